"""Estimation of parameters from logs, with intervals that allow for misstated noise and coloured
residuals.

Residuals of real logs neither have the stated size nor are independent. After a fit, the residuals
of each channel are compared with white noise that has gone through the same fit. Their variance is
compared, and the variance of their sums over one second, which is larger for correlated residuals.
The larger of the two ratios widens the noise of the channel, and the fit is repeated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.stats import t

from uuv.calib.water.named_fit import Blocks, NamedFit, NamedParameter, Reduced, Slopes, fit_blocks
from uuv.sim.interfaces.spatial import Array

PASSES = 2  # number of comparisons with white noise
# degrees of freedom of Student's t for which a block counts, since disturbances are drawn anew in
# each block
FREEDOM = 2
# relative decrease of the cost below which rounds end: far less than a standard deviation causes
SETTLED = 1e-5
_DRAWS = 4  # number of draws of white noise
_LEAST = 0.05  # largest value of a ratio


class ChannelBlocks(Blocks, Protocol):
    """Blocks of residuals that belong to channels."""

    @property
    def channels(self) -> Sequence[str]:
        """Name of each channel."""
        ...

    @property
    def labels(self) -> Sequence[np.ndarray]:
        """Index (m,) into `channels` of each residual of each block."""
        ...

    @property
    def widths(self) -> Sequence[int]:
        """Number of values in a sample of each channel; these values are consecutive in a block."""
        ...

    @property
    def a_second(self) -> Sequence[int]:
        """Number of samples per second of each channel."""
        ...

    def widen(self, factors: Array) -> None:
        """Multiply the noise of each channel by a factor."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaterFit:
    """Estimate from logs."""

    named: NamedFit
    # by channel: ratio of the noise that the intervals allow for to the stated noise
    widened: dict[str, float]
    quantile: float  # half of a 95 % interval, in standard deviations

    @property
    def parameters(self) -> tuple[NamedParameter, ...]:
        """The fitted parameters."""
        return self.named.parameters

    @property
    def sigmas(self) -> Array:
        """Standard deviations (n,), in units of the prior standard deviations."""
        return np.sqrt(np.diag(self.named.covariance))


def estimate(
    blocks: ChannelBlocks,
    parameters: Sequence[NamedParameter],
    *,
    start: Array | None = None,
    rounds: int = 8,
) -> WaterFit:
    """Fit parameters and widen the noise of each channel until its residuals agree with it.

    Args:
        blocks: Residuals; their noise is widened in place.
        parameters: Parameters to fit.
        start: (n,) initial deviations, from which the residuals are nearly linear.
        rounds: Largest number of rounds of the first fit.

    Returns:
        The estimate.

    Raises:
        ConfigurationError: As `fit_blocks`.
    """
    fit = fit_blocks(blocks, parameters, start=start, rounds=rounds, enough=SETTLED, straight=True)

    # The noise of each channel is widened to agree with its residuals.
    widened = np.ones(len(blocks.channels))
    for _ in range(PASSES):
        factors = np.sqrt(excess(blocks, fit))
        blocks.widen(factors)
        widened *= factors
        fit = fit_blocks(
            blocks,
            parameters,
            start=fit.deviations,
            local=fit.local,
            rounds=3,
            enough=SETTLED,
            straight=True,
        )

    return WaterFit(
        named=fit,
        widened=dict(zip(blocks.channels, widened.tolist(), strict=True)),
        quantile=float(t.ppf(0.975, FREEDOM * len(blocks.local))),
    )


def excess(blocks: ChannelBlocks, fit: NamedFit) -> Array:
    """Ratio (channels,) of the variance of residuals to that of white noise passed through the same
    fit.
    """
    slopes = blocks.slopes(fit.deviations, fit.local)
    reduced = Reduced.of(slopes, fit.deviations, fit.local)
    inverse = np.array(np.linalg.inv(reduced.H), dtype=np.float64)
    solved = [np.linalg.inv(L.T @ L + np.eye(L.shape[1])) @ L.T for _, _, L in slopes]

    # Mean squares of the residuals, and of white noise through the same fit.
    measured = _powers(blocks, [block.residuals for block in slopes])
    rng = np.random.default_rng(0)
    white = np.mean(
        [
            _powers(
                blocks,
                _through(slopes, solved, inverse, [rng.standard_normal(len(s[0])) for s in slopes]),
            )
            for _ in range(_DRAWS)
        ],
        axis=0,
    )

    ratio = np.max(measured / np.maximum(white, 1e-12), axis=0)
    return np.clip(ratio, _LEAST, None)


def _through(
    slopes: Sequence[Slopes], solved: Sequence[Array], inverse: Array, noise: list[Array]
) -> list[Array]:
    """Residuals that a fit leaves of given noise."""
    left = [e - L @ (P @ e) for e, (_, _, L), P in zip(noise, slopes, solved, strict=True)]
    gradient = np.sum([J.T @ e for e, (_, J, _) in zip(left, slopes, strict=True)], axis=0)

    step = inverse @ gradient
    moved = [J @ step for _, J, _ in slopes]
    return [
        e - (m - L @ (P @ m))
        for e, m, (_, _, L), P in zip(left, moved, slopes, solved, strict=True)
    ]


def _powers(blocks: ChannelBlocks, residuals: Sequence[Array]) -> Array:
    """Mean squares (2, channels) of residuals, and of their sums over a second divided by the
    number of samples.
    """
    count = len(blocks.channels)
    squares = np.zeros((2, count))
    numbers = np.zeros((2, count))

    for r, label in zip(residuals, blocks.labels, strict=True):
        for c in range(count):
            residuals_c = r[label == c].reshape(-1, blocks.widths[c])
            squares[0, c] += np.sum(residuals_c**2)
            numbers[0, c] += residuals_c.size

            # Sums over a second: coloured residuals do not average out.
            summed = max(2, blocks.a_second[c])
            whole = len(residuals_c) // summed
            if whole:
                sums = residuals_c[: whole * summed].reshape(whole, summed, -1).sum(axis=1)
                squares[1, c] += np.sum(sums**2) / summed
                numbers[1, c] += sums.size

    return squares / np.maximum(numbers, 1.0)
