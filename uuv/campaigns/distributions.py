"""Distributions of a campaign's parameters, and designs of the draws: random, Sobol, or Latin
hypercube.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array, finite_number, shown
from uuv.sim.interfaces.streams import Streams

Design = Literal["random", "sobol", "latin-hypercube"]
DESIGNS: tuple[Design, ...] = get_args(Design)
STEP = "step"  # key of a distribution in addition to its kind
# largest number of steps in a value; whole numbers beyond it are not exact in a double
_MOST_STEPS = 2.0**53
_DRAWS = 1  # identifies the random stream of the designs


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """Distribution of one parameter, as a map from the unit cube. In a file it is written `{
    uniform = [0, 1] }`.
    """

    kind: str  # a key of KINDS
    values: tuple[Any, ...]  # lower and upper end, or the categories
    step: float | None = None  # values are rounded to multiples of `step`, but not below one step

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            known = ", ".join(KINDS) + did_you_mean(self.kind, KINDS)
            raise ConfigurationError(f"no distribution {shown(self.kind)}; allowed {known}")

        if self.step is not None:
            finite_number(self.step, STEP, above=0.0)
            largest = max(
                (abs(entry) for entry in self.values if isinstance(entry, int | float)), default=0.0
            )
            if not largest < _MOST_STEPS * self.step:
                raise ConfigurationError(
                    f"{STEP}: must be larger than 1/{_MOST_STEPS:g} of the largest value, got "
                    f"{shown(self.step)}"
                )

        # Categories; all other kinds have two ends.
        if self.kind == "categorical":
            if not self.values or self.step is not None:
                raise ConfigurationError(
                    f"categorical: must have values and no `{STEP}`, got {shown(list(self.values))}"
                )
            return

        if len(self.values) != 2:
            raise ConfigurationError(
                f"{self.kind}: must be two numbers, got {shown(list(self.values))}"
            )

        # The ends must increase, and be positive if the kind requires it.
        low, high = (finite_number(value, self.kind) for value in self.values)
        if (
            low > high
            or (KINDS[self.kind].positive and not low > 0.0)
            or (self.kind == "direction" and low < 0.0)
        ):
            sign = " above 0" if KINDS[self.kind].positive else ""
            raise ConfigurationError(
                f"{self.kind}: must be two increasing numbers{sign}, got {shown([low, high])}"
            )

    @classmethod
    def of(cls, table: Any) -> "Distribution":
        """The distribution in a table of a file.

        Raises:
            ConfigurationError: The table is not a distribution.
        """
        if not isinstance(table, Mapping) or len(kinds := [*table.keys() - {STEP}]) != 1:
            allowed = ", ".join(f"{{ {kind} = [...] }}" for kind in KINDS)
            raise ConfigurationError(f"must be one of {allowed}, got {shown(table)}")

        values = table[kinds[0]]
        if not isinstance(values, list):
            raise ConfigurationError(f"{kinds[0]}: must be a list, got {shown(values)}")
        return cls(kind=str(kinds[0]), values=tuple(values), step=table.get(STEP))

    @property
    def dimensions(self) -> int:
        """Number of coordinates of the unit cube that one value uses."""
        return KINDS[self.kind].dimensions

    def at(self, u: Array) -> Any:
        """The value at `u` (dimensions,) in [0, 1): a number, a category, or a vector as a list."""
        sample = KINDS[self.kind].value(self.values, u)
        return sample if self.step is None else max(1, round(sample / self.step)) * self.step


@dataclass(frozen=True, slots=True)
class _Kind:
    """Map from the unit cube for one kind of distribution."""

    value: Callable[[Sequence[Any], Array], Any]
    dimensions: int = 1
    positive: bool = False  # whether both ends must be positive


def _between(ends: Sequence[float], u: float) -> float:
    return float(ends[0] + (ends[1] - ends[0]) * u)


def _direction(ends: Sequence[float], u: Array) -> list[float]:
    """Vector with uniform length between `ends`, and uniform direction on the sphere."""
    length = _between(ends, u[0])
    rise = 2.0 * u[1] - 1.0
    azimuth = 2.0 * np.pi * u[2]
    level = math.sqrt(1.0 - rise * rise)
    return [
        float(length * component)
        for component in (level * np.cos(azimuth), level * np.sin(azimuth), rise)
    ]


KINDS: Mapping[str, _Kind] = {
    "uniform": _Kind(lambda ends, u: _between(ends, u[0])),
    "log_uniform": _Kind(
        lambda ends, u: math.exp(_between([math.log(end) for end in ends], u[0])), positive=True
    ),
    "reciprocal": _Kind(lambda ends, u: 1.0 / _between(ends, u[0]), positive=True),
    "categorical": _Kind(lambda values, u: values[min(int(u[0] * len(values)), len(values) - 1)]),
    "direction": _Kind(_direction, dimensions=3),
}


def drawn(
    distributions: Mapping[str, Distribution], cases: int, seed: int, design: Design
) -> list[dict[str, Any]]:
    """Values of the parameters by name, for each case.

    In a random design, each parameter has its own stream, so that neither more cases nor another
    parameter change the draws. A Sobol design with more cases keeps the earlier cases. A Latin
    hypercube depends on the number of cases.

    Args:
        distributions: Distributions by parameter.
        cases: Number of cases.
        seed: Seed of the campaign.
        design: Kind of design.
    """
    if design == "random":
        return [
            {
                name: distribution.at(Streams(seed, case)[name].random(distribution.dimensions))
                for name, distribution in distributions.items()
            }
            for case in range(cases)
        ]

    d = sum(distribution.dimensions for distribution in distributions.values())
    rng = np.random.default_rng([seed, _DRAWS])

    if not d:
        return [{} for _ in range(cases)]
    from scipy.stats import qmc  # the import takes a second

    if design == "sobol":
        if d > qmc.Sobol.MAXDIM:
            raise ConfigurationError(
                f"design: Sobol has at most {qmc.Sobol.MAXDIM} dimensions, got {d}"
            )
        points = qmc.Sobol(d, rng=rng).random_base2(max(0, math.ceil(math.log2(cases))))[:cases]
    else:
        points = qmc.LatinHypercube(d, rng=rng).random(cases)

    # A point has the coordinates of all parameters in sequence.
    ends = np.cumsum([distribution.dimensions for distribution in distributions.values()])[:-1]
    return [
        {
            name: distribution.at(u)
            for (name, distribution), u in zip(
                distributions.items(), np.split(point, ends), strict=True
            )
        }
        for point in points
    ]
