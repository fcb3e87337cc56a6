"""Tool path over an unknown seabed: vertical profiles between targets, tool axes, spline.

The surface is cut by the planes through A_i A_i+1 and z. The points T_j are at the crossings of a
plane with the edges of triangles. Each has the unit axes a_j (of the tool, into the ground) and n_j
(along the path) [Konoplin 2019, section 1].
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.spatial import cKDTree

from uuv.perception.seabed.relief import Relief, ReliefLimits, relief
from uuv.perception.seabed.terrain import Projection, Terrain, build_terrain, project
from uuv.perception.seabed.tool_width import checked_width
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, finite_number, readonly, real_array

_DENSE = 0.003  # [m] spacing of the points to which the spline is fitted
_KNOTS = 0.02  # [m] spacing of the knots of the spline
_PINNED = 1e3  # [-] weight of the targets, through which the spline must pass
_BARE = 1e-6  # [m] longest part of a profile without surface


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """Cut of the surface from target to target, in S."""

    T: Array  # (m, 3) [m] targets and the points between them, in order
    a: Array  # (m, 3) unit tool axis, into the ground
    n: Array  # (m, 3) unit, along the path, perpendicular to a
    target: np.ndarray  # (m,) bool: T_j is one of the targets A_i


def profile(terrain: Terrain, A: ArrayLike, width: float = 0.1) -> Profile:
    """Cut the terrain by the vertical planes through successive targets.

    Args:
        terrain: Triangulated seabed.
        A: (s, 3) [m] targets on it, in S.
        width: [m] width of the tool; the tool axes are the normals of the ground, averaged over
            this width.

    Returns:
        The profile in S.

    Raises:
        ConfigurationError: There are fewer than two targets, or two are at the same position.
        PerceptionError: A hole of the cloud is between two targets.
    """
    targets = real_array(A, "profile: targets", "(s, 3) numbers")
    if (
        targets.ndim != 2
        or targets.shape[1:] != (3,)
        or len(targets) < 2
        or not np.all(np.isfinite(targets))
    ):
        raise ConfigurationError(
            f"profile: must be at least two finite targets (s, 3), got shape {targets.shape}"
        )

    width = checked_width(width)
    ground = terrain.ground(terrain.vertices)
    ends = terrain.ground(targets)
    points = []
    along = []
    flags = []

    # Targets, with the points between them
    for i in range(len(ends) - 1):
        cut, way = _cut(ground, terrain.triangles, ends[i], ends[i + 1], f"A_{i + 1}", f"A_{i + 2}")
        points += [ends[i : i + 1], cut]
        along.append(np.broadcast_to(way, (1 + len(cut), 2)))
        flags += [True] + [False] * len(cut)
    points.append(ends[-1:])
    along.append(along[-1][-1:])

    # Axes: normals over the tool's width, and the path's direction across them
    T = np.concatenate(points)
    normal = _normals(ground, T, max(0.5 * width, 2.0 * terrain.spacing))
    way = np.column_stack([np.concatenate(along), np.zeros(len(T))])
    n = way - np.einsum("ij,ij->i", way, normal)[:, None] * normal
    n /= np.linalg.norm(n, axis=1, keepdims=True)

    R = terrain.R_ground
    return Profile(
        T=readonly(T @ R),
        a=readonly(-normal @ R),
        n=readonly(n @ R),
        target=np.array([*flags, True]),
    )


def _cut(
    ground: Array, triangles: np.ndarray, start: Array, end: Array, first: str, second: str
) -> tuple[Array, Array]:
    """Points (k, 3) where edges cross the vertical plane between two targets; direction (2,)."""
    length = float(np.linalg.norm(end[:2] - start[:2]))
    if length < 1e-6:
        raise ConfigurationError(
            f"profile: {first} and {second} have the same horizontal position and define no "
            "vertical plane"
        )

    way = (end[:2] - start[:2]) / length

    # Triangles on both sides of the plane, and their two edges that cross it
    offset = ground[:, :2] - start[:2]
    aside = offset[:, 1] * way[0] - offset[:, 0] * way[1]
    u = offset @ way
    left = aside >= 0.0
    crossed = triangles[(left[triangles].any(axis=1)) & (~left[triangles]).any(axis=1)]
    edges = np.sort(crossed[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3, 2), axis=2)
    # the plane crosses two of the three edges of each triangle
    cuts = left[edges[..., 0]] != left[edges[..., 1]]
    pairs = edges[cuts].reshape(-1, 2, 2)

    # Crossings, as positions along the plane
    a = pairs[..., 0]
    b = pairs[..., 1]
    share = aside[a] / (aside[a] - aside[b])
    # (k, 2) [m] first and last position of the plane in each triangle
    at = u[a] + share * (u[b] - u[a])
    _check_covered(at, length, first, second)

    # In order along the plane; an edge of two triangles is used once
    edge, index = np.unique(pairs.reshape(-1, 2), axis=0, return_index=True)
    s = at.reshape(-1)[index]
    p = ground[edge[:, 0]] + share.reshape(-1)[index, None] * (
        ground[edge[:, 1]] - ground[edge[:, 0]]
    )
    within = (s > 1e-6) & (s < length - 1e-6)
    order = np.argsort(s[within])
    s = s[within][order]
    p = p[within][order]
    return p[np.diff(s, prepend=0.0) > 1e-6], way  # edges that meet in one vertex give one point


def _check_covered(at: Array, length: float, first: str, second: str) -> None:
    """Refuse a plane that leaves the surface between its targets."""
    # Farthest position covered so far, compared with the beginning of the next triangle
    low, high = at.min(axis=1), at.max(axis=1)
    order = np.argsort(low)
    reached = np.maximum.accumulate(np.concatenate([[0.0], high[order]]))
    begins = np.concatenate([low[order], [length]])
    inside = (reached < length - _BARE) & (begins > reached + _BARE)

    if inside.any():
        hole = int(inside.argmax())
        size = min(begins[hole], length) - reached[hole]
        raise PerceptionError(
            f"profile: between {first} and {second} a hole in the cloud {size:.2f} m long begins "
            f"{reached[hole]:.2f} m from {first}"
        )


def _normals(ground: Array, T: Array, radius: float) -> Array:
    """Upward unit normals (m, 3) of planes through the vertices within `radius` [m] of each T."""
    tree = cKDTree(ground[:, :2])
    normal = np.empty((len(T), 3))
    for j, near in enumerate(tree.query_ball_point(T[:, :2], radius)):
        if len(near) < 6:
            near = tree.query(T[j, :2], k=min(6, len(ground)))[1]
        patch = ground[near] - ground[near].mean(axis=0)
        slope = np.linalg.lstsq(patch[:, :2], patch[:, 2], rcond=None)[0]
        normal[j] = [-slope[0], -slope[1], 1.0]
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def smooth_path(cut: Profile, spacing: float = 0.0015) -> ToolPath:
    """Cubic B-spline through the targets of a profile, sampled every `spacing` [m] of length."""
    # Dense polyline through the profile, fixed at the targets
    spacing = finite_number(spacing, "spacing [m]", least=1e-5)
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(cut.T, axis=0), axis=1))])
    fine = np.union1d(np.linspace(0.0, u[-1], max(16, 1 + round(u[-1] / _DENSE))), u[cut.target])
    weight = np.where(np.isin(fine, u[cut.target]), _PINNED, 1.0)
    p, a, n = (
        np.column_stack([np.interp(fine, u, column) for column in rows.T])
        for rows in (cut.T, cut.a, cut.n)
    )

    curve, axis, ahead = (_spline(fine, rows, weight) for rows in (p, a, n))

    # Evenly spaced by length along the curve
    dense = np.linspace(0.0, u[-1], max(64, 4 * round(u[-1] / spacing)))
    length = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(curve(dense), axis=0), axis=1))]
    )
    s = np.linspace(0.0, length[-1], max(8, 1 + round(length[-1] / spacing)))
    at = np.interp(s, length, dense)

    # Axes of unit length, perpendicular to each other
    z = axis(at)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = ahead(at)
    x -= np.einsum("ij,ij->i", x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)

    on_scan = np.ones(len(s), dtype=bool)
    on_scan.setflags(write=False)
    return ToolPath(
        s=readonly(s), p=readonly(curve(at)), z=readonly(z), x=readonly(x), on_scan=on_scan
    )


def _spline(u: Array, values: Array, weight: Array) -> BSpline:
    count = max(1, min(int(u[-1] / _KNOTS), (len(u) - 4) // 2))
    inner = np.linspace(0.0, u[-1], count + 1)[1:-1]
    return make_lsq_spline(
        u, values, np.concatenate([[0.0] * 4, inner, [u[-1]] * 4]), k=3, w=weight
    )


def core_path(A: Array, a: Array, n: Array, depth: float) -> ToolPath:
    """Straight path of a core sampler into the ground.

    Args:
        A: (3,) [m] target on the surface, in S.
        a: (3,) unit tool axis, into the ground.
        n: (3,) unit second axis, x of the path.
        depth: [m] along `a`.

    Returns:
        The path in S, from the surface downwards.

    Raises:
        ConfigurationError: The depth is outside (0, 10] m.
    """
    depth = finite_number(depth, "core depth [m]", above=0.0, most=10.0)
    s = np.linspace(0.0, depth, max(4, 1 + round(depth / 0.005)))
    ones = np.ones((len(s), 1))
    scanned = np.ones(len(s), dtype=bool)
    scanned.setflags(write=False)
    return ToolPath(
        s=readonly(s),
        p=readonly(A + s[:, None] * a),
        z=readonly(ones * a),
        x=readonly(ones * n),
        on_scan=scanned,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeabedPlan:
    """All results from the cloud to the path, in S."""

    terrain: Terrain
    targets: Projection
    relief: Relief
    profile: Profile | None  # None for a single target
    path: ToolPath | None
    duration_s: float  # [s] computing time


def plan_seabed_work(
    cloud: ArrayLike,
    B: ArrayLike,
    z: ArrayLike = (0.0, 0.0, 1.0),
    *,
    width: float = 0.1,
    patch: float = 0.15,
    limits: ReliefLimits | None = None,
) -> SeabedPlan:
    """Plan a tool path on the seabed from a cloud and the points over it.

    The relief is checked within `patch` of the targets and of the profile between them.

    Args:
        cloud: (n, 3) [m] points in S.
        B: (s, 3) [m] points over the seabed in S, projected down on it.
        z: (3,) vertical in S.
        width: [m] width of the tool.
        patch: [m] radius of the patch whose relief is checked.
        limits: Limits of the relief; None: `ReliefLimits()`.

    Returns:
        Terrain, projected targets, relief, profile and path. The last two are None for a single
        target.

    Raises:
        ConfigurationError: An argument has a wrong type or shape.
        PerceptionError: The cloud is bad, there is a hole under a target or on the path, or the
            relief is beyond `limits`.
    """
    began = time.perf_counter()
    width = checked_width(width)
    if limits is not None and not isinstance(limits, ReliefLimits):
        raise ConfigurationError(f"limits: expected ReliefLimits, got {type(limits).__name__}")
    patch = finite_number(patch, "patch [m]", above=0.0, most=100.0)

    # From the cloud to the profile
    terrain = build_terrain(cloud, z)
    targets = project(terrain, B)
    cut = profile(terrain, targets.A, width) if len(targets.A) > 1 else None

    site = relief(terrain, targets.A if cut is None else cut.T, patch, limits)
    if not site.suitable:
        raise PerceptionError(site.reason)

    path = None if cut is None else smooth_path(cut)
    return SeabedPlan(
        terrain=terrain,
        targets=targets,
        relief=site,
        profile=cut,
        path=path,
        duration_s=time.perf_counter() - began,
    )
