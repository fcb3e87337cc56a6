"""The vehicle's own filter on synthetic sensors: what it finds, what lateness costs, how smooth it is."""

from collections.abc import Callable

import numpy as np
import pytest

from perception.navigation import Navigation
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    TorqueMeasurement,
    VisionMeasurement,
)
from sim.interfaces.spatial import GRAVITY, Array, exp_so3, rotation_angle

STEP, LATE = 0.002, 0.1  # [s]
UP = np.array([0.0, 0.0, GRAVITY])
R_WB = exp_so3([0.1, -0.2, 0.5])
BIAS_W = np.array([0.004, -0.006, 0.005])  # [m/s^2]

Motion = Callable[[float], tuple[Array, Array, Array]]  # time [s] -> place, velocity, acceleration, world axes


def resting(_: float) -> tuple[Array, Array, Array]:
    return np.array([1.0, -2.0, -3.0]), np.zeros(3), np.zeros(3)


def cruising(time: float) -> tuple[Array, Array, Array]:
    v = np.array([0.2, -0.1, 0.05])
    return v * time, v, np.zeros(3)


def swaying(time: float) -> tuple[Array, Array, Array]:
    """A slow hover: 5 cm, 12 s."""
    w, size = 2.0 * np.pi / 12.0, np.array([0.05, 0.03, 0.02])
    return size * np.sin(w * time), size * w * np.cos(w * time), -size * w**2 * np.sin(w * time)


def body() -> list[Measurement]:
    return [
        EncoderMeasurement(time=0.0, q=np.arange(6.0), qd=np.ones(6)),
        TorqueMeasurement(time=0.0, tau=np.full(6, 2.0)),
    ]


def run(
    motion: Motion, seconds: float, *, noise: float = 1.0, bias_W: Array | None = None, late: float = LATE,
    start_error: Array | None = None, vision: bool = True, seed: int = 1,
):  # fmt: skip
    """Places and velocities believed (N, 3) in W, the true places, and the last state. DVL and vision: 10 Hz."""
    rng, filter_ = np.random.default_rng(seed), Navigation()
    bias = np.zeros(3) if bias_W is None else bias_W

    def imu(time: float) -> ImuMeasurement:
        force = R_WB.T @ (motion(time)[2] + UP + bias) + noise * 2e-3 * rng.standard_normal(3)
        return ImuMeasurement(time=time, specific_force_B=force, w_WB_B=np.zeros(3), R_WB=R_WB)

    def seen(time: float) -> VisionMeasurement:
        return VisionMeasurement(time=time, p_WB=motion(time)[0] + noise * 2e-3 * rng.standard_normal(3))

    def log(time: float) -> DvlMeasurement:
        return DvlMeasurement(time=time, v_WB_B=R_WB.T @ motion(time)[1] + noise * 3e-3 * rng.standard_normal(3))

    error = np.zeros(3) if start_error is None else start_error
    state = filter_.init([imu(0.0), VisionMeasurement(time=0.0, p_WB=motion(0.0)[0] + error), *body()])
    state.x[1] = motion(0.0)[1]  # the first measurements take the vehicle as resting; here it may not be
    believed, true, velocity = [], [], []
    delay, every = round(late / STEP), round(0.1 / STEP)
    for tick in range(1, round(seconds / STEP)):
        time = tick * STEP
        measurements: list[Measurement] = [imu(time)]
        if tick % every == 0:
            measurements.append(log(time))
        if vision and tick > delay and (tick - delay) % every == 0:
            measurements.append(seen(time - late))
        state, estimate = filter_.step(state, measurements)
        believed.append(estimate.X_WB[:3, 3])
        velocity.append(estimate.X_WB[:3, :3] @ estimate.v_WB_B)
        true.append(motion(time)[0])
    return np.array(believed), np.array(velocity), np.array(true), state


def test_accelerometer_bias_is_found():
    *_, state = run(resting, 60.0, bias_W=BIAS_W)
    assert state.x[2] == pytest.approx(BIAS_W, abs=6e-4)  # measured 2e-4


def test_late_vision_gives_no_lag_at_constant_velocity(within):
    """Taken for the present, pictures 0.1 s late would put the vehicle 23 mm behind. Without noise nothing is left."""
    believed, velocity, true, _ = run(cruising, 20.0, noise=0.0)
    within("place [m]", believed - true, 1e-12)  # measured 8e-14
    within("velocity [m/s]", velocity - cruising(0.0)[1], 3e-13)  # measured 2e-14


def test_lateness_does_not_spoil_the_correction_of_a_wrong_start(within):
    """1 cm wrong at the start; two pictures are always on their way, yet the same error is not corrected twice."""
    wrong = np.array([0.01, -0.01, 0.01])
    believed, _, true, _ = run(resting, 60.0, noise=0.0, start_error=wrong)
    error = (believed - true) @ wrong / (wrong @ wrong)
    assert error[0] == pytest.approx(1.0, abs=1e-6)
    assert error.min() > -0.1  # no overshoot worth the name
    within("share left after a minute", error[-1], 3e-5)  # measured 3e-6


