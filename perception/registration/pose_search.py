"""Search for the pose that gives the scan the highest likelihood: ICP from several starts, and from look-alikes."""

from dataclasses import dataclass

import numpy as np

from perception.registration.evidence import Evidence, score
from perception.registration.fine_fit import IcpFit, fine_fit
from perception.registration.likelihood import log_likelihood
from perception.registration.model_surface import ModelSurface
from perception.registration.symmetry import ambiguous_poses
from sim.interfaces.spatial import Array, pose, readonly

_REFINED = 3  # initial poses that get a full ICP, at first
_HOPELESS = 0.4  # [-] score below the best one from which on an initial pose gets no ICP at first
_POOR = 1.2  # [-] score of the likeliest pose below which all initial poses get an ICP
_SLIDING = 0.7  # [-] translational share of a free twist, from which on it is searched by translation
_SLIDES = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)  # [radii] of the model: translations tried along a free twist
_ADOPTED = 4  # look-alikes adopted one after the other, at most


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A pose to which ICP converged."""

    X_sensor_target: Array  # (4, 4) pose of T in S
    log_likelihood: float  # [nat] of the scan, up to a constant common to all poses


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The likeliest pose, and the distinct others that were tried."""

    X_ST: Array  # (4, 4)
    fit: IcpFit | None  # ICP that converged there; None for another method
    X_start: Array  # (4, 4) where that ICP began
    log_likelihood: float
    others: tuple[Hypothesis, ...] = ()  # the most likely first
    asks: str = ""  # reason for which the method requests a new scan


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    fit: IcpFit
    X_start: Array
    log_likelihood: float

    @property
    def X_ST(self) -> Array:
        return self.fit.X_ST


def likeliest_pose(evidence: Evidence, surface: ModelSurface, starts: list[Array], given: list[Array]) -> Found:
    """ICP from the best-scored starts, then from poses that look like the likeliest one, until none is likelier.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        starts: Initial poses (4, 4) of the search; at least one here or among `given`.
        given: Initial poses (4, 4) from prior knowledge, which are tried whatever their score.
    """

    def fitted(X: Array, X_start: Array, rounds: int = 2) -> _Candidate:
        fit = fine_fit(evidence, surface, X, rounds)
        return _Candidate(fit, X_start, log_likelihood(evidence, surface, fit.X_ST))

    ranked = sorted(((score(evidence, surface, X), X) for X in starts), key=lambda item: -item[0])
    first = [X for s, X in ranked[:_REFINED] if s > ranked[0][0] - _HOPELESS]
    tried = [fitted(X, X) for X in [*first, *given]]
    best = _likeliest(tried)
    for X in _slides(evidence, surface, best.fit):
        tried.append(fitted(X, best.X_start))
    best = _likeliest(tried)
    if score(evidence, surface, best.X_ST) < _POOR:
        tried += [fitted(X, X) for _, X in ranked[len(first) :]]
        best = _likeliest(tried)
    for _ in range(_ADOPTED):
        alike = [fitted(best.X_ST @ G, best.X_start, rounds=1) for G in ambiguous_poses(surface)]
        tried += alike
        if not alike or _likeliest(alike).log_likelihood <= best.log_likelihood:
            break
        likelier = _likeliest(alike)
        tried.append(fitted(likelier.X_ST, likelier.X_start))
        if not _differ(surface, tried[-1].X_ST, best.X_ST):
            break  # ICP has returned to where it came from
        best = _likeliest(tried)
    best = _likeliest(tried)
    return Found(best.X_ST, best.fit, best.X_start, best.log_likelihood, _others(surface, tried, best))


def _likeliest(candidates: list[_Candidate]) -> _Candidate:
    return max(candidates, key=lambda each: each.log_likelihood)


def _others(surface: ModelSurface, tried: list[_Candidate], best: _Candidate) -> tuple[Hypothesis, ...]:
    """Distinct poses apart from the best one, the most likely first."""
    kept = [best]
    for each in sorted(tried, key=lambda each: -each.log_likelihood):
        if all(_differ(surface, each.X_ST, one.X_ST) for one in kept):
            kept.append(each)
    return tuple(
        Hypothesis(X_sensor_target=readonly(each.X_ST), log_likelihood=each.log_likelihood) for each in kept[1:]
    )


def _differ(surface: ModelSurface, A: Array, B: Array) -> bool:
    """True if two poses (4, 4) are not the same up to the declared symmetry and the ends of ICP's valley."""
    off, angle = surface.symmetry.error(A, B)
    return bool(off > 2.0 * surface.spacing or angle > np.deg2rad(5.0))


def _slides(evidence: Evidence, surface: ModelSurface, fit: IcpFit) -> list[Array]:
    """The best translation along each free twist of `fit`: no residual pulls the model along these."""
    found: list[Array] = []
    for twist in fit.free:
        if np.linalg.norm(twist[:3]) < _SLIDING:
            continue
        slides = [pose(p=share * surface.radius * twist[:3]) @ fit.X_ST for share in _SLIDES]
        found.append(max(slides, key=lambda X: score(evidence, surface, X)))
    return found
