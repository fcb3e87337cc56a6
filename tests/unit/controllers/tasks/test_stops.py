"""Stops of a pressed tool on its path: when it stops, what it says, and that a pause calls it
off.
"""

from collections.abc import Callable

import numpy as np
import pytest

from uuv.controllers.planning.promise import StopLimits
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.phase import Context
from uuv.controllers.tasks.stops import Stops
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command, ContactEstimate, Promise, StateEstimate, ToolAtRest

PERIOD = 0.01  # [s]


DOWN = np.array([0.0, 0.0, -1.0])  # tool axis, W


def context(time: float, *, paused: bool = False, across: float = 3.0) -> Context:
    """A tool pressed with 60 N, and `across` [N] to the side."""
    zero = np.zeros(3)
    contact = ContactEstimate(force_W=np.array([across, 0.0, 60.0]), normal=60.0)
    command = Command(
        time=time, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False, contact=contact
    )
    estimate = StateEstimate(
        time=time,
        X_WB=np.eye(4),
        v_WB_B=zero,
        w_WB_B=zero,
        a_WB_B=zero,
        q=np.full(6, time),
        qd=zero,
        tau=zero,
    )
    return Context(time, PERIOD, estimate, None, command, paused=paused)


def never(time: float) -> bool:
    del time
    return False


def follow(
    stops: Stops,
    seconds: float,
    *,
    paused: Callable[[float], bool] = never,
    ramped: Callable[[float], bool] = never,
    across: float = 3.0,
) -> tuple[list[ToolAtRest], list[tuple[float, float, bool]]]:
    """Messages, and (time, pace, standing) of every period, of a tool that slows down as
    `FollowPath` does.
    """
    messages = []
    trace = []
    pace = 1.0
    for k in range(round(seconds / PERIOD)):
        time = k * PERIOD
        instant = context(time, paused=paused(time), across=across)
        stopping = (
            stops.step(pace, DOWN, steady=not ramped(time), context=instant) or instant.paused
        )
        change = PERIOD / FollowLimits().pace_time
        pace = max(0.0, pace - change) if stopping else min(1.0, pace + change)
        if stops.said is not None:
            messages.append(stops.said)
        trace.append((time, pace, stops.standing))
    return messages, trace


def test_each_stop_says_when_it_began_and_that_nothing_has_moved_since():
    limits = StopLimits(every=2.0, lasting=0.5, settle=0.3)
    messages, trace = follow(Stops(limits), 10.0)
    begins, ends = messages[0::2], messages[1::2]
    assert len(begins) == len(ends) == 3
    for begin, end in zip(begins, ends, strict=True):
        assert begin.time == begin.since == end.since
        assert end.time - begin.time == pytest.approx(limits.lasting, abs=1.5 * PERIOD)
        assert end.slip_sigma == pytest.approx(limits.creep * (end.time - end.since), rel=1e-9)
        assert end.q == pytest.approx(np.full(6, end.time))  # the joints of that moment
        still = [
            pace
            for time, pace, _ in trace
            if begin.time - limits.settle + PERIOD <= time < end.time
        ]
        assert max(still) == 0.0
        assert all(standing for time, _, standing in trace if begin.time <= time < end.time)
    moving = [begin.time - end.time for end, begin in zip(ends, begins[1:], strict=False)]
    assert min(moving) > limits.every


def test_a_pause_calls_a_stop_off():
    """The force is reduced in a pause: nothing tells whether it still holds the tool."""
    messages, _ = follow(Stops(StopLimits(every=1.0)), 6.0, paused=lambda time: 2.0 <= time < 2.5)
    # begun, called off, and begun anew
    assert [m.time == m.since for m in messages[:2]] == [True, True]
    assert messages[1].time > 2.5 + 1.0
    assert messages[2].since == messages[1].since


@pytest.mark.parametrize("across", [10.0, np.nan])
def test_a_tool_that_friction_may_not_hold_says_nothing_and_goes_on(across):
    """With 10 N across 60 N along, or where the force across is not known."""
    limits = StopLimits(every=1.0)
    messages, trace = follow(Stops(limits), 8.0, across=across)
    assert messages == []
    assert sum(time for time, pace, _ in trace if pace == 1.0) > 0.0
    still = [time for time, pace, _ in trace if pace == 0.0]
    assert len(still) * PERIOD < 3.0 * (limits.patience + 2.0 * PERIOD)


def test_a_force_that_changes_makes_it_wait():
    """The pad's spring gives way meanwhile, which the arm's joints would tell as a motion of the
    hull.
    """
    messages, _ = follow(Stops(StopLimits(every=1.0)), 4.0, ramped=lambda time: time <= 2.2)
    assert messages[0].time > 2.2
    assert [m.time == m.since for m in messages[:2]] == [True, False]


def test_it_stops_only_where_navigation_is_poor():
    limits = StopLimits(below=0.9)
    promised = [
        Promise(chance=c, tolerance=0.003, navigation_sigma=1e-3, object_sigma=1e-3)
        for c in (0.8, 0.95)
    ]
    assert [limits.help(None), *(limits.help(p) for p in promised)] == [True, True, False]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"every": 0.1}, "task.promise.stops.every"),
        ({"lasting": 20.0}, "lasting"),
        ({"creep": 0.0}, "creep "),
        ({"below": 2.0}, "a probability"),
    ],
)
def test_stops_that_cannot_be(wrong, said):
    with pytest.raises(ConfigurationError, match=said):
        StopLimits(**wrong)
