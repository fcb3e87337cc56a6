"""The navigation filter against theory: all information at once, the Riccati equation, consistency
over seeds.
"""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from navigation_bench import UP, Hull, Rig, body
from uuv.perception.navigation.strapdown_filter import Navigation, NavigationState
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    DvlNoise,
    ImuMeasurement,
    ImuNoise,
    Measurement,
    VisionMeasurement,
    VisionNoise,
)
from uuv.sim.interfaces.spatial import Array, exp_so3
from uuv.sim.sensors import proprioception

STEP = 0.02  # [s] of the IMU
# a coarse accelerometer on a perfect attitude, so that all states are moved by all fixes
STILL = ImuNoise(
    acceleration=0.02,
    acceleration_bias=0.03,
    rate=1e-4,
    rate_bias=0.0,
    attitude=0.0,
    attitude_bias=0.0,
)
LOG = DvlNoise(white=4e-3, bias=5e-3)
CAMERA = VisionNoise(white=3e-3, wander=8e-3, wander_time=5.0)


def transition(R: Array, dt: float, navigation: Navigation) -> tuple[Array, Array]:
    """Of the 15 states p, v, b, c, w over one step, with its noise covariance; written down from
    the model alone.
    """
    eye, F = np.eye(3), np.eye(15)
    F[:3, 3:6] = dt * eye
    F[:3, 6:9] = -0.5 * dt**2 * R
    F[3:6, 6:9] = -dt * R
    decay = np.exp(-dt / CAMERA.wander_time)
    F[12:, 12:] = decay * eye
    G = np.zeros((15, 3))
    G[:3] = 0.5 * dt**2 * eye
    G[3:6] = dt * eye
    Q = STILL.acceleration**2 * G @ G.T
    Q[6:9, 6:9] = navigation.bias_walk**2 * dt * eye
    Q[12:, 12:] = CAMERA.wander**2 * (1.0 - decay**2) * eye
    return F, Q


