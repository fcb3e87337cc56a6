"""Doubts of a calibration: what a wrong file, table or length explains better than an arm with errors of its making.

A fit finds the arm that brings the touches of a point closest together. Any file has such an arm, also one whose
columns are exchanged. How arms are made and how a hand touches tell right from wrong: each doubt states the odds of a
wrong input against the arm as found, and those of more than `REFUSED` to 1 refuse it.

    found = identify(series, nominal)
    for doubt in doubts(found, series, partial(identify, nominal=nominal)):
        print(doubt)
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import betaln

from calib.fit import LEAST_FREEDOM
from calib.identification import Calibration, MapFit
from calib.parameters import widest_prior
from calib.simulation import HAND_NOISE
from calib.touches import first_tcp, motions, moved, spread
from models.arms.kinematics import ROW
from models.arms.serial_arm import SerialArm
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

REFUSED = 100.0  # odds to 1 above which a wrong input is the better explanation
REACHES = (0.05, 50.0)  # [m] of arms; beyond, the unit of the lengths is wrong
_LIKE_HAND = 3.0  # factor of `HAND_NOISE` that is one standard deviation of how well a point is touched
_SHARE_OF_MOTION, _LIKE_SHARE = 3e-4, 4.0  # noise over the motion of the joints; factor that is one deviation of it
_COINCIDE = 0.15  # scatter by a nominal arm, as a share of the motion of the joints, that is no accident
_BLUNDERS = 20.0  # blunders are rare: their share is drawn from the density 20 (1 - share)^19
_FOREIGN = 10.0  # times the deviation to which arms are made: errors of a table that is of another arm
_WRONG_LENGTH = 0.1  # standard deviation of a wrong known length, as a share of it
_MADE_SCALE = 1e-3  # standard deviation of the size of a whole arm, slides included
_SEATS = 4.0  # most touches of a point that count for its place: the seat of a ball repeats its errors
_SAME = 2e-4  # [rad], [m] a hand does not find a posture again so closely in every joint
_RANGE = 0.1  # [rad], [m] over which a hand spreads a joint at least
_TWO_SEATS = 5e-3  # [m] apart, two seats are no longer one: a ball leans on one flank by less
_CLUSTER = 3  # least touches of a point
_SCREENED = 4  # readings of a refused file that are fitted, the nearest by the nominal arm
_ABOUT = 0.3  # logarithm of distances, for each point, within which a reading is worth a fit
_SHUFFLES = 8  # draws of the motion
_MOST = 300.0 * np.log(10.0)  # logarithm of the largest odds that are printed

_BRIEF = MapFit(max_iterations=20)  # a right reading settles in fewer steps

Again = Callable[..., Calibration]  # (series, *, distances, method) -> `identify` with the same arm and options


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """A wrong input that explains the touches better than the arm found does."""

    reason: str
    log_odds: float = np.inf  # natural logarithm, wrong input against the arm found; infinite: nothing can be told

    def __str__(self) -> str:
        if not np.isfinite(self.log_odds):
            return self.reason
        exponent = min(self.log_odds, _MOST) / np.log(10.0)
        odds = f"{10.0**exponent:.0f}" if exponent < 4.0 else f"1e{int(exponent)}"
        return f"{self.reason} ({odds} to 1)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Told:
    """What is told of the touches beside their joint values."""

    names: Sequence[str]  # of the points
    distances: Sequence[tuple[int, int, float, float]] = ()  # (series, series, length [m], deviation [m])


def doubts(found: Calibration, series: Sequence[Array], again: Again, told: Told | None = None) -> tuple[Doubt, ...]:
    """Doubts that refuse a calibration, named causes first; empty: none.

    Args:
        found: the calibration.
        series: touches (m_i, n) that it is from.
        again: the same identification from other touches, `again(series, distances=...)`.
        told: names of the points and known distances between them.

    Returns:
        The doubts whose odds are above `REFUSED`.
    """
    told = Told(names=[f"point {i + 1}" for i in range(len(series))]) if told is None else told
    free = again(series, distances=()) if told.distances else found
    named = [*_untold(found, series), *_repeats(series, told.names), *_wrong_lengths(free, series, told)]
    named += _two_points(free, series, again, told.names)
    general = [_scatter(found, series), _left_out(found, told.names), _foreign_table(found)]
    if not any(map(_grave, named)):
        named += _other_readings(found, series, again, told, single=any(map(_grave, general)))
    return tuple(doubt for doubt in (*named, *general) if _grave(doubt))


def _grave(doubt: Doubt) -> bool:
    return doubt.log_odds > np.log(REFUSED)


# Nothing can be told


def _untold(found: Calibration, series: Sequence[Array]) -> Iterator[Doubt]:
    """Joints, scale and parameters of which the touches tell nothing."""
    arm = found.nominal
    if not REACHES[0] <= arm.reach <= REACHES[1]:
        yield Doubt(
            reason=f"the nominal arm reaches {arm.reach:.3g} m, arms {REACHES[0]:g} to {REACHES[1]:g} m: the unit of "
            "its lengths is wrong"
        )
    if found.degrees_of_freedom < LEAST_FREEDOM:
        yield Doubt(reason="the touches are too few for what is identified: they fit any arm")
    still = ~np.any([moved(q, arm) for q in series], axis=0)
    most = np.max([motions(q) for q in series], axis=0)
    for k in np.flatnonzero(still & np.isin(np.arange(arm.n), found.estimate.parameters.index // ROW)):
        unit = f"{1e3 * most[k]:.1f} mm" if arm.slides[k] else f"{np.rad2deg(most[k]):.1f} deg"
        yield Doubt(
            reason=f"joint {k + 1} moves by {unit} RMS about any point: nothing is told of it; move it, or leave its "
            "parameters out of those that are free"
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
                reason=f"points {names[i]} and {names[j]} share {shared} postures: the same touches twice",
                log_odds=n * likely - np.log(len(a) * len(b)),
            )
    for name, q in zip(names, series, strict=True):
        near = cKDTree(q).query_ball_tree(cKDTree(q), _SAME, p=np.inf)
        fresh = sum(min(mine) == k for k, mine in enumerate(near))
        if len(q) >= 4 and fresh <= len(q) / 2:
            # A point leaves n - 3 joints to choose.
            yield Doubt(
                reason=f"point {name}: {len(q)} touches are {fresh} postures, the rest repeats them",
                log_odds=(len(q) - fresh) * max(n - 3, 0) * likely,
            )


# Two points in one series


def _two_points(free: Calibration, series: Sequence[Array], again: Again, names: Sequence[str]) -> Iterator[Doubt]:
    """Series that fit far better as touches of two points each than as `free`, which knows no distances."""
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
        apart = again(parts, distances=(), method=_BRIEF)
    except ConfigurationError:
        return
    far = [name for name, k in split if np.linalg.norm(apart.points[k] - apart.points[k + 1]) > _TWO_SEATS]
    if far:
        yield Doubt(
            reason=f"{', '.join(far)}: touches of two points, not of one",
            log_odds=_log_evidence(apart, parts) - _log_evidence(free, series) - cost,
        )


def _clusters(found: Calibration, q: Array) -> np.ndarray | None:
    """Mask (m,) of the touches `q` (m, n) in one of two clusters of tips; None if one explains them as well."""
    best, labels = 0.0, None
    for arm, tcp in ((found.arm, found.tcp), (found.nominal, found.nominal_tcp)):
        p = arm.tips(q, tcp)
        off = p - p.mean(axis=0)
        mine = off @ np.linalg.svd(off, full_matrices=False)[2][0] > 0.0
        for _ in range(10):
            if not _CLUSTER <= mine.sum() <= len(q) - _CLUSTER:
                break
            gaps = [((p - p[each].mean(axis=0)) ** 2).sum(axis=1) for each in (mine, ~mine)]
            mine = gaps[0] < gaps[1]
        if not _CLUSTER <= mine.sum() <= len(q) - _CLUSTER:
            continue
        within = sum(((p[each] - p[each].mean(axis=0)) ** 2).sum() for each in (mine, ~mine))
        # Of isotropic tips a cut leaves 0.79 of the squares; which touch is of which point costs a bit each.
        gain = 1.5 * len(q) * np.log((off**2).sum() / max(within, 1e-18)) - len(q) * np.log(2.0)
        if gain > best:
            best, labels = gain, mine
    return labels


# Known lengths


def _wrong_lengths(free: Calibration, series: Sequence[Array], told: Told) -> Iterator[Doubt]:
    """Known lengths against those that the touches and the making of the arm tell, `free` of them."""
    informed, made = _information(free), _as_made(free)
    covariance = np.linalg.inv(informed + np.diag(np.maximum(free.estimate.prior, made / 3.0) ** -2.0))
    slopes: dict[int, Array] = {}
    for i, j, length, deviation in told.distances:
        gap = free.points[i] - free.points[j]
        size = float(np.linalg.norm(gap))
        variance = deviation**2 + (_MADE_SCALE * length) ** 2
        for k in (i, j):
            if k not in slopes:
                slopes[k] = _slope(free, series[k], k)
            variance += free.noise**2 / np.clip(float((free.weights[k] > 0.0).sum()), 1.0, _SEATS)
        slope = (slopes[i] - slopes[j]) @ gap / max(size, 1e-12)
        variance += float(slope @ covariance @ slope)
        wide = variance + (_WRONG_LENGTH * length) ** 2
        error2 = (size - length) ** 2
        yield Doubt(
            reason=f"known distance {told.names[i]} to {told.names[j]}: told {length:.5g} m, by the touches "
            f"{size:.5g} ± {2.0 * np.sqrt(variance):.2g} m: the length is wrong",
            log_odds=0.5 * (error2 / variance - error2 / wide - np.log(wide / variance)),
        )


def _slope(free: Calibration, q: Array, k: int) -> Array:
    """Derivatives (P, 3) of the point of series k, touched at `q` (m, n), by the free parameters."""
    J = free.arm.tips_and_jacobian(np.ascontiguousarray(q), free.tcp)[1]
    J = np.concatenate([J, np.zeros((len(q), free.arm.n, 3))], axis=1)[:, free.estimate.parameters.index]
    used = free.weights[k] > 0.0
    return J[used].mean(axis=0) if used.any() else J.mean(axis=0)


# Noise and parameters


def _scatter(found: Calibration, series: Sequence[Array]) -> Doubt:
    """Touches that come no closer than those of no point: by a hand's noise, and by the motion of the joints."""
    motion = motion_of(found.arm, found.tcp, series)
    share = found.noise / max(motion, 1e-12)
    odds = max(
        _log_unlike(found.noise, HAND_NOISE, _LIKE_HAND, motion), _log_unlike(share, _SHARE_OF_MOTION, _LIKE_SHARE, 1.0)
    )
    return Doubt(
        reason=f"touches scatter by {1e3 * found.noise:.3g} mm about their points, {100.0 * share:.2g} % of the motion "
        "of the joints: they are not touches of points by this arm",
        log_odds=odds,
    )


