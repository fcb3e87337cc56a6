"""Lead compensation of the thrusters' lag, and a prediction of the thrust that they give meanwhile.

A propeller follows its command with a first-order lag T (`models.water.thrusters`). Its present speed n is predicted
from past commands. The command u that brings it towards the wanted speed c with a lag T_r < T is

    u = n + (c - n) (1 - exp(-dt / T_r)) / (1 - exp(-dt / T)),    within full speed.

This is the inverse of the lag, filtered by `response` T_r. In the steady state u = c, whatever T is. The price of a
smaller T_r is command activity: noise is amplified by about T / T_r.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from controllers.tuning import HULL
from models.vehicle import Vehicle
from models.water.thruster_curves import reach_at, thrust_at
from models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, TORQUE, curves
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.kernels import keyed_by_imports
from sim.interfaces.spatial import Array, fitting, number

_PARTS = 4  # number of instants in a period over which the thrust is averaged


@dataclass(slots=True, eq=False)
class ThrusterLeadState:
    """Believed state of the propellers."""

    passed: Array  # (m,) [-] normalised command after the slew limit of the drives
    speed: Array  # (m,) [-] normalised speed
    given_B: Array  # (6,) [N, N m] mean wrench on the hull from the last step to the next, hull axes


class _Propellers(NamedTuple):
    """Model of the thrusters, as the kernel takes it."""

    curves: Array  # of thrust over speed
    figures: Array  # (m, 3) lag [s], slew rate [1/s], loss by inflow
    B: Array  # (6, m) wrench of unit thrusts
    advance: Array  # (6, m) levers of the inflow: `B` without the propellers' reaction torques
    response: float  # [s] lag with compensation


class ThrusterLead:
    """Thruster model of one vehicle, run in parallel and inverted."""

    def __init__(self, vehicle: Vehicle, *, response: float = HULL.response, lag_error: float = 0.0) -> None:
        """Set up the model for the thrusters of `vehicle`.

        Args:
            vehicle: the vehicle, with a table of its thrusters.
            response: [s] lag with compensation. At or above a thruster's own lag its command stays unchanged.
            lag_error: [-] share by which the believed lag is deliberately wrong.

        Raises:
            ConfigurationError: `response` is not finite or not > 0, or `lag_error` leaves no lag.
        """
        if not 0.0 < number(response, "response of the thrusters [s]") < np.inf:
            raise ConfigurationError(f"response of the thrusters: must be finite and > 0 s, got {response}")
        if not -1.0 < number(lag_error, "lag_error") < np.inf:
            raise ConfigurationError(f"lag_error: must be finite and above -1, got {lag_error}")
        table = vehicle.thruster_table
        B = np.array(vehicle.thruster_wrench)
        advance = B.copy()
        advance[3:] -= table[:, TORQUE] * B[:3]
        figures = np.column_stack(
            [(1.0 + lag_error) * table[:, TIME_CONSTANT], table[:, SLEW_RATE], table[:, INFLOW_LOSS]]
        )
        self._model = tuple(_Propellers(curves(table), figures, B, advance, float(response)))
        self._thrusters = len(figures)

    def init(self) -> ThrusterLeadState:
        """Initial state: all propellers at rest."""
        m = self._thrusters
        return ThrusterLeadState(np.zeros(m), np.zeros(m), np.zeros(6))

    def step(self, state: ThrusterLeadState, wanted: Array, nu_r_B: Array, dt: float) -> Array:
        """Commands (m,) for the next `dt` that replace the static ones `wanted`.

        The predicted mean wrench of the thrusters over `dt` is left in `state.given_B`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            wanted: (m,) [-] static commands, normalised.
            nu_r_B: (6,) [m/s, rad/s] velocity of the hull relative to the water, hull axes; its inflow reduces thrust.
            dt: [s] duration of the commands.

        Returns:
            Normalised commands (m,) [-] in [-1, 1].

        Raises:
            ConfigurationError: another shape, or a number that is not finite.
        """
        wanted = fitting(wanted, state.speed.shape, "thruster commands wanted")
        nu_r_B = fitting(nu_r_B, (6,), "motion through the water")
        command = np.empty_like(wanted)
        _lead(self._model, wanted, nu_r_B, dt, (state.passed, state.speed, state.given_B), command)
        return command


@numba.njit(cache=True)
@keyed_by_imports
def _lead(model, wanted, nu_r_B, dt, state, command):
    """Commands for the next `dt`; `model` is `_Propellers`, `state` is passed, speed and given_B of the state."""
    curve, figures, B, advance, response = model
    passed, speed, given_B = state
    given_B[:] = 0.0
    for i in range(wanted.shape[0]):
        lag, slew, loss = figures[i]
        u = wanted[i]
        if lag > response:
            u = speed[i] + (u - speed[i]) * np.expm1(-dt / response) / np.expm1(-dt / lag)
        command[i] = min(max(u, -1.0), 1.0)
        most = slew * dt if slew > 0.0 else np.inf
        passed[i] += min(max(command[i] - passed[i], -most), most)
        inflow = 0.0
        for k in range(6):
            inflow += advance[k, i] * nu_r_B[k]
        mean = 0.0
        for part in range(_PARTS):
            n = passed[i]
            if lag > 0.0:
                n += (speed[i] - n) * np.exp(-(part + 0.5) / _PARTS * dt / lag)
            thrust = thrust_at(curve[i], n)
            if thrust != 0.0:
                thrust -= loss * reach_at(curve[i], n) * inflow
            mean += thrust / _PARTS
        speed[i] = passed[i] + (speed[i] - passed[i]) * np.exp(-dt / lag) if lag > 0.0 else passed[i]
        for k in range(6):
            given_B[k] += B[k, i] * mean
