"""Force at the tool that dry friction of the gears hides from the motors.

Without torque sensors a joint's friction counts as contact where it is not known: any torque up to
stiction of a joint that rests or reverses, and the unknown share of sliding friction of one that
moves. By the rows of least squares on J^T f (`uuv.controllers.estimation.force_from_torques`) they
become a force along the tool.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from uuv.controllers.estimation.force_from_torques import PRIOR
from uuv.controllers.tuning import ArmTuning
from uuv.own_vehicle import OwnVehicle

# [-] standard deviation of the friction of a joint at rest over stiction, by which the load
# observer weighs its torques (`uuv.controllers.arm.believed_friction.dry_friction_sigma`)
_AT_REST = 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenForce:
    """Errors of the force along the tool by the motors, in the posture `ready`."""

    rms: float  # [N] expected while the joints slide
    most: float  # [N] with joints at rest or reversing
    by: str  # joint that hides most

    @classmethod
    def of(cls, believed: OwnVehicle) -> Self:
        """Figures of a vehicle, by its model of itself."""
        vehicle = believed.vehicle
        dry = vehicle.dry_friction
        tuning = ArmTuning()
        X_AG, J = believed.chain().kinematics(np.array(vehicle.q_ready))

        # Force along the tool per torque of each joint
        weights = np.hypot(tuning.torques.observer_floor, _AT_REST * dry.stiction)
        J_G = X_AG[:3, :3].T @ J[:3]
        of_force = np.asarray(
            np.linalg.inv(J_G @ (J_G / weights**2).T + PRIOR * np.eye(3)), dtype=np.float64
        )
        along = of_force[2] @ (J_G / weights**2)

        hidden = np.abs(along) * dry.stiction
        unknown = (1.0 - tuning.gears.known) * np.abs(along) * dry.coulomb
        return cls(
            rms=float(np.linalg.norm(unknown)),
            most=float(hidden.sum()),
            by=vehicle.joint_names[int(np.argmax(hidden))],
        )

    def refusal(self, rms: float, most: float) -> str:
        """Sentence if the errors are above the bounds [N] of their RMS and peak; else empty."""
        if self.rms <= rms and self.most <= most:
            return ""
        return (
            "control.force_from motors: dry friction of the gears hides up to "
            f"{self.most:.0f} N of the force where joints rest or reverse, mostly {self.by} "
            f"(allowed {most:.1f} N), and "
            f"{self.rms:.1f} N RMS while they slide (allowed {rms:.1f} N)"
        )
