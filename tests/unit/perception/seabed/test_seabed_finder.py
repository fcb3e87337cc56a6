"""The finder of seabed work on pings of the simulated sonar: what it finds, and what it refuses."""

import mujoco
import numpy as np
import pytest

from at_rest import at_rest
from untyped import untyped
from uuv.models.site.seabed import Seabed, seabed
from uuv.perception.seabed.relief import ReliefLimits
from uuv.perception.seabed.seabed_finder import SeabedFinder, points_in_world
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import ImuMeasurement, SonarScan, Target
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points
from uuv.sim.sensors.sonar import Sonar, SonarBeams

X_WB = pose(exp_so3([0.0, 0.0, 0.7]), [1.0, -2.0, -17.5])
X_BS = pose(np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), [0.7, 0.0, -0.4])
B_W = transform_points(X_WB, np.array([[0.5, -0.15, 0.0], [0.5, 0.15, 0.0]]))
ESTIMATE = at_rest(time=3.0, X_WB=X_WB)
BEAMS = SonarBeams(rows=80, columns=80, elevation=np.radians(80.0), azimuth=np.radians(80.0))


def ping(ground: Seabed, seed: int, **sonar: object) -> SonarScan:
    spec = mujoco.MjSpec()
    ground.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    points = Sonar(model, "world", X_WB @ X_BS, beams=BEAMS, **untyped(sonar)).ping(
        data, np.random.default_rng(seed)
    )
    return SonarScan(time=3.0, points=points, X_BS=X_BS)


def ground(kind: str = "ripples", seed: int = 1) -> Seabed:
    return seabed(untyped(kind), np.random.default_rng(seed), center_W=(1.0, -2.0, -20.0), half=2.5)


def find(finder: SeabedFinder, scan: SonarScan) -> Target:
    target = finder.step(finder.init(), ESTIMATE, scan)[1]
    assert target is not None
    return target


@pytest.mark.parametrize("kind", ["flat", "ripples", "slope"])
def test_the_path_lies_on_the_true_seabed(kind):
    """Within 1 cm + 0.5 % of the range of 2.6 m, as wanted; 8 mm were seen."""
    true = ground(kind)
    target = find(SeabedFinder(B_W), ping(true, 5))
    assert target.accepted, target.reason
    assert target.path is not None
    off = np.abs(target.path.p[:, 2] - true.height(target.path.p))
    assert np.quantile(off, 0.95) < 0.01 + 0.005 * target.range_m
    assert np.linalg.norm(target.path.p[-1, :2] - B_W[1, :2]) < 2e-3
    assert target.ground is not None
    near = np.hypot(*(target.ground[:, :2] - B_W[0, :2]).T) < 1.0
    assert near.sum() > 200


def test_points_are_where_the_sonar_saw_them(within):
    true = ground("slope")
    points = points_in_world(X_WB, ping(true, 6, noise=None))
    assert len(points) > 4000
    off = points[:, 2] - true.height(points)  # beside the terrain NaN
    within("off the surface [m]", np.nanquantile(np.abs(off), 0.95), 2.5e-3)


def test_a_core_goes_against_the_direction_given(within):
    up = np.array([0.1, -0.05, 1.0])
    target = find(SeabedFinder(B_W[:1], up, core_depth=0.15), ping(ground("flat"), 7))
    assert target.path is not None
    unit = up / np.linalg.norm(up)
    within("tool axis", target.path.z + unit, 1e-12)
    within("way [m]", target.path.p[-1] - target.path.p[0] + 0.15 * unit, 1e-12)
    within("square", np.sum(target.path.x * target.path.z, axis=1), 1e-12)
    within("under B [m]", np.linalg.norm(np.cross(target.path.p[0] - B_W[0], unit)), 1e-9)


def blind(scan: SonarScan, hidden: np.ndarray) -> SonarScan:
    points = np.array(scan.points)
    points[hidden] = np.nan
    return SonarScan(time=scan.time, points=points, X_BS=scan.X_BS)


def test_what_shows_no_seabed_is_refused_with_the_reason():
    scan = ping(ground(), 8)
    finder = SeabedFinder(B_W)
    everything = np.ones(scan.points.shape[:2], dtype=bool)
    assert "0 points show no surface" in find(finder, blind(scan, everything)).reason
    at = transform_points(X_WB @ X_BS, np.nan_to_num(scan.points).reshape(-1, 3)).reshape(
        scan.points.shape
    )
    near = np.hypot(at[..., 0] - B_W[0, 0], at[..., 1] - B_W[0, 1]) < 0.35
    refused = find(finder, blind(scan, near))
    assert not refused.accepted
    assert refused.path is None
    assert "B_1" in refused.reason
    steep = find(SeabedFinder(B_W, limits=ReliefLimits(roughness=1e-4)), scan)
    assert "roughness" in steep.reason


def test_a_cloud_that_is_given_is_believed():
    """The scan shows ripples, the cloud two layers."""
    rng = np.random.default_rng(9)
    xy = X_WB[:2, 3] + rng.uniform(-1.5, 1.5, (4000, 2))
    layers = np.column_stack([xy, -20.0 + 0.5 * (rng.random(4000) < 0.5)])
    refused = find(SeabedFinder(B_W, cloud_W=layers), ping(ground(), 10))
    assert "two surfaces, one above the other" in refused.reason


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match="targets B"):
        SeabedFinder(np.zeros((0, 3)))
    with pytest.raises(
        ConfigurationError, match="expected a SonarScan or a DepthImage, got ImuMeasurement"
    ):
        points_in_world(
            X_WB,
            ImuMeasurement(
                time=0.0, specific_force_B=np.zeros(3), w_WB_B=np.zeros(3), R_WB=np.eye(3)
            ),
        )
