"""Behaviour of contact work under sensor and thruster faults, for every fault on both paths of the
barrel.

Each run presses with 90 N when the fault begins, or it begins in another phase (--phases). A case
does damage if the true force on the object exceeds 1.5 times the set force, during the retreat too,
or anything but the tool touches the object. A case fails too if the tool touches the object later
than 2 s after the work was left.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from experiments.faults.fault_cases import (
    AT_START,
    PATHS,
    PHASES,
    PUSH,
    SETTLE,
    Branch,
    PathName,
    PhaseName,
    Trace,
    fault_names,
)
from uuv import jobs, models
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.vehicle import Vehicle
from uuv.scenario import Scenario
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import one_of

LATE = 2.0  # [s] after the work was left, from which on the tool must not touch the object
_TOUCHING = 1.0  # [N] from which on it does
DEGREES = math.degrees(1.0)
GROUPS = {  # by the first word of a fault
    "vision": "vision or DVL",
    "DVL": "vision or DVL",
    "torque": "torque sensor",
    "gyro": "gyro or attitude",
    "attitude": "gyro or attitude",
    "found": "object found too deep or too high",
    "current": "current doubled",
}


@dataclass(frozen=True, kw_only=True)
class BranchedRun:
    """A run that is branched into faults."""

    path: PathName
    """Path of clean_barrel."""
    phases: tuple[PhaseName, ...] = ("work",)
    """Phases in which the faults begin: at work at full push, else shortly after the phase has
    begun; unload: while the force is ramped down; ascent: off the object after the loss of a heave
    thruster at work.
    """
    only: tuple[str, ...] = ()
    """Only faults whose names contain one of these words."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class FaultCase:
    """One fault in one phase of a run."""

    path: PathName
    seed: int
    phase: str
    fault: str

    def __post_init__(self) -> None:
        one_of(self.phase, (SETTLE, *PHASES), "phase")
        one_of(self.fault, all_faults(), "fault")


@dataclass(frozen=True, kw_only=True)
class FaultRow:
    """What the vehicle detects, what it does, and what happens; times are from the fault on."""

    group: str = column("group")
    detected: str = column("detected first")
    delay: float | None = column("detected after", "s", digits=2)
    reaction: str = column("reaction")
    left: float | None = column("work left after", "s", digits=2)
    peak: float = column("true force", "N", digits=0)
    touch: float | None = column("last contact after leaving", "s", digits=1)
    excursion: float = column("hull moved", "mm", digits=0, factor=1e3)
    tilt: float = column("hull tilted", "deg", digits=1, factor=DEGREES)
    lost: float = column("without contact at work", "s", digits=2)
    final: str = column("last state")
    note: str = column("its note")
    damage: bool = column("damage")


@cache
def all_faults() -> tuple[str, ...]:
    """Names of all faults of the job's vehicle."""
    vehicle = jobs.clean_barrel().vehicle.vehicle
    return fault_names(Vehicle.of(models.load(vehicle).compile()).thruster_names)


def cases(run: BranchedRun) -> Iterator[FaultCase]:
    """Faults of a run: those that begin before the scan, then those of each phase.

    Raises:
        ConfigurationError: No fault has one of the words.
    """
    chosen = [
        fault for fault in all_faults() if not run.only or any(word in fault for word in run.only)
    ]
    if not chosen:
        raise ConfigurationError(
            f"--only {' '.join(run.only)}: there is no such case; there are "
            f"{', '.join(all_faults())}"
        )

    for phase in (SETTLE, *run.phases):
        for fault in chosen:
            if (fault in AT_START) == (phase == SETTLE):
                yield FaultCase(path=run.path, seed=run.seed, phase=phase, fault=fault)


def scenario_of(path: PathName, seed: int) -> Scenario:
    """The job without a fault."""
    return jobs.clean_barrel(path=path, seed=seed, forces=(PUSH,))


@lru_cache(maxsize=1)
def _branch(path: PathName, seed: int, phase: str) -> Branch:
    """The job at the onset of a phase, from which its cases go on, one after the other."""
    return Branch(scenario_of(path, seed), phase)


