"""Images of a small stereo camera with a lamp in turbid water: intensity and measured depth.

Surfaces have a solid texture that is fixed to the object: a band-limited sum of plane waves with
random directions and phases. It models paint, rust and fouling. The lamp is next to the lens, so
that brightness decreases with range and incidence, and the shading moves with the camera. Turbidity
attenuates the light on its way out and back, and adds backscatter [Jaffe 1990]. A cloud of silt
hides part of the view and drifts with its own texture.

Frame C has OpenCV axes: x right, y down, z along the optical axis.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, finite_number, transform_points
from uuv.sim.sensors.stereo_noise import StereoNoise, add_noise

LAMP_RANGE = 0.2  # [m] range at which a white wall facing the lamp gives full scale in clear water
ALBEDO = 0.35  # mean reflectance of a surface
BACKSCATTER = 0.3  # share of the attenuated light that returns as backscatter
BLUR = 0.45  # [px] standard deviation of lens and pixel together


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallStereo:
    """Image, lens and errors of a small stereo camera."""

    width: int = 120  # [px]
    height: int = 90  # [px]
    focal: float = 104.0  # [px]: 60 deg wide
    intensity_noise: float = 0.006  # of full scale, white, per pixel: 7.4 bits
    near: float = 0.06  # [m] closest range
    far: float = 0.5  # [m] farthest range
    stereo: StereoNoise = field(default_factory=lambda: StereoNoise(baseline=0.03, correlation=3.0))

    def __post_init__(self) -> None:
        finite_number(self.focal, "small stereo camera: focal [px]", above=0.0)
        finite_number(self.intensity_noise, "small stereo camera: intensity_noise", above=0.0)
        if not (self.width > 8 and self.height > 8 and 0.0 < self.near < self.far):
            raise ConfigurationError(
                "small stereo camera: must have more than 8 x 8 px and 0 < near < far, got "
                f"{self.width} x {self.height} px, {self.near} to {self.far} m"
            )

    def rays(self, step: int = 1) -> Array:
        """Directions (h, w, 3) in C with unit z, of every `step`-th pixel."""
        v, u = np.mgrid[step // 2 : self.height : step, step // 2 : self.width : step]
        x = (u - 0.5 * (self.width - 1)) / self.focal
        y = (v - 0.5 * (self.height - 1)) / self.focal
        return np.stack([x, y, np.ones_like(x)], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """Solid texture of zero mean and standard deviation `contrast`."""

    waves: Array  # (K, 4) wave vector [rad/m], phase [rad]
    contrast: float  # of the reflectance, share of its mean

    @classmethod
    def of(
        cls, seed: int, contrast: float, band: tuple[float, float] = (0.006, 0.04), count: int = 48
    ) -> "Texture":
        """Draw a texture.

        Args:
            seed: Seed of directions, phases and wavelengths.
            contrast: Standard deviation of the reflectance, share of its mean; 0: a plain surface.
            band: [m] shortest and longest wavelength, log-uniform between them.
            count: Number of waves.
        """
        finite_number(contrast, "texture contrast", least=0.0, most=1.0)
        rng = np.random.default_rng(seed)
        way = rng.standard_normal((count, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)

        number = (
            2.0 * np.pi / np.exp(rng.uniform(float(np.log(band[0])), float(np.log(band[1])), count))
        )
        return cls(
            np.column_stack([number[:, None] * way, rng.uniform(0.0, 2.0 * np.pi, count)]), contrast
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Turbidity:
    """Optical conditions in front of the camera."""

    # [1/m] of a beam of light: 0.15 clear ocean, 0.4 coast, 2.2 harbour [Petzold 1972]
    attenuation: float = 0.4
    cloud: float = 0.0  # share of the view hidden by a drifting cloud of silt

    def __post_init__(self) -> None:
        finite_number(self.attenuation, "attenuation [1/m]", least=0.0)
        finite_number(self.cloud, "cloud, a share of the view", least=0.0, most=1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One exposure with intensity and measured depth."""

    intensity: np.ndarray  # (h, w) float32, full scale 1
    depth: np.ndarray  # (h, w) float32 [m], NaN without a measurement


