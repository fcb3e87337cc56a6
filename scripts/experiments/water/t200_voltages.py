"""T200 at a voltage whose sheet is left out, beside that sheet [BlueRobotics 2019].

The model interpolates the measured sheets of 10, 14, 16 and 20 V. Each of the inner two is left out
in turn, and thrust, power and dead band are predicted from the others. What a simulation takes that
knows the curve of 16 V alone stands beside it.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass, replace

import numpy as np

from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.water import t200_sheets, thrusters
from uuv.sim.interfaces.errors import ConfigurationError

INNER = (14.0, 16.0)  # [V] that have a sheet on either side


@dataclass(frozen=True, kw_only=True)
class VoltageCase:
    """One sheet that is left out."""

    voltage: float
    """Voltage of the sheet that is left out [V]."""

    def __post_init__(self) -> None:
        at_least(self, voltage=0)
        if self.voltage not in INNER:
            raise ConfigurationError(f"--voltage [V]: allowed 14 and 16, got {self.voltage:g}")


@dataclass(frozen=True, kw_only=True)
class VoltageRow:
    """Errors of the prediction, largest over the sheet."""

    full_thrust: float = column("full thrust, measured", "N", digits=1)
    thrust: float = column("thrust off", "N", digits=2)
    thrust_share: float = column("of full", "%", digits=2, factor=100.0)
    power_share: float = column("power off, of full", "%", digits=2, factor=100.0)
    dead_band: float = column("dead band off", "us", digits=1)
    one_curve: float = column("curve of 16 V off", "N", digits=1)


@experiment("t200_voltages", vary={"voltage": INNER}, quick={"voltage": (14.0,)})
def t200_voltages(case: VoltageCase) -> VoltageRow:
    """Predicts a sheet from the others."""
    (sheet,) = (s for s in t200_sheets.SHEETS if s.voltage == case.voltage)
    others = tuple(s for s in t200_sheets.SHEETS if s.voltage != case.voltage)
    model = replace(thrusters.t200(voltage=others[0].voltage), sheets=others)

    pulses = t200_sheets.ESC.pulse(sheet.command)
    measured = np.array(sheet.thrust)
    current = np.array(sheet.current)
    thrust = np.abs(model.thrust(pulses, case.voltage) - measured).max()
    power = np.abs(model.power(pulses, case.voltage) - case.voltage * current).max()

    # Dead band, and one curve for every voltage
    dead = t200_sheets.ESC.pulse(np.array(sheet.command)[measured == 0.0])
    dead_off = np.abs(np.subtract(model.dead_pulses(case.voltage), (dead.min(), dead.max())))
    at_16 = thrusters.t200().thrust(pulses)
    return VoltageRow(
        full_thrust=float(measured.max()),
        thrust=float(thrust),
        thrust_share=float(thrust / measured.max()),
        power_share=float(power / (case.voltage * current.max())),
        dead_band=float(dead_off.max()),
        one_curve=float(np.abs(at_16 - measured).max()),
    )


t200_voltages.page = (
    Page()
    .table(
        "T200 at a voltage that is left out",
        by="voltage",
        columns=["full_thrust", "thrust", "thrust_share", "power_share", "dead_band", "one_curve"],
    )
    .accept(stat("largest", "thrust_share"), most=0.03)
    .accept(stat("largest", "power_share"), most=0.02)
)

if __name__ == "__main__":
    run_scenario(t200_voltages.main)
