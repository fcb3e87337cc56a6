"""The papers' own fit: it comes to rest where it should, and asks for a new scan where it does
not.
"""

from dataclasses import replace

import numpy as np
import pytest

from depth_scenes import look
from untyped import untyped
from uuv.clouds.frames import camera_pose
from uuv.models.objects import targets
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import Decision
from uuv.perception.registration.published.paper_icp import laid_on, paper_fit
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points

VALVE = targets.named("valve")
SURFACE = ModelSurface.of(VALVE)
VIEW = camera_pose(VALVE.center + np.array([0.3, -0.5, 0.8]), VALVE.center)
MIDDLE = transform_points(VIEW, VALVE.center)
SCAN = Scan.from_depth(look(VALVE, VIEW, np.random.default_rng(0), floor=False))


def test_by_the_one_door(within):
    identification = identify(
        SCAN, SURFACE, MIDDLE, exp_so3([0.1, -0.1, 0.1]) @ VIEW[:3, :3], method="paper"
    )
    position, angle = VALVE.symmetry.error(identification.X_sensor_target, VIEW)
    within("position [m]", position, 0.02)  # 2 mm
    within("angle [rad]", angle, 0.1)
    assert position < 0.5 * VALVE.symmetry.error(identification.X_sensor_start, VIEW)[0]
    assert len(identification.hypotheses) == 1
    with pytest.raises(ConfigurationError, match="planes, paper"):
        identify(SCAN, SURFACE, method=untyped("guess"))


def test_pairs_from_scan_to_model_are_no_pairs_from_model_to_scan(within):
    """Both end near the object, at different poses, from an exact start."""
    poses = [
        identify(SCAN, SURFACE, MIDDLE, VIEW[:3, :3], method=method).X_sensor_target
        for method in ("paper", "paper-scan")
    ]
    for X in poses:
        within("position [m]", VALVE.symmetry.error(X, VIEW)[0], 0.02)
    assert not np.allclose(*poses, atol=1e-4)


def test_published_threshold_decides_in_place_of_the_check():
    """It accepts the right object near its place, and another one that our check refuses only if Q
    is small.
    """
    near = exp_so3([0.02, -0.02, 0.02]) @ VIEW[:3, :3]
    right = identify(SCAN, SURFACE, MIDDLE, near, method="paper-q")
    assert right.accepted
    assert right.check is not None
    assert right.check.figure_m <= right.check.threshold_m
    wrong = identify(SCAN, targets.named("rock"), MIDDLE, near, method="paper-q")
    assert wrong.check is not None
    assert wrong.decision is Decision.RESCAN
    assert wrong.check.figure_m > wrong.check.threshold_m
    assert "Q is" in wrong.reason or "error no longer falls" in wrong.reason


def test_whole_cloud_is_met_exactly(within):
    """A cloud that is the model's own points, moved: ICP from point to point ends on them."""
    identification = identify(SCAN, SURFACE, MIDDLE, VIEW[:3, :3])
    assert identification.evidence is not None
    whole = replace(identification.evidence, points=transform_points(VIEW, SURFACE.points))
    fit = paper_fit(whole, SURFACE, pose(exp_so3([0.003, 0.0, 0.003]), [0.0, 0.0, 0.0]) @ VIEW)
    within("pose", fit.X_ST - VIEW, 1e-9)
    within("error [m]", fit.error, 1e-9)
    within("middle on middle", laid_on(whole.points, SURFACE, VIEW[:3, :3]) - VIEW, 1e-9)


def test_no_further_fall_of_the_error_asks_for_a_new_scan():
    """A sensor that claims to be exact, and an object that is not the one looked for."""
    exact = SensorModel(disparity_sigma=0.01)
    identification = identify(
        SCAN, targets.named("rock"), MIDDLE, VIEW[:3, :3], sensor=exact, method="paper"
    )
    assert identification.evidence is not None
    fit = paper_fit(
        identification.evidence, identification.surface, np.array(identification.X_sensor_start)
    )
    assert fit.error > fit.required
    assert identification.decision is not Decision.ACCEPT
