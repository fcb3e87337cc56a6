"""The height of work over a seabed: every pose checked again by kinematics, and against the ground
point by point.
"""

import numpy as np
import pytest

from uuv import models
from uuv.controllers.mkps import Chain, solve
from uuv.controllers.planning.path_poses import tool_pose
from uuv.controllers.planning.seabed_height import (
    HeightSearch,
    choose_height,
    jet_shear,
    silt_height,
)
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.site.seabed import seabed
from uuv.models.vehicle import Vehicle
from uuv.perception.seabed.terrain_path import core_path
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, readonly

SEARCH = HeightSearch(jets_above=0.4)
HULL_BOX = np.array([[-0.8, -0.45, -0.4], [0.8, 0.45, 0.4]])


@pytest.fixture(scope="module")
def own():
    model = models.load("uuv_puma").compile()
    return Vehicle.of(model), Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=["pad"])


def straight(start, end):
    s = np.linspace(0.0, np.linalg.norm(np.subtract(end, start)), 40)
    x = np.subtract(end, start) / s[-1]
    ones = np.ones((len(s), 1))
    scanned = np.ones(len(s), dtype=bool)
    return ToolPath(
        s=readonly(s),
        p=readonly(np.asarray(start) + s[:, None] * x),
        z=readonly(ones * [0.0, 0.0, -1.0]),
        x=readonly(ones * x),
        on_scan=scanned,
    )


def core(A, depth):
    return core_path(np.array(A), np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0]), depth)


def choose(own, path, ground, X_WB, search=SEARCH, force=60.0):
    vehicle, chain = own
    known = WorkVehicle(vehicle=vehicle, chain=chain, hull_box=HULL_BOX)
    return choose_height(
        known, path, ground=ground, X_WB=X_WB, force=force, standoff=0.1, search=search
    )


def grid(half=2.0, step=0.05):
    x = np.arange(-half, half + 1e-9, step)
    return np.column_stack([a.ravel() for a in (*np.meshgrid(x, x), np.zeros((len(x), len(x))))])


@pytest.mark.parametrize("yaw", [0.0, 2.1])
def test_all_of_the_path_is_reached_and_the_hull_is_clear(own, within, yaw):
    vehicle, chain = own
    turn = exp_so3([0.0, 0.0, yaw])
    path = straight(turn @ [0.55, -0.15, 0.0], turn @ [0.55, 0.15, 0.0])
    height = choose(own, path, grid(), pose(turn, [0.0, 0.0, 3.0]))
    at = height.placement
    within("heading is kept", at.X_WB[:3, :3] - turn, 1e-12)
    within("gap [m]", height.hull_gap - (at.X_WB[2, 3] - 0.4), 1e-9)
    assert height.hull_gap >= HeightSearch().clearance
    within("shear [Pa]", height.shear - jet_shear(1.0, height.jet_height), 1e-12)
    q = at.q_start
    X_WA = at.X_WB @ vehicle.X_BA
    first = tool_pose(path, 0.0, at.roll)[0]
    first[:3, 3] -= 0.1 * first[:3, 2]
    within("stand-off [m]", (X_WA @ chain.kinematics(q)[0])[:3, 3] - first[:3, 3], 2e-4)
    for s in np.linspace(0.0, path.s[-1], 25):
        X_WG = tool_pose(path, s, at.roll)[0]
        solution = solve(chain, inverse(X_WA) @ X_WG, q, branch="keep")
        assert solution.converged
        q = solution.q
        within("tip [m]", (X_WA @ chain.kinematics(q)[0])[:3, 3] - X_WG[:3, 3], 2e-4)
        assert np.all(q > vehicle.q_limits[:, 0])
        assert np.all(q < vehicle.q_limits[:, 1])


