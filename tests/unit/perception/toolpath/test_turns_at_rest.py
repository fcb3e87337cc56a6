"""A tool that is not round stops in a corner and turns there: the path that is planned for it."""

import numpy as np
import pytest

from uuv.models.objects.axis_steps import Steps
from uuv.models.objects.barrel import around_corner
from uuv.perception.toolpath.path_planner import path_on_model
from uuv.perception.toolpath.turns_at_rest import turning_at_rest
from uuv.sim.interfaces.spatial import exp_so3, pose

EVERYWHERE = pose(exp_so3([0.4, -1.1, 2.0]), [0.3, -0.2, 5.0])


@pytest.mark.parametrize("corner", [-90.0, 30.0, 90.0, 150.0])
def test_the_tool_turns_at_rest_by_the_corner(corner, within):
    whole = around_corner(np.radians(corner))
    path = path_on_model(EVERYWHERE, whole.turned(0.0, dwell=True))
    moving = path_on_model(EVERYWHERE, whole)  # of a round tool
    step = np.linalg.norm(np.diff(path.p, axis=0), axis=1)
    resting = step == 0.0
    # once, in one place
    assert np.diff(np.flatnonzero(resting)).tolist() == [1] * (resting.sum() - 1)
    ends = np.flatnonzero(resting)[[0, -1]] + [0, 1]
    within("s of the turn [m]", np.diff(path.s[ends]) - 0.02 * np.radians(abs(corner)), 1e-12)
    within("place, s [m]", path.s[ends[0]] - 0.2, 0.005)  # the spline rounds the corner
    around = np.concatenate([np.flatnonzero(~resting), [len(path.s) - 1]])
    within("way [m]", path.p[around] - moving.p, 1e-12)
    angle = [
        np.arctan2(np.cross(path.x[ends[0]], x) @ path.z[ends[0]], path.x[ends[0]] @ x)
        for x in path.x
    ]
    # the tool axis points inwards
    within("turned [rad]", angle[ends[1]] + np.radians(corner), 1e-9)
    assert np.all(np.sign(-corner) * np.diff(angle[ends[0] : ends[1] + 1]) > 0.0)
    # Before and after, x lies along the path but for where the spline has rounded the corner.
    straight = np.abs(path.s - 0.5 * path.s[ends].sum()) > 0.06
    tangent = np.gradient(path.p, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    within(
        "x off the path [rad]", np.linalg.norm(np.cross(tangent, path.x)[straight], axis=1), 0.03
    )


def test_steps_taken_out_and_put_back_are_the_same_axes(rng, within):
    z = np.tile([0.0, 0.0, 1.0], (40, 1)) + 0.02 * np.cumsum(rng.normal(size=(40, 3)), axis=0)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    turn = np.where(np.arange(40) > 12, 1.0, 0.0) - np.where(np.arange(40) > 30, 2.2, 0.0)
    x = np.cross(z, np.column_stack([-np.sin(turn), np.cos(turn), 0.0 * turn]))
    x = np.cross(x / np.linalg.norm(x, axis=1, keepdims=True), z)
    steps = Steps.of(z, x)
    assert steps.after.tolist() == [12, 30]
    within("angles [rad]", steps.angle - [1.0, -2.2], 0.03)
    smooth = steps.taken_out(z, x)
    assert not len(Steps.of(z, smooth).after)
    within("put back", steps.put_back(z, smooth, np.arange(40)) - x, 1e-12)


def test_a_path_without_a_corner_is_itself():
    path = path_on_model(np.eye(4), around_corner(np.radians(90.0)).turned(0.3, blend=0.1))
    assert turning_at_rest(path) is path
