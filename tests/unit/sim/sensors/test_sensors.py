"""Every sensor's noise, bias and quantisation against the figures stated beside it."""

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from untyped import untyped
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import GRAVITY, exp_so3, log_so3
from uuv.sim.loop.rollout import Parts, rollout
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors import proprioception

SAMPLES = 20_000  # one sigma of a standard deviation is 0.5 %, less where axes are taken together
R_WB = exp_so3([0.2, -0.1, 0.7])
ALL: list[Any] = [
    proprioception.Encoders(),
    proprioception.JointTorqueSensors(),
    proprioception.Imu(),
    proprioception.Dvl(),
    proprioception.PressureDepth(),
    proprioception.VisionDrift(),
]


def truth() -> Truth:
    state = Truth()
    state.time = 3.5
    state.R_WB = R_WB
    state.p_WB = np.array([1.0, -2.0, -3.0])
    state.v_WB_W, state.w_WB_B = np.array([0.2, -0.1, 0.3]), np.array([0.05, -0.02, 0.01])
    state.acceleration = np.array([0.3, 0.2, -0.1, 0.0, 0.0, 0.0])
    state.q = np.array([0.1, -1.2, 2.0, 0.3, 0.0, 3.0])
    state.qd = np.array([0.0, 0.1, -0.2, 0.0, 0.3, 0.0])
    state.qdd = np.array([1.0, 0.0, -2.0, 0.0, 0.0, 0.5])
    state.tau_drive = np.array([50.0, 104.0, -34.0, 10.0, 2.0, -1.0])
    state.tau_friction = np.array([0.0, -4.0, 4.0, 0.0, -2.0, 0.0])
    state.vehicle = untyped(SimpleNamespace(armature=np.full(6, 0.5)))
    state.joint_damping = np.full(6, 3.0)
    return state


# drive and dry friction, less 0.5 qdd less 3 qd
TAU_GEAR = np.array([49.5, 99.7, -28.4, 10.0, -0.9, -1.25])


def sample(sensor: Sensor, field: str, seed: int = 1, count: int = SAMPLES) -> np.ndarray:
    state = sensor.init(np.random.default_rng(seed))
    rows = []
    state_of_truth = truth()
    for _ in range(count):
        state, measurement = sensor.step(state, state_of_truth)
        assert measurement is not None
        assert measurement.time == 3.5
        rows.append(getattr(measurement, field))
    return np.array(rows)


def biases(sensor: Sensor, field: str) -> np.ndarray:
    """What one sample shows in each of 2000 runs."""
    return np.concatenate([sample(sensor, field, seed, 1) for seed in range(2000)])


def test_encoders():
    sensor = proprioception.Encoders(resolution=1e-3)
    q = sample(sensor, "q", count=10)
    qd = sample(sensor, "qd")
    assert q == pytest.approx(np.tile(np.round(truth().q, 3), (10, 1)), abs=1e-15)
    assert (
        np.abs(sample(proprioception.Encoders(), "q", count=1)[0] - truth().q).max()
        <= np.pi / 2**19
    )
    assert (qd - truth().qd).std(axis=0) == pytest.approx(2e-4, rel=0.03)
    assert qd.mean(axis=0) == pytest.approx(truth().qd, abs=1e-5)


def test_torque_noise_is_a_share_of_the_reading_at_the_gear():
    tau = sample(proprioception.JointTorqueSensors(bias=0.0), "tau")
    assert tau.std(axis=0) == pytest.approx(0.01 * np.abs(TAU_GEAR), rel=0.03)
    assert tau.mean(axis=0) == pytest.approx(TAU_GEAR, abs=0.01)


def test_torque_bias_is_even_within_its_bound_and_constant_over_a_run():
    bias = biases(proprioception.JointTorqueSensors(noise=0.0), "tau") - TAU_GEAR
    assert np.abs(bias).max() <= 0.5
    assert bias.std() == pytest.approx(0.5 / np.sqrt(3.0), rel=0.03)
    assert bias.mean() == pytest.approx(0.0, abs=0.01)
    assert not np.ptp(
        sample(proprioception.JointTorqueSensors(noise=0.0), "tau", count=100), axis=0
    ).any()


