"""Likelihood of a scan, given the pose of a known model, by which poses are ranked."""

from collections.abc import Sequence

import numpy as np

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, transform_points

# [m] distance in front of the model, from which on a pixel shows something else, even if the object
# is fouled
OCCLUDER = 0.06
_PIXELS = 40_000  # approximate largest number of pixels of the thinned scan in the likelihood
_GLANCED = 2_000  # number of pixels that suffices to rank poses which are not fitted yet
_FILLED = 0.5  # [-] approximate share of the square around a model's sphere that its picture fills
_MOST_COST = 9.0  # [sigma^2] largest cost of a pixel that contradicts the model
# [sigma^2] cost of a pixel of the background, which a plane explains except for noise
_BACKGROUND_COST = 1.0
_UNEXPLAINED_COST = 4.0  # [sigma^2] cost of a masked pixel that the model does not cover


def glance(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Log likelihood [nat] from a twentieth of the pixels; arguments as for `log_likelihood`."""
    return _compared(evidence, surface, X_ST, _GLANCED)


def log_likelihood(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, pixels: int = _PIXELS
) -> float:
    """Log likelihood of the scan with the model at `X_ST`, up to a constant common to all poses.

    Each pixel's depth is compared with the model's, in units of the sensor's noise. The cost is
    clipped, which leaves room for growth and dents. A share of points within a tolerance cannot
    distinguish a plate from the same plate turned round, because every single difference is smaller
    than the noise. A sum of squares over hundreds of pixels can.

    Pixels without depth contribute nothing. Pixels outside the model have a constant cost, whether
    they stand out or are background, so that only the pixels that the model covers are compared.
    The resolution for a small object in a heap is therefore the same as for a single object.

    Args:
        evidence: Scan and mask of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.
        pixels: Approximate largest number of pixels around the model that are compared.

    Returns:
        The log likelihood [nat], more than without the model.
    """
    return _weighed(evidence, surface, X_ST.tobytes(), pixels)


# stored, since the same pose is ranked when it is fitted, as the start of the next fit, and when it
# is verified
@remembered(64)
def _weighed(evidence: Evidence, surface: ModelSurface, pose_bytes: bytes, pixels: int) -> float:
    return _compared(evidence, surface, np.frombuffer(pose_bytes).reshape(4, 4), pixels)


def _compared(evidence: Evidence, surface: ModelSurface, X_ST: Array, pixels: int) -> float:
    """As `log_likelihood`."""
    window = _window(evidence, [(surface, X_ST)], pixels)
    if window is None:
        return 0.0

    # Pixels with depth that the model covers
    scan = evidence.scan.part(window)
    mask = evidence.standing[window]
    rows, columns = np.nonzero(np.isfinite(scan.depth))
    depth = surface.depth_along(X_ST, scan.lines_of_sight(rows, columns))
    met = np.isfinite(depth)
    rows = rows[met]
    columns = columns[met]
    depth = depth[met].astype(np.float64)

    sigma = evidence.noise.sigma(depth)
    behind = scan.depth[rows, columns] - depth
    # pixels of an occluder carry no information on the model
    shown = behind > -np.maximum(OCCLUDER, 6.0 * sigma)
    without = np.where(mask[rows, columns], _UNEXPLAINED_COST, _BACKGROUND_COST)
    if (known := scan.known) is not None:
        explainer = known.depth[rows, columns]
        shown &= ~(explainer < depth)  # nor do pixels where a known object hides the model
        covered = np.isfinite(explainer)
        explained = (
            np.where(
                covered,
                (scan.depth[rows, columns] - np.where(covered, explainer, 0.0)) / sigma,
                0.0,
            )
            ** 2
        )
        without = np.where(covered, np.minimum(explained, _UNEXPLAINED_COST), without)

    cost = np.minimum((behind[shown] / sigma[shown]) ** 2, _MOST_COST) - without[shown]
    return -0.5 * _weight(evidence, window) * float(cost.sum())


def difference(
    evidence: Evidence, one: tuple[ModelSurface, Array], other: tuple[ModelSurface, Array]
) -> float:
    """Expected log likelihood ratio [nat] of two models at their poses, on this scan's pixels.

    Args:
        evidence: Scan and sensor.
        one: A sampled model and its pose X_ST (4, 4).
        other: Another one.

    Returns:
        The expected log likelihood ratio [nat], 0 where both look the same; occluded pixels do not
        count.
    """
    window = _window(evidence, [one, other], _PIXELS)
    if window is None:
        return 0.0

    scan = evidence.scan.part(window)
    a, b = (surface.depth(X_ST, scan) for surface, X_ST in (one, other))
    z = np.where(np.isfinite(a), a, np.where(np.isfinite(b), b, 1.0))
    sigma = evidence.noise.sigma(z)

    counted = (np.isfinite(a) | np.isfinite(b)) & (
        scan.depth > z - np.maximum(OCCLUDER, 6.0 * sigma)
    )

    cost = np.where(
        np.isfinite(a) & np.isfinite(b), np.minimum(((a - b) / sigma) ** 2, _MOST_COST), _MOST_COST
    )
    return 0.5 * _weight(evidence, window) * float(cost[counted].sum())


def _weight(evidence: Evidence, window: tuple[slice, slice]) -> float:
    """Number of independent readings that a pixel of the window represents, including the pixels
    removed by thinning.

    The window depends on the pose. If the removed pixels were not counted, a pose with a smaller
    picture would be likelier.
    """
    return float(evidence.noise.independent(1.0)) * window[0].step ** 2


def _window(
    evidence: Evidence, models: Sequence[tuple[ModelSurface, Array]], pixels: int
) -> tuple[slice, slice] | None:
    """Rows and columns around models at their poses (4, 4), thinned; None if out of the picture.

    The step depends on the size of the models at the depth of the evidence, and not on the pose,
    because with other pixels the sum over thousands of them differs by tens of nats.
    """
    corners = [transform_points(X_ST, surface.hull) for surface, X_ST in models]
    rows, columns = evidence.scan.window(np.concatenate(corners), 0.0, evidence.scan.depth.size)
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return None

    largest = max(surface.radius for surface, _ in models)
    across = 2.0 * largest / (evidence.scan.pitch * evidence.middle)  # [px]
    step = max(1, int(np.ceil(across * np.sqrt(_FILLED / pixels))))
    return slice(rows.start // step * step, rows.stop, step), slice(
        columns.start // step * step, columns.stop, step
    )
