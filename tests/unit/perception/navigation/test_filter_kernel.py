"""Kernels of the navigation filter, uncompiled, against the matrices of a Kalman filter."""

import numpy as np
import pytest

from uncompiled import uncompiled
from uuv.sim.interfaces.records import EstimateRecord, estimate_record, joint_record
from uuv.sim.interfaces.spatial import GRAVITY, Array, exp_so3, log_so3

attitude, kernel = uncompiled(
    "uuv.perception.navigation.attitude_kernel", "uuv.perception.navigation.filter_kernel"
)
WALKS = np.array([0.02, 0.3, 5.0])
LAYOUTS = [(9, -1, -1, -1), (12, 9, -1, -1), (12, -1, 9, -1), (15, 9, 12, -1), (18, 9, 12, 15)]


class Case:
    """A layout with a mean, a covariance and one stored step, drawn at random."""

    def __init__(self, layout: tuple[int, int, int, int], rng: np.random.Generator) -> None:
        self.memory = np.zeros(1, kernel.FILTER)
        self.f = self.memory[0]
        self.layout = self.f.layout
        self.n = layout[0]
        self.x = self.f.x
        self.P = self.f.P
        self.layout[:], self.f.walks[:] = layout, WALKS
        self.x[: self.n] = rng.normal(size=self.n)
        G = rng.normal(size=(self.n, self.n))
        self.P[: self.n, : self.n] = G @ G.T + 0.1 * np.eye(self.n)
        self.R = self.f.R_WB
        self.R[:] = exp_so3(rng.normal(size=3))
        self.row = np.zeros(kernel.INPUT)
        self.row[: kernel.FORCE] = [3.0, 0.07, 0.02, 0.05]
        self.row[kernel.FORCE : kernel.ATTITUDE] = rng.normal(size=3)
        self.row[kernel.ATTITUDE : kernel.JUMP] = self.R.ravel()
        self.row[kernel.JUMP] = 0.4
        self.fix = np.array([1.0, *rng.normal(size=3), 0.3, 0.11])

    def measured(self, kind: int) -> Array:
        """H (3, n) of a fix."""
        H = np.zeros((3, self.n))
        _, bias, wander, _ = self.layout
        if kind == kernel.VISION:
            H[:, :3], H[:, 3:6] = np.eye(3), self.fix[kernel.SHIFT] * np.eye(3)
            if wander >= 0:
                H[:, wander : wander + 3] = np.eye(3)
        else:
            H[:, 3:6] = np.eye(3)
            if bias >= 0:
                H[:, bias : bias + 3] = self.R
        return H


@pytest.fixture(params=LAYOUTS, ids=str)
def case(request: pytest.FixtureRequest, rng: np.random.Generator) -> Case:
    return Case(request.param, rng)


def test_propagation_is_f_p_f_transposed_and_noise(case: Case) -> None:
    n = case.n
    dt = case.row[kernel.DT]
    wander = case.layout[2]
    F = np.eye(n)
    I3 = np.eye(3)
    F[:3, 3:6] = dt * I3
    F[:3, 6:9] = -0.5 * dt**2 * case.R
    F[3:6, 6:9] = -dt * case.R
    Q = np.zeros((n, n))
    v = np.diag([0.02, 0.02, 0.05])
    Q[:3, :3] = 0.25 * dt**2 * v
    Q[:3, 3:6] = 0.5 * dt * v
    Q[3:6, :3] = 0.5 * dt * v
    Q[3:6, 3:6] = v
    Q[6:9, 6:9] = (WALKS[0] * dt + 0.4) * I3
    if wander >= 0:
        decay = np.exp(-dt / WALKS[2])
        F[wander : wander + 3, wander : wander + 3] = decay * I3
        Q[wander : wander + 3, wander : wander + 3] = WALKS[1] * (1.0 - decay**2) * I3
    gravity = np.zeros(n)
    force = case.R @ case.row[kernel.FORCE : kernel.ATTITUDE] - [0.0, 0.0, GRAVITY]
    gravity[:3] = 0.5 * dt**2 * force
    gravity[3:6] = dt * force
    x = F @ case.x[:n] + gravity
    P = F @ case.P[:n, :n] @ F.T + Q
    kernel.propagate(case.f, case.row)
    np.testing.assert_allclose(case.x[:n], x, atol=1e-12)
    np.testing.assert_allclose(case.P[:n, :n], P, atol=1e-12)


