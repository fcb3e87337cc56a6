"""Friction of the gears from recorded motion: exact where nothing is wrong, as sure as it says
where there is noise.
"""

import numpy as np
import pytest

from uuv import models
from uuv.controllers.estimation.friction_identification import (
    FrictionMotion,
    identify_friction,
    over_steps,
)
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.models.vehicle import Vehicle
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.rollout import Moment, Parts, rollout
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors import proprioception
from uuv.sim.water.current import Current

TRUE = np.array([0.2, 8.0, 5.0, 6.5, 0.04])  # bias, viscous, coulomb, stiction, Stribeck's speed
ARMATURE = np.array([0.5])


def motion(rng: np.random.Generator, noise: float) -> tuple[Array, Array, Array, Array]:
    """Speeds, accelerations, motor and gear torques (N, 1) of one joint that swings slowly, then
    fast.
    """
    t = np.arange(0.0, 20.0, 0.004)[:, None]
    qd = np.where(t < 14.0, 0.1 * np.sin(0.9 * t), 0.4 * np.sin(2.0 * t))
    qdd = np.gradient(qd, 0.004, axis=0)
    b, viscous, coulomb, stiction, over = TRUE
    lost = (
        b
        + viscous * qd
        + np.sign(qd) * (coulomb + (stiction - coulomb) * np.exp(-((qd / over) ** 2)))
    )
    gear = 30.0 * np.sin(0.5 * t)
    return qd, qdd, gear + ARMATURE * qdd + lost + noise * rng.standard_normal(qd.shape), gear


def numbers(result) -> Array:
    dry = result.dry
    return np.array(
        [result.bias[0], result.viscous[0], dry.coulomb[0], dry.stiction[0], dry.stribeck_speed[0]]
    )


def test_without_noise_it_is_found(within):
    friction = identify_friction(*motion(np.random.default_rng(1), 0.0), ARMATURE)
    # measured 7e-4: how fine the speed is searched
    within("share", numbers(friction) / TRUE - 1.0, 1e-2)
    assert friction.residual[0] < 1e-3


def test_it_is_as_sure_as_it_says():
    """Normalised squared error of 30 repeats, 5 each: its mean is 5 with a deviation of 0.58."""
    squared = []
    for seed in range(30):
        friction = identify_friction(*motion(np.random.default_rng([2, seed]), 0.5), ARMATURE)
        error = numbers(friction) - TRUE
        squared.append(float(error @ np.linalg.solve(friction.covariance[0], error)))
    assert 2.4 < np.mean(squared) < 7.6  # 4.5 deviations


def test_a_gear_without_stiction_is_told_so():
    """Viscous friction alone: where stiction comes out below Coulomb friction, both are one number
    near zero.
    """
    without = 0
    for seed in range(10):
        rng = np.random.default_rng([4, seed])
        qd = motion(rng, 0.0)[0]
        friction = identify_friction(
            qd, 0.0 * qd, 3.0 * qd + 0.01 * rng.standard_normal(qd.shape), 0.0 * qd, ARMATURE
        )
        assert abs(friction.viscous[0] - 3.0) < 5.0 * friction.sigma("viscous")[0]
        if np.isinf(friction.sigma("stribeck_speed")[0]):
            without += 1
            assert friction.dry.stiction[0] == friction.dry.coulomb[0]
            assert friction.dry.stiction[0] < 5.0 * friction.sigma("stiction")[0]
    assert without >= 2  # measured 7


def test_sigma_holds_where_noise_is_a_share_of_the_reading():
    """As a torque sensor's is, here under drag: squared errors over their variances, means of 40
    repeats.

    Their deviation is 0.22. With one variance for all samples they are 4.0 for viscous friction,
    0.02 for stiction.
    """
    squared = []
    for repeat in range(40):
        rng = np.random.default_rng([3, repeat])
        qd, qdd, motor, gear = motion(rng, 0.0)
        drag = 160.0 * np.abs(qd) * qd
        reading = drag * (1.0 + 0.1 * rng.standard_normal(drag.shape))
        friction = identify_friction(qd, qdd, motor - gear + drag, reading, ARMATURE)
        squared.append((numbers(friction) - TRUE) ** 2 / np.diag(friction.covariance[0]))
    means = np.mean(squared, axis=0)  # measured 0.9 to 1.1
    assert np.all((means > 0.3) & (means < 2.0)), means


