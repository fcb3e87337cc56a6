"""The fit as the papers have it: ICP from point to point, from the model to the scan (papers 002 and 004).

The model's cloud is laid on the scan's, matched, rid of the points that the sensor cannot see, and matched again. ICP
stops when its error no longer falls; if it is then not as small as required, a new scan is asked for. Kept to compare
with: matching the scan to planes of the visible model is several times as accurate
(`perception.registration.fine_fit`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from perception.registration.fine_fit import Evidence, ModelSurface
from sim.interfaces.spatial import Array, pose, transform_points

_MODEL_POINTS = 4000
_FALLS = 1e-5  # share of the error by which it must fall for another iteration
_MOST = 300  # iterations
_ALLOWED = 2.0  # times the noise and spacing of the points


@dataclass(frozen=True, slots=True, eq=False)
class PaperFit:
    """Where the papers' ICP stopped."""

    X_ST: Array  # (4, 4)
    error: float  # [m] rms distance of the model's visible points from the nearest of the scan
    required: float  # [m] that it must not exceed, or a new scan is asked for


def laid_on(points: Array, surface: ModelSurface, R_ST: Array) -> Array:
    """Pose (4, 4) of the model, turned by `R_ST` (3, 3), with the middle of its points on that of `points` (N, 3)."""
    return pose(R_ST, points.mean(axis=0) - R_ST @ surface.points.mean(axis=0))


def paper_fit(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> PaperFit:
    """ICP with all of the model's points, and again with those that can be seen from where the first came to rest."""
    step = -(-len(surface.points) // _MODEL_POINTS)
    tree = cKDTree(evidence.points)
    X_ST, error = _icp(tree, surface.points[::step], X_ST)
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence, step)
    if visible.sum() >= 10:
        X_ST, error = _icp(tree, surface.points[::step][visible], X_ST)
    noise = float(np.sqrt(np.mean(evidence.sigma**2)))
    return PaperFit(X_ST, error, _ALLOWED * float(np.hypot(noise, surface.spacing)))


def _icp(tree: cKDTree, points_T: Array, X_ST: Array) -> tuple[Array, float]:
    """Each of `points_T` (M, 3) to the nearest point of the scan, until the rms distance [m] no longer falls."""
    error, middle = np.inf, points_T.mean(axis=0)
    for _ in range(_MOST):
        distance, index = tree.query(transform_points(X_ST, points_T))
        before, error = error, float(np.sqrt(np.mean(distance**2)))
        if not error < (1.0 - _FALLS) * before:
            break
        nearest = tree.data[index]
        # The rotation that brings the pairs nearest together: Arun, Huang and Blostein 1987.
        U, _, Vt = np.linalg.svd((nearest - nearest.mean(axis=0)).T @ (points_T - middle))
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        X_ST = pose(R, nearest.mean(axis=0) - R @ middle)
    return X_ST, error
