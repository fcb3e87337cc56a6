"""Tool paths on any model: curves projected on the model's mesh, cuts by planes, lists of points.

A curve is points (n, 3) [m] in the model's frame T, near the surface. `laid_on` projects it along a
direction by ray casting [Moller 1997], [Konoplin 2019, eq. 1 to 4]. `cut` follows the surface in a
plane [Konoplin 2019, section 1]. The result is a ModelPath like those of the objects: add it with
`TargetModel.with_path`.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    exp_so3,
    finite_number,
    number,
    real_array,
    unit_vector,
)

# least cosine between a ray and the normal, for a well-conditioned projection
_GRAZING = np.cos(np.deg2rad(70.0))
# [m]/[m] ratio of the steps on the surface and on the curve; a larger one means that the path falls
# off an edge
_STEEPEST = 4.0
_FOOTPRINT = 0.01  # [m] around the path, over which normals are averaged
_NEAR = 1e-9  # [m] below which a length counts as zero
# [m] largest distance of a path from the middle of its object; a larger one means another unit
_FARTHEST = 1e3
_MOST_TURN, _MOST_LINES = 1e3, 10_000  # [rad] of a helix; lines of a raster


def line(start: ArrayLike, end: ArrayLike) -> Array:
    """Points (n, 3) [m] from `start` to `end` (3,)."""
    a = _place(start, "line: start")
    b = _place(end, "line: end")

    length = float(np.linalg.norm(b - a))
    if not length > _NEAR:
        raise ConfigurationError("line: start and end coincide")
    return a + np.linspace(0.0, 1.0, _count(length))[:, None] * (b - a)


def circle(
    center: ArrayLike,
    axis: ArrayLike,
    start: ArrayLike,
    angle: float = 2.0 * np.pi,
    rise: float = 0.0,
) -> Array:
    """Arc, circle or helix: points (n, 3) [m] from `start`, right-handed about an axis.

    Args:
        center: (3,) [m] in T.
        axis: (3,) of the rotation.
        start: (3,) [m] first point.
        angle: [rad] of the arc; more than one turn is allowed.
        rise: [m] along the axis at the end, for a helix.

    Returns:
        Points (n, 3) [m] in T.

    Raises:
        ConfigurationError: The start is on the axis, or the angle or rise is out of bounds.
    """
    c = _place(center, "circle: center")
    p = _place(start, "circle: start")
    angle = number(angle, "circle: angle [rad]")
    rise = number(rise, "circle: rise [m]")

    w = unit_vector(axis, "circle: axis")
    arm = (p - c) - w * (w @ (p - c))
    radius = float(np.linalg.norm(arm))
    if not radius > _NEAR:
        raise ConfigurationError("circle: start must not be on the axis")

    if not (
        abs(angle) < _MOST_TURN and abs(rise) <= _FARTHEST and angle != 0.0 and np.isfinite(rise)
    ):
        raise ConfigurationError(
            f"circle: |angle| must be above 0 and below {_MOST_TURN:g} rad, |rise| below "
            f"{_FARTHEST:g} m; got {angle} rad, {rise} m"
        )

    share = np.linspace(0.0, 1.0, _count(float(np.hypot(radius * angle, rise))))
    turned = np.array([exp_so3(angle * u * w) @ arm for u in share])
    return p - arm + turned + (share * rise)[:, None] * w


def raster(center: ArrayLike, along: ArrayLike, across: ArrayLike, pitch: float) -> Array:
    """Raster over a flat patch: points (n, 3) [m] of parallel lines joined by half circles.

    The half circles are beyond the ends of the lines.

    Args:
        center: (3,) [m] centre of the patch in T.
        along: (3,) [m] edge of the patch along the lines.
        across: (3,) [m] edge perpendicular to `along`.
        pitch: [m] largest distance between lines.

    Returns:
        Points (n, 3) [m] in T.

    Raises:
        ConfigurationError: The edges are zero or not perpendicular, or there are too many lines.
    """
    c, u, v = (
        _place(vector, f"raster: {name}")
        for vector, name in ((center, "center"), (along, "along"), (across, "across"))
    )

    length = float(np.linalg.norm(u))
    width = float(np.linalg.norm(v))
    if not (length > _NEAR and width > _NEAR and abs(u @ v) < 1e-6 * length * width):
        raise ConfigurationError("raster: along and across must be perpendicular and not zero")

    pitch = finite_number(pitch, "raster: pitch [m]", above=0.0)
    if width / pitch > _MOST_LINES:
        raise ConfigurationError(
            f"raster: pitch must give at most {_MOST_LINES} lines, got a pitch of {pitch} m on a "
            f"width of {width:g} m"
        )

    # Lines in turn, each but the last with a half circle to the next
    lines = 1 + max(1, int(np.ceil(width / pitch - 1e-9)))
    pitch = width / (lines - 1)
    parts = []
    turn = np.linspace(0.0, np.pi, _count(0.5 * np.pi * pitch))[1:-1, None]
    for i in range(lines):
        way = 1.0 if i % 2 == 0 else -1.0
        begin = c - 0.5 * v + i * pitch * v / width
        parts.append(line(begin - 0.5 * way * u, begin + 0.5 * way * u))
        if i < lines - 1:
            middle = begin + 0.5 * way * u + 0.5 * pitch * v / width
            parts.append(
                middle + 0.5 * pitch * (np.sin(turn) * way * u / length - np.cos(turn) * v / width)
            )
    return np.vstack(parts)


def laid_on(
    target: TargetModel, curve: ArrayLike, direction: ArrayLike, *, before: float = 0.5
) -> ModelPath:
    """Project a curve on the mesh of a target along a direction, with normals as tool axes.

    Each ray stops at the first surface that it meets. The tool axis is the inward normal, averaged
    over a footprint of 1 cm.

    Args:
        target: Model with the mesh.
        curve: (n, 3) [m] in T.
        direction: (3,), or (n, 3) one for each point, as towards the axis of a pipe.
        before: [m] distance before the curve at which the rays start.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: A ray misses or meets the surface at more than 70 deg, or the path falls
            off an edge.
    """
    points = _points(curve, "curve")
    before = finite_number(before, "before [m]", least=0.0, most=_FARTHEST)
    ways = _directions(direction, points)

    # Rays down on the mesh
    scene = RayScene(target.vertices, target.triangles)
    b = _tangents(points)
    aside = np.cross(ways, b)
    starts = points - before * ways
    hit = scene.cast(starts, ways)

    missed = np.flatnonzero(~np.isfinite(hit["t"]))
    if len(missed):
        raise ConfigurationError(
            f"path on {target.name!r}: {len(missed)} of {len(points)} rays miss the mesh, the "
            f"first from {np.round(points[missed[0]], 3).tolist()}"
        )

    # No step off an edge
    p = starts + hit["t"][:, None] * ways
    steps, expected = (
        np.linalg.norm(np.diff(polyline, axis=0), axis=1) for polyline in (p, points)
    )
    fall = np.flatnonzero(steps > _STEEPEST * expected)
    if len(fall):
        raise ConfigurationError(
            f"path on {target.name!r}: the path falls off an edge after "
            f"{np.round(p[fall[0]], 3).tolist()}, by {1e3 * steps[fall[0]]:.0f} mm"
        )

    # Normals over the footprint
    normals = np.zeros_like(p)
    for side in (-1.0, 0.0, 1.0):
        near = scene.cast(starts + side * _FOOTPRINT * aside, ways)
        same = np.isfinite(near["t"]) & (np.abs(near["t"] - hit["t"]) < _STEEPEST * _FOOTPRINT)
        facing = near["normal"] * -np.sign(np.einsum("ij,ij->i", near["normal"], ways))[:, None]
        normals[same] += facing[same]
    return _path(p, -_averaged(normals, p), f"path on {target.name!r}", ways)


def _directions(direction: ArrayLike, points: Array) -> Array:
    """Unit directions (n, 3) of projection, one for each point (n, 3)."""
    ways = real_array(direction, "direction")
    if ways.shape not in ((3,), points.shape) or not np.all(np.isfinite(ways)):
        raise ConfigurationError(
            f"direction: expected (3,) or {points.shape} numbers, got shape {ways.shape}"
        )

    ways = ways / np.maximum(np.abs(ways).max(axis=-1, keepdims=True), 1e-9)
    length = np.linalg.norm(ways, axis=-1, keepdims=True)
    if not np.all(length > _NEAR):
        raise ConfigurationError("direction: must not be zero")
    return np.broadcast_to(ways / length, points.shape)


def cut(target: TargetModel, start: ArrayLike, end: ArrayLike, direction: ArrayLike) -> ModelPath:
    """Profile of a target between two points, in the plane through both points and `direction`.

    The path is where the plane cuts the triangles (T_j) between the projected points (A_i, A_i+1)
    [Konoplin 2019, section 1].

    Args:
        target: Model with the mesh.
        start: (3,) [m] in T, projected on the mesh along `direction`.
        end: (3,) [m] in T, projected likewise.
        direction: (3,) of projection.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: The points miss the mesh, or no unbroken profile that faces against
            `direction` joins them.
    """
    way = unit_vector(direction, "direction")
    ends = laid_on(target, line(start, end), way).p[[0, -1]]  # raises where the profile is broken
    chord = ends[1] - ends[0]
    normal = np.cross(chord, way)
    if not np.linalg.norm(normal) > 1e-6:
        raise ConfigurationError(
            "cut: start and end must not be one behind the other along the direction"
        )

    normal /= np.linalg.norm(normal)
    along = np.cross(way, normal)
    along *= np.sign(along @ chord)

    # Crossings of the plane with the edges of triangles
    corners = np.asarray(target.vertices)[target.triangles]
    side = (corners - ends[0]) @ normal
    # a corner in the plane belongs to one side, so that no crossing is lost
    side = np.where(np.abs(side) < 1e-9, 1e-9, side)
    t: list[Array] = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        rows = np.flatnonzero(side[:, i] * side[:, j] < 0.0)
        share = side[rows, i] / (side[rows, i] - side[rows, j])
        t.append(corners[rows, i] + share[:, None] * (corners[rows, j] - corners[rows, i]))

    crossings = np.vstack(t)
    reach = (crossings - ends[0]) @ along
    crossings = crossings[(reach > 0.0) & (reach < chord @ along)]

    # Of the crossings, keep those that a ray along the direction meets first.
    scene = RayScene(target.vertices, target.triangles)
    ahead = float(np.ptp(corners.reshape(-1, 3) @ way)) + 0.1
    first = scene.cast(crossings - ahead * way, np.broadcast_to(way, crossings.shape))["t"]
    crossings = crossings[np.abs(first - ahead) < 1e-4]

    # Path over those points, respaced
    points = np.vstack([ends[0], crossings[np.argsort((crossings - ends[0]) @ along)], ends[1]])
    return laid_on(target, _respaced(points), way, before=0.05)


def through(points: ArrayLike, axes: ArrayLike, along: ArrayLike | None = None) -> ModelPath:
    """Path through a list of points and tool axes; a cubic spline between the points.

    Args:
        points: (n, 3) [m] in T, n >= 4.
        axes: (n, 3) tool axes, into the surface.
        along: (n, 3) x axes that a tool that is not round keeps; None: the direction of the path,
            made perpendicular to the tool axis.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: A value is not finite, neighbours coincide, an axis is zero or along the
            path, or the axes of neighbours are opposite.
    """
    from scipy.interpolate import make_interp_spline

    p = _points(points, "points")
    a = checked(axes, p.shape, "axes")

    # Unit axes that turn by less than 90 deg between neighbours
    size = np.linalg.norm(a, axis=1)
    if not np.all(size > _NEAR):
        raise ConfigurationError(f"axes: row {int(size.argmin())} is zero")
    a = a / size[:, None]
    turned = np.einsum("ij,ij->i", a[:-1], a[1:])
    if turned.min() < 0.0:
        raise ConfigurationError(
            f"axes: rows {int(turned.argmin())} and {int(turned.argmin()) + 1} are 90 deg or more "
            "apart"
        )

    # Splines through points and axes
    u = _chords(p, "points")
    fine = np.linspace(0.0, u[-1], max(_count(float(u[-1])), len(p)))
    dense = make_interp_spline(u, p, k=3)(fine)
    axis = make_interp_spline(u, a, k=1)(fine)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)

    if along is None:
        return _path(dense, axis, "points", axis)
    b = make_interp_spline(u, checked(along, p.shape, "along"), k=1)(fine)
    return ModelPath(p=dense, a=axis, b=_across(b, axis, "along"), keeps_b=True)


def joined(paths: Sequence[ModelPath]) -> ModelPath:
    """Concatenate successive paths.

    Raises:
        ConfigurationError: A path does not begin where the previous one ends.
    """
    for i, (first, then) in enumerate(pairwise(paths)):
        gap = float(np.linalg.norm(then.p[0] - first.p[-1]))
        if gap > 2.0 * PATH_STEP:
            raise ConfigurationError(f"paths {i} and {i + 1} are {1e3 * gap:.0f} mm apart")

    # Without the points that two paths share
    p = np.vstack([path.p for path in paths])
    keep = np.concatenate([[True], np.linalg.norm(np.diff(p, axis=0), axis=1) > 0.2 * PATH_STEP])
    a, b = (np.vstack([getattr(path, name) for path in paths])[keep] for name in ("a", "b"))
    return ModelPath(p=p[keep], a=a, b=b, keeps_b=any(path.keeps_b for path in paths))


def _count(length: float) -> int:
    """Number of points of a curve of `length` [m]."""
    return max(4, 1 + round(abs(length) / PATH_STEP))


def _place(values: ArrayLike, name: str) -> Array:
    return checked_place(values, (3,), name, _FARTHEST)


def _points(values: ArrayLike, name: str) -> Array:
    points = real_array(values, name, "(N, 3) numbers [m]")
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
        raise ConfigurationError(
            f"{name}: expected (N, 3) numbers [m], N >= 4, got shape {points.shape}"
        )
    if not np.all(np.isfinite(points)):
        raise ConfigurationError(
            f"{name}: row {int(np.argmin(np.isfinite(points).all(axis=1)))} is not finite"
        )
    _chords(checked_place(points, points.shape, name, _FARTHEST), name)
    return points


def _chords(points: Array, name: str) -> Array:
    """Length (n,) [m] along the polyline. Raises ConfigurationError if neighbours coincide."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if steps.min() < _NEAR:
        raise ConfigurationError(
            f"{name}: rows {int(steps.argmin())} and {int(steps.argmin()) + 1} coincide"
        )
    return np.concatenate([[0.0], np.cumsum(steps)])


