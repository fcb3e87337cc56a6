"""Scan: a depth frame as points on a pixel grid, with segmentation and triangulation.

Sensor frame S has OpenCV axes (z along the optical axis). Point clouds are converted to such a grid
(`cloud_grid`), so that all later steps have one data type.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from uuv.models.meshes.ray_casting import RayScene
from uuv.perception.clouds.cloud_grid import jump, lattice_grid, organised_grid, scatter_grid
from uuv.perception.clouds.likely_causes import other_axes
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import Array, number, readonly, real_array

# [m] largest sigma of depth at 1 m; with 0.02 a barrel 10 cm thinner is accepted as the barrel
SIGMA_ALLOWED = (1e-6, 0.01)
MIN_POINTS = 60  # with fewer points no pose can be distinguished from noise
_ENDLESS = 1e5  # [m] along an axis; larger coordinates are invalid
_SAMPLED = 20_000  # approximate number of pixels to which background planes are fitted
_FACET = 0.056  # [rad] width of the surface (31 px of the usual camera) for a local normal
_ALIGNED = np.cos(np.deg2rad(20.0))  # least cosine between a local normal and that of its plane
# large odd factors of `row_hash`
_FACTORS = np.array([0x1E3779B97F4A7C15, 0x3F58476D1CE4E5B9, 0x14D049BB133111EB])
_CREASE = np.cos(np.deg2rad(40.0))  # cosine of the angle between normals at which one surface ends
_WIDTHS = 8  # number of directions in which the width of a plane is measured
_OUTER = (1.0, 99.0)  # [%] percentiles of its points between which the width is measured
# [-] width over the object's extent, from which on a plane that the picture does not cut is
# background
_UNCUT = 1.4
# rows or columns at the border of the thinned picture, and number of pixels there, of a plane that
# the border cuts
_RIM, _CUT = 4, 8
# [px] distance of two pixels on a plane, in the thinned picture, up to which they are connected
_GAP = 2
_NORMAL = 1.4826  # standard deviation of normal errors over their median absolute value
# [sigma] threshold in units of a plane's own roughness: pixels that are farther off on average rise
# above the plane
_ROUGH = 4.0
_FLAT = 0.002  # [m] least roughness
_COUNTED = 1e6  # largest number of cubes with which `voxel_means` counts the points of each cube
_RAY_CELLS = 400  # number of cells along the longer side of a grid of parallel rays
_SINGLE = 1e-5  # [m] margin, larger than the rounding of rays in single precision


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """Assumed accuracy of the depth sensor (a stereo pair)."""

    focal: float = 554.0  # [px]
    baseline: float = 0.12  # [m]
    disparity_sigma: float = 0.25  # [px]
    # [px] correlation length of the depth errors: the distance of two independent readings
    noise_length: float = 5.0
    # [px] standard deviation of a depth edge's position; half the window for matchers with large
    # windows
    edge_sigma: float = 1.0
    max_incidence: float = np.deg2rad(75.0)  # [rad] largest incidence with an echo

    def __post_init__(self) -> None:
        for field in fields(self):
            number(getattr(self, field.name), f"sensor model: {field.name}")

        if not (
            self.focal > 0.0
            and self.baseline > 0.0
            and self.disparity_sigma > 0.0
            and self.edge_sigma > 0.0
        ):
            raise ConfigurationError(
                "sensor model: focal, baseline, disparity_sigma and edge_sigma must be positive, "
                f"got {self}"
            )

        # A wrong unit shows in the accuracy at 1 m
        least, most = SIGMA_ALLOWED
        if not least <= float(self.sigma(1.0)) <= most:
            raise ConfigurationError(
                f"sensor model: the standard deviation of depth at 1 m must be within {least:g} to "
                f"{most:g} m, got {float(self.sigma(1.0)):g} m from {self}"
            )

        if not 1.0 <= self.noise_length < np.inf:
            raise ConfigurationError(
                f"sensor model: noise_length must be at least 1 [px], got {self.noise_length}"
            )
        if not 0.0 < self.max_incidence < 0.5 * np.pi:
            raise ConfigurationError(
                f"sensor model: max_incidence must lie in (0, pi/2), got {self.max_incidence}"
            )

    def sigma(self, z: ArrayLike) -> Array:
        """Standard deviation [m] of depth at depth `z` [m]: z^2 sigma_d / (f b)."""
        return np.square(np.asarray(z, dtype=np.float64)) * (
            self.disparity_sigma / (self.focal * self.baseline)
        )

    def independent(self, pixels: ArrayLike) -> Array:
        """Share (0..1) of an independent reading for each of points `pixels` [px] apart."""
        return np.minimum(1.0, np.square(np.asarray(pixels, dtype=np.float64) / self.noise_length))

    @property
    def information(self) -> float:
        """Information [1/m^2] of one pixel among many at a depth of 1 m."""
        return float(self.independent(1.0) / self.sigma(1.0) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class KnownObjects:
    """Objects already identified in a scan; they explain their pixels and occlude others."""

    depth: Array  # (h, w) [m] depth of their models, inf outside them
    shown: np.ndarray  # (h, w) pixels of the scan that show them

    def part(self, window: tuple[slice, slice]) -> "KnownObjects":
        """Rows and columns of `window`."""
        return KnownObjects(self.depth[window], self.shown[window])

    def joined(self, others: "KnownObjects") -> "KnownObjects":
        """These and `others` in the same scan."""
        return KnownObjects(np.minimum(self.depth, others.depth), self.shown | others.shown)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """One frame of a depth sensor: a point in sensor frame S for each pixel of a pinhole grid."""

    points: Array  # (h, w, 3) [m], NaN without echo
    tangent_x: Array  # (w,) x/z of each column
    tangent_y: Array  # (h,) y/z of each row
    known: "KnownObjects | None" = None  # other objects that were identified in the scan already
    doubt: str = ""  # sign of a cloud in other axes than those of S; empty if there is none

    @property
    def depth(self) -> Array:
        """Depth (h, w) [m] along the optical axis."""
        return self.points[..., 2]

    @cached_property
    def pitches(self) -> Array:
        """Angles (2,) between neighbouring columns and between neighbouring rows, as tangents."""
        return readonly(
            [self.tangent_x[1] - self.tangent_x[0], self.tangent_y[1] - self.tangent_y[0]]
        )

    @cached_property
    def pitch(self) -> float:
        """Angle between neighbouring pixels, as a tangent; the geometric mean of `pitches`."""
        return float(np.sqrt(self.pitches.prod()))

    @property
    def rays(self) -> Array:
        """Lines of sight (h, w, 3) of the pixels, scaled to a depth of 1."""
        x, y = np.meshgrid(self.tangent_x, self.tangent_y)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def lines_of_sight(self, rows: np.ndarray, columns: np.ndarray) -> Array:
        """Lines of sight (n, 3) of some pixels, as in `rays`."""
        return np.column_stack([self.tangent_x[columns], self.tangent_y[rows], np.ones(len(rows))])

    def pixels(self, points: Array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row and column (n,) of points (n, 3) in S, clipped to the grid; mask of those within."""
        with np.errstate(divide="ignore", invalid="ignore"):
            tangents = points[:, :2] / points[:, 2:]
        tangents = np.where(points[:, 2:] > 0.0, tangents, np.inf)

        column = (tangents[:, 0] - self.tangent_x[0]) / self.pitches[0]
        row = (tangents[:, 1] - self.tangent_y[0]) / self.pitches[1]
        height, width = self.depth.shape
        inside = (column >= 0.0) & (column <= width - 1) & (row >= 0.0) & (row <= height - 1)

        return (
            np.rint(np.clip(row, 0, height - 1)).astype(int),
            np.rint(np.clip(column, 0, width - 1)).astype(int),
            inside,
        )

    def part(self, window: tuple[slice, slice]) -> "Scan":
        """The part of the scan in the rows and columns of `window`, which may thin the grid."""
        return Scan(
            points=self.points[window],
            tangent_x=self.tangent_x[window[1]],
            tangent_y=self.tangent_y[window[0]],
            known=None if self.known is None else self.known.part(window),
        )

    def window(self, points: Array, margin: float, pixels: int) -> tuple[slice, slice]:
        """Rows and columns around the picture of given points, for `part`.

        Args:
            points: (n, 3) [m] in S.
            margin: [-] added on each side, as a share of the picture's size.
            pixels: Approximate largest number of pixels to which the steps thin the window.

        Returns:
            Slices of rows and of columns; empty if no point lies in front of the sensor.
        """
        row, column, _ = self.pixels(points[points[:, 2] > 0.0])
        if not len(row):
            return slice(0, 0), slice(0, 0)

        # Window around the picture of the points
        border = 4 + int(margin * max(np.ptp(row), np.ptp(column)))
        top = max(0, int(row.min()) - border)
        bottom = int(row.max()) + border + 1
        left = max(0, int(column.min()) - border)
        right = int(column.max()) + border + 1

        # Steps that thin the part of the window inside the grid
        height, width = (
            min(bottom, self.depth.shape[0]) - top,
            min(right, self.depth.shape[1]) - left,
        )
        stride = max(1, int(np.ceil(np.sqrt(height * width / pixels))))
        return slice(top, bottom, stride), slice(left, right, stride)

    @classmethod
    def from_depth(cls, image: DepthImage) -> "Scan":
        """Scan of a depth frame, with the frame's pinhole matrix.

        Raises:
            ConfigurationError: The frame is malformed.
        """
        depth = np.asarray(image.depth, dtype=np.float64)
        if depth.ndim != 2 or min(depth.shape) < 2:
            raise ConfigurationError(
                f"depth frame: expected (height, width) numbers, got shape {depth.shape}"
            )

        K = np.asarray(image.K, dtype=np.float64)
        if K.shape != (3, 3) or not np.all(np.isfinite(K)) or K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
            raise ConfigurationError(f"depth frame: K must be a pinhole matrix, got {K.tolist()}")
        if abs(K[0, 0] / K[1, 1] - 1.0) > 1e-3:
            raise ConfigurationError(
                f"depth frame: pixels must be square, got focal lengths {K[0, 0]} and {K[1, 1]}"
            )

        depth = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan)
        tangent_x = (np.arange(depth.shape[1]) - K[0, 2]) / K[0, 0]
        tangent_y = (np.arange(depth.shape[0]) - K[1, 2]) / K[1, 1]
        return cls.of_grid(depth, tangent_x, tangent_y)

    @classmethod
    def from_cloud(cls, cloud: ArrayLike) -> "Scan":
        """Scan of an unordered (n, 3) or organised (h, w, 3) cloud [m] in S.

        If the cloud has the pixels of a depth sensor, they are kept or recovered (`cloud_grid`).
        Points behind the sensor (z <= 0) or farther than 100 km are left out.

        Raises:
            ConfigurationError: The array is not a cloud.
            PerceptionError: Too few points are left, or they span no surface.
        """
        coordinates = real_array(cloud, "cloud", "(N, 3) numbers [m]")
        if coordinates.size == 0:
            raise PerceptionError("the cloud is empty")
        if coordinates.ndim not in (2, 3) or coordinates.shape[-1] != 3:
            raise ConfigurationError(
                f"cloud: expected (N, 3) or (H, W, 3) numbers [m], got shape {coordinates.shape}"
            )

        # Usable points
        usable = (np.abs(coordinates) < _ENDLESS).all(axis=-1) & (
            coordinates[..., 2] > 1e-3
        )  # False for NaN
        count = int(usable.sum())
        doubt = other_axes(coordinates[(np.abs(coordinates) < _ENDLESS).all(axis=-1)])
        if count < MIN_POINTS:
            raise PerceptionError(
                f"only {count} usable points of {coordinates.size // 3}; need {MIN_POINTS}"
                + (f"; {doubt}" if doubt else "")
            )

        # Pixels of the sensor if the cloud has them, else those of a virtual pinhole
        grid = organised_grid(coordinates, usable) if coordinates.ndim == 3 else None
        if grid is None:
            points = coordinates[usable]
            grid = lattice_grid(points) or scatter_grid(points)
        scan = cls.of_grid(grid.depth, grid.tangent_x, grid.tangent_y)
        return replace(scan, doubt=doubt)

    @classmethod
    def of_grid(cls, depth: Array, tangent_x: Array, tangent_y: Array) -> "Scan":
        """Scan of a depth image on a pinhole's grid.

        Args:
            depth: (h, w) [m], NaN without echo.
            tangent_x: (w,) x/z of each column.
            tangent_y: (h,) y/z of each row.

        Returns:
            The scan, its points in S.
        """
        points = np.stack([depth * tangent_x, depth * tangent_y[:, None], depth], axis=-1)
        return cls(
            points=readonly(points), tangent_x=readonly(tangent_x), tangent_y=readonly(tangent_y)
        )


