"""Static thruster curves from command to thrust and back: polynomials outside a dead band, or a
table.

One curve is one row of numbers, so that plant and controllers evaluate the same data in compiled
code.
"""

from collections.abc import Sequence

import numpy as np

from uuv.models.water.bounds import bounded
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, shown

QUADRATIC, POLYNOMIAL, TABLE = range(3)
# share of the largest coefficient, below which a coefficient does not affect where the curve turns
_NOTHING = 1e-12

# A row: kind, number of points or coefficients, ends of the dead band, least thrust [N]. Then
# commands, thrusts [N] and slopes of a table, or coefficients ahead and astern.
_KIND, _COUNT, _LOW, _HIGH, _LEAST, FIRST = range(6)

# coefficients ahead and astern, or commands and thrusts [N]
Sides = tuple[tuple[float, ...], tuple[float, ...]]


def pack_polynomial(
    kind: int, ahead: Sequence[float], astern: Sequence[float], band: float, least: float
) -> Array:
    """Row of a polynomial curve `c[0] r + c[1] r^2 + ...` [N].

    Args:
        kind: POLYNOMIAL, or QUADRATIC where only c[1] differs from zero.
        ahead: coefficients [N] for positive commands.
        astern: coefficients [N] of the magnitude for negative commands.
        band: half width of the dead band, as a command.
        least: [N] least thrust of a turning propeller.

    Returns:
        The row, for the kernels of this module.
    """
    count = max(len(ahead), len(astern))
    coefficients = np.zeros((2, count))
    coefficients[0, : len(ahead)] = ahead
    coefficients[1, : len(astern)] = astern
    return np.array([kind, count, -band, band, least, *coefficients.ravel()])


def pack_table(command: Sequence[float], thrust: Sequence[float], least: float) -> Array:
    """Row of a tabled curve; its dead band is the range of zero thrust.

    Args:
        command: (k,) in [-1, 1], rising.
        thrust: (k,) [N].
        least: [N] least thrust of a turning propeller.

    Returns:
        The row, for the kernels of this module.
    """
    x = np.array(command)
    y = np.array(thrust)
    still = x[y == 0.0]
    return np.array([TABLE, len(x), still[0], still[-1], least, *x, *y, *_slopes(x, y)])


@kernel
def rewrite_table(curve, command, thrust):
    """Replace commands and thrusts [N] of a tabled curve by the same number of others, as
    `pack_table` does.
    """
    count = int(curve[_COUNT])
    curve[FIRST : FIRST + count] = command[:count]
    curve[FIRST + count : FIRST + 2 * count] = thrust[:count]
    curve[FIRST + 2 * count : FIRST + 3 * count] = _slopes(command[:count], thrust[:count])

    # The dead band.
    at = 0
    while thrust[at] < 0.0:
        at += 1
    curve[_LOW] = command[at]
    while at < count - 1 and thrust[at + 1] == 0.0:
        at += 1
    curve[_HIGH] = command[at]


def unpack(curve: Array) -> tuple[Sides | None, Sides | None]:
    """Polynomial and table of a row. The one that the row does not have is None; for a quadratic
    curve both are None.

    Raises:
        ConfigurationError: the row has another kind or length.
    """
    numbers = curve.tolist()
    kind, count = (round(number) for number in numbers[:_LOW]) if len(numbers) >= FIRST else (-1, 0)
    blocks = {QUADRATIC: 2, POLYNOMIAL: 2, TABLE: 3}.get(kind, -1)
    if len(numbers) != FIRST + blocks * count:
        raise ConfigurationError(
            f"thruster: the curve, a row of {len(numbers)} numbers, must have a known kind and its "
            "length"
        )

    first = tuple(numbers[FIRST : FIRST + count])
    second = tuple(numbers[FIRST + count : FIRST + 2 * count])
    if kind == TABLE:
        return None, (first, second)
    if kind == QUADRATIC:
        return None, None
    return (_without_zeros(first), _without_zeros(second)), None


def agrees(curve: Array, thrust: tuple[float, float], band: float | None, least: float) -> bool:
    """True if a curve has these figures.

    Args:
        curve: row of a curve.
        thrust: [N] magnitudes of the full thrust astern and ahead.
        band: half width of the dead band, as a command; None: any.
        least: [N] least thrust of a turning propeller.
    """
    full = (-thrust_at(curve, -1.0), thrust_at(curve, 1.0))
    bands = (-curve[_LOW], curve[_HIGH])
    stated = [*thrust, *(bands if band is None else (band, band)), least]
    return np.allclose([*full, *bands, curve[_LEAST]], stated, rtol=1e-9, atol=0.0)


