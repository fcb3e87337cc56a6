"""Tool paths on any model: analytic curves laid on its mesh, cuts of the mesh by planes, and lists of points with axes.

A curve is points (N, 3) [m] in the model's frame T, near the surface. `laid_on` projects it along a direction by rays
(Moller and Trumbore; paper 004, eq. 1 to 4), `cut` follows the surface in a plane (paper 004, section 1). What comes
out is a ModelPath like those that the objects bring along: add it with `TargetModel.with_path`.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage
from scipy.interpolate import make_interp_spline

from models.meshes.ray_casting import RayScene
from models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    exp_so3,
    finite_number,
    number,
    real_array,
    unit_vector,
)

_GRAZING = np.cos(np.deg2rad(70.0))  # cosine between a ray and the normal below which a projection says nothing
_STEEPEST = 4.0  # [m]/[m] between neighbours on the surface and on the curve; more is a fall off an edge
_FOOTPRINT = 0.01  # [m] around the path, over which normals are averaged
_NEAR = 1e-9  # [m]
_FARTHEST = 1e3  # [m] of a path from the middle of its object: more is another unit
_MOST_TURN, _MOST_LINES = 1e3, 10_000  # [rad] of a helix; of a raster


def line(start: ArrayLike, end: ArrayLike) -> Array:
    """Points (N, 3) [m] from `start` to `end` (3,)."""
    a, b = _place(start, "line: start"), _place(end, "line: end")
    length = float(np.linalg.norm(b - a))
    if not length > _NEAR:
        raise ConfigurationError("line: start and end coincide")
    return a + np.linspace(0.0, 1.0, _count(length))[:, None] * (b - a)


def circle(
    center: ArrayLike, axis: ArrayLike, start: ArrayLike, angle: float = 2.0 * np.pi, rise: float = 0.0
) -> Array:
    """Points (N, 3) [m] of an arc of `angle` [rad], right-handed about `axis` through `center`, from the point `start`.

    With `rise` [m] along the axis by its end it is a helix; more than a turn is allowed.
    """
    c, p = _place(center, "circle: center"), _place(start, "circle: start")
    angle, rise = number(angle, "circle: angle [rad]"), number(rise, "circle: rise [m]")
    w = unit_vector(axis, "circle: axis")
    arm = (p - c) - w * (w @ (p - c))
    radius = float(np.linalg.norm(arm))
    if not radius > _NEAR:
        raise ConfigurationError("circle: the start lies on the axis")
    if not (abs(angle) < _MOST_TURN and abs(rise) <= _FARTHEST and angle != 0.0 and np.isfinite(rise)):
        raise ConfigurationError(
            f"circle: angle must not be zero, and below {_MOST_TURN:g} rad, rise below {_FARTHEST:g} m; got "
            f"{angle} rad, {rise} m"
        )
    share = np.linspace(0.0, 1.0, _count(float(np.hypot(radius * angle, rise))))
    turned = np.array([exp_so3(angle * u * w) @ arm for u in share])
    return p - arm + turned + (share * rise)[:, None] * w


def raster(center: ArrayLike, along: ArrayLike, across: ArrayLike, pitch: float) -> Array:
    """Points (N, 3) [m] of a way to and fro over a flat patch, with half circles between its lines.

    `along` and `across` (3,) [m] are the patch's edges, perpendicular, around its `center`; the lines run along
    `along`, the half circles lie beyond its ends. Lines are at most `pitch` [m] apart.
    """
    c, u, v = (
        _place(value, f"raster: {name}") for value, name in ((center, "center"), (along, "along"), (across, "across"))
    )
    length, width = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    if not (length > _NEAR and width > _NEAR and abs(u @ v) < 1e-6 * length * width):
        raise ConfigurationError("raster: along and across must be perpendicular and not zero")
    pitch = finite_number(pitch, "raster: pitch [m]", above=0.0)
    if width / pitch > _MOST_LINES:
        raise ConfigurationError(f"raster: pitch must give at most {_MOST_LINES} lines, got {pitch} m on {width:g} m")
    lines = 1 + max(1, int(np.ceil(width / pitch - 1e-9)))
    pitch = width / (lines - 1)
    parts, turn = [], np.linspace(0.0, np.pi, _count(0.5 * np.pi * pitch))[1:-1, None]
    for i in range(lines):
        way, begin = (1.0 if i % 2 == 0 else -1.0), c - 0.5 * v + i * pitch * v / width
        parts.append(line(begin - 0.5 * way * u, begin + 0.5 * way * u))
        if i < lines - 1:
            middle = begin + 0.5 * way * u + 0.5 * pitch * v / width
            parts.append(middle + 0.5 * pitch * (np.sin(turn) * way * u / length - np.cos(turn) * v / width))
    return np.vstack(parts)


def laid_on(target: TargetModel, curve: ArrayLike, direction: ArrayLike, *, before: float = 0.5) -> ModelPath:
    """`curve` (N, 3) [m] in T, projected on the mesh of `target` along `direction`, and the surface's normals there.

    `direction`: (3,), or (N, 3) one for each point, as towards the axis of a pipe. Rays begin `before` [m] ahead of
    the curve and take the first surface that they meet. The tool axis is the inward normal, averaged over a footprint
    of 1 cm. Raises ConfigurationError where a ray misses, meets the surface at more than 70 deg, or the path falls
    off an edge.
    """
    points = _points(curve, "curve")
    ways = real_array(direction, "direction")
    before = finite_number(before, "before [m]", least=0.0, most=_FARTHEST)
    if ways.shape not in ((3,), points.shape) or not np.all(np.isfinite(ways)):
        raise ConfigurationError(f"direction: expected (3,) or {points.shape} numbers, got shape {ways.shape}")
    ways = ways / np.maximum(np.abs(ways).max(axis=-1, keepdims=True), 1e-9)
    length = np.linalg.norm(ways, axis=-1, keepdims=True)
    if not np.all(length > _NEAR):
        raise ConfigurationError("direction: must not be zero")
    ways = np.broadcast_to(ways / length, points.shape)
    scene = RayScene(target.vertices, target.triangles)
    b = _tangents(points)
    aside = np.cross(ways, b)
    starts = points - before * ways
    hit = scene.cast(starts, ways)
    missed = np.flatnonzero(~np.isfinite(hit["t"]))
    if len(missed):
        raise ConfigurationError(
            f"path on {target.name!r}: {len(missed)} of {len(points)} rays miss it, the first from "
            f"{np.round(points[missed[0]], 3).tolist()}"
        )
    p = starts + hit["t"][:, None] * ways
    steps, wanted = (np.linalg.norm(np.diff(values, axis=0), axis=1) for values in (p, points))
    fall = np.flatnonzero(steps > _STEEPEST * wanted)
    if len(fall):
        raise ConfigurationError(
            f"path on {target.name!r}: it falls off an edge after {np.round(p[fall[0]], 3).tolist()}, by "
            f"{1e3 * steps[fall[0]]:.0f} mm"
        )
    normals = np.zeros_like(p)
    for side in (-1.0, 0.0, 1.0):
        near = scene.cast(starts + side * _FOOTPRINT * aside, ways)
        same = np.isfinite(near["t"]) & (np.abs(near["t"] - hit["t"]) < _STEEPEST * _FOOTPRINT)
        facing = near["normal"] * -np.sign(np.einsum("ij,ij->i", near["normal"], ways))[:, None]
        normals[same] += facing[same]
    return _path(p, -_averaged(normals, p), f"path on {target.name!r}", ways)


def cut(target: TargetModel, start: ArrayLike, end: ArrayLike, direction: ArrayLike) -> ModelPath:
    """The profile of `target` between two points, in the plane through both and `direction` (paper 004, section 1).

    `start`, `end` (3,) [m] in T are projected along `direction` (3,) on the mesh (A_i, A_i+1); the path is where the
    plane cuts the triangles between them (T_j). Raises ConfigurationError where they miss the mesh, or no unbroken
    profile joins them that faces against `direction`.
    """
    way = unit_vector(direction, "direction")
    ends = laid_on(target, line(start, end), way).p[[0, -1]]  # raises where the profile is broken
    chord = ends[1] - ends[0]
    normal = np.cross(chord, way)
    if not np.linalg.norm(normal) > 1e-6:
        raise ConfigurationError("cut: start and end lie one behind the other along the direction")
    normal /= np.linalg.norm(normal)
    along = np.cross(way, normal)
    along *= np.sign(along @ chord)
    corners = np.asarray(target.vertices)[target.triangles]
    side = (corners - ends[0]) @ normal
    side = np.where(np.abs(side) < 1e-9, 1e-9, side)  # a corner in the plane counts to one side: no lost crossings
    t: list[Array] = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        rows = np.flatnonzero(side[:, i] * side[:, j] < 0.0)
        share = side[rows, i] / (side[rows, i] - side[rows, j])
        t.append(corners[rows, i] + share[:, None] * (corners[rows, j] - corners[rows, i]))
    crossings = np.vstack(t)
    reach = (crossings - ends[0]) @ along
    crossings = crossings[(reach > 0.0) & (reach < chord @ along)]
    # Of what lies in the plane, the part that a ray along the direction meets first.
    scene = RayScene(target.vertices, target.triangles)
    ahead = float(np.ptp(corners.reshape(-1, 3) @ way)) + 0.1
    first = scene.cast(crossings - ahead * way, np.broadcast_to(way, crossings.shape))["t"]
    crossings = crossings[np.abs(first - ahead) < 1e-4]
    points = np.vstack([ends[0], crossings[np.argsort((crossings - ends[0]) @ along)], ends[1]])
    return laid_on(target, _respaced(points), way, before=0.05)


def through(points: ArrayLike, axes: ArrayLike, along: ArrayLike | None = None) -> ModelPath:
    """A path through a list of points (N, 3) [m] in T, N >= 4, with the tool's axes (N, 3) into the surface.

    `along` (N, 3): the second axis; by default the path's own direction, made perpendicular to the first. Between the
    points a cubic spline. Raises ConfigurationError for numbers that are not finite, neighbours that coincide, axes
    that are zero or, between neighbours, opposite, or an axis along the path.
    """
    p = _points(points, "points")
    a = checked(axes, p.shape, "axes")
    size = np.linalg.norm(a, axis=1)
    if not np.all(size > _NEAR):
        raise ConfigurationError(f"axes: row {int(size.argmin())} is zero")
    a = a / size[:, None]
    turned = np.einsum("ij,ij->i", a[:-1], a[1:])
    if turned.min() < 0.0:
        raise ConfigurationError(f"axes: rows {int(turned.argmin())} and {int(turned.argmin()) + 1} point apart")
    u = _chords(p, "points")
    fine = np.linspace(0.0, u[-1], max(_count(float(u[-1])), len(p)))
    dense, axis = make_interp_spline(u, p, k=3)(fine), make_interp_spline(u, a, k=1)(fine)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    if along is None:
        return _path(dense, axis, "points", axis)
    b = make_interp_spline(u, checked(along, p.shape, "along"), k=1)(fine)
    return ModelPath(p=dense, a=axis, b=_across(b, axis, "along"))


def joined(paths: Sequence[ModelPath]) -> ModelPath:
    """Paths one after another as one. Raises ConfigurationError where one does not begin where the last ends."""
    for i, (first, then) in enumerate(pairwise(paths)):
        gap = float(np.linalg.norm(then.p[0] - first.p[-1]))
        if gap > 2.0 * PATH_STEP:
            raise ConfigurationError(f"paths {i} and {i + 1} are {1e3 * gap:.0f} mm apart")
    p = np.vstack([path.p for path in paths])
    keep = np.concatenate([[True], np.linalg.norm(np.diff(p, axis=0), axis=1) > 0.2 * PATH_STEP])
    a, b = (np.vstack([getattr(path, name) for path in paths])[keep] for name in ("a", "b"))
    return ModelPath(p=p[keep], a=a, b=b)


def _count(length: float) -> int:
    """Points of a curve of `length` [m]."""
    return max(4, 1 + round(abs(length) / PATH_STEP))


def _place(values: ArrayLike, name: str) -> Array:
    return checked_place(values, (3,), name, _FARTHEST)


def _points(values: ArrayLike, name: str) -> Array:
    points = real_array(values, name, "(N, 3) numbers [m]")
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
        raise ConfigurationError(f"{name}: expected (N, 3) numbers [m], N >= 4, got shape {points.shape}")
    if not np.all(np.isfinite(points)):
        raise ConfigurationError(f"{name}: row {int(np.argmin(np.isfinite(points).all(axis=1)))} is not finite")
    _chords(checked_place(points, points.shape, name, _FARTHEST), name)
    return points


def _chords(points: Array, name: str) -> Array:
    """Length (N,) [m] along the polyline. Raises ConfigurationError where neighbours coincide."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if steps.min() < _NEAR:
        raise ConfigurationError(f"{name}: rows {int(steps.argmin())} and {int(steps.argmin()) + 1} coincide")
    return np.concatenate([[0.0], np.cumsum(steps)])


