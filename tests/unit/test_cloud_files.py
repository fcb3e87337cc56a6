"""Files that users have: each works, with what was left out said, or gets one clear error."""

import numpy as np
import pytest

from models import open3d_loader, targets
from models.target_model import TargetModel
from perception import cloud_files
from perception.cloud_files import load_cloud
from perception.identification import identify
from perception.scan import Scan
from sim.interfaces.errors import ConfigurationError
from tests.unit.depth_scenes import look, seen_from

POINTS = np.random.default_rng(0).uniform([-0.5, -0.5, 1.0], [0.5, 0.5, 2.0], (500, 3))


def save(path, points: np.ndarray) -> str:
    o3d = open3d_loader.load()
    if path.suffix in (".ply", ".pcd"):
        assert o3d.io.write_point_cloud(str(path), o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)))
    else:
        np.savetxt(path, points)
    return str(path)


@pytest.mark.parametrize("ending", ["ply", "pcd", "xyz"])
def test_formats_bad_rows_and_duplicates(tmp_path, ending: str, within):
    rows = np.vstack([POINTS, POINTS[:50], np.zeros((7, 3)), np.full((9, 3), np.nan)])
    found = load_cloud(save(tmp_path / f"scan.{ending}", rows))
    order = [np.lexsort(np.round(p, 4).T) for p in (found.points, POINTS)]
    within("points [m]", found.points[order[0]] - POINTS[order[1]], 1e-5)  # PCD keeps single precision
    assert [note.split()[0] for note in found.notes] == ["9", "7", "50"]


def test_millimetres_are_detected_and_said(tmp_path, within):
    file = save(tmp_path / "mm.ply", 1e3 * POINTS)
    with pytest.raises(ConfigurationError, match=r"millimetres.*0\.001"):
        load_cloud(file)
    within("points [m]", load_cloud(file, scale=1e-3).points - POINTS, 1e-9)
    with pytest.raises(ConfigurationError, match="mixed"):
        load_cloud(save(tmp_path / "mixed.xyz", np.vstack([POINTS, 1e3 * POINTS[:100]])))
    o3d = open3d_loader.load()
    stone = targets.named("rock")
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(1e3 * stone.vertices), o3d.utility.Vector3iVector(stone.triangles)
    )
    assert o3d.io.write_triangle_mesh(str(tmp_path / "rock.ply"), mesh)
    with pytest.raises(ConfigurationError, match=r"millimetres.*0\.001"):
        TargetModel.from_file(tmp_path / "rock.ply")
    assert TargetModel.from_file(tmp_path / "rock.ply", scale=1e-3).radius == pytest.approx(stone.radius)


def test_files_without_a_cloud(tmp_path):
    for name, text in (("none.xyz", ""), ("two.xyz", "1 2\n3 4\n"), ("words.xyz", "a b c\n"), ("bad.ply", "no")):
        (tmp_path / name).write_text(text)
        with pytest.raises(ConfigurationError, match="cloud"):
            load_cloud(tmp_path / name)
    with pytest.raises(ConfigurationError, match="no usable point"):
        load_cloud(save(tmp_path / "zeros.xyz", np.zeros((5, 3))))
    with pytest.raises(ConfigurationError, match="no such file"):
        load_cloud(tmp_path / "missing.pcd")
    with pytest.raises(ConfigurationError, match="scale"):
        load_cloud(tmp_path / "zeros.xyz", scale=0.0)


def test_more_points_than_are_allowed(tmp_path, monkeypatch):
    monkeypatch.setattr(cloud_files, "MOST", 400)
    with pytest.raises(ConfigurationError, match="at most 400 points"):
        load_cloud(save(tmp_path / "many.ply", POINTS))


def test_file_that_is_cut_short(tmp_path):
    whole = tmp_path / "whole.ply"
    save(whole, POINTS)
    (tmp_path / "short.ply").write_bytes(whole.read_bytes()[:5000])
    with pytest.raises(ConfigurationError, match="cut short"):
        load_cloud(tmp_path / "short.ply")


def test_awkward_meshes(tmp_path, within):
    """The same pose, whatever is the matter with the mesh: doubled and zero-area faces, a fin, strays, turned in."""
    o3d, rock = open3d_loader.load(), targets.named("rock")
    V, F = np.array(rock.vertices), np.array(rock.triangles)
    n = len(V)
    view = seen_from(np.array([0.3, -0.6, 1.0]))
    scan = Scan.from_depth(look(rock, view, np.random.default_rng(0)))
    cases = {
        "fin and doubled faces": (np.vstack([V, V[F[0]].mean(axis=0) * 1.05]), [*F, *F[:200], [F[0, 0], F[0, 1], n]]),
        "no area": (np.vstack([V, V[:1], V[:1], 0.5 * (V[F[:1, 0]] + V[F[:1, 1]])]),
                    [*F, [0, 0, 1], [n, n + 1, 0], [F[0, 0], F[0, 1], n + 2]]),
        "strays": (np.vstack([V, [[9.0, 9.0, 9.0], [np.nan, 0.0, 0.0]]]), F),
        "turned in": (V, F[:, ::-1]),
    }  # fmt: skip
    for name, (vertices, faces) in cases.items():
        mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(np.array(faces, dtype=np.int32))
        )
        assert o3d.io.write_triangle_mesh(str(tmp_path / "awkward.ply"), mesh)
        target = TargetModel.from_file(tmp_path / "awkward.ply")
        found = identify(scan, target, view[:3, 3], view[:3, :3])
        position, angle = rock.symmetry.error(found.X_sensor_target, view)
        within(f"{name}: position [m]", position, 0.01)
        within(f"{name}: angle [rad]", angle, 0.1)


def test_faces_of_four_corners(tmp_path):
    (tmp_path / "quads.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert len(TargetModel.from_file(tmp_path / "quads.obj").triangles) == 2
    (tmp_path / "beyond.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(ConfigurationError, match="not there"):
        TargetModel.from_file(tmp_path / "beyond.obj")