@pytest.mark.parametrize("in_order", [True, False])
def test_late_fixes_give_what_all_information_at_once_gives(within, in_order):
    """Against one Gaussian conditioned on every fix at once: no recursion, no gain, no going back.

    The hull turns; pictures are 0.04 to 0.4 s late and, in the second case, overtake one another;
    logs are late too.
    """
    rng = np.random.default_rng(5)
    navigation = Navigation(adapt=False, gate=np.inf, bias_walk=1e-3)
    ticks = 150
    attitude = [exp_so3([0.1, -0.2, 0.5]) @ exp_so3([0.0, 0.0, 0.01 * k]) for k in range(ticks + 1)]
    rate = np.array([0.0, 0.0, 0.01 / STEP])
    force = [R.T @ UP + 0.1 * rng.standard_normal(3) for R in attitude]

    def imu(k: int) -> ImuMeasurement:
        return ImuMeasurement(
            time=k * STEP, specific_force_B=force[k], w_WB_B=rate, R_WB=attitude[k], noise=STILL
        )

    first = VisionMeasurement(time=0.0, p_WB=np.array([1.0, 2.0, 3.0]), noise=CAMERA)
    log = DvlMeasurement(time=0.0, v_WB_B=np.array([0.1, 0.2, -0.1]), noise=LOG)
    arriving: dict[int, list[Measurement]] = {}
    fixes: list[tuple[int, str, Array]] = []
    for k in range(1, ticks):
        if k % 7 == 0:
            measured = first.p_WB + 0.05 * rng.standard_normal(3)
            late = 12 if in_order else int(rng.integers(2, 20))
            message = VisionMeasurement(time=k * STEP, p_WB=measured, noise=CAMERA)
        elif k % 5 == 0:
            measured = 0.1 * rng.standard_normal(3)
            late = int(rng.integers(0, 3))
            message = DvlMeasurement(time=k * STEP, v_WB_B=measured, noise=LOG)
        else:
            continue
        if k + late <= ticks:
            arriving.setdefault(k + late, []).append(message)
            fixes.append((k, type(message).__name__, measured))
    state = navigation.init([imu(0), first, log, *body()])
    for k in range(1, ticks + 1):
        state, _ = navigation.step(state, [*arriving.get(k, []), imu(k)])
    assert sum(watch.refused for watch in state.fixes.watches) == 0

    # Prior of every step, and transitions between them.
    eye = np.eye(3)
    R0 = attitude[0]
    mean = np.zeros(15)
    C = np.zeros((15, 15))
    mean[:3] = first.p_WB
    mean[3:6] = R0 @ log.v_WB_B
    for at, variance in ((9, LOG.bias**2), (12, CAMERA.wander**2), (6, STILL.acceleration_bias**2)):
        C[at : at + 3, at : at + 3] = variance * eye
    C[:3, :3] = (CAMERA.white**2 + CAMERA.wander**2) * eye
    C[:3, 12:] = C[12:, :3] = -(CAMERA.wander**2) * eye
    C[3:6, 3:6] = (LOG.white**2 + LOG.bias**2) * eye
    C[3:6, 9:12] = -(LOG.bias**2) * R0
    C[9:12, 3:6] = -(LOG.bias**2) * R0.T
    means = [mean]
    covariances = [C]
    steps = [np.eye(15)]
    for k in range(1, ticks + 1):
        F, Q = transition(attitude[k], STEP, navigation)
        known = attitude[k] @ force[k] - UP
        mean = F @ mean
        mean[:3] += 0.5 * STEP**2 * known
        mean[3:6] += STEP * known
        C = F @ C @ F.T + Q
        means.append(mean)
        covariances.append(C)
        steps.append(F)

    def between(j: int, k: int) -> Array:
        """cov(x_j, x_k) for j <= k."""
        F = np.eye(15)
        for i in range(j + 1, k + 1):
            F = steps[i] @ F
        return covariances[j] @ F.T

    H, R = [], []
    for k, kind, _ in fixes:
        h = np.zeros((3, 15))
        if kind == "VisionMeasurement":
            h[:, :3], h[:, 12:] = eye, eye
        else:
            h[:, 3:6] = attitude[k].T
            h[:, 9:12] = eye
        H.append(h)
        R.append((CAMERA.white if kind == "VisionMeasurement" else LOG.white) ** 2 * eye)
    size = 3 * len(fixes)
    S = np.zeros((size, size))
    cross = np.zeros((15, size))
    residual = np.zeros(size)
    order = sorted(range(len(fixes)), key=lambda i: fixes[i][0])
    for a, i in enumerate(order):
        rows = slice(3 * a, 3 * a + 3)
        residual[rows] = fixes[i][2] - H[i] @ means[fixes[i][0]]
        cross[:, rows] = (H[i] @ between(fixes[i][0], ticks)).T
        for b, j in enumerate(order[a:], a):
            block = H[i] @ between(fixes[i][0], fixes[j][0]) @ H[j].T + (R[i] if i == j else 0.0)
            S[rows, 3 * b : 3 * b + 3] = block
            S[3 * b : 3 * b + 3, rows] = block.T
    best = means[-1] + cross @ np.linalg.solve(S, residual)
    left = covariances[-1] - cross @ np.linalg.solve(S, cross.T)
    sigma = np.sqrt(np.diag(left))
    within("states, in their standard deviations", (state.x[:15] - best) / sigma, 1e-6)
    within(
        "covariance, in standard deviations",
        (state.P[:15, :15] - left) / np.outer(sigma, sigma),
        1e-6,
    )


def settled(state: NavigationState) -> Array:
    """Standard deviations (15,) of the filter's states."""
    return np.sqrt(np.diag(state.P))


