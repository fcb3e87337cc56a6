"""An object whose pose is known: nothing looks for it, and the tool is led along its model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from uuv.models.objects.targets import barrel, block
from uuv.models.site.scenes import work_site
from uuv.own_vehicle import vehicle_spec
from uuv.perception.finding.surveyed_object import SURVEY_SIGMA, SurveyedObjectFinder
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage, StateEstimate, SurveyedPose
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, transform_points
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors.survey import Survey
from uuv.sim.water.current import Current
from uuv.site import KnownObject

ZERO = np.zeros(3)
AT_REST = StateEstimate(
    time=0.0,
    X_WB=pose(p=[0.0, 0.0, 1.0]),
    v_WB_B=ZERO,
    w_WB_B=ZERO,
    a_WB_B=ZERO,
    q=ZERO,
    qd=ZERO,
    tau=ZERO,
    position_sigma=np.full(3, 5e-4),
)
X_WT = pose(exp_so3([0.1, -0.05, 0.7]), [0.3, 0.2, -1.5])
SEEN = SurveyedPose(time=0.0, X_WT=X_WT)


@pytest.mark.parametrize("path", ["longitudinal", "transverse", "corner"])
def test_path_is_that_of_the_model(path: str, within):
    finder = SurveyedObjectFinder(barrel(), path)
    _, target = finder.step(finder.init(), AT_REST, SEEN)
    assert target is not None
    assert target.accepted
    assert target.path is not None
    p_T = transform_points(inverse(X_WT), target.path.p)
    radius = np.linalg.norm(p_T[:, 1:], axis=1)
    within("path off the barrel [m]", np.abs(radius - 0.3).max(), 2e-4)
    assert np.diff(target.path.s) == pytest.approx(target.path.s[1], rel=1e-6)
    assert not target.path.on_scan.any()


def test_its_doubt_is_that_of_the_hull():
    finder = SurveyedObjectFinder(block(), "edge")
    _, near = finder.step(finder.init(), AT_REST, SEEN)
    _, doubtful = finder.step(
        finder.init(), replace(AT_REST, position_sigma=np.full(3, 3e-3)), SEEN
    )
    assert near is not None
    assert near.covariance is not None
    assert doubtful is not None
    assert doubtful.covariance is not None
    assert SURVEY_SIGMA < near.covariance.position_sigma < 2e-3
    assert doubtful.covariance.position_sigma > 3e-3


def test_sensor_tells_the_true_pose():
    model = hydrodynamics.compile(work_site(vehicle_spec("uuv_puma"), barrel(), X_WT))
    plant = Plant(model, current=Current(ZERO, timestep=model.opt.timestep))
    _, detection = Survey(model).step(None, plant.observe())
    assert pytest.approx(X_WT, abs=1e-9) == detection.X_WT


def test_other_measurements_and_worlds_are_refused():
    finder = SurveyedObjectFinder(barrel(), "corner")
    frame = DepthImage(time=0.0, depth=np.ones((2, 2)), K=np.eye(3), X_BC=np.eye(4))
    with pytest.raises(ConfigurationError, match="must be a SurveyedPose, got DepthImage"):
        finder.step(finder.init(), AT_REST, frame)
    with pytest.raises(ConfigurationError, match="has no body 'target'"):
        Survey(vehicle_spec("uuv_puma").compile())


def test_line_of_ones_own_over_an_object():
    target, name = KnownObject(object="rock", line=(-0.1, -0.05, 0.1, 0.08)).target(None)
    path = target.path(name)
    assert name == "over"
    assert path.p[0, :2] == pytest.approx([-0.1, -0.05], abs=1e-6)
    assert path.p[-1, :2] == pytest.approx([0.1, 0.08], abs=1e-6)


def test_line_over_a_mesh_avoids_its_hole(tmp_path: Path):
    trimesh.creation.torus(0.35, 0.1).export(tmp_path / "torus.stl")
    target, name = KnownObject(object=str(tmp_path / "torus.stl")).target(None)
    p = target.path(name).p
    ring = np.linalg.norm(p[:, :2], axis=1)
    assert np.abs(ring - 0.35).max() < 0.1
    assert np.ptp(p[:, 0]) == pytest.approx(0.3, abs=0.01)
    with pytest.raises(ConfigurationError, match=r"site\.object\.line = x0 y0 x1 y1"):
        KnownObject(object=str(tmp_path / "torus.stl"), length=2.0).target(None)
