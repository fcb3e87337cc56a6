"""Figures of work with stops, gaps and a lean, by a hull or on an object that moves, against their
closed forms.
"""

from dataclasses import replace

import numpy as np
import pytest

from recorded_work import SPEED, STEPS, TIME, TRUTH, recorded
from uuv.sim.evaluation.metrics import hull_figures, uncertainty_figures
from uuv.sim.evaluation.surface.force_levels import unjudged_levels
from uuv.sim.evaluation.surface.tool_errors import (
    gap_figures,
    path_error,
    tool_figures,
    true_path_deviation,
)
from uuv.sim.evaluation.surface.tool_speed import speed_figures
from uuv.sim.interfaces.messages import ToolPath, WorkState
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, quat_wxyz_from_rotation
from uuv.sim.loop.recording import STATES, Recording

R_WT = TRUTH.X_WT[:3, :3]
ALONG, ASIDE, OUTWARD = R_WT.T
WORK, RETREAT = STATES.index(WorkState.WORK), STATES.index(WorkState.RETREAT)
PLACE = recorded()["p_command"].value  # of a perfect run


def in_two_stretches() -> Recording:
    """Work along the first and the last 4 s of the path; between them the tool is lifted."""
    lifted = (TIME >= 4.0) & (TIME < 6.0)
    return recorded(
        state=np.where(lifted, RETREAT, WORK), p_pad=PLACE + 0.1 * np.outer(lifted, OUTWARD)
    )


def test_the_way_between_two_stretches_is_not_worked():
    tool, speed = tool_figures(in_two_stretches(), TRUTH), speed_figures(in_two_stretches(), SPEED)
    p = TRUTH.model.path("longitudinal").p
    length = float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())
    assert tool.worked_share == pytest.approx(8.0 * SPEED / length, rel=1e-3)
    assert tool.speed_mean_m_s == pytest.approx(SPEED, rel=1e-3)
    assert speed.mean == pytest.approx(SPEED, rel=1e-9)
    hasty = replace(in_two_stretches())
    tip = hasty["p_pad"].value + 0.2 * np.outer(TIME >= 6.0, ALONG)  # set down 20 cm further on
    moved = {**hasty.series, "p_pad": replace(hasty["p_pad"], value=tip)}
    assert speed_figures(replace(hasty, series=moved), SPEED).mean == pytest.approx(SPEED, rel=1e-9)


def test_rest_does_not_count_in_the_mean_speed():
    """The tool stands still for 4 of 10 s."""
    done = np.minimum(TIME, 3.0) + np.clip(TIME - 7.0, 0.0, None)
    p_tip = PLACE[0] + SPEED * np.outer(done, ALONG)
    moving = (TIME < 3.0) | (TIME >= 7.0)
    velocity = SPEED * np.outer(moving, ALONG)
    recording = recorded(p_command=p_tip, p_pad=p_tip, v_command=velocity)
    assert tool_figures(recording, TRUTH).speed_mean_m_s == pytest.approx(SPEED, rel=2e-3)


def test_a_tip_that_trembles_across_is_no_faster():
    tremble = 1e-3 * np.sin(2.0 * np.pi * 10.0 * TIME)
    figures = speed_figures(recorded(p_pad=PLACE + np.outer(tremble, ASIDE)), SPEED)
    assert figures.mean == pytest.approx(SPEED, rel=1e-6)


def test_a_surface_that_allows_a_share_of_the_speed_sets_it():
    n = np.linspace(0.0, 0.3, 4)
    ones = np.ones((4, 1))
    slow = ToolPath(
        s=n,
        p=n[:, None] * ALONG,
        z=-ones * OUTWARD,
        x=ones * ALONG,
        on_scan=np.ones(4, dtype=bool),
        pace=0.5,
    )
    recording = recorded()
    figures = speed_figures(
        replace(recording, targets=(replace(recording.targets[0], path=slow),)), 2.0 * SPEED
    )
    assert (figures.set, figures.mean) == (pytest.approx(SPEED), pytest.approx(SPEED))


def test_the_lateral_error_is_along_axis_cross_tangent():
    """The tool axis is -z of the object and the tangent x: their cross product is -y."""
    error = path_error(recorded(p_pad=PLACE + 0.0012 * ASIDE))
    assert error is not None
    assert error.lateral == pytest.approx(-0.0012)


def test_a_lean_along_the_path_makes_no_normal_error():
    """The normal is square to the tangent: a tip behind its place is not deeper, however the tool
    leans.
    """
    lean = np.radians(12.0)
    axis = np.tile(-np.cos(lean) * OUTWARD + np.sin(lean) * ALONG, (STEPS, 1))
    error = path_error(recorded(tool_axis=axis, p_pad=PLACE - 0.004 * ALONG - 0.001 * OUTWARD))
    assert error is not None
    assert error.along == pytest.approx(-0.004)
    assert error.normal == pytest.approx(0.001)


