"""Work on surfaces: figures of short runs against the behaviour baseline."""

import pytest

import holding
import traces
from cases import barrel_longitudinal_run
from uuv.sim.evaluation.bounds import Bounds

ANOTHER = pytest.mark.long(
    guarded_by="tests/baseline/test_main_job.py::test_figures_keep_their_bands"
)
TRANSVERSE = pytest.param("barrel_transverse", marks=ANOTHER)
STEPS = pytest.param("force_steps", marks=ANOTHER)
# Its job is done whole there; a rock is found, and flown around, for the figures of inspection.
ON_A_ROCK = pytest.mark.long(
    guarded_by="tests/unit/uuv/cli/test_uuv_command.py::test_a_run_is_compared_and_read_back"
)
ROCK = pytest.param("rock", marks=ON_A_ROCK)


@pytest.mark.parametrize("name", ["barrel_longitudinal", TRANSVERSE, "pile", ROCK, STEPS])
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)


def test_the_main_job_is_done_within_its_bounds():
    """The run of "barrel_longitudinal", which is kept."""
    assessment = barrel_longitudinal_run(holding.SEED).assessment
    metrics, bounds = assessment.metrics, Bounds()
    assert assessment.accepted
    assert metrics["run"]["state"] == "done"
    identification = metrics["identification"]
    assert identification["accepted"] is True
    assert identification["position_error_m"] <= min(0.005, 0.005 * identification["range_m"])
    assert metrics["contact"]["force_error_rms_n"] <= 3.0
    assert metrics["contact"]["force_error_max_n"] <= 9.0
    assert metrics["contact"]["lost_s"] == 0.0
    assert metrics["tool"]["path_deviation_max_m"] <= 0.003
    assert metrics["tool"]["tilt_max_rad"] <= bounds.tilt
    assert metrics["hull"]["tilt_max_rad"] <= bounds.tilt

    # It did the work, and did not look for the easy one.
    sets = [segment["set_n"] for segment in metrics["contact"]["segments"]]
    assert sets == [60.0, 90.0, 60.0]
    assert metrics["tool"]["speed_mean_m_s"] == pytest.approx(0.02, rel=0.2)
    assert metrics["hull"]["excursion_max_m"] > 0.001


def test_the_main_job_goes_the_way_that_is_held():
    traces.check(traces.CLOSED)  # of the same run
