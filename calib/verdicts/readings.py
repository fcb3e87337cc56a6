"""Other interpretations ("readings") of touch files, of columns or of one joint, that explain the
touches equally well.

Columns may be exchanged, have the other sign, be in another unit, or be mirrored. The readings of a
joint may be unrelated to the touches, or shifted in a part of them. If the axis of a joint passes
close to the tip, wrong readings of the joint are hidden: the fit moves the tip onto the axis and
interprets the rest as noise. Such a joint is fitted again with its reading unknown in each touch.
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

_SCREENED = 4  # number of readings of a file that are fitted, those that fit the nominal arm best
# difference of the log distance, for each point, within which a reading is fitted
_ABOUT = np.log(3.0)
_SIGN = "with the opposite sign"
_UNITS = (("in degrees", np.pi / 180.0), ("converted from degrees once too often", 180.0 / np.pi))
# ratio of the tip's distance from an axis to the noise, below which wrong readings may be hidden in
# the noise
_HIDDEN = 10.0
_CLOSE = 0.02  # the same limit as a share of the reach
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)  # [rad] grid of an unknown reading
_ROUNDS = 5  # number of fits with unknown readings, or with a shift
_ALL_REPLACED = 2  # number of these with all readings unknown
_UNKNOWN = (0.1, 0.3, 0.5, 0.9, 1.0 - 1e-9)  # shares of the readings that are assumed unknown
_WRONG_ZERO = 0.1  # [rad], [m] standard deviation of a shift of readings
_GEARS = 5e-3  # [rad], [m] error of gears and bearings, which also shifts the readings of a point
_LEAST_FROZEN = 4  # least number of consecutive touches with a frozen reading
_LEAST_RUN = 3  # least number of touches with a shift
_MOST_SPLITS = 60  # number of touches from which on a shift is tried


# Whole columns


@dataclass(frozen=True, kw_only=True)
class ColumnReading:
    """Another reading of joint values."""

    text: str
    change: Callable[[Array], Array]  # joint values (m, n) as stated -> as meant
    joints: tuple[int, ...]  # indices of series that are read differently, from 0; empty: all
    mirrored: bool = False  # True: the arm becomes its mirror image


@dataclass(frozen=True, kw_only=True)
class Rival:
    """A reading that was fitted, with its odds against the file as it is."""

    reading: ColumnReading
    doubt: Doubt


def rival_readings(
    calibration: Calibration, series: Sequence[Array], again: Again, stated: Told, single: bool
) -> list[Rival]:
    """Other readings of the files that explain the touches about as well: columns, signs, units.

    Only readings are fitted with which, for the nominal arm, the touches are about as close
    together as in the file as it is.

    Args:
        calibration: calibration from the files as they are.
        series: touches (m_i, n) of the files.
        again: function that repeats the identification with other touches.
        stated: names of the points, known distances, joints of a moving base.
        single: True: also try other readings of single files.
    """
    readings = list(_readings(calibration.nominal, stated.base_joints))

    misses = np.array(
        [[_miss(calibration.nominal, reading.change(q)) for q in series] for reading in readings]
    )
    as_read = np.array([_miss(calibration.nominal, q) for q in series])
    read = [
        (total, k, range(len(series))) for k, total in enumerate((misses - as_read).sum(axis=1))
    ]

    # A different reading of a single file.
    if single and len(series) > 1:
        read += [
            (misses[k, i] - as_read[i], k, (i,))
            for k in range(len(readings))
            for i in range(len(series))
        ]

    nearest = [
        candidate
        for candidate in sorted(read, key=lambda candidate: candidate[0])
        if candidate[0] < _ABOUT * len(candidate[2])
    ]

    # A mirror image may explain touches to the last digit, and other readings may be closer by
    # chance.
    mirrored = [
        candidate
        for candidate in nearest[_SCREENED:]
        if readings[candidate[1]].mirrored and len(candidate[2]) == len(series)
    ]

    # Readings close enough are fitted.
    evidence = log_evidence(calibration, series)
    out = []
    for _, k, chosen in (*nearest[:_SCREENED], *mirrored):
        reading = readings[k]

        meant = [reading.change(q) if i in chosen else q for i, q in enumerate(series)]
        try:
            other = again(meant, distances=stated.distances, method=BRIEF)
        except ConfigurationError:
            continue

        where = f" of {stated.names[chosen[0]]}" if len(chosen) < len(series) else ""
        odds = log_evidence(other, meant) - evidence - np.log(len(read))
        out.append(
            Rival(
                reading=reading,
                doubt=Doubt(
                    reason=f"{reading.text}{where} explains the touches better", log_odds=odds
                ),
            )
        )

    return out


def _miss(arm: SerialArm, q: Array) -> float:
    """Log median distance of the touches `q` (m, n) from their point, with the nominal arm."""
    p = arm.tips(q, first_tcp(arm, [q]))
    return float(np.log(np.median(np.linalg.norm(p - p.mean(axis=0), axis=1)) + HAND_NOISE))


def _readings(arm: SerialArm, first: int) -> Iterator[ColumnReading]:
    """Other readings of joint values (m, n) of the joints from `first` on."""
    n, hinges = arm.n, ~arm.slides
    of_arm = np.arange(n) >= first

    for i, j in combinations(range(first, n), 2):
        if hinges[i] == hinges[j]:
            order = np.arange(n)
            order[[i, j]] = j, i
            text = f"columns {i + 1 - first} and {j + 1 - first} exchanged"
            yield ColumnReading(
                text=text, change=partial(np.take, indices=order, axis=1), joints=(i, j)
            )

    for text, factor in ((_SIGN, -1.0), *_UNITS):
        turned = of_arm & (hinges | (factor < 0.0))
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
    """A joint whose readings are hidden, or nearly hidden, by the noise."""

    joint: int  # index of the joint, from 0
    lever: float  # [m] RMS distance of the tip from its axis
    doubt: Doubt  # doubt that some or all readings are unknown, against those in the file
    log_any: float  # log odds of any other readings against those in the file

    @property
    def told(self) -> bool:
        """True if the touches distinguish the readings in the file from any others."""
        return self.log_any < -np.log(REFUSED)


def hidden_joints(
    calibration: Calibration, series: Sequence[Array], again: Again, stated: Told
) -> Iterator[HiddenJoint]:
    """Hinges whose axis is close to the tip, with the odds that their readings belong to other
    touches.

    Args:
        calibration: the calibration.
        series: touches (m_i, n) from which it was computed.
        again: function that repeats the identification with other touches.
        stated: names of the points, known distances, joints of a moving base.
    """
    for k in range(stated.base_joints, calibration.arm.n):
        if calibration.arm.slides[k]:
            continue

        lever = float(np.sqrt((_by_joint(calibration, series, k) ** 2).sum(axis=1).mean()))
        if lever < min(_HIDDEN * calibration.noise, _CLOSE * calibration.nominal.reach):
            yield _with_unknown_readings(calibration, series, again, stated, k, lever)


def _by_joint(calibration: Calibration, series: Sequence[Array], k: int) -> Array:
    """Derivatives (M, 3) of all tips with respect to the reading of joint k."""
    _, J = calibration.arm.tips_and_jacobian(
        np.ascontiguousarray(np.vstack(series)), calibration.tcp
    )
    return J[:, ROW * k + (D if calibration.arm.slides[k] else THETA)]


def _with_unknown_readings(
    calibration: Calibration,
    series: Sequence[Array],
    again: Again,
    stated: Told,
    k: int,
    lever: float,
) -> HiddenJoint:
    """Fit joint k and the arm in turn, with readings of joint k that bring each touch closest to
    its point.

    The first fits replace all readings of the joint, which identifies the arm without them; later
    fits replace only readings that are unlikely with this arm. If the reading is constant for some
    touches, these readings are replaced too, since the reading may have frozen.
    """
    evidence = log_evidence(calibration, series)
    refitted = calibration
    frozen = np.concatenate([repeated(q[:, k]) for q in series])

    some = -np.inf
    every = -np.inf
    noise = calibration.noise
    for turn in range(_ROUNDS):
        as_read, unknown = _log_likely_readings(refitted, series, k)
        prior = log_made(refitted)
        every = max(every, freedom(series) * float(unknown.sum()) + prior)

        # Evidence with shares of the readings unknown, or with those that froze.
        mixed = [
            np.logaddexp(as_read + np.log1p(-share), unknown + np.log(share)).sum()
            for share in _UNKNOWN
        ]
        mixed.append(np.where(frozen, unknown, as_read).sum())
        mixture = freedom(series) * float(np.logaddexp.reduce(mixed) - np.log(len(mixed))) + prior

        if mixture > some:
            some = mixture
            noise = refitted.noise

        # The least likely readings are replaced, and the arm is fitted again.
        unlikely = frozen if frozen.any() else (unknown > as_read) | (turn < _ALL_REPLACED)
        replaced = np.split(unlikely, np.cumsum([len(q) for q in series])[:-1])
        read = [
            np.where(mine[:, None], _nearest(refitted, q, point, k), q)
            for q, point, mine in zip(series, refitted.points, replaced, strict=True)
        ]

        try:
            refitted = again(read, distances=stated.distances, method=BRIEF)
        except ConfigurationError:
            break

    name = f"joint {k + 1 - stated.base_joints}"
    joints = np.log(calibration.arm.n - stated.base_joints)
    return HiddenJoint(
        joint=k,
        lever=lever,
        doubt=Doubt(
            reason=f"the readings of {name} are not those of these touches: with them the touches "
            f"scatter by {1e3 * calibration.noise:.3g} mm, with others about its axis by "
            f"{1e3 * noise:.3g} mm",
            log_odds=some - evidence - joints,
        ),
        log_any=every - evidence,
    )


def repeated(read: Array) -> np.ndarray:
    """Mask (m,) of readings in a run of at least `_LEAST_FROZEN` exact repeats."""
    run = np.cumsum(np.concatenate([[True], np.diff(read) != 0.0]))
    return np.bincount(run)[run] >= _LEAST_FROZEN


def _log_likely_readings(
    calibration: Calibration, series: Sequence[Array], k: int
) -> tuple[Array, Array]:
    """Log likelihoods (M,) of the touches with the readings of joint k, and with an arbitrary
    reading of it.
    """
    motion = motion_of(calibration.arm, calibration.tcp, series)
    pairs = list(zip(series, calibration.points, strict=True))

    squares = [
        ((calibration.arm.tips(q, calibration.tcp) - point) ** 2).sum(axis=1) for q, point in pairs
    ]
    likely = np.concatenate(
        [log_likely(_squares(calibration, q, point, k), motion) for q, point in pairs], axis=1
    )

    unknown = np.logaddexp.reduce(likely, axis=0) - np.log(len(_ANGLES))
    return log_likely(np.concatenate(squares), motion), unknown


def _squares(calibration: Calibration, q: Array, point: Array, k: int) -> Array:
    """Squared distances (A, m) [m^2] of the touches from `point` (3,), with joint k at A angles."""
    turned = np.tile(q, (len(_ANGLES), 1))
    turned[:, k] += np.repeat(_ANGLES, len(q))
    return (
        ((calibration.arm.tips(turned, calibration.tcp) - point) ** 2)
        .sum(axis=1)
        .reshape(len(_ANGLES), len(q))
    )


def _nearest(calibration: Calibration, q: Array, point: Array, k: int) -> Array:
    """The touches `q` (m, n), with joint k turned so that each tip is closest to `point` (3,)
    [m].
    """
    out = np.array(q)
    out[:, k] += _ANGLES[_squares(calibration, q, point, k).argmin(axis=0)]
    out[:, k] = (out[:, k] + np.pi) % (2.0 * np.pi) - np.pi
    return out


# Readings that froze


def frozen_readings(
    calibration: Calibration, series: Sequence[Array], stated: Told
) -> Iterator[Doubt]:
    """Doubts about joints with the same reading in touches that the fit left out, which blunders
    hardly cause.
    """
    left_out = np.concatenate([weights == 0.0 for weights in calibration.weights])

    for k in range(stated.base_joints, calibration.arm.n):
        same = np.concatenate([repeated(q[:, k]) for q in series])
        lost = int((same & left_out).sum())

        if lost:
            yield Doubt(
                reason=(
                    f"joint {k + 1 - stated.base_joints} has the same reading in {same.sum()} "
                    f"touches, of which {lost} do not belong to their points: its reading froze"
                ),
                log_odds=-lost * np.log(same.mean())
                - np.log(calibration.arm.n - stated.base_joints),
            )


# Shifted readings


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shift:
    """Readings of joint k that are larger by an offset in some of the touches."""

    joint: int
    rows: np.ndarray  # (M,) mask of all touches
    where: str


def shifted_readings(
    calibration: Calibration, series: Sequence[Array], again: Again, stated: Told
) -> Iterator[Doubt]:
    """Doubt about a shift of one joint's readings, in one file or from some touch on, that explains
    the touches best.

    The shift is chosen by the evidence of the linearised touches; the arm is then fitted to the
    touches without the shift.
    """
    shifts = list(_shifts(calibration, series, stated))
    if not shifts:
        return

    # The best shift by the linearised touches.
    odds, sizes, occam = _linear_odds(calibration, series, shifts)
    best = int(odds.argmax())
    if odds[best] < 0.0:
        return
    size = float(sizes[best])
    shift = shifts[best]
    refitted = calibration

    # The shift and the arm are refined in turn while the evidence rises.
    evidence = log_evidence(calibration, series)
    shifted = -np.inf
    settled = size
    for _ in range(_ROUNDS):
        meant = _without(series, shift, size)
        try:
            refitted = again(meant, distances=stated.distances, method=BRIEF)
        except ConfigurationError:
            break

        if (reached := log_evidence(refitted, meant)) <= shifted:
            break
        shifted = reached
        settled = size
        size += float(_linear_odds(refitted, meant, [shift])[1][0])

    if abs(settled) < _GEARS:
        return
    amount = (
        f"{1e3 * settled:+.3g} mm"
        if calibration.arm.slides[shift.joint]
        else f"{np.rad2deg(settled):+.3g} deg"
    )

    yield Doubt(
        reason=f"joint {shift.joint + 1 - stated.base_joints} reads {amount} off {shift.where} "
        "against the other touches: its zero was set again, or it slipped",
        log_odds=shifted - evidence - float(occam[best]) - np.log(len(shifts)),
    )


def _shifts(calibration: Calibration, series: Sequence[Array], stated: Told) -> Iterator[_Shift]:
    """Shifts that are tried, for each joint in each file and from some touch on."""
    counts = [len(q) for q in series]
    rows = np.arange(sum(counts))
    ends = np.cumsum(counts)
    parts = []

    for start in np.unique(
        np.linspace(_LEAST_RUN, len(rows) - _LEAST_RUN, _MOST_SPLITS).astype(int)
    ):
        i = int(np.searchsorted(ends, start, side="right"))
        first = start - (ends[i] - counts[i]) + 1
        name = stated.names[i]
        parts.append((rows >= start, f"from touch {first} of {name} on"))

        if i < len(series) - 1 and start <= ends[i] - _LEAST_RUN:
            parts.append(
                ((rows >= start) & (rows < ends[i]), f"from touch {first} of {name} to its last")
            )

    if len(series) > 1:
        parts += [
            ((rows >= end - count) & (rows < end), f"in {name}")
            for end, count, name in zip(ends, counts, stated.names, strict=True)
        ]

    for k in range(stated.base_joints, calibration.arm.n):
        yield from (_Shift(joint=k, rows=mine, where=where) for mine, where in parts)


def _without(series: Sequence[Array], shift: _Shift, size: float) -> list[Array]:
    """The touches with `size` subtracted from the shifted readings."""
    every = np.vstack(series)
    every[shift.rows, shift.joint] -= size
    return np.split(every, np.cumsum([len(q) for q in series])[:-1])


def _linear_odds(
    calibration: Calibration, series: Sequence[Array], shifts: Sequence[_Shift]
) -> tuple[Array, Array, Array]:
    """Log odds of each of C shifts for linearised touches with unknown noise.

    Touches that the fit left out are included, since they may be those with the shift.

    Returns:
        Log odds (C,) against no shift, sizes (C,), and the penalty (C,) for the unknown size of a
            shift.
    """
    counts = np.array([len(q) for q in series])
    owner = np.repeat(np.arange(len(series)), counts)

    def rows(values: Array) -> Array:
        """Values (M, ..., 3) minus their mean in each series, in standard deviations of a touch."""
        means = np.zeros((len(series), *values.shape[1:]))
        np.add.at(means, owner, values)
        means /= counts.reshape(-1, *(1,) * (values.ndim - 1))
        return (values - means[owner]) / calibration.noise

    # Residuals without the part that the parameters explain.
    _, J = calibration.arm.tips_and_jacobian(
        np.ascontiguousarray(np.vstack(series)), calibration.tcp
    )
    J = np.concatenate([J, np.zeros((len(J), calibration.arm.n, 3))], axis=1)
    A = rows(J[:, calibration.estimate.parameters.index]).transpose(0, 2, 1).reshape(3 * len(J), -1)
    r = rows(np.vstack(calibration.touched_tips(series))).ravel()
    covariance = np.linalg.inv(A.T @ A + np.diag(calibration.estimate.prior**-2.0))
    r -= A @ (covariance @ (A.T @ r))

    moved = [_by_joint(calibration, series, k) for k in range(calibration.arm.n)]
    V = np.array([rows(moved[shift.joint] * shift.rows[:, None]).ravel() for shift in shifts])

    # Size and evidence of each shift.
    toward, crossed = V @ r, V @ A
    informed = np.maximum(
        (V**2).sum(axis=1) - np.einsum("cp,pr,cr->c", crossed, covariance, crossed), 0.0
    )

    sizes = toward / (informed + _WRONG_ZERO**-2.0)
    explained = np.clip(toward * sizes / max(float(r @ r), 1e-12), 0.0, 0.999)
    occam = 0.5 * np.log1p(_WRONG_ZERO**2 * informed)

    return (
        -0.5 * calibration.degrees_of_freedom * np.log1p(-explained) - occam - np.log(len(shifts)),
        sizes,
        occam,
    )
