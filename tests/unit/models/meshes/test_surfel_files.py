"""Clouds as other programs write them: the same model by every door, with what was left out said,
or a way on.
"""

from pathlib import Path

import numpy as np
import pytest

from uuv.models.meshes.closed_shells import box
from uuv.models.meshes.ply_files import write_ply
from uuv.models.meshes.surfel_files import check_surfels, read_surfels
from uuv.models.objects.target_model import TargetModel
from uuv.perception.clouds.cloud_files import load_cloud
from uuv.perception.clouds.point_files import read_cloud
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3

TURN = exp_so3([0.3, -0.5, 0.2])


def surface(rng: np.random.Generator, count: int = 900) -> tuple[Array, Array]:
    """Points (n, 3) [m] on a turned box, and outward normals (n, 3)."""
    vertices, triangles = box([0.3, 0.2, 0.1], np.array([0.05, -0.1, 0.9]))
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(triangles), count, p=area / area.sum())
    points = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), count), corners[face])
    return points @ TURN.T, (cross[face] / area[face, None]) @ TURN.T


def colours(rng: np.random.Generator, count: int) -> Array:
    return rng.integers(0, 256, (count, 3)).astype(float)


def written(
    file: Path, rows: Array, head: str = "", delimiter: str = " ", point: str = "."
) -> Path:
    lines = [delimiter.join(f"{number:.6g}".replace(".", point) for number in row) for row in rows]
    file.write_text("\n".join([*([head] if head else []), *lines]) + "\n")
    return file


FORMS = {  # head of the file, columns after the point, delimiter, decimal sign, note
    "plain": ("", "", " ", ".", ""),
    "colours": ("", "c", " ", ".", "columns left out: 4, 5, 6 (no unit normals)"),
    "colours from 0 to 1": ("", "s", " ", ".", "columns left out: 4, 5, 6"),
    "intensity": ("", "i", " ", ".", "columns left out: 4"),
    "intensity and colours": ("", "ic", " ", ".", "columns left out: 4, 5, 6, 7"),
    "CSV": ("x,y,z", "", ",", ".", ""),
    "CSV with quotes and units": (
        '"X [m]","Y [m]","Z [m]","Intensity"',
        "i",
        ",",
        ".",
        "columns left out: intensity",
    ),
    "CloudCompare": ("//X Y Z R G B", "c", " ", ".", "columns left out: r g b"),
    "comment": ("# x y z red green blue", "c", " ", ".", "columns left out: red green blue"),
    "PTS": ("900", "ic", " ", ".", "columns left out: 4, 5, 6, 7"),
    "ParaView": ("Points:0,Points:1,Points:2", "", ",", ".", ""),
    "decimal commas": ("", "", "; ", ",", "commas are read as decimal signs"),
    "decimal commas and blanks": ("x y z", "", " ", ",", "commas are read as decimal signs"),
}


@pytest.mark.parametrize("form", FORMS)
def test_columns_that_are_no_normals_are_left_out_and_said(
    tmp_path: Path, form: str, rng: np.random.Generator
) -> None:
    head, more, delimiter, point, note = FORMS[form]
    points, _ = surface(rng)
    shades = colours(rng, len(points))
    parts = {
        "c": shades,
        "s": (shades / 255.0).round(4),
        "i": rng.uniform(0.0, 1.0, (len(points), 1)),
    }
    rows = np.column_stack([points, *(parts[name] for name in more)])
    file = written(tmp_path / "scan.xyz", rows, head, delimiter, point)

    check_surfels(file)
    surfels = read_surfels(file)

    assert surfels.normals is None
    np.testing.assert_allclose(surfels.points, points, rtol=1e-5)
    assert note in "; ".join(surfels.notes)
    assert bool(surfels.notes) == bool(note)
    np.testing.assert_array_equal(read_cloud(file), surfels.points)
    assert load_cloud(file).notes == surfels.notes


@pytest.mark.parametrize("ending", ["ply", "pcd"])
def test_colours_of_ply_and_pcd_are_left_out_and_said(
    tmp_path: Path, ending: str, rng: np.random.Generator
) -> None:
    file = tmp_path / f"scan.{ending}"
    points = surface(rng)[0].round(4)
    if ending == "ply":
        write_ply(file, points, colours=colours(rng, len(points)) / 255.0)
    else:
        head = "FIELDS x y z _ rgb\nSIZE 4 4 4 1 4\nTYPE F F F U U\nCOUNT 1 1 1 1 1\n"
        rows = np.column_stack(
            [points, np.zeros(len(points)), rng.integers(0, 99, len(points)) / 1.0]
        )
        written(file, rows, f"{head}WIDTH {len(points)}\nHEIGHT 1\nDATA ascii")

    cloud = load_cloud(file)
    np.testing.assert_allclose(cloud.points, points, atol=1e-6)
    left_out = "red green blue" if ending == "ply" else "rgb"
    assert cloud.notes == (f"columns left out: {left_out}",)


