"""Random scenes for identification: a known object near the seabed, stones around it, one frame, a
coarse start pose.

The world frame is the camera's frame C. A seed gives the same scene for every sensor, so that
sensors and methods can be compared scene by scene. `scene_kinds` makes scenes that are right or
wrong in a known way, and `placing` puts bodies beside, on and before each other.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from uuv.models.objects import targets
from uuv.models.objects.targets import TargetModel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.clouds.sonar_cloud import sonar_model, without_isolated_echoes
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    inverse,
    pose,
    quat_wxyz_from_rotation,
    readonly,
    rotation_from_z,
    transform_points,
)
from uuv.sim.sensors.depth_camera import DepthCamera, Optics, StereoNoise
from uuv.sim.sensors.sonar import BEAMS, NOISE, Sonar, SonarBeams, SonarNoise

FOCAL = 554.0  # [px] focal length of an image of 640 x 480
RANGES = (1.0, 2.0)  # [m] from the camera to the object
# Objects whose centre does not show their height: camera aim p_T [m], elevations [rad].
_AIM = {"pile": ((0.0, 0.0, 0.2), (-0.25, 0.5))}
# Default range of the camera's elevation above the horizon of T [rad].
_CLIMB = (np.deg2rad(15.0), np.deg2rad(70.0))
_ROLL = np.deg2rad(10.0)  # [rad] largest roll of the camera, either way
_STEREO = SensorModel(focal=FOCAL)
_SONAR = sonar_model(BEAMS.pitch)
_STONES = 3  # on the seabed
_FOUND = (0.01, 5.0)  # share of the range, [deg]: bounds of a found pose
_CLEAR = 0.08  # [m] least distance of a stone from the sphere around the object


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Depth camera: its true noise, and the noise model that perception uses."""

    stereo: StereoNoise | None = None  # None: no stereo noise, only `white`
    white: float = 0.0  # [m] standard deviation along the ray, independent from pixel to pixel
    model: SensorModel = _STEREO

    def look(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> Scan:
        """Scan of one depth frame taken from the world's origin.

        Args:
            model: The scene.
            data: Its state, kinematics computed.
            rng: Draws the noise.
        """
        camera = DepthCamera(
            model, "world", np.eye(4), optics=Optics(focal=FOCAL), noise=self.stereo
        )
        _, image = camera.step(camera.init(rng), _Poses(time=0.0, xpos=data.xpos, xmat=data.xmat))

        # White noise is along the ray: the depth changes by its share of the slant.
        if self.white > 0.0:
            u, v = (
                np.arange(n) - c
                for n, c in zip(image.depth.shape[::-1], image.K[:2, 2], strict=True)
            )
            slant = np.sqrt(1.0 + (u / FOCAL) ** 2 + ((v / FOCAL) ** 2)[:, None])
            depth = image.depth + self.white * rng.standard_normal(image.depth.shape) / slant
            image = DepthImage(time=image.time, depth=readonly(depth), K=image.K, X_BC=image.X_BC)

        return Scan.from_depth(image)


@dataclass(frozen=True, slots=True, kw_only=True)
class Imager:
    """Multibeam 3D sonar with wide beams and independent errors, and the noise model that
    perception uses.
    """

    beams: SonarBeams = BEAMS
    noise: SonarNoise = NOISE
    model: SensorModel = _SONAR

    def look(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> Scan:
        """Scan of one ping from the world's origin, lone echoes removed.

        Args:
            model: The scene.
            data: Its state, kinematics computed.
            rng: Draws the noise.
        """
        sonar = Sonar(model, "world", np.eye(4), beams=self.beams, noise=self.noise)
        return Scan.from_cloud(without_isolated_echoes(sonar.ping(data, rng)))


SENSORS: Mapping[str, Camera | Imager] = {
    "stereo": Camera(stereo=StereoNoise(disparity_sigma=0.25)),
    "white": Camera(white=0.003),
    "sonar": Imager(),
}
CAMERAS = ("stereo", "white")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectScene:
    """One frame of one object, with the truth and the coarse start of identification."""

    target: TargetModel  # the known model, which is searched for
    sensor: Camera | Imager
    seed: int
    scan: Scan
    X_CT: Array  # (4, 4) true pose
    approach: Array  # (3,) [m] coarse position of the target's centre, in C
    orientation: Array  # (3, 3) coarse rotation of T in C
    range_m: float  # [m] from the camera to the point that it is aimed at
    hidden: float = 0.0  # share of the object's image behind others

    def error(self, X_CT: Array) -> tuple[float, float]:
        """Error of an estimated pose (4, 4) in C, modulo the declared symmetry.

        Returns:
            Distance of the object's centres [m], rotation angle [rad].
        """
        X = self.target.symmetry.nearest_pose(np.asarray(X_CT), self.X_CT[:3, :3])
        center = self.target.center
        off = float(
            np.linalg.norm(transform_points(X, center) - transform_points(self.X_CT, center))
        )
        return off, self.target.symmetry.error(X, self.X_CT)[1]

    def is_found(self, X_CT: Array) -> bool:
        """Whether an estimated pose (4, 4) in C counts as found: within 1 % of the range and 5
        deg.
        """
        off, angle = self.error(X_CT)
        return bool(off < _FOUND[0] * self.range_m and np.rad2deg(angle) < _FOUND[1])


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
    sensor: str = "stereo",
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
        sensor: Name in SENSORS.
        ranges: [m] least and largest range.
        start_error: [m], [rad] bounds of the coarse start's error, uniform.
        gap: [m] bounds of the distance from the lowest part of object and stand down to the seabed.
            0 means that they lie on it, None neither seabed nor stones.
        there: The true object; None: `target`.
        absent: Leave the object out of the scene.
        X_CN: (4, 4) pose from which the same scene is seen instead, in the camera frame of the
            seed's view; the result is in N. None: the seed's view.
        look: Number of the look, which draws its noise.

    Returns:
        The scene with its scan.

    Raises:
        ConfigurationError: The object or sensor is unknown, or a number is out of range.
    """
    if not 0.0 < ranges[0] <= ranges[1] < np.inf:
        raise ConfigurationError(f"ranges: must be 0 < near <= far [m], got {ranges}")
    if not np.all(np.isfinite(start_error)) or min(start_error) < 0.0:
        raise ConfigurationError(f"start error: must not be negative [m], [rad], got {start_error}")
    target = target_of(target) if isinstance(target, str) else target
    if sensor not in SENSORS:
        raise ConfigurationError(f"no sensor {sensor!r}; there are {sorted(SENSORS)}")

    # What is where, in the camera's frame.
    X_CT, range_m = seeded_view(target, seed, ranges)
    if X_CN is not None:
        X_CT = inverse(X_CN) @ X_CT
    shown = there or target

    # The scene; an absent object still decides where the ground is.
    spec = mujoco.MjSpec()
    if not absent:
        shown.add_to(spec, X_CT, felt=False)
    if gap is not None:
        _add_surroundings(spec, np.random.default_rng([seed, 1]), X_CT, shown, gap)

    # The frame; further looks have noise of their own.
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    noise = np.random.default_rng([seed, 2, look] if look else [seed, 2])
    scan = SENSORS[sensor].look(model, data, noise)

    approach, orientation = _coarse_start(target, X_CT, seed, start_error)
    return ObjectScene(
        target=target,
        sensor=SENSORS[sensor],
        seed=seed,
        scan=scan,
        X_CT=readonly(X_CT),
        approach=approach,
        orientation=orientation,
        range_m=range_m,
    )


def seeded_view(
    target: TargetModel, seed: int, ranges: tuple[float, float] = RANGES
) -> tuple[Array, float]:
    """Pose X_CT (4, 4) of the object in the view of `seed`, and its range [m] within `ranges`,
    whatever else is in the scene.
    """
    rng = np.random.default_rng([seed, 0])
    aim, climb = _AIM.get(target.name, (target.center, _CLIMB))
    range_m = float(rng.uniform(*ranges))
    return _view(rng, np.asarray(aim), range_m, climb), range_m


def _coarse_start(
    target: TargetModel, X_CT: Array, seed: int, most: tuple[float, float]
) -> tuple[Array, Array]:
    """What `coarse_pose` gives with errors of at most `most` [m], [rad]."""
    rng = np.random.default_rng([seed, 3])
    aside, axis = rng.normal(size=(2, 3))
    distance, angle = rng.uniform(size=2) * most
    shift = distance * aside / np.linalg.norm(aside)
    return coarse_pose(target, X_CT, shift, angle * axis / np.linalg.norm(axis))


def camera_pose(eye: Array, at: Array, roll: float = 0.0) -> Array:
    """Pose X_CF (4, 4) of a frame F with z up, seen by a camera.

    Args:
        eye: (3,) [m] position of the camera in F.
        at: (3,) [m] point in F on its optical axis.
        roll: [rad] about that axis, from a level image.
    """
    z = at - eye
    R_FC = rotation_from_z(z, np.cross(z, [0.0, 0.0, 1.0])) @ exp_so3([0.0, 0.0, roll])
    return inverse(pose(R_FC, eye))


def coarse_pose(target: TargetModel, X_CT: Array, shift: Array, turn: Array) -> tuple[Array, Array]:
    """What a coarse detection says of an object: position (3,) [m] of its centre and rotation
    (3, 3) of T, in C.

    Args:
        target: The object.
        X_CT: (4, 4) its true pose.
        shift: (3,) [m] error of the position, in C.
        turn: (3,) [rad] error of the attitude as a rotation vector, in C.
    """
    approach = transform_points(X_CT, target.center) + shift
    return readonly(approach), readonly(exp_so3(turn) @ X_CT[:3, :3])


def _view(
    rng: np.random.Generator, aim: Array, range_m: float, climb: tuple[float, float]
) -> Array:
    """X_CT of a nearly level camera at `range_m` [m] from `aim` (3,) [m] in T, pointed slightly
    beside it.
    """
    low, high = np.sin(climb)
    heading, up, roll = rng.uniform([-np.pi, low, -_ROLL], [np.pi, high, _ROLL])
    flat = np.sqrt(1.0 - up**2)
    p_TC = aim + range_m * np.array([flat * np.cos(heading), flat * np.sin(heading), up])
    return camera_pose(p_TC, aim + rng.normal(0.0, 0.03, 3), roll)


def _lowest(target: TargetModel) -> float:
    """z_T [m] of the lowest point of object and stand."""
    # stands are made of boxes
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
    """A seabed below what is in the object's place, and stones on it."""
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
    """An ellipsoid half in the seabed beside the object, so that it neither touches nor hides
    it.
    """
    center_C = transform_points(X_CT, target.center)
    for _ in range(20):
        size = rng.uniform(0.03, 0.15, 3)
        away = target.radius + _CLEAR + float(size.max()) + rng.uniform(0.0, 0.5)
        heading = rng.uniform(-np.pi, np.pi)
        p_T = np.array(
            [*(target.center[:2] + away * np.array([np.cos(heading), np.sin(heading)])), floor]
        )
        p_C = transform_points(X_CT, p_T)

        # Behind the object, or beside it in the image.
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


@dataclass(frozen=True, slots=True)
class _Poses:
    """Body poses in the form in which a depth camera reads the plant's truth."""

    time: float
    xpos: Array
    xmat: Array