@pytest.mark.parametrize("kind", [kernel.VISION, kernel.DVL])
def test_a_fix_is_taken_by_the_kalman_gain(case: Case, kind: int) -> None:
    n = case.n
    H = case.measured(kind)
    x = case.x[:n].copy()
    P = case.P[:n, :n].copy()
    innovation, cross, S = kernel.compare(kind, case.fix, case.row, case.layout, case.x, case.P)
    expected = case.fix[kernel.VALUE : kernel.VALUE + 3] - H @ x
    covariance = H @ P @ H.T + case.fix[kernel.VARIANCE] * np.eye(3)
    np.testing.assert_allclose(innovation, expected, atol=1e-12)
    np.testing.assert_allclose(cross[:n], P @ H.T, atol=1e-12)
    np.testing.assert_allclose(S, covariance, atol=1e-12)
    np.testing.assert_allclose(kernel.inverse3(S), np.linalg.inv(S), atol=1e-10)
    case.f.past_input[7], case.f.past_x[7], case.f.past_P[7] = case.row, case.x, case.P
    square, shown, white = kernel.mahalanobis(case.memory, kind, case.fix, 7)
    np.testing.assert_array_equal(shown, innovation)
    assert square == pytest.approx(expected @ np.linalg.solve(covariance, expected))
    np.testing.assert_allclose(
        white, np.linalg.solve(np.linalg.cholesky(covariance), expected), atol=1e-10
    )
    K = P @ H.T @ np.linalg.inv(covariance)
    kernel.absorb(case.f, kind, case.fix, case.row)
    np.testing.assert_allclose(case.x[:n], x + K @ expected, atol=1e-10)
    np.testing.assert_allclose(case.P[:n, :n], (np.eye(n) - K @ H) @ P, atol=1e-10)


def test_an_inverse_of_any_matrix_is_one(rng: np.random.Generator) -> None:
    """Each of its nine numbers, though the kernel asks for symmetric ones alone."""
    for _ in range(5):
        G = rng.normal(size=(3, 3))
        S = G @ G.T + 0.1 * np.eye(3)
        np.testing.assert_allclose(kernel.inverse3(S) @ S, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-6, 9e-5, 1.1e-4, 0.3, 2.0])
def test_a_turn_about_its_own_axes(size: float, rng: np.random.Generator) -> None:
    R = exp_so3(rng.normal(size=3))
    axis = rng.normal(size=3)
    angle = size * axis / np.linalg.norm(axis)
    expected = R @ exp_so3(angle)
    attitude.rotate(R, angle)
    np.testing.assert_allclose(R, expected, atol=1e-13)
    skewed = expected + 1e-4 * rng.normal(size=(3, 3))
    attitude.rotate(skewed, np.zeros(3))  # the Newton step brings it nearer to a rotation
    assert np.abs(skewed.T @ skewed - np.eye(3)).max() < 1e-6


def turned(
    R: Array, R_meas: Array, w: Array, bias: Array, gyro: Array, dt: float = 0.01
) -> tuple[Array, Array, Array]:
    R, bias, gyro = R.copy(), bias.copy(), gyro.copy()
    attitude.turn(R, R_meas, w, dt, bias, gyro, np.array([0.02, 0.3, 0.05]), np.zeros(3))
    return R, bias, gyro


def test_attitude_is_a_kalman_filter_of_angle_and_bias(rng: np.random.Generator) -> None:
    dt = 0.01
    G = rng.normal(size=(2, 2))
    P = 0.02 * (G @ G.T + 0.2 * np.eye(2))
    R = exp_so3(rng.normal(size=3))
    w = rng.normal(size=3)
    bias = rng.normal(size=3)
    error = rng.uniform(-2e-3, 2e-3, 3)
    moved = R @ exp_so3(dt * (w - bias))
    R_filtered, found_bias, gyro = turned(
        R, moved @ exp_so3(error), w, bias, np.array([P[0, 0], P[0, 1], P[1, 1]])
    )
    F = np.array([[1.0, -dt], [0.0, 1.0]])
    P = F @ P @ F.T + np.diag([0.02 * dt, 0.05 * dt])
    K = P[:, 0] / (P[0, 0] + 0.3)
    P = P - np.outer(K, P[0])
    np.testing.assert_allclose(gyro, [P[0, 0], P[0, 1], P[1, 1]], rtol=1e-9)
    np.testing.assert_allclose(log_so3(moved.T @ R_filtered), K[0] * error, atol=1e-8)
    np.testing.assert_allclose(found_bias, bias + K[1] * error, atol=1e-8)


