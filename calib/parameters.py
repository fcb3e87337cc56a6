"""Identifiable parameters of an arm: names, groups, units, selection by words, and priors.

The full vector of an arm with n joints holds its table (n, 5) row by row, the tool point (3) and
the compliances (n).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from uuv.models.arms.kinematics import ALPHA, BETA, ROW, THETA, A, D
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, shown

GROUPS = ("theta", "d", "a", "alpha", "beta", "tcp", "compliance")
UNITS = {
    "theta": "rad",
    "d": "m",
    "a": "m",
    "alpha": "rad",
    "beta": "rad",
    "tcp": "m",
    "compliance": "rad/(N m)",
}

# Standard deviations about the nominal arm if the caller states none, for a machined arm of about a
# metre. A UR10e as delivered has 0.5 mm and 0.2 deg (tables of [Yukhimets 2023]), a Panda 1 mm and
# 0.3 deg. The tool point is practically unknown; 1e-4 rad/(N m) is a joint of 1e4 N m/rad.
DEFAULT_PRIOR = {
    "theta": np.deg2rad(0.2),
    "d": 1e-3,
    "a": 1e-3,
    "alpha": np.deg2rad(0.2),
    "beta": np.deg2rad(0.2),
    "tcp": 0.1,
    "compliance": 1e-4,
}
# Manufacturing tolerances limit the prior that the evidence of the touches may choose: a multiple
# of the usual tolerances (0.2 deg, 1e-3 of a length), which includes the real arms examined (0.6
# deg, 1 mm). Without this limit, touches that do not belong together lead to ever wider deviations,
# with which the arm shrinks to a point.
MADE_TURN = np.deg2rad(0.6)  # [rad] limit for angles
# limit for lengths, as a share of the arm's reach, and the least limit [m]
MADE_SHARE, MADE_LENGTH = 2e-3, 1.5e-3
# bounds of a deviation, so that squares neither vanish nor overflow in sums
_NARROWEST, _WIDEST = 1e-12, 1e6
DEFAULT_FREE = ("theta", "d", "a", "alpha", "beta", "tcp")


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameters:
    """Free parameters, in the order DH row by row, tool point, betas, compliances."""

    # "theta1", "d1", "a1", "alpha1", ..., "tcp_x", ..., "beta2", ..., "c1", ...
    names: tuple[str, ...]
    groups: tuple[str, ...]  # group of each parameter, one of GROUPS
    index: np.ndarray  # (P,) index of each parameter in the full vector

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter."""
        return tuple(UNITS[group] for group in self.groups)

    def where(self, *names: str) -> np.ndarray:
        """Indices, in this selection, of those `names` that it contains."""
        return np.array([self.names.index(name) for name in names if name in self.names], dtype=int)

    def only(self, keep: Iterable[int]) -> "Parameters":
        """Subset of this selection at the indices `keep`."""
        places = list(keep)
        return Parameters(
            names=tuple(self.names[i] for i in places),
            groups=tuple(self.groups[i] for i in places),
            index=self.index[places],
        )


def all_parameters(arm: SerialArm) -> Parameters:
    """All parameters: 4 n of DH, 3 of the tool point, beta of near-parallel axes, n compliances."""
    names = []
    groups = []
    index = []

    for k in range(arm.n):
        for group, column in (("theta", THETA), ("d", D), ("a", A), ("alpha", ALPHA)):
            names.append(f"{group}{k + 1}")
            groups.append(group)
            index.append(ROW * k + column)

    for j, axis in enumerate("xyz"):
        names.append(f"tcp_{axis}")
        groups.append("tcp")
        index.append(ROW * arm.n + j)

    for k in arm.near_parallel:
        names.append(f"beta{k + 1}")
        groups.append("beta")
        index.append(ROW * k + BETA)

    for k in range(arm.n):
        names.append(f"c{k + 1}")
        groups.append("compliance")
        index.append(ROW * arm.n + 3 + k)

    return Parameters(names=tuple(names), groups=tuple(groups), index=np.array(index))


