"""Log likelihood of a scan given the model's pose: ranks hypotheses and separates poses that look alike.

Each pixel's depth is compared with the model's depth, in units of the sensor's noise. The cost is clipped, which leaves
room for growth and dents. A share of points within a tolerance cannot tell a plate from the same plate turned round,
because every single difference drowns in noise; a sum of squares over hundreds of pixels can.
"""

import numpy as np

from perception.registration.fine_fit import Evidence, ModelSurface
from sim.interfaces.spatial import Array

OCCLUDER = 0.06  # [m] in front of the model: nearer pixels show something else, not the object, fouled or not
_PIXELS = 40_000  # pixels of the thinned scan, at most about
_MOST = 9.0  # [sigma^2] largest cost of a pixel that contradicts the model
_UNEXPLAINED = 4.0  # [sigma^2] cost of a masked pixel that the model does not cover


def log_likelihood(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Log likelihood of the scan with the model at `X_ST`, up to a constant common to all poses.

    Pixels without depth, and background pixels that the model does not cover, contribute nothing.

    Args:
        evidence: Scan and mask of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        The log likelihood [nat].
    """
    rows, columns = evidence.mask.shape
    step = int(np.ceil(np.sqrt(max(1.0, rows * columns / _PIXELS))))
    scan = evidence.scan.part((slice(0, rows, step), slice(0, columns, step)))
    depth = surface.seen(X_ST, scan)[0].depth
    shown = np.isfinite(depth) & np.isfinite(scan.depth)
    sigma = evidence.sensor.sigma(np.where(shown, depth, 1.0))
    behind = np.where(shown, scan.depth - depth, 0.0)
    shown &= behind > -np.maximum(OCCLUDER, 6.0 * sigma)  # pixels of an occluder carry no information on the model
    cost = np.where(evidence.mask[::step, ::step] & np.isfinite(scan.depth), _UNEXPLAINED, 0.0)
    cost[shown] = np.minimum((behind[shown] / sigma[shown]) ** 2, _MOST)
    return -0.5 * float(evidence.sensor.independent(step) * cost.sum())
