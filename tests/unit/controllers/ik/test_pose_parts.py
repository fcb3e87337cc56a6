"""Parts of a pose error, uncompiled, against angles from matrices and finite differences."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain_chains import (
    SCALE,
    Plain,
    by_exponentials,
    descent,
    drawn_chain,
    drawn_q,
    kernels,
    parts,
    plain,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

ONE = parts.Weights(1.0, 1.0, 1.0)


def drawn_pose(rng: np.random.Generator) -> Array:
    return pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3))


def at(it: Plain, q: Array, weights: object = ONE) -> tuple:
    """`measured` at joint values `q`."""
    return parts.measured(it.table, it.goal, kernels.trace(it.table, q, it.work), weights)


def by_matrices(X: Array, target: Array) -> tuple[float, float, float]:
    """Distance, angle between the z axes, and turn about z that is left once the shortest rotation
    aligned them.
    """
    z, axis_goal = X[:3, 2], target[:3, 2]
    tilt = math.atan2(float(np.linalg.norm(np.cross(z, axis_goal))), float(z @ axis_goal))
    axis = np.cross(z, axis_goal)
    aligned = exp_so3(tilt * axis / np.linalg.norm(axis)) @ X[:3, :3]
    turn = Rotation.from_matrix(aligned.T @ target[:3, :3]).magnitude()
    return float(np.linalg.norm(X[:3, 3] - target[:3, 3])), tilt, float(turn)


def test_the_parts_are_distance_tilt_and_turn(rng: np.random.Generator) -> None:
    for _ in range(20):
        it = plain(drawn_chain(rng, "rporrr"))
        q = drawn_q(it.chain, rng)
        target = drawn_pose(rng)
        it.aim(target)
        error, error2, left = at(it, q)
        distance, tilt, turn = by_matrices(by_exponentials(it.chain, q), target)
        expected = (
            (SCALE * distance) ** 2,
            *(4.0 * math.sin(0.5 * angle) ** 2 for angle in (tilt, turn)),
        )
        np.testing.assert_allclose((left[0], left[2], left[3]), expected, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(left[:2], it.errors(q), rtol=1e-9)
        assert error2 == pytest.approx(sum(expected), rel=1e-9)
        assert np.sum(np.square(error)) == pytest.approx(error2, rel=1e-9)


def test_parts_without_weight_leave_no_error(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    q = drawn_q(it.chain, rng)
    target = drawn_pose(rng)
    it.aim(target)
    z = by_exponentials(it.chain, q)[:3, 2]
    error, error2, left = at(it, q, parts.Weights(0.5, 0.0, 0.0))
    assert error[3:] == (0.0, 0.0, 0.0)
    assert error2 == pytest.approx(0.25 * left[0])
    error, error2, left = at(it, q, parts.Weights(0.0, 1.0, 0.0))
    assert error[:3] == (0.0, 0.0, 0.0)
    assert np.dot(error[3:], z) == pytest.approx(0.0, abs=1e-12)
    assert error2 == pytest.approx(left[2])
    error, error2, left = at(it, q, parts.Weights(0.0, 0.0, 1.0))
    np.testing.assert_allclose(np.abs(np.array(error[3:]) @ z), math.sqrt(left[3]), rtol=1e-9)


def test_opposite_tool_axes_have_an_error_across_them(rng: np.random.Generator) -> None:
    for lean in (0.0, 1e-9, 1e-3):
        it = plain(drawn_chain(rng, "rrrr"))
        q = drawn_q(it.chain, rng)
        X = by_exponentials(it.chain, q)
        it.aim(X @ pose(exp_so3([math.pi - lean, 0.0, 0.0])))
        error, _, left = at(it, q, parts.Weights(0.0, 1.0, 0.0))
        assert math.sqrt(left[2]) == pytest.approx(2.0 * math.cos(0.5 * lean))
        assert np.linalg.norm(error) == pytest.approx(2.0, abs=1e-6)
        assert np.dot(error[3:], X[:3, 2]) == pytest.approx(0.0, abs=1e-9)


def test_weighted_columns_are_the_slopes_of_the_weighted_error(rng: np.random.Generator) -> None:
    """Near the goal, where the error is linear in the joint values."""
    weights = parts.Weights(0.3, 1.0, 0.05)
    it = plain(drawn_chain(rng, "rporrr"))
    q = drawn_q(it.chain, rng)
    it.aim(by_exponentials(it.chain, q))
    tip = kernels.trace(it.table, q, it.work)
    z = parts.tool_axis(it.table, tip)
    np.testing.assert_allclose(z, by_exponentials(it.chain, q)[:3, 2], atol=1e-12)
    columns = [
        parts.weighted_column(kernels.column(it.table, it.work, i, *tip[:3]), z, weights)
        for i in range(it.chain.n)
    ]
    h = 1e-6
    for e, column in zip(h * np.eye(it.chain.n), columns, strict=True):
        slope = (np.array(at(it, q - e, weights)[0]) - np.array(at(it, q + e, weights)[0])) / (
            2 * h
        )
        np.testing.assert_allclose(column, slope, atol=1e-8)


def test_weights_are_in_proportion_to_the_tolerances() -> None:
    it = plain(drawn_chain(np.random.default_rng(3), "rrrrrr"))
    settings = kernels.Settings(kernels.HYBRID, 0.02, math.inf, 1.0, 1.0, 9, 9, False, False)
    near = parts.squared_parts(it.table, settings, parts.PartTolerances(0.002, math.inf))
    weights = parts.weights_of(it.table, near)
    assert weights.axis == 1.0
    assert weights.position == pytest.approx(0.002 / (SCALE * 0.02), rel=1e-5)
    assert weights.turn == 0.0
    near = parts.squared_parts(it.table, settings, parts.PartTolerances(1e-9, math.pi))
    assert (near.turn2, parts.weights_of(it.table, near).position) == (math.inf, parts.LIGHTEST)


@pytest.mark.parametrize(
    ("p", "r", "alike"),
    [
        (1e-4, 1e-3, True),
        (1e-6, 1e-5, True),
        (1e-4, 1e-2, True),
        (1e-4, math.inf, False),
        (1e-4, math.pi, False),
        (math.inf, 1e-3, False),
        (1e-4, 0.5, False),
        (0.5, 1e-4, False),
    ],
)
def test_a_pose_is_solved_for_by_parts_where_they_do_not_count_alike(
    p: float, r: float, alike: bool
) -> None:
    assert parts.count_alike(SCALE, p, r) is alike


def test_one_error_is_traded_for_another_until_both_are_within_their_tolerances(
    rng: np.random.Generator,
) -> None:
    """A stretched arm: the target lies beyond reach by less than the tolerance, and turned by less
    than another.
    """
    it = plain(drawn_chain(rng, "rrrr"))
    q = 0.5 * drawn_q(it.chain, rng)
    missed = pose(exp_so3([0.9e-3, 0.0, 0.0]), [0.0, 0.9e-4, 0.0])
    it.aim(by_exponentials(it.chain, q) @ missed)
    near = kernels.Near((SCALE * 1e-4) ** 2, 1e-6)
    it.work[:, kernels.BEST] = q + 1e-3
    code, _, p2, chord2 = descent.finish(it.views, near, None, np.empty((0, 4)), 0)
    assert code == kernels.CONVERGED
    assert p2 <= near.p2
    assert chord2 <= near.chord2
    np.testing.assert_allclose((p2, chord2), it.errors(it.q), rtol=1e-6)
    # Half the tolerances: no pose nearby is within them, and the joint values of the least sum of
    # squares stay.
    near = kernels.Near((SCALE * 1e-5) ** 2, 1e-8)
    it.work[:, kernels.BEST] = q + 1e-3
    code, _, left = descent.settle(it.views, near, None, np.empty((0, 4)), 0)
    settled = it.q.copy()
    it.work[:, kernels.BEST] = q + 1e-3
    code, _, *errors = descent.finish(it.views, near, None, np.empty((0, 4)), 0)
    assert code == kernels.STALLED
    np.testing.assert_array_equal(it.q, settled)
    np.testing.assert_allclose(errors, left)
