"""Place of the hull at work that is chosen by hand, relative to the object."""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.spatial import Array, exp_so3, finite_number, pose


@dataclass(frozen=True, kw_only=True)
class HullPlace:
    """Hull pose at work, in level axes at the object's origin: z up, x along x_T, or along y_T of
    an object whose x_T is nearer to vertical than to horizontal.
    """

    x: float  # [m] of the hull's origin
    y: float  # [m]
    z: float  # [m]
    heading: float = 0.0  # [rad] of the hull, from x

    def __post_init__(self) -> None:
        for axis in ("x", "y", "z"):
            finite_number(
                getattr(self, axis), f"task.hull_place.{axis} [m]", least=-100.0, most=100.0
            )
        finite_number(self.heading, "task.hull_place.heading [rad]", least=-np.pi, most=np.pi)

    def in_world(self, X_WT: Array) -> Array:
        """Hull pose X_WB (4, 4) beside an object at X_WT (4, 4)."""
        axis = int(abs(X_WT[2, 0]) > np.sqrt(0.5))
        turn = np.arctan2(X_WT[1, axis], X_WT[0, axis]) - 0.5 * np.pi * axis
        R = exp_so3([0.0, 0.0, turn])
        return pose(
            R @ exp_so3([0.0, 0.0, self.heading]), X_WT[:3, 3] + R @ [self.x, self.y, self.z]
        )
