"""What the vehicle's drives do with a command that is late: they carry it on.

A servo behind a late link would be a loop with that delay, and unstable. Therefore a command may
come with the gains by which its torques follow the motion since the measurement that it answers,
and with the friction of the gears that it overcomes, which the drives measure anew.
"""

from typing import NamedTuple, Self

import numpy as np

from uuv.controllers.arm.joint_servo import FrictionTracking, track_gear_friction
from uuv.controllers.tuning import ArmTuning
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import Command, StateEstimate
from uuv.sim.interfaces.spatial import Array, log_so3


class Asked(NamedTuple):
    """Motion in a measurement, for which its answer is computed."""

    time: float  # [s] simulated
    X_WB: Array  # (4, 4) hull pose
    nu_B: Array  # (6,) [m/s, rad/s] its velocity
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]

    @classmethod
    def of(cls, estimate: StateEstimate) -> Self:
        """That of an estimate, whose arrays may change."""
        nu_B = np.concatenate([estimate.v_WB_B, estimate.w_WB_B])
        parts = estimate.X_WB, nu_B, estimate.q, estimate.qd
        return cls(estimate.time, *(np.array(part) for part in parts))


class Answer(NamedTuple):
    """A command, with the motion for which it was computed."""

    command: Command
    asked: Asked
    stiffness: Array  # (n, n) [N m/rad] with which the torques follow the joints since
    damping: Array  # (n, n) [N m s/rad]
    compensation: Array  # (n, 6) [rad/m, rad/rad] of the joints, for the motion of the hull since
    friction: Array  # (n,) [N m] of the gears, in the torques; NaN: not overcome


class LateCommands:
    """Drives that carry commands on, with the friction of their gears from the torque sensors."""

    def __init__(self, vehicle: Vehicle, period: float) -> None:
        """Set up the drives of a vehicle, for a period [s] of the commands."""
        tuning = ArmTuning()
        self._limits = np.array(vehicle.torque_limits)
        self._share = min(1.0, period / tuning.acceleration_filter)
        self._lag = tuning.acceleration_filter
        self._gears = FrictionTracking(
            armature=np.array(vehicle.armature),
            damping=np.array(vehicle.joint_damping),
            most=tuning.gears.excess * vehicle.dry_friction.stiction,
            share=min(1.0, period / tuning.gears.filter),
        )
        self._friction = np.zeros(vehicle.joints.size)
        self._qd_slow: Array | None = None

    def measure(self, applied: Array, estimate: StateEstimate) -> None:
        """Track the friction of the gears.

        Args:
            applied: (n,) [N m] torques of the motors in the last period.
            estimate: Present estimate.
        """
        qd = np.array(estimate.qd)
        tau = np.array(estimate.tau)
        if not (np.isfinite(qd).all() and np.isfinite(tau).all()):
            return
        if self._qd_slow is None:
            self._qd_slow = qd
        qdd = (qd - self._qd_slow) / self._lag
        self._qd_slow = self._qd_slow + self._share * (qd - self._qd_slow)
        track_gear_friction(applied, tau, qd, qdd, tuple(self._gears), self._friction)

    def cut(self, torque: Array) -> Array:
        """Torques (n,) [N m] within the limits of the drives."""
        return np.clip(torque, -self._limits, self._limits)

    def torque(self, answer: Answer, estimate: StateEstimate) -> Array:
        """Torques (n,) [N m] of a command at a later tick: they follow the motion since."""
        seen = Asked.of(estimate)
        asked = answer.asked
        R_BW = asked.X_WB[:3, :3].T

        # How far the hull has moved, and how much faster it is, in its axes of then.
        off_W = seen.X_WB[:3, 3] - asked.X_WB[:3, 3]
        moved_B = np.concatenate([R_BW @ off_W, log_so3(R_BW @ seen.X_WB[:3, :3])])
        error = answer.compensation @ moved_B - (seen.q - asked.q)
        slower = answer.compensation @ (seen.nu_B - asked.nu_B) - (seen.qd - asked.qd)

        torque = answer.command.joint_torque + answer.stiffness @ error + answer.damping @ slower
        known = np.isfinite(answer.friction)
        torque[known] += (self._friction - answer.friction)[known]
        return self.cut(torque)
