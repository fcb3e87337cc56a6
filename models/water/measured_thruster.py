"""Thrust, current and power of a thruster over pulse width and voltage, from measured sheets."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.sheet_kernels import Between, between, current_at, pack_sheets
from uuv.models.water.thruster_curves import command_for, pack_table, thrust_at
from uuv.models.water.thruster_sheets import Esc, Sheet
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, one_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredThruster:
    """A thruster's sheets and speed controller; methods raise ConfigurationError where they lack.

    Pulses [us] must be in the range of the ESC, voltages [V] in that of the sheets; None is the
    voltage of the thruster. Results have the shape of the pulses.
    """

    curve: Array  # its own static curve, as a row of `uuv.models.water.thruster_curves`
    sheets: tuple[Sheet, ...]
    voltage: float  # [V] of that curve
    esc: Esc | None
    least_thrust: float  # [N]

    def thrust(self, pulse_us: ArrayLike, voltage: float | None) -> Any:
        """Steady thrust [N] in still water."""
        commands = self._esc.command(pulse_us)
        if self.sheets:
            at = self.between(voltage)
            row = pack_table(at.command.tolist(), at.thrust.tolist(), self.least_thrust)
        elif voltage is None:
            row = self.curve
        else:
            raise ConfigurationError(
                f"voltage [V]: this thruster was measured at none, got {voltage}"
            )
        return _for_each(commands, lambda command: thrust_at(row, command))

    def current(self, pulse_us: ArrayLike, voltage: float | None) -> Any:
        """Steady current [A]."""
        commands = self._esc.command(pulse_us)
        self.between(voltage)  # refuses the voltage
        if not self.sheets[0].current:
            raise ConfigurationError("thruster: neither current nor power of it was measured")
        block = pack_sheets(self.sheets)
        volts = self.voltage if voltage is None else float(voltage)
        return _for_each(commands, lambda command: current_at(block, volts, command))

    def power(self, pulse_us: ArrayLike, voltage: float | None) -> Any:
        """Steady electrical power [W]."""
        volts = self.voltage if voltage is None else finite_number(voltage, "voltage [V]")
        return volts * self.current(pulse_us, voltage)

    def dead_pulses(self, voltage: float | None) -> tuple[float, float]:
        """Pulses [us] between which there is no thrust."""
        at = self.between(voltage)
        still = at.command[at.thrust == 0.0]
        first, last = sorted(self._esc.pulse(still[[0, -1]]).tolist())
        return first, last

    def command(self, value: float, unit: str) -> float:
        """Command in [-1, 1] of a value in share, N (still water) or us."""
        one_of(unit, ("share", "N", "us"), "command unit")
        if unit == "us":
            return float(self._esc.command(value))
        if unit == "share":
            return finite_number(value, "command", least=-1.0, most=1.0)

        least, most = float(thrust_at(self.curve, -1.0)), float(thrust_at(self.curve, 1.0))
        newtons = finite_number(value, "command [N]", least=least, most=most)
        return float(command_for(self.curve, newtons))

    def between(self, voltage: float | None) -> Between:
        """Commands, thrusts [N] and currents [A] at a voltage."""
        if not self.sheets:
            raise ConfigurationError("thruster: it has no sheets of a maker's measurements")
        volts = self.voltage if voltage is None else finite_number(voltage, "voltage [V]")
        return between(self.sheets, volts)

    @property
    def _esc(self) -> Esc:
        if self.esc is None:
            raise ConfigurationError("thruster: it has no `esc`, which turns pulses into commands")
        return self.esc


def _for_each(commands: Array, function: Callable[[float], float]) -> Any:
    """A function of each command, of their shape; a number of a number."""
    values = np.array([function(command) for command in commands.ravel().tolist()])
    return values.reshape(commands.shape) if commands.ndim else float(values[0])
