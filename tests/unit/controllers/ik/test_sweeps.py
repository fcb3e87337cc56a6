"""Kernels of the Jacobian-free method, uncompiled: each joint's step against a search, the mixing
by least squares.
"""

import math

import numpy as np
import pytest

from plain_chains import (
    SCALE,
    Plain,
    by_exponentials,
    drawn_chain,
    drawn_q,
    kernels,
    plain,
    settings,
    sweeps,
)
from uuv.controllers.ik.chain import Chain
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

KINDS = ("rrrrrr", "rporrr", "orpor")


def objective(it: Plain, q: Array, weight: float) -> float:
    p2, chord2 = it.errors(q)
    return p2 + 2.0 * weight * chord2


def only(it: Plain, joint: int, q: Array) -> None:
    """Lock all other joints at `q`, by their limits."""
    for i in range(it.chain.n):
        rows = it.table[kernels.HEAD + i]
        rows[kernels.LOWER], rows[kernels.UPPER] = (
            it.chain.limits[i] if i == joint else (q[i], q[i])
        )


def test_a_vector_is_turned_about_an_axis(rng: np.random.Generator) -> None:
    for _ in range(10):
        v = rng.normal(size=3)
        axis = rng.normal(size=3)
        angle = rng.uniform(-3, 3)
        axis /= np.linalg.norm(axis)
        turned = sweeps.turn(*v, *axis, math.cos(angle), math.sin(angle))
        np.testing.assert_allclose(turned, exp_so3(angle * axis) @ v, atol=1e-13)


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("weight", [0.02, 1.0])
def test_each_joint_takes_the_exact_minimiser_within_its_limits(
    kinds: str, weight: float, rng: np.random.Generator
) -> None:
    it = plain(drawn_chain(rng, kinds))
    it.aim(by_exponentials(it.chain, drawn_q(it.chain, rng)))
    for joint in range(it.chain.n):
        q = drawn_q(it.chain, rng)
        only(it, joint, q)
        it.q[:] = q
        before = sweeps.sweep(it.table, it.goal, weight, kernels.WITHIN, it.q, it.work)
        np.testing.assert_allclose(before, it.errors(q), rtol=1e-9)
        np.testing.assert_array_equal(np.delete(it.q, joint), np.delete(q, joint))
        lower, upper = it.chain.limits[joint]
        assert lower <= it.q[joint] <= upper
        grid = np.linspace(lower, upper, 40)
        tried = [
            objective(it, np.where(np.arange(it.chain.n) == joint, angle, q), weight)
            for angle in grid
        ]
        # The nearer limit need not be the better one: then the step is at least no worse than none.
        bound = objective(it, q, weight) if it.q[joint] in (lower, upper) else min(tried)
        assert objective(it, it.q, weight) <= bound + 1e-12


@pytest.mark.parametrize("kinds", KINDS)
def test_a_sweep_carries_its_tip_along(kinds: str, rng: np.random.Generator) -> None:
    """It is the same as the steps of single joints, tip to base, each from a fresh start."""
    it = plain(drawn_chain(rng, kinds))
    it.aim(by_exponentials(it.chain, drawn_q(it.chain, rng)))
    start = drawn_q(it.chain, rng)
    for mode in (kernels.ALONG, kernels.WITHIN):
        alone, whole = start.copy(), start.copy()
        for joint in reversed(range(it.chain.n)):
            only(it, joint, alone)
            sweeps.sweep(it.table, it.goal, 0.1, mode, alone, it.work)
        it.table[kernels.HEAD :, kernels.LOWER : kernels.UPPER + 1] = it.chain.limits
        sweeps.sweep(it.table, it.goal, 0.1, mode, whole, it.work)
        np.testing.assert_allclose(whole, alone, atol=1e-9)
    sweeps.sweep(it.table, it.goal, 0.1, kernels.THROUGH, whole := start.copy(), it.work)
    assert objective(it, whole, 0.1) <= objective(it, start, 0.1) + 1e-12
    slides = np.array([kind == "p" for kind in kinds])
    assert np.all(~slides | ((whole >= it.chain.limits[:, 0]) & (whole <= it.chain.limits[:, 1])))


def test_limits_are_kept_jumped_or_passed() -> None:
    """A single hinge whose goal lies beyond its limits."""
    it = plain(Chain.from_dh([(0, 0, 0.5, 0)], limits=np.array([(-4.0, 1.0)])))
    it.aim(by_exponentials(it.chain, np.array([2.8])))
    for mode, expected in (
        (kernels.ALONG, 1.0),
        (kernels.WITHIN, 2.8 - 2 * math.pi),
        (kernels.THROUGH, 2.8),
    ):
        it.q[:] = 0.5
        sweeps.sweep(it.table, it.goal, 0.01, mode, it.q, it.work)
        np.testing.assert_allclose(it.q, expected, atol=1e-12)


def test_mixing_is_least_squares(rng: np.random.Generator) -> None:
    n = 8
    depth = sweeps.DEPTH
    for count in (1, 2, depth):
        past = rng.normal(size=(n, kernels.PAST))
        normal = np.full((6, 8), np.nan)
        q = np.empty(n)
        turns = past[:, sweeps.TURNS : sweeps.TURNS + count]
        steps = past[:, sweeps.STEPS : sweeps.STEPS + count]
        y = np.linalg.lstsq(turns, past[:, sweeps.RESIDUAL], rcond=None)[0]
        sweeps.mix(count, past, normal, q)
        # measured 1e-13
        np.testing.assert_allclose(q, past[:, sweeps.SWEPT] - steps @ y, atol=1e-10)


