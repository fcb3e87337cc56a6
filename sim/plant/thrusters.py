"""Thruster model of the plant: slew rate and lag of the propeller, static curve, saturation, inflow loss."""

import numpy as np

from uuv.models.water.thruster_curves import thrust_at, thrust_in_flow
from uuv.models.water.thrusters import HEADER, INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves, inflow_levers
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, fitting

SATURATED = 0.979  # share of full thrust that counts as saturated; thrust allocation stops slightly below 1


@kernel
def advance_thrusters(curve, table, command, R_WB, v_WB_W, w_WB_B, current_W, state):
    """Advance the lag by one exact step and compute thrust; True if any command was at its limit.

    Rows of `table` (9, m): decay of the lag, slew in a step, inflow loss, lever of the advance speed (6). Rows of
    `state` (3, m): command after the slew limit, propeller speed, thrust [N].
    """
    decay, slew, inflow_loss, advance = table[0], table[1], table[2], table[3:]
    passed, speed, thrust = state[0], state[1], state[2]
    saturated = False
    nu_r_B = np.empty(6)
    for i in range(3):
        nu_r_B[i], nu_r_B[3 + i] = 0.0, w_WB_B[i]
        for j in range(3):
            nu_r_B[i] += R_WB[j, i] * (v_WB_W[j] - current_W[j])
    for i in range(speed.shape[0]):
        wanted = command[i]
        if abs(wanted) > 0.9:
            wanted = min(max(wanted, -1.0), 1.0)
            end = 1.0 if wanted > 0.0 else -1.0
            saturated |= thrust_at(curve[i], wanted) / thrust_at(curve[i], end) >= SATURATED
        if abs(wanted - passed[i]) > slew[i]:
            wanted = passed[i] + np.sign(wanted - passed[i]) * slew[i]
        passed[i] = wanted
        speed[i] = wanted + (speed[i] - wanted) * decay[i]
        inflow = 0.0  # [m/s] advance speed: water through the propeller along the thrust
        for k in range(6):
            inflow += advance[k, i] * nu_r_B[k]
        thrust[i] = thrust_in_flow(curve[i], inflow_loss[i], inflow, speed[i])
    return saturated


class Thrusters:
    """State and step of all thrusters of one vehicle; parameters from `uuv.models.water.thrusters`."""

    def __init__(self, table: Array, wrench: Array, timestep: float, *, kept_in: Array | None = None) -> None:
        """Build the tables of the kernel.

        Args:
            table: Thruster rows (m, ...) of `uuv.models.water.thrusters`.
            wrench: Wrench on the hull per newton of thrust, columns (6, m).
            timestep: [s]
            kept_in: Memory for the state, so that copies of a simulation carry it; where it is shorter than 3 m
                numbers, or None, the state is kept apart.

        Raises:
            ConfigurationError: The shapes do not match, or a row is invalid.
        """
        if table.ndim != 2 or (len(table) and table.shape[1] < HEADER) or wrench.shape != (6, len(table)):
            raise ConfigurationError(f"thrusters: table {table.shape} and wrench {wrench.shape} do not fit together")
        self.curves = curves(table)
        columns = np.array(table).reshape(len(table), -1) if len(table) else np.zeros((0, HEADER))
        lag, slew = columns[:, TIME_CONSTANT], columns[:, SLEW_RATE]
        decay = np.where(lag > 0.0, np.exp(-timestep / np.where(lag > 0.0, lag, 1.0)), 0.0)
        advance = inflow_levers(columns, wrench)
        slew = np.where(slew > 0.0, slew * timestep, np.inf)
        self.table = np.vstack([decay, slew, columns[:, INFLOW_LOSS], advance])
        kept = 3 * len(table)
        if kept_in is None or len(kept_in) < kept:
            kept_in = np.zeros(kept)
        self.state = kept_in[:kept].reshape(3, len(table))  # first row: command after the drives' slew limit
        self.speed = self.state[1]  # normalised propeller speed
        self.thrust = self.state[2]  # [N]

    def reset(self) -> None:
        """Stop all propellers."""
        self.state[:] = 0.0

    def step(self, command: Array, R_WB: Array, v_WB_W: Array, w_WB_B: Array, current_W: Array) -> bool:
        """Advance by one step of the plant; the thrust [N] is then in `self.thrust`.

        Args:
            command: Normalised speed (m,).
            R_WB: Hull attitude (3, 3).
            v_WB_W: Hull velocity (3,) [m/s], world axes.
            w_WB_B: Hull angular velocity (3,) [rad/s], hull axes.
            current_W: Current (3,) [m/s], world axes.

        Returns:
            True if a command was at its limit (SATURATED).

        Raises:
            ConfigurationError: The command has another shape or is not finite.
        """
        command = fitting(command, self.speed.shape, "thruster command")
        return advance_thrusters(self.curves, self.table, command, R_WB, v_WB_W, w_WB_B, current_W, self.state)
