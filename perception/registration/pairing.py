"""Pairs of scan and visible model in a round of ICP, and their normal equations.

Scan points are paired with planes of the model, depth edges with depth edges.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from uuv.perception.clouds.contours import Contour, contour, outward
from uuv.perception.clouds.nearest_point import NearestPoint
from uuv.perception.clouds.scan import Scan, jump
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.likelihood import OCCLUDER
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

# if a surface turns away more slowly than this, the sensor fails there, and the surface has no edge
SHARP_EDGE = np.cos(np.deg2rad(70.0))
_WINDOW_PIXELS = 80_000  # number of pixels above which depth edges are taken from a thinned grid
_RASTER = 32  # [px] windows of depth edges are extended to about a multiple of this
_BESIDE = (1.5, 3.0, 4.5)  # [px] distance beyond an edge, at which the background is compared
# [-] share of the sharp edges that can show, below which they are too few for a verdict
_SHOWN = 0.1
_BESIDE_OCCLUDER = 2  # [px] width of the margin of mixed pixels around an occluder's picture
_EDGE_BIAS = 0.1  # [px] error that shifts all depth edges sideways, or outward
_HALVINGS = 4  # number of bisections of a pixel, to locate a model's depth edge
_CONTOUR = 5.0  # [px] within which a contour's points give its direction
# [px] largest width of a band without depth next to a surface, in which its outline is searched for
_BAND = 40.0
# [px] by which that band may be wider than the model's own band, where the surface turns away: no
# shadow of stereo
_WIDER = 2.0


class _Outline(NamedTuple):
    """Depth edges of the scan, taken from one side."""

    edges: Contour
    outward: Array  # (n, 2) unit, across the edge in the image
    band: Array  # (n,) [px] without depth between the edge and the surface


@dataclass(frozen=True, slots=True, eq=False)
class DepthEdges:
    """Depth edges of scan and model around the object.

    A sharp edge is where the object's surface ends in the scan. At a smooth edge the surface turns
    away and gives no depth; the edge is where the depth behind it begins.
    """

    ends: _Outline  # outline of the scan, where the surface ends
    behind: _Outline  # outline where the depth behind it begins
    model_points: Array  # (k, 3) [m] in T
    model_outward: Array  # (k, 2) unit
    # (k,) bool: sharp edges, see SHARP_EDGE; the border of an open model is neither
    model_sharp: np.ndarray
    model_smooth: np.ndarray  # (k,) bool: smooth edges
    # (k,) [px] width of the band next to the edge, in which the surface is too steep for an echo
    model_band: Array
    model_step: Array  # (k,) [m] by which the edge is farther than the surface next to that band


@dataclass(frozen=True, slots=True, eq=False)
class PairRows:
    """Pairs of scan and model, one per row.

    A pair's score is J weight distance, with the derivative J slope J^T.
    """

    # (n, 7) derivative of the model point along the pair's direction, by the unknowns of
    # `Pairing.terms`
    J: Array
    weight: Array  # (n,) [1/m^2]
    slope: Array  # (n,) [1/m^2], negative for distances that are far outside the noise
    distance: Array  # (n,) [m] distance of the scan from the model
    tangents: Array  # (n, 2) x/z and y/z of the scan point
    # (n,) [m] standard deviation of the error that all depth edges share; 0 for planes
    common: Array

    @classmethod
    def joined(cls, *parts: "PairRows") -> "PairRows":
        """The rows of several instances, one after the other."""
        return cls(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            )
        )


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """The visible model points and depth edges that a round of ICP compares with the scan."""

    evidence: Evidence
    surface: ModelSurface
    points: Array  # (m, 3) [m] visible, in T
    normals: Array  # (m, 3)
    grid: NearestPoint
    edges: DepthEdges | None

    @classmethod
    def of(
        cls, evidence: Evidence, surface: ModelSurface, X_ST: Array, with_edges: bool = True
    ) -> "Pairing | None":
        """Pairing with the model at `X_ST`; None if fewer than 10 of its points are in view."""
        visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
        if visible.sum() < 10:
            return None
        points = surface.points[visible]
        edges = _edges(evidence, surface, X_ST) if with_edges else None
        return cls(
            evidence,
            surface,
            points,
            surface.normals[visible],
            NearestPoint.of(points, surface.spacing),
            edges,
        )

    def nearest(self, X_ST: Array, gate: float) -> np.ndarray:
        """Index (n,) of the model point nearest to each scan point; the point count if none is."""
        points = transform_points(inverse(X_ST), self.evidence.points)
        return self.grid.query(points, self._reach(gate))[1]

    def _reach(self, gate: float) -> float:
        return gate + 3.0 * self.evidence.median_sigma

    def terms(self, X_ST: Array, gate: float, index: np.ndarray) -> tuple[Array, Array, float]:
        """Normal equations (7, 7), (7,) of planes and edges, and the robust rms [m] of the planes.

        The unknowns are a twist about the model's centre (linear; angular x radius), and growth x
        radius from there. `index` is the result of `nearest`.
        """
        evidence = self.evidence
        surface = self.surface
        H, g, residual = _plane_terms(
            evidence, self.points, self.normals, index, X_ST, self._reach(gate), surface
        )

        if self.edges is not None:
            edges = _edge_rows(self.edges, evidence, X_ST, gate, surface)
            H = H + edges.J.T @ (edges.weight[:, None] * edges.J)
            g = g + edges.J.T @ (edges.weight * edges.distance)
        return H, g, residual

    def rows(self, X_ST: Array, gate: float, index: np.ndarray) -> PairRows:
        """The pairs themselves, planes first and then depth edges; arguments as for `terms`."""
        evidence = self.evidence
        surface = self.surface
        scan, model = _kernel_inputs(evidence, self.points, self.normals, surface)
        center = transform_points(X_ST, surface.center)
        J, terms = _plane_rows(scan, model, index, X_ST, center, self._reach(gate))

        paired = terms[:, 0] > 0.0
        points = evidence.points[paired]
        weight, slope, distance = terms[paired].T
        planes = PairRows(
            J[paired], weight, slope, distance, points[:, :2] / points[:, 2:], np.zeros(len(points))
        )
        return PairRows.joined(planes, self.edge_rows(X_ST, gate))

    def edge_rows(self, X_ST: Array, gate: float) -> PairRows:
        """The pairs of depth edges; arguments as for `terms`."""
        if self.edges is None:
            none = np.zeros(0)
            return PairRows(np.zeros((0, 7)), none, none, none, np.zeros((0, 2)), none)
        return _edge_rows(self.edges, self.evidence, X_ST, gate, self.surface)


def edge_offsets(
    evidence: Evidence, surface: ModelSurface, X_ST: Array
) -> tuple[Array, float, float]:
    """Compare the model's sharp depth edges with those of the scan.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        Offsets (n,) [m] across the edge of edges that have a partner, the share (0..1) of sharp
        edge with a partner, and the share beyond which the scanned surface continues. The shares
        are NaN without sharp edges in view.
    """
    edges = _edges(evidence, surface, X_ST)
    if edges is None or edges.model_sharp.sum() < 20 or not len(edges.ends.edges.rows):
        return np.zeros(0), np.nan, np.nan

    # Sharp edges that can show: without an occluder in front, and with the background well behind
    sharp = edges.model_sharp
    points = transform_points(X_ST, edges.model_points[sharp])
    tangents = points[:, :2] / points[:, 2:]
    normal = edges.model_outward[sharp]
    shown = ~_hidden(evidence, points) & ~_resting(evidence, points, normal)
    if shown.sum() < max(20, _SHOWN * len(points)):
        return np.zeros(0), np.nan, np.nan
    points = points[shown]
    tangents = tangents[shown]
    normal = normal[shown]

    # Nearest edge of the scan at the same depth, in the same direction
    ends = edges.ends.edges
    tree = cKDTree(ends.tangents)
    distance, index = tree.query(tangents, distance_upper_bound=0.06 / float(points[:, 2].min()))
    paired = np.isfinite(distance)
    index = np.where(paired, index, 0)
    paired &= np.abs(ends.depth[index] - points[:, 2]) < 2.0 * jump(points[:, 2])
    paired &= np.einsum("ij,ij->i", edges.ends.outward[index], normal) > 0.5

    offsets = np.einsum("ij,ij->i", ends.tangents[index] - tangents, normal) * points[:, 2]

    # Where the scanned surface continues at the same depth, both a little and further beyond the
    # edge
    goes_on = np.ones(len(points), dtype=bool)
    for beyond in (0.03, 0.05):
        probe = np.column_stack([points[:, :2] + beyond * normal, points[:, 2]])
        row, column, inside = evidence.scan.pixels(probe)
        step = np.maximum(0.5 * jump(points[:, 2]), 3.0 * evidence.sensor.sigma(points[:, 2]))
        goes_on &= inside & evidence.mask[row, column]
        goes_on &= np.abs(evidence.scan.depth[row, column] - points[:, 2]) < step
        # a part of the model in front of another part does not end the model
        goes_on &= ~surface.covers(X_ST, probe)

    return offsets[paired], float(paired.mean()), float((goes_on & ~paired).mean())


def _hidden(evidence: Evidence, points: Array) -> np.ndarray:
    """Mask (n,) of the model's edges (n, 3) [m] in S with an occluder in front of them."""
    row, column, _ = evidence.scan.pixels(points)
    first = np.where(np.isfinite(evidence.scan.depth), evidence.scan.depth, np.inf)
    nearest = ndimage.minimum_filter(first, 2 * _BESIDE_OCCLUDER + 1)[row, column]
    return nearest < points[:, 2] - np.maximum(OCCLUDER, 6.0 * evidence.sensor.sigma(points[:, 2]))


