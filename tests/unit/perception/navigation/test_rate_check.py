"""Check of the gyro against the attitude of the same message: what is found, when, and what
navigation goes on with.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from untyped import untyped
from uuv.perception.navigation.rate_check import REPEATS
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.sim.interfaces.messages import (
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    StateEstimate,
    TorqueMeasurement,
    VisionMeasurement,
)
from uuv.sim.interfaces.spatial import Array, exp_so3
from uuv.sim.sensors.proprioception import Imu

STEP = 0.002  # [s]
ONSET = 1500  # tick of a fault
SOUND = Imu()
COARSE = Imu(
    rate_noise=1e-3, rate_resolution=1e-3, rate_bias=2e-3, attitude_noise=1e-3, attitude_bias=1e-2
)
PERFECT = Imu(
    acceleration_noise=0.0,
    acceleration_bias=0.0,
    rate_noise=0.0,
    attitude_noise=0.0,
    attitude_bias=0.0,
)
# from a message and the time since the onset [s]
Spoil = Callable[[ImuMeasurement, float], ImuMeasurement]


@dataclass(frozen=True, slots=True)
class Sway:
    """Estimates and truth of a hull that sways about all axes, as a gyro and an attitude tell of
    it.
    """

    estimates: list[StateEstimate]
    R_WB: list[Array]
    w_WB_B: list[Array]

    def found(self) -> int:
        """Ticks from the onset to the first finding; -1: none."""
        off = [bool(e.gyro_off_B.any() or e.attitude_off_B.any()) for e in self.estimates]
        return off.index(True) - ONSET if True in off else -1

    def attitude_error(self) -> Array:
        """Angles (N,) [rad] of the attitude estimated from the true one, from the onset on."""
        pairs = zip(self.estimates[ONSET:], self.R_WB[ONSET:], strict=True)
        cosine = [0.5 * (np.trace(R.T @ e.X_WB[:3, :3]) - 1.0) for e, R in pairs]
        return np.arccos(np.clip(cosine, -1.0, 1.0))

    def rate_error(self) -> Array:
        """Errors (N, 3) [rad/s] of the rate, from the onset on."""
        return np.array([e.w_WB_B for e in self.estimates[ONSET:]]) - np.array(self.w_WB_B[ONSET:])


def sway(
    spoil: Spoil,
    *,
    seed: int = 3,
    imu: Imu = SOUND,
    size: float = 0.002,
    ticks: int = ONSET + 250,
    shaken: tuple[float, int] = (0.0, 1),
) -> Sway:
    """A hull that sways by `size` [rad/s] at 0.2 Hz, with its messages spoilt from ONSET on.

    From then on it also shakes: amplitude [rad/s], number of ticks in a period.
    """
    rng = np.random.default_rng(seed)
    sensor = imu.init(rng)
    navigation = Navigation()
    R = exp_so3(rng.standard_normal(3))
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    state = None
    done = Sway([], [], [])
    for tick in range(-1, ticks):
        time = tick * STEP
        w = size * np.sin(2.0 * np.pi * 0.2 * time + phase)
        if tick >= ONSET:
            w += shaken[0] * np.cos(2.0 * np.pi * tick / shaken[1]) * np.array([1.0, -0.3, 0.5])
        R = R @ exp_so3(w * STEP)
        _, m = imu.step(
            sensor, untyped(SimpleNamespace(time=time, R_WB=R, acceleration=np.zeros(6), w_WB_B=w))
        )
        messages: list[Measurement] = [spoil(m, time - ONSET * STEP) if tick >= ONSET else m]
        messages += [EncoderMeasurement(time=time, q=np.zeros(1), qd=np.zeros(1))]
        messages += [TorqueMeasurement(time=time, tau=np.zeros(1))]
        if state is None:
            state = navigation.init([*messages, VisionMeasurement(time=time, p_WB=np.zeros(3))])
            continue
        state, estimate = navigation.step(state, messages)
        done.estimates.append(estimate)
        done.R_WB.append(R)
        done.w_WB_B.append(w)
    return done


def off(axis: int, jump: float = 0.0, rate: float = 0.0) -> Spoil:
    """A gyro whose bias jumps, or drifts."""
    return lambda m, t: replace(m, w_WB_B=m.w_WB_B + (jump + rate * t) * np.eye(3)[axis])


def turned(axis: int, jump: float = 0.0, rate: float = 0.0) -> Spoil:
    """An attitude that jumps, or drifts."""
    return lambda m, t: replace(m, R_WB=m.R_WB @ exp_so3((jump + rate * t) * np.eye(3)[axis]))


def frozen(name: str) -> Spoil:
    """A field that stays as it is."""
    frozen_field: list[Array] = []

    def spoil(m: ImuMeasurement, _: float) -> ImuMeasurement:
        frozen_field.append(getattr(m, name))
        return replace(m, **{name: frozen_field[0]})

    return spoil


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("size", [0.003, -0.03, 0.3])
def test_a_gyro_that_jumps_is_named_with_its_size_before_the_attitude_has_followed(
    axis: int, size: float
):
    """At 0.003 rad/s the filter used to follow to 0.75 mrad, and beyond 0.02 without end."""
    course = sway(off(axis, size), seed=axis)
    assert 0 < course.found() < 60  # 45 for the smallest, 2 for the largest
    gyro = course.estimates[-1].gyro_off_B
    assert np.flatnonzero(gyro).tolist() == [axis]
    assert 0.5 < gyro[axis] / size < 1.5  # measured 0.75 to 1.27
    error = course.attitude_error()
    assert (error - error[0]).max() < 3e-4  # [rad] measured 1e-4
    # [rad/s] from the attitude alone; measured 1.4e-3
    assert np.abs(course.rate_error()[100:]).max() < 6e-3


def test_without_its_gyro_a_turning_hull_is_followed_by_the_attitude():
    """The hull goes on to swing at 0.1 rad/s, far beyond what its rate was when the gyro was
    lost.
    """
    course = sway(off(0, 0.3), size=0.1, ticks=ONSET + 1500)
    assert course.found() > 0
    assert np.abs(course.rate_error()[200:, 0]).max() < 0.015  # [rad/s] measured 5e-3
    assert course.attitude_error()[200:].max() < 1e-3  # [rad] measured 3e-4


@pytest.mark.parametrize("size", [0.012, 0.03, 0.3])
def test_a_rate_that_jumps_never_reaches_the_estimate(size: float):
    """Beyond 0.01 rad/s in one sample it is not used before the check can tell; 0.03 used to raise
    the felt force.
    """
    assert np.abs(sway(off(1, size)).rate_error()).max() < 0.01  # [rad/s] measured 5.6e-3


def test_samples_of_a_rough_gyro_are_all_used():
    """At 5e-3 rad/s one in six samples differs from the last by more than 0.01 rad/s."""
    course = sway(lambda m, _: m, imu=replace(SOUND, rate_noise=5e-3, rate_resolution=0.0))
    rates = np.array([e.w_WB_B for e in course.estimates])
    equal = np.abs(np.diff(rates, axis=0)) < 1e-6  # [rad/s] as where only the gyro's bias has moved
    assert equal.mean() < 1e-3  # measured 2e-4, by chance


def test_a_gyro_that_jumps_in_a_rolling_hull_is_told_from_an_attitude_that_drifts():
    """The hull sways by four times the jump: what it turned since then says nothing, but no hull
    turns by a step.
    """
    for seed in range(3):
        gyro = sway(off(seed, 0.003), seed=seed, size=0.012, ticks=ONSET + 100).estimates[-1]
        assert gyro.gyro_off_B[seed]
        assert not gyro.attitude_off_B.any()
        attitude = sway(
            turned(seed, rate=0.003), seed=seed, size=0.012, ticks=ONSET + 100
        ).estimates[-1]
        assert attitude.attitude_off_B[seed]


def test_a_gyro_that_jumps_is_not_called_a_wrong_attitude_nor_the_reverse():
    """Where the change is far above the hull's own motion it is certain, and below it never
    wrong.
    """
    sure = {"gyro": 0, "attitude": 0}
    for seed in range(4):
        for size in (0.005, 0.03):
            gyro = sway(off(seed % 3, size), seed=seed, ticks=ONSET + 100).estimates[-1]
            attitude = sway(turned(seed % 3, rate=size), seed=seed, ticks=ONSET + 100).estimates[-1]
            assert gyro.gyro_off_B.any()
            assert attitude.attitude_off_B.any()
            sure["gyro"] += not gyro.attitude_off_B.any()
            sure["attitude"] += not attitude.gyro_off_B.any()
    assert sure["gyro"] >= 7  # of 8, measured 8
    assert sure["attitude"] >= 7  # measured 8


@pytest.mark.parametrize(
    "spoil", [turned(2, jump=0.01), turned(0, rate=0.03)], ids=["jump", "drift"]
)
def test_an_attitude_that_leaves_the_rate_is_left_and_the_gyro_goes_on(spoil: Spoil):
    course = sway(spoil)
    assert 0 <= course.found() < 15
    assert course.estimates[-1].attitude_off_B.any()
    assert not course.estimates[-1].gyro_off_B.any()
    error = course.attitude_error()
    assert (error - error[0]).max() < 3e-4  # [rad] where the attitude is 10 to 15 mrad off


def test_a_drift_that_comes_slowly_may_be_either():
    estimate = sway(off(1, rate=0.001), size=0.0, ticks=ONSET + 700).estimates[-1]
    assert estimate.gyro_off_B[1]
    assert estimate.attitude_off_B[1]


def test_what_repeats_bit_by_bit_is_the_one_that_froze():
    gyro, attitude = (
        sway(frozen(name), size=0.02, ticks=ONSET + 300).estimates[-1]
        for name in ("w_WB_B", "R_WB")
    )
    assert gyro.gyro_off_B.any()
    assert not gyro.attitude_off_B.any()
    assert attitude.attitude_off_B.any()
    assert not attitude.gyro_off_B.any()


def test_an_attitude_that_is_no_rotation_is_found_after_some_readings_in_a_row():
    course = sway(lambda m, _: replace(m, R_WB=m.R_WB + 0.02))
    assert course.found() == REPEATS - 1
    assert np.isnan(course.estimates[-1].attitude_off_B).all()
    assert course.attitude_error().max() < 2e-3


@pytest.mark.parametrize(
    "imu", [SOUND, COARSE, PERFECT, Imu(rate_bias=5e-3)], ids=["usual", "coarse", "perfect", "off"]
)
@pytest.mark.parametrize("size", [0.0, 0.1])
def test_sound_units_are_not_blamed(imu: Imu, size: float):
    """At rest, and in a sway of 0.1 rad/s; with the noise that each one states."""
    assert sway(lambda m, _: m, imu=imu, size=size).found() == -1


@pytest.mark.parametrize("shaken", [(0.007, 2), (0.05, 3), (0.2, 5)])
def test_a_light_hull_that_its_arm_shakes_is_followed_and_neither_is_blamed(
    shaken: tuple[float, int],
):
    """Rates that jump were left out for good: the attitude was off by 1, 6 and 75 mrad after a
    second, the gyro's bias followed, and sound references were called wrong after 11 s.
    """
    course = sway(lambda m, _: m, shaken=shaken, ticks=ONSET + 500)
    assert course.found() == -1
    error = course.attitude_error()
    # [rad] beyond the angle of one sample; measured 0
    assert np.median(abs(error - error[0])) < shaken[0] * STEP + 1e-4


def test_one_wild_attitude_is_no_fault():
    wild = sway(
        lambda m, t: (
            replace(m, R_WB=m.R_WB @ exp_so3(np.array([1.0, 0.0, 0.0]))) if t < 0.5 * STEP else m
        )
    )
    assert wild.found() == -1


def test_after_a_gap_both_are_compared_anew():
    """The hull is turned by 0.2 rad while the unit is silent."""
    away = exp_so3(np.array([0.0, 0.2, 0.0]))

    def spoil(m: ImuMeasurement, t: float) -> ImuMeasurement:
        return replace(m, R_WB=m.R_WB @ away) if t > 0.02 else replace(m, w_WB_B=m.w_WB_B * np.nan)

    assert sway(spoil).found() == -1
