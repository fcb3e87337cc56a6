"""Faults of a plug's move by the job: named, what is out is kept, what is seated is let go."""

from dataclasses import replace

import numpy as np
import pytest

from uuv import Run, jobs, run
from uuv.controllers.tasks.grasping.plugging import LENGTH
from uuv.perturbations.jaws import JawFailure
from uuv.perturbations.loop import SensorFailure, ThrusterFailure
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, WorkState

OUT = 10.0  # [s] after the pull begins, at which the plug hangs free
GRIP = 70.0  # [N]
long = pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/grasping/test_plugging.py::"
    "test_a_plug_is_pulled_out_carried_and_seated_in_the_other_receptacle"
)


def moved(*perturbations: Perturbation, **options: float) -> Run:
    """A run of the job with failures."""
    scenario = jobs.move_plug(quick=True, seed=1, **options)
    return run(replace(scenario, perturbations=perturbations))


def blind(joint: int) -> SensorFailure:
    """A torque sensor without a number, with the plug in the jaws."""
    return SensorFailure(
        sensor="torque",
        effect="fixed",
        field="tau",
        index=joint,
        value=float("nan"),
        state=WorkState.WORK,
        after=OUT,
    )


def risen(ran: Run) -> float:
    """Height [m] of the plug at the end over its first place."""
    height = ran.recording["p_WT"].value[:, 2]
    return float(height[-1] - height[0])


def safe(ran: Run, code: AbortCode) -> None:
    """The cause is named, forces stay below 1.5 times what is set, and nothing is hit."""
    assert ran.recording.final.abort is code, ran.recording.final.note
    assert ran.recording["contact_most"].scalar.max() < 1.5 * GRIP
    force = ran.assessment.metrics["force"]
    assert force["pull_max_n"] < 60.0
    assert force["push_max_n"] < 60.0
    collision = next(check for check in ran.assessment.checks if check.name == "collision")
    assert collision.value == 0.0


@long
def test_a_thruster_lost_in_the_pull_opens_the_jaws_and_leaves_the_plug() -> None:
    ran = moved(ThrusterFailure(thruster="heave_front", state="work", after=0.2), friction=30.0)
    safe(ran, AbortCode.THRUSTER)
    assert risen(ran) < 0.5 * LENGTH
    assert ran.recording["jaw_opening"].scalar[-1] > 0.045


@long
def test_a_thruster_lost_with_the_plug_keeps_it_and_rises() -> None:
    ran = moved(ThrusterFailure(thruster="heave_front", state="work", after=OUT))
    safe(ran, AbortCode.THRUSTER)
    assert risen(ran) > 0.5


@long
def test_without_an_estimate_the_plug_is_kept_and_the_hull_leaves() -> None:
    ran = moved(SensorFailure(sensor="imu", state="work", after=OUT))
    safe(ran, AbortCode.ESTIMATE)
    assert risen(ran) > 0.5


@long
def test_without_an_estimate_in_the_other_receptacle_the_jaws_let_go() -> None:
    ran = moved(SensorFailure(sensor="imu", state="insert", after=6.0))
    safe(ran, AbortCode.ESTIMATE)
    assert risen(ran) < 0.5 * LENGTH
    assert ran.recording["jaw_opening"].scalar[-1] > 0.045


@long
def test_two_torque_sensors_lost_with_the_plug_keep_it() -> None:
    ran = moved(blind(1), blind(2))
    safe(ran, AbortCode.TORQUE_SENSORS)
    assert risen(ran) > LENGTH


@long
def test_jaws_that_are_stuck_while_they_close_are_named() -> None:
    ran = moved(JawFailure(state="press", after=0.3))
    safe(ran, AbortCode.JAWS)
    assert abs(risen(ran)) < 0.01


@long
def test_jaws_that_lose_their_force_in_the_pull_grip_once_more() -> None:
    ran = moved(JawFailure(effect="dead", state="work", after=0.3, duration=0.8), friction=30.0)
    assert ran.recording.final.state is WorkState.DONE, ran.recording.final.note
    assert ran.assessment.metrics["seat"]["seated"]
    assert np.count_nonzero([event.state is WorkState.PRESS for event in ran.recording.events]) > 1


@long
def test_jaws_that_lose_their_force_with_the_plug_drop_it_and_say_so() -> None:
    ran = moved(JawFailure(effect="dead", state="work", after=OUT))
    assert ran.recording.final.abort is AbortCode.DROPPED, ran.recording.final.note


def test_an_object_that_is_no_panel_and_a_plug_that_cannot_be_are_refused() -> None:
    scenario = jobs.move_plug()
    valve = jobs.turn_valve()
    with pytest.raises(ConfigurationError, match="needs a PlugBoard at the site, got HandValve"):
        run(replace(scenario, site=valve.site))
    with pytest.raises(ConfigurationError, match=r"panel: friction \[N\]"):
        jobs.move_plug(friction=0.0)
    with pytest.raises(ConfigurationError, match=r"task.pull 70 N: friction holds 84 N"):
        run(jobs.move_plug(pull=70.0))
    with pytest.raises(ConfigurationError, match="driven jaws, such as gripper"):
        run(jobs.move_plug(tool="pad"))
