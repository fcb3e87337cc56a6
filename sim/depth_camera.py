"""A stereo depth camera by ray casting: every geom that a viewer shows, and the errors that stereo makes.

Open3D's ray caster is used because no screen or GL may be assumed, `mj_multiRay` takes 20 times as long and misses
visual-only geoms. Frame C has OpenCV axes: x right, y down, z along the optical axis.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np
from scipy import ndimage

from models import open3d_loader
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import DepthImage
from sim.interfaces.spatial import Array, checked, pose, readonly

SAGITTA = 2e-4  # [m], largest distance of a tessellated curved primitive from the true one
NEAR = 0.02  # [m], nothing closer than this to the camera's plane is drawn
EDGE = 0.025  # relative jump of disparity between neighbours that counts as a depth edge
VISIBLE_GROUPS = (0, 1, 2)  # what MuJoCo's own renderer shows; models keep collision shapes in 3 and above

_BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
_BOX_FACES = np.array(
    [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]
).reshape(-1, 3)


class BodyPoses(Protocol):
    """What the camera looks at in `sim.plant.Truth`."""

    @property
    def time(self) -> float: ...  # [s]

    @property
    def xpos(self) -> Array: ...  # (nbody, 3) [m] in W

    @property
    def xmat(self) -> Array: ...  # (nbody, 9) rotations to W, row-major


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoNoise:
    """Errors of a stereo camera, made in disparity: sigma_z = z^2 disparity_sigma / (f baseline)."""

    disparity_sigma: float = 0.25  # [px]
    baseline: float = 0.12  # [m]
    correlation: float = 5.0  # [px] at which the correlation of the error has fallen to 1/e
    disparity_step: float = 1.0 / 16.0  # [px] quantum of the matcher; 0: none
    flying: float = 0.5  # probability that a pair of pixels across a depth edge makes a flying pixel
    max_incidence: float = np.deg2rad(75.0)  # [rad] from the surface normal; nothing comes back beyond it

    def __post_init__(self) -> None:
        for name in ("disparity_sigma", "correlation", "disparity_step"):
            if not getattr(self, name) >= 0.0:
                raise ConfigurationError(f"stereo noise: {name} must not be negative, got {getattr(self, name)}")
        if not self.baseline > 0.0:
            raise ConfigurationError(f"stereo noise: baseline must be positive, got {self.baseline}")
        if not 0.0 <= self.flying <= 1.0:
            raise ConfigurationError(f"stereo noise: flying must lie in [0, 1], got {self.flying}")
        if not 0.0 < self.max_incidence <= 0.5 * np.pi:
            raise ConfigurationError(f"stereo noise: max_incidence must lie in (0, pi/2], got {self.max_incidence}")


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCameraState:
    """Where the camera's noise has come to; a frame depends on nothing else, so a run can be replayed."""

    seed: int
    frame: int


