"""A gyro or an attitude that is wrong, in the whole loop: named, and the work goes on or is
left.
"""

from dataclasses import replace

import pytest

from uuv import assemble, jobs, run, saved
from uuv.perturbations.loop import SensorFailure
from uuv.runner import run_through
from uuv.sim.evaluation.surface.tool_errors import path_error
from uuv.sim.interfaces.messages import AbortCode, FaultKind, WorkState

SHORT = "tests/integration/test_gyro_faults.py::test_before_the_contact_a_gyro_is_done_without"


@pytest.mark.parametrize(
    ("failure", "kind", "state", "code"),
    [
        (
            SensorFailure(
                sensor="imu", effect="offset", field="w_WB_B", index=2, value=0.1, at=2.0
            ),
            FaultKind.GYRO,
            WorkState.SETTLE,
            None,
        ),
        (
            SensorFailure(sensor="imu", effect="turned", index=2, rate=0.1, at=2.0),
            FaultKind.ATTITUDE,
            WorkState.ABORT,
            AbortCode.ATTITUDE,
        ),
    ],
    ids=["gyro", "attitude"],
)
def test_before_the_contact_a_gyro_is_done_without(failure, kind, state, code):
    outcome = run_through(
        assemble(replace(jobs.clean_barrel(quick=True, seed=2), perturbations=(failure,))),
        longest=2.4,
    )
    faults = outcome.last.command.faults
    assert [fault.kind for fault in faults] == [kind]
    assert 2.0 < faults[0].time < 2.1
    assert outcome.recording.final.state is state
    assert outcome.recording.final.abort is code


@pytest.mark.long(guarded_by=SHORT)
@pytest.mark.parametrize("path", ["longitudinal", "transverse"])
def test_at_work_a_gyro_that_jumps_leaves_the_tool_on_its_path(path: str):
    """About z 0.1 rad/s took it 164 mm off, about x 0.03 rad/s 82 mm, and no fault was named."""
    at_work = saved(jobs.clean_barrel(quick=True, path=path, forces=(90.0,)), "work")
    onset = at_work.time + 3.0
    for axis, size in ((2, 0.1), (0, 0.03), (1, -0.03)):
        jump = SensorFailure(
            sensor="imu", effect="offset", field="w_WB_B", index=axis, value=size, at=onset
        )
        done = run(at_work.with_failures(jump))
        assert done.recording.final.state is WorkState.DONE
        faults = done.result.last.command.faults
        assert [(fault.kind, fault.index) for fault in faults] == [(FaultKind.GYRO, axis)]
        assert faults[0].time - onset < 0.5
        error = path_error(done.recording)
        assert error is not None
        assert error.deviation.max() < 3e-3
        assert done.assessment.metrics["contact"]["force_error_max_n"] < 9.0