def test_inertial_unit():
    quiet = {"acceleration_bias": 0.0, "attitude_bias": 0.0}
    force, w = (
        sample(proprioception.Imu(**quiet), name) for name in ("specific_force_B", "w_WB_B")
    )
    expected = R_WB.T @ [0.3, 0.2, -0.1 + GRAVITY]
    assert force.mean(axis=0) == pytest.approx(expected, abs=1e-4)
    assert force.std(axis=0) == pytest.approx(2e-3, rel=0.03)
    assert w.mean(axis=0) == pytest.approx(truth().w_WB_B, abs=1e-5)
    assert w.std(axis=0) == pytest.approx(2e-4, rel=0.03)
    turned = sample(proprioception.Imu(**quiet), "R_WB", count=5000)
    phi = np.array([log_so3(R_WB.T @ R) for R in turned])
    assert phi.std(axis=0) == pytest.approx(5e-5, rel=0.06)
    assert np.abs(turned @ turned.transpose(0, 2, 1) - np.eye(3)).max() < 1e-9


def test_inertial_biases():
    silent = proprioception.Imu(acceleration_noise=0.0, rate_noise=0.0, attitude_noise=0.0)
    force = biases(silent, "specific_force_B") - R_WB.T @ [0.3, 0.2, -0.1 + GRAVITY]
    phi = np.array([log_so3(R_WB.T @ R) for R in biases(silent, "R_WB")])
    assert force.std(axis=0) == pytest.approx(0.005, rel=0.08)  # 2000 runs: 1.6 % is one sigma
    assert phi.std(axis=0) == pytest.approx(3e-4, rel=0.08)


def test_doppler_log_measures_in_hull_axes():
    v = sample(proprioception.Dvl(), "v_WB_B")
    assert v.mean(axis=0) == pytest.approx(R_WB.T @ truth().v_WB_W, abs=1e-4)
    assert v.std(axis=0) == pytest.approx(3e-3, rel=0.03)


def test_vision():
    p = sample(proprioception.VisionDrift(), "p_WB")
    assert p.mean(axis=0) == pytest.approx(truth().p_WB, abs=1e-4)
    assert p.std(axis=0) == pytest.approx(2e-3, rel=0.03)
    assert (proprioception.VisionDrift().period, proprioception.VisionDrift().delay) == (0.1, 0.1)


def test_wandering_vision_is_a_gauss_markov_process():
    """Its spread over runs, and over one run how long it remembers: exp(-t / T), the noise
    aside.
    """
    sensor = proprioception.VisionDrift(noise=0.0, bias=0.05, bias_time=0.5)
    spread = biases(sensor, "p_WB") - truth().p_WB
    assert spread.std(axis=0) == pytest.approx(0.05, rel=0.08)
    error = sample(sensor, "p_WB", count=15_000) - truth().p_WB  # 3000 times its memory
    assert error.std(axis=0) == pytest.approx(0.05, rel=0.08)
    for lag in (1, 3, 5):
        correlation = np.mean(error[lag:] * error[:-lag], axis=0) / error.var(axis=0)
        assert correlation == pytest.approx(np.exp(-lag * 0.1 / 0.5), abs=0.06)
    still, wandering = (
        sample(proprioception.VisionDrift(bias=b), "p_WB", count=50) for b in (0.0, 0.05)
    )
    assert np.array_equal(still, sample(proprioception.VisionDrift(), "p_WB", count=50))
    # the same noise, and a slow drift
    assert np.abs(np.diff(wandering - still, axis=0)).max() < 0.05


def test_pressure_is_that_of_the_water_above_the_gauge():
    quiet = proprioception.PressureDepth(noise=0.0, bias=0.0, resolution=0.0, p_BS=(0.5, -0.2, 0.3))
    depth = 3.0 - R_WB[2] @ [0.5, -0.2, 0.3]
    assert sample(quiet, "depth", count=3) == pytest.approx(depth, abs=1e-10)
    assert sample(quiet, "pressure", count=3) == pytest.approx(
        101325.0 + 1025.0 * GRAVITY * depth, abs=1e-8
    )
    # In fresh water under low weather a gauge set for the sea reads shallow by both.
    wrong = replace(quiet, water_density=1000.0, surface=99325.0)
    shallow = (1000.0 * GRAVITY * depth - 2000.0) / (1025.0 * GRAVITY)
    assert sample(wrong, "depth", count=3) == pytest.approx(shallow, abs=1e-10)
    risen = truth()
    risen.p_WB = np.array([0.0, 0.0, 4.0])
    assert quiet.step(quiet.init(np.random.default_rng(1)), risen)[1].pressure == 101325.0


