"""Data of the vehicle that the planners of its work use."""

from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.mkps import Chain
from uuv.controllers.planning.arm_size import size
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, readonly

_AHEAD = readonly(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkVehicle:
    """Vehicle, kinematics of its arm, extent of its hull, and pose of its camera."""

    vehicle: Vehicle
    chain: Chain  # kinematics of the arm, base to tool
    hull_box: Array  # (2, 3) [m] corners of the hull in B, kept clear of objects and seabed
    # (4, 4) pose of the camera on the hull, z its axis
    X_BC: Array = field(default_factory=lambda: _AHEAD)

    @property
    def size(self) -> float:
        """Scale [-] of the distances from an object (`uuv.controllers.planning.arm_size`)."""
        return size(self.chain)

    @property
    def level_view_B(self) -> Array:
        """Horizontal direction (3,) of the camera's view; ahead if it looks straight down."""
        ahead = self.X_BC[:3, 2] * [1.0, 1.0, 0.0]
        return (
            ahead / np.linalg.norm(ahead)
            if np.linalg.norm(ahead) > 1e-6
            else np.array([1.0, 0.0, 0.0])
        )

    def tip(self, estimate: StateEstimate) -> Array:
        """Position (3,) [m] of the tool's tip in W, from the estimated hull pose and joint
        angles.
        """
        return (estimate.X_WB @ self.vehicle.X_BA @ self.chain.forward(estimate.q))[:3, 3]
