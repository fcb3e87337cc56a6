"""Phases with a plug in the jaws, by forces and readings: stuck, limp, slipped, seated."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.axial_phases import Push
from uuv.controllers.tasks.grasping.jaw_phases import GripPlan, LetGo
from uuv.controllers.tasks.grasping.plug_phases import PullOut, SeatPlug, WithPlug
from uuv.controllers.tasks.grasping.plugging import LENGTH, PlugJob
from uuv.controllers.tasks.insertion import EntryState
from uuv.controllers.tasks.phase import Abort, Context, Held, Hold, Outcome, PhaseEvent, ToolLine
from uuv.sim.interfaces.messages import (
    AbortCode,
    ContactEstimate,
    HeldLoad,
    JawMeasurement,
    ToolPath,
)

PERIOD, WIDTH, GRIP = 0.01, 0.03, 70.0  # [s], [m], [N]
JOB = PlugJob()
LOADED = Push(force=JOB.push, beyond=-1.0)
EXPECTED = HeldLoad(mass=0.8, displaced=0.2, center_G=np.zeros(3), buoyancy_G=np.zeros(3))
AXIS = np.array([0.0, 0.0, -1.0])


def pulling() -> PullOut:
    return PullOut(replace(JOB.axial, speed=JOB.pull_speed), LOADED, JOB.jaws, GRIP, JOB.out)


def at_seat(tries: int = 1) -> Held:
    """The jaws closed on the seated plug, above a path along x."""
    s = np.linspace(0.0, 0.15, 8)
    ones = np.ones((8, 1))
    path = ToolPath(
        s=s,
        p=np.column_stack([s, 0.0 * s, 0.0 * s]),
        z=ones * AXIS,
        x=ones * [1.0, 0.0, 0.0],
        on_scan=np.zeros(8, bool),
        keeps_x=True,
    )
    placement = Placement(
        X_WB=np.eye(4), travel_W=np.zeros(3), roll=0.0, q_start=np.zeros(6), margin=1.0, reached=1.0
    )
    plan = GripPlan(opening=0.05, width=WIDTH, bears=20.0, expected=EXPECTED, tries=tries)
    held = Held(
        X_WB=np.eye(4), X_WB_scan=np.eye(4), q=np.zeros(6), plan=replace(plan, gripped=WIDTH)
    )
    held.line = ToolLine(path, placement, 0.0)
    return held


def period(time: float, pull: float, jaws: JawMeasurement | None) -> Context:
    """A period in which the plug resists a pull [N]."""
    estimate: Any = SimpleNamespace(time=time, jaws=jaws)
    contact = ContactEstimate(normal=-pull, force_W=pull * AXIS)
    last: Any = SimpleNamespace(contact=contact, faults=())
    return Context(time, PERIOD, estimate, None, last)


def pressing(time: float, force: float = GRIP, opening: float = WIDTH) -> JawMeasurement:
    return JawMeasurement(time=time, opening=opening, speed=0.0, force=force)


def drawn(phase: Any, held: Held, pull: Any, jaws: Any = pressing) -> tuple[Outcome, float]:
    """How a phase ends, and when, under a resistance `pull(depth)` [N]."""
    state = phase.enter(held, period(0.0, 0.0, None))
    for step in range(6000):
        time = step * PERIOD
        ended = phase.step(state, held, period(time, pull(held.depth), jaws(time)))
        if ended is not None:
            return ended, time
    return None, 60.0


def test_a_plug_comes_out_at_the_speed_that_its_friction_leaves() -> None:
    times = {}
    for friction in (0.0, 20.0):
        held = at_seat()
        ended, times[friction] = drawn(
            pulling(), held, lambda depth, f=friction: f if depth > -LENGTH else 0.0
        )
        assert ended is PhaseEvent.DONE
        assert held.depth == -JOB.axial.standoff
        assert held.note == f"the plug came out at {friction:.0f} N"

    # With half of the pull the law leaves half of the speed, as long as the plug is in.
    speed = JOB.pull_speed
    more = JOB.jaws.clear / (0.5 * speed) - JOB.jaws.clear / speed
    assert times[20.0] - times[0.0] == pytest.approx(more, abs=0.8)


def test_a_plug_that_resists_the_whole_pull_is_stuck_and_named_after_the_stall() -> None:
    ended, time = drawn(pulling(), at_seat(), lambda _: 0.95 * JOB.pull)
    assert isinstance(ended, Abort)
    assert ended.code is AbortCode.STUCK
    assert f"38 of {JOB.pull:.0f} N" in ended.reason
    assert JOB.out.stall < time < JOB.out.stall + 1.5


def test_limp_jaws_grip_once_more_in_the_receptacle_and_else_have_lost_it() -> None:
    def limp(time: float) -> JawMeasurement:
        return pressing(time, force=5.0)

    assert drawn(pulling(), at_seat(), lambda _: 10.0, limp)[0] is PhaseEvent.REFUSED
    ended, time = drawn(pulling(), at_seat(tries=2), lambda _: 10.0, limp)
    assert ended == Abort(AbortCode.DROPPED, "the jaws press with 5 of 70 N only")
    assert time == pytest.approx(0.3, abs=2 * PERIOD)
    inserting = WithPlug(Hold(), JOB.jaws, GRIP)
    assert drawn(inserting, at_seat(), lambda _: 0.0, limp)[0] == ended


def test_a_plug_that_slips_out_on_its_way_in_is_dropped_and_a_silent_drive_is_named() -> None:
    inserting = WithPlug(Hold(), JOB.jaws, GRIP)
    ended, _ = drawn(inserting, at_seat(), lambda _: 0.0, lambda time: pressing(time, opening=0.01))
    assert isinstance(ended, Abort)
    assert ended.code is AbortCode.DROPPED
    ended, _ = drawn(inserting, at_seat(), lambda _: 0.0, lambda _: pressing(0.0))
    assert isinstance(ended, Abort)
    assert ended.code is AbortCode.JAWS


def test_a_stop_near_the_seat_is_the_seat_and_one_above_it_a_jam() -> None:
    seat = SeatPlug(JOB.insertion, LOADED)
    held = at_seat()
    held.depth = -0.004
    assert seat._stopped(EntryState(held.depth, 0.0), held) is PhaseEvent.DONE

    # Above it: back off three times, at the rim search.
    held.depth = -0.02
    for _ in range(JOB.insertion.inside.tries):
        assert seat._stopped(EntryState(held.depth, 0.0), held) is None
    ended = seat._stopped(EntryState(held.depth, 0.0), held)
    assert ended == Abort(AbortCode.JAMMED, "stopped 20 mm above the seat in 3 attempts")
    held.tries = 0
    held.depth = -LENGTH + 0.002
    assert seat._stopped(EntryState(held.depth, 0.0), held) is PhaseEvent.TOUCHED


def test_work_that_is_broken_off_keeps_the_plug_at_the_rim_and_lets_it_go_in_the_hole() -> None:
    leave = LetGo(JOB.axial, LOADED, JOB.jaws, GRIP)
    at_rim = at_seat()
    at_rim.depth = -LENGTH + 0.002
    assert drawn(leave, at_rim, lambda _: 0.0) == (PhaseEvent.DONE, 0.0)
    assert at_rim.plan_of(GripPlan).gripped == WIDTH

    inside = at_seat()
    inside.depth = -LENGTH + 0.02
    ended, _ = drawn(leave, inside, lambda _: 0.0, lambda time: pressing(time, opening=0.05))
    assert ended is PhaseEvent.DONE
    assert np.isnan(inside.plan_of(GripPlan).gripped)
