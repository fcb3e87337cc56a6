"""Card of an identified pose for a notebook."""

import math
from typing import Any

import numpy as np

from uuv.sim.interfaces import page
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, log_so3, transform_points


class PoseCard:
    """Display of an `Identification` in a notebook, from the attributes listed here."""

    X_sensor_target: Array
    accepted: bool
    reason: str
    covariance: PoseCovariance | None
    surface: Any  # the model, `ModelSurface`
    duration_s: float

    def _repr_html_(self) -> str:
        """Card for a notebook: middle and attitude in the sensor's frame, and their uncertainty."""
        target = self.surface.target
        middle = transform_points(self.X_sensor_target, target.center)
        turn = np.degrees(log_so3(self.X_sensor_target[:3, :3]))
        rows = [
            ("middle, in S", ", ".join(f"{value:.4f}" for value in middle), "m"),
            ("rotation vector, T in S", ", ".join(f"{value:.2f}" for value in turn), "deg"),
        ]

        if self.covariance is not None:
            position, angle = self.covariance.held_sigmas
            rows += [
                ("standard deviation, position", f"{1e3 * position:.2f}", "mm"),
                ("standard deviation, rotation", f"{math.degrees(angle):.3f}", "deg"),
                ("degrees of freedom determined", str(self.covariance.degrees), ""),
            ]
        rows.append(("computing time", f"{self.duration_s:.2f}", "s"))
        return page.card(f"Pose of {target.name}", self.accepted, [self.reason], rows)
