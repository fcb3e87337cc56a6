"""Random scenes for identification: a known object near the seabed with stones around it, one
frame, and a coarse start pose.

The world frame is the camera's frame C. A seed gives the same scene for every sensor, so that
sensors and methods can be compared scene by scene. `scene_kinds` makes scenes with a known
difficulty or fault. `placing` places bodies next to, on and in front of each other. `frames`
contains the sensors that see the scenes.
"""

from functools import cache

import mujoco
import numpy as np

from uuv.clouds.frames import (
    Camera,
    Imager,
    ObjectScene,
    camera_pose,
    coarse_pose,
    sensor_of,
    viewpoint,
)
from uuv.models.objects import targets
from uuv.models.objects.targets import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    inverse,
    quat_wxyz_from_rotation,
    readonly,
    transform_points,
)

RANGES = (1.0, 2.0)  # [m] from the camera to the object
# Aim points p_T [m] and elevations [rad] of the camera, for objects whose centre does not show
# their height.
_AIM = {"pile": ((0.0, 0.0, 0.2), (-0.25, 0.5))}
# Default range of the camera's elevation above the horizon of T [rad].
_CLIMB = (np.deg2rad(15.0), np.deg2rad(70.0))
_ROLL = np.deg2rad(10.0)  # [rad] largest roll of the camera in either direction
_STONES = 3  # on the seabed
_CLEAR = 0.08  # [m] least distance of a stone from the sphere around the object


@cache
def target_of(name: str) -> TargetModel:
    """The library object `name` with default options.

    Raises:
        ConfigurationError: The name is unknown; the message lists the known ones.
    """
    return targets.named(name)


def object_scene(
    target: TargetModel | str,
    seed: int,
    sensor: str | Camera | Imager = "stereo",
    *,
    ranges: tuple[float, float] = RANGES,
    start_error: tuple[float, float] = (0.3, np.deg2rad(45.0)),
    gap: tuple[float, float] | None = (0.05, 0.4),
    there: TargetModel | None = None,
    absent: bool = False,
    X_CN: Array | None = None,
    look: int = 0,
) -> ObjectScene:
    """The scene of `seed`, seen from a range within `ranges`.

    Args:
        target: The known model, or its name.
        seed: Draws view, seabed, noise and coarse start, each from its own stream.
        sensor: The sensor, or its name in SENSORS.
        ranges: [m] least and largest range.
        start_error: [m], [rad] bounds of the coarse start's error, uniform.
        gap: [m] Bounds of the distance from the lowest part of object and stand down to the seabed.
            0: they lie on the seabed. None: there are neither seabed nor stones.
        there: The object that is truly in the scene; None: `target`.
        absent: Whether the object is left out of the scene.
        X_CN: (4, 4) pose from which the same scene is seen instead, in the camera frame of the
            seed's view; the result is in N. None: the seed's view.
        look: Number of the look, which draws its noise.

    Returns:
        The scene with its scan.

    Raises:
        ConfigurationError: The object or sensor is unknown, or a number is out of range.
    """
    check_limits(ranges, start_error)
    target = target_of(target) if isinstance(target, str) else target
    sensor = sensor_of(sensor)

    # Poses in the camera's frame.
    X_CT, range_m = seeded_view(target, seed, ranges)
    if X_CN is not None:
        X_CT = inverse(X_CN) @ X_CT
    shown = there or target

    # The scene; the height of the ground depends on the object even if the object is absent.
    spec = mujoco.MjSpec()
    if not absent:
        shown.add_to(spec, X_CT, felt=False)
    if gap is not None:
        _add_surroundings(spec, np.random.default_rng([seed, 1]), X_CT, shown, gap)

    # The frame; each further look has its own noise.
    model = spec.compile()
    noise = np.random.default_rng([seed, 2, look] if look else [seed, 2])
    scan = sensor.look(model, noise)

    approach, orientation = _coarse_start(target, X_CT, seed, start_error)
    return ObjectScene(
        target=target,
        sensor=sensor,
        seed=seed,
        model=model,
        scan=scan,
        X_CT=readonly(X_CT),
        approach=approach,
        orientation=orientation,
        range_m=range_m,
    )


def check_limits(ranges: tuple[float, float], start_error: tuple[float, float]) -> None:
    """Refuse invalid bounds of the range [m] and of the coarse start's error [m], [rad].

    Raises:
        ConfigurationError: The message names the bounds, the allowed values and the given ones.
    """
    if not 0.0 < ranges[0] <= ranges[1] < np.inf:
        raise ConfigurationError(f"ranges: must be 0 < near <= far [m], got {ranges}")
    if not np.all(np.isfinite(start_error)) or min(start_error) < 0.0:
        raise ConfigurationError(f"start error: must not be negative [m], [rad], got {start_error}")


