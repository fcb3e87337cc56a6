"""Kinematics kernels, one by one and uncompiled, against matrices, determinants and published
numbers.
"""

import math

import numpy as np
import pytest

from plain_chains import SCALE, by_exponentials, drawn_chain, drawn_q, kernels, plain
from uuv.controllers.ik.chain import Chain
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose

H = np.pi / 2
PUMA = [
    (0, 0, 0, H),
    (0, 0, 0.4318, 0),
    (0, 0.15005, 0.0203, -H),
    (0, 0.4318, 0, H),
    (0, 0, 0, -H),
    (0, 0, 0, 0),
]


def unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def test_forward_is_the_product_of_exponentials_and_its_jacobian_the_derivative(
    rng: np.random.Generator,
) -> None:
    for kinds in ("rporrr", "oprpo", "rrrrrrr"):
        it = plain(drawn_chain(rng, kinds))
        q = drawn_q(it.chain, rng)
        X = np.empty((4, 4))
        J = np.empty((6, it.chain.n))
        kernels.forward(it.table, q, it.work, X, J)
        np.testing.assert_allclose(X, by_exponentials(it.chain, q), atol=1e-13)  # measured 1e-15
        h = 1e-5
        for i in range(it.chain.n):
            ahead, behind = (
                by_exponentials(it.chain, q + s * h * np.eye(it.chain.n)[i]) for s in (1, -1)
            )
            linear = (ahead[:3, 3] - behind[:3, 3]) / (2 * h)
            angular = log_so3(ahead[:3, :3] @ behind[:3, :3].T) / (2 * h)
            np.testing.assert_allclose(J[:, i], [*linear, *angular], atol=1e-8)  # measured 1e-10


def test_orientation_error_is_the_axis_times_the_chord(rng: np.random.Generator) -> None:
    axes = [*np.eye(3), *-np.eye(3), *(unit(rng) for _ in range(12))]
    goal = np.zeros((4, 3))
    for axis in axes:
        R = exp_so3(rng.normal(size=3))
        for angle in (1e-7, 0.3, 1.6, 2.9, 3.0, 3.05, 3.141, math.pi - 1e-6):
            goal[1:] = (exp_so3(angle * axis) @ R).T
            *error, chord2 = kernels.turn_left(goal, (0.0, 0.0, 0.0, *R.T.ravel()))
            chord = 2.0 * math.sin(0.5 * angle)
            # Near half a turn the axis is a column of R + 1, which is parallel to it at half a turn
            # alone.
            near = 2.0 * math.sin(angle) if math.cos(angle) <= -0.99 else 0.0
            np.testing.assert_allclose(error, chord * axis, rtol=0.0, atol=1e-12 + near)
            assert np.linalg.norm(error) == pytest.approx(chord, rel=1e-9)
            assert chord2 == pytest.approx(chord**2, abs=1e-12)


def test_half_a_turn_has_a_whole_chord() -> None:
    for axis in np.vstack([np.eye(3), unit(np.random.default_rng(2))]):
        goal = np.zeros((4, 3))
        goal[1:] = 2.0 * np.outer(axis, axis) - np.eye(3)
        *error, chord2 = kernels.turn_left(goal, (0.0, 0.0, 0.0, *np.eye(3).ravel()))
        assert chord2 == pytest.approx(4.0)
        assert abs(np.dot(error, axis)) == pytest.approx(2.0)


def test_chords_and_angles_are_each_others_inverse() -> None:
    for angle in np.linspace(0.0, math.pi, 50):
        assert kernels.chord_squared(angle) == pytest.approx(2.0 - 2.0 * math.cos(angle), abs=1e-14)
        assert kernels.angle_of(kernels.chord_squared(angle)) == pytest.approx(angle, abs=1e-7)
    assert kernels.chord_squared(5.0) == kernels.chord_squared(math.pi)
    assert kernels.angle_of(4.0 + 1e-12) == pytest.approx(math.pi)


