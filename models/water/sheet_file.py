"""A thruster's table from its maker: CSV of thrust and current over pulse width and voltage.

The columns are `pulse_us` and `force_N`, and optionally `voltage_V`, `current_A` or `power_W`.
Other columns, such as `rpm`, are ignored. A table has one sheet for each of its voltages.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uuv.models.water.thruster_sheets import Esc, Sheet
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import Array, shown

PULSE = "pulse_us"
FORCE = "force_N"
VOLTAGE = "voltage_V"
CURRENT = "current_A"
POWER = "power_W"

_MOST_BYTES = 5_000_000  # largest size of a file
_MOST_SHEETS = 40  # largest number of sheets of a table
_MOST_POINTS = 5000  # largest number of rows of a sheet
# largest fall of the thrust towards the ends that counts as noise and is pooled, as a share of the
# full thrust
_NOISE = 0.01
_FEW = 40  # number of points of a side up to which all are kept
# points kept of a longer side, besides the first: shares of the range from the dead band to the end
_SHARES = np.arange(1, 21) / 20
_SAME = 1e-6  # difference below which two shares count as equal
_OFF = 0.05  # largest relative difference of power from voltage times current


def read_sheets(
    file: str | Path, esc: Esc | None = None, voltage: float | None = None
) -> tuple[tuple[Sheet, ...], Esc]:
    """Sheets of a table, lowest voltage first, and the speed controller of its pulses.

    If the thrust falls as the pulse rises, the controller's direction is -1. A side of more than 40
    points is reduced to 21 points; the resulting error of the thrust is far less than 1 % of full
    thrust.

    Args:
        file: CSV with a header line.
        esc: range, dead band and direction of the pulses; default: the range of the table, with
            neutral at 1500 us or, if there is thrust at that pulse, at the middle of the dead band.
        voltage: [V] at which a table without that column was measured; None: unknown, which is a
            sheet of 0 V without currents.

    Raises:
        ConfigurationError: a column is missing, a cell is not a finite number, a pulse occurs
            twice, the thrusts do not rise from below zero through zero, or a pulse is beyond the
            range.
    """
    what = f"thruster table {shown(str(file))}"
    columns = _columns(text_of(file, "thruster table", _MOST_BYTES), what)
    stated = VOLTAGE in columns
    if not stated:
        columns[VOLTAGE] = np.full(len(columns[PULSE]), 0.0 if voltage is None else voltage)
    if voltage is None and not stated and (POWER in columns or CURRENT in columns):
        raise ConfigurationError(
            f"{what}: {CURRENT} and {POWER} need the column {VOLTAGE}, or the argument voltage"
        )

    volts = columns[VOLTAGE]
    levels = np.unique(volts)
    if len(levels) > _MOST_SHEETS or levels[0] < 0.0 or (stated and levels[0] == 0.0):
        raise ConfigurationError(
            f"{what}: {VOLTAGE} must have 1 to {_MOST_SHEETS} values above zero, got "
            f"{len(levels)} from {levels[0]:g} V"
        )

    # One sheet per voltage, with pulses in place of commands; a falling thrust is reversed.
    raw: list[_Rows] = []
    for level in levels.tolist():
        rows = {name: column[volts == level] for name, column in columns.items()}
        order = np.argsort(rows[PULSE], kind="stable")
        rows = {name: column[order] for name, column in rows.items()}
        name = f"{what}, {level:g} V" if level else what
        raw.append(_Rows(name, level, _current(rows, name), rows[PULSE], rows[FORCE]))
    falls = {entry.force[-1] < entry.force[0] for entry in raw}
    if len(falls) > 1:
        raise ConfigurationError(f"{what}: the thrust rises at one voltage and falls at another")

    esc = _esc_of(raw, falls.pop(), what) if esc is None else esc
    sheets = [_sheet(entry, esc) for entry in raw]
    return _of_one_size(sheets), esc


class _Rows(NamedTuple):
    """Rows of one voltage, in the order of their pulses."""

    what: str  # first words of a message
    voltage: float  # [V]
    current: Array | None  # [A]
    pulse: Array  # [us]
    force: Array  # [N]


def _columns(text: str, what: str) -> dict[str, Array]:
    """Columns of numbers by name."""
    reader = csv.reader(io.StringIO(text))
    try:
        heading, *table = list(reader) or [[]]
    except csv.Error as error:  # a quote that is not closed
        raise ConfigurationError(
            f"{what}, line {reader.line_num}: cannot be read as CSV ({error})"
        ) from error

    heading = [word.strip() for word in heading]
    for name in (PULSE, FORCE):
        if name not in heading:
            near = did_you_mean(name, heading) or f"; its columns are {', '.join(heading)}"
            raise ConfigurationError(f"{what}: column {name} is missing{near}")

    used = [name for name in (PULSE, FORCE, VOLTAGE, CURRENT, POWER) if name in heading]
    if twice := [name for name in used if heading.count(name) > 1]:
        raise ConfigurationError(f"{what}: column {twice[0]} occurs twice")

    rows = []
    for line, cells in enumerate(table, start=2):
        if not any(cell.strip() for cell in cells):
            continue
        try:
            row = [float(cells[heading.index(name)]) for name in used]
        except (ValueError, IndexError):
            row = [np.nan]
        if not np.isfinite(row).all():
            raise ConfigurationError(
                f"{what}, line {line}: must have finite numbers for {', '.join(used)}, got "
                f"{shown(','.join(cells))}"
            )
        rows.append(row)

    if not 3 <= len(rows) <= _MOST_SHEETS * _MOST_POINTS:
        raise ConfigurationError(f"{what}: must have three or more rows, got {len(rows)}")
    return dict(zip(used, np.array(rows).T, strict=True))


def _current(rows: dict[str, Array], what: str) -> Array | None:
    """Currents [A] of a sheet, measured or from the power; None if it has neither."""
    by_power = rows[POWER] / rows[VOLTAGE] if POWER in rows else None
    current = rows.get(CURRENT, by_power)
    if current is not None and current.min() < 0.0:
        raise ConfigurationError(f"{what}: {CURRENT} and {POWER} must be >= 0")

    if current is None or by_power is None:
        return current
    if np.abs(current - by_power).max() > _OFF * max(float(current.max()), 1e-9):
        raise ConfigurationError(f"{what}: {POWER} must be {VOLTAGE} times {CURRENT}, but is not")
    return current


def _esc_of(raw: Sequence[_Rows], falls: bool, what: str) -> Esc:
    """Speed controller over the range that all sheets have, with neutral at a pulse without
    thrust.
    """
    low = max(float(entry.pulse[0]) for entry in raw)
    high = min(float(entry.pulse[-1]) for entry in raw)

    # Neutral is where no sheet has thrust; if no row has zero thrust, where the thrust changes its
    # sign.
    still = [entry.pulse[entry.force == 0.0] for entry in raw]
    if all(len(pulses) for pulses in still):
        first = max(float(pulses[0]) for pulses in still)
        last = min(float(pulses[-1]) for pulses in still)
    else:
        order = np.argsort(raw[0].force, kind="stable")
        first = last = float(np.interp(0.0, raw[0].force[order], raw[0].pulse[order]))

    neutral = 1500.0 if first <= 1500.0 <= last else 0.5 * (first + last)
    if not low + 1.0 < neutral < high - 1.0:
        raise ConfigurationError(
            f"{what}: thrusts must rise from below zero through zero, or fall from above zero "
            "through zero"
        )
    return Esc(low_us=low, neutral_us=neutral, high_us=high, direction=-1 if falls else 1)


def _sheet(raw: _Rows, esc: Esc) -> Sheet:
    """Sheet of rows in the order of their pulses; rows beyond the range are left out."""
    what = raw.what
    pulse = raw.pulse
    if twice := pulse[1:][np.diff(pulse) <= 0.0].tolist():
        raise ConfigurationError(f"{what}: pulse {twice[0]:g} us occurs twice")

    inside = (pulse >= esc.low_us) & (pulse <= esc.high_us)
    if np.count_nonzero(inside) < 3:
        raise ConfigurationError(
            f"{what}: must have three or more rows within the range of the ESC"
        )

    # Rows x, y, i: command, thrust [N], current [A].
    amperes = np.zeros(len(pulse)) if raw.current is None else raw.current
    rows = np.array([esc.command(pulse[inside]), raw.force[inside], amperes[inside]])
    rows = rows[:, np.argsort(rows[0], kind="stable")]
    _check_rise(what, rows, esc)
    x, y, i = _with_dead_band(_without_noise(rows)).tolist()
    return Sheet(
        voltage=raw.voltage,
        command=tuple(x),
        thrust=tuple(y),
        current=() if raw.current is None else tuple(i),
    )


def _check_rise(what: str, rows: Array, esc: Esc) -> None:
    """Refuse thrusts that do not rise from below zero to above zero, except for noise."""
    x, y, _ = rows
    if not y[0] < 0.0 < y[-1]:
        raise ConfigurationError(
            f"{what}: {FORCE} must rise from below zero through zero, or fall from above zero "
            f"through zero, got {y[0]:g} to {y[-1]:g}"
        )

    falls = y[:-1] - y[1:]
    worst = int(falls.argmax())
    if falls[worst] > _NOISE * np.abs(y).max():
        at = float(esc.pulse(float(np.clip(x[worst], -1.0, 1.0))))
        raise ConfigurationError(
            f"{what}: {FORCE} must rise throughout, or fall, but turns at {at:g} us, from "
            f"{y[worst]:g} to {y[worst + 1]:g}"
        )


def _without_noise(rows: Array) -> Array:
    """Rows with neighbours pooled until thrusts outside the dead band rise; the end points keep
    their pulses.

    This is isotonic regression by the pool-adjacent-violators algorithm.
    """
    pools: list[list[Array]] = []
    for point in rows.T:
        pools.append([point])
        while len(pools) > 1 and _falls(pools[-2], pools[-1]):
            pools[-2:] = [pools[-2] + pools[-1]]

    pooled = np.array([np.mean(pool, axis=0) for pool in pools]).T
    pooled[0, 0] = rows[0, 0]
    pooled[0, -1] = rows[0, -1]
    return pooled


def _falls(before: Sequence[Array], after: Sequence[Array]) -> bool:
    first, second = (float(np.mean(pool, axis=0)[1]) for pool in (before, after))
    return second < first or (second == first and second != 0.0)


def _with_dead_band(rows: Array) -> Array:
    """Rows in which the dead band is reduced to its two ends, or to one point if it is a single
    point.
    """
    y = rows[1]
    below = rows[:, y < 0.0]
    above = rows[:, y > 0.0]
    still = rows[:, y == 0.0]
    if not still.size:
        a = below[:, -1]
        b = above[:, 0]
        still = (a + (b - a) * (-a[1] / (b[1] - a[1])))[:, None]
        still[1] = 0.0
    edges = still if still.shape[1] == 1 else still[:, [0, -1]]
    return np.hstack([below, edges, above])


def _of_one_size(sheets: Sequence[Sheet]) -> tuple[Sheet, ...]:
    """Sheets with points at equal fractions of the range between dead band and end."""
    shares = [_shares(sheet) for sheet in sheets]
    few = max(len(side) for pair in shares for side in pair) <= _FEW
    like = all(
        len(side) == len(first) and np.allclose(side, first, atol=_SAME)
        for pair in shares
        for side, first in zip(pair, shares[0], strict=True)
    )
    edges = {np.count_nonzero(np.array(sheet.thrust) == 0.0) for sheet in sheets}
    if few and like and len(edges) == 1:
        return tuple(sheets)

    # All shares of all sheets, or a grid.
    grids = []
    for side in range(2):
        every = np.sort(np.concatenate([pair[side] for pair in shares]))
        every = every[np.append(np.diff(every) > _SAME, True)]
        if len(every) > _FEW:
            every = np.array([every[0], *_SHARES[every[0] + _SAME < _SHARES]])
        grids.append(every)
    return tuple(_on_grid(sheet, *grids) for sheet in sheets)


def _shares(sheet: Sheet) -> tuple[Array, Array]:
    """Shares in (0, 1] of the points astern and ahead, in rising order."""
    x = np.array(sheet.command)
    y = np.array(sheet.thrust)
    still = x[y == 0.0]
    astern = (still[0] - x[y < 0.0]) / (still[0] - x[0])
    ahead = (x[y > 0.0] - still[-1]) / (x[-1] - still[-1])
    return astern[::-1], ahead


def _on_grid(sheet: Sheet, astern: Array, ahead: Array) -> Sheet:
    """The sheet at other shares, by the curve through its points."""
    # imported here, since it imports numba
    from uuv.models.water.thruster_curves import pack_table, thrust_at

    x = np.array(sheet.command)
    y = np.array(sheet.thrust)
    still = x[y == 0.0]
    # A single point becomes two if another sheet has a dead band there.
    width = _SAME if still[0] == still[-1] else 0.0
    low = still[0] - width
    high = still[-1] + width

    # Ends are unchanged, to the bit.
    points = np.concatenate(
        [low + astern[::-1] * (x[0] - low), [low, high], high + ahead * (x[-1] - high)]
    )
    points[0] = x[0]
    points[-1] = x[-1]
    curve = pack_table(sheet.command, sheet.thrust, 0.0)
    thrust = [float(thrust_at(curve, at)) for at in points.tolist()]
    thrust[len(astern)] = thrust[len(astern) + 1] = 0.0

    current = np.interp(points, x, sheet.current) if sheet.current else np.zeros(0)
    return replace(
        sheet, command=tuple(points.tolist()), thrust=tuple(thrust), current=tuple(current.tolist())
    )
