"""Tool motion by priorities, against pseudo-inverses in NumPy and constrained minimisation in
SciPy.
"""

import numpy as np
import pytest
from scipy.optimize import minimize

from uuv import models
from uuv.controllers.ik.priorities import DAMPING, FULL, ZONE, prioritised
from uuv.controllers.mkps import Chain, IkOptions, solve
from uuv.models.arms import published_arms
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, log_so3, pose

ARMS = ("panda", "iiwa7", "puma560")


@pytest.fixture(scope="module")
def four() -> Chain:
    """Chain of four joints, of a Reach Alpha 5."""
    return Chain.from_mjcf(models.load("reach_alpha_5").compile(), ARM_BASE_BODY, TIP_SITE)


CLEAR = 0.3  # [-] least singular value from which on the damping does not show


def by_pseudo_inverses(J: Array, z: Array, twist: Array, posture: Array) -> tuple[Array, float]:
    """Joint rates task by task, each in the exact null space of those before it; and the least
    singular value used.
    """
    across = np.eye(3) - np.outer(z, z)
    tasks = (
        (J[:3], twist[:3]),
        (across @ J[3:], across @ twist[3:]),
        (z[None] @ J[3:], z[None] @ twist[3:]),
    )
    rates = np.zeros(len(posture))
    free = np.eye(len(posture))
    least = np.inf
    for A, b in tasks[: 3 if len(posture) >= FULL else 2]:
        left, singular_values, right = np.linalg.svd(A @ free, full_matrices=False)
        least = min(least, float(singular_values.min(where=singular_values > 1e-6, initial=np.inf)))
        singular_values = np.divide(
            1.0, singular_values, out=np.zeros_like(singular_values), where=singular_values > 1e-6
        )
        inverse_of = (right.T * singular_values) @ left.T
        rates = rates + inverse_of @ (b - A @ rates)
        free = free - inverse_of @ (A @ free)
    return rates + free @ posture, least


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7, 9])
def test_the_rates_are_those_of_pseudo_inverses(rng, within, n):
    off = []
    for _ in range(50):
        J = rng.normal(size=(6, n))
        twist = rng.normal(size=6)
        posture = rng.normal(size=n)
        z = rng.normal(size=3)
        z /= np.linalg.norm(z)
        rates = np.empty(n)
        prioritised(J, z, twist, DAMPING, posture, np.zeros(n, dtype=bool), rates)
        exact, least = by_pseudo_inverses(J, z, twist, posture)
        if least > CLEAR:
            off.append(np.abs(rates - exact).max() / np.abs(exact).max())
    assert len(off) > 10
    within("relative error of the rates", max(off), 2e-5)


def test_a_joint_that_is_held_does_not_move_and_the_position_is_kept(rng):
    J = rng.normal(size=(6, 7))
    twist = rng.normal(size=6)
    rates = np.empty(7)
    held = np.zeros(7, dtype=bool)
    held[2] = True
    prioritised(J, np.array([0.0, 0.0, 1.0]), twist, DAMPING, np.zeros(7), held, rates)
    assert rates[2] == 0.0
    assert J[:3] @ rates == pytest.approx(twist[:3], abs=1e-5)


@pytest.mark.parametrize("name", ARMS)
def test_arms_of_six_and_seven_joints_meet_the_whole_pose(rng, within, name):
    """Targets within 0.3 rad of the start; a few lie behind a limit."""
    chain = Chain.from_arm(published_arms.load(name))
    low, high = np.clip(chain.limits, -3.0, 3.0).T
    met = 0
    off = 0.0
    for _ in range(40):
        q = low + (0.2 + 0.6 * rng.random(chain.n)) * (high - low)
        X = chain.forward(q)
        solution = solve(
            chain,
            X,
            np.clip(q + rng.uniform(-0.3, 0.3, chain.n), low, high),
            1e-6,
            1e-5,
            "priority",
        )
        met += solution.converged
        if solution.converged:
            X_error = inverse(chain.forward(solution.q)) @ X
            off = max(
                off,
                float(np.linalg.norm(X_error[:3, 3])),
                float(np.linalg.norm(log_so3(X_error[:3, :3]))),
            )
    assert met >= 36
    within("whole pose, turn about the axis included [m, rad]", off, 1e-5)


def test_four_joints_meet_the_position_and_lean_the_least(rng, within, four):
    """The lean is compared with the least one at that position, found by SciPy from the same
    start.
    """
    worse = []
    for _ in range(12):
        q = np.array(
            [rng.uniform(-1, 1), rng.uniform(0.9, 2.0), rng.uniform(0.9, 1.7), rng.uniform(-1, 1)]
        )
        X = four.forward(q) @ pose(exp_so3(0.3 * rng.normal(size=3)), 0.03 * rng.normal(size=3))
        solution = solve(four, X, q, 1e-6, np.pi, "priority")
        assert solution.position_error < 1e-6

        def lean(q: Array, X: Array = X) -> float:
            return float(np.arccos(np.clip(four.forward(q)[:3, 2] @ X[:3, 2], -1.0, 1.0)))

        least = minimize(
            lean,
            q,
            method="SLSQP",
            constraints={"type": "eq", "fun": lambda q, X=X: four.forward(q)[:3, 3] - X[:3, 3]},
            bounds=four.limits,
            options={"ftol": 1e-10, "maxiter": 300},
        )
        assert solution.orientation_error == pytest.approx(lean(solution.q), abs=1e-6)
        if least.success:
            worse.append(solution.orientation_error - lean(least.x))
    assert len(worse) >= 6
    within("lean above the least one [rad]", max(worse), 2e-4)


def test_a_place_out_of_reach_is_approached_as_far_as_it_goes(within, four):
    """Straight away from the shoulder: the nearest place lies on the sphere of the stretched arm,
    or at the limits.
    """
    q = np.array([0.0, 1.6, 2.4, 0.0])
    X = four.forward(q)
    far = pose(X[:3, :3], 3.0 * X[:3, 3])
    solution = solve(four, far, q, 1e-6, 0.5, "priority")
    assert not solution.converged

    def distance(q: Array) -> float:
        return float(np.linalg.norm(four.forward(q)[:3, 3] - far[:3, 3]))

    nearest = min(
        minimize(distance, start, bounds=four.limits, method="L-BFGS-B").fun
        for start in (q, np.array([0.0, 1.0, 3.0, 0.0]), np.array([0.0, 2.0, 3.4, 0.0]))
    )
    within("distance beyond the nearest place [m]", solution.position_error - nearest, 1e-4)


def test_a_seventh_joint_keeps_the_others_off_their_limits(rng):
    chain = Chain.from_arm(published_arms.load("iiwa7"))
    low, high = chain.limits.T
    zone = ZONE * (high - low)
    inside = 0
    for _ in range(20):
        q = low + (0.25 + 0.5 * rng.random(7)) * (high - low)
        X = chain.forward(q)
        near = q.copy()
        near[2] = high[2] - 0.05
        solution = solve(
            chain, X, near, 1e-6, 1e-5, "priority", options=IkOptions(max_iterations=400)
        )
        if solution.converged:
            inside += bool(
                np.all(solution.q > low + 0.9 * zone) and np.all(solution.q < high - 0.9 * zone)
            )
    assert inside >= 12
