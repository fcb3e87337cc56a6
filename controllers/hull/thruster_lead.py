"""Lead compensation of the thrusters' lag, by a model of the thrusters that is run in parallel and
inverted.

A propeller follows its command with a first-order lag T (`uuv.models.water.thrusters`). Its present
speed n is predicted from past commands. The command u that moves it towards the desired speed c
with a lag T_r < T is

    u = n + (c - n) (1 - exp(-dt / T_r)) / (1 - exp(-dt / T)),    within full speed.

This is the inverse of the lag, filtered with the time constant `response` = T_r. In the steady
state u = c for any T. A smaller T_r increases command activity: noise is amplified by about T /
T_r.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.tuning import HULL
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import command_in_flow, thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves, inflow_levers
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, fitting, number

_PARTS = 4  # number of instants in a period over which the thrust is averaged


class ThrusterLeadState(NamedTuple):
    """Predicted state of the propellers, as arrays that are changed in place."""

    passed: Array  # (m,) [-] normalised command after the slew limit of the drives
    speed: Array  # (m,) [-] normalised speed
    # (6,) [N, N m] mean wrench on the hull from the last step to the next, hull axes
    given_B: Array


class Propellers(NamedTuple):
    """Model of the thrusters, in the form of the kernel."""

    curves: Array  # static curves of thrust over speed
    figures: Array  # (m, 3) lag [s], slew rate [1/s], loss by inflow
    B: Array  # (6, m) wrench of unit thrusts
    advance: Array  # (6, m) levers of the inflow: `B` without the propellers' reaction torques
    response: float  # [s] lag with compensation


class ThrusterLead:
    """Thruster model of one vehicle, run in parallel and inverted."""

    def __init__(
        self, vehicle: Vehicle, *, response: float = HULL.response, lag_error: float = 0.0
    ) -> None:
        """Set up the model for the thrusters of `vehicle`.

        Args:
            vehicle: the vehicle, with a table of its thrusters.
            response: [s] lag with compensation. If it is not below a thruster's own lag, the
                command of that thruster is unchanged.
            lag_error: [-] share by which the modelled lag is deliberately wrong.

        Raises:
            ConfigurationError: `response` is not finite or not > 0, or `lag_error` leaves no lag.
        """
        if not 0.0 < number(response, "response of the thrusters [s]") < np.inf:
            raise ConfigurationError(
                f"response of the thrusters: must be finite and > 0 s, got {response}"
            )
        if not -1.0 < number(lag_error, "lag_error") < np.inf:
            raise ConfigurationError(f"lag_error: must be finite and above -1, got {lag_error}")

        table = vehicle.thruster_table
        B = np.array(vehicle.thruster_wrench)
        figures = np.column_stack(
            [
                (1.0 + lag_error) * table[:, TIME_CONSTANT],
                table[:, SLEW_RATE],
                table[:, INFLOW_LOSS],
            ]
        )

        self._propellers = Propellers(
            curves(table), figures, B, inflow_levers(table, B), float(response)
        )
        self._thrusters = len(figures)

    @property
    def propellers(self) -> Propellers:
        """The model in the form of the kernels."""
        return self._propellers

    def init(self) -> ThrusterLeadState:
        """Initial state: all propellers at rest."""
        m = self._thrusters
        return ThrusterLeadState(np.zeros(m), np.zeros(m), np.zeros(6))

    def step(self, state: ThrusterLeadState, wanted: Array, nu_r_B: Array, dt: float) -> Array:
        """Commands (m,) for the next `dt` that replace the static ones `wanted`.

        The predicted mean wrench of the thrusters over `dt` is stored in `state.given_B`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            wanted: (m,) [-] static commands, normalised.
            nu_r_B: (6,) [m/s, rad/s] velocity of the hull relative to the water, hull axes; its
                inflow reduces thrust.
            dt: [s] duration of the commands.

        Returns:
            Normalised commands (m,) [-] in [-1, 1].

        Raises:
            ConfigurationError: an input has another shape, or a number is not finite.
        """
        wanted = fitting(wanted, state.speed.shape, "thruster commands wanted")
        nu_r_B = fitting(nu_r_B, (6,), "motion through the water")
        command = np.empty_like(wanted)
        lead_commands(self.propellers, state, wanted, nu_r_B, float(dt), command)
        return command


@kernel
def _inflow(advance, i, nu_r_B):
    """Speed of advance [m/s] of thruster `i` through the water, along its thrust."""
    total = 0.0
    for k in range(6):
        total += advance[k, i] * nu_r_B[k]
    return total


@kernel
def static_commands(model, thrust, nu_r_B):
    """Static commands (m,) [-] that give thrusts in the inflow of the moving hull.

    Args:
        model: `Propellers`.
        thrust: (m,) [N] wanted.
        nu_r_B: (6,) [m/s, rad/s] velocity of the hull relative to the water, hull axes.

    Returns:
        The commands, in [-1, 1]; the nearest command if a thrust is out of reach.
    """
    command = np.empty(thrust.shape[0])
    for i in range(thrust.shape[0]):
        inflow = _inflow(model.advance, i, nu_r_B)
        command[i] = command_in_flow(model.curves[i], model.figures[i, 2], inflow, thrust[i])
    return command


@kernel
def lead_commands(model, state, wanted, nu_r_B, dt, command):
    """Commands (m,) for the next `dt`, see `ThrusterLead.step`; `model` is a `Propellers`."""
    curve = model.curves
    B = model.B
    advance = model.advance
    response = model.response
    passed = state.passed
    speed = state.speed
    given_B = state.given_B

    given_B[:] = 0.0
    for i in range(wanted.shape[0]):
        lag, slew, loss = model.figures[i]

        # Lead.
        u = wanted[i]
        if lag > response:
            u = speed[i] + (u - speed[i]) * np.expm1(-dt / response) / np.expm1(-dt / lag)
        command[i] = min(max(u, -1.0), 1.0)

        # Speed of the propeller, and its mean thrust until the next step.
        most = slew * dt if slew > 0.0 else np.inf
        passed[i] += min(max(command[i] - passed[i], -most), most)

        inflow = _inflow(advance, i, nu_r_B)
        mean = 0.0
        for part in range(_PARTS):
            n = passed[i]
            if lag > 0.0:
                n += (speed[i] - n) * np.exp(-(part + 0.5) / _PARTS * dt / lag)
            mean += thrust_in_flow(curve[i], loss, inflow, n) / _PARTS
        speed[i] = (
            passed[i] + (speed[i] - passed[i]) * np.exp(-dt / lag) if lag > 0.0 else passed[i]
        )

        for k in range(6):
            given_B[k] += B[k, i] * mean
