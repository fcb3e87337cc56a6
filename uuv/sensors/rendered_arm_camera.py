"""Camera on the arm with every image rendered and aligned, which is the reference for the error
model of `ArmCamera`.

The covariance is computed by the tracker. On average over rendered pairs it is correct: the ratio
of squared error to covariance is 0.92 per direction, in 216 pairs that were observed in all
directions. Silt, texture and key images follow the same rules as in the modelled sensor.
"""

from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from uuv.perception.navigation.surface_alignment import (
    PictureNoise,
    PreparedPicture,
    align,
    prepare,
)
from uuv.sim.interfaces.messages import SurfaceMotionMeasurement
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose
from uuv.sim.sensors.arm_camera import (
    LEAST_SEEN,
    MOST_LOST,
    ROTATION,
    ArmCamera,
    ViewConditions,
    leaves_key,
    silt,
    tool_in_view,
)
from uuv.sim.sensors.textured_view import SmallStereo, Texture, Turbidity, expose
from uuv.sim.sensors.visible_world import Rays, VisibleWorld

RIM = 2  # [px] margin around the tool that is left out, too
PREDICTED = 2e-3  # [m] standard deviation of the motion predicted by navigation, per axis


def hidden_by(tool: Array) -> np.ndarray:
    """Mask (h, w) of the pixels that a tool at the depth `tool` (h, w) hides, with a margin."""
    mask = np.isfinite(tool)
    for _ in range(RIM):
        grown = mask.copy()
        grown[1:] |= mask[:-1]
        grown[:-1] |= mask[1:]
        grown[:, 1:] |= mask[:, :-1]
        grown[:, :-1] |= mask[:, 1:]
        mask = grown
    return mask


def picture_noise(camera: SmallStereo, attenuation: float, range_m: float) -> PictureNoise:
    """The tracker's noise model of the camera at this range."""
    stereo = camera.stereo
    sigma = np.hypot(
        stereo.disparity_sigma * np.exp(attenuation * range_m),
        stereo.disparity_step / np.sqrt(12.0),
    )
    return PictureNoise(
        intensity=camera.intensity_noise,
        inverse_depth=float(sigma / (camera.focal * stereo.baseline)),
        correlation=stereo.correlation,
    )


@dataclass(slots=True, eq=False)
class RenderedState:
    """State of the tracker."""

    rng: np.random.Generator
    key: PreparedPicture | None = None
    key_time: float = -np.inf  # [s]
    # true pose of the key camera in the object
    X_OK: Array = field(default_factory=lambda: np.eye(4))
    lost: int = 0  # number of consecutive lost images
    cloud: float = 0.0  # share of the view that is hidden now
    cloud_until: float = -np.inf  # [s]


class RenderedArmCamera:
    """Stereo camera on the arm's last link (`Sensor`) that renders its images."""

    def __init__(
        self, model: mujoco.MjModel, tip: str, surface: str, *, conditions: ViewConditions
    ) -> None:
        """Mount the camera; the arguments are those of `ArmCamera`."""
        self._modelled = ArmCamera(model, tip, surface, conditions=conditions)
        self.period = self._modelled.period
        self.delay = self._modelled.delay
        self._conditions = conditions
        self._camera = self._modelled.camera

        # Visible surfaces: the textured world without the camera's own link.
        self._texture = Texture.of(0, conditions.texture)
        self._rays = Rays.of(self._camera.rays(), self._camera.near)
        self._world = VisibleWorld(model)
        link = int(model.site_bodyid[model.site(tip).id])
        self._hidden = hidden_by(tool_in_view(model, link, self._modelled.X_LC, self._rays))

    def camera_pose(self, truth: Any) -> tuple[Array, Array]:
        """True poses X_WC and X_OC (4, 4) of the camera in the world and in the tracked body."""
        return self._modelled.camera_pose(truth)

    def init(self, rng: np.random.Generator) -> RenderedState:
        """Take the stream of the noise."""
        return RenderedState(rng=rng)

    def step(
        self, state: RenderedState, truth: Any
    ) -> tuple[RenderedState, SurfaceMotionMeasurement | None]:
        """One image; None if no surface is in range, or if the image is lost."""
        X_WC, X_OC = self.camera_pose(truth)
        time = float(truth.time)
        camera = self._camera
        rng = state.rng

        # Depth of the surfaces in view, which must fill enough of the view.
        water = Turbidity(
            attenuation=self._conditions.attenuation,
            cloud=silt(state, self._conditions, time, self.period),
        )
        depth, cosine = self._world.cast(
            X_WC, self._rays, truth.xpos, np.asarray(truth.xmat).reshape(-1, 3, 3)
        )
        measured = (depth >= camera.near) & (depth <= camera.far) & ~self._hidden
        if measured.mean() < LEAST_SEEN:
            state.key = None
            return state, None

        # The image through the water; without a key image it becomes the key.
        range_m = float(np.median(depth[measured]))
        picture = expose(
            camera, (depth.astype(np.float64), cosine), X_OC, self._texture, water, rng
        )
        noise = picture_noise(camera, water.attenuation, range_m)
        current = prepare(picture.intensity, picture.depth, self._hidden, camera.focal, noise)
        if state.key is None:
            _take_key(state, current, time, X_OC)
            return state, _message(truth, time, np.eye(4), np.zeros((3, 3)))

        # Alignment to the key image, from an initial guess with the error of navigation.
        X_KC = inverse(state.X_OK) @ X_OC
        guess = X_KC @ pose(exp_so3(ROTATION * rng.standard_normal(3)))
        guess[:3, 3] += PREDICTED * rng.standard_normal(3)
        alignment = align(state.key, current, guess, ROTATION, noise)
        if alignment is None or not alignment.settled:
            state.lost += 1
            if state.lost >= MOST_LOST:
                state.key = None
            return state, None

        # Motion since the key image, which is replaced before it leaves the view.
        state.lost = 0
        read = pose(guess[:3, :3], alignment.p_KC)
        message = _message(truth, state.key_time, read, alignment.information_K)
        if leaves_key(camera, X_KC, range_m):
            _take_key(state, current, time, X_OC)
        return state, message


def _take_key(state: RenderedState, picture: PreparedPicture, time: float, X_OC: Array) -> None:
    """Make an image from the pose X_OC the key image, which later images are aligned to."""
    state.key = picture
    state.key_time = time
    state.X_OK = X_OC
    state.lost = 0


def _message(
    truth: Any, key_time: float, X_KC: Array, information_K: Array
) -> SurfaceMotionMeasurement:
    return SurfaceMotionMeasurement(
        time=float(truth.time),
        key_time=key_time,
        p_KC=X_KC[:3, 3],
        R_KC=X_KC[:3, :3],
        information_K=information_K,
        q=np.array(truth.q),
    )
