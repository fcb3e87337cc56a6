"""Score of an entry from the true state: one row for each case, and a summary of all with
intervals.
"""

import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uuv.assembly import Assembly, assemble
from uuv.benchmark.cases import INSERTION, BenchmarkCase
from uuv.benchmark.door import EntryProcess, RemoteController, RemoteEstimator
from uuv.benchmark.entries import Entry
from uuv.benchmark.wire import Briefing, EntryError
from uuv.campaigns.run_outcome import CRASHED, DAMAGED, force_over_set
from uuv.components.contact_parts import estimator
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.experiment import Row, Summary, Table
from uuv.models.hydrodynamics import SEA_WATER
from uuv.runner import Run, run
from uuv.scenario import Control
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.evaluation.insertion_metrics import AT_THE_HOLE
from uuv.sim.evaluation.intervals import bootstrap_interval, share_interval
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.rollout import Moment
from uuv.tasks.surface_work import first_force

# seed of every briefing, since a number of the case itself would identify the case
ENTRY_SEED = 20260101
KEPT, MISSED, BROKEN, NOT_BEGUN, ENTRY_FAILED = (
    "kept",
    "missed",
    "broken off",
    "not begun",
    "entry failed",
)
FIGURES = ("force_rms_n", "force_peak_n", "path_max_m", "excursion_max_m", "energy_j")
DISC = 0.25  # [m] assumed diameter of a thruster's disc, which scales all energies equally
# [W]/[N]^1.5 for an ideal disc in still water
_POWER = (2.0 * SEA_WATER * np.pi * (0.5 * DISC) ** 2) ** -0.5
# loop steps between samples of the thrusts, which is less than the lag of the propellers
_SAMPLE_TICKS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredCase:
    """One case to be run with one entry, as a picklable value for a worker process."""

    case: BenchmarkCase
    entry: Entry
    in_process: bool = False  # no separate process: the controller runs in the simulation's process


class ThrusterEnergy:
    """Observer of the ideal energy, c |T|^1.5 of an actuator disc over thrusters and time."""

    slow_ticks = (_SAMPLE_TICKS,)

    def __init__(self, timestep: float) -> None:
        self._dt = _SAMPLE_TICKS * timestep
        self.energy = 0.0  # [J]

    def observe(self, moment: Moment) -> None:
        """Add one sample of the true thrusts."""
        if moment.tick % _SAMPLE_TICKS == 0:
            self.energy += _POWER * float(np.sum(np.abs(moment.truth.thrust) ** 1.5)) * self._dt


def score(scored: ScoredCase) -> Row:
    """Run an entry on a case and return a row of JSON types; an error of the run gives a row, too,
    with one line.

    The key `door` holds wall times, and is the only one that may differ between two runs.
    """
    row: Row = {
        "case": scored.case.index,
        "family": scored.case.family,
        "entry": scored.entry.name,
        "class": CRASHED,
        "detail": "",
        **dict.fromkeys((*FIGURES, "force_over_set", "collision_s", "simulated_s", "door")),
    }
    try:
        with entered(scored) as (built, process):
            energy = ThrusterEnergy(built.plant.timestep)
            outcome = run(built, observers=[energy])

        if process is not None:
            row["door"] = {
                "steps": process.steps,
                "waited_s": process.waited,
                "longest_s": process.longest,
            }
    except EntryError as error:
        return row | {"class": ENTRY_FAILED, "detail": str(error)}
    except UuvError as error:
        return row | {"class": NOT_BEGUN, "detail": str(error)}
    except Exception:
        return row | {"detail": traceback.format_exc()[-500:]}

    return row | figures(outcome, energy.energy) | _class(outcome)


@contextmanager
def entered(
    scored: ScoredCase, *, full: bool = False
) -> Iterator[tuple[Assembly, EntryProcess | None]]:
    """Context manager: the case assembled with its entry, and the entry's process, if any.

    Args:
        scored: Case and entry.
        full: Whether to record everything that a report needs.

    Raises:
        UuvError: The case cannot be assembled, or the entry cannot be made.
    """
    control = scored.entry.control
    if not scored.in_process:  # the entry's own module is not imported here
        control = replace(control, controller=Control().controller)

    built = assemble(scored.case.scenario(control), full=full)
    if scored.in_process:
        yield _in_process(built, scored.entry), None
        return

    with _process(built, scored) as process:
        yield behind_door(built, process), process


def _process(built: Assembly, scored: ScoredCase) -> EntryProcess:
    return EntryProcess(
        Briefing(
            model=built.own.model,
            water_error=built.scenario.belief.water_error,
            control=scored.entry.control,
            estimator=scored.entry.estimator,
            task=scored.case.family,
            seed=ENTRY_SEED,
        )
    )


def behind_door(built: Assembly, process: EntryProcess) -> Assembly:
    """The assembly with the controller of an entry's process, in the safety wrapper like every
    controller.

    Args:
        built: Assembly with the default controller.
        process: Process of the entry; its estimator, if it has one, replaces navigation.
    """
    parts = replace(
        built.parts, controller=SafetyWrapper(RemoteController(process), built.own.model)
    )
    if process.estimator_period is not None:
        parts = replace(parts, estimator=RemoteEstimator(process))
    return replace(built, loop=replace(built.loop, parts=parts))


def _in_process(built: Assembly, entry: Entry) -> Assembly:
    """The assembly with the entry's own estimator."""
    if not entry.estimator:
        return built
    parts = replace(built.parts, estimator=estimator(entry.estimator, built.own.model))
    return replace(built, loop=replace(built.loop, parts=parts))


