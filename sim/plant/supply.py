"""Electrical supply of a plant's thrusters, compiled: current, voltage, charge and energy.

The current of a thruster is that of steady running at its present propeller speed, in still water.
A battery supplies all thrusters, whose curves are those at its present voltage. Without a battery
each thruster has its own constant voltage. A vehicle whose thrusters have no table of their current
is left unchanged.
"""

from typing import NamedTuple, Self

import mujoco
import numpy as np

from uuv.models.water import battery_feed
from uuv.models.water.sheet_kernels import MEASURED, POINTS, blend, current_at, least_voltage
from uuv.models.water.thruster_curves import FIRST, rewrite_table
from uuv.models.water.thrusters import (
    COUNT,
    FORWARD,
    HEADER,
    REVERSE,
    SPEED,
    read,
    sheet_blocks,
    unpack,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

# State; NaN without tables: voltage [V] (NaN if each thruster has its own), current [A], charge [C]
# and energy [J] drawn by the thrusters, least voltage [V], and time [s] in which the voltage was
# below that of the tables.
VOLTAGE, CURRENT, CHARGE, ENERGY, LEAST, BELOW, STATE = range(7)

_FULL, _EMPTY, _CAPACITY, _RESISTANCE = range(4)  # parameters of the battery, in [V, V, C, ohm]


class Supply(NamedTuple):
    """Supply of one plant. MuJoCo's arrays are views; the kernel writes the others."""

    user: Array  # (nu, ...) MuJoCo's user data of the actuators
    act: Array  # (na,) MuJoCo's activations
    actuators: np.ndarray  # (m,) indices into `user`
    activations: np.ndarray  # (m,) index of the first activation of each thruster
    blocks: Array  # (m, ...) tables for `uuv.models.water.sheet_kernels`; (0, 0): none
    volts: Array  # (m,) [V] voltages without a battery
    # (4,) voltage when full, voltage when empty, charge, resistance; zeros without a battery
    battery: Array
    curves: Array  # (3, points) commands, thrusts and currents, as working memory
    state: Array  # (STATE,)
    timestep: float  # [s] step of the plant

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        thrusters: tuple[np.ndarray, Array],
        timestep: float,
    ) -> Self:
        """Supply of thrusters, which are given as rows from `uuv.models.water.thrusters.read`.

        Raises:
            ConfigurationError: There is a battery, but a thruster has no table of its current.
        """
        actuators, table = thrusters
        blocks = [block for block in sheet_blocks(table) if block.size and block[MEASURED]]
        whole = len(blocks) == len(actuators) > 0
        battery = battery_feed.numbers_of(model)
        curves_fit = [
            row[COUNT] == FIRST + 3 * block[POINTS]
            for row, block in zip(table, blocks, strict=False)
        ]
        if battery.any() and not (whole and all(curves_fit)):
            raise ConfigurationError(
                "battery: every thruster of the model must have its own table of current over "
                "voltage (uuv.models.water.battery_feed.attach)"
            )

        width = max((len(block) for block in blocks), default=0) if whole else 0
        points = max((int(block[POINTS]) for block in blocks), default=0)
        return cls(
            user=model.actuator_user,
            act=data.act,
            actuators=actuators,
            activations=np.asarray(model.actuator_actadr)[actuators].astype(np.int64),
            blocks=np.array([np.pad(block, (0, width - len(block))) for block in blocks])
            if whole
            else np.zeros((0, 0)),
            volts=np.array([unpack(row).voltage for row in table]),
            battery=battery,
            curves=np.zeros((3, points)),
            state=np.zeros(STATE),
            timestep=timestep,
        )

    def start(self) -> None:
        """Begin with a full battery and nothing drawn."""
        self.state[:] = 0.0 if self.blocks.size else np.nan
        self.state[VOLTAGE] = self.state[LEAST] = np.nan
        if self.battery[_CAPACITY] > 0.0:
            self.state[VOLTAGE] = self.state[LEAST] = self.battery[_FULL]
            set_curves(tuple(self), float(self.battery[_FULL]))


def fill_up(model: mujoco.MjModel) -> None:
    """Set the thrusters' curves in a model to those at the voltage of its full battery without
    load.

    A plant leaves the curves of its last step in the model. A model without a battery is left
    unchanged.

    Raises:
        ConfigurationError: As for `Supply.of`.
    """
    if battery_feed.numbers_of(model).any():
        Supply.of(model, mujoco.MjData(model), read(model), 1.0).start()


