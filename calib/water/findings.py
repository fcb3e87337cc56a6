"""Observability of the parameters of a fit: identified, partly identified, not identifiable, or
only in combination.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuv.calib.water.named_fit import NamedFit
from uuv.calib.water.parameters import AXES, group_of
from uuv.sim.interfaces.spatial import Array

TOLD, PARTLY = 0.9, 0.3  # limits of the verdicts, as shares of the prior variance
TOGETHER = 0.95  # correlation beyond which parameters are identifiable only together
_HELP = {  # for each group: the experiment that would help
    "added mass": "faster reversals there",
    "linear damping": "slow runs there, or a release that dies away",
    "quadratic damping": "fast runs there",
    "trim": "a drift with the thrusters off, in water at rest",
    "thrusters": "commands beyond the dead band",
    "arm": "fast swings of the arm",
}
_SCALE = "a tow with a spring balance, or a known weight hung on the hull, would separate them"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One parameter after a fit."""

    name: str
    unit: str
    group: str
    nominal: float
    value: float
    low: float  # half of the 95 % interval
    high: float
    told: float  # share of the prior variance that the logs removed

    @property
    def verdict(self) -> str:
        """Identified, partly identified or not identifiable."""
        if self.told >= TOLD:
            return "identified"
        return "partly identified" if self.told >= PARTLY else "not identifiable"

    @property
    def helps(self) -> str:
        """Experiment that would identify the parameter; empty if it is identified."""
        return "" if self.verdict == "identified" else _HELP.get(self.group, "")


def findings(fit: NamedFit, count: int, quantile: float) -> list[Finding]:
    """The vehicle's parameters, the first `count` of a fit; intervals of `quantile` deviations."""
    rows = []
    for i, parameter in enumerate(fit.parameters[:count]):
        low, high = fit.interval(i, quantile)
        rows.append(
            Finding(
                name=parameter.name,
                unit=parameter.unit,
                group=group_of(parameter.name),
                nominal=parameter.nominal,
                value=parameter.value(float(fit.deviations[i])),
                low=low,
                high=high,
                told=float(np.clip(fit.told[i], 0.0, 1.0)),
            )
        )

    return rows


def together(fit: NamedFit, count: int) -> list[str]:
    """Sentences about parameters with correlated errors, of which only a sum or a ratio is
    identifiable.
    """
    sigma = np.sqrt(np.diag(fit.covariance))
    correlation = fit.covariance / np.outer(sigma, sigma)
    sentences = []

    for group in _linked(np.abs(correlation) > TOGETHER):
        if len(group) > 1 and group[0] < count:
            sentences.append(
                _sentence(
                    [fit.parameters[i].name for i in group], correlation[np.ix_(group, group)]
                )
            )

    return sentences


def _linked(near: np.ndarray) -> list[list[int]]:
    """Groups of indices that are linked by pairs."""
    left = list(range(len(near)))
    groups = []
    while left:
        group = [left[0]]
        edge = [left[0]]
        while edge:
            here = edge.pop()
            new = [j for j in left if near[here, j] and j not in group]
            group += new
            edge += new

        left = [j for j in left if j not in group]
        groups.append(sorted(group))

    return groups


def _sentence(names: Sequence[str], correlation: Array) -> str:
    kinds = {group_of(name) for name in names}
    least = float(np.abs(correlation)[np.triu_indices(len(names), 1)].min())
    axes = {axis for axis in AXES for name in names if name.endswith(axis)}

    # Combinations that remain undetermined, and the experiment that resolves them.
    if "thrusters" in kinds and kinds & {"added mass", "quadratic damping", "linear damping"}:
        what = "only their ratios are identifiable"
        how = _SCALE
    elif kinds == {"thrusters"}:
        what = "their common factor is not identifiable"
        how = _SCALE
    elif kinds == {"linear damping", "quadratic damping"} and len(axes) == 1:
        what = "only the drag at the flown speeds is identifiable"
        how = "the same axis at two speeds would separate them"
    elif "nuisance" in kinds and "trim" in kinds:
        what = "only their sum is identifiable"
        mount = any("mount" in name for name in names)
        how = "a level mark for the attitude sensor" if mount else "water at rest"
        how += " would separate them"
    else:
        what = "only a combination is identifiable"
        how = "another axis or another speed would separate them"

    shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    return f"{shown}: {what} (correlation {least:.2f} and more); {how}"
