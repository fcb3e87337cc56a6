"""Insertion, the seabed, inspection: figures of short runs against the behaviour baseline."""

import pytest

import holding

CORE = pytest.param(
    "core",
    marks=pytest.mark.long(
        guarded_by="tests/integration/test_sample_seabed.py::test_a_core_is_taken_and_its_log_tells_all_of_it"
    ),
)


@pytest.mark.parametrize("name", ["insertion", CORE, "drag", "inspection"])
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)
