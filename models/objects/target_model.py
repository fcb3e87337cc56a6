"""Model of an object to work on: mesh, symmetry, tool paths, and its bodies in a MuJoCo scene.

Frame T is the model's own frame. Triangles wind counter-clockwise seen from outside.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.meshes.far_origin import middle_if_far
from uuv.models.meshes.mesh_files import read_mesh
from uuv.models.meshes.surfel_files import is_cloud_file, read_surfels
from uuv.models.objects.grasps import Grasp, checked_grasps
from uuv.models.objects.model_input import FARTHEST_VERTEX, checked_mesh, usable_cloud
from uuv.models.objects.solid import Solid
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_pose,
    checked_rows,
    exp_so3,
    finite_number,
    pose,
    quat_wxyz_from_rotation,
    readonly,
    real_array,
)

if TYPE_CHECKING:
    import mujoco

    from uuv.models.meshes.cloud_mesh import CloudMesh

# [m] largest extent accepted without a stated scale; a larger mesh is probably in millimetres
LARGEST = 20.0
_LEAST_SINE = 0.05  # least sine of the angle between the two axes of a tool
PATH_STEP = 0.005  # [m] spacing of the points of a model path
# [rad] largest turn of a model path at a point; beyond it the path nearly reverses
SHARPEST_CORNER = float(np.radians(150.0))
# [m] of path over which a tool turns in a corner, since splines would overshoot a jump
_SHORTEST_BLEND = 0.04
_CORNER = 0.2  # [rad] angle between the axes of two points, from which on there is a corner


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Symmetry:
    """Rotations about `center` that map the shape onto itself: a discrete group times turns about
    `axis`.
    """

    axis: Array | None = None  # (3,) unit, in T: any turn about it maps the shape onto itself
    # (n, 3, 3), identity first
    rotations: Array = field(default_factory=lambda: readonly(np.eye(3)[None]))
    # (3,) [m] fixed point of all rotations, in T
    center: Array = field(default_factory=lambda: readonly(np.zeros(3)))

    def __post_init__(self) -> None:
        rotations = real_array(self.rotations, "symmetry rotations", "(n, 3, 3) numbers")
        if rotations.ndim != 3 or rotations.shape[1:] != (3, 3) or not len(rotations):
            raise ConfigurationError(
                f"symmetry rotations: expected shape (n, 3, 3), got {rotations.shape}"
            )

        # checked first, because the square of a large number overflows
        small = np.where(np.abs(rotations) < 2.0, rotations, np.nan)
        if not np.abs(small @ small.transpose(0, 2, 1) - np.eye(3)).max() <= 1e-6:
            raise ConfigurationError("symmetry rotations: every matrix must be orthonormal")
        if not np.all(np.linalg.det(rotations) > 0.0):
            raise ConfigurationError(
                "symmetry rotations: every matrix must be a rotation, not a reflection"
            )

        object.__setattr__(self, "rotations", readonly(rotations))
        object.__setattr__(self, "center", checked(self.center, (3,), "symmetry center"))
        if self.axis is not None:
            axis = checked(self.axis, (3,), "symmetry axis")
            longest = float(np.abs(axis).max())
            if not longest > 1e-9:
                raise ConfigurationError("symmetry axis: must not be zero")
            axis = axis / longest  # scaled first, because the square of a very long axis overflows
            object.__setattr__(self, "axis", readonly(axis / np.linalg.norm(axis)))

    @property
    def is_none(self) -> bool:
        """True if only the identity maps the shape onto itself."""
        return self.axis is None and len(self.rotations) == 1

    def about_center(self, R: Array) -> Array:
        """Pose (4, 4) in T of the shape turned by `R` (3, 3) about the centre of symmetry."""
        return pose(R, self.center - R @ self.center)

    def nearest_pose(self, X_AT: Array, R_AT_prior: Array) -> Array:
        """Among all poses (4, 4) equivalent to `X_AT`, the one with the smallest rotation from
        `R_AT_prior` (3, 3).
        """
        return X_AT @ self.about_center(X_AT[:3, :3].T @ self.nearest(X_AT[:3, :3], R_AT_prior))

    def nearest(self, R_AT: Array, R_AT_prior: Array) -> Array:
        """Among all rotations equivalent to `R_AT`, the one nearest to `R_AT_prior` (both (3,
        3)).
        """
        best = R_AT
        best_trace = -np.inf

        for G in self.rotations:
            R = R_AT @ G
            if self.axis is not None:
                # tr(M Rot(a, phi)) = const + (tr M - a.Ma) cos phi + (-m.a) sin phi has its maximum
                # in closed form.
                M = R_AT_prior.T @ R
                m = np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])
                phi = np.arctan2(-m @ self.axis, np.trace(M) - self.axis @ M @ self.axis)
                R = R @ exp_so3(phi * self.axis)

            trace = float(np.trace(R_AT_prior.T @ R))
            if trace > best_trace:
                best = R
                best_trace = trace

        return best

    def cosines(self, R_AT: Array, R_AT_true: Array) -> Array:
        """Cosines (n,) of the least angles between attitudes modulo symmetry; one of the two may be
        a single (3, 3).
        """
        largest = np.array(-np.inf)
        for G in self.rotations:
            M = np.swapaxes(R_AT_true, -1, -2) @ R_AT @ G
            trace = np.trace(M, axis1=-2, axis2=-1)

            # largest trace over all angles, in closed form as in `nearest`
            if self.axis is not None:
                along = np.einsum("i,...ij,j", self.axis, M, self.axis)
                aside = (M[..., [2, 0, 1], [1, 2, 0]] - M[..., [1, 2, 0], [2, 0, 1]]) @ self.axis
                trace = along + np.hypot(trace - along, aside)
            largest = np.maximum(largest, trace)

        return 0.5 * (largest - 1.0)

    def error(self, X_AT: Array, X_AT_true: Array, p_T: Array | None = None) -> tuple[float, float]:
        """Error between two poses (4, 4) modulo symmetry.

        Args:
            X_AT: pose of T in A.
            X_AT_true: true pose of T in A.
            p_T: (3,) [m] point of the shape whose displacement is computed, in T; by default the
                origin. A point far from the shape moves much when the shape turns little.

        Returns:
            Distance between the two positions of the point [m], and least rotation angle [rad].
        """
        R_true = X_AT_true[:3, :3]
        nearest = self.nearest_pose(X_AT, R_true)

        delta = R_true.T @ nearest[:3, :3]
        sine = 0.5 * np.linalg.norm(
            [delta[2, 1] - delta[1, 2], delta[0, 2] - delta[2, 0], delta[1, 0] - delta[0, 1]]
        )
        angle = float(np.arctan2(sine, 0.5 * (np.trace(delta) - 1.0)))

        away = nearest[:3, 3] - X_AT_true[:3, 3]
        if p_T is not None:
            away = away + (nearest[:3, :3] - R_true) @ p_T
        return float(np.linalg.norm(away)), angle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelPath:
    """Tool path on the model, in T: points X'_j and axes a'_j, b'_j of [Konoplin 2022, eq. 3]."""

    p: Array  # (N, 3) [m] points on the surface
    a: Array  # (N, 3) unit tool axis, into the surface
    b: Array  # (N, 3) unit, along the path, or, if `keeps_b`, the direction of the tool's x axis
    # True: the tool keeps its x axis along b, since it is not round; False: it may turn about a
    keeps_b: bool = False

    def __post_init__(self) -> None:
        n = len(checked_rows(self.p, 3, "model path p", least=0))
        if n < 4:
            raise ConfigurationError(f"model path: a cubic spline needs at least 4 points, got {n}")
        for name in ("p", "a", "b"):
            rows = checked(getattr(self, name), (n, 3), f"model path {name}")
            if np.abs(rows).max() > FARTHEST_VERTEX:
                raise ConfigurationError(
                    f"model path {name}: numbers must lie within {FARTHEST_VERTEX:g}"
                )
            if name != "p" and np.abs(np.linalg.norm(rows, axis=1) - 1.0).max() > 1e-6:
                raise ConfigurationError(f"model path {name}: every row must be a unit vector")
            object.__setattr__(self, name, rows)

        if (
            self.keeps_b
            and not np.linalg.norm(np.cross(self.a, self.b), axis=1).min() > _LEAST_SINE
        ):
            raise ConfigurationError(
                "model path b: the x axis of the tool must not be parallel to its axis a"
            )

    def turned(self, angle: float, blend: float = 0.0, *, dwell: bool = False) -> "ModelPath":
        """The path for a tool that is not round, whose x axis stays at an angle from `b`.

        Args:
            angle: [rad] from `b`, right-handed about `a`.
            blend: [m] length of path over which the tool turns at a corner. The angle is averaged
                over this length, and over _SHORTEST_BLEND at least; the motion there is as slow as
                the turn requires.
            dwell: True: in a corner of `uuv.models.objects.axis_steps.STEP` or more, the tool stops
                and turns at rest instead.
        """
        b = self.b - np.sum(self.b * self.a, axis=1, keepdims=True) * self.a
        b /= np.linalg.norm(b, axis=1, keepdims=True)

        # Turn of b relative to an axis that does not turn about a.
        still = without_turn(b[0], self.a)
        across = np.cross(self.a, still)
        turn = np.unwrap(np.arctan2(np.sum(b * across, axis=1), np.sum(b * still, axis=1)))

        if not dwell and (np.abs(np.diff(turn)).max() > _CORNER or blend > 0.0):
            step = float(np.linalg.norm(np.diff(self.p, axis=0), axis=1).mean())
            width = max(1, round(max(blend, _SHORTEST_BLEND) / step))
            from scipy import ndimage

            turn = ndimage.uniform_filter1d(turn, width, mode="nearest")[:, None]
            b = np.cos(turn) * still + np.sin(turn) * across

        return replace(
            self, b=np.cos(angle) * b + np.sin(angle) * np.cross(self.a, b), keeps_b=True
        )


