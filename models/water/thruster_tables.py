"""Thrusters as bought: thrust and electrical power over pulse width and voltage, from tables.

    T200.thrust(1700.0, 14.8)         # [N]
    T200.points(14.8)                 # pulses and thrusts, of which a `Thruster` is made
    table = ThrusterTable.of_csv("my_thruster.csv")

Between voltages the dead band's edges are interpolated, and the thrust at the same share of the
pulse beyond them; along the pulse the curve is a monotone cubic [Fritsch 1984].
"""

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.documents import named
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import Array, finite_number, readonly

_COLUMNS = ("pulse_us", "force_N")  # needed of a file
_SMALL = 1e-6  # [N] below which a propeller stands still
_STEP = 4.0  # [us] between the edge of a dead band and its last pulse without thrust
_SHARES = 41  # of the pulse beyond the dead band, at which a file's curve is kept


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrusterTable:
    """Thrust, and power where it is known, of one thruster at several voltages.

    Raises:
        ConfigurationError: voltages or thrusts that do not rise.
    """

    name: str  # with which errors begin
    voltages: Array  # (k,) [V], rising
    ends: Array  # (2,) [us] pulses of full thrust astern and ahead
    edges: Array  # (k, 2) [us] pulses at which the propeller begins to turn
    shares: Array  # (s,) from 0 at the edge to 1 at the end
    astern: Array  # (k, s) [N] magnitude
    ahead: Array  # (k, s) [N]
    power: Array | None = None  # (k, 2, s) [W] astern and ahead

    def __post_init__(self) -> None:
        if not np.all(np.diff(self.voltages) > 0.0):
            raise ConfigurationError(f"{self.name}: voltages must rise")
        for side, thrusts in (("astern", self.astern), ("ahead", self.ahead)):
            for voltage, row in zip(self.voltages, thrusts, strict=True):
                if not np.all(np.diff(row) > 0.0):
                    raise ConfigurationError(
                        f"{self.name}: at {voltage:g} V the thrust {side} does not rise with the "
                        "pulse"
                    )

    @classmethod
    def of_csv(cls, file: str | Path) -> Self:
        """Read a maker's table: columns pulse_us, force_N, and voltage_V, power_W where known.

        Without voltage_V the table holds at one unknown voltage, 0.

        Raises:
            ConfigurationError: the file cannot be read, lacks a column, or has a number that is
                none; or its thrusts do not rise.
        """
        name = named(file, "thruster table")
        rows = list(csv.DictReader(io.StringIO(text_of(file, "thruster table"))))
        columns = tuple(rows[0]) if rows else ()

        if lacking := [column for column in _COLUMNS if column not in columns]:
            raise ConfigurationError(
                f"{name}: needs the columns {', '.join(_COLUMNS)}; it lacks {', '.join(lacking)}"
            )

        figures = {column: _numbers(rows, column, name) for column in _COLUMNS}
        voltages = np.zeros(len(rows))
        if "voltage_V" in columns:
            voltages = _numbers(rows, "voltage_V", name)
        power = _numbers(rows, "power_W", name) if "power_W" in columns else None

        return cls._of_rows(name, voltages, figures["pulse_us"], figures["force_N"], power)

    @classmethod
    def _of_rows(
        cls, name: str, voltages: Array, pulses: Array, forces: Array, power: Array | None
    ) -> Self:
        levels = np.unique(voltages)
        ends = np.array([pulses.min(), pulses.max()])
        shares = np.linspace(0.0, 1.0, _SHARES)
        edges = np.zeros((len(levels), 2))
        sides = np.zeros((len(levels), 2, _SHARES))
        powers = np.zeros_like(sides)

        for i, level in enumerate(levels):
            of_level = np.flatnonzero(voltages == level)
            of_level = of_level[np.argsort(pulses[of_level])]
            pulse = pulses[of_level]
            force = forces[of_level]
            if not (np.any(force > _SMALL) and np.any(force < -_SMALL)):
                raise ConfigurationError(f"{name}: at {level:g} V it has thrust one way only")

            edges[i] = pulse[force < -_SMALL].max(), pulse[force > _SMALL].min()
            for side, end in enumerate(ends):
                at = edges[i, side] + shares * (end - edges[i, side])
                sides[i, side] = np.abs(np.interp(at, pulse, force))
                if power is not None:
                    powers[i, side] = np.interp(at, pulse, power[of_level])

        return cls(
            name=name,
            voltages=readonly(levels),
            ends=readonly(ends),
            edges=readonly(edges),
            shares=readonly(shares),
            astern=readonly(sides[:, 0]),
            ahead=readonly(sides[:, 1]),
            power=None if power is None else readonly(powers),
        )

    @property
    def neutral(self) -> float:
        """Pulse [us] in the middle, without thrust."""
        return float(self.ends.mean())

    def thrust(self, pulse_us: ArrayLike, voltage: float) -> Array:
        """Thrust [N] at pulses [us] and a voltage [V]; beyond the ends that of the end.

        Raises:
            ConfigurationError: a voltage outside the table.
        """
        at = self._between(voltage)
        astern = self._curve(at @ self.edges, at @ self.astern, 0, pulse_us)

        return self._curve(at @ self.edges, at @ self.ahead, 1, pulse_us) - astern

    def power_at(self, pulse_us: ArrayLike, voltage: float) -> Array:
        """Electrical power [W] at pulses [us] and a voltage [V].

        Raises:
            ConfigurationError: a voltage outside the table, or a table without power.
        """
        if self.power is None:
            raise ConfigurationError(f"{self.name}: it has no power")
        at = self._between(voltage)
        rows = np.tensordot(at, self.power, axes=1)

        astern = self._curve(at @ self.edges, rows[0], 0, pulse_us)
        return astern + self._curve(at @ self.edges, rows[1], 1, pulse_us)

    def points(self, voltage: float) -> tuple[Array, Array]:
        """Pulses (p,) [us] and thrusts (p,) [N] at a voltage [V], the dead band's ends among them.

        Raises:
            ConfigurationError: a voltage outside the table.
        """
        at = self._between(voltage)
        low, high = at @ self.edges
        back = low - self.shares[::-1] * (low - self.ends[0])
        onward = high + self.shares * (self.ends[1] - high)
        still = [low + _STEP, high - _STEP]
        thrusts = [-(at @ self.astern)[::-1], np.zeros(2), at @ self.ahead]

        return np.concatenate([back, still, onward]), np.concatenate(thrusts)

    def least(self, voltage: float) -> float:
        """Least thrust [N] of a turning propeller at a voltage [V]."""
        at = self._between(voltage)
        return float(min((at @ self.astern)[0], (at @ self.ahead)[0]))

    def _between(self, voltage: float) -> Array:
        """Weights (k,) of the table's voltages at another one."""
        subject = f"{self.name}: voltage [V]"
        least = float(self.voltages[0])
        level = finite_number(voltage, subject, least=least, most=float(self.voltages[-1]))
        return np.array(
            [np.interp(level, self.voltages, row) for row in np.eye(len(self.voltages))]
        )

    def _curve(self, edges: Array, row: Array, side: int, pulse_us: ArrayLike) -> Array:
        """A row (s,) at pulses on one side of the dead band, 0 on the other."""
        from scipy.interpolate import PchipInterpolator

        pulse = np.asarray(pulse_us, dtype=np.float64)
        share = (pulse - edges[side]) / (self.ends[side] - edges[side])
        inside = np.clip(share, 0.0, 1.0)
        return np.where(share >= 0.0, PchipInterpolator(self.shares, row)(inside), 0.0)