def expose(
    camera: SmallStereo,
    hits: tuple[np.ndarray, np.ndarray],
    X_TC: Array,
    texture: Texture,
    water: Turbidity,
    rng: np.random.Generator,
) -> Picture:
    """Render one image.

    Args:
        camera: The camera.
        hits: Exact depth (h, w) [m], inf without a surface, and cosine of the angle of incidence
            (h, w).
        X_TC: (4, 4) camera in the axes of the textured object.
        texture: Texture of every surface in view.
        water: Optical conditions.
        rng: Source of the noise.

    Returns:
        The image.
    """
    exact, cosine = hits
    on_surface = np.isfinite(exact)
    depth = np.where(on_surface, exact, 1.0).astype(np.float64)
    points = transform_points(X_TC, (camera.rays() * depth[..., None]).reshape(-1, 3))

    # The object's texture, lit by the lamp, and the backscatter of the water [Jaffe 1990].
    pattern = np.zeros(len(points))
    if texture.contrast > 0.0:
        pattern = _waves(
            points, np.repeat(BLUR / camera.focal, len(points)) * depth.ravel(), texture.waves
        )

    reflected = ALBEDO * np.clip(1.0 + texture.contrast * pattern.reshape(depth.shape), 0.0, None)
    light = (LAMP_RANGE / depth) ** 2 * cosine * np.exp(-2.0 * water.attenuation * depth)
    veil = BACKSCATTER * -np.expm1(
        -2.0 * water.attenuation * np.where(on_surface, depth, camera.far)
    )
    image = np.where(on_surface, reflected * light, 0.0) + veil

    noisy = add_noise(
        np.where(on_surface, exact, np.inf).astype(np.float32),
        cosine.astype(np.float32),
        camera.focal,
        replace(camera.stereo, attenuation=water.attenuation),
        rng,
    )

    if water.cloud > 0.0:
        hidden, drift = _cloud(depth.shape, water.cloud, rng)
        image = np.where(hidden, drift, image)
        noisy = np.where(
            hidden, np.where(rng.random(depth.shape) < 0.5, np.inf, 0.5 * noisy), noisy
        )

    image = image + camera.intensity_noise * rng.standard_normal(depth.shape)
    valid = (noisy >= camera.near) & (noisy <= camera.far)
    return Picture(image.astype(np.float32), np.where(valid, noisy, np.nan).astype(np.float32))


def _cloud(
    shape: tuple[int, ...], share: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Mask (h, w) of a cloud that hides `share` of the view, and the cloud's brightness (h, w)."""
    v, u = np.indices(shape)
    middle = rng.uniform(0.0, 1.0, 2) * shape
    lobes = rng.uniform(0.7, 1.3, 2)
    away = np.hypot((v - middle[0]) * lobes[0], (u - middle[1]) * lobes[1])
    hidden = away <= np.quantile(away, share)

    silt = Texture.of(int(rng.integers(2**31)), 0.3, band=(8.0, 40.0), count=12)
    flat = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]).astype(np.float64)
    drift = BACKSCATTER * (
        1.0 + silt.contrast * _waves(flat, np.zeros(u.size), silt.waves).reshape(shape)
    )
    return hidden, drift


@kernel
def _waves(points, blur, waves):
    """Sum of plane waves of variance 1 at `points` (N, 3), seen with a Gaussian blur (N,) [m]."""
    out = np.zeros(len(points))
    scale = np.sqrt(2.0 / len(waves))

    for k in range(len(waves)):
        a, b, c, phase = waves[k]
        square = 0.5 * (a * a + b * b + c * c)
        for i in range(len(points)):
            damped = np.exp(-square * blur[i] * blur[i])
            out[i] += (
                scale
                * damped
                * np.cos(a * points[i, 0] + b * points[i, 1] + c * points[i, 2] + phase)
            )
    return out