def test_a_wild_attitude_reading_turns_by_little_and_to_its_side(rng: np.random.Generator) -> None:
    gyro = np.array([0.1, 0.05, 0.2])
    none = np.zeros(3)
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        R = exp_so3(rng.normal(size=3))
        wild, wild_bias, _ = turned(R, R @ exp_so3(1.0 * axis), none, none, gyro)
        clipped, clipped_bias, _ = turned(
            R, R @ exp_so3(np.arcsin(attitude.TILT_CLIP) * axis), none, none, gyro
        )
        np.testing.assert_allclose(wild, clipped, atol=1e-12)
        np.testing.assert_allclose(wild_bias, clipped_bias, atol=1e-12)
        assert log_so3(R.T @ wild) @ axis > 1e-4
        assert wild_bias @ axis > 0.0


def test_a_replay_is_the_filter_run_again_with_the_late_fix(
    case: Case, rng: np.random.Generator
) -> None:
    """Around the end of the ring, with fixes of both kinds on the way."""
    f = case.f
    n = case.n
    last = kernel.HISTORY - 1
    f.past_x[:] = np.nan
    f.past_P[:] = np.nan
    f.past_fix[:] = 1.0
    f.head = last - 2
    f.interval = np.inf
    f.acceleration = 2.0
    f.attitude = 1e-4
    f.tilt = 4.0
    f.gyro[:] = 0.01, 0.0, 0.01
    states = {}
    for step, head in enumerate((last - 1, last, 0, 1)):
        force = rng.normal(size=3)
        w = 0.1 * rng.normal(size=3)
        assert kernel.advance(f, 0.05, force, w, case.R.copy(), 0.0)
        assert f.head == head
        row = f.past_input[head]
        np.testing.assert_allclose(row[:7], [0.05 * (step + 1), 0.05, 0.02, 0.01, *force])
        np.testing.assert_allclose(row[kernel.ATTITUDE : kernel.JUMP], case.R.ravel())
        np.testing.assert_array_equal(f.past_x[head], case.x)
        np.testing.assert_array_equal(f.past_P[head][:n, :n], case.P[:n, :n])
        assert not f.past_fix[head, :, kernel.HAS].any()
        states[head] = case.x.copy(), case.P.copy()
    f.past_fix[last, kernel.VISION], f.past_fix[1, kernel.DVL] = case.fix, case.fix
    twin = np.zeros(1, kernel.FILTER)[0]
    twin.layout[:], twin.walks[:] = f.layout, f.walks
    twin.x[:], twin.P[:] = states[last]
    kernel.absorb(twin, kernel.VISION, case.fix, f.past_input[last])
    for head in (0, 1):
        kernel.propagate(twin, f.past_input[head])
    before = twin.x.copy(), twin.P.copy()
    kernel.absorb(twin, kernel.DVL, case.fix, f.past_input[1])
    withheld = 0.01 * rng.normal(size=(2, 3))
    f.held[:] = withheld
    kernel.replay(case.memory, last)
    np.testing.assert_allclose(f.x, twin.x)
    np.testing.assert_allclose(f.P[:n, :n], twin.P[:n, :n])
    np.testing.assert_allclose(f.past_x[1], before[0])  # the past is kept before its fixes
    np.testing.assert_allclose(f.past_P[1][:n, :n], before[1][:n, :n])
    np.testing.assert_allclose(
        f.held - withheld, (twin.x - states[1][0])[:6].reshape(2, 3), atol=1e-12
    )


def test_a_sample_that_is_not_finite_changes_nothing(case: Case) -> None:
    case.f.interval = 0.05
    before = case.memory.copy()
    for spoilt in range(4):  # also one that comes sooner than those before it
        sample = [np.ones(3), np.ones(3), np.eye(3), np.array(0.04)]
        sample[spoilt] = sample[spoilt] * (np.nan if spoilt < 3 else np.inf)
        *measured, dt = sample
        assert not kernel.advance(case.f, float(dt), *measured, 0.0)
        assert case.memory.tobytes() == before.tobytes()


