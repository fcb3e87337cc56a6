"""Doubts of a calibration: wrong files, tables or lengths that explain its touches better.

A fit finds the arm that brings the touches of a point closest together. Any file has such an arm,
also one whose columns are exchanged. How arms are made and how a hand touches tell right from
wrong: each doubt states the odds of a wrong input against the arm as found, and those of more than
`REFUSED` to 1 refuse it. What no odds can tell is said.

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

REACHES = (0.05, 50.0)  # [m] of arms; beyond, the unit of the lengths is wrong
# factor of `HAND_NOISE` that is one standard deviation of how well a point is touched
_LIKE_HAND = 3.0
_SHARE_OF_MOTION = 3e-4  # noise over the motion of the joints
_LIKE_SHARE = 4.0  # factor of it that is one standard deviation
# scatter by a nominal arm, as a share of the motion of the joints, that is no accident
_COINCIDE = 0.15
_BLUNDERS = 20.0  # blunders are rare: their share is drawn from the density 20 (1 - share)^19
# times the deviation to which arms are made: errors of a table that is of another arm
_FOREIGN = 10.0
_WRONG_LENGTH = 0.1  # standard deviation of a wrong known length, as a share of it
_MADE_SCALE = 1e-3  # standard deviation of the size of a whole arm, slides included
# most touches of a point that count for its place: the seat of a ball repeats its errors
_SEATS = 4.0
_SAME = 2e-4  # [rad], [m] a hand does not find a posture again so closely in every joint
_RANGE = 0.1  # [rad], [m] over which a hand spreads a joint at least
_TWO_SEATS = 5e-3  # [m] apart, two seats are no longer one: a ball leans on one flank by less
_CLUSTER = 3  # least touches of a point


@dataclass(frozen=True, kw_only=True)
class Examination:
    """What the touches say against a calibration, and what they cannot say."""

    doubts: tuple[Doubt, ...] = ()  # that refuse it, named causes first
    untold: tuple[str, ...] = ()  # wrong inputs that touches like these cannot tell from right ones


def examine(
    calibration: Calibration, series: Sequence[Array], again: Again, stated: Told | None = None
) -> Examination:
    """Doubts that refuse a calibration, and what its touches cannot tell.

    Args:
        calibration: the calibration.
        series: touches (m_i, n) that it is from.
        again: the same identification from other touches, `again(series, distances=...)`.
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

    # Other readings of the files, where no named cause refuses the calibration.
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

        # A wrong file may look like several: what explains it best is said.
        named += sorted(causes, key=lambda doubt: -doubt.log_odds)[:1]

    grave = tuple(doubt for doubt in (*named, *general) if doubt.grave)
    return Examination(
        doubts=grave, untold=() if grave else tuple(_cannot_tell(hidden, rivals, stated))
    )


def _cannot_tell(
    hidden: Sequence[HiddenJoint], rivals: Sequence[Rival], stated: Told
) -> Iterator[str]:
    """Joints whose readings explain nothing, and readings that explain as much as those given."""
    lost = {suspect.joint for suspect in hidden if not suspect.told}

    for suspect in hidden:
        if suspect.joint in lost:
            yield (
                f"the readings of joint {suspect.joint + 1 - stated.base_joints} are not checked: "
                f"the tip lies on its axis within {1e3 * suspect.lever:.2g} mm, and no parameter "
                "of that joint is identifiable"
            )
        elif suspect.doubt.log_odds > 0.0:
            yield f"possibly {suspect.doubt}: too weak to refuse it"

    for rival in rivals:
        if rival.doubt.log_odds < -np.log(REFUSED) or {*rival.reading.joints} & lost:
            continue

        if rival.reading.mirrored:
            yield (
                "the arm and its mirror image fit the touches equally: check the sign of one "
                "joint by a move"
            )
        else:
            yield (
                f"the file as it is and {rival.reading.text} fit the touches equally: check it by "
                "a move"
            )


# Nothing can be told


