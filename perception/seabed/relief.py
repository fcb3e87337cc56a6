"""Relief of the seabed around a work site: slope, roughness and step, compared with limits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from uuv.perception.seabed.terrain import Terrain
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError


@dataclass(frozen=True, slots=True, kw_only=True)
class ReliefLimits:
    """Largest slope, roughness and step on which work may begin."""

    slope: float = float(np.radians(30.0))  # [rad] of the plane through the patch
    roughness: float = 0.025  # [m] standard deviation of the heights from that plane
    step: float = 0.12  # [m] between the highest and the lowest of the deviations from that plane

    def __post_init__(self) -> None:
        if not (0.0 < self.slope < 0.5 * np.pi and self.roughness > 0.0 and self.step > 0.0):
            raise ConfigurationError(
                "relief limits: slope must be in (0, pi/2) rad, roughness and step > 0 m, got "
                f"{self}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """Slope, roughness and step of the seabed around a position."""

    slope: float  # [rad]
    roughness: float  # [m]
    step: float  # [m] between the highest and the lowest deviation from the fitted plane
    reason: str  # reason why work may not begin; empty if it may

    @property
    def suitable(self) -> bool:
        """True if all limits are kept."""
        return not self.reason


def relief(
    terrain: Terrain,
    around: ArrayLike,
    radius: float,
    limits: ReliefLimits | None = None,
    name: str = "the work site",
) -> Relief:
    """Slope and roughness of the patch around given points, compared with limits.

    Args:
        terrain: Triangulated seabed.
        around: (k, 3) [m] points in S.
        radius: [m] radius of the patch around any of the points.
        limits: Limits of slope, roughness and step; None: `ReliefLimits()`.
        name: Name of the patch, in messages.

    Returns:
        Slope, roughness and step, with the reason if a limit is exceeded.

    Raises:
        PerceptionError: Too little of the patch was measured.
    """
    limits = limits or ReliefLimits()

    # Vertices around the points
    centers = terrain.ground(np.atleast_2d(np.asarray(around, dtype=np.float64)))
    heights = terrain.ground(terrain.vertices)
    near = cKDTree(centers[:, :2]).query(heights[:, :2], distance_upper_bound=radius)[0] <= radius
    if near.sum() < 6:
        raise PerceptionError(
            f"relief: only {near.sum()} measured points within {radius:g} m of {name}"
        )

    # Plane through them, and what deviates from it
    patch = heights[near]
    middle = patch.mean(axis=0)
    (sx, sy), *_ = np.linalg.lstsq(patch[:, :2] - middle[:2], patch[:, 2] - middle[2], rcond=None)
    off = patch[:, 2] - middle[2] - (patch[:, :2] - middle[:2]) @ [sx, sy]
    slope = float(np.arctan(np.hypot(sx, sy)))
    rough = float(off.std())
    step = float(np.ptp(off))

    # Limits
    exceeded = [
        f"{word} {figure * scale:.{digits}f} {unit} above the limit of {limit * scale:.{digits}f}"
        for word, figure, limit, scale, digits, unit in (
            ("slope", slope, limits.slope, np.degrees(1.0), 0, "deg"),
            ("roughness", rough, limits.roughness, 1e3, 0, "mm"),
            ("step", step, limits.step, 1e3, 0, "mm"),
        )
        if figure > limit
    ]
    reason = f"the relief at {name} is unsuitable: {', '.join(exceeded)}" if exceeded else ""
    return Relief(slope=slope, roughness=rough, step=step, reason=reason)
