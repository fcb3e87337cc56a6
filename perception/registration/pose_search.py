"""Search for the pose of highest likelihood, by ICP from several starts and from similar-looking
poses.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from uuv.perception.registration.evidence import Evidence, score
from uuv.perception.registration.fine_fit import GATES, IcpFit, fine_fit, icp_rows, nudged
from uuv.perception.registration.likelihood import glance, log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_covariance import PoseCovariance, pose_covariance
from uuv.perception.registration.projective_fit import polished, polished_rows
from uuv.perception.registration.slipping import resting_places, settled
from uuv.perception.registration.symmetry import ambiguous_poses, slipping_twist
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, readonly

_ROUGH_ACROSS = 110  # [px] least size of the object's picture in a rough fit
_ROUGH_WIDTH = 5.0  # [px] least size of its parts, so that bars remain
_ROUGH_STEP = 3  # [px] largest step by which the picture is thinned for it
_ROUGH_POINTS = 1000  # approximate number of scan points in a rough fit
_ROUGH_MODEL = 8000  # approximate number of model points in a rough fit
_NUDGED = 40  # number of initial poses that get a few steps of ICP, if there are many
# approximate number of points of scan and model in these steps
_NUDGE_POINTS, _NUDGE_MODEL = 300, 3000
REFINED = 8  # number of initial poses that get a rough fit
_NUDGED_OF_MANY, _REFINED_OF_MANY = 24, 5  # number of these among starts that are close together
_ALIKE = 3  # number of poses similar to the likeliest one that get a rough fit
# [-] translational share of a free twist, from which on it is searched by translation
_SLIDING = 0.7
# [radii] of the model: translations tried along a free twist
_SLIDES = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)
_LOOSE = 0.002  # [m] standard deviation of a twist, from which on the pose is searched along it
_SLACKENED = 2  # largest number of such twists, one after the other
_STEPS = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)  # [sigma] steps tried
# [sigma] steps at which other maxima are searched for
_FAR = (-12.0, -8.0, -6.0, -4.5, -3.0, 3.0, 4.5, 6.0, 8.0, 12.0)
_NEARLY = 30.0  # [nat] difference from the likeliest pose, within which a fit is worthwhile
_EXPLORED = 3  # number of poses whose similar-looking poses are tried
# number of rounds for a model that slips along itself, since it may be several maxima off
_EXPLORED_SLIPPING = 6
# number of distinct poses that are refined to the end, since ICP stops up to 20 nat short of the
# likeliest one
_FINISHED = 4
# number of likeliest poses that are fitted again if the noise turns out to be less than stated
_WEIGHED = 4
# [nat] difference of two poses, below which both are moved to the maximum of the likelihood
_CLOSE = 30.0
_CLIMBING = 3  # largest number of poses for which that is done
_SHARES = (1.0, 0.5)  # [sigma] steps of this ascent
_CLIMBS = 6  # largest number of rounds with each of these steps
_FARTHEST_STEP = 0.5  # [spacings] largest step of the ascent
# [nat] difference from the likeliest pose, within which another one is refined and its
# similar-looking poses are tried
_RIVAL = 150.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A pose to which ICP converged."""

    X_sensor_target: Array  # (4, 4) pose of T in S
    log_likelihood: float  # [nat] log likelihood of the scan, up to a constant common to all poses


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The likeliest pose, and the distinct other poses that were tried."""

    X_ST: Array  # (4, 4) likeliest pose of T in S
    fit: IcpFit | None  # result of ICP there; None for another method
    X_start: Array  # (4, 4) start of that ICP
    log_likelihood: float
    others: tuple[Hypothesis, ...] = ()  # distinct poses, the most likely first
    asks: str = ""  # reason for which the method requests a new scan


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    fit: IcpFit
    X_start: Array
    log_likelihood: float

    @property
    def X_ST(self) -> Array:
        return self.fit.X_ST


def likeliest_pose(
    evidence: Evidence,
    surface: ModelSurface,
    starts: list[Array],
    given: list[Array],
    most: int = REFINED,
) -> Found:
    """ICP from the likeliest starts, then from poses that look similar to the best, until none is
    likelier.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        starts: Initial poses (4, 4) of the search; at least one here or among `given`.
        given: Initial poses (4, 4) from prior knowledge, which are tried whatever their likelihood.
        most: Largest number of starts that are fitted, the likeliest ones.
    """
    thin = _rough(evidence, surface), surface.thinned(_ROUGH_MODEL)

    def fitted(X: Array, X_start: Array) -> _Candidate:
        return _likelier(evidence, surface, fine_fit(*thin, X), X, X_start)

    # Rough fits from the likeliest starts
    tried = [fitted(X, X) for X in [*_ranked(evidence, surface, starts, most), *given]]
    best = _likeliest(tried)
    tried += [fitted(X, best.X_start) for X in _slides(evidence, surface, best.fit)]

    # Rough fits of poses that look like the likeliest one
    explored: list[_Candidate] = []
    for _ in range(_EXPLORED if slipping_twist(surface) is None else _EXPLORED_SLIPPING):
        # First the likeliest pose and then its rivals: if a flange is turned over, no single step
        # leads to the right bolts.
        new = [
            candidate
            for candidate in _rivals(evidence, tried)
            if _is_new(surface, candidate.X_ST, explored)
        ]
        if not new:
            break
        explored.append(_likeliest(new))
        X_now = explored[-1].X_ST
        alike = _likeliest_at_a_glance(
            evidence, surface, (X_now @ G for G in ambiguous_poses(surface)), _ALIKE
        )
        for X in [*alike, *resting_places(evidence, surface, X_now)]:
            near = [candidate for candidate in tried if not _differ(surface, X, candidate.X_ST)]
            fit = near[0].fit if near else fine_fit(*thin, X)
            tried.append(_likelier(evidence, surface, fit, X, explored[-1].X_start))

    # The best pose is fitted to the end, and rivals as far below it as it gained by that
    rough_best, *rest = _distinct(surface, tried)
    tried.append(_finished(evidence, surface, rough_best))
    # the others may gain about as much
    short = 2.0 * (tried[-1].log_likelihood - rough_best.log_likelihood)
    least = tried[-1].log_likelihood - _of_noise(evidence, _RIVAL) - short
    near = [candidate for candidate in rest if candidate.log_likelihood > least]
    tried += [_finished(evidence, surface, candidate) for candidate in near[: _FINISHED - 1]]

    # Other maxima: along the least certain twist, and along the slip
    tried += _beside(evidence, surface, _likeliest(tried))
    for _ in range(_EXPLORED):
        best = _likeliest(tried)
        places = [
            X for X in resting_places(evidence, surface, best.X_ST) if _is_new(surface, X, tried)
        ]
        tried += [
            _finished(evidence, surface, replace(best, fit=replace(best.fit, X_ST=X)))
            for X in places
        ]
        if best is _likeliest(tried):
            break

    return _found(surface, [*tried, *_climbed(evidence, surface, tried)])


def _climbed(
    evidence: Evidence, surface: ModelSurface, tried: list[_Candidate]
) -> list[_Candidate]:
    """Move the likeliest pose and its rivals to the maximum of the likelihood, if they are close.

    On bars, where most pixels are at an edge, Gauss-Newton stops up to 20 nat below the maximum.
    """
    best, *others = _distinct(surface, tried)

    close = [
        candidate for candidate in others if candidate.log_likelihood > best.log_likelihood - _CLOSE
    ]
    return (
        [_at_top(evidence, surface, candidate) for candidate in [best, *close[: _CLIMBING - 1]]]
        if close
        else []
    )


def _at_top(evidence: Evidence, surface: ModelSurface, candidate: _Candidate) -> _Candidate:
    """The likeliest pose reached by steps along the axes of the covariance."""
    rows = polished_rows(evidence, surface, candidate.X_ST)
    covariance = pose_covariance(evidence, surface, candidate.X_ST, candidate.fit.free, rows)
    if covariance is None:
        return candidate

    variances, axes = np.linalg.eigh(covariance.matrix)
    steps = np.minimum(np.sqrt(np.maximum(variances, 0.0)), _FARTHEST_STEP * surface.spacing)
    X_ST, most = candidate.X_ST, candidate.log_likelihood

    # Coordinate ascent along the principal axes of the covariance
    for share in _SHARES:
        for _ in range(_CLIMBS):
            X_before = X_ST
            for step, axis in zip(share * steps, axes.T, strict=True):
                for way in (step, -step):
                    X = _along(covariance, way * axis) @ X_ST
                    likelihood = log_likelihood(evidence, surface, X)
                    if likelihood > most:
                        X_ST, most = X, likelihood
                        break
            if X_ST is X_before:
                break

    return replace(candidate, fit=replace(candidate.fit, X_ST=X_ST), log_likelihood=most)


def _found(surface: ModelSurface, tried: list[_Candidate]) -> Found:
    """The likeliest of all poses, and those that differ from it and from each other."""
    best, *others = _distinct(surface, tried)
    return Found(
        best.X_ST,
        best.fit,
        best.X_start,
        best.log_likelihood,
        tuple(
            Hypothesis(
                X_sensor_target=readonly(candidate.X_ST), log_likelihood=candidate.log_likelihood
            )
            for candidate in others
        ),
    )


def likeliest_of(
    evidence: Evidence, surface: ModelSurface, starts: list[Array], to_beat: float
) -> Found:
    """ICP from the likeliest of many starts, without a search of further poses.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        starts: Initial poses (4, 4), at least one.
        to_beat: [nat] log likelihood of another explanation; a pose that is far less likely is not
            fitted to the end.
    """
    thin = _rough(evidence, surface), surface.thinned(_ROUGH_MODEL)

    poses = _ranked(evidence, surface, starts, _REFINED_OF_MANY, _NUDGED_OF_MANY)
    tried = [_likelier(evidence, surface, fine_fit(*thin, X), X, X) for X in poses]
    best = _likeliest(tried)

    if best.log_likelihood > to_beat - _of_noise(evidence, _RIVAL):
        tried.append(_finished(evidence, surface, best))
    return _found(surface, tried)


def _ranked(
    evidence: Evidence, surface: ModelSurface, starts: list[Array], most: int, moved: int = _NUDGED
) -> list[Array]:
    """The likeliest poses (4, 4) that differ from each other; if there are many, `moved` of them
    first get a few steps of ICP.
    """
    if len(starts) > most:
        few_points = evidence.thinned(_ROUGH_STEP, _NUDGE_POINTS)
        few_of_model = surface.thinned(_NUDGE_MODEL)
        best = _likeliest_at_a_glance(evidence, surface, starts, moved)
        starts = [nudged(few_points, few_of_model, X) for X in best]

    apart: list[Array] = []
    for X in _likeliest_at_a_glance(evidence, surface, starts, len(starts)):
        if len(apart) < most and all(_differ(surface, X, Y) for Y in apart):
            apart.append(X)
    return apart


def _likeliest_at_a_glance(
    evidence: Evidence, surface: ModelSurface, poses: Iterable[Array], most: int
) -> list[Array]:
    """The `most` likeliest of `poses` (4, 4), by a few pixels, the likeliest first."""
    return sorted(poses, key=lambda X: -glance(evidence, surface, X))[:most]


def weighed_again(evidence: Evidence, surface: ModelSurface, found: Found) -> Found:
    """The poses of a search, fitted and ranked again with evidence whose noise is better known.

    Args:
        evidence: Evidence of the search, with another noise.
        surface: Sampled model.
        found: Result of the search.
    """
    poses = [found.X_ST, *(hypothesis.X_sensor_target for hypothesis in found.others)]
    start = fine_fit(evidence, surface, found.X_ST, ())
    tried = [
        _finished(evidence, surface, _Candidate(replace(start, X_ST=X), found.X_start, 0.0))
        for X in poses[:_WEIGHED]
    ]
    for X in poses[_WEIGHED:]:
        tried.append(
            _Candidate(replace(start, X_ST=X), found.X_start, log_likelihood(evidence, surface, X))
        )

    return _found(surface, [*tried, *_climbed(evidence, surface, tried)])


def _rough(evidence: Evidence, surface: ModelSurface) -> Evidence:
    """Evidence with fewer pixels and points, sufficient to choose the poses that are fitted to the
    end.
    """
    picture = 2.0 * surface.radius / (evidence.scan.pitch * evidence.middle)  # [px] across
    rim = evidence.mask & ~ndimage.binary_erosion(evidence.mask)
    width = 2.0 * evidence.mask.sum() / max(1, int(rim.sum()))  # [px] of a part of the picture

    step = int(np.clip(min(picture / _ROUGH_ACROSS, width / _ROUGH_WIDTH), 1, _ROUGH_STEP))
    return evidence.thinned(step, _ROUGH_POINTS)


def best_alternative(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Log likelihood [nat] at the best fitted pose that looks similar to `X_ST`, or -inf if there
    is none.
    """
    alike = _likeliest_at_a_glance(
        evidence, surface, (X_ST @ G for G in ambiguous_poses(surface)), _ALIKE
    )

    fitted = (fine_fit(evidence, surface, X).X_ST for X in alike)
    return max(
        (log_likelihood(evidence, surface, X) for X in fitted if _differ(surface, X, X_ST)),
        default=-np.inf,
    )