def motion_of(arm: SerialArm, tcp: Array, series: Sequence[Array]) -> float:
    """RMS distance [m] along each axis of the tips from their mean when the joints take their values in any order.

    The touches of a point are judged by it: an arm that shrinks, or joint values in a unit that makes them small,
    shrink it as much as their scatter.
    """
    rng, square, count = np.random.default_rng(0), 0.0, 0
    for q in series:
        for _ in range(_SHUFFLES if len(q) > 1 else 0):
            p = arm.tips(np.ascontiguousarray(rng.permuted(q, axis=0)), tcp)
            square, count = square + float(((p - p.mean(axis=0)) ** 2).sum()), count + 3 * len(q)
    return float(np.sqrt(square / max(count, 1)))


def coincide(arm: SerialArm, series: Sequence[Array]) -> bool:
    """True if the touches of each point lie close together by the nominal `arm`, beside the motion of its joints."""
    tcp = first_tcp(arm, series)
    return spread(arm, tcp, series) < _COINCIDE * np.sqrt(3.0) * motion_of(arm, tcp, series)


def _log_unlike(value: float, usual: float, factor: float, most: float) -> float:
    """Logarithm of the odds that `value` is any up to `most`, log-uniform, against about `usual` by a factor."""
    if value <= usual or most <= usual:
        return -np.inf
    z = np.log(value / usual) / np.log(factor)
    return 0.5 * z**2 + np.log(np.sqrt(2.0 * np.pi) * np.log(factor)) - np.log(np.log(most / usual))


