"""Thrusters of the plant: lag of the propeller, static curve, dead band, saturation, thrust lost with inflow."""

import numba
import numpy as np

from models.thrusters import WIDTH
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

SATURATED = 0.99  # of full speed: who asks for this much has nothing left; allocations stop a little short of 1


@numba.njit(cache=True)
def _advance(table, decay, B, command, R_WB, v_WB_W, w_WB_B, current_W, speed, thrust):
    """One exact step of the lag, then the thrust at the new speed; True if any command was beyond its range."""
    saturated = False
    nu_r_B = np.empty(6)
    for i in range(3):
        nu_r_B[i], nu_r_B[3 + i] = 0.0, w_WB_B[i]
        for j in range(3):
            nu_r_B[i] += R_WB[j, i] * (v_WB_W[j] - current_W[j])
    for i in range(speed.shape[0]):
        wanted = command[i]
        if abs(wanted) >= SATURATED:
            saturated = True
            wanted = min(max(wanted, -1.0), 1.0)
        speed[i] = wanted + (speed[i] - wanted) * decay[i]
        inflow = 0.0  # water speed through the propeller along the thrust: B^T nu_r is its advance speed
        for k in range(6):
            inflow += B[k, i] * nu_r_B[k]
        n, band = speed[i], table[i, 2]
        if abs(n) <= band:
            thrust[i] = 0.0
            continue
        reach = (abs(n) - band) / (1.0 - band)
        gain = table[i, 0] if n > 0.0 else table[i, 1]
        thrust[i] = np.sign(n) * gain * reach * reach - table[i, 4] * reach * inflow
    return saturated


class Thrusters:
    """State and step of all thrusters of one vehicle. Source: models.thrusters."""

    def __init__(self, table: Array, wrench: Array, timestep: float) -> None:
        """Take a thruster `table` (m, WIDTH), columns `wrench` (6, m) per newton, and the physics step [s]."""
        if table.shape[1:] != (WIDTH,) or wrench.shape != (6, len(table)):
            raise ConfigurationError(f"thrusters: table {table.shape} and wrench {wrench.shape} do not fit together")
        self._table, self._wrench = np.array(table), np.array(wrench)
        lag = self._table[:, 3]
        self._decay = np.where(lag > 0.0, np.exp(-timestep / np.where(lag > 0.0, lag, 1.0)), 0.0)
        self.speed = np.zeros(len(table))  # normalised propeller speed
        self.thrust = np.zeros(len(table))  # [N]

    def step(self, command: Array, R_WB: Array, v_WB_W: Array, w_WB_B: Array, current_W: Array) -> bool:
        """Advance by one physics step; thrust [N] in `self.thrust`.

        `command` (m,) normalised speed; attitude (3, 3) and velocities of the hull (3,) [m/s, world axes] and [rad/s,
        hull axes]; the current (3,) [m/s], world axes. Returns True if a command was at its limit (SATURATED).
        """
        return _advance(
            self._table, self._decay, self._wrench, command, R_WB, v_WB_W, w_WB_B, current_W, self.speed, self.thrust
        )
