"""Joint torques that hold an arm in a posture: a PD law whose gains follow from the drives' limits."""

import numpy as np

from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.truth import Truth

HOLD_ANGLE = 0.05  # [rad] error that asks for the whole torque of a drive, which is the maximum
HOLD_TIME = 0.03  # [s] damping over stiffness


class ArmHold:
    """Holds the arm of a vehicle at joint angles, from the true state."""

    def __init__(self, vehicle: Vehicle, q: Array) -> None:
        """Take the vehicle, and the angles (n,) [rad] to hold."""
        self._q, self._limits = np.array(q), vehicle.torque_limits
        self._stiffness = vehicle.torque_limits / HOLD_ANGLE  # [N m]/[rad]
        self._damping = self._stiffness * HOLD_TIME  # [N m]/[rad/s]

    def torque(self, truth: Truth) -> Array:
        """Joint torques (n,) [N m] within the drives' limits."""
        wanted = self._stiffness * (self._q - truth.q) - self._damping * truth.qd
        return np.minimum(np.maximum(wanted, -self._limits), self._limits)  # faster than np.clip on few numbers