def _left_out(found: Calibration, names: Sequence[str]) -> Doubt:
    """More touches left out than a hand's blunders, of all points or of one."""
    out = np.array([(weights == 0.0).sum() for weights in found.weights])
    counts = np.array([len(weights) for weights in found.weights])
    tried = [(f"{out.sum()} of all {counts.sum()} touches", out.sum(), counts.sum())]
    tried += [(f"{k} of {m} touches of {name}", k, m) for name, k, m in zip(names, out, counts, strict=True)]

    def log_odds(left_out: float, count: float) -> float:
        any_share = betaln(left_out + 1.0, count - left_out + 1.0)
        return float(any_share - betaln(left_out + 1.0, count - left_out + _BLUNDERS) - np.log(_BLUNDERS))

    text, *worst = max(tried, key=lambda one: log_odds(*one[1:]))
    return Doubt(reason=f"{text} do not belong to their points", log_odds=log_odds(*worst))


def _foreign_table(found: Calibration) -> Doubt:
    """One parameter further off than arms are made: evidence of the linearised touches under either deviation."""
    estimate, informed, made = found.estimate, _information(found), _as_made(found)
    toward = np.linalg.solve(estimate.covariance, estimate.changes)

    def evidence(deviations: Array) -> tuple[float, Array]:
        """Logarithm of the evidence, and the changes (P,) that the touches then give."""
        root = informed * np.outer(deviations, deviations) + np.eye(len(deviations))
        changes = deviations * np.linalg.solve(root, deviations * toward)
        return 0.5 * float(toward @ changes) - 0.5 * float(np.linalg.slogdet(root)[1]), changes

    own, _ = evidence(made)
    tried = [k for k, group in enumerate(estimate.parameters.groups) if group not in {"tcp", "compliance"}]
    best = Doubt(reason="", log_odds=-np.inf)
    for k in tried:
        wider = made.copy()
        wider[k] *= _FOREIGN
        value, changes = evidence(wider)
        odds = value - own - np.log(len(tried))
        if odds > best.log_odds:
            unit = estimate.parameters.units[k]
            amount = f"{np.rad2deg(changes[k]):.3g} deg" if unit == "rad" else f"{1e3 * changes[k]:.3g} mm"
            usual = f"{np.rad2deg(made[k]):.2g} deg" if unit == "rad" else f"{1e3 * made[k]:.2g} mm"
            best = Doubt(
                reason=f"{estimate.names[k]} would be off by {amount}, arms are made to {usual}: the table, a joint "
                "sign or a joint zero is wrong",
                log_odds=odds,
            )
    return best


