"""Blind departure: thrusts that move a vehicle without a state estimate away from the surface, and
then up.

The motion of the hull is unknown, so the thrusts are computed beforehand. The mean thrusts that
have held the hull in its current continue, without their part against the contact. In addition
there is a force away from the surface along the tool axis, and then an upward force; under an
overhang there is no upward force. With the arm folded the position of the object is unknown, and
the hull rises at once. The last velocity of the hull is braked first. Roll and pitch are stabilised
by weight and buoyancy. If the thrusters merely stopped, the current would move the vehicle onto the
object.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.priorities import PRIORITIES_AFTER_LOSS
from uuv.controllers.tuning import SAFETY
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.records import FOLLOWS, IN_CONTACT
from uuv.sim.interfaces.spatial import Array

# [rad], slides [m]: largest distance from the folded arm's joint angles at which the tool is near
# nothing
_FOLDED = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class DepartureStage:
    """Commands that are held for some time."""

    until: float  # [s] since the departure began
    thrusters: Array  # (m,) normalised propeller speed in [-1, 1]


class HeldHull(NamedTuple):
    """Means over about `SAFETY.balance_time` of the loads that hold the hull, as arrays that are
    changed in place.
    """

    begun: np.ndarray  # (1,) bool: there has been a command
    time: Array  # (1,) [s] time of the newest command
    thrust: Array  # (m,) [N] steady thrusts, in still water
    force_W: Array  # (3,) [N] contact force

    @classmethod
    def start(cls, thrusters: int) -> "HeldHull":
        """Means for `thrusters` thrusters, before any command."""
        return cls(
            begun=np.zeros(1, dtype=np.bool_),
            time=np.zeros(1),
            thrust=np.zeros(thrusters),
            force_W=np.zeros(3),
        )


@kernel
def follow(curves, balance_time, command, reference, time, held):
    """Include a new command of the hull in the means of the loads that hold it.

    Args:
        curves: static curves of the thrusters.
        balance_time: [s] time constant of the means.
        command: `Commanded`, finite. The contact force of the command is used while the tool is to
            be in contact; if it is unknown, the set force is used.
        reference: `ReferenceRecord` of the command.
        time: [s] of the command.
        held: `HeldHull`; updated.
    """
    estimated = np.isfinite(command.f_W.sum())
    along_W = reference.X_WG[0, 2] + reference.X_WG[1, 2] + reference.X_WG[2, 2]
    wanted = reference.flags[FOLLOWS] and np.isfinite(reference.set_force[0] * along_W)

    # First-order means, which begin with the first command.
    share = 1.0
    if held.begun[0]:
        share = 1.0 - math.exp(-max(time - held.time[0], 0.0) / balance_time)

    for i in range(3):
        force = 0.0
        if reference.flags[IN_CONTACT]:
            if estimated:
                force = command.f_W[i]
            elif wanted:
                force = -reference.set_force[0] * reference.X_WG[i, 2]
        held.force_W[i] += share * (force - held.force_W[i])

    for i in range(curves.shape[0]):
        thrust = thrust_at(curves[i], command.thrusters[i])
        held.thrust[i] += share * (thrust - held.thrust[i])

    held.time[0] = time
    held.begun[0] = True


class BlindDeparture:
    """Blind departure of one vehicle."""

    def __init__(self, model: mujoco.MjModel, vehicle: Vehicle, arm: ArmDynamics | None) -> None:
        """Set up the departure.

        Args:
            model: the controller's model of the vehicle, compiled.
            vehicle: the vehicle in the model.
            arm: the vehicle's arm; None if it has none.

        Raises:
            ConfigurationError: the thrusters do not span all six directions.
        """
        self._arm = arm
        self._allocation = Allocation(vehicle)
        self._B = np.array(vehicle.thruster_wrench)
        self._q_home = np.array(vehicle.q_home)
        self._mass = float(model.body_subtreemass[vehicle.hull])

    def stages(
        self, held: HeldHull, sound: StateEstimate, lost: tuple[int, ...]
    ) -> tuple[DepartureStage, ...]:
        """Stages of the departure in order, at most two; none before the first valid command.

        Args:
            held: loads that have held the hull until now.
            sound: the last valid estimate.
            lost: indices of thrusters that are not to be used.
        """
        if not held.begun[0]:
            return ()
        R_BW, up_W, held_B = (
            sound.X_WB[:3, :3].T,
            np.array([0.0, 0.0, 1.0]),
            self._B @ held.thrust,
        )

        # With the arm folded: straight up, in addition to the thrusts that hold the hull in its
        # current.
        legs = [(SAFETY.leave_time, up_W), (SAFETY.leave_time + SAFETY.rise_time, up_W)]

        # Near the object: without the thrust against the contact, and first away from the surface.
        if self._arm is not None and np.abs(sound.q - self._q_home).max() > _FOLDED:
            X_BG = self._arm.tip(sound.q)[0]
            force_B = R_BW @ held.force_W
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

        # The first stage also brakes the hull.
        found: list[DepartureStage] = []
        braking_B = -self._mass * sound.v_WB_B / SAFETY.leave_time  # duration of the first stage
        for until, along_W in legs:
            push_B = self._mass * SAFETY.leave_acceleration * (R_BW @ along_W)
            wrench_B = held_B + np.append(push_B if found else push_B + braking_B, np.zeros(3))
            found.append(DepartureStage(until, allocation.command(allocation.thrust(wrench_B))))

        return tuple(found)


def ascent_direction(normal_W: Array) -> Array:
    """Direction (3,) of an ascent off a surface: up, and partly along its normal `normal_W` (3,).

    In a vertical ascent along a steep flank the tool would hit parts of the object that protrude
    above it. Under an overhang the direction has a larger part along the normal, and points down if
    the overhang is horizontal.
    """
    return np.array([0.0, 0.0, 1.0]) + max(0.0, 0.5 - normal_W[2]) * normal_W
