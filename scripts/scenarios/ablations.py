"""Ablations: the words of `--without` as the objects that a controller takes in place of its own."""

from collections.abc import Set
from typing import Any, Literal

import mujoco

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.arm.position_force import NominalStiffness
from controllers.hull.feedforward import Term, WithoutCompensation, WithoutTerms
from controllers.tool_control import FromReference
from controllers.tuning import ArmTuning
from controllers.work_controller import PERIOD
from models.vehicle import Vehicle

Method = Literal[
    "compensation", "hydrodynamic-term", "dynamic-term", "contact-term", "drift-correction", "force-control"
]
_TERMS: dict[str, Term] = {"hydrodynamic-term": "hydrodynamic", "dynamic-term": "dynamic", "contact-term": "contact"}


def ablated(without: Set[str], own: mujoco.MjModel, water_error: float) -> dict[str, Any]:
    """Keyword arguments of `WorkController` that leave methods out; none where nothing is left out.

    Args:
        without: methods to leave out, each one of `Method`.
        own: the vehicle's model of itself.
        water_error: [-] share by which its hydrodynamic coefficients are wrong.

    Returns:
        `force_law`, `drift` and `feedforward`, as far as they differ from the controller's own.
    """
    parts: dict[str, Any] = {}
    if "force-control" in without:
        parts["force_law"] = NominalStiffness()
    if "drift-correction" in without:
        parts["drift"] = FromReference()
    terms: set[Term] = {term for word, term in _TERMS.items() if word in without}
    if terms or "compensation" in without:
        arm = ArmDynamics(own, water_error=water_error)
        if "compensation" in without:
            parts["feedforward"] = WithoutCompensation(arm, Vehicle.of(own).q_home)
        else:
            lag = ArmTuning().acceleration_filter
            parts["feedforward"] = WithoutTerms(arm, terms, acceleration_filter=lag, period=PERIOD)
    return parts
