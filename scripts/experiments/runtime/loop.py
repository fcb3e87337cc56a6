"""Benchmark: computing time of each part of a contact job's loop, and the real-time factor.

    ./uvw run scripts/experiments/runtime/loop.py    # half a minute

It takes any option of clean_barrel.py. The job runs twice from the same seed. The first run is
unchanged, with compiled ticks (`uuv.ticks.compiled_ticks`). It gives processor time, so that other
load on the machine does not count, over the time of MuJoCo's own step. In the second, every tick is
taken part by part, and a stopwatch around every part gives the shares. Both must end with the same
bits. The printed digest of the recording shows whether a change of the code changes the results.
Writes bench_loop.json into --out.
"""

from uuv.start import new_folder, run_scenario  # first: it tells BLAS to use one thread

# isort: split
import copy
import hashlib
import os
import sys
import time
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from uuv.assembly import Assembly, assemble
from uuv.jobs import clean_barrel
from uuv.jobs.command_line import parsed
from uuv.runner import Run, rehearse, run, to_rehearse
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Moment
from uuv.sim.runs.command_line import RunOptions
from uuv.sim.runs.saving import write_json
from uuv.sim.sensors.depth_camera import DepthCamera

GOAL = 4.5  # largest time of the loop over that of MuJoCo's own step
GOAL_WHOLE = 9.0  # the same with identification and placement
# share of a part's slowest calls that is left out: in those the machine did something else
SLOWEST = 0.01


