"""How likely is the scan with the model at a pose? What ranks poses, and tells those apart that look alike.

Each pixel is held against the depth of the model there, in units of the sensor's noise, up to a limit that leaves
room for growth and dents. Unlike a share of points within a tolerance, a sum of squares over hundreds of pixels tells
a plate from the same plate turned round where every single difference drowns in noise.
"""

import numpy as np

from perception.registration.fine_fit import Evidence, ModelSurface
from sim.interfaces.spatial import Array

OCCLUDER = 0.06  # [m] before the model from which on the scan shows something else, not the object, fouled or not
_PIXELS = 40_000  # the scan is thinned to this
_MOST = 9.0  # cost [sigma^2] of a pixel that contradicts the model
_UNEXPLAINED = 4.0  # cost of one that may show the object, and that the model does not explain


def log_likelihood(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Of the scan with the model at `X_ST` (4, 4), in nats and up to a constant that is the same for all poses.

    Pixels without depth, and those of the background that the model leaves alone, say nothing.
    """
    rows, columns = evidence.mask.shape
    step = int(np.ceil(np.sqrt(max(1.0, rows * columns / _PIXELS))))
    scan = evidence.scan.part((slice(0, rows, step), slice(0, columns, step)))
    depth = surface.seen(X_ST, scan)[0].depth
    shown = np.isfinite(depth) & np.isfinite(scan.depth)
    sigma = evidence.sensor.sigma(np.where(shown, depth, 1.0))
    behind = np.where(shown, scan.depth - depth, 0.0)
    shown &= behind > -np.maximum(OCCLUDER, 6.0 * sigma)  # else hidden: the model is not what is seen there
    cost = np.where(evidence.mask[::step, ::step] & np.isfinite(scan.depth), _UNEXPLAINED, 0.0)
    cost[shown] = np.minimum((behind[shown] / sigma[shown]) ** 2, _MOST)
    return -0.5 * float(evidence.sensor.independent(step) * cost.sum())
