"""Gauss-Newton fit of named parameters with priors, for few parameters and costly residuals.

Each parameter has a nominal value and a prior standard deviation, and is fitted as a number of
standard deviations from the nominal value. Residuals come in blocks. All blocks share the named
parameters. Each block may also have local parameters, such as its initial state. Local parameters
are eliminated block by block, so that the computing time is proportional to the length of the log.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number

STEP = 0.03  # step of the differences, in prior standard deviations
LONGEST_STEP = 1.5  # largest motion of a parameter in one round, in prior standard deviations
SMALLEST_FACTOR = 0.3  # largest factor by which a linear step reduces a value
ENOUGH = 2e-3  # relative decrease of the cost, below which rounds end
_TRIES = 6  # number of damping factors tried in a round


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedParameter:
    """One number to be fitted."""

    name: str
    unit: str
    nominal: float
    sigma: float  # prior standard deviation in the unit; for a factor that of its logarithm
    # True: positive, fitted as the logarithm of its ratio to the nominal value
    factor: bool = False

    def __post_init__(self) -> None:
        finite_number(self.sigma, f"parameter {self.name}: prior standard deviation", above=0.0)
        finite_number(self.nominal, f"parameter {self.name}: nominal value")
        if self.factor and not self.nominal > 0.0:
            raise ConfigurationError(
                f"parameter {self.name}: a factor must be > 0, got {self.nominal}"
            )

    def value(self, deviations: float) -> float:
        """Value at `deviations` prior standard deviations from the nominal value."""
        if self.factor:
            return self.nominal * float(np.exp(self.sigma * deviations))
        return self.nominal + self.sigma * deviations

    def moved(self, deviations: float, step: float) -> float:
        """Deviations after a linear step of the value itself, also for a factor."""
        if not self.factor:
            return deviations + step
        return (
            deviations + float(np.log1p(max(self.sigma * step, SMALLEST_FACTOR - 1.0))) / self.sigma
        )


class Mapping(Protocol):
    """The method `map` of an executor: results in order."""

    def __call__(
        self, function: Callable[[Array], Array], points: Iterable[Array], /
    ) -> Iterable[Array]:
        """Values of the function at the points."""
        ...


class Slopes(NamedTuple):
    """Residuals of one block and their derivatives."""

    residuals: Array  # (m,) residuals in units of their standard deviations
    shared: Array  # (m, n) with respect to the deviations of the named parameters
    # (m, k) with respect to the block's local parameters, which have unit prior variance
    local: Array


class Blocks(Protocol):
    """Residuals in blocks."""

    @property
    def local(self) -> Sequence[int]:
        """Number of local parameters of each block."""
        ...

    def residuals(self, deviations: Array, local: Sequence[Array]) -> list[Array]:
        """Residuals of each block over their standard deviations; not finite if not computable."""
        ...

    def slopes(self, deviations: Array, local: Sequence[Array]) -> list[Slopes]:
        """Residuals of each block, with their derivatives."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFit:
    """Result of a fit."""

    parameters: tuple[NamedParameter, ...]
    deviations: Array  # (n,) deviations from the nominal values, in prior standard deviations
    # (n, n) covariance of the deviations, if residuals are independent with unit variance
    covariance: Array
    cost: float  # sum of squares of residuals and deviations
    rounds: int
    local: tuple[Array, ...] = ()  # local parameters of each block

    @property
    def values(self) -> dict[str, float]:
        """Value by name."""
        return values_of(self.parameters, self.deviations)

    @property
    def told(self) -> Array:
        """Share (n,) of the prior variance that the data removed; 0 without information."""
        return 1.0 - np.diag(self.covariance)

    def interval(self, index: int, sigmas: float) -> tuple[float, float]:
        """Interval of a parameter, `sigmas` standard deviations to either side."""
        parameter = self.parameters[index]
        x = float(self.deviations[index])
        half = sigmas * float(np.sqrt(max(self.covariance[index, index], 0.0)))
        return parameter.value(x - half), parameter.value(x + half)


def values_of(parameters: Sequence[NamedParameter], deviations: Array) -> dict[str, float]:
    """Values by name, at `deviations` (n,) prior standard deviations from the nominal values."""
    return {
        parameter.name: parameter.value(float(x))
        for parameter, x in zip(parameters, deviations, strict=True)
    }


def fit_named(
    residuals: Callable[[Array], Array],
    parameters: Sequence[NamedParameter],
    *,
    start: Array | None = None,
    rounds: int = 8,
    mapped: Mapping = map,
) -> NamedFit:
    """Fit parameters to one block of residuals, with derivatives by finite differences.

    Args:
        residuals: Function of the deviations (n,) that returns residuals (m,) in units of their
            standard deviations, or numbers that are not finite if it cannot be computed.
        parameters: Parameters to fit.
        start: (n,) initial deviations; None: the nominal values.
        rounds: Largest number of rounds.
        mapped: Maps the function over the points of a round, as `concurrent.futures.Executor.map`
            does.

    Returns:
        The fit.

    Raises:
        ConfigurationError: The residuals are not finite at the start.
    """
    return fit_blocks(_Differences(residuals, mapped), parameters, start=start, rounds=rounds)


