"""The part of a scan that may show the object, thinned for ICP, and the agreement of a pose with
it.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy import fft, ndimage

from uuv.perception.clouds.nearest_point import NearestPoint
from uuv.perception.clouds.scan import Scan, SensorModel, facing_normals, hashed_subset, voxel_means
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, transform_points

MODEL_TOLERANCE = 0.001  # [m] accuracy of the model
_GRAZING = np.deg2rad(88.0)  # [rad] largest incidence at which the model explains a scanned point
_HASHED = 1e-4  # [m] edge of the cubes by which points are drawn
_BLOCK = 48  # [px] edge of the blocks of smooth surface in which noise is estimated
_SAME_DEPTH = 0.4  # [-] largest difference of the logarithm of a block's depth from the object's
_FEWEST_BLOCKS = 4  # least number of blocks; with fewer the noise is taken as stated
_NOISE_PIXELS = 40_000  # approximate largest number of pixels from which noise is estimated
_INLYING = 3.0  # [sigma] as stated, beyond which a difference is not noise
_LEAST_PIXELS = 200  # least number of pixels; with fewer the noise is taken as stated
_CORRELATED = 2.5  # [noise lengths] distance up to which errors may be correlated
_UNCORRELATED = 0.1  # [-] correlation that counts as zero
_LEAST_LENGTH = 2.0  # [px] largest correlation length
_MAX_SCAN_POINTS = 4000  # approximate largest number of scan points in ICP; more add only time


@dataclass(frozen=True, eq=False)
class Evidence:
    """The part of a scan that is used in ICP."""

    scan: Scan
    mask: np.ndarray  # (h, w) pixels around the initial poses that may belong to the object
    # (h, w) all pixels that stand out from the background, wherever the model may be placed
    standing: np.ndarray
    points: Array  # (n, 3) [m] thinned, in S
    normals: Array  # (n, 3) unit, towards the sensor
    sigma: Array  # (n,) [m] standard deviation of depth
    # (n,) [-] share of an independent reading, because errors of neighbours are correlated
    independent: Array
    sensor: SensorModel  # errors of depth as the sensor states them, from which limits are computed
    # errors of depth with which poses are fitted and ranked: as stated, or as this scan shows them
    # (`seen_noise`)
    noise: SensorModel

    @classmethod
    def of(
        cls,
        scan: Scan,
        mask: np.ndarray,
        spacing: float,
        sensor: SensorModel,
        standing: np.ndarray | None = None,
        most: int = _MAX_SCAN_POINTS,
    ) -> "Evidence":
        """Thin the masked pixels to one point per cube and estimate normals.

        Args:
            scan: The scan.
            mask: (h, w) pixels that may belong to the object.
            spacing: [m] edge of the cubes.
            sensor: Accuracy of the sensor.
            standing: (h, w) all pixels that stand out from the background; None: `mask`.
            most: Approximate largest number of points.

        Returns:
            The evidence.
        """
        points = voxel_means(scan.points[mask], spacing)

        # Few enough, drawn without regard to their order
        step = max(1, -(-len(points) // most))
        drawn = hashed_subset(step, points, spacing)
        normals = facing_normals(points, at=drawn)
        points = points[drawn]

        apart = np.sqrt(step) * spacing / (scan.pitch * points[:, 2])  # [px]
        return cls(
            scan=scan,
            mask=mask,
            standing=mask if standing is None else standing,
            points=points,
            normals=normals,
            sigma=sensor.sigma(points[:, 2]),
            independent=sensor.independent(apart),
            sensor=sensor,
            noise=sensor,
        )

    @cached_property
    def middle(self) -> float:
        """Median depth [m] of the points."""
        return float(np.median(self.points[:, 2]))

    @cached_property
    def median_sigma(self) -> float:
        """Median standard deviation [m] of the points' depth."""
        return float(np.median(self.sigma))

    def with_noise(self, noise: SensorModel) -> "Evidence":
        """The same evidence with errors of depth as in `noise`."""
        sigma = noise.sigma(self.points[:, 2])
        tighter = (self.noise.noise_length / noise.noise_length) ** 2
        return replace(
            self, sigma=sigma, independent=np.minimum(1.0, tighter * self.independent), noise=noise
        )

    def thinned(self, step: int, points: int) -> "Evidence":
        """The same evidence on every `step`-th row and column, with about `points` points."""
        return _thinned(self, step, points)


