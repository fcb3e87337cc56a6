"""Point-to-point ICP from model to scan, the published baseline [Konoplin 2022], [Konoplin 2019].

The model's centroid is moved to the scan's, then ICP runs a few iterations with all model points.
Points that the sensor cannot see are removed and ICP runs until its error no longer decreases. If
the error is then above the required one, a new scan is requested. Point-to-plane ICP from the scan
to the visible model (`uuv.perception.registration.fine_fit`) is several times as accurate.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, pose, transform_points

_MODEL_POINTS = 4000  # largest number of model points used
_FALLS = 1e-5  # [-] relative decrease of the error, below which ICP stops
# largest number of iterations with all model points, and with the visible ones
_FIRST, _MOST = 10, 300
_ALLOWED = 2.0  # [-] required rms distance as a multiple of the points' noise and spacing


@dataclass(frozen=True, slots=True, eq=False)
class PaperFit:
    """Result of the point-to-point ICP."""

    X_ST: Array  # (4, 4) fitted pose of T in S
    error: float  # [m] rms distance of the visible model points from their nearest scan points
    required: float  # [m] largest allowed `error`; above it a new scan is requested


def laid_on(points: Array, surface: ModelSurface, R_ST: Array) -> Array:
    """Initial pose: the model rotated by `R_ST`, its centroid on that of the scan points.

    Args:
        points: (n, 3) [m] scan points in S.
        surface: Sampled model.
        R_ST: (3, 3) rotation of T in S.

    Returns:
        X_ST (4, 4).
    """
    return pose(R_ST, points.mean(axis=0) - R_ST @ surface.points.mean(axis=0))


def paper_fit(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> PaperFit:
    """Run the first iterations of ICP with all model points, the others with the visible ones.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) initial pose of T in S.

    Returns:
        The fitted pose with its error and the required error [m].
    """
    step = -(-len(surface.points) // _MODEL_POINTS)
    tree = cKDTree(evidence.points)

    X_ST, error = _icp(tree, surface.points[::step], X_ST, _FIRST)

    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence, step)
    if visible.sum() >= 10:
        X_ST, error = _icp(tree, surface.points[::step][visible], X_ST, _MOST)
    return PaperFit(X_ST, error, required_error(evidence, surface))


def required_error(evidence: Evidence, surface: ModelSurface) -> float:
    """Largest rms distance [m] of a good fit, from noise and spacing; the paper does not state
    it.
    """
    noise = float(np.sqrt(np.mean(evidence.sigma**2)))
    return _ALLOWED * float(np.hypot(noise, surface.spacing))


def _icp(tree: cKDTree, points_T: Array, X_ST: Array, iterations: int) -> tuple[Array, float]:
    """Point-to-point ICP of `points_T` (m, 3) [m] to the scan, until the rms distance [m] no longer
    decreases.
    """
    error = np.inf
    middle = points_T.mean(axis=0)
    for _ in range(iterations):
        distance, index = tree.query(transform_points(X_ST, points_T))
        before = error
        error = float(np.sqrt(np.mean(distance**2)))
        if not error < (1.0 - _FALLS) * before:
            break

        nearest = tree.data[index]
        # Least-squares rotation of the paired points by SVD [Arun 1987].
        U, _, Vt = np.linalg.svd((nearest - nearest.mean(axis=0)).T @ (points_T - middle))
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        X_ST = pose(R, nearest.mean(axis=0) - R @ middle)
    return X_ST, error