def select(arm: SerialArm, words: Iterable[str] | str) -> Parameters:
    """Select parameters by `words`: groups ("a", "alpha", "tcp", ...) or names ("a2", "tcp_z").

    Raises:
        ConfigurationError: a word names no parameter, or no parameter is left to identify.
    """
    every = all_parameters(arm)
    words_chosen = [words] if isinstance(words, str) else list(words)

    for word in words_chosen:
        if not isinstance(word, str) or (word not in GROUPS and word not in every.names):
            raise ConfigurationError(
                f"free: {shown(word)} is no parameter of this arm; must be a group "
                f"({', '.join(GROUPS)}) or a single parameter such as {every.names[0]}, "
                f"{every.names[4 * arm.n]}"
                + (
                    f", beta{arm.near_parallel[0] + 1}"
                    if arm.near_parallel
                    else " (no beta: no near-parallel axes)"
                )
            )

    chosen = [
        i
        for i, (name, group) in enumerate(zip(every.names, every.groups, strict=True))
        if {name, group} & {*words_chosen}
    ]
    if not chosen:
        raise ConfigurationError(f"free: no parameter is left to identify, got {words_chosen}")
    return every.only(chosen)


def prior_deviations(parameters: Parameters, prior: Mapping[str, float] | None) -> Array:
    """Prior standard deviation (P,) of each parameter about its nominal value, in its unit.

    Args:
        parameters: P free parameters.
        prior: deviations by group or single name. A name takes precedence over its group;
            parameters that are not named keep `DEFAULT_PRIOR`.

    Returns:
        Standard deviations in rad, m, rad/(N m).

    Raises:
        ConfigurationError: a word is unknown, or a deviation is not positive and finite.
    """
    stated = dict(prior or {})
    for word, value in stated.items():
        if word not in GROUPS and word not in parameters.names:
            raise ConfigurationError(
                f"prior: {shown(word)} is not a free parameter; must be one of "
                f"{', '.join((*GROUPS, *parameters.names))}"
            )
        stated[word] = finite_number(
            value, f"prior: the deviation of {word}", above=0.0, most=_WIDEST
        )
        if stated[word] < _NARROWEST:
            raise ConfigurationError(
                f"prior: the deviation of {word} must be >= {_NARROWEST:g}, got {value}"
            )

    return np.array(
        [
            stated.get(name, stated.get(group, DEFAULT_PRIOR[group]))
            for name, group in zip(parameters.names, parameters.groups, strict=True)
        ]
    )


def widest_prior(parameters: Parameters, reach: float) -> Array:
    """Upper bounds (P,) of an estimated prior's deviations: tolerances of manufactured arms.

    Args:
        parameters: P free parameters.
        reach: [m] of the nominal arm.

    Returns:
        Standard deviations in rad and m; infinite for the tool point and compliances, which have no
            manufacturing tolerance.
    """
    bounds = {"rad": MADE_TURN, "m": max(MADE_SHARE * reach, MADE_LENGTH)}
    free = {"tcp", "compliance"}
    return np.array(
        [np.inf if group in free else bounds[UNITS[group]] for group in parameters.groups]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """The free parameters as identified; arrays are ordered as `names`."""

    parameters: Parameters
    values: Array  # (P,) identified
    changes: Array  # (P,) against nominal
    # (P, P) of the errors, in the units of `parameters`: of the noise, and of a true arm within
    # manufacturing tolerances where the touches do not determine it
    covariance: Array
    posterior: Array  # (P, P) posterior covariance under `prior`
    prior: Array  # (P,) standard deviations of the prior in use, stated or chosen by the data

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters: theta1, d1, a1, alpha1, ..., tcp_x, ..., beta2, ..., c1,
        ...
        """
        return self.parameters.names

    @property
    def sigma(self) -> Array:
        """Standard deviation (P,) of the error of each parameter, in its unit."""
        return np.sqrt(np.diag(self.covariance))
