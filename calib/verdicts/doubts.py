"""Doubts about a calibration: wrong files, tables or lengths that explain its touches better.

A fit finds the arm that brings the touches of a point closest together. Such an arm exists for any
file, also for one whose columns are exchanged. Manufacturing tolerances and the accuracy of an
operator distinguish right inputs from wrong ones. Each doubt states the odds of a wrong input
against the arm found, and a doubt with odds above `REFUSED` to 1 refuses the calibration. Questions
that the touches cannot decide are stated separately.

    found = identify(series, nominal)
    for doubt in examine(found, series, partial(identify, nominal=nominal)).doubts:
        print(doubt)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import betaln

from uuv.calib.fit import LEAST_FREEDOM
from uuv.calib.identification import Calibration
from uuv.calib.simulation import HAND_NOISE
from uuv.calib.touches import first_tcp, motions, moved, spread
from uuv.calib.verdicts.evidence import (
    BRIEF,
    REFUSED,
    Again,
    Doubt,
    Told,
    as_made,
    log_evidence,
    motion_of,
)
from uuv.calib.verdicts.readings import (
    HiddenJoint,
    Rival,
    frozen_readings,
    hidden_joints,
    rival_readings,
    shifted_readings,
)
from uuv.models.arms.kinematics import ROW
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

REACHES = (0.05, 50.0)  # [m] reach of arms; outside this range the unit of the lengths is wrong
# factor on `HAND_NOISE` that is one standard deviation of the accuracy of touching
_LIKE_HAND = 3.0
_SHARE_OF_MOTION = 3e-4  # usual ratio of the noise to the motion of the joints
_LIKE_SHARE = 4.0  # factor on this ratio that is one standard deviation
# scatter with the nominal arm, as a share of the motion of the joints, that is not due to chance
_COINCIDE = 0.15
_BLUNDERS = 20.0  # blunders are rare: their share has the prior density 20 (1 - share)^19
# factor on manufacturing tolerances: errors of a table that belongs to another arm
_FOREIGN = 10.0
_WRONG_LENGTH = 0.1  # standard deviation of a wrong known length, as a share of the length
_MADE_SCALE = 1e-3  # standard deviation of the size of a whole arm, slides included
# largest number of touches of a point that count for its position, since the seat of a ball repeats
# its errors
_SEATS = 4.0
_SAME = 2e-4  # [rad], [m] an operator does not repeat a posture so closely in every joint
_RANGE = 0.1  # [rad], [m] least range over which an operator moves a joint
# [m] distance from which on two seats are not the same: the play of a ball is smaller
_TWO_SEATS = 5e-3
_CLUSTER = 3  # least number of touches of a point


@dataclass(frozen=True, kw_only=True)
class Examination:
    """Doubts of the touches about a calibration, and the questions that they leave open."""

    doubts: tuple[Doubt, ...] = ()  # doubts that refuse it, named causes first
    # wrong inputs that touches like these cannot distinguish from right ones
    untold: tuple[str, ...] = ()


def examine(
    calibration: Calibration, series: Sequence[Array], again: Again, stated: Told | None = None
) -> Examination:
    """Doubts that refuse a calibration, and questions that its touches cannot decide.

    Args:
        calibration: the calibration.
        series: touches (m_i, n) from which it was computed.
        again: function that repeats the identification with other touches, `again(series,
            distances=...)`.
        stated: names of the points, known distances between them, joints of a moving base.

    Returns:
        The doubts whose odds are above `REFUSED`, and statements.
    """
    stated = (
        Told(names=[f"point {i + 1}" for i in range(len(series))]) if stated is None else stated
    )
    free = again(series, distances=()) if stated.distances else calibration
    arm_series = [np.ascontiguousarray(q[:, stated.base_joints :]) for q in series]

    named = [
        *_untold(calibration, series, stated),
        *_repeats(arm_series, stated.names),
        *_wrong_lengths(free, series, stated),
    ]
    named += frozen_readings(calibration, series, stated)

    general = [
        _scatter(calibration, series),
        _left_out(calibration, stated.names),
        _foreign_table(calibration),
    ]
    hidden: list[HiddenJoint] = []
    rivals: list[Rival] = []

    # Other readings of the files, if no named cause refuses the calibration.
    if not any(doubt.grave for doubt in named):
        hidden += hidden_joints(calibration, series, again, stated)
        rivals += rival_readings(
            calibration, series, again, stated, single=any(doubt.grave for doubt in general)
        )
        causes = [
            *(cause.doubt for cause in (*hidden, *rivals)),
            *_two_points(free, series, again, stated.names),
        ]

        if not any(doubt.grave for doubt in causes):
            causes += shifted_readings(calibration, series, again, stated)

        # A wrong file may fit several doubts; only the best explanation is reported.
        named += sorted(causes, key=lambda doubt: -doubt.log_odds)[:1]

    grave = tuple(doubt for doubt in (*named, *general) if doubt.grave)
    return Examination(
        doubts=grave, untold=() if grave else tuple(_cannot_tell(hidden, rivals, stated))
    )


def _cannot_tell(
    hidden: Sequence[HiddenJoint], rivals: Sequence[Rival], stated: Told
) -> Iterator[str]:
    """Statements about joints whose readings cannot be checked, and about other readings that
    explain the touches equally well.
    """
    lost = {suspect.joint for suspect in hidden if not suspect.told}

    for suspect in hidden:
        if suspect.joint in lost:
            yield (
                f"the readings of joint {suspect.joint + 1 - stated.base_joints} are not checked: "
                f"the tip lies on its axis within {1e3 * suspect.lever:.2g} mm, and no parameter "
                "of that joint is identifiable"
            )
        elif suspect.doubt.log_odds > 0.0:
            yield f"possibly {suspect.doubt}: too weak to refuse the calibration"

    for rival in rivals:
        if rival.doubt.log_odds < -np.log(REFUSED) or {*rival.reading.joints} & lost:
            continue

        if rival.reading.mirrored:
            yield (
                "the arm and its mirror image fit the touches equally: check the sign of one joint "
                "by moving it"
            )
        else:
            yield (
                f"the file as it is and {rival.reading.text} fit the touches equally: check this "
                "by moving the joint"
            )


# Touches without information


def _untold(calibration: Calibration, series: Sequence[Array], stated: Told) -> Iterator[Doubt]:
    """Doubts about joints, scale and parameters about which the touches contain no information."""
    arm = calibration.nominal

    if not REACHES[0] <= arm.reach <= REACHES[1]:
        yield Doubt(
            reason=(
                f"the nominal arm reaches {arm.reach:.3g} m, but arms reach {REACHES[0]:g} to "
                f"{REACHES[1]:g} m: the unit of its lengths is wrong"
            )
        )

    if calibration.degrees_of_freedom < LEAST_FREEDOM:
        yield Doubt(reason="the touches are too few for what is identified: they fit any arm")

    still = ~np.any([moved(q, arm) for q in series], axis=0)
    most = np.max([motions(q) for q in series], axis=0)
    for k in np.flatnonzero(
        still & np.isin(np.arange(arm.n), calibration.estimate.parameters.index // ROW)
    ):
        unit = f"{1e3 * most[k]:.1f} mm" if arm.slides[k] else f"{np.rad2deg(most[k]):.1f} deg"
        yield Doubt(
            reason=f"joint {k + 1 - stated.base_joints} moves by {unit} RMS about any point: its "
            "parameters are not identifiable; move it, or leave its parameters out of "
            "those that are free"
        )


# Repeated postures


def _repeats(series: Sequence[Array], names: Sequence[str]) -> Iterator[Doubt]:
    """Doubts about postures that two points share, and about points most of whose postures are
    repeats.
    """
    n = series[0].shape[1]
    likely = np.log(_RANGE / _SAME)

    for (i, a), (j, b) in combinations(enumerate(series), 2):
        shared = sum(map(bool, cKDTree(a).query_ball_tree(cKDTree(b), _SAME, p=np.inf)))

        if shared:
            yield Doubt(
                reason=(
                    f"points {names[i]} and {names[j]} share {shared} postures: the same touches "
                    "were written twice"
                ),
                log_odds=n * likely - np.log(len(a) * len(b)),
            )

    for name, q in zip(names, series, strict=True):
        near = cKDTree(q).query_ball_tree(cKDTree(q), _SAME, p=np.inf)
        fresh = sum(min(mine) == k for k, mine in enumerate(near))

        if len(q) >= 4 and fresh <= len(q) / 2:
            # For each point, n - 3 joints can be chosen freely.
            yield Doubt(
                reason=(
                    f"point {name}: {len(q)} touches have only {fresh} different postures, the "
                    "others repeat them"
                ),
                log_odds=(len(q) - fresh) * max(n - 3, 0) * likely,
            )


# Touches of two points in one series


def _two_points(
    free: Calibration, series: Sequence[Array], again: Again, names: Sequence[str]
) -> Iterator[Doubt]:
    """Doubts about series that fit far better as touches of two points each than in the fit `free`,
    without distances.
    """
    if free.loads is not None:
        return  # the payloads belong to the series in their original form

    parts: list[Array] = []
    split: list[tuple[str, int]] = []
    cost = 0.0

    for name, q in zip(names, series, strict=True):
        labels = _clusters(free, q)
        if labels is None:
            parts.append(q)
            continue

        split.append((name, len(parts)))
        cost += len(q) * np.log(2.0)
        parts += [q[labels], q[~labels]]

    if not split:
        return

    try:
        apart = again(parts, distances=(), method=BRIEF)
    except ConfigurationError:
        return

    far = [
        name
        for name, k in split
        if np.linalg.norm(apart.points[k] - apart.points[k + 1]) > _TWO_SEATS
    ]

    if far:
        yield Doubt(
            reason=f"{', '.join(far)}: touches of two points, not of one",
            log_odds=log_evidence(apart, parts) - log_evidence(free, series) - cost,
        )


def _clusters(calibration: Calibration, q: Array) -> np.ndarray | None:
    """Mask (m,) of the touches `q` (m, n) in one of two clusters of tips; None if one cluster
    suffices.
    """
    best = 0.0
    labels = None

    for arm, tcp in (
        (calibration.arm, calibration.tcp),
        (calibration.nominal, calibration.nominal_tcp),
    ):
        p = arm.tips(q, tcp)
        off = p - p.mean(axis=0)
        mine = off @ np.linalg.svd(off, full_matrices=False)[2][0] > 0.0

        # Two means, starting from the cut perpendicular to the principal axis.
        for _ in range(10):
            if not _CLUSTER <= mine.sum() <= len(q) - _CLUSTER:
                break
            gaps = [((p - p[cluster].mean(axis=0)) ** 2).sum(axis=1) for cluster in (mine, ~mine)]
            mine = gaps[0] < gaps[1]

        if not _CLUSTER <= mine.sum() <= len(q) - _CLUSTER:
            continue
        within = sum(
            ((p[cluster] - p[cluster].mean(axis=0)) ** 2).sum() for cluster in (mine, ~mine)
        )

        # For isotropic tips such a cut leaves 0.79 of the sum of squares; the assignment of each
        # touch costs one bit.
        gain = 1.5 * len(q) * np.log((off**2).sum() / max(within, 1e-18)) - len(q) * np.log(2.0)

        if gain > best:
            best = gain
            labels = mine

    return labels


# Known lengths


def _wrong_lengths(free: Calibration, series: Sequence[Array], stated: Told) -> Iterator[Doubt]:
    """Doubts about known lengths, which are compared with lengths from the touches and the
    manufacturing tolerances alone.
    """
    informed = _information(free)
    tolerances = as_made(free)
    covariance = np.linalg.inv(
        informed + np.diag(np.maximum(free.estimate.prior, tolerances / 3.0) ** -2.0)
    )

    slopes: dict[int, Array] = {}

    for i, j, length, deviation in stated.distances:
        gap = free.points[i] - free.points[j]
        size = float(np.linalg.norm(gap))
        variance = deviation**2 + (_MADE_SCALE * length) ** 2

        # Variance of the length from the touches: seats of the points, and the arm.
        for k in (i, j):
            if k not in slopes:
                slopes[k] = _slope(free, series[k], k)
            variance += free.noise**2 / np.clip(float((free.weights[k] > 0.0).sum()), 1.0, _SEATS)
        slope = (slopes[i] - slopes[j]) @ gap / max(size, 1e-12)
        variance += float(slope @ covariance @ slope)

        wide = variance + (_WRONG_LENGTH * length) ** 2
        error2 = (size - length) ** 2

        yield Doubt(
            reason=f"known distance {stated.names[i]} to {stated.names[j]}: stated {length:.5g} "
            f"m, from the touches {size:.5g} ± {2.0 * np.sqrt(variance):.2g} m: the length is "
            "wrong",
            log_odds=0.5 * (error2 / variance - error2 / wide - np.log(wide / variance)),
        )


def _slope(free: Calibration, q: Array, k: int) -> Array:
    """Derivatives (P, 3) of the point of series k, touched at `q` (m, n), by free parameters."""
    J = free.arm.tips_and_jacobian(np.ascontiguousarray(q), free.tcp)[1]
    J = np.concatenate([J, np.zeros((len(q), free.arm.n, 3))], axis=1)[
        :, free.estimate.parameters.index
    ]

    used = free.weights[k] > 0.0
    return J[used].mean(axis=0) if used.any() else J.mean(axis=0)


# Noise and parameters


def _scatter(calibration: Calibration, series: Sequence[Array]) -> Doubt:
    """Doubt about touches that scatter too much to be touches of points, compared with an
    operator's noise and with the joint motion.
    """
    motion = motion_of(calibration.arm, calibration.tcp, series)
    share = calibration.noise / max(motion, 1e-12)

    odds = max(
        _log_unlike(calibration.noise, HAND_NOISE, _LIKE_HAND, motion),
        _log_unlike(share, _SHARE_OF_MOTION, _LIKE_SHARE, 1.0),
    )

    return Doubt(
        reason=f"touches scatter by {1e3 * calibration.noise:.3g} mm about their points, "
        f"{100.0 * share:.2g} % of the motion "
        "of the joints: they are not touches of points by this arm",
        log_odds=odds,
    )


def coincide(arm: SerialArm, series: Sequence[Array]) -> bool:
    """True if, with the nominal `arm`, the touches of each point are close compared with the joint
    motion.
    """
    tcp = first_tcp(arm, series)
    return spread(arm, tcp, series) < _COINCIDE * np.sqrt(3.0) * motion_of(arm, tcp, series)


def _log_unlike(value: float, usual: float, factor: float, most: float) -> float:
    """Log odds that `value` is log-uniform up to `most`, against log-normal about `usual` with
    deviation `factor`.
    """
    if value <= usual or most <= usual:
        return -np.inf

    z = np.log(value / usual) / np.log(factor)
    return 0.5 * z**2 + np.log(np.sqrt(2.0 * np.pi) * np.log(factor)) - np.log(np.log(most / usual))


def _left_out(calibration: Calibration, names: Sequence[str]) -> Doubt:
    """Doubt if more touches, of all points or of one, are left out than an operator's blunders
    explain.
    """
    out = np.array([(weights == 0.0).sum() for weights in calibration.weights])
    counts = np.array([len(weights) for weights in calibration.weights])

    tried = [(f"{out.sum()} of all {counts.sum()} touches", out.sum(), counts.sum())]
    tried += [
        (f"{k} of {m} touches of {name}", k, m)
        for name, k, m in zip(names, out, counts, strict=True)
    ]

    def log_odds(left_out: float, count: float) -> float:
        any_share = betaln(left_out + 1.0, count - left_out + 1.0)
        return float(
            any_share - betaln(left_out + 1.0, count - left_out + _BLUNDERS) - np.log(_BLUNDERS)
        )

    text, *worst = max(tried, key=lambda candidate: log_odds(*candidate[1:]))
    return Doubt(reason=f"{text} do not belong to their points", log_odds=log_odds(*worst))


def _foreign_table(calibration: Calibration) -> Doubt:
    """Doubt about one parameter beyond manufacturing tolerances, from the evidence of the
    linearised touches.
    """
    estimate = calibration.estimate
    informed = _information(calibration)
    tolerances = as_made(calibration)
    toward = np.linalg.solve(estimate.posterior, estimate.changes)

    def evidence(deviations: Array) -> tuple[float, Array]:
        """Logarithm of the evidence with prior `deviations`, and the resulting changes (P,)."""
        root = informed * np.outer(deviations, deviations) + np.eye(len(deviations))

        changes = deviations * np.linalg.solve(root, deviations * toward)
        return 0.5 * float(toward @ changes) - 0.5 * float(np.linalg.slogdet(root)[1]), changes

    as_stated, _ = evidence(tolerances)

    tried = [
        k
        for k, group in enumerate(estimate.parameters.groups)
        if group not in {"tcp", "compliance"}
    ]
    best = Doubt(reason="", log_odds=-np.inf)

    # Each parameter in turn gets a wider deviation.
    for k in tried:
        wider = tolerances.copy()
        wider[k] *= _FOREIGN
        value, changes = evidence(wider)
        odds = value - as_stated - np.log(len(tried))

        if odds > best.log_odds:
            unit = estimate.parameters.units[k]
            amount = (
                f"{np.rad2deg(changes[k]):.3g} deg"
                if unit == "rad"
                else f"{1e3 * changes[k]:.3g} mm"
            )
            usual = (
                f"{np.rad2deg(tolerances[k]):.2g} deg"
                if unit == "rad"
                else f"{1e3 * tolerances[k]:.2g} mm"
            )

            best = Doubt(
                reason=f"{estimate.names[k]} would be wrong by {amount}, manufacturing tolerances "
                f"are {usual}: the table, a joint sign or a joint zero is wrong",
                log_odds=odds,
            )

    return best


def _information(calibration: Calibration) -> Array:
    """Information (P, P) of the touches alone, without the prior."""
    estimate = calibration.estimate
    return np.linalg.inv(estimate.posterior) - np.diag(estimate.prior**-2.0)