def _likeliest(candidates: list[_Candidate]) -> _Candidate:
    return max(candidates, key=lambda candidate: candidate.log_likelihood)


def _likelier(
    evidence: Evidence, surface: ModelSurface, fit: IcpFit, X_before: Array, X_start: Array
) -> _Candidate:
    """The fitted pose, or the pose before the fit if that is likelier.

    On thin plates in much noise ICP may lead away from a good pose.
    """
    if fit.pairing is None:  # the fit moved the model out of view, where no pixel contradicts it
        return _Candidate(fit, X_start, -np.inf)

    before, after = (log_likelihood(evidence, surface, X) for X in (X_before, fit.X_ST))
    return _Candidate(
        fit if after > before else replace(fit, X_ST=X_before), X_start, max(before, after)
    )


def _rivals(evidence: Evidence, candidates: list[_Candidate]) -> list[_Candidate]:
    """Candidates whose difference from the likeliest one is not much larger than the remaining gain
    of ICP.
    """
    least = _likeliest(candidates).log_likelihood - _of_noise(evidence, _RIVAL)
    return [candidate for candidate in candidates if candidate.log_likelihood > least]


def _of_noise(evidence: Evidence, nats: float) -> float:
    """Remaining gain [nat] of ICP with this noise, if it is `nats` with the noise as stated.

    The gain is larger for smaller noise.
    """
    return nats * evidence.noise.information / evidence.sensor.information


