"""Battery in a vehicle's MjSpec. It feeds all thrusters, and their total current lowers its
voltage.

    attach(spec, Battery(voltage=16.0, capacity_Ah=18.0, resistance_ohm=0.05))

The voltage at the thrusters is E - R I, with the resistance R of cells and wiring and the current I
of all thrusters. The electromotive force E is the battery's voltage, constant or falling linearly
with the drawn charge to `empty_voltage`. Once the capacity is drawn the thrusters stop
(`uuv.sim.plant.supply`).
"""

import mujoco
import numpy as np

from uuv.models.water import thrusters
from uuv.models.water.battery import Battery
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

NAME = "uuv_battery"  # custom numeric element: voltage, empty voltage, charge [C], resistance


def attach(spec: mujoco.MjSpec, battery: Battery) -> None:
    """Feed all thrusters of `spec` from `battery`; their curves become those at its voltage.

    Raises:
        ConfigurationError: there are no thrusters, one has no table of its current over the
            voltage, or the voltage is beyond such a table.
    """
    table = {
        actuator.name: thrusters.unpack(np.array(actuator.userdata))
        for actuator in spec.actuators
        if thrusters.carries(np.array(actuator.userdata))
    }
    if not table:
        raise ConfigurationError("vehicle.battery: the vehicle has no thrusters")

    for name, thruster in table.items():
        if not thruster.sheets or not thruster.sheets[0].current:
            raise ConfigurationError(
                f"vehicle.battery: thruster {name!r} has no table of its current over the voltage "
                "(t200 and from_table have one)"
            )

    # The curve at the battery's voltage.
    try:
        driven = {
            name: thrusters.at_voltage(thruster, battery.voltage)
            for name, thruster in table.items()
        }
    except ConfigurationError as error:
        raise ConfigurationError(f"vehicle.battery: {error}") from error
    thrusters.attach(spec, driven)
    _store(spec, battery)


def numbers_of(model: mujoco.MjModel) -> Array:
    """Voltage, empty voltage, charge [C] and resistance of the battery in a compiled model.

    Zeros without a battery, so that voltages do not change.
    """
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, NAME) < 0:
        return np.zeros(4)
    return np.array(model.numeric(NAME).data, dtype=np.float64)


def weaken(spec: mujoco.MjSpec, volts: float) -> None:
    """Lower the supply voltage of all thrusters by `volts` [V], with or without a battery.

    Raises:
        ConfigurationError: a thruster has no sheets, or its new voltage is beyond them.
    """
    element = next((part for part in spec.numerics if part.name == NAME), None)
    if element is not None:
        full, empty, charge, resistance = np.array(element.data).tolist()
        less = Battery(
            voltage=full - volts,
            capacity_Ah=charge / 3600.0,
            resistance_ohm=resistance,
            empty_voltage=empty - volts,
        )
        attach(spec, less)
        return

    # Without a battery, the thrusters' own voltage is lowered.
    table = {}
    for actuator in spec.actuators:
        if thrusters.carries(np.array(actuator.userdata)):
            thruster = thrusters.unpack(np.array(actuator.userdata))
            table[actuator.name] = thrusters.at_voltage(thruster, thruster.voltage - volts)
    thrusters.attach(spec, table)


def _store(spec: mujoco.MjSpec, battery: Battery) -> None:
    for element in [part for part in spec.numerics if part.name == NAME]:
        spec.delete(element)

    empty = battery.voltage if battery.empty_voltage is None else battery.empty_voltage
    numbers = [battery.voltage, empty, 3600.0 * battery.capacity_Ah, battery.resistance_ohm]
    spec.add_numeric(name=NAME, data=numbers, size=len(numbers))
