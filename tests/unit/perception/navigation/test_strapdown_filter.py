"""The vehicle's own filter on synthetic sensors: what it finds, what lateness costs, how smooth it
is.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from navigation_bench import Course, Hull, Rig
from uuv.perception.navigation import filter_kernel as kernel
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    TorqueMeasurement,
    VisionMeasurement,
    VisionNoise,
)
from uuv.sim.interfaces.records import estimate_record, joint_record
from uuv.sim.interfaces.spatial import GRAVITY, Array, exp_so3, log_so3
from uuv.sim.sensors import proprioception

STEP, LATE = 0.002, 0.1  # [s]
UP = np.array([0.0, 0.0, GRAVITY])
R_WB = exp_so3([0.1, -0.2, 0.5])
FAINT = 1e-9  # of the noise: a sensor that repeats itself to the last bit passes for frozen
BIAS_W = np.array([0.004, -0.006, 0.005])  # [m/s^2]

# time [s] -> place, velocity, acceleration, world axes
Motion = Callable[[float], tuple[Array, Array, Array]]


def resting(_: float) -> tuple[Array, Array, Array]:
    return np.array([1.0, -2.0, -3.0]), np.zeros(3), np.zeros(3)


def cruising(time: float) -> tuple[Array, Array, Array]:
    v = np.array([0.2, -0.1, 0.05])
    return v * time, v, np.zeros(3)


def swaying(time: float) -> tuple[Array, Array, Array]:
    """A slow hover: 5 cm, 12 s."""
    w = 2.0 * np.pi / 12.0
    size = np.array([0.05, 0.03, 0.02])
    return size * np.sin(w * time), size * w * np.cos(w * time), -size * w**2 * np.sin(w * time)


def body() -> list[Measurement]:
    return [
        EncoderMeasurement(time=0.0, q=np.arange(6.0), qd=np.ones(6)),
        TorqueMeasurement(time=0.0, tau=np.full(6, 2.0)),
    ]


def run(
    motion: Motion,
    seconds: float,
    *,
    noise: float = 1.0,
    bias_W: Array | None = None,
    late: float = LATE,
    start_error: Array | None = None,
    vision: bool = True,
    seed: int = 1,
):
    """Places and velocities believed (N, 3) in W, the true places, and the last state.

    DVL and vision: 10 Hz.
    """
    rng = np.random.default_rng(seed)
    filter_ = Navigation()
    bias = np.zeros(3) if bias_W is None else bias_W

    def imu(time: float) -> ImuMeasurement:
        force = R_WB.T @ (motion(time)[2] + UP + bias) + noise * 2e-3 * rng.standard_normal(3)
        return ImuMeasurement(time=time, specific_force_B=force, w_WB_B=np.zeros(3), R_WB=R_WB)

    def seen(time: float) -> VisionMeasurement:
        return VisionMeasurement(
            time=time, p_WB=motion(time)[0] + noise * 2e-3 * rng.standard_normal(3)
        )

    def log(time: float) -> DvlMeasurement:
        return DvlMeasurement(
            time=time, v_WB_B=R_WB.T @ motion(time)[1] + noise * 3e-3 * rng.standard_normal(3)
        )

    error = np.zeros(3) if start_error is None else start_error
    state = filter_.init(
        [imu(0.0), VisionMeasurement(time=0.0, p_WB=motion(0.0)[0] + error), *body()]
    )
    # the first measurements take the vehicle as resting; here it may not be
    state.x[3:6] = motion(0.0)[1]
    believed, true, velocity = [], [], []
    delay = round(late / STEP)
    every = round(0.1 / STEP)
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
    assert R_WB @ state.x[6:9] == pytest.approx(BIAS_W, abs=6e-4)  # measured 2e-4


def test_late_vision_gives_no_lag_at_constant_velocity(within):
    """Taken for the present, pictures 0.1 s late would put the vehicle 23 mm behind."""
    believed, velocity, true, _ = run(cruising, 20.0, noise=FAINT)
    within("place [m]", believed - true, 2e-11)  # measured 2e-12
    within("velocity [m/s]", velocity - cruising(0.0)[1], 1e-10)  # measured 1e-11


def test_lateness_does_not_spoil_the_correction_of_a_wrong_start(within):
    """1 cm wrong at the start; two pictures are always on their way, yet the same error is not
    corrected twice.
    """
    wrong = np.array([0.01, -0.01, 0.01])
    believed, _, true, _ = run(resting, 60.0, noise=FAINT, start_error=wrong)
    error = (believed - true) @ wrong / (wrong @ wrong)
    assert error[0] == pytest.approx(1.0, abs=1e-6)
    assert error.min() > -0.1  # no overshoot worth the name
    # measured 9e-4: its part in the bias goes slowly
    within("share left after a minute", error[-1], 1e-2)


@pytest.fixture(scope="module")
def hovered():
    """What is believed and true in 90 s of a slow hover; see `run`."""
    return run(swaying, 90.0, bias_W=BIAS_W)


def test_hovering_is_known_to_a_millimetre(hovered, within):
    believed, velocity, true, _ = hovered
    late = slice(round(45.0 / STEP), None)
    error = np.linalg.norm((believed - true)[late], axis=1)
    within("place, RMS [m]", np.sqrt(np.mean(error**2)), 2e-3)  # measured 1.1e-3
    speed = np.array([swaying((i + 1) * STEP)[1] for i in range(len(velocity))])
    error = np.linalg.norm((velocity - speed)[late], axis=1)
    within("velocity, RMS [m/s]", np.sqrt(np.mean(error**2)), 4e-3)  # measured 1.1e-3


def test_output_is_smooth(hovered, within):
    """On a pad of 3e4 N/m a jump of 0.03 mm is 1 N; a raw picture would jump by 2 mm."""
    believed, _, true, _ = hovered
    jumps = np.diff(believed - true, axis=0)[round(30.0 / STEP) :]
    within("largest step beside the motion [m]", jumps, 4e-5)  # measured 4e-6


def test_place_and_velocity_handed_on_belong_together(hovered, within):
    """One is the derivative of the other, through every correction; and neither jumps."""
    believed, velocity, _, _ = hovered
    late = slice(round(10.0 / STEP), None)
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    error = (np.diff(believed, axis=0) / STEP - middle)[late]
    within("difference quotient of the place [m/s]", error, 1e-3)  # measured 1.4e-4
    within("step of the velocity [m/s]", np.diff(velocity, axis=0)[late], 6e-4)  # measured 6e-5


def test_the_output_loses_nothing_of_the_corrections(within):
    """What is held back is handed on: filter and output agree once the pictures stop."""
    *_, state = run(resting, 30.0)
    filter_ = Navigation()
    start = float(state.memory["time"][0])
    assert np.abs(state.memory["held"][0, 0]).max() > 1e-5
    state, estimate = filter_.step(state, [])
    rng = np.random.default_rng(2)
    for tick in range(1, 2500):
        force = R_WB.T @ UP + state.x[6:9] + 1e-9 * rng.standard_normal(3)
        still = ImuMeasurement(
            time=start + tick * STEP, specific_force_B=force, w_WB_B=np.zeros(3), R_WB=R_WB
        )
        state, estimate = filter_.step(state, [still])
    within("output against filter [m]", estimate.X_WB[:3, 3] - state.x[:3], 1e-8)  # measured 6e-10


def test_vision_older_than_the_history_is_of_no_use():
    with_old, *_ = run(resting, 4.0, noise=FAINT, late=1.5, start_error=np.array([0.01, 0.0, 0.0]))
    without, *_ = run(
        resting, 4.0, noise=FAINT, vision=False, start_error=np.array([0.01, 0.0, 0.0])
    )
    assert with_old == pytest.approx(without, abs=1e-9)


def test_attitude_is_as_good_as_gyro_and_reference_allow(within):
    """Angle random walk q [rad^2/s] and white reference r [rad^2 s]: the error has the variance
    sqrt(q r).
    """
    imu = proprioception.Imu(rate_bias=1e-3, attitude_bias=0.0)
    course = Rig(imu=imu).run(40.0, np.random.default_rng(4))
    settled = course.R_error[round(20.0 / STEP) :]
    theory = np.sqrt(imu.rate_noise * imu.attitude_noise * STEP)
    # measured 0.06
    within("RMS against theory, share", np.sqrt(np.mean(settled**2, axis=0)) / theory - 1.0, 0.3)
    true = np.array(
        [0.0, 0.0, 0.5 * 2.0 * np.pi / 30.0 * np.cos(2.0 * np.pi / 30.0 * course.time[-1])]
    )
    within("rates [rad/s], their bias removed", course.estimates[-1].w_WB_B - true, 1.2e-3)


# -- what sensors do to a filter -------------------------------------------------------------------


def late_error(course: Course, since: float = 20.0) -> float:
    """RMS [m] per axis, from `since` [s] on."""
    return float(np.sqrt(np.mean(course.error[course.time > since] ** 2)))


def slow(**vision: float) -> Rig:
    """The usual sensors on an IMU of 100 Hz, for speed."""
    return Rig(imu=proprioception.Imu(period=0.01), vision=proprioception.VisionDrift(**vision))


def with_pictures(change: Callable[[int, VisionMeasurement], VisionMeasurement | None]):
    """Spoils pictures alone."""

    def spoil(tick: int, arrived: list[Measurement]) -> list[Measurement]:
        out: list[Measurement | None] = [
            change(tick, m) if isinstance(m, VisionMeasurement) else m for m in arrived
        ]
        return [m for m in out if m is not None]

    return spoil


def test_what_the_sensor_states_is_better_than_a_belief():
    """Pictures of 1 mm that are believed to have 2 mm: the filter cannot know that they are
    better.
    """
    silent = with_pictures(lambda _, m: VisionMeasurement(time=m.time, p_WB=m.p_WB))
    stated, believed = (
        np.mean(
            [
                late_error(slow(noise=1e-3).run(30.0, np.random.default_rng(s), spoil=how), 10.0)
                for s in range(4)
            ]
        )
        for how in (None, silent)
    )
    assert stated < 0.95 * believed


def test_a_sensor_worse_than_it_states_is_believed_less():
    """It says 1 mm and has 5: the innovations tell; without them the filter would refuse most of
    its pictures.
    """
    lie = with_pictures(
        lambda _, m: VisionMeasurement(time=m.time, p_WB=m.p_WB, noise=VisionNoise(white=1e-3))
    )
    errors = {}
    for adapt in (True, False):
        course = slow(noise=5e-3).run(
            60.0, np.random.default_rng(2), Navigation(period=0.01, adapt=adapt), spoil=lie
        )
        errors[adapt] = late_error(course, 30.0)
        scale = course.state.fixes.watches[0].scale
        assert (15.0 < scale < 35.0) if adapt else scale == 1.0  # 25 is true
    honest = late_error(slow(noise=5e-3).run(60.0, np.random.default_rng(2)), 30.0)
    assert errors[True] < 1.15 * honest
    assert errors[False] > 1.15 * honest


def test_a_sound_sensor_keeps_its_word():
    course = slow().run(60.0, np.random.default_rng(7))
    assert [watch.refused for watch in course.state.fixes.watches] == [0, 0]
    assert all(watch.scale < 1.3 for watch in course.state.fixes.watches)


@pytest.mark.parametrize(
    "rig", [{}, {"delay": 0.25, "noise": 5e-3}], ids=["vision as it is", "vision late and rough"]
)
@pytest.mark.parametrize("size", [0.01, 0.2])
def test_an_accelerometer_whose_bias_jumps_is_learnt_anew(
    size: float, rig: dict[str, float], rng, within
):
    """Within a second, before the place has run away by more than a centimetre."""
    way = size * unit(rng)

    def spoil(tick: int, arrived: list[Measurement]) -> list[Measurement]:
        return [
            replace(m, specific_force_B=m.specific_force_B + way)
            if tick > 1500 and isinstance(m, ImuMeasurement)
            else m
            for m in arrived
        ]

    course = slow(**rig).run(30.0, rng, spoil=spoil)
    assert course.state.fixes.bias_jumps >= 1
    ages = np.array([e.imu_jump_age for e in course.estimates])
    assert np.isinf(ages[:1500]).all()
    assert 0.0 <= ages[-1] < np.inf
    within("place from the jump on [m]", np.abs(course.error[1500:]).max(), 0.08)
    within("bias at the end [m/s^2]", np.abs(course.state.x[6:9] - course.bias_B - way).max(), 3e-3)


def test_a_sound_accelerometer_is_not_thought_to_jump(rng: np.random.Generator):
    """Nor by pictures that jump and go missing."""
    course = slow(noise=5e-3).run(60.0, rng)
    jump = with_pictures(
        lambda tick, m: (
            None if 1000 < tick < 1300 else replace(m, p_WB=m.p_WB + 0.05 * (tick > 2000))
        )
    )
    spoilt = slow().run(40.0, rng, spoil=jump)
    assert (course.state.fixes.bias_jumps, spoilt.state.fixes.bias_jumps) == (0, 0)
    assert course.estimates[-1].imu_jump_age == np.inf


def test_outliers_are_refused():
    """One picture in seven is 5 cm to 1 m off: the error stays what it is without them, less the
    pictures lost.
    """
    rng = np.random.default_rng(1)
    wild = with_pictures(
        lambda _, m: (
            m
            if rng.random() > 1 / 7
            else replace(m, p_WB=m.p_WB + rng.uniform(0.05, 1.0) * unit(rng))
        )
    )
    clean, spoilt = (
        late_error(slow().run(60.0, np.random.default_rng(1), spoil=how)) for how in (None, wild)
    )
    assert spoilt < 1.3 * clean


def unit(rng: np.random.Generator) -> Array:
    way = rng.standard_normal(3)
    return way / np.linalg.norm(way)


def test_a_filter_that_is_wrong_gives_way_to_pictures_that_agree():
    """The hull is suddenly 0.3 m elsewhere for vision, and stays there: within two seconds the
    filter is too.
    """
    jump = with_pictures(lambda tick, m: replace(m, p_WB=m.p_WB + (0.3 if tick > 2000 else 0.0)))
    course = slow().run(60.0, np.random.default_rng(1), spoil=jump)
    error = course.state.x[:3] - course.p[-1]
    assert np.abs(error - 0.3).max() < 5e-3
    steps = np.abs(np.diff(course.error, axis=0)).max()
    assert steps < 0.03 * 0.01  # [m] handed on slowly, 3 cm/s at the most


def test_vision_lost_and_found():
    """Three seconds without a picture: sigma and age grow, the error stays inside, and the way back
    is smooth.
    """
    gone = with_pictures(lambda tick, m: None if 3000 < tick <= 3300 else m)
    course = slow().run(45.0, np.random.default_rng(3), spoil=gone)
    before, at_end = course.estimates[2999], course.estimates[3299]
    assert at_end.vision_age == pytest.approx(3.1, abs=0.02)
    assert before.vision_age < 0.21
    assert np.all(at_end.position_sigma > 1.2 * before.position_sigma)
    assert np.all(np.abs(course.error[3299]) < 5.0 * at_end.position_sigma)
    steps = np.abs(np.diff(course.error, axis=0))[2500:]
    assert steps.max() < 0.01 * 0.01  # [m] 1 cm/s
    assert late_error(course, 38.0) < 1e-3


@cache
def without_a_camera() -> Course:
    """Thirty seconds of which the last ten have no pictures."""
    silent = with_pictures(lambda tick, m: m if tick <= 2000 else None)
    return slow().run(30.0, np.random.default_rng(6), spoil=silent)


@pytest.mark.parametrize("what", ["NaN", "frozen", "frozen with new times", "inf"])
def test_a_broken_camera_is_as_good_as_none(what):
    """From 20 s on. Repeats with new times are used until they are too many to be chance."""
    last: list[VisionMeasurement] = []

    def broken(tick: int, m: VisionMeasurement) -> VisionMeasurement:
        if tick <= 2000 or not last:
            last[:] = [m]
            return m
        if what == "frozen":
            return last[0]
        if what == "frozen with new times":
            return replace(last[0], time=m.time)
        return replace(m, p_WB=np.full(3, np.nan if what == "NaN" else np.inf))

    course = slow().run(30.0, np.random.default_rng(6), spoil=with_pictures(broken))
    assert np.isfinite(course.p_believed).all()
    assert course.estimates[-1].vision_age > 9.0
    if "times" in what:
        assert np.abs(course.error).max() < 0.05
    else:
        assert np.array_equal(course.p_believed, without_a_camera().p_believed)


def test_fixes_from_the_future_are_refused():
    """A wild stamp moves neither the clock nor the hull."""
    wild = with_pictures(lambda tick, m: replace(m, time=m.time + 1e4) if tick > 500 else m)
    course = slow().run(10.0, np.random.default_rng(12), spoil=wild)
    assert course.estimates[-1].time == pytest.approx(course.time[-1], abs=1e-9)
    assert course.estimates[-1].vision_age == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize("what", ["NaN", "frozen", "silent"])
def test_an_imu_that_fails_is_told_and_does_not_stop_the_clock(what):
    """For a second, and DVL and vision carry the filter meanwhile."""
    last: list[ImuMeasurement] = []

    def spoil(tick: int, arrived: list[Measurement]) -> list[Measurement]:
        out: list[Measurement] = []
        for m in arrived:
            if not isinstance(m, ImuMeasurement):
                out.append(m)
            elif not 2000 < tick <= 2100:
                last[:] = [m]
                out.append(m)
            elif what == "NaN":
                out.append(replace(m, specific_force_B=np.full(3, np.nan)))
            elif what == "frozen":
                out.append(replace(last[0], time=m.time))
        return out

    rig = slow()
    course = rig.run(40.0, np.random.default_rng(8), hull=Hull(0.01, turn=0.0), spoil=spoil)
    assert np.array([e.time for e in course.estimates]) == pytest.approx(course.time, abs=1e-9)
    ages = np.array([e.imu_age for e in course.estimates])
    assert ages.max() == pytest.approx(1.0 if what != "frozen" else 0.76, abs=0.02)
    assert ages[2150] == 0.0
    assert np.abs(course.error).max() < 0.05
    assert late_error(course, 35.0) < 2e-3


def test_a_late_imu_costs_no_more_than_the_way_it_must_look_ahead():
    """The clock of the others runs 20 ms ahead: pose and time are those of now."""
    held: list[list[Measurement]] = [[], []]

    def spoil(_: int, arrived: list[Measurement]) -> list[Measurement]:
        held.append([m for m in arrived if isinstance(m, ImuMeasurement)])
        return [
            m for m in arrived if not isinstance(m, (ImuMeasurement, DvlMeasurement))
        ] + held.pop(0)

    course = slow().run(40.0, np.random.default_rng(9), spoil=spoil)
    assert course.estimates[-1].time == pytest.approx(course.time[-1])
    assert late_error(course) < 1.2e-3


def test_encoders_and_torques_that_are_not_numbers_are_left_aside():
    state = Navigation().init(
        [
            ImuMeasurement(time=0.0, specific_force_B=UP, w_WB_B=np.zeros(3), R_WB=np.eye(3)),
            VisionMeasurement(time=0.0, p_WB=np.zeros(3)),
            *body(),
        ]
    )
    bad = [
        EncoderMeasurement(time=0.002, q=np.full(6, np.nan), qd=np.zeros(6)),
        TorqueMeasurement(time=0.002, tau=np.full(6, np.inf)),
    ]
    state, estimate = Navigation().step(state, bad)
    assert np.array_equal(estimate.q, np.arange(6.0))
    assert np.all(estimate.tau == 2.0)
    assert estimate.time == 0.002
    tau = np.arange(6.0)
    tau[1] = np.nan
    _, estimate = Navigation().step(state, [TorqueMeasurement(time=0.004, tau=tau)])
    # the second stands still, the others go on
    assert estimate.tau.tolist() == [0.0, 2.0, 2.0, 3.0, 4.0, 5.0]


def test_a_declared_wander_is_in_the_sigma_of_the_place():
    """Where it was from the beginning nobody can tell; how the hull moves meanwhile is known far
    better.
    """
    rig = slow(bias=10e-3, bias_time=300.0)
    course = rig.run(20.0, np.random.default_rng(11))
    assert np.all(course.estimates[-1].position_sigma > 8e-3)
    moved = (course.error[-1] - course.error[999]).max()
    assert abs(moved) < 5e-3


def test_joints_are_handed_through():
    state = Navigation().init(
        [
            ImuMeasurement(time=0.0, specific_force_B=UP, w_WB_B=np.zeros(3), R_WB=np.eye(3)),
            VisionMeasurement(time=0.0, p_WB=np.zeros(3)),
            *body(),
        ]
    )
    _, estimate = Navigation().step(
        state, [EncoderMeasurement(time=0.0, q=np.zeros(6), qd=np.full(6, 3.0))]
    )
    assert not estimate.q.any()
    assert np.all(estimate.qd == 3.0)
    assert np.all(estimate.tau == 2.0)


@pytest.mark.parametrize(
    "missing", [ImuMeasurement, VisionMeasurement, EncoderMeasurement, TorqueMeasurement]
)
def test_first_measurement_that_is_missing_is_named(missing):
    first: list[Measurement] = [
        ImuMeasurement(time=0.0, specific_force_B=UP, w_WB_B=np.zeros(3), R_WB=np.eye(3)),
        VisionMeasurement(time=0.0, p_WB=np.zeros(3)),
        *body(),
    ]
    with pytest.raises(ConfigurationError, match=missing.__name__):
        Navigation().init([m for m in first if not isinstance(m, missing)])


def test_a_steady_push_is_integrated_exactly_in_a_turned_hull_with_a_known_bias(rng, within):
    """p = v t + a t^2 / 2 over a hundred steps, to rounding."""
    R = exp_so3(rng.uniform(-1.0, 1.0, 3))
    a = rng.normal(size=3)
    bias = rng.normal(size=3)
    v = rng.normal(size=3)
    row = np.zeros(kernel.INPUT)
    f = np.zeros(1, kernel.FILTER)[0]
    f.layout[:] = 9, -1, -1, -1
    row[kernel.DT] = 0.05
    row[kernel.ATTITUDE : kernel.ATTITUDE + 9] = R.ravel()
    row[kernel.FORCE : kernel.FORCE + 3] = R.T @ (a + np.array([0.0, 0.0, GRAVITY])) + bias
    f.x[3:6], f.x[6:9] = v, bias
    for _ in range(100):
        kernel.propagate(f, row)
    within("place [m]", f.x[:3] - (5.0 * v + 12.5 * a), 1e-10)
    within("velocity [m/s]", f.x[3:6] - (v + 5.0 * a), 1e-11)


def test_what_is_handed_on_is_the_state_brought_to_the_time_of_the_estimate(rng, within):
    """A tilted hull, corrections held back: place, attitude, velocity, rates and acceleration by
    their definitions.
    """
    lag = 0.03
    w_B = rng.normal(size=3)
    bias = 0.1 * rng.normal(size=3)
    f_B = rng.normal(size=3)
    R = exp_so3(rng.normal(size=3))
    x = rng.normal(size=9)
    held = rng.normal(size=(2, 3))
    memory = np.zeros(1, kernel.FILTER)
    out = estimate_record(6)
    f = memory[0]
    f.release[:] = (1.0, 0.1, 10.0, 0.01)
    f.smooth = 0.01
    f.clock = lag
    f.given = lag
    f.force[:], f.w_B[:], f.rate_bias[:], f.held[:] = f_B, w_B, bias, held
    f.R_WB[:] = R
    f.x[:9] = x
    f.P[:] = np.eye(kernel.MOST_STATES)
    kernel.put_out(memory, joint_record(6), out)
    X, v_B, w = out.X_WB, out.v_WB_B, out.w_WB_B
    v_W = x[3:6] - held[1]
    within("place [m]", X[:3, 3] - (x[:3] - held[0] + lag * v_W), 1e-14)
    # measured 1e-9
    within("attitude [rad]", log_so3(X[:3, :3].T @ R @ exp_so3(lag * (w_B - bias))), 1e-7)
    within("velocity [m/s]", v_B - R.T @ v_W, 1e-14)
    within("rates [rad/s]", w - (w_B - bias), 1e-14)
    f.held[:], f.a_B[:], f.given = 0.0, 0.0, lag - f.smooth
    kernel.put_out(memory, joint_record(6), out)
    within("acceleration [m/s^2]", out.a_WB_B - (f_B - x[6:] - R.T @ [0.0, 0.0, GRAVITY]), 1e-13)
