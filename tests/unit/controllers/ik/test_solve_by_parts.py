"""Solutions of a part of a pose: every part alone, on arms of three to eight joints, judged by DH
matrices.
"""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.kinematics.ik_parts import REACHER
from untyped import untyped
from uuv.controllers.mkps import Chain, IkOptions, solve, solve_many
from uuv.models.arms import published_arms
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

INF = math.inf
KINDS = {
    "position": {"orientation_tolerance": INF},
    "orientation": {"position_tolerance": INF},
    "axis": {"position_tolerance": INF, "turn_tolerance": INF},
    "position and axis": {"turn_tolerance": INF},
    "position, axis and turn": {"axis_tolerance": 1e-3, "turn_tolerance": 1e-2},
    "position and a loose rotation": {"orientation_tolerance": 0.4},
}


def drawn_arm(n: int, seed: int) -> Chain:
    rng = np.random.default_rng(seed)
    dh = np.column_stack(
        [
            rng.uniform(-3, 3, n),
            rng.uniform(-0.3, 0.3, n),
            rng.uniform(0.1, 0.6, n),
            rng.uniform(-1.6, 1.6, n),
        ]
    )
    return Chain.from_dh(
        dh,
        limits=np.tile([-2.6, 2.3], (n, 1)),
        tool=pose(exp_so3([0.4, -0.5, 0.3]), [0.02, 0, 0.1]),
    )


CHAINS = {
    "URDF of 3": Chain.from_urdf(REACHER, "base", "tip"),
    "drawn 4": drawn_arm(4, 1),
    "drawn 5": drawn_arm(5, 2),
    "UR5": Chain.from_arm(published_arms.load("ur5")),
    "Stanford": Chain.from_arm(published_arms.load("stanford")),
    "Panda": Chain.from_arm(published_arms.load("panda")),
    "drawn 8": drawn_arm(8, 3),
}


def drawn(chain: Chain, rng: np.random.Generator) -> Array:
    bounds = np.clip(chain.limits, -np.pi, np.pi)
    return rng.uniform(bounds[:, 0], bounds[:, 1])


def judged(chain: Chain, q: Array, target: Array) -> dict[str, float]:
    """Errors of joint values by rotation vectors: distance, whole angle, tilt of the tool axis,
    turn about it.
    """
    X = chain.forward(q)
    z, axis_goal = X[:3, 2], target[:3, 2]
    axis = np.cross(z, axis_goal)
    tilt = math.atan2(float(np.linalg.norm(axis)), float(z @ axis_goal))
    aligned = exp_so3(tilt * axis / max(np.linalg.norm(axis), 1e-300)) @ X[:3, :3]
    return {
        "position_tolerance": float(np.linalg.norm(X[:3, 3] - target[:3, 3])),
        "orientation_tolerance": float(
            Rotation.from_matrix(X[:3, :3].T @ target[:3, :3]).magnitude()
        ),
        "axis_tolerance": tilt,
        "turn_tolerance": float(Rotation.from_matrix(aligned.T @ target[:3, :3]).magnitude()),
    }


def claimed(kind: str) -> dict[str, float]:
    """Tolerances of a kind of target, those that count alone."""
    tolerances = {"position_tolerance": 1e-4, "orientation_tolerance": 1e-3} | KINDS[kind]
    if "axis_tolerance" in tolerances or "turn_tolerance" in tolerances:
        whole = tolerances.pop("orientation_tolerance")
        tolerances = {"axis_tolerance": whole, "turn_tolerance": whole} | tolerances
    return {name: tolerance for name, tolerance in tolerances.items() if tolerance < INF}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("arm", CHAINS)