def _is_new(surface: ModelSurface, X_ST: Array, candidates: list[_Candidate]) -> bool:
    """True if a pose (4, 4) differs from those of all candidates."""
    return all(_differ(surface, X_ST, candidate.X_ST) for candidate in candidates)


def _distinct(surface: ModelSurface, tried: list[_Candidate]) -> list[_Candidate]:
    """The poses that differ from each other, the most likely first."""
    distinct: list[_Candidate] = []
    for candidate in sorted(tried, key=lambda candidate: -candidate.log_likelihood):
        if _is_new(surface, candidate.X_ST, distinct):
            distinct.append(candidate)
    return distinct


def _finished(evidence: Evidence, surface: ModelSurface, candidate: _Candidate) -> _Candidate:
    """The likeliest pose near that of a candidate, from all pixels and points."""
    fit = fine_fit(evidence, surface, candidate.X_ST, GATES[1:])
    # edges that would determine it may be beyond the last gate
    if len(fit.free) > (surface.symmetry.axis is not None):
        fit = fine_fit(evidence, surface, candidate.X_ST, GATES)
    candidate = _likelier(evidence, surface, fit, candidate.X_ST, candidate.X_start)

    # Along uncertain twists, then on the depth image, then along the slip
    loose = _slackened(evidence, surface, candidate)
    X_ST, likelihood = polished(evidence, surface, loose.fit, loose.log_likelihood)
    X_ST, likelihood = settled(evidence, surface, X_ST, likelihood)
    return _Candidate(replace(loose.fit, X_ST=X_ST), loose.X_start, likelihood)


