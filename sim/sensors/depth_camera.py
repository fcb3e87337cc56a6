"""A stereo depth camera by ray casting: every geom that a viewer shows, and the errors that stereo makes.

Frame C has OpenCV axes: x right, y down, z along the optical axis.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import DepthImage
from sim.interfaces.spatial import Array, checked_pose, pose, readonly, rotation_from_quat_wxyz
from sim.sensors.refraction import FlatPort, PortCalibration, in_water, read_depth
from sim.sensors.stereo_noise import StereoNoise, add_noise
from sim.sensors.visible_world import VISIBLE_GROUPS, BodyPoses, Rays, VisibleWorld, body_id, names, site_on_body

NEAR = 0.02  # [m], nothing closer than this to the camera's plane is drawn
NOISE = StereoNoise()


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCameraState:
    """Where the camera's noise has come to; a frame depends on nothing else, so a run can be replayed."""

    seed: int
    frame: int


class DepthCamera:
    """A depth camera fixed to a body of a compiled model; delivers one frame each time it is asked (`period` 0)."""

    period = 0.0  # [s], on request

    def __init__(
        self,
        model: mujoco.MjModel,
        hull: str,
        X_BC: Array,
        *,
        width: int = 640,
        height: int = 480,
        focal: float = 554.0,
        range_limits: tuple[float, float] = (0.3, 10.0),
        noise: StereoNoise | None = NOISE,
        delay: float = 0.0,
        exclude: Collection[str] = (),
        groups: Collection[int] = VISIBLE_GROUPS,
        port: FlatPort | None = None,
        calibration: PortCalibration | None = None,
    ) -> None:
        """Mount the camera on body `hull` of `model` at `X_BC` (4, 4), OpenCV axes.

        `width`, `height` and `focal` are in px, the principal point is the middle of the picture; `range_limits` and
        `delay` are in m and s; `noise` None gives exact depth; bodies named in `exclude` and geoms outside `groups`
        are not seen, nor are transparent ones (alpha 0), flexes and skins.

        Without `port` the camera is a pinhole that is known exactly. Behind a `port` (`sim.sensors.refraction`),
        `focal` is that of the lens, and frames are rectified by `calibration`, the best in water by default: their `K`
        and the place that they claim for the camera are those of the calibration, right or wrong.
        Raises ConfigurationError for unknown bodies or impossible numbers, MissingLibraryError without a ray caster.
        """
        whole = all(isinstance(pixels, int | np.integer) and pixels > 0 for pixels in (width, height))
        if not (whole and 0.0 < focal < np.inf):
            raise ConfigurationError(f"depth camera: {width} x {height} px with focal {focal} px is no camera")
        if not (len(range_limits) == 2 and 0.0 < range_limits[0] < range_limits[1]):
            raise ConfigurationError(f"depth camera: range_limits must be 0 < near < far, got {range_limits}")
        if not delay >= 0.0:
            raise ConfigurationError(f"depth camera: delay must not be negative, got {delay}")
        self.delay = delay
        self._hull = body_id(model, hull, "depth camera")
        self._X_BC = checked_pose(X_BC, "X_BC")
        self._range = range_limits
        self._noise = noise
        if calibration is not None and port is None:
            raise ConfigurationError("depth camera: a calibration corrects for a port; there is none")
        if port is not None and calibration is None:
            calibration = in_water(port, focal, 0.5 * float(np.hypot(width, height)))
        self._port, self._calibration, self._focal = port, calibration, focal
        self._baseline = (noise or NOISE).baseline
        f = calibration.focal if calibration is not None else focal
        self._K = readonly([[f, 0, 0.5 * (width - 1)], [0, f, 0.5 * (height - 1)], [0, 0, 1]])
        self._X_BC_said = self._X_BC
        v, u = np.indices((height, width))
        tangents = np.stack([(u - self._K[0, 2]) / f, (v - self._K[1, 2]) / f], axis=-1)
        self._tangent_x = np.ascontiguousarray(tangents[0, :, 0])
        # With unit z component the ray parameter is the depth along the optical axis.
        start, way = None, np.concatenate([tangents, np.ones((height, width, 1))], axis=-1)
        if port is not None and calibration is not None:
            self._X_BC_said = readonly(self._X_BC @ pose(None, [0.0, 0.0, calibration.center]))
            start, way = port.rays(calibration.raw(tangents, focal))
        self._rays = Rays.of(way, NEAR, start)
        unseen = {body_id(model, name, "depth camera") for name in exclude}
        self._world = VisibleWorld(model, exclude=unseen, groups=groups)

    @classmethod
    def at_site(cls, model: mujoco.MjModel, site: str, **options: Any) -> "DepthCamera":
        """A camera at `site`, looking along its z axis with x to the right; options as in the constructor."""
        body, X_BC = site_on_body(model, site, "depth camera")
        return cls(model, body, X_BC, **options)

    @classmethod
    def at_camera(cls, model: mujoco.MjModel, camera: str, **options: Any) -> "DepthCamera":
        """A camera where MuJoCo's `camera` is (which looks along its -z axis, y up); options as in the constructor."""
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if index < 0:
            raise ConfigurationError(
                f"depth camera: no camera {camera!r}; there are {names(model, 'camera', model.ncam)}"
            )
        R_BC = rotation_from_quat_wxyz(model.cam_quat[index]) @ np.diag([1.0, -1.0, -1.0])
        return cls(model, model.body(model.cam_bodyid[index]).name, pose(R_BC, model.cam_pos[index]), **options)

    @property
    def K(self) -> Array:
        """Pinhole matrix (3, 3) [px]."""
        return self._K

    def init(self, rng: np.random.Generator) -> DepthCameraState:
        """Draw the seed of this camera's noise from `rng`."""
        return DepthCameraState(seed=int(rng.integers(2**63)), frame=0)

    def step(self, state: DepthCameraState, truth: BodyPoses) -> tuple[DepthCameraState, DepthImage]:
        """One frame of the world as `truth` has it; the same state and truth always give the same frame."""
        depth, cosine = self.render(truth.xpos, truth.xmat)
        if self._noise is not None:
            depth = add_noise(
                depth, cosine, float(self._K[0, 0]), self._noise, np.random.default_rng([state.seed, state.frame])
            )
        depth = depth.astype(np.float64)
        depth[~((depth >= self._range[0]) & (depth <= self._range[1]))] = np.nan
        depth.setflags(write=False)
        image = DepthImage(time=float(truth.time), depth=depth, K=self._K, X_BC=self._X_BC_said)
        return DepthCameraState(seed=state.seed, frame=state.frame + 1), image

    def render(self, xpos: Array, xmat: Array) -> tuple[np.ndarray, np.ndarray]:
        """Depth (height, width) [m], inf where nothing is hit, and cosine of the incidence there.

        Depth is exact without a port; with one, it is what the calibration makes of exact disparities.

        `xpos` (nbody, 3) [m] and `xmat` (nbody, 9) are the bodies' world poses.
        """
        R_W = np.asarray(xmat, dtype=np.float64).reshape(-1, 3, 3)
        X_WC = pose(R_W[self._hull], xpos[self._hull]) @ self._X_BC
        depth, cosine = self._world.cast(X_WC, self._rays, xpos, R_W)
        if self._port is not None and self._calibration is not None:
            with np.errstate(invalid="ignore"):  # 0 times inf where nothing is hit
                points = self._rays.origins + depth[..., None] * self._rays.directions
            depth = read_depth(points, self._tangent_x, self._port, self._calibration, self._focal, self._baseline)
        return depth, cosine
