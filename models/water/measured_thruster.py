"""Thrust, current and power of a thruster over pulse width and voltage, from sheets of
measurements.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.thruster_sheets import Esc, Sheet
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, one_of


class MeasuredThruster(ABC):
    """Base of a thruster, with the values of its sheets and its speed controller (ESC).

    Pulses [us] must be in the range of the ESC, voltages [V] in that of the sheets. The default is
    the thruster's own voltage. Results have the shape of the pulses. A method raises
    ConfigurationError if a pulse or voltage is out of range, or if the thruster has no
    measurements.
    """

    __slots__ = ()
    sheets: tuple[Sheet, ...]
    voltage: float  # [V] voltage of the thruster's own curve
    esc: Esc | None
    least_thrust: float  # [N]

    @abstractmethod
    def static_curve(self) -> Array:
        """The static curve at the thruster's own voltage, as a row of
        `uuv.models.water.thruster_curves`.
        """

    def thrust(self, pulse_us: ArrayLike, voltage: float | None = None) -> Any:
        """Steady thrust [N] in still water, from the simulated curve, or from the sheets at a
        `voltage` [V].
        """
        # imported here, since these import numba
        from uuv.models.water.thruster_curves import pack_table, thrust_at

        commands = self._drive.command(pulse_us)
        if voltage is None:
            row = self.static_curve()
        elif self.sheets:
            at = self.between(voltage)
            row = pack_table(at.command.tolist(), at.thrust.tolist(), self.least_thrust)
        else:
            raise ConfigurationError(
                "voltage [V]: must be left out, since this thruster has no measurements, got "
                f"{voltage}"
            )
        return _for_each(commands, lambda command: thrust_at(row, command))

    def current(self, pulse_us: ArrayLike, voltage: float | None = None) -> Any:
        """Steady current [A]."""
        from uuv.models.water.sheet_kernels import current_at, pack_sheets

        commands = self._drive.command(pulse_us)
        volts = self._volts(voltage)
        self.between(volts)  # this refuses a thruster without measurements
        if not self.sheets[0].current:
            raise ConfigurationError("thruster: its sheets have neither current nor power")

        block = pack_sheets(self.sheets)
        return _for_each(commands, lambda command: current_at(block, volts, command))

    def power(self, pulse_us: ArrayLike, voltage: float | None = None) -> Any:
        """Steady electrical power [W]."""
        return self._volts(voltage) * self.current(pulse_us, voltage)

    def dead_pulses(self, voltage: float | None = None) -> tuple[float, float]:
        """The two pulses [us] between which there is no thrust."""
        at = self.between(voltage)
        still = at.command[at.thrust == 0.0]
        first, last = sorted(self._drive.pulse(still[[0, -1]]).tolist())
        return first, last

    def command(self, value: float, unit: Literal["share", "N", "us"] = "share") -> float:
        """Command in [-1, 1] of a value in another unit.

        Args:
            value: a share of full speed, a thrust [N] in still water, or a pulse width [us].
            unit: unit of the value.
        """
        from uuv.models.water.thruster_curves import command_for, thrust_at

        one_of(unit, ("share", "N", "us"), "command unit")
        if unit == "us":
            return float(self._drive.command(value))
        if unit == "share":
            return finite_number(value, "command", least=-1.0, most=1.0)

        row = self.static_curve()
        least, most = (float(thrust_at(row, end)) for end in (-1.0, 1.0))
        return float(command_for(row, finite_number(value, "command [N]", least=least, most=most)))

    def between(self, voltage: float | None = None) -> Any:
        """Commands, thrusts [N] and currents [A] (`uuv.models.water.sheet_kernels.Between`)."""
        from uuv.models.water.sheet_kernels import between

        if not self.sheets:
            raise ConfigurationError("thruster: it has no sheets of a maker's measurements")
        return between(self.sheets, self._volts(voltage))

    def _volts(self, voltage: float | None) -> float:
        return self.voltage if voltage is None else finite_number(voltage, "voltage [V]")

    @property
    def _drive(self) -> Esc:
        if self.esc is None:
            raise ConfigurationError("thruster: it has no `esc`, which turns pulses into commands")
        return self.esc


def _for_each(commands: Array, function: Callable[[float], float]) -> Any:
    """Values of a function for each command, in the commands' shape; a number for a number."""
    values = np.array([function(command) for command in commands.ravel().tolist()])
    return values.reshape(commands.shape) if commands.ndim else float(values[0])
