"""Thrust and current of a thruster as its maker measured them, one sheet for each voltage, and its
ESC.

`uuv.models.water.sheet_kernels` interpolates between sheets, `sheet_file` reads them from a file.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, number, real_array, whole_number

_MOST_VOLTS = 1000.0  # [V]
_MOST_US = 1e5  # [us]
_LEAST_SPAN = 1.0  # [us] least distance between neutral and an end


@dataclass(frozen=True, slots=True, kw_only=True)
class Esc:
    """Electronic speed controller: pulse width to command, a share of full speed.

    Raises:
        ConfigurationError: the pulses do not rise, or the dead band leaves no range.
    """

    low_us: float = 1100.0  # [us] pulse of full speed on one side
    neutral_us: float = 1500.0
    high_us: float = 1900.0  # [us] pulse of full speed on the other
    # [us] half width of the range about neutral in which the controller gives no speed
    dead_band_us: float = 0.0
    direction: int = 1  # +1: pulses above neutral give thrust ahead; -1: astern

    def __post_init__(self) -> None:
        for name in ("low_us", "neutral_us", "high_us", "dead_band_us"):
            pulse = finite_number(getattr(self, name), f"esc {name}", least=0.0, most=_MOST_US)
            object.__setattr__(self, name, pulse)
        if whole_number(self.direction, "esc direction", least=-1, most=1) == 0:
            raise ConfigurationError("esc direction: must be 1 or -1, got 0")

        span = min(self.neutral_us - self.low_us, self.high_us - self.neutral_us)
        if not span >= self.dead_band_us + _LEAST_SPAN:
            raise ConfigurationError(
                "esc: must have low_us < neutral_us < high_us with room for the dead band, got "
                f"{self.low_us:g}, {self.neutral_us:g}, {self.high_us:g} and {self.dead_band_us:g}"
            )

    def command(self, pulse_us: ArrayLike) -> Array:
        """Commands in [-1, 1] of pulses [us], of the same shape.

        Raises:
            ConfigurationError: a pulse is beyond the range.
        """
        pulse = real_array(pulse_us, "pulse [us]")
        # NaN is beyond the range too
        beyond = ~((pulse >= self.low_us) & (pulse <= self.high_us))
        if np.any(beyond):
            raise ConfigurationError(
                f"pulse [us]: must be {self.low_us:g} to {self.high_us:g}, got "
                f"{float(pulse[beyond].flat[0]):g}"
            )

        offset = pulse - self.neutral_us
        span = np.where(offset > 0.0, self.high_us - self.neutral_us, self.neutral_us - self.low_us)
        still = np.abs(offset) < self.dead_band_us
        return np.where(still, 0.0, self.direction * offset / span)

    def pulse(self, command: ArrayLike) -> Array:
        """Pulses [us] of commands in [-1, 1], of the same shape.

        Raises:
            ConfigurationError: a command is beyond [-1, 1].
        """
        share = real_array(command, "command")
        if not np.all(np.abs(share) <= 1.0):
            raise ConfigurationError(f"command: must be in [-1, 1], got {share.tolist()}")
        turn = self.direction * share
        above = self.high_us - self.neutral_us
        return self.neutral_us + turn * np.where(turn > 0.0, above, self.neutral_us - self.low_us)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Thrust and current in still water at one voltage.

    Raises:
        ConfigurationError: the voltage is out of range, the rows differ in length, or a current is
            negative or not finite. The thrusts are checked later, with the curve that is made of
            them.
    """

    voltage: float  # [V] at the ESC; 0: unknown
    command: tuple[float, ...]  # (k,) in [-1, 1], rising; two or more are without thrust
    thrust: tuple[float, ...]  # (k,) [N]
    current: tuple[float, ...] = ()  # (k,) [A]; empty if not measured

    def __post_init__(self) -> None:
        volts = finite_number(self.voltage, "sheet voltage [V]", least=0.0, most=_MOST_VOLTS)
        object.__setattr__(self, "voltage", volts)
        for name in ("command", "thrust", "current"):
            row = tuple(number(x, f"sheet {name}") for x in getattr(self, name))
            object.__setattr__(self, name, row)

        if not len(self.command) == len(self.thrust) == (len(self.current) or len(self.thrust)):
            raise ConfigurationError(
                f"sheet of {self.voltage:g} V: command, thrust and current must have the same "
                f"length, got {len(self.command)}, {len(self.thrust)} and {len(self.current)}"
            )
        if not all(0.0 <= amperes < np.inf for amperes in self.current):
            raise ConfigurationError(
                f"sheet of {self.voltage:g} V: currents must be finite and >= 0 A, got "
                f"{list(self.current)}"
            )

    def stronger(self, gain: float) -> Self:
        """The sheet with `gain` times its thrust, at the same current."""
        thrust = tuple(gain * newtons for newtons in self.thrust)
        return type(self)(
            voltage=self.voltage, command=self.command, thrust=thrust, current=self.current
        )


def check_sheets(sheets: Sequence[Sheet], voltage: float) -> None:
    """Refuse sheets that do not match each other, or do not cover a voltage [V].

    Raises:
        ConfigurationError: the voltages do not rise, the sheets differ in size or kind, or
            `voltage` is beyond them.
    """
    volts = [sheet.voltage for sheet in sheets]
    if volts[0] <= 0.0 or any(b <= a for a, b in itertools.pairwise(volts)):
        raise ConfigurationError(
            f"thruster sheets: voltages must be above zero and rise, got {volts}"
        )
    if len({(len(sheet.command), len(sheet.current)) for sheet in sheets}) > 1:
        raise ConfigurationError(
            "thruster sheets: all must have the same number of points, and all or none of them "
            "currents"
        )
    if not volts[0] <= voltage <= volts[-1]:
        limits = f"{volts[0]:g} to {volts[-1]:g}" if len(volts) > 1 else f"{volts[0]:g}"
        raise ConfigurationError(
            f"voltage [V]: must be {limits}, the range of the measurements, got {voltage:g}"
        )
