"""Tolerance bands of behaviour figures: what another seed may give, derived from how the figures
spread over seeds.

A band is a prediction interval of Student's t for one more run, at a false-alarm rate of
FALSE_ALARMS a figure. Figures that are positive in every run spread by factors (errors, peaks,
times) and are taken as logarithms. A figure that is the same in every run is held to ROUNDING. A
truth value, such as a verdict, that is the same in every run is held on
the seeds that it was seen on: what share of other seeds it holds on, a dozen runs cannot tell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t

# of one figure of one clean run: one in some 400 runs of all cases, of 250 figures each
FALSE_ALARMS = 1e-5
LEAST_SEEDS = 8
ROUNDING = 1e-9  # relative, and absolute in the figure's unit, of what no seed changes
# of a logarithm, or relative to the mean: other BLAS kernels and platforms move figures by less
_LEAST_SPREAD = 1e-3

Figures = Mapping[str, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """Allowed range of one figure.

    The numbers that it was derived from stand beside it in the file.
    """

    low: float
    high: float
    middle: float  # mean, geometric where `factor`
    spread: float  # standard deviation over seeds, of the logarithm where `factor`
    factor: bool
    seeds: int
    truth: bool = False  # a truth value: held on those seeds alone

    @classmethod
    def of(cls, values: Sequence[float]) -> "Band":
        """Band of a figure that took `values` over as many seeds.

        Raises ValueError for fewer than LEAST_SEEDS.
        """
        truth = isinstance(values[0], bool)
        v = np.asarray(values, dtype=np.float64)
        n = len(v)
        if n < LEAST_SEEDS:
            raise ValueError(f"{n} seeds; a spread needs at least {LEAST_SEEDS}")
        if np.ptp(v) <= ROUNDING * np.abs(v).max():
            margin = ROUNDING * (1.0 + abs(v[0]))
            low = float(v[0] - margin)
            middle = float(v[0])
            high = float(v[0] + margin)
            return cls(
                low=low, high=high, middle=middle, spread=0.0, factor=False, seeds=n, truth=truth
            )
        factor = bool(v.min() > 0.0)
        x = np.log(v) if factor else v
        spread = float(x.std(ddof=1))
        least = _LEAST_SPREAD if factor else _LEAST_SPREAD * float(np.abs(v).max())
        half = float(t.ppf(1.0 - 0.5 * FALSE_ALARMS, n - 1) * np.sqrt(1.0 + 1.0 / n)) * max(
            spread, least
        )
        low = x.mean() - half
        middle = x.mean()
        high = x.mean() + half
        if factor:
            low, middle, high = np.exp([low, middle, high])
        return cls(
            low=float(low),
            high=float(high),
            middle=float(middle),
            spread=spread,
            factor=factor,
            seeds=n,
        )

    def fault(self, value: float) -> str:
        """What is wrong with `value`, in a few words; empty if it lies within."""
        if self.low <= value <= self.high:
            return ""
        side = "above" if value > self.high else "below"
        return (
            f"{value:.4g}, {side} {self.low:.4g} to {self.high:.4g} (over {self.seeds} seeds "
            f"{self.middle:.4g})"
        )


def bands_of(runs: Sequence[Figures]) -> dict[str, Band | None]:
    """Bands of all figures that every run has; None for those that no run lived to produce.

    A figure that only some runs have, and a truth value that differs, are left out: nothing of them
    could be held.
    """
    names = dict.fromkeys(name for run in runs for name in run)
    bands: dict[str, Band | None] = {}
    for name in names:
        figures = [run.get(name) for run in runs]
        known = [figure for figure in figures if figure is not None]
        if len(known) == len(figures) and not (isinstance(known[0], bool) and len(set(known)) > 1):
            bands[name] = Band.of(known)
        elif not known:
            bands[name] = None
    return bands


def faults(figures: Figures, bands: Mapping[str, Band | None], *, fresh: bool = False) -> list[str]:
    """A line for each figure that lies outside its band, is missing, or should not be there.

    `fresh`: of a seed that the bands were not derived from, on which truth values are not held.
    """
    lines = []
    for name, band in bands.items():
        if fresh and band is not None and band.truth:
            continue
        figure = figures.get(name)
        if band is None:
            fault = "" if figure is None else f"{figure:.4g}, where no run gave a figure"
        else:
            fault = "no figure" if figure is None else band.fault(figure)
        if fault:
            lines.append(f"{name}: {fault}")
    return lines


def numbers_of(metrics: Mapping[str, Any], without: Sequence[str] = ()) -> dict[str, float | None]:
    """All numbers and truth values of nested `metrics` by dotted name; sentences are left out.

    `without`: dotted beginnings of what is left out.
    """
    numbers: dict[str, float | None] = {}

    def walk(value: Any, name: str) -> None:
        if any(name == part or name.startswith(f"{part}.") for part in without):
            return
        if isinstance(value, Mapping):
            for key, inner in value.items():
                walk(inner, f"{name}.{key}" if name else str(key))
        elif isinstance(value, (list, tuple)):
            for i, inner in enumerate(value):
                walk(inner, f"{name}.{i}")
        elif value is None or isinstance(value, (bool, int, float, np.number)):
            numbers[name] = value if value is None or isinstance(value, bool) else float(value)

    walk(metrics, "")
    return numbers