def _respaced(points: Array) -> Array:
    """Points on the polyline at a spacing of PATH_STEP."""
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])
    points = points[keep]
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.linspace(0.0, u[-1], _count(float(u[-1])))
    return np.column_stack([np.interp(even, u, points[:, i]) for i in range(3)])


def _tangents(points: Array) -> Array:
    tangents = np.gradient(points, axis=0)
    return tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), _NEAR)


def _averaged(normals: Array, p: Array) -> Array:
    """Average normals (n, 3) along the path over the footprint."""
    step = float(np.linalg.norm(np.diff(p, axis=0), axis=1).mean())
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    smooth = ndimage.gaussian_filter1d(
        normals / np.maximum(size, _NEAR), _FOOTPRINT / step, axis=0, mode="nearest"
    )
    return smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), _NEAR)


def _path(p: Array, a: Array, name: str, ways: Array) -> ModelPath:
    """Path with its own direction as b.

    Raises ConfigurationError if a ray along `ways` grazes the surface.
    """
    cosine = np.einsum("ij,ij->i", a, ways)
    if cosine.min() < _GRAZING:
        i = int(cosine.argmin())
        raise ConfigurationError(
            f"{name}: at {np.round(p[i], 3).tolist()} the surface is nearly parallel to the "
            f"direction of projection ({np.degrees(np.arccos(np.clip(cosine[i], -1.0, 1.0))):.0f} "
            "deg off, limit 70)"
        )
    return ModelPath(p=p, a=a, b=_across(_tangents(p), a, name))


def _across(b: Array, a: Array, name: str) -> Array:
    """Unit vectors along `b`, made perpendicular to `a`."""
    flat = b - np.einsum("ij,ij->i", a, b)[:, None] * a
    size = np.linalg.norm(flat, axis=1)
    if not np.all(size > 0.1 * np.linalg.norm(b, axis=1)):
        raise ConfigurationError(
            f"{name}: at row {int(size.argmin())} the tool axis is parallel to the path"
        )
    return flat / size[:, None]