@remembered(4)  # the search for the object and that for its mirror image begin with the same points
def _thinned(evidence: Evidence, step: int, points: int) -> Evidence:
    every = (slice(None, None, step), slice(None, None, step))
    few = max(1, -(-len(evidence.points) // points))
    drawn = hashed_subset(few, evidence.points, _HASHED)

    return replace(
        evidence,
        scan=evidence.scan.part(every),
        mask=evidence.mask[every],
        standing=evidence.standing[every],
        points=evidence.points[drawn],
        normals=evidence.normals[drawn],
        sigma=evidence.sigma[drawn],
        independent=np.minimum(1.0, few * evidence.independent[drawn]),
        sensor=_coarser(evidence.sensor, step),
        noise=_coarser(evidence.noise, step),
    )


def _coarser(sensor: SensorModel, step: int) -> SensorModel:
    """The model on every `step`-th row and column."""
    return replace(sensor, noise_length=max(1.0, sensor.noise_length / step))


def surface_noise(scan: Scan, mask: np.ndarray, stated: SensorModel) -> SensorModel:
    """Errors of depth, estimated from the smooth surfaces of a scan at the masked pixels' depth.

    In inverse depth a block of such a surface is a quadratic function of the pixel; the residuals
    are noise. Rough or broken blocks have larger residuals, so the lower quartile of the blocks is
    used. Only the standard deviation is estimated, and it never exceeds the stated one.

    Args:
        scan: The scan.
        mask: (h, w) pixels that may belong to the object.
        stated: Accuracy of the sensor.
    """
    rows, columns = (np.arange(0, n - _BLOCK + 1, _BLOCK) for n in scan.depth.shape)
    basis = _quadratic_functions()
    middle = float(np.median(scan.depth[mask]))

    # Mean square of the residuals from a quadratic surface in each block, over the stated variance
    variances = []
    for row in rows:
        for column in columns:
            z = scan.depth[row : row + _BLOCK, column : column + _BLOCK].ravel()
            if not np.isfinite(z).all() or abs(np.log(z.mean() / middle)) > _SAME_DEPTH:
                continue
            inverse = 1.0 / z
            off = inverse - basis @ (basis.T @ inverse)
            variances.append(float(np.mean((off * z * z / stated.sigma(z)) ** 2)))

    if len(variances) < _FEWEST_BLOCKS:
        return stated
    variance = (
        float(np.quantile(variances, 0.25)) + (MODEL_TOLERANCE / float(stated.sigma(middle))) ** 2
    )
    return replace(
        stated, disparity_sigma=stated.disparity_sigma * min(1.0, float(np.sqrt(variance)))
    )


@cache
def _quadratic_functions() -> Array:
    """Orthonormal basis (_BLOCK^2, 6) of the quadratic functions of a block's pixels."""
    x = np.linspace(-1.0, 1.0, _BLOCK)
    y, x = (axis.ravel() for axis in np.meshgrid(x, x, indexing="ij"))
    return np.linalg.qr(np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y]))[0]


