"""Targets: the barrel's mesh against its closed form and its collision shape, symmetry, paths,
files.
"""

import mujoco
import numpy as np
import pytest
import trimesh

from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects.targets import (
    ModelPath,
    Symmetry,
    TargetModel,
    barrel,
    longitudinal,
    revolve,
    starfish,
    transverse,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose, rotation_angle, transform_points

BARREL = barrel()


def test_barrel_is_closed_and_wound_outwards(within):
    v, t = BARREL.vertices, BARREL.triangles
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges}
    assert len(directed) == len(edges)
    assert all((b, a) in directed for a, b in directed)
    volume = np.einsum("ij,ij->", v[t[:, 0]], np.cross(v[t[:, 1]], v[t[:, 2]])) / 6.0
    exact = np.pi * (0.3**2 * 0.84 + 0.31**2 * 0.06)
    within("volume", volume / exact - 1.0, 2e-4)  # 256 sides: 1e-4


def test_picture_and_contact_agree(within):
    """Rays at the mesh and at MuJoCo's primitives end within a millimetre, also at the rims."""
    spec = mujoco.MjSpec()
    X_WT = pose(exp_so3([0.3, -0.2, 0.5]), [0.2, -0.1, 0.4])
    BARREL.add_to(spec, X_WT, stand=False)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rng = np.random.default_rng(3)
    start_T = rng.normal(size=(400, 3))
    start_T *= 1.5 / np.linalg.norm(start_T, axis=1, keepdims=True)
    way_T = rng.uniform([-0.4, -0.15, -0.15], [0.4, 0.15, 0.15], (400, 3)) - start_T
    way_T /= np.linalg.norm(way_T, axis=1, keepdims=True)
    mesh = RayScene(BARREL.vertices, BARREL.triangles).cast(start_T, way_T)["t"]
    geom = np.zeros(1, dtype=np.int32)
    solid = [
        mujoco.mj_ray(model, data, start, way, None, 1, -1, geom)
        for start, way in zip(transform_points(X_WT, start_T), way_T @ X_WT[:3, :3].T, strict=True)
    ]
    within("mesh against primitives [m]", mesh - np.array(solid), 1e-3)  # 0.2 mm where a ray grazes


def test_target_stands_in_a_scene():
    spec = mujoco.MjSpec()
    BARREL.add_to(spec, pose(p=[0, 0, 0.45]))
    model = spec.compile()
    names = {model.geom(i).name for i in range(model.ngeom)}
    assert model.body("target").id > 0
    assert {
        "target",
        "target_rim_aft",
        "target_rim_fore",
        "target_stand_aft",
        "target_stand_fore",
    } == names
    stand = model.geom("target_stand_aft")
    # its feet are 0.45 m under the axis
    assert 0.45 + stand.pos[2] - stand.size[2] == pytest.approx(0.0)


