"""Stereo pair behind a flat port: Snell's law for each pixel, and a pinhole calibration of the
image.

Both cameras look through the same flat port, whose normal is their optical axis. A ray that leaves
the lens at the tangent s continues in water at the tangent s_w = s / sqrt(n^2 (1 + s^2) - s^2),
from Snell's law sin a = n sin w. It crosses the port off the axis. In water the camera therefore
has no single centre of projection, and a pinhole model is only a fit [Treibitz 2012], [Shortis
2015].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_STEPS = 20  # largest number of Newton steps; 3 to 5 are needed


class _Port(NamedTuple):
    """Parameters of a `FlatPort`, for compiled functions."""

    distance: float
    thickness: float
    n_glass: float
    n_water: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatPort:
    """Flat window between air and water, perpendicular to the optical axis."""

    distance: float = 0.02  # [m] air gap from the lens to the port
    thickness: float = 0.01  # [m]
    n_water: float = 1.333
    n_glass: float = 1.49  # acrylic

    def __post_init__(self) -> None:
        for name in ("distance", "thickness"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ConfigurationError(
                    f"flat port: {name} must not be negative [m], got {getattr(self, name)}"
                )
        for name in ("n_water", "n_glass"):
            if not 1.0 <= getattr(self, name) < 3.0:
                raise ConfigurationError(
                    f"flat port: {name} must lie in [1, 3), got {getattr(self, name)}"
                )

    def rays(self, tangents: ArrayLike) -> tuple[Array, Array]:
        """Trace rays through the port.

        Args:
            tangents: x/z and y/z (..., 2) of the rays in air, from the lens at the origin.

        Returns:
            Points (..., 3) [m] where the rays leave the port, and their directions (..., 3) in
            water, with z = 1.
        """
        t = np.asarray(tangents, dtype=np.float64)
        square = (t**2).sum(axis=-1, keepdims=True)
        glass = t / np.sqrt(self.n_glass**2 * (1.0 + square) - square)
        water = t / np.sqrt(self.n_water**2 * (1.0 + square) - square)
        unit_z = np.ones_like(square)

        start = np.concatenate(
            [self.distance * t + self.thickness * glass, (self.distance + self.thickness) * unit_z],
            axis=-1,
        )
        return start, np.concatenate([water, unit_z], axis=-1)

    def tangent(self, radius: ArrayLike, z: ArrayLike) -> Array:
        """Tangent in air of the ray from a point in water.

        Args:
            radius: Distance of the points from the axis [m].
            z: Depth of the points along the axis [m].

        Returns:
            Tangents, of the common shape of `radius` and `z`.

        Raises:
            ConfigurationError: A point is not beyond the port.
        """
        rho, depth = np.broadcast_arrays(
            np.asarray(radius, dtype=np.float64), np.asarray(z, dtype=np.float64)
        )
        if not np.all(depth > self.distance + self.thickness):
            raise ConfigurationError("flat port: points must lie in the water, beyond the port")

        # Copies, since writing to a view gives a warning.
        flat = _tangents(np.array(rho).ravel(), np.array(depth).ravel(), self.numbers)
        return flat.reshape(rho.shape)

    @property
    def numbers(self) -> _Port:
        """Parameters of the port for compiled functions."""
        return _Port(
            float(self.distance), float(self.thickness), float(self.n_glass), float(self.n_water)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PortCalibration:
    """Camera model of the stereo software: a pinhole with radial distortion.

    r = f t (1 + k1 t^2 + k2 t^4): r [px] is the distance from the centre of the raw image, t the
    tangent of the ray assigned to the pixel.
    """

    focal: float  # [px]
    k1: float = 0.0
    k2: float = 0.0
    center: float = 0.0  # [m] position of the pinhole ahead of the lens (behind it if negative)

    def __post_init__(self) -> None:
        if not (0.0 < self.focal < np.inf and np.isfinite([self.k1, self.k2, self.center]).all()):
            raise ConfigurationError(
                f"calibration: focal must be positive and all numbers finite, got {self}"
            )

    def raw(self, tangents: ArrayLike, focal: float) -> Array:
        """Tangents (..., 2) in the air behind the port from rectified tangents, for a lens of
        `focal` [px].
        """
        t = np.asarray(tangents, dtype=np.float64)
        square = (t**2).sum(axis=-1, keepdims=True)
        return t * (self.focal / focal) * (1.0 + square * (self.k1 + square * self.k2))


def in_air(focal: float) -> PortCalibration:
    """Calibration by the manufacturer of a lens of `focal` [px], which is correct in air."""
    return PortCalibration(focal=focal)


def in_water(
    port: FlatPort,
    focal: float,
    corner: float,
    ranges: Sequence[float] = (0.5, 1.0, 2.0),
    move_center: bool = True,
) -> PortCalibration:
    """Pinhole with distortion that best fits calibration boards seen through `port`, by least
    squares in pixels.

    Args:
        port: The flat port.
        focal: Focal length of the lens [px].
        corner: Distance from the centre of the image to its corner [px].
        ranges: Ranges of the boards [m], which may be anywhere in the image.
        move_center: Whether to fit the position of the pinhole on the axis, too; otherwise it is at
            the lens.

    Returns:
        The calibration.

    Raises:
        ConfigurationError: A board is not in the water, or a number is not positive.
    """
    if not (focal > 0.0 and corner > 0.0 and len(ranges)):
        raise ConfigurationError(
            f"calibration: focal, corner and ranges must be positive, got {focal}, {corner}"
        )

    way = port.rays([corner / focal, 0.0])[1][0]
    z = np.asarray(ranges, dtype=np.float64)[:, None]
    radius = z * way * np.linspace(0.02, 1.0, 50)
    image_radius = focal * port.tangent(radius, z)

    def fit(center: float) -> tuple[Array, float]:
        t = radius / (z - center)
        # The number of pixels at a radius is proportional to the radius.
        weight = np.sqrt(radius / z).ravel()
        A = np.stack([t, t**3, t**5], axis=-1).reshape(-1, 3) * weight[:, None]
        solution = np.linalg.lstsq(A, weight * image_radius.ravel(), rcond=None)[0]
        return solution, float(np.square(A @ solution - weight * image_radius.ravel()).sum())

    center = 0.0
    if move_center:
        from scipy import optimize

        span = port.distance + port.thickness
        optimum = optimize.minimize_scalar(
            lambda c: fit(c)[1], bounds=(-span, span), options={"xatol": 1e-7}
        )
        center = float(optimum.x)

    (f, f_k1, f_k2), _ = fit(center)
    return PortCalibration(focal=float(f), k1=float(f_k1 / f), k2=float(f_k2 / f), center=center)


class StereoReader(NamedTuple):
    """Depth that a stereo pair measures through a flat port, with `baseline` between its two
    cameras.

    Both images are rectified by one calibration. Depth is baseline / (difference of the rectified x
    tangents).
    """

    tangent_x: Array  # (W,) rectified x tangents of the columns
    port: _Port
    scale: float  # ratio of the calibration's focal length to that of the lenses
    k1: float
    k2: float
    baseline: float  # [m]

    @classmethod
    def of(
        cls,
        port: FlatPort,
        calibration: PortCalibration,
        focal: float,
        baseline: float,
        tangent_x: Array,
    ) -> "StereoReader":
        """Set up the reader.

        Args:
            port: The flat port.
            calibration: Camera model of both cameras.
            focal: Focal length of the lenses [px].
            baseline: [m]
            tangent_x: Rectified x tangents (W,) of the columns.

        Returns:
            The reader.
        """
        scale = float(calibration.focal / focal)
        return cls(
            tangent_x,
            port.numbers,
            scale,
            float(calibration.k1),
            float(calibration.k2),
            float(baseline),
        )

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Depth (H, W) [m], float32, of points (H, W, 3) [m] in the frame of the left camera; inf
        without a point.
        """
        return _read(np.ascontiguousarray(points, dtype=np.float64), self)


