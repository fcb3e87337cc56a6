"""Clouds and targets from files: what is written is read, what cannot be is said with its line."""

import numpy as np
import pytest

from models import open3d_loader
from perception.point_files import read_cloud, read_targets
from sim.interfaces.errors import ConfigurationError


def test_text_ply_and_pcd_hold_the_same_points(tmp_path, within):
    points = np.random.default_rng(0).normal(size=(500, 3))
    o3d = open3d_loader.load()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    np.savetxt(tmp_path / "a.txt", points, header="x y z")
    np.savetxt(tmp_path / "b.csv", points, delimiter=", ")
    for name, tolerance in (("c.ply", 1e-12), ("d.pcd", 1e-6)):
        o3d.io.write_point_cloud(str(tmp_path / name), cloud)
        within(name, read_cloud(tmp_path / name) - points, tolerance)
    (tmp_path / "e.txt").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "b.csv").read_bytes().replace(b"\n", b"\r\n"))
    for name in ("a.txt", "b.csv", "e.txt"):
        within(name, read_cloud(tmp_path / name) - points, 1e-12)


def test_targets_and_direction(tmp_path):
    file = tmp_path / "targets.txt"
    file.write_text("# two points\n0.1 0.2 -0.5\nz 0 0 2\n0.3, 0.2, -0.5  # the end\n", "utf-8")
    B, z = read_targets(file)
    assert B.tolist() == [[0.1, 0.2, -0.5], [0.3, 0.2, -0.5]]
    assert z.tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.txt", b"", "empty"),
        ("comments.txt", b"# nothing\n\n", "empty"),
        ("columns.txt", b"0 0 0\n1 2\n", "line 2: expected 3 columns"),
        ("wide.txt", b"0 0 0 1\n1 2 3 1\n", "line 1: expected 3 columns"),
        ("words.txt", b"0 0 0\n\n1 two 3\n", "line 3: expected 3 numbers"),
        ("binary.txt", bytes(range(128, 256)), "cannot be read as text"),
        ("bad.ply", b"ply\nnonsense\n", "no points"),
        ("bad.pcd", b"hello", "no points"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigurationError, match=words) as caught:
        read_cloud(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [("z 0 0 1\n", "no point B"), ("z 0 0 0\n1 2 3\n", "zero"), ("z 0 0 1\nz 0 0 1\n1 2 3", "twice"),
     ("1 nan 2\n", "finite"), ("1 2\n", "line 1"), ("", "empty")],
)  # fmt: skip
def test_bad_targets_are_refused_with_their_line(tmp_path, content, words):
    (tmp_path / "t.txt").write_text(content, "utf-8")
    with pytest.raises(ConfigurationError, match=words):
        read_targets(tmp_path / "t.txt")
    with pytest.raises(ConfigurationError, match="no such file"):
        read_cloud(tmp_path / "none.txt")
