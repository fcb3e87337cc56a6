"""Sensors and filter by their stage functions, as a compiled tick calls them, against the loop of
objects.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from untyped import untyped
from uuv.perception.navigation.filter_kernel import put_out, take_sample
from uuv.perception.navigation.strapdown_filter import Navigation, NavigationState
from uuv.sim.interfaces.messages import DvlMeasurement, StateEstimate, VisionMeasurement
from uuv.sim.interfaces.records import EstimateRecord, estimate_record, state_estimate
from uuv.sim.interfaces.spatial import Array, exp_so3
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors import proprioception
from uuv.sim.sensors.proprioception import encode, sense_motion, transmit

STEP, TICKS, FIXES = 0.002, 400, 25  # [s], number of ticks, ticks between fixes
SENSORS = (
    proprioception.Encoders(bias=1e-3, rate_resolution=1e-4),
    proprioception.JointTorqueSensors(resolution=0.1),
    proprioception.Imu(rate_bias=1e-3, acceleration_resolution=1e-4),
)


class Motion:
    """A hull and an arm that move at random, smoothly enough; rows are ticks."""

    def __init__(self, rng: np.random.Generator) -> None:
        way = 0.05 * np.cumsum(rng.normal(size=(TICKS, 3)), axis=0) * STEP
        self.R_WB = np.array([exp_so3(w) for w in way])
        self.w_B, self.a_W = 0.05 * rng.normal(size=(TICKS, 3)), 0.1 * rng.normal(size=(TICKS, 3))
        self.joints = rng.normal(size=(5, TICKS, 6))  # q, qd, qdd, drive torque, friction
        self.fixes = 1e-3 * rng.normal(size=(TICKS, 3))

    def truth(self, tick: int) -> Truth:
        truth = Truth()
        truth.time = tick * STEP
        truth.R_WB = self.R_WB[tick]
        truth.w_WB_B, truth.acceleration = self.w_B[tick], self.a_W[tick]
        truth.q, truth.qd, truth.qdd, truth.tau_drive, truth.tau_friction = self.joints[:, tick]
        truth.vehicle = untyped(SimpleNamespace(armature=np.full(6, 0.5)))
        truth.joint_damping = np.full(6, 3.0)
        return truth

    def arrived(self, tick: int) -> list[Any]:
        """Fixes; vision is 20 ticks late."""
        if tick % FIXES:
            return []
        dvl = DvlMeasurement(time=tick * STEP, v_WB_B=self.fixes[tick])
        return (
            [dvl, VisionMeasurement(time=(tick - 20) * STEP, p_WB=self.fixes[tick - 20])]
            if tick
            else [dvl]
        )


class Ship:
    """Sensors and filter of one run."""

    def __init__(self, motion: Motion, seed: int) -> None:
        streams = np.random.default_rng(seed).spawn(len(SENSORS))
        self.motion = motion
        self.navigation = Navigation()
        self.sensors = [s.init(stream) for s, stream in zip(SENSORS, streams, strict=True)]
        vision = VisionMeasurement(time=0.0, p_WB=np.zeros(3))
        self.state: NavigationState = self.navigation.init(
            [*self.sensed(0), *motion.arrived(0), vision]
        )

    def sensed(self, tick: int) -> list[Any]:
        truth = self.motion.truth(tick)
        return [
            sensor.step(state, truth)[1]
            for sensor, state in zip(SENSORS, self.sensors, strict=True)
        ]

    def step(self, tick: int) -> StateEstimate:
        _, estimate = self.navigation.step(
            self.state, [*self.sensed(tick), *self.motion.arrived(tick)]
        )
        return estimate


def flat(e: StateEstimate) -> Array:
    ages = [e.vision_age, e.dvl_age, e.imu_age, e.imu_jump_age]
    parts = (e.X_WB.ravel(), e.v_WB_B, e.w_WB_B, e.a_WB_B, e.q, e.qd, e.tau, e.position_sigma, ages)
    return np.concatenate([[e.time], *parts])


def test_stages_give_what_the_loop_of_objects_gives(rng: np.random.Generator) -> None:
    """Bit by bit, the filter's whole memory included; at ticks with fixes both go by objects."""
    motion = Motion(rng)
    first, other = Ship(motion, 3), Ship(motion, 3)
    state = other.state
    sample, joints, estimate = state.sample, state.joints, state.estimate
    encoders, torque, imu = (sensor.record for sensor in other.sensors)
    armature, damping = np.full(6, 0.5), np.full(6, 3.0)
    for tick in range(TICKS):
        expected = flat(first.step(tick))
        if tick % FIXES == 0:
            np.testing.assert_array_equal(flat(other.step(tick)), expected)
            assert all(sensor.ready() >= FIXES for sensor in other.sensors)
            continue
        q, qd, qdd, drive, friction = motion.joints[:, tick]
        encode(encoders, q, qd, joints.q, joints.qd)
        transmit(torque, drive, friction, armature, qdd, damping, qd, joints.tau)
        moved = motion.R_WB[tick], motion.a_W[tick], motion.w_B[tick]
        sense_motion(imu, *moved, sample.specific_force_B, sample.w_WB_B, sample.R_WB)
        sample.time[0] = tick * STEP
        take_sample(state.memory, tuple(sample))
        put_out(state.memory, tuple(joints), tuple(estimate))
        np.testing.assert_array_equal(flat(state_estimate(estimate)), expected)
    assert state.memory.tobytes() == first.state.memory.tobytes()
    for watch, twin in zip(state.fixes.watches, first.state.fixes.watches, strict=True):
        assert (watch.refused, watch.scale) == (twin.refused, twin.scale)


