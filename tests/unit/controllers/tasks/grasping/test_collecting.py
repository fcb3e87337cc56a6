"""The collection from the stand-off over the object on: gripped, lifted, carried, put."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from uuv import jobs
from uuv.assembly import assemble
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.arrival import around
from uuv.controllers.tasks.axial_phases import AxialLimits
from uuv.controllers.tasks.grasping.collecting import (
    CollectJob,
    check_grip,
    drop_monitors,
    longest_lever,
    rows_at_object,
)
from uuv.controllers.tasks.grasping.jaw_phases import GripPlan, Weighing
from uuv.controllers.tasks.phase import ToolLine
from uuv.controllers.tasks.task import TaskPlanner, TaskState
from uuv.models.tools.jaw_shape import JawShape
from uuv.sim.evaluation.handling.collect_metrics import carried
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, StateEstimate, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.loop.recording import Recorder, Recording
from uuv.sim.loop.rollout import rollout
from uuv.tasks.collecting import PlacedCollection
from uuv.ticks.compiled_ticks import CompiledTicks

JAWS = JawShape(
    opening=0.1,
    thickness=0.012,
    breadth=0.03,
    finger=0.09,
    force=100.0,
    friction=0.6,
    damping=3840.0,
    loss=4.0,
)
QUICK = AxialLimits(standoff=0.1, approach_speed=0.06, speed=0.05, longest=40.0, force_limit=80.0)


class AtObject(TaskPlanner):
    """The rows of a collection from the stand-off on, with the line and the grasp given."""

    def __init__(self, job: CollectJob, placement: Placement, path: ToolPath, plan: GripPlan):
        q = placement.q_start
        rows = rows_at_object(job, q)
        super().__init__(rows, drop_monitors(job.jaws), X_WB=placement.X_WB, q=q)
        self.line = ToolLine(path, placement, 0.0)
        self.depth = -job.axial.standoff
        self.plan = plan

    def init(self, estimate: StateEstimate) -> TaskState:
        state = super().init(estimate)
        state.held.line = self.line
        state.held.depth = self.depth
        state.held.plan = self.plan
        return state


def collection(
    *, compiled: bool = True, friction: float | None = None, **options
) -> tuple[Recording, PlacedCollection]:
    """A run from the stand-off on, with a believed pose that is the true one."""
    scenario = jobs.collect(seed=5, current=(0.1, 0.05, 0.0), **options)
    sensing = replace(scenario.sensing, torque_bias=0.0)
    made = assemble(replace(scenario, sensing=sensing))
    placed = cast(PlacedCollection, made.placed)
    job = CollectJob(
        grip=placed.task.grip,
        load=placed.task.load,
        carry_speed=0.2,
        axial=QUICK,
        carry_ramp=1.0,
        weighing=Weighing(after=1.0, seconds=1.0),
    )

    planner = placed.planner()
    target = _seen(placed.X_WT)
    path = target.path
    assert path is not None
    placement, path, _ = planner.stand(target, path, np.zeros(3))
    grasp = planner.grasps(target)[0][0]
    expected = planner.expected(target, ToolLine(path, placement, 0.0).at(0.0, 0.0)[0])
    plan = GripPlan(opening=grasp.opening, width=grasp.width, bears=job.load, expected=expected)

    plant = made.plant
    if friction is not None:
        plant.model.pair_friction[:, :2] = friction
    plant.reset(current=made.current(), X_WB=placement.X_WB)
    plant.data.qpos[plant.vehicle.qpos] = placement.q_start
    recorder = Recorder(plant.model, timestep=plant.timestep, full=False)
    rollout(
        plant,
        replace(made.parts, planner=AtObject(job, placement, path, plan), finder=None),
        duration=60.0,
        rng=np.random.default_rng(3),
        observers=[recorder, *placed.observers()],
        compiled=CompiledTicks(plant, recorder).bind if compiled else None,
    )
    return recorder.recording(), placed


def _seen(X_WT: Array) -> Target:
    """The object as it is, as a find."""
    path = ToolPath(
        s=np.zeros(1),
        p=X_WT[None, :3, 3],
        z=np.zeros((1, 3)),
        x=np.zeros((1, 3)),
        on_scan=np.zeros(1, bool),
    )
    return Target(
        time=0.0, X_WT=X_WT, accepted=True, check_m=0.0, range_m=1.0, reason="", path=path
    )


def test_a_stone_is_gripped_weighed_carried_and_put_into_the_basket() -> None:
    recording, placed = collection()

    assert recording.final.state is WorkState.DONE, recording.final.note
    held = carried(recording)
    end = recording["p_WT"].value[-1]
    assert np.hypot(*(end - placed.basket_W)[:2]) < 0.03
    assert recording["p_WT"].value[:, 2].max() > recording["p_WT"].value[0, 2] + 0.08
    assert recording["contact_normal"].scalar[held].mean() == pytest.approx(40.0, rel=0.1)
    assert recording["contact_most"].scalar.max() < 60.0
    felt = np.linalg.norm(recording["felt_force"].value, axis=1)
    assert np.nanmax(felt) < 45.0  # nothing is pressed on the ground; 150 N without giving way

    weighed = placed.watch.weighed
    assert weighed is not None
    assert weighed.weight == pytest.approx(placed.loose.weight(1025.0, 9.81), abs=0.3)
    assert weighed.mass == pytest.approx(placed.loose.mass, abs=0.03)


@pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/grasping/test_collecting.py::"
    "test_a_stone_is_gripped_weighed_carried_and_put_into_the_basket"
)
def test_what_slips_out_is_named_and_the_work_broken_off() -> None:
    recording, _ = collection(friction=0.04)
    assert recording.final.state is WorkState.ABORT
    assert recording.final.abort in (AbortCode.DROPPED, AbortCode.NOT_GRIPPED)


@pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/grasping/test_collecting.py::"
    "test_a_stone_is_gripped_weighed_carried_and_put_into_the_basket"
)
def test_what_is_too_heavy_is_put_back() -> None:
    recording, placed = collection(mass=1.9)
    assert recording.final.abort is AbortCode.TOO_HEAVY
    assert "allowed" in recording.final.note
    moved = recording["p_WT"].value[-1] - recording["p_WT"].value[0]
    assert np.linalg.norm(moved) < 0.05
    weighed = placed.watch.weighed
    assert weighed is not None
    assert weighed.mass == pytest.approx(placed.loose.mass, abs=0.05)


@pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/grasping/test_collecting.py::"
    "test_a_stone_is_gripped_weighed_carried_and_put_into_the_basket"
)
def test_compiled_ticks_and_ticks_part_by_part_give_the_same_bits() -> None:
    digests = {collection(compiled=compiled)[0].digest() for compiled in (True, False)}
    assert len(digests) == 1


def test_the_hull_keeps_clear_of_the_basket_on_its_way() -> None:
    placed = assemble(jobs.collect(seed=5)).placed
    assert isinstance(placed, PlacedCollection)
    seen = _seen(placed.X_WT)
    worker = placed.vehicle.at_work()

    # The hull's rear end is in the middle of the basket, its front points away from the object.
    away = placed.basket_W - placed.X_WT[:3, 3]
    R_WB = exp_so3([0.0, 0.0, np.arctan2(away[1], away[0])])
    rear = np.array([worker.hull_box[0, 0], 0.0, worker.hull_box[0, 2]])
    X_WB = pose(R_WB, placed.basket_W - R_WB @ rear)

    assert around(worker, placed.target)(seen).gap(X_WB) > 0.1
    assert placed.planner().around(seen).gap(X_WB) < 0.0


def test_a_grip_that_cannot_bear_the_load_is_refused_with_the_figures() -> None:
    check_grip(CollectJob(grip=40.0, load=30.0), JAWS)  # 0.7 of 48 N
    with pytest.raises(ConfigurationError, match=r"friction holds 48 N .* a grip of 48 N"):
        check_grip(CollectJob(grip=40.0, load=40.0), JAWS)
    with pytest.raises(ConfigurationError, match=r"task.grip \[N\]: the jaws give at most 100"):
        check_grip(CollectJob(grip=120.0), JAWS)
    # Below 4 N of friction and 5.8 N at 3 mm/s free jaws cannot be told from jaws that grip.
    with pytest.raises(ConfigurationError, match=r"at least 9\.8"):
        check_grip(CollectJob(grip=6.0, load=1.0), JAWS)


def test_the_lever_that_the_pads_bear_falls_with_the_load() -> None:
    light = longest_lever(CollectJob(grip=40.0, load=4.0), JAWS)
    assert light == pytest.approx(2 * 0.7 * 0.6 * 40.0 * 0.0075 / 4.0)
    assert longest_lever(CollectJob(grip=40.0, load=8.0), JAWS) == pytest.approx(0.5 * light)
