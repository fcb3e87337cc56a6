"""Benchmark: cost of an engine of campaigns beside the runs: its start, a task, a message, a row.

    # 100 runs on each engine: 20 min
    ./uvw run --extra cluster scripts/experiments/runtime/campaign_engines.py

    # one minute
    ./uvw run --extra cluster scripts/experiments/runtime/campaign_engines.py --runs 4

The same runs are done by each engine, and their rows must be equal to the bit. Needs an idle
machine. Writes campaign_engines.json, and the rows of each engine, into --out. docs/scale.md says
what follows for large campaigns.
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

import pickle
import resource
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from uuv.campaigns.campaign import Campaign, CampaignRun, read_campaign
from uuv.campaigns.campaign_rows import crashed_row, one_run
from uuv.experiment import Row, Study, StudyOptions, Summary, Table, read_rows
from uuv.experiment.engines import EngineName, engine_for
from uuv.experiment.harness import key_of
from uuv.experiment.row_log import KEY, TIMING, RowLog
from uuv.experiment.row_table import CHUNK, ROWS
from uuv.experiment.worker import Limits
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.saving import write_json

# goal: largest time of an engine's workers beside their runs, over that of the runs
OVERHEAD = 0.03
_SIZES = (0, 10_000)  # rows that are there when the time of another one is taken
_ADDED = 100  # times that are taken, of which the median counts
_PLANNED = 20_000  # runs that are drawn
_BATCH = 50  # rows that come at once


@dataclass(kw_only=True)
class Options:
    """Cost of the engines of campaigns beside the runs."""

    campaign: Path = Path("scripts/campaigns/contact_quick.toml")
    """Campaign file (TOML)."""
    runs: int = 100
    """Number of its runs."""
    workers: int = 2
    """Processes of each engine."""
    tasks: int = 500
    """Number of tasks that do nothing."""
    engines: tuple[EngineName, ...] = ("processes", "ray")
    """Engines, in their order."""
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        for name in ("runs", "workers", "tasks"):
            if getattr(self, name) < 2:
                raise ConfigurationError(f"--{name}: must be at least 2, got {getattr(self, name)}")


def nothing(task: CampaignRun) -> Mapping[str, Any]:
    """Row of a run that does nothing."""
    return crashed_row(task, "")


def no_task(task: CampaignRun) -> Mapping[str, Any]:
    """Row of a task whose process died."""
    raise ConfigurationError(f"the process of case {task.case} died")


def empty_tasks(engine: EngineName, tasks: Sequence[CampaignRun], workers: int) -> dict[str, float]:
    """Time to the first result [s], that of each one after it [s], and the size of a task's message
    [B].

    Args:
        engine: Name of the engine.
        tasks: Tasks, of which none is run.
        workers: Number of processes.
    """
    times = [time.perf_counter()]
    for found in engine_for(engine, workers, len(tasks), Limits()).results(tasks, nothing, no_task):
        times += [time.perf_counter()] * len(found)
    told = {"first_s": times[1] - times[0], "task_s": (times[-1] - times[1]) / (len(tasks) - 1)}
    return told | {
        "end_s": time.perf_counter() - times[-1],
        "message_b": float(np.mean([*map(_size, tasks)])),
    }


def real_runs(
    engine: EngineName, campaign: Campaign, options: Options, folder: Path
) -> tuple[list[Row], dict]:
    """Rows of a campaign by case, and wall time, that of the runs alone, and their difference by
    worker [s].

    Args:
        engine: Name of the engine.
        campaign: Campaign.
        options: Of the command.
        folder: For the rows.
    """
    study = Study(
        cases=campaign.runs(options.runs),
        run_one=one_run,
        summarise=lambda rows: Summary(metrics={"runs": len(rows)}),
        failed=crashed_row,
    )
    began = time.perf_counter()
    how = StudyOptions(workers=options.workers, out=folder, engine=engine)
    study.carry_out(campaign.name, how, f"Campaign {campaign.name} by {engine}", campaign.limits)
    wall = time.perf_counter() - began
    rows = sorted(read_rows(folder), key=lambda row: row["case"])
    spent = sum(row[TIMING]["wall_s"] for row in rows)
    beside = options.workers * wall - spent
    return rows, {"wall_s": wall, "runs_s": spent, "beside_s": beside, "overhead": beside / spent}


def plan_costs(campaign: Campaign) -> dict[str, float]:
    """Time [s] and memory [B] that a run takes before it begins: its values drawn, its key."""
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    keyed = {key_of(run): run for run in campaign.runs(_PLANNED)}
    took = time.perf_counter() - began
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return {"plan_s": took / len(keyed), "plan_b": grown / len(keyed)}


def row_costs(rows: Sequence[Row]) -> dict[str, float]:
    """Median time to add a row alone, and in a batch [s], with so many there; and what one takes in
    memory [B].

    Args:
        rows: Rows of a campaign; they are repeated under other numbers.
    """
    plain = [
        {name: value for name, value in row.items() if name not in (KEY, TIMING)} for row in rows
    ]
    found: dict[str, float] = {}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as name, RowLog.open(Path(name)) as log:

        def add(count: int) -> float:
            """Time [s] to add so many rows at once, for each."""
            numbers = range(len(log.rows), len(log.rows) + count)
            more = [
                (str(k), {**plain[k % len(plain)], "case": k}, {"wall_s": 1.0, "cpu_s": 1.0})
                for k in numbers
            ]
            began = time.perf_counter()
            log.add(more)
            return (time.perf_counter() - began) / count

        for size in _SIZES:
            while len(log.rows) < size:
                add(CHUNK)
            found[f"add_s_at_{size}"] = float(np.median([add(1) for _ in range(_ADDED)]))
        found["add_s_in_batch"] = float(np.median([add(_BATCH) for _ in range(_ADDED)]))
        began = time.perf_counter()
        count = len(read_rows(name))
        found["read_s"] = (time.perf_counter() - began) / count
        found["memory_b"] = (
            1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / len(log.rows)
        )
    return found


def _size(value: Any) -> int:
    return len(pickle.dumps(value, pickle.HIGHEST_PROTOCOL))


def _told(costs: Mapping[str, Mapping[str, float]]) -> Table:
    names = (
        ("first_s", "to the first result [s]", "{:.1f}"),
        ("task_s", "a task that does nothing [ms]", "{:.2f}"),
        ("message_b", "its message [kB]", "{:.1f}"),
        ("end_s", "the end [s]", "{:.1f}"),
        ("wall_s", "all runs [s]", "{:.0f}"),
        ("runs_s", "sum of the runs' own times [s]", "{:.0f}"),
        ("overhead", f"beside the runs [%], goal {100 * OVERHEAD:g}", "{:.2f}"),
    )
    scale = {"task_s": 1e3, "message_b": 1e-3, "overhead": 100.0}
    rows = [
        (said, *(form.format(scale.get(name, 1.0) * cost[name]) for cost in costs.values()))
        for name, said, form in names
    ]
    return Table(title="Engines", columns=("", *costs), rows=rows)


def main() -> int:
    """Measures all engines and returns the exit code: 1 if their rows differ."""
    options, console = parse(Options), Console(width=120)
    out = new_folder("campaign_engines", options.out)
    campaign = read_campaign(options.campaign)
    runs, tasks = campaign.runs(options.runs), campaign.runs(options.tasks)
    of_plan = plan_costs(replace(campaign, cases=_PLANNED))  # first: memory is told by its peak
    costs: dict[str, dict[str, float]] = {}
    rows: dict[str, list[Row]] = {}
    for engine in options.engines:
        costs[engine] = empty_tasks(engine, tasks, options.workers)
        rows[engine], more = real_runs(engine, campaign, options, out / engine)
        costs[engine] |= more
    bare = [[{**row, TIMING: None} for row in each] for each in rows.values()]
    equal = all(each == bare[0] for each in bare)
    of_rows = row_costs(next(iter(rows.values())))
    console.print(_told(costs).printed())
    size = sum(file.stat().st_size for file in (out / options.engines[0] / ROWS).iterdir()) / len(
        runs
    )
    console.print(
        f"a row: {size:.0f} B on the disk, {1e-3 * of_rows['memory_b']:.1f} kB in the memory of "
        "the study; "
        f"{1e3 * of_rows['add_s_at_0']:.1f} ms to add the first ones, "
        f"{1e3 * of_rows[f'add_s_at_{_SIZES[-1]}']:.1f} ms to {_SIZES[-1]} others, "
        f"{1e3 * of_rows['add_s_in_batch']:.2f} ms with {_BATCH} at once, "
        f"{1e3 * of_rows['read_s']:.2f} ms to read it; "
        f"{1e3 * of_plan['plan_s']:.2f} ms and {1e-3 * of_plan['plan_b']:.1f} kB to draw a run",
        highlight=False,
    )
    console.print(
        f"{len(runs)} rows, {'equal to the bit' if equal else 'NOT EQUAL'} on all engines",
        highlight=False,
    )
    write_json(
        out / "campaign_engines.json",
        {"engines": costs, "row": {**of_rows, **of_plan, "row_b": size}, "equal": equal},
    )
    console.print(f"written to {out}/", highlight=False)
    return 0 if equal else 1


if __name__ == "__main__":
    run_scenario(main)
