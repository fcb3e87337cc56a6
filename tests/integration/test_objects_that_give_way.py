"""An object that moves, or gives way to the tool, is worked within the bounds or refused for what
it is.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv.assembly import assemble
from uuv.jobs import clean_barrel
from uuv.perturbations.target import MountedObject, MovingObject
from uuv.runner import Run, run
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, WorkState


def work_on(*perturbations, **options) -> Run:
    return run(
        assemble(replace(clean_barrel(seed=1, quick=True, **options), perturbations=perturbations))
    )


@pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/test_arrival.py::test_what_does_not_agree_is_left_out"
)
def test_object_that_swings_is_refused_before_contact():
    recording = work_on(MovingObject(amplitude=(0.0, 0.02, 0.0), frequency=0.1)).recording
    assert recording.final.abort is AbortCode.OBJECT_MOVES
    assert not recording.within(WorkState.CLOSE_IN).any()
    way = recording["p_WT"].value - recording["p_WT"].value[0]
    expected = 0.02 * np.sin(2.0 * np.pi * 0.1 * recording["p_WT"].time)
    assert np.abs(way - expected[:, None] * [0.0, 1.0, 0.0]).max() < 1e-9


def test_free_object_is_let_go_within_three_seconds_of_contact():
    recording = work_on(
        MountedObject(stiffness=0.0), current=(0.0, 0.0, 0.0), gust=0.0, sensor="survey"
    ).recording
    assert recording.final.abort is AbortCode.GIVES_WAY
    first = np.argmax(recording["contact_normal"].scalar > 0.0)
    touched = recording["contact_normal"].time[first]
    p_WT = recording["p_WT"].value
    assert np.abs(p_WT[:first] - p_WT[0]).max() < 1e-3  # [m] weightless, in still water
    broken = next(event.time for event in recording.events if event.state is WorkState.RETREAT)
    assert 0.0 < broken - touched < 3.0
    assert recording["contact_most"].scalar.max() < 60.0


@pytest.mark.long
def test_object_on_a_mount_is_worked_and_judged_where_it_is():
    stiffness = 1e4
    ran = work_on(MountedObject(stiffness=stiffness))
    recording = ran.recording
    assert ran.assessment.accepted
    work = recording.within(WorkState.WORK)
    down = recording["p_WT"].value[0, 2] - recording["p_WT"].value[work, 2]
    assert down.max() == pytest.approx(90.0 / stiffness, rel=0.15)  # worked from above
    assert ran.assessment.metrics["path"]["true_deviation_max_m"] < 0.003


def test_bad_input():
    with pytest.raises(ConfigurationError, match="MountedObject stiffness"):
        MountedObject(stiffness=-1.0)
    with pytest.raises(ConfigurationError, match="MovingObject frequency"):
        MovingObject(frequency=-1.0)
    with pytest.raises(
        ConfigurationError, match="must be the only perturbation that moves the object"
    ):
        assemble(replace(clean_barrel(seed=1), perturbations=(MovingObject(), MountedObject())))
