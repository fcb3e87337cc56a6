"""Figures of a fault case against a time series made by hand."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from experiments.faults.fault_cases import AT_WORK, PUSH, Trace
from experiments.faults.fault_figures import figures, summarise
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.interfaces.messages import WorkState


def trace(states: list[tuple[float, WorkState, str]]) -> Trace:
    """10 s in steps of 0.5 s: 60 N until 4 s and from 6 to 7 s, none at 1 and 1.5 s; one hull
    offset and one tilt.
    """
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
    left = figures(
        trace([(0.5, WorkState.WORK, ""), (2.5, WorkState.RETREAT, "gone")]), "transverse", 4
    )
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


@pytest.mark.parametrize(
    ("late", "peak", "said"),
    [
        (1.9, 60.0, []),
        (2.1, 60.0, ["contact 2.1 s after the work was left"]),
        (0.0, 91.0, ["damage"]),
    ],
)
def test_a_late_touch_or_damage_fails_the_study(late: float, peak: float, said: list[str]):
    """Work at 60 N that is left at 2.5 s: a touch counts as late from 2 s after that on, a peak as
    damage from 90 N.
    """
    left = trace([(0.5, WorkState.WORK, ""), (2.5, WorkState.RETREAT, "gone")])
    one = replace(figures(left, "transverse", 4), touch_s=late, peak_n=peak, damage=peak > 90.0)
    summary = summarise([{"path": "transverse", "seed": 4, "cases": [asdict(one)]}])
    assert [line.split(":")[0] for line in summary.failed or []] == said


def test_damage_is_by_the_largest_force():
    for peak, damage in ((DAMAGE * PUSH - 0.1, False), (DAMAGE * PUSH + 0.1, True)):
        hit = trace([(0.5, WorkState.WORK, "")])
        hit.rows[5, 10] = peak
        assert figures(hit, "transverse", 4).damage == damage
