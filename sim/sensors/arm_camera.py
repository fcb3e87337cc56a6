"""Small stereo camera on the arm's last link, which tracks the surface beside the contact.

The camera reports its motion over the object since a key image. For every image a coarse grid of
rays is cast into the world. The points that they hit predict the normal equations that a direct
alignment of intensity and depth would have (`uuv.perception.navigation.surface_alignment`): texture
gives the motion across the view, shape the motion along the surface's normals. Their inverse,
multiplied by the factors of an error model that was fitted to rendered pairs (`ErrorModel`), is the
covariance of the drawn error, and the covariance in the message. A direction that the view does not
observe has no information, such as the axial direction on a plain cylinder.
"""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from uuv.sim.interfaces.documents import named, toml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import SurfaceMotionMeasurement
from uuv.sim.interfaces.spatial import Array, inverse, pose, rotation_from_z
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.sensors.textured_view import (
    ALBEDO,
    BACKSCATTER,
    BLUR,
    LAMP_RANGE,
    SmallStereo,
    Texture,
    Turbidity,
)
from uuv.sim.sensors.view_conditions import ViewConditions
from uuv.sim.sensors.visible_world import Rays, VisibleWorld, body_id, site_on_body

TABLE = Path(__file__).with_suffix(".toml")
GRID = 10  # [px] between the rays of the prediction
# [rad] standard deviation of the rotation between two images, by attitude reference and encoders
ROTATION = 1e-4
FINE_BLUR = 0.8  # [px] standard deviation of the blur of the intensity in the tracker
# [-] smallest gradient of a pixel that the tracker uses, as a multiple of the noise
LEAST_GRADIENT = 4.0
# [px] number of pixels whose errors count as one in the prediction; the fitted factors refer to it
CELL = 35.0
WEAKEST = 2e-3  # [m] standard deviation above which a direction counts as not observed
OBSERVED = 1.0  # [1/m^2] information that is larger than rounding errors
# share of the view's width, or of the range along the view, above which a new key is taken
KEY_SHIFT = 0.25
KEY_TURN = 0.2  # [rad] the same for the rotation
MOST_LOST = 5  # number of consecutive lost images that end a track
LEAST_SEEN = 0.25  # share of the view with a surface that a track requires
_WHAT = "errors of the arm camera"
_SHARE = {"schema": {"minimum": 0, "maximum": 1}}
_FACTOR = {"schema": {"minimum": 1, "maximum": 1000}}
_EXPONENTS = {"schema": {"items": {"minimum": -100, "maximum": 100}}}


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorModel:
    """Errors of the tracker in units of the prediction, fitted by `fit_arm_camera.py`.

    The model was fitted to rendered pairs of images. The variance from texture is exp(texture . x)
    times the predicted one, the variance from shape exp(shape . x) times. The condition x consists
    of 1, the shift since the key over the width of the view, the share of the view hidden by silt,
    and the logarithm of the ratio of gradient to noise. An image is lost with probability 1 / (1 +
    exp(-lost . x)).
    """

    texture: tuple[float, float, float, float] = field(metadata=_EXPONENTS)
    shape: tuple[float, float, float, float] = field(metadata=_EXPONENTS)
    lost: tuple[float, float, float, float] = field(metadata=_EXPONENTS)
    # share of the variance that all images of a key have in common
    common: float = field(metadata=_SHARE)
    # share of the images with an error beyond the gate of the fit
    outliers: float = field(metadata=_SHARE)
    outlier_factor: float = field(metadata=_FACTOR)  # factor by which their errors are larger
    bias: tuple[float, float, float] = field(  # mean error, camera axes
        metadata={"schema": {"unit": "m", "items": {"minimum": -1, "maximum": 1}}}
    )
    pairs: int = field(metadata={"schema": {"minimum": 1}})  # number of rendered pairs in the fit

    @classmethod
    def read(cls, file: Path = TABLE) -> "ErrorModel":
        """The model in a TOML file.

        Raises:
            ConfigurationError: The file cannot be read, or a key or value is not allowed.
        """
        table = toml_of(file, _WHAT)
        try:
            return TableReader().made(cls, table)
        except ConfigurationError as error:
            raise ConfigurationError(f"{named(file, _WHAT)}: {error}") from error


