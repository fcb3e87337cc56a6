"""Named parameters fitted to residuals: Gauss-Newton with priors, for few parameters and costly residuals.

Each parameter has a nominal value and a prior standard deviation, and is fitted as a number of standard deviations from
it. Columns of the Jacobian are differences, which a pool of processes may compute.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, finite_number

STEP = 0.03  # prior standard deviations, of the differences
LONGEST_STEP = 1.5  # prior standard deviations that a parameter moves in one round
ENOUGH = 2e-3  # share of the cost by which a round must lower it
_TRIES = 6  # damping factors tried in a round


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedParameter:
    """One number to be fitted."""

    name: str
    unit: str
    nominal: float
    sigma: float  # prior standard deviation in the unit; of a factor, that of its logarithm
    factor: bool = False  # positive, fitted as the logarithm of its ratio to the nominal value

    def __post_init__(self) -> None:
        finite_number(self.sigma, f"parameter {self.name}: prior standard deviation", above=0.0)
        finite_number(self.nominal, f"parameter {self.name}: nominal value")
        if self.factor and not self.nominal > 0.0:
            raise ConfigurationError(f"parameter {self.name}: a factor must be > 0, got {self.nominal}")

    def value(self, deviations: float) -> float:
        """Value at so many prior standard deviations from the nominal one."""
        if self.factor:
            return self.nominal * float(np.exp(self.sigma * deviations))
        return self.nominal + self.sigma * deviations


class Mapping(Protocol):
    """The method `map` of an executor: results in order."""

    def __call__(self, function: Callable[[Array], Array], points: Iterable[Array], /) -> Iterable[Array]:
        """Values of the function at the points."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFit:
    """Result of a fit."""

    parameters: tuple[NamedParameter, ...]
    deviations: Array  # (n,) prior standard deviations from the nominal values
    covariance: Array  # (n, n) of the deviations, if residuals have unit variance and are independent
    cost: float  # sum of squares of residuals and deviations
    rounds: int

    @property
    def values(self) -> dict[str, float]:
        """Value by name."""
        return values_of(self.parameters, self.deviations)

    @property
    def told(self) -> Array:
        """Share (n,) of the prior variance that the data took away: 0 where they tell nothing of a parameter."""
        return 1.0 - np.diag(self.covariance)


def values_of(parameters: Sequence[NamedParameter], deviations: Array) -> dict[str, float]:
    """Value by name at so many prior standard deviations (n,) from the nominal values."""
    return {each.name: each.value(float(x)) for each, x in zip(parameters, deviations, strict=True)}


def fit_named(
    residuals: Callable[[Array], Array],
    parameters: Sequence[NamedParameter],
    *,
    start: Array | None = None,
    rounds: int = 8,
    mapped: Mapping = map,
) -> NamedFit:
    """Fit parameters by Gauss-Newton with Levenberg's damping.

    Args:
        residuals: Function of the deviations (n,), residuals (m,) in their standard deviations. Where it cannot be
            computed it gives numbers that are not finite.
        parameters: Those to fit.
        start: (n,) deviations to begin with; None: the nominal values.
        rounds: Most rounds.
        mapped: Maps the function over the points of a round, as `concurrent.futures.Executor.map` does.

    Returns:
        The fit.

    Raises:
        ConfigurationError: The residuals are not finite at the start.
    """
    n = len(parameters)
    x = np.zeros(n) if start is None else np.array(start, dtype=np.float64)
    (r,) = mapped(residuals, [x])
    if not np.all(np.isfinite(r)):
        raise ConfigurationError("the residuals are not finite at the start of the fit")
    cost, damping, H, done = float(r @ r + x @ x), 1e-2, np.eye(n), 0
    while done < rounds:
        done += 1
        moved = list(mapped(residuals, [x + STEP * e for e in np.eye(n)]))
        J = np.column_stack([(each - r) / STEP if np.all(np.isfinite(each)) else np.zeros_like(r) for each in moved])
        H, gradient = J.T @ J + np.eye(n), J.T @ r + x
        before = cost
        for _ in range(_TRIES):
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)), gradient)
            there = x + np.clip(step, -LONGEST_STEP, LONGEST_STEP)
            (found,) = mapped(residuals, [there])
            reached = float(found @ found + there @ there) if np.all(np.isfinite(found)) else np.inf
            if reached < cost:
                x, r, cost, damping = there, found, reached, max(damping / 5.0, 1e-4)
                break
            damping *= 10.0
        if before - cost < ENOUGH * before:
            break
    return NamedFit(
        parameters=tuple(parameters),
        deviations=x,
        covariance=np.array(np.linalg.inv(H), np.float64),
        cost=cost,
        rounds=done,
    )
