"""Joints to spare: their motion against NumPy, and the arms that it leads off singular postures."""

import numpy as np
import pytest

from uuv.controllers.ik.entries import entry
from uuv.controllers.ik.spare_joints import NEAR
from uuv.controllers.mkps import Chain, Track, track
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import Array, pose

PERIOD = 0.02  # [s]
SPEED = 0.1  # [m/s] of the tool
WHOLE = np.zeros((6, 6))  # the tool moves in every way
PLANAR = Chain.from_dh(
    [(0.0, 0.0, a, 0.0) for a in (0.5, 0.4, 0.3, 0.2)], limits=np.tile([-np.inf, np.inf], (4, 1))
)
IN_A_PLANE = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])  # it does not move along z, nor turn off it


def spare(chain: Chain, q: Array, blocked: Array = WHOLE) -> tuple[float, Array]:
    """Clearance, and the motion."""
    rates = np.empty(chain.n)
    return entry("spare")(chain.memory(), np.asarray(q, dtype=float), blocked, rates), rates


def clearance(chain: Chain, q: Array, blocked: Array = WHOLE) -> float:
    """The definition: 1 / sqrt(trace((J J^T)^-1)) in arm lengths."""
    J = scaled(chain, q)
    never = float(np.trace(blocked))
    return float((np.trace(np.linalg.inv(J @ J.T + blocked)) - never) ** -0.5)


def scaled(chain: Chain, q: Array) -> Array:
    """Jacobian in arm lengths and radians."""
    J = chain.jacobian(q)
    J[:3] *= chain._scale
    J[:, [kind == "p" for kind in chain.joint_types]] /= chain._scale
    return J


def unlimited(arm_name: str) -> Chain:
    arm = published_arms.load(arm_name)
    return Chain.from_dh(arm.dh, limits=np.tile([-np.inf, np.inf], (arm.n, 1)))


def near_singular(chain: Chain, rng: np.random.Generator) -> Array:
    """Joint values of a clearance below NEAR."""
    while True:
        q = rng.uniform(-2.5, 2.5, chain.n)
        if 0.02 < clearance(chain, q) < 0.8 * NEAR:
            return q


def test_the_motion_is_the_gradient_of_the_clearance_that_leaves_the_tool_at_rest(rng):
    """Along it by differences, on a hinge arm, and on one with a slide and a pantograph link."""
    mixed = Chain.from_vectors(
        rng.normal(size=(8, 3)),
        rng.normal(scale=0.3, size=(8, 3)),
        np.array([1, 1, 0, 1, 2, 1, 1, 1]),
    )
    for chain in (unlimited("iiwa7"), mixed):
        for _ in range(5):
            q = near_singular(chain, rng)
            J = scaled(chain, q)
            found, rates = spare(chain, q)
            assert found == pytest.approx(clearance(chain, q), rel=1e-4)

            units = np.where([kind == "p" for kind in chain.joint_types], chain._scale, 1.0)
            step = 1e-6
            slope = [
                (clearance(chain, q + step * e / units) - clearance(chain, q - step * e / units))
                / (2 * step)
                for e in np.eye(chain.n)
            ]
            uphill = slope - np.linalg.pinv(J) @ J @ slope
            np.testing.assert_allclose(J @ (units * rates), 0.0, atol=1e-5)
            along = units * rates @ uphill / np.linalg.norm(units * rates) / np.linalg.norm(uphill)
            assert along == pytest.approx(1.0, abs=1e-4)


def test_a_clear_posture_in_the_middle_of_its_limits_does_not_move(rng):
    chain = unlimited("era")
    q = rng.uniform(-2.5, 2.5, chain.n)
    while clearance(chain, q) < NEAR:
        q = rng.uniform(-2.5, 2.5, chain.n)
    assert not np.any(spare(chain, q)[1])


def test_joints_by_their_limits_move_back_and_the_tool_stays():
    arm = published_arms.load("iiwa7")
    chain = Chain.from_arm(arm)
    q = np.array([0.3, 0.9, 0.4, 1.5, 0.2, 1.2, 0.1])
    q[2] = chain.limits[2, 1] - 0.05
    _, rates = spare(chain, q)
    assert rates[2] < -0.01
    np.testing.assert_allclose(scaled(chain, q) @ rates, 0.0, atol=1e-6)