def _differ(surface: ModelSurface, A: Array, B: Array) -> bool:
    """True if two poses (4, 4) differ by more than the declared symmetry and the error of ICP's
    convergence.

    The displacement is that of the model's centre, since the origin of its file may be anywhere.
    """
    off, angle = surface.symmetry.error(A, B, surface.center)
    return bool(off > 2.0 * surface.spacing or angle > np.deg2rad(5.0))


def _slackened(evidence: Evidence, surface: ModelSurface, best: _Candidate) -> _Candidate:
    """The likeliest pose along the twists that ICP observes least, which the outline may
    determine.
    """
    for _ in range(_SLACKENED):
        covariance = pose_covariance(
            evidence, surface, best.X_ST, best.fit.free, icp_rows(evidence, surface, best.fit)
        )
        moved = best if covariance is None else _along_loosest(evidence, surface, best, covariance)
        if moved is best:
            break
        best = moved
    return best


def _along_loosest(
    evidence: Evidence, surface: ModelSurface, best: _Candidate, covariance: PoseCovariance
) -> _Candidate:
    """The likeliest of a few poses along the least certain twist that has a likelier one; else
    `best`.
    """
    variances, axes = np.linalg.eigh(covariance.matrix)
    for variance, axis in zip(variances[::-1], axes.T[::-1], strict=True):
        sigma = float(np.sqrt(max(variance, 0.0)))
        if sigma < _LOOSE:
            break

        likeliest = best
        for step in _steps(_STEPS, sigma, surface):
            X = _along(covariance, step * sigma * axis) @ best.X_ST
            likelihood = log_likelihood(evidence, surface, X)
            if likelihood > likeliest.log_likelihood:
                likeliest = _Candidate(replace(best.fit, X_ST=X), best.X_start, likelihood)

        if likeliest is not best:
            return likeliest
    return best


