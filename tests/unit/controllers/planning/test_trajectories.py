"""Motions in time: bounds of speed and acceleration kept and reached, rest at both ends, rates that
are derivatives.
"""

import numpy as np
import pytest

from uuv.controllers.planning.path_poses import samples_along
from uuv.controllers.planning.trajectories import (
    TURN,
    JointMove,
    PoseMove,
    Progress,
    SpeedLaw,
    progress_along,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, rotation_angle

H = 1e-5  # [s] of the differences


def random_move(rng: np.random.Generator) -> tuple[PoseMove, Array, Array]:
    X_from, X_to = (pose(exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2))
    move = PoseMove.between(
        3.0, X_from, X_to, speed=0.25, acceleration=0.08, turn_rate=rng.uniform(0.1, 1.0)
    )
    return move, X_from, X_to


def test_pose_move_keeps_its_bounds_and_meets_one(rng):
    X_from, X_to = (pose(exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2))
    speed, acceleration, turn_rate = (
        rng.uniform(0.1, 0.4),
        rng.uniform(0.03, 0.2),
        rng.uniform(0.1, 1.0),
    )
    move = PoseMove.between(
        3.0, X_from, X_to, speed=speed, acceleration=acceleration, turn_rate=turn_rate
    )
    times = np.linspace(3.0, 3.0 + move.duration, 2001)
    v = np.array([move.at(t)[1] for t in times])
    a = [np.linalg.norm(move.at(t + H)[1] - move.at(t - H)[1]) / (2 * H) for t in times]
    w = [
        rotation_angle(move.at(t - H)[0][:3, :3], move.at(t + H)[0][:3, :3]) / (2 * H)
        for t in times
    ]
    shares = [np.linalg.norm(v, axis=1).max() / speed, max(a) / acceleration, max(w) / turn_rate]
    assert max(shares) == pytest.approx(1.0, abs=1e-3)  # the shortest move within the bounds


def test_pose_move_starts_and_ends_at_rest_where_it_should(rng, within):
    move, X_from, X_to = random_move(rng)
    for time, X in ((-5.0, X_from), (3.0, X_from), (3.0 + move.duration, X_to), (1e3, X_to)):
        within("pose", move.at(time)[0] - X, 1e-14)
        within("velocity at rest [m/s]", move.at(time)[1], 1e-29)  # measured 4e-32
    assert move.done(3.0 + move.duration)
    assert not move.done(2.9 + move.duration)


def test_pose_move_velocity_is_the_derivative(rng, within):
    move, *_ = random_move(rng)
    for t in rng.uniform(3.0, 3.0 + move.duration, 20):
        difference = (move.at(t + H)[0][:3, 3] - move.at(t - H)[0][:3, 3]) / (2 * H)
        # measured 2e-10, rounding over H
        within("velocity [m/s]", move.at(t)[1] - difference, 2e-9)


def test_joint_move(rng, within):
    q_from, q_to = rng.uniform(-3.0, 3.0, (2, 6))
    move = JointMove.between(1.0, q_from, q_to, speed=0.5)
    times = np.linspace(1.0, 1.0 + move.duration, 2001)
    speeds = np.array([move.at(t)[1] for t in times])
    # Either the fastest joint meets its speed, or a short move is bounded by 0.5 rad/s^2.
    assert np.abs(speeds).max() <= 0.5 * (1.0 + 1e-9)
    assert np.abs(np.gradient(speeds, times, axis=0)).max() <= 0.5 * 1.01
    assert np.abs(speeds).max() == pytest.approx(0.5, rel=1e-6)
    # measured 4e-16
    within("ends", np.array([move.at(0.0)[0] - q_from, move.at(1e3)[0] - q_to]), 5e-15)
    assert not move.at(1.0)[1].any()
    assert not move.at(1.0 + move.duration)[1].any()
    t = float(rng.uniform(1.0, 1.0 + move.duration))
    slope = (move.at(t + H)[0] - move.at(t - H)[0]) / (2 * H)
    within("speed [rad/s]", move.at(t)[1] - slope, 5e-10)  # measured 4e-11, rounding over H


@pytest.mark.parametrize(
    ("length", "top"), [(0.6, 0.02), (0.021, 0.02), (0.02, 0.02), (0.005, 0.01)]
)
def test_progress(length, top, within):
    """A trapezoid, or a triangle where the path is too short for the speed: v^2 = length *
    acceleration.
    """
    progress = Progress(length, 0.02, 1.0)
    times = np.linspace(0.0, progress.duration, 5001)
    s, rate = np.array([progress.at(t) for t in times]).T
    assert rate.max() == pytest.approx(top, rel=1e-3)
    assert rate.min() >= 0.0
    assert np.abs(np.diff(rate)).max() / (times[1] - times[0]) <= 0.02 * (1.0 + 1e-6)
    error = np.gradient(s, times, edge_order=2) - rate
    within("rate is the derivative [m/s]", error, 1e-4)  # measured 2e-5, at the corners
    assert progress.at(-1.0) == progress.at(0.0) == (0.0, 0.0)
    assert progress.at(progress.duration) == progress.at(1e3) == (length, 0.0)
    assert length / progress.duration < 0.02


@pytest.mark.parametrize(
    "figures", [(0.0, 0.02, 1.0), (0.6, -0.02, 1.0), (0.6, 0.02, 0.0), (float("nan"), 0.02, 1.0)]
)
def test_progress_that_cannot_be(figures):
    with pytest.raises(ConfigurationError, match="path progress"):
        Progress(*figures)


def bent(radius: float) -> ToolPath:
    """Straight for 0.2 m, a quarter of a circle, straight for 0.2 m."""
    quarter = 0.5 * np.pi * radius
    s = np.linspace(0.0, 0.4 + quarter, 801)
    turn = np.clip((s - 0.2) / radius, 0.0, 0.5 * np.pi)
    p = np.column_stack(
        [np.minimum(s, 0.2) + radius * np.sin(turn), radius * (1.0 - np.cos(turn)), 0.0 * s]
    )
    p[:, 1] += np.maximum(s - 0.2 - quarter, 0.0)
    ones = np.ones((len(s), 1))
    return ToolPath(
        s=s,
        p=p,
        z=ones * [0.0, 0.0, -1.0],
        x=ones * [1.0, 0.0, 0.0],
        on_scan=np.ones(len(s), dtype=bool),
    )


def test_bend_is_taken_as_slowly_as_the_acceleration_asks(within):
    path = bent(0.05)
    speed = 0.1
    bend = 0.05
    law = progress_along(path, 0.0, float(path.s[-1]), speed=speed, ramp=1.0, bend=bend)
    assert isinstance(law, SpeedLaw)
    middle = float(path.s[-1]) / 2.0
    fastest = np.sqrt(bend * 0.05)  # v^2 / radius = bend
    assert np.interp(middle, law.s, law.speed) == pytest.approx(fastest, rel=1e-3)
    assert law.speed.max() == pytest.approx(speed)
    times = np.linspace(0.0, law.duration, 4001)
    s, v = np.array([law.at(t) for t in times]).T
    within("speed is the rate of s [m/s]", np.gradient(s, times)[2:-2] - v[2:-2], 1e-4)
    assert np.abs(np.gradient(v, times)).max() <= speed * 1.01
    assert (s[0], s[-1]) == (0.0, path.s[-1])


def test_without_a_tight_bend_the_motion_is_trapezoidal():
    path = bent(0.5)
    stretch = progress_along(path, 0.1, 0.9, speed=0.1, ramp=2.0)
    assert stretch == Progress(0.8, 0.1, 2.0)
    # just binding: 0.1^2 / 0.5
    law = progress_along(path, 0.1, 0.9, speed=0.1, ramp=2.0, bend=0.0199)
    assert isinstance(law, SpeedLaw)
    assert law.duration == pytest.approx(stretch.duration, rel=0.01)


def over_an_edge(radius: float) -> ToolPath:
    """Straight, over a quarter of a circle about y, straight; the tool's axis stays normal to
    it.
    """
    quarter = 0.5 * np.pi * radius
    s = np.linspace(0.0, 0.4 + quarter, 2001)
    angle = np.clip((s - 0.2) / radius, 0.0, 0.5 * np.pi)
    zero = np.zeros_like(s)
    x = np.column_stack([np.cos(angle), zero, -np.sin(angle)])
    z = np.column_stack([-np.sin(angle), zero, -np.cos(angle)])
    p = np.vstack([np.zeros(3), np.cumsum(np.diff(s)[:, None] * 0.5 * (x[1:] + x[:-1]), axis=0)])
    return ToolPath(s=s, p=p, z=z, x=x, on_scan=np.ones(len(s), dtype=bool))


def test_edge_is_taken_as_slowly_as_the_tool_turns():
    """At TURN the tool turns by 90 degrees in 4.5 s, however sharp the edge is."""
    for radius in (0.05, 0.01):
        path = over_an_edge(radius)
        law = progress_along(path, 0.0, float(path.s[-1]), speed=0.05, ramp=1.0)
        assert isinstance(law, SpeedLaw)
        assert np.interp(0.5 * path.s[-1], law.s, law.speed) == pytest.approx(
            TURN * radius, rel=1e-2
        )


def test_samples_of_an_edge_turn_the_tool_a_little_each():
    path = over_an_edge(0.01)
    at = samples_along(path, 20)
    angles = np.clip((at - 0.2) / 0.01, 0.0, 0.5 * np.pi)
    assert np.diff(angles).max() <= 0.3 + 1e-6
    assert {*np.linspace(0.0, path.s[-1], 20)} <= {*at}
    np.testing.assert_array_equal(
        samples_along(bent(0.5), 20), np.linspace(0.0, bent(0.5).s[-1], 20)
    )
