"""An object that is pushed while the vehicle looks at it is noticed in the running job, by the door
of a user.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv.assembly import assemble
from uuv.jobs import clean_barrel
from uuv.perturbations.target import PushedObject
from uuv.runner import assessed, run, run_through
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, WorkState

SCANS = 5.0  # [s] at which the hull of seed 1 is at rest and scans
AT, RAMP, UNTIL = 6.6, 0.5, 8.2  # [s] of the push, and of the end

IN_FRAMES = pytest.mark.long(
    guarded_by="tests/unit/perception/test_object_tracker.py::test_a_push_is_noticed_in_two_frames_and_measured"
)


@pytest.mark.parametrize(
    "by",
    [
        pytest.param((0.0, 0.01, 0.0), id="1 cm", marks=IN_FRAMES),
        pytest.param((0.03, 0.0, 0.0), id="along", marks=pytest.mark.long),
        pytest.param((0.03, -0.04, 0.0), id="5 cm", marks=pytest.mark.long),
    ],
)
def test_push_is_noticed_within_a_second_and_measured(by, within):
    scenario = replace(
        clean_barrel(seed=1, follow=True), perturbations=(PushedObject(at=AT, by=by, ramp=RAMP),)
    )
    assembly = assemble(scenario)
    ran = run_through(assembly, longest=UNTIL)
    assert ran.part_by_part
    motions = ran.recording.motions
    assert motions
    assert motions[0].time < SCANS + 1.5
    assert not any(motion.moved for motion in motions if motion.time < AT)
    noticed = next(motion.time for motion in motions if motion.moved)
    assert AT < noticed < AT + 1.0
    assert motions[-1].moved
    within("motion [m]", motions[-1].twist_W[:3] - by, 0.006)  # two sigma
    assert 3e-4 < motions[-1].distance_sigma < 5e-3
    figures = assessed(assembly, ran).metrics["motion"]
    assert figures["noticed_s"] == noticed
    assert figures["distance_m"] == pytest.approx(np.linalg.norm(by), abs=0.006)


@pytest.mark.long
def test_an_object_that_rests_raises_no_alarm():
    """Twelve seconds of a hull that is held in the current, 60 frames."""
    recording = run_through(assemble(clean_barrel(seed=2, follow=True)), longest=17.0).recording
    assert len(recording.motions) > 40
    assert not any(motion.moved for motion in recording.motions)


@pytest.mark.long
def test_push_at_work_is_noticed_by_the_camera_on_the_arm():
    """Without it the tool goes on 2 cm beside its path, unnoticed."""
    scenario = clean_barrel(seed=1, quick=True, arm_camera=True)
    push = PushedObject(by=(0.0, 0.02, 0.0), state="work", after=2.0)
    recording = run(assemble(replace(scenario, perturbations=(push,)))).recording
    assert recording.final.abort is AbortCode.OBJECT_MOVES
    work = recording["p_pad"].time[recording.within(WorkState.WORK)]
    assert 2.0 < work[-1] - work[0] < 4.0


def test_bad_input():
    with pytest.raises(ConfigurationError, match="must have either"):
        PushedObject(by=(0.0, 0.0, 0.1))
    with pytest.raises(ConfigurationError, match="PushedObject by"):
        PushedObject(at=1.0, by=(np.nan, 0.0, 0.0))
    with pytest.raises(ConfigurationError, match="stays where it was pushed"):
        PushedObject(at=1.0, duration=2.0)
    with pytest.raises(
        ConfigurationError,
        match=r"sensing\.follow: takes depth frames; the "
        r"sensor is 'sonar'",
    ):
        assemble(clean_barrel(sensor="sonar", follow=True))
