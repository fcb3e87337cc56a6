"""Every object there is: closed, symmetric as declared, its paths on it, and felt where it is
seen.
"""

import mujoco
import numpy as np
import pytest

from surface_distance import signed_distance
from uuv.models.meshes import convex_parts
from uuv.models.meshes.closed_shells import box, open_edges, revolve, sphere, split, volume, welded
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects import targets
from uuv.models.objects.rock import rock
from uuv.models.objects.target_model import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points

OBJECTS = {name: targets.named(name) for name in targets.available()} | {"another rock": rock(5)}


def felt_and_seen(
    target: TargetModel, rng: np.random.Generator, rays: int
) -> tuple[np.ndarray, np.ndarray]:
    """How far (N,) [m] what is felt lies out of the mesh, along its normal, where rays from all
    sides meet both; and whether (M,) a ray met one of them alone.
    """
    X_WT = pose(exp_so3(rng.normal(size=3)), rng.normal(size=3))
    spec = mujoco.MjSpec()
    target.add_to(spec, X_WT, stand=False)
    model = spec.compile()
    model.geom_rgba[:, 3] = 1.0  # rays pass through what is transparent
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    collides = model.geom_contype != 0
    assert model.body("target").id > 0
    assert model.geom("target").id >= 0
    ways = rng.normal(size=(rays, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    start = (
        rng.uniform(target.vertices.min(axis=0), target.vertices.max(axis=0), (rays, 3))
        - 2.5 * target.radius * ways
    )
    hit = RayScene(target.vertices, target.triangles).cast(start, ways)
    model.geom_group[:] = np.where(collides, 3, 0)
    group = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
    geom = np.zeros(1, dtype=np.int32)
    start_W = transform_points(X_WT, start)
    ways_W = ways @ X_WT[:3, :3].T
    felt = np.array(
        [mujoco.mj_ray(model, data, start_W[i], ways_W[i], group, 1, -1, geom) for i in range(rays)]
    )
    both = (felt >= 0.0) & np.isfinite(hit["t"])
    cosine = np.abs(np.einsum("ij,ij->i", hit["normal"], ways))
    return (hit["t"][both] - felt[both]) * cosine[both], (felt >= 0.0) != np.isfinite(hit["t"])


@pytest.mark.parametrize("name", OBJECTS)
def test_object_is_closed_and_wound_outwards(name: str):
    target = OBJECTS[name]
    assert open_edges(target.triangles) == 0
    assert (
        1e-4 < volume(target.vertices, target.triangles) < np.prod(np.ptp(target.vertices, axis=0))
    )


@pytest.mark.parametrize("name", OBJECTS)
def test_declared_symmetry_is_one(name: str, within):
    target = OBJECTS[name]
    nearest = NearestSurface.of(target.vertices, target.triangles)
    turns = list(target.symmetry.rotations)
    if target.symmetry.axis is not None:
        turns += [exp_so3(angle * target.symmetry.axis) for angle in (0.4, 2.0)]
    for R in turns:
        # 0.02 mm: facets
        within("from the surface [m]", nearest.query(target.vertices @ R.T).distance, 1e-4)


@pytest.mark.parametrize("name", OBJECTS)
def test_paths_lie_on_the_object(name: str, within):
    target = OBJECTS[name]
    scene = RayScene(target.vertices, target.triangles)
    assert len(target.paths) > 1
    for path in target.paths.values():
        hit = scene.cast(path.p - 0.05 * path.a, path.a)
        within("from the surface [m]", hit["t"] - 0.05, 1e-3)  # 0.2 mm on the rock: its facets
        within("a . b", np.einsum("ij,ij->i", path.a, path.b), 1e-9)
        lean = np.arccos(np.clip(-np.einsum("ij,ij->i", hit["normal"], path.a), -1.0, 1.0))
        within("off the normal [rad]", lean, np.deg2rad(15.0))  # 5 deg on facets of the starfish
        step = np.linalg.norm(np.diff(path.p, axis=0), axis=1)
        within("evenness of steps", step / step.mean() - 1.0, 0.15)


@pytest.mark.parametrize("name", OBJECTS)
def test_object_is_felt_where_it_is_seen(name: str, within):
    """Never under the surface, and at most the tolerance over it, from any side."""
    off, alone = felt_and_seen(OBJECTS[name], np.random.default_rng(4), 500)
    assert len(off) > 100
    # The manifold's bores are polygons, at their corners 0.17 mm wider than the mesh.
    within("felt under the surface [m]", np.minimum(off, 0.0), 2e-3 if name == "manifold" else 1e-5)
    # 0.5 mm and less; a ray that grazes may pass one and meet the other far off.
    within(
        "felt over the surface [m], all but 1 in 100", np.sort(off)[: int(0.99 * len(off))], 8e-4
    )
    assert alone.mean() < 0.02


def test_pad_rests_where_the_surface_is(within):
    """The pad's dome, lowered on a rock until it touches: its distance from the mesh is its
    radius.
    """
    stone = OBJECTS["another rock"]
    spec = mujoco.MjSpec()
    stone.add_to(spec, pose())
    dome = spec.worldbody.add_body(name="dome")
    for axis in np.eye(3):
        dome.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    dome.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.06, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    nearest = NearestSurface.of(stone.vertices, stone.triangles)

    def touches(p: np.ndarray) -> bool:
        data.qpos[:] = p
        mujoco.mj_fwdPosition(model, data)
        return bool(data.ncon)

    gaps = []
    for p in stone.paths["over"].p[::6]:
        low, high = 0.0, 0.2
        for _ in range(22):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if touches(p + np.array([0.0, 0.0, middle])) else (low, middle)
            )
        gaps.append(float(nearest.query((p + np.array([0.0, 0.0, high]))[None]).distance[0]) - 0.06)
    within("gap under the dome [m]", gaps, 1e-3)  # 0.2 mm


def test_convex_solid_is_one_part():
    assert len(convex_parts.parts(*box([0.3, 0.2, 0.1], [0.0, 0.0, 1.0]))) == 1
    vertices, triangles = sphere(3)
    assert len(convex_parts.parts(0.2 * vertices, triangles)) == 1


def test_triangles_without_area_change_no_part():
    """As in many users' files: three corners in a line, before and between the others."""
    wedge = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0], [0.1, 0.1, 0], [0.1, 0.1, 0.1]]) - [
        0.1,
        0.1,
        0.0,
    ]
    solid = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 3, 1], [3, 2, 1]])
    line = np.vstack([wedge, [[0.05, -0.1, 0.0]]])  # on the edge from corner 0 to 1
    spoilt = np.vstack([[[0, 5, 1]], solid[:3], [[1, 5, 0]], solid[3:]])
    clean, decomposed = convex_parts.parts(wedge, solid), convex_parts.parts(line, spoilt)
    assert len(decomposed) == len(clean)
    assert all(np.array_equal(a, b) for a, b in zip(decomposed, clean, strict=True))
    with pytest.raises(ConfigurationError, match="no triangle of the mesh has an area"):
        convex_parts.parts(line, np.array([[0, 5, 1]]))


