"""Monitors at their bounds: just within each nothing happens, just beyond it the work is broken off
in its time.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.hull_phases import RestLimits, Settle
from uuv.controllers.tasks.monitors import Monitor, Reaction, adrift, fault_monitors, watch
from uuv.controllers.tasks.phase import Abort, Context, Held, PhaseEvent, ToolLine
from uuv.controllers.tasks.surface_work import SurfaceTaskConfig, surface_monitors
from uuv.controllers.tasks.task import TaskPlanner, TaskRow
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ContactEstimate,
    Fault,
    FaultKind,
    StateEstimate,
    ToolPath,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

STEP = 0.02  # [s]
JOB = SurfaceTaskConfig(forces=(60.0,))


def estimate(time: float, X_WB: Array | None = None) -> StateEstimate:
    zero, joints = np.zeros(3), np.zeros(6)
    X_WB = np.eye(4) if X_WB is None else X_WB
    return StateEstimate(
        time=time, X_WB=X_WB, v_WB_B=zero, w_WB_B=zero, a_WB_B=zero, q=joints, qd=joints, tau=joints
    )


def seen(
    time: float,
    felt: float = 0.0,
    faults: Sequence[Fault] = (),
    X_WB: Array | None = None,
    sigma: float = np.inf,
) -> Context:
    contact = ContactEstimate(normal=felt, sigma_G=np.array([1.0, 1.0, sigma]))
    fields_of: dict[str, Any] = {
        "joint_torque": np.zeros(6),
        "thrusters": np.zeros(6),
        "scan": False,
    }
    command = Command(time=time, contact=contact, faults=tuple(faults), **fields_of)
    return Context(time, STEP, estimate(time, X_WB), None, command)


def held(force: float = 60.0) -> Held:
    return Held(X_WB=np.eye(4), X_WB_scan=np.eye(4), q=np.zeros(6), set_force=force)


def broken_off(
    work: WorkState, felt: float, seconds: float, sigma: float = np.inf
) -> tuple[float, Abort] | None:
    """When [s] and why the work is broken off under a constant felt force [N]; None: not within
    `seconds`.

    `sigma` [N] is the stated standard deviation of the force; inf: none is stated.
    """
    monitors = surface_monitors(JOB)
    false_at = [0.0] * len(monitors)
    for tick in range(round(seconds / STEP)):
        reaction, cause = watch(
            monitors, false_at, work, held(), seen(tick * STEP, felt, sigma=sigma)
        )
        if reaction is not Reaction.GO_ON:
            assert cause is not None
            return tick * STEP, cause
    return None


@pytest.mark.parametrize(
    ("within", "beyond", "after", "code"),
    [
        (
            (1.0 + JOB.contact.excess) * 60.0 + 0.9 * JOB.approach.touch,
            (1.0 + JOB.contact.excess) * 60.0 + 1.1 * JOB.approach.touch,
            JOB.contact.excess_time,
            AbortCode.FORCE_NOT_HELD,
        ),
        (
            0.55 * JOB.approach.touch,
            0.45 * JOB.approach.touch,
            JOB.contact.lost_time,
            AbortCode.CONTACT_LOST,
        ),
    ],
)
def test_a_force_beyond_its_bound_ends_the_work_in_its_time(within, beyond, after, code):
    assert broken_off(WorkState.WORK, within, 4.0 * after + 1.0) is None
    broken = broken_off(WorkState.WORK, beyond, 4.0 * after + 1.0)
    assert broken is not None
    assert after < broken[0] < after + 2.5 * STEP
    assert broken[1].code is code
    assert broken_off(WorkState.RETREAT, beyond, 4.0 * after + 1.0) is None


def test_work_ends_where_the_force_is_not_felt():
    assert broken_off(WorkState.WORK, 60.0, 3.0, 0.9 * JOB.contact.sigma) is None
    broken = broken_off(WorkState.WORK, 60.0, 3.0, 1.1 * JOB.contact.sigma)
    assert broken is not None
    assert JOB.contact.lost_time < broken[0] < JOB.contact.lost_time + 2.5 * STEP
    assert broken[1].code is AbortCode.FORCE_NOT_FELT
    assert "standard deviation 22 N" in broken[1].reason
    assert broken_off(WorkState.CLOSE_IN, 0.0, 3.0, 1.1 * JOB.contact.sigma) is None


def test_a_hull_that_does_not_become_quiet_is_waited_for_so_long_and_no_longer():
    limits = RestLimits()
    phase = Settle(limits)
    moving = held()
    moving.X_WB = pose(p=[1.1 * limits.error, 0.0, 0.0])
    state = phase.enter(moving, seen(0.0))
    ticks = range(round(2.0 * limits.within / STEP))
    given_up = [
        tick for tick in ticks if isinstance(phase.step(state, moving, seen(tick * STEP)), Abort)
    ]
    assert limits.within < given_up[0] * STEP < limits.within + 2.5 * STEP
    state = phase.enter(held(), seen(0.0))
    ends = [
        tick
        for tick in range(400)
        if phase.step(state, held(), seen(tick * STEP)) is PhaseEvent.DONE
    ]
    assert limits.time < ends[0] * STEP < limits.time + 2.5 * STEP


def fault(kind: FaultKind, part: str = "", time: float = 0.0, figures: str = "") -> Fault:
    return Fault(kind=kind, part=part, index=0, time=time, figures=figures)


@pytest.mark.parametrize(
    ("faults", "reaction", "said"),
    [
        ([], Reaction.GO_ON, None),
        ([fault(FaultKind.TORQUE_SENSOR, "j1")], Reaction.GO_ON, None),
        (
            [fault(FaultKind.TORQUE_SENSOR, "j1"), fault(FaultKind.TORQUE_SENSOR, "j2")],
            Reaction.RETREAT,
            "torque sensors of j1, j2 are wrong",
        ),
        (
            [fault(FaultKind.GYRO, "z", figures="+1.7 deg/s off"), fault(FaultKind.IMU)],
            Reaction.GO_ON,
            None,
        ),
        (
            [fault(FaultKind.GYRO, "x"), fault(FaultKind.ATTITUDE, figures="no rotation")],
            Reaction.RETREAT,
            "the attitude reference is wrong (no rotation)",
        ),
        ([fault(FaultKind.VISION, time=7.0)], Reaction.PAUSE, "vision is lost"),
        ([fault(FaultKind.VISION, time=4.0)], Reaction.RETREAT, "vision is lost"),
        (
            [
                fault(FaultKind.VISION, time=4.0),
                fault(FaultKind.THRUSTER, "v3", figures="gave 3 N where 11 N were"),
            ],
            Reaction.RISE,
            "thruster v3 is lost (gave 3 N where 11 N were)",
        ),
        (
            [fault(FaultKind.THRUSTER, "v3"), fault(FaultKind.ENCODER, "j2")],
            Reaction.WITHDRAW,
            "encoder of j2 is wrong",
        ),
        (
            [fault(FaultKind.ENCODER, "j2"), fault(FaultKind.ESTIMATE)],
            Reaction.STOP,
            "the state estimate is lost",
        ),
    ],
)
def test_the_hardest_reaction_counts_with_its_figures(faults, reaction, said):
    monitors = fault_monitors(blind_time=5.0)
    reaction_of, cause = watch(
        monitors, [0.0] * len(monitors), WorkState.WORK, held(), seen(10.0, faults=faults)
    )
    assert reaction_of is reaction
    assert (None if cause is None else cause.reason) == said
    hull = (
        *monitors,
        Monitor(condition=adrift(0.1), reaction=Reaction.RISE, code=AbortCode.HULL_ADRIFT),
    )
    off = seen(10.0, faults=faults, X_WB=pose(p=[0.2, 0.0, 0.0]))
    harder, _ = watch(hull, [0.0] * len(hull), WorkState.WORK, held(), off)
    assert harder is (reaction if reaction in (Reaction.WITHDRAW, Reaction.STOP) else Reaction.RISE)


# -- a monitor of one's own ------------------------------------------------------------------------


def tilted(limit: float) -> Monitor:
    """The hull tilts by more than `limit` [rad] for half a second while the tool is in contact:
    retreat.
    """

    def found(held: Held, context: Context) -> str:
        del held
        tilt = float(np.arccos(np.clip(context.estimate.X_WB[2, 2], -1.0, 1.0)))
        return f"the hull tilts by {np.degrees(tilt):.0f} degrees" if tilt > limit else ""

    in_contact = frozenset({WorkState.PRESS, WorkState.WORK})
    return Monitor(
        condition=found,
        reaction=Reaction.RETREAT,
        code=AbortCode.HULL_ADRIFT,
        lasting=0.5,
        during=in_contact,
    )


@pytest.mark.parametrize(("tilt", "seconds"), [(0.19, None), (0.21, 0.52)])
def test_a_monitor_of_ones_own(tilt, seconds):
    monitors = [tilted(0.2)]
    false_at = [0.0]
    X_WB = pose(exp_so3([tilt, 0.0, 0.0]), np.zeros(3))
    hits = [
        tick * STEP
        for tick in range(100)
        if watch(monitors, false_at, WorkState.WORK, held(), seen(tick * STEP, X_WB=X_WB))[0]
        is Reaction.RETREAT
    ]
    assert (hits[0] if hits else None) == (None if seconds is None else pytest.approx(seconds))
    assert (
        watch(monitors, [0.0], WorkState.APPROACH, held(), seen(9.0, X_WB=X_WB))[0]
        is Reaction.GO_ON
    )


def test_a_table_that_leads_nowhere_is_refused():
    rows = {"settle": TaskRow(Settle(RestLimits()), WorkState.SETTLE, {PhaseEvent.DONE: "scan"})}
    with pytest.raises(
        ConfigurationError, match="task row 'settle': there is no row 'scan' to follow it"
    ):
        TaskPlanner(rows.items(), (), X_WB=np.eye(4), q=np.zeros(6))


@pytest.mark.parametrize(
    ("moved", "broken"),
    [((0.0, 0.0029, 0.0), False), ((0.0, 0.0031, 0.0), True), ((0.0, 0.0, 0.02), False)],
)
def test_an_object_that_moves_across_the_tool_ends_the_work_and_along_it_does_not(moved, broken):
    """The tool points down: along its axis the force tells what there is to tell."""
    path = ToolPath(
        s=np.array([0.0, 1.0]),
        p=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        z=np.tile([0.0, 0.0, -1.0], (2, 1)),
        x=np.tile([1.0, 0.0, 0.0], (2, 1)),
        on_scan=np.ones(2, dtype=bool),
    )
    placement = Placement(
        X_WB=np.eye(4), travel_W=np.zeros(3), roll=0.0, q_start=np.zeros(6), margin=1.0, reached=1.0
    )
    state = replace(held(), line=ToolLine(path, placement, 0.0))
    moment = replace(
        seen(1.0, 60.0), estimate=replace(estimate(1.0), object_moved_W=np.array(moved))
    )
    monitors = surface_monitors(JOB)
    reaction, cause = watch(monitors, [0.0] * len(monitors), WorkState.WORK, state, moment)
    assert reaction is (Reaction.RETREAT if broken else Reaction.GO_ON)
    assert (cause is not None and cause.code is AbortCode.OBJECT_MOVES) is broken


def test_a_plan_of_another_kind_is_told():
    shared = replace(held(), plan=[1.5])
    assert shared.plan_of(list) == [1.5]
    with pytest.raises(TypeError, match="expected dict, got list"):
        shared.plan_of(dict)
