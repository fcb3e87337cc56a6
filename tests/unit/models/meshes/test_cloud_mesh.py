"""Meshes of point clouds: on the surface, sharp at its edges, open where the cloud is, whatever the
scale.
"""

import numpy as np
import pytest

from untyped import untyped
from uuv.models.meshes.closed_shells import box, sphere
from uuv.models.meshes.cloud_mesh import FEWEST, CloudMesh, mesh_of_cloud
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ray_casting import OneSidedScene, RayScene
from uuv.models.meshes.surfel_files import read_surfels
from uuv.models.objects.mesh_symmetry import mesh_symmetry
from uuv.models.objects.target_model import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

SIZE = np.array([0.4, 0.3, 0.2])


def sampled(
    vertices: Array, triangles: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points (n, 3) spread evenly over a mesh, and normals (n, 3)."""
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(triangles), count, p=area / area.sum())
    weight = rng.dirichlet(np.ones(3), count)
    return np.einsum("nk,nki->ni", weight, corners[face]), cross[face] / area[face, None]


def off(made: CloudMesh, vertices: Array, triangles: np.ndarray, rng: np.random.Generator) -> Array:
    """Distances (n,) [m] of points on the made mesh from another."""
    points = sampled(made.vertices, made.triangles, 4000, rng)[0]
    return NearestSurface.of(vertices, triangles).query(points).distance


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_a_box_gets_its_faces_and_edges_back(
    rng: np.random.Generator, given: bool, scale: float, within
) -> None:
    solid = box(SIZE * scale, np.zeros(3))
    points, normals = sampled(*solid, 4000, rng)
    mesh = mesh_of_cloud(points, normals if given else None)
    assert not mesh.is_open
    assert not len(mesh.border)
    distance = off(mesh, *solid, rng)
    assert np.quantile(distance, 0.95) < 0.1 * mesh.spacing
    # Without sharpening no vertex lies on an edge, and the box is as much smaller as the points lie
    # apart.
    across = np.ptp(mesh.vertices, axis=0)
    within("extent [spacings]", (across - SIZE * scale) / mesh.spacing, 0.2 if given else 1.0)
    rays = rng.normal(size=(2000, 3))
    out = RayScene(mesh.vertices, mesh.triangles).cast(np.zeros(3), rays)
    assert np.isfinite(out["t"]).mean() > 0.99  # closed but for cracks
    outward = np.einsum("ni,ni->n", out["normal"], rays) > 0.0
    assert outward[np.isfinite(out["t"])].mean() > 0.97


def test_the_sides_of_a_plate_stay_apart(rng: np.random.Generator) -> None:
    thin = box([0.5, 0.4, 0.004], np.zeros(3))  # the points lie 9 mm apart
    points, normals = sampled(*thin, 5000, rng)
    mesh = mesh_of_cloud(points, normals)
    hit = RayScene(mesh.vertices, mesh.triangles).distance([0.05, 0.02, 1.0], [[0.0, 0.0, -1.0]])
    assert hit[0] == pytest.approx(0.998, abs=1e-4)
    distance = off(mesh, *thin, rng)
    assert np.median(distance) < 1e-6
    assert np.quantile(distance, 0.95) < 2.5e-3  # at the rim, where hardly a point lies


@pytest.mark.parametrize("given", [True, False])
def test_a_scan_from_one_side_stays_open(rng: np.random.Generator, given: bool) -> None:
    points, normals = sampled(*sphere(3), 8000, rng)
    half = points[:, 2] > 0.0
    mesh = mesh_of_cloud(points[half], normals[half] if given else None)
    assert mesh.is_open
    assert "open" in mesh.note
    assert np.quantile(np.abs(mesh.border[:, 2]), 0.9) < 4.0 * mesh.spacing
    assert len(mesh.border) > 0.3 * 2.0 * np.pi / mesh.spacing
    scene = OneSidedScene(mesh.vertices, mesh.triangles)
    assert scene.distance([0.0, 0.0, 3.0], [[0.0, 0.0, -1.0]])[0] == pytest.approx(2.0, abs=0.02)
    # from behind nothing is known
    assert np.isinf(scene.distance([0.0, 0.0, -3.0], [[0.0, 0.0, 1.0]])[0])
    # Nothing spans the open side.
    flat = np.column_stack([rng.uniform(-0.6, 0.6, (500, 2)), np.full(500, -2.0)])
    assert (
        RayScene(mesh.vertices, mesh.triangles).distance(flat, [[0.0, 0.0, 1.0]] * 500) > 2.3
    ).mean() > 0.99


def test_normals_of_either_sign_are_turned_outward(rng: np.random.Generator) -> None:
    points, normals = sampled(*sphere(3), 8000, rng)
    half = points[:, 2] > 0.0
    points, normals = points[half], normals[half]
    for normals_read, words in (
        (-normals, "turned over"),
        (normals * rng.choice([-1.0, 1.0], (len(normals), 1)), "mixed signs"),
    ):
        mesh = mesh_of_cloud(points, normals_read)
        assert words in mesh.note
        scene = OneSidedScene(mesh.vertices, mesh.triangles)
        assert np.isfinite(scene.distance([0.0, 0.0, 3.0], [[0.0, 0.0, -1.0]])[0])


def test_noise_and_numbers_of_points_are_averaged(rng: np.random.Generator) -> None:
    points, _ = sampled(*sphere(3), 12_000, rng)
    mesh = mesh_of_cloud(points * (1.0 + 0.04 * rng.normal(size=(len(points), 1))))
    assert "averaged to" in mesh.note
    assert np.median(np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1.0)) < 0.03


def test_the_symmetry_of_a_cloud_is_that_of_its_object(rng: np.random.Generator) -> None:
    solid = box([0.5, 0.3, 0.3], np.zeros(3))
    mesh = mesh_of_cloud(*sampled(*solid, 5000, rng))
    symmetry = mesh_symmetry(mesh.vertices, mesh.triangles, np.random.default_rng(0), mesh.spacing)
    assert len(symmetry.rotations) == 8
    assert np.linalg.norm(symmetry.center) < 0.003


def test_the_same_points_give_the_same_mesh(rng: np.random.Generator) -> None:
    points, _ = sampled(*box(SIZE, np.zeros(3)), 2000, rng)
    first = mesh_of_cloud(points)
    other = mesh_of_cloud(points[rng.permutation(len(points))])
    assert np.array_equal(first.vertices, other.vertices)
    assert np.array_equal(first.triangles, other.triangles)


def test_what_is_no_model_is_refused_in_a_line(rng: np.random.Generator) -> None:
    points = rng.uniform(size=(300, 3))
    for arguments, words in (
        ((points[:50],), f"at least {FEWEST} distinct points, got 50"),
        ((np.ones((300, 3)),), "distinct points, got 1"),
        ((np.linspace(0.0, 1.0, 300)[:, None] * np.ones(3),), "must form a surface"),
        ((points, points[:10]), r"normals must be \(300, 3\), one for each point, got \(10, 3\)"),
        ((points[:, :2],), r"points must be \(n, 3\)"),
        ((1e200 * points,), "must lie within"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            TargetModel.from_cloud(*untyped(arguments))


def test_files_of_surfels(tmp_path, rng: np.random.Generator) -> None:
    points, normals = sampled(*box(SIZE, np.zeros(3)), 2000, rng)
    points[7] = np.nan
    rows = np.column_stack([points, normals])
    pcd = (
        "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 8 8 8 8 8 8\nTYPE F F F F F "
        "F\nCOUNT 1 1 1 1 1 1\n"
    )
    pcd += "WIDTH 2000\nHEIGHT 1\nPOINTS 2000\nDATA binary\n"
    (tmp_path / "a.pcd").write_bytes(pcd.encode() + rows.tobytes())
    ply = "ply\nformat binary_little_endian 1.0\nelement vertex 2000\n"
    ply += "".join(f"property double {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    (tmp_path / "a.ply").write_bytes((ply + "end_header\n").encode() + rows.tobytes())
    np.savetxt(tmp_path / "a.xyz", np.delete(rows, 7, axis=0), fmt="%.17g")
    np.savetxt(tmp_path / "bare.xyz", points[8:], fmt="%.17g", delimiter=",")
    for name in ("a.pcd", "a.ply", "a.xyz"):
        surfels = read_surfels(tmp_path / name)
        finite = np.isfinite(surfels.points).all(axis=1)
        assert finite.sum() == 1999
        assert np.array_equal(surfels.points[finite], np.delete(points, 7, axis=0))
        assert surfels.normals is not None
        assert np.array_equal(surfels.normals[finite], np.delete(normals, 7, axis=0))
        target = TargetModel.from_file(tmp_path / name)
        assert target.cloud is not None
        assert "normals given" in target.cloud.note
    assert read_surfels(tmp_path / "bare.xyz").normals is None
    assert TargetModel.from_file(tmp_path / "bare.xyz", scale=0.5).radius < 0.14
    (tmp_path / "bad.xyz").write_text("1 2\n3 4\n")
    with pytest.raises(ConfigurationError, match=r"bad\.xyz, line 1: expected x y z and .*'1 2'"):
        TargetModel.from_file(tmp_path / "bad.xyz")
    np.savetxt(tmp_path / "mm.xyz", 1e3 * points[8:])
    with pytest.raises(ConfigurationError, match="millimetres"):
        TargetModel.from_file(tmp_path / "mm.xyz")


def test_where_the_origin_lies_changes_nothing(rng: np.random.Generator) -> None:
    points = sampled(*box(SIZE, np.zeros(3)), 3000, rng)[0].round(4)
    near = mesh_of_cloud(points)
    for far in (np.array([20.0, -15.0, 0.0]), np.array([5.12e3, 5.403e4, 200.0])):
        mesh = mesh_of_cloud(points + far)
        assert abs(len(mesh.triangles) - len(near.triangles)) < 0.01 * len(near.triangles)
        assert mesh.spacing == pytest.approx(near.spacing, rel=1e-6)
        np.testing.assert_allclose(
            np.ptp(mesh.vertices, axis=0), np.ptp(near.vertices, axis=0), atol=1e-3
        )
        np.testing.assert_allclose(
            mesh.vertices.mean(axis=0) - far, near.vertices.mean(axis=0), atol=1e-3
        )
