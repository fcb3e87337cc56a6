"""The verdict on a calibration: inputs right and wrong, how each ends, and the page of many."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.calibration.wrong_inputs import WRONG, Distance, Input
from uuv.arm_identification.calibration_case import from_files
from uuv.arm_identification.calibration_outcome import CalibrationOutcome, failed, solve
from uuv.calib.touch_files import write_touches
from uuv.calib.verification import kabsch
from uuv.experiment import Page, Row, Table, column, stat
from uuv.experiment.statistic import Record
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.spatial import Array, transform_points

# [m] RMS of moves of the flange by which arms from a wrong and a right file differ at most
AS_RIGHT = 3e-4
RIGHT_LENGTHS = {"right": 1.0, "right, length 0.2 % off": 1.002, "right, no length": None}
KINDS = (*RIGHT_LENGTHS, *WRONG)
REFUSED = "refused"
RIGHT = "the arm is right"
STATED = "stated that touches cannot tell"
WRONGLY = "accepted wrongly"
ACCEPTED = "accepted"  # a right input
ENDS = (REFUSED, RIGHT, STATED, WRONGLY)
_MOVES = 60  # postures at which two arms are compared
_MIRRORED = "signs of all joints"
_MIRROR = "mirror image"
# of lines on readings that are hidden
_HIDDEN = ("are not checked", "are not those of these touches")


@dataclass(frozen=True, kw_only=True)
class VerdictRow:
    """How the calibration of one input ends."""

    source: str = column("arm")
    wrong: bool = column("wrong input")
    # of ENDS, or accepted; None: nothing of this arm can be wrong so
    end: str | None = column("end")
    reasons: Sequence[str] = column("refused for")
    hidden: Sequence[str] = column("what touches cannot tell")
    apart: float | None = column("arm off", "mm", digits=2, factor=1e3)


def verdict_of(kind: str, source: str, right: Input, held_out: tuple[Array, ...]) -> VerdictRow:
    """Row of one input.

    Args:
        kind: Of KINDS.
        source: Name of the arm in tables.
        right: What was touched, as it is.
        held_out: Touches that are predicted.
    """
    row = VerdictRow(
        source=source, wrong=kind in WRONG, end=None, reasons=[], hidden=[], apart=None
    )
    touched = _input_of(kind, right)
    if touched is None:
        return row

    # the calibration, as a user would do it
    try:
        outcome = _calibrated(touched, held_out)
    except UuvError as error:
        return replace(row, reasons=[str(error)], end=REFUSED)
    reasons = failed(outcome, "map")
    hidden = list(outcome.examined.untold)

    if not row.wrong:
        return replace(row, reasons=reasons, hidden=hidden, end=REFUSED if reasons else ACCEPTED)

    # a wrong input that was accepted: how far its arm is from that of the right one
    apart = None
    if not reasons:
        reference = _calibrated(right).calibration.arm
        apart = _apart(reference, outcome.calibration.arm, np.vstack(right.series))
    return replace(
        row,
        reasons=reasons,
        hidden=hidden,
        apart=apart,
        end=end_of(kind, reasons, hidden, apart or 0.0),
    )


def end_of(kind: str, reasons: Sequence[str], hidden: Sequence[str], apart: float) -> str:
    """How a wrong input ended, of ENDS.

    Args:
        kind: Of WRONG.
        reasons: Why it was refused; empty: accepted.
        hidden: What the verdict says that touches cannot tell.
        apart: [m] of the arm from that of the right input.
    """
    if reasons:
        return REFUSED
    if apart < AS_RIGHT:
        return RIGHT
    words = (_MIRROR,) if kind == _MIRRORED else _HIDDEN
    return STATED if any(word in line for word in words for line in hidden) else WRONGLY


def _input_of(kind: str, right: Input) -> Input | None:
    """The input of a kind, made of a right one; None: nothing of it can be wrong so."""
    if kind in WRONG:
        return WRONG[kind](right, np.random.default_rng(3))

    factor = RIGHT_LENGTHS[kind]
    if factor is None:
        return replace(right, distances=())
    return replace(
        right, distances=tuple((a, b, factor * length) for a, b, length in right.distances)
    )


def _calibrated(touched: Input, held_out: tuple[Array, ...] = ()) -> CalibrationOutcome:
    """The calibration from files that hold an input."""
    names = [f"p{k}" for k in range(len(touched.series))]
    pairs: list[Distance] = [pair for pair in touched.distances if {*pair[:2]} <= {*names}]
    joints = [f"joint{k + 1}" for k in range(touched.series[0].shape[1])]

    with TemporaryDirectory() as folder:
        files = Path(folder) / "touches"
        rest = Path(folder) / "held_out"
        write_touches(files, names, touched.series, joints)
        if held_out:
            write_touches(rest, [f"h{k}" for k in range(len(held_out))], held_out, joints)
        units = touched.units if touched.units in ("deg", "rad") else "auto"
        case = from_files(touched.source, [files], [rest] if held_out else [], units, pairs)
        return solve(case, free=(), prior={}, method="map")


def _apart(arm: SerialArm, other: SerialArm, touched: Array) -> float:
    """RMS difference [m] of moves of the flange over the joint ranges that were touched."""
    ranges = touched.min(axis=0), touched.max(axis=0)
    q = np.random.default_rng(5).uniform(*ranges, (_MOVES, touched.shape[1]))

    p, p_other = (entry.tips(q, np.zeros(3)) for entry in (arm, other))
    off = p - transform_points(kabsch(p_other, p), p_other)
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def refused_right_inputs(rows: list[Row]) -> Table:
    """Right inputs that were refused."""
    return Table(
        title="Right inputs that were refused",
        columns=("arm", "input", "positions", "refused for"),
        rows=[
            (
                row["source"],
                row["kind"],
                " ".join(row.get("positions", ())),
                "; ".join(row["reasons"]),
            )
            for row in rows
            if not row["wrong"] and row["end"] == REFUSED
        ],
        labels=4,
    )


def _is_wrong(row: Record) -> bool:
    return row["wrong"] and row["end"] is not None


def verdict_page() -> Page:
    """Page of verdicts: ends of wrong inputs, and right ones that were refused."""
    counts = [
        stat("count", "end", "calibrated"),
        *(stat("count", lambda row, end=end: row["end"] == end, end) for end in ENDS),
    ]
    largest = stat("largest", "apart", "arm off, largest of those accepted")
    return (
        Page()
        .table("Wrong inputs", columns=[*counts, largest], where=_is_wrong)
        .share(
            lambda row: row["end"] != REFUSED,
            "right inputs accepted",
            where=lambda row: not row["wrong"],
        )
        .add(refused_right_inputs)
        .table("Wrong inputs by kind", by="kind", columns=[*counts, largest], where=_is_wrong)
    )
