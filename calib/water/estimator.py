"""Parameters from logs, with intervals that allow for misstated noise and coloured residuals.

Residuals of real logs are neither of the stated size nor independent. After a fit each channel is
compared with white
noise that has gone through the same fit: by its variance, and by the variance of its sums over a
second, which neighbours of one sign enlarge. The larger of the two ratios widens the channel's
noise, and the fit is made again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.stats import t

from uuv.calib.water.named_fit import Blocks, NamedFit, NamedParameter, Reduced, Slopes, fit_blocks
from uuv.sim.interfaces.spatial import Array

PASSES = 2  # comparisons with white noise
# degrees of freedom of Student's t that a block counts as: what disturbs is drawn anew in each
FREEDOM = 2
# share of the cost by which a round must lower it: far less than a standard deviation makes
SETTLED = 1e-5
_DRAWS = 4  # of white noise
_LEAST = 0.05  # of a ratio


class ChannelBlocks(Blocks, Protocol):
    """Blocks whose residuals are those of channels."""

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
        """Numbers of a sample of each channel, which follow one another in a block."""
        ...

    @property
    def a_second(self) -> Sequence[int]:
        """Samples in a second of each channel."""
        ...

    def widen(self, factors: Array) -> None:
        """Multiply the noise of each channel."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaterFit:
    """Estimate from logs."""

    named: NamedFit
    widened: dict[str, float]  # by channel: noise that the intervals allow for, over the stated one
    quantile: float  # standard deviations of half a 95 % interval

    @property
    def parameters(self) -> tuple[NamedParameter, ...]:
        """Those fitted."""
        return self.named.parameters

    @property
    def sigmas(self) -> Array:
        """Standard deviations (n,) in those of the priors."""
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
        parameters: Those to fit.
        start: (n,) deviations to begin with, from which the residuals are nearly straight.
        rounds: Most rounds of the first fit.

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
    """Variance (channels,) of residuals over that of white noise passed through the same fit."""
    slopes = blocks.slopes(fit.deviations, fit.local)
    reduced = Reduced.of(slopes, fit.deviations, fit.local)
    inverse = np.array(np.linalg.inv(reduced.H), dtype=np.float64)
    solved = [np.linalg.inv(L.T @ L + np.eye(L.shape[1])) @ L.T for _, _, L in slopes]

    # Powers of the residuals, and of white noise through the same fit.
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
    """What a fit leaves of noise in the residuals."""
    left = [e - L @ (P @ e) for e, (_, _, L), P in zip(noise, slopes, solved, strict=True)]
    gradient = np.sum([J.T @ e for e, (_, J, _) in zip(left, slopes, strict=True)], axis=0)

    step = inverse @ gradient
    moved = [J @ step for _, J, _ in slopes]
    return [
        e - (m - L @ (P @ m))
        for e, m, (_, _, L), P in zip(left, moved, slopes, solved, strict=True)
    ]


def _powers(blocks: ChannelBlocks, residuals: Sequence[Array]) -> Array:
    """Mean squares (2, channels) of residuals, and of their sums over a second by their number."""
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
