"""Faults of a collection by the job: what is found, what is kept, and that nothing is crushed."""

from dataclasses import replace
from typing import Any, cast

import pytest

from uuv import Run, jobs, run
from uuv.perturbations.jaws import JawFailure
from uuv.perturbations.loop import SensorFailure, ThrusterFailure
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, WorkState

CARRIED = 13.0  # [s] after the lift begins
CRUSHED = 1.5  # of the set grip
long = pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/grasping/test_jaw_phases.py::"
    "test_what_hangs_free_is_kept_and_what_is_on_the_ground_is_let_go"
)


def collected(*perturbations: Perturbation, **options: float) -> Run:
    """A run of the job with failures."""
    scenario = jobs.collect(quick=True, seed=1, **options)
    return run(replace(scenario, perturbations=perturbations))


def blind(joint: int, state: WorkState, after: float) -> SensorFailure:
    """A torque sensor without a number."""
    return SensorFailure(
        sensor="torque",
        effect="fixed",
        field="tau",
        index=joint,
        value=float("nan"),
        state=state,
        after=after,
    )


def risen(ran: Run) -> float:
    """Height [m] of the object at the end over its first place."""
    height = ran.recording["p_WT"].value[:, 2]
    return float(height[-1] - height[0])


def safe(ran: Run, code: AbortCode) -> None:
    """The cause is named, nothing is crushed, and nothing is hit."""
    assert ran.recording.final.abort is code, ran.recording.final.note
    assert ran.recording["contact_most"].scalar.max() < CRUSHED * 40.0
    collision = next(check for check in ran.assessment.checks if check.name == "collision")
    assert collision.value == 0.0


@long
def test_a_thruster_lost_at_the_object_opens_the_jaws_and_leaves_it() -> None:
    ran = collected(ThrusterFailure(thruster="heave_front", state="press", after=0.5))
    safe(ran, AbortCode.THRUSTER)
    assert abs(risen(ran)) < 0.01
    assert ran.recording["jaw_opening"].scalar[-1] > 0.08


@long
def test_a_thruster_lost_with_the_object_keeps_it_and_rises() -> None:
    ran = collected(ThrusterFailure(thruster="heave_front", state="work", after=CARRIED))
    safe(ran, AbortCode.THRUSTER)
    assert risen(ran) > 0.5


@long
@pytest.mark.parametrize("mass", [0.66, 3.0])
def test_without_an_estimate_the_arm_bears_its_load_and_the_hull_leaves(mass: float) -> None:
    fault = SensorFailure(sensor="imu", state="work", after=CARRIED)
    ran = collected(fault, mass=mass, load=30.0)
    safe(ran, AbortCode.ESTIMATE)
    assert risen(ran) > 0.5


@long
def test_two_torque_sensors_lost_with_the_object_keep_it() -> None:
    ran = collected(*(blind(joint, WorkState.WORK, CARRIED) for joint in (1, 2)))
    safe(ran, AbortCode.TORQUE_SENSORS)
    assert risen(ran) > 0.1


@long
def test_jaws_that_are_stuck_while_they_close_are_named() -> None:
    ran = collected(JawFailure(state="press", after=0.3))
    safe(ran, AbortCode.JAWS)
    assert abs(risen(ran)) < 0.01


@long
def test_an_object_that_slips_in_the_lift_is_gripped_once_more() -> None:
    fault = JawFailure(effect="dead", state="work", after=2.0, duration=0.5)
    ran = collected(fault, mass=3.0, load=30.0)
    assert ran.recording.final.state is WorkState.DONE, ran.recording.final.note
    assert ran.assessment.metrics["put"]["in_basket"]
    assert ran.recording["contact_most"].scalar.max() < CRUSHED * 40.0


@long
def test_an_object_that_drops_on_its_way_ends_the_work() -> None:
    ran = collected(JawFailure(effect="dead", state="work", after=CARRIED), mass=3.0, load=30.0)
    safe(ran, AbortCode.DROPPED)


@pytest.mark.parametrize(
    ("failure", "message"),
    [
        (
            lambda: JawFailure(state="press", effect=cast(Any, "limp")),
            "effect: allowed stuck, dead",
        ),
        (lambda: JawFailure(), "must have either `at`"),
    ],
)
def test_a_failure_of_the_jaws_that_cannot_be_is_refused(failure, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        failure()


def test_a_failure_of_the_jaws_is_refused_without_a_gripper() -> None:
    scenario = jobs.clean_barrel(quick=True)
    with pytest.raises(ConfigurationError, match="JawFailure: the vehicle has no gripper"):
        run(replace(scenario, perturbations=(JawFailure(state="press"),)))
