"""Ahead of the thrusters' lag: commands whose thrust comes sooner, and what the thrusters are giving meanwhile.

A propeller follows its command with a first-order lag T (`models.water.thrusters`). The speed n that it has by now is
known from the commands so far, so the command u that brings it towards the wanted speed c as a lag of T_r < T would is

    u = n + (c - n) (1 - exp(-dt / T_r)) / (1 - exp(-dt / T)),    within full speed:

the inverse of the lag, filtered by `response` T_r. In the steady state u = c whatever T is. What T_r gains is paid in
motion of the command: its noise grows by about T / T_r.
"""

from dataclasses import dataclass

import numba
import numpy as np

from models.vehicle import Vehicle
from models.water.thruster_curves import reach_at, thrust_at
from models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, TORQUE, curves
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.kernels import keyed_by_imports
from sim.interfaces.spatial import Array, fitting, number

RESPONSE = 0.05  # [s]
_PARTS = 4  # of a period over which the thrust is averaged


@dataclass(slots=True, eq=False)
class ThrusterLeadState:
    """What is believed of the propellers."""

    passed: Array  # (m,) command that the drives pass on, after their slew limit
    speed: Array  # (m,) normalised
    given_B: Array  # (6,) [N, N m] mean wrench on the hull from the last step to the next, hull axes


class ThrusterLead:
    """Model of the thrusters of one vehicle, run beside them and turned round."""

    def __init__(self, vehicle: Vehicle, *, response: float = RESPONSE, lag_error: float = 0.0) -> None:
        """Take the thrusters of `vehicle`; a `response` [s] at or above a thruster's own lag leaves its command alone.

        `lag_error` makes the lag that is believed wrong by that share. Raises ConfigurationError for a response that is
        not > 0, or an error that leaves no lag.
        """
        if not 0.0 < number(response, "response of the thrusters [s]") < np.inf:
            raise ConfigurationError(f"response of the thrusters: must be finite and > 0 s, got {response}")
        if not -1.0 < number(lag_error, "lag_error") < np.inf:
            raise ConfigurationError(f"lag_error: must be finite and above -1, got {lag_error}")
        table = vehicle.thruster_table
        self._curves, self._B = curves(table), np.array(vehicle.thruster_wrench)
        self._advance = self._B.copy()  # where the water goes: the propeller's own torque is no lever of the thrust
        self._advance[3:] -= table[:, TORQUE] * self._B[:3]
        self._figures = np.column_stack(
            [(1.0 + lag_error) * table[:, TIME_CONSTANT], table[:, SLEW_RATE], table[:, INFLOW_LOSS]]
        )
        self._response = float(response)

    def init(self) -> ThrusterLeadState:
        """All at rest."""
        m = len(self._figures)
        return ThrusterLeadState(np.zeros(m), np.zeros(m), np.zeros(6))

    def step(self, state: ThrusterLeadState, wanted: Array, nu_r_B: Array, dt: float) -> Array:
        """Commands (m,) for the next `dt` [s], where the static ones would be `wanted` (m,).

        `nu_r_B` (6,) is the hull's motion through the water [m/s, rad/s], whose inflow costs thrust; the wrench that
        the thrusters will give in the mean is left in `state.given_B`. Raises ConfigurationError for other shapes or
        numbers that are not finite.
        """
        wanted = fitting(wanted, state.speed.shape, "thruster commands wanted")
        nu_r_B = fitting(nu_r_B, (6,), "motion through the water")
        command = np.empty_like(wanted)
        _lead(
            self._curves,
            self._figures,
            self._B,
            self._advance,
            self._response,
            wanted,
            nu_r_B,
            dt,
            state.passed,
            state.speed,
            state.given_B,
            command,
        )
        return command


@numba.njit(cache=True)
@keyed_by_imports
def _lead(curve, figures, B, advance, response, wanted, nu_r_B, dt, passed, speed, given_B, command):
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