def without_turn(first: Array, z: Array) -> Array:
    """Second axes (n, 3), starting with `first` (3,), without turn about `z` (n, 3) (parallel
    transport).
    """
    x = np.empty_like(z)
    last = first
    for i, axis in enumerate(z):
        last = last - (last @ axis) * axis
        last = x[i] = last / np.linalg.norm(last)
    return x


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetModel:
    """Prior knowledge of an object to work on: mesh, symmetry, paths and collision shapes."""

    name: str
    vertices: Array  # (V, 3) [m], in T
    triangles: np.ndarray  # (T, 3) int indices into `vertices`
    symmetry: Symmetry = field(default_factory=Symmetry)
    paths: Mapping[str, ModelPath] = field(default_factory=dict)  # tool paths by name
    grasps: Mapping[str, Grasp] = field(default_factory=dict)  # for parallel jaws, by name
    # collision primitives, each with the shape of one part of the mesh
    solids: tuple[Solid, ...] = ()
    # (n, 3) [m] corners, in T, of convex collision parts in addition to the solids
    hulls: tuple[Array, ...] = ()
    # supporting parts: in the scene, but not in the model used for identification
    stand: tuple[Solid, ...] = ()
    # how the mesh was made, if the object was given as a point cloud
    cloud: "CloudMesh | None" = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ConfigurationError(
                f"target: name must be a string, got {type(self.name).__name__}"
            )
        if not isinstance(self.symmetry, Symmetry):
            raise ConfigurationError(
                f"target {self.name!r}: expected a Symmetry, got {type(self.symmetry).__name__}"
            )
        if not isinstance(self.paths, Mapping) or not all(
            isinstance(p, ModelPath) for p in self.paths.values()
        ):
            raise ConfigurationError(
                f"target {self.name!r}: paths must be a mapping of names to ModelPath"
            )

        vertices, triangles = checked_mesh(self.vertices, self.triangles, f"target {self.name!r}")
        triangles.setflags(write=False)
        for hull in self.hulls:
            if (
                hull.ndim != 2
                or hull.shape[1] != 3
                or len(hull) < 4
                or not np.all(np.isfinite(hull))
            ):
                raise ConfigurationError(
                    f"target {self.name!r}: a hull must be finite, (n, 3), n > 3; got {hull.shape}"
                )

        object.__setattr__(self, "vertices", readonly(vertices))
        object.__setattr__(self, "hulls", tuple(readonly(hull) for hull in self.hulls))
        object.__setattr__(self, "triangles", triangles)
        object.__setattr__(self, "paths", MappingProxyType(dict(self.paths)))
        grasps = checked_grasps(self.grasps, f"target {self.name!r}")
        object.__setattr__(self, "grasps", MappingProxyType(grasps))

    @property
    def center(self) -> Array:
        """Centre (3,) [m] of the bounding box, in T: the point that a coarse detection yields."""
        return 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))

    @property
    def radius(self) -> float:
        """Radius [m] of the sphere around `center` that encloses the whole model."""
        return float(np.linalg.norm(self.vertices - self.center, axis=1).max())

    def path(self, name: str) -> ModelPath:
        """Tool path by name.

        Raises:
            ConfigurationError: an unknown name; the message lists the known ones.
        """
        if name not in self.paths:
            raise ConfigurationError(
                f"target {self.name!r} has no path {name!r}; it has {sorted(self.paths)}"
            )
        return self.paths[name]

    def with_path(self, name: str, path: ModelPath) -> "TargetModel":
        """Copy of the target with `path` added or replaced under `name`."""
        return replace(self, paths={**self.paths, name: path})

    def add_to(
        self, spec: "mujoco.MjSpec", X_WT: ArrayLike, stand: bool = True, felt: bool = True
    ) -> "mujoco.MjsBody":
        """Add the target to the world of `spec`, as a body and a main geom both named "target".

        The other geoms are named "target_<part>". If the target has solids only, they are both
        visible and used for collision. If it has hulls, the mesh is visible, and the solids and
        hulls are hidden and used for collision. If it has neither, the mesh is first decomposed
        into hulls, which takes seconds for a large mesh (half a minute for a fouled barrel).

        Args:
            spec: scene.
            X_WT: (4, 4) pose of the target.
            stand: True: add the stand too.
            felt: False: skip the decomposition; the mesh is then visible but has no collision.

        Returns:
            The body, so that the caller can set friction or colour.

        Raises:
            ConfigurationError: a bad pose.
        """
        import mujoco

        X = checked_pose(X_WT, "X_WT")
        body = spec.worldbody.add_body(
            name="target", pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3])
        )

        middle = middle_if_far(self.vertices)  # MuJoCo keeps meshes in single precision
        hulls = self.hulls
        cut = felt and not (self.solids or self.hulls)
        if cut:
            from uuv.models.meshes import convex_parts

            hulls = convex_parts.parts(self.vertices, self.triangles)

        # Visible geoms: the mesh, unless solids show the whole object.
        if hulls or not self.solids:
            spec.add_mesh(
                name="target",
                uservert=(self.vertices - middle).astype(np.float32).ravel(),
                userface=self.triangles.astype(np.int32).ravel(),
                # the scan of a user may be open
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )
            body.add_geom(
                name="target",
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname="target",
                pos=middle,
                contype=0,
                conaffinity=0,
            )

        # Collision geoms: hulls and solids.
        for k, hull in enumerate(hulls):
            name = f"target_hull_{k}"
            spec.add_mesh(
                name=name,
                uservert=(hull - middle).astype(np.float32).ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # some hulls are thin
            )
            part = body.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, pos=middle
            )
            _hide(part)
            if cut:
                _soften(part, spec)

        for solid in (*self.solids, *(self.stand if stand else ())):
            geom = solid.add_to(body)
            if hulls and solid in self.solids:
                _hide(geom)

        return body

    @classmethod
    def from_file(
        cls,
        file: str | Path,
        name: str | None = None,
        symmetry: Symmetry | None = None,
        paths: Mapping[str, ModelPath] | None = None,
        scale: float | None = None,
    ) -> "TargetModel":
        """Load a target from a mesh file (STL, PLY, OBJ, OFF, glTF, GLB) or cloud (PLY, PCD, text).

        A PLY without faces is a cloud. A cloud is meshed as by `from_cloud`. Text files have x y z
        on each line, and optionally the outward normal; a first line may name the columns. Other
        columns, such as colours, are left out, and `cloud.note` says so.

        Args:
            file: path.
            name: by default the file's stem.
            symmetry: by default none.
            paths: tool paths by name.
            scale: metres per unit of the file (0.001 for millimetres). None means metres, and a
                model larger than `LARGEST` is refused.

        Returns:
            The target.

        Raises:
            ConfigurationError: the file is missing, unreadable, has no surface, or has a wrong
                unit.
        """
        path = existing_file(file, "target mesh")
        if scale is not None:
            scale = finite_number(scale, "target mesh: scale", least=1e-9, most=1e9)

        normals = None
        triangles = np.zeros((0, 3), dtype=np.int64)
        notes = ()
        is_cloud = is_cloud_file(path)
        if is_cloud:
            surfels = read_surfels(path, "target cloud")
            finite = np.isfinite(surfels.points).all(axis=1)
            vertices = surfels.points[finite]
            normals = surfels.normals
            normals = None if normals is None else normals[finite]
            notes = surfels.notes
        else:
            vertices, triangles = read_mesh(path)

        vertices = vertices * (1.0 if scale is None else scale)
        size = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
        if scale is None and size > LARGEST:
            raise ConfigurationError(
                f"target mesh {str(path)!r}: is {size:.4g} m across, more than {LARGEST:.0f} m; "
                "state its scale (0.001 if it is in millimetres, 1 if it is so large)"
            )

        if is_cloud:
            return _noted(
                cls.from_cloud(vertices, normals, name or path.stem, symmetry, paths), notes
            )

        return cls(
            name=name or path.stem,
            vertices=vertices,
            triangles=triangles,
            symmetry=symmetry or Symmetry(),
            paths=paths or {},
        )

    @classmethod
    def from_cloud(
        cls,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        name: str = "cloud",
        symmetry: Symmetry | None = None,
        paths: Mapping[str, ModelPath] | None = None,
    ) -> "TargetModel":
        """Target from a point cloud, which is meshed; `cloud.note` describes how.

        All thresholds of the meshing are multiples of the spacing of the points. The mesh of a scan
        from some sides stays open: its borders do not count as edges of the object, and the side
        that was not scanned is unknown.

        Args:
            points: (n, 3) [m] on the surface, in T, in any order; rows that are not finite are left
                out.
            normals: (n, 3) outward, of any length; None: computed from the points. Points whose
                normal is zero or not finite are left out, and `cloud.note` says so. If no normal is
                usable, all are computed from the points.
            name: name of the target.
            symmetry: by default none.
            paths: tool paths by name.

        Raises:
            ConfigurationError: an array has another shape, there are too few points, or the points
                form no surface.
        """
        what = f"target cloud {name!r}"
        positions, outward, notes = usable_cloud(points, normals, what)
        from uuv.models.meshes.cloud_mesh import mesh_of_cloud

        mesh = mesh_of_cloud(positions, outward)
        target = cls(
            name=name,
            vertices=mesh.vertices,
            triangles=mesh.triangles,
            symmetry=symmetry or Symmetry(),
            paths=paths or {},
            cloud=mesh,
        )
        return _noted(target, notes)


def _noted(target: TargetModel, notes: Sequence[str]) -> TargetModel:
    """The target of a cloud, with further notes on how the target was made."""
    cloud = target.cloud
    if cloud is None or not notes:
        return target
    return replace(target, cloud=replace(cloud, note="; ".join([cloud.note, *notes])))


def _hide(geom: "mujoco.MjsGeom") -> None:
    """Hide `geom` from cameras and logs; it still collides."""
    geom.group = 3
    geom.rgba = [0.5, 0.5, 0.5, 0.0]


def _soften(part: "mujoco.MjsGeom", spec: "mujoco.MjSpec") -> None:
    """Make the contact of `part` compliant, with a penetration of some tenths of a millimetre.

    Where parts meet, a tool is in contact with several at once and penetrates each of them less.
    With stiff contacts the penetration is then so small that a pressed tool loses contact between
    steps. The friction coefficient remains that of the tool.
    """
    # equal priority: MuJoCo takes the larger friction, and mixes the rest by `solmix`
    part.priority = max(geom.priority for geom in spec.geoms)
    part.friction = [0.0, 0.0, 0.0]
    part.solmix = 1e6
    part.solref = [0.006, 1.0]
    part.solimp = [0.8, 0.9, 0.001, 0.5, 2.0]
