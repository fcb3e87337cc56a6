"""Contact path of a ball-ended tool on a surface: morphological closing, as it bridges tight hollows.

The centre of a ball that rolls on the surface stays at least its radius away from every surface point. The ball then
reaches, seen along the tool axis, the surface itself or, over a tight hollow, its own underside.
"""

import numba
import numpy as np
from scipy import ndimage

from models.objects.targets import ModelPath
from perception.toolpath.path_deviation import BESIDE, Deviation
from sim.interfaces.spatial import Array

_ACROSS = 0.003  # [m] between the lines of the surface beside a path
_GONE = 0.1  # [m] behind the path: depth used where there is no surface
_SLOPE = 0.006  # [m] to both sides, over which the axis's slope is taken


def rolled(path: ModelPath, deviation: Deviation, radius: float) -> tuple[Array, Array]:
    """Contact points (n, 3) [m] and axes (n, 3) in S of a ball-ended tool that moves along a path.

    The surface is the model's plus the deviation, as far beside the path as BESIDE extends.

    Args:
        path: Dense path in S.
        deviation: Of the scanned surface along it.
        radius: [m] of the ball.

    Returns:
        Contact points (n, 3) [m] and unit axes (n, 3) in S.
    """
    count = 2 * round(BESIDE[-1] / _ACROSS) + 1
    x = np.linspace(BESIDE[0], BESIDE[-1], count)
    section = np.array([_between(row, x) for row in deviation.section])
    depth = section + deviation.form @ x ** np.arange(3)[:, None]
    lateral = np.cross(path.a, path.b)
    surface = path.p[:, None] + x[:, None] * lateral[:, None] + depth[..., None] * deviation.o
    step = float(np.linalg.norm(np.diff(path.p, axis=0), axis=1).mean())
    more, slope = int(np.ceil(radius / step)), max(1, round(_SLOPE / step))
    longer = np.vstack([_onward(surface[::-1], more, slope)[::-1], surface, _onward(surface, more, slope)])
    ways = np.vstack([np.tile(-path.a[0], (more, 1)), -path.a, np.tile(-path.a[-1], (more, 1))])
    over = lift(longer, ways, radius)[more:-more]
    closed = surface - over[..., None] * path.a[:, None]
    middle, off = count // 2, round(_SLOPE / _ACROSS)
    along = ndimage.gaussian_filter1d(np.gradient(closed[:, middle], axis=0), 0.5 * _SLOPE / step, axis=0)
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
    """Interpolate a section (7,) at offsets `x` [m] from the path; _GONE beyond its known part on either side."""
    known = np.isfinite(row)
    if not known[len(row) // 2]:
        return np.where(np.abs(x) < _ACROSS, 0.0, _GONE)
    return np.interp(x, BESIDE[known], row[known], left=_GONE, right=_GONE)


def lift(surface: Array, outward: Array, radius: float) -> Array:
    """Height (n, l) [m] of the underside of a rolling ball over each surface point.

    The ball's centre stays over the grid, so that it does not reach the outermost points where these slope down.

    Args:
        surface: (n, l, 3) [m] grid, dense against the radius: n places along a path, l across it.
        outward: (n, 3) unit direction from which the ball comes at each place.
        radius: [m] of the ball.

    Returns:
        Height (n, l) [m], 0 where the ball touches the point.
    """
    points = np.ascontiguousarray(surface)
    ways = np.ascontiguousarray(outward)
    return _erosion(points, ways, _dilation(points, ways, radius), radius)


@numba.njit(cache=True)
def _dilation(points, ways, radius):
    """Centres (n, l, 3) of the ball over each point, as low as all points near it allow."""
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


@numba.njit(cache=True)
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


@numba.njit(cache=True)
def _near(points, i, radius):
    """Range of rows whose middle point is within 1.5 `radius` of that of row `i`."""
    n, middle = points.shape[0], points.shape[1] // 2
    reach = (1.5 * radius) ** 2
    first, last = i, i + 1
    while first > 0 and _square(points, first - 1, i, middle) < reach:
        first -= 1
    while last < n and _square(points, last, i, middle) < reach:
        last += 1
    return first, last


@numba.njit(cache=True)
def _square(points, i, j, k):
    total = 0.0
    for c in range(3):
        total += (points[i, k, c] - points[j, k, c]) ** 2
    return total


@numba.njit(cache=True)
def _split(points, j, k, origin, way):
    """Height of points[j, k] over `origin` along `way`, and the squared distance from that line."""
    over, total = 0.0, 0.0
    for c in range(3):
        step = points[j, k, c] - origin[c]
        over += step * way[c]
        total += step * step
    return over, total - over * over
