"""Experts: the project's own controllers and planners as policies of the tasks.

    environment = load("barrel", "press")
    policy = expert(environment)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))

Experts use the true state of the environment that they are made for.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import singledispatch
from typing import Protocol, TypeVar

import dm_env
import numpy as np
from dm_control import composer

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.hull_control import HullControl, HullControlState
from uuv.controllers.mkps import solve
from uuv.controllers.planning.trajectories import PoseMove
from uuv.controllers.tasks import contact_phases as contact
from uuv.controllers.tasks import insertion
from uuv.controllers.tasks.axial_phases import Push
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.grasping.collecting import rows_at_object
from uuv.controllers.tasks.grasping.jaw_phases import GripPlan, JawPhase, JawPhaseState
from uuv.controllers.tasks.grasping.turn_phases import TurnPlan
from uuv.controllers.tasks.grasping.turning import rows_at_handle
from uuv.controllers.tasks.hull_phases import HullMotion, RestLimits, Settle
from uuv.controllers.tasks.monitors import Reaction
from uuv.controllers.tasks.phase import (
    Context,
    Decide,
    Held,
    HoldTool,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
)
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, TaskState, at_once
from uuv.environments.actions import JointVelocities, ThrusterSpeeds, ToolAndJaws, ToolTwist
from uuv.environments.contact_tasks import (
    TOUCHED,
    ContactTask,
    InsertSampler,
    PressPoint,
    TapPoints,
    WipePath,
)
from uuv.environments.free_tasks import HoldStation, ReachPose
from uuv.environments.hands.hand_tasks import GraspObject, HandTask, TurnValve
from uuv.environments.true_state import TrueState
from uuv.environments.vehicle_task import VehicleTask
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    AbortCode,
    HeldLoad,
    JawMeasurement,
    JawReference,
    JawSetpoint,
    Reference,
    StateEstimate,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, readonly, transform_points

STANDOFF = 0.05  # [m] from the surface at which the tool begins its approach
# [m/s], [rad/s] speeds below which the hull counts as at rest before the work
QUIET = RestLimits(time=1.0)
FORCE_RATE = 60.0  # [N/s] largest rate of set forces
_STILL = np.zeros(3)
_Kind = TypeVar("_Kind")


class Policy(Protocol):
    """Policy: returns the action (k,) for a time step of the environment."""

    def __call__(self, timestep: dm_env.TimeStep, /) -> Array:
        """Action for a time step of the environment; at the first one of an episode the policy
        restarts.
        """
        ...


def zero(environment: composer.Environment) -> Policy:
    """Policy that always returns the middle of every action's range."""
    size = environment.action_spec().shape
    return lambda _: np.zeros(size)


def at_random(environment: composer.Environment, rng: np.random.Generator) -> Policy:
    """Policy of random actions, uniform within the bounds."""
    size = environment.action_spec().shape
    return lambda _: rng.uniform(-1.0, 1.0, size)


def expert(environment: composer.Environment) -> Policy:
    """Policy of the project's own controllers for the task of an environment.

    Raises:
        ConfigurationError: There is no expert for the task or for its kind of action, or
            `environment` is not one of dm_control.
    """
    if not isinstance(environment, composer.Environment):
        raise ConfigurationError(
            "expert: expected an environment of dm_control's composer, got "
            f"{type(environment).__name__}; a Gymnasium "
            "environment has it as `unwrapped.environment`"
        )
    return _expert(environment.task)


@singledispatch
def _expert(task: composer.Task) -> Policy:
    raise ConfigurationError(f"expert: there is none for {type(task).__name__}")


class StationExpert:
    """Station keeping and thrust allocation as policy, with a rest-to-rest move to the pose to
    hold.
    """

    def __init__(self, task: HoldStation) -> None:
        """Set up for a task with thrusters as action."""
        believed = task.vehicle.own
        self._task = task
        self._true = TrueState()
        self._control = HullControl(believed.model, period=task.control_timestep)
        self._home = np.array(believed.vehicle.q_home)

        armed = len(believed.vehicle.joints) > 0
        self._arm_B = (
            ArmDynamics(believed.model).wrench_at_rest(self._home) if armed else np.zeros(6)
        )
        self._state: HullControlState | None = None
        self._move: PoseMove | None = None

    def __call__(self, timestep: dm_env.TimeStep) -> Array:
        """Thruster commands."""
        task = self._task
        estimate = self._true.estimate(task.truth)

        # A new episode starts with the move from the start to the goal.
        if timestep.first() or self._state is None:
            self._state = self._control.init()
            limits = HullMotion()
            self._move = PoseMove.between(
                estimate.time,
                estimate.X_WB,
                task.X_WH,
                speed=limits.speed,
                acceleration=limits.acceleration,
                turn_rate=limits.turn_rate,
            )
        assert self._move is not None

        X_WB, v_WB_W = (
            self._move.at(estimate.time)
            if not self._move.done(estimate.time)
            else (task.X_WH, _STILL)
        )

        reference = Reference.holding(estimate.time, X_WB, self._home, v_WB_W=v_WB_W)

        return np.clip(self._control.step(self._state, estimate, reference, self._arm_B), -1.0, 1.0)


