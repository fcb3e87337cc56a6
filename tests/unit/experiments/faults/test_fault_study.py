"""Figures of a fault case against a time series made by hand, and what its page says."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.faults.fault_cases import AT_WORK, PUSH, SETTLE, Trace
from experiments.faults.fault_picture import draw
from experiments.faults.faults import FaultCase, FaultRow, faults, figures, group_of
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState

DEAD = "thruster sway dead"
LEFT = [(0.5, WorkState.WORK, ""), (2.5, WorkState.RETREAT, "gone")]


def trace(states: list[tuple[float, WorkState, str]]) -> Trace:
    """10 s in steps of 0.5 s: 60 N until 4 s and from 6 to 7 s, none at 1 and 1.5 s; one hull
    offset and one tilt.
    """
    time = 0.5 * np.arange(1, 21)
    touching = (time <= 4.0) | ((time >= 6.0) & (time <= 7.0))
    zeros = np.zeros(time.size)
    series: dict[str, Any] = {
        "time": time,
        "contact_normal": zeros,
        "contact_least": np.where(touching & (time != 1.0) & (time != 1.5), 60.0, 0.0),
        "contact_most": np.where(touching, 60.0, 0.0),
        "felt": zeros,
        "set_force": np.full(time.size, 60.0),
        "moved": np.zeros((time.size, 3)),
        "tilt": zeros.copy(),
        "collision": zeros,
        "thrust": np.zeros((time.size, 6)),
    }
    series["contact_most"][5] = 75.0
    series["moved"][7] = [0.02, -0.03, 0.06]
    series["tilt"][8] = 0.1
    return Trace(
        fault=DEAD,
        phase=AT_WORK,
        set_force=60.0,
        thruster_names=tuple("abcdef"),
        series=series,
        states=states,
        reports=[(1.2, "thruster", "t1"), (2.0, "joint", "q2")],
    )


def test_figures_of_a_work_that_was_left():
    row = figures(trace(LEFT))
    assert row.touch == pytest.approx(7.0 - 2.5)  # counted from letting go
    assert row.left == 2.5
    assert (row.detected, row.delay) == ("thruster t1", 1.2)
    assert row.peak == 75.0
    assert row.excursion == pytest.approx(0.07)
    assert row.tilt == pytest.approx(0.1)
    assert row.lost == pytest.approx(2 * 0.5)  # only while at work
    assert (row.final, row.note) == (str(WorkState.RETREAT), "gone")


def test_a_work_that_was_not_left_has_no_last_touch():
    row = figures(trace([(0.5, WorkState.WORK, "")]))
    assert row.touch is None
    assert row.left is None
    assert row.reaction == str(WorkState.WORK)  # the set force never fell
    assert not row.damage


def stored(row: FaultRow) -> dict[str, object]:
    """Row of a transverse run as it is stored."""
    case = FaultCase(path="transverse", seed=4, phase=AT_WORK, fault=DEAD)
    return asdict(case) | asdict(row)


@pytest.mark.parametrize(
    ("late", "peak", "reason"),
    [(1.9, 60.0, ""), (2.1, 60.0, "contact 2.1 s after the work was left"), (0.0, 91.0, "damage")],
)
def test_a_late_touch_or_damage_fails_the_study(late: float, peak: float, reason: str):
    """Work at 60 N that is left at 2.5 s: a touch counts as late from 2 s after that on, a peak as
    damage from 90 N.
    """
    row = replace(figures(trace(LEFT)), touch=late, peak=peak, damage=peak > 90.0)
    summary = faults.summary([stored(row)])
    assert len(summary.failed or []) == (1 if reason else 0)
    lines = [f"{reason}: {DEAD} in work, transverse path, seed 4"] if reason else []
    assert list(summary.lines) == lines


def test_damage_is_by_the_largest_force():
    for peak, damage in ((DAMAGE * PUSH - 0.1, False), (DAMAGE * PUSH + 0.1, True)):
        hit = trace([(0.5, WorkState.WORK, "")])
        hit.series["contact_most"][5] = peak
        assert figures(hit).damage == damage


def test_each_fault_begins_in_its_phases_and_a_wrong_place_before_the_scan():
    options = faults.options_with(
        {"path": ("transverse",), "only": ("found", "IMU N"), "phases": ("press", "unload")}
    )
    cases = [(case.phase, case.fault) for case in faults.space.cases(options)]
    assert cases == [
        (SETTLE, "found 8 cm too deep"),
        (SETTLE, "found 5 cm too high"),
        *((phase, f"IMU NaN{end}") for phase in ("press", "unload") for end in ("", " 10 ms")),
    ]


def test_a_word_of_no_fault_is_refused():
    with pytest.raises(ConfigurationError, match="--only storm: there is no such case"):
        faults.space.cases(faults.options_with({"only": ("storm",)}))
    with pytest.raises(ConfigurationError, match=r"fault.*got 'storm'"):
        FaultCase(path="transverse", seed=4, phase=AT_WORK, fault="storm")


def test_groups_part_thrusters_by_their_direction():
    assert group_of("thruster surge_left stuck astern") == "thruster at full thrust, surge or heave"
    assert group_of(DEAD) == "thruster dead, sway"
    assert group_of("torque sensors silent") == "torque sensor"
    assert group_of("IMU NaN") == "IMU"


def test_a_trace_is_drawn(tmp_path: Path):
    draw(trace(LEFT), "a fault", tmp_path / "fault.png")
    assert (tmp_path / "fault.png").stat().st_size > 20_000
