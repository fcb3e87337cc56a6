"""Kinds of scenes: the object is clean, partly hidden, fouled, in a heap, replaced by another
object, absent, or too little of it is visible.

The scenes are those of `uuv.clouds.object_scenes`. Occluders are added as parts of the object's
stand. Fouling and a heap are parts of the mesh in the object's place.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from uuv.clouds.frames import ObjectScene, pinhole
from uuv.clouds.object_scenes import object_scene, seeded_view, target_of
from uuv.clouds.placing import Body, heaped, hidden_by
from uuv.models.meshes.closed_shells import (
    area_centroid,
    joined,
    moved,
    split,
    vertex_normals,
    welded,
)
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects import targets
from uuv.models.objects.targets import Solid, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points
from uuv.sim.interfaces.streams import Streams

KINDS: Mapping[str, bool] = {  # value: the object is in the scene, and enough of it is visible
    "clean": True,
    "hidden": True,  # 20 to 50 % of the object's visible part is hidden
    # 30 % of the surface is fouled, 10 to 40 mm thick, or at most a tenth of the object's radius
    "fouled": True,
    # the object is on the seabed, others are on it and next to it; at most 60 % of it is hidden
    "heap": True,
    "hidden_most": False,  # 70 to 90 % of the object is hidden
    "other": False,  # another object, or the same object in another size
    "absent": False,
}
# share of the image to hide, drawn between these bounds
_HIDDEN = {"hidden": (0.2, 0.45), "hidden_most": (0.72, 0.85)}
_HEAP = 5  # number of objects in a heap
_SIZES = (0.4, 1.0)  # size of the other objects, in extents of the object
_MOST_HIDDEN = 0.6  # largest hidden share of the object's image in a heap
_HEAPS = 40  # number of heaps tried
UNEVEN = "uneven starfish"
NAMES: tuple[str, ...] = (*targets.available(), UNEVEN)
_FINE = 60_000  # largest number of triangles after a subdivision
_RAYS = 4  # [px] spacing of the rays that measure occlusion


@cache
def object_of(name: str) -> TargetModel:
    """The object `name` of NAMES.

    Raises:
        ConfigurationError: The name is unknown.
    """
    return uneven_starfish() if name == UNEVEN else target_of(name)


def uneven_starfish() -> TargetModel:
    """Starfish whose five arms differ in length by up to 16 %: a rotation by 72 deg is nearly a
    symmetry.
    """
    sides = 200
    rings = 12
    height = 0.035  # [m]

    # Outline: a disc with arms, each of which is a bump of the radius.
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radius = np.full(sides, 0.055)
    for k, length in enumerate((1.0, 0.93, 1.05, 0.97, 1.08)):
        aside = np.angle(np.exp(1j * (angle - 2.0 * np.pi * k / 5.0)))
        radius = np.maximum(radius, 0.03 + 0.18 * length * np.exp(-((aside / 0.28) ** 2)))

    # Rings from the top, where they meet in a point, down to the edge of the flat base.
    share = np.arange(1, rings + 1) / rings
    top = np.stack(
        [
            np.outer(share, radius * np.cos(angle)),
            np.outer(share, radius * np.sin(angle)),
            np.repeat(height * np.sqrt(1.0 - share**2)[:, None], sides, axis=1),
        ],
        axis=-1,
    )
    vertices = np.vstack([[[0.0, 0.0, height]], top.reshape(-1, 3), [[0.0, 0.0, 0.0]]])

    # Triangles: a fan at the top, two for each patch between rings, and a fan at the base.
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = [np.column_stack([np.zeros_like(i), 1 + i, 1 + j])]
    for ring in range(rings - 1):
        inner = 1 + ring * sides
        outer = inner + sides
        faces += [
            np.column_stack([inner + i, outer + i, outer + j]),
            np.column_stack([inner + i, outer + j, inner + j]),
        ]

    rim = 1 + (rings - 1) * sides
    faces.append(np.column_stack([np.full_like(i, len(vertices) - 1), rim + j, rim + i]))
    return TargetModel(name=UNEVEN, vertices=vertices, triangles=np.vstack(faces))


def draw(
    name: str, kind: str, seed: int, sensor: str, X_CN: Array | None = None, look: int = 0
) -> ObjectScene:
    """The scene of `seed`.

    Args:
        name: Object in NAMES.
        kind: Kind of scene in KINDS.
        seed: Draws the scene and its changes.
        sensor: Name in `uuv.clouds.frames.SENSORS`.
        X_CN: (4, 4) pose of another view, as in `object_scene`; None: the seed's view.
        look: Number of the look, which draws its noise.

    Raises:
        ConfigurationError: A name is unknown.
    """
    if kind not in KINDS:
        raise ConfigurationError(f"kind of scene: must be one of {sorted(KINDS)}, got {kind!r}")
    target = object_of(name)

    # Changes of this kind of scene; every change draws from its own stream.
    streams = Streams(seed)
    shown = target
    content: dict[str, Any] = {}
    hidden = 0.0

    match kind:
        case "absent":
            content["absent"] = True
        case "other":
            shown = other_than(target, streams["other"])
        case "fouled":
            thick = min(0.04, 0.1 * target.radius)
            shown = fouled(target, streams["growth"], (0.25 * thick, thick))
        case "hidden" | "hidden_most":
            share = streams["hidden share"].uniform(*_HIDDEN[kind])
            X_CT, _ = seeded_view(target, seed)
            solids, hidden = occluders(target, X_CT, share, streams["occluders"])
            shown = replace(target, stand=(*target.stand, *solids))
        case "heap":
            shown, hidden = in_heap(target, seeded_view(target, seed)[0], streams["heap"])
            content["gap"] = (0.0, 0.0)  # the object lies on the seabed

    scene = object_scene(target, seed, sensor, there=shown, X_CN=X_CN, look=look, **content)
    return replace(scene, hidden=hidden)


def other_than(target: TargetModel, rng: np.random.Generator) -> TargetModel:
    """Another object of NAMES, or `target` 15 to 30 % smaller or 18 to 43 % larger as a mesh."""
    others = [object_of(name) for name in NAMES if object_of(name).name != target.name]
    if rng.random() < 0.6:
        return others[int(rng.integers(len(others)))]
    scale = rng.uniform(0.7, 0.85)
    scale = 1.0 / scale if rng.random() < 0.5 else scale
    return TargetModel(
        name=f"{target.name} in another size",
        vertices=target.center + scale * (target.vertices - target.center),
        triangles=target.triangles,
    )


def fouled(
    target: TargetModel, rng: np.random.Generator, thick: tuple[float, float], cover: float = 0.3
) -> TargetModel:
    """`target` with random mounds of fouling along its normals.

    Args:
        target: The clean object.
        rng: Draws the mounds.
        thick: [m] bounds of their height.
        cover: Share of the vertices that are covered.
    """
    vertices, triangles = welded(target.vertices, target.triangles)
    while len(triangles) < _FINE // 4:
        vertices, triangles = split(vertices, triangles, np.ones(len(triangles), dtype=bool), 0.0)
    normals = vertex_normals(vertices, triangles)

    growth = np.zeros(len(vertices))
    while (growth > 0.25 * thick[0]).mean() < cover:
        middle = vertices[rng.integers(len(vertices))]
        width = rng.uniform(0.1, 0.25) * target.radius
        height = rng.uniform(*thick)
        distance = np.linalg.norm(vertices - middle, axis=1)
        growth = np.maximum(growth, height * np.exp(-0.5 * (distance / width) ** 4))
    return TargetModel(
        name=f"{target.name}, fouled",
        vertices=vertices + growth[:, None] * normals,
        triangles=triangles,
        stand=target.stand,
    )


def in_heap(
    target: TargetModel, X_CT: Array, rng: np.random.Generator
) -> tuple[TargetModel, float]:
    """The object among others that touch it or each other, as one mesh in T.

    The object stands upright. The others are objects of NAMES in drawn sizes, and are lowered onto
    it or pushed against it.

    Args:
        target: The object.
        X_CT: (4, 4) its pose in the camera frame.
        rng: Draws the others and their poses.

    Returns:
        The heap, and the share of the object's image that the others hide.

    Raises:
        ConfigurationError: Every heap that was tried hides too much.
    """
    lowest = target.vertices[:, 2].min()
    X_TF = pose(p=[*target.center[:2], lowest])  # F has its origin under the object, on the seabed
    upright = moved((target.vertices, target.triangles), inverse(X_TF))
    body = Body.of(upright, rng)
    others = [name for name in NAMES if name != target.name]

    for _ in range(_HEAPS):
        shapes = [
            _resized(object_of(str(name)), rng.uniform(*_SIZES) * body.extent)
            for name in rng.choice(others, _HEAP - 1, replace=False)
        ]
        poses = heaped(shapes, rng, around=[body])
        shells = [
            moved((shape.vertices, shape.triangles), X_FN)
            for shape, X_FN in zip(shapes, poses, strict=True)
        ]

        around = [Body.of(shell, rng) for shell in shells]
        hidden = float(hidden_by(body, around, X_CT @ X_TF)[1].mean())
        if hidden <= _MOST_HIDDEN:
            vertices, triangles = moved(joined([upright, *shells]), X_TF)
            heap = TargetModel(
                name=f"{target.name} in a heap", vertices=vertices, triangles=triangles
            )
            return heap, hidden
    raise ConfigurationError(
        f"{target.name}: each of {_HEAPS} heaps hides more than {_MOST_HIDDEN:.0%} of it"
    )


def _resized(target: TargetModel, extent: float) -> TargetModel:
    """An object scaled to a largest side of `extent` [m], with the centroid of its surface at the
    origin of T.
    """
    vertices = target.vertices - area_centroid(target.vertices, target.triangles)
    scale = extent / np.ptp(vertices, axis=0).max()
    return TargetModel(name=target.name, vertices=scale * vertices, triangles=target.triangles)


def occluders(
    target: TargetModel, X_CT: Array, share: float, rng: np.random.Generator
) -> tuple[tuple[Solid, ...], float]:
    """Spheres between camera and object that hide a share of its image.

    Args:
        target: The object.
        X_CT: (4, 4) its pose in the camera frame.
        share: Share of the image to hide.
        rng: Draws the spheres.

    Returns:
        Spheres in T, and the share that they hide.
    """
    X_TC = inverse(X_CT)
    rays = pinhole(_RAYS).reshape(-1, 3)
    scene = RayScene(target.vertices, target.triangles)
    t = scene.cast(X_TC[:3, 3], rays @ X_TC[:3, :3].T)["t"]
    visible = rays[np.isfinite(t)] * t[np.isfinite(t), None]
    spread = float(np.linalg.norm(visible - visible.mean(axis=0), axis=1).max())
    way = visible / np.linalg.norm(visible, axis=1, keepdims=True)

    # Spheres are added until they hide enough; one that hides too much is left out.
    covered = np.zeros(len(visible), dtype=bool)
    solids: list[Solid] = []
    for k in range(200):
        if covered.mean() >= share:
            break
        p = visible[rng.integers(len(visible))]
        nearness = rng.uniform(0.5, 0.8)
        center = nearness * p
        size = nearness * spread * rng.uniform(0.1, 0.4)
        with_it = covered | (np.linalg.norm(np.cross(way, center), axis=1) < size)
        if with_it.mean() > share + 0.08:
            continue
        covered = with_it
        X_TS = pose(p=transform_points(X_TC, center))
        solids.append(Solid(name=f"occluder_{k}", kind="sphere", size=(size, 0.0, 0.0), X_TS=X_TS))
    return tuple(solids), float(covered.mean())


def wrong_poses(X_CT: Array, target: TargetModel, streams: Streams) -> dict[str, Array]:
    """Wrong poses by name: off by 3 cm, by 10 deg, and for the uneven starfish by a multiple of 72
    deg.

    The 10 deg are about an axis perpendicular to the object's axis of symmetry, if it has one.

    Args:
        X_CT: (4, 4) true pose.
        target: The object.
        streams: Draw the directions, with one stream for each wrong pose.

    Returns:
        Poses (4, 4) in C by name.
    """
    aside, axis = (streams[f"wrong pose {name}"].normal(size=3) for name in ("3 cm", "10 deg"))
    poses = {"3 cm": pose(p=0.03 * aside / np.linalg.norm(aside)) @ X_CT}
    if target.symmetry.axis is not None:
        axis -= (axis @ target.symmetry.axis) * target.symmetry.axis
    poses["10 deg"] = X_CT @ _turn(target, np.deg2rad(10.0) * axis / np.linalg.norm(axis))
    if target.name == UNEVEN:
        steps = streams["wrong pose 72 deg"].integers(1, 5)
        poses["72 deg"] = X_CT @ _turn(target, np.array([0.0, 0.0, 0.4 * np.pi * steps]))
    return poses


def _turn(target: TargetModel, rotation: Array) -> Array:
    middle = np.array([0.0, 0.0, target.center[2]]) if target.name == UNEVEN else target.center
    return pose(p=middle) @ pose(exp_so3(rotation)) @ pose(p=-middle)
