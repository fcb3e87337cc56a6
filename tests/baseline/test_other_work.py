"""Insertion, the seabed, inspection: figures of short runs against the behaviour baseline."""

import pytest

import holding

SEABED = pytest.mark.long(
    guarded_by="tests/integration/test_sample_seabed.py::test_a_core_is_taken_and_its_log_tells_all_of_it"
)
CORE, DRAG = pytest.param("core", marks=SEABED), pytest.param("drag", marks=SEABED)


@pytest.mark.parametrize("name", ["insertion", CORE, DRAG, "inspection"])
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)
