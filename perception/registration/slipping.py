"""Position of a model along the motion in which it slips along itself, from the likelihood.

If a coil spring is screwed along itself, the pairs of nearest points move with it, so that they do
not determine its position. Their apparent resistance comes only from the roughness of their
normals. The likelihood, in contrast, compares the same pixels at every pose.
"""

from dataclasses import replace

import numpy as np

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.likelihood import glance, log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.symmetry import slipped, slipping_twist
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, readonly

_FARTHEST = 12  # [spacings] distance up to which other maxima are searched for, in both directions
_PLACES = 3  # largest number of these
_COMPARED = 10_000  # approximate number of pixels that are compared
_TRIED = np.linspace(-1.0, 1.0, 5)  # [reaches] around a pose, at which the likelihood is evaluated
_REACHES = (1.0, 1.0, 0.5, 0.25)  # [spacings] reach of the successive parabolas
_FLAT = 0.1  # [nat/spacing^2] least curvature, below which the slip is not observed


def resting_places(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> list[Array]:
    """The best few local maxima of the likelihood along the slipping twist from `X_ST`, as poses
    (4, 4).
    """
    if slipping_twist(surface) is None:
        return []

    # Likelihood along the slip
    steps = np.arange(-_FARTHEST, _FARTHEST + 1)
    poses = [X_ST @ slipped(surface, k * surface.spacing) for k in steps]
    along = np.array([glance(evidence, surface, X) for X in poses])

    # Its maxima, except the present pose
    peak = np.zeros(len(along), dtype=bool)
    peak[1:-1] = (along[1:-1] >= along[:-2]) & (along[1:-1] >= along[2:])
    peak[[0, -1]] = along[[0, -1]] > along[[1, -2]]
    peak &= np.abs(steps) > 1

    best = np.flatnonzero(peak)[np.argsort(-along[peak], kind="stable")]
    return [poses[k] for k in best[:_PLACES]]


def settled(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, likelihood: float
) -> tuple[Array, float]:
    """The likeliest pose (4, 4) near `X_ST` along the slipping twist, and its log likelihood."""
    if slipping_twist(surface) is None:
        return X_ST, likelihood
    for reach in _REACHES:
        curvature, slope = _profile(evidence, surface, X_ST, reach)

        # Newton step of the fitted parabola, within its reach
        step = float(np.clip(0.5 * slope / max(curvature, _FLAT), -reach, reach))
        moved = X_ST @ slipped(surface, step * surface.spacing)

        likelier = log_likelihood(evidence, surface, moved)
        if likelier > likelihood:
            X_ST, likelihood = moved, likelier
    return X_ST, likelihood


def with_slip(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, covariance: PoseCovariance
) -> PoseCovariance:
    """Covariance of the pose `X_ST`, in which the variance of the slipping twist comes from the
    likelihood.
    """
    twist = slipping_twist(surface)
    if twist is None:
        return covariance

    # Information on the slip from the pairs
    R = X_ST[:3, :3]
    u = np.concatenate([R @ twist[:3], R @ twist[3:] * covariance.radius])
    u -= covariance.free.T @ (covariance.free @ u)
    stated = u @ covariance.information @ u  # [1/m^2] of a slip by 1 m

    # If the information from the likelihood is smaller, its variance is used
    curvature, _ = _profile(evidence, surface, X_ST, 1.0)
    square = surface.spacing**2 / (2.0 * max(curvature, _FLAT))
    if stated <= 0.0 or square <= 1.0 / stated:
        return covariance
    return replace(
        covariance, matrix=readonly(covariance.matrix + (square - 1.0 / stated) * np.outer(u, u))
    )


def _profile(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, reach: float
) -> tuple[float, float]:
    """Curvature [nat/spacing^2] and slope [nat/spacing] of the likelihood along the slip.

    The curvature is positive at a maximum.
    """
    steps = reach * _TRIED  # [spacings]
    poses = (X_ST @ slipped(surface, k * surface.spacing) for k in steps)
    square, slope, _ = np.polyfit(
        steps, [log_likelihood(evidence, surface, X, _COMPARED) for X in poses], 2
    )
    return -float(square), float(slope)
