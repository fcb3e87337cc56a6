"""Clouds and targets from files: what is written is read, what cannot be is said with its line."""

from pathlib import Path

import numpy as np
import pytest

from uuv.models.meshes.ply_files import write_ply
from uuv.perception.clouds.point_files import read_cloud, read_targets
from uuv.sim.interfaces.errors import ConfigurationError


def test_text_ply_and_pcd_hold_the_same_points(tmp_path, within):
    points = np.random.default_rng(0).normal(size=(500, 3))
    np.savetxt(tmp_path / "a.txt", points, header="x y z")
    np.savetxt(tmp_path / "b.csv", points, delimiter=", ")
    write_ply(tmp_path / "c.ply", points)
    within("c.ply", read_cloud(tmp_path / "c.ply") - points, 0.0)
    (tmp_path / "e.txt").write_bytes(
        b"\xef\xbb\xbf" + (tmp_path / "b.csv").read_bytes().replace(b"\n", b"\r\n")
    )
    for name in ("a.txt", "b.csv", "e.txt"):
        within(name, read_cloud(tmp_path / name) - points, 1e-12)


FIELDS = "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"


def pcd(
    kind: str, data: bytes, count: int, fields: str = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
) -> bytes:
    """A PCD file of `count` points in one row."""
    size = f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\n"
    return f"# .PCD v0.7\nVERSION 0.7\n{fields}{size}DATA {kind}\n".encode() + data


def test_the_three_kinds_of_pcd(tmp_path):
    """With a field more, NaN in its place; compressed by hand: bytes as they are, and bytes that
    were there.
    """
    points = np.random.default_rng(0).normal(size=(500, 3)).astype("<f4")
    points[7] = np.nan
    rows = np.zeros(500, dtype=[("p", "<f4", 3), ("rgb", "<u4")])
    rows["p"] = points
    rows["rgb"] = 7
    lines = "".join(f"{x!r} {y!r} {z!r} 7\n" for x, y, z in points.astype(float).tolist())
    plain = points.T.tobytes() + rows["rgb"].tobytes()
    packed = b"".join(
        bytes([len(run) - 1]) + run for run in (plain[i : i + 32] for i in range(0, len(plain), 32))
    )
    packed = np.array([len(packed), len(plain)], "<u4").tobytes() + packed
    for kind, data in (
        ("ascii", lines.encode()),
        ("binary", rows.tobytes()),
        ("binary_compressed", packed),
    ):
        file = tmp_path / f"{kind}.pcd"
        file.write_bytes(pcd(kind, data, 500, FIELDS))
        assert np.array_equal(read_cloud(file), points, equal_nan=True), kind
        file.write_bytes(pcd(kind, data, 501, FIELDS))
        with pytest.raises(ConfigurationError, match="truncated"):
            read_cloud(file)
    # four bytes, then 264, 264 and 8 of them
    ones = bytes([3, 0, 0, 0x80, 0x3F, 0xE0, 255, 3, 0xE0, 255, 3, 0xC0, 3])
    file = tmp_path / "ones.pcd"
    file.write_bytes(
        pcd("binary_compressed", np.array([len(ones), 540], "<u4").tobytes() + ones, 45)
    )
    assert np.array_equal(read_cloud(file), np.ones((45, 3)))
    for spoilt in (ones[:-1], ones + ones, bytes([0xE0, 255, 3])):
        file.write_bytes(
            pcd("binary_compressed", np.array([len(spoilt), 540], "<u4").tobytes() + spoilt, 45)
        )
        with pytest.raises(ConfigurationError, match="truncated"):
            read_cloud(file)


def test_files_of_open3d_hold_the_same_points(tmp_path, open3d, within):
    """PLY and PCD, of each kind, with normals and colours."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(500, 3))
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = cloud.colors = open3d.utility.Vector3dVector(rng.random((500, 3)))
    # text has six digits, pcd floats
    for name, tolerance, as_text in (("a.ply", 1e-12, 1e-5), ("a.pcd", 1e-6, 1e-5)):
        for options in ({}, {"write_ascii": True}, {"compressed": True}):
            open3d.io.write_point_cloud(str(tmp_path / name), cloud, **options)
            allowed = as_text if "write_ascii" in options else tolerance
            within(f"{name} {options}", read_cloud(tmp_path / name) - points, allowed)


@pytest.mark.parametrize("name", ["a.ply", "a.pcd", "a.xyz"])
def test_a_file_that_may_not_be_read_is_one_clear_error(tmp_path, monkeypatch, name):
    def refused(path: Path, *_: int) -> int:
        raise PermissionError(13, "Permission denied", str(path))

    (tmp_path / name).write_text("0 0 0\n")
    monkeypatch.setattr("uuv.sim.interfaces.files.os.open", refused)
    with pytest.raises(ConfigurationError, match="permission denied"):
        read_cloud(tmp_path / name)


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
        ("comments.txt", b"# nothing\n\n", "the text has no points"),
        ("columns.txt", b"0 0 0\n1 2\n", "line 2: expected 3 numbers"),
        ("narrow.txt", b"0 0\n1 2\n", "line 1: expected x y z and optional columns, got 2"),
        ("named.txt", b"x y\n1 2\n", "line 1: expected 3 numbers .x y z., or a line that names"),
        ("fewer.txt", b"x y z\n1 2 3 4\n", "3 columns are named .x y z., but line 2 has 4"),
        ("twice.txt", b"x,y,z\nx,y,z\n1,2,3\n", "line 2: expected 3 numbers"),
        ("count.pts", b"0\n", "the text has no points"),
        (
            "a.npy",
            b"\x93NUMPY\x01\x00v\x00",
            "NumPy files cannot be read; allowed are PLY, PCD.*numpy.savetxt",
        ),
        ("a.las", b"LASF and more", "LAS files cannot be read; .*pdal translate"),
        ("a.LAZ", b"LASF and more", "LAS files cannot be read"),
        ("a.e57", b"ASTM-E57", "E57 files cannot be read; .*CloudCompare"),
        ("renamed.xyz", b"ASTM-E57\x00", "E57 files cannot be read"),
        ("words.txt", b"0 0 0\n\n1 two 3\n", "line 3: expected 3 numbers"),
        ("binary.txt", bytes(range(128, 256)), "not text"),
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
    [
        ("z 0 0 1\n", "no point B"),
        ("z 0 0 0\n1 2 3\n", "zero"),
        ("z 0 0 1\nz 0 0 1\n1 2 3", "twice"),
        ("1 nan 2\n", "finite"),
        ("1 2\n", "line 1"),
        ("", "empty"),
    ],
)
def test_bad_targets_are_refused_with_their_line(tmp_path, content, words):
    (tmp_path / "t.txt").write_text(content, "utf-8")
    with pytest.raises(ConfigurationError, match=words):
        read_targets(tmp_path / "t.txt")
    with pytest.raises(ConfigurationError, match="no such file"):
        read_cloud(tmp_path / "none.txt")


def test_a_direction_has_any_length(tmp_path):
    file = tmp_path / "targets.txt"
    file.write_text("z 0 3e200 4e200\n1 2 3\n")
    assert read_targets(file)[1] == pytest.approx([0.0, 0.6, 0.8])


def test_a_signalling_nan_is_a_nan(tmp_path):
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "a.ply").write_bytes(
        header.encode() + b"end_header\n" + b"\x01\x00\x80\x7f" + bytes(8)
    )
    assert np.array_equal(read_cloud(tmp_path / "a.ply"), [[np.nan, 0.0, 0.0]], equal_nan=True)
