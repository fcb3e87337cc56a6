"""Hydrodynamics from the parameters of gz-sim's plugin, by their names in a model's SDF."""

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
    """True for a parameter of the plugin."""
    return name in _KNOWN


def body_hydrodynamics(
    parameters: Mapping[str, float],
    *,
    volume: float,
    center_of_buoyancy: ArrayLike = (0.0, 0.0, 0.0),
) -> BodyHydrodynamics:
    """Coefficients of a link by the parameters of gz-sim's plugin Hydrodynamics, from version 7 on.

    xDotU are added masses, xU linear, xUabsV and xUV quadratic terms, all with the signs of
    stability derivatives: damping is negative. Products of two components that no diagonal
    quadratic damping holds become `CrossTerms`. The plugin acts at the link's origin, as here, and
    its axes are ours. Of the added mass's velocity terms it has those of the diagonal alone, here
    all act.

    Args:
        parameters: values by name; missing ones are zero.
        volume: [m^3] of displaced water, which gz-sim takes from its plugin Buoyancy.
        center_of_buoyancy: (3,) [m].

    Returns:
        The coefficients.

    Raises:
        ConfigurationError: an unknown name, or numbers that `BodyHydrodynamics` refuses, such as a
            linear damping that feeds energy in.
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

        # Stability derivatives: what damps is negative there, and positive here.
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
