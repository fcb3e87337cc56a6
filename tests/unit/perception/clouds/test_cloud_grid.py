"""Every form of a cloud gives the scan of the depth frame that it came from; scatter is averaged
without bias.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.meshes.ply_files import write_ply
from uuv.models.objects.targets import Symmetry, TargetModel, barrel
from uuv.perception.clouds.cloud_files import load_cloud
from uuv.perception.clouds.cloud_grid import lattice_grid, organised_grid, scatter_grid
from uuv.perception.clouds.scan import Scan
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import PerceptionError
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import Array, exp_so3

FOCAL, WIDTH, HEIGHT = 554.0, 320, 240
K = np.array([[FOCAL, 0.0, 159.5], [0.0, FOCAL, 119.5], [0.0, 0.0, 1.0]])
# holds milk_cartoon_all_small_clorox.pcd, milk.pcd and milk_other_view.pcd of PCL's tests
REAL = "UUV_KINECT_FOLDER"


def frame(rng: np.random.Generator, sigma: float = 0.003, lost: float = 0.1) -> Scan:
    """A sloped wall with a disc before it; every pixel errs by itself, some return nothing."""
    x, y = np.meshgrid(np.arange(WIDTH) - K[0, 2], np.arange(HEIGHT) - K[1, 2])
    z = 1.5 / (1.0 + 0.3 * x / FOCAL - 0.5 * y / FOCAL)
    z[np.hypot(x, y) < 60.0] = 1.1
    z += sigma * rng.standard_normal(z.shape)
    z[rng.random(z.shape) < lost] = np.nan
    return Scan.from_depth(DepthImage(time=0.0, depth=z, K=K, X_BC=np.eye(4)))


def listed(scan: Scan) -> Array:
    """The points (N, 3) of a scan, row by row."""
    return scan.points[np.isfinite(scan.depth)]


def same(name: str, found: Scan, scan: Scan, within, tolerance: float = 1e-6) -> None:
    """`found` has the pixels of `scan`, if not its margins, and the depth in each."""
    within(f"{name}: pitch", FOCAL * found.pitches - 1.0, tolerance)
    points = listed(scan)
    row, column, _ = found.pixels(points)
    assert np.isfinite(found.depth).sum() == len(points)
    within(f"{name}: points [m]", found.points[row, column] - points, tolerance)


def test_an_organised_cloud_keeps_its_pixels(rng, within):
    scan = frame(rng)
    zeros = np.nan_to_num(scan.points)
    for name, cloud in {
        "as it is": scan.points,
        "nothing is zero": zeros,
        "single precision": scan.points.astype(np.float32),
        "rows for columns": scan.points.swapaxes(0, 1),
        "upside down": scan.points[::-1, ::-1],
    }.items():
        gridded = Scan.from_cloud(cloud)
        assert gridded.depth.shape == scan.depth.shape
        within(f"{name}: depth [m]", np.nan_to_num(gridded.depth) - zeros[..., 2], 1e-6)
        within(f"{name}: tangents", gridded.tangent_x - scan.tangent_x, 1e-7)


def test_a_picture_in_no_order_has_no_pixels():
    """Of more points than are looked at, chance may ask for rows and columns to be exchanged, and
    back again.
    """
    x, y = np.meshgrid((np.arange(640) - 319.5) / FOCAL, (np.arange(480) - 239.5) / FOCAL)
    points = 1.5 * np.stack([x, y, np.ones_like(x)], axis=-1)
    for seed in (0, 6):  # 6: both ways round chance asks for it
        shuffled = (
            np.random.default_rng(seed).permutation(points.reshape(-1, 3)).reshape(points.shape)
        )
        assert organised_grid(shuffled, np.ones(x.shape, dtype=bool)) is None


def test_noise_across_the_ray_leaves_an_organised_cloud_its_pixels(rng, within):
    scan = frame(rng)
    grid = organised_grid(
        scan.points + 0.003 * rng.standard_normal(scan.points.shape),
        np.asarray(np.isfinite(scan.depth)),
    )
    assert grid is not None
    # of a scatter of 1.2 px: 0.01
    within("tangents [px]", FOCAL * (grid.tangent_x - scan.tangent_x), 0.1)
    within("tangents [px]", FOCAL * (grid.tangent_y - scan.tangent_y), 0.1)


def test_what_is_no_pinhole_is_not_taken_for_one(rng):
    scan = frame(rng)
    usable = np.asarray(np.isfinite(scan.depth))
    bent = scan.points.copy()
    bent[..., :2] *= (
        1.0
        + 0.1
        * np.sum(scan.points[..., :2] ** 2, axis=-1, keepdims=True)
        / scan.depth[..., None] ** 2
    )
    elsewhere = scan.points @ exp_so3([0.1, 0.2, 0.0]).T + [0.2, 0.0, 0.1]
    mixed = rng.permutation(listed(scan))[: 200 * 300].reshape(200, 300, 3)
    for cloud, mask in (
        (bent, usable),
        (elsewhere, usable),
        (mixed, np.ones((200, 300), dtype=bool)),
    ):
        assert organised_grid(cloud, mask) is None
    assert lattice_grid(elsewhere[usable]) is None
    assert lattice_grid(np.vstack([elsewhere[usable], listed(scan)])) is None
    assert lattice_grid(rng.uniform([-0.5, -0.5, 1.0], [0.5, 0.5, 2.0], (50_000, 3))) is None
    assert lattice_grid(rng.uniform([-0.5, -0.5, 1.0], [0.5, 0.5, 2.0], (60, 3))) is None


def test_a_list_in_any_order_gets_its_pixels_back(rng, within):
    scan = frame(rng)
    points = listed(scan)
    for name, cloud, tolerance in (
        ("shuffled", rng.permutation(points), 1e-9),
        ("with rows of NaN", rng.permutation(scan.points.reshape(-1, 3)), 1e-9),
        ("single precision", rng.permutation(points).astype(np.float32), 1e-6),
        ("to 0.1 mm", np.round(points, 4), 1e-3),
    ):
        same(name, Scan.from_cloud(cloud), scan, within, tolerance)
    for name, window in (
        ("a corner", (slice(150, None), slice(7, 201))),
        ("a few pixels", (slice(100, 112), slice(40, 57))),
        ("every other", (slice(None, None, 2), slice(None, None, 2))),
        ("every other row", (slice(None, None, 2), slice(None))),
    ):
        part = scan.part(window)
        gridded = Scan.from_cloud(rng.permutation(listed(part)))
        within(f"{name}: pitches", gridded.pitches / part.pitches - 1.0, 1e-9)
        row, column, _ = gridded.pixels(listed(part))
        within(f"{name}: points [m]", gridded.points[row, column] - listed(part), 1e-9)


def test_millimetres_as_whole_numbers(rng, within):
    scan = frame(rng)
    grid = lattice_grid(np.rint(1e3 * listed(scan)).astype(np.int64).astype(float))
    assert grid is not None
    within("pitch", FOCAL * np.diff(grid.tangent_x) - 1.0, 1e-3)  # 1e-5


def test_the_picture_is_completed_where_it_went_on(rng, within):
    """The empty upper part of a frame that shows the bed, and the surroundings of what stands
    alone.
    """
    scan = frame(rng, lost=0.0)
    below, disc = scan.points.copy(), scan.points.copy()
    below[:90] = np.nan
    disc[scan.depth > 1.2] = np.nan
    gridded = Scan.from_cloud(below.reshape(-1, 3))
    within("lines [px]", FOCAL * (gridded.tangent_x - scan.tangent_x), 1e-6)
    within("lines [px]", FOCAL * (gridded.tangent_y - scan.tangent_y), 1e-6)
    alone = Scan.from_cloud(disc.reshape(-1, 3)).depth
    for edge in (alone[:20], alone[-20:], alone[:, :20], alone[:, -20:]):
        assert not np.isfinite(edge).any()


def test_several_frames_of_one_view_are_averaged(rng, within):
    frames = [frame(rng, lost=0.0) for _ in range(4)]
    merged = Scan.from_cloud(rng.permutation(np.vstack([listed(frame) for frame in frames])))
    mean = 1.0 / np.mean([1.0 / frame.depth for frame in frames], axis=0)
    within("depth [m]", merged.depth - mean, 1e-9)


def test_scatter_is_averaged_without_bias(within):
    """A plane under noise: the surface that is left lies on it, not sigmas before it."""
    sigma, count, rng = 0.01, 100_000, np.random.default_rng(1)
    tangents = rng.uniform([-0.5, -0.4], [0.5, 0.4], (count, 2))
    normal = np.array([0.2, -0.3, 1.0]) / np.linalg.norm([0.2, -0.3, 1.0])
    rays = np.column_stack([tangents, np.ones(count)])
    points = rays * (1.5 / (rays @ normal) + sigma * rng.standard_normal(count))[:, None]
    assert lattice_grid(points) is None
    grid = scatter_grid(points)
    x, y = np.meshgrid(grid.tangent_x, grid.tangent_y)
    off = (np.stack([x, y, np.ones_like(x)], axis=-1) * grid.depth[..., None]) @ normal - 1.5
    assert np.isfinite(off).mean() > 0.95
    within("mean distance [m]", np.nanmean(off), 0.05 * sigma)  # 0.004 sigma
    # 0.35 sigma: it is not one point that is left of several
    within("spread [m]", np.nanstd(off), 0.6 * sigma)


def test_scatter_over_an_edge_invents_no_surface():
    tangents = np.random.default_rng(1).uniform(-0.4, 0.4, (100_000, 2))
    z = np.where(tangents[:, 0] < 0.0, 1.0, 2.0)
    grid = scatter_grid(z[:, None] * np.column_stack([tangents, np.ones(len(z))]))
    depth = grid.depth[np.isfinite(grid.depth)]
    assert ((np.abs(depth - 1.0) < 1e-3) | (np.abs(depth - 2.0) < 1e-3)).all()
    assert abs((depth < 1.5).mean() - 0.5) < 0.01  # the near side is no wider than it is


def test_a_stray_point_leaves_the_rest_its_resolution(rng, within):
    scan = frame(rng)
    strays = [[1.0, 0.0, 0.002], [-3.0, 1.0, 0.01]]
    same("strays", Scan.from_cloud(np.vstack([strays, listed(scan)])), scan, within)


def pcd(file: Path, points: Array, shape: tuple[int, int], *, text: bool) -> Path:
    """The points as a PCD file of `shape` (rows, columns), nine digits as text, single precision
    else.
    """
    rows, columns = shape
    head = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {columns}\nHEIGHT {rows}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {rows * columns}\n"
        f"DATA {'ascii' if text else 'binary'}\n"
    )
    lines = (
        "".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points.reshape(-1, 3)) if text else ""
    )
    file.write_bytes(head.encode() + (lines.encode() if text else points.astype("<f4").tobytes()))
    return file


def ply(file: Path, points: Array) -> Path:
    """The points as an ASCII PLY file of nine digits."""
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    file.write_text(
        head + "".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points), encoding="utf-8"
    )
    return file


def written(folder: Path, points: Array) -> dict[str, Path]:
    """The cloud (H, W, 3) as files: lists without what is empty, and a picture."""
    flat = points[np.isfinite(points[..., 2])]
    binary = folder / "binary.ply"
    write_ply(binary, flat)
    files = {
        "binary.ply": binary,
        "text.ply": ply(folder / "text.ply", flat),
        "binary.pcd": pcd(folder / "binary.pcd", flat, (1, len(flat)), text=False),
        "text.pcd": pcd(folder / "text.pcd", flat, (1, len(flat)), text=True),
    }
    return files | {
        "picture.pcd": pcd(folder / "picture.pcd", points, points.shape[:2], text=False)
    }


def farthest(surface: ModelSurface, X: Array, Y: Array) -> float:
    """Largest distance [m] of a point of the model at one pose from the same at the other, but for
    its symmetry.
    """
    X = np.array(X)
    X[:3, :3] = surface.symmetry.nearest(X[:3, :3], Y[:3, :3])
    return float(np.linalg.norm(surface.points @ (X - Y)[:3, :3].T + (X - Y)[:3, 3], axis=1).max())


DOORS = "tests/unit/perception/clouds/test_cloud_grid.py::test_every_door_finds_the_same_pose"


@pytest.mark.parametrize(
    "floor", [pytest.param(True, marks=pytest.mark.long(guarded_by=DOORS)), False]
)
def test_every_door_finds_the_same_pose(tmp_path, floor: bool, within):
    """As nearest points of cells the same clouds lay 8 mm before the frame."""
    target = barrel()
    surface, X_ST = ModelSurface.of(target), camera_pose(np.array([0.1, -0.9, 0.75]))
    rng = np.random.default_rng(5)
    scan = Scan.from_depth(look(target, X_ST, rng, floor=floor))
    coarse = X_ST[:3, 3] + 0.1, exp_so3([0.2, -0.2, 0.2]) @ X_ST[:3, :3]
    truth = identify(scan, surface, *coarse)
    assert truth.accepted, truth.reason
    doors = {"shuffled": rng.permutation(listed(scan))}
    files = written(tmp_path, np.array(scan.points))
    doors |= {
        name: load_cloud(files[name]).points
        for name in (("text.ply",) if floor else ("picture.pcd",))
    }
    for name, cloud in doors.items():
        identified = identify(cloud, surface, *coarse)
        assert identified.accepted, f"{name}: {identified.reason}"
        within(
            f"{name}: model [m]",
            farthest(surface, identified.X_sensor_target, truth.X_sensor_target),
            1e-4,
        )


def test_files_of_every_kind_give_the_same_scan(tmp_path, rng, within):
    scan = frame(rng)
    for name, file in written(tmp_path, np.array(scan.points)).items():
        same(name, Scan.from_cloud(load_cloud(file).points), scan, within, 1e-5)
    assert load_cloud(tmp_path / "picture.pcd").points.shape == scan.points.shape


def test_thinned_scatter_does_not_stand_before_its_surface(within):
    """The barrel's frame with every point moved along its own ray's surroundings: no lattice is
    left.
    """
    target, X_ST = barrel(), camera_pose(np.array([0.1, -0.9, 0.75]))
    surface, rng = ModelSurface.of(target), np.random.default_rng(5)
    scan = Scan.from_depth(look(target, X_ST, rng))
    points = listed(scan) + rng.normal(
        0.0, [2e-3, 2e-3, 0.0], (int(np.isfinite(scan.depth).sum()), 3)
    )
    assert lattice_grid(points) is None
    identified = identify(
        points, surface, X_ST[:3, 3] + 0.1, exp_so3([0.2, -0.2, 0.2]) @ X_ST[:3, :3]
    )
    assert identified.accepted, identified.reason
    within("position [m]", target.symmetry.error(identified.X_sensor_target, X_ST)[0], 3e-3)


@pytest.mark.parametrize(
    "cloud", [np.zeros((40, 40, 3)), np.full((3, 3, 3), np.nan), np.ones((1, 500, 3))]
)
def test_organised_clouds_that_hold_nothing(cloud: Array):
    with pytest.raises(PerceptionError):
        Scan.from_cloud(cloud)


@pytest.mark.skipif(REAL not in os.environ, reason=f"{REAL} names no folder with the real frame")
@pytest.mark.parametrize("name", ["milk.pcd", "milk_other_view.pcd"])
def test_every_door_finds_the_same_pose_in_a_real_frame(name: str, open3d, within):
    o3d, folder = open3d, Path(os.environ[REAL])
    file = folder / "milk_cartoon_all_small_clorox.pcd"
    picture = load_cloud(file).points
    K = np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]])
    scan = Scan.from_depth(DepthImage(time=0.0, depth=picture[..., 2], K=K, X_BC=np.eye(4)))
    carton = o3d.io.read_point_cloud(str(folder / name)).voxel_down_sample(0.003)
    carton.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(0.02, 30))
    carton.orient_normals_consistent_tangent_plane(30)
    radii = o3d.utility.DoubleVector([0.004, 0.006, 0.01, 0.015])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(carton, radii)
    target = TargetModel(
        name=name,
        vertices=np.asarray(mesh.vertices),
        triangles=np.asarray(mesh.triangles),
        symmetry=Symmetry(),
    )
    surface = ModelSurface.of(target)
    truth = identify(scan, surface)
    assert truth.accepted, truth.reason
    flat = np.random.default_rng(0).permutation(listed(scan))
    for cloud in (picture, flat, flat.astype(np.float32)):
        identified = identify(cloud, surface)
        assert identified.accepted, identified.reason
        # 2 um
        within(
            "model [m]", farthest(surface, identified.X_sensor_target, truth.X_sensor_target), 1e-3
        )
