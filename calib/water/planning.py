"""Next manoeuvre to fly: the information that each would add, and the intervals after it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uuv.calib.water.named_fit import NamedParameter, Slopes
from uuv.calib.water.parameters import GROUPS, group_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planned:
    """A manoeuvre and what is expected of it."""

    name: str
    before: Array  # (n,) standard deviations in those of the priors
    after: Array  # (n,) after the manoeuvre
    aim: np.ndarray  # (n,) bool: parameters that it was judged by

    @property
    def left(self) -> float:
        """Share of the prior variance that is left, mean over the aim."""
        return float(np.mean(self.after[self.aim] ** 2))

    def sharper(self, group: np.ndarray | None = None) -> float:
        """Factor by which intervals shrink, geometric mean over a group (n,); None: the aim."""
        mask = self.aim if group is None else group
        return float(np.exp(np.mean(np.log(self.before[mask] / self.after[mask]))))


def information(slopes: Sequence[Slopes], count: int) -> Array:
    """Information (count, count) on the first parameters, all other numbers eliminated.

    Both have unit priors; of the first parameters the prior is not counted.
    """
    n = slopes[0].shared.shape[1]
    H = np.zeros((n, n))

    # Own numbers of each block, eliminated with unit priors.
    for _, J, L in slopes:
        B = L.T @ J
        H += J.T @ J - B.T @ np.linalg.solve(L.T @ L + np.eye(L.shape[1]), B)

    # All other parameters, likewise.
    rest = H[count:, count:] + np.eye(n - count)
    return H[:count, :count] - H[:count, count:] @ np.linalg.solve(rest, H[count:, :count])


def planned(
    known: Array,
    candidates: Mapping[str, Array],
    parameters: Sequence[NamedParameter],
    aim: Sequence[str] = (),
) -> list[Planned]:
    """Manoeuvres in order, the one first that leaves least of the prior variance.

    Args:
        known: Covariance (n, n) now, in prior standard deviations; the unit matrix before any log.
        candidates: Information (n, n) that each would add, by name.
        parameters: Those of the vehicle.
        aim: Groups of parameters to judge by, of GROUPS; none: all.

    Raises:
        ConfigurationError: There is no such group.
    """
    for group in aim:
        if group not in GROUPS:
            raise ConfigurationError(f"--aim {shown(group)}: allowed {', '.join(GROUPS)}")
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
