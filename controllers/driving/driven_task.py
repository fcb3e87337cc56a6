"""Planner of a driven vehicle: rest, unfold, tare, then the operator's requests until the inputs
end.

| phase | next |
|---|---|
| settle, unfold, rest, tare | the next of them; after the tare free |
| free | guarded with a set force; stay when the inputs have ended |
| guarded | contact at the touch; free without a set force; stay when the inputs have ended |
| contact | guarded when it slips off; let go without a set force; unload when the inputs end |
| let go, lift | off the surface, and free |
| unload | retreat, and the end |

Reactions to faults are those of any surface task.
"""

from collections.abc import Iterable

import numpy as np

from uuv.controllers.driving.drive_phase import (
    OUT_OF_REACH,
    Cockpit,
    DriveLimits,
    Driven,
    Mode,
    OperatorDrive,
)
from uuv.controllers.driving.operator_inputs import COLUMNS, OperatorInputs
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.approach_limits import ApproachLimits
from uuv.controllers.tasks.arrival import ArrivalLimits, TareSensors
from uuv.controllers.tasks.contact_phases import Retreat, Unload
from uuv.controllers.tasks.hull_phases import EscapeLimits, Settle, Unfold
from uuv.controllers.tasks.monitors import Monitor, Reaction, normal_force, too_much_force
from uuv.controllers.tasks.phase import Context, Decide, Held, HoldTool, PhaseEvent
from uuv.controllers.tasks.settings import SurfaceSettings
from uuv.controllers.tasks.surface_work import (
    BREAK_OFF,
    SurfaceTaskConfig,
    retreat_rows,
    surface_monitors,
)
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import Array

_LIFT = 0.05  # [m] by which the tool is lifted off a surface on which no force is set any more
# share of the time after which lost contact ends the work: the tool approaches again before that
_LOST = 0.5


def driven_task(
    vehicle: WorkVehicle, source: OperatorInputs, delay: float, *, X_WB: Array
) -> TaskPlanner:
    """Planner that follows an operator's inputs.

    Args:
        vehicle: the vehicle.
        source: inputs of the operator; their time begins when the vehicle is ready.
        delay: [s] between operator and vehicle.
        X_WB: (4, 4) hull pose at the start.

    Returns:
        The planner.
    """
    size = vehicle.size
    approach = ApproachLimits().of_size(size)
    largest = source.largest_force or COLUMNS["set_force"].most
    job = SurfaceTaskConfig(
        forces=(max(largest, approach.least_force),),
        force_rate=size**2 * SurfaceSettings.force_rate,
        approach=approach,
        arrival=ArrivalLimits.of_size(size),
        escape=EscapeLimits.of_size(size),
    )
    cockpit = Cockpit(
        work_vehicle=vehicle,
        source=source,
        delay=delay,
        approach=job.approach,
        force_rate=job.force_rate,
        limits=DriveLimits(lost=_LOST * job.contact.lost_time),
    )

    # The set force when none is stated
    touched = Monitor(
        condition=too_much_force(job.force_limit, normal_force),
        reaction=Reaction.RETREAT,
        code=AbortCode.FORCE_LIMIT,
        during=frozenset({WorkState.CLOSE_IN}),
    )
    monitors = (*surface_monitors(job), touched)
    return TaskPlanner(_rows(cockpit, job), monitors, X_WB=X_WB, q=vehicle.vehicle.q_home)


def _rows(cockpit: Cockpit, job: SurfaceTaskConfig) -> Iterable[tuple[str, TaskRow]]:
    """Names and rows of a driven vehicle."""
    lift = cockpit.work_vehicle.size * _LIFT

    yield from _ready_rows(cockpit, job)
    yield from _driven_rows(cockpit)
    yield from _lift_rows(cockpit, job, lift)

    # The end
    yield "stay", TaskRow(HoldTool(), WorkState.DONE, leave={Reaction.STOP: "halt"})
    yield from retreat_rows(cockpit.work_vehicle, job)


