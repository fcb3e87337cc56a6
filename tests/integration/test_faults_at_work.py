"""Two faults in a closed loop at full push: one that the work rides through, one that it retreats
from.
"""

import sys
from typing import Any

import pytest

from uuv.controllers.tuning import SAFETY
from uuv.sim.interfaces.messages import WorkState


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["scripts/experiments/faults/faults.py"])


def at_work(fault: str) -> Any:
    """Trace of the fault at full push, along the barrel."""
    from experiments.faults.fault_cases import AT_WORK, Branch
    from uuv import jobs

    scenario = jobs.clean_barrel(seed=0, forces=(90.0,), quick=True, sensor="survey")
    return Branch(scenario, AT_WORK).trace(fault)


def is_harmless(trace: Any) -> bool:
    """True if nothing collides, and no force goes far beyond the set one."""
    peak = trace.series["contact_most"].max()
    sound = not trace.blew_up and not trace.series["collision"].any()
    return bool(sound and peak < 1.5 * trace.set_force)


@pytest.mark.usefixtures("scripts")
def test_a_lost_thruster_ends_in_a_retreat():
    lost = at_work("thruster heave_front dead")
    assert lost.reports[0][1:] == ("thruster", "heave_front")
    assert lost.reports[0][0] < 2.0
    assert [state for _, state, _ in lost.states] == [
        WorkState.WORK,
        WorkState.RETREAT,
        WorkState.ABORT,
    ]
    assert "thruster heave_front is lost" in lost.states[-1][2]
    assert is_harmless(lost)
    gone = lost.series["time"] > lost.states[-1][0]
    assert not lost.series["contact_normal"][gone].any()  # off the object, and it stays off


@pytest.mark.long(
    guarded_by="tests/unit/controllers/safety/test_safety_wrapper.py"
    "::test_a_torque_sensor_found_wrong_is_replaced_by_its_motor"
)
@pytest.mark.usefixtures("scripts")
def test_a_frozen_torque_sensor_is_ridden_through():
    frozen = at_work("torque sensor 2 frozen")
    assert frozen.reports[0][1:] == ("torque sensor", "joint2")
    assert frozen.reports[0][0] < 0.1
    assert frozen.states[-1][1] is WorkState.DONE
    assert is_harmless(frozen)


@pytest.mark.long
@pytest.mark.usefixtures("scripts")
def test_without_an_estimate_the_hull_leaves_and_does_not_come_back():
    """With the thrusters merely stopped the current holds the tool on the object, here for 2.4
    s.
    """
    from experiments.faults.fault_cases import AT_WORK, Branch
    from uuv import jobs

    scenario = jobs.clean_barrel(path="transverse", seed=0, forces=(90.0,), quick=True)
    trace = Branch(scenario, AT_WORK).trace("IMU silent")
    time = trace.series["time"]
    left = next(when for when, state, _ in trace.states if state is WorkState.RETREAT)
    # the thrusters have stopped
    assert time[-1] > left + SAFETY.leave_time + SAFETY.rise_time
    assert not trace.series["contact_most"][time > left + 1.0].any()  # 0.59 s measured
    assert not trace.series["collision"].any()