def seen_noise(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> SensorModel:
    """Errors of depth, estimated from the difference of the scan from the model at its likeliest
    pose `X_ST`.

    Variance and area of correlation come from the differences that remain. They are never estimated
    larger than stated, since a wrong pose would then hide the evidence against it, nor smaller than
    the error of the model.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.
    """
    stated = evidence.sensor
    scan = evidence.scan.part(
        evidence.scan.window(transform_points(X_ST, surface.hull), 0.0, _NOISE_PIXELS)
    )

    # Differences from the model, in standard deviations as stated
    depth = surface.depth(X_ST, scan)
    off = (scan.depth - depth) / stated.sigma(np.where(np.isfinite(depth), depth, 1.0))
    used = np.abs(off) < _INLYING  # False for NaN
    if used.sum() < _LEAST_PIXELS:
        return stated

    # Autocorrelation over the pairs of pixels that were compared
    off[~used] = 0.0
    reach = int(np.ceil(_CORRELATED * stated.noise_length))
    products, pairs = (_autocorrelation(field, reach) for field in (off, used.astype(np.float64)))
    variance = float(np.square(off).sum() / used.sum())
    correlation = np.where(pairs > _LEAST_PIXELS, products / np.maximum(pairs, 1.0), 0.0) / max(
        variance, 1e-12
    )

    # Area of the peak: number of pixels that share one error
    around = ndimage.label(correlation > _UNCORRELATED)[0]
    area = float(correlation[around == around[reach, reach]].sum())  # [px of the window]

    floor = (MODEL_TOLERANCE / float(np.median(stated.sigma(depth[used])))) ** 2
    step = scan.pitch / evidence.scan.pitch
    return replace(
        stated,
        disparity_sigma=stated.disparity_sigma
        * float(np.sqrt(np.clip(variance + floor, 0.0, 1.0))),
        noise_length=min(stated.noise_length, max(_LEAST_LENGTH, step * np.sqrt(max(area, 0.0)))),
    )


def _autocorrelation(image: np.ndarray, reach: int) -> np.ndarray:
    """Sums of products of an image (h, w) with itself, moved by up to `reach` pixels.

    Shape (2 reach + 1, 2 reach + 1).
    """
    shape = [n + reach for n in image.shape]
    power = np.abs(fft.rfft2(image, shape)) ** 2
    every = fft.irfft2(power, shape)
    return np.roll(every, (reach, reach), axis=(0, 1))[: 2 * reach + 1, : 2 * reach + 1]


def score(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Mutual agreement of scan and model at `X_ST`, from -1 to 2: higher is better.

    The score is the share of the visible model that the scan confirms, minus the share that the
    scan sees through, plus the share of the scan that the model explains.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        The score [-].
    """
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if visible.sum() < 10:
        return -1.0
    points = transform_points(X_ST, surface.points[visible])

    # Model points that the scan confirms, and that it sees through
    row, column, _ = evidence.scan.pixels(points)
    measured = evidence.scan.depth[row, column]
    tolerance = 2.0 * surface.spacing + 3.0 * evidence.sensor.sigma(points[:, 2])
    behind = measured - points[:, 2]
    agree = float(np.mean(np.abs(behind) < tolerance))
    through = float(np.mean(behind > 2.0 * tolerance))

    return agree - through + float(np.mean(explained(evidence, surface, X_ST)))


def explained(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> np.ndarray:
    """Mask (n,) of the scan points that lie on the visible model.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        Mask (n,).
    """
    return _explained(evidence, surface, X_ST.tobytes())


@remembered(4)  # the accepted pose is verified by the check and by its score
def _explained(evidence: Evidence, surface: ModelSurface, pose_bytes: bytes) -> np.ndarray:
    X_ST = np.frombuffer(pose_bytes).reshape(4, 4)

    # an echo at such incidence is not expected, but possible
    visible = surface.visible(X_ST, evidence.scan, _GRAZING)
    if not visible.any():
        return np.zeros(len(evidence.points), dtype=bool)
    points = transform_points(X_ST, surface.points[visible])

    limit = 2.0 * surface.spacing + 3.0 * evidence.sensor.sigma(evidence.points[:, 2])
    mask = (
        NearestPoint.of(points, surface.spacing).query(evidence.points, float(limit.max()))[0]
        < limit
    )
    mask.setflags(write=False)
    return mask
