"""Cost of an engine of campaigns beside the runs: its start, a task, a message, a row.

The same runs are done by each engine, and their rows must be equal to the bit. Needs an idle
machine. docs/scale.md says what follows for large campaigns.

    # 100 runs on each engine: 20 min
    ./uvw run --extra cluster scripts/experiments/runtime/campaign_engines.py --workers 1

    # one minute
    ./uvw run --extra cluster scripts/experiments/runtime/campaign_engines.py --campaign-runs 4
"""

from uuv.start import run_scenario  # isort: skip

import pickle
import resource
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from uuv.campaigns.campaign import Campaign, CampaignRun, read_campaign
from uuv.campaigns.campaign_rows import crashed_row, one_run
from uuv.experiment import (
    Page,
    Row,
    Study,
    StudyOptions,
    Summary,
    column,
    experiment,
    read_rows,
    stat,
)
from uuv.experiment.engines import EngineName, engine_for
from uuv.experiment.harness import key_of
from uuv.experiment.options import at_least
from uuv.experiment.row_log import KEY, TIMING, RowLog
from uuv.experiment.row_table import CHUNK, ROWS
from uuv.experiment.worker import Limits
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import one_of

# goal: largest time of an engine's workers beside their runs, over that of the runs
OVERHEAD = 0.03
ENGINES: tuple[EngineName, ...] = ("processes", "ray")
_SIZES = (0, 10_000)  # rows that are there when the time of another one is taken
_ADDED = 100  # times that are taken, of which the median counts
_PLANNED = 20_000  # runs that are drawn
_BATCH = 50  # rows that come at once


@dataclass(frozen=True, kw_only=True)
class EnginesCase:
    """One campaign by all engines, one after the other."""

    campaign: str = "scripts/campaigns/contact_quick.toml"
    """Campaign file (TOML)."""
    campaign_runs: int = 100
    """Number of its runs."""
    processes: int = 2
    """Processes of each engine."""
    tasks: int = 500
    """Number of tasks that do nothing."""
    engines: tuple[str, ...] = ENGINES
    """Engines, in their order."""

    def __post_init__(self) -> None:
        at_least(self, campaign_runs=2, processes=2, tasks=2)
        for engine in self.engines:
            one_of(engine, get_args(EngineName), "--engines")


def _seconds(label: str, unit: str = "s", factor: float = 1.0, **more: Any) -> Any:
    return column(label, unit, factor=factor, tolerance=None, **more)


@dataclass(frozen=True, kw_only=True)
class EnginesRow:
    """Costs by engine, those of a row by number of rows, and those of drawing a run."""

    equal: bool = column("equal to the bit on all engines")
    first: Mapping[str, float] = _seconds("to the first result", digits=1, by="engine")
    task: Mapping[str, float] = _seconds(
        "a task that does nothing", "ms", 1e3, digits=2, by="engine"
    )
    message: Mapping[str, float] = _seconds("its message", "kB", 1e-3, digits=1, by="engine")
    end: Mapping[str, float] = _seconds("the end", digits=1, by="engine")
    wall: Mapping[str, float] = _seconds("all runs", digits=0, by="engine")
    own: Mapping[str, float] = _seconds("sum of the runs' own times", digits=0, by="engine")
    overhead: Mapping[str, float] = _seconds("beside the runs", "%", 100.0, digits=2, by="engine")
    add: Mapping[str, float] = _seconds("time to add a row", "ms", 1e3, digits=2, by="how")
    read: float = _seconds("to read a row", "ms", 1e3, digits=2)
    disk: float = _seconds("on the disk", "B", digits=0)
    memory: float = _seconds("in the memory of the study", "kB", 1e-3, digits=1)
    plan: float = _seconds("to draw a run", "ms", 1e3, digits=2)
    plan_memory: float = _seconds("a run drawn", "kB", 1e-3, digits=1)


@experiment("campaign_engines")
def campaign_engines(case: EnginesCase) -> EnginesRow:
    """Measures all engines."""
    campaign = read_campaign(Path(case.campaign))
    tasks = campaign.runs(case.tasks)
    of_plan = plan_costs(replace(campaign, cases=_PLANNED))  # first: memory is measured by its peak

    costs: dict[str, dict[str, float]] = {}
    rows: dict[str, list[Row]] = {}
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)

        for engine in case.engines:
            costs[engine] = empty_tasks(engine, tasks, case.processes)
            rows[engine], more = real_runs(engine, campaign, case, home / engine)
            costs[engine] |= more

        files = (home / case.engines[0] / ROWS).iterdir()
        disk = sum(file.stat().st_size for file in files) / case.campaign_runs

    bare = [[{**row, TIMING: None} for row in entries] for entries in rows.values()]
    of_rows = row_costs(next(iter(rows.values())))
    by_engine = {
        key: {engine: cost[key] for engine, cost in costs.items()}
        for key in ("first", "task", "message", "end", "wall", "own", "overhead")
    }
    equal = all(entries == bare[0] for entries in bare)
    figures: dict[str, Any] = {**by_engine, **of_rows, **of_plan}
    return EnginesRow(equal=equal, disk=disk, **figures)


