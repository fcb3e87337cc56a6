"""The current in time: its statistics, an acceleration that is its derivative, and what the door
refuses.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv import models
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current, Wave

MEAN = (0.15, -0.05, 0.02)  # [m/s]


def run(current: Current, steps: int) -> tuple[Array, Array]:
    rows = [current.step() for _ in range(steps)]
    return np.array([v for v, _ in rows]), np.array([a for _, a in rows])


def test_gusts_have_the_stated_deviation_and_the_spectrum_of_two_poles():
    gust, T, dt = 0.03, 0.5, 0.01
    rng = np.random.default_rng(1)
    velocity, acceleration = run(
        Current(MEAN, gust=gust, time_constant=T, timestep=dt, rng=rng), 200_000
    )
    # 2000 s of a process that forgets itself within a second or so: 2 % of its deviation is three
    # sigma.
    assert velocity.mean(axis=0) == pytest.approx(MEAN, abs=0.1 * gust)
    assert velocity.std(axis=0) == pytest.approx(gust, rel=0.1)
    assert acceleration.std(axis=0) == pytest.approx(gust / T, rel=0.1)
    fluctuation = velocity - velocity.mean(axis=0)
    for lag in (T, 2.0 * T):  # autocorrelation (1 + t/T) exp(-t/T)
        n = round(lag / dt)
        correlation = np.mean(fluctuation[n:] * fluctuation[:-n], axis=0) / fluctuation.var(axis=0)
        assert correlation == pytest.approx((1.0 + lag / T) * np.exp(-lag / T), abs=0.06)


def test_the_axes_gust_independently():
    velocity, _ = run(
        Current(MEAN, gust=0.03, time_constant=0.2, timestep=0.01, rng=np.random.default_rng(2)),
        50_000,
    )
    assert np.abs(np.corrcoef(velocity.T) - np.eye(3)).max() < 0.1


@pytest.mark.parametrize(("time_constant", "timestep"), [(5.0, 0.002), (0.1, 0.009), (5e4, 1e-7)])
def test_gusts_blow_from_the_first_step_on(time_constant, timestep):
    """The first value of many runs has the stationary deviation already, and no jump in its
    acceleration.
    """
    first = []
    for seed in range(1000):
        rng = np.random.default_rng(seed)
        first.append(
            Current(
                (0, 0, 0), gust=0.03, time_constant=time_constant, timestep=timestep, rng=rng
            ).step()
        )
    velocity, acceleration = np.array(first).transpose(1, 0, 2)
    assert velocity.std() == pytest.approx(0.03, rel=0.1)  # 3000 values: 1.3 % is one sigma
    # of a difference over one step, by the correlation 2 a / (1 + a^2)
    a = np.exp(-timestep / time_constant)
    differs = 0.03 / timestep * np.sqrt(2.0 / (1.0 + a * a)) * -np.expm1(-timestep / time_constant)
    assert acceleration.std() == pytest.approx(differs, rel=0.1)


def test_acceleration_is_the_derivative(within):
    """Over two refills of the generator's block as well."""
    velocity, acceleration = run(
        Current(MEAN, gust=0.03, timestep=0.002, rng=np.random.default_rng(3)), 10_000
    )
    # measured 3e-17
    within("dv - a dt [m/s]", np.diff(velocity, axis=0) - 0.002 * acceleration[1:], 3e-16)


def test_a_flow_that_grows_is_accelerated_by_as_much(within):
    """With gusts, under a profile 1 - exp(-t / T): differences of the velocities are the
    accelerations.
    """

    def rising(t: float) -> tuple[float, float]:
        return 1.0 - np.exp(-t / 3.0), np.exp(-t / 3.0) / 3.0

    current = Current(
        [0.4, -0.2, 0.1], gust=0.05, timestep=1e-3, rng=np.random.default_rng(1), profile=rising
    )
    v, a = (np.array(rows) for rows in zip(*(current.step() for _ in range(5000)), strict=True))
    assert np.abs(a).max() > 0.1
    # 2.8e-5: of the first order
    within("acceleration [m/s^2]", np.diff(v, axis=0) / 1e-3 - a[1:], 3e-4)


def test_gusts_of_a_long_time_and_a_short_step_begin_at_once():
    current = Current(
        (0, 0, 0), gust=0.03, time_constant=1e8, timestep=1e-3, rng=np.random.default_rng(5)
    )
    velocity, _ = run(current, 10)
    assert 0.0 < np.abs(velocity[0]).max() < 0.2
    assert np.ptp(velocity, axis=0).max() < 1e-9


def test_the_plant_refuses_gusts_made_for_another_step():
    model = hydrodynamics.compile(models.load("bluerov2_heavy"))
    gusty = Current(
        MEAN, gust=0.03, timestep=2.0 * model.opt.timestep, rng=np.random.default_rng(6)
    )
    with pytest.raises(ConfigurationError, match="timestep"):
        Plant(model, current=gusty)
    assert Current(MEAN, timestep=0.1).timestep is None
    plant = Plant(model, current=Current(MEAN, timestep=0.1))  # a steady one fits any
    with pytest.raises(ConfigurationError, match="timestep"):
        plant.reset(current=gusty)


