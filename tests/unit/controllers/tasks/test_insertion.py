"""The planner of an insertion under scripted forces, and its figures from recordings made up."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from scripted_world import UNTOUCHED, ScriptedWorld
from uuv.controllers.mkps import Chain
from uuv.controllers.planning import hull_placement
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.insertion import EntryLimits, HoleInsertion, InsertionJob, axis_path
from uuv.controllers.tasks.phase import Context
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.objects.manifold import manifold
from uuv.models.vehicle import Vehicle
from uuv.models.vehicles import uuv_puma
from uuv.sim.evaluation.insertion_metrics import hole_error
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ContactEstimate,
    Fault,
    FaultKind,
    Reference,
    Target,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose

PERIOD, FINE = 0.02, 0.01  # [s] enough for most that is asked here; that of jobs
SCAN_POSE, WORK_POSE = pose(p=[-1.0, 0.2, 0.5]), pose(p=[-0.6, 0.0, 0.3])
X_WT = pose(exp_so3([0.05, -0.03, 0.4]), [0.3, -0.2, -1.5])
BLOCK = manifold()
HOLE = BLOCK.hole("a")
X_WH = HOLE.pose(X_WT)
STIFFNESS = 3e4  # [N/m]
LOST = Fault(kind=FaultKind.THRUSTER, part="v1", index=0, time=0.0)
BEFORE = [WorkState.SETTLE, WorkState.SCAN, WorkState.CLOSE_IN, WorkState.TARE, WorkState.APPROACH]
AFTER = [WorkState.INSERT, WorkState.WORK, WorkState.WITHDRAW]
OWN = uuv_puma.build("sampler").compile()
CHAIN = Chain.from_mjcf(OWN, ARM_BASE_BODY, TIP_SITE, exclude=["pad", "mount_x", "mount_y"])
World = Callable[
    [Array, float], Array
]  # tip in the hole's frame (3,) [m], time [s] -> force on it (3,) [N], that frame


def free(tip_H: Array, time: float) -> Array:
    del tip_H, time
    return np.zeros(3)


def wall_at(depth: float, radius: float = np.inf) -> World:
    """A face `depth` [m] below the mouth, but for a bore of `radius` around (6, 3) mm, to be found
    by the search.
    """

    def world(tip_H: Array, time: float) -> Array:
        del time
        inside = (
            np.hypot(tip_H[0] - 6e-3, tip_H[1] - 3e-3) < radius if np.isfinite(radius) else False
        )
        return np.array([0.0, 0.0, 0.0 if inside else -STIFFNESS * max(0.0, tip_H[2] - depth)])

    return world


@dataclass
class Script(ScriptedWorld):
    """Drives a planner through a world that answers with forces; every reference that it gives is
    kept.
    """

    world: World = free
    job: InsertionJob = field(default_factory=InsertionJob)
    found: bool = True
    dead_in: WorkState | None = None  # state in which a thruster is found dead
    period: float = PERIOD  # [s] of the planner

    def run(self, seconds: float = 200.0) -> "Script":
        vehicle = Vehicle.of(OWN)
        own = WorkVehicle(vehicle=vehicle, chain=CHAIN, hull_box=np.zeros((2, 3)))
        planner = HoleInsertion(
            own, BLOCK.target, HOLE, self.job, X_WB_scan=SCAN_POSE, period=self.period
        )
        return self.drive(planner, SCAN_POSE, seconds, vehicle.q_home)

    def look(self, time: float) -> Target:
        return Target(
            time=time,
            X_WT=X_WT,
            accepted=self.found,
            check_m=0.001,
            range_m=1.2,
            reason="" if self.found else "too few points",
            path=axis_path(X_WT, HOLE, 0.03) if self.found else None,
        )

    def feel(self, reference: Reference, time: float) -> ContactEstimate:
        if reference.X_WG is None:
            return UNTOUCHED
        f_tip_W = X_WH[:3, :3] @ self.world((inverse(X_WH) @ reference.X_WG)[:3, 3], time)
        return ContactEstimate(force_W=f_tip_W, normal=-float(f_tip_W @ reference.X_WG[:3, 2]))

    def faults(self, reference: Reference, time: float) -> tuple[Fault, ...]:
        del time
        return (LOST,) if reference.state is self.dead_in else ()

    def tips(self, *states: WorkState) -> Array:
        """(N, 3) [m] tip references in the hole's frame, in `states`."""
        poses = [r.X_WG for r in self.references if r.state in states and r.X_WG is not None]
        return np.array([(inverse(X_WH) @ X)[:3, 3] for X in poses])

    @property
    def deepest(self) -> float:
        return float(self.tips(*AFTER, WorkState.SEARCH)[:, 2].max())