def _without_zeros(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Coefficients without the zeros that were appended to the shorter side."""
    count = max((k + 1 for k, c in enumerate(coefficients) if c), default=0)
    return coefficients[:count]


@kernel
def reach_at(curve, command):
    """Share in [0, 1] of the command's magnitude beyond the dead band."""
    if command > curve[_HIGH]:
        return (command - curve[_HIGH]) / (1.0 - curve[_HIGH])
    if command < curve[_LOW]:
        return (curve[_LOW] - command) / (1.0 + curve[_LOW])
    return 0.0


@kernel
def thrust_at(curve, command):
    """Steady thrust [N] in still water at a command in [-1, 1]."""
    reach = reach_at(curve, command)
    if reach == 0.0:
        return 0.0

    count = int(curve[_COUNT])
    if curve[_KIND] == TABLE:
        at = _segment(curve[FIRST:], count, command)
        thrust = _cubic(curve[FIRST:], count, at, command)[0]
    else:
        start = FIRST if command > 0.0 else FIRST + count
        thrust = _horner(curve[start:], count, reach)[0]
        if command < 0.0:
            thrust = -thrust

    # tolerance, so that the inverse of the least thrust gives the least thrust
    if abs(thrust) < curve[_LEAST] * (1.0 - 1e-9):
        return 0.0
    return thrust


@kernel
def command_for(curve, thrust):
    """Inverse curve: the command whose steady thrust in still water is `thrust` [N], to rounding.

    Beyond the ends of the curve it saturates. Below the least thrust the result gives zero or the
    least thrust, whichever is nearer.
    """
    least = curve[_LEAST]
    if abs(thrust) < least:
        thrust = 0.0 if abs(thrust) < 0.5 * least else np.sign(thrust) * least
    if thrust == 0.0:
        return min(max(0.0, curve[_LOW]), curve[_HIGH])

    count = int(curve[_COUNT])
    if curve[_KIND] == TABLE:
        x = curve[FIRST : FIRST + count]
        y = curve[FIRST + count : FIRST + 2 * count]
        if thrust >= y[count - 1]:
            return x[count - 1]
        if thrust <= y[0]:
            return x[0]

        at = 0
        while y[at + 1] < thrust:
            at += 1

        # Newton's method in the segment, starting from its chord.
        low = x[at]
        high = x[at + 1]
        command = low + (high - low) * (thrust - y[at]) / (y[at + 1] - y[at])
        for _ in range(100):
            reached, slope = _cubic(curve[FIRST:], count, at, command)
            low, high, command, done = _closer(low, high, command, reached - thrust, slope)
            if done:
                break
        return command

    # A polynomial in the reach beyond the dead band.
    start, band = (FIRST, curve[_HIGH]) if thrust > 0.0 else (FIRST + count, -curve[_LOW])
    magnitude = abs(thrust)
    if curve[_KIND] == QUADRATIC:
        reach = np.sqrt(min(magnitude / curve[start + 1], 1.0))
    else:
        low = 0.0
        high = 1.0
        reach = 1.0
        for step in range(100):
            reached, slope = _horner(curve[start:], count, reach)
            if step == 0 and reached <= magnitude:
                break
            low, high, reach, done = _closer(low, high, reach, reached - magnitude, slope)
            if done:
                break

    return np.sign(thrust) * (band + (1.0 - band) * reach)


@kernel
def thrust_in_flow(curve, loss, inflow, command):
    """Steady thrust [N] in moving water: less by `loss` [N s/m] times reach times `inflow` [m/s].

    The inflow is the speed of advance through the water along the thrust.
    """
    thrust = thrust_at(curve, command)
    return thrust - loss * reach_at(curve, command) * inflow if thrust != 0.0 else 0.0


@kernel
def command_in_flow(curve, loss, inflow, thrust):
    """Command whose steady thrust in moving water is `thrust` [N], or the nearest in its direction.

    Args:
        curve: static curve of the thruster.
        loss: [N s/m] as in `thrust_in_flow`.
        inflow: [m/s] speed of advance through the water along the thrust.
        thrust: [N] desired thrust.
    """
    still = command_for(curve, thrust)
    if thrust == 0.0 or thrust_at(curve, still) == 0.0 or loss * inflow == 0.0:
        return still

    sign = np.sign(thrust)
    # The solution is the larger root. It is between the command in still water and full speed if
    # the flow reduces the thrust, else between the least thrust and the command in still water.
    taken = loss * inflow * sign > 0.0
    end = sign if taken else command_for(curve, sign * curve[_LEAST])
    low, high = (still, end) if taken else (end, still)

    if taken and sign * (thrust_in_flow(curve, loss, inflow, end) - thrust) <= 0.0:
        return end

    for _ in range(52):  # number of halvings until rounding
        middle = 0.5 * (low + high)
        if sign * (thrust_in_flow(curve, loss, inflow, middle) - thrust) < 0.0:
            low = middle
        else:
            high = middle
    return high


@kernel
def _closer(low, high, x, error, slope):
    """One step of Newton's method on a rising function, or of bisection if the step leaves the
    bracket.

    Returns:
        The new bracket, the new argument, and True when converged.
    """
    step = error / slope if slope > 0.0 else np.inf
    if error == 0.0 or abs(step) <= 4e-16 * abs(x):
        return low, high, x, True
    if error > 0.0:
        high = x
    else:
        low = x
    nearer = x - step
    if not low < nearer < high:
        nearer = 0.5 * (low + high)
    return low, high, nearer, high - low <= 4e-16 * abs(x)


@kernel
def _horner(coefficients, count, r):
    """Value and derivative of `c[0] r + c[1] r^2 + ...`."""
    polynomial = 0.0
    slope = 0.0
    for k in range(count - 1, -1, -1):
        slope = slope * r + polynomial
        polynomial = polynomial * r + coefficients[k]
    return polynomial * r, polynomial + slope * r


@kernel
def _segment(x, count, command):
    at = 0
    while at < count - 2 and x[at + 1] < command:
        at += 1
    return at


@kernel
def _cubic(blocks, count, at, command):
    """Value and slope of the Hermite cubic from point `at` to the next; constant beyond both."""
    x0, x1 = blocks[at], blocks[at + 1]
    y0, y1 = blocks[count + at], blocks[count + at + 1]
    h = x1 - x0
    s0 = h * blocks[2 * count + at]
    s1 = h * blocks[2 * count + at + 1]

    # t in [0, 1] from one point to the other.
    t = min(max((command - x0) / h, 0.0), 1.0)
    rise = y1 - y0
    a = 3.0 * rise - 2.0 * s0 - s1
    b = s0 + s1 - 2.0 * rise
    return y0 + t * (s0 + t * (a + t * b)), (s0 + t * (2.0 * a + 3.0 * t * b)) / h


@kernel
def _slopes(x, y):
    """Slopes (k,) that keep a piecewise cubic monotone: weighted harmonic means, bounded at the
    ends.
    """
    h = np.diff(x)
    secant = np.diff(y) / np.diff(x)
    slopes = np.zeros_like(y)

    for i in range(1, len(x) - 1):
        if secant[i - 1] * secant[i] > 0.0:
            before = h[i - 1] + 2.0 * h[i]
            after = 2.0 * h[i - 1] + h[i]
            slopes[i] = (before + after) / (before / secant[i - 1] + after / secant[i])

    # Slopes at the ends, from three points.
    for end, near, far in ((0, 0, 1), (-1, -1, -2)):
        slope = ((2.0 * h[near] + h[far]) * secant[near] - h[near] * secant[far]) / (
            h[near] + h[far]
        )
        if slope * secant[near] <= 0.0:
            slope = 0.0
        elif secant[near] * secant[far] <= 0.0 and abs(slope) > 3.0 * abs(secant[near]):
            slope = 3.0 * secant[near]
        slopes[end] = slope

    return slopes


def check_polynomial(coefficients: Sequence[float]) -> float:
    """Validate a rising polynomial, and return its thrust [N] at r = 1.

    Raises:
        ConfigurationError: the coefficients are not finite, or the curve does not rise throughout.
    """
    c = np.asarray(coefficients, dtype=np.float64)
    if c.ndim != 1 or c.size == 0 or not np.isfinite(c).all():
        got = shown(coefficients)
        raise ConfigurationError(f"thruster polynomial: expected finite coefficients, got {got}")
    bounded(c, c.shape, "thruster polynomial")

    # Last coefficients that are negligible beside the others would only overflow in the roots.
    slope = np.polynomial.Polynomial(c * np.arange(1, c.size + 1))
    roots = slope.trim(_NOTHING * np.abs(slope.coef).max()).roots()

    # Between its extrema the curve rises or falls throughout.
    turns = np.sort(
        roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0) & (roots.real < 1.0)].real
    )
    between = 0.5 * (np.array([0.0, *turns]) + np.array([*turns, 1.0]))
    if falls := [float(r) for r in between if not slope(r) > 0.0]:
        raise ConfigurationError(
            f"thruster polynomial {c.tolist()}: must rise from 0 to 1, but does not at "
            f"{falls[0]:.3g}"
        )
    return float(c.sum())


def check_table(command: Sequence[float], thrust: Sequence[float]) -> tuple[float, float]:
    """Validate an invertible table; returns its thrust magnitudes [N] at upper and lower end.

    Raises:
        ConfigurationError: commands or thrusts do not rise, or no thrust is zero.
    """
    x = np.asarray(command, dtype=np.float64)
    y = np.asarray(thrust, dtype=np.float64)
    if x.shape != y.shape or len(x) < 3 or not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ConfigurationError(
            "thruster table: expected three or more pairs of finite numbers, got the commands "
            f"{command} and the thrusts {thrust}"
        )
    if not (np.all(np.diff(x) > 0.0) and x[0] >= -1.0 - 1e-9 and x[-1] <= 1.0 + 1e-9):
        raise ConfigurationError(
            f"thruster table: commands must rise within full speed, got {x.tolist()}"
        )

    still = (y[1:] == 0.0) & (y[:-1] == 0.0)
    if not (y[0] < 0.0 < y[-1] and np.any(y == 0.0) and np.all((np.diff(y) > 0.0) | still)):
        raise ConfigurationError(
            f"thruster table: thrusts must rise from below zero through zero, got {y.tolist()}"
        )

    return float(y[-1]), float(-y[0])
