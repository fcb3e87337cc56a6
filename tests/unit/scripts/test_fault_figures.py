"""Figures of a fault case against a time series made by hand."""

import numpy as np
import pytest

from scenarios.campaigns.fault_cases import AT_WORK, Trace
from scenarios.campaigns.fault_figures import figures
from sim.interfaces.messages import WorkState


def trace(states: list[tuple[float, WorkState, str]]) -> Trace:
    """10 s in steps of 0.5 s: 60 N until 4 s and from 6 to 7 s, none at 1 and 1.5 s; one hull offset and one tilt."""
    time = 0.5 * np.arange(1, 21)
    rows = np.zeros((time.size, 17))
    touching = (time <= 4.0) | ((time >= 6.0) & (time <= 7.0))
    rows[:, 0], rows[:, 3] = time, 60.0
    rows[:, 9] = np.where(touching & (time != 1.0) & (time != 1.5), 60.0, 0.0)
    rows[:, 10] = np.where(touching, 60.0, 0.0)
    rows[5, 10] = 75.0
    rows[7, 4:7], rows[8, 7] = [0.02, -0.03, 0.06], 0.1
    found = [(1.2, "thruster", "t1"), (2.0, "joint", "q2")]
    return Trace("stuck", AT_WORK, 30.0, 60.0, tuple("abcdef"), rows, states, found)


def test_figures_of_a_work_that_was_left():
    left = figures(trace([(0.5, WorkState.WORK, ""), (2.5, WorkState.RETREAT, "gone")]), "transverse", 4)
    assert left.touch_s == pytest.approx(7.0 - 2.5)  # counted from letting go
    assert left.reaction_s == 2.5
    assert (left.found, left.detection_s) == ("thruster t1", 1.2)
    assert left.peak_n == 75.0
    assert left.excursion_m == pytest.approx(0.07)
    assert left.tilt_deg == pytest.approx(18.0 / np.pi)
    assert left.lost_s == pytest.approx(2 * 0.5)  # only while at work
    assert (left.final, left.note) == (str(WorkState.RETREAT), "gone")


def test_a_work_that_was_not_left_has_no_last_touch():
    kept = figures(trace([(0.5, WorkState.WORK, "")]), "transverse", 4)
    assert kept.touch_s is None
    assert kept.reaction_s is None
    assert kept.reaction == str(WorkState.WORK)  # the set force never fell
    assert not kept.damage
