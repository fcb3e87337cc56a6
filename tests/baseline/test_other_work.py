"""Insertion, the seabed, inspection: figures of short runs against the behaviour baseline."""

import pytest

import holding


@pytest.mark.parametrize("name", ["insertion", "core", "drag", "inspection"])
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)