def test_every_target_that_is_reachable_is_found(
    arm: str, kind: str, rng: np.random.Generator
) -> None:
    chain = CHAINS[arm]
    targets = np.array([chain.forward(drawn(chain, rng)) for _ in range(40)])
    if kind == "position":  # any orientation will do
        targets[:, :3, :3] = Rotation.random(40, random_state=rng).as_matrix()
    if kind in ("axis", "orientation"):
        targets[:, :3, 3] = rng.uniform(-9.0, 9.0, (40, 3))
    if kind in ("axis", "position and axis"):
        targets[:, :3, :3] = (
            targets[:, :3, :3] @ Rotation.from_euler("z", rng.uniform(-3, 3, (40, 1))).as_matrix()
        )
    if kind == "position and a loose rotation":
        targets[:, :3, :3] = targets[:, :3, :3] @ exp_so3([0.2, -0.15, 0.2])
    start = drawn(chain, rng)

    solutions = solve_many(chain, targets, start, **untyped(KINDS[kind]))

    assert solutions.converged.all()
    for target, q, axis, turn in zip(
        targets, solutions.q, solutions.axis_error, solutions.turn_error, strict=True
    ):
        assert np.all((q >= chain.limits[:, 0]) & (q <= chain.limits[:, 1]))
        errors = judged(chain, q, target)
        for name, tolerance in claimed(kind).items():
            assert errors[name] <= tolerance + 1e-9
        assert axis == pytest.approx(errors["axis_tolerance"], abs=1e-7)
        assert turn == pytest.approx(errors["turn_tolerance"], abs=1e-6)


@pytest.mark.parametrize("branch", ["free", "keep"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_claim_is_false(kind: str, branch: str, rng: np.random.Generator) -> None:
    """Targets of which many are out of reach: what is called converged is within every tolerance
    that counts.
    """
    met = 0
    for chain in (CHAINS["URDF of 3"], CHAINS["drawn 5"]):
        for _ in range(30):
            target = pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.2, 0.2, 3))
            solution = solve(
                chain, target, drawn(chain, rng), branch=untyped(branch), **untyped(KINDS[kind])
            )
            errors = judged(chain, solution.q, target)
            within = all(
                errors[name] <= tolerance + 1e-9 for name, tolerance in claimed(kind).items()
            )
            assert within or not solution.converged
            assert solution.position_error == pytest.approx(errors["position_tolerance"], abs=1e-9)
            assert solution.orientation_error == pytest.approx(
                errors["orientation_tolerance"], abs=1e-6
            )
            met += solution.converged
    assert met < 60 or "position" not in kind


def test_one_at_a_time_equals_many(rng: np.random.Generator) -> None:
    chain = CHAINS["UR5"]
    targets = np.array([chain.forward(drawn(chain, rng)) for _ in range(5)])
    start = drawn(chain, rng)
    for kind in KINDS.values():
        many = solve_many(chain, targets, start, **untyped(kind), options=IkOptions(threads=2))
        for i, target in enumerate(targets):
            single = solve(chain, target, start, **untyped(kind))
            np.testing.assert_array_equal(single.q, many.q[i])
            assert (single.axis_error, single.turn_error) == (
                many[i].axis_error,
                many[i].turn_error,
            )
    whole = solve(chain, targets[0], start)
    assert math.isnan(whole.axis_error)
    for branch in ("free", "keep"):  # the first call and those after it go the same way
        solutions = [
            solve(chain, targets[0], start, orientation_tolerance=0.5, branch=untyped(branch))
            for _ in range(3)
        ]
        np.testing.assert_array_equal(solutions[0].q, solutions[1].q)
        np.testing.assert_array_equal(solutions[1].q, solutions[2].q)
        assert not math.isnan(solutions[2].axis_error)
    assert np.isnan(solve_many(chain, targets, start).turn_error).all()


