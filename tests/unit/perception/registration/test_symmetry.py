"""The turn about a declared axis: told by a part in view that breaks the symmetry, else said to be unknown."""

from dataclasses import replace

import numpy as np
import pytest

from depth_scenes import look, seen_from
from models.objects.barrel import barrel
from perception.clouds.scan import Scan, SensorModel
from perception.registration.evidence import Evidence
from perception.registration.identification import identify
from perception.registration.model_surface import ModelSurface
from perception.registration.symmetry import asymmetric_parts, resolve_symmetry
from sim.interfaces.spatial import exp_so3

VIEW = seen_from(np.array([0.1, -0.9, 0.75]))
SEEN, HIDDEN = np.deg2rad(40.0), np.deg2rad(200.0)  # towards the camera, and away from it


WITHOUT = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_result_tells_how_it_came_about"
)


@pytest.mark.parametrize(
    ("azimuth", "off"), [(SEEN, 0.3), (SEEN - 0.4, -2.0), (HIDDEN, 0.3), pytest.param(None, 0.3, marks=WITHOUT)]
)
def test_a_bung_in_view_tells_the_turn_and_nothing_else_does(azimuth: float | None, off: float, within):
    target = barrel(bung_azimuth=azimuth)
    scan = Scan.from_depth(look(target, VIEW, np.random.default_rng(3)))
    prior = VIEW[:3, :3] @ exp_so3([off, 0.1, 0.1])
    found = identify(scan, target, VIEW[:3, 3] + 0.1, prior)
    assert found.accepted, found.reason
    R_error = VIEW[:3, :3].T @ found.X_sensor_target[:3, :3]
    if azimuth in (None, HIDDEN):
        assert not found.symmetry.angle_known
        assert "nearest to the coarse orientation" in found.symmetry.policy
        within("turn from the prior [rad]", np.arccos(0.5 * (np.trace(R_error) - 1.0)) - abs(off), 0.2)
    else:
        assert found.symmetry.angle_known
        assert "told" in found.symmetry.policy
        within("turn [deg]", np.rad2deg(np.arccos(0.5 * (np.trace(R_error) - 1.0))), 2.0)  # 0.4


def test_two_thirds_of_a_bung_are_none():
    """Where every third column shows a bare body, the bung explains the scan better than that, and yet is not there."""
    target, rng = barrel(bung_azimuth=SEEN), np.random.default_rng(3)
    whole, bare = (look(each, VIEW, rng, noise=None, floor=False) for each in (target, barrel()))
    depth = np.array(whole.depth)
    depth[:, ::3] = bare.depth[:, ::3]
    surface = ModelSurface.of(target)
    told = []
    for image in (whole, replace(whole, depth=depth)):
        scan = Scan.from_depth(image)
        mask = np.isfinite(image.depth)
        told.append(resolve_symmetry(Evidence.of(scan, mask, 0.8 * surface.spacing, SensorModel()), surface, VIEW))
    assert told[0] is not None
    assert told[1] is None


def test_a_bung_stands_out_and_a_whole_barrel_has_nothing_that_does():
    assert not len(asymmetric_parts(ModelSurface.of(barrel())))
    parts = asymmetric_parts(ModelSurface.of(barrel(bung_azimuth=0.5 * np.pi)))
    assert len(parts) > 50
    assert np.all(parts[:, 1] < -0.29)
    assert np.all(np.hypot(parts[:, 0] - 0.15, parts[:, 2]) < 0.036)
