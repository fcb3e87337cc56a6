"""Stereo depth camera, simulated by ray casting, with stereo errors and an optional flat port.

Frame C has OpenCV axes: x right, y down, z along the optical axis.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import Array, checked_pose, pose, readonly, rotation_from_quat_wxyz
from uuv.sim.sensors.refraction import FlatPort, PortCalibration, StereoReader, in_water
from uuv.sim.sensors.stereo_noise import StereoNoise, add_noise
from uuv.sim.sensors.visible_world import (
    ALL,
    BodyPoses,
    Rays,
    Visible,
    body_id,
    names,
    site_on_body,
)

NEAR = 0.02  # [m] surfaces closer than this to the camera's plane are not seen
NOISE = StereoNoise()


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """Optics of a camera: image size, focal length, flat port (`uuv.sim.sensors.refraction`).

    Without `port` the camera is an exactly known pinhole. Behind a port, frames are rectified by
    `calibration`. Their `K` and camera pose are then those of the calibration, even if it is wrong.
    """

    width: int = 640  # [px]
    height: int = 480  # [px]
    focal: float = 554.0  # [px] of the lens; the principal point is the centre of the image
    port: FlatPort | None = None  # flat port before the lens
    # for rectification; None with a port: the best calibration in water
    calibration: PortCalibration | None = None

    def __post_init__(self) -> None:
        width = self.width
        height = self.height
        focal = self.focal
        whole = all(
            isinstance(pixels, int | np.integer) and pixels > 0 for pixels in (width, height)
        )
        if not (whole and 0.0 < focal < np.inf):
            raise ConfigurationError(
                "depth camera: width and height must be whole numbers > 0 and focal finite and > "
                f"0 px, got {width} x {height} px and {focal} px"
            )

        if self.calibration is not None and self.port is None:
            raise ConfigurationError(
                "depth camera: a calibration needs a port, which it corrects for; got none"
            )

    @property
    def rectified(self) -> PortCalibration:
        """Calibration of the frames; without a port that of the bare lens."""
        if self.port is None:
            return PortCalibration(focal=self.focal)
        return self.calibration or in_water(
            self.port, self.focal, 0.5 * float(np.hypot(self.width, self.height))
        )


OPTICS = Optics()


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCameraState:
    """State of the noise. A frame depends only on this state and the truth, so a run can be
    repeated.
    """

    seed: int
    frame: int


class DepthCamera:
    """Depth camera fixed to a body of a compiled model. It sends one frame for each request
    (`period` 0).
    """

    period = 0.0  # [s], on request

    def __init__(
        self,
        model: mujoco.MjModel,
        hull: str,
        X_BC: Array,
        *,
        optics: Optics = OPTICS,
        range_limits: tuple[float, float] = (0.3, 10.0),
        noise: StereoNoise | None = NOISE,
        delay: float = 0.0,
        visible: Visible = ALL,
    ) -> None:
        """Mount the camera on a body.

        Args:
            model: Compiled model.
            hull: Name of the body.
            X_BC: Pose of the camera in the body (4, 4), OpenCV axes.
            optics: Image, lens and port.
            range_limits: Closest and farthest depth [m].
            noise: Error model; None: exact depth.
            delay: [s]
            visible: Surfaces that the camera sees.

        Raises:
            ConfigurationError: A body is unknown, or a number is invalid.
            MissingLibraryError: No ray caster is installed.
        """
        if not (len(range_limits) == 2 and 0.0 < range_limits[0] < range_limits[1]):
            raise ConfigurationError(
                f"depth camera: range_limits must be 0 < near < far, got {range_limits}"
            )
        if not delay >= 0.0:
            raise ConfigurationError(f"depth camera: delay must not be negative, got {delay}")

        self.delay = delay
        self._hull = body_id(model, hull, "depth camera")
        self._X_BC = checked_pose(X_BC, "X_BC")
        self._range = range_limits
        self._noise = noise
        calibration = optics.rectified
        port = optics.port
        width = optics.width
        height = optics.height
        f = calibration.focal
        self._K = readonly([[f, 0, 0.5 * (width - 1)], [0, f, 0.5 * (height - 1)], [0, 0, 1]])
        self._X_BC_said = self._X_BC

        # Rays of the rectified image.
        v, u = np.indices((height, width))
        tangents = np.stack([(u - self._K[0, 2]) / f, (v - self._K[1, 2]) / f], axis=-1)
        # With a unit z component, the ray parameter is the depth along the optical axis.
        start = None
        way = np.concatenate([tangents, np.ones((height, width, 1))], axis=-1)
        self._reader: StereoReader | None = None
        if port is not None:
            self._X_BC_said = readonly(self._X_BC @ pose(None, [0.0, 0.0, calibration.center]))
            start, way = port.rays(calibration.raw(tangents, optics.focal))
            tangent_x = np.ascontiguousarray(tangents[0, :, 0])
            self._reader = StereoReader.of(
                port, calibration, optics.focal, (noise or NOISE).baseline, tangent_x
            )
        self._ways = way
        self._starts = start

        self._world = visible.world(model, "depth camera")

    @cached_property
    def _rays(self) -> Rays:
        """The rays in tiles, which are made for the first frame."""
        return Rays.of(self._ways, NEAR, self._starts)

    @classmethod
    def at_site(cls, model: mujoco.MjModel, site: str, **options: Any) -> "DepthCamera":
        """Camera at a site, looking along its z axis with x to the right.

        Args:
            model: Compiled model.
            site: Name of the site.
            **options: As in the constructor.

        Returns:
            The camera.
        """
        body, X_BC = site_on_body(model, site, "depth camera")
        return cls(model, body, X_BC, **options)

    @classmethod
    def at_camera(cls, model: mujoco.MjModel, camera: str, **options: Any) -> "DepthCamera":
        """Camera at a MuJoCo camera, which looks along its -z axis, y up.

        Args:
            model: Compiled model.
            camera: Name of the MuJoCo camera.
            **options: As in the constructor.

        Returns:
            The depth camera.

        Raises:
            ConfigurationError: There is no such camera.
        """
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if index < 0:
            raise ConfigurationError(
                f"depth camera: no camera {camera!r}; there are "
                f"{names(model, 'camera', model.ncam)}"
            )
        R_BC = rotation_from_quat_wxyz(model.cam_quat[index]) @ np.diag([1.0, -1.0, -1.0])
        return cls(
            model,
            model.body(model.cam_bodyid[index]).name,
            pose(R_BC, model.cam_pos[index]),
            **options,
        )

    @property
    def K(self) -> Array:
        """Pinhole matrix (3, 3) [px]."""
        return self._K

    def init(self, rng: np.random.Generator) -> DepthCameraState:
        """Draw the seed of this camera's noise from `rng`."""
        return DepthCameraState(seed=int(rng.integers(2**63)), frame=0)

    def step(
        self, state: DepthCameraState, truth: BodyPoses
    ) -> tuple[DepthCameraState, DepthImage]:
        """One frame of the world at `truth`; the same state and truth give the same frame."""
        depth, cosine = self.render(truth.xpos, truth.xmat)
        if self._noise is not None:
            depth = add_noise(
                depth,
                cosine,
                float(self._K[0, 0]),
                self._noise,
                np.random.default_rng([state.seed, state.frame]),
            )

        depth = depth.astype(np.float64)
        depth[~((depth >= self._range[0]) & (depth <= self._range[1]))] = np.nan
        depth.setflags(write=False)

        image = DepthImage(time=float(truth.time), depth=depth, K=self._K, X_BC=self._X_BC_said)
        return DepthCameraState(seed=state.seed, frame=state.frame + 1), image

    def render(self, xpos: Array, xmat: Array) -> tuple[np.ndarray, np.ndarray]:
        """Depth without noise; with a port, the depth that the calibration gives for exact
        disparities.

        Args:
            xpos: Body origins (nbody, 3) [m] in W.
            xmat: Rotations of the bodies to W (nbody, 9).

        Returns:
            Depth (height, width) [m], inf without a hit, and cosine of the angle of incidence.
        """
        R_W = np.asarray(xmat, dtype=np.float64).reshape(-1, 3, 3)
        X_WC = pose(R_W[self._hull], xpos[self._hull]) @ self._X_BC
        depth, cosine = self._world.cast(X_WC, self._rays, xpos, R_W)
        if self._reader is not None:
            with np.errstate(invalid="ignore"):  # 0 times inf where nothing is hit
                points = self._rays.origins + depth[..., None] * self._rays.directions
            depth = self._reader.depth(points)

        return depth, cosine
