"""Scenes for depth cameras, seen from the camera's own frame: the world is the camera's frame C."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.models.objects.targets import BARREL_LENGTH, TargetModel, revolve
from uuv.sim.interfaces.messages import DepthImage, StateEstimate
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    inverse,
    pose,
    quat_wxyz_from_rotation,
    readonly,
    rotation_from_z,
)
from uuv.sim.sensors.depth_camera import DepthCamera, StereoNoise

DEFAULT_NOISE = StereoNoise()


@dataclass(frozen=True)
class Poses:
    """Bodies' poses of one instant, as `uuv.sim.plant.truth.Truth` holds them."""

    time: float
    xpos: Array
    xmat: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, qpos: Array | None = None) -> "Poses":
        data = mujoco.MjData(model)
        if qpos is not None:
            data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        return cls(0.25, data.xpos.copy(), data.xmat.copy())


def shoot(spec: mujoco.MjSpec, rng: np.random.Generator, noise: StereoNoise | None) -> DepthImage:
    """A frame of `spec` from a camera at the world's origin with OpenCV axes."""
    model = spec.compile()
    camera = DepthCamera(model, "world", np.eye(4), noise=noise)
    return camera.step(camera.init(rng), Poses.of(model))[1]


def add_floor(spec: mujoco.MjSpec, X_CT: Array) -> None:
    """A floor 0.45 m under the target."""
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.1],
        pos=X_CT[:3, 3] - 0.45 * X_CT[:3, 2],
        quat=quat_wxyz_from_rotation(X_CT[:3, :3]),
    )


def look(
    target: TargetModel,
    X_CT: Array,
    rng: np.random.Generator,
    noise: StereoNoise | None = DEFAULT_NOISE,
    floor: bool = True,
) -> DepthImage:
    """A frame of `target` at `X_CT` on its stand, on a floor."""
    spec = mujoco.MjSpec()
    target.add_to(spec, X_CT, felt=False)
    if floor:
        add_floor(spec, X_CT)
    return shoot(spec, rng, noise)


def halved(frame: DepthImage) -> DepthImage:
    """Every second row and column of a frame, which is searched faster."""
    K = np.diag([0.5, 0.5, 1.0]) @ frame.K
    return replace(frame, depth=readonly(frame.depth[::2, ::2]), K=readonly(K))


def seen_from(p_TC: Array, at_T: Array | None = None) -> Array:
    """X_CT of a level camera at `p_TC` (3,) [m] in the target's frame that looks at `at_T`, default
    its origin.
    """
    z = (np.zeros(3) if at_T is None else at_T) - p_TC
    return inverse(pose(rotation_from_z(z, np.cross(z, [0.0, 0.0, 1.0])), p_TC))


def random_view(rng: np.random.Generator, near: float = 1.0, far: float = 1.5) -> Array:
    """X_CT from any side, 10 to 60 deg above the horizon, at `near` to `far` [m]."""
    distance, climb, heading = rng.uniform(
        [near, np.deg2rad(10), -np.pi], [far, np.deg2rad(60), np.pi]
    )
    p_TC = distance * np.array(
        [np.cos(climb) * np.cos(heading), np.cos(climb) * np.sin(heading), np.sin(climb)]
    )
    return seen_from(p_TC, rng.normal(0.0, 0.05, 3))


def coarse(rng: np.random.Generator, X_CT: Array, center_T: Array) -> tuple[Array, Array]:
    """A coarse detection: position 10 to 30 cm, orientation up to 30 deg wrong."""
    aside, axis = rng.normal(size=(2, 3))
    approach = (
        X_CT[:3, :3] @ center_T
        + X_CT[:3, 3]
        + aside / np.linalg.norm(aside) * rng.uniform(0.1, 0.3)
    )
    return approach, exp_so3(
        axis / np.linalg.norm(axis) * np.deg2rad(rng.uniform(0.0, 30.0))
    ) @ X_CT[:3, :3]


def dented_barrel(
    depth: float, x: float = 0.05, azimuth: float = 0.0, width: float = 0.06
) -> TargetModel:
    """The barrel with a smooth dent of `depth` [m] (a bulge if negative) and Gaussian `width`
    [m].
    """
    half, radius, rim = 0.5 * BARREL_LENGTH, 0.3, 0.31
    shell = np.linspace(0.03 - half, half - 0.03, 141)
    xs = np.concatenate([[-half, -half, 0.03 - half], shell, [half - 0.03, half, half]])
    radii = np.concatenate([[0.0, rim, rim], np.full(len(shell), radius), [rim, rim, 0.0]])
    vertices, triangles = revolve(np.column_stack([xs, radii]), 320)
    r = np.linalg.norm(vertices[:, 1:], axis=1)
    arc = radius * np.angle(np.exp(1j * (np.arctan2(-vertices[:, 1], vertices[:, 2]) - azimuth)))
    off = depth * np.exp(-((vertices[:, 0] - x) ** 2 + arc**2) / (2.0 * width**2))
    off *= (r > 0.25) & (np.abs(vertices[:, 0]) < half - 0.031)
    vertices[:, 1:] *= (1.0 - off / np.maximum(r, 1e-9))[:, None]
    return TargetModel(name="dented barrel", vertices=vertices, triangles=triangles)


def standing(X_WB: Array) -> StateEstimate:
    """A hull at rest at `X_WB` (4, 4), without an arm."""
    zero, none = np.zeros(3), np.zeros(0)
    return StateEstimate(
        time=0.0, X_WB=X_WB, v_WB_B=zero, w_WB_B=zero, a_WB_B=zero, q=none, qd=none, tau=none
    )