@pytest.fixture(autouse=True)
def placed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Placement has its own tests: here every path is within reach from WORK_POSE."""

    def place(vehicle: Vehicle, *_: Any, **__: Any) -> Placement:
        return Placement(
            X_WB=WORK_POSE,
            travel_W=np.zeros(3),
            roll=0.7,
            q_start=vehicle.q_ready,
            margin=1.0,
            reached=1.0,
        )

    monkeypatch.setattr(hull_placement, "place_hull", place)


def test_a_free_hole_is_entered_along_its_axis_and_left(within):
    script = Script(period=FINE).run()
    assert script.states == [*BEFORE, *AFTER, WorkState.DONE]
    assert script.end.note == ""
    tips = script.tips(WorkState.APPROACH, *AFTER, WorkState.DONE)
    within("off the axis [m]", np.linalg.norm(tips[:, :2], axis=1), 1e-12)
    assert 0.0 <= script.deepest - script.job.depth < 1e-3  # it slows down at 30 mm/s^2
    within("back at the stand-off [m]", tips[-1, 2] + script.job.axial.standoff, 3e-4)
    axes = np.array(
        [r.X_WG[:3, 2] for r in script.references if r.state in AFTER and r.X_WG is not None]
    )
    within("tool axis", axes - X_WH[:3, 2], 1e-12)
    # What is asked of the tool's speed is how its place moves.
    moved = np.diff(tips[:, 2]) / FINE
    asked = [
        r.v_WG_W @ X_WH[:3, 2] for r in script.references if r.state in (WorkState.APPROACH, *AFTER)
    ]
    within(
        "speed [m/s]",
        moved[:-1] - np.array(asked)[1 : len(moved)],
        script.job.axial.acceleration * FINE + 1e-9,
    )
    stay = script.of(WorkState.WORK)
    assert len(stay) * FINE == pytest.approx(script.job.stay, abs=0.05)
    assert {r.state for r in script.references if r.compliant} == set(AFTER)
    assert {r.state for r in script.references if r.tare} == {WorkState.TARE}


@pytest.mark.parametrize(
    ("depth", "first"), [(-0.009, WorkState.APPROACH), (0.004, WorkState.INSERT)]
)
def test_the_rim_is_met_and_the_hole_is_searched_for(depth, first):
    script = Script(wall_at(depth, radius=0.004)).run()
    at = script.states.index(WorkState.SEARCH)
    assert script.states[at - 1] is first
    assert script.states[at + 1 :] == [*AFTER, WorkState.DONE]
    middle = script.tips(WorkState.WORK)[-1, :2]
    assert np.hypot(middle[0] - 6e-3, middle[1] - 3e-3) < 0.004
    search = script.tips(WorkState.SEARCH)
    speed = np.linalg.norm(np.diff(search[:, :2], axis=0), axis=1)[20:] / PERIOD
    assert speed.max() < 1.2 * script.job.search.speed
    # Pressed by no more than the force with which it feels, but for the speed at which the rim is
    # met.
    pressed = (
        STIFFNESS
        * (search[50:, 2] - depth)[np.hypot(search[50:, 0] - 6e-3, search[50:, 1] - 3e-3) > 4e-3]
    )
    assert pressed.max() < 1.3 * script.job.search.force


def test_no_hole_is_there():
    script = Script(wall_at(0.001)).run()
    assert script.states[-4:] == [
        WorkState.INSERT,
        WorkState.SEARCH,
        WorkState.WITHDRAW,
        WorkState.ABORT,
    ]
    assert "no hole within 16 mm" in script.end.note
    assert np.linalg.norm(script.tips(WorkState.SEARCH)[:, :2], axis=1).max() == pytest.approx(
        0.016, rel=0.02
    )


def test_a_jam_is_drawn_back_from_and_tried_again():
    jam = wall_at(0.035)
    script = Script(jam).run()
    assert "stopped at 3" in script.end.note
    assert script.states[-3:] == [WorkState.INSERT, WorkState.WITHDRAW, WorkState.ABORT]
    depths = script.tips(WorkState.INSERT)[:, 2]
    at_the_wall = np.flatnonzero(np.diff((depths > 0.034).astype(int)) > 0)
    assert len(at_the_wall) == script.job.inside.tries + 1
    gaps = [depths[a:b].min() for a, b in pairwise(at_the_wall)]
    assert np.allclose(gaps, 0.035 - script.job.inside.back, atol=1.5e-3)

    def once(tip_H: Array, time: float) -> Array:
        return jam(tip_H, time) if time < script.references[0].time + 60.0 else np.zeros(3)

    begins = next(r.time for r in script.references if r.state is WorkState.INSERT)
    freed = Script(lambda tip_H, time: once(tip_H, time + 60.0 - begins - 12.0)).run()
    assert freed.states[-4:] == [*AFTER, WorkState.DONE]


def test_pressed_aside_it_waits():
    def aside(tip_H: Array, time: float) -> Array:
        del time
        return np.array([12.0 if 0.02 < tip_H[2] < 0.03 else 0.0, 0.0, 0.0])

    script = Script(
        aside, job=InsertionJob(axial=replace(InsertionJob().axial, longest=30.0))
    ).run()
    assert 0.02 < script.deepest < 0.021  # at 6 mm/s it needs 0.6 mm to stop
    assert script.states[-1] is WorkState.ABORT


@pytest.mark.parametrize(
    ("world", "said"),
    [
        pytest.param(wall_at(-0.03), "29 mm before the mouth", id="early"),
        pytest.param(
            lambda tip_H, _: np.array([0.0, 70.0 * (tip_H[2] > 0.02), 0.0]),
            "above the limit",
            id="force",
        ),
    ],
)
def test_breaks_off_and_is_drawn_out(world, said):
    script = Script(world).run()
    assert script.states[-2:] == [WorkState.WITHDRAW, WorkState.ABORT]
    assert said in script.end.note
    assert script.tips(WorkState.ABORT)[-1, 2] <= -script.job.axial.standoff


def test_stuck_on_the_way_out_it_pulls_no_harder_than_it_pushed():
    held: list[float] = []

    def stuck(tip_H: Array, time: float) -> Array:
        del time
        held.append(max([0.0, *held[-1:], tip_H[2]]))
        return (
            np.array([0.0, 0.0, STIFFNESS * max(0.0, 0.04 - tip_H[2])])
            if held[-1] > 0.0599
            else np.zeros(3)
        )

    script = Script(
        stuck, job=InsertionJob(axial=replace(InsertionJob().axial, longest=20.0))
    ).run()
    assert script.states[-2:] == [WorkState.WITHDRAW, WorkState.ABORT]
    assert "stuck at 40" in script.end.note
    pulled = STIFFNESS * (0.04 - script.tips(WorkState.WITHDRAW)[:, 2])
    assert script.job.force * 0.9 < pulled.max() < 1.3 * script.job.force


def test_not_found_is_not_entered():
    script = Script(found=False).run()
    assert script.states[-1] is WorkState.ABORT
    assert "not identified" in script.end.note
    assert not {WorkState.APPROACH, WorkState.INSERT} & set(script.states)


@pytest.mark.parametrize("state", BEFORE[:-1])
def test_a_fault_before_the_hole_ends_the_work_there(state):
    script = Script(dead_in=state).run()
    assert script.states == [*BEFORE[: BEFORE.index(state) + 1], WorkState.ABORT]
    assert script.end.abort is AbortCode.THRUSTER
    tips = script.tips(*WorkState)
    # never nearer than the stand-off
    assert not len(tips) or tips[:, 2].max() < -0.9 * script.job.axial.standoff


def test_without_compliance_nothing_gives_way():
    assert not any(r.compliant for r in Script(job=InsertionJob(compliance=False)).run().references)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depth": 0.0}, "depth"),
        ({"axial": replace(InsertionJob().axial, speed=float("nan"))}, "speed"),
        ({"force": 50.0}, "half the limit"),
        ({"inside": EntryLimits(side_full=4.0)}, "side_full"),
        ({"guard": 0.1}, "standoff"),
    ],
)
def test_what_cannot_be_is_refused(change, said):
    with pytest.raises(ConfigurationError, match=said):
        InsertionJob(**change)


def test_a_hole_that_is_too_shallow_is_refused():
    with pytest.raises(ConfigurationError, match=r"below the hole's 0\.08 m, got 0\.09"):
        Script(job=InsertionJob(depth=0.09)).run()


def test_a_controller_that_feels_nothing_is_refused():
    estimate: Any = None
    dumb = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)
    with pytest.raises(ConfigurationError, match="no contact estimate"):
        Context(0.0, PERIOD, estimate, None, dumb).contact_force(np.array([0.0, 0.0, 1.0]))


# -- figures ---------------------------------------------------------------------------------------


def test_error_of_the_hole_is_across_its_axis(within):
    rng = np.random.default_rng(5)
    for _ in range(5):
        aside, turn = rng.normal(scale=0.002, size=2), rng.uniform(0.001, 0.02)
        X = X_WH @ pose(
            exp_so3([turn, 0.0, 0.0]) @ exp_so3([0.0, 0.0, 1.0]), [*aside, rng.normal(scale=0.01)]
        )
        position, angle = hole_error(X, X_WH)
        within("aside [m]", position - np.hypot(*aside), 1e-12)
        within("tilt [rad]", angle - turn, 1e-9)