class Record:
    """Speeds and torques of every step; a torque sensor tells of the step before."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, Array, Array, Array]] = []
        self._motor: Array | None = None

    def observe(self, moment: Moment) -> None:
        if self._motor is not None:
            estimate = moment.estimate
            self.rows.append((estimate.time, estimate.qd.copy(), estimate.tau.copy(), self._motor))
        self._motor = moment.command.joint_torque.copy()


def test_gears_of_the_hovering_vehicle_are_identified():
    """Against the plant's own numbers. Over 14 s of swings they are found within 0.1 % (Coulomb),
    0.4 % (viscous) and 0.7 % (stiction, which few samples show).
    """
    spec = models.load("uuv_puma")
    plant = Plant(hydrodynamics.compile(spec), current=Current([0.1, 0.0, 0.0]))
    model = spec.compile()
    vehicle = Vehicle.of(model)
    planner = FrictionMotion(vehicle, np.eye(4), slow=8.0, fast=3.0)
    record = Record()
    parts = Parts(
        sensors=[
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(),
        ],
        estimator=Navigation(),
        finder=None,
        planner=planner,
        controller=WorkController(model),
    )
    begin, end = planner.recorded
    rollout(plant, parts, duration=end, rng=np.random.default_rng(3), observers=[record])
    rows = [row for row in record.rows if row[0] > begin]
    qd, gear, motor = (np.array([row[i] for row in rows]) for i in (1, 2, 3))
    friction = identify_friction(
        *over_steps(qd, plant.timestep), motor[1:], gear[1:], vehicle.armature
    )
    true = vehicle.dry_friction
    print(
        "coulomb",
        friction.dry.coulomb / true.coulomb,
        "stiction",
        friction.dry.stiction / true.stiction,
    )
    print("viscous", friction.viscous / vehicle.joint_damping, "speed", friction.dry.stribeck_speed)
    assert friction.dry.coulomb == pytest.approx(true.coulomb, rel=0.01)
    assert friction.dry.stiction == pytest.approx(true.stiction, rel=0.05)
    assert friction.viscous == pytest.approx(vehicle.joint_damping, rel=0.04)


def test_speed_and_acceleration_belong_to_the_steps(within):
    """Of q = sin t: the mean over a step is at its middle, to second order."""
    t = np.arange(0.0, 5.0, 0.002)
    speed, acceleration = over_steps(np.cos(t)[:, None], 0.002)
    middle = 0.5 * (t[1:] + t[:-1])[:, None]
    within("speed", speed - np.cos(middle), 5e-6)  # measured 5e-7
    within("acceleration", acceleration + np.sin(middle), 2e-6)  # measured 2e-7


def test_a_joint_that_hardly_moves_is_named():
    qd = np.full((1000, 2), 0.1) * np.sign(np.sin(np.arange(1000.0)))[:, None]
    qd[:, 1] = 1e-4
    with pytest.raises(ConfigurationError, match="friction of joint 2: must have at least"):
        identify_friction(qd, 0.0 * qd, qd, qd, np.ones(2))


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (0, np.zeros(5), "friction qd"),
        (2, np.zeros((5, 3)), "friction tau_motor"),
        (4, np.ones(3), "friction armature"),
    ],
)
def test_arrays_that_do_not_fit(at, value, said):
    arguments = [np.zeros((5, 2)), np.zeros((5, 2)), np.zeros((5, 2)), np.zeros((5, 2)), np.ones(2)]
    arguments[at] = value
    with pytest.raises(ConfigurationError, match=said):
        identify_friction(*arguments)
