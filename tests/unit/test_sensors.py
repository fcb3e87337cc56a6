"""Every sensor's noise, bias and quantisation against the figures stated beside it."""

import numpy as np
import pytest

from sim import sensors
from sim.interfaces.protocols import Sensor
from sim.interfaces.spatial import GRAVITY, exp_so3, log_so3
from sim.plant import Truth

SAMPLES = 20_000  # one sigma of a standard deviation is 0.5 %, less where axes are taken together
R_WB = exp_so3([0.2, -0.1, 0.7])
ALL = [sensors.Encoders(), sensors.JointTorqueSensors(), sensors.Imu(), sensors.Dvl(), sensors.VisionDrift()]


def truth() -> Truth:
    state = Truth()
    state.time = 3.5
    state.R_WB, state.p_WB = R_WB, np.array([1.0, -2.0, -3.0])
    state.v_WB_W, state.w_WB_B = np.array([0.2, -0.1, 0.3]), np.array([0.05, -0.02, 0.01])
    state.acceleration = np.array([0.3, 0.2, -0.1, 0.0, 0.0, 0.0])
    state.q, state.qd = np.array([0.1, -1.2, 2.0, 0.3, 0.0, 3.0]), np.array([0.0, 0.1, -0.2, 0.0, 0.3, 0.0])
    state.qdd = np.array([1.0, 0.0, -2.0, 0.0, 0.0, 0.5])
    state.tau_drive = np.array([50.0, 100.0, -30.0, 10.0, 0.0, -1.0])
    state.armature, state.joint_damping = np.full(6, 0.5), np.full(6, 3.0)
    return state


TAU_GEAR = np.array([49.5, 99.7, -28.4, 10.0, -0.9, -1.25])  # drive less 0.5 qdd less 3 qd


def sample(sensor: Sensor, field: str, seed: int = 1, count: int = SAMPLES) -> np.ndarray:
    state, rows, state_of_truth = sensor.init(np.random.default_rng(seed)), [], truth()
    for _ in range(count):
        state, measurement = sensor.step(state, state_of_truth)
        assert measurement.time == 3.5
        rows.append(getattr(measurement, field))
    return np.array(rows)


def biases(sensor: Sensor, field: str) -> np.ndarray:
    """What one sample shows in each of 2000 runs."""
    return np.concatenate([sample(sensor, field, seed, 1) for seed in range(2000)])


def test_encoders():
    sensor = sensors.Encoders(resolution=1e-3)
    q, qd = sample(sensor, "q", count=10), sample(sensor, "qd")
    assert q == pytest.approx(np.tile(np.round(truth().q, 3), (10, 1)), abs=1e-15)
    assert np.abs(sample(sensors.Encoders(), "q", count=1)[0] - truth().q).max() <= np.pi / 2**19
    assert (qd - truth().qd).std(axis=0) == pytest.approx(2e-4, rel=0.03)
    assert qd.mean(axis=0) == pytest.approx(truth().qd, abs=1e-5)


def test_torque_noise_is_a_share_of_the_reading_at_the_gear():
    tau = sample(sensors.JointTorqueSensors(bias=0.0), "tau")
    assert tau.std(axis=0) == pytest.approx(0.01 * np.abs(TAU_GEAR), rel=0.03)
    assert tau.mean(axis=0) == pytest.approx(TAU_GEAR, abs=0.01)


def test_torque_bias_is_even_within_its_bound_and_constant_over_a_run():
    bias = biases(sensors.JointTorqueSensors(noise=0.0), "tau") - TAU_GEAR
    assert np.abs(bias).max() <= 0.3
    assert bias.std() == pytest.approx(0.3 / np.sqrt(3.0), rel=0.03)
    assert bias.mean() == pytest.approx(0.0, abs=0.01)
    assert not np.ptp(sample(sensors.JointTorqueSensors(noise=0.0), "tau", count=100), axis=0).any()


def test_inertial_unit():
    quiet = {"acceleration_bias": 0.0, "attitude_bias": 0.0}
    force, w = (sample(sensors.Imu(**quiet), name) for name in ("specific_force_B", "w_WB_B"))
    expected = R_WB.T @ [0.3, 0.2, -0.1 + GRAVITY]
    assert force.mean(axis=0) == pytest.approx(expected, abs=1e-4)
    assert force.std(axis=0) == pytest.approx(2e-3, rel=0.03)
    assert w.mean(axis=0) == pytest.approx(truth().w_WB_B, abs=1e-5)
    assert w.std(axis=0) == pytest.approx(2e-4, rel=0.03)
    turned = sample(sensors.Imu(**quiet), "R_WB", count=5000)
    phi = np.array([log_so3(R_WB.T @ R) for R in turned])
    assert phi.std(axis=0) == pytest.approx(5e-5, rel=0.06)
    assert np.abs(turned @ turned.transpose(0, 2, 1) - np.eye(3)).max() < 1e-9


def test_inertial_biases():
    silent = sensors.Imu(acceleration_noise=0.0, rate_noise=0.0, attitude_noise=0.0)
    force = biases(silent, "specific_force_B") - R_WB.T @ [0.3, 0.2, -0.1 + GRAVITY]
    phi = np.array([log_so3(R_WB.T @ R) for R in biases(silent, "R_WB")])
    assert force.std(axis=0) == pytest.approx(0.005, rel=0.08)  # 2000 runs: 1.6 % is one sigma
    assert phi.std(axis=0) == pytest.approx(3e-4, rel=0.08)


def test_doppler_log_measures_in_hull_axes():
    v = sample(sensors.Dvl(), "v_WB_B")
    assert v.mean(axis=0) == pytest.approx(R_WB.T @ truth().v_WB_W, abs=1e-4)
    assert v.std(axis=0) == pytest.approx(3e-3, rel=0.03)


def test_vision():
    p = sample(sensors.VisionDrift(), "p_WB")
    assert p.mean(axis=0) == pytest.approx(truth().p_WB, abs=1e-4)
    assert p.std(axis=0) == pytest.approx(2e-3, rel=0.03)
    assert (sensors.VisionDrift().period, sensors.VisionDrift().delay) == (0.1, 0.1)


FIELDS = ("qd", "tau", "specific_force_B", "v_WB_B", "p_WB")


@pytest.mark.parametrize(("sensor", "field"), list(zip(ALL, FIELDS, strict=True)))
def test_noise_is_white_and_of_its_seed(sensor, field):
    one, same, other = (sample(sensor, field, seed) for seed in (7, 7, 8))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
    noise = one - one.mean(axis=0)
    for lag in (1, 2, 3, 5):
        seen = np.mean(noise[lag:] * noise[:-lag], axis=0) / noise.var(axis=0)
        assert np.abs(seen).max() < 5.0 / np.sqrt(SAMPLES)
    assert np.abs(np.corrcoef(noise.T) - np.eye(noise.shape[1])).max() < 5.0 / np.sqrt(SAMPLES)


@pytest.mark.parametrize("sensor", ALL)
def test_measurements_keep_nothing_of_the_truth(sensor):
    """The truth is a set of live views: what a sensor has handed on must not move with them."""
    state_of_truth = truth()
    _, measurement = sensor.step(sensor.init(np.random.default_rng(1)), state_of_truth)
    for name in type(measurement).__slots__:
        value = getattr(measurement, name)
        if isinstance(value, np.ndarray):
            for view in Truth.__slots__:
                held = getattr(state_of_truth, view, None)
                assert not (isinstance(held, np.ndarray) and np.shares_memory(value, held))
