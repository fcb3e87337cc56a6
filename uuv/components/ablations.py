"""Ablations: replacements in the controller for a method that is left out (`--without`)."""

from collections.abc import Set
from typing import Any, get_args

import mujoco

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.position_force import NominalStiffness
from uuv.controllers.hull.feedforward import Term, WithoutCompensation, WithoutTerms
from uuv.controllers.tuning import DRIVE_PERIOD, ArmTuning
from uuv.controllers.whole_body.tool_control import FromReference
from uuv.models.vehicle import Vehicle

# keyword argument, by the method that it leaves out
_TERMS: dict[str, Term] = {f"{term}-term": term for term in get_args(Term)}


def ablated(without: Set[str], model: mujoco.MjModel, water_error: float) -> dict[str, Any]:
    """Keyword arguments of `WorkController` that leave methods out; empty if nothing is left out.

    Args:
        without: Methods to leave out, each one of `uuv.methods.Method`.
        model: The vehicle's model of itself.
        water_error: [-] Share by which its hydrodynamic coefficients are wrong.

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
        arm = ArmDynamics(model, water_error=water_error)
        if "compensation" in without:
            parts["feedforward"] = WithoutCompensation(arm, Vehicle.of(model).q_home)
        else:
            lag = ArmTuning().acceleration_filter
            parts["feedforward"] = WithoutTerms(
                arm, terms, acceleration_filter=lag, period=DRIVE_PERIOD
            )
    return parts
