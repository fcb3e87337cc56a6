"""Position of a model along the motion in which it slips along itself, by the likelihood.

Pairs of nearest points follow a spring that is screwed along itself. What they seem to resist is
the roughness of their directions. The likelihood compares the same pixels whatever the pose.
"""

from dataclasses import replace

import numpy as np

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.likelihood import glance, log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.symmetry import slipped, slipping_twist
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, readonly

_FARTHEST = 12  # [spacings] to which other maxima are sought, either way
_PLACES = 3  # of these, at most
_COMPARED = 10_000  # pixels that count, about
_TRIED = np.linspace(-1.0, 1.0, 5)  # [reaches] around a pose, where the likelihood is evaluated
_REACHES = (1.0, 1.0, 0.5, 0.25)  # [spacings] in one round of a parabola after the other
_FLAT = 0.1  # [nat/spacing^2] least curvature: what is flatter is not observed


def resting_places(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> list[Array]:
    """The best few poses (4, 4) of maximal likelihood along the slipping twist from `X_ST`."""
    if slipping_twist(surface) is None:
        return []

    # Likelihood along the slip
    steps = np.arange(-_FARTHEST, _FARTHEST + 1)
    poses = [X_ST @ slipped(surface, k * surface.spacing) for k in steps]
    along = np.array([glance(evidence, surface, X) for X in poses])

    # Maxima of it, not where the pose is already
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
    """Covariance of the pose `X_ST` in which that of the slipping twist is by the likelihood."""
    twist = slipping_twist(surface)
    if twist is None:
        return covariance

    # Information on the slip as the pairs state it
    R = X_ST[:3, :3]
    u = np.concatenate([R @ twist[:3], R @ twist[3:] * covariance.radius])
    u -= covariance.free.T @ (covariance.free @ u)
    stated = u @ covariance.information @ u  # [1/m^2] of a slip by 1 m

    # Where the likelihood states less, its variance replaces that
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