@cache
def fitted() -> ErrorModel:
    """The fitted model that is part of the package."""
    return ErrorModel.read()


def beside_tool() -> Array:
    """Default pose X_GC (4, 4) of the camera: 11 cm beside the tool axis, 17 cm behind the face.

    It looks at the surface 5 cm beside the contact, 0.33 rad from the tool axis.
    """
    p = np.array([0.11, 0.0, -0.17])
    return pose(rotation_from_z(np.array([0.05, 0.0, 0.0]) - p, [0.0, 1.0, 0.0]), p)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Normal equations that an alignment would have, for texture and for shape, and the condition
    of the view.
    """

    texture: Array  # (6, 6) of motion and rotation of the camera, camera axes
    shape: Array  # (6, 6)
    condition: Array  # (4,) x of `ErrorModel`
    seen: float  # share of the view with a surface
    range: float  # [m] median depth; NaN without a surface

    def information(self, texture: float, shape: float) -> Array:
        """Information (3, 3) [1/m^2] of the position, camera axes, with these factors on the
        variances.
        """
        A = self.texture / texture + self.shape / shape
        A[3:, 3:] += np.eye(3) / ROTATION**2
        marginal = A[:3, :3] - A[:3, 3:] @ np.linalg.solve(A[3:, 3:], A[3:, :3])
        eigenvalues, axes = np.linalg.eigh(0.5 * (marginal + marginal.T))
        eigenvalues[eigenvalues < WEAKEST**-2] = 0.0
        return (axes * eigenvalues) @ axes.T

    def factors(self, errors: ErrorModel) -> tuple[float, float]:
        """Factors on the variances of texture and shape in this condition."""
        return float(np.exp(np.dot(errors.texture, self.condition))), float(
            np.exp(np.dot(errors.shape, self.condition))
        )

    def chance_lost(self, errors: ErrorModel) -> float:
        """Probability that the image is lost."""
        return (
            float(1.0 / (1.0 + np.exp(-np.dot(errors.lost, self.condition))))
            if self.seen >= LEAST_SEEN
            else 1.0
        )


def predict(
    camera: SmallStereo,
    depth: Array,
    hidden: np.ndarray,
    texture: Texture,
    water: Turbidity,
    shift: float,
) -> Prediction:
    """Predict the normal equations of an alignment from the points that a coarse grid of rays hits.

    Args:
        camera: The camera.
        depth: (h, w) [m] along the optical axis at every GRID-th pixel, inf without a surface.
        hidden: (h, w) bool, True where the vehicle itself hides the view.
        texture: Texture of the surface.
        water: Optical conditions.
        shift: [m] Motion across the view since the key image.
    """
    rays = camera.rays(GRID)
    valid = np.isfinite(depth) & ~hidden & (depth >= camera.near) & (depth <= camera.far)
    visible = float(valid.mean())
    if valid.sum() < 4:
        nothing = np.zeros((6, 6))
        return Prediction(
            texture=nothing,
            shape=nothing.copy(),
            condition=np.zeros(4),
            seen=0.0,
            range=float("nan"),
        )

    # Normals of the surface, from gradients of the inverse depth.
    inverse_depth = np.where(valid, 1.0 / np.where(valid, depth, 1.0), np.nan)
    wv, wu = np.gradient(inverse_depth, GRID)
    f = camera.focal
    u = f * rays[..., 0]
    v = f * rays[..., 1]
    normals = -np.stack([f * wu, f * wv, inverse_depth - u * wu - v * wv], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    shaped = valid & np.isfinite(normals).all(axis=-1)

    points = rays * np.where(valid, depth, 0.0)[..., None]
    slant = np.sum(np.where(shaped[..., None], normals, 0.0)[valid] * -rays[valid], axis=1)
    cosine = np.clip(np.abs(slant), 0.3, 1.0)
    H_texture, ratio = _texture_information(camera, texture, water, points[valid], cosine)
    H_shape = _shape_information(camera, water, points[shaped], normals[shaped])

    range_m = float(np.median(depth[valid]))
    condition = np.array(
        [1.0, shift * f / (range_m * camera.width), water.cloud, np.clip(ratio, -2.0, 4.0)]
    )

    return Prediction(
        texture=H_texture, shape=H_shape, condition=condition, seen=visible, range=range_m
    )


def _texture_information(
    camera: SmallStereo, texture: Texture, water: Turbidity, p: Array, cosine: Array
) -> tuple[Array, float]:
    """Information (6, 6) from the gradient of the intensity, relative to its mean, and the noise.

    Args:
        camera: The camera.
        texture: Texture of the surface.
        water: Optical conditions.
        p: (n, 3) [m] points of the surface, camera axes.
        cosine: (n,) of the angle of incidence.

    Returns:
        The information, and the logarithm of the ratio of gradient to noise.
    """
    f = camera.focal
    zg = np.ascontiguousarray(p[:, 2])
    light = ALBEDO * (LAMP_RANGE / zg) ** 2 * cosine * np.exp(-2.0 * water.attenuation * zg)
    veil = BACKSCATTER * -np.expm1(-2.0 * water.attenuation * zg)
    white = camera.intensity_noise / (light + veil)

    square = gradient_square(texture, zg / f) * (light / (light + veil)) ** 2
    slope = white / (2.0 * FINE_BLUR**2 * np.sqrt(2.0 * np.pi))
    used = np.exp(-((LEAST_GRADIENT * slope) ** 2) / (square + slope**2))  # noise of both images
    sigma = white / (2.0 * FINE_BLUR * np.sqrt(np.pi)) * np.sqrt(2.0)
    weight = _share(water) * used * square / sigma**2

    H = np.zeros((6, 6))
    for row in (_image_rows(p, zg, f, 0), _image_rows(p, zg, f, 1)):
        H += np.einsum("n,ni,nj->ij", weight, row, row)
    return H, float(np.log(np.sqrt(np.maximum(np.mean(square), 1e-12)) / np.mean(slope)))


def _shape_information(camera: SmallStereo, water: Turbidity, p: Array, n: Array) -> Array:
    """Information (6, 6) from the distance of points (m, 3) along normals (m, 3), camera axes.

    It is computed from the errors of the inverse depth.
    """
    zs = np.ascontiguousarray(p[:, 2])
    dimmed = (
        camera.stereo.disparity_sigma
        / (camera.focal * camera.stereo.baseline)
        * np.exp(water.attenuation * zs)
    )
    along = np.sum(n * p, axis=1) / zs
    unit = 1.0 / (np.where(np.abs(along) > 0.2, along, np.inf) * zs**2)
    row = np.concatenate([n * unit[:, None], np.cross(p, n) * unit[:, None]], axis=1)
    return np.einsum("n,ni,nj->ij", _share(water) / dimmed**2, row, row)


def _share(water: Turbidity) -> float:
    """Independent errors per ray of the grid, without those that silt hides."""
    return (1.0 - water.cloud) * GRID**2 / CELL


def gradient_square(texture: Texture, pixel: Array) -> Array:
    """Mean square (n,) [1/px^2] of a texture's gradient on one image axis; `pixel` (n,) [m] is the
    size of a pixel.
    """
    # mean square of the wave number along one axis, averaged over directions
    square = np.sum(texture.waves[:, :3] ** 2, axis=1) / 3.0
    phase = square[:, None] * pixel**2
    return texture.contrast**2 * np.mean(
        phase * np.exp(-2.0 * phase * (BLUR**2 + FINE_BLUR**2)), axis=0
    )


def _image_rows(p: Array, z: Array, focal: float, axis: int) -> Array:
    """Derivative (n, 6) [px] of an image coordinate with respect to motion and rotation of the
    points (n, 3).
    """
    J = np.zeros((len(p), 6))
    J[:, axis] = focal / z
    J[:, 2] = -focal * p[:, axis] / z**2
    J[:, 3:] = np.cross(p, J[:, :3])
    return J


@dataclass(slots=True, eq=False)
class ArmCameraState:
    """State of the camera's tracker."""

    rng: np.random.Generator
    scale: float  # error of the scale in this run
    key_time: float = -np.inf  # [s]
    # true pose of the key camera in the object
    X_OK: Array = field(default_factory=lambda: np.eye(4))
    # (3,) standard normal numbers, common to the images of a key
    key_error: Array = field(default_factory=lambda: np.zeros(3))
    tracking: bool = False
    lost: int = 0  # number of consecutive lost images
    cloud: float = 0.0  # share of the view that is hidden now
    cloud_until: float = -np.inf  # [s]