def test_pressure_noise_bias_and_steps():
    pressure = sample(proprioception.PressureDepth(bias=0.0, resolution=0.0), "pressure")
    true = 101325.0 + 1025.0 * GRAVITY * 3.0
    assert pressure.std() == pytest.approx(20.0, rel=0.03)
    assert pressure.mean() == pytest.approx(true, abs=1.0)
    spread = [
        sample(proprioception.PressureDepth(noise=0.0), "pressure", seed, 1)[0] - true
        for seed in range(2000)
    ]
    assert np.std(spread) == pytest.approx(100.0, rel=0.08)
    steps = sample(proprioception.PressureDepth(), "pressure", count=200) / 20.0
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert len(np.unique(steps)) > 3


@pytest.mark.parametrize(
    ("sensor", "field", "change", "expected"),
    [
        (proprioception.Encoders(), "q", "bias", 0.01),
        (proprioception.Imu(), "w_WB_B", "rate_bias", 0.01),
        (proprioception.Dvl(), "v_WB_B", "bias", 0.01),
    ],
)
def test_biases_that_are_off_by_default(sensor, field, change, expected):
    """Constant over a run, of the stated spread over runs; the noise stays what it was without
    them.
    """
    with_bias, without = (
        sample(s, field, 3, 200) for s in (replace(sensor, **{change: expected}), sensor)
    )
    shift = with_bias - without
    assert np.ptp(shift, axis=0).max() < 2e-5  # the encoders' steps: 1.2e-5 rad
    assert np.abs(shift).max() > 1e-4
    biased = replace(sensor, **{change: expected})
    spread = np.array([sample(biased, field, seed, 1)[0] - without[0] for seed in range(1000)])
    assert spread.std(axis=0).mean() == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize(
    ("sensor", "field", "change"),
    [
        (proprioception.Encoders(), "qd", "rate_resolution"),
        (proprioception.JointTorqueSensors(), "tau", "resolution"),
        (proprioception.Imu(), "specific_force_B", "acceleration_resolution"),
        (proprioception.Imu(), "w_WB_B", "rate_resolution"),
        (proprioception.Dvl(), "v_WB_B", "resolution"),
        (proprioception.VisionDrift(), "p_WB", "resolution"),
    ],
)
def test_quantisation(sensor, field, change):
    """Whole steps, and none farther than half a step from what would be there without."""
    fine, coarse = (
        sample(s, field, count=100) for s in (sensor, replace(sensor, **{change: 0.07}))
    )
    assert coarse / 0.07 == pytest.approx(np.round(coarse / 0.07), abs=1e-9)
    assert np.abs(coarse - fine).max() <= 0.035 * (1.0 + 1e-9)
    assert np.abs(coarse - fine).max() > 1e-3


@pytest.mark.parametrize("sensor", ALL)
def test_figures_that_cannot_be(sensor):
    for field in fields(sensor):
        if field.type is not float:
            continue
        for figure in (-1e-3, np.nan, np.inf):
            with pytest.raises(
                ConfigurationError,
                match=rf"{type(sensor).__name__} {field.name}: "
                r".*got",
            ):
                replace(sensor, **{field.name: figure})
    with pytest.raises(ConfigurationError, match="period: must be finite and > 0"):
        replace(sensor, period=0.0)


@pytest.mark.parametrize("sensor", ALL)
@pytest.mark.parametrize("change", [{"period": 0.003}, {"delay": 0.001}])
def test_rates_and_delays_are_whole_steps(sensor, change):
    none: Any = None
    parts = Parts(
        sensors=[replace(sensor, **change)],
        estimator=none,
        finder=None,
        planner=none,
        controller=none,
    )
    plant: Any = SimpleNamespace(timestep=0.002)
    with pytest.raises(
        ConfigurationError,
        match=f"{type(sensor).__name__}.* whole multiple of the physics step 0.002",
    ):
        rollout(plant, parts, duration=1.0, rng=np.random.default_rng(1))


