"""A task: a table of phases with their successors, and monitors; run by `TaskPlanner`."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from uuv.controllers.tasks.monitors import Bounded, BoundsOfPeriod, Monitor, Reaction, watch
from uuv.controllers.tasks.phase import (
    NO_ESTIMATE,
    Abort,
    Context,
    Held,
    Phase,
    PhaseEvent,
    Setpoint,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels.foresight import EstimateBounds, Foresight, is_plain
from uuv.sim.interfaces.kernels.slots import gives_kernel
from uuv.sim.interfaces.messages import (
    Command,
    Fault,
    FaultKind,
    JawReference,
    Reference,
    StateEstimate,
    Target,
    TurnReference,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array

_FELT = EstimateBounds(normal=1e9)  # any force, but a number


class AtOnce(str):
    """Name of a row whose phase takes its first step in the same period."""


def at_once(name: str) -> AtOnce:
    """The row `name`, stepped in the period in which it is entered."""
    return AtOnce(name)


@dataclass(frozen=True, slots=True, eq=False)
class TaskRow:
    """One phase of a task, and its successors."""

    phase: Phase
    work: WorkState  # as reported; DONE is reported as ABORT if the work was broken off
    # next row, by the event that ends the phase
    then: Mapping[PhaseEvent, str] = field(default_factory=dict)
    # next row, by the reaction; RETREAT also for an Abort
    leave: Mapping[Reaction, str] = field(default_factory=dict)
    feels: bool = False  # an estimate of the contact force is needed


@dataclass(slots=True, eq=False)
class TaskState:
    """State of a task."""

    row: str  # name of the present row
    since: float  # [s] time at which it was entered
    phase: Any  # state of its phase
    held: Held
    false_at: list[float]  # [s] for each monitor, the time at which its condition was last false
    abort: Abort | None = None  # why the work was broken off
    lost_thrusters: tuple[Fault, ...] = ()


def _copied(state: TaskState) -> TaskState:
    """A state that may be stepped ahead of time (`Phase.foresee`)."""
    return replace(state, phase=copy(state.phase), held=copy(state.held))


class TaskPlanner:
    """Planner (`uuv.sim.interfaces.protocols.Planner`) that runs a table of phases."""

    def __init__(
        self,
        rows: Iterable[tuple[str, TaskRow]],
        monitors: Sequence[Monitor],
        *,
        X_WB: Array,
        q: Array,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            rows: names and rows, the first one to begin with.
            monitors: what is watched in every period.
            X_WB: (4, 4) hull pose to hold first, from which the target is scanned.
            q: (n,) [rad] joint angles to hold first.
            period: [s] of the planner.

        Raises:
            ConfigurationError: if a row follows that is not in the table.
        """
        self.period = period
        self._rows = dict(rows)
        self._monitors = tuple(monitors)
        self._X_WB = np.array(X_WB)
        self._q = np.array(q)

        for name, row in self._rows.items():
            for after in (*row.then.values(), *row.leave.values()):
                if after not in self._rows:
                    raise ConfigurationError(
                        f"task row {name!r}: there is no row {after!r} to follow it"
                    )

        # Bounds of the rows that can be foreseen.
        by_row = {name: self._bounds_of(row) for name, row in self._rows.items()}
        self._bounds = {name: bounds for name, bounds in by_row.items() if bounds is not None}

    def _bounds_of(self, row: TaskRow) -> tuple[EstimateBounds, tuple[BoundsOfPeriod, ...]] | None:
        """Bounds of a row's monitors, in all periods and by period; None if the row is not
        foreseen.
        """
        watched = [monitor.condition for monitor in self._monitors if row.work in monitor.during]
        bounded = [condition for condition in watched if isinstance(condition, Bounded)]
        if len(bounded) < len(watched) or not gives_kernel(row.phase, "foresee"):
            return None

        bounds = [condition.bounds for condition in bounded]
        felt = _FELT if row.feels else EstimateBounds()
        always = felt.and_within(*(bound for bound in bounds if isinstance(bound, EstimateBounds)))
        return always, tuple(bound for bound in bounds if not isinstance(bound, EstimateBounds))

    @property
    def works(self) -> tuple[WorkState, ...]:
        """Phases, as reported, in the order of the table."""
        return tuple(dict.fromkeys(row.work for row in self._rows.values()))

    def init(self, estimate: StateEstimate) -> TaskState:
        """State at the start: the first row."""
        held = Held(X_WB=self._X_WB, X_WB_scan=self._X_WB, q=self._q)
        state = TaskState("", estimate.time, None, held, [0.0] * len(self._monitors))

        self._enter(
            state, next(iter(self._rows)), Context(estimate.time, self.period, estimate, None, None)
        )
        return state

    def with_path(self, target: Target) -> Target:
        """The accepted target with the path of the task; the finder's path unless overridden."""
        return target

    def step(
        self, state: TaskState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[TaskState, Reference]:
        """Advance the task by one period.

        Args:
            state: state of the task, changed in place.
            estimate: estimated state of the vehicle.
            target: newest identification, if any.
            last: the controller's last command, with its estimate of the contact force and its
                faults.

        Returns:
            The state and the reference for the controller.

        Raises:
            ConfigurationError: if the controller does not estimate the contact force in a phase
                that needs it.
        """
        time = estimate.time if math.isfinite(estimate.time) else state.since
        if target is not None and target.accepted:
            target = self.with_path(target)
        now = Context(time, self.period, estimate, target, last)

        faults = last.faults if last is not None else ()
        state.lost_thrusters = tuple(fault for fault in faults if fault.kind is FaultKind.THRUSTER)

        while isinstance(self._advance(state, now), AtOnce):
            pass
        return state, self._reference(state, now)

    def ahead(
        self,
        state: TaskState,
        estimate: StateEstimate,
        target: Target | None,
        times: Sequence[float],
    ) -> Foresight | None:
        """The next periods, as long as the present phase depends on time alone.

        Args:
            state: after the present step; it is not changed.
            estimate: of the present step.
            target: newest target, or None.
            times: [s] of the estimates of the next steps.

        Returns:
            The periods; None: not even the next one can be foreseen.
        """
        row = self._rows[state.row]
        phase = row.phase
        bounds = self._bounds.get(state.row)
        foreseen = None if bounds is None else phase.foresee(state.phase, state.held)
        if foreseen is None or bounds is None:
            return None
        always, varying = bounds
        steady = foreseen.within.and_within(always)

        # Steps on a copy.
        trial = _copied(state)
        references: list[Reference] = []
        within: list[EstimateBounds] = []
        for time in times:
            if not time < foreseen.until:
                break
            narrow = steady.and_within(*[of_period(trial.held) for of_period in varying])
            context = self._foreseen(time, trial.held, estimate, target)
            ended = phase.step(trial.phase, trial.held, context) is not None
            reference = None if ended else self._reference(trial, context)
            if reference is None or not is_plain(reference):
                trial = None
                break
            references.append(reference)
            within.append(narrow)

        if not references:
            return None
        seen = estimate, target
        return Foresight(references, times[: len(references)], within, seen, trial)

    def followed(self, state: TaskState, foresight: Foresight, periods: int) -> TaskState:
        """State after `periods` of the periods that `ahead` foresaw for `state`."""
        after = foresight.after
        if after is None or periods < len(foresight.times):
            after = _copied(state)
            phase = self._rows[state.row].phase
            for time in foresight.times[:periods]:
                context = self._foreseen(time, after.held, *foresight.seen)
                phase.step(after.phase, after.held, context)

        after.false_at = [foresight.times[periods - 1]] * len(self._monitors)
        return after

    def _foreseen(
        self, time: float, held: Held, estimate: StateEstimate, target: Target | None
    ) -> Context:
        """Inputs of a phase in a foreseen period, with the hull at its reference.

        The hull's own place is that of the present step, and the reference moves on: a lag would
        grow that no vehicle has. The true one is watched by the bounds.
        """
        return Context(time, self.period, replace(estimate, X_WB=held.X_WB), target, None)

    def _advance(self, state: TaskState, context: Context) -> str | None:
        """Check the monitors and step the present phase; returns the name of the row that is
        entered, if any.
        """
        row = self._rows[state.row]
        if row.feels and context.last is not None and not context.last.contact.known:
            raise ConfigurationError(NO_ESTIMATE)

        reaction, cause = watch(self._monitors, state.false_at, row.work, state.held, context)
        if reaction in row.leave:
            state.abort = cause if cause is None else cause.after(state.abort)
            row = self._enter(state, row.leave[reaction], context)

        if reaction is Reaction.PAUSE:
            context = replace(context, paused=True)

        # Step the phase; what follows is in its row
        outcome = row.phase.step(state.phase, state.held, context)
        if outcome is None:
            return None
        if isinstance(outcome, Abort):
            state.abort = outcome.after(state.abort)
            after = row.leave[Reaction.RETREAT]
        else:
            after = row.then[outcome]

        self._enter(state, after, context)
        return after

    def _enter(self, state: TaskState, name: str, context: Context) -> TaskRow:
        """Change to the row `name`."""
        row = self._rows[name]
        state.phase = row.phase.enter(state.held, context)
        state.row = str(name)
        state.since = context.time
        return row

    def path_s(self, held: Held) -> float:
        """Arc length [m] reached, as it is reported."""
        return held.s

    def _reference(self, state: TaskState, context: Context) -> Reference:
        """Reference for the controller in the present phase."""
        row = self._rows[state.row]
        held = state.held
        abort = state.abort
        setpoint = row.phase.setpoint(state.phase, held, context)
        kind = _kind(setpoint)

        return kind(
            time=context.time,
            state=WorkState.ABORT if row.work is WorkState.DONE and abort is not None else row.work,
            X_WB=held.X_WB,
            v_WB_W=setpoint.v_WB_W,
            w_WB_W=setpoint.w_WB_W,
            X_WG=setpoint.X_WG,
            v_WG_W=setpoint.v_WG_W,
            w_WG_W=setpoint.w_WG_W,
            q=held.q,
            qd=np.zeros(len(held.q)) if setpoint.qd is None else setpoint.qd,
            set_force=setpoint.set_force,
            force_control=setpoint.force_control,
            compliant=setpoint.compliant,
            standing=setpoint.standing,
            tare=setpoint.tare,
            scan=setpoint.scan,
            touch=setpoint.touch,
            # for the report
            path_s=self.path_s(held),
            abort=None if abort is None else abort.code,
            note=held.note if abort is None else abort.reason,
            lost_thrusters=tuple(fault.index for fault in state.lost_thrusters),
            lost_thrust=tuple(fault.thrust for fault in state.lost_thrusters),
            target=held.target,
            promise=held.promise,
            at_rest=setpoint.at_rest,
        )


def _kind(setpoint: Setpoint) -> Callable[..., Reference]:
    """What makes the reference of a set point: that of a gripper, or of a handle, where asked."""
    if setpoint.jaws is not None:
        return partial(JawReference, jaws=setpoint.jaws)
    if setpoint.handle is not None:
        return partial(TurnReference, handle=setpoint.handle)
    return Reference