def test_a_commanded_motion_of_the_hull_is_no_excursion():
    travel = np.outer(0.03 * TIME, [0.6, -0.8, 0.2])
    off = np.outer((TIME > 5.0) * 0.007, [0.0, 0.6, 0.8])
    hull = hull_figures(recorded(p_WB=travel + off, p_WB_reference=travel))
    assert hull.excursion_max_m == pytest.approx(0.007)


def test_a_touch_in_any_state_counts_where_none_is_meant_to_be():
    """0.3 s at work, and 0.1 s on the way back."""
    force = np.where((TIME >= 2.0) & (TIME < 2.3 - 1e-9), 1.0, 0.0) + np.where(
        TIME >= 9.9 - 1e-9, 1.0, 0.0
    )
    state = np.where(TIME >= 9.0, RETREAT, WORK)
    gap = gap_figures(recorded(contact_normal=force, state=state), replace(TRUTH, contactless=0.03))
    assert gap is not None
    assert gap.touched_s == pytest.approx(0.4)


@pytest.mark.parametrize(
    "same", [np.eye(4), pose(exp_so3([2.0, 0.0, 0.0]))], ids=["as it is", "turned about its axis"]
)
def test_on_an_object_that_moves_the_path_moves_along(same: Array):
    """The barrel drifts and turns; the tip goes with it, 2 mm beside the path, as found at either
    of two turns.
    """
    path = TRUTH.model.path("longitudinal")
    beside = np.array([0.0, 0.002, 0.0])
    tip_T = (
        (same @ np.append(path.p[0], 1.0))[:3]
        + SPEED * TIME[:, None] * [1.0, 0.0, 0.0]
        + same[:3, :3] @ beside
    )
    R = np.array([exp_so3([0.02 * t, -0.03 * t, 0.05 * t]) @ R_WT for t in TIME])
    origin = TRUTH.X_WT[:3, 3] + np.outer(TIME, [0.01, 0.02, -0.005])
    recording = recorded(
        p_WT=origin,
        quat_WT_wxyz=np.array([quat_wxyz_from_rotation(R_WT) for R_WT in R]),
        p_pad=origin + np.einsum("nij,nj->ni", R, tip_T),
    )
    target = replace(recording.targets[0], X_WT=TRUTH.X_WT @ same)
    assert true_path_deviation(replace(recording, targets=(target,)), TRUTH) == pytest.approx(
        0.002, abs=1e-6
    )


def test_the_stated_deviation_on_a_path_is_its_quantile_and_the_error_is_per_degree_of_freedom():
    """3 mm off along the object's x, stated 2 mm an axis and 1 mm of turn at 0.5 m; a turn about x,
    its own, is free.

    Then the squared error is 9 / 4 over five degrees. The path lies along x, from the centre to 1 m
    off it: along it the deviation is 2 mm, normal to it sqrt(4 + (2 s)^2) mm.
    """
    centre = TRUTH.X_WT[:3, 3]
    n = 41
    turn = np.concatenate([np.zeros(3), ALONG])[None]
    matrix = np.diag([4e-6] * 3 + [1e-6] * 3)
    matrix = matrix - 1e-6 * turn.T @ turn
    doubt = PoseCovariance(
        matrix=matrix, free=turn, same=turn, center=centre, radius=0.5, size_sigma=1.0
    )
    s = np.linspace(0.0, 1.0, n)
    ones = np.ones((n, 1))
    path = ToolPath(
        s=s,
        p=centre + s[:, None] * ALONG,
        z=-ones * OUTWARD,
        x=ones * ALONG,
        on_scan=np.ones(n, dtype=bool),
    )
    recording = recorded()
    X_WT = pose(R_WT, centre + 0.003 * ALONG)
    target = replace(recording.targets[0], X_WT=X_WT, path=path, covariance=doubt)
    stated = uncertainty_figures(replace(recording, goes_by=target), TRUTH)
    assert stated.normalised_error == pytest.approx(9.0 / 4.0 / 5.0)
    assert stated.path_along_max_m == pytest.approx(2e-3)
    assert stated.path_normal_max_m == pytest.approx(np.sqrt(8.0) * 1e-3)
    assert stated.path_normal_p95_m == pytest.approx(np.sqrt(4.0 + 1.9**2) * 1e-3)


def test_a_level_of_force_is_judged_on_its_own_part_of_the_path():
    """60 N are set too late for the first half of the path, and held far into the second, which 90
    N were meant for.
    """
    force = np.where(TIME < 4.2, 30.0, np.where(TIME < 7.0, 60.0, 90.0))
    lines = unjudged_levels(recorded(set_force=force), (60.0, 90.0))
    assert lines == ("set force of 60 N, level 1 of 2: judged for 0.00 s, less than 0.5 s",)
