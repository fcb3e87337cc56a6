"""Views of a scene: sensors at the world's origin, viewpoints, and coarse start poses.

The world frame of a scene is the camera's frame C. These sensors see all scenes, however their
content is drawn: known objects (`object_scenes`), kinds of scenes (`scene_kinds`), or shapes of a
grammar.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.models.meshes.closed_shells import Shell, joined
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
    readonly,
    rotation_from_z,
    transform_points,
)
from uuv.sim.sensors.depth_camera import OPTICS, DepthCamera, Optics, StereoNoise
from uuv.sim.sensors.sonar import BEAMS, NOISE, Sonar, SonarBeams, SonarNoise

FOCAL = OPTICS.focal  # [px] focal length of the image
MIDDLE = np.array([0.5 * (OPTICS.width - 1), 0.5 * (OPTICS.height - 1)])  # [px] of the image
_ORIGIN = readonly(np.zeros(3))
_STEREO = SensorModel(focal=FOCAL)
_SONAR = sonar_model(BEAMS.pitch)
_FOUND = (0.01, 5.0)  # share of the range, and [deg]: largest errors of a correctly identified pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Depth camera with its true noise, and the noise model that perception uses."""

    stereo: StereoNoise | None = None  # None: no stereo noise, only `white`
    white: float = 0.0  # [m] standard deviation along the ray, independent from pixel to pixel
    optics: Optics = OPTICS  # with a port, C is the camera frame of the calibration
    model: SensorModel = _STEREO

    def frame(self, model: mujoco.MjModel, rng: np.random.Generator) -> DepthImage:
        """Depth frame of a scene.

        Args:
            model: The scene in C.
            rng: Draws the noise.
        """
        # C is the camera frame of the calibration; the true lens lies behind it.
        lens = pose(None, [0.0, 0.0, -self.optics.rectified.center])
        camera = DepthCamera(model, "world", lens, optics=self.optics, noise=self.stereo)
        _, image = camera.step(camera.init(rng), resting(model))

        # White noise is along the ray, while the image holds depth.
        if self.white > 0.0:
            u, v = (
                np.arange(n) - c
                for n, c in zip(image.depth.shape[::-1], image.K[:2, 2], strict=True)
            )
            focal = image.K[0, 0]
            slant = np.sqrt(1.0 + (u / focal) ** 2 + ((v / focal) ** 2)[:, None])
            depth = image.depth + self.white * rng.standard_normal(image.depth.shape) / slant
            image = replace(image, depth=readonly(depth))
        return image

    def look(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scan:
        """Scan from one depth frame; the arguments are those of `frame`."""
        return Scan.from_depth(self.frame(model, rng))

    def readings(self, model: mujoco.MjModel, rng: np.random.Generator) -> Array:
        """Depth (h, w) [m] of one frame, NaN without a reading; the arguments are those of
        `frame`.
        """
        return self.frame(model, rng).depth

    def exact(self, model: mujoco.MjModel) -> np.ndarray:
        """Depth (h, w) [m] of the scene along the rays that the calibration assumes, inf where no
        surface is hit.
        """
        pinhole_optics = Optics(
            width=self.optics.width, height=self.optics.height, focal=self.optics.rectified.focal
        )
        camera = DepthCamera(model, "world", np.eye(4), optics=pinhole_optics, noise=None)

        bodies = resting(model)
        return camera.render(bodies.xpos, bodies.xmat)[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Imager:
    """Multibeam 3D sonar with wide beams and independent errors, and the noise model that
    perception uses.
    """

    beams: SonarBeams = BEAMS
    noise: SonarNoise = NOISE
    model: SensorModel = _SONAR

    def look(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scan:
        """Scan from one ping, without isolated echoes.

        Args:
            model: The scene in C.
            rng: Draws the noise.
        """
        sonar = Sonar(model, "world", np.eye(4), beams=self.beams, noise=self.noise)
        return Scan.from_cloud(without_isolated_echoes(sonar.ping(resting(model), rng)))

    def readings(self, model: mujoco.MjModel, rng: np.random.Generator) -> Array:
        """Ranges (h, w) [m] of one ping, NaN without an echo; the arguments are those of `look`."""
        sonar = Sonar(model, "world", np.eye(4), beams=self.beams, noise=self.noise)
        return np.linalg.norm(sonar.ping(resting(model), rng), axis=-1)

    def exact(self, model: mujoco.MjModel) -> Array:
        """Ranges (h, w) [m] of the scene without echo errors; NaN without an echo."""
        sonar = Sonar(model, "world", np.eye(4), beams=self.beams, noise=None)
        return np.linalg.norm(sonar.ping(resting(model), np.random.default_rng(0)), axis=-1)


SENSORS: Mapping[str, Camera | Imager] = {
    "stereo": Camera(stereo=StereoNoise(disparity_sigma=0.25)),
    "white": Camera(white=0.003),
    "sonar": Imager(),
}
CAMERAS = ("stereo", "white")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectScene:
    """One frame of one object, with the true pose and the coarse start pose of the
    identification.
    """

    target: TargetModel  # the known model, which the identification searches for
    sensor: Camera | Imager
    seed: int
    model: mujoco.MjModel  # scan of all that is visible, in C
    scan: Scan
    X_CT: Array  # (4, 4) true pose
    approach: Array  # (3,) [m] coarse position of the target's centre, in C
    orientation: Array  # (3, 3) coarse rotation of T in C
    range_m: float  # [m] from the camera to its aim point
    hidden: float = 0.0  # share of the object's image that is hidden by others

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


def sensor_of(sensor: str | Camera | Imager) -> Camera | Imager:
    """A sensor, given itself or by its name in SENSORS.

    Raises:
        ConfigurationError: There is no sensor of that name; the message lists the known ones.
    """
    if not isinstance(sensor, str):
        return sensor

    if sensor not in SENSORS:
        raise ConfigurationError(f"sensor: must be one of {sorted(SENSORS)}, got {sensor!r}")
    return SENSORS[sensor]


def resting(model: mujoco.MjModel, qpos: Array | None = None) -> mujoco.MjData:
    """Poses of the bodies of a scene at rest, by default those of its model.

    Args:
        model: The scene.
        qpos: (nq,) generalised positions.
    """
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data


def meshed(solids: Sequence[Shell]) -> mujoco.MjModel:
    """Scene of visible meshes in C, fixed in the world."""
    spec = mujoco.MjSpec()
    vertices, triangles = joined(solids)

    spec.add_mesh(
        name="scene",
        uservert=vertices.astype(np.float32).ravel(),
        userface=triangles.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname="scene", contype=0, conaffinity=0
    )
    return spec.compile()


def viewpoint(range_m: float, up: float, heading: float) -> Array:
    """Position (3,) [m] at a range from the origin of a frame with z up.

    Args:
        range_m: [m]
        up: Sine of the elevation above the horizon.
        heading: [rad] about z.
    """
    flat = np.sqrt(1.0 - up**2)
    return range_m * np.array([flat * np.cos(heading), flat * np.sin(heading), up])


def camera_pose(eye: Array, at: Array = _ORIGIN, roll: float = 0.0) -> Array:
    """Pose X_CF (4, 4) of a frame F with z up, seen by a camera.

    Args:
        eye: (3,) [m] position of the camera in F.
        at: (3,) [m] point in F on its optical axis.
        roll: [rad] about that axis, from a level image.
    """
    z = at - eye
    level = rotation_from_z(z, np.cross(z, [0.0, 0.0, 1.0]))
    R_FC = level @ exp_so3([0.0, 0.0, roll])

    return inverse(pose(R_FC, eye))


def coarse_pose(
    target: TargetModel, X_CT: Array, shift: tuple[float, Array], turn: tuple[float, Array]
) -> tuple[Array, Array]:
    """Pose that a coarse detection reports for an object: position (3,) [m] of its centre and
    rotation (3, 3) of T, in C.

    Args:
        target: The object.
        X_CT: (4, 4) its true pose.
        shift: [m] error of the position, and a vector (3,) in C in its direction.
        turn: [rad] error of the attitude, and a vector (3,) in C along its axis.
    """
    off, turned = (size * way / np.linalg.norm(way) for size, way in (shift, turn))

    approach = transform_points(X_CT, target.center) + off
    return readonly(approach), readonly(exp_so3(turned) @ X_CT[:3, :3])


def pinhole(step: int) -> Array:
    """Lines of sight (h, w, 3) in C, for every `step`-th pixel of the camera, scaled to a depth of
    1.
    """
    x, y = np.meshgrid(
        (np.arange(0, OPTICS.width, step) - MIDDLE[0]) / FOCAL,
        (np.arange(0, OPTICS.height, step) - MIDDLE[1]) / FOCAL,
    )
    return np.asarray(np.stack([x, y, np.ones(x.shape)], axis=-1), dtype=np.float64)
