"""Hull placement for an arm of four joints, which the hull carries along the path."""

from itertools import pairwise

import numpy as np
import pytest

from uuv import models
from uuv.controllers.mkps import Chain, solve
from uuv.controllers.planning.arm_margins import TILT, posture_for
from uuv.controllers.planning.arm_size import size
from uuv.controllers.planning.carried_arm import HULL_JOINTS, CarriedArm, hull_pose, with_hull
from uuv.controllers.planning.hull_path import hull_gap
from uuv.controllers.planning.path_poses import middle_part, tool_pose
from uuv.controllers.planning.placement import Placement, PlacementSearch, Surroundings
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.objects.targets import barrel
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, log_so3, pose, transform_points

MODEL = models.load("bluerov2_heavy_alpha5").compile()
VEHICLE = Vehicle.of(MODEL)
CHAIN = Chain.from_mjcf(MODEL, ARM_BASE_BODY, TIP_SITE)
BOX = np.array([[-0.23, -0.29, -0.13], [0.23, 0.29, 0.13]])  # [m] of the hull
STANDOFF, FORCE = 0.04, 8.0  # [m], [N]


def placed(path: ToolPath, obstacle: Array, force: float = FORCE) -> Placement:
    search = PlacementSearch.of_size(size(CHAIN))
    around = Surroundings(obstacle=obstacle, hull_box=BOX)
    arm = CarriedArm(
        vehicle=VEHICLE,
        chain=CHAIN,
        around=around,
        force=force,
        standoff=STANDOFF,
        search=search,
        holding=None,
    )
    return arm.place(path)


def on_barrel(name: str) -> tuple[ToolPath, Array]:
    """Middle half of a path on a barrel, and the barrel's points; no level hull can follow half a
    turn about it.
    """
    target = barrel()
    X_WT = pose(exp_so3([0.0, 0.0, 0.7]), [0.4, 0.2, -2.0])
    line = target.path(name)
    R = X_WT[:3, :3]
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.p, axis=0), axis=1))])
    p = transform_points(X_WT, line.p)
    on_scan = np.ones(len(s), dtype=bool)
    path = ToolPath(s=s, p=p, z=line.a @ R.T, x=line.b @ R.T, on_scan=on_scan)
    return middle_part(path, 0.5), transform_points(X_WT, target.vertices)


@pytest.fixture(scope="module", params=["longitudinal", "transverse"])
def work(request: pytest.FixtureRequest) -> tuple[ToolPath, Array, Placement]:
    """A path on the barrel, the barrel's points, and the placement."""
    path, obstacle = on_barrel(request.param)
    return path, obstacle, placed(path, obstacle)


def test_hull_and_arm_are_one_chain(rng, within):
    whole = with_hull(CHAIN, VEHICLE.X_BA)
    for _ in range(20):
        joints = np.concatenate([rng.normal(size=HULL_JOINTS), rng.uniform(*VEHICLE.q_limits.T)])
        expected = hull_pose(joints) @ VEHICLE.X_BA @ CHAIN.forward(joints[HULL_JOINTS:])
        within("tip of hull and arm [m]", whole.forward(joints) - expected, 1e-12)


def test_the_arm_puts_the_tool_on_the_path_everywhere(work, within):
    path, _, placement = work
    q = placement.q_start
    off = []
    for share in np.linspace(0.0, 1.0, 41):
        X_WG = tool_pose(path, share * float(path.s[-1]), placement.roll)[0]
        posture = posture_for(CHAIN, inverse(placement.hull_at(share) @ VEHICLE.X_BA) @ X_WG, q)
        q = posture.q
        off.append(posture.position_error)
        assert posture.orientation_error < TILT
        assert np.all((q > VEHICLE.q_limits[:, 0]) & (q < VEHICLE.q_limits[:, 1]))
    within("tool off the path [m]", max(off), 1e-6)


def test_the_hull_keeps_clear_level_and_moves_smoothly(work):
    path, obstacle, placement = work
    shares = np.linspace(0.0, 1.0, 201)
    poses = [placement.hull_at(share) for share in shares]
    least = min(hull_gap(X, BOX, obstacle) for X in poses[::20])
    assert least > 0.9 * PlacementSearch.of_size(size(CHAIN)).clearance
    assert all(X[2, 2] == pytest.approx(1.0, abs=1e-12) for X in poses)
    way = np.linalg.norm(np.diff([X[:3, 3] for X in poses], axis=0), axis=1)
    assert way.max() < 4.0 * way.mean() + 1e-4  # no point of the path has a place of its own
    turned = [np.linalg.norm(log_so3(a[:3, :3].T @ b[:3, :3])) for a, b in pairwise(poses)]
    assert max(turned) < 0.05
    rate = (placement.hull_at(0.501)[:3, 3] - placement.hull_at(0.499)[:3, 3]) / 0.002
    assert placement.hull_rate(0.5) == pytest.approx(rate, abs=1e-3 * float(path.s[-1]))


def test_a_force_beyond_the_drives_is_refused_with_the_joint():
    path, obstacle = on_barrel("longitudinal")
    with pytest.raises(ReachError, match=r"joint\d .*(limit|bear)"):
        placed(path, obstacle, force=400.0)


def test_hull_and_arm_of_four_joints_meet_position_and_axis_of_poses_near_by(rng):
    """Random tool poses before a hull that may move: met in position and axis by hull and arm
    together.
    """
    whole, low, high = with_hull(CHAIN, VEHICLE.X_BA), *VEHICLE.q_limits.T
    off, moved = [], []
    for _ in range(40):
        q = low + (0.2 + 0.6 * rng.random(4)) * (high - low)
        configuration = np.concatenate([rng.uniform(-1.0, 1.0, 3), [rng.uniform(-1.0, 1.0)], q])
        start = np.concatenate([np.zeros(HULL_JOINTS), VEHICLE.q_ready])
        solution = solve(whole, whole.forward(configuration), start, 1e-5, 1e-3, "priority")
        off.append(not solution.converged)
        moved.append(float(np.linalg.norm(solution.q[:3])))
    assert np.mean(off) <= 0.1
    assert np.median(moved) < 2.0