def triangulate(scan: Scan, mask: np.ndarray) -> tuple[Array, np.ndarray]:
    """Triangulated surface of the masked (h, w) pixels: vertices (v, 3) [m] in S, triangles (t, 3).

    There are two triangles for each cell of the grid, except where depth jumps.
    """
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(int(mask.sum()))
    vertices = scan.points[mask]

    # Two triangles per cell, if all their corners are in the mask
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)]
    )
    a, b, c = faces.T
    faces = faces[(a >= 0) & (b >= 0) & (c >= 0)]

    # Triangles across a jump of depth are left out
    a, b, c = vertices[:, 2][faces.T]
    nearest = np.minimum(np.minimum(a, b), c)
    return vertices, faces[np.maximum(np.maximum(a, b), c) - nearest < jump(nearest)]


def distances_along(scan: Scan, starts: Array, way: Array) -> Array | None:
    """Distances from points to the triangulated surface of a scan, all in one direction.

    Args:
        scan: The scan.
        starts: (n, 3) [m] in S.
        way: (3,) unit direction in S.

    Returns:
        Distances (n,) [m], inf where the surface is missed; None if the scan has no surface.
    """
    vertices, triangles = triangulate(scan, np.isfinite(scan.depth))
    if not len(triangles):
        return None

    # Most of a scan is outside the rays, and building a ray caster takes longer than casting.
    triangles = triangles[_may_be_met(vertices, triangles, starts, way)]
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True

    scene = RayScene(vertices[used], (np.cumsum(used) - 1)[triangles])
    return scene.distance(starts, np.broadcast_to(way, starts.shape))