def test_finer_tolerance_gives_a_truer_surface(within):
    bowl, triangles = sphere(3)
    # the cap pushed in: hollow
    bowl = np.where(bowl[:, 2:] > 0.2, bowl * [1.0, 1.0, -0.4], bowl) * 0.2
    worst = []
    for tolerance in (6e-3, 1.5e-3):
        hulls = convex_parts.parts(bowl, triangles, tolerance)
        hollow = TargetModel(name="bowl", vertices=bowl, triangles=triangles, hulls=hulls)
        off, _ = felt_and_seen(hollow, np.random.default_rng(1), 400)
        worst.append(np.sort(off)[int(0.98 * len(off))])
        within("over the surface [m]", worst[-1], 1.5 * tolerance)
    assert worst[1] < worst[0]


@pytest.mark.seeds(1, 2)
def test_no_part_spans_a_hollow_corner(within, seed):
    """A shaft with a flange, of slivers as long as it is: a part over two of them once filled the
    corner by 7 cm.
    """
    rng = np.random.default_rng(seed)
    thin, wide, long = rng.uniform(0.05, 0.15), rng.uniform(0.2, 0.3), rng.uniform(0.2, 0.5)
    outline = [(-long, 0.0), (-long, thin), (0.0, thin), (0.0, wide), (0.1, wide), (0.1, 0.0)]
    shaft = revolve(outline, int(rng.integers(60, 120)))
    for hull in convex_parts.parts(*shaft):
        inside = rng.dirichlet(np.ones(len(hull)), 400) @ hull
        within(
            "over the surface [m]",
            np.maximum(signed_distance(*shaft, inside), 0.0),
            convex_parts.TOLERANCE,
        )


def test_splitting_keeps_a_shell_closed(rng, within):
    vertices, triangles = welded(*box([0.4, 0.3, 0.2], np.zeros(3)))
    for _ in range(6):
        vertices, triangles = split(vertices, triangles, rng.random(len(triangles)) < 0.4, 0.03)
        assert open_edges(triangles) == 0
        within("volume", volume(vertices, triangles) - 0.4 * 0.3 * 0.2, 1e-12)
    assert len(triangles) > 200


def test_seed_makes_the_rock():
    first, same, other = rock(3), rock(3), rock(4)
    assert np.array_equal(first.vertices, same.vertices)
    assert np.abs(first.vertices - other.vertices).max() > 0.01
    assert np.ptp(rock(1, size=0.9).vertices, axis=0).max() == pytest.approx(0.9)


def test_starfish_is_as_thick_as_said():
    assert np.ptp(OBJECTS["starfish"].vertices[:, 2]) == pytest.approx(0.035)
    assert len(OBJECTS["starfish"].symmetry.rotations) == 5


def test_names_and_options():
    assert targets.named("barrel", line_length=0.3).path("longitudinal").p[0, 0] == pytest.approx(
        -0.15
    )
    with pytest.raises(ConfigurationError, match="starfish"):
        targets.named("spoon")
    with pytest.raises(ConfigurationError, match="seed"):
        targets.named("rock", colour=3)
    with pytest.raises(ConfigurationError, match="roughness"):
        targets.named("rock", roughness=1.0)
    with pytest.raises(ConfigurationError, match="whole number"):
        targets.named("rock", seed=-1)
    with pytest.raises(ConfigurationError, match="tolerance"):
        convex_parts.parts(*sphere(1), tolerance=0.0)
    with pytest.raises(ConfigurationError, match="hull"):
        TargetModel(
            name="x", vertices=np.eye(3), triangles=np.array([[0, 1, 2]]), hulls=(np.eye(3),)
        )
