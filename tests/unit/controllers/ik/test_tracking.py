"""Tracking of tool poses through singular configurations, and answers that keep their branch."""

import numpy as np
import pytest

from untyped import untyped
from uuv.controllers.ik.method import Method
from uuv.controllers.ik.tracking import Passing
from uuv.controllers.ik.tracking_solvers import solve_at, solver_address
from uuv.controllers.mkps import Chain, IkOptions, Track, Tracker, solve, track
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose

H = np.pi / 2
PUMA = [
    (0, 0, 0, H),
    (0, 0, 0.4318, 0),
    (0, 0.15005, 0.0203, -H),
    (0, 0.4318, 0, H),
    (0, 0, 0, -H),
    (0, 0.1, 0, 0),
]
SEVEN = [
    (0, 0.34, 0, -H),
    (0, 0, 0, H),
    (0, 0.4, 0, H),
    (0, 0, 0, -H),
    (0, 0.4, 0, -H),
    (0, 0, 0, H),
    (0, 0.126, 0, 0),
]
PERIOD = 0.01  # [s]


def straight(X_a: Array, X_b: Array, count: int) -> Array:
    """Poses on a straight line, turning about one axis at a steady rate."""
    turn = log_so3(X_a[:3, :3].T @ X_b[:3, :3])
    return np.array(
        [
            pose(X_a[:3, :3] @ exp_so3(s * turn), (1 - s) * X_a[:3, 3] + s * X_b[:3, 3])
            for s in np.linspace(0, 1, count)
        ]
    )


def through_the_wrist_lock(chain: Chain, miss: float) -> tuple[Array, Array]:
    """A start, and poses that tilt the tool past the gimbal lock of a PUMA's wrist, missed by
    `miss` [rad].
    """
    q0 = np.array([0.2, -0.4, 0.9, 2.0 * miss, 0.5, 0.1])
    return q0, straight(chain.forward(q0), chain.forward([0.2, -0.4, 0.9, 0.0, -0.5, 0.1]), 300)


def errors_along(chain: Chain, poses: Array, q: Array) -> tuple[Array, Array]:
    X = np.array([chain.forward(row) for row in q])
    turns = np.array([log_so3(a[:3, :3].T @ b[:3, :3]) for a, b in zip(X, poses, strict=True)])
    return np.sqrt(np.sum((X - poses)[:, :3, 3] ** 2, axis=1)), np.sqrt(np.sum(turns**2, axis=1))


def largest_speed(result: Track) -> float:
    return float(np.abs(result.qd).max())


