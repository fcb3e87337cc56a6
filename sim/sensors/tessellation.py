"""Triangulation of the geoms of a compiled model, fine enough for measurements."""

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

SAGITTA = 2e-4  # [m] largest distance of a tessellated curved primitive from the true surface

_BOX_CORNERS = np.array(
    [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64
)
_BOX_FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)


def tessellate(model: mujoco.MjModel, geom: int) -> tuple[Array, np.ndarray]:
    """Triangles of any geom except a plane; those of curved primitives are within SAGITTA of the
    true surface.

    Args:
        model: Compiled model.
        geom: Index of the geom.

    Returns:
        Vertices (V, 3) [m] in the geom's frame, and triangles (T, 3).

    Raises:
        ConfigurationError: The type has no surface.
    """
    kinds = mujoco.mjtGeom
    kind = kinds(int(model.geom_type[geom]))
    size = model.geom_size[geom]

    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        count = model.mesh_vertnum[mesh]
        first = model.mesh_faceadr[mesh]
        faces = model.mesh_facenum[mesh]
        return (
            model.mesh_vert[start : start + count].astype(np.float64),
            model.mesh_face[first : first + faces].astype(np.int64),
        )

    if kind == kinds.mjGEOM_BOX:
        return _BOX_CORNERS * size, _BOX_FACES
    if kind == kinds.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))

    # Surfaces of revolution.
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

    raise ConfigurationError(
        f"geom {model.geom(geom).name!r} has a type that has no surface here: {kind}"
    )


def _sides(radius: float) -> int:
    return int(np.clip(np.ceil(np.pi / np.arccos(1.0 - min(SAGITTA / radius, 0.5))), 12, 360))


def _half_circle(radius: float, scale: float) -> tuple[Array, Array]:
    """Heights and radii from pole to pole. The number of rows is odd, and the middle row is the
    equator.
    """
    angle = np.linspace(0.0, np.pi, 2 * (_sides(scale) // 4 + 1) + 1)
    r = radius * np.sin(angle)
    r[[0, -1]] = 0.0
    return -radius * np.cos(angle), r


def _lathe(z: Array, radius: Array, scale: float) -> tuple[Array, np.ndarray]:
    """Surface of revolution about z of the profile (z, radius), both (P,) [m].

    The number of sides is chosen for a circle of radius `scale` [m].
    """
    sides = _sides(scale)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    rings = np.stack(
        [
            np.outer(radius, np.cos(angle)),
            np.outer(radius, np.sin(angle)),
            np.repeat(z[:, None], sides, axis=1),
        ],
        -1,
    )

    # Two triangles on each side between neighbouring rings.
    i = np.arange(sides)
    j = (i + 1) % sides
    low = (np.arange(len(z) - 1) * sides)[:, None]
    first = np.stack([low + i, low + j, low + sides + i], -1).reshape(-1, 3)
    second = np.stack([low + j, low + sides + j, low + sides + i], -1).reshape(-1, 3)

    vertices = rings.reshape(-1, 3)
    faces = np.vstack([first, second])
    corner = vertices[faces]
    area = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    return vertices, faces[area > 0.0]  # at the poles one triangle of each pair has no area


def _height_field(model: mujoco.MjModel, field: int) -> tuple[Array, np.ndarray]:
    """Upper surface of a height field, triangulated as in MuJoCo."""
    rows = int(model.hfield_nrow[field])
    columns = int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    half_x, half_y, top, _ = model.hfield_size[field]

    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    z = top * model.hfield_data[start : start + rows * columns]

    # Each cell is divided along the diagonal from corner a to corner c.
    index = np.arange(rows * columns).reshape(rows, columns)
    a = index[:-1, :-1].ravel()
    b = index[:-1, 1:].ravel()
    c = index[1:, 1:].ravel()
    d = index[1:, :-1].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel(), z]), faces