def test_it_goes_no_lower_than_it_must(own):
    """The first height with room from above: 4 cm higher there is none."""
    path = core([0.5, 0.1, 0.0], 0.12)
    search = HeightSearch(roomy=0.2, margin=0.2, jet=0.1)
    height = choose(own, path, grid(), pose(p=[0.0, 0.0, 3.0]), search)
    higher = HeightSearch(
        roomy=0.2, margin=0.2, jet=0.1, clearance=height.hull_gap + 0.5 * search.step, asides=(0.0,)
    )
    with pytest.raises(ReachError, match="m clear of the ground"):
        choose(own, path, grid(), pose(p=[0.0, 0.0, 3.0]), higher)


def test_a_rock_under_the_hull_is_kept_clear_of(own):
    path = core([0.7, 0.0, 0.0], 0.1)
    ground = grid()
    rock = np.linalg.norm(ground[:, :2] - [-0.6, 0.0], axis=1) < 0.15
    ground[rock, 2] = 0.9
    height = choose(own, path, ground, pose(p=[0.0, 0.0, 3.0]))
    X = height.placement.X_WB
    p_B = (ground - X[:3, 3]) @ X[:3, :3]
    beside = np.maximum(0.0, np.maximum(HULL_BOX[0] - p_B, p_B - HULL_BOX[1]))
    assert np.linalg.norm(beside, axis=1).min() >= HeightSearch().clearance - 1e-9
    bare = choose(own, path, grid(), pose(p=[0.0, 0.0, 3.0]))
    # not where it would go without
    assert np.abs(X[:3, 3] - bare.placement.X_WB[:3, 3]).max() > 0.03


def test_refusals_say_what_stands_against_the_work(own):
    far = core([3.0, 0.0, 0.0], 0.1)
    near = core([0.5, 0.0, 0.0], 0.1)
    X = pose(p=[0.0, 0.0, 3.0])
    with pytest.raises(ReachError, match=r"at best 0% of the path, up to 0\.8 m aside"):
        choose(own, far, grid(), X)
    with pytest.raises(ReachError, match="stir it up"):
        choose(own, near, grid(), X, HeightSearch(jet=20.0))
    with pytest.raises(ReachError, match="higher than the arm reaches"):
        choose(own, near, grid(), X, HeightSearch(clearance=2.5))
    aside = grid() + np.array([5.0, 0.0, 0.0])
    with pytest.raises(ReachError, match="no point of the ground is known"):
        choose(own, core([5.0, 0.0, 0.0], 0.1), aside, X)
    with pytest.raises(ReachError):  # more than the drives bear
        choose(own, near, grid(), X, force=2000.0)


def test_jets(within):
    speed, diameter, height = 2.0, 0.2, 1.5
    thrust = 1025.0 * speed**2 * np.pi * diameter**2 / 4.0
    beltaos = 0.16 * 1025.0 * speed**2 * (diameter / height) ** 2
    within("0.16 rho U^2 (d / H)^2, relative", jet_shear(thrust, height) / beltaos - 1.0, 1e-12)
    within(
        "silt height is where the shear is critical [Pa]",
        jet_shear(7.0, silt_height(7.0, 0.15)) - 0.15,
        1e-12,
    )


@pytest.mark.parametrize("kind", ["ripples", "slope", "rocks"])
def test_seeded_seabeds_are_kept_clear_of(own, kind):
    ground = seabed(kind, np.random.default_rng(5), step=0.05, half=2.0)
    points = ground.mesh()[0]
    path = core([0.5, 0.0, float(ground.height([[0.5, 0.0]])[0])], 0.1)
    height = choose(own, path, points, pose(p=[0.0, 0.0, 3.0]))
    X = height.placement.X_WB
    p_B = (points - X[:3, 3]) @ X[:3, :3]
    beside = np.maximum(0.0, np.maximum(HULL_BOX[0] - p_B, p_B - HULL_BOX[1]))
    assert np.linalg.norm(beside, axis=1).min() >= HeightSearch().clearance - 1e-9
    assert height.placement.margin >= HeightSearch().margin
