"""Phases with jaws, by the readings of a gripper: an object, nothing, a jam, silence, a slip."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from uuv.controllers.tasks.axial_phases import AxialLimits, Push
from uuv.controllers.tasks.grasping.jaw_phases import (
    CloseJaws,
    GripPlan,
    JawLimits,
    MoveJaws,
    dropped,
)
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, PhaseEvent
from uuv.sim.interfaces.messages import AbortCode, HeldLoad, JawMeasurement

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
