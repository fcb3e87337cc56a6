"""The figures of work in the seabed against their closed forms, on recordings made up for it."""

from types import MappingProxyType

import jsonschema
import numpy as np
import pytest

from uuv import models
from uuv.models.site.seabed import Seabed
from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.seabed_metrics import TrueGround, assess_seabed_work, schema
from uuv.sim.interfaces.messages import Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import exp_so3, quat_wxyz_from_rotation, readonly
from uuv.sim.loop.recording import STATES, Event, Recording, Series

DT, SPEED = 0.002, 0.02  # [s], [m/s]
STEPS = 3000
TIME = DT * np.arange(STEPS, dtype=np.float64)
ONES = np.ones((STEPS, 1))
SLOPE = 0.1
X = np.linspace(-2.0, 2.0, 41)
TILTED = Seabed(
    kind="slope",
    heights=np.tile(SLOPE * X, (41, 1)),
    half=2.0,
    center_W=np.array([0.0, 0.0, -5.0]),
    rocks=np.zeros((0, 3)),
)
BOX = np.array([[-0.8, -0.4, -0.3], [0.8, 0.4, 0.4]])
VEHICLE = Vehicle.of(models.load("uuv_puma").compile())
WORK = TIME >= 2.0  # the last 4 s; before, the tool goes in
STATE = np.where(WORK, STATES.index(WorkState.WORK), STATES.index(WorkState.INSERT))


def surface(x: float) -> np.ndarray:
    return np.array([x, 0.0, -5.0 + SLOPE * x])


def assess(
    core: bool = True, found: bool = True, final: WorkState = WorkState.DONE, **changed: np.ndarray
):
    """A core at 50 N, or a drag at 30 mm along x, perfect but for what is `changed`."""
    command = np.array([surface(0.5) - [0.0, 0.0, 0.1]]) * ONES
    speed = np.zeros((STEPS, 3))
    if not core:
        s = np.maximum(0.0, TIME - 2.0) * SPEED
        command = np.column_stack([0.5 + s, np.zeros(STEPS), -5.0 + SLOPE * (0.5 + s) - 0.03])
        speed[WORK] = [SPEED, 0.0, SPEED * SLOPE]
    columns = {
        "state": STATE[:, None],
        "contact_normal": 50.0 * ONES,
        "contact_force": ONES * [0.0, 3.0, 50.0],
        "collision": 0.0 * ONES,
        "p_command": command,
        "v_command": speed,
        "p_pad": command,
        "tool_axis": ONES * [0.0, 0.0, -1.0],
        "p_WB": ONES * [0.0, 0.0, -3.0],
        "quat_WB_wxyz": ONES * [1.0, 0.0, 0.0, 0.0],
    }
    assert not changed.keys() - columns.keys() - {"contact_least", "contact_most"}
    columns |= changed
    for name in ("contact_least", "contact_most"):  # as where the plant has no substeps
        columns.setdefault(name, columns["contact_normal"])
    series = {
        name: Series(
            time=TIME,
            value=np.asarray(column, dtype=np.float64).reshape(STEPS, -1),
            unit="",
            labels=(),
        )
        for name, column in columns.items()
    }
    ends = np.array([surface(0.5), surface(0.8)])
    ends[:, 2] += 0.004
    ones = np.ones((2, 1))
    path = ToolPath(
        s=np.array([0.0, 0.3]),
        p=readonly(ends),
        z=ones * [0.0, 0.0, -1.0],
        x=ones * [1.0, 0.0, 0.0],
        on_scan=np.ones(2, dtype=bool),
    )
    target = Target(
        time=0.0,
        X_WT=np.eye(4),
        accepted=found,
        check_m=0.002,
        range_m=2.0,
        reason="",
        path=path if found else None,
    )
    recording = Recording(
        timestep=DT,
        duration=STEPS * DT,
        vehicle=VEHICLE,
        series=MappingProxyType(series),
        events=(
            Event(time=0.0, state=final, note="two layers" if final is WorkState.ABORT else ""),
        ),
        targets=(target,),
        clouds=MappingProxyType({}),
    )
    truth = TrueGround(
        ground=TILTED, hull_box=BOX, push=50.0 if core else None, depth=0.18 if core else 0.03
    )
    assessment = assess_seabed_work(recording, truth, seed=1, wall_s=2.0)
    jsonschema.validate(assessment.metrics, schema())
    return assessment


def test_a_perfect_core(within):
    assessment = assess()
    assert assessment.accepted, assessment.failed
    core = assessment.metrics["core"]
    within("push error", core["push_error_share"], 1e-12)
    within("depth [m]", core["depth_m"] - 0.1, 1e-9)
    within("held [s]", core["held_s"] - 4.0, 2e-3)
    within("rise [m]", assessment.metrics["hull"]["rise_max_m"], 1e-12)
    within("target [m]", assessment.metrics["surface"]["target_error_max_m"] - 0.004, 1e-9)
    within(
        "of what is allowed",
        assessment.metrics["surface"]["target_error_share"] - 0.004 / 0.02,
        1e-6,
    )
    # The nearest place of the slope to the box is under its lower front edge, up to the grid of 0.1
    # m.
    within("gap [m]", assessment.metrics["hull"]["ground_gap_m"] - (1.7 - SLOPE * 0.8), 0.02)


