"""Tool path on the real surface from a path on the model [Konoplin 2022, eq. 3 and following].

The path is transformed by the identified pose. Where the object is seen well and deviates from its
model by more than the sensor's noise (fouled, silted, dented), points are moved along +-o onto the
scanned triangulation. Elsewhere the model is the better measurement and is kept. A tool that ends
in a ball is led along the surface that the ball can reach. A cubic B-spline smooths the whole path.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from uuv.models.objects.axis_steps import NO_STEPS, Steps
from uuv.models.objects.target_model import ModelPath, without_turn
from uuv.perception.registration.identification import Identification
from uuv.perception.toolpath.path_deviation import BESIDE, Deviation, deviate
from uuv.perception.toolpath.tool_axes import scanned_axis, tilted_axis
from uuv.perception.toolpath.turns_at_rest import turning_at_rest
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, readonly, transform_points

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_DENSE = 0.003  # [m] spacing of the points that are projected
_KNOTS = 0.015  # [m] spacing of the knots of the smoothing spline
_ACROSS = 0.003  # [m] spacing of the lines of the surface next to a path
_GONE = 0.1  # [m] depth behind the path that is used where there is no surface
_SLOPE = 0.006  # [m] to both sides, over which the slope for the axis is computed
# [-] ratio of the curvature of a hollow to that of the ball, from which on the tool is kept out
_TIGHT = 0.85
_MARGIN = 0.012  # [m] margin next to such a hollow
_SURE = 0.05  # [rad] difference of the axes from scan and model, at which each has half the weight
# [m] least length of a stretch that is worked; the tool needs 1 cm to accelerate, and as much to
# stop
_SHORTEST = 0.03
# [rad] a path that turns less about the tool axis is followed by the tool's x axis
_TURNS = float(np.cos(np.radians(20.0)))
# [-] share of the set speed on a surface that deviates: slopes of 10 deg that were not seen then
# cost half the force
PACE = 0.5


def plan_path(
    found: Identification,
    path: ModelPath,
    *,
    spacing: float = 0.0015,
    max_deviation: float = 0.05,
    bridge: float = 0.06,
    tool_radius: float = 0.0,
) -> ToolPath:
    """Plan the tool path on the real surface, in the sensor frame S.

    Args:
        found: Accepted identification of the object.
        path: Path on the model, in T.
        spacing: [m] between the samples along the arc length.
        max_deviation: [m] along the line of sight; larger deviations are treated as another object.
        bridge: [m] longest hole in the scan, along the path, over which both sides are joined.
        tool_radius: [m] radius of the ball at the end of the tool; where the surface deviates, the
            path follows the part that the ball can reach. 0: a point.

    Returns:
        The tool path in S.

    Raises:
        PerceptionError: `found` was not accepted, or the scan has a longer hole on the path.
        ConfigurationError: The path has coinciding points, or a parameter is out of bounds.
    """
    if not found.accepted or found.evidence is None:
        raise PerceptionError(f"tool path: the object was not identified: {found.reason}")
    if not (spacing > 0.0 and max_deviation > 0.0 and bridge >= 0.0 and tool_radius >= 0.0):
        raise ConfigurationError(
            "tool path: spacing and max_deviation must be > 0 m, bridge and tool_radius >= 0 m, "
            f"got {spacing}, {max_deviation}, {bridge} and {tool_radius}"
        )

    # The path on the model, and the deviation of the scan along it
    carried = carry(found.X_sensor_target, densified(path))
    dense = along_itself(carried)
    b = carried.b if carried.keeps_b else None
    deviation = deviate(
        found.evidence, found.surface, found.X_sensor_target, dense, max_deviation, bridge
    )

    # A point of contact
    p = dense.p + deviation.along_o[:, None] * deviation.o
    z = tilted_axis(dense, deviation)
    if not (tool_radius > 0.0 and deviation.on_scan.any()):
        return turning_at_rest(_smoothed(p, z, deviation.on_scan, spacing, b))

    # A ball: contact points, and axes from the scan where it shows them better
    p, z = rolled(dense, deviation, tool_radius)
    axes, scanned = scanned_axis(found.evidence, p, z)
    path_found = _smoothed(p, _towards(axes, z, p), deviation.on_scan, spacing, b)

    at = np.linspace(0.0, 1.0, len(path_found.s))
    observed = np.interp(at, np.linspace(0.0, 1.0, len(p)), scanned.astype(float)) > 0.5
    return turning_at_rest(workable(path_found, tool_radius, observed))


def path_on_model(X_AT: Array, path: ModelPath, *, spacing: float = 0.0015) -> ToolPath:
    """Tool path on the surface of the model, for an object that was not scanned.

    Args:
        X_AT: (4, 4) pose of the object.
        path: Path on the model, in T.
        spacing: [m] between the samples along the arc length.

    Returns:
        The tool path in A.

    Raises:
        ConfigurationError: The path has coinciding points.
    """
    carried = carry(X_AT, densified(path))
    on_scan = np.zeros(len(carried.p), dtype=bool)
    return turning_at_rest(
        _smoothed(carried.p, carried.a, on_scan, spacing, carried.b if carried.keeps_b else None)
    )


def _towards(axes: Array, z: Array, p: Array) -> Array:
    """Unit axes (n, 3): `z` of model and deviation, or those of the scan where the two differ
    significantly.
    """
    apart = np.sum((axes - z) ** 2, axis=1)
    step = float(np.linalg.norm(np.diff(p, axis=0), axis=1).mean())
    share = ndimage.gaussian_filter1d(apart / (apart + _SURE**2), _SLOPE / step, mode="nearest")

    mixed = ndimage.gaussian_filter1d(
        z + share[:, None] * (axes - z), _SLOPE / step, axis=0, mode="nearest"
    )
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def workable(path: ToolPath, tool_radius: float, scanned: np.ndarray | None = None) -> ToolPath:
    """`path` on a surface that deviates, at half speed and without the parts that this tool cannot
    work.

    In a hollow nearly as tight as the ball, the ball is in contact with two flanks at once, and the
    force jumps from one flank to the other. Such parts of the path are left out with a margin.
    Parts where nothing was scanned are left out too, because the model is not valid there. Parts at
    the ends are cut off.

    Args:
        path: Path of the ball's contact point.
        tool_radius: [m] of the ball.
        scanned: (n,) mask of the points around which the surface was scanned; None: all points.

    Returns:
        The path, with `fits`, `pace` and `note`.

    Raises:
        PerceptionError: Nothing of the path remains.
    """
    # Hollows as tight as the ball, and parts that were not seen, with a margin
    step = float(path.s[1] - path.s[0])
    bend = np.gradient(np.gradient(path.p, step, axis=0), step, axis=0)
    tight = -np.sum(bend * path.z, axis=1) > _TIGHT / tool_radius
    margin = max(1, round(_MARGIN / step))
    unseen = np.zeros_like(tight) if scanned is None else ~scanned
    tight, unseen = (
        ndimage.binary_dilation(places, iterations=margin) for places in (tight, unseen)
    )

    # Stretches that are long enough to be worked
    fits = ~(tight | unseen)
    stretch, count = ndimage.label(fits)
    fits &= (np.bincount(stretch, minlength=count + 1) * step >= min(_SHORTEST, float(path.s[-1])))[
        stretch
    ]

    if not fits.any():
        why = (
            f"it fits the surface on {1.0 - tight.mean():.0%} of the path, of which "
            f"{1.0 - unseen.mean():.0%} was seen"
        )
        raise PerceptionError(
            f"the tool, a ball of {1e3 * tool_radius:.0f} mm, cannot work anywhere on the path: "
            f"{why}"
        )

    # From the first point that fits to the last, including the parts left out between
    ends = np.flatnonzero(fits)[[0, -1]]
    part = slice(ends[0], ends[1] + 1)
    return replace(
        path,
        s=readonly(path.s[part] - path.s[part.start]),
        p=readonly(path.p[part]),
        z=readonly(path.z[part]),
        x=readonly(path.x[part]),
        on_scan=path.on_scan[part],
        fits=fits[part],
        pace=PACE,
        note=_left_out(tight & ~unseen, unseen),
    )


def _left_out(tight: np.ndarray, unseen: np.ndarray) -> str:
    """Description of the parts left out of a path; empty if none is left out.

    Args:
        tight: (n,) mask of the hollows that are too tight.
        unseen: (n,) mask of the points that were not seen.
    """
    causes = (("hollows too tight for the tool", tight), ("parts that were not seen", unseen))
    reasons = [
        f"{what}, {max(0.01, left.mean()):.0%} of the path" for what, left in causes if left.any()
    ]
    return f"{' and '.join(reasons)}, are left out" if reasons else ""


def carry(X_ST: Array, path: ModelPath) -> ModelPath:
    """Transform a path from T to S, points and axes [Konoplin 2022, eq. 3].

    The equation has two rotations and centroids; `X_ST` (4, 4) combines them.
    """
    R = X_ST[:3, :3]
    return replace(path, p=transform_points(X_ST, path.p), a=path.a @ R.T, b=path.b @ R.T)


def along_itself(path: ModelPath) -> ModelPath:
    """`path` with b along the path; unchanged unless the tool keeps another b."""
    if not path.keeps_b:
        return path
    b = np.gradient(path.p, axis=0)
    b -= np.sum(b * path.a, axis=1, keepdims=True) * path.a
    return replace(path, b=b / np.linalg.norm(b, axis=1, keepdims=True), keeps_b=False)


def densified(path: ModelPath) -> ModelPath:
    """Resample the path at a spacing of _DENSE, through all its points.

    Raises:
        ConfigurationError: Two neighbouring points coincide.
    """
    from scipy.interpolate import make_interp_spline

    chord = np.linalg.norm(np.diff(path.p, axis=0), axis=1)
    if chord.min() < 1e-9:
        raise ConfigurationError(
            f"tool path: points {int(chord.argmin())} and {int(chord.argmin()) + 1} coincide"
        )

    # Splines through points and axes; steps of b are removed and put back
    u = np.concatenate([[0.0], np.cumsum(chord)])
    fine = np.linspace(0.0, u[-1], max(8, 1 + round(u[-1] / _DENSE)))
    steps = Steps.of(path.a, path.b) if path.keeps_b else NO_STEPS
    smooth = steps.taken_out(path.a, path.b)
    p, a, b = (make_interp_spline(u, rows, k=3)(fine) for rows in (path.p, path.a, smooth))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = steps.put_back(
        a, b / np.linalg.norm(b, axis=1, keepdims=True), np.interp(fine, u, np.arange(len(u)))
    )
    return replace(path, p=p, a=a, b=b)


def _smoothed(
    p: Array, z: Array, on_scan: np.ndarray, spacing: float, b: Array | None = None
) -> ToolPath:
    """Least-squares cubic B-splines through points and axes, sampled evenly over arc length.

    If the tool keeps its second axis, that axis is `b` (n, 3). Otherwise it is the tangent. On a
    path with bends and corners in the surface, about which a round tool need not turn, it is an
    axis that never turns about the tool axis.
    """
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    curve = _spline(u, p)
    axis = _spline(u, z)

    # Evenly spaced by length along the curve
    fine = np.linspace(0.0, u[-1], max(16, 4 * round(u[-1] / spacing)))
    length = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))]
    )
    s = np.linspace(0.0, length[-1], max(2, 1 + round(length[-1] / spacing)))
    at = np.interp(s, length, fine)

    # Axes
    points = curve(at)
    tool = axis(at)
    tool /= np.linalg.norm(tool, axis=1, keepdims=True)

    steps = NO_STEPS if b is None else Steps.of(z, b)
    x = curve.derivative()(at) if b is None else _spline(u, steps.taken_out(z, b))(at)
    x -= np.einsum("ij,ij->i", x, tool)[:, None] * tool
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    x = steps.put_back(tool, x, np.interp(at, u, np.arange(len(u))))

    if b is None:
        free = without_turn(x[0], tool)
        if np.einsum("ij,ij->i", free, x).min() < _TURNS:
            x = free

    nearest = np.clip(np.searchsorted(u, at), 0, len(u) - 1)
    flags = on_scan[nearest].copy()
    flags.setflags(write=False)
    return ToolPath(
        s=readonly(s),
        p=readonly(points),
        z=readonly(tool),
        x=readonly(x),
        on_scan=flags,
        keeps_x=b is not None,
    )


def _spline(u: Array, values: Array) -> "BSpline":
    from scipy.interpolate import make_lsq_spline

    intervals = max(1, min(int(u[-1] / _KNOTS), (len(u) - 4) // 2))
    inner = np.linspace(u[0], u[-1], intervals + 1)[1:-1]
    return make_lsq_spline(u, values, np.concatenate([[u[0]] * 4, inner, [u[-1]] * 4]), k=3)


def rolled(path: ModelPath, deviation: Deviation, radius: float) -> tuple[Array, Array]:
    """Contact points (n, 3) [m] and axes (n, 3) in S of a ball-ended tool that moves along a path.

    The surface is that of the model plus the deviation, within the offsets BESIDE of the path. Its
    morphological closing bridges tight hollows: the centre of a ball that rolls on the surface
    stays at least a ball radius away from every surface point. The contact point, seen along the
    tool axis, is on the surface, or on the underside of the ball over a tight hollow.

    Args:
        path: Dense path in S.
        deviation: Deviation of the scanned surface along the path.
        radius: [m] of the ball.

    Returns:
        Contact points (n, 3) [m] and unit axes (n, 3) in S.
    """
    # Surface beside the path: model, deviation, and its form
    count = 2 * round(BESIDE[-1] / _ACROSS) + 1
    x = np.linspace(BESIDE[0], BESIDE[-1], count)
    section = np.array([_between(row, x) for row in deviation.section])
    depth = section + deviation.form @ x ** np.arange(3)[:, None]
    lateral = np.cross(path.a, path.b)
    surface = path.p[:, None] + x[:, None] * lateral[:, None] + depth[..., None] * deviation.o

    # The same surface, extended by straight ends on which the ball can rest
    step = float(np.linalg.norm(np.diff(path.p, axis=0), axis=1).mean())
    more = int(np.ceil(radius / step))
    slope = max(1, round(_SLOPE / step))
    longer = np.vstack(
        [_onward(surface[::-1], more, slope)[::-1], surface, _onward(surface, more, slope)]
    )
    ways = np.vstack([np.tile(-path.a[0], (more, 1)), -path.a, np.tile(-path.a[-1], (more, 1))])

    # Closing: the surface raised to the underside of the ball
    over = lift(longer, ways, radius)[more:-more]
    closed = surface - over[..., None] * path.a[:, None]

    # Normals from the slopes along and across
    middle = count // 2
    off = round(_SLOPE / _ACROSS)
    along = ndimage.gaussian_filter1d(
        np.gradient(closed[:, middle], axis=0), 0.5 * _SLOPE / step, axis=0
    )
    normal = np.cross(along, closed[:, middle + off] - closed[:, middle - off])
    return closed[:, middle], normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _onward(surface: Array, rows: int, over: int) -> Array:
    """Extend a surface (n, l, 3) by `rows` straight rows, sloped as over its last `over` rows.

    At the end of a sloped path the ball's centre lies beyond it.
    """
    last = min(over, len(surface) - 1)
    way = (surface[-1] - surface[-1 - last]).mean(axis=0) / last
    return surface[-1] + np.arange(1, rows + 1)[:, None, None] * way


def _between(row: Array, x: Array) -> Array:
    """Interpolate a section (7,) at offsets `x` [m] from the path; _GONE beyond its known part."""
    known = np.isfinite(row)
    if not known[len(row) // 2]:
        return np.where(np.abs(x) < _ACROSS, 0.0, _GONE)
    return np.interp(x, BESIDE[known], row[known], left=_GONE, right=_GONE)


def lift(surface: Array, outward: Array, radius: float) -> Array:
    """Height (n, l) [m] of the underside of a rolling ball over each surface point.

    The ball's centre stays over the grid, so that the ball does not reach the outermost points if
    these slope down.

    Args:
        surface: (n, l, 3) [m] grid, dense compared with the radius: n points along a path, l across
            it.
        outward: (n, 3) unit direction from which the ball approaches at each of the n points.
        radius: [m] of the ball.

    Returns:
        Height (n, l) [m], 0 where the ball is in contact with the point.
    """
    points = np.ascontiguousarray(surface)
    ways = np.ascontiguousarray(outward)
    return _erosion(points, ways, _dilation(points, ways, radius), radius)


@kernel
def _dilation(points, ways, radius):
    """Lowest possible centre (n, l, 3) of the ball over each point, given all points near it."""
    n, m = points.shape[:2]
    centres = np.empty_like(points)
    for i in range(n):
        first, last = _near(points, i, radius)
        for k in range(m):
            height = radius
            for j in range(first, last):
                for row in range(m):
                    over, beside = _split(points, j, row, points[i, k], ways[i])
                    if beside < radius * radius:
                        height = max(height, over + np.sqrt(radius * radius - beside))
            for c in range(3):
                centres[i, k, c] = points[i, k, c] + height * ways[i, c]
    return centres


@kernel
def _erosion(points, ways, centres, radius):
    """Height (n, l) over each point of the lowest underside of a ball at any of `centres`."""
    n, m = points.shape[:2]
    height = np.zeros((n, m))
    for i in range(n):
        first, last = _near(points, i, radius)
        for k in range(m):
            lowest = np.inf
            for j in range(first, last):
                for row in range(m):
                    over, beside = _split(centres, j, row, points[i, k], ways[i])
                    if beside < radius * radius:
                        lowest = min(lowest, over - np.sqrt(radius * radius - beside))
            height[i, k] = max(lowest, 0.0)
    return height


@kernel
def _near(points, i, radius):
    """Range of rows whose middle point is within 1.5 `radius` of that of row `i`."""
    n = points.shape[0]
    middle = points.shape[1] // 2
    reach = (1.5 * radius) ** 2
    first = i
    last = i + 1
    while first > 0 and _square(points, first - 1, i, middle) < reach:
        first -= 1
    while last < n and _square(points, last, i, middle) < reach:
        last += 1
    return first, last


@kernel
def _square(points, i, j, k):
    total = 0.0
    for c in range(3):
        total += (points[i, k, c] - points[j, k, c]) ** 2
    return total


@kernel
def _split(points, j, k, origin, way):
    """Height of points[j, k] over `origin` along `way`, and the squared distance from that line."""
    over = 0.0
    total = 0.0
    for c in range(3):
        step = points[j, k, c] - origin[c]
        over += step * way[c]
        total += step * step
    return over, total - over * over
