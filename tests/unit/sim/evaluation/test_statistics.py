"""Intervals of shares."""

import numpy as np
import pytest

from uuv.sim.evaluation.statistics import wilson
from uuv.sim.interfaces.errors import ConfigurationError


def test_wilson_against_the_published(within):
    """Newcombe 1998, Statistics in Medicine 17:857, table I: 81 of 263, 15 of 148, 0 of 20, 1 of
    29.
    """
    for good, of, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        within(f"{good} of {of}", np.subtract(wilson(good, of), (low, high)), 6e-5)
    with pytest.raises(ConfigurationError, match="good"):
        wilson(3, 2)