def _resting(evidence: Evidence, points: Array, normal: Array) -> np.ndarray:
    """Mask (n,) of the model's edges (n, 3) [m] in S that the background hides by contact.

    `normal` (n, 2) are unit directions across the edges, outward in the image.
    """
    resting = np.zeros(len(points), dtype=bool)
    for pixels in _BESIDE:
        beyond = points[:, :2] / points[:, 2:] + pixels * evidence.scan.pitch * normal
        row, column, inside = evidence.scan.pixels(
            np.column_stack([beyond, np.ones(len(beyond))]) * points[:, 2:]
        )

        step = evidence.scan.depth[row, column] - points[:, 2]
        with np.errstate(invalid="ignore"):
            resting |= (
                inside & ~evidence.standing[row, column] & (np.abs(step) < jump(points[:, 2]))
            )
    return resting


class _Readings(NamedTuple):
    """Scan points in the form of the kernel; fields as in `Evidence`."""

    points: Array  # (n, 3) [m] in S
    normals: Array  # (n, 3)
    sigma: Array  # (n,) [m]
    independent: Array  # (n,) [-]


class _ModelPoints(NamedTuple):
    """Visible model points in the form of the kernel; fields as in `ModelSurface`."""

    points: Array  # (m, 3) [m] in T
    normals: Array  # (m, 3)
    spacing: float  # [m]
    radius: float  # [m]


