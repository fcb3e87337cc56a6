"""The coarse approach: ranges of the Doppler log, the plane through them, and where the vehicle
goes on its word.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv.controllers.planning.ground_approach import GroundApproach
from uuv.models.site.seabed import Seabed, seabed
from uuv.perception.navigation.ground_plane import GroundPlaneEstimator, plane_through
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import DvlRangesMeasurement, Measurement, StateEstimate
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points
from uuv.sim.sensors.dvl_ranges import DvlBeams, DvlRanges

P_BD = np.array([-0.7, 0.1, -0.4])
X_WB = pose(exp_so3([0.03, -0.05, 0.8]), [0.2, -0.1, -6.1])
BOX = np.array([[-0.8, -0.5, -0.4], [0.8, 0.5, 0.4]])
NO_NOISE = DvlBeams(noise=0.0, dropouts=0.0)
ZERO = np.zeros(3)
ESTIMATE = StateEstimate(
    time=0.0,
    X_WB=X_WB,
    v_WB_B=ZERO,
    w_WB_B=ZERO,
    a_WB_B=ZERO,
    q=np.zeros(6),
    qd=np.zeros(6),
    tau=np.zeros(6),
)


def slope(sx: float, sy: float) -> Seabed:
    """A plane that rises by `sx` and `sy` per metre."""
    x = np.linspace(-4.0, 4.0, 41)
    heights = sx * x[None, :] + sy * x[:, None]
    return Seabed(
        kind="slope",
        heights=heights,
        half=4.0,
        center_W=np.array([0.0, 0.0, -10.0]),
        rocks=np.zeros((0, 3)),
    )


def pings(ground: Seabed, beams: DvlBeams, count: int, seed: int = 0) -> list[DvlRangesMeasurement]:
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="hull", pos=X_WB[:3, 3])
    ground.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hull = model.body("hull").id
    data.xpos[hull], data.xmat[hull] = X_WB[:3, 3], X_WB[:3, :3].ravel()
    sensor = DvlRanges.on(model, "hull", P_BD, beams)
    state = sensor.init(np.random.default_rng(seed))
    measured = []
    for i in range(count):
        state, measurement = sensor.step(state, data)
        measured.append(replace(measurement, time=0.1 * i))
    return measured


@dataclass(frozen=True)
class Still:
    """An estimator that believes in one place."""

    period: float = 0.002

    def init(self, first: object) -> None:
        del first

    def step(self, state: None, measurements: list[Measurement]) -> tuple[None, StateEstimate]:
        return state, replace(ESTIMATE, time=max((m.time for m in measurements), default=0.0))


def estimate(ground: Seabed, beams: DvlBeams, count: int = 10, seed: int = 0) -> StateEstimate:
    """After `count` pings over `ground`."""
    below = GroundPlaneEstimator(untyped(Still()))
    state = below.init([])
    estimated = ESTIMATE
    for ping in pings(ground, beams, count, seed):
        state, estimated = below.step(state, [ping])
    return estimated


def level(X: Array) -> Array:
    """The pose upright, its heading and place kept."""
    return pose(exp_so3([0.0, 0.0, np.arctan2(X[1, 0], X[0, 0])]), X[:3, 3])


def test_ranges_end_on_the_ground(within):
    ground = seabed("ripples", np.random.default_rng(3), center_W=(0.0, 0.0, -10.0), half=4.0)
    ping = pings(ground, NO_NOISE, 1)[0]
    ends = transform_points(X_WB, P_BD + ping.ranges[:, None] * ping.axes_B)
    within("off the ground [m]", ends[:, 2] - ground.height(ends), 1e-4)  # float32 rays
    within("slant", ping.axes_B[:, 2] + np.cos(NO_NOISE.slant), 1e-12)


def test_the_plane_of_a_slope_is_found_exactly_without_noise(within):
    ground = slope(0.2, -0.1)
    for dead in ((), (2,)):  # four beams, and three
        plane = estimate(ground, replace(NO_NOISE, dead=dead)).ground
        assert plane is not None
        assert plane.beams == 4 - len(dead)
        assert plane.silent == dead
        true = np.array([-0.2, 0.1, 1.0])
        within("normal", plane.normal_W - true / np.linalg.norm(true), 1e-5)
        within("point [m]", plane.p_W[2] - ground.height(plane.p_W), 1e-4)
        within("scatter [m]", plane.scatter, 1e-4)


def test_noise_and_dropouts_average_out(within, rng):
    """1 % of 4 m, a median of ten pings: 1.6 cm a beam, and over four of them some 1.3 deg of
    slope: 7 sigma.
    """
    ground = slope(0.1, 0.15)
    plane = estimate(ground, DvlBeams(dropouts=0.1), seed=int(rng.integers(2**31))).ground
    assert plane is not None
    assert plane.beams == 4
    within("height [m]", plane.p_W[2] - ground.height(plane.p_W), 0.08)
    true = np.array([-0.1, -0.15, 1.0])
    cosine = plane.normal_W @ true / np.linalg.norm(true)
    within("angle [deg]", np.degrees(np.arccos(min(1.0, cosine))), 5.0)


def test_the_hull_goes_to_its_height_over_the_plane(within):
    ground = slope(0.2, -0.1)
    near = GroundApproach(height=2.5, hull_box=BOX).pose(estimate(ground, NO_NOISE), level(X_WB))
    within("place and heading", (near - level(X_WB))[:, :3], 1e-12)
    within("aside [m]", near[:2, 3] - X_WB[:2, 3], 1e-12)
    within("height [m]", near[2, 3] - ground.height(near[:3, 3]) - 2.5, 1e-4)


def test_all_of_the_hull_keeps_clear_of_a_slope(within):
    ground = slope(0.6, 0.0)
    approach = GroundApproach(height=1.2, hull_box=BOX, clearance=1.0)
    near = approach.pose(estimate(ground, NO_NOISE), level(X_WB))
    corners = transform_points(near, np.array(np.meshgrid(*BOX.T)).reshape(3, -1).T)
    gaps = (corners[:, 2] - ground.height(corners)) / np.hypot(1.0, 0.6)
    within("least gap [m]", gaps.min() - 1.0, 1e-4)


@pytest.mark.parametrize(
    ("sea", "beams", "said"),
    [
        pytest.param(
            slope(0.0, 0.0),
            DvlBeams(dead=(1, 3)),
            "2 of the Doppler log's beams have an echo, but at least 3, .* silent: 1, 3",
        ),
        pytest.param(
            slope(0.0, 0.0), DvlBeams(dropouts=1.0), "0 of the Doppler log's beams have an echo"
        ),
        pytest.param(slope(0.8, 0.0), NO_NOISE, "slope of the ground is 39 deg"),
    ],
    ids=["two dead beams", "nothing heard", "too steep"],
)
def test_it_stays_where_the_plane_is_unknown_or_too_steep(sea, beams, said):
    with pytest.raises(ReachError, match=said):
        GroundApproach(height=2.5, hull_box=BOX).pose(estimate(sea, beams), level(X_WB))


def test_it_stays_without_ranges_of_late():
    approach = GroundApproach(height=2.5, hull_box=BOX)
    with pytest.raises(ReachError, match="no ranges for 1 s"):
        approach.pose(ESTIMATE, level(X_WB))
    old = estimate(slope(0.0, 0.0), NO_NOISE)
    with pytest.raises(ReachError, match="no ranges for 1 s"):
        approach.pose(replace(old, time=old.time + 1.1), level(X_WB))


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match="on a line"):
        plane_through(np.outer(np.arange(4.0), [1.0, 2.0, 0.5]))
    with pytest.raises(ConfigurationError, match="3 finite points"):
        plane_through(np.zeros((2, 3)))
    with pytest.raises(ConfigurationError, match="dead beams must be 1 to 4"):
        DvlBeams(dead=(5,))
    with pytest.raises(ConfigurationError, match="ground approach height: must be > 0"):
        GroundApproach(height=0.0, hull_box=BOX)
