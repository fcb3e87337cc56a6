"""Rotations under which a model looks nearly the same, such as one arm of a starfish further or a plate turned round.

They are found on the model alone, by rotating it about its principal axes. PoseCheck must then separate the fitted pose
from them by the scan. Rotations declared as symmetry count as the same pose.
"""

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from perception.registration.fine_fit import Evidence, ModelSurface, fine_fit
from perception.registration.likelihood import log_likelihood
from sim.interfaces.spatial import Array, exp_so3, pose, transform_points

_FOLDS = (2, 3, 4, 5, 6, 8)  # n of the rotations by multiples of 360/n deg
_ALIKE = 0.06  # [-] rms distance between the surfaces, as a share of the radius, up to which a rotation is tried
_POINTS = 600  # model points compared, about
_FEW = 10  # every so many of these points, a first test
_TRIED = 6  # rotations kept, the most similar first


@lru_cache(maxsize=16)
def ambiguous_poses(surface: ModelSurface) -> tuple[Array, ...]:
    """Poses G (4, 4) in T such that the model at X G looks nearly as at X, most similar first; may be empty.

    Rotations by multiples of 360/n deg, n from `_FOLDS` (2 to 8), about the principal axes and the axes of T. They pass
    through the centroid of the surface and through the centre of its bounding box.
    """
    points = surface.points[:: max(1, len(surface.points) // _POINTS)]
    tree = cKDTree(surface.points)
    symmetry = surface.target.symmetry
    found: list[tuple[float, Array]] = []
    for middle in (surface.points.mean(axis=0), surface.center):
        main = np.linalg.eigh(np.cov((surface.points - middle).T))[1].T
        for axis in np.vstack([main, np.eye(3)]):
            for angle in sorted({2.0 * np.pi * k / n for n in _FOLDS for k in range(1, n)}):
                R = exp_so3(angle * axis)
                G = pose(R, middle - R @ middle)
                if not all(_differ(symmetry, G, Y) for Y in (np.eye(4), *(Y for _, Y in found))):
                    continue
                moved = transform_points(G, points)
                # The distances of a few points alone exclude most rotations.
                if np.sum(tree.query(moved[::_FEW])[0] ** 2) > 1.01 * len(moved) * (_ALIKE * surface.radius) ** 2:
                    continue
                unlike = float(np.sqrt(np.mean(tree.query(moved)[0] ** 2)))
                if unlike <= _ALIKE * surface.radius:
                    found.append((unlike, G))
    return tuple(G for _, G in sorted(found, key=lambda item: item[0]))[:_TRIED]


def _differ(symmetry, A: Array, B: Array) -> bool:
    return symmetry.error(A, B)[1] > np.deg2rad(8.0)


def best_alternative(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Log likelihood of the scan at the best fitted pose that looks nearly as `X_ST` does.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        The log likelihood [nat]; -inf if no such pose exists.
    """
    best = -np.inf
    for G in ambiguous_poses(surface):
        fitted = fine_fit(evidence, surface, X_ST @ G, rounds=1).X_ST
        if _differ(surface.target.symmetry, fitted, X_ST):  # else ICP has returned to X_ST
            best = max(best, log_likelihood(evidence, surface, fitted))
    return best
