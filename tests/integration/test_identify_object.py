"""Finding an object in a cloud or a scene: what comes out, and inputs that end in one line."""

import json
import re

import numpy as np
import pytest

from uuv.clouds.object_scenes import object_scene
from uuv.models.objects import targets


@pytest.fixture(scope="module")
def scene():
    return object_scene("starfish", 1)


def test_a_cloud_with_blemishes_is_searched(verb, scene, tmp_path):
    points = scene.scan.points.reshape(-1, 3)[::7]
    points = points[np.isfinite(points).all(axis=1)]
    rows = np.vstack([points, points[:100], np.zeros((20, 3)), np.full((30, 3), np.nan)])
    np.savetxt(tmp_path / "cloud.xyz", 1e3 * rows, "%.2f")
    known = (
        "--object",
        "starfish",
        "--cloud",
        tmp_path / "cloud.xyz",
        "--approach",
        *scene.approach,
    )
    refused = verb("identify", "object", *known, "--out", tmp_path / "out")
    assert refused.returncode == 2
    assert "millimetres" in refused.stderr
    done = verb("identify", "object", *known, "--scale", 0.001, "--out", tmp_path / "out")
    assert done.returncode in (0, 1), done.stderr
    assert "not finite" in done.stdout
    found = json.loads((tmp_path / "out" / "identification.json").read_text("utf-8"))
    assert (done.returncode == 0) == (found["decision"] == "accept")
    assert len(found["notes"]) == 3
    for name in ("cloud.ply", "model.ply", "identification.png"):
        assert (tmp_path / "out" / name).stat().st_size > 5000


def test_object_and_cloud_in_different_units(verb, scene, tmp_path):
    np.savetxt(tmp_path / "cloud.xyz", 0.001 * scene.scan.points.reshape(-1, 3)[::50])
    done = verb(
        "identify",
        "object",
        "--object",
        "barrel",
        "--cloud",
        tmp_path / "cloud.xyz",
        "--out",
        tmp_path / "out",
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "--mesh-scale" in done.stderr


def test_objects_by_name_or_file(tmp_path):
    assert targets.of("rock").name == "rock"
    (tmp_path / "two.obj").write_text("v 0 0 0\nv 900 0 0\nv 0 900 0\nf 1 2 3\n", "utf-8")
    assert targets.of(str(tmp_path / "two.obj"), 0.001).radius < 1.0


@pytest.mark.long(
    guarded_by="tests/unit/perception/toolpath/test_deformation.py::test_growth_and_dent_are_found_as_they_are"
)
def test_deformed_object_is_mapped(verb, tmp_path):
    done = verb(
        "identify",
        "object",
        "--object",
        "rock",
        "--fouled",
        0.04,
        "--dented",
        0.03,
        "--out",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "identification.json").read_text("utf-8"))["deformation"]
    assert {np.sign(region["largest_m"]) for region in found["regions"]} == {1.0, -1.0}
    assert all(found["size_m"] < abs(region["largest_m"]) < 0.06 for region in found["regions"])
    assert "Deviation from the model above" in done.stdout
    for name in ("deformation.ply", "deformation.png"):
        assert (tmp_path / name).stat().st_size > 5000


@pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_recognition.py::test_the_object_in_the_scene_is_named"
)
def test_which_of_several_objects_it_is(verb, tmp_path):
    done = verb(
        "identify",
        "object",
        "--object",
        "starfish",
        "--among",
        "starfish",
        "valve",
        "--out",
        tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    said = json.loads((tmp_path / "identification.json").read_text())
    assert said["object"] == "starfish"
    assert [each["object"] for each in said["candidates"]] == ["starfish", "valve"]
    assert re.search(r"middle at \(.*\) m, standard deviation [\d.]+ mm", done.stdout)


def test_an_object_that_is_there_twice_is_refused(verb, tmp_path):
    refused = verb("identify", "object", "--among", "valve", "valve", "--out", tmp_path / "twice")
    assert refused.returncode == 2
    assert "got 'valve' twice" in refused.stdout + refused.stderr
