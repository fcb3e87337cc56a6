"""Open-loop trajectories against those held: samples everywhere, bits on the platform that wrote
them.
"""

import pytest

import traces


@pytest.mark.parametrize("name", traces.OPEN)
def test_the_trajectory_is_that_held(name):
    traces.check(name)
