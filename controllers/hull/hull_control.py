"""Control of the hull: station keeping, allocation to the thrusters and lead compensation of their lag, in one loop."""

from dataclasses import dataclass

import mujoco
import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.hull.allocation import PRIORITIES_AFTER_LOSS, Allocation
from controllers.hull.station_keeping import StationKeeping, StationKeepingState
from controllers.hull.thruster_lead import ThrusterLead, ThrusterLeadState
from models.vehicle import Vehicle
from sim.interfaces.messages import Reference, StateEstimate
from sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class HullControlState:
    """State of the loop."""

    station: StationKeepingState
    propellers: ThrusterLeadState
    wanted_B: Array  # (6,) [N, N m] last asked of the thrusters, hull axes
    current_W: Array  # (3,) [m/s] estimated current
    thrusters: Array  # (m,) last command, normalised


class HullControl:
    """Hull pose to thruster commands, beside the fed-forward wrench of the arm."""

    def __init__(
        self,
        model: mujoco.MjModel,
        arm: ArmDynamics | None = None,
        *,
        period: float = 0.02,
        water_error: float = 0.0,
        allocation: Allocation | None = None,
        lead: ThrusterLead | None = None,
    ) -> None:
        """Set up from the believed model of the vehicle.

        Args:
            model: believed model, compiled.
            arm: believed dynamics of its arm; None reads them from `model`.
            period: [s] of a step.
            water_error: [-] share by which added mass and drag of the hull are deliberately wrong.
            allocation: of the sound vehicle; None: the default one.
            lead: compensation of the thrusters' lag; None: the default one.
        """
        vehicle = Vehicle.of(model)
        self.station = StationKeeping(model, arm, water_error=water_error)
        self._period, self._thrusters = period, len(vehicle.thruster_names)
        self._lead = lead or ThrusterLead(vehicle)
        self._allocations: dict[tuple[int, ...], Allocation] = {(): allocation or Allocation(vehicle)}  # by those lost

    def init(self) -> HullControlState:
        """Initial state: thrusters off, no current known."""
        off = np.zeros(self._thrusters)
        return HullControlState(self.station.init(), self._lead.init(), np.zeros(6), np.zeros(3), off)

    def allocation(self, lost: tuple[int, ...]) -> Allocation:
        """Allocation to the thrusters that are left without those `lost`, by index."""
        if lost not in self._allocations:
            self._allocations[lost] = self._allocations[()].without(*lost, priorities=PRIORITIES_AFTER_LOSS)
        return self._allocations[lost]

    def step(
        self, state: HullControlState, estimate: StateEstimate, reference: Reference, arm_wrench_B: Array
    ) -> Array:
        """Thruster commands (m,), normalised, for one period.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: hull pose and its velocities, and the thrusters that are lost.
            arm_wrench_B: (6,) [N, N m] wrench of the arm on the hull to be cancelled, hull axes.

        Returns:
            The commands.
        """
        r, dt = reference, self._period
        state.wanted_B = self.station.step(state.station, estimate, r.X_WB, r.v_WB_W, arm_wrench_B, dt, r.w_WB_W)
        state.current_W = self.station.current(state.station)
        allocation = self.allocation(r.lost_thrusters)
        command = allocation.command(allocation.thrust(state.wanted_B))
        through_water = self.station.through_water(state.station, estimate)
        state.thrusters = self._lead.step(state.propellers, command, through_water, dt)
        state.station.given_B = state.propellers.given_B
        return state.thrusters