@dataclass(kw_only=True)
class Options(RunOptions):
    """Options of the benchmark beside those of the job."""

    record: bool = False
    """Keep also what the report needs; no log is written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredJob:
    """The job of clean_barrel.py, and whether what the report needs is recorded."""

    scenario: Scenario
    record: bool


class Stopwatch:
    """Durations of one kind of call, measured by a given clock."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self.spent = array("q")  # [ns]
        self.tally = 0  # [ns] sum since the last reset
        self._clock = clock

    def around(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, with its durations recorded."""
        clock, add = self._clock, self.spent.append

        def timed(*given: Any) -> Any:
            began = clock()
            result = call(*given)
            spent = clock() - began
            add(spent)
            self.tally += spent
            return result

        return timed

    @property
    def total(self) -> float:
        """Sum of all durations [s]."""
        return 1e-9 * sum(self.spent)

    def typical(self, overhead: float) -> float:
        """Mean duration [us] of a call without the slowest ones, less `overhead` [us] of reading
        the clock.
        """
        spent = np.sort(self.spent)[: max(1, int((1.0 - SLOWEST) * len(self.spent)))]
        return max(0.0, 1e-3 * float(spent.mean()) - overhead)


class Part:
    """Proxy of a part of the loop, with a stopwatch around one of its methods."""

    def __init__(self, part: Any, method: str, watch: Stopwatch) -> None:
        self._part = part
        setattr(self, method, watch.around(getattr(part, method)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._part, name)


class PlannerPart:
    """Proxy of a planner; the one long call, the placement of the hull, has a stopwatch of its
    own.
    """

    def __init__(self, part: Any, watch: Stopwatch, placing: Stopwatch) -> None:
        self.period, self.init = part.period, part.init
        self._step, self._spent, self._placing = watch.around(part.step), watch.spent, placing.spent
        self._state = WorkState.SETTLE  # of the last reference

    def step(self, state: Any, *given: Any) -> Any:
        """Step of the planner; a step that ends the scan counts as placement."""
        state, reference = self._step(state, *given)
        if self._state is WorkState.SCAN and reference.state is not WorkState.SCAN:
            self._placing.append(self._spent.pop())
        self._state = reference.state
        return state, reference


class Rest:
    """Observer that measures the time of each step outside the timed calls."""

    def __init__(self, watches: Mapping[str, Stopwatch]) -> None:
        self.watch = Stopwatch(time.perf_counter_ns)
        self._watches, self._last = watches, time.perf_counter_ns()

    def observe(self, moment: Moment) -> None:
        """Records the rest of one step and resets the tallies."""
        now = time.perf_counter_ns()
        inside = sum(watch.tally for watch in self._watches.values())
        if moment.tick:
            self.watch.spent.append(now - self._last - inside)
        for watch in self._watches.values():
            watch.tally = 0
        self._last = time.perf_counter_ns()


class Instants:
    """Observer that copies the plant's data every second, for steps of MuJoCo alone from the same
    states.
    """

    def __init__(self, built: Assembly) -> None:
        self._model, self._data, self.copies = built.plant.model, built.plant.data, []
        self.slow_ticks = (round(1.0 / built.plant.timestep),)

    def observe(self, moment: Moment) -> None:
        """Copies the data once a second."""
        if moment.tick % self.slow_ticks[0] == 0:
            self.copies.append(copy.copy(self._data))

    def step_us(self) -> float:
        """Time [us] of MuJoCo's own step: best of ten at each instant, averaged over the
        instants.
        """
        best = []
        for data in self.copies:
            spent = []
            for _ in range(10):
                began = time.perf_counter_ns()
                mujoco.mj_step(self._model, data)
                spent.append(time.perf_counter_ns() - began)
            best.append(min(spent))
        return 1e-3 * float(np.mean(best))


def fresh(job: MeasuredJob) -> Assembly:
    """The job assembled from the seed, with its code loaded."""
    rehearse(assemble(to_rehearse(job.scenario), full=job.record))
    return assemble(job.scenario, full=job.record)


def digest(outcome: Run) -> str:
    """Hash of the recording, twelve hexadecimal digits."""
    word = hashlib.sha256()
    for name, series in sorted(outcome.recording.series.items()):
        word.update(name.encode() + series.value.tobytes())
    return word.hexdigest()[:12]


def as_it_is(job: MeasuredJob) -> tuple[Run, dict[str, float], Instants]:
    """Runs the unchanged job; returns outcome, processor times [s] (whole, identification,
    placement) and instants.
    """
    built = fresh(job)
    seeing, placing, planning = (Stopwatch(time.process_time_ns) for _ in range(3))
    parts = built.parts
    parts = replace(
        parts,
        sensors=[
            Part(s, "step", seeing) if isinstance(s, DepthCamera) else s for s in parts.sensors
        ],
        finder=Part(parts.finder, "step", seeing),
        planner=PlannerPart(parts.planner, planning, placing),
    )
    instants = Instants(built)
    began = time.process_time()
    outcome = run(replace(built, loop=replace(built.loop, parts=parts)), observers=[instants])
    spent = {
        "whole": time.process_time() - began,
        "identification": seeing.total,
        "placement": placing.total,
    }
    return outcome, spent, instants


def by_part(job: MeasuredJob) -> tuple[Run, dict[str, Stopwatch], Stopwatch]:
    """Runs the job with a stopwatch around every part; returns outcome, stopwatches and the one for
    the rest.
    """
    built = fresh(job)
    watches: dict[str, Stopwatch] = {}

    def watch(name: str) -> Stopwatch:
        return watches.setdefault(name, Stopwatch(time.perf_counter_ns))

    parts, plant, recorder = built.parts, built.plant, Recorder(built.plant.model, full=job.record)
    timed = replace(
        parts,
        sensors=[Part(s, "step", watch(f"sensor {type(s).__name__}")) for s in parts.sensors],
        estimator=Part(parts.estimator, "step", watch("navigation")),
        finder=Part(parts.finder, "step", watch("finder")),
        planner=PlannerPart(parts.planner, watch("planner"), watch("placement")),
        controller=Part(parts.controller, "step", watch("controller")),
    )
    stepped = Part(
        Part(plant, "observe", watch("plant, up to the sensors")),
        "step",
        watch("plant, from the commands"),
    )
    rest = Rest(watches)
    recorder_part: Any = Part(recorder, "observe", watch("recorder"))
    timed_loop: Any = replace(built.loop, parts=timed, plant=stepped)
    outcome = run(replace(built, loop=timed_loop), recorder=recorder_part, observers=[rest])
    return outcome, watches, rest.watch


def main() -> int:
    """Runs the benchmark and writes its file; exit code 0 if both goals are reached."""
    values, options = parsed(clean_barrel, sys.argv[1:], beside=Options)
    job = MeasuredJob(scenario=clean_barrel(**values), record=options.record)
    if hasattr(os, "sched_setaffinity"):  # Linux: one core, as the goals say
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    folder = new_folder("bench_loop", options.out, job.scenario.seed)
    console = Console()
    outcome, spent, instants = as_it_is(job)
    again, watches, rest_watch = by_part(job)
    if digest(outcome) != digest(again):
        raise UuvError(f"the two runs differ: {digest(outcome)} and {digest(again)}")
    steps = outcome.result.last.tick + 1
    simulated = outcome.recording.duration
    loop = spent["whole"] - spent["identification"] - spent["placement"]
    clock = Stopwatch(time.perf_counter_ns)
    for nothing in [clock.around(lambda: None)] * 20_000:
        nothing()
    reading = clock.typical(0.0)  # [us]
    once = ("sensor DepthCamera", "finder", "placement")
    rows = {
        name: (len(w.spent) / steps, w.typical(reading))
        for name, w in watches.items()
        if name not in once
    }
    # A stopwatch takes about as much time outside its own measurement as within it.
    rest = rest_watch.typical(reading * sum(often for often, _ in rows.values()))
    whole = rest + sum(often * us for often, us in rows.values())
    table = Table(
        title=f"{steps} physics steps of {1e3 * simulated / steps:g} ms, digest {digest(outcome)}"
    )
    for column in ("part", "calls a step", "us a call", "us a step", "share"):
        table.add_column(column, justify="left" if column == "part" else "right")
    for name, (often, us) in rows.items():
        table.add_row(
            name, f"{often:.2g}", f"{us:.1f}", f"{often * us:.1f}", f"{often * us / whole:.0%}"
        )
    table.add_row("loop itself", "1", "", f"{rest:.1f}", f"{rest / whole:.0%}", end_section=True)
    table.add_row("all", "", "", f"{whole:.1f}", "100%")
    own = instants.step_us()
    table.add_row("MuJoCo's step alone", "1", f"{own:.1f}", f"{own:.1f}", f"{own / whole:.0%}")
    console.print(table)
    factors = {"loop": simulated / loop, "whole": simulated / spent["whole"]}
    ratios = {"loop": 1e6 * loop / steps / own, "whole": 1e6 * spent["whole"] / steps / own}
    console.print(
        f"{simulated:.1f} s simulated. With compiled ticks the loop alone takes "
        f"{1e6 * loop / steps:.1f} us a step, "
        f"[bold]{ratios['loop']:.1f}[/bold] times MuJoCo's own step (goal {GOAL:g}): "
        f"{factors['loop']:.0f} times real "
        f"time. With identification ({spent['identification']:.2f} s) and placement "
        f"({spent['placement']:.2f} s) "
        f"[bold]{ratios['whole']:.1f}[/bold] times (goal {GOAL_WHOLE:g}): {factors['whole']:.0f} "
        "times real time.",
        highlight=False,
    )
    figures = {
        "digest": digest(outcome),
        "steps": steps,
        "simulated_s": simulated,
        "processor_s": spent,
        "real_time_factor": factors,
        "mujoco_step_us": own,
        "over_mujoco_step": ratios,
        "part_by_part": outcome.result.part_by_part,
        "us_a_step": {
            **{name: often * us for name, (often, us) in rows.items()},
            "loop itself": rest,
        },
    }
    write_json(folder / "bench_loop.json", figures)
    console.print(f"written to {folder}/", highlight=False)
    return 0 if ratios["loop"] <= GOAL and ratios["whole"] <= GOAL_WHOLE else 1


if __name__ == "__main__":
    run_scenario(main)
