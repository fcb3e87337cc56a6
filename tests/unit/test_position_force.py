"""The displacement from the force error: closed form on a spring, limits, anti-windup, release."""

import numpy as np
import pytest

from controllers.position_force import Displacement, DisplacementState
from sim.interfaces.errors import ConfigurationError

SPRING = 3e4  # [N/m]
DT = 0.002  # [s]


def test_force_on_a_spring_settles_as_the_equations_say(within):
    """PI on a spring: e = F* - c k, k = I integral(e) + P e, so (1 + c P) e decays at the rate c I."""
    loop, state, dt = Displacement(speed=10.0), DisplacementState(), 1e-5
    time, error = dt * np.arange(20000), []
    for _ in time:
        error.append(10.0 - SPRING * state.k)
        loop.step(state, error[-1], dt)
    rate = SPRING * loop.integral / (1.0 + SPRING * loop.proportional)
    late = time > 0.002
    exact = 10.0 / (1.0 + SPRING * loop.proportional) * np.exp(-rate * time)
    within("force error [N]", (np.array(error) - exact)[late], 5e-3)  # measured 5e-4, of the first order in dt
    assert abs(error[-1]) < 0.2


def test_speed_and_size_of_the_displacement_are_limited():
    loop, state, rng = Displacement(), DisplacementState(), np.random.default_rng(1)
    last = furthest = 0.0
    for _ in range(5000):
        k = loop.step(state, 20.0 * rng.standard_normal() + 60.0, DT)
        assert abs(k - last) <= loop.speed * DT * (1.0 + 1e-12)
        assert abs(k) <= loop.limit
        last, furthest = k, max(furthest, k)
    assert furthest == loop.limit


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_windup(sign):
    """However long the output was at its limit, it leaves it with the first error of the other sign."""
    loop = Displacement()
    turned = []
    for seconds in (5, 50):
        state = DisplacementState()
        for _ in range(round(seconds / DT)):
            loop.step(state, sign * 80.0, DT)
        assert state.k == sign * loop.limit
        turned.append([loop.step(state, -sign * 5.0, DT) for _ in range(100)])
    assert turned[0] == pytest.approx(turned[1], abs=1e-15)
    assert sign * turned[0][0] < loop.limit
    # 5 N for 0.2 s through the integral alone.
    assert sign * (sign * loop.limit - turned[0][-1]) >= 0.99 * loop.integral * 5.0 * 0.2


def test_release_goes_back_at_the_limited_speed_and_takes_up_again_without_a_bump():
    loop, state = Displacement(), DisplacementState()
    for _ in range(1000):
        loop.step(state, 60.0, DT)
    start = state.k
    assert start > 0.02
    values = [loop.release(state, DT) for _ in range(100)]
    assert np.diff([start, *values]) == pytest.approx(-loop.speed * DT, rel=1e-9)
    assert loop.step(state, 0.0, DT) == pytest.approx(values[-1], abs=1e-15)
    for _ in range(2000):
        loop.release(state, DT)
    assert state.k == 0.0
    assert loop.step(state, 0.0, DT) == 0.0


@pytest.mark.parametrize(
    ("name", "value"),
    [("proportional", -1.0), ("integral", float("nan")), ("derivative", -1e-9), ("limit", 0.0), ("speed", -0.1)],
)
def test_gains_that_cannot_be(name, value):
    with pytest.raises(ConfigurationError, match=name):
        Displacement(**{name: value})
