"""Wrong inputs of a calibration: what happens to touch files, tables and lengths, as a table of
kinds.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from uuv.calib.arm_files import ArmSource
from uuv.models.arms import published_arms
from uuv.models.arms.kinematics import ALPHA, THETA
from uuv.sim.interfaces.spatial import Array

Distance = tuple[str, str, float]  # point, point, length [m]
# joint values (m, n) of a file -> as they are given
Change = Callable[[Array, np.random.Generator], Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class Input:
    """What a calibration is given."""

    source: ArmSource  # nominal arm
    series: tuple[Array, ...]  # (m_i, n) [rad] or [m], of the points p0, p1, ...
    distances: tuple[Distance, ...]
    units: str = "auto"


# None: this arm has nothing that can be wrong so
Kind = Callable[[Input, np.random.Generator], Input | None]

# How a file changes


def _files(
    change: Change, *, which: slice = slice(None), units: str = "auto", lengths: bool = True
) -> Kind:
    """The files `which` changed, the others as they are."""

    def spoil(touches: Input, rng: np.random.Generator) -> Input:
        series = [np.array(q) for q in touches.series]
        for i in range(len(series))[which]:
            series[i] = change(series[i], rng)
        return replace(
            touches,
            series=tuple(series),
            units=units,
            distances=touches.distances if lengths else (),
        )

    return spoil


def _column(k: int, change: Change) -> Change:
    """Column k of a file changed."""

    def spoil(q: Array, rng: np.random.Generator) -> Array:
        out = np.array(q)
        out[:, k] = change(q[:, k], rng)
        return out

    return spoil


def _rows(share: float, change: Change) -> Change:
    """Every so many rows changed, so that `share` of the file is."""

    def spoil(q: Array, rng: np.random.Generator) -> Array:
        out = np.array(q)
        rows = slice(1, None, round(1.0 / share))
        out[rows] = change(q[rows], rng)
        return out

    return spoil


def _order(*order: int) -> Change:
    """Columns in another order, counted from the end where negative."""

    def spoil(q: Array, _: np.random.Generator) -> Array:
        whole = np.arange(q.shape[1])
        a, b = order
        whole[[a, b]] = whole[[b, a]]
        return q[:, whole]

    return spoil


def _times(factor: float) -> Change:
    return lambda q, _: factor * q


def _plus(degrees: float) -> Change:
    return lambda q, _: q + np.deg2rad(degrees)


def _shuffled(q: Array, rng: np.random.Generator) -> Array:
    return rng.permutation(q)


def _late(share: float) -> Change:
    """Readings that lag by a share of a row."""
    return lambda q, _: (1.0 - share) * q + share * np.roll(q, 1, axis=0)


def _frozen(q: Array, _: np.random.Generator) -> Array:
    """The middle third reads the same."""
    out = np.array(q)
    third = len(q) // 3
    out[third : 2 * third] = out[third]
    return out


def _from_the_middle(change: Change) -> Change:
    """The second half changed."""
    return lambda q, rng: np.concatenate([q[: len(q) // 2], change(q[len(q) // 2 :], rng)])


def _turned_once(q: Array, _: np.random.Generator) -> Array:
    """A turn more or less, towards zero."""
    return q - 2.0 * np.pi * np.sign(q)


def _jittered(size: float) -> Change:
    return lambda q, rng: q + size * rng.standard_normal(q.shape)


def _three_postures(size: float) -> Change:
    return lambda q, rng: _jittered(size)(np.vstack([q[:3]] * 10), rng)


def _each_row_shuffled(q: Array, rng: np.random.Generator) -> Array:
    return rng.permuted(q, axis=1)


def _drawn(q: Array, rng: np.random.Generator) -> Array:
    return rng.uniform(q.min(axis=0), q.max(axis=0), q.shape)


def _straight(q: Array, _: np.random.Generator) -> Array:
    return q[0] + np.linspace(0.0, 1.0, len(q))[:, None] * (q[1] - q[0])


def _of_another_arm(q: Array, rng: np.random.Generator) -> Array:
    """The same postures by the zeros of another arm."""
    return q + 0.05 * rng.standard_normal(q.shape[1])


# How the files belong together


def _together(touches: Input, _: np.random.Generator) -> Input:
    return replace(
        touches, series=(np.vstack(touches.series[:2]), *touches.series[2:]), distances=()
    )


def _one_of_two(touches: Input, _: np.random.Generator) -> Input:
    return replace(touches, series=(np.vstack(touches.series[:2]),), distances=())


def _twice(size: float) -> Kind:
    def spoil(touches: Input, rng: np.random.Generator) -> Input:
        first = touches.series[0]
        return replace(
            touches, series=(first, _jittered(size)(first, rng), *touches.series[2:]), distances=()
        )

    return spoil


def _exchanged(share: float) -> Kind:
    """A share of the rows of two files exchanged."""

    def spoil(touches: Input, _: np.random.Generator) -> Input:
        a, b = (np.array(q) for q in touches.series[:2])
        rows = np.arange(1, min(len(a), len(b)), round(1.0 / share))
        a[rows], b[rows] = touches.series[1][rows], touches.series[0][rows]
        return replace(touches, series=(a, b, *touches.series[2:]))

    return spoil


def _repeated_elsewhere(touches: Input, _: np.random.Generator) -> Input:
    """A third of a file in another one too."""
    a, b = touches.series[:2]
    return replace(touches, series=(a, np.vstack([b, a[::3]]), *touches.series[2:]))


def _tip_poses(touches: Input, _: np.random.Generator) -> Input | None:
    """Positions and angles of the flange in place of joint values."""
    arm = touches.source.arm
    if arm.n < 6 or arm.slides.any():
        return None

    def pose_of(q: Array) -> Array:
        X = arm.flange(q)
        angles = np.column_stack(
            [
                np.arctan2(X[:, 2, 1], X[:, 2, 2]),
                np.arcsin(np.clip(-X[:, 2, 0], -1.0, 1.0)),
                np.arctan2(X[:, 1, 0], X[:, 0, 0]),
            ]
        )
        return np.column_stack([X[:, :3, 3], angles, *[np.zeros(len(q))] * (arm.n - 6)])

    return replace(touches, series=tuple(pose_of(q) for q in touches.series))


# Lengths and tables


def _lengths(factor: float) -> Kind:
    return lambda touches, _: replace(
        touches,
        distances=tuple((a, b, min(factor * length, 999.0)) for a, b, length in touches.distances),
    )


def _other_pair(touches: Input, _: np.random.Generator) -> Input | None:
    if len(touches.series) < 3:
        return None
    pairs = [({"p0", "p1", "p2"} - {a, b}, b, length) for a, b, length in touches.distances]
    return replace(touches, distances=tuple((*third, b, length) for third, b, length in pairs))


def _with_table(touches: Input, table: Array, *, lengths: float = 1.0, known: bool = True) -> Input:
    arm = touches.source.arm.with_table(table)
    X = np.array(arm.X_n_flange)
    X[:3, 3] *= lengths
    arm = replace(arm, X_n_flange=X)
    return replace(
        touches,
        source=replace(touches.source, arm=arm),
        distances=touches.distances if known else (),
    )


def _table_times(factor: float, *, known: bool = False) -> Kind:
    def spoil(touches: Input, _: np.random.Generator) -> Input:
        table = np.array(touches.source.arm.table)
        table[:, THETA + 1 : ALPHA] *= factor
        return _with_table(touches, table, lengths=factor, known=known)

    return spoil


def _longest_link(touches: Input, _: np.random.Generator) -> Input:
    """The longest link 5 % too long."""
    table = np.array(touches.source.arm.table)
    lengths = table[1:-1, THETA + 1 : ALPHA]
    lengths[np.unravel_index(np.abs(lengths).argmax(), lengths.shape)] *= 1.05
    return _with_table(touches, table)


def _alpha_sign(touches: Input, _: np.random.Generator) -> Input:
    """An axis that points the other way."""
    table = np.array(touches.source.arm.table)
    square = np.flatnonzero(np.abs(table[:-1, ALPHA]) > 0.3)
    table[square[min(1, len(square) - 1)], ALPHA] *= -1.0
    return _with_table(touches, table)


OTHER_ARMS = {
    "panda": "iiwa7",
    "gen3": "panda",
    "iiwa7": "panda",
    "xarm7": "panda",
    "ur10e": "ur5",
    "ur5": "ur10e",
    "irb140": "puma560",
    "jaco": "irb140",
    "general6r": "puma560",
}


def _other_arm(touches: Input, _: np.random.Generator) -> Input | None:
    name = OTHER_ARMS.get(touches.source.path.name)
    if name is None:
        return None
    return replace(touches, source=replace(touches.source, arm=published_arms.load(name)))


def _flipped(k: int) -> Kind:
    flip = _files(_column(k, _times(-1.0)))
    return lambda touches, rng: flip(touches, rng) if k < touches.source.arm.n else None


WRONG: dict[str, Kind] = {
    "two sockets in one file": _together,
    "two sockets in the only file": _one_of_two,
    "the same file twice": _twice(0.0),
    "the same file twice, jittered": _twice(1e-6),
    "half of the rows of two files exchanged": _exchanged(0.5),
    "a tenth of the rows of two files exchanged": _exchanged(0.1),
    "rows repeated in another file": _repeated_elsewhere,
    "columns 1 and 2 exchanged": _files(_order(0, 1)),
    "last two columns exchanged": _files(_order(-2, -1)),
    "columns 3 and 5 exchanged": _files(_order(2, 4)),
    "columns 2 and 3 exchanged in one file": _files(_order(1, 2), which=slice(1)),
    "columns reversed": _files(lambda q, _: q[:, ::-1]),
    "radians read as degrees": _files(_times(1.0), units="deg"),
    "degrees read as radians": _files(_times(180.0 / np.pi), units="rad"),
    "a column in degrees": _files(_column(3, _times(180.0 / np.pi)), units="rad"),
    "a column in degrees in a tenth of the rows": _files(
        _rows(0.1, _column(3, _times(180.0 / np.pi))), units="rad"
    ),
    "a column turned to radians twice": _files(_column(3, _times(np.pi / 180.0)), units="rad"),
    "a column turned to radians twice in a third of the rows": _files(
        _rows(1 / 3, _column(1, _times(np.pi / 180.0))), units="rad"
    ),
    "last column turned to radians twice in a third of the rows": _files(
        _rows(1 / 3, _column(-1, _times(np.pi / 180.0))), units="rad"
    ),
    "a file turned to radians twice": _files(
        _times(np.pi / 180.0), which=slice(-1, None), units="rad"
    ),
    **{f"sign of joint {k + 1}": _flipped(k) for k in range(7)},
    "signs of all joints": _files(_times(-1.0)),
    "columns shuffled in each row": _files(_each_row_shuffled),
    "column 3 shuffled": _files(_column(2, _shuffled)),
    "last column shuffled": _files(_column(-1, _shuffled)),
    "last column shuffled in one file": _files(_column(-1, _shuffled), which=slice(1)),
    "column 2 a row late": _files(_column(1, _late(1.0))),
    "last column a row late": _files(_column(-1, _late(1.0))),
    "two columns half a row late": _files(
        lambda q, rng: _column(1, _late(0.5))(_column(-1, _late(0.5))(q, rng), rng)
    ),
    "last two columns a tenth of a row late": _files(
        lambda q, rng: _column(-2, _late(0.1))(_column(-1, _late(0.1))(q, rng), rng)
    ),
    "three postures repeated": _files(_three_postures(0.0)),
    "three postures repeated, jittered": _files(_three_postures(2e-5)),
    "column 3 stands still": _files(_column(2, lambda q, _: np.full_like(q, q[0]))),
    "column 4 is zero": _files(_column(3, _times(0.0))),
    "joint 3 frozen for a third": _files(_column(2, _frozen)),
    "last joint frozen for a third": _files(_column(-1, _frozen)),
    "joint 3 off by 5 degrees in one file": _files(_column(2, _plus(5.0)), which=slice(1)),
    "joint 2 off by 2 degrees in one file": _files(_column(1, _plus(2.0)), which=slice(1)),
    "joint 5 slips by 3 degrees within a file": _files(
        _column(4, _from_the_middle(_plus(3.0))), which=slice(1)
    ),
    "last joint off by 40 degrees in one file": _files(_column(-1, _plus(40.0)), which=slice(1)),
    "zero of joint 3 off by 90 degrees": _files(_column(2, _plus(90.0))),
    "zero of joint 2 off by 10 degrees": _files(_column(1, _plus(10.0))),
    "a turn more or less in some rows": _files(_rows(0.2, _column(3, _turned_once))),
    "a tenth of the rows of another arm": _files(_rows(0.1, _of_another_arm)),
    "random rows": _files(_drawn),
    "a straight motion": _files(_straight),
    "velocities": _files(lambda q, _: np.diff(q, axis=0)),
    "one decimal": _files(lambda q, _: np.round(q, 1)),
    "poses of the flange": _tip_poses,
    "known length 4 % too long": _lengths(1.04),
    "known length 4 % too short": _lengths(0.96),
    "known length 10 % too long": _lengths(1.1),
    "known length in millimetres": _lengths(1e3),
    "known length in centimetres for millimetres": _lengths(0.1),
    "known length of another pair": _other_pair,
    "table in millimetres for metres": _table_times(1e3),
    "table in metres for millimetres": _table_times(1e-3),
    "table in inches": _table_times(39.37, known=True),
    "table of another arm": _other_arm,
    "longest link 5 % too long": _longest_link,
    "an axis of the table the other way": _alpha_sign,
}