def test_history_and_single_precision(rng: np.random.Generator) -> None:
    chain = CHAINS["drawn 5"]
    target = chain.forward(drawn(chain, rng))
    start = drawn(chain, rng)
    traced = solve(chain, target, start, turn_tolerance=INF, options=IkOptions(history=True))
    plain = solve(chain, target, start, turn_tolerance=INF)
    assert traced.history is not None
    np.testing.assert_array_equal(traced.history[[0, -1]], [start, plain.q])
    single = solve(chain, target, start, turn_tolerance=INF, options=IkOptions(precision="single"))
    assert single.converged
    errors = judged(chain, single.q, target)
    assert errors["position_tolerance"] <= 1e-4
    assert errors["axis_tolerance"] <= 1e-3
    assert single.axis_error == pytest.approx(errors["axis_tolerance"], abs=1e-9)
    assert single.turn_error == pytest.approx(errors["turn_tolerance"], abs=1e-9)
    fine = solve(
        chain,
        target,
        start,
        1e-9,
        axis_tolerance=1e-9,
        turn_tolerance=INF,
        options=IkOptions(precision="single"),
    )
    assert not fine.converged


@pytest.mark.parametrize("branch", ["free", "keep"])
def test_a_stretched_arm_trades_one_error_for_the_other(
    branch: str, rng: np.random.Generator
) -> None:
    """Targets beyond the reach of a straight UR5, by less than the tolerances: poses within both
    are there.
    """
    chain = CHAINS["UR5"]
    solutions = []
    for _ in range(30):
        q = rng.uniform(-3.0, 3.0, 6)
        q[2] = rng.uniform(-0.02, 0.02)  # the elbow
        X = chain.forward(q)
        outwards = X[:3, 3] / np.linalg.norm(X[:3, 3])
        tilt = rng.normal(size=3)
        tilt *= 0.9e-3 / np.linalg.norm(tilt)
        target = pose(X[:3, :3] @ exp_so3(tilt), X[:3, 3] + 0.9e-4 * outwards)
        solutions.append(
            solve(chain, target, q + rng.uniform(-0.05, 0.05, 6), branch=untyped(branch))
        )
        assert not solutions[-1].converged or solutions[-1].position_error <= 1e-4
        assert not solutions[-1].converged or solutions[-1].orientation_error <= 1e-3
    assert sum(solution.converged for solution in solutions) >= 29


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"position_tolerance": INF, "orientation_tolerance": INF}, "at least one must be finite"),
        (
            {"position_tolerance": INF, "axis_tolerance": INF, "turn_tolerance": 4.0},
            "at least one must be finite",
        ),
        ({"axis_tolerance": 0.0}, r"axis_tolerance \[rad\]: must be positive, got 0"),
        ({"turn_tolerance": math.nan}, r"turn_tolerance \[rad\]"),
        ({"turn_tolerance": "wide"}, r"turn_tolerance \[rad\]"),
        (
            {"method": "plain", "turn_tolerance": INF},
            "method: 'plain' solves for whole poses; \"hybrid\"",
        ),
        (
            {"method": "jacobian_free", "orientation_tolerance": INF},
            "method: 'jacobian_free' solves for whole poses",
        ),
        ({"method": "priority", "position_tolerance": INF}, 'position_tolerance: "priority"'),
        ({"method": "priority", "turn_tolerance": 0.1}, 'turn_tolerance: "priority" never counts'),
    ],
)
def test_tolerances_that_ask_for_nothing_or_too_much_are_refused(given: dict, said: str) -> None:
    chain = CHAINS["UR5"]
    with pytest.raises(ConfigurationError, match=said):
        solve(chain, np.eye(4), np.zeros(6), **untyped(given))
    with pytest.raises(ConfigurationError, match=said):
        solve_many(chain, np.eye(4)[None], np.zeros(6), **untyped(given))


def test_priority_judges_the_tool_axis_by_its_own_tolerance(rng: np.random.Generator) -> None:
    chain = CHAINS["drawn 4"]
    q = drawn(chain, rng)
    target = chain.forward(q) @ pose(exp_so3([0.05, 0.0, 0.0]))
    loose = solve(chain, target, q, method="priority", axis_tolerance=0.06)
    assert loose.converged
    assert not solve(chain, target, q, method="priority").converged