@pytest.mark.parametrize("miss", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("passing", ["auto", "limit"])
def test_passing_a_gimbal_lock_keeps_the_speed_limits_and_comes_back(
    miss: float, passing: Passing
) -> None:
    chain = Chain.from_dh(PUMA)
    q0, poses = through_the_wrist_lock(chain, miss)
    spun = track(chain, poses, q0, PERIOD, passing="off")
    assert np.all(spun.converged)
    assert largest_speed(spun) > 5.0  # [rad/s]; measured 13 to 71
    passed = track(chain, poses, q0, PERIOD, passing=passing, speed_limits=1.0)
    assert largest_speed(passed) <= 1.0 + 1e-9
    assert set(passed.way) > {"none"}
    assert passed.converged[-1]
    position, orientation = errors_along(chain, poses, passed.q)
    np.testing.assert_allclose(passed.position_error, position, atol=1e-12)
    np.testing.assert_allclose(passed.orientation_error, orientation, atol=1e-7)
    assert position.max() < 0.01  # [m], measured up to 0.0020
    assert orientation.max() < 0.3  # [rad], measured up to 0.079: the price of not spinning
    active = np.array([way != "none" for way in passed.way])
    assert np.all(passed.converged[~active])
    assert not np.any(passed.restricted[~active])


def test_the_way_of_passing_follows_nearness() -> None:
    """Held where the arm is nearest to the lock, limited round about, free elsewhere [Danilov 2021,
    ch. 4].
    """
    chain = Chain.from_dh(PUMA)
    q0, poses = through_the_wrist_lock(chain, 0.02)
    passed = track(chain, poses, q0, PERIOD, near=0.1, passing="auto")
    way = np.array(passed.way)
    assert np.all(passed.nearness[way == "hold"] < 0.025)
    assert np.any(way == "hold")
    held = passed.restricted[way == "hold"]
    assert np.all(held.any(axis=1))
    spinning = [3, 5]  # the two roll joints that line up
    assert np.all(held[:, spinning].any(axis=1))
    only_hold = track(chain, poses, q0, PERIOD, passing="hold")
    assert "hold" in only_hold.way
    assert "hold" not in track(chain, poses, q0, PERIOD, passing="limit").way


def test_a_held_joint_is_let_go() -> None:
    """The path ends in the lock, where the plain solution would spin for good; the paper's joint is
    held, then not.
    """
    chain = Chain.from_dh(PUMA)
    q0, poses = through_the_wrist_lock(chain, 0.005)
    waiting = np.concatenate(
        [poses[: len(poses) // 2], np.tile(poses[-1], (round(5.0 / PERIOD), 1, 1))]
    )
    run = track(
        chain, waiting, q0, PERIOD, passing="hold", hold_joint=3, near=np.inf, speed_limits=0.2
    )
    held = np.array([way == "hold" for way in run.way])
    assert held.any()
    assert np.all(run.restricted[held, 3])
    assert PERIOD * held.sum() <= 2.0 + PERIOD
    assert run.way[-1] != "hold"
    with pytest.raises(ConfigurationError, match=r"hold_joint: .* got 6"):
        Tracker(chain, PERIOD, hold_joint=6)


def test_nearness_is_the_least_singular_value() -> None:
    chain = Chain.from_dh(PUMA)
    tracker = Tracker(chain, PERIOD)
    rng = np.random.default_rng(4)
    for q in rng.uniform(-2, 2, (5, 6)):
        J = chain.jacobian(q)
        # about one unit long
        J[:3] *= 2.0 ** -round(np.log2(0.4318 + 0.1501 + 0.0203 + 0.4318 + 0.1))
        _, step = tracker.step(tracker.init(q), chain.forward(q))
        assert abs(step.nearness - np.linalg.svd(J)[1][-1]) < 1e-9
    locked = np.array([0.2, -0.4, 0.9, 0.3, 0.0, 0.1])
    _, step = tracker.step(tracker.init(locked), chain.forward(locked))
    assert step.nearness < 1e-9


@pytest.mark.parametrize("method", ["hybrid", "jacobian_free", "plain"])
def test_far_from_singular_configurations_passing_changes_nothing(method: Method) -> None:
    chain = Chain.from_dh(SEVEN)
    q0 = np.array([0.1, 0.6, 0.3, 1.2, 0.2, 0.7, 0.1])
    goal = chain.forward(q0)
    goal[:3, 3] += [0.0, 0.1, -0.05]
    poses = straight(chain.forward(q0), goal, 100)
    options = {
        "period": PERIOD,
        "method": method,
        "position_tolerance": 1e-5,
        "orientation_tolerance": 1e-4,
    }
    passed = track(chain, poses, q0, **options)
    plain = track(chain, poses, q0, passing="off", **options)
    assert set(passed.way) == {"none"}
    assert np.all(passed.converged)
    np.testing.assert_array_equal(passed.q, plain.q)
    np.testing.assert_allclose(passed.qd[1:], np.diff(passed.q, axis=0) / PERIOD, atol=1e-12)
    np.testing.assert_allclose(passed.time, PERIOD * np.arange(1, 101))


def test_a_tracker_keeps_no_state_of_its_own() -> None:
    """Two arms tracked in turn by one tracker go where each goes alone."""
    chain = Chain.from_dh(PUMA)
    q0, poses = through_the_wrist_lock(chain, 0.02)
    tracker = Tracker(chain, PERIOD)
    first = two = tracker.init(q0)
    for i in range(200):
        first, _ = tracker.step(first, poses[i])
        if i % 2:
            two, _ = tracker.step(two, poses[i])
    alone = track(chain, poses[:200], q0, PERIOD)
    np.testing.assert_array_equal(first.q, alone.q[-1])
    assert not np.array_equal(first.q, two.q)


@pytest.mark.parametrize("method", ["jacobian_free", "plain"])
def test_a_solver_called_by_address_has_the_bits_of_solve(method: Method) -> None:
    chain = Chain.from_dh(PUMA)
    rng = np.random.default_rng(5)
    for _ in range(20):
        q0 = rng.uniform(-2.0, 2.0, chain.n)
        X = np.ascontiguousarray(chain.forward(q0 + rng.uniform(-0.05, 0.05, chain.n)))
        q = np.empty(chain.n)
        errors = np.empty(2)
        code = solve_at(
            solver_address(method), chain.memory(), X, q0, (1e-6, 1e-5), 4000, q, errors
        )
        most = IkOptions(max_iterations=4000)
        solution = solve(chain, X, q0, 1e-6, 1e-5, method=method, branch="keep", options=most)
        assert (code == 0) == solution.converged
        assert np.array_equal(q, solution.q)
        assert (errors[0], errors[1]) == (solution.position_error, solution.orientation_error)


def test_tracking_keeps_joint_limits() -> None:
    limits = np.tile([-2.8, 2.8], (6, 1))
    limits[4] = 0.2, 2.8  # the wrist may not straighten
    chain = Chain.from_dh(PUMA, limits=limits)
    q0, poses = through_the_wrist_lock(Chain.from_dh(PUMA), 0.02)
    tracked = track(chain, poses, q0, PERIOD)
    assert np.all((tracked.q >= limits[:, 0]) & (tracked.q <= limits[:, 1]))
    assert not tracked.converged[-1]


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"period": 0.0}, "period"),
        ({"speed_limits": [1.0]}, "speed_limits"),
        ({"speed_limits": -1.0}, "speed_limits"),
        ({"passing": "jump"}, "passing: allowed auto"),
        ({"method": "magic"}, "method: allowed hybrid"),
        ({"near": np.nan}, "near"),
        ({"spare_joints": "no"}, "spare_joints: must be True or False"),
        ({"position_tolerance": 0.0}, "position_tolerance"),
        ({"orientation_tolerance": 3.2}, "orientation_tolerance: must be under pi"),
        ({"q0": np.full(6, 9.0)}, "q0: joint1"),
        ({"X_base_tip": np.eye(4)}, "X_base_tip"),
        ({"X_base_tip": np.ones((2, 4, 4))}, "X_base_tip.*pose"),
    ],
)
def test_bad_tracking_is_refused(change: dict[str, object], names: str) -> None:
    chain = Chain.from_dh(PUMA, limits=np.tile([-3, 3], (6, 1)))
    q0, poses = through_the_wrist_lock(chain, 0.02)
    arguments: dict[str, object] = {"X_base_tip": poses[:3], "q0": q0, "period": PERIOD} | change
    with pytest.raises(ConfigurationError, match=names):
        track(chain, **untyped(arguments))


