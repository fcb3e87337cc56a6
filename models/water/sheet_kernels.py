"""Thrust and current at any voltage between measured ones.

Points with the same index of two sheets correspond: they are at the same share of the range from
the dead band to the end. Between two voltages,

- the ends of the dead band and the full thrust and current are linear in the voltage,
- the share of the full thrust, or current, at corresponding points is linear in the square of the
  voltage, since the thrust of a propeller grows with the square of its speed, and the speed with
  the voltage.

All weights are positive, so that a curve between two rising curves rises too. If one sheet of the
T200 is left out, the error there is 1.3 % of full thrust at 14 V and 2.8 % at 16 V. Linear
interpolation over the voltage has errors of 1.3 and 3.6 %, a parabola of 2.8 and 2.4 %
(`tests/unit/models/water/test_measured_thruster.py`).
"""

from collections.abc import Sequence
from dataclasses import astuple, fields
from typing import NamedTuple

import numpy as np

from uuv.models.water.thruster_sheets import Esc, Sheet, check_sheets
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

# A block: number of sheets, points of each sheet, 1 if there are currents. Then the voltages; then
# commands, thrusts and currents of the first sheet, of the next, and so on.
_SHEETS, POINTS, MEASURED, _VOLTS = range(4)


class Between(NamedTuple):
    """Curves at one voltage, which may be between sheets."""

    command: Array  # (k,)
    thrust: Array  # (k,) [N]
    current: Array  # (k,) [A]; zeros if not measured


def between(sheets: Sequence[Sheet], voltage: float) -> Between:
    """Curves at `voltage` [V].

    Raises:
        ConfigurationError: the voltage is beyond those of the sheets.
    """
    check_sheets(sheets, voltage)
    block = pack_sheets(sheets)
    curves = np.empty((3, len(sheets[0].command)))
    blend(block, voltage, curves)
    return Between(*curves)


def pack_sheets(sheets: Sequence[Sheet]) -> Array:
    """Block of numbers for `blend` and `current_at`."""
    points = len(sheets[0].command)
    rows = [(s.command, s.thrust, s.current or (0.0,) * points) for s in sheets]
    head = len(sheets), points, float(bool(sheets[0].current))
    return np.array([*head, *(sheet.voltage for sheet in sheets), *np.ravel(rows).tolist()])


def unpack_sheets(block: Array) -> tuple[Sheet, ...]:
    """Sheets of a block.

    Raises:
        ConfigurationError: the block has another length, or contains no sheet.
    """
    count, points = (round(float(x)) for x in block[:MEASURED])
    whole = _VOLTS + count + 3 * count * points
    if count < 1 or points < 3 or len(block) < whole:
        raise ConfigurationError(
            f"thruster: a block of {len(block)} numbers does not have the length of {count} sheets "
            f"of {points} points"
        )

    rows = np.asarray(block[_VOLTS + count : whole]).reshape(count, 3, points).tolist()
    return tuple(
        Sheet(
            voltage=float(block[_VOLTS + k]),
            command=tuple(command),
            thrust=tuple(thrust),
            current=tuple(current) if block[MEASURED] else (),
        )
        for k, (command, thrust, current) in enumerate(rows)
    )


# Order in a row of numbers after the curve: voltage, numbers of the ESC, block.
_BLOCK = 1 + len(fields(Esc))


def pack_measured(voltage: float, esc: Esc | None, sheets: Sequence[Sheet]) -> list[float]:
    """Numbers of a thruster's measurements; empty without measurements."""
    if esc is None and not sheets:
        return []
    pulses = [0.0] * (_BLOCK - 1) if esc is None else astuple(esc)
    return [voltage, *pulses, *(pack_sheets(sheets).tolist() if sheets else [0.0])]