def _untold(calibration: Calibration, series: Sequence[Array], stated: Told) -> Iterator[Doubt]:
    """Joints, scale and parameters of which the touches tell nothing."""
    arm = calibration.nominal

    if not REACHES[0] <= arm.reach <= REACHES[1]:
        yield Doubt(
            reason=f"the nominal arm reaches {arm.reach:.3g} m, arms {REACHES[0]:g} to "
            f"{REACHES[1]:g} m: the unit of "
            "its lengths is wrong"
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
    """Postures that two points share, and points of which most postures are repeats."""
    n = series[0].shape[1]
    likely = np.log(_RANGE / _SAME)

    for (i, a), (j, b) in combinations(enumerate(series), 2):
        shared = sum(map(bool, cKDTree(a).query_ball_tree(cKDTree(b), _SAME, p=np.inf)))

        if shared:
            yield Doubt(
                reason=f"points {names[i]} and {names[j]} share {shared} postures: the same "
                "touches twice",
                log_odds=n * likely - np.log(len(a) * len(b)),
            )

    for name, q in zip(names, series, strict=True):
        near = cKDTree(q).query_ball_tree(cKDTree(q), _SAME, p=np.inf)
        fresh = sum(min(mine) == k for k, mine in enumerate(near))

        if len(q) >= 4 and fresh <= len(q) / 2:
            # A point leaves n - 3 joints to choose.
            yield Doubt(
                reason=f"point {name}: {len(q)} touches are {fresh} postures, the rest repeats "
                "them",
                log_odds=(len(q) - fresh) * max(n - 3, 0) * likely,
            )


# Two points in one series


def _two_points(
    free: Calibration, series: Sequence[Array], again: Again, names: Sequence[str]
) -> Iterator[Doubt]:
    """Series that fit far better as touches of two points each than `free` without distances."""
    if free.loads is not None:
        return  # its payloads are those of the series as they are

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
    """Mask (m,) of the touches `q` (m, n) in one of two clusters of tips; None if one will do."""
    best = 0.0
    labels = None

    for arm, tcp in (
        (calibration.arm, calibration.tcp),
        (calibration.nominal, calibration.nominal_tcp),
    ):
        p = arm.tips(q, tcp)
        off = p - p.mean(axis=0)
        mine = off @ np.linalg.svd(off, full_matrices=False)[2][0] > 0.0

        # Two means, from the cut across the principal axis.
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

        # Of isotropic tips a cut leaves 0.79 of the squares; which touch is of which point costs a
        # bit each.
        gain = 1.5 * len(q) * np.log((off**2).sum() / max(within, 1e-18)) - len(q) * np.log(2.0)

        if gain > best:
            best = gain
            labels = mine

    return labels


# Known lengths


def _wrong_lengths(free: Calibration, series: Sequence[Array], stated: Told) -> Iterator[Doubt]:
    """Known lengths against those that the touches and the making of the arm tell, without them."""
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

        # Variance of the length by the touches: seats of the points, and the arm.
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
    """Touches that come no closer than those of no point: by a hand's noise, by joint motion."""
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
    """True if by the nominal `arm` the touches of each point lie close, for their motion."""
    tcp = first_tcp(arm, series)
    return spread(arm, tcp, series) < _COINCIDE * np.sqrt(3.0) * motion_of(arm, tcp, series)


def _log_unlike(value: float, usual: float, factor: float, most: float) -> float:
    """Log odds that `value` is any up to `most`, log-uniform, against about `usual` by a factor."""
    if value <= usual or most <= usual:
        return -np.inf

    z = np.log(value / usual) / np.log(factor)
    return 0.5 * z**2 + np.log(np.sqrt(2.0 * np.pi) * np.log(factor)) - np.log(np.log(most / usual))


def _left_out(calibration: Calibration, names: Sequence[str]) -> Doubt:
    """More touches left out than a hand's blunders, of all points or of one."""
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
    """One parameter further off than arms are made, by the evidence of the linearised touches."""
    estimate = calibration.estimate
    informed = _information(calibration)
    tolerances = as_made(calibration)
    toward = np.linalg.solve(estimate.covariance, estimate.changes)

    def evidence(deviations: Array) -> tuple[float, Array]:
        """Logarithm of the evidence, and the changes (P,) that the touches then give."""
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

    # Each parameter with a wider deviation of its own.
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
    return np.linalg.inv(estimate.covariance) - np.diag(estimate.prior**-2.0)
