"""Normals, planes and nearness of points, each against linear algebra by NumPy."""

import numpy as np
import pytest

from uuv.models.meshes.ray_casting import RayScene
from uuv.perception.clouds import scan as scans
from uuv.perception.clouds.scan import (
    Scan,
    SensorModel,
    distances_along,
    facing_normals,
    triangulate,
    voxel_means,
)
from uuv.sim.interfaces.spatial import Array, exp_so3


def flat_cloud(rng: np.random.Generator, normal: Array, spread: float, count: int = 200) -> Array:
    """Points about (0, 0, 2) in a plane, off it by `spread` [m]."""
    u = np.linalg.svd(normal[None])[2][1:]
    return (
        np.array([0.0, 0.0, 2.0])
        + rng.uniform(-0.3, 0.3, (count, 2)) @ u
        + spread * rng.normal(size=(count, 1)) * normal
    )


def test_axes_of_least_spread_are_those_of_the_covariance(rng: np.random.Generator) -> None:
    points = rng.normal(size=(60, 3)) * [1.0, 0.4, 0.1] @ exp_so3(rng.normal(size=3)).T
    near = np.array([rng.permutation(60)[:12] for _ in range(25)])
    axes = scans._least_axes.py_func(points, near)
    for axis, rows in zip(axes, near, strict=True):
        eigenvalues, vectors = np.linalg.eigh(np.cov(points[rows].T))
        assert abs(axis @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-9)
        assert eigenvalues[0] < eigenvalues[1]


def test_points_of_no_spread_or_the_same_in_all_directions_have_an_axis() -> None:
    corners = np.vstack([np.eye(3), -np.eye(3)])
    for points in (corners, np.zeros((6, 3))):
        axes = scans._least_axes.py_func(points, np.arange(6)[None])
        np.testing.assert_array_equal(axes, [[0.0, 0.0, 1.0]])


def test_normals_face_the_sensor(rng: np.random.Generator) -> None:
    for _ in range(3):
        normal = exp_so3(rng.uniform(-0.8, 0.8, 3))[:, 2]
        points = flat_cloud(rng, normal, 0.0)
        np.testing.assert_allclose(
            facing_normals(points), -normal * np.sign(points @ normal)[:, None], atol=1e-6
        )


def test_the_largest_plane_is_found_among_others(rng: np.random.Generator) -> None:
    sensor = SensorModel()
    normal = exp_so3([0.3, -0.2, 0.0])[:, 2]
    plane = flat_cloud(rng, normal, 1e-3, 150)
    others = np.array([0.0, 0.0, 1.5]) + rng.uniform(-0.4, 0.4, (80, 3)) * [1.0, 1.0, 0.5]
    plane_found = scans._largest_plane(np.vstack([plane, others]), sensor, rng)
    assert plane_found is not None
    assert abs(plane_found.normal @ normal) == pytest.approx(1.0, abs=1e-3)
    assert abs((plane_found.center - [0.0, 0.0, 2.0]) @ normal) < 2e-3
    assert plane_found.inliers[:150].all()
    off = np.abs((np.vstack([plane, others]) - plane_found.center) @ plane_found.normal)
    assert np.all(off[~plane_found.inliers] > 3.0e-3)
    assert scans._largest_plane(plane[:2], sensor, rng) is None
    assert scans._largest_plane(np.tile(plane[:1], (9, 1)), sensor, rng) is None
    line = np.column_stack([np.linspace(0, 1, 9), np.zeros(9), np.ones(9)])
    assert scans._largest_plane(line, sensor, rng) is None


def test_nearness_to_any_centre_is_that_of_the_nearest(rng: np.random.Generator) -> None:
    points = rng.uniform(-1, 1, (8, 9, 3))
    centers = rng.uniform(-1, 1, (5, 3))
    points[2, 3] = np.nan
    distance = np.linalg.norm(points[:, :, None] - centers, axis=-1).min(axis=-1)
    for reach in (0.3, 0.6):
        near = scans.near_any.py_func(points, centers, reach)
        np.testing.assert_array_equal(near, distance <= reach)
    assert not scans.near_any.py_func(points, np.zeros((0, 3)), 1.0).any()


def test_rays_meet_a_scan_as_they_meet_its_whole_triangulated_surface(
    rng: np.random.Generator,
) -> None:
    tangents = np.linspace(-0.4, 0.4, 60)
    for _ in range(10):
        depth = (
            1.5
            + 0.3 * rng.random() * np.sin(9.0 * tangents + tangents[:, None])
            + 0.01 * rng.normal(size=(60, 60))
        )
        depth[rng.random((60, 60)) < 0.1] = np.nan
        scan = Scan.of_grid(depth, tangents, tangents)
        way = exp_so3(rng.uniform(-0.6, 0.6, 3))[:, 2]
        starts = rng.uniform(-0.6, 0.6, (400, 3)) * [1.0, 1.0, 0.1]
        ranges = distances_along(scan, starts, way)
        whole = RayScene(*triangulate(scan, np.isfinite(depth))).distance(
            starts, np.broadcast_to(way, starts.shape)
        )
        assert ranges is not None
        assert 0 < np.isfinite(whole).sum() < len(starts)
        np.testing.assert_array_equal(ranges, whole)
    assert (
        distances_along(
            Scan.of_grid(np.full((60, 60), np.nan), tangents, tangents),
            np.zeros((1, 3)),
            np.eye(3)[2],
        )
        is None
    )


def test_counted_cubes_have_the_means_of_sorted_ones(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = rng.normal(size=(3000, 3)) * [1.0, 0.3, 0.1] - 5.0
    counted = voxel_means(points, 0.05)
    monkeypatch.setattr(scans, "_COUNTED", 0.0)
    np.testing.assert_array_equal(counted, voxel_means(points, 0.05))
    assert 100 < len(counted) < len(points)