def test_hovering_is_known_to_a_millimetre(within):
    believed, velocity, true, _ = run(swaying, 90.0, bias_W=BIAS_W)
    late = slice(round(45.0 / STEP), None)
    error = np.linalg.norm((believed - true)[late], axis=1)
    within("place, RMS [m]", np.sqrt(np.mean(error**2)), 2e-3)  # measured 1.1e-3
    speed = np.array([swaying((i + 1) * STEP)[1] for i in range(len(velocity))])
    within(
        "velocity, RMS [m/s]", np.sqrt(np.mean(np.sum((velocity - speed)[late] ** 2, axis=1))), 8e-4
    )  # measured 4e-4


def test_output_is_smooth(within):
    """On a pad of 3e4 N/m a jump of 0.03 mm is 1 N; a raw picture would jump by 2 mm."""
    believed, _, true, _ = run(swaying, 90.0, bias_W=BIAS_W)
    jumps = np.diff(believed - true, axis=0)[round(30.0 / STEP) :]
    within("largest step beside the motion [m]", jumps, 2e-5)  # measured 5e-6


def test_the_output_loses_nothing_of_the_corrections(within):
    """What is held back is handed on: filter and output agree once the pictures stop."""
    *_, state = run(resting, 30.0)
    filter_, start = Navigation(), state.time
    assert np.abs(state.held[0]).max() > 1e-5
    state, estimate = filter_.step(state, [])
    for tick in range(1, 2500):
        still = ImuMeasurement(
            time=start + tick * STEP, specific_force_B=R_WB.T @ (UP + state.x[2]), w_WB_B=np.zeros(3), R_WB=R_WB
        )
        state, estimate = filter_.step(state, [still])
    within("output against filter [m]", estimate.X_WB[:3, 3] - state.x[0], 1e-8)  # measured 6e-10


def test_vision_older_than_the_history_is_of_no_use():
    with_old, *_ = run(resting, 5.0, noise=0.0, late=1.0, start_error=np.array([0.01, 0.0, 0.0]))
    without, *_ = run(resting, 5.0, noise=0.0, vision=False, start_error=np.array([0.01, 0.0, 0.0]))
    assert np.array_equal(with_old, without)


def test_attitude_follows_the_gyro_and_leans_to_the_reference():
    """Turning at 0.2 rad/s about a slant axis, the reference 1 mrad off at the start only."""
    w, filter_ = np.array([0.1, -0.1, 0.15]), Navigation()

    def imu(tick: int, error: float) -> ImuMeasurement:
        R = R_WB @ exp_so3(w * tick * STEP) @ exp_so3([error, 0.0, 0.0])
        return ImuMeasurement(time=tick * STEP, specific_force_B=R.T @ UP, w_WB_B=w, R_WB=R)

    still = VisionMeasurement(time=0.0, p_WB=np.zeros(3))
    state = filter_.init([imu(0, 1e-3), still, *body()])
    errors = []
    for tick in range(1, 2501):
        state, estimate = filter_.step(state, [imu(tick, 0.0)])
        errors.append(rotation_angle(estimate.X_WB[:3, :3], R_WB @ exp_so3(w * tick * STEP)))
    assert errors[0] == pytest.approx(1e-3, rel=0.01)
    assert errors[499] == pytest.approx(1e-3 * np.exp(-1.0), rel=0.02)  # time constant 1 s
    assert errors[-1] < 1e-5


def test_joints_are_handed_through():
    state = Navigation().init([ImuMeasurement(time=0.0, specific_force_B=UP, w_WB_B=np.zeros(3), R_WB=np.eye(3)),
                               VisionMeasurement(time=0.0, p_WB=np.zeros(3)), *body()])  # fmt: skip
    _, estimate = Navigation().step(state, [EncoderMeasurement(time=0.0, q=np.zeros(6), qd=np.full(6, 3.0))])
    assert not estimate.q.any()
    assert np.all(estimate.qd == 3.0)
    assert np.all(estimate.tau == 2.0)


@pytest.mark.parametrize("missing", [ImuMeasurement, VisionMeasurement, EncoderMeasurement, TorqueMeasurement])
def test_first_measurement_that_is_missing_is_named(missing):
    first: list[Measurement] = [
        ImuMeasurement(time=0.0, specific_force_B=UP, w_WB_B=np.zeros(3), R_WB=np.eye(3)),
        VisionMeasurement(time=0.0, p_WB=np.zeros(3)),
        *body(),
    ]
    with pytest.raises(ConfigurationError, match=missing.__name__):
        Navigation().init([m for m in first if not isinstance(m, missing)])
