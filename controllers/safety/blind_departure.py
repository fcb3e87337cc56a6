"""Blind departure: thrusts that take a vehicle without an estimate off the surface, and then up.

Nothing is known any more of how the hull moves, so the thrusts are set beforehand. Those that have held the hull in its
current, on average, go on, less their part against the contact. On top comes a force off the surface along the tool
axis, then one up. It scales with the vehicle's mass, and down where a thruster has no more to give. Roll and pitch are
left to weight and buoyancy. With the thrusters merely stopped, the current would carry the tool back.
"""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.tuning import SAFETY
from models.vehicle import Vehicle
from models.water.thruster_curves import command_for, thrust_at
from models.water.thrusters import FORWARD, REVERSE, curves
from sim.interfaces.messages import Command, Reference, StateEstimate
from sim.interfaces.spatial import Array

_ROUNDING = 1e-9  # [-] share of the largest thrust below which one is rounding noise, also where it has no more to give


@dataclass(frozen=True, slots=True, eq=False)
class DepartureStage:
    """Commands that stand for a time."""

    until: float  # [s] since the departure began
    thrusters: Array  # (m,) normalised propeller speed in [-1, 1]


@dataclass(slots=True, eq=False)
class HullBalance:
    """Means of what balances the hull, over some `SAFETY.balance_time`."""

    time: float = -math.inf  # [s] of the newest command
    commanded: Array | None = None  # (m,) thrusters of that command, to tell a new one
    thrusters: Array = field(default_factory=lambda: np.zeros(0))  # (m,) [-]
    force_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [N] of the contact; NaN: not known

    def follow(self, command: Command, time: float) -> None:
        """Take a finite command at `time` [s] into the means, at each new one of the hull."""
        if command.thrusters is self.commanded:
            return
        share = 1.0 - math.exp(-max(time - self.time, 0.0) / SAFETY.balance_time)
        if self.commanded is None:
            self.thrusters, self.force_W = command.thrusters, command.contact.force_W
        else:
            self.thrusters = self.thrusters + share * (command.thrusters - self.thrusters)
            before = self.force_W if math.isfinite(self.force_W[0]) else command.contact.force_W
            self.force_W = before + share * (command.contact.force_W - before)
        self.time, self.commanded = time, command.thrusters


class BlindDeparture:
    """Departure of one vehicle with an arm."""

    def __init__(self, model: mujoco.MjModel, vehicle: Vehicle, arm: ArmDynamics) -> None:
        """Set up the departure.

        Args:
            model: compiled model of the vehicle, the believed one.
            vehicle: the vehicle in it.
            arm: its arm.
        """
        self._vehicle, self._arm, self._curves = vehicle, arm, curves(vehicle.thruster_table)
        self._push = SAFETY.leave_acceleration * float(model.body_subtreemass[vehicle.hull])

    def stages(self, balance: HullBalance, sound: StateEstimate, reference: Reference) -> tuple[DepartureStage, ...]:
        """Stages of the departure; none where no tool pose is commanded, since then the tool is nowhere near.

        Args:
            balance: what has held the hull until now. Where it knows no contact, the set force counts.
            sound: the last sound estimate.
            reference: set points at that time.
        """
        if reference.X_WG is None:
            return ()
        R_BW, off_W = sound.X_WB[:3, :3].T, -reference.X_WG[:3, 2]
        wrench, B = np.zeros(6), np.array(self._vehicle.thruster_wrench)
        known = bool(np.isfinite(balance.force_W).all())
        wrench[:3] = R_BW @ (balance.force_W if known else reference.force * off_W)
        wrench[3:] = np.cross(self._arm.tip(sound.q)[0][:3, 3], wrench[:3])
        B[:, list(reference.lost_thrusters)] = 0.0
        inverse = np.linalg.pinv(B)
        given = np.array([thrust_at(*one) for one in zip(self._curves, balance.thrusters, strict=True)])
        held = given + inverse @ wrench
        up_W = ascent_direction(off_W)
        found = []
        for until, along_W in (
            (SAFETY.leave_time, off_W),
            (SAFETY.leave_time + SAFETY.rise_time, up_W / np.linalg.norm(up_W)),
        ):
            more = inverse[:, :3] @ (self._push * (R_BW @ along_W))
            pairs = zip(self._curves, self._within(held, more), strict=True)
            found.append(DepartureStage(until, np.array([command_for(*one) for one in pairs])))
        return tuple(found)

    def _within(self, held: Array, more: Array) -> Array:
        """Thrusts (m,) [N] `held`, with as much of `more` as no thruster exceeds its limit for."""
        table = self._vehicle.thruster_table
        low, high = -table[:, REVERSE], table[:, FORWARD]
        held = np.clip(held, low, high)
        room = np.where(more > 0.0, high - held, low - held)
        moved = np.abs(more) > _ROUNDING * np.abs(more).max(initial=0.0)
        return held + more * float(np.min(room[moved] / more[moved], initial=1.0))


def ascent_direction(normal_W: Array) -> Array:
    """Direction (3,) of an ascent off a surface with normal `normal_W` (3,): up, and up to half as much along it.

    Straight up a steep flank the tool would strike parts of the object that bulge above it.
    """
    return np.array([0.0, 0.0, 1.0]) + max(0.0, 0.5 - normal_W[2]) * normal_W
