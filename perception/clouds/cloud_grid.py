"""Conversion of any point cloud to the depth image of a pinhole at its origin.

A cloud from a depth sensor still contains the sensor's pixel grid: x/z is linear in the column and
y/z in the row to the last digits, independent of errors of z. In an organised cloud the pixel of
each point is known; in an unordered cloud the lattice is recovered from x/z and y/z alone. Only
clouds without a lattice (merged scans, lidar, sonar) are resampled: they are averaged over the
cells of a virtual pinhole's image, triangulated in that image (Delaunay) and rendered.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage
from scipy.spatial import Delaunay, QhullError, cKDTree

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import PerceptionError
from uuv.sim.interfaces.spatial import Array

_MOST_CELLS = 640  # largest number of pixels per side of the virtual pinhole's image
_FEWEST_CELLS = 40  # least number of pixels along its longer side
_MAX_DELAUNAY = 40_000  # largest number of points; more only add time, not shape
_SAMPLE = 100_000  # number of points to which a pinhole is fitted
_STRAY = 1e-3  # [-] share of the points, on each side, that may be far beyond the others
# [px] largest systematic offset of an organised cloud's pixels from those of a pinhole
_BENT = 0.25
# [px] largest random offset from a pinhole's pixels, if noise was added to x and y too
_SCATTER = 3.0
_BINS = 2**15  # number of bins of the histogram whose spectrum shows a lattice
_COMB = 0.4  # [-] peak of the spectrum that shows the lines of a lattice, relative to that at zero
_OFF_LATTICE = (0.8, 0.25)  # [-] share of the points that must be within so many [px] of a lattice
# [-] filled share of the 8 neighbours (median), below which the lattice is rejected as sparse
_FILLED = 0.5
_LONGEST_SIDE = 8192  # [px] largest size of a recovered lattice
# [-] ratio of the points in a picture's last row to those further in, at which the picture itself
# ends
_CUT = 0.7
# [-] filled share of a picture's last row, from which on a surface covers that side
_FULL_SIDE = 0.7
# [-] largest offset of the picture's middle from the optical axis, as a share of the picture's
# width
_OFF_CENTRE = 0.1
_MARGIN = 16  # [px] empty border around an object that is wholly in the picture
_UNEVEN = 4.0  # [-] largest ratio of the pitches of columns and rows


@dataclass(frozen=True, slots=True, eq=False)
class DepthGrid:
    """Depth image of a pinhole."""

    depth: Array  # (h, w) [m] along the optical axis, NaN without echo
    tangent_x: Array  # (w,) x/z of each column
    tangent_y: Array  # (h,) y/z of each row


def jump(z: ArrayLike) -> Array:
    """Depth step [m] at depth `z` [m] above which neighbouring pixels are on different surfaces."""
    return 0.01 + 0.02 * np.asarray(z, dtype=np.float64)


def organised_grid(points: Array, usable: np.ndarray, turned: bool = False) -> DepthGrid | None:
    """Depth image of an organised cloud whose pixels are those of a pinhole.

    Args:
        points: (h, w, 3) [m] in S; rows and columns may be exchanged or in reverse order.
        usable: Mask (h, w) of the pixels that have a point.
        turned: True: rows and columns have been exchanged already and are not exchanged again.

    Returns:
        The depth image, or None if the pixels are not those of a pinhole.
    """
    if min(usable.shape) < 2:
        return None

    # Pixels and tangents of a sample of the points
    row, column = (index.astype(np.float64) for index in np.nonzero(usable))
    tangents = points[usable][:, :2] / points[usable][:, 2:]
    chosen = _sample(len(tangents))
    row = row[chosen]
    column = column[chosen]
    tangents = tangents[chosen]

    # Columns are those along which x/z changes more
    along = [
        abs(_slope(index, tangents[:, 0])) * size
        for index, size in zip((column, row), usable.shape[::-1], strict=True)
    ]
    if along[0] < along[1] and not turned:  # `turned` ends the recursion for an unordered cloud
        return organised_grid(points.swapaxes(0, 1), usable.T, turned=True)

    # Smooth deviations are lens distortion and must be small. Random deviations are noise, which
    # leaves points in their pixels.
    u, v = (
        2.0 * index / (size - 1) - 1.0
        for index, size in zip((column, row), usable.shape[::-1], strict=True)
    )
    terms = np.column_stack([u**i * v**j for i in range(4) for j in range(4 - i)])

    # A straight line is fitted for each axis: x/z over the columns, y/z over the rows
    axes = []
    for index, size, tangent in (
        (column, usable.shape[1], tangents[:, 0]),
        (row, usable.shape[0], tangents[:, 1]),
    ):
        slope = _slope(index, tangent)
        start = float(np.median(tangent - slope * index))
        off = tangent - start - slope * index
        if not abs(slope) > 0.0 or np.median(np.abs(off)) > _SCATTER * abs(slope):
            return None
        if np.abs(terms @ np.linalg.lstsq(terms, off, rcond=None)[0]).max() > _BENT * abs(slope):
            return None
        axes.append((start + slope * np.arange(size), int(np.sign(slope))))

    # Columns run to the right and rows down
    (tangent_x, right), (tangent_y, down) = axes
    depth = np.where(usable, points[..., 2], np.nan)[::down, ::right]
    return _even(DepthGrid(depth, tangent_x[::right], tangent_y[::down]))


def lattice_grid(points: Array) -> DepthGrid | None:
    """Depth image of an unordered cloud whose points are the pixels of a pinhole.

    Several points in one pixel are averaged, as in `scatter_grid`.

    Args:
        points: (n, 3) [m] in S, in any order.

    Returns:
        The depth image, or None if the points lie on no lattice.
    """
    points = _without_strays(points)
    tangents = points[:, :2] / points[:, 2:]

    # Lines of columns and rows, and the pixel of each point
    axes = [_lattice(tangent[_sample(len(tangent))]) for tangent in tangents.T]
    cells = []
    lines = []
    for axis, tangent in zip(axes, tangents.T, strict=True):
        if axis is None:
            return None
        start, pitch = axis
        index = np.rint((tangent - start) / pitch).astype(np.int64)
        first = int(index.min())
        count = int(np.ptp(index)) + 1
        if not 2 <= count <= _LONGEST_SIDE:
            return None
        cells.append(index - first)
        lines.append(start + pitch * np.arange(first, first + count))

    # Pixels of a picture have neighbours; those of a coincidental lattice do not
    width, height = len(lines[0]), len(lines[1])
    key = cells[1] * width + cells[0]
    filled = np.zeros((height, width), dtype=np.float32)
    filled.ravel()[key] = 1.0
    around = (9.0 * ndimage.uniform_filter(filled, 3, mode="constant") - filled) / 8.0
    if np.median(around[filled > 0.0]) < _FILLED:
        return None

    # Depth of a pixel: the mean of the points in it
    cell, _, z = _cell_means(tangents, points[:, 2], key)
    depth = np.full(height * width, np.nan)
    depth[cell] = z
    return _even(_framed(DepthGrid(depth.reshape(height, width), *lines)))


def scatter_grid(points: Array) -> DepthGrid:
    """Depth image of an unordered cloud without a lattice, rendered by a virtual pinhole.

    The resolution of the image is that of the cloud. In dense clouds the points of a cell that are
    on the surface of their median are averaged. The mean is unbiased under noise, while the nearest
    of many points would be in front of the surface.

    Args:
        points: (n, 3) [m] in S.

    Raises:
        PerceptionError: The points span no surface.
    """
    points = _without_strays(points)

    # Picture that contains all points
    tangents = points[:, :2] / points[:, 2:]
    z = points[:, 2]
    low, high = tangents.min(axis=0), tangents.max(axis=0)
    span = float((high - low).max())
    if not span > 1e-6:
        raise PerceptionError("the cloud spans no surface: all its points lie on one line of sight")

    # Large clouds are averaged over cells until they are coarse enough for the triangulation
    pitch = span / _MOST_CELLS
    few = tangents
    few_z = z
    if len(z) > _MAX_DELAUNAY:
        while (count := len(np.unique(_keys(tangents, low, pitch)))) > _MAX_DELAUNAY:
            pitch *= 1.02 * np.sqrt(count / _MAX_DELAUNAY)
        _, few, few_z = _cell_means(tangents, z, _keys(tangents, low, pitch))

    # The spacing is computed from neighbours, not from the bounding box, since a cloud seldom fills
    # its box.
    sample = few[:: max(1, len(few) // 4000)]
    spacing = float(np.median(cKDTree(few).query(sample, k=3)[0][:, 2]))
    pitch = float(np.clip(spacing, pitch, span / _FEWEST_CELLS))

    # Surface: triangles between neighbours, without those across a jump of depth
    try:
        triangles = Delaunay(few).simplices
    except QhullError as error:
        raise PerceptionError(
            "the cloud spans no surface: its points lie on one line in the image"
        ) from error
    triangles = triangles[_coherent(few, few_z, triangles, 4.0 * pitch)]
    if not len(triangles):
        raise PerceptionError("the cloud has no connected surface")

    # Picture of that surface
    tangent_x = np.arange(low[0], high[0] + pitch, pitch)
    tangent_y = np.arange(low[1], high[1] + pitch, pitch)
    if min(len(tangent_x), len(tangent_y)) < 2:
        raise PerceptionError("the cloud spans no surface: its points lie on one line in the image")
    rays = np.stack(
        [*np.meshgrid(tangent_x, tangent_y), np.ones((len(tangent_y), len(tangent_x)))], axis=-1
    )
    vertices = few_z[:, None] * np.column_stack([few, np.ones(len(few))])
    hit = RayScene(vertices, triangles).cast(np.zeros(3), rays)
    return DepthGrid(np.where(np.isfinite(hit["t"]), hit["t"], np.nan), tangent_x, tangent_y)


def _sample(count: int) -> np.ndarray | slice:
    """Indices of at most _SAMPLE of `count`, random, so that they do not alias with rows."""
    return (
        slice(None) if count <= _SAMPLE else np.random.default_rng(0).integers(count, size=_SAMPLE)
    )


def _slope(x: Array, y: Array) -> float:
    """Slope of the least-squares line through `y` (n,) over `x` (n,); 0 where x is constant."""
    x = x - x.mean()
    return float(x @ (y - y.mean()) / max(float(x @ x), 1e-300))


def _even(grid: DepthGrid) -> DepthGrid | None:
    """Return `grid`, or None if its pixels are much longer in one direction than in the other."""
    ratio = (grid.tangent_x[1] - grid.tangent_x[0]) / (grid.tangent_y[1] - grid.tangent_y[0])
    return grid if 1.0 / _UNEVEN < ratio < _UNEVEN else None


def _framed(grid: DepthGrid) -> DepthGrid:
    """Extend `grid` by the empty pixels that probably surrounded it in the sensor's picture.

    Pixels without a point are not in an unordered cloud. If the points do not reach a side of the
    picture, the sensor's picture extended further. It also did if that side is much closer to the
    optical axis than the opposite side. If no surface covers any side, the object is completely
    inside the picture.
    """
    depth = grid.depth
    lines = (grid.tangent_y, grid.tangent_x)
    count = [np.isfinite(depth).sum(axis=1 - axis) for axis in range(2)]

    # Sides that cut through the content have as many points in the last row as further in
    cut = [[of[0] >= _CUT * of[max(1, len(of) // 20)] for of in (n, n[::-1])] for n in count]

    # An object is completely inside the picture if no last row is covered
    filled = np.isfinite(depth).astype(np.float32)
    # pixels may be missing anywhere
    dense = _FULL_SIDE * float(ndimage.uniform_filter(filled, 3)[filled > 0.0].mean())
    alone = all(
        max(n[0], n[-1]) < dense * other for n, other in zip(count, depth.shape[::-1], strict=True)
    )

    # Rows and columns to add at each end
    wider = []
    for line, ends in zip(lines, cut, strict=True):
        reach = (-line[0], line[-1])
        pitch = line[1] - line[0]
        lacking = [int((max(reach) - side) / pitch + 0.5) for side in reach]
        for i in range(2):
            if ends[i] and not alone:
                lacking[i] *= lacking[i] > _OFF_CENTRE * len(line)
            elif alone or lacking[i] <= 1:
                lacking[i] = max(lacking[i], _MARGIN, alone * len(line) // 2)
        wider.append([min(n, len(line) + _MARGIN) for n in lacking])

    # Lines of the extended picture
    tangent_y, tangent_x = (
        line[0] + (line[1] - line[0]) * np.arange(-n[0], len(line) + n[1])
        for line, n in zip(lines, wider, strict=True)
    )
    return DepthGrid(np.pad(depth, wider, constant_values=np.nan), tangent_x, tangent_y)


def _without_strays(points: Array) -> Array:
    """Remove points far beyond all others, which would make the image as wide as they are."""
    tangents = points[:, :2] / points[:, 2:]
    low, high = np.quantile(tangents[_sample(len(tangents))], [_STRAY, 1.0 - _STRAY], axis=0)
    margin = float((high - low).max())
    return points[((tangents >= low - margin) & (tangents <= high + margin)).all(axis=1)]


def _lattice(values: Array) -> tuple[float, float] | None:
    """First line and pitch of the equidistant lines on which `values` (n,) lie; None if there are
    no such lines.

    With such lines the spectrum of the density of the values has peaks at all multiples of 1/pitch,
    as high as at zero.
    """
    low = float(values.min())
    span = float(np.ptp(values))
    if not span > 1e-6:
        return None

    # Spectrum of the density of the values
    density = np.bincount(
        np.minimum(((values - low) * (_BINS / span)).astype(np.int64), _BINS - 1), minlength=_BINS
    )
    height = np.abs(np.fft.rfft(density, 4 * _BINS)) / len(values)  # at multiples of 1 / (4 span)

    # beyond the peak at zero, which is wide for a narrow cloud
    fell = np.nonzero(height < 0.5 * _COMB)[0]
    if not len(fell) or not (peaks := height[fell[0] :]).max() > _COMB:
        return None

    # Pitch: the first of the highest peaks
    begin = fell[0] + int(np.nonzero(peaks > max(_COMB, 0.8 * peaks.max()))[0][0])
    end = begin + int(np.argmax(height[begin:] < 0.5 * height[begin])) or len(height)
    pitch = 4.0 * span / (begin + int(np.argmax(height[begin:end])))

    # First line: from the phase; then first line and pitch by least squares
    phase = float(np.angle(np.exp(2j * np.pi * (values - low) / pitch).mean())) / (2.0 * np.pi)
    start = low + phase * pitch
    for _ in range(3):
        index = np.rint((values - start) / pitch)
        pitch = _slope(index, values)
        if not pitch > 0.0:
            return None
        start = float(np.median(values - pitch * index))

    # Enough of the values must lie near a line
    off = (values - start) / pitch
    share, near = _OFF_LATTICE
    return (start, pitch) if np.mean(np.abs(off - np.rint(off)) < near) >= share else None


def _keys(tangents: Array, low: Array, pitch: float) -> np.ndarray:
    """Index (n,) of the cell of width `pitch`, counted from `low`, that contains each of `tangents`
    (n, 2).
    """
    column, row = ((tangents - low) / pitch).astype(np.int64).T
    return row * (int(column.max()) + 1) + column


def _cell_means(tangents: Array, z: Array, key: np.ndarray) -> tuple[np.ndarray, Array, Array]:
    """Occupied cells (m,), and mean tangents (m, 2) and depth (m,) [m] of the points in each.

    `key` is the cell (n,) of each point. Points that are not on the surface of their cell's median
    are left out. A plane is linear in inverse depth, so a mean of points on a plane is on the plane
    too. Points across an edge are not averaged, because that would create surface that does not
    exist.
    """
    # Points sorted by cell and depth
    order = np.lexsort((z, key))
    key = key[order]
    z = z[order]
    first = np.nonzero(np.r_[True, key[1:] != key[:-1]])[0]
    count = np.diff(np.r_[first, len(key)])
    cell = key[first]

    # the median of two is alternately the nearer and the farther; always the nearer would enlarge
    # near surfaces
    middle = z[first + (count - 1 + cell % 2) // 2]

    # Points on the surface of their cell's median
    same = np.repeat(np.arange(len(cell)), count)
    on = np.abs(z - middle[same]) < jump(middle)[same]
    same = same[on]
    order = order[on]
    z = z[on]

    # Means of the tangents and of the inverse depth
    number = np.bincount(same)
    means = (
        np.column_stack([np.bincount(same, weights=tangents[order, i]) for i in range(2)])
        / number[:, None]
    )
    return cell, means, number / np.bincount(same, weights=1.0 / z)


def _coherent(tangents: Array, z: Array, triangles: np.ndarray, reach: float) -> np.ndarray:
    """Mask of the triangles that join neighbours on one surface, which are short and without a jump
    in depth.
    """
    corners = tangents[triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    z = z[triangles]
    return (edges < reach) & (np.ptp(z, axis=1) < jump(z.min(axis=1)) + 2.0 * reach * z.max(axis=1))
