"""Trajectories projected along the line of sight on two triangulated surfaces, the model's and the scan's.

Paper 002, eq. (2): points c_i in a plane across o = -(S - H_D)/|S - H_D| meet the surfaces in C_i and C'_i.
"""

from dataclasses import dataclass

import numpy as np

from models.meshes.ray_casting import RayScene
from perception.clouds.scan import jump, triangulate
from perception.registration.fine_fit import Evidence, ModelSurface
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, inverse, transform_points

ACROSS_EDGES = 1.5  # [px] that a ray is moved aside to find out whether it passes an edge
_RAY_STEP = 0.006  # [m] along the curves
_LINES = 8
_CIRCLES = (0.35, 0.7)  # of the object's reach


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaperQ:
    """The criterion of paper 002 as written, for one trajectory."""

    q_m: float  # [m] sqrt(sum |C_i - C'_i|^2) over the rays that meet both surfaces: it grows with their number
    rays: int  # that meet both
    missed: int  # of the trajectory's rays; the paper has no rule for them


def direction(points: Array) -> tuple[Array, Array]:
    """Centre of mass H_D (3,) [m] of the model's `points` (M, 3) [m] in S, and o (3,), the unit direction to it."""
    H_D = points.mean(axis=0)
    return H_D, H_D / np.linalg.norm(H_D)  # S is the origin: o = -(S - H_D)/|S - H_D|


def across(o: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) perpendicular to `o` (3,) and to each other."""
    u = np.cross(o, [0.0, 1.0, 0.0] if abs(o[1]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    return u, np.cross(o, u)


def curves(H_D: Array, o: Array, points: Array) -> Array:
    """Points c_i (N, 3) of lines and circles in a plane across `o`, before the object, that cross all of it."""
    reach = _reach(H_D, o, points)
    s = np.arange(-reach, reach + _RAY_STEP, _RAY_STEP)
    flat = [np.outer(s, [np.cos(angle), np.sin(angle)]) for angle in np.linspace(0.0, np.pi, _LINES, endpoint=False)]
    flat += [_circle(share * reach, max(8, round(2.0 * np.pi * share * reach / _RAY_STEP))) for share in _CIRCLES]
    return _in_plane(H_D, o, points, np.vstack(flat))


def paper_q(evidence: Evidence, surface: ModelSurface, X_ST: Array, curve: str = "line", n: int = 50) -> PaperQ:
    """Q of eq. (2) at the pose `X_ST` (4, 4), of `n` points on a "line" across the object or a "circle" on it.

    For comparison with `perception.registration.pose_check`, which decides. Raises ConfigurationError for another
    `curve` or n < 2.
    """
    if curve not in ("line", "circle") or n < 2:
        raise ConfigurationError(f"check trajectory: expected 'line' or 'circle' of n >= 2 points, got {curve!r}, {n}")
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if not visible.any():
        return PaperQ(q_m=0.0, rays=0, missed=n)
    points = transform_points(X_ST, surface.points[visible])
    H_D, o = direction(points)
    reach = _reach(H_D, o, points)
    flat = np.outer(np.linspace(-reach, reach, n), [1.0, 0.0]) if curve == "line" else _circle(0.5 * reach, n)
    starts = _in_plane(H_D, o, points, flat)
    X_TS = inverse(X_ST)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    C_model = surface.scene.cast(transform_points(X_TS, starts), way)["t"]
    part = evidence.scan.part(evidence.scan.window(points, 0.05, 10**6))
    vertices, triangles = triangulate(part, part.depth > 0.0)
    C_scan = np.full(n, np.inf)
    if len(triangles):
        scene = RayScene(vertices, triangles)
        C_scan = scene.cast(starts, np.broadcast_to(o, starts.shape))["t"]
    both = np.isfinite(C_model) & np.isfinite(C_scan)
    E = C_scan[both] - C_model[both]
    return PaperQ(q_m=float(np.sqrt(np.sum(E**2))), rays=int(both.sum()), missed=int((~both).sum()))


def clear_of_edges(surface: ModelSurface, X_TS: Array, starts: Array, t: Array, o: Array, margin: float) -> np.ndarray:
    """Mask (N,) of the rays that meet the same face of the model when moved aside by `margin` [m].

    `starts` (N, 3) [m] and `o` (3,) in S, `t` (N,) [m] to the model along o.
    """
    clear = np.ones(len(starts), dtype=bool)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    u, v = across(o)
    for aside in (u, -u, v, -v):
        beside = surface.scene.cast(transform_points(X_TS, starts + margin * aside), way)["t"]
        with np.errstate(invalid="ignore"):
            clear &= np.abs(beside - t) < jump(0.0) + 3.0 * margin
    return clear


def _circle(radius: float, n: int) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _reach(H_D: Array, o: Array, points: Array) -> float:
    """Distance [m] of the outermost of `points` (M, 3) from the line through H_D along `o`."""
    offset = points - H_D
    return float(np.linalg.norm(offset - np.outer(offset @ o, o), axis=1).max())


def _in_plane(H_D: Array, o: Array, points: Array, flat: Array) -> Array:
    """Points (N, 3) [m] in S for `flat` (N, 2) [m] in a plane across `o` that lies before all of `points`."""
    before = min(float(((points - H_D) @ o).min()) - 0.3, -0.05)
    return H_D + before * o + flat @ np.stack(across(o))
