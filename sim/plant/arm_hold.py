"""Joint torques that hold an arm in a posture: a PD law with gains from the drives' limits."""

from typing import NamedTuple

import numpy as np

from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.truth import Truth

HOLD_ANGLE = 0.05  # [rad] error at which a drive gives its largest torque
HOLD_TIME = 0.03  # [s] ratio of damping to stiffness


class HoldGains(NamedTuple):
    """Posture to hold, gains and torque limits."""

    q: Array  # (n,) [rad]
    stiffness: Array  # (n,) [N m/rad]
    damping: Array  # (n,) [N m s/rad]
    limits: Array  # (n,) [N m] of the drives


@kernel
def hold_torque(gains, q, qd, tau):
    """Write torques (n,) [N m] into `tau` that hold joints in a posture, from `q` (n,) [rad], `qd`
    [rad/s].
    """
    for j in range(tau.shape[0]):
        torque = gains.stiffness[j] * (gains.q[j] - q[j]) - gains.damping[j] * qd[j]
        tau[j] = min(max(torque, -gains.limits[j]), gains.limits[j])


class ArmHold:
    """Holds the arm of a vehicle at joint angles, from the true state."""

    def __init__(self, vehicle: Vehicle, q: Array, time: float = HOLD_TIME) -> None:
        """Take the vehicle, the angles (n,) [rad] to hold, and the ratio of damping to stiffness
        [s].

        Torques are constant during a timestep, so a light arm that presses on something needs less
        damping.
        """
        limits = np.array(vehicle.torque_limits)
        stiffness = limits / HOLD_ANGLE
        self.gains = HoldGains(np.array(q), stiffness, stiffness * time, limits)

    def torque(self, truth: Truth) -> Array:
        """Joint torques (n,) [N m] within the drives' limits."""
        tau = np.empty(len(self.gains.q))
        hold_torque(self.gains, truth.q, truth.qd, tau)
        return tau
