"""Benchmark: vehicles beside the default one in all jobs, what `uuv check` promised of them and
what they kept.

    ./uvw run scripts/experiments/vehicles/vehicles.py --workers 2

A job that the check refuses is run all the same, to see whether the refusal was right. Writes
vehicles.json and vehicles.md into --out.
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
from rich.console import Console

from uuv.check.check import check_vehicle
from uuv.check.checked_jobs import ARM_JOBS, HOVERING
from uuv.check.jobs import ArmJobs
from uuv.experiment.harness import Table
from uuv.experiment.local_processes import run_all
from uuv.experiment.options import at_least
from uuv.runner import Run, run
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import one_of
from uuv.sim.runs.saving import write_json, write_whole

# Vehicle: tool, set forces [N]; None: its own tool, the jobs' own forces.
VEHICLES: dict[str, tuple[str | None, tuple[float, ...]]] = {
    "bluerov2_heavy_alpha5": ("small_pad", (8.0,)),
    "rexrov2_arm7": (None, ()),
    "uuv_puma_two_sway": (None, ()),
}


@dataclass(kw_only=True)
class Options:
    """Vehicles in all jobs."""

    vehicles: tuple[str, ...] = tuple(VEHICLES)
    """Names, of those that the benchmark knows."""
    jobs: tuple[str, ...] = tuple(ARM_JOBS)
    """Jobs of the arm."""
    seeds: int = 5
    """Runs of each job, with seeds from 0 on."""
    workers: int = 1
    """Processes."""
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        at_least(self, seeds=1, workers=1)
        for vehicle in self.vehicles:
            one_of(vehicle, tuple(VEHICLES), "--vehicles")
        for job in self.jobs:
            one_of(job, tuple(ARM_JOBS), "--jobs")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run."""

    vehicle: str
    job: str
    seed: int


def scenario_of(case: Case) -> Scenario:
    """Scenario of a run."""
    tool, forces = VEHICLES[case.vehicle]
    return replace(
        ArmJobs(case.vehicle, tool=tool, parts=None, forces=forces).scenario(case.job),
        seed=case.seed,
    )


def outcome(case: Case) -> dict[str, Any]:
    """Figures of a run: kept, or why not."""
    row: dict[str, Any] = {
        "vehicle": case.vehicle,
        "job": case.job,
        "seed": case.seed,
        "kept": False,
        "said": "",
    }
    try:
        done = run(scenario_of(case))
    except UuvError as error:
        return row | {"said": str(error), "begun": False}
    judged = done.assessment
    figures = cast(dict[str, Any], judged.metrics)
    row["kept"] = judged.accepted
    row["said"] = "; ".join(judged.failed)[:300]
    for group, name in (
        ("contact", "force_error_rms_n"),
        ("tool", "path_deviation_max_m"),
        ("hull", "tilt_max_rad"),
    ):
        row[name] = (
            figures.get(group, {}).get(name) if isinstance(figures.get(group), dict) else None
        )
    row["felt_error_n"] = (figures.get("force_estimate") or {}).get("normal_error_rms_n")
    row["felt_sigma_n"] = _sigma(done)
    return row


def _sigma(done: Run) -> float | None:
    """Standard deviation [N] of the normal force that the controller stated, mean over the work;
    None without work.
    """
    name = "believed.f_tip_sigma_G"
    if name not in done.recording:
        return None
    work = [(event.time, event.state) for event in done.recording.events]
    spans = [
        (begin, after) for (begin, state), (after, _) in pairwise(work) if state is WorkState.WORK
    ]
    series = done.recording[name]
    at = [k for k, t in enumerate(series.time) if any(begin <= t < after for begin, after in spans)]
    return float(np.nanmean(series.value[at, 2])) if at else None


def died(case: Case) -> dict[str, Any]:
    """Row of a run whose process died."""
    return {
        "vehicle": case.vehicle,
        "job": case.job,
        "seed": case.seed,
        "kept": False,
        "said": "process died",
    }


def main() -> int:
    """Checks the vehicles, runs all jobs, and compares; 1 if a job that was promised was kept in
    less than 90 %.
    """
    options, console = parse(Options), Console()
    folder = new_folder("vehicles", options.out)
    promised: dict[tuple[str, str], Any] = {}
    hovering: list[dict[str, Any]] = []
    for vehicle in options.vehicles:
        tool, forces = VEHICLES[vehicle]
        check = check_vehicle(vehicle, tool=tool, forces=forces, jobs=(*HOVERING, *options.jobs))
        for verdict in check.jobs:
            if verdict.job in HOVERING:
                row = {
                    "vehicle": vehicle,
                    "job": verdict.job,
                    "kept": verdict.promised,
                    "said": verdict.said,
                }
                hovering.append(row)
            promised[vehicle, verdict.job] = verdict
    cases = [
        Case(vehicle=vehicle, job=job, seed=seed)
        for vehicle in options.vehicles
        for job in options.jobs
        for seed in range(options.seeds)
    ]
    rows: list[dict[str, Any]] = []
    for case, row in run_all(cases, options.workers, outcome, died):
        rows.append(row)
        console.print(
            f"{case.vehicle} {case.job} {case.seed}: {'kept' if row['kept'] else row['said']}"[:160]
        )
    table: list[tuple[str, ...]] = []
    short = False
    for vehicle in options.vehicles:
        for job in options.jobs:
            mine = [row for row in rows if (row["vehicle"], row["job"]) == (vehicle, job)]
            kept, verdict = sum(row["kept"] for row in mine), promised[vehicle, job]
            short |= verdict.promised and kept < 0.9 * len(mine)
            table.append(
                (
                    vehicle,
                    job,
                    "promised" if verdict.promised else f"refused: {verdict.code}",
                    f"{kept} of {len(mine)}",
                    _worst(mine, "force_error_rms_n", 1.0, 2),
                    _worst(mine, "path_deviation_max_m", 1e3, 1),
                    _worst(mine, "felt_error_n", 1.0, 2),
                    _worst(mine, "felt_sigma_n", 1.0, 2),
                )
            )
    columns = (
        "vehicle",
        "job",
        "check",
        "kept",
        "force error, RMS [N]",
        "path, peak [mm]",
        "felt [N]",
        "sigma [N]",
    )
    tables = [
        Table("Vehicles in all jobs: worst of the runs", columns, table, labels=3),
        Table(
            "Hover",
            ("vehicle", "job", "kept", "figures"),
            [
                (each["vehicle"], each["job"], "yes" if each["kept"] else "no", each["said"])
                for each in hovering
            ],
            labels=4,
        ),
    ]
    for each in tables:
        console.print(each.printed())
    write_json(folder / "vehicles.json", {"hover": hovering, "rows": rows})
    write_whole(folder / "vehicles.md", "\n\n".join(each.markdown() for each in tables))
    console.print(f"in {folder}")
    return int(short)


def _worst(rows: list[dict[str, Any]], name: str, scale: float, digits: int) -> str:
    values = [row[name] for row in rows if row.get(name) is not None]
    return f"{scale * max(values):.{digits}f}" if values else ""


if __name__ == "__main__":
    run_scenario(main)
