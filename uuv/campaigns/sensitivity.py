"""Sensitivity of results to drawn parameters: partial rank correlations, failures by parameter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, mannwhitneyu, rankdata

from uuv.sim.evaluation.intervals import LEVEL, TAILS, middle
from uuv.sim.interfaces.spatial import Array

SEEDS = ("seed", "perturbation_seed", "variation_seed")  # drawn parameters that have no order
RESAMPLES = 1000  # number of resamples in the bootstrap
FIRST = 5  # number of parameters that a ranking names
ANY = "any reason"  # the name for all reasons together
FEWEST_FAILED = 3  # smallest number of runs with one reason that are compared with the others
_PART = 500_000  # number of weights of runs at a time, which bounds the memory
# added to correlations, so that a column that is constant in a resample has coefficient 0
_RIDGE = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """A drawn parameter as columns of a regression: one column for a number, and for a category one
    less than there are categories.
    """

    name: str
    columns: Array  # (runs, m); NaN where the run has no value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensitivity:
    """Sensitivity of one response to all parameters; arrays are in the order of `names`."""

    names: tuple[str, ...]
    runs: int  # number of runs that were used
    # (k,) partial rank correlation; its modulus for a parameter with several columns
    coefficient: Array
    low: Array  # (k,) lower end of the bootstrap interval
    high: Array  # (k,) upper end
    null: Array  # (k,) modulus that a parameter without effect exceeds in 5 % of such tables
    p: Array  # (k,) probability of this modulus or a larger one without an effect
    place: Array  # (k, 2) interval of the rank by modulus, from 1
    explained: float  # R^2 of the ranks on all parameters
    adjusted: float  # the same, adjusted for the number of columns
    explained_by_first: float  # R^2 on only the first parameters of the ranking

    @property
    def ranking(self) -> list[int]:
        """Indices of the parameters, in order of decreasing modulus."""
        return np.argsort(-np.abs(self.coefficient), kind="stable").tolist()

    def as_metrics(self) -> dict[str, Any]:
        """Content for metrics.json, with the parameters in the order of the ranking."""
        return {
            "runs": self.runs,
            "explained": self.explained,
            "explained_adjusted": self.adjusted,
            "explained_by_first": self.explained_by_first,
            "parameters": [
                {
                    "name": self.names[i],
                    "coefficient": float(self.coefficient[i]),
                    "low": float(self.low[i]),
                    "high": float(self.high[i]),
                    "null": float(self.null[i]),
                    "p": float(self.p[i]),
                    "place": self.place[i].tolist(),
                }
                for i in self.ranking
            ],
        }


def factors_of(draws: Sequence[Mapping[str, Any]]) -> list[Factor]:
    """Parameters that vary between the runs, from their drawn values.

    A number gives one column. A vector gives columns for its length and each component. Text and
    booleans give a column for each category except the first in the alphabet, so that two
    categories are one column with a sign. Seeds are left out.

    Args:
        draws: Drawn values by name, for each run; a run may lack some.
    """
    factors: list[Factor] = []
    for name in dict.fromkeys(name for draw in draws for name in draw if name not in SEEDS):
        column = [draw.get(name) for draw in draws]
        stated = [value for value in column if value is not None]

        # A vector: its length and each component.
        if stated and all(
            isinstance(value, list) and len(value) == len(stated[0]) for value in stated
        ):
            vectors = np.array(
                [value or [np.nan] * len(stated[0]) for value in column], dtype=np.float64
            )
            axes = "xyz" if vectors.shape[1] == 3 else [str(i) for i in range(vectors.shape[1])]
            factors.append(Factor(f"{name} (length)", np.linalg.norm(vectors, axis=1)[:, None]))
            factors += [Factor(f"{name} ({axis})", vectors[:, [i]]) for i, axis in enumerate(axes)]
        elif all(
            isinstance(value, (int, float)) and not isinstance(value, bool) for value in stated
        ):
            factors.append(Factor(name, np.array(column, dtype=np.float64)[:, None]))
        else:
            # A column for each category except the first.
            words = [None if value is None else str(value) for value in column]
            kinds = sorted({word for word in words if word is not None})
            columns = [
                [np.nan if word is None else float(word == kind) for word in words]
                for kind in kinds[1:]
            ]
            label = f"{name} = {kinds[1]}" if len(kinds) == 2 else name
            factors.append(
                Factor(label, np.array(columns, dtype=np.float64).reshape(-1, len(draws)).T)
            )

    # Of these, the columns that vary.
    return [
        factor
        for factor in factors
        if len({*map(tuple, factor.columns[~np.isnan(factor.columns).any(axis=1)].tolist())}) > 1
    ]


def fewest_runs(factors: Sequence[Factor]) -> int:
    """Number of runs that `sensitivity` needs: a resample, 63 % of them, must still determine all
    columns.
    """
    return 2 * (sum(factor.columns.shape[1] for factor in factors) + 1)


def sensitivity(
    factors: Sequence[Factor], response: Array, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Sensitivity | None:
    """Partial rank correlation of each parameter with a response [Marino 2008]; None if there are
    too few runs, or if the response does not vary.

    Columns and response are converted to ranks. The coefficient of a parameter is the correlation
    of the residuals of both after a linear regression on all other parameters. The coefficient of a
    parameter with several columns is the root of their partial R^2. Intervals are percentiles of a
    bootstrap over the runs with fixed ranks. Without an effect the squared coefficient follows a
    beta distribution, exact for normal residuals, which gives `null` and `p`.

    Args:
        factors: Parameters, from `factors_of`.
        response: (runs,) Values. Runs with NaN are left out, and infinite values rank last.
        rng: Random generator of the bootstrap.
        resamples: Number of resamples.
    """
    if not factors:
        return None

    # Ranks of the runs that have all values.
    columns = np.hstack([factor.columns for factor in factors])
    used = ~np.isnan(response) & ~np.isnan(columns).any(axis=1)
    n = int(used.sum())
    k = columns.shape[1]
    if n < fewest_runs(factors) or len({*response[used].tolist()}) < 2:
        return None
    table = rankdata(np.column_stack([columns[used], response[used]]), axis=0)
    owner = np.repeat(np.arange(len(factors)), [factor.columns.shape[1] for factor in factors])

    coefficients, explained = _coefficients(table, np.ones((1, n)), owner)

    # Bootstrap over the runs with fixed ranks.
    drawn = np.empty((resamples, len(factors)))
    at_once = max(1, _PART // n)
    for begin in range(0, resamples, at_once):
        here = drawn[begin : begin + at_once]
        here[:] = _coefficients(
            table, rng.multinomial(n, np.full(n, 1.0 / n), size=len(here)), owner
        )[0]
    low, high = middle(drawn)
    places = rankdata(-np.abs(drawn), axis=1, method="ordinal")

    # Half the degrees of freedom of the squared coefficient without an effect.
    sizes = np.bincount(owner) / 2.0
    left = (n - 1 - k) / 2.0
    estimate = coefficients[0]

    # R^2 on only the first parameters of the ranking.
    first = np.argsort(-np.abs(estimate), kind="stable")[:FIRST]
    alone = np.isin(owner, first)
    _, by_first = _coefficients(
        table[:, [*np.flatnonzero(alone), k]], np.ones((1, n)), np.arange(alone.sum())
    )

    return Sensitivity(
        names=tuple(factor.name for factor in factors),
        runs=n,
        coefficient=estimate,
        low=low,
        high=high,
        null=np.sqrt(beta.ppf(LEVEL, sizes, left)),
        p=beta.sf(estimate**2, sizes, left),
        place=np.quantile(places, TAILS, axis=0, method="nearest").T.astype(int),
        explained=float(explained[0]),
        adjusted=float(1.0 - (1.0 - explained[0]) * (n - 1) / (n - 1 - k)),
        explained_by_first=float(by_first[0]),
    )


def _coefficients(
    table: Array, weights: NDArray[Any], owner: NDArray[np.int_]
) -> tuple[Array, Array]:
    """Partial correlations (samples, parameters) and R^2 (samples,), from inverse correlations.

    Args:
        table: (n, k + 1) columns and response.
        weights: (samples, n) Number of times that a row is in a sample.
        owner: (k,) parameter of each column.
    """
    centred = table - (weights @ table / weights.sum(axis=1)[:, None])[:, None, :]
    covariance = np.matmul((centred * weights[:, :, None]).transpose(0, 2, 1), centred)

    # Correlations; a column that is constant in a sample keeps the scale 1.
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale[scale == 0.0] = 1.0
    correlation = covariance / scale[:, :, None] / scale[:, None, :]
    inverse = np.linalg.inv(correlation + _RIDGE * np.eye(table.shape[1]))
    last = inverse[:, -1, -1]

    # Partial correlation of each parameter with the response, which is the last column.
    coefficients = np.empty((len(weights), owner.max() + 1))
    for number in range(coefficients.shape[1]):
        of_parameter = np.flatnonzero(owner == number)
        across = inverse[:, of_parameter, -1]
        if len(of_parameter) == 1:
            coefficients[:, number] = -across[:, 0] / np.sqrt(
                inverse[:, of_parameter[0], of_parameter[0]] * last
            )
        else:
            solved = np.linalg.solve(
                inverse[:, of_parameter[:, None], of_parameter], across[:, :, None]
            )[:, :, 0]
            coefficients[:, number] = np.sqrt(np.maximum(0.0, (across * solved).sum(axis=1) / last))

    return np.clip(coefficients, -1.0, 1.0), np.clip(1.0 - 1.0 / last, 0.0, 1.0)


def worst_ratio(values: Mapping[str, float | None], bounds: Mapping[str, float]) -> float:
    """Largest ratio of a metric to its bound; infinite if a metric is missing, or beyond a bound of
    0 or less.
    """
    ratios = [0.0]
    for name, most in bounds.items():
        figure = values.get(name)
        if figure is None:
            return np.inf
        ratios.append(figure / most if most > 0.0 else (np.inf if figure > most else 0.0))

    return max(ratios)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReasonShift:
    """Position of the runs that failed for one reason in the range of a parameter."""

    reason: str
    parameter: str
    runs: int  # number of runs with that reason
    median_rank: float  # median rank of these runs among all; 0 lowest, 1 highest
    p: float  # p of the two-sided Mann-Whitney test against all other runs


def shifts(factors: Sequence[Factor], reasons: Sequence[Sequence[str]]) -> list[ReasonShift]:
    """Positions of the runs that failed for a reason in the range of each parameter with one
    column.

    The result has an entry for each reason of at least three runs, and for all reasons together.

    Args:
        factors: Parameters, such as the first five of a ranking.
        reasons: Reasons why each run failed; a run may have several or none.
    """
    moved = []
    named = dict.fromkeys(reason for several in reasons for reason in several)
    for reason in (*named, *((ANY,) if len(named) > 1 else ())):
        having = np.array(
            [bool(several) if reason == ANY else reason in several for several in reasons]
        )

        for factor in factors:
            known = ~np.isnan(factor.columns).any(axis=1)
            inside = having[known]
            if factor.columns.shape[1] > 1 or inside.sum() < FEWEST_FAILED or inside.all():
                continue

            sample = factor.columns[known, 0]
            rank = (rankdata(sample) - 1.0) / (len(sample) - 1.0)
            moved.append(
                ReasonShift(
                    reason=reason,
                    parameter=factor.name,
                    runs=int(inside.sum()),
                    median_rank=float(np.median(rank[inside])),
                    p=float(mannwhitneyu(sample[inside], sample[~inside]).pvalue),
                )
            )

    return moved