def seeded_view(
    target: TargetModel, seed: int, ranges: tuple[float, float] = RANGES
) -> tuple[Array, float]:
    """Pose X_CT (4, 4) of the object in the view of `seed`, and its range [m] within `ranges`,
    independent of everything else in the scene.
    """
    rng = np.random.default_rng([seed, 0])
    aim, climb = _AIM.get(target.name, (target.center, _CLIMB))
    range_m = float(rng.uniform(*ranges))
    return _view(rng, np.asarray(aim), range_m, climb), range_m


def _coarse_start(
    target: TargetModel, X_CT: Array, seed: int, most: tuple[float, float]
) -> tuple[Array, Array]:
    """Result of `coarse_pose` with errors of at most `most` [m], [rad]."""
    rng = np.random.default_rng([seed, 3])
    aside, axis = rng.normal(size=(2, 3))
    distance, angle = rng.uniform(size=2) * most
    return coarse_pose(target, X_CT, (distance, aside), (angle, axis))


def _view(
    rng: np.random.Generator, aim: Array, range_m: float, climb: tuple[float, float]
) -> Array:
    """X_CT of a nearly level camera at `range_m` [m] from `aim` (3,) [m] in T, with the optical
    axis slightly off this point.
    """
    low, high = np.sin(climb)
    heading, up, roll = rng.uniform([-np.pi, low, -_ROLL], [np.pi, high, _ROLL])
    p_TC = aim + viewpoint(range_m, up, heading)
    return camera_pose(p_TC, aim + rng.normal(0.0, 0.03, 3), roll)


def _lowest(target: TargetModel) -> float:
    """z_T [m] of the lowest point of object and stand."""
    # stands consist of boxes
    stand = [
        float(solid.X_TS[2, 3] - np.abs(solid.X_TS[2, :3]) @ np.array(solid.size))
        for solid in target.stand
    ]
    return min([float(target.vertices[:, 2].min()), *stand])


def _add_surroundings(
    spec: mujoco.MjSpec,
    rng: np.random.Generator,
    X_CT: Array,
    shown: TargetModel,
    gap: tuple[float, float],
) -> None:
    """Add a seabed below the object that is in the scene, and stones on it."""
    floor = _lowest(shown) - float(rng.uniform(*gap))
    add_seabed(spec, X_CT, floor)
    for _ in range(_STONES):
        _add_stone(spec, rng, X_CT, shown, floor)


def add_seabed(spec: mujoco.MjSpec, X_CT: Array, height: float) -> None:
    """Add a level seabed at z_T = `height` [m]."""
    spec.worldbody.add_geom(
        name="seabed",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.1],
        pos=transform_points(X_CT, np.array([0.0, 0.0, height])),
        quat=quat_wxyz_from_rotation(X_CT[:3, :3]),
    )


def _add_stone(
    spec: mujoco.MjSpec, rng: np.random.Generator, X_CT: Array, target: TargetModel, floor: float
) -> None:
    """Add a stone, an ellipsoid half in the seabed, that neither touches nor hides the object."""
    center_C = transform_points(X_CT, target.center)
    for _ in range(20):
        size = rng.uniform(0.03, 0.15, 3)
        away = target.radius + _CLEAR + float(size.max()) + rng.uniform(0.0, 0.5)
        heading = rng.uniform(-np.pi, np.pi)
        p_T = np.array(
            [*(target.center[:2] + away * np.array([np.cos(heading), np.sin(heading)])), floor]
        )
        p_C = transform_points(X_CT, p_T)

        # Behind the object, or next to it in the image.
        apart = np.arccos(
            np.clip(p_C @ center_C / (np.linalg.norm(p_C) * np.linalg.norm(center_C)), -1.0, 1.0)
        )
        width = np.arcsin(min(1.0, target.radius / float(np.linalg.norm(center_C)))) + float(
            np.arcsin(min(1.0, size.max() / float(np.linalg.norm(p_C))))
        )
        if np.linalg.norm(p_C) > np.linalg.norm(center_C) or apart > width:
            R = X_CT[:3, :3] @ exp_so3(rng.normal(0.0, 0.3, 3))
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
                size=size,
                pos=p_C,
                quat=quat_wxyz_from_rotation(R),
            )
            return
