"""Choice of the next manoeuvre, from the information that each would add and the resulting
intervals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uuv.calib.water.named_fit import NamedParameter, Slopes
from uuv.calib.water.parameters import GROUPS, group_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planned:
    """A manoeuvre with its expected result."""

    name: str
    before: Array  # (n,) standard deviations before the manoeuvre, in those of the priors
    after: Array  # (n,) standard deviations after the manoeuvre
    aim: np.ndarray  # (n,) bool: parameters by which it was ranked

    @property
    def left(self) -> float:
        """Remaining share of the prior variance, as the mean over the aim."""
        return float(np.mean(self.after[self.aim] ** 2))

    def sharper(self, group: np.ndarray | None = None) -> float:
        """Factor by which intervals shrink, as the geometric mean over a group (n,); None: over the
        aim.
        """
        mask = self.aim if group is None else group
        return float(np.exp(np.mean(np.log(self.before[mask] / self.after[mask]))))


def information(slopes: Sequence[Slopes], count: int) -> Array:
    """Information (count, count) about the first parameters, with all other numbers eliminated.

    All have unit priors; the prior of the first parameters is not included in the result.
    """
    n = slopes[0].shared.shape[1]
    H = np.zeros((n, n))

    # Local parameters of each block, eliminated with unit priors.
    for _, J, L in slopes:
        B = L.T @ J
        H += J.T @ J - B.T @ np.linalg.solve(L.T @ L + np.eye(L.shape[1]), B)

    # All other parameters, in the same way.
    rest = H[count:, count:] + np.eye(n - count)
    return H[:count, :count] - H[:count, count:] @ np.linalg.solve(rest, H[count:, :count])


def planned(
    known: Array,
    candidates: Mapping[str, Array],
    parameters: Sequence[NamedParameter],
    aim: Sequence[str] = (),
) -> list[Planned]:
    """Manoeuvres in order, first the one that leaves the smallest share of the prior variance.

    Args:
        known: Present covariance (n, n), in prior standard deviations; the unit matrix before any
            log.
        candidates: Information (n, n) that each would add, by name.
        parameters: Parameters of the vehicle.
        aim: Groups of parameters, of GROUPS, by which manoeuvres are ranked; empty: all.

    Raises:
        ConfigurationError: There is no such group.
    """
    for group in aim:
        if group not in GROUPS:
            raise ConfigurationError(f"--aim {shown(group)}: must be one of {', '.join(GROUPS)}")
    mask = np.array([not aim or group_of(parameter.name) in aim for parameter in parameters])
    if not mask.any():
        raise ConfigurationError(f"--aim {', '.join(aim)}: this vehicle has no such parameters")

    before = np.sqrt(np.diag(known))
    inverse = np.linalg.inv(known)
    plans = [
        Planned(
            name=name,
            before=before,
            after=np.sqrt(np.diag(np.linalg.inv(inverse + added))),
            aim=mask,
        )
        for name, added in candidates.items()
    ]

    return sorted(plans, key=lambda plan: plan.left)
