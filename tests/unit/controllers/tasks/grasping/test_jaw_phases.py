"""Phases with jaws, by the readings of a gripper: an object, nothing, a jam, silence, a slip."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from uuv.controllers.tasks.axial_phases import AxialLimits, Push
from uuv.controllers.tasks.grasping.jaw_phases import (
    CloseJaws,
    Depart,
    GripPlan,
    JawLimits,
    LetGo,
    Lift,
    MoveJaws,
    dropped,
    weight_gone,
)
from uuv.controllers.tasks.phase import Abort, Context, Held, Hold, Outcome, PhaseEvent
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ContactEstimate,
    HeldLoad,
    JawMeasurement,
)

PERIOD, FORCE, WIDTH = 0.01, 40.0, 0.06  # [s], [N], [m]
AXIAL = AxialLimits(standoff=0.1, approach_speed=0.03, speed=0.02, longest=60.0, force_limit=80.0)
LIMITS = JawLimits()
EXPECTED = HeldLoad(mass=0.3, displaced=0.3, center_G=np.zeros(3), buoyancy_G=np.zeros(3))
PARTS = (AXIAL, Push(force=20.0, beyond=-1.0), LIMITS, FORCE)


def held_with(plan: GripPlan) -> Held:
    """A tool at the object."""
    return Held(X_WB=np.eye(4), X_WB_scan=np.eye(4), q=np.zeros(6), plan=plan)


def plan() -> GripPlan:
    """The grasp of an object of WIDTH."""
    return GripPlan(opening=0.08, width=WIDTH, bears=12.0, expected=EXPECTED)


def seen(time: float, jaws: JawMeasurement | None) -> Context:
    """A period with a reading of the gripper, and no force at the tip."""
    estimate: Any = SimpleNamespace(time=time, jaws=jaws)
    return Context(time, PERIOD, estimate, None, None)


def standing(
    time: float, opening: float, force: float = FORCE, speed: float = 0.0
) -> JawMeasurement:
    """A reading."""
    return JawMeasurement(time=time, opening=opening, speed=speed, force=force)


def outcome(phase: Any, held: Held, jaws: Any, seconds: float = 20.0) -> tuple[Outcome, float]:
    """How a phase ends, and when, under readings `jaws(time)`."""
    state = phase.enter(held, seen(0.0, None))
    for step in range(round(seconds / PERIOD)):
        time = step * PERIOD
        ended = phase.step(state, held, seen(time, jaws(time)))
        if ended is not None:
            return ended, time
    return None, seconds


def test_jaws_that_stand_and_press_on_the_objects_width_hold_it() -> None:
    held = held_with(plan())
    ended, time = outcome(CloseJaws(*PARTS), held, lambda t: standing(t, WIDTH - 2e-3))
    assert ended is PhaseEvent.DONE
    assert time == pytest.approx(LIMITS.held, abs=2 * PERIOD)
    assert held.plan_of(GripPlan).gripped == pytest.approx(WIDTH - 2e-3)


def test_jaws_that_still_move_or_press_too_little_do_not_hold() -> None:
    for reading in (
        lambda t: standing(t, WIDTH, speed=-0.01),
        lambda t: standing(t, WIDTH, force=0.5 * FORCE),
    ):
        ended, time = outcome(CloseJaws(*PARTS), held_with(plan()), reading)
        assert isinstance(ended, Abort)
        assert ended.code is AbortCode.JAWS
        assert time == pytest.approx(LIMITS.within, abs=2 * PERIOD)


def test_jaws_that_close_on_nothing_try_again_and_then_give_up() -> None:
    held = held_with(plan())
    phase = CloseJaws(*PARTS)

    def shut(time: float) -> JawMeasurement:
        return standing(time, 5e-4, force=0.0)

    assert outcome(phase, held, shut)[0] is PhaseEvent.REFUSED
    ended, _ = outcome(phase, held, shut)
    assert isinstance(ended, Abort)
    assert ended.code is AbortCode.NOT_GRIPPED
    assert "60 mm between the jaws in 2 attempts: they closed to 0 mm" in ended.reason


def test_stuck_and_silent_jaws_are_named() -> None:
    ended, _ = outcome(MoveJaws(*PARTS), held_with(plan()), lambda t: standing(t, 0.03))
    assert isinstance(ended, Abort)
    assert ended == Abort(AbortCode.JAWS, "the jaws are stuck at 30 mm on the way to 80 mm")

    old = standing(0.0, 0.03)
    ended, time = outcome(MoveJaws(*PARTS), held_with(plan()), lambda _: old)
    assert isinstance(ended, Abort)
    assert "silent" in ended.reason
    assert time == pytest.approx(LIMITS.silent, abs=2 * PERIOD)
    assert isinstance(outcome(MoveJaws(*PARTS), held_with(plan()), lambda _: None)[0], Abort)


def test_open_jaws_are_done_at_their_opening_and_are_asked_for_it() -> None:
    held = held_with(plan())
    phase = MoveJaws(*PARTS)
    assert outcome(phase, held, lambda t: standing(t, 0.0795))[0] is PhaseEvent.DONE
    assert phase.jaws_set(held).opening == 0.08
    assert CloseJaws(*PARTS).jaws_set(held).opening == 0.0
    assert CloseJaws(*PARTS).jaws_set(held).force == FORCE


def test_an_object_has_slipped_out_once_the_jaws_close_further() -> None:
    condition = dropped(LIMITS)
    held = held_with(plan())
    assert condition(held, seen(1.0, standing(1.0, 0.0))) == ""  # nothing was held
    held.plan = replace(plan(), gripped=WIDTH, carried=True)
    assert condition(held, seen(1.0, standing(1.0, WIDTH - 1e-3))) == ""
    assert "from 60 to 50 mm" in condition(held, seen(1.0, standing(1.0, WIDTH - 0.01)))


def pulled(time: float, jaws: JawMeasurement, pull: float) -> Context:
    """A period in which the world pulls the tip down by `pull` [N]."""
    contact = ContactEstimate(force_W=np.array([0.0, 0.0, -pull]), normal=-pull)
    last = Command(
        time=time, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False, contact=contact
    )
    return replace(seen(time, jaws), last=last)


def holding(depth: float, weight: float = 10.0) -> Held:
    """A tool with an object of that weight [N] in the jaws, `depth` [m] from its place."""
    load = replace(EXPECTED, mass=EXPECTED.displaced + weight / 9.81)
    held = held_with(replace(plan(), gripped=WIDTH, load=load, carried=True, tries=1))
    held.depth = depth
    return held


def test_jaws_that_press_wider_than_the_object_are_said_to_jam() -> None:
    held = held_with(replace(plan(), tries=1))
    ended, _ = outcome(CloseJaws(*PARTS), held, lambda t: standing(t, WIDTH + 0.02))
    assert isinstance(ended, Abort)
    assert ended.code is AbortCode.JAWS
    assert "press at 80 mm, and the object has 60 mm" in ended.reason


def test_a_slip_in_the_lift_is_gripped_once_more_and_then_given_up() -> None:
    def slips(time: float) -> JawMeasurement:
        return standing(time, WIDTH - (0.01 if time > 0.5 else 0.0))

    for tries, expected in ((1, PhaseEvent.REFUSED), (LIMITS.tries, AbortCode.DROPPED)):
        held = held_with(replace(plan(), gripped=WIDTH, tries=tries))
        ended, time = outcome(Lift(*PARTS), held, slips)
        assert time == pytest.approx(0.5, abs=2 * PERIOD)
        assert (ended.code if isinstance(ended, Abort) else ended) is expected


def test_a_lift_ends_where_the_pull_is_more_than_the_load_may_be() -> None:
    phase = Lift(*PARTS)
    most = LIMITS.heavier * plan().bears + LIMITS.pull
    for pull, goes_on in ((0.95 * most, True), (1.05 * most, False)):
        held = held_with(replace(plan(), gripped=WIDTH))
        state = phase.enter(held, seen(0.0, None))
        jaws = standing(0.0, WIDTH)
        ends = [phase.step(state, held, pulled(k * PERIOD, jaws, pull)) for k in range(20)]
        assert all(end is None for end in ends) is goes_on
        if not goes_on:
            last = next(end for end in ends if end is not None)
            assert isinstance(last, Abort)
            assert last.code is AbortCode.TOO_HEAVY


def test_what_hangs_free_is_kept_and_what_is_on_the_ground_is_let_go() -> None:
    for depth, kept in ((-0.1, True), (-0.5 * LIMITS.clear, False)):
        held = holding(depth)
        phase = LetGo(*PARTS)
        state = phase.enter(held, pulled(0.0, standing(0.0, WIDTH), 0.0))
        ended = phase.step(state, held, pulled(0.0, standing(0.0, WIDTH), 0.0))
        assert (ended is PhaseEvent.DONE) is kept
        setpoint = phase.jaws_set(held)
        assert (setpoint.opening, setpoint.holds is not None) == ((0.0 if kept else 0.08), kept)

        # The same beside another phase.
        held = holding(depth)
        depart = Depart(Hold(), LIMITS, FORCE)
        context = pulled(0.0, standing(0.0, WIDTH), 0.0)
        depart.enter(held, context)
        jaws = depart.setpoint(None, held, context).jaws
        assert jaws is not None
        assert jaws.opening == (0.0 if kept else 0.08)


def test_a_weight_that_is_missing_is_a_drop_whether_it_pulls_down_or_up() -> None:
    condition = weight_gone(LIMITS)
    jaws = standing(1.0, WIDTH)
    for weight in (30.0, -30.0):
        held = holding(-0.1, weight)
        assert condition(held, pulled(1.0, jaws, 0.0)) == ""
        assert "of its" in condition(held, pulled(1.0, jaws, -weight))
        assert condition(held, pulled(1.0, jaws, weight)) == ""
        context = pulled(1.0, jaws, -weight)
        phase = LetGo(*PARTS)
        phase.enter(held, context)  # what has dropped is not kept
        assert held.plan_of(GripPlan).load is None
