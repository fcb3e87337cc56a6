"""Ray casting on a compiled model. Every geom that a viewer shows is visible to the sensors.

Embree casts the rays, since a display or GL cannot be assumed, and `mj_multiRay` takes 20 times as
long and misses visual-only geoms. Most rays miss most of a scene. Rays are therefore grouped in
tiles and triangles in clusters, and a tile is cast only if its cone meets a cluster.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import mujoco
import numpy as np

from uuv.models.meshes import ray_casting
from uuv.models.meshes.closed_shells import joined
from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, inverse, pose, rotation_from_quat_wxyz
from uuv.sim.sensors.tessellation import tessellate

# geom groups that MuJoCo's renderer shows; models keep collision shapes in 3 and above
VISIBLE_GROUPS = (0, 1, 2)

_TILE = 16  # number of rays along the side of a tile
_CLUSTERS = 400  # largest number of clusters of a mesh; more clusters cost as much as they save
_CLUSTER = 16  # smallest number of triangles in a cluster


class BodyPoses(Protocol):
    """World poses of all bodies: `uuv.sim.plant.truth.Truth`, or MjData after `mj_kinematics`."""

    @property
    def time(self) -> float:
        """Time [s]."""
        ...

    @property
    def xpos(self) -> Array:
        """Body origins (nbody, 3) [m] in W."""
        ...

    @property
    def xmat(self) -> Array:
        """Rotations to W (nbody, 9), row-major."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays of a sensor in its frame S, and the bounding cones of its tiles; made by `of`."""

    # (H, W, ..., 3) float32, of any length; distances are in units of this length
    directions: np.ndarray
    origins: np.ndarray  # [m] of the same shape, or (1, 3) for all rays
    near: float  # hits at a smaller distance do not count
    tile: np.ndarray  # (N,) index of the tile of each ray
    cone: np.ndarray  # (T, 8): centre of the origins, their radius, axis, half angle

    @classmethod
    def of(cls, directions: np.ndarray, near: float, origins: np.ndarray | None = None) -> "Rays":
        """Rays of a sensor, grouped in tiles.

        Args:
            directions: (H, W, ..., 3) in S, of any length.
            near: Closest distance of a hit, in lengths of the direction.
            origins: [m] of the same shape; default: the origin of S.

        Returns:
            The rays.
        """
        way = np.ascontiguousarray(directions, dtype=np.float32)
        start = (
            np.zeros((1, 3), np.float32)
            if origins is None
            else np.ascontiguousarray(origins, dtype=np.float32)
        )

        height, width = way.shape[:2]
        columns = -(-width // _TILE)
        tile = (np.arange(height)[:, None] // _TILE) * columns + np.arange(width) // _TILE
        tile = np.repeat(tile.ravel(), int(np.prod(way.shape[2:-1])))

        return cls(
            way,
            start,
            near,
            tile,
            _cones(way.reshape(-1, 3), start.reshape(-1, 3), tile, int(tile[-1]) + 1),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Visible:
    """Surfaces that a sensor can see. Transparent geoms (alpha 0), flexes and skins are invisible
    to every sensor.
    """

    exclude: Collection[str] = ()  # names of invisible bodies
    groups: Collection[int] = VISIBLE_GROUPS  # visible geom groups

    def world(self, model: mujoco.MjModel, sensor: str) -> "VisibleWorld":
        """The visible surfaces of a model; `sensor` names the sensor in an error.

        Raises:
            ConfigurationError: A body to exclude is unknown.
            MissingLibraryError: No ray caster is installed.
        """
        return VisibleWorld(
            model,
            exclude={body_id(model, name, sensor) for name in self.exclude},
            groups=self.groups,
        )


ALL = Visible()


class VisibleWorld:
    """Visible surfaces of a model for ray casting: static surfaces in one scene, and one scene for
    each moving body.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        exclude: Collection[int] = (),
        groups: Collection[int] = VISIBLE_GROUPS,
    ) -> None:
        """Collect the visible surfaces. Scenes are built from them when the first rays are cast.

        Transparent geoms (alpha 0), flexes and skins are invisible. Height fields are read once, by
        this call.

        Args:
            model: Compiled model.
            exclude: Indices of invisible bodies.
            groups: Visible geom groups.

        Raises:
            MissingLibraryError: No ray caster is installed.
        """
        ray_casting.installed()  # raises now if no ray caster is installed
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        static: list[tuple[Array, np.ndarray]] = []
        moving: dict[int, list[tuple[Array, np.ndarray]]] = {}
        self._planes: list[tuple[Array, Array]] = []  # pose in W, half lengths

        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            if (
                body in exclude
                or int(model.geom_group[geom]) not in groups
                or _alpha(model, geom) == 0.0
            ):
                continue
            X_BG = pose(rotation_from_quat_wxyz(model.geom_quat[geom]), model.geom_pos[geom])
            X_WB = pose(data.xmat[body].reshape(3, 3), data.xpos[body])
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                # Planes are kept in closed form, because triangles cannot be infinite.
                self._planes.append((X_WB @ X_BG, model.geom_size[geom].copy()))
                continue

            vertices, faces = tessellate(model, geom)
            # Bodies without joints are part of the world, unless a mocap root moves them.
            fixed = model.body_weldid[body] == 0 and model.body_mocapid[model.body_rootid[body]] < 0
            X = X_WB @ X_BG if fixed else X_BG
            part = (vertices @ X[:3, :3].T + X[:3, 3], faces)
            if fixed:
                static.append(part)
            else:
                moving.setdefault(body, []).append(part)

        self._static: _Surface | None = None
        self._middle_W = np.zeros(3)
        if static:
            vertices, faces = joined(static)
            # Embree's single precision is too coarse far from W's origin: 0.1 mm at 3 km.
            self._middle_W = vertices.mean(axis=0)
            self._static = _Surface(0, vertices, faces, self._middle_W)
        self._moving = [_Surface(body, *joined(parts)) for body, parts in moving.items()]

    def cast(
        self, X_WS: Array, rays: Rays, xpos: Array, xmat: Array
    ) -> tuple[np.ndarray, np.ndarray]:
        """Cast all rays.

        Args:
            X_WS: Pose of the sensor (4, 4).
            rays: Rays in S.
            xpos: Body origins (nbody, 3) [m] in W.
            xmat: Rotations of the bodies to W (nbody, 9).

        Returns:
            Distance to the first surface in lengths of the ray's direction, and cosine of the angle
            of incidence there. Both are float32 arrays in the shape of the rays; without a hit they
            are inf and 1.
        """
        way = rays.directions.reshape(-1, 3)
        start = rays.origins.reshape(-1, 3)
        distance = np.full(len(way), np.inf, dtype=np.float32)
        cosine = np.ones(len(way), dtype=np.float32)
        R_WS = X_WS[:3, :3]
        p_WS = X_WS[:3, 3]

        if self._static is not None:
            clusters = self._static.clusters
            centers = (clusters[:, :3] - p_WS) @ R_WS
            tiles = _meetings(rays.cone, _spheres(centers, clusters[:, 3]))
            X_FS = pose(R_WS, p_WS - self._middle_W)
            self._cast_chosen(self._static.scene, X_FS, rays, tiles, distance, cosine)

        for X_WG, size in self._planes:
            R_SG = R_WS.T @ X_WG[:3, :3]
            p_SG = R_WS.T @ (X_WG[:3, 3] - p_WS)
            _draw_plane(R_SG, p_SG, size, way, start, rays.near, distance, cosine)
        if self._moving:
            self._cast_moving(
                X_WS, rays, xpos, np.asarray(xmat).reshape(-1, 3, 3), distance, cosine
            )

        shape = rays.directions.shape[:-1]
        return distance.reshape(shape), cosine.reshape(shape)

    def _cast_moving(
        self,
        X_WS: Array,
        rays: Rays,
        xpos: Array,
        R_W: Array,
        distance: np.ndarray,
        cosine: np.ndarray,
    ) -> None:
        """Cast rays on the moving bodies, in their frames B, and merge into `distance` and `cosine`
        (N,).
        """
        for part in self._moving:
            X_BS = inverse(pose(R_W[part.body], xpos[part.body])) @ X_WS
            centers = (part.clusters[:, :3] - X_BS[:3, 3]) @ X_BS[:3, :3]
            tiles = _meetings(rays.cone, _spheres(centers, part.clusters[:, 3]))
            self._cast_chosen(part.scene, X_BS, rays, tiles, distance, cosine)

    @staticmethod
    def _cast_chosen(
        scene: RayScene,
        X_FS: Array,
        rays: Rays,
        tiles: np.ndarray,
        distance: np.ndarray,
        cosine: np.ndarray,
    ) -> None:
        """Cast rays of the chosen tiles (T,) on `scene`, in frame F, and merge into the last two
        arguments (N,).
        """
        chosen = np.flatnonzero(tiles[rays.tile])
        if not len(chosen):
            return

        near = rays.near
        way = rays.directions.reshape(-1, 3)
        start = rays.origins.reshape(-1, 3)
        origins, directions = _gathered(way, start, chosen, near)

        turn = X_FS[:3, :3].T.astype(np.float32)
        directions = directions @ turn
        hit = scene.cast(origins @ turn + X_FS[:3, 3].astype(np.float32), directions)
        _keep_nearer(hit["t"], hit["normal"], directions, chosen, near, distance, cosine)


@dataclass(frozen=True, eq=False)
class _Surface:
    """Triangles that a sensor sees, and the scene and clusters, which are built when the first rays
    are cast.
    """

    body: int  # body in whose axes the triangles are; 0: the world
    vertices: Array  # (V, 3) [m]
    faces: np.ndarray  # (T, 3)
    middle: Array | None = None  # (3,) [m] origin of the scene; None: that of the axes

    @cached_property
    def scene(self) -> RayScene:
        """Scene of the triangles for ray casting."""
        moved = self.vertices if self.middle is None else self.vertices - self.middle
        return RayScene(moved, self.faces)

    @cached_property
    def clusters(self) -> Array:
        """Bounding spheres (C, 4) of runs of triangles, centre and radius [m]."""
        return _clusters(self.vertices, self.faces)


def body_id(model: mujoco.MjModel, name: str, sensor: str) -> int:
    """Index of the body `name`; `sensor` begins the error message.

    Args:
        model: Compiled model.
        name: Name of the body.
        sensor: Name of the sensor.

    Returns:
        The index.

    Raises:
        ConfigurationError: There is no such body.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        raise ConfigurationError(
            f"{sensor}: no body {name!r}; there are {names(model, 'body', model.nbody)}"
        )
    return int(index)


def site_on_body(model: mujoco.MjModel, site: str, sensor: str) -> tuple[str, Array]:
    """Body that `site` is attached to, and the site's pose in the body.

    Args:
        model: Compiled model.
        site: Name of the site.
        sensor: Name of the sensor, which begins the error message.

    Returns:
        Name of the body, and X_BS (4, 4).

    Raises:
        ConfigurationError: There is no such site.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site)
    if index < 0:
        raise ConfigurationError(
            f"{sensor}: no site {site!r}; there are {names(model, 'site', model.nsite)}"
        )
    X_BS = pose(rotation_from_quat_wxyz(model.site_quat[index]), model.site_pos[index])
    return model.body(model.site_bodyid[index]).name, X_BS


def names(model: mujoco.MjModel, kind: str, count: int) -> list[str]:
    """Names of the first elements of a kind.

    Args:
        model: Compiled model.
        kind: Accessor of MjModel, such as "body".
        count: Number of elements.

    Returns:
        The names.
    """
    return [getattr(model, kind)(index).name for index in range(count)]


def _alpha(model: mujoco.MjModel, geom: int) -> float:
    material = model.geom_matid[geom]
    return float(model.mat_rgba[material, 3] if material >= 0 else model.geom_rgba[geom, 3])


def _cluster_size(faces: np.ndarray) -> int:
    return max(_CLUSTER, -(-len(faces) // _CLUSTERS))


def _clusters(vertices: Array, faces: np.ndarray) -> Array:
    """Bounding spheres (C, 4), centre and radius [m], of runs of successive triangles."""
    first = np.arange(0, len(faces), _cluster_size(faces))
    corners = vertices[faces]
    low = np.minimum.reduceat(corners.min(axis=1), first)
    high = np.maximum.reduceat(corners.max(axis=1), first)
    center = 0.5 * (low + high)

    away = np.linalg.norm(
        corners - center[np.arange(len(faces)) // _cluster_size(faces)][:, None], axis=2
    ).max(axis=1)
    return np.column_stack([center, np.maximum.reduceat(away, first)])


def _spheres(centers: Array, radii: Array) -> np.ndarray:
    return np.column_stack([centers, radii])


def _cones(way: np.ndarray, start: np.ndarray, tile: np.ndarray, count: int) -> np.ndarray:
    """Bounding cones (T, 8) of the rays (N, 3) of each tile, with the spheres of their origins."""
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    axis = np.column_stack([np.bincount(tile, unit[:, i], count) for i in range(3)])
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)

    # By the chord, since in single precision the cosine of a narrow cone does not resolve its
    # angle.
    chord = np.zeros(count)
    np.maximum.at(chord, tile, np.linalg.norm(unit - axis[tile], axis=1))

    origin = np.repeat(start[:1].astype(np.float64), count, axis=0)
    spread = np.zeros(count)
    if len(start) > 1:
        number = np.bincount(tile, minlength=count)[:, None]
        origin = np.column_stack([np.bincount(tile, start[:, i], count) for i in range(3)]) / number
        np.maximum.at(spread, tile, np.linalg.norm(start - origin[tile], axis=1))

    half = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) + 1e-4
    return np.column_stack([origin, spread + 1e-4, axis, half])


@kernel
def _meetings(cones: np.ndarray, spheres: np.ndarray) -> np.ndarray:
    """Mask (T,) of the cones that meet any of the spheres."""
    tiles = np.zeros(len(cones), dtype=np.bool_)
    for i in range(len(cones)):
        cos_half = np.cos(cones[i, 7])
        sin_half = np.sin(cones[i, 7])
        for j in range(len(spheres)):
            x, y, z = (
                spheres[j, 0] - cones[i, 0],
                spheres[j, 1] - cones[i, 1],
                spheres[j, 2] - cones[i, 2],
            )

            reach = spheres[j, 3] + cones[i, 3]
            along = x * cones[i, 4] + y * cones[i, 5] + z * cones[i, 6]
            square = x * x + y * y + z * z
            beside = np.sqrt(max(square - along * along, 0.0))

            # The nearest point is the cone's apex, or a point of its mantle at the distance of the
            # first sum.
            if (
                square <= reach * reach
                or cones[i, 7] >= 0.5 * np.pi
                or (
                    beside * cos_half - along * sin_half <= reach
                    and along * cos_half + beside * sin_half >= 0.0
                )
            ):
                tiles[i] = True
                break

    return tiles


@kernel
def _gathered(
    way: np.ndarray, start: np.ndarray, chosen: np.ndarray, near: float
) -> tuple[np.ndarray, np.ndarray]:
    """Origins, shifted by `near` along the ray, and directions of the chosen rays, (M, 3) each."""
    origins = np.empty((len(chosen), 3), dtype=np.float32)
    directions = np.empty((len(chosen), 3), dtype=np.float32)
    common = len(start) == 1
    for k in range(len(chosen)):
        ray = chosen[k]
        source = 0 if common else ray
        for axis in range(3):
            directions[k, axis] = way[ray, axis]
            origins[k, axis] = start[source, axis] + near * way[ray, axis]
    return origins, directions


@kernel
def _keep_nearer(
    t: np.ndarray,
    normal: np.ndarray,
    way: np.ndarray,
    chosen: np.ndarray,
    near: float,
    distance: np.ndarray,
    cosine: np.ndarray,
) -> None:
    for k in range(len(chosen)):
        ray = chosen[k]
        far = t[k] + near
        if far < distance[ray]:
            distance[ray] = far
            x, y, z = way[k, 0], way[k, 1], way[k, 2]
            across = x * normal[k, 0] + y * normal[k, 1] + z * normal[k, 2]
            cosine[ray] = abs(across) / np.sqrt(x * x + y * y + z * z)


@kernel
def _draw_plane(
    R_SG: np.ndarray,
    p_SG: np.ndarray,
    size: np.ndarray,
    way: np.ndarray,
    start: np.ndarray,
    near: float,
    distance: np.ndarray,
    cosine: np.ndarray,
) -> None:
    """Intersect rays with a one-sided plane geom, as in MuJoCo; half lengths of 0 are infinite."""
    common = len(start) == 1
    for ray in range(len(way)):
        x, y, z = way[ray, 0], way[ray, 1], way[ray, 2]
        descent = -(x * R_SG[0, 2] + y * R_SG[1, 2] + z * R_SG[2, 2])
        if descent <= 0.0:
            continue

        source = 0 if common else ray
        a, b, c = start[source, 0] - p_SG[0], start[source, 1] - p_SG[1], start[source, 2] - p_SG[2]
        height = a * R_SG[0, 2] + b * R_SG[1, 2] + c * R_SG[2, 2]
        t = height / descent
        if height <= 0.0 or t < near or t >= distance[ray]:
            continue

        a, b, c = a + t * x, b + t * y, c + t * z
        if size[0] > 0.0 and abs(a * R_SG[0, 0] + b * R_SG[1, 0] + c * R_SG[2, 0]) > size[0]:
            continue
        if size[1] > 0.0 and abs(a * R_SG[0, 1] + b * R_SG[1, 1] + c * R_SG[2, 1]) > size[1]:
            continue

        distance[ray] = t
        cosine[ray] = descent / np.sqrt(x * x + y * y + z * z)