class ArmCamera:
    """Stereo camera on the arm's last link (`Sensor`) that measures its motion over the surface
    since a key image.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        tip: str,
        surface: str,
        *,
        X_GC: Array | None = None,
        conditions: ViewConditions | None = None,
        camera: SmallStereo | None = None,
        errors: ErrorModel | None = None,
        period: float = 0.06,
        delay: float = 0.06,
    ) -> None:
        """Mount the camera.

        Args:
            model: Compiled world.
            tip: Name of the tool's site.
            surface: Name of the body that the camera tracks; other bodies in view count as this
                body.
            X_GC: (4, 4) camera in tool axes; default `beside_tool`.
            conditions: Conditions of the view.
            camera: Image and lens.
            errors: Error model; default: the fitted one of the package.
            period: [s]
            delay: [s] from exposure to message.

        Raises:
            ConfigurationError: A name is unknown.
            MissingLibraryError: No ray caster is installed.
        """
        if not (period > 0.0 and delay >= 0.0):
            raise ConfigurationError(
                f"arm camera: period must be > 0 and delay >= 0, got {period} and {delay}"
            )

        self.period = period
        self.delay = delay
        self.camera = camera or SmallStereo()
        self.conditions = conditions or ViewConditions()
        self._errors = errors or fitted()

        link, X_LG = site_on_body(model, tip, "arm camera")
        self._link = body_id(model, link, "arm camera")
        self._surface = body_id(model, surface, "arm camera")
        self.X_LC = X_LG @ (beside_tool() if X_GC is None else X_GC)
        self._texture = Texture.of(0, self.conditions.texture)

        rays = self.camera.rays(GRID)
        self._rays = Rays.of(rays, self.camera.near)

        vehicle = [
            b for b in range(model.nbody) if model.body_rootid[b] == model.body_rootid[self._link]
        ]
        self._world = VisibleWorld(model, exclude=set(vehicle))
        self._hidden = np.isfinite(tool_in_view(model, self._link, self.X_LC, self._rays))

    def init(self, rng: np.random.Generator) -> ArmCameraState:
        """Draw the error of the scale."""
        return ArmCameraState(rng=rng, scale=self.conditions.scale * float(rng.standard_normal()))

    def camera_pose(self, truth: Any) -> tuple[Array, Array]:
        """True poses X_WC and X_OC (4, 4) of the camera in the world and in the tracked body."""
        X_WC = pose(truth.xmat[self._link].reshape(3, 3), truth.xpos[self._link]) @ self.X_LC
        X_WO = pose(truth.xmat[self._surface].reshape(3, 3), truth.xpos[self._surface])
        return X_WC, inverse(X_WO) @ X_WC

    def step(
        self, state: ArmCameraState, truth: Any
    ) -> tuple[ArmCameraState, SurfaceMotionMeasurement | None]:
        """One image; None if no surface is in range, or if the image is lost."""
        X_WC, X_OC = self.camera_pose(truth)
        time = float(truth.time)
        rng = state.rng
        water = Turbidity(
            attenuation=self.conditions.attenuation,
            cloud=silt(state, self.conditions, time, self.period),
        )
        depth, _ = self._world.cast(
            X_WC, self._rays, truth.xpos, np.asarray(truth.xmat).reshape(-1, 3, 3)
        )

        # Prediction of an alignment with the key image.
        X_KC = inverse(state.X_OK) @ X_OC
        view = predict(
            self.camera,
            depth.astype(np.float64),
            self._hidden,
            self._texture,
            water,
            float(np.hypot(X_KC[0, 3], X_KC[1, 3])) if state.tracking else 0.0,
        )

        probability = view.chance_lost(self._errors)
        drawn = rng.standard_normal(3), rng.uniform(size=2)
        if drawn[1][0] < probability:
            state.lost += 1
            state.tracking &= state.lost < MOST_LOST
            return state, None
        state.lost = 0
        if not state.tracking:
            self._new_key(state, time, X_OC)
            return state, _message(truth, time, np.eye(4), np.zeros((3, 3)))

        information_C = view.information(*view.factors(self._errors))
        error = self._error(state, information_C, drawn)
        information_C = with_scale(information_C, X_KC, self.conditions.scale)
        R = X_KC[:3, :3]
        read = X_KC.copy()
        read[:3, 3] = (1.0 + state.scale) * X_KC[:3, 3] + R @ error
        message = _message(truth, time, read, R @ information_C @ R.T, key_time=state.key_time)

        if leaves_key(self.camera, X_KC, view.range):
            self._new_key(state, time, X_OC)
        return state, message

    def _error(
        self, state: ArmCameraState, information_C: Array, drawn: tuple[Array, Array]
    ) -> Array:
        """Error (3,) [m] of the position, camera axes; a part of it is common to all images of a
        key.
        """
        eigenvalues, axes = np.linalg.eigh(information_C)
        spread = np.where(
            eigenvalues > OBSERVED, 1.0 / np.sqrt(np.maximum(eigenvalues, OBSERVED)), 0.0
        )

        common = self._errors.common
        normal = np.sqrt(common) * state.key_error + np.sqrt(1.0 - common) * drawn[0]
        if drawn[1][1] < self._errors.outliers:
            normal = normal * self._errors.outlier_factor

        return axes @ (spread * (axes.T @ normal)) + np.where(
            eigenvalues.max() > OBSERVED, self._errors.bias, 0.0
        )

    @staticmethod
    def _new_key(state: ArmCameraState, time: float, X_OC: Array) -> None:
        """Make the present image the key."""
        state.key_time = time
        state.X_OK = X_OC
        state.tracking = True
        state.key_error = state.rng.standard_normal(3)


def _message(
    truth: Any, time: float, X_KC: Array, information_K: Array, key_time: float | None = None
) -> SurfaceMotionMeasurement:
    return SurfaceMotionMeasurement(
        time=time,
        key_time=time if key_time is None else key_time,
        p_KC=X_KC[:3, 3],
        R_KC=X_KC[:3, :3],
        information_K=information_K,
        q=np.array(truth.q),
    )


def with_scale(information: Array, X_KC: Array, scale: float) -> Array:
    """Information (3, 3), camera axes, with the variance (scale x motion)^2 of an unknown scale
    added.
    """
    d = scale * (X_KC[:3, :3].T @ X_KC[:3, 3])
    taken = information @ d
    return information - np.outer(taken, taken) / (1.0 + d @ taken)


def leaves_key(camera: SmallStereo, X_KC: Array, range_m: float) -> bool:
    """True if the view has moved so far from its key image that the present image becomes the
    key.
    """
    across = float(np.hypot(X_KC[0, 3], X_KC[1, 3])) * camera.focal / (range_m * camera.width)
    along = abs(float(X_KC[2, 3])) / range_m
    turn = float(np.arccos(np.clip(0.5 * (np.trace(X_KC[:3, :3]) - 1.0), -1.0, 1.0)))
    return across > KEY_SHIFT or along > KEY_SHIFT or turn > KEY_TURN


def silt(state: Any, conditions: ViewConditions, time: float, period: float) -> float:
    """Share of the view that silt hides now. Clouds are a Poisson process with exponential
    durations.

    Args:
        state: Holds `rng`, `cloud` and `cloud_until`, which are changed in place.
        conditions: Rate and duration.
        time: [s]
        period: [s] between two images.
    """
    draw = state.rng.uniform()
    share = state.rng.uniform()
    duration = state.rng.exponential()

    if draw < conditions.cloud_rate * period:
        state.cloud = share
        state.cloud_until = time + conditions.cloud_time * duration
    return state.cloud if time < state.cloud_until else 0.0


def tool_in_view(model: mujoco.MjModel, link: int, X_LC: Array, rays: Rays) -> Array:
    """Depth (h, w) [m] of the last link and its tool in the camera's view; inf elsewhere."""
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    mujoco.mj_kinematics(model, data)

    carried = {link}
    for body in range(link + 1, model.nbody):
        if int(model.body_parentid[body]) in carried:
            carried.add(body)

    carried_world = VisibleWorld(model, exclude=set(range(model.nbody)) - carried)
    R_W = data.xmat.reshape(-1, 3, 3)
    X_WC = pose(R_W[link], data.xpos[link]) @ X_LC
    depth, _ = carried_world.cast(X_WC, rays, data.xpos, R_W)
    return depth.astype(np.float64)
