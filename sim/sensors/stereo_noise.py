"""Stereo errors, modelled in disparity."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from uuv.sim.interfaces.errors import ConfigurationError

EDGE = 0.025  # relative jump of disparity between neighbours that counts as a depth edge


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoNoise:
    """Error model of a stereo camera in disparity: sigma_z = z^2 disparity_sigma / (f baseline).

    In turbid water the contrast at range r is C = exp(-attenuation r) [Duntley 1963], and the error
    of a match grows as 1 / C. Texture strength varies over the image (Rayleigh, mean square 1).
    There is no match where strength times C is below `least_contrast`, which happens at a share of
    1 - exp(-(least_contrast / C)^2) of the pixels.
    """

    disparity_sigma: float = 0.25  # [px]
    baseline: float = 0.12  # [m]
    # [px] distance at which the correlation of the error has fallen to 1/e
    correlation: float = 5.0
    disparity_step: float = 1.0 / 16.0  # [px] quantisation of the matcher; 0: none
    # probability that a pair of pixels across a depth edge makes a flying pixel
    flying: float = 0.5
    # [rad] from the surface normal; no measurement beyond it
    max_incidence: float = np.deg2rad(75.0)
    # [1/m] of a beam of light: 0.15 clear ocean, 0.4 coast, 2.2 harbour [Petzold 1972]
    attenuation: float = 0.0
    # smallest contrast that is matched, relative to the mean texture in clear water
    least_contrast: float = 0.05

    def __post_init__(self) -> None:
        for name in (
            "disparity_sigma",
            "correlation",
            "disparity_step",
            "attenuation",
            "least_contrast",
        ):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ConfigurationError(
                    f"stereo noise: {name} must not be negative, got {getattr(self, name)}"
                )

        if not self.baseline > 0.0:
            raise ConfigurationError(
                f"stereo noise: baseline must be positive, got {self.baseline}"
            )
        if not 0.0 <= self.flying <= 1.0:
            raise ConfigurationError(f"stereo noise: flying must lie in [0, 1], got {self.flying}")
        if not 0.0 < self.max_incidence <= 0.5 * np.pi:
            raise ConfigurationError(
                f"stereo noise: max_incidence must lie in (0, pi/2], got {self.max_incidence}"
            )


def add_noise(
    depth: np.ndarray,
    cosine: np.ndarray,
    focal: float,
    noise: StereoNoise,
    rng: np.random.Generator,
) -> np.ndarray:
    """Depth (height, width) [m] that a stereo camera would measure; inf without a measurement.

    The errors are added in the order of a matcher: mixed pixels at edges, correlated disparity
    error, quantisation, and drop-out at grazing incidence.

    Args:
        depth: Exact depth (height, width) [m], inf without a surface.
        cosine: Cosine of the angle of incidence (height, width).
        focal: [px]
        noise: Error model.
        rng: Source of the errors.

    Returns:
        Depth (height, width) [m].
    """
    # Flying pixels mix the disparities at an edge.
    with np.errstate(divide="ignore"):
        disparity = np.float32(focal * noise.baseline) / depth
    if noise.flying > 0.0:
        _mix_edges(disparity, noise.flying, rng)

    matched = disparity > 0.0
    contrast = None
    if noise.attenuation > 0.0:
        contrast = np.exp(
            -noise.attenuation * np.where(matched, depth, 0.0) * _ray_lengths(depth.shape, focal)
        )

    # Correlated error, which increases as the contrast falls.
    if noise.disparity_sigma > 0.0:
        error = np.float32(noise.disparity_sigma) * _smooth_noise(
            depth.shape, noise.correlation, rng
        )
        disparity += error if contrast is None else error / np.maximum(contrast, np.float32(1e-6))

    if contrast is not None:
        x, y = (_smooth_noise(depth.shape, noise.correlation, rng) for _ in range(2))
        matched &= 0.5 * (x * x + y * y) * contrast**2 >= noise.least_contrast**2

    if noise.disparity_step > 0.0:
        disparity = np.rint(disparity / np.float32(noise.disparity_step)) * np.float32(
            noise.disparity_step
        )
    matched &= (disparity > 0.0) & (cosine >= np.cos(noise.max_incidence))

    measured = np.full_like(depth, np.inf)
    np.divide(np.float32(focal * noise.baseline), disparity, out=measured, where=matched)
    return measured


def _smooth_noise(
    shape: tuple[int, ...], correlation: float, rng: np.random.Generator
) -> np.ndarray:
    """Normal numbers of variance 1, correlated over `correlation` [px]; periodic at the border."""
    noise = rng.standard_normal(shape, dtype=np.float32)
    if correlation == 0.0:
        return noise

    # White noise through a Gaussian of width s is correlated as exp(-r^2 / (4 s^2)).
    width = 0.5 * correlation
    middle = int(3.0 * width) + 1
    kernel = ndimage.gaussian_filter1d(np.eye(1, 2 * middle + 1, middle)[0], width, truncate=3.0)
    smooth = ndimage.gaussian_filter(noise, width, truncate=3.0, mode="wrap")
    smooth /= np.float32(kernel @ kernel)
    return smooth


def _ray_lengths(shape: tuple[int, ...], focal: float) -> np.ndarray:
    """Length (height, width) of each pixel's ray with unit z, float32."""
    x = (np.arange(shape[1]) - 0.5 * (shape[1] - 1)) / focal
    y = (np.arange(shape[0]) - 0.5 * (shape[0] - 1)) / focal
    return np.sqrt(1.0 + x**2 + (y**2)[:, None]).astype(np.float32)


def _mix_edges(disparity: np.ndarray, probability: float, rng: np.random.Generator) -> None:
    """Mix the disparities of both sides for some pixels at depth edges, in place."""
    width = disparity.shape[1]
    flat = disparity.ravel()
    for step, ahead, behind in (
        (1, disparity[:, 1:], disparity[:, :-1]),
        (width, disparity[1:], disparity[:-1]),
    ):
        row, column = np.nonzero(np.abs(ahead - behind) > EDGE * np.maximum(ahead, behind))
        first = row * width + column
        first = first[rng.random(len(first)) < probability]
        second = first + step

        swap = rng.random(len(first)) < 0.5
        pixel = np.where(swap, second, first)
        other = np.where(swap, first, second)
        flat[pixel] += rng.random(len(first), dtype=np.float32) * (flat[other] - flat[pixel])
