"""Point-to-plane ICP from the scan to the visible part of a known model.

[Konoplin 2022] matches the model's points to the scan and removes hidden ones after the first pass. Matching the scan
to planes of the visible model is 3 to 10 times as accurate. Planes leave some motions free: sliding along a plate, or
along a barrel seen from its side. Depth edges of scan and model hold these. Both are taken from the same pixel grid, so
that their bias cancels.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from models.meshes.ray_casting import RayScene
from models.objects.targets import TargetModel
from perception.clouds.nearest_point import NearestPoint
from perception.clouds.scan import (
    Contour,
    Scan,
    SensorModel,
    contour,
    facing_normals,
    hashed_subset,
    jump,
    outward,
    voxel_means,
)
from sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

SHARP_EDGE = np.cos(np.deg2rad(60.0))  # where a surface turns away more slowly the sensor fails, it has no edge
_WINDOW_PIXELS = 80_000  # pixels above which depth edges are taken from a thinned grid
_RASTER = 32  # [px] to whose multiples the window of depth edges is extended, so that it seldom changes
_HALVINGS = 4  # bisections of a pixel, to locate a model's depth edge
_MAX_SCAN_POINTS = 4000  # scan points used in ICP, at most about: more add time
_AT_REST = 0.01  # [spacings] a step below which ICP with the same pairs has converged
_STALE = 0.2  # [spacings] by which the model may move before nearest points are looked up again
_FREE = 1e-4  # [-] eigenvalues of the normal equations below this share of the largest count as free


@dataclass(frozen=True, slots=True, eq=False)
class ModelSurface:
    """A target's surface prepared for ICP: sampled points K_q with normals, and a ray caster, all in T."""

    target: TargetModel
    points: Array  # (m, 3) [m]
    normals: Array  # (m, 3) unit
    spacing: float  # [m] between neighbouring points
    center: Array  # (3,) [m], of the target's bounding box
    radius: float  # [m], of the sphere around it
    scene: RayScene

    @classmethod
    def of(cls, target: TargetModel, seed: int = 0) -> "ModelSurface":
        """Sample the mesh of `target` evenly, at 1/60 of its size between 3 and 10 mm.

        Args:
            target: Model of the object.
            seed: Of the random samples.
        """
        spacing = float(np.clip(target.radius / 60.0, 0.003, 0.01))
        corners = target.vertices[target.triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double_area = np.linalg.norm(cross, axis=1)
        rng = np.random.default_rng(seed)
        count = int(np.clip(3.0 * double_area.sum() / spacing**2, 2000, 150_000))
        face = np.searchsorted(np.cumsum(double_area) / double_area.sum(), rng.random(count), side="right")
        face = np.minimum(face, len(corners) - 1)
        u, v = rng.random((2, count))
        over = u + v > 1.0
        u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
        a, b, c = corners[face].transpose(1, 0, 2)
        points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        # One sample per cell, not their mean: a mean would leave the surface.
        cells = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
        _, first = np.unique((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], return_index=True)
        return cls(
            target=target,
            points=points[first],
            normals=cross[face[first]] / double_area[face[first], None],
            spacing=spacing,
            center=target.center,
            radius=target.radius,
            scene=RayScene(target.vertices, target.triangles),
        )

    def visible(self, X_ST: Array, scan: Scan, max_incidence: float, step: int = 1) -> np.ndarray:
        """Mask (m,) of the points that the sensor can see: in view, not hidden, not at grazing incidence.

        Args:
            X_ST: (4, 4) pose of T in S.
            scan: Scan whose pixel grid is the field of view.
            max_incidence: [rad] largest angle of incidence.
            step: Only every `step`-th point is judged, and the mask is of those.

        Returns:
            Mask (m,).
        """
        return _visible(self, X_ST.tobytes(), scan, max_incidence, step)

    def exposed(
        self, origin: Array, max_incidence: float, step: int = 1, among: np.ndarray | None = None
    ) -> np.ndarray:
        """Mask (m,) of the points visible from `origin`: not hidden, not at grazing incidence.

        Args:
            origin: (3,) [m] of the sensor in T.
            max_incidence: [rad] largest angle of incidence.
            step: Only every `step`-th point is judged, and the mask is of those.
            among: Mask (m,) of the points to be judged; None: all.

        Returns:
            Mask (m,).
        """
        points, normals = self.points[::step], self.normals[::step]
        rays = points - origin
        distance = np.linalg.norm(rays, axis=1)
        seen = np.abs(np.einsum("ij,ij->i", rays, normals)) > np.cos(max_incidence) * distance
        if among is not None:
            seen &= among
        first = self.scene.distance(origin, rays[seen]) * distance[seen]
        seen[seen] = first > distance[seen] - 0.002
        return seen

    def covers(self, X_ST: Array, points: Array) -> np.ndarray:
        """Mask (n,) of the points (n, 3) [m] in S whose line of sight meets the model at `X_ST` (4, 4)."""
        X_TS = inverse(X_ST)
        return np.isfinite(self.scene.distance(X_TS[:3, 3], points @ X_TS[:3, :3].T))

    def seen(self, X_ST: Array, scan: Scan) -> tuple[Scan, Array]:
        """Render the model at `X_ST` on the pixel grid of `scan`.

        Args:
            X_ST: (4, 4) pose of T in S.
            scan: Scan that gives the grid.

        Returns:
            The rendered scan, and cosines of incidence (h, w).
        """
        rays, X_TS = scan.rays, inverse(X_ST)
        rays_T = rays @ X_TS[:3, :3].T
        hit = self.scene.cast(X_TS[:3, 3], rays_T)
        depth = np.where(np.isfinite(hit["t"]), hit["t"], np.nan).astype(np.float64)
        cosine = np.abs(np.einsum("hwi,hwi->hw", hit["normal"], rays_T)) / np.linalg.norm(rays, axis=-1)
        return Scan(points=rays * depth[..., None], tangent_x=scan.tangent_x, tangent_y=scan.tangent_y), cosine

    def depth(self, X_ST: Array, scan: Scan) -> Array:
        """Depth (h, w) [m] of the model at `X_ST` (4, 4) in the pixels of `scan`, NaN where it is missed."""
        depth, X_TS = np.full(scan.depth.shape, np.nan), inverse(X_ST)
        corners = transform_points(X_ST, self.target.vertices)
        window = scan.window(corners, 0.0, scan.depth.size) if corners[:, 2].min() > 0.0 else np.s_[:, :]
        t = self.scene.distance(X_TS[:3, 3], scan.part(window).rays @ X_TS[:3, :3].T)
        depth[window] = np.where(np.isfinite(t), t, np.nan)
        return depth


@lru_cache(maxsize=8)  # one pose is judged several times: by its score, by ICP and by the check
def _visible(surface: ModelSurface, pose_bytes: bytes, scan: Scan, max_incidence: float, step: int) -> np.ndarray:
    X_ST = np.frombuffer(pose_bytes).reshape(4, 4)
    in_view = scan.pixels(transform_points(X_ST, surface.points[::step]))[2]
    mask = surface.exposed(inverse(X_ST)[:3, 3], max_incidence, step, in_view)
    mask.setflags(write=False)
    return mask


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The part of a scan that takes part in ICP."""

    scan: Scan
    mask: np.ndarray  # (h, w) pixels that may belong to the object
    points: Array  # (n, 3) [m] thinned, in S
    normals: Array  # (n, 3) unit, towards the sensor
    sigma: Array  # (n,) [m] standard deviation of depth
    independent: Array  # (n,) [-] share of an independent reading, because errors of neighbours are correlated
    sensor: SensorModel

    @classmethod
    def of(cls, scan: Scan, mask: np.ndarray, spacing: float, sensor: SensorModel) -> "Evidence":
        """Thin the masked pixels to one point per cube and estimate normals.

        Args:
            scan: The scan.
            mask: (h, w) pixels that may belong to the object.
            spacing: [m] edge of the cubes.
            sensor: Accuracy of the sensor.

        Returns:
            The evidence, at most about _MAX_SCAN_POINTS points.
        """
        points = voxel_means(scan.points[mask], spacing)
        step = max(1, -(-len(points) // _MAX_SCAN_POINTS))
        kept = hashed_subset(step, points, spacing)
        normals, points = facing_normals(points, at=kept), points[kept]
        apart = np.sqrt(step) * spacing / (scan.pitch * points[:, 2])  # [px]
        return cls(scan, mask, points, normals, sensor.sigma(points[:, 2]), sensor.independent(apart), sensor)


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Depth edges of scan and model around the object."""

    scan: Contour
    scan_outward: Array  # (n, 2) unit, across the edge in the image
    model_points: Array  # (k, 3) [m] in T
    model_outward: Array  # (k, 2) unit
    model_sharp: np.ndarray  # (k,) bool: see SHARP_EDGE


@dataclass(frozen=True, slots=True, eq=False)
class IcpFit:
    """Result of ICP at convergence."""

    X_ST: Array  # (4, 4) pose of T in S
    free: Array  # (k, 6) free unit twists (linear; angular x radius) in S, about the model's centre
    residual: float  # [m] robust rms of the point-to-plane distance
    size: float  # [-] scale of the object against the model that would minimise the residual
    size_sigma: float  # [-] standard deviation of `size`, from the sensor's noise


def fine_fit(evidence: Evidence, surface: ModelSurface, X_ST: Array, rounds: int = 2, inner: int = 5) -> IcpFit:
    """Full ICP: hidden points removed before each round, point-to-plane distances and depth edges together.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) initial pose of T in S.
        rounds: Number of pairings with the visible model, each with a smaller gate.
        inner: Gauss-Newton steps in a round, at most.

    Returns:
        The pose at convergence, its free twists, residual and best scale.
    """
    gates = np.geomspace(8.0 * surface.spacing, 3.0 * surface.spacing, rounds)
    pairing, X_paired = None, X_ST
    for gate in gates:
        pairing, X_paired = _Pairing.of(evidence, surface, X_ST), X_ST
        if pairing is None:
            break
        index, X_looked_up = pairing.nearest(X_ST, gate), X_ST
        for _ in range(inner):
            if _step(X_looked_up, X_ST, surface) > _STALE * surface.spacing:
                index, X_looked_up = pairing.nearest(X_ST, gate), X_ST
            H, g, _ = pairing.terms(X_ST, gate, index)
            X_before = X_ST
            X_ST, _ = _moved(X_ST, H, g, surface)
            if _step(X_before, X_ST, surface) < _AT_REST * surface.spacing:
                break
    # Free twists are judged with the pairs at the final pose: ICP may have slid off all that held it before.
    if pairing is not None and _step(X_paired, X_ST, surface) > surface.spacing:
        pairing = _Pairing.of(evidence, surface, X_ST)
    if pairing is None:
        return IcpFit(X_ST, np.zeros((0, 6)), np.inf, 1.0, np.inf)
    H, g, residual = pairing.terms(X_ST, gates[-1], pairing.nearest(X_ST, gates[-1]))
    return IcpFit(X_ST, _moved(X_ST, H, g, surface)[1], residual, *_size(H, g, surface))


@dataclass(frozen=True, slots=True, eq=False)
class _Pairing:
    """The visible model points and depth edges that are compared with the scan in one round of ICP."""

    evidence: Evidence
    surface: ModelSurface
    points: Array  # (m, 3) [m] visible, in T
    normals: Array  # (m, 3)
    grid: NearestPoint
    edges: _Edges | None

    @classmethod
    def of(cls, evidence: Evidence, surface: ModelSurface, X_ST: Array) -> "_Pairing | None":
        """Pairing with the model at `X_ST`; None if fewer than 10 of its points are in view."""
        visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
        if visible.sum() < 10:
            return None
        points = surface.points[visible]
        edges = _edges(evidence, surface, X_ST)
        return cls(evidence, surface, points, surface.normals[visible], NearestPoint.of(points, surface.spacing), edges)

    def nearest(self, X_ST: Array, gate: float) -> np.ndarray:
        """Index (n,) of the visible model point nearest to each scan point; their number where none is near."""
        points = transform_points(inverse(X_ST), self.evidence.points)
        return self.grid.query(points, self._reach(gate))[1]

    def _reach(self, gate: float) -> float:
        return gate + 3.0 * float(np.median(self.evidence.sigma))

    def terms(self, X_ST: Array, gate: float, index: np.ndarray) -> tuple[Array, Array, float]:
        """Normal equations (7, 7), (7,) of planes and depth edges, and the robust rms [m] of the planes.

        The unknowns are a twist about the model's centre (linear; angular x radius), and growth x radius from there.
        `index` is the result of `nearest`.
        """
        evidence, surface = self.evidence, self.surface
        H, g, residual = _plane_terms(evidence, self.points, self.normals, index, X_ST, self._reach(gate), surface)
        if self.edges is not None:
            H_edge, g_edge = _edge_terms(self.edges, evidence, X_ST, gate, surface)
            H, g = H + H_edge, g + g_edge
        return H, g, residual


def score(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Mutual agreement of scan and model at `X_ST`, from -1 to 2: higher is better.

    The share of the visible model that the scan confirms, less the share that the scan sees through, plus the share of
    the scan that the model explains.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        The score [-].
    """
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if visible.sum() < 10:
        return -1.0
    points = transform_points(X_ST, surface.points[visible])
    row, column, _ = evidence.scan.pixels(points)
    measured = evidence.scan.depth[row, column]
    tolerance = 2.0 * surface.spacing + 3.0 * evidence.sensor.sigma(points[:, 2])
    behind = measured - points[:, 2]
    agree = float(np.mean(np.abs(behind) < tolerance))
    through = float(np.mean(behind > 2.0 * tolerance))
    return agree - through + float(np.mean(explained(evidence, surface, X_ST)))


def explained(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> np.ndarray:
    """Mask (n,) of the scan points that lie on the visible model.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        Mask (n,).
    """
    return _explained(evidence, surface, X_ST.tobytes())


@lru_cache(maxsize=4)  # the accepted pose is judged by the check and by its score
def _explained(evidence: Evidence, surface: ModelSurface, pose_bytes: bytes) -> np.ndarray:
    X_ST = np.frombuffer(pose_bytes).reshape(4, 4)
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if not visible.any():
        return np.zeros(len(evidence.points), dtype=bool)
    points = transform_points(X_ST, surface.points[visible])
    limit = 2.0 * surface.spacing + 3.0 * evidence.sigma
    mask = NearestPoint.of(points, surface.spacing).query(evidence.points, float(limit.max()))[0] < limit
    mask.setflags(write=False)
    return mask


def edge_offsets(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> tuple[Array, float, float]:
    """Compare the model's sharp depth edges with those of the scan.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        Offsets (n,) [m] across the edge of those that have a partner, the share (0..1) of sharp edge that has one, and
        the share beyond which the scanned surface goes on. The shares are NaN without sharp edges in view.
    """
    edges = _edges(evidence, surface, X_ST)
    if edges is None or edges.model_sharp.sum() < 20:
        return np.zeros(0), np.nan, np.nan
    sharp = edges.model_sharp
    points = transform_points(X_ST, edges.model_points[sharp])
    tangents = points[:, :2] / points[:, 2:]
    normal = edges.model_outward[sharp]
    reach = 0.06 / points[:, 2]
    tree = cKDTree(edges.scan.tangents)
    distance, index = tree.query(tangents, distance_upper_bound=float(reach.max()))
    paired = np.isfinite(distance)
    index = np.where(paired, index, 0)
    paired &= np.abs(edges.scan.depth[index] - points[:, 2]) < 2.0 * jump(points[:, 2])
    paired &= np.einsum("ij,ij->i", edges.scan_outward[index], normal) > 0.5
    offsets = np.einsum("ij,ij->i", edges.scan.tangents[index] - tangents, normal) * points[:, 2]
    goes_on = np.ones(len(points), dtype=bool)
    for beyond in (0.03, 0.05):
        probe = np.column_stack([points[:, :2] + beyond * normal, points[:, 2]])
        row, column, inside = evidence.scan.pixels(probe)
        step = np.maximum(0.5 * jump(points[:, 2]), 3.0 * evidence.sensor.sigma(points[:, 2]))
        goes_on &= inside & evidence.mask[row, column]
        goes_on &= np.abs(evidence.scan.depth[row, column] - points[:, 2]) < step
        goes_on &= ~surface.covers(X_ST, probe)  # one part of the model in front of another does not end it
    return offsets[paired], float(paired.mean()), float((goes_on & ~paired).mean())


class _Readings(NamedTuple):
    """Scan points as the kernel takes them; as in `Evidence`."""

    points: Array  # (n, 3) [m] in S
    normals: Array  # (n, 3)
    sigma: Array  # (n,) [m]
    independent: Array  # (n,) [-]


class _ModelPoints(NamedTuple):
    """Visible model points as the kernel takes them; as in `ModelSurface`."""

    points: Array  # (m, 3) [m] in T
    normals: Array  # (m, 3)
    spacing: float  # [m]
    radius: float  # [m]


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
    readings = _Readings(evidence.points, evidence.normals, evidence.sigma, evidence.independent)
    model = _ModelPoints(model_points, model_normals, surface.spacing, surface.radius)
    H, g, sums = _plane_sums(readings, model, index, X_ST, transform_points(X_ST, surface.center), gate)
    return H, g, float(np.sqrt(sums[1] / sums[0])) if sums[0] > 0.0 else np.inf


@njit(cache=True)
def _plane_sums(
    scan: _Readings, model: _ModelPoints, index: np.ndarray, X_ST: Array, center: Array, gate: float
) -> tuple[Array, Array, Array]:
    """Sums over the valid pairs: normal equations as in `_plane_terms`, and weights and weighted squares (2,) [m^2]."""
    H, g, sums, J = np.zeros((7, 7)), np.zeros(7), np.zeros(2), np.empty(7)
    q, m = np.empty(3), np.empty(3)
    points, normals, sigma, independent = scan.points, scan.normals, scan.sigma, scan.independent
    model_points, model_normals, spacing, radius = model.points, model.normals, model.spacing, model.radius
    pairs = 0
    for n in range(len(points)):
        i = index[n]
        if i >= len(model_points):
            continue
        for a in range(3):
            q[a], m[a] = X_ST[a, 3], 0.0
            for b in range(3):
                q[a] += X_ST[a, b] * model_points[i, b]
                m[a] += X_ST[a, b] * model_normals[i, b]
        facing = -1.0 if m[0] * q[0] + m[1] * q[1] + m[2] * q[2] > 0.0 else 1.0
        along, square, cosine = 0.0, 0.0, 0.0
        for a in range(3):
            m[a] *= facing
            off = points[n, a] - q[a]
            along += m[a] * off
            square += off * off
            cosine += m[a] * normals[n, a]
        # Beyond the rim of the visible part the nearest point pulls sideways: such pairs are dropped.
        if square >= gate**2 or square - along**2 >= (1.5 * spacing) ** 2 or cosine <= 0.5:
            continue
        pairs += 1
        scale = max(2.0 * sigma[n], 0.25 * gate)
        weight = independent[n] / (1.0 + (along / scale) ** 2) ** 2 / (sigma[n] ** 2 + 1e-6)
        for a in range(3):
            q[a] = (q[a] - center[a]) / radius
        J[0], J[1], J[2] = m
        J[3] = q[1] * m[2] - q[2] * m[1]
        J[4] = q[2] * m[0] - q[0] * m[2]
        J[5] = q[0] * m[1] - q[1] * m[0]
        J[6] = q[0] * m[0] + q[1] * m[1] + q[2] * m[2]
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


def _rows(direction: Array, at: Array, X_ST: Array, surface: ModelSurface) -> Array:
    """Jacobian rows (n, 7) of `direction . at` for a twist about the model's centre and growth from there.

    Rotation and growth are scaled by the model's radius.
    """
    arm = (at - transform_points(X_ST, surface.center)) / surface.radius
    return np.column_stack([direction, np.cross(arm, direction), np.einsum("ij,ij->i", arm, direction)])


def _moved(X_ST: Array, H: Array, g: Array, surface: ModelSurface) -> tuple[Array, Array]:
    """One Gauss-Newton step in the directions that the data determine, and the free directions (k, 6)."""
    H, g, radius = H[:6, :6], g[:6], surface.radius
    center = transform_points(X_ST, surface.center)
    axis = surface.target.symmetry.axis
    spin = np.zeros((0, 6))
    if axis is not None:
        # Free by declaration: the facets of the mesh would otherwise act as evidence of the angle.
        axis_S = X_ST[:3, :3] @ axis
        spin = np.concatenate([np.cross(axis_S, center - X_ST[:3, 3]), radius * axis_S])[None]
        spin /= np.linalg.norm(spin)
        P = np.eye(6) - spin.T @ spin
        H, g = P @ H @ P, P @ g
    values, vectors = np.linalg.eigh(H)
    held = values > _FREE * max(values[-1], 1e-12)
    step = vectors[:, held] @ ((vectors[:, held].T @ g) / values[held])
    # A longer step comes from a handful of pairs; the next iteration pairs again.
    step *= min(1.0, 0.5 * radius / max(float(np.linalg.norm(step)), 1e-12))
    R = exp_so3(step[3:] / radius)
    X_SS = pose(R, center + step[:3] - R @ center)
    return X_SS @ X_ST, vectors[:, ~held].T


def _size(H: Array, g: Array, surface: ModelSurface) -> tuple[float, float]:
    """Best scale of the object and its standard deviation [-]; free directions of the pose stay unchanged."""
    values, vectors = np.linalg.eigh(H)
    if not values[-1] > 0.0:
        return 1.0, np.inf
    inverted = vectors[6] / np.maximum(values, _FREE**2 * values[-1])
    growth, variance = float(inverted @ (vectors.T @ g)), float(inverted @ vectors[6])
    return 1.0 + growth / surface.radius, np.sqrt(variance) / surface.radius


def _step(A: Array, B: Array, surface: ModelSurface) -> float:
    """Approximate upper bound [m] of a model point's motion from pose `A` to `B` (4, 4)."""
    center = transform_points(A, surface.center) - transform_points(B, surface.center)
    turn = np.linalg.norm(A[:3, :3] - B[:3, :3]) / np.sqrt(2.0)
    return float(np.linalg.norm(center) + surface.radius * turn)


def _edges(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> _Edges | None:
    """Depth edges of scan and model around the model at `X_ST`; None if either has too few."""
    scan = evidence.scan
    rows, columns = scan.window(transform_points(X_ST, surface.points), 0.1, _WINDOW_PIXELS)
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return None
    # The window lies on a fixed raster, so that the next round finds the scan's edges in the cache though the model has
    # moved a little. The raster counts from the optical axis, which mostly lies midway between two pixels. The pixels
    # are therefore the same however much the picture is cropped.
    rows, columns = (
        _rastered(window, round(float(tangents[0]) / pitch + 0.25))
        for window, tangents, pitch in zip(
            (rows, columns), (scan.tangent_y, scan.tangent_x), scan.pitches[::-1], strict=True
        )
    )
    part = scan.part((rows, columns))
    if min(part.depth.shape) < 8:
        return None
    of_scan, scan_outward = _scan_edges(evidence, rows.start, rows.stop, columns.start, columns.stop, rows.step)
    model, cosine = surface.seen(X_ST, part)
    covered = np.isfinite(model.depth)
    of_model = contour(model, covered, model.depth)
    if len(of_scan.rows) < 10 or len(of_model.rows) < 10:
        return None
    tangents = _refined(surface, X_ST, part, of_model)
    points = of_model.depth[:, None] * np.column_stack([tangents, np.ones(len(tangents))])
    return _Edges(
        scan=of_scan,
        scan_outward=scan_outward,
        model_points=transform_points(inverse(X_ST), points),
        model_outward=outward(covered, model.depth, of_model.rows, of_model.columns),
        model_sharp=cosine[of_model.rows, of_model.columns] > SHARP_EDGE,
    )


def _rastered(window: slice, first: int) -> slice:
    """Extend `window` of rows or columns to a raster on which the first of the picture has the number `first`."""
    start = window.start - (window.start + first) % _RASTER
    stop = window.stop + -(window.stop + first) % _RASTER
    return slice(start if start >= 0 else start % window.step, stop, window.step)


def _refined(surface: ModelSurface, X_ST: Array, part: Scan, found: Contour) -> Array:
    """Tangents (n, 2) of the model's depth edges `found` on the grid of `part`, to a fraction of a pixel."""
    X_TS, step = inverse(X_ST), jump(found.depth)
    middle = np.column_stack([part.tangent_x[found.columns], part.tangent_y[found.rows]])
    at = np.full(len(found.rows), 0.5)  # [px] from the middle of the near pixel
    for halving in range(_HALVINGS):
        rays = np.column_stack([middle + part.pitches * at[:, None] * found.steps, np.ones(len(at))])
        depth = surface.scene.distance(X_TS[:3, 3], rays @ X_TS[:3, :3].T)
        at += np.where(depth - found.depth <= step, 0.25, -0.25) / 2.0**halving
    return middle + part.pitches * at[:, None] * found.steps


@lru_cache(maxsize=4)
def _scan_edges(evidence: Evidence, top: int, bottom: int, left: int, right: int, step: int) -> tuple[Contour, Array]:
    """Depth edges of the scan in a window of pixels, and the directions (n, 2) across them."""
    window = slice(top, bottom, step), slice(left, right, step)
    part, mask = evidence.scan.part(window), evidence.mask[window]
    found = contour(part, mask, part.depth)
    return found, outward(mask, part.depth, found.rows, found.columns)


def _edge_terms(
    edges: _Edges, evidence: Evidence, X_ST: Array, gate: float, surface: ModelSurface
) -> tuple[Array, Array]:
    """Normal equations (7, 7), (7,) of the distances across depth edges in the image plane."""
    points = transform_points(X_ST, edges.model_points)
    tangents = points[:, :2] / points[:, 2:]
    distance, index = cKDTree(tangents).query(
        edges.scan.tangents, distance_upper_bound=gate / float(np.median(points[:, 2]))
    )
    paired = np.isfinite(distance)
    index = np.where(paired, index, 0)
    paired &= edges.model_sharp[index]
    paired &= np.abs(edges.scan.depth - points[index, 2]) < jump(points[index, 2])
    paired &= np.einsum("ij,ij->i", edges.scan_outward, edges.model_outward[index]) > 0.7
    if paired.sum() < 10:
        return np.zeros((7, 7)), np.zeros(7)
    index, measured = index[paired], edges.scan.tangents[paired]
    P, m = points[index], edges.model_outward[index]
    across = np.einsum("ij,ij->i", measured - tangents[index], m) * P[:, 2]
    # d(m . P_xy / z) z = (m, -m . P_xy / z) . dP
    direction = np.column_stack([m, -np.einsum("ij,ij->i", m, tangents[index])])
    pitch = evidence.scan.pitch * P[:, 2]
    # Mixed depths at an edge differ from pixel to pixel: each pixel is an independent reading.
    sigma = evidence.sensor.edge_sigma * pitch
    weight = 1.0 / (1.0 + (across / np.maximum(3.0 * pitch, 0.25 * gate)) ** 2) ** 2 / sigma**2
    J = _rows(direction, P, X_ST, surface)
    return J.T @ (weight[:, None] * J), J.T @ (weight * across)
