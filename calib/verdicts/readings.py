"""Other readings of touch files that explain the touches as well: of columns, or of one joint.

Columns may be exchanged, of the other sign, in another unit, mirrored. The readings of a joint may
be unrelated to the touches, or shifted in a part of them. A joint whose axis passes close by the
tip hides what it reads: the fit moves the tip onto the axis and takes what is left for noise. Such
a joint is fitted anew with its reading of each touch unknown.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from uuv.calib.identification import Calibration
from uuv.calib.simulation import HAND_NOISE
from uuv.calib.touches import first_tcp
from uuv.calib.verdicts.evidence import (
    BRIEF,
    REFUSED,
    Again,
    Doubt,
    Told,
    freedom,
    log_evidence,
    log_likely,
    log_made,
    motion_of,
)
from uuv.models.arms.kinematics import ROW, THETA, D
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

_SCREENED = 4  # readings of a file that are fitted, the nearest by the nominal arm
# logarithm of distances, for each point, within which a reading is worth a fit
_ABOUT = np.log(3.0)
_SIGN = "with the other sign"
_UNITS = (("in degrees", np.pi / 180.0), ("turned from degrees once too often", 180.0 / np.pi))
# distance of the tip from an axis, over the noise, below which its readings may hide in the noise
_HIDDEN = 10.0
_CLOSE = 0.02  # the same as a share of the reach
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)  # [rad] of an unknown reading
_ROUNDS = 5  # fits with unknown readings, or with a shift
_ALL_REPLACED = 2  # of them with all readings unknown
_UNKNOWN = (0.1, 0.3, 0.5, 0.9, 1.0 - 1e-9)  # shares of the readings that are unknown
_WRONG_ZERO = 0.1  # [rad], [m] standard deviation of a shift of readings
_GEARS = 5e-3  # [rad], [m] of gears and bearings, which also shift the readings of a point
_LEAST_FROZEN = 4  # touches in a row
_LEAST_RUN = 3  # touches of a shift
_MOST_SPLITS = 60  # touches from which on a shift is tried


# Whole columns


@dataclass(frozen=True, kw_only=True)
class ColumnReading:
    """Another reading of joint values."""

    text: str
    change: Callable[[Array], Array]  # joint values (m, n) as given -> as meant
    joints: tuple[int, ...]  # that it reads otherwise, from 0; empty: all
    mirrored: bool = False  # the arm becomes its mirror image


@dataclass(frozen=True, kw_only=True)
class Rival:
    """A reading that was fitted, with its odds against the file as given."""

    reading: ColumnReading
    doubt: Doubt


def rival_readings(
    found: Calibration, series: Sequence[Array], again: Again, told: Told, single: bool
) -> list[Rival]:
    """Other readings of the files that explain the touches about as well: columns, signs, units.

    Readings that bring the touches about as close as they are, by the nominal arm, are fitted.

    Args:
        found: calibration from the files as given.
        series: their touches (m_i, n).
        again: the same identification from other touches.
        told: names of the points, known distances, joints of a moving base.
        single: also readings of one file alone.
    """
    readings = list(_readings(found.nominal, told.base_joints))

    misses = np.array([[_miss(found.nominal, each.change(q)) for q in series] for each in readings])
    given = np.array([_miss(found.nominal, q) for q in series])
    read = [(total, k, range(len(series))) for k, total in enumerate((misses - given).sum(axis=1))]

    # A reading of one file alone.
    if single and len(series) > 1:
        read += [
            (misses[k, i] - given[i], k, (i,))
            for k in range(len(readings))
            for i in range(len(series))
        ]

    nearest = [one for one in sorted(read, key=lambda one: one[0]) if one[0] < _ABOUT * len(one[2])]

    # A mirror image may explain touches to the last digit, and other readings come closer by
    # chance.
    mirrored = [
        one
        for one in nearest[_SCREENED:]
        if readings[one[1]].mirrored and len(one[2]) == len(series)
    ]

    # Those worth it are fitted.
    own, out = log_evidence(found, series), []
    for _, k, chosen in (*nearest[:_SCREENED], *mirrored):
        one = readings[k]

        meant = [one.change(q) if i in chosen else q for i, q in enumerate(series)]
        try:
            other = again(meant, distances=told.distances, method=BRIEF)
        except ConfigurationError:
            continue

        where = f" of {told.names[chosen[0]]}" if len(chosen) < len(series) else ""
        odds = log_evidence(other, meant) - own - np.log(len(read))
        out.append(
            Rival(
                reading=one,
                doubt=Doubt(reason=f"{one.text}{where} explains the touches better", log_odds=odds),
            )
        )

    return out


def _miss(arm: SerialArm, q: Array) -> float:
    """Log median distance of the touches `q` (m, n) from their point, by the nominal arm."""
    p = arm.tips(q, first_tcp(arm, [q]))
    return float(np.log(np.median(np.linalg.norm(p - p.mean(axis=0), axis=1)) + HAND_NOISE))


def _readings(arm: SerialArm, first: int) -> Iterator[ColumnReading]:
    """Other readings of joint values (m, n) of the joints from `first` on."""
    n, hinges = arm.n, ~arm.slides
    own = np.arange(n) >= first

    for i, j in combinations(range(first, n), 2):
        if hinges[i] == hinges[j]:
            order = np.arange(n)
            order[[i, j]] = j, i
            text = f"columns {i + 1 - first} and {j + 1 - first} exchanged"
            yield ColumnReading(
                text=text, change=partial(np.take, indices=order, axis=1), joints=(i, j)
            )

    for text, factor in ((_SIGN, -1.0), *_UNITS):
        turned = own & (hinges | (factor < 0.0))
        change = partial(np.multiply, np.where(turned, factor, 1.0))
        yield ColumnReading(
            text=f"all joints {text}", change=change, joints=(), mirrored=factor < 0.0
        )

        for k in np.flatnonzero(turned):
            change = partial(np.multiply, np.where(np.arange(n) == k, factor, 1.0))
            yield ColumnReading(
                text=f"joint {k + 1 - first} {text}", change=change, joints=(int(k),)
            )


# Readings of one joint


@dataclass(frozen=True, kw_only=True)
class HiddenJoint:
    """A joint whose readings are lost in the noise, or nearly."""

    joint: int  # from 0
    lever: float  # [m] RMS distance of the tip from its axis
    doubt: Doubt  # some or all readings unknown, against those given
    log_any: float  # logarithm of the odds of any other readings against those given

    @property
    def told(self) -> bool:
        """Whether the touches tell the readings given from any others."""
        return self.log_any < -np.log(REFUSED)


def hidden_joints(
    found: Calibration, series: Sequence[Array], again: Again, told: Told
) -> Iterator[HiddenJoint]:
    """Hinges whose axis is close to the tip, and the odds that their readings are of other touches.

    Args:
        found: the calibration.
        series: touches (m_i, n) that it is from.
        again: the same identification from other touches.
        told: names of the points, known distances, joints of a moving base.
    """
    for k in range(told.base_joints, found.arm.n):
        if found.arm.slides[k]:
            continue

        lever = float(np.sqrt((_by_joint(found, series, k) ** 2).sum(axis=1).mean()))
        if lever < min(_HIDDEN * found.noise, _CLOSE * found.nominal.reach):
            yield _with_unknown_readings(found, series, again, told, k, lever)


def _by_joint(found: Calibration, series: Sequence[Array], k: int) -> Array:
    """Derivatives (M, 3) of all tips by the reading of joint k."""
    J = found.arm.tips_and_jacobian(np.ascontiguousarray(np.vstack(series)), found.tcp)[1]
    return J[:, ROW * k + (D if found.arm.slides[k] else THETA)]


def _with_unknown_readings(
    found: Calibration, series: Sequence[Array], again: Again, told: Told, k: int, lever: float
) -> HiddenJoint:
    """Joint k fitted in turn with the arm, by readings that bring each touch closest to its point.

    The first fits replace all readings, which finds the arm without them; the others those that it
    finds unlikely. Where the joint stood still for some touches, those are replaced: its reading
    may have frozen.
    """
    own, seen, frozen = (
        log_evidence(found, series),
        found,
        np.concatenate([repeated(q[:, k]) for q in series]),
    )

    some, every, noise = -np.inf, -np.inf, found.noise
    for turn in range(_ROUNDS):
        given, unknown = _log_likely_readings(seen, series, k)
        made = log_made(seen)
        every = max(every, freedom(series) * float(unknown.sum()) + made)

        # Evidence with shares of the readings unknown, or with those that froze.
        mixed = [
            np.logaddexp(given + np.log1p(-share), unknown + np.log(share)).sum()
            for share in _UNKNOWN
        ]
        mixed.append(np.where(frozen, unknown, given).sum())
        value = freedom(series) * float(np.logaddexp.reduce(mixed) - np.log(len(mixed))) + made

        if value > some:
            some, noise = value, seen.noise

        # The least likely readings are replaced, and the arm is fitted to these.
        unlikely = frozen if frozen.any() else (unknown > given) | (turn < _ALL_REPLACED)
        replaced = np.split(unlikely, np.cumsum([len(q) for q in series])[:-1])
        read = [
            np.where(mine[:, None], _nearest(seen, q, point, k), q)
            for q, point, mine in zip(series, seen.points, replaced, strict=True)
        ]

        try:
            seen = again(read, distances=told.distances, method=BRIEF)
        except ConfigurationError:
            break

    name, joints = f"joint {k + 1 - told.base_joints}", np.log(found.arm.n - told.base_joints)
    return HiddenJoint(
        joint=k,
        lever=lever,
        doubt=Doubt(
            reason=f"the readings of {name} are not those of these touches: with them the touches "
            f"scatter by {1e3 * found.noise:.3g} mm, with others about its axis by "
            f"{1e3 * noise:.3g} mm",
            log_odds=some - own - joints,
        ),
        log_any=every - own,
    )


def repeated(read: Array) -> np.ndarray:
    """Mask (m,) of readings in a run of exact repeats, `_LEAST_FROZEN` of them at least."""
    run = np.cumsum(np.concatenate([[True], np.diff(read) != 0.0]))
    return np.bincount(run)[run] >= _LEAST_FROZEN


def _log_likely_readings(seen: Calibration, series: Sequence[Array], k: int) -> tuple[Array, Array]:
    """Log likelihoods (M,) of the touches with the readings of joint k, and with any of it."""
    motion = motion_of(seen.arm, seen.tcp, series)
    pairs = list(zip(series, seen.points, strict=True))

    given = [((seen.arm.tips(q, seen.tcp) - point) ** 2).sum(axis=1) for q, point in pairs]
    likely = np.concatenate(
        [log_likely(_squares(seen, q, point, k), motion) for q, point in pairs], axis=1
    )

    unknown = np.logaddexp.reduce(likely, axis=0) - np.log(len(_ANGLES))
    return log_likely(np.concatenate(given), motion), unknown


def _squares(seen: Calibration, q: Array, point: Array, k: int) -> Array:
    """Squared distances (A, m) [m^2] of the touches from `point` (3,), joint k at every angle."""
    turned = np.tile(q, (len(_ANGLES), 1))
    turned[:, k] += np.repeat(_ANGLES, len(q))
    return (
        ((seen.arm.tips(turned, seen.tcp) - point) ** 2).sum(axis=1).reshape(len(_ANGLES), len(q))
    )


def _nearest(seen: Calibration, q: Array, point: Array, k: int) -> Array:
    """The touches `q` (m, n) with joint k turned for each tip closest to `point` (3,) [m]."""
    out = np.array(q)
    out[:, k] += _ANGLES[_squares(seen, q, point, k).argmin(axis=0)]
    out[:, k] = (out[:, k] + np.pi) % (2.0 * np.pi) - np.pi
    return out


# Readings that froze


def frozen_readings(found: Calibration, series: Sequence[Array], told: Told) -> Iterator[Doubt]:
    """Joints that read the same for touches which the fit left out, as blunders hardly do."""
    left_out = np.concatenate([weights == 0.0 for weights in found.weights])

    for k in range(told.base_joints, found.arm.n):
        same = np.concatenate([repeated(q[:, k]) for q in series])
        lost = int((same & left_out).sum())

        if lost:
            yield Doubt(
                reason=f"joint {k + 1 - told.base_joints} reads the same in {same.sum()} touches, "
                f"of which {lost} do not belong to their points: its reading froze",
                log_odds=-lost * np.log(same.mean()) - np.log(found.arm.n - told.base_joints),
            )


# Shifted readings


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shift:
    """Readings of joint k that are larger by an offset in some of the touches."""

    joint: int
    rows: np.ndarray  # (M,) mask of all touches
    where: str


def shifted_readings(
    found: Calibration, series: Sequence[Array], again: Again, told: Told
) -> Iterator[Doubt]:
    """The shift of one joint, in one file or from some touch on, that explains the touches best.

    The evidence of the linearised touches chooses it; the arm is then fitted to the touches without
    it.
    """
    shifts = list(_shifts(found, series, told))
    if not shifts:
        return

    # The best shift by the linearised touches.
    odds, sizes, occam = _linear_odds(found, series, shifts)
    best = int(odds.argmax())
    if odds[best] < 0.0:
        return
    size, shift, seen = float(sizes[best]), shifts[best], found

    # Its size in turn with the arm, while the evidence rises.
    own, value, settled = log_evidence(found, series), -np.inf, size
    for _ in range(_ROUNDS):
        meant = _without(series, shift, size)
        try:
            seen = again(meant, distances=told.distances, method=BRIEF)
        except ConfigurationError:
            break

        if (reached := log_evidence(seen, meant)) <= value:
            break
        value, settled = reached, size
        size += float(_linear_odds(seen, meant, [shift])[1][0])

    if abs(settled) < _GEARS:
        return
    amount = (
        f"{1e3 * settled:+.3g} mm"
        if found.arm.slides[shift.joint]
        else f"{np.rad2deg(settled):+.3g} deg"
    )

    yield Doubt(
        reason=f"joint {shift.joint + 1 - told.base_joints} reads {amount} off {shift.where} "
        "against the other touches: its zero was set again, or it slipped",
        log_odds=value - own - float(occam[best]) - np.log(len(shifts)),
    )


def _shifts(found: Calibration, series: Sequence[Array], told: Told) -> Iterator[_Shift]:
    """Shifts that are tried: each joint in each file, and from some touch on."""
    counts = [len(q) for q in series]
    rows, ends = np.arange(sum(counts)), np.cumsum(counts)
    parts = []

    for start in np.unique(
        np.linspace(_LEAST_RUN, len(rows) - _LEAST_RUN, _MOST_SPLITS).astype(int)
    ):
        i = int(np.searchsorted(ends, start, side="right"))
        first, name = start - (ends[i] - counts[i]) + 1, told.names[i]
        parts.append((rows >= start, f"from touch {first} of {name} on"))

        if i < len(series) - 1 and start <= ends[i] - _LEAST_RUN:
            parts.append(
                ((rows >= start) & (rows < ends[i]), f"from touch {first} of {name} to its last")
            )

    if len(series) > 1:
        parts += [
            ((rows >= end - count) & (rows < end), f"in {name}")
            for end, count, name in zip(ends, counts, told.names, strict=True)
        ]

    for k in range(told.base_joints, found.arm.n):
        yield from (_Shift(joint=k, rows=mine, where=where) for mine, where in parts)


def _without(series: Sequence[Array], shift: _Shift, size: float) -> list[Array]:
    """The touches with `size` taken from the shifted readings."""
    every = np.vstack(series)
    every[shift.rows, shift.joint] -= size
    return np.split(every, np.cumsum([len(q) for q in series])[:-1])


def _linear_odds(
    found: Calibration, series: Sequence[Array], shifts: Sequence[_Shift]
) -> tuple[Array, Array, Array]:
    """Linearised touches with each of C shifts, the noise unknown.

    Touches that the fit left out count as well: they may be those of a shift.

    Returns:
        Logarithms (C,) of the odds against no shift, sizes (C,), and what a shift of unknown size
        costs (C,).
    """
    counts = np.array([len(q) for q in series])
    owner = np.repeat(np.arange(len(series)), counts)

    def rows(values: Array) -> Array:
        """Values (M, ..., 3) less their mean in each series, in standard deviations of a touch."""
        means = np.zeros((len(series), *values.shape[1:]))
        np.add.at(means, owner, values)
        means /= counts.reshape(-1, *(1,) * (values.ndim - 1))
        return (values - means[owner]) / found.noise

    # Residuals less what the parameters explain.
    J = found.arm.tips_and_jacobian(np.ascontiguousarray(np.vstack(series)), found.tcp)[1]
    J = np.concatenate([J, np.zeros((len(J), found.arm.n, 3))], axis=1)
    A = rows(J[:, found.estimate.parameters.index]).transpose(0, 2, 1).reshape(3 * len(J), -1)
    r = rows(np.vstack(found.touched_tips(series))).ravel()
    covariance = np.linalg.inv(A.T @ A + np.diag(found.estimate.prior**-2.0))
    r -= A @ (covariance @ (A.T @ r))

    moved = [_by_joint(found, series, k) for k in range(found.arm.n)]
    V = np.array([rows(moved[each.joint] * each.rows[:, None]).ravel() for each in shifts])

    # Size and evidence of each shift.
    toward, crossed = V @ r, V @ A
    informed = np.maximum(
        (V**2).sum(axis=1) - np.einsum("cp,pr,cr->c", crossed, covariance, crossed), 0.0
    )

    sizes = toward / (informed + _WRONG_ZERO**-2.0)
    explained = np.clip(toward * sizes / max(float(r @ r), 1e-12), 0.0, 0.999)
    occam = 0.5 * np.log1p(_WRONG_ZERO**2 * informed)

    return (
        -0.5 * found.degrees_of_freedom * np.log1p(-explained) - occam - np.log(len(shifts)),
        sizes,
        occam,
    )
