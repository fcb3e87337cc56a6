"""Files that users have: each works, with what was left out said, or gets one clear error."""

import numpy as np
import pytest

from models import open3d_loader, targets
from models.target_model import TargetModel
from perception.cloud_files import MOST, load_cloud
from sim.interfaces.errors import ConfigurationError

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


def test_more_points_than_are_kept(tmp_path):
    many = np.random.default_rng(1).uniform([-1, -1, 1], [1, 1, 2], (MOST + 1000, 3))
    found = load_cloud(save(tmp_path / "many.ply", many))
    assert len(found.points) == MOST
    assert "thinned" in found.notes[-1]
