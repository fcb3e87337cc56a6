"""How much of the thrusters a hull needs that hovers level while its arm stands and pushes: what is left decides where
it hovers. Weight and buoyancy, the arm's weight in water, the set force and the surface's friction; current aside.
"""

from copy import copy
from typing import Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.hull.station_keeping import StationKeeping
from models.vehicle import Vehicle
from models.water.thrusters import FORWARD, REVERSE
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, checked


class ThrustMargin:
    """The statics of a vehicle at work."""

    def __init__(self, vehicle: Vehicle, arm: ArmDynamics, static_B: ArrayLike, *, drag: float = 0.6) -> None:
        """Take the vehicle, its arm, and weight and buoyancy of the level hull alone `static_B` (6,) [N, N m].

        `drag` is the share of the set force by which friction may hold the tool back. Raises ConfigurationError for
        one that is negative or no number, or for a vehicle without thrusters.
        """
        if not checked([drag], (1,), "drag")[0] >= 0.0:
            raise ConfigurationError(f"drag: must be >= 0, got {drag}")
        if not vehicle.thruster_wrench.size:
            raise ConfigurationError("the vehicle has no thrusters to hold it")
        self.drag = drag
        self._arm, self._static = arm, checked(static_B, (6,), "static_B").copy()
        forward, reverse = vehicle.thruster_table[:, FORWARD], vehicle.thruster_table[:, REVERSE]
        most = np.maximum(forward, reverse)
        # Of all ways to give a wrench the least by the thrusters' own strengths; six thrusters have but one.
        self._shares = np.linalg.pinv(vehicle.thruster_wrench * most)
        with np.errstate(divide="ignore"):
            self._forward, self._reverse = most / forward, most / reverse
        self._still = np.zeros(arm.n)

    @classmethod
    def of(cls, model: mujoco.MjModel, *, drag: float = 0.6) -> Self:
        """Of the vehicle in `model`, which the hull's and the arm's weights are read from."""
        arm = ArmDynamics(model)
        return cls(Vehicle.of(model), arm, StationKeeping(model, arm).static_wrench(np.eye(3)), drag=drag)

    def without_friction(self) -> Self:
        """The same where nothing holds the tool back."""
        free = copy(self)
        free.drag = 0.0
        return free

    def used(self, q: Array, R_WB: Array, f_tip_G: ArrayLike) -> float:
        """Largest share of a thruster that is used, 1 at full thrust.

        The arm stands at `q` (n,) [rad], the hull at `R_WB` (3, 3), the world pushes the tip by `f_tip_G` (3,) [N],
        tool axes.
        """
        zero, wrench = np.zeros(6), np.zeros(6)
        wrench[:3] = f_tip_G
        arm_B = self._arm.inverse(
            q, self._still, self._still, R_WB=R_WB, nu_B=zero, a_B=zero, v_current_W=zero[:3], wrench_tip_G=wrench
        )[1]
        shares = self._shares @ -(arm_B + self._static)
        return float(np.where(shares > 0.0, shares * self._forward, -shares * self._reverse).max())
