"""Thrust margin: largest share of thrust used by a hull at rest whose arm pushes on a surface.

Loads are weight and buoyancy, the arm's weight in water, the set force, and the friction of the
surface. In a current there are also the drag on hull and arm, the hull's Munk moment, and the
inflow of the thrusters. Hull placement (`uuv.controllers.planning.hull_placement`) uses the
remaining share as one of its margins.
"""

from copy import copy
from typing import Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.controllers.arm.inverse_dynamics import ArmDynamics, inverse_dynamics
from uuv.controllers.hull.allocation import AXES, undriven_axes
from uuv.controllers.hull.station_keeping import StationKeeping
from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.models.water.thrusters import FORWARD, INFLOW_LOSS, REVERSE
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, cross


class ThrustMargin:
    """Static load on the thrusters of a vehicle in contact work."""

    def __init__(
        self,
        vehicle: Vehicle,
        arm: ArmDynamics,
        static_B: ArrayLike,
        *,
        drag: float = 0.6,
        water: BodyHydrodynamics | None = None,
    ) -> None:
        """Set up the statics of `vehicle` with its arm.

        Args:
            vehicle: the vehicle, with thrusters.
            arm: modelled dynamics of the arm.
            static_B: (6,) [N, N m] weight and buoyancy of the level hull alone, hull axes.
            drag: [-] largest friction on the tool, as a share of the set force.
            water: hydrodynamics of the hull, for its drag in a current; None: it has none.

        Raises:
            ConfigurationError: `drag` is negative or not finite, or the vehicle has no thrusters.
        """
        if not checked([drag], (1,), "drag")[0] >= 0.0:
            raise ConfigurationError(f"drag: must be >= 0, got {drag}")
        if not vehicle.thruster_wrench.size:
            raise ConfigurationError("thrust margin: the vehicle must have thrusters, has none")
        self.drag = drag
        self._static = checked(static_B, (6,), "static_B").copy()

        table = vehicle.thruster_table
        self._forward, self._reverse, self._loss = (
            table[:, FORWARD],
            table[:, REVERSE],
            table[:, INFLOW_LOSS],
        )

        most = np.maximum(self._forward, self._reverse)
        # Least-norm allocation in shares of each thruster's own strength; six thrusters have a
        # single solution. Axes that weight and buoyancy right are left out.
        spared = undriven_axes(vehicle.thruster_wrench)
        driven = [i for i, axis in enumerate(AXES) if axis not in spared]
        self._thrust = np.zeros((len(most), 6))
        self._thrust[:, driven] = most[:, None] * np.linalg.pinv(
            vehicle.thruster_wrench[driven] * most
        )

        self._advance = np.array(vehicle.thruster_wrench[:3])
        self._parameters = tuple(arm.parameters)
        self._still = np.zeros(arm.n)

        # Drag in a current.
        self._linear = np.zeros((6, 6)) if water is None else np.array(water.linear_damping)
        self._quadratic = np.zeros(6) if water is None else np.array(water.quadratic_damping)
        self._added = np.zeros((6, 6)) if water is None else np.array(water.added_mass)
        self._forms = () if water is None else water.terms

        self._current_W = np.zeros(3)

    @classmethod
    def of(cls, model: mujoco.MjModel, *, drag: float = 0.6) -> Self:
        """Thrust margin of the vehicle in `model`, with its weights and drags; `drag` as above."""
        arm = ArmDynamics(model)
        vehicle = Vehicle.of(model)
        water = hydrodynamics.unpack(model.body_user[vehicle.hull])
        return cls(
            vehicle,
            arm,
            StationKeeping(model, arm).static_wrench(np.eye(3)),
            drag=drag,
            water=water,
        )

    def without_friction(self) -> Self:
        """Copy of this margin without surface friction."""
        return self.with_friction(0.0)

    def with_friction(self, drag: float) -> Self:
        """Copy of this margin with another force against the motion, as a share of the set
        force.
        """
        other = copy(self)
        other.drag = drag
        return other

    def in_current(self, current_W: ArrayLike) -> Self:
        """Copy of this margin in a steady current (3,) [m/s], W."""
        moved = copy(self)
        moved._current_W = checked(current_W, (3,), "current").copy()
        return moved

    def used(self, q: Array, R_WB: Array, tip_G: ArrayLike) -> float:
        """Largest share of full thrust used by any thruster.

        Args:
            q: (n,) [rad] joint angles of the arm, at rest.
            R_WB: (3, 3) attitude of the hull.
            tip_G: (3,) [N] force of the world on the tip, tool axes; or (6,) [N, N m] with moment.

        Returns:
            The share [-]; above 1 the thrusters cannot hold the hull.
        """
        load_B = self._loads(q, R_WB, tip_G)[1] + self._static

        # Drag of the hull, and the thrust that each thruster loses by inflow at full speed ahead.
        taken: Array | float = 0.0
        if self._current_W.any():
            past_B = -(R_WB.T @ self._current_W)
            load_B += self._drag(past_B)
            taken = self._loss * (past_B @ self._advance)

        # Shares of the remaining strength.
        thrust = self._thrust @ -load_B
        most = np.where(thrust > 0.0, self._forward - taken, self._reverse + taken)
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.where(thrust == 0.0, 0.0, np.abs(thrust) / np.maximum(most, 0.0)).max())

    def torques(self, q: Array, R_WB: Array, tip_G: ArrayLike) -> Array:
        """Joint torques (n,) [N m] at rest, for a load on the tip; arguments as of `used`."""
        return self._loads(q, R_WB, tip_G)[0]

    def _loads(self, q: Array, R_WB: Array, tip_G: ArrayLike) -> tuple[Array, Array]:
        """Joint torques, and wrench (6,) of the arm on the hull, at rest."""
        # the hull is at rest, so only its attitude matters
        hull, wrench = np.zeros(24), np.zeros(6)
        hull[:9], hull[21:] = R_WB.ravel(), self._current_W
        load = np.asarray(tip_G, dtype=np.float64)
        wrench[: len(load)] = load

        joints = (np.array(q, dtype=np.float64), self._still, self._still)
        return inverse_dynamics(self._parameters, joints, hull, wrench)

    def _drag(self, past_B: Array) -> Array:
        """Wrench (6,) [N, N m] of the water on a hull that moves relative to it at `past_B` (3,)
        [m/s].
        """
        twist = np.concatenate([past_B, np.zeros(3)])
        drag_B = -(self._linear @ twist + self._quadratic * np.abs(twist) * twist)
        drag_B[3:] -= cross(past_B, (self._added @ twist)[:3])  # Munk moment
        for form in self._forms:
            drag_B += form.wrench(twist[None, :3], twist[None, 3:], self._added)[0]
        return drag_B