def _respaced(points: Array) -> Array:
    """Points on the polyline, PATH_STEP apart."""
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])
    points = points[keep]
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.linspace(0.0, u[-1], _count(float(u[-1])))
    return np.column_stack([np.interp(even, u, points[:, i]) for i in range(3)])


def _tangents(points: Array) -> Array:
    tangents = np.gradient(points, axis=0)
    return tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), _NEAR)


def _averaged(normals: Array, p: Array) -> Array:
    """Normals (N, 3) averaged along the path over the footprint."""
    step = float(np.linalg.norm(np.diff(p, axis=0), axis=1).mean())
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    smooth = ndimage.gaussian_filter1d(normals / np.maximum(size, _NEAR), _FOOTPRINT / step, axis=0, mode="nearest")
    return smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), _NEAR)


def _path(p: Array, a: Array, name: str, ways: Array) -> ModelPath:
    """The path with its own direction for b. Raises ConfigurationError where a ray along `ways` grazes the surface."""
    cosine = np.einsum("ij,ij->i", a, ways)
    if cosine.min() < _GRAZING:
        i = int(cosine.argmin())
        raise ConfigurationError(
            f"{name}: at {np.round(p[i], 3).tolist()} the surface lies along the direction of projection "
            f"({np.degrees(np.arccos(np.clip(cosine[i], -1.0, 1.0))):.0f} deg off, limit 70)"
        )
    return ModelPath(p=p, a=a, b=_across(_tangents(p), a, name))


def _across(b: Array, a: Array, name: str) -> Array:
    """Unit vectors along `b`, made perpendicular to `a`."""
    flat = b - np.einsum("ij,ij->i", a, b)[:, None] * a
    size = np.linalg.norm(flat, axis=1)
    if not np.all(size > 0.1 * np.linalg.norm(b, axis=1)):
        raise ConfigurationError(f"{name}: at row {int(size.argmin())} the tool axis lies along the path")
    return flat / size[:, None]