RELEASE = np.array([0.5, 0.2, 3.0, 0.04])


def smooth(
    case: Case, dt: float, lag: float, held: Array, a_B: Array, w: Array | None = None
) -> EstimateRecord:
    """Output `dt` after the last one and `lag` ahead of the filter; `held` and `a_B` are changed in
    place.
    """
    f = case.f
    out = estimate_record(2)
    f.release[:] = RELEASE
    f.smooth = 0.1
    f.time = -lag
    f.clock = 0.0
    f.given = -dt
    f.force[:] = [0.1, 0.2, 9.9]
    f.w_B[:] = 0.0 if w is None else w
    f.rate_bias[:] = [0.01, -0.02, 0.03]
    f.held[:], f.a_B[:] = held, a_B
    kernel.put_out(case.memory, joint_record(2), out)
    held[:], a_B[:] = f.held, f.a_B
    return out


def test_output_leads_the_filter_by_its_lag_and_leaves_out_what_is_held(
    case: Case, rng: np.random.Generator
) -> None:
    held = 0.01 * rng.normal(size=(2, 3))
    w = rng.normal(size=3)
    unchanged = held.copy()
    out = smooth(case, 0.0, 0.07, held, np.zeros(3), w)
    X = out.X_WB
    np.testing.assert_array_equal(held, unchanged)  # no time has passed
    rate = w - [0.01, -0.02, 0.03]
    v_W = case.x[3:6] - held[1]
    np.testing.assert_allclose(X[:3, 3], case.x[:3] - held[0] + 0.07 * v_W)
    np.testing.assert_allclose(X[:3, :3], case.R @ exp_so3(0.07 * rate), atol=1e-12)
    np.testing.assert_allclose(out.v_WB_B, case.R.T @ v_W)
    np.testing.assert_allclose(out.w_WB_B, rate)
    np.testing.assert_allclose(out.position_sigma, np.sqrt(np.diag(case.P)[:3] + held[0] ** 2))
    out = smooth(case, 0.0, 0.0, held, np.zeros(3), w)
    np.testing.assert_array_equal(out.X_WB[:3, :3], case.R)


def test_what_is_held_is_released_as_by_a_damped_spring(case: Case) -> None:
    """Of the damping 1/sqrt(2), at the filter's own frequency within bounds; beyond a distance by
    an even pull.
    """
    for scale, frequency in ((1.0, None), (0.0, RELEASE[1]), (1e6, RELEASE[2])):
        for i in range(3):
            case.P[i, 3 + i] = scale * (1.0 + i)
        frequency_of = RELEASE[0] * scale * 6.0 / np.trace(case.P[:3, :3])
        expected = np.clip(frequency_of, RELEASE[1], RELEASE[2]) if frequency is None else frequency
        for far in (0.02, 0.4):
            held = np.array([[far, 0.0, 0.0], [0.1, 0.2, 0.0]])
            smooth(case, 1e-3, 0.0, held, np.zeros(3))
            pull = expected**2 * min(far, RELEASE[3])
            speed = np.array([0.1, 0.2, 0.0]) - 1e-3 * np.sqrt(2.0) * expected * np.array(
                [0.1, 0.2, 0.0]
            )
            speed[0] -= 1e-3 * pull
            np.testing.assert_allclose(held[1], speed)
            np.testing.assert_allclose(held[0], [far, 0.0, 0.0] + 1e-3 * speed)
    held = np.array([[0.02, 0.0, 0.0], [0.0, 0.0, 0.0]])
    smooth(case, 1.0, 0.0, held, np.zeros(3))  # a long step is no reason to overshoot
    np.testing.assert_allclose(held[0, 0], 0.02 * (1.0 - 0.3**2))


def test_acceleration_follows_by_its_time_constant(case: Case) -> None:
    fresh = np.array([0.1, 0.2, 9.9]) - case.x[6:9] - GRAVITY * case.R[2]
    for dt, share in ((0.02, 0.2), (0.05, 0.5), (0.3, 1.0)):
        a_B = np.array([1.0, -1.0, 2.0])
        acceleration = smooth(case, dt, 0.0, np.zeros((2, 3)), a_B).a_WB_B
        np.testing.assert_allclose(a_B, (1.0 - share) * np.array([1.0, -1.0, 2.0]) + share * fresh)
        np.testing.assert_array_equal(acceleration, a_B)