@pytest.mark.parametrize(
    ("sensor", "count"),
    list(zip(SENSORS, (6, 6, 9), strict=True)),
    ids=["encoders", "torque", "imu"],
)
def test_noise_is_the_stream_in_blocks_that_are_refilled_in_place(sensor: Any, count: int) -> None:
    """A block whose rest is too short for a sample is discarded; `ready` counts the samples before
    that.
    """
    motion = Motion(np.random.default_rng(1))
    truth = motion.truth(0)
    state = sensor.init(np.random.default_rng(5))
    twin = np.random.default_rng(5)
    sensor.init(twin)  # draws the biases
    drawn = state.record["drawn"][0]
    assert state.ready() == 0
    for _ in range(3):
        block = twin.standard_normal(len(drawn))
        for left in reversed(range(len(drawn) // count)):
            sensor.step(state, truth)
            assert state.ready() == left
        np.testing.assert_array_equal(drawn, block)
        assert np.shares_memory(drawn, state.record)


def test_encoder_noise_comes_from_the_stream_in_order() -> None:
    sensor = proprioception.Encoders(rate_noise=1.0)
    state = sensor.init(np.random.default_rng(2))
    truth = Motion(np.random.default_rng(1)).truth(0)
    twin = np.random.default_rng(2)
    sensor.init(twin)
    count = 8192 // 6
    rates = np.array([sensor.step(state, truth)[1].qd for _ in range(2 * count)])
    blocks = [twin.standard_normal(8192)[: 6 * count].reshape(count, 6) for _ in range(2)]
    np.testing.assert_array_equal(rates, truth.qd + np.concatenate(blocks))


def test_a_message_has_copies_of_the_record() -> None:
    record = estimate_record(4)
    for k, array in enumerate(record):
        array[:] = k + 1.0 + np.arange(array.size).reshape(array.shape)
    expected = EstimateRecord(*(array.copy() for array in record))
    message = state_estimate(record)
    for array in record:
        array[:] = 0.0
    for name in ("X_WB", "v_WB_B", "w_WB_B", "a_WB_B", "q", "qd", "tau", "position_sigma"):
        np.testing.assert_array_equal(getattr(message, name), getattr(expected, name))
    ages = [message.vision_age, message.dvl_age, message.imu_age, message.imu_jump_age]
    assert [message.time, *ages] == [*expected.time, *expected.ages]