def test_a_push_that_is_off_for_a_moment_counts(within):
    push = 50.0 * ONES
    push[2000:2010] = 46.0  # while held
    push[500] = 80.0  # on the way in
    assessment = assess(contact_normal=push)
    within("worst", assessment.metrics["core"]["push_error_share"] - 0.08, 1e-12)
    within("peak [N]", assessment.metrics["core"]["push_max_n"] - 80.0, 1e-12)
    assert assessment.failed == ("push while held, worst: 8 %, allowed 5 %",)


def test_rise_counts_from_the_first_touch(within):
    p_WB = ONES * [0.0, 0.0, -3.0]
    p_WB[:400, 2] -= 0.05  # before it touches
    p_WB[2000:2100] += [0.03, 0.0, 0.025]
    push = 50.0 * ONES
    push[:500] = 0.0
    hull = assess(p_WB=p_WB, contact_normal=push).metrics["hull"]
    within("rise [m]", hull["rise_max_m"] - 0.025, 1e-12)
    within("sink [m]", hull["sink_max_m"], 1e-12)
    within("excursion [m]", hull["excursion_max_m"] - np.hypot(0.03, 0.025), 1e-12)


def test_a_drag_off_its_path(within):
    perfect = assess(core=False)
    assert perfect.accepted, perfect.failed
    within("force [N]", perfect.metrics["drag"]["force_max_n"] - np.hypot(3.0, 50.0), 1e-9)
    tip = np.column_stack(
        [0.5 + np.maximum(0.0, TIME - 2.0) * SPEED, np.zeros(STEPS), np.zeros(STEPS)]
    )
    tip[:, 2] = -5.0 + SLOPE * tip[:, 0] - 0.03
    tip[2500:2600] += [0.0, 0.004, -0.006]
    drag = assess(core=False, p_pad=tip)
    # The tangent is not quite square to the axis.
    within("deeper [m]", drag.metrics["drag"]["depth_error_max_m"] - 0.006, 3e-4)
    within("aside [m]", drag.metrics["drag"]["side_max_m"] - 0.004, 1e-9)
    within(
        "under the true surface [m]", drag.metrics["drag"]["true_depth_error_max_m"] - 0.006, 1e-9
    )
    assert [line.split(":")[0] for line in drag.failed] == [
        "depth error, peak",
        "cross-track error, peak",
    ]


def test_work_that_was_refused_has_no_figures():
    state = np.full((STEPS, 1), STATES.index(WorkState.SCAN))
    assessment = assess(found=False, final=WorkState.ABORT, state=state)
    assert assessment.metrics["core"] is None
    assert assessment.metrics["hull"]["rise_max_m"] is None
    assert not assessment.accepted
    assert any("no value" in line for line in assessment.failed)
    assert "the run ended in state abort: two layers" in assessment.failed


def test_work_without_an_error_has_none_in_its_figures():
    core = assess().metrics
    drag = assess(core=False).metrics
    assert core["core"]["push_error_share"] == pytest.approx(0.0, abs=1e-12)
    assert drag["drag"]["depth_error_max_m"] == pytest.approx(0.0, abs=1e-3)
    for metrics in (core, drag):
        share = metrics["surface"]["target_error_share"]
        assert share == pytest.approx(0.004 / 0.0225, rel=0.2)


def test_the_hull_against_the_ground_when_it_is_turned(within):
    quat = quat_wxyz_from_rotation(exp_so3([0.0, 0.0, np.pi]))  # up the slope with its stern
    turned = assess(quat_WB_wxyz=ONES * quat).metrics["hull"]["ground_gap_m"]
    # the box is symmetric
    within("gap [m]", turned - assess().metrics["hull"]["ground_gap_m"], 1e-9)
    low = assess(p_WB=ONES * [0.0, 0.0, -4.8]).metrics["hull"]["ground_gap_m"]
    assert low == pytest.approx(0.0, abs=1e-12)


def test_the_hull_against_the_ground_when_it_is_askew(within):
    """Banked by 25 deg and turned: the lowest corner of its box is the nearest, by the sine and
    cosine of the bank.
    """
    turn = np.radians(90.0)
    bank = np.radians(25.0)
    depth = -4.0
    quat = quat_wxyz_from_rotation(exp_so3([0.0, 0.0, turn]) @ exp_so3([bank, 0.0, 0.0]))
    # Turned by 90 deg, the hull's y points to -x of W: its right side, y = -0.4, hangs down and
    # towards +x.
    y, z = BOX[0, 1], BOX[0, 2]
    low = depth + y * np.sin(bank) + z * np.cos(bank)
    x = -(y * np.cos(bank) - z * np.sin(bank))
    gap = assess(quat_WB_wxyz=ONES * quat, p_WB=ONES * [0.0, 0.0, depth]).metrics["hull"][
        "ground_gap_m"
    ]
    # the grid of 0.1 m
    within("gap [m]", gap - (low - (-5.0 + SLOPE * x)) / np.hypot(1.0, SLOPE), 0.02)


def test_the_greatest_pull_is_that_of_the_substeps(within):
    """On the way in the tube is pulled with 7 N for a moment, and pushed at all other times."""
    least = 50.0 * ONES
    least[700] = -7.0
    core = assess(contact_least=least).metrics["core"]
    within("pull [N]", core["pull_max_n"] - 7.0, 1e-12)
