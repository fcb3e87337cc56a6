"""Published criterion of a fitted pose [Konoplin 2022, eq. 2], for comparison with `pose_check`.

Points c_i in a plane perpendicular to o = -(S - H_D)/|S - H_D| are projected along o on the
triangulated surfaces of model and scan of the object. The projected points are C_i and C'_i.
"""

from dataclasses import dataclass, replace

import numpy as np

from uuv.perception.clouds.scan import distances_along
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.projection.trajectories import (
    circle,
    direction,
    in_plane,
    lateral_reach,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, inverse, transform_points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PublishedCriterion:
    """The published criterion of one trajectory, unchanged [Konoplin 2022, eq. 2]."""

    # [m] sqrt(sum |C_i - C'_i|^2) over rays that meet both surfaces, which grows with the number of
    # rays
    q_m: float
    rays: int  # rays that meet both surfaces
    # number of other rays of the trajectory, for which the published criterion has no rule
    missed: int


def published_criterion(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, curve: str = "line", n: int = 50
) -> PublishedCriterion:
    """Published criterion Q at the pose `X_ST`, for comparison with `pose_check`.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.
        curve: "line" across the object or "circle" on it.
        n: Number of points of the curve.

    Returns:
        Q [m] and the number of rays in it [Konoplin 2022, eq. 2].

    Raises:
        ConfigurationError: `curve` has another value, or n < 2.
    """
    if curve not in ("line", "circle") or n < 2:
        raise ConfigurationError(
            f"check trajectory: must be 'line' or 'circle' with n >= 2 points, got {curve!r} with "
            f"n = {n}"
        )
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if not visible.any():
        return PublishedCriterion(q_m=0.0, rays=0, missed=n)

    # Trajectory of points c_i
    points = transform_points(X_ST, surface.points[visible])
    H_D, o = direction(points)
    reach = lateral_reach(H_D, o, points)
    flat = (
        np.outer(np.linspace(-reach, reach, n), [1.0, 0.0])
        if curve == "line"
        else circle(0.5 * reach, n)
    )
    starts = in_plane(H_D, o, points, flat)

    # Projections on the model and on the scan of the object
    X_TS = inverse(X_ST)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    C_model = surface.scene.distance(transform_points(X_TS, starts), way)
    # the object is extracted from its surroundings
    of_object = np.where(evidence.mask[..., None], evidence.scan.points, np.nan)
    scan = replace(evidence.scan, points=of_object)
    part = scan.part(scan.window(points, 0.05, 10**6))
    C_scan = distances_along(part, starts, o)
    if C_scan is None:
        return PublishedCriterion(q_m=0.0, rays=0, missed=n)

    # Q over the rays that meet both
    both = np.isfinite(C_model) & np.isfinite(C_scan)
    E = C_scan[both] - C_model[both]
    return PublishedCriterion(
        q_m=float(np.sqrt(np.sum(E**2))), rays=int(both.sum()), missed=int((~both).sum())
    )