def unpack_measured(rest: Array) -> tuple[float, Esc | None, tuple[Sheet, ...]]:
    """Voltage [V], ESC and sheets from the numbers of `pack_measured`, which zeros may follow.

    Raises:
        ConfigurationError: the numbers hold no measurements.
    """
    if len(rest) <= _BLOCK or not np.any(rest):
        return 0.0, None, ()
    voltage, *pulses = rest[:_BLOCK].tolist()
    numbers = dict(zip([entry.name for entry in fields(Esc)], pulses, strict=True))
    direction = round(numbers.pop("direction"))
    esc = Esc(**numbers, direction=direction) if direction else None
    block = block_of(rest)
    return voltage, esc, unpack_sheets(block) if block.size else ()


def block_of(rest: Array) -> Array:
    """Block of the sheets in the numbers of `pack_measured`; empty without sheets."""
    sheets = len(rest) > _BLOCK and rest[_BLOCK] != 0.0
    return np.array(rest[_BLOCK:]) if sheets else np.zeros(0)


@kernel
def least_voltage(block):
    """Least voltage [V] of a block."""
    return block[_VOLTS]


@kernel
def _weights(block, voltage):
    """Sheets below and above `voltage` [V], with the weights of the upper sheet.

    Returns:
        Indices of both, the weight that is linear in the voltage, and the weight linear in its
            square.
    """
    count = int(block[_SHEETS])
    if count == 1:
        return 0, 0, 0.0, 0.0

    low = 0
    while low < count - 2 and block[_VOLTS + low + 1] < voltage:
        low += 1
    v0 = block[_VOLTS + low]
    v1 = block[_VOLTS + low + 1]
    v = min(max(voltage, v0), v1)
    return low, low + 1, (v - v0) / (v1 - v0), (v * v - v0 * v0) / (v1 * v1 - v0 * v0)


@kernel
def _mixed(y0, y1, full0, full1, linear, square):
    """A value between two sheets: its interpolated share of the full value, times the full value at
    the voltage.
    """
    if full0 == 0.0 or full1 == 0.0:
        return (1.0 - linear) * y0 + linear * y1
    full = (1.0 - linear) * full0 + linear * full1
    return full * ((1.0 - square) * y0 / full0 + square * y1 / full1)


@kernel
def blend(block, voltage, curves):
    """Write commands, thrusts [N] and currents [A] at a voltage [V] to `curves` (3, points)."""
    n = int(block[POINTS])
    low, high, linear, square = _weights(block, voltage)
    first = _VOLTS + int(block[_SHEETS])
    a = first + 3 * n * low
    b = first + 3 * n * high

    for j in range(n):
        curves[0, j] = (1.0 - linear) * block[a + j] + linear * block[b + j]

    # Thrusts and currents: the full value of each side is that of its end.
    for row in range(1, 3):
        a += n
        b += n
        for j in range(n):
            end = 0 if block[first + n + j] < 0.0 else n - 1
            curves[row, j] = _mixed(
                block[a + j], block[b + j], block[a + end], block[b + end], linear, square
            )


@kernel
def current_at(block, voltage, command):
    """Current [A] at a voltage [V] and a command in [-1, 1], linear between the points."""
    n = int(block[POINTS])
    low, high, linear, square = _weights(block, voltage)
    first = _VOLTS + int(block[_SHEETS])
    a = first + 3 * n * low
    b = first + 3 * n * high

    # Find the segment, at this voltage.
    at = 0
    x0 = (1.0 - linear) * block[a] + linear * block[b]
    x1 = (1.0 - linear) * block[a + 1] + linear * block[b + 1]
    while at < n - 2 and x1 < command:
        at += 1
        x0 = x1
        x1 = (1.0 - linear) * block[a + at + 1] + linear * block[b + at + 1]

    # Values at its ends.
    side = 0 if block[first + n + at] < 0.0 else n - 1
    full0 = block[a + 2 * n + side]
    full1 = block[b + 2 * n + side]
    i0 = _mixed(block[a + 2 * n + at], block[b + 2 * n + at], full0, full1, linear, square)
    i1 = _mixed(block[a + 2 * n + at + 1], block[b + 2 * n + at + 1], full0, full1, linear, square)
    share = min(max((command - x0) / (x1 - x0), 0.0), 1.0)
    return i0 + share * (i1 - i0)