def _ready_rows(cockpit: Cockpit, job: SurfaceTaskConfig) -> Iterable[tuple[str, TaskRow]]:
    """Rows until the vehicle is at rest, its arm unfolded and its torque sensors tared."""
    states = WorkState
    done = PhaseEvent.DONE

    def make_ready(held: Held, context: Context) -> None:
        """Aim at the posture in which the drive begins."""
        del context
        q = cockpit.roomy_posture()
        held.line = cockpit.line(held.X_WB, cockpit.tool_at(held.X_WB, q), q)

    def hand_over(held: Held, context: Context) -> None:
        """Begin the time of the inputs."""
        held.plan = Driven(start=context.time, X_WG=held.tool()[0], q=np.array(held.q))

    rest = Settle(job.arrival.rest)
    aim = Decide(make_ready, AbortCode.OUT_OF_REACH)
    unfold = Unfold(job.arrival.joint_speed)
    start = Decide(hand_over, AbortCode.OUT_OF_REACH)

    yield "settle", TaskRow(rest, states.SETTLE, {done: at_once("ready")}, _STAY)
    yield "ready", TaskRow(aim, states.SETTLE, {done: "unfold"}, _STAY)
    yield "unfold", TaskRow(unfold, states.CLOSE_IN, {done: "rest"}, _STAY)
    yield "rest", TaskRow(rest, states.CLOSE_IN, {done: "tare"}, _STAY)
    yield "tare", TaskRow(TareSensors(), states.TARE, {done: at_once("hand over")}, _STAY)
    yield "hand over", TaskRow(start, states.TARE, {done: "free"}, _STAY)


def _driven_rows(cockpit: Cockpit) -> Iterable[tuple[str, TaskRow]]:
    """Rows of the operator's modes, one for each mode, with the rows that follow."""
    ends = PhaseEvent
    free = OperatorDrive(cockpit, Mode.FREE)
    guarded = OperatorDrive(cockpit, Mode.GUARDED)
    contact = OperatorDrive(cockpit, Mode.CONTACT)

    # Row that follows each event
    after_free = {ends.MORE: "guarded", ends.DONE: "stay"}
    after_guarded = {ends.TOUCHED: "contact", ends.REFUSED: "free", ends.DONE: "stay"}
    after_contact = {ends.MORE: "guarded", ends.REFUSED: "let go", ends.DONE: "unload"}

    yield "free", TaskRow(free, WorkState.CLOSE_IN, after_free, BREAK_OFF)
    yield "guarded", TaskRow(guarded, WorkState.APPROACH, after_guarded, BREAK_OFF, feels=True)
    yield "contact", TaskRow(contact, WorkState.WORK, after_contact, BREAK_OFF, feels=True)


def _lift_rows(
    cockpit: Cockpit, job: SurfaceTaskConfig, lift: float
) -> Iterable[tuple[str, TaskRow]]:
    """Rows that lift the tool off a surface by `lift` [m], and continue from there."""
    retreat = WorkState.RETREAT
    done = PhaseEvent.DONE

    def lifted(held: Held, context: Context) -> None:
        """Continue from the pose to which the tool was lifted, or from the present pose of the arm
        if it is below that.
        """
        driven = held.plan_of(Driven)
        X_WG = held.tool(lift)[0]
        q = cockpit.posture(held.X_WB, X_WG, driven.q)
        if q is None:
            held.note = OUT_OF_REACH
            q = np.array(context.estimate.q)
            X_WG = cockpit.tool_at(held.X_WB, q)
        driven.X_WG = X_WG
        driven.q = q
        driven.rest()
        held.line = cockpit.line(held.X_WB, driven.X_WG, driven.q)

    let_go = Unload(job.force_rate, job.approach.touch)
    off = Retreat(job.approach.speed, lift)
    onward = Decide(lifted, AbortCode.OUT_OF_REACH)

    yield "let go", TaskRow(let_go, retreat, {done: "lift"}, BREAK_OFF)
    yield "lift", TaskRow(off, retreat, {done: at_once("lifted")}, BREAK_OFF)
    yield "lifted", TaskRow(onward, retreat, {done: "free"}, BREAK_OFF)


# Until the tare the vehicle stays in place.
_STAY = {
    **dict.fromkeys((Reaction.RETREAT, Reaction.RISE, Reaction.WITHDRAW), "held"),
    Reaction.STOP: "halt",
}
