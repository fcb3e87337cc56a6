"""Sampled surface of a known model: points with normals, their visibility, and depth images."""

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from uuv.models.meshes.closed_shells import sphere
from uuv.models.meshes.ray_casting import OneSidedScene, RayScene
from uuv.models.objects.mesh_symmetry import mesh_symmetry
from uuv.models.objects.target_model import Symmetry, TargetModel
from uuv.perception.clouds.scan import Scan
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

# [spacings of the cloud] from its border, within which an edge counts as part of the border
_AT_BORDER = 2.0

# number of latest surfaces whose symmetries, views and so on are kept for surfaces of the same
# content
MODELS = 2


@dataclass(frozen=True, eq=False)
class ModelSurface:
    """A target's surface prepared for ICP: sampled points K_q with normals, and a ray caster.

    All quantities are in T. Surfaces of the same content are equal, so that results computed for a
    recent model are reused by the next run.
    """

    target: TargetModel
    points: Array  # (m, 3) [m]
    normals: Array  # (m, 3) unit
    spacing: float  # [m] between neighbouring points
    center: Array  # (3,) [m], of the target's bounding box
    radius: float  # [m], of the sphere around it
    scene: RayScene
    # symmetry declared by the target, or else found in its mesh; for an open cloud only the
    # declared one
    symmetry: Symmetry
    hull: Array  # (k, 3) [m] outermost corners in many directions, which bound its picture
    resolution: float = 0.0  # [m] spacing of the cloud from which the mesh was made; 0 for a mesh
    # points in T where an open cloud ends although the object may continue
    border: cKDTree | None = None

    @classmethod
    def of(cls, target: TargetModel, seed: int = 0) -> "ModelSurface":
        """Sample the mesh of `target` evenly, at 1/60 of its size between 3 and 10 mm.

        Args:
            target: Model of the object.
            seed: Seed of the random samples.
        """
        spacing = float(np.clip(target.radius / 60.0, 0.003, 0.01))
        corners = target.vertices[target.triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double_area = np.linalg.norm(cross, axis=1)

        # Points spread evenly over the area: a triangle is drawn by its area, the position by a
        # folded unit square
        rng = np.random.default_rng(seed)
        count = int(np.clip(3.0 * double_area.sum() / spacing**2, 2000, 150_000))
        face = np.searchsorted(
            np.cumsum(double_area) / double_area.sum(), rng.random(count), side="right"
        )
        face = np.minimum(face, len(corners) - 1)
        u, v = rng.random((2, count))
        over = u + v > 1.0
        u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
        a, b, c = corners[face].transpose(1, 0, 2)
        points = a + u[:, None] * (b - a) + v[:, None] * (c - a)

        # Symmetry as declared, else found in the mesh if the mesh is closed
        cloud = target.cloud
        is_open = cloud is not None and cloud.is_open
        resolution = cloud.spacing if cloud is not None else 0.0
        symmetry = target.symmetry
        if symmetry.is_none and not is_open:
            symmetry = mesh_symmetry(target.vertices, target.triangles, rng, resolution)

        first = one_per_cube(points, spacing)
        return cls(
            target=target,
            points=points[first],
            normals=cross[face[first]] / double_area[face[first], None],
            spacing=spacing,
            center=target.center,
            radius=target.radius,
            scene=(OneSidedScene if is_open else RayScene)(target.vertices, target.triangles),
            symmetry=symmetry,
            hull=_hull(target.vertices),
            resolution=resolution,
            border=cKDTree(cloud.border) if cloud is not None and len(cloud.border) else None,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ModelSurface) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @cached_property
    def _content(self) -> bytes:
        """Digest of all data from which the surface is made."""
        target = self.target
        none = np.zeros(0)
        parts = [
            target.vertices,
            target.triangles,
            self.points,
            self.normals,
            self.hull,
            self.center,
        ]

        for symmetry in (self.symmetry, target.symmetry):
            axis = none if symmetry.axis is None else symmetry.axis
            parts += [axis, symmetry.rotations, symmetry.center]

        parts += [np.array([self.spacing, self.radius, self.resolution])]
        parts += [none if self.border is None else self.border.data]
        digest = hashlib.blake2b(
            f"{target.name} {type(self.scene).__name__}".encode(), digest_size=16
        )

        for part in parts:
            digest.update(f"{part.dtype}{part.shape}".encode())
            digest.update(part.tobytes())
        return digest.digest()

    def thinned(self, points: int) -> "ModelSurface":
        """The same surface with about `points` points at most; the surface itself if it has no
        more.
        """
        return _thinned(self, points)

    @property
    def is_open(self) -> bool:
        """True for a scan from some sides, where the space behind the surface and beyond its border
        is unknown.
        """
        return isinstance(self.scene, OneSidedScene)

    def on_border(self, points: Array) -> np.ndarray:
        """Mask (n,) of points (n, 3) [m] in T at the border of an open cloud, which is not an edge
        of the object.
        """
        if self.border is None:
            return np.zeros(len(points), dtype=bool)
        return (
            self.border.query(points, distance_upper_bound=_AT_BORDER * self.resolution)[0] < np.inf
        )

    def visible(self, X_ST: Array, scan: Scan, max_incidence: float, step: int = 1) -> np.ndarray:
        """Mask (m,) of the points that are visible: in view, not hidden, not at grazing incidence.

        Args:
            X_ST: (4, 4) pose of T in S.
            scan: Scan whose pixel grid is the field of view.
            max_incidence: [rad] largest angle of incidence.
            step: Only every `step`-th point is tested, and the mask is for these points.

        Returns:
            Mask (m,).
        """
        return _visible(scan, self, X_ST.tobytes(), max_incidence, step)

    def exposed(
        self, origin: Array, max_incidence: float, step: int = 1, among: np.ndarray | None = None
    ) -> np.ndarray:
        """Mask (m,) of the points visible from `origin`: not hidden, not at grazing incidence.

        Args:
            origin: (3,) [m] of the sensor in T.
            max_incidence: [rad] largest angle of incidence.
            step: Only every `step`-th point is tested, and the mask is for these points.
            among: Mask (m,) of the points to test; None: all.

        Returns:
            Mask (m,).
        """
        points = self.points[::step]
        normals = self.normals[::step]
        rays = points - origin
        distance = np.linalg.norm(rays, axis=1)

        # Facing the sensor, among the points to test
        facing = -np.einsum("ij,ij->i", rays, normals)
        visible = (facing if self.is_open else np.abs(facing)) > np.cos(max_incidence) * distance
        if among is not None:
            visible &= among

        # Nothing in front of them
        first = self.scene.distance(origin, rays[visible]) * distance[visible]
        visible[visible] = first > distance[visible] - 0.002
        return visible

    def covers(self, X_ST: Array, points: Array) -> np.ndarray:
        """Mask (n,) of points (n, 3) [m] in S whose line of sight meets the model at `X_ST`."""
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
        rays = scan.rays
        X_TS = inverse(X_ST)
        rays_T = rays @ X_TS[:3, :3].T
        hit = self.scene.cast(X_TS[:3, 3], rays_T)
        depth = np.where(np.isfinite(hit["t"]), hit["t"], np.nan).astype(np.float64)

        cosine = np.abs(np.einsum("hwi,hwi->hw", hit["normal"], rays_T)) / np.linalg.norm(
            rays, axis=-1
        )
        return Scan(
            points=rays * depth[..., None], tangent_x=scan.tangent_x, tangent_y=scan.tangent_y
        ), cosine

    def depth(self, X_ST: Array, scan: Scan) -> Array:
        """Depth (h, w) [m] of the model at `X_ST` in the pixels of `scan`, NaN where missed."""
        depth = np.full(scan.depth.shape, np.nan)
        X_TS = inverse(X_ST)
        corners = transform_points(X_ST, self.hull)
        window = (
            scan.window(corners, 0.0, scan.depth.size) if corners[:, 2].min() > 0.0 else np.s_[:, :]
        )

        t = self.scene.distance(X_TS[:3, 3], scan.part(window).rays @ X_TS[:3, :3].T)
        depth[window] = np.where(np.isfinite(t), t, np.nan)
        return depth

    def depth_along(self, X_ST: Array, rays: Array) -> Array:
        """Depth (n,) [m] of the model at `X_ST` along rays (n, 3) in S; inf where they miss it.

        The rays are scaled to a depth of 1.
        """
        X_TS = inverse(X_ST)
        return self.scene.distance(X_TS[:3, 3], rays @ X_TS[:3, :3].T)


@remembered(16, owners=MODELS)
def _thinned(surface: ModelSurface, points: int) -> ModelSurface:
    share = len(surface.points) / points
    if share <= 1.0:
        return surface

    spacing = surface.spacing * float(np.sqrt(share))
    chosen = one_per_cube(surface.points, spacing)
    return replace(
        surface, points=surface.points[chosen], normals=surface.normals[chosen], spacing=spacing
    )


def one_per_cube(points: Array, size: float) -> np.ndarray:
    """Index of one of the points (n, 3) in each cube of edge `size` [m].

    A mean of the points would not be on the surface.
    """
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    return np.unique((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], return_index=True)[1]


def _hull(vertices: Array) -> Array:
    """The vertices (k, 3) that are outermost in any of 162 directions.

    Their extent is within 1 % of that of the convex hull.
    """
    return vertices[np.unique((vertices @ sphere(2)[0].T).argmax(axis=0))]


# stored, since one pose is tested several times: by its score, by ICP and by the check
@remembered(8)
def _visible(
    scan: Scan, surface: ModelSurface, pose_bytes: bytes, max_incidence: float, step: int
) -> np.ndarray:
    X_ST = np.frombuffer(pose_bytes).reshape(4, 4)
    in_view = scan.pixels(transform_points(X_ST, surface.points[::step]))[2]
    mask = surface.exposed(inverse(X_ST)[:3, 3], max_incidence, step, in_view)

    mask.setflags(write=False)
    return mask
