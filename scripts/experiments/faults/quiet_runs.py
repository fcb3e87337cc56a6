"""Quick jobs of several vehicles in drawn seas, nothing failing: which faults are named, and what
the gyro check does.

Where a survey can, it tells the pose of the object, which halves the time of a run.

A case is run once more without the check of the gyro where the check has named a fault, and where
it is one of the `paired` cases. In all others the check has changed nothing as long as the paired
ones agree to the bit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from uuv.assembly import assemble
from uuv.check.checked_jobs import ARM_JOBS
from uuv.experiment import Row, Summary, Table
from uuv.kinds import SURVEY
from uuv.runner import run
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import FaultKind, WorkState
from uuv.sim.interfaces.spatial import one_of
from uuv.sim.interfaces.streams import Streams

CURRENT = 0.4  # [m/s] at most
GUST = 0.05  # [m/s] standard deviation per axis, at most
WAVE = 0.1  # [m/s] amplitude of the water's velocity, at most; two of three seas have waves
FREQUENCY = (0.05, 0.3)  # [Hz]

CHECKED = frozenset({FaultKind.GYRO.value, FaultKind.ATTITUDE.value})
REFUSED, DONE, LATE = "refused", "done", "not done in time"
TOUCHED = (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK)
BEFORE, AFTER = "before the contact", "in contact or later"
COLUMNS = (
    "vehicle",
    "jobs",
    "done",
    f"left {BEFORE}",
    f"left {AFTER}",
    REFUSED,
    "gyro or attitude",
    "other faults",
)

# jobs that a survey cannot tell the pose of their object
SEARCHING = frozenset({"insertion", "seabed-core"})


@dataclass(frozen=True, kw_only=True)
class Worker:
    """A vehicle, and the jobs that `uuv check` promises of it."""

    name: str
    jobs: tuple[str, ...]  # of ARM_JOBS
    options: Mapping[str, Any] = field(default_factory=dict)  # of these jobs


WORKERS = (
    Worker(
        name="uuv_puma",
        jobs=("barrel-longitudinal", "barrel-transverse", "tap", "insertion", "seabed-core"),
    ),
    Worker(name="uuv_puma_side", jobs=("pile",)),
    Worker(
        name="uuv_puma_two_sway",
        jobs=("barrel-longitudinal", "barrel-transverse", "tap", "insertion"),
    ),
    Worker(
        name="rexrov2_arm7",
        jobs=("barrel-longitudinal", "barrel-transverse", "pile", "tap", "insertion"),
    ),
    Worker(
        name="bluerov2_heavy_alpha5",
        jobs=("barrel-longitudinal", "tap"),
        options={"tool": "small_pad", "forces": (8.0,)},
    ),
)
_BY_NAME = {worker.name: worker for worker in WORKERS}


@dataclass(frozen=True, kw_only=True)
class SoundCase:
    """One job of a vehicle in a drawn sea, in which nothing fails."""

    run: int
    paired: bool = False  # run without the check in any case
    vehicle: str  # name in WORKERS
    job: str  # name in ARM_JOBS
    seed: int  # of the job's own random numbers
    current: tuple[float, float, float]  # [m/s] in W
    gust: float  # [m/s] standard deviation per axis
    wave: tuple[float, float, float]  # [m/s] amplitude of the water's velocity, in W
    wave_frequency: float  # [Hz]

    def __post_init__(self) -> None:
        one_of(self.vehicle, _BY_NAME, "vehicle")
        one_of(self.job, _BY_NAME[self.vehicle].jobs, f"job of {self.vehicle}")

    def scenario(self) -> Scenario:
        """The job in its sea."""
        # Where a survey can, it tells the pose of the object.
        sensor = {} if self.job in SEARCHING else {"sensor": SURVEY}
        return ARM_JOBS[self.job](
            vehicle=self.vehicle,
            quick=True,
            seed=self.seed,
            current=self.current,
            gust=self.gust,
            wave=self.wave,
            wave_frequency=self.wave_frequency,
            **sensor,
            **_BY_NAME[self.vehicle].options,
        )


def draw(seed: int, run: int, *, paired: bool = False) -> SoundCase:
    """A case of the study; vehicles come in turn, and so do the jobs of each.

    Args:
        seed: Of the study.
        run: Number of the case.
        paired: Run it without the check in any case.
    """
    worker = WORKERS[run % len(WORKERS)]

    streams = Streams(seed, run)
    speed = streams["current speed"].uniform(0.0, CURRENT)
    has_waves = streams["waves"].random() < 2.0 / 3.0
    amplitude = streams["wave amplitude"].uniform(0.0, WAVE) if has_waves else 0.0
    return SoundCase(
        run=run,
        paired=paired,
        vehicle=worker.name,
        job=worker.jobs[run // len(WORKERS) % len(worker.jobs)],
        seed=int(streams["seed"].integers(2**31)),
        current=_directed(streams["current direction"], speed),
        gust=streams["gust"].uniform(0.0, GUST),
        wave=_directed(streams["wave direction"], amplitude),
        wave_frequency=streams["wave frequency"].uniform(*FREQUENCY),
    )


def _directed(rng: np.random.Generator, size: float) -> tuple[float, float, float]:
    """A vector of that size in a direction that is uniform on the sphere."""
    way = rng.standard_normal(3)
    x, y, z = (size * way / np.linalg.norm(way)).tolist()
    return x, y, z


def sound_run(case: SoundCase) -> dict[str, Any]:
    """Row of a case: sea, end and faults; of the run without the check too, where there is one."""
    scenario = case.scenario()
    checked = outcome(scenario)

    row = {
        "run": case.run,
        "vehicle": case.vehicle,
        "job": case.job,
        "current": float(np.linalg.norm(case.current)),
        "gust": case.gust,
        "wave": float(np.linalg.norm(case.wave)),
        "wave_frequency": case.wave_frequency,
        **checked,
        "paired": case.paired or bool(CHECKED & {name.split()[0] for name in checked["faults"]}),
    }
    if row["paired"]:
        unchecked = outcome(
            replace(scenario, control=replace(scenario.control, without=("gyro-check",)))
        )
        row |= {f"unchecked_{name}": value for name, value in unchecked.items()}
    return row


def outcome(scenario: Scenario) -> dict[str, Any]:
    """How a run ended, when in its work, the faults that were named, and the digest of its
    trajectory.
    """
    try:
        done = run(assemble(scenario))
    except UuvError as error:
        return {"ended": REFUSED, "why": str(error), "touched": False, "faults": [], "digest": ""}
    recording, final = done.recording, done.recording.final
    ended = (
        DONE
        if final.state is WorkState.DONE
        else LATE
        if final.abort is None
        else final.abort.value
    )
    return {
        "ended": ended,
        "why": final.note,
        "touched": bool(recording.within(*TOUCHED).any()),
        "faults": [f"{fault.kind.value} {fault.part}" for fault in done.result.last.command.faults],
        "digest": done.assessment.metrics["run"]["trajectory_sha256"],
    }


def line(row: Row) -> str:
    """Line about a run that named a fault."""
    if not row["faults"]:
        return ""
    return (
        f"run {row['run']}, {row['vehicle']}, {row['job']}: {', '.join(row['faults'])}; "
        f"{row['ended']}: {row['why']}"
    )


def summarise(rows: list[Row]) -> Summary:
    """How the runs of each vehicle ended and what was named; a gyro or an attitude that is named
    fails the study.
    """
    # By vehicle.
    vehicles = dict.fromkeys(row["vehicle"] for row in rows)
    table = [_cells(name, [row for row in rows if row["vehicle"] == name]) for name in vehicles]

    # What the check has changed.
    paired = [row for row in rows if row["paired"]]
    same = sum(row["digest"] == row["unchecked_digest"] for row in paired)

    named = [line(row) for row in rows if _names_one(row, checked=True)]
    left, unchecked = _left(paired), _left(paired, "unchecked_")
    pairs = (
        f"{len(paired)} runs without the check: {same} the same to the bit; left {unchecked}, "
        f"with it {left}"
    )
    return Summary(
        metrics={
            "runs": len(rows),
            "named": len(named),
            "other_faults": sum(_names_one(row, checked=False) for row in rows),
            "left": _left(rows),
            "paired": {
                "runs": len(paired),
                "same": same,
                "left": left,
                "left_without_check": unchecked,
            },
        },
        tables=[
            Table(
                title="Nothing failed",
                columns=COLUMNS,
                rows=[*table, _cells("all", rows)],
                labels=1,
            )
        ],
        lines=[pairs],
        failed=named,
    )


def _names_one(row: Row, *, checked: bool) -> bool:
    """True if a fault was named, of gyro or attitude if `checked`, else another one."""
    return any((name.split()[0] in CHECKED) == checked for name in row["faults"])


def _left(rows: Sequence[Row], prefix: str = "") -> int:
    """How many runs ended neither done nor refused."""
    return sum(row[f"{prefix}ended"] not in (DONE, REFUSED) for row in rows)


def _cells(name: str, rows: Sequence[Row]) -> list[str]:
    left = [row for row in rows if row["ended"] not in (DONE, REFUSED)]
    counts = (
        len(rows),
        sum(row["ended"] == DONE for row in rows),
        sum(not row["touched"] for row in left),
        sum(row["touched"] for row in left),
        sum(row["ended"] == REFUSED for row in rows),
        sum(_names_one(row, checked=True) for row in rows),
        sum(_names_one(row, checked=False) for row in rows),
    )
    return [name, *map(str, counts)]