def test_mesh_target_stands_where_its_frame_says(within):
    """MuJoCo re-centres meshes; the geom must still lie where T says."""
    wedge = TargetModel(
        name="wedge",
        vertices=np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.2, 0], [0, 0, 0.1]]),
        triangles=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
    )
    spec = mujoco.MjSpec()
    wedge.add_to(spec, pose(p=[1.0, 2.0, 3.0]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    corners = model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    gap = np.linalg.norm(
        corners[:, None] - (wedge.vertices + np.array([1.0, 2.0, 3.0])), axis=2
    ).min(axis=1)
    within("corners [m]", gap, 1e-6)


def test_symmetric_distance(within):
    rng = np.random.default_rng(0)
    for _ in range(20):
        R = exp_so3(rng.normal(size=3))
        turned = (
            R
            @ exp_so3([rng.uniform(-9, 9), 0, 0])
            @ (np.diag([-1, -1, 1]) if rng.random() < 0.5 else np.eye(3))
        )
        p = rng.normal(size=3)
        within("same shape", BARREL.symmetry.error(pose(turned, p), pose(R, p))[1], 1e-9)
        tilted = R @ exp_so3([0.0, 0.02, 0.0]) @ R.T @ turned
        within(
            "tilted axis [rad]", BARREL.symmetry.error(pose(tilted, p), pose(R, p))[1] - 0.02, 1e-9
        )
        nearest = BARREL.symmetry.nearest(R, turned)
        within("the free angle follows the prior [rad]", rotation_angle(nearest, turned), 1e-7)


def test_without_symmetry_every_angle_counts(within):
    R = exp_so3([0.4, 0.1, 0.2])
    within("angle", Symmetry().error(pose(R), pose())[1] - np.linalg.norm([0.4, 0.1, 0.2]), 1e-9)


@pytest.mark.parametrize("declared", [Symmetry(), BARREL.symmetry, starfish().symmetry])
def test_cosines_of_many_attitudes_are_those_of_their_errors(declared: Symmetry, within):
    rng = np.random.default_rng(0)
    R = np.array([exp_so3(rng.normal(size=3)) for _ in range(10)])
    errors = np.array([[declared.error(pose(a), pose(b))[1] for b in R[5:]] for a in R[:5]])
    for a, row in zip(R[:5], errors, strict=True):
        within("one with many", declared.cosines(a, R[5:]) - np.cos(row), 1e-14)
    for b, column in zip(R[5:], errors.T, strict=True):
        within("many with one", declared.cosines(R[:5], b) - np.cos(column), 1e-14)


@pytest.mark.parametrize(
    "path", [longitudinal(0.7, 0.4), transverse(np.pi, 0.2), transverse(1.0, -0.3, 0.2)]
)
def test_paths_lie_on_the_shell_and_press_into_it(path: ModelPath, within):
    within("radius [m]", np.linalg.norm(path.p[:, 1:], axis=1) - 0.3, 1e-12)
    outward = path.p * [0, 1, 1] / 0.3
    within("tool axis", path.a + outward, 1e-12)
    within("a . b", np.einsum("ij,ij->i", path.a, path.b), 1e-12)
    step = np.gradient(path.p, axis=0)
    within(
        "b along the path",
        np.cross(path.b, step / np.linalg.norm(step, axis=1, keepdims=True)),
        1e-2,
    )


def test_path_lengths(within):
    line = longitudinal(0.6)
    arc = transverse(np.pi)
    within("line [m]", np.linalg.norm(np.diff(line.p, axis=0), axis=1).sum() - 0.6, 1e-12)
    within(
        "half circle [m]", np.linalg.norm(np.diff(arc.p, axis=0), axis=1).sum() - 0.3 * np.pi, 1e-4
    )
    assert line.p[len(line.p) // 2] == pytest.approx([0, 0, 0.3])  # azimuth 0 is the top generator


def test_file_round_trip(tmp_path, within):
    mesh = trimesh.Trimesh(1e3 * BARREL.vertices, BARREL.triangles, process=False)
    for suffix in ("ply", "obj", "stl", "off", "glb"):
        file = tmp_path / f"drum.{suffix}"
        mesh.export(file)
        target = TargetModel.from_file(file, scale=1e-3)
        assert target.name == "drum"
        assert len(target.triangles) == len(BARREL.triangles)
        within("size [m]", np.ptp(target.vertices, axis=0) - np.ptp(BARREL.vertices, axis=0), 1e-6)


def test_files_that_are_no_mesh_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="no such file"):
        TargetModel.from_file(tmp_path / "missing.stl")
    for name, content in (
        ("broken.ply", b"not a mesh"),
        ("empty.obj", b""),
        ("notes.txt", b"hello"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigurationError, match=r"target (mesh|cloud)"):
            TargetModel.from_file(tmp_path / name)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: longitudinal(0.9), "length"),
        (lambda: transverse(4.0), "arc"),
        (lambda: transverse(1.0, x=0.44), "rims"),
        (lambda: barrel(stand_height=0.2), "stand_height"),
        (lambda: BARREL.path("diagonal"), "longitudinal"),
        (
            lambda: TargetModel(name="x", vertices=np.eye(3), triangles=np.array([[0, 1, 3]])),
            "from 0 to 2, got 0 to 3",
        ),
        (
            lambda: TargetModel(name="x", vertices=np.eye(3), triangles=np.zeros((0, 3))),
            "triangles",
        ),
        (lambda: ModelPath(p=np.zeros((4, 3)), a=np.zeros((4, 3)), b=np.zeros((4, 3))), "unit"),
        (lambda: ModelPath(p=np.eye(3), a=np.eye(3), b=np.eye(3)), "at least 4"),
        (lambda: Symmetry(axis=np.zeros(3)), "zero"),
        (lambda: Symmetry(rotations=2.0 * np.eye(3)[None]), "orthonormal"),
        (lambda: Symmetry(rotations=np.full((1, 3, 3), np.nan)), "orthonormal"),
        (lambda: Symmetry(rotations=np.diag([1.0, 1.0, -1.0])[None]), "reflection"),
        (
            lambda: TargetModel(
                name="x", vertices=np.outer([0, 1, 2], np.ones(3)), triangles=np.array([[0, 1, 2]])
            ),
            "an area",
        ),
        (
            lambda: BARREL.add_to(mujoco.MjSpec(), np.diag([1.0, 1.0, -1.0, 1.0])),
            "X_WT: expected a pose",
        ),
        (lambda: revolve([[0, 1], [1, 0]], 8), "must be 0"),
    ],
)
def test_impossible_targets_are_refused(make, words: str):
    with pytest.raises(ConfigurationError, match=words):
        make()


def test_a_point_of_the_shape_may_stand_for_its_place(within):
    """Far from the shape, the origin moves by metres where the shape turns by a degree about its
    middle.
    """
    middle = np.array([12.0, 16.0, 1.0])
    X = pose(exp_so3([0.4, 0.1, 0.2]), [0.3, -0.2, 0.5])
    moved = (
        X @ pose(p=middle) @ pose(exp_so3([0.0, 0.0, 0.02]), [0.003, 0.0, 0.0]) @ pose(p=-middle)
    )
    off, angle = Symmetry().error(moved, X, middle)
    within("point [m]", off - 0.003, 1e-12)
    within("angle [rad]", angle - 0.02, 1e-12)
    assert Symmetry().error(moved, X)[0] > 0.3
