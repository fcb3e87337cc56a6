"""Which of several objects it is: named, or refused with a reason; folders, twins, and what is not there."""

import numpy as np
import pytest

import perception
from models.meshes.ply_files import write_ply
from perception.registration.pose_check import MIN_MARGIN, Decision
from scenarios.object_scenes import object_scene, target_of
from scenarios.perception_studies.cloud_models import sampled_cloud
from sim.interfaces.errors import ConfigurationError
from untyped import untyped

NAMES = ("starfish", "valve", "manifold")


def recognised(scene, targets):
    return perception.recognise(scene.scan, targets, scene.approach, sensor=scene.sensor.model)


@pytest.mark.parametrize("name", NAMES)
def test_the_object_in_the_scene_is_named(name: str):
    scene = object_scene(name, 7000)
    made = recognised(scene, {each: target_of(each) for each in NAMES})
    assert made.name == name, made.reason
    assert made.accepted
    assert made.decision is Decision.ACCEPT
    assert scene.is_found(made.found.X_sensor_target)
    assert made.margin > MIN_MARGIN
    assert made.candidates[0].name == name
    assert {each.name for each in made.candidates} == set(NAMES)


def test_a_folder_of_meshes_and_clouds(tmp_path):
    scene = object_scene("starfish", 7000)
    for name in NAMES[:2]:
        target = target_of(name)
        write_ply(tmp_path / f"{name}.ply", target.vertices, target.triangles)
    write_ply(tmp_path / "plate.ply", sampled_cloud(target_of("plate"), 3000)[0])
    (tmp_path / "notes.md").write_text("no model")
    made = recognised(scene, tmp_path)
    assert made.name == "starfish", made.reason
    assert {each.name for each in made.candidates} == {"starfish", "valve", "plate"}


def test_twins_and_what_is_not_there_are_refused():
    scene = object_scene("starfish", 7000)
    twins = recognised(scene, {"one": target_of("starfish"), "other": target_of("starfish")})
    assert not twins.accepted
    assert "fits as well" in twins.reason
    assert twins.decision is Decision.RESCAN
    absent = recognised(scene, [target_of("valve"), target_of("manifold")])
    assert absent.name is None
    assert "none of 2 objects is accepted" in absent.reason
    assert absent.decision is not Decision.ACCEPT
    empty = perception.recognise(np.zeros((0, 3)), [target_of("valve")])
    assert not empty.accepted
    assert "empty" in empty.reason
    assert empty.margin == np.inf


def test_a_small_object_in_front_of_a_large_one_is_found_with_it():
    """Alone the valve is refused: of the surface that passes into it most is the barrel's."""
    scene = leaning_scene()
    found = perception.identify_together(scene.scan, scene.targets, scene.approaches, sensor=scene.sensor)
    for name, X_CT in scene.X_CT.items():
        assert found[name].accepted, (name, found[name].reason)
        position, angle = scene.targets[name].symmetry.error(found[name].X_sensor_target, X_CT)
        assert position < 0.005
        assert angle < np.deg2rad(3.0)


def test_targets_that_are_none_are_refused_in_a_line(tmp_path):
    cloud = np.zeros((0, 3))
    for targets, words in (
        ([], "at least one model is needed, got none"),
        ([target_of("valve"), target_of("valve")], "'valve' is there twice"),
        ({"a": 7}, "targets, a: target: expected a TargetModel"),
        (7, "expected several models, or the name of a folder, got 7"),
        (np.zeros((5, 3)), "expected several models"),
        (tmp_path, "no model in folder"),
        (str(tmp_path / "none"), "or the name of a folder, got"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            perception.recognise(cloud, untyped(targets))
