"""Starts when nothing is known beforehand: the true pose is among them, whatever frame the model is
given in.
"""

import numpy as np
import pytest

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.objects import targets
from uuv.models.objects.target_model import TargetModel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.identification import identify
from uuv.perception.registration.initialiser import Expected, _patches, initial_poses
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points

VALVE = targets.named("valve")
VIEW = camera_pose(np.array([0.3, -0.8, 0.6]))


def test_an_exact_look_is_explained_best_by_the_true_pose(within):
    scan = Scan.from_depth(look(VALVE, VIEW, np.random.default_rng(0), noise=None, floor=False))
    for turn in (np.zeros(3), np.array([0.3, -2.0, 1.0])):
        G = pose(exp_so3(turn), [0.1, -0.2, 0.3])  # the same valve, drawn in another frame
        target = TargetModel(
            name="v", vertices=transform_points(G, VALVE.vertices), triangles=VALVE.triangles
        )
        surface = ModelSurface.of(target)
        first, *others = initial_poses(scan, scan.depth > 0.0, surface, SensorModel(), Expected())
        apart = first @ G
        # 3 mm: a start, not a fit
        within("position [m]", np.linalg.norm((apart - VIEW)[:3, 3]), 0.04)
        within("attitude", np.linalg.norm((apart - VIEW)[:3, :3]), 0.3)  # 0.02
        for other in others:
            position, angle = target.symmetry.error(other, first)
            assert position > 0.01 or angle > np.deg2rad(5.0)


MORE = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_initialiser.py::test_found_among_stones_with_nothing_known"
)


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("starfish", 1),
        pytest.param("manifold", 3, marks=MORE),
        pytest.param("valve", 4, marks=MORE),
        pytest.param("rock", 2, marks=MORE),
        ("barrel", 2),
    ],
)
def test_found_among_stones_with_nothing_known(within, name: str, seed: int):
    from uuv.clouds.object_scenes import object_scene

    scene = object_scene(name, seed)
    identification = identify(scene.scan, scene.target, sensor=scene.sensor.model)
    position, angle = scene.error(identification.X_sensor_target)
    assert identification.accepted, identification.reason
    within("position, of range", position / scene.range_m, 0.01)  # 0.15 %
    within("attitude [deg]", np.rad2deg(angle), 5.0)  # 1 deg


def test_a_plate_without_thickness_is_seen_from_no_edge():
    corners = np.array(
        [[-0.2, -0.1, 0], [0.2, -0.1, 0], [0.2, 0.1, 0], [-0.2, 0.1, 0], [0.3, 0.0, 0.1]]
    )
    plate = TargetModel(
        name="plate", vertices=corners, triangles=np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2]])
    )
    scan = Scan.from_depth(look(plate, VIEW, np.random.default_rng(0), floor=False))
    starts = initial_poses(
        scan, scan.depth > 0.0, ModelSurface.of(plate), SensorModel(), Expected()
    )
    assert starts
    assert np.all(np.isfinite(starts))


def test_a_ring_about_nothing_is_no_empty_patch():
    """The middle of a ring much larger than the object lies far from all its points."""
    rng = np.random.default_rng(5)
    angle = rng.uniform(0.0, 2.0 * np.pi, 3000)
    ring = 0.25 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]) + [0.1, 0.2, 1.0]
    # neighbours closer than half the object's radius: one surface
    patches = _patches(ring + rng.normal(0.0, 1e-3, ring.shape), 0.05, Expected())
    assert patches
    assert min(len(patch) for patch in patches) > 0
