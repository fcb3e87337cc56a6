"""Parameters of a vehicle's battery; `uuv.models.water.battery_feed` adds it to a model."""

from dataclasses import MISSING, dataclass
from typing import Any, cast

from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.spatial import finite_number

_MOST_VOLTS = 1000.0  # [V]
_MOST_AH = 1e5  # [A h]
_MOST_OHM = 10.0  # [ohm]


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """A battery that is full at the start.

    Raises:
        ConfigurationError: a figure is not finite or out of range.
    """

    voltage: float = option(
        cast(Any, MISSING),
        "Battery of this voltage without load [V], which sags under the current of the thrusters "
        "(docs/own_vehicle.md); needs thrusters with tables of it, such as T200.",
        group="vehicle",
        word="battery",
        closed=None,
    )
    capacity_Ah: float = 18.0  # [A h], the capacity of a BlueROV2's battery
    # [ohm] of cells and wiring to the thrusters; assumed: four in series of six lithium cells with
    # 30 milliohm, and as much in wires and plugs
    resistance_ohm: float = 0.04
    # [V] without load at the end of the charge; None: the same as full
    empty_voltage: float | None = None

    def __post_init__(self) -> None:
        volts = finite_number(
            self.voltage, "vehicle.battery.voltage [V]", above=0.0, most=_MOST_VOLTS
        )
        amperehours = finite_number(
            self.capacity_Ah, "vehicle.battery.capacity_Ah", above=0.0, most=_MOST_AH
        )
        ohms = finite_number(
            self.resistance_ohm, "vehicle.battery.resistance_ohm", least=0.0, most=_MOST_OHM
        )

        object.__setattr__(self, "voltage", volts)
        object.__setattr__(self, "capacity_Ah", amperehours)
        object.__setattr__(self, "resistance_ohm", ohms)

        if self.empty_voltage is not None:
            empty = finite_number(
                self.empty_voltage, "vehicle.battery.empty_voltage [V]", above=0.0, most=volts
            )
            object.__setattr__(self, "empty_voltage", empty)
