"""A saved run: a scenario up to the first step of a phase, to go on from as often as one likes."""

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

    That step is decided and not yet taken. Each run that goes on from here has the same bits as the
    run that never stopped. It is a value of this process: nothing later changes it, and there is no
    file of it.
    """

    scenario: Scenario  # with the failures that were added
    phase: WorkState
    time: float  # [s] simulated so far
    full: bool  # what the report needs is recorded
    snapshot: Snapshot = field(repr=False)  # as made by `snapshot_of`
    past: tuple[tuple[float, WorkState, float], ...] = field(repr=False)  # `Recorder.references`

    def with_failures(self, *failures: Failure) -> "SavedRun":
        """The same run with failures to come, as if its scenario had had them from the start.

        Args:
            failures: SensorFailure or ThrusterFailure, after the scenario's own perturbations.

        Raises:
            ConfigurationError: One is another perturbation, or would have begun by now.
        """
        for failure in failures:
            self._check(failure)
        perturbations = (*self.scenario.perturbations, *failures)
        return replace(self, scenario=replace(self.scenario, perturbations=perturbations))

    def _check(self, failure: Failure) -> None:
        """Refuse what would have acted by now."""
        kind = type(failure).__name__
        if not (isinstance(failure, Failure) and failure.joins):
            raise ConfigurationError(
                f"saved run: {kind} changes a run from its start; allowed SensorFailure, "
                "ThrusterFailure"
            )

        onset = failure.onset()
        for event in self.past:
            onset.notice(*event)

        if onset.began <= self.time:
            raise ConfigurationError(
                f"saved run: {kind} would have begun at {onset.began:.3f} s, and {self.phase} is "
                f"saved at {self.time:.3f} s; let it begin later, or save an earlier phase"
            )

    def check_before(self, phase: WorkState) -> None:
        """Refuse to go on to a phase that has begun.

        Raises:
            ConfigurationError: It is the one in which the run was saved, or was before.
        """
        if phase in (self.phase, *(state for _, state, _ in self.past)):
            raise ConfigurationError(
                f"phase: {phase} has begun, for the run was saved in {self.phase}, at "
                f"{self.time:.3f} s"
            )

    def resume(
        self, run: Rollout, recorder: Recorder | None, observers: Sequence[Observer]
    ) -> None:
        """Bring a new run of the scenario to where this one stands.

        Args:
            run: The new run, not begun.
            recorder: Of that run, new; None: it has none.
            observers: Of its loop; those of added failures come last.
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

        # Added failures have not begun; they notice the events so far.
        for onset in keepers[len(states) :]:
            for event in self.past:
                onset.notice(*event)


def snapshot_of(run: Rollout, recorder: Recorder, observers: Iterable[Observer]) -> Snapshot:
    """Copy of all that a run needs to go on.

    Args:
        run: It stands still (`uuv.sim.loop.rollout.run_on`).
        recorder: Of the run.
        observers: Of its loop; `check_observers` has passed them.

    Raises:
        ConfigurationError: The state of a part holds what cannot be copied.
    """
    keepers: Iterable[Any] = observers
    states = [keeper.save() if hasattr(keeper, "save") else None for keeper in keepers]
    saved = {"run": run.save(), "recorder": recorder.save(), "observers": states}
    return Snapshot(saved, "saved run: its state")


def check_observers(observers: Iterable[Observer]) -> None:
    """Refuse observers, of a task or a perturbation, that keep something and cannot be saved.

    Raises:
        ConfigurationError: One has attributes, but no `save` and `resume`.
    """
    for observer in observers:
        if not hasattr(observer, "save") and getattr(observer, "__dict__", True):
            raise ConfigurationError(
                f"saved run: observer {type(observer).__name__} has a state: it needs `save()`, "
                "which returns the state, and `resume(saved)`, which restores it"
            )


def checked_phase(name: str, planner: Planner | None = None) -> WorkState:
    """The phase of that name.

    Args:
        name: Such as "approach".
        planner: Of the task; None, or one that names no phases: any will do.

    Raises:
        ConfigurationError: There is no such phase, or it is the end of the run.
    """
    works = getattr(planner, "works", WorkState)
    phases = [str(phase) for phase in works if phase not in _ENDS]

    if name not in phases:
        owner = "a run" if planner is None else "this task"
        raise ConfigurationError(
            f"phase: {owner} has no phase {shown(name)}{did_you_mean(name, phases)}; allowed "
            f"{', '.join(phases)}"
        )
    return WorkState(name)
