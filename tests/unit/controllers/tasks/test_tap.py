"""A task of one's own from the phases that are there: some points are touched one after another."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from scripted_world import ScriptedWorld
from uuv import models
from uuv.controllers.mkps import Chain
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import WorkSite
from uuv.controllers.tasks.surface_work import SurfaceTaskConfig
from uuv.controllers.tasks.tap import tap
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import ContactEstimate, Reference, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, pose

PERIOD, STIFFNESS = 0.01, 3e4  # [s], [N/m]
# [m] of the real surface over that expected, at each point
HEIGHTS = {0.0: 4e-3, 0.05: 0.0, 0.12: -3e-3}
JOB = SurfaceTaskConfig(forces=(30.0,))


def target(time: float) -> Target:
    s = np.linspace(0.0, 0.12, 41)
    ones = np.ones((41, 1))
    path = ToolPath(
        s=s,
        p=s[:, None] * [1.0, 0.0, 0.0],
        z=ones * [0.0, 0.0, -1.0],
        x=ones * [1.0, 0.0, 0.0],
        on_scan=s >= 0.0,
    )
    return Target(
        time=time, X_WT=np.eye(4), accepted=True, check_m=1e-3, range_m=1.2, reason="", path=path
    )


class World(ScriptedWorld):
    """A hull that is where it should be, and a surface whose height differs from point to point."""

    tip: Array
    fails_at: float

    def run(self, fails_at: float = np.inf, travel: Array | None = None) -> "World":
        model = models.load("uuv_puma").compile()
        vehicle = Vehicle.of(model)
        chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=["pad"])
        work_vehicle = WorkVehicle(vehicle=vehicle, chain=chain, hull_box=np.zeros((2, 3)))
        placement = Placement(
            X_WB=pose(p=[-0.6, 0.0, 0.3]),
            travel_W=np.zeros(3) if travel is None else travel,
            roll=0.0,
            q_start=vehicle.q_ready,
            margin=1,
            reached=1,
        )
        site = WorkSite(
            own=work_vehicle,
            X_WB_scan=pose(p=[-1.0, 0.2, 0.5]),
            stand=lambda _, path, _current: (placement, path, 1.0),
        )
        planner = tap(site, JOB, tuple(HEIGHTS), lambda _: self.tip, hold=2.0)
        self.fails_at = fails_at
        return self.drive(planner, site.X_WB_scan, 20_000 * PERIOD)

    def look(self, time: float) -> Target:
        return target(time)

    def feel(self, reference: Reference, time: float) -> ContactEstimate:
        del time
        felt = 0.0
        if reference.X_WG is not None:
            self.tip = reference.X_WG[:3, 3]
            nearest = min(HEIGHTS, key=lambda s: abs(s - float(self.tip[0])))
            felt = STIFFNESS * max(0.0, HEIGHTS[nearest] - float(self.tip[2]))
        if reference.force_control:
            felt = reference.set_force if self.tip[0] < self.fails_at else 170.0
        return ContactEstimate(normal=felt)


def test_every_point_is_touched_with_its_force_for_its_time_and_its_place_noted(within):
    world = World().run()
    tapping = [
        WorkState.APPROACH,
        WorkState.PRESS,
        WorkState.WORK,
        WorkState.RETREAT,
        WorkState.CLOSE_IN,
    ]
    assert world.states[4:] == [*tapping * 3, WorkState.DONE]
    held = world.of(WorkState.WORK)
    assert {reference.set_force for reference in held} == {30.0}
    assert len(held) * PERIOD == pytest.approx(3 * 2.0, abs=0.1)
    places = np.array(world.state.held.places)
    within("along [m]", places[:, 0] - list(HEIGHTS), 1e-9)
    # at touch speed the tool sinks in by 6 N
    within("height [m]", places[:, 2] - list(HEIGHTS.values()), 1.5e-3)
    tips = [r.X_WG[:3, 3] for r in world.references if r.X_WG is not None]
    steps = [float(np.linalg.norm(b - a)) for a, b in pairwise(tips)]
    assert max(steps) <= 1.01 * JOB.approach.speed * PERIOD  # the tool never jumps


def test_the_hull_travels_along_from_point_to_point(within):
    """It stands where the placement has it for the share of the path that lies behind, so the arm
    keeps its margin.
    """
    travel = np.array([0.06, -0.02, 0.01])
    world = World().run(travel=travel)
    held = [reference.X_WB[:3, 3] for reference in world.of(WorkState.WORK)]
    for s in HEIGHTS:
        p_hull = np.array([-0.6, 0.0, 0.3]) + s / 0.12 * travel
        within("hull at a point [m]", min(float(np.linalg.norm(p - p_hull)) for p in held), 1e-9)
    moving = [reference for reference in world.of(WorkState.CLOSE_IN) if reference.X_WG is not None]
    for earlier, later in pairwise(moving):
        step = later.X_WB[:3, 3] - earlier.X_WB[:3, 3]
        if earlier.state is later.state and np.linalg.norm(step) < 1e-2:
            within(
                "speed of the hull [m/s]",
                step / PERIOD - 0.5 * (earlier.v_WB_W + later.v_WB_W),
                2e-4,
            )


def test_a_tap_that_is_too_hard_ends_the_task_off_the_surface():
    world = World().run(fails_at=0.04)
    assert world.end.state is WorkState.ABORT
    assert len(world.state.held.places) == 1
    assert world.tip[2] > 0.09


@pytest.mark.parametrize("points", [(), (0.01, 0.02), (0.0, 0.0)])
def test_points_that_cannot_be(points):
    site: Any = None
    with pytest.raises(ConfigurationError, match="must increase from 0 m"):
        tap(site, JOB, points, lambda _: np.zeros(3), hold=2.0)