def figures(outcome: Run, energy: float) -> dict[str, Any]:
    """Figures of a run from the true state, in SI units; None if the run ended before a figure
    existed.

    At a hole the force is that across the hole's axis, with a set value of 0.
    """
    metrics = outcome.assessment.metrics
    recording = outcome.recording
    off = np.linalg.norm(recording["p_WB"].value - recording["p_WB_reference"].value, axis=1)

    # Force error and path deviation, by the kind of work.
    if "insertion" in metrics:
        # At a hole there is no path on a surface.
        force = {
            name: metrics["insertion"][f"side_{name}"] for name in ("force_rms_n", "force_max_n")
        }
        force_figures = {
            "force_rms_n": force["force_rms_n"],
            "force_peak_n": force["force_max_n"],
            "path_max_m": None,
        }
        at_work = recording.within(*AT_THE_HOLE)
    else:
        contact = metrics["contact"]
        force_figures = {
            "force_rms_n": contact["force_error_rms_n"],
            "force_peak_n": contact["force_error_max_n"],
            "path_max_m": metrics["tool"]["path_deviation_max_m"],
            "force_over_set": force_over_set(recording, first_force(outcome.scenario)),
        }

        at_work = recording.within(WorkState.APPROACH, WorkState.PRESS, WorkState.WORK)

    return {
        **force_figures,
        "excursion_max_m": float(off[at_work].max()) if at_work.any() else None,
        "energy_j": energy,
        "collision_s": metrics["run"]["collision_s"],
        "simulated_s": recording.duration,
    }


def _class(outcome: Run) -> dict[str, Any]:
    """Class of the end of a run and its reason: damage first, then the way it ended, then the
    bounds.
    """
    metrics = outcome.assessment.metrics
    recording = outcome.recording
    surface = "contact" in metrics
    if surface and force_over_set(recording, first_force(outcome.scenario)) > DAMAGE:
        return {"class": DAMAGED, "detail": f"force above {DAMAGE:g} times the set force"}

    if metrics["run"]["collision_s"]:
        return {"class": DAMAGED, "detail": "collision of the vehicle"}

    if recording.final.state is not WorkState.DONE:
        begun = recording.within(*outcome.assembly.placed.begun).any()
        return {
            "class": BROKEN if begun else NOT_BEGUN,
            "detail": recording.final.note or "not finished in time",
        }

    if not metrics["accepted"]:
        return {"class": MISSED, "detail": "; ".join(metrics["failed"])}
    return {"class": KEPT, "detail": ""}


def line(row: Row) -> str:
    """Line about a finished case."""
    return f"case {row['case']:3d}, {row['family']}: {row['class']}" + (
        f": {row['detail']}" if row["detail"] else ""
    )


def share(good: int, of: int) -> dict[str, float]:
    """Share with its exact binomial confidence interval of 95 % (Clopper and Pearson)."""
    low, high = share_interval(good, of, "exact")
    return {"value": good / of, "low": low, "high": high}


def median(values: Sequence[float]) -> dict[str, float] | None:
    """Median with its bootstrap confidence interval of 95 % (fixed seed); None if there are no
    values.

    A single value has no interval. The median is taken over the runs that gave the figure. Runs
    that ended early count only in the share of kept runs.
    """
    if not values:
        return None

    median_of = {"value": float(np.median(values)), "of": len(values)}
    if len(values) < 2:
        return median_of

    interval = bootstrap_interval(np.median, np.array(values), rng=np.random.default_rng(0))
    return median_of | {"low": interval.low, "high": interval.high}


def totals(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Shares and medians over rows of one entry; those of force and path exclude insertions."""
    surface = [row for row in rows if row["family"] != INSERTION]
    by_figure = {
        name: median(
            [
                row[name]
                for row in (rows if name in ("excursion_max_m", "energy_j") else surface)
                if row[name] is not None
            ]
        )
        for name in FIGURES
    }

    doors = [row["door"] for row in rows if row["door"]]
    steps = sum(door["steps"] for door in doors)
    return {
        "runs": len(rows),
        "kept": share(sum(row["class"] == KEPT for row in rows), len(rows)),
        "damaged": share(sum(row["class"] == DAMAGED for row in rows), len(rows)),
        **by_figure,
        "step_wall_s": sum(door["waited_s"] for door in doors) / steps if steps else None,
        "step_longest_s": max((door["longest_s"] for door in doors), default=None),
    }


def by_family(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Number of runs and of kept runs, by family."""
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        count = counts.setdefault(row["family"], {"runs": 0, "kept": 0})
        count["runs"] += 1
        count["kept"] += row["class"] == KEPT
    return counts


def summary(rows: list[Row], about: Mapping[str, Any]) -> Summary:
    """Summary of the rows of one entry, with the versions of its cases and code."""
    total = totals(rows)
    families = by_family(rows)
    cells = [(name, f"{count['kept']} of {count['runs']}") for name, count in families.items()]

    lines = [line(row) for row in rows if row["detail"]]
    if total["step_wall_s"] is not None:
        lines.append(
            f"a step of the entry's process: {1e6 * total['step_wall_s']:.0f} us on average, "
            f"{1e3 * total['step_longest_s']:.1f} ms at most"
        )

    return Summary(
        metrics={"benchmark": about, "totals": total, "families": families, "rows": rows},
        tables=[
            Table(title=f"Passed by {about['entry']}", columns=("family", "passed"), rows=cells)
        ],
        lines=lines,
    )