def test_goal_is_the_pose_of_the_last_joint_frame(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng))
    X = pose(exp_so3(rng.normal(size=3)), rng.normal(size=3))
    assert kernels.set_goal(it.table, X, it.goal)
    np.testing.assert_allclose(it.goal[0], SCALE * X[:3, 3])
    np.testing.assert_allclose(it.goal[1:].T, X[:3, :3] @ it.tool.T, atol=1e-14)


def test_a_target_is_a_pose_in_each_of_its_numbers(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng))
    X = pose(exp_so3([0.5, 0.7, -0.6]), rng.normal(size=3))
    for i in range(4):
        for k in range(4):
            for change, good in (
                (1e-10, True),
                (1e-4, i < 3 and k == 3),
                (math.nan, False),
                (math.inf, False),
            ):
                bad = X.copy()
                bad[i, k] += change
                assert kernels.set_goal(it.table, bad, it.goal) == good, (i, k, change)
    left_handed = X @ np.diag([1.0, 1.0, -1.0, 1.0])
    assert not kernels.set_goal(it.table, left_handed, it.goal)
    assert not kernels.set_goal(it.table, X @ np.diag([2.0, 2.0, 2.0, 1.0]), it.goal)


def test_what_a_solver_is_given_is_judged(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrprr"))
    X = by_exponentials(it.chain, drawn_q(it.chain, rng))

    def begin(X: Array = X, q0: Array | None = None, good: bool = True, leaps: bool = True) -> int:
        start = np.zeros(5) if q0 is None else q0
        return kernels.begin(it.table, X, start, good, leaps, it.goal, it.work, it.q)

    assert begin() == kernels.CONVERGED
    assert begin(good=False) == kernels.BAD_OPTION
    assert begin(X=np.zeros((4, 4))) == kernels.BAD_TARGET
    assert begin(X=np.eye(5)) == kernels.BAD_TARGET
    assert begin(q0=np.zeros(4)) == kernels.BAD_START
    assert begin(q0=np.array([0, 0, 0, 0, math.nan])) == kernels.BAD_START
    # As far from the first joint as the arm can reach, a little less, a little more.
    base = it.chain.points[0]
    reach = it.table[0, kernels.REACH] / SCALE
    for share, code in ((0.999, kernels.CONVERGED), (1.001, kernels.OUT_OF_REACH)):
        for axis in (*np.eye(3), *-np.eye(3)):
            assert begin(X=pose(p=base + share * reach * axis)) == code
    # A start beyond the limits: hinges may come round by a turn, slides are clamped.
    lower, upper = it.chain.limits.T
    q0 = np.array([lower[0] + 2 * math.pi, 0.1, upper[2] + 1.0, upper[3] + 0.1, lower[4] - 0.1])
    assert begin(q0=q0) == kernels.CONVERGED
    np.testing.assert_allclose(it.q, [lower[0], 0.1, upper[2], upper[3], lower[4]])
    np.testing.assert_array_equal(it.work[:, kernels.START], it.q)
    begin(q0=q0, leaps=False)
    np.testing.assert_allclose(it.q, [upper[0], 0.1, upper[2], upper[3], lower[4]])


def test_the_reach_bounds_every_configuration(rng: np.random.Generator) -> None:
    for kinds in ("rrprr", "oorp", "rrrrrr"):
        it = plain(drawn_chain(rng, kinds))
        tips = np.array(
            [by_exponentials(it.chain, drawn_q(it.chain, rng))[:3, 3] for _ in range(60)]
        )
        assert (
            SCALE * np.linalg.norm(tips - it.chain.points[0], axis=1).max()
            < it.table[0, kernels.REACH]
            < 10.0
        )
    straight = plain(Chain.from_dh([(0, 0, 0.5, 0), (0, 0, 0.25, 0), (0, 0, 0.25, 0)]))
    assert straight.table[0, kernels.REACH] == pytest.approx(SCALE * 1.0)


@pytest.mark.parametrize(
    ("value", "hinge", "admitted"),
    [
        (0.3, True, 0.3),
        (-1.0, True, -1.0),
        (2.0, True, 2.0),
        (2.5, True, 2.0),  # a turn back is -3.8
        (2 * math.pi - 0.5, True, -0.5),
        (2 * math.pi - 0.5, False, 2.0),
        (-2 * math.pi + 1.5, True, 1.5),
        (-2 * math.pi + 1.5, False, -1.0),
        (-1.5, True, -1.0),
        (9.0, True, 2.0),  # one turn back is 2.72
    ],
)
def test_a_joint_value_is_admitted_within_limits(
    value: float, hinge: bool, admitted: float
) -> None:
    assert kernels.admit(value, -1.0, 2.0, hinge, 2 * math.pi) == pytest.approx(admitted)


def test_wound_up_hinges_are_folded_back(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrop", limit=3.1))
    q = drawn_q(it.chain, rng)
    turns = rng.integers(-3, 4, (20, 4)) * [1, 1, 1, 0]
    for wound in turns:
        it.q[:] = q + 2 * math.pi * wound
        assert kernels.fold(it.table, it.q)
        np.testing.assert_allclose(it.q, q, atol=1e-12)
    it.q[:] = q
    it.q[3] = it.chain.limits[3, 1] + 1e-3  # a slide has no turns
    assert not kernels.fold(it.table, it.q)
    it.q[:] = q
    it.q[0] = math.pi  # between the limits and their next turn
    assert not kernels.fold(it.table, it.q)


def test_restarts_are_drawn_by_splitmix64() -> None:
    """Published values of the generator for seed 0, then: uniform, and no two alike."""
    published = (0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F)
    with np.errstate(over="ignore"):
        assert [kernels.restart_angle(0, k) for k in range(3)] == [
            (v >> 11) * 2.0**-53 for v in published
        ]
        drawn = np.array([kernels.restart_angle(r, k) for r in range(60) for k in range(8)])
    assert len(set(drawn)) == 480
    np.testing.assert_allclose(np.histogram(drawn, 4, (0.0, 1.0))[0], 120, atol=45)


def test_starts_of_restarts_fill_the_limits_or_one_turn_about_the_first() -> None:
    limits = np.array(
        [(-1.0, 0.5), (-np.inf, np.inf), (-9.0, 9.0), (-0.1, 9.0), (-np.inf, np.inf), (-50.0, 50.0)]
    )
    chain = Chain.from_dh(np.tile([0.1, 0.1, 0.3, 1.0], (6, 1)), "rrrppr", limits=limits)
    it = plain(chain)
    it.work[:, kernels.START] = start = np.array([0.0, 4.0, 8.5, 8.0, -3.0, -49.5])
    starts = []
    with np.errstate(over="ignore"):
        for restart in range(1, 200):
            kernels.scatter(it.table, restart, it.work, it.q)
            starts.append(it.q.copy())
    low = np.array(
        [-1.0, 4.0 - math.pi, 9.0 - 2 * math.pi, 9.0 - 2 / SCALE, -3.0 - 1 / SCALE, -50.0]
    )
    size = np.array([1.5, 2 * math.pi, 2 * math.pi, 2 / SCALE, 2 / SCALE, 2 * math.pi])
    share = (np.array(starts) - low) / size
    assert np.all((share >= 0.0) & (share <= 1.0))
    assert np.all(share.min(axis=0) < 0.05)
    assert np.all(share.max(axis=0) > 0.95)
    assert np.all((start - low) / size <= 1.0)


def test_a_trail_takes_what_it_has_rows_for() -> None:
    trail = np.full((2, 3), np.nan)
    for row in range(4):
        kernels.note(np.full(3, float(row)), trail, row)
    np.testing.assert_array_equal(trail, [[0.0] * 3, [1.0] * 3])


def test_errors_and_results_are_in_their_units(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng))
    target, q = drawn_q(it.chain, rng), drawn_q(it.chain, rng)
    it.aim(by_exponentials(it.chain, target))
    np.testing.assert_allclose(
        kernels.errors(it.table, it.goal, target, it.work), [0.0, 0.0], atol=1e-25
    )
    expected = it.errors(q)
    np.testing.assert_allclose(kernels.errors(it.table, it.goal, q, it.work), expected, rtol=1e-9)
    it.work[:, kernels.BEST] = q
    np.testing.assert_allclose(
        kernels.recall(it.table, it.goal, it.work, it.q), expected, rtol=1e-9
    )
    np.testing.assert_array_equal(it.q, q)
    X, X_goal = by_exponentials(it.chain, q), by_exponentials(it.chain, target)
    out = np.empty(it.chain.n)
    code, count, restarts, position, angle = kernels.hand_over(
        it.table, q, *expected, 2, 17, 3, out
    )
    assert (code, count, restarts) == (2, 17, 3)
    np.testing.assert_array_equal(out, q)
    assert position == pytest.approx(np.linalg.norm(X[:3, 3] - X_goal[:3, 3]))
    assert angle == pytest.approx(np.linalg.norm(log_so3(X[:3, :3].T @ X_goal[:3, :3])))


@pytest.mark.parametrize("n", [3, 5, 6, 8])
def test_a_change_of_orientation_is_the_sign_of_a_determinant(
    n: int, rng: np.random.Generator
) -> None:
    work = np.zeros((n, kernels.WORK))
    past = np.zeros((n, kernels.PAST))
    normal = np.zeros((6, 8))
    signs = set()
    for _ in range(40):
        past[:, :6], work[:, :6] = J, J_new = rng.normal(size=(2, n, 6))
        product = J.T @ J_new if n >= 6 else J @ J_new.T
        over = kernels.turned_over(work, past, normal, n)
        assert over == (np.linalg.det(product) < 0.0)
        signs.add(over)
    assert signs == {True, False}
    work[0, :6] = work[1, :6] if n < 6 else 0.0
    work[:, 5] = 0.0  # singular: cannot be told
    past[:, 5] = 0.0
    if n >= 6:
        assert not kernels.turned_over(work, past, normal, n)


def test_a_branch_is_left_where_the_determinant_of_the_jacobian_changes_sign(
    rng: np.random.Generator,
) -> None:
    it = plain(Chain.from_dh(PUMA))
    X, J = np.empty((4, 4)), np.empty((6, 6))

    def orientation(q: Array) -> float:
        kernels.forward(it.table, q, it.work.copy(), X, J)
        return float(np.sign(np.linalg.det(J)))

    branches_left = []
    for _ in range(12):
        start, end = rng.uniform(-1.5, 1.5, (2, 6))
        end = start + 0.5 * (end - start)
        count = math.ceil(float(np.abs(end - start).max()) / 0.1)
        signs = {orientation(start + (end - start) * i / count) for i in range(count + 1)}
        it.work[:, kernels.START] = start
        left = kernels.branch_left(it.table, end, 0.01, it.work, it.past, it.normal)
        assert left == (len(signs) > 1)
        # near enough not to be asked
        assert not kernels.branch_left(it.table, end, 2.0, it.work, it.past, it.normal)
        branches_left.append(left)
    assert True in branches_left
    assert False in branches_left


def test_how_far_a_slide_moves_counts_in_scaled_length() -> None:
    """The elbow of two hinges passes its straight position while a slide before them moves by 1
    m.
    """
    chain = Chain.from_dh([(0, 0, 0.3, 0), (0, 0, 0.3, H), (0, 0.1, 0, 0)], "rrp")
    it = plain(chain)
    it.work[:, kernels.START] = [0.0, 0.05, -0.5]
    end = np.array([0.0, -0.05, 0.5])
    assert not kernels.branch_left(it.table, end, SCALE * 1.0 + 1e-9, it.work, it.past, it.normal)
    moved = end.copy()
    kernels.branch_left(it.table, moved, SCALE * 0.9, it.work, it.past, it.normal)
    np.testing.assert_array_equal(moved, end)
    np.testing.assert_array_equal(it.work[:, kernels.BEST], end)
