"""Foreseen periods of a task: the set points and the state of steps taken one by one."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from at_rest import at_rest
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks import contact_phases as contact
from uuv.controllers.tasks.approach_limits import ApproachLimits
from uuv.controllers.tasks.arrival import ScanLimits, ScanTarget, TareSensors
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.hull_phases import (
    HullMotion,
    KeepStation,
    MoveHull,
    RestLimits,
    Settle,
    Unfold,
)
from uuv.controllers.tasks.monitors import (
    Bounded,
    Monitor,
    Reaction,
    adrift,
    normal_force,
    too_much_force,
)
from uuv.controllers.tasks.phase import (
    INSTANT,
    Context,
    Decide,
    Foreseen,
    Held,
    Hold,
    Phase,
    PhaseEvent,
    ToolLine,
)
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, TaskState, at_once
from uuv.sim.interfaces.kernels.foresight import EstimateBounds
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ContactEstimate,
    Reference,
    StateEstimate,
    Target,
    ToolPath,
    WorkState,
)
from uuv.sim.interfaces.spatial import exp_so3, pose

PERIOD, LENGTH = 0.01, 0.12  # [s], [m]
X_WB = pose(exp_so3([0.3, -0.2, 1.1]), [1.0, 2.0, -3.0])
X_WB_far = pose(exp_so3([0.3, -0.2, 0.9]), [1.1, 1.9, -2.8])
SPEEDS = FollowLimits(speed=0.02, ramp=0.3, linger=0.5)
MONITORS = (
    Monitor(condition=adrift(0.5), reaction=Reaction.RISE, code=AbortCode.HULL_ADRIFT),
    Monitor(
        condition=too_much_force(90.0, normal_force),
        reaction=Reaction.RETREAT,
        code=AbortCode.FORCE_LIMIT,
        lasting=0.2,
    ),
)
PHASES: dict[str, Callable[[], Phase]] = {
    "follow": lambda: contact.FollowPath(SPEEDS, (60.0, 90.0), rate=200.0),
    "unload": lambda: contact.Unload(40.0, 1.0),
    "retreat": lambda: contact.Retreat(0.03, 0.05),
    "dwell": lambda: contact.Dwell(0.3),
    "approach": lambda: contact.GuardedApproach(ApproachLimits(touch=40.0)),
    "tare": lambda: TareSensors(0.1, 0.4),
    "move": lambda: MoveHull(HullMotion(), lambda _: X_WB_far),
    "unfold": lambda: Unfold(0.5),
    "station": lambda: KeepStation(0.3),
    "settle": lambda: Settle(RestLimits(time=0.4)),
    "hold": Hold,
}


def line() -> ToolLine:
    """A straight path, askew in W; the hull travels 0.3 m along y."""
    s, ones = np.linspace(0.0, LENGTH, 25), np.ones((25, 1))
    R = X_WB[:3, :3]
    path = ToolPath(
        s=s,
        p=X_WB[:3, 3] + s[:, None] * R[:, 0],
        z=-ones * R[:, 2],
        x=ones * R[:, 0],
        on_scan=np.ones(25, dtype=bool),
    )
    placement = Placement(
        X_WB=X_WB,
        travel_W=np.array([0.0, 0.3, 0.0]),
        roll=0.2,
        q_start=np.linspace(0.1, 0.6, 6),
        margin=1.0,
        reached=1.0,
    )
    return ToolLine(path=path, placement=placement, offset=-0.1)


def planner(phase: Phase, *more: Monitor) -> TaskPlanner:
    """A task of a phase at a path, and the end after it."""

    def stand(held: Held, context: Context) -> None:
        del context
        held.line, held.set_force = line(), 20.0

    first = Decide(stand, AbortCode.OUT_OF_REACH)
    done = {PhaseEvent.DONE: "end", PhaseEvent.MORE: "end", PhaseEvent.TOUCHED: "end"}
    leave: dict[Reaction, str] = dict.fromkeys((Reaction.RETREAT, Reaction.RISE), "end")
    rows = [
        ("first", TaskRow(first, WorkState.SETTLE, {PhaseEvent.DONE: at_once("phase")})),
        ("phase", TaskRow(phase, WorkState.WORK, done, leave)),
        ("end", TaskRow(Hold(), WorkState.RETREAT)),
    ]
    monitors = (*MONITORS, *more)
    return TaskPlanner(rows, monitors, X_WB=X_WB, q=np.zeros(6), period=PERIOD)


def seen(time: float, near: np.ndarray = X_WB) -> StateEstimate:
    """The hull at rest 1 cm off a pose."""
    return at_rest(time=time, X_WB=pose(near[:3, :3], near[:3, 3] + [0.01, 0.0, 0.0]))


def felt(normal: float) -> Command:
    """A command with an estimated normal force [N]."""
    force = ContactEstimate(force_W=np.array([0.0, 0.0, normal]), normal=normal)
    return Command(
        time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False, contact=force
    )


def same(one: Reference, other: Reference) -> bool:
    """True for two references with the same bits."""
    return all(
        np.array_equal(np.asarray(getattr(one, each.name)), np.asarray(getattr(other, each.name)))
        for each in fields(one)
        if each.name != "target"
    )


def begun(task: TaskPlanner, steps: int = 6) -> tuple[TaskState, StateEstimate]:
    """State after some periods in the phase, and the last estimate."""
    state, estimate = task.init(seen(0.0)), seen(0.0)
    for k in range(steps):
        estimate = seen(k * PERIOD)
        state, _ = task.step(state, estimate, None, felt(30.0))
    assert state.row == "phase"
    return state, estimate


@pytest.mark.parametrize("name", PHASES)
@pytest.mark.parametrize("taken", [1, 4, 11])
def test_foreseen_periods_are_those_of_steps_one_by_one(name: str, taken: int):
    task = planner(PHASES[name]())
    state, estimate = begun(task)
    times = [estimate.time + (k + 1) * PERIOD for k in range(taken)]
    stepped = deepcopy(state)
    foresight = task.ahead(state, estimate, None, times)
    assert foresight is not None
    assert len(foresight.references) == taken
    after = task.followed(state, foresight, taken)

    # One by one, with other forces and places within the bounds.
    for k, time in enumerate(times):
        stepped, reference = task.step(
            stepped, seen(time, stepped.held.X_WB), None, felt(25.0 + 0.1 * k)
        )
        assert same(reference, foresight.references[k])
    assert after.false_at == stepped.false_at

    # And on from there.
    for k in range(80):
        now = seen(times[-1] + (k + 1) * PERIOD, stepped.held.X_WB)
        stepped, one = task.step(stepped, now, None, felt(25.0))
        after, other = task.step(after, now, None, felt(25.0))
        assert same(one, other)
        assert stepped.row == after.row


def trailing(lag: float) -> Callable[[float, Held], StateEstimate]:
    """Estimates of a hull that is `lag` [m] behind its reference."""

    def trail(time: float, held: Held) -> StateEstimate:
        back = lag * np.array([0.6, -0.48, 0.64])
        return at_rest(time=time, X_WB=pose(held.X_WB[:3, :3], held.X_WB[:3, 3] - back))

    return trail


@pytest.mark.parametrize(
    ("phase", "lag"),
    [
        (MoveHull(HullMotion(), lambda _: X_WB_far), 0.175),  # slower from 0.18 on
        (Settle(RestLimits(time=1.6, error=0.06)), 0.0599),
    ],
)
def test_a_hull_just_within_a_bound_has_the_periods_of_steps_one_by_one(phase: Phase, lag: float):
    task = planner(phase)
    trail = trailing(lag)
    estimate = trail(0.0, Held(X_WB, X_WB, np.zeros(6)))
    state = task.init(estimate)
    for k in range(110):  # the move is at its fastest
        estimate = trail(k * PERIOD, state.held)
        state, _ = task.step(state, estimate, None, felt(30.0))
    assert state.row == "phase"

    # Foreseen, and one by one.
    times = [estimate.time + (k + 1) * PERIOD for k in range(20)]
    foresight = task.ahead(state, estimate, None, times)
    assert foresight is not None
    assert len(foresight.references) == len(times)
    stepped = deepcopy(state)
    after = task.followed(state, foresight, 12)
    for k, time in enumerate(times):
        if k == 12:
            assert pytest.approx(stepped.held.X_WB, abs=0.0) == after.held.X_WB
        stepped, reference = task.step(stepped, trail(time, stepped.held), None, felt(25.0))
        assert same(reference, foresight.references[k])


@pytest.mark.parametrize("name", PHASES)
def test_the_state_before_is_as_it_was_and_fewer_periods_can_be_followed(name: str):
    task = planner(PHASES[name]())
    state, estimate = begun(task)
    times = [estimate.time + (k + 1) * PERIOD for k in range(8)]
    foresight = task.ahead(state, estimate, None, times)
    assert foresight is not None
    fewer = task.followed(state, foresight, 3)
    again = task.ahead(fewer, estimate, None, times[3:])
    assert again is not None
    assert all(map(same, again.references, foresight.references[3:]))


def test_a_phase_that_ends_is_foreseen_up_to_its_end():
    task = planner(contact.Dwell(0.3))
    state, estimate = begun(task)
    times = [estimate.time + (k + 1) * PERIOD for k in range(60)]
    foresight = task.ahead(state, estimate, None, times)
    assert foresight is not None
    assert 20 < len(foresight.references) < 30
    after = task.followed(state, foresight, len(foresight.references))
    end = seen(times[len(foresight.references)])
    assert task.step(after, end, None, felt(25.0))[0].row == "end"


def test_the_bounds_are_the_narrowest_of_phase_and_monitors():
    hard = Bounded(lambda *_: "", lambda held: EstimateBounds(normal=held.set_force + 5.0))
    more = Monitor(condition=hard, reaction=Reaction.RETREAT, code=AbortCode.FORCE_LIMIT)
    task = planner(contact.FollowPath(SPEEDS, (60.0,), rate=200.0), more)
    state, estimate = begun(task)
    times = [estimate.time + (k + 1) * PERIOD for k in range(12)]
    foresight = task.ahead(state, estimate, None, times)
    assert foresight is not None
    forces = [state.held.set_force, *(r.set_force for r in foresight.references)]
    assert [w.normal for w in foresight.within] == [min(90.0, f + 5.0) for f in forces[:-1]]
    assert {w.off for w in foresight.within} == {0.5}

    moving = planner(MoveHull(HullMotion(), lambda _: X_WB_far))
    state, estimate = begun(moving)
    foresight = moving.ahead(state, estimate, None, times)
    assert foresight is not None
    assert HullMotion.behind is not None
    assert {w.off for w in foresight.within} == {0.18}


def test_the_wait_for_a_look_is_foreseen_up_to_it():
    """Whatever the last look has shown."""
    phase, where = ScanTarget(ScanLimits(interval=0.5)), Held(X_WB, X_WB, np.zeros(6))
    target = Target(
        time=1.0,
        X_WT=X_WB_far,
        accepted=True,
        check_m=0.0,
        range_m=2.0,
        reason="",
        path=line().path,
    )
    state = phase.enter(where, Context(1.0, PERIOD, seen(1.0), None, None))
    assert phase.foresee(state, where) == Foreseen(until=1.0 - INSTANT)
    look = Context(1.05, PERIOD, seen(1.05), target, None)
    assert phase.step(state, where, look) is None

    foreseen = phase.foresee(state, where)
    assert foreseen is not None
    stepped = deepcopy(state)
    times = [1.05 + k * PERIOD for k in range(1, 70)]
    waiting = [time for time in times if time < foreseen.until]
    assert len(waiting) == 49
    for time in times:
        later = Context(time, PERIOD, seen(time), target, None)
        assert phase.step(state, where, later) is None
        assert phase.setpoint(state, where, later).scan is (time not in waiting)
    assert (state.look_from, state.looks, state.in_vain) == (stepped.look_from, 1, 0)


class Feeling(contact.Dwell):
    """A dwell of one's own, which reads the estimate."""

    def step(self, state: Any, held: Held, context: Context) -> Any:
        """Longer in contact."""
        return None if context.normal > 0.0 else super().step(state, held, context)