def _may_be_met(vertices: Array, triangles: np.ndarray, starts: Array, way: Array) -> np.ndarray:
    """Mask (t,) of the triangles whose bounding rectangle along `way` (3,) contains a start."""
    # Rays and vertices in a plane perpendicular to the rays
    across = np.linalg.svd(way[None])[2][1:].T
    rays = starts @ across
    projected = vertices @ across
    corner = rays.min(axis=0)
    extent = np.ptp(rays, axis=0)

    # Summed-area table: number of rays below and left of each corner of a grid
    cell = max(float(extent.max()) / _RAY_CELLS, _SINGLE)
    shape = (extent / cell).astype(int) + 1
    counts = np.zeros(shape + 1, dtype=np.int32)
    np.add.at(counts, tuple(((rays - corner) / cell).astype(int).T + 1), 1)
    before = counts.cumsum(axis=0).cumsum(axis=1)  # rays in all cells below a corner of the grid

    # Rectangle around each triangle, in cells
    low = np.clip((projected - _SINGLE - corner) / cell, 0, shape).astype(np.int32)
    high = np.clip((projected + _SINGLE - corner) / cell + 1.0, 0, shape).astype(np.int32)
    a, b, c = triangles.T
    (left, top), (right, bottom) = (
        np.minimum(np.minimum(low[a], low[b]), low[c]).T,
        np.maximum(np.maximum(high[a], high[b]), high[c]).T,
    )

    # Number of rays within it
    return before[right, bottom] - before[left, bottom] - before[right, top] + before[left, top] > 0