def test_the_motion_of_a_planar_arm_raises_its_clearance_in_the_plane():
    """Of four joints three hold the tool: it never leaves the plane."""
    q = np.array([0.4, 0.02, 0.03, -0.02])
    found, rates = spare(PLANAR, q, IN_A_PLANE)
    assert found == pytest.approx(clearance(PLANAR, q, IN_A_PLANE), rel=1e-4)
    np.testing.assert_allclose(scaled(PLANAR, q) @ rates, 0.0, atol=1e-6)
    assert clearance(PLANAR, q + 0.05 * rates, IN_A_PLANE) > found


def test_a_planar_arm_of_four_joints_is_led_off_its_fold(within):
    """Tracked across the fold of its second joint: without the spare one it has to pass."""
    folded = np.array([0.4, np.pi, 0.0, 0.5])
    X = PLANAR.forward(folded)
    across = np.array([-np.sin(folded[0]), np.cos(folded[0]), 0.0])
    line = np.arange(-0.2, 0.2, SPEED * PERIOD)
    path = np.array([pose(X[:3, :3], X[:3, 3] + s * across) for s in line])
    beside = np.add(folded, [0.0, 0.02, 0.02, 0.0])
    back = track(
        PLANAR, path[: len(path) // 2][::-1], beside, PERIOD, speed_limits=5.0, spare_joints=False
    )
    assert back.converged[-1]

    passed = track(PLANAR, path[1:], back.q[-1], PERIOD, speed_limits=1.0, spare_joints=False)
    led = track(PLANAR, path[1:], back.q[-1], PERIOD, speed_limits=1.0)
    assert "limit" in passed.way
    assert largest(passed) == pytest.approx(1.0)
    assert set(led.way) == {"none"}
    assert led.converged.all()
    within("joint speed [rad/s]", largest(led), 0.8)  # measured 0.72
    assert led.nearness.min() > 2.0 * passed.nearness.min()


def through(
    chain: Chain, q_middle: Array, way: Array, reach: float, scale: float
) -> tuple[Array, Array]:
    """First joint values and poses of a line of the tool through that of `q_middle`."""
    X = chain.forward(q_middle)
    line = np.arange(-reach, reach, SPEED * PERIOD * scale)
    path = np.array([pose(X[:3, :3], X[:3, 3] + s * way) for s in line])
    back = track(
        chain, path[: len(path) // 2][::-1], q_middle, PERIOD, speed_limits=5.0, spare_joints=False
    )
    return back.q[-1], path[1:]


def largest(run: Track) -> float:
    return float(np.abs(run.qd).max())


def test_the_european_robotic_arm_evades_its_gimbal_lock(within):
    """The path of [Danilov 2021, figs. 6, 7]: without the spare joint a joint spins."""
    chain = Chain.from_arm(published_arms.load("era"))
    lock = np.radians([90.0, 0.0, -30.0, 60.0, 62.636, 90.0, 0.0])
    q0, path = through(chain, lock, np.array([0.0, 1.0, 0.0]), 1.0, 1.0)

    spun = track(chain, path, q0, PERIOD, passing="off", spare_joints=False)
    run = track(chain, path, q0, PERIOD, speed_limits=0.1)
    assert largest(spun) > 1.0
    assert run.converged.all()
    assert set(run.way) == {"none"}
    within("joint speed [rad/s]", largest(run), 0.05)


def test_a_sequence_is_never_left_farther_than_without_the_spare_joints(rng):
    """Lines through locks of an iiwa's wrist, some of which lead beyond its limits."""
    chain = Chain.from_arm(published_arms.load("iiwa7"))
    farther = []
    evaded = 0
    for _ in range(12):
        q = 0.7 * rng.uniform(chain.limits[:, 0], chain.limits[:, 1])
        q[4] = rng.choice([-0.5, 0.5]) * np.pi
        q[5] = 0.0
        way = rng.normal(size=3)
        q0, path = through(chain, q, way / np.linalg.norm(way), 0.1, 1.0)

        run = track(chain, path, q0, PERIOD, speed_limits=0.4)
        plain = track(chain, path, q0, PERIOD, speed_limits=0.4, spare_joints=False)
        farther.append(run.position_error.max() - plain.position_error.max())
        assert run.orientation_error.max() <= max(plain.orientation_error.max(), 1e-5)
        evaded += bool(run.converged.all() and not plain.converged.all())

    print(f"{evaded} of {len(farther)} lines kept only with the spare joint")
    assert max(farther) <= 1e-6
    assert evaded > 0
