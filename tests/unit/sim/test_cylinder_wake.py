"""Wake of a cylinder against closed forms: deficit and half-width, momentum and drag, a far
station, its two ends.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3
from uuv.sim.water.cylinder_wake import CylinderWake, wake_behind

R_WC = exp_so3([0.4, -0.7, 1.1])  # of the cylinder: stream across along x, aside y, axis z
PLACE = np.array([0.7, -1.3, -2.2])  # [m]
SPEED, DIAMETER, LENGTH, DRAG = 0.3, 0.6, 40.0, 1.1


def tuple_of(vector: Array) -> Any:
    return tuple(vector.tolist())


LONG = CylinderWake(
    stream=tuple_of(R_WC @ [SPEED, 0.0, 0.0]),
    place=tuple_of(PLACE),
    axis=tuple_of(R_WC @ [0.0, 0.0, 2.5]),
    diameter=DIAMETER,
    length=LENGTH,
    drag=DRAG,
)


def deficit(wake: CylinderWake, x: float, y: float, s: float = 0.0) -> float:
    """What is missing [m/s] along the stream, at a place in the cylinder's axes; nothing is missing
    across.
    """
    missing_C = -R_WC.T @ wake.velocity(PLACE + R_WC @ [x, y, s], 3.0)
    np.testing.assert_allclose(missing_C[1:], 0.0, atol=1e-15)
    return float(missing_C[0])


@pytest.mark.parametrize("x", [0.6, 3.0, 20.0])
def test_deficit_and_half_width_are_those_of_the_source(x):
    """[Huse 1993] from one diameter on: k1 = 0.25, k2 = 1, and half of it at the half-width."""
    away = x + 4.0 * DIAMETER / DRAG
    middle = SPEED * np.sqrt(DRAG * DIAMETER / away)
    width = 0.25 * np.sqrt(DRAG * DIAMETER * away)
    assert deficit(LONG, x, 0.0) == pytest.approx(middle, rel=1e-12)
    for side in (-1.0, 1.0):
        assert deficit(LONG, x, side * width) == pytest.approx(0.5 * middle, rel=1e-12)


def test_the_wake_begins_at_half_the_drag_coefficient_and_half_the_diameter():
    """The virtual source is placed so: extrapolated to the axis, where the growth over a diameter
    is taken off.
    """
    x = 1e-3 * DIAMETER
    growth = (x / DIAMETER) ** 2 * (3.0 - 2.0 * x / DIAMETER)
    assert deficit(LONG, x, 0.0) / growth == pytest.approx(0.5 * DRAG * SPEED, rel=1e-3)
    assert deficit(LONG, x, 0.5 * DIAMETER) / deficit(LONG, x, 0.0) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("x", [2.0, 20.0])
def test_the_momentum_that_is_missing_is_the_drag_within_seven_percent(x):
    """Per length: rho U int u dy = rho U^2 C D k1 k2 sqrt(pi / ln 2), against 0.5 rho U^2 C D."""
    y = np.linspace(-15.0, 15.0, 6001)
    missing = np.trapezoid([deficit(LONG, x, at) for at in y], y)
    exact = 0.25 * np.sqrt(np.pi / np.log(2.0)) * SPEED * DRAG * DIAMETER
    assert missing == pytest.approx(exact, rel=1e-9)
    assert missing == pytest.approx(0.5 * SPEED * DRAG * DIAMETER, rel=0.07)


def test_a_short_cylinder_loses_the_momentum_of_its_length():
    """Blurred at the ends: half at an end, and as much in all as without blur."""
    short = replace(LONG, length=1.5)
    x = 4.0
    s = np.linspace(-12.0, 12.0, 4001)
    along = np.array([deficit(short, x, 0.1, at) for at in s])
    assert np.trapezoid(along, s) == pytest.approx(1.5 * deficit(LONG, x, 0.1), rel=1e-9)
    assert deficit(replace(LONG, length=20.0), x, 0.1, 10.0) == pytest.approx(
        0.5 * deficit(LONG, x, 0.1), rel=1e-9
    )


def test_ahead_of_it_nothing_is_missing_and_the_wake_grows_smoothly():
    assert deficit(LONG, -0.1, 0.0) == deficit(LONG, 0.0, 0.0) == 0.0
    x = np.linspace(-0.5, 3.0, 3501)
    slope = np.abs(np.diff([deficit(LONG, at, 0.0) for at in x])) / 1e-3
    # [1/s] twice that of a straight rise
    assert 0.1 < slope.max() < 2.0 * 0.5 * DRAG * SPEED / DIAMETER


def test_only_the_stream_across_the_axis_sheds_a_wake():
    oblique = replace(LONG, stream=tuple_of(R_WC @ [SPEED, 0.0, 0.8]))
    assert deficit(oblique, 2.0, 0.3) == pytest.approx(deficit(LONG, 2.0, 0.3), rel=1e-12)
    along = replace(LONG, stream=tuple_of(R_WC @ [0.0, 0.0, 0.8]))
    assert not along.velocity(PLACE + R_WC @ [1.0, 0.2, 0.3], 0.0).any()


def test_an_object_is_a_cylinder_along_the_longest_side_of_its_box():
    X_WO = np.eye(4)
    X_WO[:3, :3], X_WO[:3, 3] = R_WC, PLACE
    box = np.array([[-0.3, -1.0, -0.2], [0.3, 1.4, 0.6]])
    wake = wake_behind(np.array([0.2, 0.1, 0.0]), X_WO, box, drag=0.9)
    np.testing.assert_allclose(wake.axis, R_WC[:, 1], atol=1e-15)
    np.testing.assert_allclose(wake.place, PLACE + R_WC @ [0.0, 0.2, 0.2], atol=1e-15)
    assert (wake.stream, wake.drag) == ((0.2, 0.1, 0.0), 0.9)
    assert (wake.length, wake.diameter) == (pytest.approx(2.4), pytest.approx(0.7))
    assert wake_behind(np.ones(3), X_WO, box, 0.55).diameter == 0.55
    with pytest.raises(ConfigurationError, match="sides of the object must be > 0"):
        wake_behind(np.ones(3), X_WO, np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"diameter": 0.0}, r"CylinderWake diameter \[m\]"),
        ({"length": np.nan}, r"CylinderWake length \[m\]"),
        ({"drag": -1.0}, "CylinderWake drag"),
        ({"axis": (0.0, 0.0, 0.0)}, "CylinderWake axis"),
        ({"stream": (0.1, 0.2)}, r"CylinderWake stream \[m/s\]"),
        ({"place": (0.1, 0.2, np.inf)}, r"CylinderWake place \[m\]"),
    ],
)
def test_numbers_that_make_no_wake_are_refused(changed, said):
    with pytest.raises(ConfigurationError, match=said):
        replace(LONG, **changed)
