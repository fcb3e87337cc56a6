"""Faults that are named while nothing fails: quick jobs of several vehicles in drawn seas.

A case is run once more without the check of the gyro where the check has named a fault, and where
it is one of the first `pairs`. In all others the check has changed nothing as long as the paired
ones agree to the bit. Where a survey can, it tells the pose of the object, which halves the time
of a run. Exit code 1 if a gyro or an attitude is named.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from uuv.assembly import assemble
from uuv.check.checked_jobs import ARM_JOBS
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
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
REFUSED = "refused"
DONE = "done"
LATE = "not finished in time"
TOUCHED = (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK)

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
class SoundRun:
    """Which run is drawn."""

    draws: int = 0
    """Seed of what is drawn, beside the number of the run."""
    pairs: int = 5
    """So many of the first runs are repeated without the check, and each that names gyro or
    attitude.
    """
    seed: int
    """Number of the first run."""

    def __post_init__(self) -> None:
        at_least(self, draws=0, pairs=0)


@dataclass(frozen=True, kw_only=True)
class SoundCase:
    """One job of a vehicle in a drawn sea, in which nothing fails."""

    run: int
    paired: bool = False
    """Run without the check in any case."""
    vehicle: str
    """Name in WORKERS."""
    job: str
    """Name in ARM_JOBS."""
    seed: int
    """Seed of the job's own random numbers."""
    current: tuple[float, float, float]
    """Current [m/s] in W."""
    gust: float
    """Standard deviation of the gusts [m/s] per axis."""
    wave: tuple[float, float, float]
    """Amplitude of the water's velocity [m/s] in W."""
    wave_frequency: float
    """Frequency of the waves [Hz]."""

    def __post_init__(self) -> None:
        one_of(self.vehicle, _BY_NAME, "vehicle")
        one_of(self.job, _BY_NAME[self.vehicle].jobs, f"job of {self.vehicle}")

    def scenario(self) -> Scenario:
        """The job in its sea."""
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


@dataclass(frozen=True, kw_only=True)
class SoundEnd:
    """How a run ended."""

    ended: str = column("ended")
    why: str = column("why")
    touched: bool = column("came to the contact")
    faults: Sequence[str] = column("faults named")
    digest: str = column("digest of the trajectory", tolerance=None)


@dataclass(frozen=True, kw_only=True)
class SoundRow(SoundEnd):
    """How a run ended, and the same run without the check of the gyro where there is one."""

    unchecked: Mapping[str, Any] | None = column("without the check", tolerance=None, default=None)
    same: bool | None = column("the same to the bit", default=None)


def draw(seed: int, run: int, *, paired: bool = False) -> SoundCase:
    """A drawn case; vehicles come in turn, and so do the jobs of each.

    Args:
        seed: Of the draws.
        run: Number of the case.
        paired: Run it without the check in any case.
    """
    worker = WORKERS[run % len(WORKERS)]
    streams = Streams(seed, run)

    # the sea; a third have no waves
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


def cases(drawn: SoundRun) -> Iterator[SoundCase]:
    """The case of one number."""
    yield draw(drawn.draws, drawn.seed, paired=drawn.seed < drawn.pairs)


@experiment("false_alarms", seeds=200, cases=cases, quick={"runs": 1})
def false_alarms(case: SoundCase) -> SoundRow:
    """Runs a case; without the check too if it is paired or the check named a fault."""
    scenario = case.scenario()
    end = end_of(scenario)
    if not (case.paired or _names_one(asdict(end), checked=True)):
        return SoundRow(**asdict(end))

    # the same run without the check
    without = replace(scenario, control=replace(scenario.control, without=("gyro-check",)))
    unchecked = end_of(without)
    return SoundRow(**asdict(end), unchecked=asdict(unchecked), same=end.digest == unchecked.digest)


def end_of(scenario: Scenario) -> SoundEnd:
    """How a run of a scenario ends."""
    try:
        done = run(assemble(scenario))
    except UuvError as error:
        return SoundEnd(ended=REFUSED, why=str(error), touched=False, faults=[], digest="")

    recording = done.recording
    final = recording.final
    ended = LATE if final.abort is None else final.abort.value
    return SoundEnd(
        ended=DONE if final.state is WorkState.DONE else ended,
        why=final.note,
        touched=bool(recording.within(*TOUCHED).any()),
        faults=[f"{fault.kind.value} {fault.part}" for fault in done.result.last.command.faults],
        digest=done.assessment.metrics["run"]["trajectory_sha256"],
    )


def line(row: Row) -> str:
    """Line about a run that named a fault."""
    if not row["faults"]:
        return ""
    return (
        f"run {row['run']}, {row['vehicle']}, {row['job']}: {', '.join(row['faults'])}; "
        f"{row['ended']}: {row['why']}"
    )


def named(rows: list[Row]) -> list[str]:
    """Lines about the runs that named a gyro or an attitude."""
    return [line(row) for row in rows if _names_one(row, checked=True)]


def _names_one(row: Mapping[str, Any], *, checked: bool) -> bool:
    """True if a fault was named, of gyro or attitude if `checked`, else another one."""
    return any((name.split()[0] in CHECKED) == checked for name in row["faults"])


def _left(end: Mapping[str, Any]) -> bool:
    """True if a run ended neither done nor refused."""
    return end["ended"] not in (DONE, REFUSED)


GYRO = stat("count", lambda row: _names_one(row, checked=True), "gyro or attitude named")

false_alarms.line = line
false_alarms.page = (
    Page()
    .table(
        "Nothing failed",
        by="vehicle",
        columns=[
            stat("count", "vehicle", "jobs"),
            stat("count", lambda row: row["ended"] == DONE, "done"),
            stat("count", lambda row: _left(row) and not row["touched"], "left before the contact"),
            stat("count", lambda row: _left(row) and row["touched"], "left in contact or later"),
            stat("count", lambda row: row["ended"] == REFUSED, "refused"),
            GYRO,
            stat("count", lambda row: _names_one(row, checked=False), "other faults"),
        ],
        total=True,
    )
    .table(
        "Runs with and without the check of the gyro",
        columns=[
            stat("share", "same"),
            stat("count", _left, "left with it"),
            stat("count", lambda row: _left(row["unchecked"]), "left without it"),
        ],
        where=lambda row: row["unchecked"] is not None,
    )
    .add(named)
    .accept(GYRO, most=0)
)

if __name__ == "__main__":
    run_scenario(false_alarms.main)
