"""Ways past an object, judged by MuJoCo's own distances between the geoms of vehicle and object."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.mkps import Chain
from uuv.controllers.planning.hull_path import CLEARANCE, HullPath
from uuv.models.naming import ARM_BASE_BODY, HULL_BODY, TIP_SITE
from uuv.models.objects.targets import pile
from uuv.models.site import scenes
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    pose,
    quat_wxyz_from_rotation,
    transform_points,
)

X_WT = pose(p=[0.2, -0.1, 0.1])
HULL_BOX = np.array([[-0.8, -0.45, -0.4], [0.8, 0.45, 0.28]])  # [m] of the geom "hull_box"
# [m] of any geom: the tool is a ball of 6 cm; on 24 ways no more than that under `gap`
NEAREST = CLEARANCE - 0.08


@pytest.fixture(scope="module")
def passing() -> HullPath:
    model = models.load("uuv_puma_side").compile()
    chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=["pad"])
    return HullPath(Vehicle.of(model), chain, HULL_BOX, transform_points(X_WT, pile().vertices))


@pytest.fixture(scope="module")
def site() -> mujoco.MjModel:
    return scenes.work_site(models.load("uuv_puma_side"), pile(), X_WT).compile()


def nearest(site: mujoco.MjModel, poses: list[Array]) -> float:
    """Distance [m] of the geoms of vehicle and pile on straight moves through `poses`."""
    data, vehicle = mujoco.MjData(site), Vehicle.of(site)
    mujoco.mj_resetDataKeyframe(site, data, 0)
    hull = site.body(HULL_BODY).id
    felt = [g for g in range(site.ngeom) if site.geom_contype[g] or site.geom_conaffinity[g]]
    hull_geoms = [g for g in felt if site.body_rootid[site.geom_bodyid[g]] == hull]
    object_geoms = [g for g in felt if site.geom(g).name.startswith("target")]
    assert hull_geoms
    assert object_geoms
    gap = np.inf
    for start, end in pairwise(poses):
        turn = np.arctan2(*(start[:3, :3].T @ end[:3, :3])[[1, 0], 0])
        for share in np.linspace(0.0, 1.0, 15):
            at = vehicle.hull_qpos
            data.qpos[at : at + 3] = (1.0 - share) * start[:3, 3] + share * end[:3, 3]
            data.qpos[at + 3 : at + 7] = quat_wxyz_from_rotation(
                start[:3, :3] @ exp_so3([0.0, 0.0, share * turn])
            )
            mujoco.mj_kinematics(site, data)
            gap = min(
                gap,
                *(
                    mujoco.mj_geomDistance(site, data, a, b, 1.0, None)
                    for a in hull_geoms
                    for b in object_geoms
                ),
            )
    return gap


def beside(bearing: float, heading: float, away: float) -> Array:
    p = X_WT[:3, 3] + away * np.array([np.cos(bearing), np.sin(bearing), 0.0])
    return pose(exp_so3([0.0, 0.0, heading]), p)


def test_straight_where_there_is_room(passing):
    X_from, X_to = beside(0.0, np.pi, 2.4), beside(0.3, np.pi, 2.4)
    way = passing.way(X_from, X_to)
    assert len(way) == 1
    assert np.array_equal(way[0], X_to)


@pytest.mark.seeds(1, 2)
def test_goes_around_what_the_folded_arm_would_strike(passing, site, seed):
    rng = np.random.default_rng(seed)
    for _ in range(3):
        bearing = rng.uniform(-np.pi, np.pi)
        turn = rng.choice([-1.0, 1.0]) * rng.uniform(1.2, 2.0)
        X_from = beside(bearing, bearing + np.pi, rng.uniform(1.9, 2.2))
        X_to = beside(bearing + turn, bearing + turn + np.pi / 2.0, rng.uniform(1.9, 2.2))
        way = passing.way(X_from, X_to)
        assert np.array_equal(way[-1], X_to)
        straight = passing.least_gap([X_from, X_to])
        assert (len(way) == 1) == (straight >= CLEARANCE), seed
        assert nearest(site, [X_from, *way]) > NEAREST, seed


@pytest.mark.parametrize("far", [1.9, 2.4])
def test_the_other_side_is_reached_around_the_object(passing, site, far):
    """Half a turn about the pile: straight it would be met."""
    X_from, X_to = beside(0.3, 0.3 + np.pi, far), beside(0.3 + np.pi - 0.1, 0.2, far)
    assert passing.least_gap([X_from, X_to]) < 0.0
    way = passing.way(X_from, X_to)
    assert np.array_equal(way[-1], X_to)
    assert passing.least_gap([X_from, *way]) > CLEARANCE - 1e-9
    assert nearest(site, [X_from, *way]) > NEAREST


def test_a_clearance_is_kept_where_the_gap_is_as_large(passing, rng):
    """The sooner answer is that of the gap, to its last bit."""
    answers = set()
    for _ in range(40):
        bearing, heading = rng.uniform(-np.pi, np.pi, 2)
        X_WB = beside(bearing, heading, rng.uniform(1.2, 2.2))
        gap = passing.gap(X_WB)
        for clearance in (gap, np.nextafter(gap, np.inf), rng.uniform(0.0, 0.6)):
            kept = passing.keeps(X_WB, clearance)
            assert kept == (gap >= clearance)
            answers.add((kept, clearance == gap))
    assert answers == {(True, True), (True, False), (False, False)}
