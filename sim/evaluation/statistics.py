"""Statistics of shares: their interval."""

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError


def wilson(good: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson score interval of a proportion [Wilson 1927].

    Args:
        good: Number of successes.
        of: Number of trials.
        z: Quantile of the normal distribution; 1.96 for 95 %.

    Returns:
        Lower and upper limit.

    Raises:
        ConfigurationError: The counts are impossible.
    """
    if not 0 <= good <= of or of < 1:
        raise ConfigurationError(f"share: expected 0 <= good <= of, of > 0; got {good} of {of}")
    share = good / of
    middle = share + z * z / (2.0 * of)
    half = z * np.sqrt(share * (1.0 - share) / of + z * z / (4.0 * of * of))
    whole = 1.0 + z * z / of
    return float((middle - half) / whole), float((middle + half) / whole)
