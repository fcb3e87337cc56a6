"""Inputs of an operator over time: velocities of hull and tool, set force, clutch; from a CSV file.

A row is valid until the next row. Only the time of the last row is used, at which the inputs end.
"""

import csv
import io
import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import Array, finite_number, shown

LONGEST = 3600.0  # [s] largest length of inputs
_MOST_BYTES = 50_000_000  # largest size of a file
_HULL = 0.25  # [m/s]
_YAW = 0.15  # [rad/s]
_TOOL = 0.1  # [m/s]
_TURN = 0.3  # [rad/s]
_FORCE = 120.0  # [N]


class InputColumn(NamedTuple):
    """A column of the file, with the bounds of its values."""

    unit: str
    least: float
    most: float
    optional: bool = False


COLUMNS = {
    "time": InputColumn("s", 0.0, LONGEST),
    # hull, along its own axes: forward, left, up; turn about the vertical
    "surge": InputColumn("m/s", -_HULL, _HULL),
    "sway": InputColumn("m/s", -_HULL, _HULL),
    "heave": InputColumn("m/s", -_HULL, _HULL),
    "yaw_rate": InputColumn("rad/s", -_YAW, _YAW),
    # tool relative to the hull, along its own axes; z is the tool axis, outwards
    "tool_x": InputColumn("m/s", -_TOOL, _TOOL),
    "tool_y": InputColumn("m/s", -_TOOL, _TOOL),
    "tool_z": InputColumn("m/s", -_TOOL, _TOOL),
    # force along the tool axis, 0: free; the clutch is 1 closed, 0 open
    "set_force": InputColumn("N", 0.0, _FORCE),
    "clutch": InputColumn("-", 0.0, 1.0),
    # turns of the tool about its own axes
    "turn_x": InputColumn("rad/s", -_TURN, _TURN, optional=True),
    "turn_y": InputColumn("rad/s", -_TURN, _TURN, optional=True),
    "turn_z": InputColumn("rad/s", -_TURN, _TURN, optional=True),
}
_NAMES = tuple(COLUMNS)


class OperatorInput(NamedTuple):
    """Requests of the operator at one time."""

    hull: Array  # (4,) [m/s, rad/s] surge, sway, heave, yaw rate
    tool: Array  # (3,) [m/s] velocity of the tool relative to the hull, tool axes
    turn: Array  # (3,) [rad/s] angular velocity of the tool relative to the hull, tool axes
    set_force: float  # [N] along the tool axis; 0: free
    clutch: bool  # True: closed; open: the vehicle comes to rest, and holds its pose and force


OPEN = OperatorInput(np.zeros(4), np.zeros(3), np.zeros(3), 0.0, False)


class OperatorInputs:
    """Inputs over time, from a file or as they arrive."""

    def __init__(self, rows: Iterable[Sequence[float]] = (), *, ended: bool = True) -> None:
        """Set up the inputs.

        Args:
            rows: numbers in the order of COLUMNS, with increasing times.
            ended: False: more rows follow, and the last row is valid until then.
        """
        self.rows = [tuple(row) for row in rows]
        self._times = [row[0] for row in self.rows]
        self.ended = ended

    @property
    def duration(self) -> float:
        """Time [s] at which the inputs end; inf if it is not known yet."""
        return self._times[-1] if self.ended else math.inf

    @property
    def largest_force(self) -> float:
        """Largest set force [N]; the largest allowed one while more rows follow."""
        if not self.ended:
            return COLUMNS["set_force"].most
        return max((row[_NAMES.index("set_force")] for row in self.rows[:-1]), default=0.0)

    def poll(self, time: float) -> None:
        """Add the rows that arrived until `time` [s]; a file has all its rows already."""

    def add(self, row: Sequence[float]) -> None:
        """Append a row, in the order of COLUMNS."""
        self.rows.append(tuple(row))
        self._times.append(row[0])

    def at(self, time: float) -> OperatorInput | None:
        """Inputs at `time` [s], with an open clutch before the first row; None from the end on."""
        if self.ended and time >= self._times[-1]:
            return None

        k = bisect_right(self._times, time) - 1
        if k < 0:
            return OPEN
        row = np.array(self.rows[k])
        return OperatorInput(row[1:5], row[5:8], row[10:13], float(row[8]), bool(row[9]))

    @classmethod
    def read(cls, file: str | Path) -> Self:
        """Inputs from a CSV file whose header has COLUMNS in any order.

        Raises:
            ConfigurationError: The file cannot be read, a column is missing or unknown, or a number
                is out of bounds; the message names line and column.
        """
        what = f"inputs {shown(str(file))}"
        table = csv.reader(io.StringIO(text_of(file, "inputs", _MOST_BYTES)), strict=True)
        rows: list[list[float]] = []
        order: list[str] = []

        # The header, then the rows; empty lines are skipped
        try:
            for cells in table:
                words = [cell.strip() for cell in cells]
                if not any(words):
                    continue
                if not order:
                    order = _head(words, what)
                    continue

                rows.append(_row(words, order, f"{what}, line {table.line_num}"))
                _check_time(rows, f"{what}, line {table.line_num}")
        except csv.Error as error:
            raise ConfigurationError(f"{what}, line {table.line_num}: {error}") from error

        if len(rows) < 2:
            raise ConfigurationError(f"{what}: must have at least two rows, got {len(rows)}")
        return cls(rows)

    def kept(self) -> list[tuple[float, ...]]:
        """Rows of a file that repeats the inputs."""
        return self.rows

    def text(self) -> str:
        """Content of a file from which `read` restores the same inputs, to the bit."""
        lines = [",".join(repr(float(number)) for number in row) for row in self.kept()]
        return "\n".join([",".join(_NAMES), *lines, ""])


def _head(words: list[str], what: str) -> list[str]:
    """Names of the columns."""
    unknown = [word for word in words if word not in COLUMNS]
    missing = [
        name for name, column in COLUMNS.items() if not column.optional and name not in words
    ]

    # The first fault is reported
    if unknown or missing or len(set(words)) < len(words):
        trouble = (
            f"no column {shown(unknown[0])}"
            if unknown
            else f"column {missing[0]} is missing"
            if missing
            else "a column occurs twice"
        )
        raise ConfigurationError(f"{what}: {trouble}; the columns are {', '.join(_NAMES)}")
    return words


def _row(words: list[str], order: list[str], where: str) -> list[float]:
    """Numbers in the order of COLUMNS, of a row in the order of the file."""
    if len(words) != len(order):
        raise ConfigurationError(f"{where}: must have {len(order)} numbers, got {len(words)}")

    numbers = dict.fromkeys(_NAMES, 0.0)
    for name, word in zip(order, words, strict=True):
        column = COLUMNS[name]
        label = f"{where}: {name} [{column.unit}]"
        try:
            number = float(word)
        except ValueError:
            raise ConfigurationError(f"{label}: must be a number, got {shown(word)}") from None
        numbers[name] = finite_number(number, label, least=column.least, most=column.most)

    if numbers["clutch"] not in (0.0, 1.0):
        raise ConfigurationError(
            f"{where}: clutch: must be 0 (open) or 1 (closed), got {numbers['clutch']:g}"
        )
    return list(numbers.values())


def _check_time(rows: list[list[float]], where: str) -> None:
    if len(rows) > 1 and not rows[-1][0] > rows[-2][0]:
        raise ConfigurationError(
            f"{where}: time [s]: must increase, got {rows[-1][0]:g} after {rows[-2][0]:g}"
        )