def test_tolerances_that_differ_very_much_are_tracked() -> None:
    chain = Chain.from_dh(PUMA, limits=np.tile([-3, 3], (6, 1)))
    q0, poses = through_the_wrist_lock(chain, 0.02)
    tracked = track(
        chain, poses[:3], q0, PERIOD, position_tolerance=1e-3, orientation_tolerance=1e-7
    )
    assert tracked.converged.all()
    assert tracked.orientation_error.max() <= 1e-7


def test_keep_refuses_answers_beyond_a_singular_configuration_of_seven_joints() -> None:
    """Elbow q4 to -q4 of a seven-joint arm crosses the stretched arm; a turn of the whole elbow
    does not.
    """
    chain = Chain.from_dh(SEVEN)
    q0 = np.array([0.1, 0.5, 0.2, 1.0, 0.3, 0.8, 0.2])
    mirrored = q0 * [1, 1, 1, -1, 1, 1, 1]
    lost = 0
    for near in np.linspace(0.0, 0.2, 5):
        target = chain.forward(mirrored + near)
        solution = solve(chain, target, q0, branch="keep")
        if solution.converged:
            assert solution.q[3] * q0[3] > 0.0
        lost += "singular" in solution.cause
        assert solve(chain, target, q0).converged
    print(f"{lost} of 5 lost their branch")
    # far, but on the branch: the arm's self-motion and the joints about it
    for shift in (0.7, 0.9):
        moved = q0 + shift * np.array([1.0, 0.0, 0.0, 0.1, 0.0, 0.1, 1.0])
        solution = solve(chain, chain.forward(moved), q0, branch="keep")
        assert solution.converged
        assert solution.cause == "converged"


@pytest.mark.parametrize("count", [3, 6])
def test_keep_tells_elbow_up_from_elbow_down(count: int) -> None:
    """A planar arm of three joints and a PUMA: the straight way between the two postures crosses
    the stretched arm.
    """
    if count == 3:
        chain = Chain.from_dh([(0, 0, 0.5, 0), (0, 0, 0.4, 0), (0, 0, 0.2, 0)])
        down = np.array([0.2, 1.0, 0.3])
        up = np.array([1.2, -0.9, 0.4])
    else:
        chain = Chain.from_dh(PUMA)
        down = np.array([0.3, -0.4, 0.6, 0.2, 0.9, 0.1])
        up = np.array([0.3, 0.5, 2.7, 0.2, 0.9, 0.1])
    for blend in np.linspace(0.0, 1.0, 21):
        solution = solve(chain, chain.forward(down + blend * (up - down)), down, branch="keep")
        assert solution.restarts == 0
        if solution.converged:
            square = [
                chain.jacobian(q)[[0, 1, 5]] if count == 3 else chain.jacobian(q)
                for q in (down, solution.q)
            ]
            assert np.linalg.det(square[0]) * np.linalg.det(square[1]) > 0.0
        else:
            assert "converged" not in solution.cause
