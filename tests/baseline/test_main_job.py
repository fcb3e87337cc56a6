"""Work on surfaces: figures of short runs against the behaviour baseline."""

import pytest

import holding
import traces

ANOTHER = pytest.mark.long(
    guarded_by="tests/baseline/test_main_job.py::test_figures_keep_their_bands"
)
TRANSVERSE = pytest.param("barrel_transverse", marks=ANOTHER)
STEPS = pytest.param("force_steps", marks=ANOTHER)


@pytest.mark.parametrize("name", ["barrel_longitudinal", TRANSVERSE, "pile", "rock", STEPS])
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)


def test_the_main_job_goes_the_way_that_is_held():
    traces.check(traces.CLOSED)  # of the run of "barrel_longitudinal", which is kept