def test_same_seed_same_gusts():
    first, same, other = (
        run(Current(MEAN, gust=0.03, rng=np.random.default_rng(seed)), 5000)[0]
        for seed in (4, 4, 5)
    )
    assert np.array_equal(first, same)
    assert np.abs(first - other).max() > 0.01


def test_steady_without_gusts():
    velocity, acceleration = run(Current(MEAN), 10)
    assert np.array_equal(velocity, np.tile(MEAN, (10, 1)))
    assert not acceleration.any()


@pytest.mark.parametrize(
    ("mean", "options", "said"),
    [
        ((0.1, 0.0), {}, "current"),
        ((0.1, 0.0, float("nan")), {}, "current"),
        (MEAN, {"gust": -0.01}, "gust: must be finite and >= 0"),
        (MEAN, {"gust": float("inf")}, "gust"),
        (MEAN, {"gust": 0.03}, "generator"),
        (MEAN, {"time_constant": 0.01}, "time constant: .* got 0.01"),
        (MEAN, {"time_constant": float("inf")}, "time constant: .* got inf"),
        (MEAN, {"time_constant": float("nan")}, "time constant: .* got nan"),
        (MEAN, {"time_constant": 1e300}, "time constant: .* got 1e\\+300"),
        (MEAN, {"time_constant": "5"}, "time constant"),
        (MEAN, {"timestep": 0.0}, "timestep of the current"),
        (MEAN, {"timestep": -0.002}, "timestep of the current"),
        (MEAN, {"timestep": float("nan")}, "timestep of the current"),
        (MEAN, {"gust": "0.3"}, "gust"),
        (MEAN, {"gust": [0.1, 0.1, 0.1]}, "gust"),
        (MEAN, {"gust": 0.03, "rng": 5}, "generator"),
    ],
)
def test_refusals(mean, options, said):
    with pytest.raises(ConfigurationError, match=said):
        Current(mean, **options)


def test_a_wave_swings_about_the_steady_current(within):
    """Its velocity is the sine in closed form across two blocks, and its acceleration adds up to
    the velocity.
    """
    dt = 0.002
    wave = Wave(amplitude_W=(0.1, -0.05, 0.0), frequency=0.2, phase=0.3)
    current = Current([0.2, 0.0, 0.0], wave=wave, timestep=dt)
    velocity, acceleration = run(current, 6000)
    t = dt * np.arange(6000)
    expected = np.array([0.2, 0.0, 0.0]) + np.outer(
        np.sin(2.0 * np.pi * 0.2 * t + 0.3), [0.1, -0.05, 0.0]
    )
    within("velocity [m/s]", float(np.abs(velocity - expected).max()), 1e-12)
    within(
        "velocity added up [m/s]",
        float(np.abs(np.diff(velocity, axis=0) - dt * acceleration[1:]).max()),
        1e-12,
    )
    alone = Current([0.0, 0.0, 0.0], gust=0.1, rng=np.random.default_rng(1))
    both = Current([0.0, 0.0, 0.0], gust=0.1, wave=wave, rng=np.random.default_rng(1))
    gust, with_wave = (
        np.array([current.step()[0] for _ in range(10)]) for current in (alone, both)
    )
    within(
        "gust and wave [m/s]", float(np.abs(with_wave - gust - wave.velocity(t[:10])).max()), 1e-12
    )
    for wrong, words in ((0.0, "finite and > 0 Hz"), (np.inf, "finite and > 0 Hz")):
        with pytest.raises(ConfigurationError, match=words):
            Wave(frequency=wrong)
    with pytest.raises(ConfigurationError, match="must be longer than 20 steps"):
        Current([0.0, 0.0, 0.0], wave=replace(wave, frequency=50.0), timestep=dt)


@pytest.mark.parametrize(
    ("profile", "said"),
    [
        (lambda t: (1.0 + 0.3 * np.sin(t), 0.0), "it is not at 5 of 5 times"),
        (lambda t: t, "must return a factor and its rate"),
        (lambda t: (np.nan * t, 0.0), "not finite at 0.37 s"),
    ],
)
def test_a_profile_whose_rate_is_not_its_factors_is_refused(profile, said: str):
    with pytest.raises(ConfigurationError, match=said):
        Current([0.3, 0.0, 0.0], profile=profile)


def test_a_profile_may_step_and_bend():
    for profile in (lambda t: (float(t > 2.71), 0.0), lambda t: (min(t, 2.0), float(t < 2.0))):
        assert Current([0.3, 0.0, 0.0], profile=profile).profile is profile


def test_the_rate_of_two_profiles_is_that_of_their_product(within):
    """By differences of the velocity; each factor has a rate of its own."""
    current = Current((0.4, -0.2, 0.1), timestep=1e-3, profile=lambda t: (1.0 + 0.3 * t, 0.3))
    current = current.with_profile(lambda t: (0.5 + 0.2 * t * t, 0.4 * t))
    steps = [current.step() for _ in range(2000)]
    velocity, acceleration = (np.array(rows) for rows in zip(*steps, strict=True))
    slope = (velocity[2:] - velocity[:-2]) / 2e-3
    # measured 3e-8: the third derivative
    within("acceleration [m/s^2]", slope - acceleration[1:-1], 1e-7)