def _as_made(found: Calibration) -> Array:
    """Deviations (P,) to which arms are made, or as stated where that is more."""
    bounds = widest_prior(found.estimate.parameters, found.nominal.reach)
    return np.where(np.isfinite(bounds), np.maximum(bounds, found.estimate.prior), found.estimate.prior)


def _information(found: Calibration) -> Array:
    """Information (P, P) of the touches alone, without the prior."""
    estimate = found.estimate
    return np.linalg.inv(estimate.covariance) - np.diag(estimate.prior**-2.0)


# Other readings of a refused file


def _log_evidence(found: Calibration, series: Sequence[Array]) -> float:
    """Logarithm of how well an arm as made explains all touches, each of unknown noise of a hand's or more."""
    square = np.concatenate(found.residuals) ** 2 + 3.0 * HAND_NOISE**2
    free = 1.0 - len(series) / len(square)
    away = found.estimate.changes / _as_made(found)
    bounded = np.isfinite(widest_prior(found.estimate.parameters, found.nominal.reach))
    motion = max(motion_of(found.arm, found.tcp, series), 1e-12)
    return -2.0 * free * float(np.log(square / motion**2).sum()) - 0.5 * float((away[bounded] ** 2).sum())


def _other_readings(
    found: Calibration, series: Sequence[Array], again: Again, told: Told, single: bool
) -> Iterator[Doubt]:
    """The other reading of the files that explains the touches best: columns exchanged, signs or units wrong.

    Readings that bring the touches about as close as they are, by the nominal arm, are fitted; `single`: also those of
    one file alone.
    """
    changes = list(_column_changes(found.nominal))
    misses = np.array([[_miss(found.nominal, change(q)) for q in series] for _, change in changes])
    given = np.array([_miss(found.nominal, q) for q in series])
    read = [(total, k, range(len(series))) for k, total in enumerate((misses - given).sum(axis=1))]
    if single and len(series) > 1:
        read += [(misses[k, i] - given[i], k, (i,)) for k in range(len(changes)) for i in range(len(series))]
    own, best = _log_evidence(found, series), Doubt(reason="", log_odds=-np.inf)
    for miss, k, chosen in sorted(read, key=lambda one: one[0])[:_SCREENED]:
        if miss > _ABOUT * len(chosen):
            continue
        text, change = changes[k]
        meant = [change(q) if i in chosen else q for i, q in enumerate(series)]
        try:
            other = again(meant, distances=told.distances, method=_BRIEF)
        except ConfigurationError:
            continue
        odds = _log_evidence(other, meant) - own - np.log(len(read))
        if odds > best.log_odds:
            where = f" of {told.names[chosen[0]]}" if len(chosen) < len(series) else ""
            best = Doubt(reason=f"{text}{where} explains the touches better", log_odds=odds)
    yield best


