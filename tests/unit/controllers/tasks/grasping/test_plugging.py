"""The move of a plug from the stand-off over it on: pulled, carried, seated; stuck and jammed."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from uuv import jobs
from uuv.assembly import assemble
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.tool_statics import ToolStatics
from uuv.controllers.tasks.axial_phases import AxialLimits
from uuv.controllers.tasks.grasping.collecting import drop_monitors
from uuv.controllers.tasks.grasping.jaw_phases import GripPlan, Weighing
from uuv.controllers.tasks.grasping.plugging import LENGTH, PlugJob, check_forces, rows_at_panel
from uuv.controllers.tasks.phase import ToolLine
from uuv.controllers.tasks.task import TaskPlanner, TaskState
from uuv.models.site.plugged_panel import PluggedPanel
from uuv.models.tools.jaw_shape import JawShape
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.handling.plug_metrics import assess_move
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import AbortCode, StateEstimate, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import Recorder, Recording
from uuv.sim.loop.rollout import rollout
from uuv.tasks.plugging import PlacedMove
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
QUICK = AxialLimits(
    standoff=LENGTH + 0.03, approach_speed=0.08, speed=0.06, longest=60.0, force_limit=100.0
)
long = pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/grasping/test_plugging.py::"
    "test_a_plug_is_pulled_out_carried_and_seated_in_the_other_receptacle"
)


class AtPanel(TaskPlanner):
    """The rows of a move from the stand-off on, with line and grip given."""

    def __init__(self, job: PlugJob, placement: Placement, path: ToolPath, plan: GripPlan) -> None:
        q = placement.q_start
        rows = rows_at_panel(job, q, job.grip)
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


def move(*, compiled: bool = True, aside: float = 0.0, **options) -> tuple[Recording, Assessment]:
    """A run from the stand-off on; the believed pose of the panel is `aside` [m] along its x_T
    from the true one.
    """
    scenario = jobs.move_plug(seed=5, current=(0.1, 0.05, 0.0), carry_speed=0.15, **options)
    sensing = replace(scenario.sensing, torque_bias=0.0)
    made = assemble(replace(scenario, sensing=sensing))
    placed = cast(PlacedMove, made.placed)
    job = replace(
        placed.job,
        axial=QUICK,
        pull_speed=0.03,
        seat_speed=0.015,
        weighing=Weighing(after=0.7, seconds=0.8),
    )

    planner = placed.planner()
    X_WT = placed.X_WT.copy()
    X_WT[:3, 3] += aside * X_WT[:3, 0]
    target = planner.with_path(_seen(X_WT))
    assert target.path is not None
    placement, path, _ = planner.stand(target, target.path, np.zeros(3))
    line = ToolLine(path, placement, 0.0)
    plan = planner.plan(target, line.at(0.0, 0.0)[0])

    plant = made.plant
    plant.reset(current=made.current(), X_WB=placement.X_WB)
    plant.data.qpos[plant.vehicle.qpos] = placement.q_start
    recorder = Recorder(plant.model, timestep=plant.timestep, full=False)
    rollout(
        plant,
        replace(made.parts, planner=AtPanel(job, placement, path, plan), finder=None),
        duration=60.0,
        rng=np.random.default_rng(3),
        observers=[recorder, *placed.observers()],
        compiled=CompiledTicks(plant, recorder).bind if compiled else None,
    )
    recording = recorder.recording()
    truth = placed.truth
    felt = placed.watch.felt(truth.first)
    return recording, assess_move(recording, truth, felt, seed=5, wall_s=1.0)


def _seen(X_WT: Array) -> Target:
    """The panel as it is believed, as a find."""
    return Target(
        time=0.0, X_WT=X_WT, accepted=True, check_m=0.0, range_m=1.0, reason="", path=None
    )


def test_a_plug_is_pulled_out_carried_and_seated_in_the_other_receptacle() -> None:
    recording, judged = move()

    assert recording.final.state is WorkState.DONE, recording.final.note
    assert judged.accepted, judged.failed
    figures = judged.metrics
    # The seal's friction was found by force: measured 23.7 N at the break, at 30 mm/s.
    assert figures["force"]["pull_max_n"] == pytest.approx(20.0, rel=0.25)
    # Felt is the plug's weight of 6 N in addition, within the error of the estimate.
    felt = figures["force"]["pull_felt_n"]
    assert felt == pytest.approx(figures["force"]["pull_max_n"] + 6.0, abs=5.0)
    assert recording["p_WT"].value[:, 2].max() > recording["p_WT"].value[0, 2] + LENGTH
    assert figures["seat"]["short_m"] < 1e-3


@long
def test_a_plug_is_seated_where_the_panel_is_believed_5_mm_aside() -> None:
    recording, judged = move(aside=0.005)
    assert recording.final.state is WorkState.DONE, recording.final.note
    assert judged.accepted, judged.failed


@long
def test_a_stuck_plug_is_named_within_a_second_and_let_go() -> None:
    recording, judged = move(stuck=True)
    assert recording.final.abort is AbortCode.STUCK, recording.final.note
    assert recording.final.state is WorkState.ABORT
    assert 0.3 < judged.metrics["named_s"] < 1.0  # measured 0.49
    assert judged.metrics["force"]["pull_max_n"] < 1.2 * 40.0
    assert judged.accepted is False  # broken off
    still = recording["p_WT"].value
    assert np.abs(still - still[0]).max() < 1e-3


@long
def test_a_plug_with_more_friction_than_the_set_pull_is_stuck_and_with_a_larger_pull_moved() -> (
    None
):
    recording, _ = move(friction=50.0)
    assert recording.final.abort is AbortCode.STUCK, recording.final.note
    recording, judged = move(friction=40.0, pull=50.0, push=50.0, grip=85.0)
    assert recording.final.state is WorkState.DONE, recording.final.note
    assert judged.accepted, judged.failed


@long
def test_debris_in_the_other_receptacle_is_a_jam_after_three_attempts() -> None:
    recording, judged = move(debris=True)
    assert recording.final.abort is AbortCode.JAMMED, recording.final.note
    assert "in 3 attempts" in recording.final.note
    assert judged.metrics["force"]["push_max_n"] < 1.5 * 40.0
    assert not judged.metrics["seat"]["seated"]


@long
def test_compiled_ticks_and_ticks_part_by_part_give_the_same_bits() -> None:
    digests = {move(compiled=compiled)[0].digest() for compiled in (True, False)}
    assert len(digests) == 1


def test_the_grips_are_a_receptacle_apart_along_the_face_and_come_from_above() -> None:
    panel = PluggedPanel(start="b")
    assert panel.grip("a")[:3, 3] - panel.grip("b")[:3, 3] == pytest.approx(panel.way)
    assert panel.way[2] == 0.0
    assert panel.grip("b")[:3, 2] == pytest.approx([0.0, 0.0, -1.0])

    # The pin is inside its receptacle, with the stated play, and shorter than it.
    hole = panel.hole("b")
    pin = next(solid for solid in panel.plug if solid.name == "target_pin")
    assert hole.radius - pin.size[0] == pytest.approx(panel.clearance)
    assert hole.p_T[2] - (pin.X_TS[2, 3] - pin.size[1] - pin.size[0]) == pytest.approx(LENGTH)
    assert hole.depth > LENGTH


def test_the_volume_of_the_plug_is_that_of_its_mesh() -> None:
    from uuv.models.meshes.closed_shells import volume

    panel = PluggedPanel()
    block = panel.panel.target
    whole = panel.target
    corners = slice(len(block.vertices), None), slice(len(block.triangles), None)
    triangles = whole.triangles[corners[1]] - len(block.vertices)
    assert volume(whole.vertices[corners[0]], triangles) == pytest.approx(panel.volume, rel=2e-3)
    center = panel.center - panel.hole("a").p_T
    assert center[:2] == pytest.approx([0.0, 0.0])
    low, high = np.ptp(whole.vertices[corners[0]], axis=0)[2], 0.062
    assert high - low < center[2] < high


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pull": 60.0}, r"task.pull 60 N: friction holds 84 N .* 70% .* a grip of 71 N or more"),
        ({"push": 59.0}, r"task.push 59 N: friction holds 84 N"),
        ({"grip": 120.0}, r"task.grip \[N\]: the jaws give at most 100, got 120"),
        ({"grip": 95.0, "pull": 55.0}, r"task.pull \[N\]: at most 50, half of the watched"),
    ],
)
def test_forces_that_the_jaws_do_not_bear_are_refused_with_the_figure(options, message) -> None:
    with pytest.raises(ConfigurationError, match=message):
        check_forces(PlugJob(**options), JAWS)


def test_a_gripper_that_is_too_small_for_the_handle_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"open to 50 mm; the plug's handle of 30 mm"):
        check_forces(PlugJob(), replace(JAWS, opening=0.05))


def test_the_pull_that_arm_and_thrusters_can_give_bounds_the_job() -> None:
    placed = cast(PlacedMove, assemble(jobs.move_plug(seed=5)).placed)
    planner = placed.planner()
    target = planner.with_path(_seen(placed.X_WT))
    assert target.path is not None
    placement, path, _ = planner.stand(target, target.path, np.zeros(3))
    whole = planner.bound(path, placement, 1.0)
    assert whole.most >= placed.task.pull

    # Along the axis of the tool, by virtual work: the torques of the bounding joint.
    weak = replace(
        placed.vehicle.vehicle, torque_limits=0.12 * planner._statics.vehicle.torque_limits
    )
    planner._statics = ToolStatics(
        vehicle=weak, chain=planner._statics.chain, holding=planner._statics.holding
    )
    less = planner.bound(path, placement, 1.0)
    assert less.most < placed.task.pull
    with pytest.raises(ReachError, match=r"the set pull of 40.0 N is above the bound of"):
        planner.stand(target, target.path, np.zeros(3))