def _beside(evidence: Evidence, surface: ModelSurface, best: _Candidate) -> list[_Candidate]:
    """Poses far along the least certain twist that are nearly as likely, since there may be several
    maxima.
    """
    covariance = pose_covariance(
        evidence, surface, best.X_ST, best.fit.free, icp_rows(evidence, surface, best.fit)
    )

    if covariance is None:
        return []
    variances, axes = np.linalg.eigh(covariance.matrix)
    sigma = float(np.sqrt(max(variances[-1], 0.0)))
    if sigma < _LOOSE:
        return []

    maxima: list[_Candidate] = []
    for step in _steps(_FAR, sigma, surface):
        X = _along(covariance, step * sigma * axes[:, -1]) @ best.X_ST
        if log_likelihood(evidence, surface, X) > best.log_likelihood - _of_noise(
            evidence, _NEARLY
        ) and _differ(surface, X, best.X_ST):
            # Another maximum is fitted and refined
            fit = fine_fit(evidence, surface, X, GATES[1:])
            likelihood = log_likelihood(evidence, surface, fit.X_ST)
            X_ST, likelihood = polished(evidence, surface, fit, likelihood)
            maxima.append(_Candidate(replace(fit, X_ST=X_ST), best.X_start, likelihood))

    return maxima


def _steps(steps: Iterable[float], sigma: float, surface: ModelSurface) -> list[float]:
    """Those of `steps` [sigma] with which the model stays in view."""
    return [step for step in steps if abs(step) * sigma < surface.radius]


def _along(covariance: PoseCovariance, twist: Array) -> Array:
    """Motion (4, 4) in S by a `twist` (6,) [m] (linear; angular x radius) about the centre."""
    R = exp_so3(twist[3:] / covariance.radius)
    return pose(R, covariance.center + twist[:3] - R @ covariance.center)


def _slides(evidence: Evidence, surface: ModelSurface, fit: IcpFit) -> list[Array]:
    """The best translation along each free twist of `fit`, on which the residuals do not depend."""
    best_slides: list[Array] = []
    for twist in fit.free:
        if np.linalg.norm(twist[:3]) < _SLIDING:
            continue
        slides = [pose(p=share * surface.radius * twist[:3]) @ fit.X_ST for share in _SLIDES]
        best_slides.append(max(slides, key=lambda X: score(evidence, surface, X)))
    return best_slides
