"""Result files of an identification: `fit.yaml`, and the vehicle with the identified
hydrodynamics.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from uuv.calib.water.findings import Finding
from uuv.calib.water.parameters import VehicleWater
from uuv.models import hydrodynamics
from uuv.models.files.sidecar import beside, write_sidecar, xml_without_water
from uuv.models.water import thrusters
from uuv.models.water.thrusters import Thruster
from uuv.sim.interfaces.documents import yaml_text


def write_fit(
    file: Path,
    findings: Sequence[Finding],
    *,
    vehicle: str,
    date: str,
    logs: Mapping[str, str],
    widened: Mapping[str, float],
    combined: Sequence[str],
) -> Path:
    """Write values with intervals as YAML.

    Args:
        file: File to write.
        findings: Parameters of the vehicle.
        vehicle: Name of the vehicle.
        date: ISO 8601.
        logs: SHA-256 of each log by its name.
        widened: Ratio of the noise that the intervals allow for to the stated noise, by channel.
        combined: Sentences about parameters that are identifiable only together.
    """
    document = {
        "vehicle": vehicle,
        "date": date,
        "logs": dict(logs),
        "noise_over_stated": {name: float(f"{factor:.3g}") for name, factor in widened.items()},
        "identified": {
            finding.name: {
                "value": float(f"{finding.value:.8g}"),
                "interval_95": [float(f"{finding.low:.6g}"), float(f"{finding.high:.6g}")],
                "unit": finding.unit,
                "nominal": float(f"{finding.nominal:.8g}"),
                "told": round(finding.told, 3),
                "verdict": finding.verdict,
            }
            for finding in findings
        },
        "only_together": list(combined),
    }

    file.write_text(yaml_text(document), encoding="utf-8")
    return file


def write_vehicle(
    folder: Path,
    name: str,
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    water: VehicleWater,
    values: Mapping[str, float],
) -> list[Path]:
    """Write the vehicle with the identified water, NAME.xml with its NAME.water.yaml beside it.

    Args:
        folder: Existing folder.
        name: Name of the vehicle's files.
        spec: The nominal vehicle.
        model: Compiled from `spec`, for the names of its bodies.
        water: Parameters of the vehicle.
        values: A value for each parameter.
    """
    fitted = spec.copy()
    hydrodynamics.attach(
        fitted, {model.body(i).name: body for i, body in water.bodies(values).items()}
    )

    table = {}
    for actuator in fitted.actuators:
        if thrusters.carries(np.array(actuator.userdata)):
            gain = values.get(
                f"gain of {actuator.name.rpartition('/')[2].removeprefix('thruster_')}", 1.0
            )
            table[actuator.name] = scaled(thrusters.unpack(np.array(actuator.userdata)), gain)
    thrusters.attach(fitted, table)

    mjcf = folder / f"{name}.xml"
    mjcf.write_text(xml_without_water(fitted), encoding="utf-8")
    return [mjcf, write_sidecar(fitted, beside(mjcf))]


def scaled(thruster: Thruster, gain: float) -> Thruster:
    """The thruster with `gain` times its thrust."""

    def times(row: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(gain * coefficient for coefficient in row)

    polynomial = thruster.polynomial
    table = thruster.table
    return replace(
        thruster,
        forward=gain * thruster.forward,
        reverse=gain * thruster.reverse,
        inflow_loss=gain * thruster.inflow_loss,
        least_thrust=gain * thruster.least_thrust,
        polynomial=None if polynomial is None else (times(polynomial[0]), times(polynomial[1])),
        table=None if table is None else (table[0], times(table[1])),
        sheets=tuple(sheet.stronger(gain) for sheet in thruster.sheets),
    )
