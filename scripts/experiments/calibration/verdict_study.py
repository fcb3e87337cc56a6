"""Study of the verdict on a calibration: wrong inputs of every kind, and right ones, of real and
simulated arms.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.calibration.wrong_inputs import WRONG, Distance, Input
from uuv.arm_identification.calibration_case import from_files, nominal
from uuv.arm_identification.calibration_outcome import CalibrationOutcome, failed, solve
from uuv.arm_identification.simulated_touches import simulated
from uuv.calib.simulation import HAND_NOISE
from uuv.calib.touch_files import read_touches, write_touches
from uuv.calib.verification import kabsch
from uuv.experiment import Row, Summary, Table
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.spatial import Array, transform_points

ARMS = (
    "panda",
    "gen3",
    "iiwa7",
    "xarm7",
    "ur10e",
    "ur5",
    "irb140",
    "jaco",
    "general6r",
    "stanford",
)
# [m] RMS of moves of the flange by which arms from a wrong and a right file differ at most
AS_RIGHT = 3e-4
_MOVES = 60  # postures at which two arms are compared
_RIGHT_LENGTHS = {"right": 1.0, "right, length 0.2 % off": 1.002, "right, no length": None}
_MIRRORED, _MIRROR = "signs of all joints", "mirror image"
# of lines on readings that are hidden
_HIDDEN = ("explain nothing", "are not those of these touches")


@dataclass(frozen=True)
class Source:
    """Touches that are right: of a simulated arm, or of a real one in a folder."""

    arm: str  # published arm
    seed: int = 0  # of a simulated arm
    pin: str = "off-axis"
    folder: str = ""  # of a real arm, in it one folder a position
    length: float = 0.05  # [m] between the sockets of a position

    @property
    def name(self) -> str:
        """Short name for tables."""
        return Path(self.folder).name if self.folder else f"{self.arm} {self.seed}, {self.pin} pin"


@dataclass(frozen=True)
class VerdictCase:
    """One calibration: a wrong input of a kind, or a right one."""

    source: Source
    kind: str  # of WRONG, or right
    positions: tuple[str, ...] = ()  # of a real arm; empty: the first
    held_out: tuple[str, ...] = ()


def cases(
    arms: int, right_arms: int, seed: int, folders: Iterable[Path], real_arm: str
) -> Iterator[VerdictCase]:
    """Cases of wrong inputs of `arms` simulated arms and all real ones, and of right inputs.

    Raises:
        ConfigurationError: a folder of a real arm has fewer than two positions.
    """
    drawn = [
        Source(ARMS[k % len(ARMS)], seed + k, "straight" if k % 2 else "off-axis")
        for k in range(max(arms, right_arms))
    ]
    real = [Source(real_arm, folder=str(folder)) for folder in folders]
    for source in drawn[:right_arms]:
        yield from (VerdictCase(source, kind) for kind in _RIGHT_LENGTHS)
    for source in real:
        names = _positions(source)
        yield VerdictCase(source, "right", names)
        for name in names:
            rest = tuple(other for other in names if other != name)
            yield VerdictCase(source, "right", rest, (name,))
            yield VerdictCase(source, "right", (name,), rest)
            yield VerdictCase(source, "right, length 0.2 % off", (name,))
    for source in (*real, *drawn[:arms]):
        yield from (VerdictCase(source, kind) for kind in WRONG)


def _positions(source: Source) -> tuple[str, ...]:
    folder = Path(source.folder)
    names = (
        tuple(each.name for each in sorted(folder.iterdir()) if each.is_dir())
        if folder.is_dir()
        else ()
    )
    if len(names) < 2:
        raise ConfigurationError(
            f"--real {folder}: at least two folders of touches are needed, got {len(names)}"
        )
    return names


def _central(source: Source) -> tuple[str, ...]:
    """The position of a real arm that wrong inputs are made of: the front one in the middle, else
    the first.
    """
    names = _positions(source)
    return next(((name,) for name in names if "front" in name and "cent" in name), names[:1])


@lru_cache(maxsize=4)
def _right(source: Source, positions: tuple[str, ...]) -> Input:
    """What was touched, as it is."""
    nominal_arm = nominal(source.arm, Path(), None, None)
    if not source.folder:
        rng = np.random.default_rng(source.seed)
        drawn = simulated(
            nominal_arm,
            points=3,
            touches=21,
            noise=HAND_NOISE,
            pin=source.pin,
            known=True,
            errors=source.seed,
            rng=rng,
        )
        pairs = tuple((f"p{i}", f"p{j}", length) for i, j, length, _ in drawn.distances)
        return Input(source=nominal_arm, series=drawn.touches.series, distances=pairs)
    series: list[Array] = []
    pairs = []
    for position in positions or _central(source):
        files = [
            each
            for each in sorted((Path(source.folder) / position).glob("*.csv"))
            if "pose" not in each.stem
        ]
        sockets = read_touches(files, joint_types=nominal_arm.arm.joint_types).series
        pairs += [
            (f"p{len(series) + k}", f"p{len(series) + k + 1}", source.length)
            for k in range(len(sockets) - 1)
        ]
        series += sockets
    return Input(source=nominal_arm, series=tuple(series), distances=tuple(pairs))


def _calibrated(given: Input, held_out: tuple[Array, ...] = ()) -> CalibrationOutcome:
    """The calibration from files that hold `given`."""
    names = [f"p{k}" for k in range(len(given.series))]
    pairs: list[Distance] = [pair for pair in given.distances if {*pair[:2]} <= {*names}]
    with TemporaryDirectory() as folder:
        files, rest = Path(folder) / "touches", Path(folder) / "held_out"
        joints = [f"joint{k + 1}" for k in range(given.series[0].shape[1])]
        write_touches(files, names, given.series, joints)
        if held_out:
            write_touches(rest, [f"h{k}" for k in range(len(held_out))], held_out, joints)
        units = "deg" if given.units == "deg" else "rad" if given.units == "rad" else "auto"
        case = from_files(given.source, [files], [rest] if held_out else [], units, pairs)
        return solve(case, free=(), prior={}, method="map")


@lru_cache(maxsize=4)
def _arm_of_right(source: Source) -> SerialArm:
    return _calibrated(_right(source, ())).calibration.arm


def verdict_of(case: VerdictCase) -> Row:
    """Row of a case: the verdict, and how far the arm is from that of the right file.

    No row where nothing is wrong.
    """
    given: Input | None = _right(case.source, case.positions)
    if case.kind in WRONG:
        given = WRONG[case.kind](given, np.random.default_rng(3))
    elif (factor := _RIGHT_LENGTHS[case.kind]) != 1.0:
        lengths = given.distances if factor else ()
        given = replace(
            given, distances=tuple((a, b, (factor or 1.0) * length) for a, b, length in lengths)
        )
    row: Row = {
        "source": case.source.name,
        "kind": case.kind,
        "positions": " ".join(case.positions),
        "held_out": len(case.held_out),
        "wrong": case.kind in WRONG,
        "given": given is not None,
    }
    if given is None:
        return row
    held = _right(case.source, case.held_out).series if case.held_out else ()
    try:
        outcome = _calibrated(given, held)
    except UuvError as error:
        return {**row, "reasons": [str(error)], "untold": [], "off_m": None}
    reasons = failed(outcome, "map")
    off = None
    if case.kind in WRONG and not reasons:
        q = np.vstack(_right(case.source, ()).series)
        off = _apart(_arm_of_right(case.source), outcome.calibration.arm, q)
    return {**row, "reasons": reasons, "untold": list(outcome.examined.untold), "off_m": off}


def _apart(arm: SerialArm, other: SerialArm, touched: Array) -> float:
    """RMS difference [m] of moves of the flange over the joint ranges that were touched."""
    q = np.random.default_rng(5).uniform(
        touched.min(axis=0), touched.max(axis=0), (_MOVES, touched.shape[1])
    )
    mine, theirs = (each.tips(q, np.zeros(3)) for each in (arm, other))
    off = mine - transform_points(kabsch(theirs, mine), theirs)
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def outcome_of(row: Row) -> str:
    """How a wrong input ended: refused, or accepted with the right arm, with what was said, or
    wrongly.
    """
    if row["reasons"]:
        return "refused"
    if row["off_m"] < AS_RIGHT:
        return "the arm is right"
    words = (_MIRROR,) if row["kind"] == _MIRRORED else _HIDDEN
    return (
        "said"
        if any(word in line for word in words for line in row["untold"])
        else "accepted wrongly"
    )


def summarise(rows: list[Row]) -> Summary:
    """Counts of each kind, and the right inputs that were refused."""
    wrong = [row for row in rows if row["wrong"] and row["given"]]
    right = [row for row in rows if not row["wrong"]]
    ends = ("refused", "the arm is right", "said", "accepted wrongly")
    table = []
    for kind in dict.fromkeys(row["kind"] for row in wrong):
        mine = [row for row in wrong if row["kind"] == kind]
        counts = [sum(outcome_of(row) == end for row in mine) for end in ends]
        off = max((1e3 * row["off_m"] for row in mine if not row["reasons"]), default=np.nan)
        table.append(
            [kind, str(len(mine)), *map(str, counts), f"{off:.2f}" if np.isfinite(off) else ""]
        )
    refused = [row for row in right if row["reasons"]]
    said = [
        [row["source"], row["kind"], row["positions"], "; ".join(row["reasons"])] for row in refused
    ]
    metrics = {
        "wrong": {
            "files": len(wrong),
            **{end: sum(outcome_of(row) == end for row in wrong) for end in ends},
        },
        "right": {"files": len(right), "accepted": len(right) - len(refused)},
    }
    columns = ("wrong input", "arms", *ends, "arm off, largest of those accepted [mm]")
    tables = [Table(title="Wrong inputs", columns=columns, rows=table, labels=1)]
    counted = f"Right inputs: {len(right) - len(refused)} of {len(right)} accepted"
    tables.append(
        Table(
            title=counted, columns=("arm", "input", "positions", "refused for"), rows=said, labels=4
        )
    )
    return Summary(metrics=metrics, tables=tables)