def _kernel_inputs(
    evidence: Evidence, points: Array, normals: Array, surface: ModelSurface
) -> tuple[_Readings, _ModelPoints]:
    scan = _Readings(evidence.points, evidence.normals, evidence.sigma, evidence.independent)
    return scan, _ModelPoints(points, normals, surface.spacing, surface.radius)


def _plane_terms(
    evidence: Evidence,
    model_points: Array,
    model_normals: Array,
    index: np.ndarray,
    X_ST: Array,
    gate: float,
    surface: ModelSurface,
) -> tuple[Array, Array, float]:
    """Normal equations (7, 7), (7,) of the scan-to-model distances, and their robust rms [m]."""
    scan, model = _kernel_inputs(evidence, model_points, model_normals, surface)
    H, g, sums = _plane_sums(scan, model, index, X_ST, transform_points(X_ST, surface.center), gate)
    return H, g, float(np.sqrt(sums[1] / sums[0])) if sums[0] > 0.0 else np.inf


@kernel
def _pair(
    scan: _Readings,
    model: _ModelPoints,
    n: int,
    i: int,
    X_ST: Array,
    center: Array,
    gate: float,
    J: Array,
) -> tuple[float, float, float]:
    """Weight, slope [1/m^2] and distance [m] of the pair of scan point `n` and model point `i`.

    The Jacobian row `J` (7,) is written too. The weight is 0 if the pair is not used. The score is
    weight times distance along the normal; the slope is its derivative by that distance.
    """
    # Model point and normal in S, towards the sensor
    q = np.empty(3)
    m = np.empty(3)
    for a in range(3):
        q[a] = X_ST[a, 3]
        m[a] = 0.0
        for b in range(3):
            q[a] += X_ST[a, b] * model.points[i, b]
            m[a] += X_ST[a, b] * model.normals[i, b]
    facing = -1.0 if m[0] * q[0] + m[1] * q[1] + m[2] * q[2] > 0.0 else 1.0

    # Distance along the normal, total distance, and angle of the normals
    along = 0.0
    square = 0.0
    cosine = 0.0
    for a in range(3):
        m[a] *= facing
        off = scan.points[n, a] - q[a]
        along += m[a] * off
        square += off * off
        cosine += m[a] * scan.normals[n, a]

    # Beyond the rim of the visible part the nearest point is sideways; such pairs are dropped.
    if square >= gate**2 or square - along**2 >= (1.5 * model.spacing) ** 2 or cosine <= 0.5:
        return 0.0, 0.0, 0.0

    # Robust weight, and slope of the score
    sigma = scan.sigma[n]
    u = (along / max(2.0 * sigma, 0.25 * gate)) ** 2
    full = scan.independent[n] / (sigma**2 + 1e-6)

    # Jacobian: twist about the model's centre, and growth
    for a in range(3):
        q[a] = (q[a] - center[a]) / model.radius
        J[a] = m[a]
    J[3] = q[1] * m[2] - q[2] * m[1]
    J[4] = q[2] * m[0] - q[0] * m[2]
    J[5] = q[0] * m[1] - q[1] * m[0]
    J[6] = q[0] * m[0] + q[1] * m[1] + q[2] * m[2]
    return full / (1.0 + u) ** 2, full * (1.0 - 3.0 * u) / (1.0 + u) ** 3, along


