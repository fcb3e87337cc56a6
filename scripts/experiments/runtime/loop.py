"""Computing time of each part of a contact job's loop, and the real-time factor.

The job of clean_barrel.py runs twice from the same seed. The first run is unchanged, with compiled
ticks (`uuv.ticks.compiled_ticks`). It gives processor time, so that other load on the machine does
not count, over the time of MuJoCo's own step. In the second, every tick is taken part by part, and
a stopwatch around every part gives the shares. Both must end with the same bits. The digest of the
recording shows whether a change of the code changes the results.

    ./uvw run scripts/experiments/runtime/loop.py    # half a minute
    ./uvw run scripts/experiments/runtime/loop.py --job="--quick --seed 3"
"""

from uuv.start import run_scenario  # first: it tells BLAS to use one thread

# isort: split
import copy
import hashlib
import shlex
import time
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from uuv.assembly import Assembly, assemble
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.one_core import one_core
from uuv.jobs import clean_barrel
from uuv.jobs.command_line import parsed
from uuv.runner import Run, rehearse, run, to_rehearse
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Moment
from uuv.sim.sensors.depth_camera import DepthCamera

GOAL = 4.5  # largest time of the loop over that of MuJoCo's own step
GOAL_WHOLE = 9.0  # the same with identification and placement
# share of a part's slowest calls that is left out: in those the machine did something else
SLOWEST = 0.01
WHOLE, SEEING, PLACING, LOOP = "whole run", "identification", "placement", "loop alone"
ONCE = ("sensor DepthCamera", "finder", "placement")  # no parts of every step
REST = "loop itself"
_READINGS = 20_000  # of the clock, by which its overhead is measured


@dataclass(frozen=True, kw_only=True)
class LoopCase:
    """One job."""

    job: str = ""
    """Options of clean_barrel.py, in quotes."""
    record: bool = False
    """Keep also what the report needs; no log is written."""

    def __post_init__(self) -> None:
        self.scenario()  # a wrong option is refused before anything runs

    def scenario(self) -> Scenario:
        """Scenario of the job.

        Raises:
            ConfigurationError: The options of the job are no words.
        """
        try:
            words = shlex.split(self.job)
        except ValueError as error:
            raise ConfigurationError(f"--job {self.job!r}: {error}") from error
        values, _ = parsed(clean_barrel, words)
        return clean_barrel(**values)


@dataclass(frozen=True, kw_only=True)
class LoopRow:
    """Times by span of the unchanged run, and by part of a step."""

    # of one machine: other libraries give other bits
    digest: str = column("digest", tolerance=None)
    steps: int = column("steps")
    simulated: float = column("simulated", "s", digits=1)
    mujoco_step: float = column("MuJoCo's step alone", "µs", digits=1, factor=1e6, tolerance=None)
    part_by_part: str = column("why ticks are not compiled")
    processor: Mapping[str, float] = column(
        "processor time", "s", digits=2, by="span", tolerance=None
    )
    calls: Mapping[str, float] = column("calls a step", digits=2, by="part", tolerance=None)
    call: Mapping[str, float] = column(
        "a call", "µs", digits=1, factor=1e6, by="part", tolerance=None
    )
    step: Mapping[str, float] = column(
        "a step", "µs", digits=1, factor=1e6, by="part", tolerance=None
    )
    share: Mapping[str, float] = column(
        "share", "%", digits=0, factor=100.0, by="part", tolerance=None
    )


class Stopwatch:
    """Durations of one kind of call, measured by a given clock."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self.spent = array("q")  # [ns]
        self.tally = 0  # [ns] sum since the last reset
        self._clock = clock

    def around(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, with its durations recorded."""
        clock, add = self._clock, self.spent.append

        def timed(*values: Any) -> Any:
            began = clock()
            result = call(*values)
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
        """Mean duration [us] of a call, the slowest left out, less `overhead` [us] of the clock."""
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
    """Proxy of a planner; its one long call, the placement of the hull, has its own stopwatch."""

    def __init__(self, part: Any, watch: Stopwatch, placing: Stopwatch) -> None:
        self.period, self.init = part.period, part.init
        self._foresees = part
        self._step, self._spent, self._placing = watch.around(part.step), watch.spent, placing.spent
        self._state = WorkState.SETTLE  # of the last reference

    def ahead(self, *values: Any) -> Any:
        """Foresight of the planner."""
        return self._foresees.ahead(*values)

    def followed(self, *values: Any) -> Any:
        """State after foreseen periods."""
        return self._foresees.followed(*values)

    def step(self, state: Any, *values: Any) -> Any:
        """Step of the planner; a step that ends the scan counts as placement."""
        state, reference = self._step(state, *values)

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
        moment_ns = time.perf_counter_ns()

        inside = sum(watch.tally for watch in self._watches.values())
        if moment.tick:
            self.watch.spent.append(moment_ns - self._last - inside)

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
        """Time [us] of MuJoCo's own step: best of ten at each instant, mean over the instants."""
        best = []

        for data in self.copies:
            spent = []
            for _ in range(10):
                began = time.perf_counter_ns()
                mujoco.mj_step(self._model, data)
                spent.append(time.perf_counter_ns() - began)

            best.append(min(spent))
        return 1e-3 * float(np.mean(best))


