"""Electrical energy that the thrusters of a run drew, if tables of their current exist."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.schemas import metric

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryMetrics:
    """Battery at the end of a run."""

    voltage_v: float = metric("Voltage at the thrusters at the end of the run.", minimum=0)
    voltage_least_v: float = metric("Least voltage at the thrusters during the run.", minimum=0)
    below_tables_s: float = metric(
        "Time in which the voltage was below the lowest of the thrusters' tables; that table was "
        "used then.",
        minimum=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyMetrics:
    """Energy drawn by all thrusters. Arm and electronics are not counted."""

    thrusters_j: float = metric("Electrical energy.", minimum=0)
    thrusters_wh: float = metric("The same.", minimum=0)
    charge_ah: float = metric("Electrical charge.", minimum=0)
    mean_power_w: float | None = metric("Mean electrical power over the whole run.", minimum=0)
    battery: BatteryMetrics | None = metric(
        "Battery at the end; null for a supply of constant voltage."
    )


def energy_figures(recording: "Recording") -> EnergyMetrics | None:
    """Energy of a run; None if the thrusters have no tables of their current."""
    # this imports the simulation, which the help text of a command does not need
    from uuv.sim.plant.supply import BELOW, CHARGE, ENERGY, LEAST, VOLTAGE

    supply = recording.supply
    if not supply.size or np.isnan(supply[ENERGY]):
        return None

    joules = float(supply[ENERGY])
    battery = None
    if not np.isnan(supply[VOLTAGE]):
        battery = BatteryMetrics(
            voltage_v=float(supply[VOLTAGE]),
            voltage_least_v=float(supply[LEAST]),
            below_tables_s=float(supply[BELOW]),
        )
    return EnergyMetrics(
        thrusters_j=joules,
        thrusters_wh=joules / 3600.0,
        charge_ah=float(supply[CHARGE]) / 3600.0,
        mean_power_w=joules / recording.duration if recording.duration > 0.0 else None,
        battery=battery,
    )


def energy_checks(energy: EnergyMetrics | None) -> Iterable[Requirement]:
    """Energy and voltages of the thrusters as figures without bounds; none if they are unknown."""
    if energy is None:
        return
    yield Requirement("energy of the thrusters", energy.thrusters_wh, None, "W h")
    if energy.battery is not None:
        yield Requirement("least voltage", energy.battery.voltage_least_v, None, "V")
        if energy.battery.below_tables_s:
            below = energy.battery.below_tables_s
            yield Requirement("voltage below the thrusters' tables", below, None, "s")
