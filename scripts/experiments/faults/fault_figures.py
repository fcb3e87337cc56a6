"""Figures of the fault cases of one contact job, and their table over paths and seeds."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from experiments.faults.fault_cases import ASCENT, PHASES, PUSH, Trace, run_branched
from experiments.faults.fault_picture import draw
from uuv import jobs
from uuv.experiment import Row, Summary, Table
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import one_of

LATE = 2.0  # [s] after the work was left, from which on the tool must not touch the object
_TOUCHING = 1.0  # [N] from which on it does
_COLUMNS = (
    "fault",
    "in",
    "path",
    "found",
    "after s",
    "reaction",
    "peak N",
    "touch s",
    "hull mm",
    "tilt deg",
    "damage",
)


@dataclass(frozen=True, slots=True)
class BranchedCase:
    """One run on one path, branched into all fault cases; a case of the study."""

    path: Literal["longitudinal", "transverse"]
    seed: int
    only: tuple[str, ...]  # parts of the names of the fault cases; empty: all
    phases: tuple[str, ...]  # of `fault_cases.PHASES`, in which they begin

    def __post_init__(self) -> None:
        for phase in self.phases:
            one_of(phase, PHASES, "phases")


@dataclass(frozen=True, slots=True)
class FaultFigures:
    """Figures of one case on one path with one seed."""

    case: str
    phase: str  # in which it began
    path: str
    seed: int
    found: str  # first fault found by the vehicle
    detection_s: float | None
    reaction: str
    reaction_s: float | None
    peak_n: float  # largest true force from the fault on
    # last contact, from when the work was left; None: not left, or not touched since
    touch_s: float | None
    excursion_m: float
    tilt_deg: float
    lost_s: float  # without contact while at work
    final: str
    note: str
    damage: bool


def figures(trace: Trace, path: str, seed: int) -> FaultFigures:
    """Figures of one trace.

    Args:
        trace: Time series of the case.
        path: Name of the path.
        seed: Seed of the run.
    """
    time, least = trace.rows[:, 0], trace.rows[:, 9]
    peak = float(trace.rows[:, 10].max())

    # When the work was left, and what the hull did.
    states = [state for _, state, _ in trace.states]
    left = next(
        (t for t, state, _ in trace.states if state in (WorkState.RETREAT, WorkState.ABORT)), None
    )
    working = time < (left if left is not None else np.inf)
    step = float(time[1] - time[0])
    touched = time[~working & (trace.rows[:, 10] > _TOUCHING)] - (left or 0.0)
    hull = np.linalg.norm(trace.rows[:, 4:7], axis=1)

    # What the vehicle did about it.
    reaction = " > ".join(states)
    if states == [WorkState.WORK] and np.any(trace.rows[:, 3] < 0.9 * trace.set_force):
        reaction = "work, at less force for a while"
    return FaultFigures(
        case=trace.case,
        phase=trace.phase,
        path=path,
        seed=seed,
        found=" ".join(trace.found[0][1:]) if trace.found else "",
        detection_s=trace.found[0][0] if trace.found else None,
        reaction=reaction,
        reaction_s=left,
        peak_n=peak,
        touch_s=float(touched.max()) if touched.size else None,
        excursion_m=float(hull.max()),
        tilt_deg=float(np.degrees(trace.rows[:, 7].max())),
        lost_s=float(np.count_nonzero(least[working] < _TOUCHING) * step)
        if states[0] is WorkState.WORK
        else 0.0,
        final=str(states[-1]),
        note=trace.blew_up or trace.states[-1][2],
        damage=bool(peak > DAMAGE * PUSH or trace.rows[:, 8].any() or trace.blew_up),
    )


def run(case: BranchedCase, folder: Path, picture: str) -> Row:
    """Figures of all fault cases of one run; their time series and pictures go to `folder`.

    Args:
        case: The run.
        folder: Folder of the study.
        picture: Part of the names of the cases that are drawn.
    """
    asked = jobs.clean_barrel(path=case.path, seed=case.seed, forces=(PUSH,))
    found: list[FaultFigures] = []

    def keep(trace: Trace) -> None:
        found.append(figures(trace, case.path, case.seed))
        name = f"{case.path}_{case.seed}_{trace.phase}_{trace.case}".replace(" ", "_").replace(
            "/", "_"
        )
        file = folder / f"{name}.npz"
        np.savez_compressed(file, rows=trace.rows)
        if picture in trace.case:
            draw(
                trace, f"{trace.case}, {case.path} path, seed {case.seed}", file.with_suffix(".png")
            )

    on_the_way = tuple(phase for phase in case.phases if phase != ASCENT)
    for phases in (on_the_way, (ASCENT,) if ASCENT in case.phases else ()):
        if phases:
            run_branched(asked, case.only, keep, phases)
    return {"path": case.path, "seed": case.seed, "cases": [asdict(one) for one in found]}


def lines(row: Row) -> str:
    """A line about each case of one run."""
    return "\n".join(_line(FaultFigures(**one)) for one in row["cases"])


def summarise(rows: list[Row]) -> Summary:
    """Table of all cases; those with damage fail, and those that touch the object late after the
    work was left.
    """
    found = [FaultFigures(**one) for row in rows for one in row["cases"]]
    cells = [
        (
            one.case,
            one.phase,
            one.path[:5],
            one.found,
            "" if one.detection_s is None else f"{one.detection_s:.2f}",
            one.reaction,
            f"{one.peak_n:.0f}",
            "" if one.touch_s is None else f"{one.touch_s:.1f}",
            f"{1e3 * one.excursion_m:.0f}",
            f"{one.tilt_deg:.1f}",
            "yes" if one.damage else "no",
        )
        for one in found
    ]
    return Summary(
        metrics={"cases": [asdict(one) for one in found]},
        tables=[
            Table(title=f"Faults at a push of {PUSH:g} N", columns=_COLUMNS, rows=cells, labels=4)
        ],
        failed=[
            f"{why}: {one.case} in {one.phase}, {one.path} path, seed {one.seed}"
            for one in found
            if (why := _bad(one))
        ],
    )


def _bad(one: FaultFigures) -> str:
    """Why the study fails by this case; empty: it does not."""
    if one.damage:
        return "damage"
    return (
        f"contact {one.touch_s:.1f} s after the work was left"
        if (one.touch_s or 0.0) > LATE
        else ""
    )


def _line(one: FaultFigures) -> str:
    after = "-" if one.detection_s is None else f"{one.detection_s:.2f} s"
    return (
        f"{one.path[:4]} {one.seed}  {one.case:30} in {one.phase:8} "
        f"found {one.found or '-':28} {after:>7}  peak {one.peak_n:4.0f} N  "
        f"touch {'-' if one.touch_s is None else f'{one.touch_s:.1f} s':>5}  "
        f"hull {1e3 * one.excursion_m:4.0f} mm {one.tilt_deg:4.1f} deg  {one.reaction}  {one.note}"
        f"{'  DAMAGE' if one.damage else ''}"
    )
