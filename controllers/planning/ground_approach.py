"""Coarse approach to an unknown seabed, a descent towards the plane from the Doppler log's ranges.

After reference 11 of [Konoplin 2019], the seabed is approximated by the plane through the ranges of
the log's beams until finer data are known. The plane decides whether the vehicle may approach, and
how close.
"""

import math
from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array

BEAMS = 3  # minimal number of beams, not collinear, that define a plane


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundApproach:
    """Rules of the coarse approach to the plane of the ground."""

    height: float  # [m] height of the hull above the plane, vertical
    hull_box: Array  # (2, 3) [m] corners of the hull in B
    # [m] distance of the whole hull from the plane, since obstacles above it are not known yet
    clearance: float = 1.2
    slope: float = float(np.radians(35.0))  # [rad] largest slope that is accepted
    oldest: float = 1.0  # [s] largest age of the plane

    def __post_init__(self) -> None:
        for name in ("height", "clearance", "slope", "oldest"):
            if not getattr(self, name) > 0.0:
                raise ConfigurationError(
                    f"ground approach {name}: must be > 0, got {getattr(self, name)}"
                )

    def pose(self, estimate: StateEstimate, X_WB: Array) -> Array:
        """Hull pose (4, 4) to scan from, with position and heading of the level pose `X_WB` (4, 4).

        Raises:
            ReachError: too few beams have measured the ground, the plane is too old, or it is too
                steep.
        """
        ground = estimate.ground
        if ground is None or not estimate.time - ground.time <= self.oldest:
            raise ReachError(
                f"the Doppler log has had no ranges for {self.oldest:g} s: the distance to the "
                "ground is unknown"
            )

        if not math.isfinite(ground.p_W[0]):
            silent = f", silent: {', '.join(map(str, ground.silent))}" if ground.silent else ""
            raise ReachError(
                f"the plane of the ground is unknown: {ground.beams} of the Doppler log's beams "
                f"have an echo, but at least {BEAMS}, not in a line, are needed{silent}"
            )

        slope = math.acos(min(1.0, float(ground.normal_W[2])))
        if slope > self.slope:
            raise ReachError(
                f"the mean slope of the ground is {math.degrees(slope):.0f} deg, above the limit "
                f"of {math.degrees(self.slope):.0f} deg"
            )

        # Higher if a corner of the hull would be too close
        X = np.array(X_WB)
        n = ground.normal_W
        p = ground.p_W
        X[2, 3] = p[2] - (n[:2] @ (X[:2, 3] - p[:2])) / n[2] + self.height
        corners = np.array(np.meshgrid(*self.hull_box.T)).reshape(3, -1).T @ X[:3, :3].T + X[:3, 3]
        gap = float(((corners - p) @ n).min())
        X[2, 3] += max(0.0, (self.clearance - gap) / n[2])

        return X
