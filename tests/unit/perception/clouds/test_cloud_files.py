"""Files that users have: each works, with what was left out said, or gets one clear error."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from test_point_files import pcd

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.meshes.mesh_files import read_mesh
from uuv.models.meshes.ply_files import read_ply, write_ply
from uuv.models.objects import targets
from uuv.models.objects.target_model import TargetModel
from uuv.perception.clouds import cloud_files
from uuv.perception.clouds.cloud_files import load_cloud
from uuv.perception.clouds.scan import Scan
from uuv.perception.registration.identification import identify
from uuv.sim.interfaces.errors import ConfigurationError

POINTS = np.random.default_rng(0).uniform([-0.5, -0.5, 1.0], [0.5, 0.5, 2.0], (500, 3))


def save(path, points: np.ndarray) -> str:
    if path.suffix == ".ply":
        write_ply(path, points)
    elif path.suffix == ".pcd":
        path.write_bytes(pcd("binary", points.astype("<f4").tobytes(), len(points)))
    else:
        np.savetxt(path, points)
    return str(path)


@pytest.mark.parametrize("ending", ["ply", "pcd", "xyz"])
def test_formats_bad_rows_and_duplicates(tmp_path, ending: str, within):
    rows = np.vstack([POINTS, POINTS[:50], np.zeros((7, 3)), np.full((9, 3), np.nan)])
    scan = load_cloud(save(tmp_path / f"scan.{ending}", rows))
    order = [np.lexsort(np.round(p, 4).T) for p in (scan.points, POINTS)]
    # PCD keeps single precision
    within("points [m]", scan.points[order[0]] - POINTS[order[1]], 1e-5)
    assert [note.split()[0] for note in scan.notes] == ["9", "7", "50"]


def test_millimetres_are_detected_and_said(tmp_path, within):
    file = save(tmp_path / "mm.ply", 1e3 * POINTS)
    with pytest.raises(ConfigurationError, match=r"millimetres.*0\.001"):
        load_cloud(file)
    within("points [m]", load_cloud(file, scale=1e-3).points - POINTS, 1e-9)
    with pytest.raises(ConfigurationError, match="mixed"):
        load_cloud(save(tmp_path / "mixed.xyz", np.vstack([POINTS, 1e3 * POINTS[:100]])))
    stone = targets.named("rock")
    write_ply(tmp_path / "rock.ply", 1e3 * stone.vertices, stone.triangles)
    with pytest.raises(ConfigurationError, match=r"millimetres.*0\.001"):
        TargetModel.from_file(tmp_path / "rock.ply")
    assert TargetModel.from_file(tmp_path / "rock.ply", scale=1e-3).radius == pytest.approx(
        stone.radius
    )


def test_files_without_a_cloud(tmp_path):
    for name, text in (
        ("none.xyz", ""),
        ("two.xyz", "1 2\n3 4\n"),
        ("words.xyz", "a b c\n"),
        ("bad.ply", "no"),
    ):
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
    with pytest.raises(ConfigurationError, match="truncated"):
        load_cloud(tmp_path / "short.ply")


@pytest.mark.long
def test_awkward_meshes(tmp_path, within):
    """The same pose, whatever is the matter with the mesh: doubled and zero-area faces, a fin,
    strays, turned in.
    """
    rock = targets.named("rock")
    V, F = np.array(rock.vertices), np.array(rock.triangles)
    n = len(V)
    view = camera_pose(np.array([0.3, -0.6, 1.0]))
    scan = Scan.from_depth(look(rock, view, np.random.default_rng(0)))
    cases = {
        "fin and doubled faces": (
            np.vstack([V, V[F[0]].mean(axis=0) * 1.05]),
            [*F, *F[:200], [F[0, 0], F[0, 1], n]],
        ),
        "no area": (
            np.vstack([V, V[:1], V[:1], 0.5 * (V[F[:1, 0]] + V[F[:1, 1]])]),
            [*F, [0, 0, 1], [n, n + 1, 0], [F[0, 0], F[0, 1], n + 2]],
        ),
        "strays": (np.vstack([V, [[9.0, 9.0, 9.0], [np.nan, 0.0, 0.0]]]), F),
        "turned in": (V, F[:, ::-1]),
    }
    for name, (vertices, faces) in cases.items():
        write_ply(tmp_path / "awkward.ply", vertices, faces)
        target = TargetModel.from_file(tmp_path / "awkward.ply")
        identification = identify(scan, target, view[:3, 3], view[:3, :3])
        position, angle = rock.symmetry.error(identification.X_sensor_target, view)
        within(f"{name}: position [m]", position, 0.01)
        within(f"{name}: angle [rad]", angle, 0.1)


def test_faces_of_four_corners(tmp_path):
    (tmp_path / "quads.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert len(TargetModel.from_file(tmp_path / "quads.obj").triangles) == 2
    (tmp_path / "beyond.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(ConfigurationError, match="does not exist"):
        TargetModel.from_file(tmp_path / "beyond.obj")


def test_ply_of_many_kinds(tmp_path):
    """Big-endian, faces of different corners, extra properties and elements, in text and in bytes;
    never cut short.
    """
    head = (
        "comment x\nelement vertex 5\nproperty float x\nproperty float y\nproperty float "
        "z\nproperty uchar red\n"
        "element face 3\nproperty uchar flags\nproperty list uchar int vertex_index\nelement edge "
        "1\n"
        "property int vertex1\nproperty int vertex2\nend_header\n"
    )
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.5, 0.5, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    faces = [(0, 1, 2, 3, 4), (0, 1, 2), (1, 2, 3, 4)]
    text = "".join(f"{x} {y} {z} 9\n" for x, y, z in corners)
    text += "".join(f"1 {len(face)} {' '.join(map(str, face))}\n" for face in faces) + "0 1\n"
    for form, order in (("ascii", ""), ("binary_little_endian", "<"), ("binary_big_endian", ">")):
        if order:
            content = b"".join(struct.pack(order + "3fB", *corner, 9) for corner in corners)
            content += b"".join(
                struct.pack(f"{order}BB{len(face)}i", 1, len(face), *face) for face in faces
            )
            content += struct.pack(order + "2i", 0, 1)
        else:
            content = text.encode()
        file = tmp_path / f"{form}.ply"
        file.write_bytes(f"ply\nformat {form} 1.0\n{head}".encode() + content)
        points, triangles = read_ply(file.read_bytes())
        assert points.tolist() == [list(corner) for corner in corners], form
        assert triangles.tolist() == [
            [0, 1, 2],
            [0, 2, 3],
            [0, 3, 4],
            [0, 1, 2],
            [1, 2, 3],
            [1, 3, 4],
        ], form
        assert len(TargetModel.from_file(file).triangles) == 6
        for left in (20, 40):  # the faces, or some vertices too
            file.write_bytes(f"ply\nformat {form} 1.0\n{head}".encode() + content[:-left])
            with pytest.raises(ConfigurationError, match="truncated"):
                TargetModel.from_file(file)


HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty "
    "float z\n"
)
FACES = "element face {}\nproperty list {} int vertex_indices\nend_header\n"
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


def test_text_ply_of_elements_that_hold_nothing():
    none = "element edge 0\nproperty int vertex1\nproperty int vertex2\n"
    points, triangles = read_ply(
        (HEAD + none + FACES.format(1, "uchar") + CORNERS + "3 0 1 2\n").encode()
    )
    assert points.shape == (3, 3)
    assert triangles.tolist() == [[0, 1, 2]]
    points, triangles = read_ply(
        (HEAD.replace("vertex 3", "vertex 0") + FACES.format(0, "uchar")).encode()
    )
    assert points.shape == triangles.shape == (0, 3)


@pytest.mark.parametrize("face", ["inf 0 1 2", "3 0 1 inf", "3 0 1 -inf"])
def test_text_ply_with_a_count_or_an_index_that_is_infinite(tmp_path, face):
    file = tmp_path / "a.ply"
    file.write_text(HEAD + FACES.format(1, "uchar") + CORNERS + face + "\n")
    with pytest.raises(ConfigurationError, match=r"a\.ply.*not finite"):
        TargetModel.from_file(file)
    with pytest.raises(ConfigurationError, match=r"a\.ply.*not finite"):
        load_cloud(file)


def test_binary_ply_with_an_index_that_is_not_finite():
    head = (
        (HEAD + FACES.format(1, "uchar"))
        .replace("ascii", "binary_little_endian")
        .replace("char int", "char float")
    )
    content = np.zeros(9, "<f4").tobytes() + struct.pack("<B3f", 3, 0.0, 1.0, np.nan)
    with pytest.raises(ValueError, match="not finite"):
        read_ply(head.encode() + content)


@pytest.mark.parametrize("name", ["a.ply", "a.off", "a.stl"])
def test_a_mesh_that_may_not_be_read_is_no_malformed_one(tmp_path, monkeypatch, name):
    def refused(path: Path, *_: int) -> int:
        raise PermissionError(13, "Permission denied", str(path))

    (tmp_path / name).write_text("0 0 0\n")
    monkeypatch.setattr("uuv.sim.interfaces.files.os.open", refused)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(
        ImportError if name == "a.stl" else ConfigurationError, match=r"permission denied|trimesh"
    ):
        read_mesh(tmp_path / name)


def test_off_and_what_is_none(tmp_path):
    file = tmp_path / "a.off"
    body = (
        "0 0 0 255 0 0\n1 0 0 255 0 0\n1 1 0 0 0 9\n0 1 0 0 0 9 # last\n4 0 1 2 3\n3 0 1 2 255 "
        "0 0\n"
    )
    for head in ("COFF\n# a comment\n4 2 0\n", "OFF 4 2 0\n"):
        file.write_text(head + body)
        assert TargetModel.from_file(file).triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    for text, words in (
        ("OFF\n4 3 0\n" + body, "truncated"),
        ("OFF\n", "no vertices"),
        ("4 2 0\n" + body, "begin with"),
        ("OFF 3 1 0\n0 0 0\n1 0 0\n1 1 0\n4 0 1 2\n", "fewer corners"),
        ("OFF 3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 7\n", "does not exist"),
        ("OFF 3 1 0\n0 0 0\n1 nan 0\n1 1 0\n3 0 1 2\n", "not finite"),
    ):
        file.write_text(text)
        with pytest.raises(ConfigurationError, match=words):
            TargetModel.from_file(file)
