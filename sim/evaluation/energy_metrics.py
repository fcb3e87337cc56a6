"""Energy that the thrusters of a run drew, where their current was measured over the voltage."""

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

    voltage_v: float = metric("At the thrusters, at the end.", minimum=0)
    voltage_least_v: float = metric("At the thrusters.", minimum=0)
    below_tables_s: float = metric(
        "Time in which it was below that of the thrusters' tables, whose lowest was used.",
        minimum=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyMetrics:
    """Energy drawn by all thrusters; arm and electronics draw nothing."""

    thrusters_j: float = metric("Electrical energy.", minimum=0)
    thrusters_wh: float = metric("The same.", minimum=0)
    charge_ah: float = metric("Electrical charge.", minimum=0)
    mean_power_w: float | None = metric("Over the whole run.", minimum=0)
    battery: BatteryMetrics | None = metric("Null without one: the voltage was constant.")


def energy_figures(recording: "Recording") -> EnergyMetrics | None:
    """Energy of a run; None where the thrusters have no tables of their current."""
    # imports the simulation, which the help of a command does without
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
    """What the thrusters drew, where it is known; reported only."""
    if energy is None:
        return
    yield Requirement("energy of the thrusters", energy.thrusters_wh, None, "W h")
    if energy.battery is not None:
        yield Requirement("least voltage", energy.battery.voltage_least_v, None, "V")
        if energy.battery.below_tables_s:
            below = energy.battery.below_tables_s
            yield Requirement("voltage below the thrusters' tables", below, None, "s")
