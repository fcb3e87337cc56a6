"""Hydrodynamics from the parameters of gz-sim's plugin, with their names in a model's SDF."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.water.forms import CrossTerms, gz_term
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import finite_number, shown

_FORCES = "xyzkmn"
_SPEEDS = "UVWPQR"
_NAMES = [f"{i}{j}" for i in _FORCES for j in _SPEEDS]
_KNOWN = (
    *(f"{i}Dot{j}" for i in _FORCES for j in _SPEEDS),
    *_NAMES,
    *(f"{name}{between}{k}" for name in _NAMES for between in ("", "abs") for k in _SPEEDS),
)


def is_known(name: str) -> bool:
    """True if the plugin has a parameter of that name."""
    return name in _KNOWN


def body_hydrodynamics(
    parameters: Mapping[str, float],
    *,
    volume: float,
    center_of_buoyancy: ArrayLike = (0.0, 0.0, 0.0),
) -> BodyHydrodynamics:
    """Coefficients of a link from the parameters of gz-sim's plugin Hydrodynamics, version 7 or
    later.

    xDotU are added masses, xU linear, xUabsV and xUV quadratic terms, all with the signs of
    stability derivatives: damping is negative. Products of two components that no diagonal
    quadratic damping holds become `CrossTerms`. Point and axes are the same in both: the plugin
    acts at the link's origin, in the link's axes. The plugin has only those velocity terms of the
    added mass that belong to its diagonal; here all of them act.

    Args:
        parameters: values by name; missing ones are zero.
        volume: [m^3] of displaced water, which gz-sim takes from its plugin Buoyancy.
        center_of_buoyancy: (3,) [m].

    Returns:
        The coefficients.

    Raises:
        ConfigurationError: a name is unknown, or `BodyHydrodynamics` refuses a number, such as a
            linear damping that adds energy.
    """
    added = np.zeros((6, 6))
    linear = np.zeros((6, 6))
    quadratic = np.zeros(6)
    others: dict[str, float] = {}
    for name, coefficient in parameters.items():
        if name not in _KNOWN:
            raise ConfigurationError(
                "gz-sim Hydrodynamics: unknown parameter "
                f"{shown(name)}{did_you_mean(name, _KNOWN)}; it has xDotU, xU, "
                "xUU, xUabsU and the like"
            )
        coefficient = finite_number(coefficient, f"gz-sim Hydrodynamics {name}")

        # Stability derivatives: a damping term is negative in the plugin, and positive here.
        term = gz_term(name)
        if term is None:  # xDotU
            added[_FORCES.index(name[0]), _SPEEDS.index(name[-1])] = -coefficient
            continue
        i, j, k, absolute = term
        if k < 0:
            linear[i, j] = -coefficient
        elif i == j == k and absolute and coefficient <= 0.0:
            quadratic[i] = -coefficient
        elif coefficient != 0.0:
            others[name] = coefficient

    return BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=np.asarray(center_of_buoyancy, dtype=np.float64),
        added_mass=added,
        linear_damping=linear,
        quadratic_damping=quadratic,
        forms=CrossTerms.of_gz(others) if others else (),
    )