def test_mixing_takes_dependent_differences(rng: np.random.Generator) -> None:
    past = rng.normal(size=(6, kernels.PAST))
    q = np.empty(6)
    past[:, sweeps.TURNS + 1] = past[:, sweeps.TURNS]
    past[:, sweeps.STEPS + 1] = past[:, sweeps.STEPS]
    sweeps.mix(1, past, np.zeros((6, 8)), q)
    once = q.copy()
    sweeps.mix(2, past, np.zeros((6, 8)), q)
    np.testing.assert_allclose(q, once, atol=0.2)
    past[:, sweeps.TURNS] = 0.0
    sweeps.mix(1, past, np.zeros((6, 8)), q)
    np.testing.assert_array_equal(q, past[:, sweeps.SWEPT])


def run(it: Plain, start: Array, mode: int, limit: int, best2: float = math.inf) -> tuple:
    trail = np.full((400, it.chain.n), np.nan)
    it.q[:] = start
    minimum = sweeps.accelerate(
        it.views, 0.03, kernels.Near(1e-12, 1e-12), limit, mode, best2, trail, 1
    )
    return *minimum, trail


@pytest.mark.parametrize("mode", [kernels.ALONG, kernels.WITHIN, kernels.THROUGH])
def test_accelerated_sweeps_meet_a_near_pose(mode: int, rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    it.aim(by_exponentials(it.chain, q))
    start = q + 0.03
    code, count, best2, p2, chord2, trail = run(it, start, mode, 300)
    if code != kernels.CONVERGED:
        pytest.skip("near a singular configuration")
    np.testing.assert_allclose(it.errors(it.q), [p2, chord2], atol=1e-15)
    assert max(p2, chord2) <= 1e-12
    went = trail[1 : 2 + count]
    np.testing.assert_allclose(went[[0, -1]], [start, it.q])
    assert np.isnan(trail[0]).all()
    assert np.isnan(trail[2 + count :]).all()
    along = np.array([sum(it.errors(row)) for row in went])
    assert best2 == (
        math.inf if mode == kernels.THROUGH else pytest.approx(along[:-1].min(), rel=1e-6)
    )
    plainly = start.copy()
    for _ in range(count):  # acceleration is worth its name
        sweeps.sweep(it.table, it.goal, 0.03, mode, plainly, it.work)
    assert sum(it.errors(plainly)) > p2 + chord2
    code, spent, best2, *_ = run(it, start, mode, 2, best2=1e-30)
    assert (code, spent, best2) == (kernels.EXHAUSTED, 2, 1e-30)


def solve(
    it: Plain, X: Array, q0: Array, limit: int, restarts: int, keep: bool, **changed: float
) -> tuple:
    tolerances = {"p": 1e-5, "r": 1e-4} | changed
    out = np.full(it.chain.n, np.nan)
    trail = np.empty((0, it.chain.n))
    with np.errstate(over="ignore"):
        how = settings(tolerances["p"], tolerances["r"], limit, restarts, keep)
        solution = sweeps.solve_jacobian_free(it.memory, X, q0, how, trail, out)
    return *solution, out


@pytest.mark.parametrize("keep", [False, True])
def test_the_solver_says_how_it_ended(keep: bool, rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    X = by_exponentials(it.chain, q)
    code, count, restarts, position, angle, out = solve(it, X, q + 0.01, 400, 3, keep)
    assert code == kernels.CONVERGED
    assert 0 < count <= 400
    assert position <= 1e-5
    assert angle <= 1e-4
    reached = by_exponentials(it.chain, out)
    assert np.linalg.norm(reached[:3, 3] - X[:3, 3]) == pytest.approx(position, abs=1e-12)
    for change in ({"p": 0.0}, {"r": 0.0}, {"r": -1.0}):
        assert solve(it, X, q, 100, 0, keep, **change)[0] == kernels.BAD_OPTION
    assert solve(it, X, q, 0, 0, keep)[0] == kernels.BAD_OPTION
    assert solve(it, X, q, 1, -1, keep)[0] == kernels.BAD_OPTION
    assert solve(it, 2.0 * X, q, 9, 0, keep)[:5] == (kernels.BAD_TARGET, 0, 0, 0.0, 0.0)
    assert solve(it, X, q[:5], 9, 0, keep)[0] == kernels.BAD_START
    assert solve(it, X, -q, 1, 5, keep)[0] == kernels.EXHAUSTED
    far = X.copy()
    far[:3, 3] *= 50.0
    code, _, restarts, *_ = solve(it, far, q, 400, 9, keep)
    assert code == kernels.OUT_OF_REACH
    assert restarts <= (0 if keep else 4)
    four = plain(drawn_chain(rng, "rrrr"))
    near = pose(exp_so3([1.0, 0.0, 2.0]), four.chain.points[0] + [0.1, 0.2, 0.1])
    code, count, restarts, position, angle, out = solve(four, near, np.zeros(4), 900, 2, keep)
    assert code == kernels.STALLED
    assert restarts == (0 if keep else 2)
    four.aim(near)
    p2, chord2 = four.errors(out)
    assert position == pytest.approx(math.sqrt(p2) / SCALE)
    assert angle == pytest.approx(2.0 * math.asin(0.5 * math.sqrt(chord2)), rel=1e-6)