@experiment(
    "faults",
    seeds=1,
    vary={"path": PATHS},
    paired=True,
    cases=cases,
    quick={"path": ("longitudinal",), "only": ("DVL lost", "heave_front dead")},
)
def faults(case: FaultCase) -> FaultRow:
    """Goes on from the run with the fault of a case."""
    return figures(_branch(case.path, case.seed, case.phase).trace(case.fault))


def figures(trace: Trace) -> FaultRow:
    """Figures of one trace."""
    time = trace.series["time"]
    most = trace.series["contact_most"]
    peak = float(most.max())

    # When the work was left, and what the hull did.
    states = [state for _, state, _ in trace.states]
    left = next(
        (t for t, state, _ in trace.states if state in (WorkState.RETREAT, WorkState.ABORT)), None
    )
    working = time < (left if left is not None else np.inf)
    touched = time[~working & (most > _TOUCHING)] - (left or 0.0)
    hull = np.linalg.norm(trace.series["moved"], axis=1)
    apart = trace.series["contact_least"][working] < _TOUCHING
    at_work = states[0] is WorkState.WORK

    # What the vehicle did about it.
    reaction = " > ".join(states)
    eased = bool(np.any(trace.series["set_force"] < 0.9 * trace.set_force))
    if states == [WorkState.WORK] and eased:
        reaction = "work, at less force for a while"
    return FaultRow(
        group=group_of(trace.fault),
        detected=" ".join(trace.reports[0][1:]) if trace.reports else "",
        delay=trace.reports[0][0] if trace.reports else None,
        reaction=reaction,
        left=left,
        peak=peak,
        touch=float(touched.max()) if touched.size else None,
        excursion=float(hull.max()),
        tilt=float(trace.series["tilt"].max()),
        lost=float(np.count_nonzero(apart) * float(time[1] - time[0])) if at_work else 0.0,
        final=str(states[-1]),
        note=trace.blew_up or trace.states[-1][2],
        damage=bool(peak > DAMAGE * PUSH or trace.series["collision"].any() or trace.blew_up),
    )


def group_of(fault: str) -> str:
    """Group of a fault: its kind of sensor, or what a thruster does and which way it pushes."""
    word, _, rest = fault.partition(" ")
    if word != "thruster":
        return GROUPS.get(word, word)

    thruster, _, how = rest.partition(" ")
    how = "at full thrust" if how in ("stuck ahead", "stuck astern") else how
    return f"thruster {how}, {'sway' if thruster.startswith('sway') else 'surge or heave'}"


def failing(rows: list[Row]) -> list[str]:
    """A line about each case with damage or a late contact."""
    return [
        f"{why}: {row['fault']} in {row['phase']}, {row['path']} path, seed {row['seed']}"
        for row in rows
        if (why := _why_failed(row))
    ]


def _why_failed(row: Row) -> str:
    """Why a case fails; empty: it does not."""
    if row["damage"]:
        return "damage"
    late = (row["touch"] or 0.0) > LATE
    return f"contact {row['touch']:.1f} s after the work was left" if late else ""


def line(row: Row) -> str:
    """A line about one case."""
    cells = [
        f"{faults.columns[name].heading}: {faults.columns[name].cell(row[name])}"
        for name in ("detected", "delay", "peak", "touch", "excursion", "tilt", "reaction", "note")
    ]
    about = f"{row['path']} {row['seed']}, {row['fault']} in {row['phase']}"
    return f"{about}: {'; '.join(cells)}{'; DAMAGE' if row['damage'] else ''}"


faults.line = line
faults.page = (
    Page()
    .table(
        f"Faults at a push of {PUSH:g} N, by group",
        by=("group", "phase"),
        columns=[
            stat("share", lambda row: row["delay"] is not None, "detected"),
            stat("spread", "delay", "after"),
            stat("largest", "peak"),
            stat("count", lambda row: row["left"] is not None, "work left"),
            stat("largest", "touch"),
            stat("count", "damage"),
        ],
    )
    .table(
        f"Faults at a push of {PUSH:g} N",
        by=("fault", "phase", "path", "seed"),
        columns=[
            *("detected", "delay", "reaction", "peak", "touch"),
            *("excursion", "tilt", "lost", "damage"),
        ],
    )
    .add(failing)
    .accept(stat("count", "damage", "cases with damage"), most=0)
    .accept(stat("largest", "touch", none=0.0), most=LATE)
)

if __name__ == "__main__":
    run_scenario(faults.main)