@kernel
def _plane_sums(
    scan: _Readings, model: _ModelPoints, index: np.ndarray, X_ST: Array, center: Array, gate: float
) -> tuple[Array, Array, Array]:
    """Normal equations as in `_plane_terms`, and sums (2,) of weights and weighted squares."""
    H = np.zeros((7, 7))
    g = np.zeros(7)
    sums = np.zeros(2)
    J = np.empty(7)
    pairs = 0

    for n in range(len(scan.points)):
        if index[n] >= len(model.points):
            continue
        weight, _, along = _pair(scan, model, n, index[n], X_ST, center, gate, J)
        if weight == 0.0:
            continue
        pairs += 1
        sums[0] += weight
        sums[1] += weight * along**2

        for a in range(7):
            g[a] += weight * along * J[a]
            for b in range(a + 1):
                H[a, b] += weight * J[a] * J[b]

    if pairs < 6:
        return np.zeros((7, 7)), np.zeros(7), np.zeros(2)
    for a in range(7):
        for b in range(a):
            H[b, a] = H[a, b]
    return H, g, sums


@kernel
def _plane_rows(
    scan: _Readings, model: _ModelPoints, index: np.ndarray, X_ST: Array, center: Array, gate: float
) -> tuple[Array, Array]:
    """Jacobian rows (n, 7), and weight, slope [1/m^2], distance [m] (n, 3) of the pairs, or 0."""
    rows = np.zeros((len(scan.points), 7))
    terms = np.zeros((len(scan.points), 3))
    for n in range(len(scan.points)):
        if index[n] < len(model.points):
            terms[n] = _pair(scan, model, n, index[n], X_ST, center, gate, rows[n])
    return rows, terms


