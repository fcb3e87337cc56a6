"""Shells of the geoms of a compiled model, grouped by moving body.

A body that is welded to another moves with it, so its geoms belong to the body that has the joint,
as in MuJoCo's fusing of static bodies. Bodies welded to the world have no hydrodynamics and are
left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.meshes.closed_shells import prism, revolve, volume
from uuv.models.water_from_geometry.choices import Choice
from uuv.models.water_from_geometry.shells import Shells, shells_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, rotation_from_quat_wxyz

LARGEST = 20.0  # [m] extent of a geom, from which on its mesh is assumed to be in millimetres
_SIDES = 64  # number of sides of round shapes
_RINGS = 33  # number of rings of a sphere or ellipsoid
_KINDS = mujoco.mjtGeom
_SHAPES = {
    int(_KINDS.mjGEOM_SPHERE): "sphere",
    int(_KINDS.mjGEOM_CAPSULE): "capsule",
    int(_KINDS.mjGEOM_ELLIPSOID): "ellipsoid",
    int(_KINDS.mjGEOM_CYLINDER): "cylinder",
    int(_KINDS.mjGEOM_BOX): "box",
    int(_KINDS.mjGEOM_MESH): "mesh",
}
_BOUNDLESS = {int(_KINDS.mjGEOM_PLANE): "plane", int(_KINDS.mjGEOM_HFIELD): "height field"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeomShells:
    """One geom as closed shells, in the frame of the moving body."""

    name: str  # its name in errors and tables
    kind: str
    size: Array  # (3,) [m] in the form of MuJoCo's geom size
    R: Array  # (3, 3) orientation of the geom in the body
    p: Array  # (3,) [m] position of the geom in the body
    shells: Shells


def moving_bodies(model: mujoco.MjModel) -> list[int]:
    """Bodies that have joints or float. Each is the root of the bodies welded to it."""
    return [
        i for i in range(1, model.nbody) if model.body_weldid[i] == i and model.body_dofnum[i] > 0
    ]


def geoms_of(model: mujoco.MjModel, body: int, choice: Choice) -> tuple[list[int], str]:
    """Geoms of a moving body, and of the bodies welded to it, that displace water; and their kind
    as text.

    "auto" selects the visual geoms, which do not collide, if there are any, else the collision
    geoms.
    """
    mine = [g for g in range(model.ngeom) if model.body_weldid[model.geom_bodyid[g]] == body]
    visual = [g for g in mine if not (model.geom_contype[g] or model.geom_conaffinity[g])]
    collision = [g for g in mine if g not in set(visual)]

    if choice == "all" or not mine:
        return mine, "geoms"
    if choice == "auto":
        choice = (
            "visual" if any(int(model.geom_type[g]) in _SHAPES for g in visual) else "collision"
        )
    return (visual, "visual geoms") if choice == "visual" else (collision, "collision geoms")


def shells_in_body(model: mujoco.MjModel, body: int, geoms: list[int]) -> Iterator[GeomShells]:
    """Closed shells of geoms, in the frame of the moving body.

    Raises:
        ConfigurationError: a geom is a plane or a height field, has no inside, or is larger than
            `LARGEST`.
    """
    meshes: dict[int, Shells] = {}
    for g in geoms:
        # Only shapes that have an inside.
        kind = int(model.geom_type[g])
        name = _name(model, g)
        if kind not in _SHAPES:
            what = _BOUNDLESS.get(kind, _KINDS(kind).name.removeprefix("mjGEOM_").lower())
            raise ConfigurationError(
                f"{name}: a {what} has no volume; geoms of a moving body must be one of "
                f"{', '.join(_SHAPES.values())}"
            )

        # The shape in its own frame; a mesh is closed once for all geoms that use it.
        R, p = _in_body(model, g, body)
        if kind == int(_KINDS.mjGEOM_MESH):
            at = int(model.geom_dataid[g])
            if at not in meshes:
                meshes[at] = shells_of(*_mesh(model, at))
            shells = meshes[at]
        else:
            vertices, triangles = primitive(_SHAPES[kind], model.geom_size[g])
            shells = Shells(corners=vertices[triangles], said="closed form")

        # The shape in the body's frame, of a size that a vehicle may have.
        corners = shells.corners @ R.T + p
        extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max()) if len(corners) else 0.0
        if extent > LARGEST:
            raise ConfigurationError(
                f"{name}: must be at most {LARGEST:.0f} m across, got {extent:.4g} m; if its mesh "
                "is "
                'in millimetres, write scale="0.001 0.001 0.001" into the file, or for a mesh file '
                "--scale 0.001"
            )

        yield GeomShells(
            name=name,
            kind=_SHAPES[kind],
            size=np.array(model.geom_size[g]),
            R=R,
            p=p,
            shells=Shells(corners=corners, said=shells.said, doubt=shells.doubt),
        )


def _in_body(model: mujoco.MjModel, geom: int, body: int) -> tuple[Array, Array]:
    """Rotation (3, 3) and position (3,) [m] of a geom in the body that carries it, the same to the
    bit at every pose of that body.
    """
    R = rotation_from_quat_wxyz(model.geom_quat[geom])
    p = np.array(model.geom_pos[geom])
    at = int(model.geom_bodyid[geom])

    while at != body:
        outer = rotation_from_quat_wxyz(model.body_quat[at])
        R = outer @ R
        p = outer @ p + model.body_pos[at]
        at = int(model.body_parentid[at])
    return R, p


def primitive(shape: str, size: Array) -> tuple[Array, np.ndarray]:
    """Closed triangles of a plain shape of MuJoCo's size; round shapes are scaled to the exact
    volume.

    Args:
        shape: sphere, capsule, ellipsoid, cylinder or box.
        size: (3,) [m] in the form of MuJoCo's geom size.

    Returns:
        Vertices (V, 3) [m] in the geom's frame, and triangles (T, 3).
    """
    x, y, z = (float(length) for length in size)

    # Profile of a round shape, from pole to pole.
    angle = np.linspace(0.0, np.pi, _RINGS)
    arc = np.column_stack([-np.cos(angle), np.sin(angle)])
    arc[[0, -1], 1] = 0.0

    if shape == "box":
        base = np.array([[-x, -y, -z], [x, -y, -z], [x, y, -z], [-x, y, -z]])
        return prism(base, base * [1.0, 1.0, -1.0])

    if shape == "cylinder":
        turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        wider = np.sqrt(2.0 * np.pi / _SIDES / np.sin(2.0 * np.pi / _SIDES))
        ring = x * wider * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)])
        end = np.array([0.0, 0.0, y])
        return prism(ring - end, ring + end)

    if shape == "capsule":
        half = _RINGS // 2 + 1
        profile = np.vstack([x * arc[:half] - [y, 0.0], x * arc[half - 1 :] + [y, 0.0]])
        vertices, triangles = revolve(profile, _SIDES)
        vertices = vertices[:, [1, 2, 0]]
        true = np.pi * x**2 * (2.0 * y + 4.0 / 3.0 * x)
        wider = np.sqrt(true / volume(vertices, triangles))
        return vertices * [wider, wider, 1.0], triangles

    # Sphere or ellipsoid.
    vertices, triangles = revolve(arc, _SIDES)
    vertices = vertices * (4.0 / 3.0 * np.pi / volume(vertices, triangles)) ** (1.0 / 3.0)
    return vertices[:, [1, 2, 0]] * ([x, x, x] if shape == "sphere" else [x, y, z]), triangles


def exact_volume(geom: GeomShells) -> float:
    """Volume [m^3] of a plain shape in closed form."""
    x, y, z = geom.size
    return float(
        {
            "sphere": 4.0 / 3.0 * np.pi * x**3,
            "ellipsoid": 4.0 / 3.0 * np.pi * x * y * z,
            "capsule": np.pi * x**2 * (2.0 * y + 4.0 / 3.0 * x),
            "cylinder": 2.0 * np.pi * x**2 * y,
            "box": 8.0 * x * y * z,
        }[geom.kind]
    )


def _mesh(model: mujoco.MjModel, at: int) -> tuple[Array, np.ndarray]:
    """Vertices (V, 3) [m] and triangles (T, 3) of a mesh, in the frame of its geom."""
    v = int(model.mesh_vertadr[at])
    f = int(model.mesh_faceadr[at])
    vertices = model.mesh_vert[v : v + model.mesh_vertnum[at]].astype(np.float64)
    return vertices, model.mesh_face[f : f + model.mesh_facenum[at]].astype(np.int64)


def _name(model: mujoco.MjModel, g: int) -> str:
    """Name of a geom for error messages."""
    body = model.body(int(model.geom_bodyid[g])).name
    name = model.geom(g).name
    mesh = int(model.geom_dataid[g]) if int(model.geom_type[g]) == int(_KINDS.mjGEOM_MESH) else -1
    label = (
        repr(name) if name else f"of mesh {model.mesh(mesh).name!r}" if mesh >= 0 else f"number {g}"
    )
    return f"body {body!r}: geom {label}"
