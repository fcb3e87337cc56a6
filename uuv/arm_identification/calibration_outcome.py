"""Calibration of an arm from a case: the fit, its evaluation, and the verdict on it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy.stats import f

from uuv.arm_identification.calibration_case import CalibrationCase, TrueArm
from uuv.arm_identification.tracked_moves import tracked
from uuv.calib import verification
from uuv.calib.identification import Calibration, identify
from uuv.calib.moving_base import (
    BASE_JOINTS,
    in_own_names,
    on_moving_base,
    own_arm,
    own_parameters,
    with_base,
)
from uuv.calib.touches import first_tcp
from uuv.calib.verdicts.doubts import Examination, examine
from uuv.calib.verdicts.evidence import Told
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.spatial import Array

# number of groups of points left out in turn, and of touches, less one for each point, that the
# rest needs
_FOLDS, _LEAST_FOLD = 4, 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationOutcome:
    """A calibration with the figures of its evaluation."""

    calibration: Calibration
    arm: SerialArm  # identified arm, without the joints that represent a moving hull
    tcp: Array  # (3,) [m]
    series: tuple[Array, ...]  # joint values that the arm was identified from
    clouds: dict[str, verification.Cloud] = field(default_factory=dict)
    # RMS [m] by point, for the nominal and the identified arm
    held_out: dict[str, tuple[float, float]] = field(default_factory=dict)
    # RMS [m] by point, as the fit predicts it, and its 95 % bound
    foretold: dict[str, tuple[float, float]] = field(default_factory=dict)
    # share of the held-out errors, along each axis, that are within their 95 % intervals
    covered: float | None = None
    half_width: float | None = None  # [m] median half-width of those intervals
    # (N,) [m] error of the tip in the base, for the nominal and the identified arm
    tips: tuple[Array, Array] | None = None
    # result for a hovering hull if its motion is ignored
    uncorrected: dict[str, verification.Cloud] = field(default_factory=dict)
    # if compliances are identified: the result for the same touches without them
    rigid: Calibration | None = None
    # errors of the input that would explain the touches better, or equally well
    examined: Examination = field(default_factory=Examination)
    worse: tuple[str, ...] = ()  # data on which the nominal arm is significantly better


def solve(
    case: CalibrationCase,
    *,
    free: Sequence[str],
    prior: dict[str, float],
    method: Literal["map", "paper"],
) -> CalibrationOutcome:
    """Identify the arm of a case and evaluate the result.

    If the hull moved, its poses from navigation enter the fit.

    Args:
        case: Input.
        free: Free parameters; empty: all.
        prior: Prior standard deviations [rad], [m] by name; empty: from the data.
        method: Fit: maximum a posteriori, or as published [Yukhimets 2023].
    """
    options = {
        "prior": prior or None,
        "method": method,
        "distances": case.distances,
        "loads": case.loads,
    }
    if case.session is not None and case.X_BA is not None:
        return _solved_on_moving_base(case, case.session.hulls, case.X_BA, free, options)

    series = list(case.touches.series)
    arm = case.source.arm
    fit = identify(series, arm, free=list(free) or None, **options)
    outcome = _judged(case, fit, fit.arm, series)
    if method == "map":
        again = partial(
            identify, nominal=arm, free=list(free) or None, **{**options, "distances": ()}
        )
        outcome = _examined(outcome, case, again)
    if case.loads is None:
        return outcome

    # The same touches with a rigid arm, for comparison.
    elastic = {"compliance", *(f"c{k + 1}" for k in range(arm.n))}
    words = [word for word in free if word not in elastic]
    return replace(
        outcome, rigid=identify(series, arm, free=words or None, **{**options, "loads": None})
    )


def _solved_on_moving_base(
    case: CalibrationCase,
    hulls: Sequence[Array],
    X_BA: Array,
    free: Sequence[str],
    options: dict[str, Any],
) -> CalibrationOutcome:
    """Same as `solve`, with the hull poses (m_i, 4, 4) during the touches as joints of a longer
    arm.
    """
    series = list(case.touches.series)
    arm = case.source.arm
    longer = on_moving_base(arm, X_BA)
    moved = [with_base(q, X) for q, X in zip(series, hulls, strict=True)]
    words = list(free) or own_parameters(longer)
    plain = identify(series, arm, free=list(free) or None, **options)
    full = identify(moved, longer, free=words, **options)

    outcome = _judged(case, in_own_names(full, plain), own_arm(full.arm, X_BA), moved)
    if options["method"] == "map":
        again = partial(identify, nominal=longer, free=words, **{**options, "distances": ()})
        outcome = _examined(outcome, case, again)
    return replace(outcome, uncorrected=tracked(case, plain.arm, plain, np.random.default_rng(0)))


def _examined(
    outcome: CalibrationOutcome, case: CalibrationCase, again: Callable[..., Calibration]
) -> CalibrationOutcome:
    """Add to an outcome the evidence of its touches against it; a hull that moved adds joints to
    the arm.
    """
    fit = outcome.calibration
    series = list(outcome.series)
    base = 0 if case.X_BA is None else BASE_JOINTS
    stated = Told(names=case.touches.names, distances=case.distances, base_joints=base)
    examined = examine(fit, series, again, stated)

    worse = _worse_points(case, fit, series)
    if not examined.doubts:
        worse += _worse_predicted(fit, series, again)
    return replace(outcome, examined=examined, worse=tuple(worse))


def _judged(
    case: CalibrationCase, fit: Calibration, arm: SerialArm, series: Sequence[Array]
) -> CalibrationOutcome:
    """Comparison of the fit with the truth, if it is known, and with the touches held out."""
    outcome = CalibrationOutcome(calibration=fit, arm=arm, tcp=fit.tcp, series=tuple(series))
    if case.truth is not None:
        clouds = tracked(case, arm, fit, np.random.default_rng(0))
        tips = _tip_errors(case, case.truth, fit, arm) if case.truth.hangs else None
        outcome = replace(outcome, clouds=clouds, tips=tips)
    if case.held_out is None:
        return outcome

    # Scatter of the touches of each held-out point, with the nominal arm and with the identified
    # one.
    tcp = first_tcp(case.source.arm, list(case.touches.series))
    held = {
        name: (_scatter(case.source.arm.tips(q, tcp)), _scatter(fit.tips(q)))
        for name, q in zip(case.held_out.names, case.held_out.series, strict=True)
    }
    several = [q for q in case.held_out.series if len(q) > 1]
    foretold = {
        name: fit.predicted_rms(q)
        for name, q in zip(case.held_out.names, case.held_out.series, strict=True)
        if len(q) > 1
    }
    outcome = replace(outcome, held_out=held, foretold=foretold)
    if not several:
        return outcome

    # Share of those touches that are within the predicted intervals.
    tips_held = [fit.tips(q) for q in several]
    errors = np.abs(np.vstack([p - p.mean(axis=0) for p in tips_held]))
    half = np.vstack([fit.half_widths(q) for q in several])
    covered = float(np.mean(errors < half))
    return replace(outcome, covered=covered, half_width=float(np.median(half)))


def _tip_errors(
    case: CalibrationCase, truth: TrueArm, fit: Calibration, arm: SerialArm
) -> tuple[Array, Array]:
    """Errors (N,) [m] of the tip in the base at all touches, for the nominal and the identified
    arm.
    """
    q = np.vstack(case.touches.series)
    bent = q if fit.loads is None else fit.deflected(q)
    true = truth.arm.tips(truth.stands_at(q), truth.tcp)
    nominal = np.linalg.norm(case.source.arm.tips(q, truth.tcp) - true, axis=1)
    return nominal, np.linalg.norm(arm.tips(bent, fit.tcp) - true, axis=1)


def _worse_points(
    case: CalibrationCase, calibration: Calibration, series: Sequence[Array]
) -> list[str]:
    """Points, used or held out, whose touches agree significantly better with the nominal arm."""
    used = [weights > 0.0 for weights in calibration.weights]
    sets = [(case.touches.names, series, used, calibration.touched_tips(series))]
    if case.held_out is not None:
        held = case.held_out
        every = [np.ones(len(q), dtype=bool) for q in held.series]
        sets.append((held.names, held.series, every, [calibration.tips(q) for q in held.series]))
    out = []

    for names, touched_series, used, tips in sets:
        for name, q, mine, p in zip(names, touched_series, used, tips, strict=True):
            if mine.sum() < 2:
                continue
            before, after = (
                _scatter(calibration.nominal.tips(q[mine], calibration.nominal_tcp)),
                _scatter(p[mine]),
            )

            if after > before * _chance(3 * (int(mine.sum()) - 1)):
                out.append(
                    f"{name}: {1e3 * after:.3g} mm against {1e3 * before:.3g} with the nominal arm"
                )
    return out


def _worse_predicted(
    calibration: Calibration, series: Sequence[Array], again: Callable[..., Calibration]
) -> list[str]:
    """Whether points left out of the fit in turn agree significantly better with the nominal
    arm.
    """
    if calibration.loads is not None:
        return []  # the payloads are given for all points

    # Cross-validation over folds of points.
    folds = [range(k, len(series), _FOLDS) for k in range(min(_FOLDS, len(series)))]
    square = np.zeros(2)
    degrees = 0
    for fold in folds:
        rest = [q for i, q in enumerate(series) if i not in fold]
        if sum(len(q) - 1 for q in rest) < _LEAST_FOLD:
            return []
        other = again(rest)
        for i in fold:
            used = calibration.weights[i] > 0.0
            if used.sum() < 2:
                continue
            q = series[i][used]
            both = calibration.nominal.tips(q, calibration.nominal_tcp), other.tips(q)
            square += [used.sum() * _scatter(p) ** 2 for p in both]
            degrees += 3 * (int(used.sum()) - 1)

    before, after = np.sqrt(square / max(degrees, 1))
    if degrees and after > before * _chance(degrees):
        return [
            f"points left out of the fit: {1e3 * after:.3g} mm along an axis against "
            f"{1e3 * before:.3g}"
        ]
    return []


def _chance(degrees: int) -> float:
    """Ratio of two RMS values, each with `degrees` degrees of freedom, at the 0.1 % significance
    level.
    """
    return float(np.sqrt(f.isf(1e-3, degrees, degrees)))


def _scatter(tips: Array) -> float:
    """RMS distance [m] of tips (m, 3) from their mean."""
    return float(np.sqrt(((tips - tips.mean(axis=0)) ** 2).sum(axis=1).mean()))


def failed(outcome: CalibrationOutcome, method: Literal["map", "paper"]) -> list[str]:
    """Reasons to reject the identified arm; empty if it is accepted.

    Convergence is required for `method` "map" only, since the published three iterations do not
    converge.
    """
    calibration = outcome.calibration
    out = [str(doubt) for doubt in outcome.examined.doubts]
    if not calibration.cost < calibration.cost_nominal:
        out.append("the scatter of the touches of a point is not smaller than with the nominal arm")

    if outcome.clouds and not outcome.clouds["identified"].rms <= outcome.clouds["nominal"].rms:
        out.append("the tracker error is smaller with the nominal arm")
    if outcome.held_out:
        before, after = np.median(list(outcome.held_out.values()), axis=0)
        if not after <= before:
            out.append("the error of the held-out touches is not smaller than with the nominal arm")
    if outcome.worse:
        out.append(f"the nominal arm is better ({'; '.join(outcome.worse)})")

    if method == "map" and not calibration.converged:
        out.append(f"the fit did not converge in {len(calibration.history) - 1} steps")
    return out