def _rows(direction: Array, at: Array, X_ST: Array, surface: ModelSurface) -> Array:
    """Jacobian rows (n, 7) of `direction . at` for a twist about the model's centre, and growth.

    Rotation and growth are scaled by the model's radius.
    """
    arm = (at - transform_points(X_ST, surface.center)) / surface.radius
    return np.column_stack(
        [direction, np.cross(arm, direction), np.einsum("ij,ij->i", arm, direction)]
    )


def _edges(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> DepthEdges | None:
    """Depth edges of scan and model around the model at `X_ST`; None if either has too few."""
    scan = evidence.scan
    rows, columns = scan.window(transform_points(X_ST, surface.hull), 0.1, _WINDOW_PIXELS)
    if rows.stop <= rows.start or columns.stop <= columns.start or not evidence.mask.any():
        return None
    part = scan.part(_rastered(scan, rows, columns))
    if min(part.depth.shape) < 8:
        return None

    # Edges of the scan, and of the model on the same pixels
    ends, behind = _scan_edges(evidence, rows.step or 1)
    model, cosine = surface.seen(X_ST, part)
    covered = np.isfinite(model.depth)
    of_model = contour(model, covered, model.depth, seams=False)
    if max(len(ends.edges.rows), len(behind.edges.rows)) < 10 or len(of_model.rows) < 10:
        return None

    # Model's edges to a fraction of a pixel, in T
    tangents = _refined(surface, X_ST, part, of_model)
    points = of_model.depth[:, None] * np.column_stack([tangents, np.ones(len(tangents))])
    points = transform_points(inverse(X_ST), points)

    # Width of the band that is too steep for an echo, and kind of each edge
    at = of_model.rows, of_model.columns
    band, (row, column) = _to_nearest(covered & (cosine > np.cos(evidence.sensor.max_incidence)))
    sharp = cosine[at] > SHARP_EDGE
    whole = ~surface.on_border(points)
    return DepthEdges(
        ends=ends,
        behind=behind,
        model_points=points,
        model_outward=_across(tangents / part.pitches, of_model.steps),
        model_sharp=sharp & whole,
        model_smooth=~sharp & whole,
        model_band=band[at],
        model_step=of_model.depth - model.depth[row[at], column[at]],
    )


def _across(pixels: Array, steps: np.ndarray) -> Array:
    """Unit directions (n, 2) across the contours through points (n, 2) [px], along the `steps`.

    With a wrong direction, motions along the contour, which the contour does not resist, would
    count as motions across it.
    """
    order = np.argsort(pixels[:, 0], kind="stable")
    directions = np.empty_like(pixels)
    directions[order] = _across_sorted(pixels[order], steps[order].astype(np.float64))
    return directions


@kernel
def _across_sorted(pixels: Array, steps: Array) -> Array:
    """As `_across`, for points sorted by their first coordinate."""
    n = len(pixels)
    rough = np.zeros((n, 2))
    across = np.empty((n, 2))
    first = np.empty(n, dtype=np.int64)
    last = np.empty(n, dtype=np.int64)

    # Mean step of the neighbours; they lie between `first` and `last` in the sorted row
    low, high = 0, 0
    for i in range(n):
        while pixels[low, 0] < pixels[i, 0] - _CONTOUR:
            low += 1
        while high < n and pixels[high, 0] <= pixels[i, 0] + _CONTOUR:
            high += 1
        first[i] = low
        last[i] = high
        for j in range(low, high):
            if (pixels[j, 0] - pixels[i, 0]) ** 2 + (
                pixels[j, 1] - pixels[i, 1]
            ) ** 2 < _CONTOUR**2:
                rough[i, 0] += steps[j, 0]
                rough[i, 1] += steps[j, 1]

        length = max(np.hypot(rough[i, 0], rough[i, 1]), 1e-12)
        rough[i] /= length

    # Direction of the line through those neighbours whose steps have the same direction
    for i in range(n):
        total = 0.0
        mx = 0.0
        my = 0.0
        xx = 0.0
        xy = 0.0
        yy = 0.0
        for j in range(first[i], last[i]):
            x, y = pixels[j, 0] - pixels[i, 0], pixels[j, 1] - pixels[i, 1]
            if (
                x * x + y * y < _CONTOUR**2
                and rough[j, 0] * rough[i, 0] + rough[j, 1] * rough[i, 1] > 0.7
            ):
                total += 1.0
                mx += x
                my += y
                xx += x * x
                xy += x * y
                yy += y * y

        across[i] = rough[i]

        # Perpendicular to it, on the side of the step, if the two agree
        if total > 0.0:
            xx -= mx * mx / total
            xy -= mx * my / total
            yy -= my * my / total
            along = 0.5 * np.arctan2(2.0 * xy, xx - yy)
            x, y = -np.sin(along), np.cos(along)
            agree = x * rough[i, 0] + y * rough[i, 1]
            if abs(agree) > 0.7:
                across[i, 0], across[i, 1] = np.sign(agree) * x, np.sign(agree) * y
    return across


def _nearest_in_image(points: Array, at: Array, reach: float) -> np.ndarray:
    """Index (n,) of the nearest of `points` (k, 2) to each of `at` (n, 2); -1 beyond `reach`."""
    order = np.argsort(points[:, 0], kind="stable")
    nearest = _nearest_sorted(points[order], at, reach)
    return np.where(nearest >= 0, order[nearest], -1)


@kernel
def _nearest_sorted(points: Array, at: Array, reach: float) -> np.ndarray:
    """As `_nearest_in_image`, for points sorted by their first coordinate."""
    index = np.full(len(at), -1)
    start = np.searchsorted(points[:, 0], at[:, 0])

    # Outwards in both directions, until the first coordinate alone is too far
    for i in range(len(at)):
        nearest = reach * reach
        for way in (-1, 1):
            j = start[i] - 1 if way < 0 else start[i]
            while 0 <= j < len(points):
                x = points[j, 0] - at[i, 0]
                if x * x >= nearest:
                    break
                square = x * x + (points[j, 1] - at[i, 1]) ** 2
                if square < nearest:
                    nearest, index[i] = square, j
                j += way
    return index


def _to_nearest(mask: np.ndarray) -> tuple[Array, tuple[np.ndarray, np.ndarray]]:
    """Distances (h, w) [px] to the nearest pixel of `mask`, and its row and column (h, w)."""
    if not mask.any():
        here = np.indices(mask.shape)
        return np.full(mask.shape, np.inf), (here[0], here[1])

    distance, index = ndimage.distance_transform_edt(~mask, return_indices=True)
    return distance, (index[0], index[1])


def _rastered(scan: Scan, rows: slice, columns: slice) -> tuple[slice, slice]:
    """Window extended to a raster, so that all windows of a step have the same pixels.

    The raster is counted from the optical axis, which is mostly midway between two pixels. The
    pixels are therefore the same regardless of how the picture is cropped.
    """
    slices = []
    for window, tangents, pitch in zip(
        (rows, columns), (scan.tangent_y, scan.tangent_x), scan.pitches[::-1], strict=True
    ):
        # index of the picture's first pixel on the raster
        first = round(float(tangents[0]) / pitch + 0.25)

        step = window.step or 1

        # Both ends on the raster, the first within the picture
        raster = step * (_RASTER // step)
        start = window.start - (window.start + first) % raster
        stop = window.stop + -(window.stop + first) % raster
        slices.append(slice(start if start >= 0 else start % step, stop, step))
    return slices[0], slices[1]


def _refined(surface: ModelSurface, X_ST: Array, part: Scan, found: Contour) -> Array:
    """Tangents (n, 2) of the model's edges `found` on the grid of `part`, finer than a pixel."""
    X_TS = inverse(X_ST)
    step = jump(found.depth)
    middle = np.column_stack([part.tangent_x[found.columns], part.tangent_y[found.rows]])
    at = np.full(len(found.rows), 0.5)  # [px] from the middle of the near pixel

    # Bisection: does the ray still hit the model?
    for halving in range(_HALVINGS):
        rays = np.column_stack(
            [middle + part.pitches * at[:, None] * found.steps, np.ones(len(at))]
        )
        depth = surface.scene.distance(X_TS[:3, 3], rays @ X_TS[:3, :3].T)
        at += np.where(depth - found.depth <= step, 0.25, -0.25) / 2.0**halving
    return middle + part.pitches * at[:, None] * found.steps


@remembered(8)
def _scan_edges(evidence: Evidence, step: int) -> tuple[_Outline, _Outline]:
    """Depth edges of the scan: where the surface ends, and where the depth behind it begins."""
    around = round(_BAND) + 2 * step
    rows, columns = (
        slice(max(0, int(lines[0]) - around), int(lines[-1]) + 1 + around, step)
        for lines in (
            np.nonzero(evidence.mask.any(axis=1))[0],
            np.nonzero(evidence.mask.any(axis=0))[0],
        )
    )

    window = _rastered(evidence.scan, rows, columns)
    part = evidence.scan.part(window)
    mask = evidence.mask[window]
    edges = contour(part, mask, part.depth)
    ends = _Outline(
        edges, outward(mask, part.depth, edges.rows, edges.columns), np.zeros(len(edges.rows))
    )

    # The surface continues at its depth up to where there is depth again.
    band, nearest = _to_nearest(mask)
    filled = mask | (~np.isfinite(part.depth) & (band < _BAND))
    depth = np.where(filled, part.depth[nearest], part.depth)

    edges = contour(Scan.of_grid(depth, part.tangent_x, part.tangent_y), filled, depth)
    edges = edges.only(
        np.isfinite(depth[edges.rows + edges.steps[:, 1], edges.columns + edges.steps[:, 0]])
    )

    at = edges.rows, edges.columns
    return ends, _Outline(edges, outward(filled, depth, *at), band[at])


def _edge_rows(
    edges: DepthEdges, evidence: Evidence, X_ST: Array, gate: float, surface: ModelSurface
) -> PairRows:
    """Pairs of depth edges: distances across them in the image plane."""
    points = transform_points(X_ST, edges.model_points)
    tangents = points[:, :2] / points[:, 2:]
    reach = gate / float(np.median(points[:, 2]))

    # Partners of either kind of edge: near, at similar depth, of the same rim and direction
    sides = []
    for side, of_kind in ((edges.ends, edges.model_sharp), (edges.behind, edges.model_smooth)):
        if not of_kind.any():
            continue
        index = _nearest_in_image(tangents, side.edges.tangents, reach)
        paired = index >= 0
        paired &= of_kind[index]
        step = jump(points[index, 2])
        nearer = points[index, 2] - side.edges.depth
        paired &= (nearer > -step) & (
            nearer < np.where(edges.model_smooth[index], edges.model_step[index], 0.0) + step
        )
        paired &= side.band <= edges.model_band[index] + _WIDER
        paired &= np.einsum("ij,ij->i", side.outward, edges.model_outward[index]) > 0.7
        sides.append((index[paired], side.edges.tangents[paired]))

    sides = sides or [(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))]
    index, measured = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    if len(index) < 10:
        index = index[:0]
        measured = measured[:0]

    # Distance across the edge in the image plane, scaled to the depth
    P = points[index]
    m = edges.model_outward[index]
    across = np.einsum("ij,ij->i", measured - tangents[index], m) * P[:, 2]
    # d(m . P_xy / z) z = (m, -m . P_xy / z) . dP
    direction = np.column_stack([m, -np.einsum("ij,ij->i", m, tangents[index])])

    # Noise of a reading, and its robust weight
    pitch = evidence.scan.pitch * P[:, 2]
    # Mixed depths at an edge differ from pixel to pixel: each pixel is an independent reading.
    sigma = evidence.sensor.edge_sigma * pitch
    u = (across / np.maximum(3.0 * pitch, 0.25 * gate)) ** 2
    return PairRows(
        J=_rows(direction, P, X_ST, surface),
        weight=1.0 / (1.0 + u) ** 2 / sigma**2,
        slope=(1.0 - 3.0 * u) / (1.0 + u) ** 3 / sigma**2,
        distance=across,
        tangents=measured,
        common=_EDGE_BIAS * pitch,
    )
