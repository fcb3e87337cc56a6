"""Stages of plain MKPS, uncompiled: each joint's step against a search, the stage axes against what
they shall be.
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
    stages,
)
from uuv.controllers.ik.chain import Chain
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

H = np.pi / 2
PUMA = [
    (0, 0, 0, H),
    (0, 0, 0.4318, 0),
    (0, 0.15005, 0.0203, -H),
    (0, 0.4318, 0, H),
    (0, 0, 0, -H),
    (0, 0, 0, 0),
]
HOME = np.array([0.1, -0.6, 0.7, 0.3, 0.6, 0.2])


def only(it: Plain, joint: int, q: Array) -> None:
    """Lock all other joints at `q`, by their limits."""
    for i in range(it.chain.n):
        row = it.table[kernels.HEAD + i]
        row[kernels.LOWER], row[kernels.UPPER] = it.chain.limits[i] if i == joint else (q[i], q[i])


def last_frame(it: Plain, q: Array) -> Array:
    """Axes of the last joint frame at `q`, as columns."""
    return by_exponentials(it.chain, q)[:3, :3] @ it.tool.T


def between(a: Array, b: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


@pytest.mark.parametrize("kinds", ["rrrrrr", "rporrr", "orpor"])
def test_the_position_stage_brings_the_tip_as_near_as_each_joint_can(
    kinds: str, rng: np.random.Generator
) -> None:
    it = plain(drawn_chain(rng, kinds))
    it.aim(by_exponentials(it.chain, drawn_q(it.chain, rng)))
    n = it.chain.n
    for joint in range(n):
        q = drawn_q(it.chain, rng)
        only(it, joint, q)
        it.q[:] = q
        left = stages.place(it.table, it.goal, 0.0, it.q, it.work)
        assert left == pytest.approx(it.errors(it.q)[0], rel=1e-9, abs=1e-15)
        np.testing.assert_array_equal(np.delete(it.q, joint), np.delete(q, joint))
        lower, upper = it.chain.limits[joint]
        if not lower < it.q[joint] < upper:
            assert lower <= it.q[joint] <= upper
            continue
        grid = [
            np.where(np.arange(n) == joint, angle, q) for angle in np.linspace(lower, upper, 40)
        ]
        assert left <= min(it.errors(tried)[0] for tried in grid) + 1e-12


@pytest.mark.parametrize("kinds", ["rrrrrr", "rporrr"])
def test_the_position_stage_goes_base_to_tip_and_ends_when_near(
    kinds: str, rng: np.random.Generator
) -> None:
    it = plain(drawn_chain(rng, kinds))
    it.aim(by_exponentials(it.chain, drawn_q(it.chain, rng)))
    start = drawn_q(it.chain, rng)
    alone, whole = start.copy(), start.copy()
    for joint in range(it.chain.n):
        only(it, joint, alone)
        stages.place(it.table, it.goal, 0.0, alone, it.work)
    it.table[kernels.HEAD :, kernels.LOWER : kernels.UPPER + 1] = it.chain.limits
    left = stages.place(it.table, it.goal, 0.0, whole, it.work)
    np.testing.assert_allclose(whole, alone, atol=1e-9)
    assert left == pytest.approx(it.errors(whole)[0], rel=1e-6)
    assert left < it.errors(start)[0]
    still = start.copy()
    enough = it.errors(start)[0]
    assert stages.place(it.table, it.goal, 1.001 * enough, still, it.work) == pytest.approx(enough)
    np.testing.assert_array_equal(still, start)


@pytest.mark.parametrize("kinds", ["rrrrrr", "rporrr"])
def test_the_axis_stage_turns_hinges_alone_tip_to_base(
    kinds: str, rng: np.random.Generator
) -> None:
    it = plain(drawn_chain(rng, kinds))
    n = it.chain.n
    hinges = np.array([kind == "r" for kind in kinds])
    u, t = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    start = drawn_q(it.chain, rng)
    turned = start.copy()
    for joint in reversed(range(n)):
        before = turned.copy()
        only(it, joint, turned)
        angle = stages.align(it.table, u, t, 0.0, turned, it.work)
        assert angle == pytest.approx(between(last_frame(it, turned) @ u, t), abs=1e-9)
        assert angle <= between(last_frame(it, before) @ u, t) + 1e-12
        lower, upper = it.chain.limits[joint]
        if hinges[joint] and lower < turned[joint] < upper:
            grid = [
                np.where(np.arange(n) == joint, angle, turned)
                for angle in np.linspace(lower, upper, 40)
            ]
            assert angle <= min(between(last_frame(it, tried) @ u, t) for tried in grid) + 1e-12
    it.table[kernels.HEAD :, kernels.LOWER : kernels.UPPER + 1] = it.chain.limits
    stages.align(it.table, u, t, 0.0, whole := start.copy(), it.work)
    np.testing.assert_allclose(whole, turned, atol=1e-9)
    np.testing.assert_array_equal(whole[~hinges], start[~hinges])
    stages.align(it.table, u, t, 3.2, still := start.copy(), it.work)  # near enough
    np.testing.assert_array_equal(still, start)


def test_angles_and_components(rng: np.random.Generator) -> None:
    for _ in range(20):
        a, b, v = rng.normal(size=(3, 3))
        b *= np.linalg.norm(a) / np.linalg.norm(b)
        assert stages.angle_between(*a, *b) == pytest.approx(
            math.acos(float(a @ b / (a @ a))), abs=1e-7
        )
        R = exp_so3(rng.normal(size=3))
        np.testing.assert_allclose(stages.in_frame(v, *R.T), R @ v, atol=1e-14)


@pytest.mark.parametrize("kinds", ["rrrr", "rrorp", "rrpo", "rpooo"])
def test_stage_axes_are_the_last_hinge_and_one_across(kinds: str, rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, kinds))
    last = max(i for i, kind in enumerate(kinds) if kind == "r")
    for _ in range(6):
        q = drawn_q(it.chain, rng)
        across, along = np.array(stages.stage_axes(it.table, False, q, it.work))
        moved = by_exponentials(it.chain, q + 1e-6 * np.eye(it.chain.n)[last])[:3, :3]
        here = by_exponentials(it.chain, q)[:3, :3]
        turned = moved @ here.T  # about the hinge, in base axes
        hinge = np.array(
            [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
        )
        np.testing.assert_allclose(
            last_frame(it, q) @ along, hinge / np.linalg.norm(hinge), atol=1e-6
        )
        assert np.linalg.norm(across) == pytest.approx(1.0)
        assert across @ along == pytest.approx(0.0, abs=1e-14)
    q = drawn_q(it.chain, rng)
    here = by_exponentials(it.chain, q)[:3, :3]
    tip = np.array(stages.stage_axes(it.table, True, q, it.work))
    np.testing.assert_allclose(last_frame(it, q) @ tip[0], here[:, 2], atol=1e-14)
    np.testing.assert_allclose(last_frame(it, q) @ tip[1], here[:, 0], atol=1e-14)


def test_goal_functions_are_distances_and_angles(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng))
    it.aim(by_exponentials(it.chain, drawn_q(it.chain, rng)))
    q = drawn_q(it.chain, rng)
    u, v = (a / np.linalg.norm(a) for a in rng.normal(size=(2, 3)))
    p2, angle_1, angle_2, chord2 = stages.three_goals(it.table, it.goal, u, v, q, it.work)
    np.testing.assert_allclose([p2, chord2], it.errors(q), rtol=1e-9)
    R = last_frame(it, q)
    R_goal = it.goal[1:].T
    assert angle_1 == pytest.approx(between(R @ u, R_goal @ u))
    assert angle_2 == pytest.approx(between(R @ v, R_goal @ v))


def solve(
    it: Plain, X: Array, q0: Array, limit: int, changed: dict[str, float] | None = None
) -> tuple:
    tol = {"p": 1e-3, "r": 1e-2, "one": 1e-2, "two": 1e-2} | (changed or {})
    out = np.full(it.chain.n, np.nan)
    trail = np.full((200, it.chain.n), np.nan)
    how = settings(tol["p"], tol["r"], limit, axes=(tol["one"], tol["two"]))
    solution = stages.solve_plain(it.memory, X, q0, how, trail, out)
    return *solution, out, trail


def test_the_solver_says_how_it_ended(rng: np.random.Generator) -> None:
    it = plain(drawn_chain(rng, "rrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    X = by_exponentials(it.chain, q)
    code, count, restarts, position, angle, out, trail = solve(it, X, q, 100)
    assert (code, count, restarts) == (kernels.CONVERGED, 0, 0)
    np.testing.assert_allclose(out, q)
    np.testing.assert_array_equal(trail[0], q)
    for change in ({"p": 0.0}, {"r": 0.0}, {"one": 0.0}, {"two": -1.0}):
        assert solve(it, X, q, 100, change)[0] == kernels.BAD_OPTION
    assert solve(it, X, q, 0)[0] == kernels.BAD_OPTION
    assert solve(it, 2.0 * X, q, 9)[:5] == (kernels.BAD_TARGET, 0, 0, 0.0, 0.0)
    assert solve(it, X, q[:5], 9)[0] == kernels.BAD_START
    far = X.copy()
    far[:3, 3] *= 50.0
    code, count, *_, out, _ = solve(it, far, q, 30)
    assert code == kernels.OUT_OF_REACH
    assert count >= 30
    # At most one round of three stages is begun, and the best joint values so far are handed over
    # with their errors.
    code, count, _, position, angle, out, trail = solve(
        it, X, -q, 1, dict.fromkeys(("p", "r", "one", "two"), 1e-9)
    )
    assert code == kernels.EXHAUSTED
    assert 3 <= count <= 3 * stages.STAGE_SWEEPS
    assert np.isfinite(trail[: count + 1]).all()
    assert np.isnan(trail[count + 1 :]).all()
    it.aim(X)
    p2, chord2 = it.errors(out)
    assert position == pytest.approx(math.sqrt(p2) / SCALE)
    assert angle == pytest.approx(2.0 * math.asin(min(1.0, 0.5 * math.sqrt(chord2))), rel=1e-6)
    assert p2 + chord2 <= min(sum(it.errors(-q)), sum(it.errors(trail[count]))) + 1e-12


def test_loose_angles_suffice_where_either_is_met(rng: np.random.Generator) -> None:
    """The position must be met; then the whole rotation, or both axes."""
    it = plain(drawn_chain(rng, "rrrrrr"))
    q = 0.6 * drawn_q(it.chain, rng)
    X = by_exponentials(it.chain, q)
    X[:3, :3] = exp_so3([0.3, 0.2, 0.1]) @ X[:3, :3]
    for change, met in (
        ({"r": 0.5}, True),
        ({"one": 0.5, "two": 0.5}, True),
        ({"one": 0.5, "two": 1e-6}, False),
        ({"one": 1e-6, "two": 0.5}, False),
        ({}, False),
    ):
        code, count, *_ = solve(it, X, q, 1, change)
        assert (count == 0) == met, change
        assert met <= (code == kernels.CONVERGED)
    moved = by_exponentials(it.chain, q) @ pose(p=[0.0, 0.0, 0.01])
    assert solve(it, moved, q, 1, dict.fromkeys(("r", "one", "two"), 3.0))[1] > 0


def test_stages_in_turn_bring_a_near_start_to_the_pose(rng: np.random.Generator) -> None:
    it = plain(Chain.from_dh(PUMA))
    solved = []
    for _ in range(5):
        q = HOME + rng.uniform(-0.3, 0.3, 6)
        X = by_exponentials(it.chain, q)
        code, count, _, position, angle, out, _ = solve(it, X, q + 0.02, 150)
        solved.append(code == kernels.CONVERGED)
        if code == kernels.CONVERGED:
            it.aim(X)
            p2, _ = it.errors(out)
            assert position == pytest.approx(math.sqrt(p2) / SCALE, rel=1e-6)
            assert position <= 1e-3
            assert angle <= 2.5e-2  # of two axes, each within 1e-2
            assert count > 0
    assert sum(solved) >= 2