def without_flying_pixels(scan: Scan) -> np.ndarray:
    """Mask (h, w) of pixels that are on the same surface as at least 3 of their 8 neighbours."""
    z = scan.depth
    step = jump(z)

    support = np.zeros(z.shape, dtype=np.int8)
    right = (np.s_[:, :-1], np.s_[:, 1:])
    down = (np.s_[:-1], np.s_[1:])
    up = (np.s_[1:, :-1], np.s_[:-1, 1:])
    for here, beside in (right, down, up, (np.s_[:-1, :-1], np.s_[1:, 1:])):
        apart = np.abs(z[here] - z[beside])
        support[here] += apart < step[here]
        support[beside] += apart < step[beside]

    return support >= 3


def background(
    scan: Scan,
    mask: np.ndarray,
    extent: float,
    sensor: SensorModel,
    rng: np.random.Generator,
    planes: int = 5,
) -> np.ndarray:
    """Mask of the pixels that lie on background planes.

    A plane is background if a connected surface on it, with normals along the plane's, extends
    further than the object can. This surface must be wider than `extent` and be cut by the border
    of the picture, or be still wider, since another object may lie in the plane of a face of the
    object. A strip where the plane only cuts through something does not count.

    A face of the object may be among the planes and is kept. Pixels that rise above a background
    plane by more than the plane's own roughness, averaged over a few pixels, are kept too: they may
    be a thin object on the seabed.

    Args:
        scan: The scan.
        mask: (h, w) pixels to classify.
        extent: [m] largest extent of the object.
        sensor: Accuracy of the sensor.
        rng: Source of the random samples.
        planes: Number of planes to examine, the largest first.

    Returns:
        Mask (h, w).
    """
    on_planes = np.zeros_like(mask)

    # Thinned picture with its normals, and a sample of its points to which planes are fitted
    every = slice(None, None, max(1, round(np.sqrt(mask.size / _SAMPLED))))
    part = scan.part((every, every))
    thinned = mask[every, every]
    normals = _local_normals(part, thinned, max(3, round(_FACET / part.pitch)))
    rows, columns = np.nonzero(thinned)
    step = max(1, len(rows) // 3000)
    sample = part.points[rows[::step], columns[::step]]

    # Planes, those with most points first
    least = max(20, int(0.08 * len(sample)))
    for _ in range(planes):
        plane = _largest_plane(sample, sensor, rng)
        if plane is None or plane.inliers.sum() < least:
            break

        # Background is wider than the object can be
        along = thinned & (np.abs(normals @ plane.normal) > _ALIGNED)
        width, cut = _spread(part, along & _near_plane(part, plane, sensor))
        if width > extent * (1.0 if cut else _UNCUT):
            on_planes |= mask & _on_plane(scan, plane, sensor)

        sample = sample[~plane.inliers]
    return on_planes


def _spread(part: Scan, lying: np.ndarray) -> tuple[float, bool]:
    """Width [m] of the largest surface among the masked pixels, and True if the border cuts it.

    The width is that in the widest direction, without outliers. It does not depend on the density
    of pixels, which is higher near the sensor. Small gaps do not divide the surface.
    """
    label = (
        ndimage.label(ndimage.binary_dilation(lying, np.ones((3, 3)), _GAP), np.ones((3, 3)))[0]
        * lying
    )
    if not label.any():
        return 0.0, False

    # Points of the largest connected surface, and True if the border cuts it
    largest = label == np.bincount(label[lying]).argmax()
    points = part.points[largest]
    cut = max(
        edge.sum()
        for edge in (largest[:_RIM], largest[-_RIM:], largest[:, :_RIM], largest[:, -_RIM:])
    )

    # Widths in directions perpendicular to its normal
    off = points - points.mean(axis=0)
    along = np.linalg.eigh(off.T @ off)[1][:, 1:]
    angles = np.pi / _WIDTHS * np.arange(_WIDTHS)
    off = off @ along @ np.array([np.cos(angles), np.sin(angles)])
    return float(np.ptp(np.percentile(off, _OUTER, axis=0), axis=0).max()), bool(cut > _CUT)


def _near_plane(scan: Scan, plane: "_Plane", sensor: SensorModel) -> np.ndarray:
    """Mask (h, w) of the pixels within the sensor's noise of a plane; False for NaN."""
    off = np.abs((scan.points - plane.center) @ plane.normal)
    with np.errstate(invalid="ignore"):
        return off < _plane_tolerance(scan.depth, sensor)


def _on_plane(scan: Scan, plane: "_Plane", sensor: SensorModel) -> np.ndarray:
    """Mask (h, w) of pixels on a plane: within the noise, and on average within its roughness."""
    off = (scan.points - plane.center) @ plane.normal
    near = _near_plane(scan, plane, sensor)
    if not near.any():
        return near

    # Local mean of their offsets, over about the area of one independent reading
    width = 2 * round(0.5 * sensor.noise_length) + 1
    share = ndimage.uniform_filter(near.astype(np.float64), width)
    mean = ndimage.uniform_filter(np.where(near, off, 0.0), width) / np.maximum(share, 1e-9)

    # The mean offset must be within the plane's own roughness
    sigma = sensor.sigma(scan.depth)
    # [sigma] in units of the depth noise there
    rough = _NORMAL * float(np.median(np.abs(mean[near] / sigma[near])))
    return near & (np.abs(mean) < np.maximum(_ROUGH * rough * sigma, _FLAT))


def _local_normals(scan: Scan, mask: np.ndarray, width: int) -> Array:
    """Unit normals (h, w, 3) of the masked surface in windows of `width` [px]; 0 where unknown.

    In inverse depth a plane is a linear function of the pixel, and the errors of a stereo pair are
    uniform.
    """
    # Means over the window: of 1, x, y, their squares, inverse depth, and its products
    x, y = np.meshgrid(scan.tangent_x, scan.tangent_y)
    inverse = np.where(mask, 1.0 / np.where(mask, scan.depth, 1.0), 0.0)
    terms = (
        mask,
        mask * x,
        mask * y,
        mask * x * x,
        mask * x * y,
        mask * y * y,
        inverse,
        inverse * x,
        inverse * y,
    )
    n, mx, my, xx, xy, yy, m, mxz, myz = (
        ndimage.uniform_filter(term.astype(np.float64), width) for term in terms
    )

    # Second moments about the means
    known = mask & (n > 0.25)
    n = np.where(known, n, 1.0)
    mx = mx / n
    my = my / n
    m = m / n
    xx = xx / n - mx * mx
    xy = xy / n - mx * my
    yy = yy / n - my * my
    xz = mxz / n - mx * m
    yz = myz / n - my * m

    # Least squares: 1/z = a x + b y + c, a plane with normal (a, b, c)
    determinant = xx * yy - xy * xy
    known &= determinant > 1e-9 * scan.pitch**4
    determinant = np.where(known, determinant, 1.0)
    a = (yy * xz - xy * yz) / determinant
    b = (xx * yz - xy * xz) / determinant
    normals = np.stack([a, b, m - a * mx - b * my], axis=-1)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where(
        known[..., None] & (length > 0.0), normals / np.where(length > 0.0, length, 1.0), 0.0
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    center: Array  # (3,) [m] point of the plane
    normal: Array  # (3,) unit normal
    inliers: np.ndarray  # (n,) bool, points near the plane


def _plane_tolerance(z: Array, sensor: SensorModel) -> Array:
    return 3.0 * sensor.sigma(z) + 0.003


def _largest_plane(points: Array, sensor: SensorModel, rng: np.random.Generator) -> _Plane | None:
    """The plane with most points (n, 3) near it, by RANSAC and least squares, or None."""
    if len(points) < 3:
        return None

    # Candidates: planes through three points
    a, b, c = points[rng.integers(len(points), size=(3, 150))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-9] / length[length > 1e-9, None]
    a = a[length > 1e-9]
    if not len(normals):
        return None

    # The candidate with most points near it
    tolerance = _plane_tolerance(points[:, 2], sensor)
    near = np.abs(points @ normals.T - np.einsum("ij,ij->i", normals, a)) < tolerance[:, None]
    inliers = near[:, int(near.sum(axis=0).argmax())]

    # Least squares over the points near the plane, selected again three times
    center = points[0]
    normal = normals[0]
    for _ in range(3):
        if inliers.sum() < 3:
            return None
        center = points[inliers].mean(axis=0)
        normal = np.linalg.eigh(np.cov((points[inliers] - center).T))[1][:, 0]
        inliers = np.abs((points - center) @ normal) < tolerance
    return _Plane(center, normal, inliers)


@kernel
def near_any(points: Array, centers: Array, reach: float) -> np.ndarray:
    """Mask (h, w) of the points within `reach` of any of the centres; False for NaN.

    Args:
        points: (h, w, 3) [m].
        centers: (k, 3) [m].
        reach: [m] largest distance.

    Returns:
        Mask (h, w).
    """
    near = np.zeros(points.shape[:2], dtype=np.bool_)
    for i in range(points.shape[0]):
        for j in range(points.shape[1]):
            x, y, z = points[i, j]
            for u, v, w in centers:
                if (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2 < reach**2:
                    near[i, j] = True
                    break
    return near


def connected_surfaces(points: Array, reach: float, normals: Array | None = None) -> np.ndarray:
    """Label (n,) of the connected surface of each point: neighbours share a label.

    Args:
        points: (n, 3) [m].
        reach: [m] largest distance of neighbours.
        normals: (n, 3) unit; if given, a surface ends at creases of 40 deg or more, whose points
            are not connected to any surface.
    """
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    if normals is not None:
        # at a crease normals, each computed from several points, change gradually
        crease = np.zeros(len(points), dtype=bool)
        crease[
            pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < _CREASE]
        ] = True
        pairs = pairs[~crease[pairs].any(axis=1)]

    graph = coo_matrix(
        (np.ones(len(pairs), dtype=bool), tuple(pairs.T)), shape=(len(points), len(points))
    )
    return connected_components(graph, directed=False)[1]


def voxel_means(points: Array, size: float) -> Array:
    """Mean (m, 3) of the points (n, 3) in each occupied cube of edge `size` [m], in fixed order."""
    # much faster than reducing narrow rows over axis 0
    low = np.array([axis.min() for axis in points.T])

    # Cube of each point
    cells = np.floor((points - low) / size).astype(np.int64)
    shape = np.array([axis.max() for axis in cells.T]) + 1

    # Number of each occupied cube, and of the points in it
    if np.prod(shape.astype(float)) < _COUNTED:  # counting is faster than sorting
        cube = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
        every = np.bincount(cube)
        number = np.cumsum(every > 0) - 1
        inverse = number[cube]
        count = every[every > 0]
    else:
        key = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)

    return (
        np.column_stack([np.bincount(inverse, weights=points[:, i]) for i in range(3)])
        / count[:, None]
    )


def hashed_subset(step: int, points: Array, size: float) -> np.ndarray:
    """Mask (n,) of about one in `step` of the points, selected by a hash of their cubes.

    The selection of a point depends on its position alone. Unlike when every `step`-th point is
    selected, adding a point elsewhere changes nothing.

    Args:
        step: Inverse share of points kept.
        points: (n, 3) [m].
        size: [m] edge of the cubes.

    Returns:
        Mask (n,).
    """
    mixed = row_hash(np.floor(points / size).astype(np.int64)).astype(np.uint64)
    return (mixed >> np.uint64(32)) % np.uint64(step) == 0


def row_hash(rows: np.ndarray) -> np.ndarray:
    """Hash (n,) of rows (n, 3) of int64; equal rows, and almost only those, have equal hashes."""
    return (rows * _FACTORS).sum(axis=1)


def facing_normals(
    points: Array, neighbours: int = 20, at: np.ndarray | slice = slice(None)
) -> Array:
    """Unit normals of points in S by principal components, oriented towards the sensor.

    Args:
        points: (n, 3) [m] in S.
        neighbours: Number of nearest points from which each normal is computed.
        at: Mask (n,) of the points whose normals are computed; all by default.

    Returns:
        Normals (k, 3) at those k points.
    """
    centers = points[at]
    near = cKDTree(points).query(centers, k=range(1, min(neighbours, len(points)) + 1))[1]

    normals = _least_axes(points, near)
    normals[np.einsum("ni,ni->n", normals, centers) > 0.0] *= -1.0
    return normals


@kernel
def _least_axes(points: Array, near: np.ndarray) -> Array:
    """Smallest principal axis (n, 3), unit, of each set of points with indices `near` (n, k).

    The smallest root of the characteristic polynomial in closed form [Smith 1961]. The axis is the
    longest cross product of two rows of C - root I, which is perpendicular to both.
    """
    axes = np.empty((len(near), 3))
    C = np.empty((3, 3))
    mean = np.empty(3)
    for n in range(len(near)):
        # Scatter matrix
        mean[:] = 0.0
        for k in near[n]:
            for i in range(3):
                mean[i] += points[k, i] / near.shape[1]
        C[:] = 0.0
        for k in near[n]:
            for i in range(3):
                for j in range(i + 1):
                    C[i, j] += (points[k, i] - mean[i]) * (points[k, j] - mean[j])
        C[0, 1], C[0, 2], C[1, 2] = C[1, 0], C[2, 0], C[2, 1]

        # Smallest eigenvalue, minus the mean of the three [Smith 1961]
        third = (C[0, 0] + C[1, 1] + C[2, 2]) / 3.0
        for i in range(3):
            C[i, i] -= third
        p = np.sqrt((C * C).sum() / 6.0)
        axes[n] = 0.0
        axes[n, 2] = 1.0
        if p <= 1e-12 * third or p == 0.0:
            continue  # equal spread in all directions, so no axis is better than another
        half = (
            C[0, 0] * (C[1, 1] * C[2, 2] - C[1, 2] * C[2, 1])
            - C[0, 1] * (C[1, 0] * C[2, 2] - C[1, 2] * C[2, 0])
            + C[0, 2] * (C[1, 0] * C[2, 1] - C[1, 1] * C[2, 0])
        ) / (2.0 * p**3)
        root = 2.0 * p * np.cos(np.arccos(min(1.0, max(-1.0, half))) / 3.0 + 2.0 * np.pi / 3.0)

        # Axis of that eigenvalue: the longest cross product of two rows of C - root I
        for i in range(3):
            C[i, i] -= root
        longest = 0.0
        for i, j in ((0, 1), (0, 2), (1, 2)):
            x = C[i, 1] * C[j, 2] - C[i, 2] * C[j, 1]
            y = C[i, 2] * C[j, 0] - C[i, 0] * C[j, 2]
            z = C[i, 0] * C[j, 1] - C[i, 1] * C[j, 0]
            length = np.sqrt(x * x + y * y + z * z)
            if length > longest:
                longest = length
                axes[n, 0], axes[n, 1], axes[n, 2] = x / length, y / length, z / length
    return axes
