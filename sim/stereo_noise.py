"""The errors of stereo vision, made in disparity."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from sim.interfaces.errors import ConfigurationError

EDGE = 0.025  # relative jump of disparity between neighbours that counts as a depth edge


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoNoise:
    """Errors of a stereo camera, made in disparity: sigma_z = z^2 disparity_sigma / (f baseline)."""

    disparity_sigma: float = 0.25  # [px]
    baseline: float = 0.12  # [m]
    correlation: float = 5.0  # [px] at which the correlation of the error has fallen to 1/e
    disparity_step: float = 1.0 / 16.0  # [px] quantum of the matcher; 0: none
    flying: float = 0.5  # probability that a pair of pixels across a depth edge makes a flying pixel
    max_incidence: float = np.deg2rad(75.0)  # [rad] from the surface normal; nothing comes back beyond it

    def __post_init__(self) -> None:
        for name in ("disparity_sigma", "correlation", "disparity_step"):
            if not getattr(self, name) >= 0.0:
                raise ConfigurationError(f"stereo noise: {name} must not be negative, got {getattr(self, name)}")
        if not self.baseline > 0.0:
            raise ConfigurationError(f"stereo noise: baseline must be positive, got {self.baseline}")
        if not 0.0 <= self.flying <= 1.0:
            raise ConfigurationError(f"stereo noise: flying must lie in [0, 1], got {self.flying}")
        if not 0.0 < self.max_incidence <= 0.5 * np.pi:
            raise ConfigurationError(f"stereo noise: max_incidence must lie in (0, pi/2], got {self.max_incidence}")


def add_noise(
    depth: np.ndarray, cosine: np.ndarray, focal: float, noise: StereoNoise, rng: np.random.Generator
) -> np.ndarray:
    """Depth (height, width) [m] as stereo with focal length `focal` [px] would measure it; inf where nothing came back.

    `depth` is exact, `cosine` that of the incidence. Order as in a matcher: mixed pixels at edges, correlated
    disparity error, quantisation, drop-out at grazing incidence.
    """
    with np.errstate(divide="ignore"):
        disparity = np.float32(focal * noise.baseline) / depth
    if noise.flying > 0.0:
        _mix_edges(disparity, noise.flying, rng)
    seen = disparity > 0.0
    if noise.disparity_sigma > 0.0:
        error = rng.standard_normal(depth.shape, dtype=np.float32)
        if noise.correlation > 0.0:
            # White noise through a Gaussian of width s is correlated as exp(-r^2 / (4 s^2)).
            kernel = ndimage.gaussian_filter1d(np.eye(1, 65, 32)[0], 0.5 * noise.correlation, truncate=3.0)
            error = ndimage.gaussian_filter(error, 0.5 * noise.correlation, truncate=3.0, mode="wrap")
            error /= np.float32(kernel @ kernel)
        disparity += np.float32(noise.disparity_sigma) * error
    if noise.disparity_step > 0.0:
        disparity = np.rint(disparity / np.float32(noise.disparity_step)) * np.float32(noise.disparity_step)
    seen &= (disparity > 0.0) & (cosine >= np.cos(noise.max_incidence))
    result = np.full_like(depth, np.inf)
    np.divide(np.float32(focal * noise.baseline), disparity, out=result, where=seen)
    return result


def _mix_edges(disparity: np.ndarray, probability: float, rng: np.random.Generator) -> None:
    """Turn some pixels at depth edges into a blend of both sides, in place."""
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
        pixel, other = np.where(swap, second, first), np.where(swap, first, second)
        flat[pixel] += rng.random(len(first), dtype=np.float32) * (flat[other] - flat[pixel])