def fit_blocks(
    blocks: Blocks,
    parameters: Sequence[NamedParameter],
    *,
    start: Array | None = None,
    local: Sequence[Array] | None = None,
    rounds: int = 8,
    enough: float = ENOUGH,
    straight: bool = False,
) -> NamedFit:
    """Fit parameters by Gauss-Newton with Levenberg's damping.

    Args:
        blocks: The residuals.
        parameters: Parameters to fit.
        start: (n,) initial deviations; None: the nominal values.
        local: Initial local parameters of each block; None: zeros.
        rounds: Largest number of rounds.
        enough: Relative decrease of the cost, below which rounds end.
        straight: True: step in the values of factors, not in their logarithms, since residuals of
            forces are linear in the values.

    Returns:
        The fit.

    Raises:
        ConfigurationError: The residuals are not finite at the start.
    """
    n = len(parameters)
    x = np.zeros(n) if start is None else np.array(start, dtype=np.float64)
    y = [np.zeros(k) for k in blocks.local] if local is None else [np.array(b) for b in local]

    cost = _cost(blocks.residuals(x, y), x, y)
    if not np.isfinite(cost):
        raise ConfigurationError("the residuals are not finite at the start of the fit")

    # Damping relative to the diagonal also limits directions that only a sum observes; a linear fit
    # begins with almost no damping.
    damping, least = (1e-6, 1e-9) if straight else (1e-2, 1e-4)
    reduced = Reduced.of([], x, y)
    done = 0
    while done < rounds:
        done += 1
        reduced = Reduced.of(blocks.slopes(x, y), x, y)

        # Damped step, shorter until it lowers the cost.
        before = cost
        for _ in range(_TRIES):
            held = reduced.H + damping * np.diag(np.diag(reduced.H))
            step = np.asarray(-np.linalg.solve(held, reduced.gradient), dtype=np.float64)
            step, trial = _moved(parameters, x, step, straight)
            beside = _sums(y, reduced.local(step))
            reached = _cost(blocks.residuals(trial, beside), trial, beside)
            if reached < cost:
                x = trial
                y = beside
                cost = reached
                damping = max(damping / 5.0, least)
                break
            damping *= 100.0 if straight else 10.0

        if before - cost < enough * before:
            break

    covariance = np.array(np.linalg.inv(reduced.H), np.float64)
    return NamedFit(
        parameters=tuple(parameters),
        deviations=x,
        covariance=covariance,
        cost=cost,
        rounds=done,
        local=tuple(y),
    )


class Reduced(NamedTuple):
    """Normal equations of the named parameters, with the blocks' local parameters eliminated."""

    H: Array  # (n, n)
    gradient: Array  # (n,)
    # for each block: (k,) step without the named parameters, (k, n) its derivative
    eliminated: list[tuple[Array, Array]]

    @classmethod
    def of(cls, blocks: Sequence[Slopes], deviations: Array, local: Sequence[Array]) -> "Reduced":
        """Normal equations with unit priors."""
        H = np.eye(len(deviations))
        gradient = np.array(deviations)
        eliminated = []

        for (r, J, L), y in zip(blocks, local, strict=False):
            # The local parameters of a block are eliminated (Schur complement).
            C = L.T @ L + np.eye(L.shape[1])
            B = L.T @ J
            solved = np.linalg.solve(C, np.column_stack([L.T @ r + y, B]))
            H += J.T @ J - B.T @ solved[:, 1:]
            gradient += J.T @ r - B.T @ solved[:, 0]
            eliminated.append((-solved[:, 0], -solved[:, 1:]))

        return cls(H, gradient, eliminated)

    def local(self, step: Array) -> list[Array]:
        """Steps of each block's local parameters for a step (n,) of the named parameters."""
        return [alone + slope @ step for alone, slope in self.eliminated]


def _moved(
    parameters: Sequence[NamedParameter], x: Array, step: Array, straight: bool
) -> tuple[Array, Array]:
    """The step that is taken, shortened unless `straight`, and the deviations (n,) after it."""
    if straight:
        moved = [p.moved(float(a), float(b)) for p, a, b in zip(parameters, x, step, strict=True)]
        return step, np.array(moved, dtype=np.float64)

    short = np.asarray(np.clip(step, -LONGEST_STEP, LONGEST_STEP), dtype=np.float64)
    return short, np.asarray(x + short, dtype=np.float64)


def _sums(local: Sequence[Array], steps: Sequence[Array]) -> list[Array]:
    return [y + step for y, step in zip(local, steps, strict=True)]


def _cost(residuals: Sequence[Array], x: Array, local: Sequence[Array]) -> float:
    if not all(np.all(np.isfinite(r)) for r in residuals):
        return np.inf
    return float(sum(r @ r for r in residuals) + x @ x + sum(y @ y for y in local))


class _Differences:
    """One block with derivatives by finite differences, which a pool of processes may compute."""

    local = (0,)

    def __init__(self, residuals: Callable[[Array], Array], mapped: Mapping) -> None:
        self._function = residuals
        self._mapped = mapped
        self._last = np.zeros(0), np.zeros(0)

    def residuals(self, deviations: Array, local: Sequence[Array]) -> list[Array]:
        """Residuals of the block."""
        (r,) = self._mapped(self._function, [deviations])
        self._last = np.array(deviations), r
        return [r]

    def slopes(self, deviations: Array, local: Sequence[Array]) -> list[Slopes]:
        """Residuals, and their finite differences; a column that is not finite counts as zero."""
        at, r = self._last
        if not np.array_equal(at, deviations):
            (r,) = self.residuals(deviations, local)

        moved = self._mapped(
            self._function, [deviations + STEP * e for e in np.eye(len(deviations))]
        )

        columns = [
            (r_moved - r) / STEP if np.all(np.isfinite(r_moved)) else np.zeros_like(r)
            for r_moved in moved
        ]
        return [Slopes(r, np.column_stack(columns), np.zeros((len(r), 0)))]