class FeelingToo(Feeling):
    """The same, which says what is foreseen of it."""

    foresee = Phase.foresee


def test_what_may_look_at_the_estimate_is_not_foreseen():
    """A phase that overrides another's step, a monitor of one's own, a touch, a hull that moves."""

    def foreseen(phase: Phase, *more: Monitor, force: float = 30.0) -> bool:
        task = planner(phase, *more)
        state, estimate = begun(task)
        later = seen(estimate.time + PERIOD)
        state, _ = task.step(state, later, None, felt(force))
        return task.ahead(state, later, None, [later.time + PERIOD]) is not None

    monitor = Monitor(
        condition=lambda *_: "", reaction=Reaction.RETREAT, code=AbortCode.FORCE_LIMIT
    )
    assert foreseen(contact.Dwell(1.0))
    assert not foreseen(Feeling(1.0))
    assert foreseen(FeelingToo(1.0))
    assert not foreseen(contact.Dwell(1.0), monitor)
    assert foreseen(contact.Dwell(1.0), replace(monitor, during=frozenset({WorkState.SCAN})))
    approach = contact.GuardedApproach(ApproachLimits(touch=40.0))
    assert foreseen(approach)
    assert not foreseen(approach, force=50.0)
    assert not foreseen(Settle(RestLimits(error=0.001)))
