"""Test scenes for PoseCheck: the object clean, partly hidden or fouled; another object, none, or
too little of it.

Built on the random scenes of `uuv.clouds.object_scenes`; occluders are added as parts of the
object's stand.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from uuv.clouds.object_scenes import ObjectScene, object_scene, target_of
from uuv.models.meshes.closed_shells import split, vertex_normals, welded
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects import targets
from uuv.models.objects.targets import Solid, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points
from uuv.sim.interfaces.streams import Streams

KINDS: Mapping[str, bool] = {  # name: the object is there, and enough of it is visible
    "clean": True,
    "hidden": True,  # 20 to 50 % of its visible part is hidden
    # 30 % of the surface, 10 to 40 mm thick, or at most a tenth of the object's radius
    "fouled": True,
    "hidden_most": False,  # 70 to 90 %
    "other": False,  # another object, or the same in another size
    "absent": False,
}
UNEVEN = "uneven starfish"
NAMES: tuple[str, ...] = (*targets.available(), UNEVEN)
_FINE = 60_000  # largest number of triangles after a subdivision
_RAYS = 4  # [px] spacing of the rays that measure occlusion


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecisionScene:
    """A scene with the share of the object that is hidden."""

    scene: ObjectScene
    hidden: float  # share of the object's image behind occluders


@cache
def object_of(name: str) -> TargetModel:
    """The object `name` of NAMES.

    Raises:
        ConfigurationError: The name is unknown.
    """
    return uneven_starfish() if name == UNEVEN else target_of(name)


def uneven_starfish() -> TargetModel:
    """Starfish whose five arms differ in length by up to 16 %: a turn by 72 deg is nearly a
    symmetry.
    """
    sides, rings, height = 200, 12, 0.035
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radius = np.full(sides, 0.055)
    for k, length in enumerate((1.0, 0.93, 1.05, 0.97, 1.08)):
        aside = np.angle(np.exp(1j * (angle - 2.0 * np.pi * k / 5.0)))
        radius = np.maximum(radius, 0.03 + 0.18 * length * np.exp(-((aside / 0.28) ** 2)))
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
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = [np.column_stack([np.zeros_like(i), 1 + i, 1 + j])]
    for ring in range(rings - 1):
        inner, outer = 1 + ring * sides, 1 + (ring + 1) * sides
        faces += [
            np.column_stack([inner + i, outer + i, outer + j]),
            np.column_stack([inner + i, outer + j, inner + j]),
        ]
    rim = 1 + (rings - 1) * sides
    faces.append(np.column_stack([np.full_like(i, len(vertices) - 1), rim + j, rim + i]))
    return TargetModel(name=UNEVEN, vertices=vertices, triangles=np.vstack(faces))


def draw(
    name: str, kind: str, seed: int, sensor: str, X_CN: Array | None = None, look: int = 0
) -> DecisionScene:
    """The scene of `seed`.

    Args:
        name: Object in NAMES.
        kind: Kind of scene in KINDS.
        seed: Draws the scene and what is changed in it.
        sensor: Name in `uuv.clouds.object_scenes.SENSORS`.
        X_CN: (4, 4) pose from which it is seen instead, as in `object_scene`; None: the seed's
            view.
        look: Number of the look, which draws its noise.

    Raises:
        ConfigurationError: A name is unknown.
    """
    other = {"X_CN": X_CN, "look": look}
    if kind not in KINDS:
        raise ConfigurationError(f"no kind of scene {kind!r}; there are {sorted(KINDS)}")
    target, streams = object_of(name), Streams(seed)
    if kind == "absent":
        return DecisionScene(
            scene=object_scene(target, seed, sensor, absent=True, **other), hidden=0.0
        )
    if kind == "other":
        return DecisionScene(
            scene=object_scene(
                target, seed, sensor, there=other_than(target, streams["other"]), **other
            ),
            hidden=0.0,
        )
    if kind == "fouled":
        thick = min(0.04, 0.1 * target.radius)
        grown = fouled(target, streams["growth"], (0.25 * thick, thick))
        return DecisionScene(
            scene=object_scene(target, seed, sensor, there=grown, **other), hidden=0.0
        )
    plain = object_scene(target, seed, sensor)
    if kind == "clean":
        return DecisionScene(scene=object_scene(target, seed, sensor, **other), hidden=0.0)

    share = streams["hidden share"].uniform(*((0.2, 0.45) if kind == "hidden" else (0.72, 0.85)))
    solids, hidden = occluders(target, plain.X_CT, share, streams["occluders"])
    shown = replace(target, stand=(*target.stand, *solids))
    return DecisionScene(
        scene=object_scene(target, seed, sensor, there=shown, **other), hidden=hidden
    )


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
    """`target` with random mounds of growth along its normals.

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
        width, height = rng.uniform(0.1, 0.25) * target.radius, rng.uniform(*thick)
        distance = np.linalg.norm(vertices - middle, axis=1)
        growth = np.maximum(growth, height * np.exp(-0.5 * (distance / width) ** 4))
    return TargetModel(
        name=f"{target.name}, fouled",
        vertices=vertices + growth[:, None] * normals,
        triangles=triangles,
        stand=target.stand,
    )


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
        Spheres in T; share that they hide.
    """
    X_TC = inverse(X_CT)
    x, y = np.meshgrid(
        (np.arange(0, 640, _RAYS) - 319.5) / 554.0, (np.arange(0, 480, _RAYS) - 239.5) / 554.0
    )
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    scene = RayScene(target.vertices, target.triangles)
    t = scene.cast(X_TC[:3, 3], rays @ X_TC[:3, :3].T)["t"]
    seen = rays[np.isfinite(t)] * t[np.isfinite(t), None]
    spread = float(np.linalg.norm(seen - seen.mean(axis=0), axis=1).max())
    way = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    covered, solids = np.zeros(len(seen), dtype=bool), []
    for k in range(200):
        if covered.mean() >= share:
            break
        p, nearness = seen[rng.integers(len(seen))], rng.uniform(0.5, 0.8)
        center, size = nearness * p, nearness * spread * rng.uniform(0.1, 0.4)
        now = covered | (np.linalg.norm(np.cross(way, center), axis=1) < size)
        if now.mean() > share + 0.08:
            continue
        covered = now
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
        streams: Draw the directions, each wrong pose from a stream of its own.

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