class Drawn(NamedTuple):
    """Current and power of all thrusters at one time."""

    voltage: float  # [V] of the battery; NaN if each thruster has its own voltage
    current: float  # [A]
    power: float  # [W]


def all_ahead(model: mujoco.MjModel) -> Drawn | None:
    """Draw of the thrusters of a compiled model at full forward thrust; None: not measured."""
    data = mujoco.MjData(model)
    supply = Supply.of(model, data, read(model), 1.0)._replace(user=np.array(model.actuator_user))
    if not supply.blocks.size:
        return None

    supply.start()
    data.act[supply.activations + SPEED] = 1.0
    feed(tuple(supply))
    return Drawn(*supply.state[[VOLTAGE, CURRENT, ENERGY]].tolist())  # result of one second


@kernel
def feed(supply):
    """Draw the current of one step at the present propeller speeds, and set the curves to the new
    voltage.

    The argument is a `Supply` or its fields.

    Returns:
        False if the battery is empty, so that the thrusters get no current.
    """
    _, act, _, activations, blocks, volts, battery, _, state, timestep = supply
    if blocks.shape[0] == 0:
        return True

    # Without a battery each thruster keeps its voltage.
    if battery[_CAPACITY] == 0.0:
        total = 0.0
        power = 0.0
        for i in range(blocks.shape[0]):
            amperes = current_at(blocks[i], volts[i], act[activations[i] + SPEED])
            total += amperes
            power += volts[i] * amperes
        state[CURRENT] = total
        state[CHARGE] += total * timestep
        state[ENERGY] += power * timestep
        return True

    # An empty battery.
    left = 1.0 - state[CHARGE] / battery[_CAPACITY]
    if left <= 0.0:
        state[VOLTAGE] = state[LEAST] = state[CURRENT] = 0.0
        return False

    force = battery[_EMPTY] + left * (battery[_FULL] - battery[_EMPTY])
    voltage, total = terminal_voltage(supply, force)
    state[VOLTAGE] = voltage
    state[LEAST] = min(state[LEAST], voltage)
    state[CURRENT] = total
    state[CHARGE] += total * timestep
    state[ENERGY] += voltage * total * timestep

    # Below the voltages of the tables, the curves of the lowest voltage are used.
    if voltage < _lowest(blocks):
        state[BELOW] += timestep
    set_curves(supply, voltage)
    return True


@kernel
def terminal_voltage(supply, force):
    """Voltage V [V] at the thrusters and their current I [A], from the solution of E - R I(V) = V.

    Args:
        supply: `Supply` or its fields.
        force: [V] electromotive force E.
    """
    _, _, _, _, _, _, battery, _, _, _ = supply
    resistance = battery[_RESISTANCE]
    total = drawn(supply, force)
    if resistance * total == 0.0:
        return force, total

    # The current increases with the voltage, so there is one solution, between these two values.
    high = force
    low = force - resistance * total
    for _ in range(60):
        middle = 0.5 * (low + high)
        total = drawn(supply, middle)
        if force - resistance * total > middle:
            low = middle
        else:
            high = middle
        if high - low < 1e-9:
            break
    return max(force - resistance * total, 0.0), total


@kernel
def drawn(supply, voltage):
    """Current [A] of all thrusters at a voltage [V] and their present propeller speeds."""
    _, act, _, activations, blocks, _, _, _, _, _ = supply
    total = 0.0
    for i in range(blocks.shape[0]):
        total += current_at(blocks[i], voltage, act[activations[i] + SPEED])
    return total


@kernel
def set_curves(supply, voltage):
    """Set the thrusters' curves in MuJoCo's user data to those at a voltage [V]."""
    user, _, actuators, _, blocks, _, _, curves, _, _ = supply
    for i in range(blocks.shape[0]):
        row = user[actuators[i]]
        count = int(blocks[i, POINTS])
        blend(blocks[i], voltage, curves)
        rewrite_table(row[HEADER:], curves[0], curves[1])
        row[FORWARD] = curves[1, count - 1]
        row[REVERSE] = -curves[1, 0]


@kernel
def _lowest(blocks):
    lowest = 0.0
    for i in range(blocks.shape[0]):
        lowest = max(lowest, least_voltage(blocks[i]))
    return lowest
