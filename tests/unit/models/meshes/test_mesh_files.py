"""Meshes in text form: faces of any number of corners, headers on one line or two, what is cut
short.
"""

import sys

import numpy as np
import pytest

from uuv.models.meshes import mesh_files
from uuv.models.meshes.closed_shells import volume
from uuv.sim.interfaces.errors import ConfigurationError

CUBE = """0 0 0
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
4 3 2 1 0
4 4 5 6 7 255 0 0
4 0 1 5 4
4 1 2 6 5  # a side
4 2 3 7 6

4 3 0 4 7
"""


@pytest.mark.parametrize("head", ["OFF\n8 6 12\n", "OFF 8 6 12\n", "# a cube\nCOFF\n8 6 0\n"])
def test_faces_are_cut_into_fans(head: str) -> None:
    vertices, triangles = mesh_files._read_off((head + CUBE).encode())
    assert (vertices.shape, triangles.shape) == ((8, 3), (12, 3))
    assert volume(vertices, triangles) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("8 6 12\n" + CUBE, "does not begin"),
        ("", "does not begin"),
        ("OFF\n", "states no"),
        ("OFF 8\n" + CUBE, "states no"),
        ("OFF 8 -6 0\n" + CUBE, "states no"),
        ("OFF 9 9 0\n" + CUBE, "truncated"),
        ("OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "fewer corners"),
    ],
)
def test_what_is_no_mesh_is_told(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        mesh_files._read_off(text.encode())


def test_duplicates_and_what_no_face_uses_are_left_out(rng: np.random.Generator) -> None:
    corners = rng.normal(size=(4, 3))
    vertices = np.vstack([corners, corners[:2], [[9.0, 9.0, 9.0]]])
    triangles = np.array([[0, 1, 2], [4, 5, 3], [0, 4, 2], [1, 2, 5], [2, 0, 4]])
    unique, faces = mesh_files._tidied(vertices, triangles)
    assert len(unique) == 4
    assert len(faces) == 2
    np.testing.assert_allclose(unique[faces], vertices[triangles[:2]])


def test_text_that_is_not_utf_8_is_read(tmp_path, monkeypatch):
    """And without the package that tells the encoding it is refused in one line."""
    corners = "".join(f"  vertex {corner}\n" for corner in ("0 0 0", "1 0 0", "0 1 0"))
    facets = f"facet normal 0 0 1\n outer loop\n{corners} endloop\nendfacet"
    file = tmp_path / "part.stl"
    file.write_bytes(f"solid Gehäuse für Müller\n{facets}\nendsolid\n".encode("latin-1"))
    vertices, triangles = mesh_files.read_mesh(file)
    assert vertices.shape == (3, 3)
    assert triangles.shape == (1, 3)
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    with pytest.raises(
        ConfigurationError, match=r"the file cannot be read as STL: .*charset_normalizer"
    ):
        mesh_files.read_mesh(file)
