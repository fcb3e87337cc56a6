"""Turns about a declared axis: nothing to search; told by a part in view that breaks the symmetry,
else unknown.
"""

from dataclasses import replace

import numpy as np
import pytest

from depth_scenes import look
from untyped import untyped
from uuv.clouds.frames import camera_pose
from uuv.models.meshes.closed_shells import revolve
from uuv.models.objects.barrel import barrel
from uuv.models.objects.target_model import Symmetry, TargetModel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration import symmetry
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.symmetry import ambiguous_poses, asymmetric_parts, resolve_symmetry
from uuv.sim.interfaces.spatial import exp_so3

VIEW = camera_pose(np.array([0.1, -0.9, 0.75]))
SEEN, HIDDEN = np.deg2rad(40.0), np.deg2rad(200.0)  # towards the camera, and away from it


TURNED = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_symmetry.py::test_a_bung_in_view_tells_the_turn_and_nothing_else_does"
)
WITHOUT = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_result_tells_how_it_came_about"
)


@pytest.mark.parametrize(
    ("azimuth", "off"),
    [
        (SEEN, 0.3),
        pytest.param(SEEN - 0.4, -2.0, marks=TURNED),
        (HIDDEN, 0.3),
        pytest.param(None, 0.3, marks=WITHOUT),
    ],
)
def test_a_bung_in_view_tells_the_turn_and_nothing_else_does(
    azimuth: float | None, off: float, within
):
    target = barrel(bung_azimuth=azimuth)
    scan = Scan.from_depth(look(target, VIEW, np.random.default_rng(3)))
    prior = VIEW[:3, :3] @ exp_so3([off, 0.1, 0.1])
    identification = identify(scan, target, VIEW[:3, 3] + 0.1, prior)
    assert identification.accepted, identification.reason
    R_error = VIEW[:3, :3].T @ identification.X_sensor_target[:3, :3]
    if azimuth in (None, HIDDEN):
        assert not identification.symmetry.angle_known
        assert "nearest to the coarse orientation" in identification.symmetry.policy
        within(
            "turn from the prior [rad]", np.arccos(0.5 * (np.trace(R_error) - 1.0)) - abs(off), 0.2
        )
    else:
        assert identification.symmetry.angle_known
        assert "resolved" in identification.symmetry.policy
        within("turn [deg]", np.rad2deg(np.arccos(0.5 * (np.trace(R_error) - 1.0))), 2.0)  # 0.4


def test_two_thirds_of_a_bung_are_none():
    """Where every third column shows a bare body, the bung explains the scan better than that, and
    yet is not there.
    """
    target = barrel(bung_azimuth=SEEN)
    rng = np.random.default_rng(3)
    whole, bare = (
        look(target_of, VIEW, rng, noise=None, floor=False) for target_of in (target, barrel())
    )
    depth = np.array(whole.depth)
    depth[:, ::3] = bare.depth[:, ::3]
    surface = ModelSurface.of(target)
    turns = []
    for image in (whole, replace(whole, depth=depth)):
        scan = Scan.from_depth(image)
        mask = np.isfinite(image.depth)
        turns.append(
            resolve_symmetry(
                Evidence.of(scan, mask, 0.8 * surface.spacing, SensorModel()), surface, VIEW
            )
        )
    assert turns[0] is not None
    assert turns[1] is None


def test_a_bung_stands_out_and_a_whole_barrel_has_nothing_that_does():
    assert not len(asymmetric_parts(ModelSurface.of(barrel())))
    parts = asymmetric_parts(ModelSurface.of(barrel(bung_azimuth=0.5 * np.pi)))
    assert len(parts) > 50
    assert np.all(parts[:, 1] < -0.29)
    assert np.all(np.hypot(parts[:, 0] - 0.15, parts[:, 2]) < 0.036)


def drum(R: np.ndarray) -> ModelSurface:
    """A drum that lies askew in its frame; its axis is declared, that it may be turned end to end
    is not.
    """
    vertices, triangles = revolve([[-0.2, 0.0], [-0.2, 0.19], [0.2, 0.19], [0.2, 0.0]], 48)
    vertices = vertices @ R.T + [0.1, -0.2, 0.3]
    declared = Symmetry(axis=R[:, 0], center=np.array([0.1, -0.2, 0.3]))
    return ModelSurface.of(
        TargetModel(name="drum", vertices=vertices, triangles=triangles, symmetry=declared)
    )


def test_a_declared_axis_is_not_searched_and_the_answer_is_that_of_the_search(monkeypatch):
    """What the declaration answers is passed over: a drum's poses that look alike are those found
    by turning it too.
    """
    surface = drum(exp_so3([0.3, -0.5, 0.8])).thinned(1500)
    settled = symmetry._settled
    turns = []
    monkeypatch.setattr(symmetry, "_settled", lambda *args: turns.append(1) or settled(*args))
    passed_over = untyped(ambiguous_poses).__wrapped__(surface)
    tried = len(turns)
    monkeypatch.setattr(symmetry, "_is_declared", lambda *_: False)
    searched = untyped(ambiguous_poses).__wrapped__(surface)
    assert len(passed_over) > 0
    assert np.array_equal(passed_over, searched)
    assert len(turns) - tried > 5 * tried  # 215 and 43


def test_what_a_model_looks_like_is_worked_out_once():
    """Surfaces of the same content are equal, another symmetry or a vertex that is off makes
    another one.
    """
    surface, same = drum(np.eye(3)), drum(np.eye(3))
    assert surface == same
    assert asymmetric_parts(surface) is asymmetric_parts(same)
    moved = np.array(surface.target.vertices)
    moved[0, 0] += 1e-9
    others = [
        replace(surface, symmetry=Symmetry()),
        replace(surface, target=replace(surface.target, vertices=moved)),
        replace(surface, points=surface.points[1:], normals=surface.normals[1:]),
        ModelSurface.of(surface.target, seed=1),
    ]
    assert surface not in others
    assert surface != surface.target
