"""A saved run: a scenario up to the first step of a phase, which can be continued any number of
times.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from uuv.perturbations.loop import Failure
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.protocols import Planner
from uuv.sim.interfaces.spatial import shown
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Observer, Rollout
from uuv.sim.loop.snapshot import Snapshot

_ENDS = (WorkState.DONE, WorkState.ABORT)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SavedRun:
    """State of a run at the first step of a phase, made by `uuv.saved`; `uuv.run` continues it.

    The command of that step is decided, but not yet applied. Each continued run has the same bits
    as an uninterrupted run. A saved run exists in this process only: it does not change later, and
    is not a file.
    """

    scenario: Scenario  # including the failures that were added
    phase: WorkState
    time: float  # [s] simulated so far
    full: bool  # whether everything that the report needs is recorded
    snapshot: Snapshot = field(repr=False)  # result of `snapshot_of`
    # result of `Recorder.references`
    past: tuple[tuple[float, WorkState, float], ...] = field(repr=False)

    def with_failures(self, *failures: Failure) -> "SavedRun":
        """The same run with later failures, as if they had been part of its scenario from the
        start.

        Args:
            failures: SensorFailure or ThrusterFailure, after the scenario's own perturbations.

        Raises:
            ConfigurationError: A failure is another perturbation, or would already have begun.
        """
        for failure in failures:
            self._check(failure)
        perturbations = (*self.scenario.perturbations, *failures)
        return replace(self, scenario=replace(self.scenario, perturbations=perturbations))

    def _check(self, failure: Failure) -> None:
        """Refuse a failure that would already have acted."""
        kind = type(failure).__name__
        if not (isinstance(failure, Failure) and failure.joins):
            raise ConfigurationError(
                f"saved run: must get SensorFailure or ThrusterFailure, got {kind}, which changes "
                "a run from its start"
            )

        onset = failure.onset()
        for event in self.past:
            onset.notice(*event)

        if onset.began <= self.time:
            raise ConfigurationError(
                f"saved run: {kind} would have begun at {onset.began:.3f} s, before {self.phase} "
                f"was saved at {self.time:.3f} s; let it begin later, or save an earlier phase"
            )

    def check_before(self, phase: WorkState) -> None:
        """Refuse to continue to a phase that has begun.

        Raises:
            ConfigurationError: The phase is the one in which the run was saved, or an earlier one.
        """
        if phase in (self.phase, *(state for _, state, _ in self.past)):
            raise ConfigurationError(
                f"phase: must be later than {self.phase}, in which the run was saved at "
                f"{self.time:.3f} s, got {phase}, which has begun"
            )

    def resume(
        self, run: Rollout, recorder: Recorder | None, observers: Sequence[Observer]
    ) -> None:
        """Bring a new run of the scenario to the state of this saved run.

        Args:
            run: The new run, not begun.
            recorder: New recorder of that run; None: the run has none.
            observers: Observers of the new run; those of added failures come last.
        """
        saved = self.snapshot.copy()
        run.resume(saved["run"])
        if recorder is not None:
            recorder.resume(saved["recorder"])

        states = saved["observers"]
        keepers: Sequence[Any] = observers
        for keeper, state in zip(keepers, states, strict=False):
            if state is not None:
                keeper.resume(state)

        # Added failures have not begun; they are informed of the events so far.
        for onset in keepers[len(states) :]:
            for event in self.past:
                onset.notice(*event)


def snapshot_of(run: Rollout, recorder: Recorder, observers: Iterable[Observer]) -> Snapshot:
    """Copy of everything that a run needs to continue.

    Args:
        run: A paused run (`uuv.sim.loop.rollout.run_on`).
        recorder: Recorder of the run.
        observers: Observers of the run, checked by `check_observers`.

    Raises:
        ConfigurationError: The state of a component contains an object that cannot be copied.
    """
    keepers: Iterable[Any] = observers
    states = [keeper.save() if hasattr(keeper, "save") else None for keeper in keepers]
    saved = {"run": run.save(), "recorder": recorder.save(), "observers": states}
    return Snapshot(saved, "saved run: its state")


def check_observers(observers: Iterable[Observer]) -> None:
    """Refuse observers, of a task or a perturbation, that have a state and cannot be saved.

    Raises:
        ConfigurationError: An observer has attributes, but no `save` and `resume`.
    """
    for observer in observers:
        if not hasattr(observer, "save") and getattr(observer, "__dict__", True):
            raise ConfigurationError(
                f"saved run: observer {type(observer).__name__} has a state, so it must have "
                "`save()`, which returns the state, and `resume(saved)`, which restores it"
            )


def checked_phase(name: str, planner: Planner | None = None) -> WorkState:
    """The phase with a name.

    Args:
        name: Name such as "approach".
        planner: Planner of the task; if it is None, or lists no phases, any name is accepted.

    Raises:
        ConfigurationError: There is no such phase, or the phase is the end of the run.
    """
    works = getattr(planner, "works", WorkState)
    phases = [str(phase) for phase in works if phase not in _ENDS]

    if name not in phases:
        owner = "a run" if planner is None else "this task"
        raise ConfigurationError(
            f"phase: must be one of {', '.join(phases)} of {owner}, got "
            f"{shown(name)}{did_you_mean(name, phases)}"
        )
    return WorkState(name)
