"""Depth frames of objects at given poses, and random views of them; the world is the camera's
frame C.
"""

from dataclasses import replace

import mujoco
import numpy as np

from uuv.clouds.frames import Camera, camera_pose, coarse_pose, viewpoint
from uuv.clouds.object_scenes import add_seabed
from uuv.models.objects.targets import BARREL_LENGTH, TargetModel, revolve
from uuv.sim.interfaces.messages import DepthImage, StateEstimate
from uuv.sim.interfaces.spatial import Array, readonly
from uuv.sim.sensors.depth_camera import StereoNoise

DEFAULT_NOISE = StereoNoise()
FLOOR = -0.45  # [m] height of the floor in the target's frame


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
        add_seabed(spec, X_CT, FLOOR)
    return Camera(stereo=noise).frame(spec.compile(), rng)


def halved(frame: DepthImage) -> DepthImage:
    """Every second row and column of a frame, which is searched faster."""
    K = np.diag([0.5, 0.5, 1.0]) @ frame.K
    return replace(frame, depth=readonly(frame.depth[::2, ::2]), K=readonly(K))


def random_view(rng: np.random.Generator, near: float = 1.0, far: float = 1.5) -> Array:
    """X_CT from any side, 10 to 60 deg above the horizon, at `near` to `far` [m]."""
    distance, climb, heading = rng.uniform(
        [near, np.deg2rad(10), -np.pi], [far, np.deg2rad(60), np.pi]
    )
    eye = viewpoint(distance, np.sin(climb), heading)
    return camera_pose(eye, rng.normal(0.0, 0.05, 3))


def coarse(rng: np.random.Generator, X_CT: Array, target: TargetModel) -> tuple[Array, Array]:
    """A coarse detection: position 10 to 30 cm, orientation up to 30 deg wrong."""
    aside, axis = rng.normal(size=(2, 3))
    distance = rng.uniform(0.1, 0.3)
    angle = np.deg2rad(rng.uniform(0.0, 30.0))
    return coarse_pose(target, X_CT, (distance, aside), (angle, axis))


def dented_barrel(
    depth: float, x: float = 0.05, azimuth: float = 0.0, width: float = 0.06
) -> TargetModel:
    """The barrel with a smooth dent of `depth` [m] (a bulge if negative) and Gaussian `width`
    [m].
    """
    half = 0.5 * BARREL_LENGTH
    radius = 0.3
    rim = 0.31
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
