"""Levenberg-Marquardt kernels, uncompiled, against the normal equations and what a minimum is."""

import math

import numpy as np
import pytest

from plain_chains import (
    SCALE,
    Plain,
    by_exponentials,
    descent,
    drawn_chain,
    drawn_q,
    kernels,
    plain,
    settings,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, pose


def jacobian(it: Plain, q: Array) -> Array:
    """Jacobian (6, n) in scaled lengths."""
    X = np.empty((4, 4))
    J = np.empty((6, it.chain.n))
    kernels.forward(it.table, q, it.work.copy(), X, J)
    return np.vstack([SCALE * J[:3], J[3:]])


def step(it: Plain, q: Array, error: Array, damping: float, limited: bool = True) -> Array:
    it.q[:] = q
    tip = kernels.trace(it.table, it.q, it.work)
    largest = descent.damped_step(it.views, limited, damping, tip, error, None)
    dq = it.work[:, kernels.STEP].copy()
    assert largest == np.abs(dq).max()
    return dq


def test_a_step_solves_the_damped_normal_equations(rng: np.random.Generator) -> None:
    for kinds in ("rrrrrr", "rporro", "rrrpr", "rrrrrrrr"):
        it = plain(drawn_chain(rng, kinds))
        for damping in (1e-3, 0.5):
            q = drawn_q(it.chain, rng)
            error = rng.normal(size=6)
            J = jacobian(it, q)
            expected = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), error)
            # measured 1e-13
            np.testing.assert_allclose(step(it, q, error, damping), expected, atol=1e-11)


