"""Blind departure: thrusts that take a vehicle without an estimate off the surface, and then up.

Nothing is known any more of how the hull moves, so the thrusts are set beforehand. Those that have
held the hull in its current, on average, go on, less their part against the contact. On top comes a
force off the surface along the tool axis, then one up; off an overhang there is no second one. With
the arm folded nobody knows where the object is, and the hull rises at once. Its last velocity is
braked first. Roll and pitch are left to weight and buoyancy. With thrusters that merely stop, the
current would carry the vehicle onto the object.
"""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.priorities import PRIORITIES_AFTER_LOSS
from uuv.controllers.tuning import SAFETY
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import curves
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array

# [rad], slides [m], from the folded arm's joint angles, up to which the tool is near nothing
_FOLDED = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class DepartureStage:
    """Commands that stand for a time."""

    until: float  # [s] since the departure began
    thrusters: Array  # (m,) normalised propeller speed in [-1, 1]


@dataclass(slots=True, eq=False)
class HullBalance:
    """Means of what balances the hull, over some `SAFETY.balance_time`."""

    time: float = -math.inf  # [s] of the newest command
    step: object = None  # what tells that command of the hull from the next
    # (m,) [N] steady, in still water; empty: none yet
    thrust: Array = field(default_factory=lambda: np.zeros(0))
    force_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [N] of the contact


class BlindDeparture:
    """Departure of one vehicle."""

    def __init__(self, model: mujoco.MjModel, vehicle: Vehicle, arm: ArmDynamics | None) -> None:
        """Set up the departure.

        Args:
            model: compiled model of the vehicle, the believed one.
            vehicle: the vehicle in it.
            arm: its arm; None: it has none.

        Raises:
            ConfigurationError: the thrusters do not span all six directions.
        """
        self._arm, self._allocation = arm, Allocation(vehicle)
        self._B, self._curves = np.array(vehicle.thruster_wrench), curves(vehicle.thruster_table)
        self._q_home = np.array(vehicle.q_home)
        self._mass = float(model.body_subtreemass[vehicle.hull])

    def follow(
        self, balance: HullBalance, command: Command, reference: Reference, time: float
    ) -> None:
        """Take each new command of the hull into its balance.

        Args:
            balance: changed in place.
            command: finite. Its estimate of the contact counts while the tool is to touch
                something; where it is unknown, the set force does.
            reference: set points that it follows.
            time: [s] of it.
        """
        step = time if command.hull_load is None else command.hull_load
        if step == balance.step:
            return
        thrust = np.array(
            [thrust_at(*one) for one in zip(self._curves, command.thrusters, strict=True)]
        )
        force_W = _contact_force(command, reference)
        if balance.thrust.size:
            share = 1.0 - math.exp(-max(time - balance.time, 0.0) / SAFETY.balance_time)
            thrust = balance.thrust + share * (thrust - balance.thrust)
            force_W = balance.force_W + share * (force_W - balance.force_W)
        balance.time, balance.step, balance.thrust, balance.force_W = time, step, thrust, force_W

    def stages(
        self, balance: HullBalance, sound: StateEstimate, lost: tuple[int, ...]
    ) -> tuple[DepartureStage, ...]:
        """Stages of the departure in their order, at most two; none before the first sound command.

        Args:
            balance: what has held the hull until now.
            sound: the last sound estimate.
            lost: indices of thrusters that are not to be used.
        """
        if not balance.thrust.size:
            return ()
        R_BW, up_W, held_B = (
            sound.X_WB[:3, :3].T,
            np.array([0.0, 0.0, 1.0]),
            self._B @ balance.thrust,
        )
        legs = [(SAFETY.leave_time, up_W), (SAFETY.leave_time + SAFETY.rise_time, up_W)]
        if self._arm is not None and np.abs(sound.q - self._q_home).max() > _FOLDED:
            X_BG, force_B = self._arm.tip(sound.q)[0], R_BW @ balance.force_W
            held_B += np.append(force_B, np.cross(X_BG[:3, 3], force_B))
            off_W = -R_BW.T @ X_BG[:3, 2]
            up_W = ascent_direction(off_W)
            legs = [(SAFETY.leave_time, off_W)]
            if up_W[2] > 0.0:
                legs.append((SAFETY.leave_time + SAFETY.rise_time, up_W / np.linalg.norm(up_W)))
        allocation = (
            self._allocation.without(*lost, priorities=PRIORITIES_AFTER_LOSS)
            if lost
            else self._allocation
        )
        found: list[DepartureStage] = []
        braking_B = -self._mass * sound.v_WB_B / SAFETY.leave_time  # of the first stage
        for until, along_W in legs:
            push_B = self._mass * SAFETY.leave_acceleration * (R_BW @ along_W)
            wrench_B = held_B + np.append(push_B if found else push_B + braking_B, np.zeros(3))
            found.append(DepartureStage(until, allocation.command(allocation.thrust(wrench_B))))
        return tuple(found)


def _contact_force(command: Command, reference: Reference) -> Array:
    """Contact force (3,) [N], W, that the thrusts are to balance; zero where none is meant to
    be.
    """
    if reference.set_force > 0.0 or reference.force_control:
        X_WG = reference.X_WG
        set_force_W = np.zeros(3) if X_WG is None else -reference.set_force * X_WG[:3, 2]
        for force_W in (command.contact.force_W, set_force_W):
            if math.isfinite(force_W[0] + force_W[1] + force_W[2]):
                return force_W
    return np.zeros(3)


def ascent_direction(normal_W: Array) -> Array:
    """Direction (3,) of an ascent off a surface with normal `normal_W` (3,): up, and half as much
    along the normal.

    Straight up a steep flank the tool would strike parts of the object that bulge above it. More
    along the normal keeps it off an overhang, down from one that is level.
    """
    return np.array([0.0, 0.0, 1.0]) + max(0.0, 0.5 - normal_W[2]) * normal_W