def _numbers(rows: list[dict[str, str]], column: str, name: str) -> Array:
    """A column of a file.

    Raises:
        ConfigurationError: a cell that is no number.
    """
    try:
        numbers = np.array([float(row[column]) for row in rows])
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{name}: column {column}: numbers are missing") from error

    if not np.isfinite(numbers).all():
        raise ConfigurationError(f"{name}: column {column}: must be finite")

    return numbers


# [BlueRobotics 2019], sheets of 10, 14, 16 and 20 V, at shares of the pulse beyond the dead band.
T200 = ThrusterTable(
    name="t200",
    voltages=readonly([10.0, 14.0, 16.0, 20.0]),
    ends=readonly([1100.0, 1900.0]),
    edges=readonly([[1456.0, 1544.0], [1464.0, 1536.0], [1468.0, 1532.0], [1472.0, 1532.0]]),
    shares=readonly([0.0, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0]),
    astern=readonly(
        [
            [0.31, 1.49, 3.97, 6.98, 10.53, 14.51, 18.78, 22.65],
            [0.31, 2.07, 6.01, 10.46, 15.51, 21.99, 28.48, 34.49],
            [0.36, 2.36, 6.67, 11.71, 18.06, 25.12, 33.42, 39.91],
            [0.36, 2.67, 6.83, 12.56, 20.12, 28.23, 39.46, 49.38],
        ]
    ),
    ahead=readonly(
        [
            [0.40, 1.76, 4.92, 8.91, 13.28, 18.20, 23.91, 28.69],
            [0.44, 2.61, 7.42, 13.15, 19.70, 27.95, 36.44, 44.36],
            [0.40, 2.91, 8.54, 14.97, 22.94, 31.88, 42.36, 51.44],
            [0.58, 3.61, 8.45, 15.42, 25.24, 36.04, 51.39, 65.92],
        ]
    ),
    power=readonly(
        [
            [
                [0.5, 2.0, 8.2, 20.6, 40.9, 66.7, 100.9, 136.2],
                [0.5, 2.0, 8.6, 21.6, 41.9, 67.8, 101.3, 136.0],
            ],
            [
                [0.7, 2.9, 16.4, 43.1, 80.9, 137.9, 208.3, 289.9],
                [0.7, 2.9, 17.8, 44.0, 81.4, 138.3, 205.3, 285.0],
            ],
            [
                [0.8, 3.5, 20.8, 53.6, 102.9, 175.4, 273.7, 388.8],
                [0.8, 3.5, 20.8, 55.4, 105.3, 177.0, 273.0, 381.3],
            ],
            [
                [1.0, 4.6, 25.8, 72.5, 158.7, 265.3, 433.4, 643.5],
                [1.0, 6.4, 26.0, 73.5, 159.4, 263.8, 426.9, 624.2],
            ],
        ]
    ),
)