@kernel
def _tangent(rho: float, z: float, port: _Port) -> float:
    """Root s of rho = distance s + thickness s_g(s) + (z - distance - thickness) s_w(s), whose
    right side increases with s.
    """
    distance, thickness, n_glass, n_water = port
    if rho == 0.0:
        return 0.0
    depth = z - distance - thickness

    # The sum is concave, and the start, computed from its slope at the axis, lies below the root.
    # Newton's method therefore does not overshoot.
    s = rho / (distance + thickness / n_glass + depth / n_water)
    for _ in range(_STEPS):
        square = s * s
        glass = n_glass * n_glass * (1.0 + square) - square
        water = n_water * n_water * (1.0 + square) - square
        root_glass = np.sqrt(glass)
        root_water = np.sqrt(water)
        off = s * (distance + thickness / root_glass + depth / root_water) - rho

        # d(s / sqrt(n^2 (1 + s^2) - s^2)) / ds = n^2 / (...)^(3/2)
        slope = (
            distance
            + thickness * n_glass * n_glass / (glass * root_glass)
            + depth * n_water * n_water / (water * root_water)
        )

        step = off / slope
        s -= step
        if abs(step) < 1e-13 * (1.0 + s):
            break
    return s


@kernel
def _tangents(rho: np.ndarray, z: np.ndarray, port: _Port) -> np.ndarray:
    tangents = np.empty(len(rho))
    for i in range(len(rho)):
        tangents[i] = _tangent(rho[i], z[i], port)
    return tangents


@kernel
def _read(points: np.ndarray, reader: StereoReader) -> np.ndarray:
    """Depth (H, W) [m] of points (H, W, 3) [m]; see `StereoReader`."""
    scale = reader.scale
    k1 = reader.k1
    k2 = reader.k2
    baseline = reader.baseline
    rows, columns = points.shape[:2]
    depth = np.full((rows, columns), np.inf, dtype=np.float32)

    for i in range(rows):
        for j in range(columns):
            x = points[i, j, 0] - baseline
            y = points[i, j, 1]
            z = points[i, j, 2]
            if not np.isfinite(z):
                continue
            rho = np.sqrt(x * x + y * y)
            s = _tangent(rho, z, reader.port)

            # Rectified tangent, by Newton's method on the distortion.
            t = s / scale
            for _ in range(_STEPS):
                square = t * t
                off = t * (1.0 + square * (k1 + square * k2)) - s / scale
                step = off / (1.0 + square * (3.0 * k1 + 5.0 * square * k2))
                t -= step
                if abs(step) < 1e-12:
                    break

            difference = reader.tangent_x[j] - (t * x / rho if rho > 0.0 else 0.0)
            if difference > 0.0:
                depth[i, j] = baseline / difference

    return depth
