"""The plane of the seabed from the ranges of a Doppler log's beams: the coarse approach, before anything is scanned.

Reference 11 of paper 004 works from this plane alone; here it tells how high and how inclined the hull is over the
ground, and whether the four beams agree that there is a plane at all.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.spatial import Array, checked, readonly

JANUS = np.radians(30.0)  # [rad] of the beams from the log's axis, as usual for Doppler logs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundPlane:
    """A plane under the hull, in hull axes: normal . p = -altitude."""

    normal_B: Array  # (3,) unit, out of the ground
    altitude: float  # [m] of the hull's origin over the plane, along its normal
    residual: float  # [m] largest distance of a beam's footprint from the plane
    spread: float  # [m] between the outermost footprints: what the residual is to be judged by

    def slope(self, up_B: ArrayLike = (0.0, 0.0, 1.0)) -> float:
        """Angle [rad] of the ground to the horizontal, `up_B` (3,) being the vertical in hull axes."""
        up = checked(up_B, (3,), "up_B")
        return float(np.arccos(np.clip(self.normal_B @ up / np.linalg.norm(up), -1.0, 1.0)))


def janus_beams(angle: float = JANUS) -> Array:
    """Unit directions (4, 3) in hull axes of beams fore, port, aft and starboard, `angle` [rad] off straight down."""
    if not 0.0 < angle < 0.5 * np.pi:
        raise ConfigurationError(f"beams: their angle must lie in (0, pi/2), got {angle}")
    s, c = np.sin(angle), np.cos(angle)
    return readonly([[s, 0.0, -c], [0.0, s, -c], [-s, 0.0, -c], [0.0, -s, -c]])


def plane_from_ranges(ranges: ArrayLike, beams_B: ArrayLike | None = None, p_B: ArrayLike = (0, 0, 0)) -> GroundPlane:
    """The plane nearest (orthogonal least squares) to where the beams end.

    `ranges` (n,) [m] along `beams_B` (n, 3) from `p_B` (3,) [m]; NaN where a beam has lost the bottom. Raises
    PerceptionError if fewer than three beams, or beams in one line, are left.
    """
    beams = janus_beams() if beams_B is None else np.asarray(beams_B, dtype=np.float64)
    r = np.asarray(ranges, dtype=np.float64)
    if beams.ndim != 2 or beams.shape[1:] != (3,) or r.shape != (len(beams),):
        raise ConfigurationError(f"ranges: expected one [m] for each beam (n, 3), got {r.shape} and {beams.shape}")
    held = np.isfinite(r) & (r > 0.0)
    if held.sum() < 3:
        raise PerceptionError(f"no plane of the seabed: {held.sum()} of {len(r)} beams hold the bottom, 3 are needed")
    feet = checked(p_B, (3,), "p_B") + r[held, None] * beams[held]
    middle = feet.mean(axis=0)
    _, size, axes = np.linalg.svd(feet - middle)
    if size[1] < 1e-3 * max(size[0], 1e-9):
        raise PerceptionError("no plane of the seabed: the beams' footprints lie in one line")
    normal = axes[2] if axes[2] @ beams[held].mean(axis=0) < 0.0 else -axes[2]
    return GroundPlane(
        normal_B=readonly(normal),
        altitude=float(-normal @ middle),
        residual=float(np.abs((feet - middle) @ normal).max()),
        spread=float(np.linalg.norm(feet[:, None] - feet[None], axis=-1).max()),
    )