@_expert.register
def _station(task: HoldStation) -> Policy:
    _wants(task, ThrusterSpeeds)
    return StationExpert(task)


class ReachExpert:
    """Inverse kinematics by MKPS as policy; the joints move to the solution within their speed
    limits.
    """

    def __init__(self, task: ReachPose, actions: JointVelocities) -> None:
        """Set up for a task with joint velocities as action."""
        self._task = task
        self._actions = actions
        self._chain = task.vehicle.own.chain()
        self._X_BA = np.array(task.vehicle.own.vehicle.X_BA)

    def __call__(self, timestep: dm_env.TimeStep) -> Array:
        """Joint velocities towards the goal."""
        actions = self._actions
        truth = self._task.truth

        X_WA = np.eye(4)
        X_WA[:3, :3], X_WA[:3, 3] = truth.R_WB, truth.p_WB

        solution = solve(
            self._chain, inverse(X_WA @ self._X_BA) @ self._task.X_WH, truth.q, branch="keep"
        )

        return actions.action_to(solution.q, 5.0 * self._task.control_timestep)


@_expert.register
def _reach(task: ReachPose) -> Policy:
    return ReachExpert(task, _wants(task, JointVelocities))


class Align(Phase):
    """Phase that moves the tool to the stand-off in front of the path."""

    def __init__(
        self, tip: Callable[[StateEstimate], Array], within: float = 2e-3, seconds: float = 0.3
    ) -> None:
        """Take the tip's estimated position (3,) [m], its tolerance [m], and the time [s] it must
        be kept.
        """
        self._tip = tip
        self._within = within
        self._seconds = seconds

    def enter(self, held: Held, context: Context) -> list[float]:
        """Begin; the state is the time since which the tool is at the stand-off."""
        return [context.time]

    def step(self, state: list[float], held: Held, context: Context) -> Outcome:
        """Report DONE once the tool has been at the stand-off for that time."""
        if (
            float(np.linalg.norm(self._tip(context.estimate) - held.tool()[0][:3, 3]))
            > self._within
        ):
            state[0] = context.time
        return PhaseEvent.DONE if context.time - state[0] > self._seconds else None

    def setpoint(self, state: list[float], held: Held, context: Context) -> Setpoint:
        """Set point with the tool at the stand-off."""
        return Setpoint(X_WG=held.tool()[0])


class WorkExpert:
    """A table of the jobs' phases as policy: converts its set points of tool and force to
    twists.
    """

    def __init__(
        self, task: ContactTask | HandTask, actions: ToolTwist, rows: Iterable[tuple[str, TaskRow]]
    ) -> None:
        """Set up for a task with the tool's motion as action."""
        self._task = task
        self._actions = actions
        self._rows = tuple(rows)
        self._planner: TaskPlanner | None = None
        self._state: TaskState | None = None
        self._true = TrueState()

    @property
    def phase(self) -> str:
        """Name of the present row of the table."""
        return "" if self._state is None else self._state.row

    def __call__(self, timestep: dm_env.TimeStep) -> Array:
        """Twist and force towards the planner's set point."""
        actions = self._actions
        period = self._task.control_timestep

        if timestep.first():
            estimate = self.estimate()
            self._planner = TaskPlanner(
                self._rows, (), X_WB=estimate.X_WB, q=estimate.q, period=period
            )
            self._state = self._planner.init(estimate)
            return np.zeros(len(actions.names))

        assert actions.estimate is not None
        assert self._planner is not None
        assert self._state is not None
        estimate = self.estimate()
        self._state, reference = self._planner.step(self._state, estimate, None, actions.last)
        return self.action(reference)

    def estimate(self) -> StateEstimate:
        """The true state as an estimate."""
        return self._true.estimate(self._task.truth)

    def action(self, reference: Reference) -> Array:
        """Twist and force towards a set point."""
        actions = self._actions
        if reference.X_WG is None:
            return np.zeros(len(actions.names))

        # The set point at the end of the action.
        period = self._task.control_timestep
        X_WG = reference.X_WG.copy()
        X_WG[:3, 3] += period * reference.v_WG_W
        if np.any(reference.w_WG_W):
            X_WG[:3, :3] = exp_so3(period * reference.w_WG_W) @ X_WG[:3, :3]
        force = reference.set_force if reference.force_control else 0.0
        return actions.action_to(X_WG, force, reference.compliant, period)