@pytest.mark.parametrize(
    ("head", "order"),
    [
        ("", "pn"),
        ("", "pni"),
        ("", "pin"),
        ("", "pcn"),
        ("//X Y Z Nx Ny Nz", "pn"),
        ("x y z r g b normal_x normal_y normal_z", "pcn"),
        ("nx ny nz x y z", "np"),
    ],
)
def test_normals_are_found_by_name_or_by_their_length(
    tmp_path: Path, head: str, order: str, rng: np.random.Generator
) -> None:
    points, normals = surface(rng)
    normals = normals.round(3)
    normals[:5] = 0.0
    parts = {
        "p": points,
        "n": normals,
        "c": colours(rng, len(points)),
        "i": rng.uniform(0.0, 9.0, (len(points), 1)),
    }
    surfels = read_surfels(
        written(tmp_path / "a.txt", np.column_stack([parts[name] for name in order]), head)
    )
    assert surfels.normals is not None
    np.testing.assert_allclose(surfels.points, points, rtol=1e-5)
    np.testing.assert_allclose(surfels.normals, normals, atol=1e-6)


def test_normals_of_any_length_have_negative_components(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    points, normals = surface(rng)
    surfels = read_surfels(written(tmp_path / "a.xyz", np.column_stack([points, 100.0 * normals])))
    assert surfels.normals is not None
    np.testing.assert_allclose(surfels.normals, 100.0 * normals, atol=1e-3)


def test_colours_do_not_make_a_model_grow(tmp_path: Path, rng: np.random.Generator) -> None:
    points, _ = surface(rng)
    plain = TargetModel.from_file(written(tmp_path / "a.xyz", points))
    coloured = TargetModel.from_file(
        written(tmp_path / "b.xyz", np.column_stack([points, colours(rng, len(points))]))
    )
    np.testing.assert_array_equal(coloured.vertices, plain.vertices)
    assert coloured.cloud is not None
    assert coloured.cloud.note.endswith("columns left out: 4, 5, 6 (no unit normals)")


@pytest.mark.parametrize("door", ["file", "array"])
def test_points_without_a_normal_are_left_out_and_said(
    tmp_path: Path, door: str, rng: np.random.Generator
) -> None:
    points, normals = surface(rng)
    normals[:4] = 0.0
    normals[4:6] = np.nan
    if door == "file":
        rows = np.column_stack([points, normals])
        model = TargetModel.from_file(written(tmp_path / "a.xyz", rows))
    else:
        model = TargetModel.from_cloud(points, normals)
    assert model.cloud is not None
    assert "6 of 900 points left out: their normal is zero or not finite" in model.cloud.note
    assert "normals given" in model.cloud.note
    whole = TargetModel.from_cloud(points[6:], normals[6:])
    assert len(model.triangles) == pytest.approx(len(whole.triangles), rel=0.02)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_normals_of_which_none_is_usable_are_taken_as_none(
    value: float, rng: np.random.Generator
) -> None:
    points, normals = surface(rng)
    model = TargetModel.from_cloud(points, np.full_like(normals, value))
    plain = TargetModel.from_cloud(points)
    np.testing.assert_array_equal(model.vertices, plain.vertices)
    assert model.cloud is not None
    assert "all normals are zero or not finite, so they are ignored" in model.cloud.note


@pytest.mark.parametrize("name", ["model.npy", "model.las", "model.e57"])
def test_models_of_other_programs_are_refused_with_a_way_on(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"LASF")
    with pytest.raises(
        ConfigurationError,
        match=r"files cannot be read; allowed are PLY, PCD, or "
        r"text .*: ",
    ):
        TargetModel.from_file(tmp_path / name)


def test_a_model_beyond_the_bound_says_what_to_subtract(rng: np.random.Generator) -> None:
    points, _ = surface(rng)
    with pytest.raises(ConfigurationError, match="subtract their middle, about 512000 5403000 1"):
        TargetModel.from_cloud(points + np.array([512_000.0, 5_403_000.0, 0.0]))