def _miss(arm: SerialArm, q: Array) -> float:
    """Logarithm of the median distance of the touches `q` (m, n) from their point, by the nominal arm."""
    p = arm.tips(q, first_tcp(arm, [q]))
    return float(np.log(np.median(np.linalg.norm(p - p.mean(axis=0), axis=1)) + HAND_NOISE))


def _column_changes(arm: SerialArm) -> Iterator[tuple[str, Callable[[Array], Array]]]:
    """Other readings of joint values (m, n), with their names."""
    n, hinges = arm.n, ~arm.slides
    for i, j in combinations(range(n), 2):
        if hinges[i] == hinges[j]:
            order = np.arange(n)
            order[[i, j]] = j, i
            yield f"columns {i + 1} and {j + 1} exchanged", partial(np.take, indices=order, axis=1)
    ways = (
        ("with the other sign", -1.0),
        ("in degrees", np.pi / 180.0),
        ("turned from degrees once too often", 180.0 / np.pi),
    )
    for text, factor in ways:
        scale = np.where(hinges | (factor < 0.0), factor, 1.0)
        yield f"all joints {text}", partial(np.multiply, scale)
        for k in np.flatnonzero(scale != 1.0):
            yield f"joint {k + 1} {text}", partial(np.multiply, np.where(np.arange(n) == k, factor, 1.0))