def fresh(case: LoopCase) -> Assembly:
    """The job assembled from the seed, with its code loaded."""
    scenario = case.scenario()

    rehearse(assemble(to_rehearse(scenario), full=case.record))
    return assemble(scenario, full=case.record)


def digest(outcome: Run) -> str:
    """Hash of the recording, twelve hexadecimal digits."""
    word = hashlib.sha256()

    for name, series in sorted(outcome.recording.series.items()):
        word.update(name.encode() + series.value.tobytes())

    return word.hexdigest()[:12]


def as_it_is(case: LoopCase) -> tuple[Run, dict[str, float], Instants]:
    """Runs the unchanged job; returns outcome, processor times [s] (whole, identification,
    placement) and instants.
    """
    built = fresh(case)

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
    spent = {WHOLE: time.process_time() - began, SEEING: seeing.total, PLACING: placing.total}
    return outcome, spent, instants


def by_part(case: LoopCase) -> tuple[Run, dict[str, Stopwatch], Stopwatch]:
    """Runs the job with a stopwatch around every part; returns outcome, stopwatches and the one for
    the rest.
    """
    built = fresh(case)
    watches: dict[str, Stopwatch] = {}

    def watch(name: str) -> Stopwatch:
        return watches.setdefault(name, Stopwatch(time.perf_counter_ns))

    parts, plant, recorder = built.parts, built.plant, Recorder(built.plant.model, full=case.record)
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


def clock_reading() -> float:
    """Time [us] that a stopwatch takes within its own measurement."""
    clock = Stopwatch(time.perf_counter_ns)
    for nothing in [clock.around(lambda: None)] * _READINGS:
        nothing()
    return clock.typical(0.0)


@experiment("loop", quick={"record": LoopCase.record})
def loop(case: LoopCase) -> LoopRow:
    """Measures one job."""
    with one_core():
        outcome, spent, instants = as_it_is(case)
        again, watches, rest_watch = by_part(case)
        reading = clock_reading()
        mujoco_step = 1e-6 * instants.step_us()
    if digest(outcome) != digest(again):
        raise UuvError(f"the two runs differ: {digest(outcome)} and {digest(again)}")

    # time of each part; a stopwatch takes about as much outside its own measurement as within it
    steps = outcome.result.last.tick + 1
    parts = {name: watch for name, watch in watches.items() if name not in ONCE}
    calls = {name: len(watch.spent) / steps for name, watch in parts.items()}
    call = {name: 1e-6 * watch.typical(reading) for name, watch in parts.items()}
    step = {name: calls[name] * call[name] for name in parts}
    step[REST] = 1e-6 * rest_watch.typical(reading * sum(calls.values()))

    whole = sum(step.values())
    return LoopRow(
        digest=digest(outcome),
        steps=steps,
        simulated=outcome.recording.duration,
        mujoco_step=mujoco_step,
        part_by_part=str(outcome.result.part_by_part),
        processor=spent | {LOOP: spent[WHOLE] - spent[SEEING] - spent[PLACING]},
        calls=calls,
        call=call,
        step=step,
        share={name: value / whole for name, value in step.items()},
    )


def _over_mujoco(row: Mapping[str, Any], span: str) -> float:
    """Time of a span over that of MuJoCo's own steps."""
    return row["processor"][span] / row["steps"] / row["mujoco_step"]


loop.page = (
    Page()
    .table("Parts of a step", by="part", columns=["calls", "call", "step", "share"])
    .table(
        "The job, with compiled ticks",
        by="span",
        columns=[
            "processor",
            stat(
                "value",
                lambda row: 1e6 * row["processor"] / row["steps"],
                "a step",
                unit="µs",
                digits=1,
            ),
            stat(
                "value",
                lambda row: row["processor"] / row["steps"] / row["mujoco_step"],
                "over MuJoCo's step",
                digits=1,
            ),
            stat(
                "value",
                lambda row: row["simulated"] / row["processor"],
                "times real time",
                digits=0,
            ),
        ],
    )
    .table("The runs", columns=["steps", "simulated", "mujoco_step", "digest", "part_by_part"])
    .accept(
        stat("largest", lambda row: _over_mujoco(row, LOOP), "loop alone over MuJoCo's step"),
        most=GOAL,
    )
    .accept(
        stat("largest", lambda row: _over_mujoco(row, WHOLE), "whole run over MuJoCo's step"),
        most=GOAL_WHOLE,
    )
)

if __name__ == "__main__":
    run_scenario(loop.main)
