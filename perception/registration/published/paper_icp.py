"""Point-to-point ICP, the published baseline [Konoplin 2022], [Konoplin 2019].

The model's centroid is moved to the scan's, then ICP runs a few iterations with all model points.
Points that the sensor cannot see are removed and ICP runs until its error no longer decreases. If
the error is then above the required one, a new scan is requested.

The papers do not say which cloud looks for its nearest points in the other. From model to scan,
parts of the model that the frame does not show still get partners; from scan to model, points
beside the object do. Point-to-plane ICP from the scan to the visible model
(`uuv.perception.registration.fine_fit`) is several times as accurate.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, inverse, pose, transform_points

_MODEL_POINTS = 4000  # largest number of model points used
_FALLS = 1e-5  # [-] relative decrease of the error, below which ICP stops
# largest number of iterations with all model points, and with the visible ones
_FIRST, _MOST = 10, 300
_ALLOWED = 2.0  # [-] required rms distance as a multiple of the points' noise and spacing


@dataclass(frozen=True, slots=True, eq=False)
class PaperFit:
    """Result of the point-to-point ICP."""

    X_ST: Array  # (4, 4) fitted pose of T in S
    error: float  # [m] rms distance of the paired points
    required: float  # [m] largest allowed `error`; above it a new scan is requested

    @property
    def asks(self) -> str:
        """Reason why a new scan is requested; empty if none is."""
        if self.error <= self.required:
            return ""
        return (
            f"the error no longer falls at {1e3 * self.error:.1f} mm, required are "
            f"{1e3 * self.required:.1f} mm"
        )


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


def paper_fit(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, *, from_scan: bool = False
) -> PaperFit:
    """Run the first iterations of ICP with all model points, the others with the visible ones.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) initial pose of T in S.
        from_scan: The scan's points look for the nearest ones of the model, not the model's for
            those of the scan.

    Returns:
        The fitted pose with its error and the required error [m].
    """
    step = -(-len(surface.points) // _MODEL_POINTS)
    fit = _from_scan if from_scan else _from_model

    # First with all points of the model, then with those that the sensor can see
    X_ST, error = fit(evidence.points, surface.points[::step], X_ST, _FIRST)

    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence, step)
    if visible.sum() >= 10:
        X_ST, error = fit(evidence.points, surface.points[::step][visible], X_ST, _MOST)
    return PaperFit(X_ST, error, required_error(evidence, surface))


def required_error(evidence: Evidence, surface: ModelSurface) -> float:
    """Largest rms distance [m] of a good fit, from noise and spacing; the paper does not state
    it.
    """
    noise = float(np.sqrt(np.mean(evidence.sigma**2)))
    return _ALLOWED * float(np.hypot(noise, surface.spacing))


def _from_model(
    points_S: Array, points_T: Array, X_ST: Array, iterations: int
) -> tuple[Array, float]:
    """ICP whose pairs are the model's points and their nearest ones of the scan.

    Args:
        points_S: (k, 3) [m] of the scan.
        points_T: (m, 3) [m] of the model.
        X_ST: (4, 4) initial pose.
        iterations: At most.

    Returns:
        The pose, and the rms distance [m] of the pairs when it no longer fell.
    """
    tree = cKDTree(points_S)
    error = np.inf
    for _ in range(iterations):
        distance, index = tree.query(transform_points(X_ST, points_T))

        before = error
        error = float(np.sqrt(np.mean(distance**2)))
        if not error < (1.0 - _FALLS) * before:
            break
        X_ST = _laid(points_T, points_S[index])
    return X_ST, error


def _from_scan(
    points_S: Array, points_T: Array, X_ST: Array, iterations: int
) -> tuple[Array, float]:
    """ICP whose pairs are the scan's points and their nearest ones of the model; as above."""
    tree = cKDTree(points_T)
    error = np.inf
    for _ in range(iterations):
        distance, index = tree.query(transform_points(inverse(X_ST), points_S))

        before = error
        error = float(np.sqrt(np.mean(distance**2)))
        if not error < (1.0 - _FALLS) * before:
            break
        X_ST = _laid(points_T[index], points_S)
    return X_ST, error


def _laid(points_T: Array, points_S: Array) -> Array:
    """Least-squares pose X_ST (4, 4) of pairs of points (n, 3) [m], by SVD [Arun 1987]."""
    middle_T = points_T.mean(axis=0)
    middle_S = points_S.mean(axis=0)
    U, _, Vt = np.linalg.svd((points_S - middle_S).T @ (points_T - middle_T))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return pose(R, middle_S - R @ middle_T)