class DepthCamera:
    """A depth camera fixed to a body of a compiled model; delivers one frame each time it is asked (`period` 0)."""

    period = 0.0  # [s], on request

    def __init__(
        self,
        model: mujoco.MjModel,
        hull: str,
        X_BC: Array,
        *,
        width: int = 640,
        height: int = 480,
        focal: float = 554.0,
        range_limits: tuple[float, float] = (0.3, 10.0),
        noise: StereoNoise | None = StereoNoise(),
        delay: float = 0.0,
        exclude: Collection[str] = (),
        groups: Collection[int] = VISIBLE_GROUPS,
    ) -> None:
        """Mount the camera on body `hull` of `model` at `X_BC` (4, 4), OpenCV axes.

        `width`, `height` and `focal` are in px, the principal point is the middle of the picture; `range_limits` and
        `delay` are in m and s; `noise` None gives exact depth; bodies named in `exclude` and geoms outside `groups`
        are not seen, nor are transparent ones (alpha 0), flexes and skins.
        Raises ConfigurationError for unknown bodies or impossible numbers, MissingLibraryError without Open3D.
        """
        if not (width > 0 and height > 0 and focal > 0.0):
            raise ConfigurationError(f"depth camera: {width} x {height} px with focal {focal} px is no camera")
        if not 0.0 < range_limits[0] < range_limits[1]:
            raise ConfigurationError(f"depth camera: range_limits must be 0 < near < far, got {range_limits}")
        if not delay >= 0.0:
            raise ConfigurationError(f"depth camera: delay must not be negative, got {delay}")
        self.delay = delay
        self._hull = _body_id(model, hull)
        self._X_BC = checked(X_BC, (4, 4), "X_BC")
        self._range = range_limits
        self._noise = noise
        self._K = readonly([[focal, 0, 0.5 * (width - 1)], [0, focal, 0.5 * (height - 1)], [0, 0, 1]])
        self._shape = (height, width)
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        # With unit z component the ray parameter is the depth along the optical axis.
        self._rays_C = np.stack(
            [(u - self._K[0, 2]) / focal, (v - self._K[1, 2]) / focal, np.ones_like(u)], axis=-1
        ).astype(np.float32)
        self._ray_length = np.linalg.norm(self._rays_C, axis=-1)
        self._build(model, {_body_id(model, name) for name in exclude}, set(groups))

    @classmethod
    def at_site(cls, model: mujoco.MjModel, site: str, **options: Any) -> "DepthCamera":
        """A camera at `site`, looking along its z axis with x to the right; options as in the constructor."""
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site)
        if index < 0:
            raise ConfigurationError(f"depth camera: no site {site!r}; there are {_names(model, 'site', model.nsite)}")
        X_BC = pose(_rotation(model.site_quat[index]), model.site_pos[index])
        return cls(model, model.body(model.site_bodyid[index]).name, X_BC, **options)

    @classmethod
    def at_camera(cls, model: mujoco.MjModel, camera: str, **options: Any) -> "DepthCamera":
        """A camera where MuJoCo's `camera` is (which looks along its -z axis, y up); options as in the constructor."""
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if index < 0:
            raise ConfigurationError(
                f"depth camera: no camera {camera!r}; there are {_names(model, 'camera', model.ncam)}"
            )
        R_BC = _rotation(model.cam_quat[index]) @ np.diag([1.0, -1.0, -1.0])
        return cls(model, model.body(model.cam_bodyid[index]).name, pose(R_BC, model.cam_pos[index]), **options)

    @property
    def K(self) -> Array:
        """Pinhole matrix (3, 3) [px]."""
        return self._K

    def init(self, rng: np.random.Generator) -> DepthCameraState:
        """Draw the seed of this camera's noise from `rng`."""
        return DepthCameraState(seed=int(rng.integers(2**63)), frame=0)

    def step(self, state: DepthCameraState, truth: BodyPoses) -> tuple[DepthCameraState, DepthImage]:
        """One frame of the world as `truth` has it; the same state and truth always give the same frame."""
        depth, cosine = self.render(truth.xpos, truth.xmat)
        if self._noise is not None:
            depth = add_noise(
                depth, cosine, float(self._K[0, 0]), self._noise, np.random.default_rng([state.seed, state.frame])
            )
        depth = depth.astype(np.float64)
        depth[~((depth >= self._range[0]) & (depth <= self._range[1]))] = np.nan
        depth.setflags(write=False)
        image = DepthImage(time=float(truth.time), depth=depth, K=self._K, X_BC=self._X_BC)
        return DepthCameraState(seed=state.seed, frame=state.frame + 1), image

    def render(self, xpos: Array, xmat: Array) -> tuple[np.ndarray, np.ndarray]:
        """Exact depth (height, width) [m], inf where nothing is hit, and cosine of the incidence there.

        `xpos` (nbody, 3) [m] and `xmat` (nbody, 9) are the bodies' world poses.
        """
        R_W = np.asarray(xmat, dtype=np.float64).reshape(-1, 3, 3)
        X_WC = pose(R_W[self._hull], xpos[self._hull]) @ self._X_BC
        R_WC, p_WC = X_WC[:3, :3], X_WC[:3, 3]

        depth = np.full(self._shape, np.inf, dtype=np.float32)
        cosine = np.ones(self._shape, dtype=np.float32)
        rays_W = self._rays_C @ R_WC.T.astype(np.float32)
        if self._static is not None:
            hit = open3d_loader.cast_rays(self._static, p_WC, rays_W)
            depth = hit["t"]
            cosine = np.abs(np.einsum("hwi,hwi->hw", hit["normal"], rays_W)) / self._ray_length
        for plane in self._planes:
            plane.draw(p_WC, rays_W, self._ray_length, depth, cosine)
        if len(self._moving_faces):
            self._draw_moving(X_WC, R_W, xpos, depth, cosine)
        depth[depth < NEAR] = np.inf
        return depth, cosine

    def _draw_moving(self, X_WC: Array, R_W: Array, xpos: Array, depth: np.ndarray, cosine: np.ndarray) -> None:
        """Draw the moving bodies over `depth` and `cosine`, casting only the pixels that they can cover."""
        R_CW = X_WC[:3, :3].T
        vertices_C = np.concatenate(
            [p_B @ (R_CW @ R_W[body]).T + R_CW @ (xpos[body] - X_WC[:3, 3]) for body, p_B in self._moving]
        )
        faces = self._moving_faces[(vertices_C[self._moving_faces, 2] > NEAR).any(axis=1)]
        if not len(faces):
            return
        window = self._window(vertices_C[faces])
        rays = self._rays_C[window]
        if not rays.size:
            return
        hit = open3d_loader.cast_rays(open3d_loader.ray_scene(vertices_C, faces), np.zeros(3), rays)
        nearer = hit["t"] < depth[window]
        incidence = np.abs(np.einsum("hwi,hwi->hw", hit["normal"], rays)) / self._ray_length[window]
        depth[window] = np.where(nearer, hit["t"], depth[window])
        cosine[window] = np.where(nearer, incidence, cosine[window])

    def _window(self, corners_C: Array) -> tuple[slice, slice]:
        """Rows and columns that hold the picture of triangles (T, 3, 3) [m] in C, clipped at the near plane."""
        start, end = corners_C.reshape(-1, 3), corners_C[:, [1, 2, 0]].reshape(-1, 3)
        crossing = (start[:, 2] > NEAR) != (end[:, 2] > NEAR)
        a, b = start[crossing], end[crossing]
        clipped = a + ((NEAR - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None] * (b - a)
        seen = np.vstack([start[start[:, 2] > NEAR], clipped])
        uv = seen[:, :2] / seen[:, 2:] * self._K[0, 0] + self._K[:2, 2]
        # Clip before the cast to int: a point on the near plane can project arbitrarily far off.
        low = np.clip(np.floor(uv.min(axis=0)), 0, [self._shape[1], self._shape[0]]).astype(int)
        high = np.clip(np.ceil(uv.max(axis=0)) + 1, 0, [self._shape[1], self._shape[0]]).astype(int)
        return slice(low[1], high[1]), slice(low[0], high[0])

    def _build(self, model: mujoco.MjModel, excluded: set[int], groups: set[int]) -> None:
        """Sort the visible geoms into one static scene in W, planes, and meshes of the bodies that move."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        static: list[tuple[Array, np.ndarray]] = []
        moving: dict[int, list[tuple[Array, np.ndarray]]] = {}
        self._planes: list[_Plane] = []
        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            if body in excluded or int(model.geom_group[geom]) not in groups or _alpha(model, geom) == 0.0:
                continue
            X_BS = pose(_rotation(model.geom_quat[geom]), model.geom_pos[geom])
            X_WB = pose(data.xmat[body].reshape(3, 3), data.xpos[body])
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                self._planes.append(_Plane(X_WB @ X_BS, model.geom_size[geom]))
                continue
            vertices, faces = tessellate(model, geom)
            # Bodies without joints are part of the world, unless a mocap root carries them about.
            fixed = model.body_weldid[body] == 0 and model.body_mocapid[model.body_rootid[body]] < 0
            X = X_WB @ X_BS if fixed else X_BS
            part = (vertices @ X[:3, :3].T + X[:3, 3], faces)
            if fixed:
                static.append(part)
            else:
                moving.setdefault(body, []).append(part)
        self._static = open3d_loader.ray_scene(*_joined(static)) if static else None
        bodies = {body: _joined(parts) for body, parts in moving.items()}
        self._moving = [(body, vertices) for body, (vertices, _) in bodies.items()]
        self._moving_faces = _joined(list(bodies.values()))[1] if bodies else np.zeros((0, 3), dtype=np.int64)


@dataclass(frozen=True, slots=True)
class _Plane:
    """A plane geom, kept in closed form: as triangles it would have to end somewhere."""

    X_WS: Array
    size: Array  # half lengths along x and y [m]; 0: infinite

    def draw(self, p_WC: Array, rays_W: np.ndarray, length: np.ndarray, depth: np.ndarray, cosine: np.ndarray) -> None:
        x, y, z = self.X_WS[:3, :3].T
        offset = p_WC - self.X_WS[:3, 3]
        height = float(offset @ z)
        if height <= 0.0:  # like MuJoCo's, it has no back
            return
        descent = -(rays_W @ z.astype(np.float32))
        with np.errstate(divide="ignore", over="ignore"):
            t = height / descent
        nearer = (descent > 0.0) & (t < depth)
        for axis, half in ((x, self.size[0]), (y, self.size[1])):
            if half > 0.0:
                reach = rays_W @ axis.astype(np.float32)
                nearer[nearer] = np.abs(offset @ axis + t[nearer] * reach[nearer]) <= half
        depth[nearer] = t[nearer]
        cosine[nearer] = descent[nearer] / length[nearer]


def add_noise(
    depth: np.ndarray, cosine: np.ndarray, focal: float, noise: StereoNoise, rng: np.random.Generator
) -> np.ndarray:
    """Depth (height, width) [m] as stereo with focal length `focal` [px] would measure it; inf where nothing came back.

    `depth` is exact, `cosine` that of the incidence. Order as in a matcher: mixed pixels at edges, correlated
    disparity error, quantisation, drop-out at grazing incidence.
    """
    with np.errstate(divide="ignore"):
        disparity = np.float32(focal * noise.baseline) / depth
    if noise.flying > 0.0:
        _mix_edges(disparity, noise.flying, rng)
    seen = disparity > 0.0
    if noise.disparity_sigma > 0.0:
        error = rng.standard_normal(depth.shape, dtype=np.float32)
        if noise.correlation > 0.0:
            # White noise through a Gaussian of width s is correlated as exp(-r^2 / (4 s^2)).
            kernel = ndimage.gaussian_filter1d(np.eye(1, 65, 32)[0], 0.5 * noise.correlation, truncate=3.0)
            error = ndimage.gaussian_filter(error, 0.5 * noise.correlation, truncate=3.0, mode="wrap")
            error /= np.float32(kernel @ kernel)
        disparity += np.float32(noise.disparity_sigma) * error
    if noise.disparity_step > 0.0:
        disparity = np.rint(disparity / np.float32(noise.disparity_step)) * np.float32(noise.disparity_step)
    seen &= (disparity > 0.0) & (cosine >= np.cos(noise.max_incidence))
    result = np.full_like(depth, np.inf)
    np.divide(np.float32(focal * noise.baseline), disparity, out=result, where=seen)
    return result


def _mix_edges(disparity: np.ndarray, probability: float, rng: np.random.Generator) -> None:
    """Turn some pixels at depth edges into a blend of both sides, in place."""
    width = disparity.shape[1]
    flat = disparity.ravel()
    for step, ahead, behind in (
        (1, disparity[:, 1:], disparity[:, :-1]),
        (width, disparity[1:], disparity[:-1]),
    ):
        row, column = np.nonzero(np.abs(ahead - behind) > EDGE * np.maximum(ahead, behind))
        first = row * width + column
        first = first[rng.random(len(first)) < probability]
        second = first + step
        swap = rng.random(len(first)) < 0.5
        pixel, other = np.where(swap, second, first), np.where(swap, first, second)
        flat[pixel] += rng.random(len(first), dtype=np.float32) * (flat[other] - flat[pixel])


def tessellate(model: mujoco.MjModel, geom: int) -> tuple[Array, np.ndarray]:
    """Vertices (V, 3) [m] in the geom's own frame, and triangles (T, 3), of any geom but a plane.

    Curved primitives are within SAGITTA of the true surface. Raises ConfigurationError for an unknown type.
    """
    kinds = mujoco.mjtGeom
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom]
    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return (
            model.mesh_vert[start : start + count].astype(np.float64),
            model.mesh_face[first : first + faces].astype(np.int64),
        )
    if kind == kinds.mjGEOM_BOX:
        return _BOX_CORNERS * size, _BOX_FACES
    if kind == kinds.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    if kind == kinds.mjGEOM_SPHERE:
        return _lathe(*_half_circle(size[0], size[0]), size[0])
    if kind == kinds.mjGEOM_ELLIPSOID:
        radius = float(size.max())
        vertices, faces = _lathe(*_half_circle(radius, radius), radius)
        return vertices * (size / radius), faces
    if kind == kinds.mjGEOM_CYLINDER:
        return _lathe(np.array([-1, -1, 1, 1]) * size[1], np.array([0, 1, 1, 0]) * size[0], size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        z, radius = _half_circle(size[0], size[0])
        middle = len(z) // 2
        z = np.concatenate([z[: middle + 1] - size[1], z[middle:] + size[1]])
        radius = np.concatenate([radius[: middle + 1], radius[middle:]])
        return _lathe(z, radius, size[0])
    raise ConfigurationError(f"depth camera: geom {model.geom(geom).name!r} has a type it cannot draw: {kind}")


def _sides(radius: float) -> int:
    return int(np.clip(np.ceil(np.pi / np.arccos(1.0 - min(SAGITTA / radius, 0.5))), 12, 360))


def _half_circle(radius: float, scale: float) -> tuple[Array, Array]:
    """Heights and radii from pole to pole, an odd number of rows: the middle one is the equator."""
    angle = np.linspace(0.0, np.pi, 2 * (_sides(scale) // 4 + 1) + 1)
    r = radius * np.sin(angle)
    r[[0, -1]] = 0.0
    return -radius * np.cos(angle), r


def _lathe(z: Array, radius: Array, scale: float) -> tuple[Array, np.ndarray]:
    """Surface of the profile (z, radius), both (P,) [m], turned about z; fine enough for a circle of `scale` [m]."""
    sides = _sides(scale)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    rings = np.stack(
        [np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)), np.repeat(z[:, None], sides, axis=1)], -1
    )
    i = np.arange(sides)
    j = (i + 1) % sides
    low = (np.arange(len(z) - 1) * sides)[:, None]
    first = np.stack([low + i, low + j, low + sides + i], -1).reshape(-1, 3)
    second = np.stack([low + j, low + sides + j, low + sides + i], -1).reshape(-1, 3)
    vertices, faces = rings.reshape(-1, 3), np.vstack([first, second])
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return vertices, faces[area > 0.0]  # at the poles one of each pair has no area


def _height_field(model: mujoco.MjModel, field: int) -> tuple[Array, np.ndarray]:
    """The upper surface of a height field, cut into the same triangles as MuJoCo's."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    half_x, half_y, top, _ = model.hfield_size[field]
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    z = top * model.hfield_data[start : start + rows * columns]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel(), z]), faces


def _joined(parts: list[tuple[Array, np.ndarray]]) -> tuple[Array, np.ndarray]:
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + offset for (_, faces), offset in zip(parts, offsets, strict=True)]),
    )


def _rotation(quat_wxyz: Array) -> Array:
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quat_wxyz)
    return R.reshape(3, 3)


def _alpha(model: mujoco.MjModel, geom: int) -> float:
    material = model.geom_matid[geom]
    return float(model.mat_rgba[material, 3] if material >= 0 else model.geom_rgba[geom, 3])


def _names(model: mujoco.MjModel, kind: str, count: int) -> list[str]:
    return [getattr(model, kind)(index).name for index in range(count)]


def _body_id(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        raise ConfigurationError(f"depth camera: no body {name!r}; there are {_names(model, 'body', model.nbody)}")
    return int(index)
