"""Trajectories projected along the line of sight on the triangulated surfaces of model and scan [Konoplin 2022, eq. 2].

Points c_i in a plane perpendicular to o = -(S - H_D)/|S - H_D| meet the model and the scan in C_i and C'_i.
"""

from dataclasses import dataclass

import numpy as np

from models.meshes.ray_casting import RayScene
from perception.clouds.scan import jump, triangulate
from perception.registration.fine_fit import Evidence, ModelSurface
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, inverse, transform_points

ACROSS_EDGES = 1.5  # [px] by which a ray is moved aside to detect a nearby edge
_RAY_STEP = 0.006  # [m] between rays along the curves
_LINES = 8  # straight lines through the centre, evenly distributed over 180 deg
_CIRCLES = (0.35, 0.7)  # [-] radii as a share of the object's extent across the line of sight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PublishedCriterion:
    """The published criterion of one trajectory, unchanged [Konoplin 2022, eq. 2]."""

    q_m: float  # [m] sqrt(sum |C_i - C'_i|^2) over rays that meet both surfaces: it grows with their number
    rays: int  # rays that meet both surfaces
    missed: int  # the other rays of the trajectory; the published criterion has no rule for them


def direction(points: Array) -> tuple[Array, Array]:
    """Centroid H_D (3,) [m] of the model points (m, 3) [m] in S, and the unit line of sight o (3,) towards it."""
    H_D = points.mean(axis=0)
    return H_D, H_D / np.linalg.norm(H_D)  # S is the origin: o = -(S - H_D)/|S - H_D|


def across(o: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) perpendicular to `o` (3,) and to each other."""
    u = np.cross(o, [0.0, 1.0, 0.0] if abs(o[1]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    return u, np.cross(o, u)


def curves(H_D: Array, o: Array, points: Array) -> Array:
    """Points c_i of lines and circles in a plane perpendicular to `o`, in front of the object, across all of it.

    Args:
        H_D: (3,) [m] centroid of the visible model in S.
        o: (3,) unit line of sight.
        points: (m, 3) [m] visible model points in S.

    Returns:
        Points (n, 3) [m] in S.
    """
    reach = _reach(H_D, o, points)
    s = np.arange(-reach, reach + _RAY_STEP, _RAY_STEP)
    flat = [np.outer(s, [np.cos(angle), np.sin(angle)]) for angle in np.linspace(0.0, np.pi, _LINES, endpoint=False)]
    flat += [_circle(share * reach, max(8, round(2.0 * np.pi * share * reach / _RAY_STEP))) for share in _CIRCLES]
    return _in_plane(H_D, o, points, np.vstack(flat))


def published_criterion(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, curve: str = "line", n: int = 50
) -> PublishedCriterion:
    """Published criterion Q at the pose `X_ST`, for comparison with `perception.registration.pose_check`.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.
        curve: "line" across the object or "circle" on it.
        n: Number of points of the curve.

    Returns:
        Q [m] and the number of rays that it is made of [Konoplin 2022, eq. 2].

    Raises:
        ConfigurationError: For another `curve` or n < 2.
    """
    if curve not in ("line", "circle") or n < 2:
        raise ConfigurationError(f"check trajectory: expected 'line' or 'circle' of n >= 2 points, got {curve!r}, {n}")
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if not visible.any():
        return PublishedCriterion(q_m=0.0, rays=0, missed=n)
    points = transform_points(X_ST, surface.points[visible])
    H_D, o = direction(points)
    reach = _reach(H_D, o, points)
    flat = np.outer(np.linspace(-reach, reach, n), [1.0, 0.0]) if curve == "line" else _circle(0.5 * reach, n)
    starts = _in_plane(H_D, o, points, flat)
    X_TS = inverse(X_ST)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    C_model = surface.scene.distance(transform_points(X_TS, starts), way)
    part = evidence.scan.part(evidence.scan.window(points, 0.05, 10**6))
    vertices, triangles = triangulate(part, part.depth > 0.0)
    C_scan = np.full(n, np.inf)
    if len(triangles):
        scene = RayScene(vertices, triangles)
        C_scan = scene.distance(starts, np.broadcast_to(o, starts.shape))
    both = np.isfinite(C_model) & np.isfinite(C_scan)
    E = C_scan[both] - C_model[both]
    return PublishedCriterion(q_m=float(np.sqrt(np.sum(E**2))), rays=int(both.sum()), missed=int((~both).sum()))


def clear_of_edges(surface: ModelSurface, X_TS: Array, starts: Array, t: Array, o: Array, margin: float) -> np.ndarray:
    """Mask (n,) of the rays that meet the same face of the model when moved aside by `margin`.

    Args:
        surface: Sampled model.
        X_TS: (4, 4) pose of S in T.
        starts: (n, 3) [m] start points of the rays in S.
        t: (n,) [m] distance to the model along `o`.
        o: (3,) unit direction of the rays in S.
        margin: [m] by which each ray is moved to four sides.

    Returns:
        Mask (n,).
    """
    clear = np.ones(len(starts), dtype=bool)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    u, v = across(o)
    for aside in (u, -u, v, -v):
        beside = surface.scene.distance(transform_points(X_TS, starts + margin * aside), way)
        with np.errstate(invalid="ignore"):
            clear &= np.abs(beside - t) < jump(0.0) + 3.0 * margin
    return clear


def _circle(radius: float, n: int) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _reach(H_D: Array, o: Array, points: Array) -> float:
    """Distance [m] of the outermost of `points` (m, 3) from the line through H_D along `o`."""
    offset = points - H_D
    return float(np.linalg.norm(offset - np.outer(offset @ o, o), axis=1).max())


def _in_plane(H_D: Array, o: Array, points: Array, flat: Array) -> Array:
    """Lift `flat` (n, 2) [m] into a plane perpendicular to `o`, in front of all `points`: (n, 3) [m] in S."""
    before = min(float(((points - H_D) @ o).min()) - 0.3, -0.05)
    return H_D + before * o + flat @ np.stack(across(o))