class Clock:
    """A plant that stands still, and an estimator that writes down what arrived when."""

    timestep = period = 0.002  # [s]

    def __init__(self) -> None:
        self.tick = 0
        self.truth = truth()
        self.arrived = []

    def observe(self) -> Truth:
        self.truth.time = self.tick * self.timestep
        return self.truth

    def init(self, first: Any) -> None:
        pass

    def step(self, *given: Any) -> Any:
        if len(given) == 1:  # a command, as the plant gets it
            self.tick += 1
            return None
        self.arrived += [(type(m).__name__, self.tick * self.timestep, m.time) for m in given[1]]
        zero = np.zeros(3)
        return None, StateEstimate(
            time=self.tick * self.timestep,
            X_WB=np.eye(4),
            v_WB_B=zero,
            w_WB_B=zero,
            a_WB_B=zero,
            q=zero,
            qd=zero,
            tau=zero,
        )


def test_measurements_come_at_their_rates_and_only_vision_comes_late():
    """By 0.1 s: what the fusion, the health checks and the force loop are tuned for.

    Counted over the loop's second.
    """
    clock: Any = Clock()
    still = Reference(
        time=0.0,
        state=WorkState.WORK,
        X_WB=np.eye(4),
        v_WB_W=np.zeros(3),
        X_WG=None,
        v_WG_W=np.zeros(3),
        w_WG_W=np.zeros(3),
        q=np.zeros(6),
        qd=np.zeros(6),
        set_force=0.0,
        force_control=False,
        tare=False,
        scan=False,
        path_s=0.0,
    )
    planner: Any = SimpleNamespace(period=0.002, init=lambda _: None, step=lambda *_: (None, still))
    command = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)
    controller: Any = SimpleNamespace(
        period=0.002, init=lambda _: None, step=lambda *_: (None, command)
    )
    parts = Parts(sensors=ALL, estimator=clock, finder=None, planner=planner, controller=controller)
    rollout(clock, parts, duration=1.0, rng=np.random.default_rng(1))
    late, rate = {}, {}
    for name, arrival, taken in clock.arrived:
        late.setdefault(name, set()).add(round(arrival - taken, 9))
        rate[name] = rate.get(name, 0) + 1
    # the first of all begins the run
    assert late == {name: {0.0} for name in rate} | {"VisionMeasurement": {0.0, 0.1}}
    often = {"EncoderMeasurement", "TorqueMeasurement", "ImuMeasurement"}
    assert {name for name, count in rate.items() if count > 499} == often
    assert [rate[f"{name}Measurement"] for name in ("Dvl", "Pressure", "Vision")] == pytest.approx(
        [10, 20, 10], abs=1
    )


FIELDS = ("qd", "tau", "specific_force_B", "v_WB_B", "pressure", "p_WB")


@pytest.mark.parametrize(("sensor", "field"), list(zip(ALL, FIELDS, strict=True)))
def test_noise_is_white_and_of_its_seed(sensor, field):
    first, same, other = (sample(sensor, field, seed) for seed in (7, 7, 8))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)
    noise = (first - first.mean(axis=0)).reshape(SAMPLES, -1)
    if isinstance(sensor, proprioception.PressureDepth):
        # its steps are as great as its noise
        noise = noise + np.random.default_rng(9).uniform(-10.0, 10.0, noise.shape)
    for lag in (1, 2, 3, 5):
        correlation = np.mean(noise[lag:] * noise[:-lag], axis=0) / noise.var(axis=0)
        assert np.abs(correlation).max() < 5.0 / np.sqrt(SAMPLES)
    assert np.abs(
        np.corrcoef(noise.T).reshape(noise.shape[1], -1) - np.eye(noise.shape[1])
    ).max() < 5.0 / np.sqrt(SAMPLES)


@pytest.mark.parametrize("sensor", ALL)
def test_measurements_keep_nothing_of_the_truth(sensor):
    """The truth is a set of live views: what a sensor has handed on must not move with them."""
    state_of_truth = truth()
    _, measurement = sensor.step(sensor.init(np.random.default_rng(1)), state_of_truth)
    for name in type(measurement).__slots__:
        field_value = getattr(measurement, name)
        if isinstance(field_value, np.ndarray):
            for view in Truth.__slots__:
                held = getattr(state_of_truth, view, None)
                assert not (isinstance(held, np.ndarray) and np.shares_memory(field_value, held))