def test_covariance_settles_at_the_solution_of_the_riccati_equation(within):
    """Vision and DVL ten samples apart, no delay: one period as one step of a discrete filter of
    three states.
    """
    navigation = Navigation(bias_walk=1e-3, adapt=False)
    noise = ImuNoise(
        acceleration=0.01,
        acceleration_bias=0.01,
        rate=1e-4,
        rate_bias=0.0,
        attitude=0.0,
        attitude_bias=0,
    )
    every = 10
    dt = STEP
    vision = 2e-3
    dvl = 3e-3

    def imu(k: int) -> ImuMeasurement:
        return ImuMeasurement(
            time=k * dt,
            specific_force_B=UP + 1e-9 * k,
            w_WB_B=np.zeros(3),
            R_WB=np.eye(3),
            noise=noise,
        )

    state = navigation.init([imu(0), VisionMeasurement(time=0.0, p_WB=np.zeros(3)), *body()])
    for k in range(1, 3000 * every):
        measurements: list[Measurement] = [imu(k)]
        if k % every == 0:
            wiggle = np.full(3, 1e-9 * (-1) ** (k // every))
            measurements += [
                VisionMeasurement(time=k * dt, p_WB=wiggle),
                DvlMeasurement(time=k * dt, v_WB_B=wiggle),
            ]
        state, _ = navigation.step(state, measurements)
    # The filter stands one sample before the next fixes.
    F = np.array([[1.0, dt, -0.5 * dt**2], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    G = np.array([0.5 * dt**2, dt, 0.0])
    Q = noise.acceleration**2 * np.outer(G, G) + np.diag([0.0, 0.0, navigation.bias_walk**2 * dt])
    whole = np.eye(3)
    lifted = np.zeros((3, 3))
    for _ in range(every):
        whole = F @ whole
        lifted = F @ lifted @ F.T + Q
    H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    P = solve_discrete_are(whole.T, H.T, lifted, np.diag([vision**2, dvl**2]))
    ours = F @ state.P[np.ix_([0, 3, 6], [0, 3, 6])] @ F.T + Q
    within("covariance before the fixes, share", ours / P - 1.0, 1e-6)


@pytest.mark.parametrize(
    "rig",
    [
        Rig(imu=proprioception.Imu(period=0.02)),
        Rig(
            imu=proprioception.Imu(period=0.02, acceleration_noise=5e-3, rate_bias=5e-4),
            dvl=proprioception.Dvl(noise=6e-3, bias=2e-3),
            vision=proprioception.VisionDrift(
                period=0.2, delay=0.25, noise=5e-3, bias=3e-3, bias_time=30.0
            ),
        ),
        Rig(
            imu=proprioception.Imu(period=0.02),
            dvl=None,
            vision=proprioception.VisionDrift(period=0.05, delay=0.05, noise=1e-3),
        ),
    ],
    ids=["nominal", "coarse, biased, wandering", "no DVL"],
)
def test_errors_are_as_large_as_the_filter_believes(rig, fresh_seeds):
    """NEES of position, velocity and bias over independent seeds: chi-square of 9 a run.

    The bounds are 5.5 standard deviations from the mean, beyond the 1e-6 quantiles of chi-square of
    9 x 24.
    """
    squared = []
    for seed in [*range(24), *fresh_seeds]:
        course = rig.run(10.0, np.random.default_rng([seed, 1]))
        state = course.state
        e = np.concatenate(
            [state.x[:3] - course.p[-1], state.x[3:6] - course.v[-1], state.x[6:9] - course.bias_B]
        )
        squared.append(e @ np.linalg.solve(state.P[:9, :9], e))
    spread = 5.5 * np.sqrt(2.0 * 9.0 / len(squared))
    assert 9.0 - spread < np.mean(squared) < 9.0 + spread


def test_bias_stays_with_the_hull_when_it_turns():
    """A tilt of the attitude reference couples gravity in, across the hull; it is not found anew at
    each heading.
    """
    rig = Rig(imu=proprioception.Imu(period=0.01, acceleration_bias=0.0, attitude_bias=1e-3))
    course = rig.run(60.0, np.random.default_rng(3), hull=Hull(0.01, turn=3.0))
    assert np.abs(course.bias_B[:2]).max() > 3e-3  # [m/s^2] there is something to find
    error = np.abs(course.state.x[6:9] - course.bias_B)
    assert np.all(error < 5.0 * settled(course.state)[6:9])
    assert np.all(settled(course.state)[6:9] < 5e-4)