def nothing(task: CampaignRun) -> Mapping[str, Any]:
    """Row of a run that does nothing."""
    return crashed_row(task, "")


def no_task(task: CampaignRun) -> Mapping[str, Any]:
    """Row of a task whose process died."""
    raise ConfigurationError(f"the process of case {task.case} died")


def empty_tasks(engine: Any, tasks: Sequence[CampaignRun], workers: int) -> dict[str, float]:
    """Time to the first result [s], that of each one after it [s], and the size of a task's message
    [B].

    Args:
        engine: Name of the engine.
        tasks: Tasks, of which none is run.
        workers: Number of processes.
    """
    times = [time.perf_counter()]
    workers_of = engine_for(engine, workers, len(tasks), Limits())

    for batch in workers_of.results(tasks, nothing, no_task):
        times += [time.perf_counter()] * len(batch)

    return {
        "first": times[1] - times[0],
        "task": (times[-1] - times[1]) / (len(tasks) - 1),
        "end": time.perf_counter() - times[-1],
        "message": float(np.mean([*map(_size, tasks)])),
    }


def real_runs(
    engine: Any, campaign: Campaign, case: EnginesCase, folder: Path
) -> tuple[list[Row], dict]:
    """Rows of a campaign by case, and wall time, that of the runs alone, and their difference by
    worker [s].

    Args:
        engine: Name of the engine.
        campaign: Campaign.
        case: Of the experiment.
        folder: For the rows.
    """
    study = Study(
        cases=campaign.runs(case.campaign_runs),
        run_one=one_run,
        summarise=lambda rows: Summary(metrics={"runs": len(rows)}),
        failed=crashed_row,
    )

    began = time.perf_counter()
    how = StudyOptions(workers=case.processes, out=folder, engine=engine)
    study.carry_out(campaign.name, how, f"Campaign {campaign.name} by {engine}", campaign.limits)
    wall = time.perf_counter() - began

    rows = sorted(read_rows(folder), key=lambda row: row["case"])
    spent = sum(row[TIMING]["wall_s"] for row in rows)
    return rows, {"wall": wall, "own": spent, "overhead": case.processes * wall / spent - 1.0}


def plan_costs(campaign: Campaign) -> dict[str, float]:
    """Time [s] and memory [B] that a run takes before it begins: its values drawn, its key."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.perf_counter()
    keyed = {key_of(run): run for run in campaign.runs(_PLANNED)}
    took = time.perf_counter() - began
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return {"plan": took / len(keyed), "plan_memory": grown / len(keyed)}


def row_costs(rows: Sequence[Row]) -> dict[str, Any]:
    """Median time to add a row alone, and in a batch [s], with so many there; and what one takes in
    memory [B].

    Args:
        rows: Rows of a campaign; they are repeated under other numbers.
    """
    plain = [
        {name: entry for name, entry in row.items() if name not in (KEY, TIMING)} for row in rows
    ]

    added: dict[str, float] = {}
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
            added[f"alone, after {size}"] = float(np.median([add(1) for _ in range(_ADDED)]))

        added[f"{_BATCH} at once"] = float(np.median([add(_BATCH) for _ in range(_ADDED)]))

        began = time.perf_counter()
        count = len(read_rows(name))
        read = (time.perf_counter() - began) / count

        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        return {"add": added, "read": read, "memory": grown / len(log.rows)}


def _size(value: Any) -> int:
    return len(pickle.dumps(value, pickle.HIGHEST_PROTOCOL))


campaign_engines.page = (
    Page()
    .table(
        "Engines",
        by="engine",
        columns=[
            *("first", "task", "message", "end", "wall", "own"),
            stat("value", "overhead", f"beside the runs, goal {100 * OVERHEAD:g}"),
        ],
    )
    .table("A row", columns=["disk", "memory", "read", "plan", "plan_memory"])
    .table("A row is added", by="how", columns=["add"])
    .share("equal")
    .accept(stat("share", "equal"), least=1.0)
)

if __name__ == "__main__":
    run_scenario(campaign_engines.main)