_OFF = {Reaction.RETREAT: "parked"}  # a phase has aborted


def _begin(
    task: ContactTask | HandTask, *, offset: float, depth: float, then: str
) -> Iterable[tuple[str, TaskRow]]:
    """Rows up to the stand-off: the hull comes to rest, and the tool moves in front of the first
    point.
    """

    def stand(held: Held, context: Context) -> None:
        del context
        held.line, held.depth = task.place.line(offset), depth

    tip = task.vehicle.own.at_work().tip
    done = PhaseEvent.DONE
    yield (
        "stand",
        TaskRow(
            Decide(stand, AbortCode.OUT_OF_REACH), WorkState.SETTLE, {done: at_once("settle")}, _OFF
        ),
    )
    yield "settle", TaskRow(Settle(QUIET), WorkState.SETTLE, {done: "align"}, _OFF)
    yield "align", TaskRow(Align(tip), WorkState.CLOSE_IN, {done: then}, _OFF)
    yield "parked", TaskRow(HoldTool(STANDOFF), WorkState.DONE)


def _pressing(task: ContactTask, then: str) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the stand-off to the set force."""
    limits = contact.ApproachLimits(standoff=STANDOFF)
    done = PhaseEvent.DONE
    yield from _begin(task, offset=-STANDOFF, depth=0.0, then="approach")
    yield (
        "approach",
        TaskRow(contact.GuardedApproach(limits), WorkState.APPROACH, {done: "press"}, _OFF),
    )

    press = contact.Press(contact.PressLimits(), task.force, FORCE_RATE)
    yield "press", TaskRow(press, WorkState.PRESS, {done: then}, _OFF)


def _leaving(then: str) -> Iterable[tuple[str, TaskRow]]:
    """Rows in which the tool leaves the surface."""
    limits = contact.ApproachLimits(standoff=STANDOFF)
    done = PhaseEvent.DONE
    yield (
        "let go",
        TaskRow(contact.Unload(FORCE_RATE, limits.touch), WorkState.RETREAT, {done: "lift"}, _OFF),
    )
    yield (
        "lift",
        TaskRow(contact.Retreat(limits.speed, STANDOFF), WorkState.RETREAT, {done: then}, _OFF),
    )


@_expert.register
def _press(task: PressPoint) -> Policy:
    stay = TaskRow(contact.Dwell(np.inf), WorkState.WORK, {PhaseEvent.DONE: "parked"}, _OFF)
    return WorkExpert(task, _wants(task, ToolTwist), [*_pressing(task, "stay"), ("stay", stay)])


@_expert.register
def _wipe(task: WipePath) -> Policy:
    follow = contact.FollowPath(FollowLimits(), (task.force,), FORCE_RATE)
    ends = {PhaseEvent.DONE: "let go", PhaseEvent.MORE: "let go"}
    work = TaskRow(follow, WorkState.WORK, ends, _OFF)

    return WorkExpert(
        task,
        _wants(task, ToolTwist),
        [*_pressing(task, "work"), ("work", work), *_leaving("parked")],
    )


@_expert.register
def _tap(task: TapPoints) -> Policy:
    tip = task.vehicle.own.at_work().tip

    def mark(held: Held, context: Context) -> None:
        held.places = (*held.places, tip(context.estimate))

    done = PhaseEvent.DONE
    move = contact.NextPoint(task.points, FollowLimits(), STANDOFF)
    ends = {PhaseEvent.MORE: "approach", done: "parked"}

    rows = [
        *_pressing(task, "dwell"),
        ("dwell", TaskRow(contact.Dwell(TOUCHED), WorkState.WORK, {done: at_once("mark")}, _OFF)),
        (
            "mark",
            TaskRow(Decide(mark, AbortCode.OUT_OF_REACH), WorkState.WORK, {done: "let go"}, _OFF),
        ),
        *_leaving("next"),
        ("next", TaskRow(move, WorkState.CLOSE_IN, ends, _OFF)),
    ]
    return WorkExpert(task, _wants(task, ToolTwist), rows)


@_expert.register
def _insert(task: InsertSampler) -> Policy:
    job = insertion.InsertionJob(
        depth=task.hole.depth, inside=insertion.EntryLimits(nose=task.hole.tool_radius)
    )
    rows = insertion.rows_at_hole(job)

    begin = _begin(task, offset=0.0, depth=-job.axial.standoff, then="approach")
    return WorkExpert(task, _wants(task, ToolTwist), _beginning_with(begin, rows))


def _beginning_with(
    begin: Iterable[tuple[str, TaskRow]], rows: Iterable[tuple[str, TaskRow]]
) -> list[tuple[str, TaskRow]]:
    """A table that begins with the row "stand" of `begin`, whose rows replace those of `rows`."""
    table = {**dict(rows), **dict(begin)}
    first = ["stand", *(name for name in table if name != "stand")]
    return [(name, table[name]) for name in first]


class HoldUp(JawPhase):
    """Hold what is in the jaws at rest."""

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Go on for ever."""
        del state, jaws
        self._stand(held, context)
        return None