def test_a_joint_at_a_limit_does_not_step_beyond_it(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrprrr"))
    for side, sign in ((0, -1.0), (1, 1.0)):
        for joint in (1, 2):
            q = drawn_q(it.chain, rng)
            q[joint] = it.chain.limits[joint, side]
            J = jacobian(it, q)
            outwards = sign * J[:, joint]
            inwards = -sign * J[:, joint]
            dq = step(it, q, outwards, 0.1)
            assert dq[joint] == 0.0
            rest = np.delete(J, joint, axis=1)
            expected = rest.T @ np.linalg.solve(rest @ rest.T + 0.1 * np.eye(6), outwards)
            np.testing.assert_allclose(np.delete(dq, joint), expected, atol=1e-11)
            assert sign * step(it, q, inwards, 0.1)[joint] < 0.0
            # a hinge may pass, a slide may not
            free = step(it, q, outwards, 0.1, limited=False)[joint]
            assert free == 0.0 if joint == 2 else sign * free > 0.0


def test_a_step_is_cut_to_the_longest_and_kept_within_limits(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrp"))
    q = np.array([0.5, -0.4, 0.1])
    for cap, factor in ((0.4, 0.5), (0.8, 1.0), (2.0, 1.0)):
        it.work[:, kernels.STEP] = dq = np.array([0.8, -0.3, 0.02])
        it.q[:] = q
        descent.take_step(it.table, cap, 0.8, kernels.ALONG, it.work, it.q)
        np.testing.assert_allclose(it.q, q + factor * dq)
    (low, high), slide = it.chain.limits[0], it.chain.limits[2, 1]
    # a turn back is within; it is not; a slide
    beyond = np.array([2 * math.pi + low + 0.1, 3.0, 5.0])
    second = it.chain.limits[1, 1]
    for mode, expected in (
        (kernels.ALONG, [high, second, slide]),
        (kernels.WITHIN, [low + 0.1, second, slide]),
        (kernels.THROUGH, [beyond[0], 3.0, slide]),
    ):
        it.work[:, kernels.STEP] = beyond
        it.q[:] = 0.0
        descent.take_step(it.table, 99.0, 9.0, mode, it.work, it.q)
        np.testing.assert_allclose(it.q, expected)


@pytest.mark.parametrize("mode", [kernels.ALONG, kernels.WITHIN, kernels.THROUGH])
def test_a_descent_meets_a_near_pose_and_says_what_it_did(
    mode: int, rng: np.random.Generator
) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    it.aim(by_exponentials(it.chain, q))
    start = q + rng.uniform(-0.2, 0.2, 6)
    trail = np.full((300, 6), np.nan)
    it.q[:] = start

    def run(limit: int, best2: float = math.inf) -> tuple[int, int, float, tuple[float, float]]:
        pace = descent.Pace(limit, 1.5, mode)
        return descent.descend(it.views, kernels.Near(1e-14, 1e-14), None, pace, best2, trail, 2)

    code, steps, best2, (p2, chord2) = run(100)
    assert (code, p2 <= 1e-14, chord2 <= 1e-14) == (kernels.CONVERGED, True, True)
    np.testing.assert_allclose(it.errors(it.q), [p2, chord2], atol=1e-18)
    went = trail[2 : 3 + steps]
    assert np.isnan(trail[:2]).all()
    assert np.isnan(trail[3 + steps :]).all()
    np.testing.assert_array_equal(went[[0, -1]], [start, it.q])
    along = np.array([sum(it.errors(row)) for row in went])
    assert along[-1] < along[0]
    if mode == kernels.THROUGH:
        assert best2 == math.inf
    else:  # the last one before the answer is the best that it noted
        assert best2 == pytest.approx(along[:-1].min(), rel=1e-6)
        np.testing.assert_array_equal(it.work[:, kernels.BEST], went[np.argmin(along[:-1])])
    it.q[:] = start
    code, spent, best2, *_ = run(1, best2=1e-30)  # a better one is known: that stays
    assert (code, spent, best2) == (kernels.EXHAUSTED, 1, 1e-30)


def test_a_descent_ends_where_the_error_no_longer_halves(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrr"))
    it.aim(pose(exp_so3([1.0, 0.0, 2.0]), [0.2, 0.3, 0.4]))
    code, steps, *_ = descent.descend(
        it.views,
        kernels.Near(1e-12, 1e-12),
        None,
        descent.Pace(500, 0.5, kernels.ALONG),
        math.inf,
        np.empty((0, 4)),
        0,
    )
    assert code == kernels.STALLED
    assert 0 < steps < 200
    assert steps % descent.STALL_WINDOW == 0


def test_settling_ends_in_a_minimum_no_worse_than_the_start(rng: np.random.Generator) -> None:
    """Where the error's gradient vanishes, but for joints that stand on a limit and would pass
    it.
    """
    for kinds in ("rrrr", "rrprr"):
        it = plain(drawn_chain(rng, kinds))
        q = 0.6 * drawn_q(it.chain, rng)
        missed = pose(exp_so3(rng.uniform(-0.05, 0.05, 3)), rng.uniform(-0.1, 0.1, 3))
        it.aim(by_exponentials(it.chain, q) @ missed)
        it.work[:, kernels.BEST] = start = q + rng.uniform(-0.3, 0.3, it.chain.n)
        best = sum(it.errors(start))
        code, steps, (p2, chord2) = descent.settle(
            it.views, kernels.Near(1e-12, 1e-12), None, np.empty((0, 4)), 0
        )
        assert code == kernels.STALLED
        assert 4 <= steps <= descent.SETTLE_STEPS
        np.testing.assert_allclose([p2, chord2], it.errors(it.q), rtol=1e-9)
        assert p2 + chord2 < best
        lower, upper = it.chain.limits.T
        assert np.all((it.q >= lower) & (it.q <= upper))
        h = 1e-5
        for i, e in enumerate(h * np.eye(it.chain.n)):
            slope = (sum(it.errors(it.q + e)) - sum(it.errors(it.q - e))) / (2 * h)
            at_limit = (it.q[i] >= upper[i] and slope < 0.0) or (
                it.q[i] <= lower[i] and slope > 0.0
            )
            assert abs(slope) < 1e-3 or at_limit


def test_settling_from_within_reach_converges(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    it.aim(by_exponentials(it.chain, q))
    it.work[:, kernels.BEST] = q + 0.05
    trail = np.full((60, 6), np.nan)
    code, steps, (p2, chord2) = descent.settle(it.views, kernels.Near(1e-14, 1e-14), None, trail, 3)
    assert code == kernels.CONVERGED
    assert steps < 20
    assert np.isnan(trail[:3]).all()
    np.testing.assert_array_equal(trail[[3, 3 + steps]], [q + 0.05, it.q])
    assert np.isnan(trail[4 + steps :]).all()
    np.testing.assert_allclose(it.errors(it.q), [p2, chord2], atol=1e-18)


def solve(
    it: Plain, X: Array, q0: Array, limit: int, restarts: int, keep: bool = False, **changed: float
) -> tuple:
    tolerances = {"p": 1e-6, "r": 1e-5} | changed
    out = np.full(it.chain.n, np.nan)
    solver = descent.solve_keep if keep else descent.solve_hybrid
    trail = np.full((600, it.chain.n), np.nan)
    with np.errstate(over="ignore"):
        solution = solver(
            it.memory,
            X,
            q0,
            settings(tolerances["p"], tolerances["r"], limit, restarts),
            None,
            trail,
            out,
        )
    return *solution, out, trail


@pytest.mark.parametrize("keep", [False, True])
def test_solvers_say_how_they_ended(keep: bool, rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    X = by_exponentials(it.chain, q)
    code, steps, restarts, position, angle, out, trail = solve(it, X, q + 0.02, 100, 0, keep)
    assert (code, restarts) == (kernels.CONVERGED, 0)
    assert position <= 1e-6
    assert angle <= 1e-5
    reached = by_exponentials(it.chain, out)
    assert np.linalg.norm(reached[:3, 3] - X[:3, 3]) == pytest.approx(position, abs=1e-12)
    assert np.isfinite(trail[: steps + 1]).all()
    assert np.isnan(trail[steps + 1 :]).all()
    for change in ({"p": 0.0}, {"r": 0.0}, {"p": -1.0}):
        assert solve(it, X, q, 100, 0, keep, **change)[0] == kernels.BAD_OPTION
    assert solve(it, X, q, 0, 0, keep)[0] == kernels.BAD_OPTION
    assert solve(it, X, q, 1, -1, keep)[0] == kernels.BAD_OPTION
    assert solve(it, 2.0 * X, q, 1, 0, keep)[:5] == (kernels.BAD_TARGET, 0, 0, 0.0, 0.0)
    assert solve(it, X, q[:5], 1, 0, keep)[0] == kernels.BAD_START
    far = X.copy()
    far[:3, 3] *= 50.0
    assert solve(it, far, q, 30, 1, keep)[0] == kernels.OUT_OF_REACH
    four = plain(drawn_chain(rng, "rrrr"))  # meets the position alone
    near = pose(exp_so3([1.0, 0.0, 2.0]), four.chain.points[0] + [0.1, 0.2, 0.1])
    assert solve(four, near, np.zeros(4), 1, 5, keep)[0] == kernels.EXHAUSTED
    assert solve(four, near, np.zeros(4), 500, 0, keep)[0] == kernels.STALLED


def test_restarts_are_taken_until_the_pose_is_met(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    solved = []
    for _ in range(4):
        X = by_exponentials(it.chain, drawn_q(it.chain, rng))
        code, steps, restarts, *_, out, _ = solve(it, X, np.zeros(6), 400, 12)
        solved.append(code == kernels.CONVERGED)
        assert restarts <= 12
        assert steps <= 400 + descent.MOST_AFTER
        assert np.all((out >= it.chain.limits[:, 0]) & (out <= it.chain.limits[:, 1]))
    assert sum(solved) >= 3


@pytest.mark.parametrize("pays", [0.0, 1.0])
def test_a_sweep_comes_first_from_a_far_start_where_it_pays(
    pays: float, rng: np.random.Generator
) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    it.table[1, kernels.SWEEPS] = pays
    start, target = drawn_q(it.chain, rng), drawn_q(it.chain, rng)
    X = by_exponentials(it.chain, target)
    *_, trail = solve(it, X, start, 5, 0)
    np.testing.assert_allclose(trail[0], start)
    swept = start.copy()
    descent.sweep(it.table, it.goal, descent.FAR_WEIGHT, kernels.WITHIN, swept, it.work)
    assert sum(it.errors(start)) > descent.FAR
    assert np.allclose(trail[1], swept) == bool(pays)
    *_, trail = solve(it, X, target + 0.01, 5, 0)  # near
    swept = target + 0.01
    descent.sweep(it.table, it.goal, descent.FAR_WEIGHT, kernels.WITHIN, swept, it.work)
    assert not np.allclose(trail[1], swept, atol=1e-9)
