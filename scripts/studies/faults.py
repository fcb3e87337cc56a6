"""Study: behaviour of contact work under sensor and thruster faults, for every fault on both paths of the barrel.

Each run presses with 90 N when the fault begins. A case does damage if the true force on the object exceeds twice the
set force, or anything but the tool touches the object.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from scenarios import assemble, barrel
from scenarios.campaigns.fault_cases import Trace, run_branched
from scenarios.campaigns.fault_picture import draw
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import WorkState
from sim.runs.saving import write_whole


@dataclass(kw_only=True)
class Options:
    """Faults in contact work."""

    seeds: tuple[int, ...] = (0,)
    """Seeds of the runs; each run is branched into all cases."""
    paths: tuple[str, ...] = ("longitudinal", "transverse")
    """Paths of clean_barrel."""
    only: tuple[str, ...] = ()
    """Run only cases whose names contain one of these words."""
    picture: str = "dead"
    """Draw cases whose names contain this."""
    out: Path | None = None
    """Folder for faults.json, time series of the cases and pictures."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one case on one path with one seed."""

    case: str
    path: str
    seed: int
    found: str  # first fault found by the vehicle
    detection_s: float | None
    reaction: str
    reaction_s: float | None
    peak_n: float  # largest true force from the fault on
    excursion_m: float
    tilt_deg: float
    lost_s: float  # without contact while at work
    final: str
    note: str
    damage: bool


def figures(trace: Trace, path: str, seed: int) -> Figures:
    """Figures of one trace.

    Args:
        trace: Time series of the case.
        path: Name of the path.
        seed: Seed of the run.
    """
    time, least = trace.rows[:, 0], trace.rows[:, 9]
    peak = float(trace.rows[:, 10].max())
    states = [state for _, state, _ in trace.states]
    left = next((t for t, state, _ in trace.states if state in (WorkState.RETREAT, WorkState.ABORT)), None)
    working = time < (left if left is not None else np.inf)
    step = float(time[1] - time[0])
    hull = np.linalg.norm(trace.rows[:, 4:7], axis=1)
    reaction = " > ".join(states)
    if states == [WorkState.WORK] and np.any(trace.rows[:, 3] < 0.9 * trace.set_force):
        reaction = "work, at less force for a while"
    return Figures(
        case=trace.case,
        path=path,
        seed=seed,
        found=" ".join(trace.found[0][1:]) if trace.found else "",
        detection_s=trace.found[0][0] if trace.found else None,
        reaction=reaction,
        reaction_s=left,
        peak_n=peak,
        excursion_m=float(hull.max()),
        tilt_deg=float(np.degrees(trace.rows[:, 7].max())),
        lost_s=float(np.count_nonzero(least[working] < 1.0) * step) if states[0] is WorkState.WORK else 0.0,
        final=str(states[-1]),
        note=trace.blew_up or trace.states[-1][2],
        damage=bool(peak > 2.0 * (trace.set_force or 60.0) or trace.rows[:, 8].any() or trace.blew_up),
    )


def main() -> int:
    """Runs the cases and writes their files; exit code 1 if a case does damage."""
    options = parse(Options)
    folder = new_folder("study_faults", options.out)
    console = Console(width=max(Console().width, 160))
    found: list[Figures] = []
    for path in options.paths:
        for seed in options.seeds:
            if path not in ("longitudinal", "transverse"):
                raise ConfigurationError(f"--paths: expected longitudinal or transverse, got {path!r}")
            asked = barrel(path=path, seed=seed, forces=(90.0,))

            def said(trace: Trace, path: str = path, seed: int = seed) -> None:
                one = figures(trace, path, seed)
                found.append(one)
                console.print(_line(one), highlight=False)
                file = folder / f"{path}_{seed}_{trace.case.replace(' ', '_').replace('/', '_')}.npz"
                np.savez_compressed(file, rows=trace.rows)
                if options.picture in trace.case:
                    draw(trace, f"{trace.case}, {path} path, seed {seed}", file.with_suffix(".png"))

            run_branched(assemble(asked), options.only, said)
    console.print(_table(found))
    write_whole(
        folder / "faults.json",
        json.dumps([{name: getattr(one, name) for name in one.__slots__} for one in found], indent=2) + "\n",
    )
    console.print(f"written to {folder}/", highlight=False)
    return 1 if any(one.damage for one in found) else 0


def _line(one: Figures) -> str:
    after = "-" if one.detection_s is None else f"{one.detection_s:.2f} s"
    return (
        f"{one.path[:4]} {one.seed}  {one.case:30} found {one.found or '-':28} {after:>7}  peak {one.peak_n:4.0f} N  "
        f"hull {1e3 * one.excursion_m:4.0f} mm {one.tilt_deg:4.1f} deg  {one.reaction}  {one.note}"
        f"{'  DAMAGE' if one.damage else ''}"
    )


def _table(found: list[Figures]) -> Table:
    table = Table(title="faults at a push of 90 N")
    for name in ("fault", "path", "found", "after s", "reaction", "peak N", "hull mm", "tilt deg", "damage"):
        table.add_column(name)
    for one in found:
        after = "" if one.detection_s is None else f"{one.detection_s:.2f}"
        table.add_row(
            one.case,
            one.path[:5],
            one.found,
            after,
            one.reaction,
            f"{one.peak_n:.0f}",
            f"{1e3 * one.excursion_m:.0f}",
            f"{one.tilt_deg:.1f}",
            "yes" if one.damage else "no",
        )
    return table


if __name__ == "__main__":
    run_scenario(main)
