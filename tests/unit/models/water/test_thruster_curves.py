"""Thruster curves, uncompiled, against polynomials by NumPy and monotone cubics by SciPy."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from uncompiled import uncompiled
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

(curves,) = uncompiled("uuv.models.water.thruster_curves")
AHEAD = (3.0, 20.0, 17.0)
ASTERN = (2.0, 24.0)
BAND = 0.1
TABLES = [
    ([-1.0, -0.6, -0.1, 0.05, 0.4, 1.0], [-30.0, -12.0, 0.0, 0.0, 9.0, 40.0]),
    ([-1.0, 0.0, 0.3, 1.0], [-20.0, 0.0, 19.0, 20.0]),
    ([-1.0, -0.9, 0.0, 0.1, 1.0], [-50.0, -1.0, 0.0, 0.2, 30.0]),
]


def cubic(command: list[float], thrust: list[float], at: Array) -> Array:
    return PchipInterpolator(command, thrust)(at)


def test_a_polynomial_counts_from_the_end_of_the_dead_band() -> None:
    row = curves.pack_polynomial(curves.POLYNOMIAL, AHEAD, ASTERN, BAND, 0.0)
    for command in np.linspace(-1.0, 1.0, 81):
        r = max(abs(command) - BAND, 0.0) / (1.0 - BAND)
        coefficients = AHEAD if command > 0.0 else ASTERN
        expected = np.sign(command) * np.polyval([*coefficients[::-1], 0.0], r)
        assert curves.reach_at(row, command) == pytest.approx(r, abs=1e-15)
        assert curves.thrust_at(row, command) == pytest.approx(expected, abs=1e-12)


def test_a_dead_band_may_be_uneven() -> None:
    row = curves.pack_table([-1.0, -0.2, 0.4, 1.0], [-5.0, 0.0, 0.0, 9.0], 0.0)
    for command, reach in (
        (-1.0, 1.0),
        (-0.6, 0.5),
        (-0.2, 0.0),
        (0.4, 0.0),
        (0.7, 0.5),
        (1.0, 1.0),
    ):
        assert curves.reach_at(row, command) == pytest.approx(reach)


@pytest.mark.parametrize(("command", "thrust"), TABLES)
def test_a_table_is_the_monotone_cubic(command: list[float], thrust: list[float]) -> None:
    row = curves.pack_table(command, thrust, 0.0)
    at = np.linspace(-1.0, 1.0, 101)
    thrusts = [curves.thrust_at(row, c) for c in at]
    np.testing.assert_allclose(thrusts, cubic(command, thrust, at), atol=1e-11)
    slopes = PchipInterpolator(command, thrust).derivative()(command)
    np.testing.assert_allclose(
        curves._slopes(np.array(command), np.array(thrust)), slopes, atol=1e-11
    )


def test_end_slopes_of_a_table_do_not_overshoot(rng: np.random.Generator) -> None:
    """For rising and for other tables of any spacing."""
    for _ in range(60):
        x = np.cumsum(rng.uniform(0.05, 1.0, 5))
        y = np.cumsum(rng.normal(size=5))
        np.testing.assert_allclose(
            curves._slopes(x, y), PchipInterpolator(x, y).derivative()(x), atol=1e-9
        )


@pytest.mark.parametrize(
    "row",
    [
        curves.pack_polynomial(curves.POLYNOMIAL, AHEAD, ASTERN, BAND, 0.0),
        curves.pack_polynomial(curves.QUADRATIC, (0.0, 40.0), (0.0, 30.0), BAND, 0.0),
        curves.pack_polynomial(curves.POLYNOMIAL, (0.0, 0.0, 9.0), (7.0,), 0.0, 0.0),
        *(curves.pack_table(*table, 0.0) for table in TABLES),
    ],
)
def test_the_inverse_gives_the_command_back(row: Array) -> None:
    most = curves.thrust_at(row, 1.0)
    least = curves.thrust_at(row, -1.0)
    for thrust in np.linspace(least, most, 41):
        command = curves.command_for(row, thrust)
        assert -1.0 <= command <= 1.0
        assert curves.thrust_at(row, command) == pytest.approx(thrust, abs=1e-9)
    assert curves.command_for(row, 2.0 * most) == pytest.approx(1.0)
    assert curves.command_for(row, 2.0 * least) == pytest.approx(-1.0)
    still = curves.command_for(row, 0.0)
    assert curves.thrust_at(row, still) == 0.0
    assert abs(still) == min(
        abs(c) for c in np.linspace(-1, 1, 2001) if curves.reach_at(row, c) == 0.0
    )


def test_below_the_least_thrust_a_propeller_stands_or_turns_as_slowly_as_it_can() -> None:
    row = curves.pack_polynomial(curves.QUADRATIC, (0.0, 40.0), (0.0, 30.0), BAND, 2.0)
    for sign in (1.0, -1.0):
        for asked_thrust, expected in ((0.9, 0.0), (1.1, 2.0), (1.99, 2.0), (2.0, 2.0), (2.1, 2.1)):
            assert curves.thrust_at(
                row, curves.command_for(row, sign * asked_thrust)
            ) == pytest.approx(sign * expected)
    just = BAND + (1.0 - BAND) * np.sqrt(2.0 / 40.0)
    assert curves.thrust_at(row, just + 1e-4) > 2.0
    assert curves.thrust_at(row, just - 1e-4) == 0.0


def test_newtons_method_stays_within_its_bracket(rng: np.random.Generator) -> None:
    """On a rising cubic with a slope of zero at its root's side, from any start."""
    for _ in range(20):
        root = rng.uniform(0.1, 0.9)
        low = 0.0
        high = 1.0
        x = rng.uniform(0.0, 1.0)
        for _ in range(100):
            low, high, x, done = curves._closer(
                low, high, x, (x - root) ** 3, 3.0 * (x - root) ** 2
            )
            assert low <= x <= high
            assert low <= root <= high
            if done:
                break
        assert x == pytest.approx(root, abs=1e-5)


@pytest.mark.parametrize(
    ("ahead", "ok"), [((1.0, 2.0), True), ((0.0, -1.0), False), ((5.0, -4.0), False)]
)
def test_a_curve_must_rise(ahead: tuple[float, ...], ok: bool) -> None:
    if ok:
        assert curves.check_polynomial(ahead) == pytest.approx(sum(ahead))
        return
    with pytest.raises(ConfigurationError, match="thruster"):
        curves.check_polynomial(ahead)