class GraspExpert(WorkExpert):
    """The phases of a collection, up to the lift, as policy."""

    def __init__(self, task: GraspObject, actions: ToolAndJaws) -> None:
        """Set up for a task with the tool's motion and the jaws as action."""
        job = task.job
        self._hand = actions
        self._grasping = task
        self._jaws: JawSetpoint | None = None

        def take(held: Held, context: Context) -> None:
            del context
            assert held.line is not None
            held.plan = GripPlan(
                opening=task.grasp.opening,
                width=task.grasp.width,
                bears=job.load,
                expected=_load_of(task, held.line.at(0.0, 0.0)[0]),
            )

        # The job's rows; what is lifted is held up.
        done = PhaseEvent.DONE
        rows = dict(rows_at_object(job, task.vehicle.own.vehicle.q_home))
        lift = rows["lift"]
        rows["lift"] = replace(lift, then={**lift.then, done: "hold up"})
        up = HoldUp(job.axial, Push(force=job.push, beyond=-np.inf), job.jaws, job.grip)
        rows["hold up"] = TaskRow(up, WorkState.WORK, {done: "parked"}, _OFF)
        rows["take"] = TaskRow(
            Decide(take, AbortCode.OUT_OF_REACH), WorkState.TARE, {done: "open"}, _OFF
        )

        begin = _begin(task, offset=0.0, depth=-job.axial.standoff, then=at_once("take"))
        super().__init__(task, actions, _beginning_with(begin, rows.items()))

    def __call__(self, timestep: dm_env.TimeStep) -> Array:
        """Twist, force and jaws towards the planner's set points."""
        if timestep.first():
            self._jaws = None
        return super().__call__(timestep)

    def estimate(self) -> StateEstimate:
        """The true state as an estimate, with the reading of the jaws' drive."""
        truth = self._grasping.truth
        reading = JawMeasurement(
            time=truth.time,
            opening=float(truth.jaws.opening[0]),
            speed=float(truth.jaws.speed[0]),
            force=-float(truth.jaws.force[0]),
        )
        return replace(super().estimate(), jaws=reading)

    def action(self, reference: Reference) -> Array:
        """Twist, force and jaws towards a set point; a set point of the jaws holds until the next
        one.
        """
        if isinstance(reference, JawReference):
            self._jaws = reference.jaws
        twist = super().action(reference)[:8]
        return np.concatenate([twist, self._hand.jaws_to(self._jaws)])


def _load_of(task: GraspObject, X_WG: Array) -> HeldLoad:
    """What the jaws will hold with the tool at `X_WG` (4, 4), with the weight of its water."""
    center_W = transform_points(task.place.X_WT, task.place.target.center)
    center_G = readonly(transform_points(inverse(X_WG), center_W))
    return HeldLoad(
        mass=task.displaced, displaced=task.displaced, center_G=center_G, buoyancy_G=center_G
    )


@_expert.register
def _grasp(task: GraspObject) -> Policy:
    return GraspExpert(task, _wants(task, ToolAndJaws))


@_expert.register
def _turn(task: TurnValve) -> Policy:
    work = task.work
    job = work.job

    def take(held: Held, context: Context) -> None:
        del context
        assert held.line is not None
        held.plan = TurnPlan(
            axis=work.planner.axis(task.place.X_WT),
            moment=job.moment,
            speed=job.speed,
            x_start=held.line.path.x[0],
        )

    rows = dict(rows_at_handle(job, task.vehicle.own.at_work(), lever=True))
    # The handle is held at its stop.
    turn = rows["turn"]
    rows["turn"] = replace(turn, then={**turn.then, PhaseEvent.DONE: "parked"})
    rows["take"] = TaskRow(
        Decide(take, AbortCode.OUT_OF_REACH), WorkState.TARE, {PhaseEvent.DONE: "approach"}, _OFF
    )
    begin = _begin(task, offset=0.0, depth=-job.axial.standoff, then=at_once("take"))
    return WorkExpert(task, _wants(task, ToolTwist), _beginning_with(begin, rows.items()))


def _wants(task: VehicleTask, kind: type[_Kind]) -> _Kind:
    """The task's actions; refused if they are not of the kind that the expert needs.

    Raises:
        ConfigurationError: The actions are of another kind.
    """
    if not isinstance(task.actions, kind):
        raise ConfigurationError(
            f"the expert of {type(task).__name__} needs the actions {kind.__name__}, got "
            f"{type(task.actions).__name__}"
        )
    return task.actions
