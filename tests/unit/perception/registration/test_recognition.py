"""Which of several objects it is: named, or refused with a reason; folders, twins, what is not
there; heaps.
"""

from dataclasses import replace

import numpy as np
import pytest

from experiments.identification.cloud_models import sampled_cloud
from untyped import untyped
from uuv import perception
from uuv.clouds.object_scenes import object_scene, target_of
from uuv.models.meshes.ply_files import write_ply
from uuv.perception.clouds.scan import KnownObjects, Scan, SensorModel
from uuv.perception.registration import identification
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.likelihood import log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import MIN_MARGIN, Decision
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose

NAMES = ("starfish", "valve", "manifold")
ANOTHER = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_recognition.py::test_the_object_in_the_scene_is_named"
)


def recognised(scene, targets):
    return perception.recognise(scene.scan, targets, scene.approach, sensor=scene.sensor.model)


@pytest.mark.parametrize(
    "name", ["starfish", *(pytest.param(name, marks=ANOTHER) for name in NAMES[1:])]
)
def test_the_object_in_the_scene_is_named(name: str):
    scene = object_scene(name, 7000)
    recognition = recognised(scene, {name_of: target_of(name_of) for name_of in NAMES})
    assert recognition.name == name, recognition.reason
    assert recognition.accepted
    assert recognition.decision is Decision.ACCEPT
    assert scene.is_found(recognition.found.X_sensor_target)
    assert recognition.margin > MIN_MARGIN
    assert recognition.candidates[0].name == name
    assert {candidate.name for candidate in recognition.candidates} == set(NAMES)


@ANOTHER
def test_a_folder_of_meshes_and_clouds(tmp_path):
    scene = object_scene("starfish", 7000)
    for name in NAMES[:2]:
        target = target_of(name)
        write_ply(tmp_path / f"{name}.ply", target.vertices, target.triangles)
    write_ply(tmp_path / "plate.ply", sampled_cloud(target_of("plate"), 3000)[0])
    (tmp_path / "notes.md").write_text("no model")
    recognition = recognised(scene, tmp_path)
    assert recognition.name == "starfish", recognition.reason
    assert {candidate.name for candidate in recognition.candidates} == {
        "starfish",
        "valve",
        "plate",
    }


@pytest.mark.long
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


def test_a_refusal_goes_on_from_what_was_searched(monkeypatch):
    """Where no object fits, all starts of each are tried; the likeliest of them are not searched a
    second time.
    """
    searched = []
    search = identification.likeliest_pose
    monkeypatch.setattr(
        identification,
        "likeliest_pose",
        lambda *args, **most: searched.append(most) or search(*args, **most),
    )
    monkeypatch.setattr(identification, "_REFINED_LATER", 10)  # which takes seconds
    scene = object_scene("starfish", 7000)
    thinned = scene.scan.part((slice(None, None, 8), slice(None, None, 8)))
    recognition = perception.recognise(
        thinned, [target_of("valve")], scene.approach, sensor=scene.sensor.model
    )
    assert not recognition.accepted
    assert searched == [{"most": identification.REFINED}, {"most": 10}]


def rendered(
    shown: dict[str, np.ndarray], surfaces: dict[str, ModelSurface], sensor: SensorModel
) -> Scan:
    """Scan of several objects at their poses X_ST (4, 4), with white noise."""
    tangent_x, tangent_y = (np.linspace(-0.5, 0.5, n) * (n - 1) / sensor.focal for n in (640, 480))
    grid = Scan.of_grid(np.ones((480, 640)), tangent_x, tangent_y)
    depth = np.fmin.reduce([surfaces[name].depth(X_ST, grid) for name, X_ST in shown.items()])
    noise = np.random.default_rng(0).normal(size=depth.shape) * sensor.sigma(depth)
    return Scan.of_grid(depth + noise, tangent_x, tangent_y)


def test_what_is_found_explains_its_part_of_the_scan():
    """An anode hides half of a manifold, which alone is found on the anode: a pixel shows one
    object only.
    """
    sensor = SensorModel(noise_length=1.0)
    surfaces = {name: ModelSurface.of(target_of(name)) for name in ("manifold", "anode")}
    X_manifold = pose(exp_so3([3.0, 0.25, 0.1]), [0.05, 0.0, 1.8])
    poses = {
        "manifold": X_manifold,
        "anode": pose(
            X_manifold[:3, :3] @ exp_so3([0.0, 0.0, 0.9]), X_manifold[:3, 3] - [0.0, 0.05, 0.12]
        ),
    }
    scan = rendered(poses, surfaces, sensor)
    approaches = {name: X[:3, 3] + [0.1, -0.05, 0.1] for name, X in poses.items()}
    identifications = perception.identify_together(scan, surfaces, approaches, sensor=sensor)
    for name, X_ST in poses.items():
        assert identifications[name].accepted, (name, identifications[name].reason)
        position, angle = surfaces[name].symmetry.error(identifications[name].X_sensor_target, X_ST)
        assert position < 0.005
        assert angle < np.deg2rad(3.0)
    with pytest.raises(ConfigurationError, match="no object is named 'barrel'"):
        perception.identify_together(scan, surfaces, {"barrel": np.zeros(3)}, sensor=sensor)


def test_a_known_object_hides_and_explains():
    """Where a known object stands the likelihood of another asks whether the other is nearer, and
    fits better there.
    """
    sensor = SensorModel(noise_length=1.0)
    surfaces = {name: ModelSurface.of(target_of(name)) for name in ("plate", "starfish")}
    R = exp_so3([3.0, 0.2, 0.0])
    poses = {"plate": pose(R, [0.0, 0.0, 1.6]), "starfish": pose(R, [0.0, 0.0, 1.5])}
    scan = rendered(poses, surfaces, sensor)
    depth = surfaces["plate"].depth(poses["plate"], scan)
    depth = np.where(np.isfinite(depth), depth, np.inf)
    known = replace(scan, known=KnownObjects(depth, np.abs(scan.depth - depth) < 0.02))
    mask = np.isfinite(scan.depth)
    alone, joint = (Evidence.of(scan_of, mask, 0.005, sensor) for scan_of in (scan, known))
    starfish = surfaces["starfish"]
    behind = pose(R, [0.0, 0.0, 2.0])
    assert log_likelihood(joint, starfish, poses["starfish"]) > 100.0
    assert log_likelihood(joint, starfish, behind) == 0.0
    on_plate = pose(R, [0.15, 0.1, 1.6])
    # the plate's face passes for the starfish
    assert log_likelihood(alone, starfish, on_plate) > 100.0
    assert log_likelihood(joint, starfish, on_plate) < 0.0


def test_targets_that_are_none_are_refused_in_a_line(tmp_path):
    cloud = np.zeros((0, 3))
    for targets, words in (
        ([], "must have at least one model, got none"),
        ([target_of("valve"), target_of("valve")], "'valve' occurs twice"),
        ({"a": 7}, "targets, a: target: expected a TargetModel"),
        (7, "must be several models, or the name of a folder, got 7"),
        (np.zeros((5, 3)), "must be several models"),
        (tmp_path, "has no model"),
        (str(tmp_path / "none"), "or the name of a folder, got"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            perception.recognise(cloud, untyped(targets))
