"""Water of a BlueROV2 with an arm, identified from the pool trials [Kolano 2022].

    ./uvw run scripts/experiments/water/pool_water.py --data FOLDER

FOLDER holds the trials (docs/pool.md). Thrusters are off and only the arm moves; attitude of the
IMU and height of the motion capture are measured. "Told" is the share of the prior variance that
the trials took away.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.water.pool.pool_vehicle import FRESH_WATER
from experiments.water.pool.trials import PoolTrial, read_trials
from uuv.calib.water.findings import findings, together
from uuv.calib.water.logs import ATTITUDE, DEPTH, Channel, WaterLog
from uuv.experiment import Page, column, experiment
from uuv.models.vehicles import published_hulls
from uuv.own_vehicle import vehicle_spec
from uuv.water_identification.command import words
from uuv.water_identification.log_residuals import identify
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

VEHICLE = "bluerov2_heavy_alpha5"
JOINTS = ("joint1", "joint2", "joint3", "joint4")
NOISE = {"attitude": 0.005, "depth": 0.005}  # [rad], [m]
RATE, WINDOW = 10.0, 10.0  # [Hz] of the samples that count, [s] of a window


@dataclass(frozen=True, kw_only=True)
class PoolWaterCase:
    """All trials of a folder."""

    data: Path
    """Folder of the trials."""


@dataclass(frozen=True, kw_only=True)
class PoolWaterRow:
    """The fit, by parameter."""

    unit: Mapping[str, str] = column("unit", by="parameter")
    nominal: Mapping[str, float] = column("before", by="parameter")
    value: Mapping[str, float] = column("found", by="parameter")
    interval: Mapping[str, Sequence[float]] = column("95 %, from and to", by="parameter")
    told: Mapping[str, float] = column("told", "%", digits=0, factor=100.0, by="parameter")
    verdict: Mapping[str, str] = column("verdict", by="parameter")
    sentences: Sequence[str] = column("what the trials cannot tell")


@experiment("pool_water")
def pool_water(case: PoolWaterCase) -> PoolWaterRow:
    """Identifies the vehicle from its trials."""
    spec = vehicle_spec(VEHICLE)
    published_hulls.ballast(spec, FRESH_WATER)
    vehicle = ReplayVehicle(spec)

    logs = [log_of(trial) for trial in read_trials(case.data)]
    settings = FitSettings(noise={**FitSettings().noise, **NOISE}, rate=RATE, window=WINDOW)
    fit, _ = identify(vehicle, logs, settings)

    n = len(vehicle.water.parameters)
    parameters = findings(fit.named, n, fit.quantile)
    combined = together(fit.named, n)
    return PoolWaterRow(
        unit={entry.name: entry.unit for entry in parameters},
        nominal={entry.name: entry.nominal for entry in parameters},
        value={entry.name: entry.value for entry in parameters},
        interval={entry.name: (entry.low, entry.high) for entry in parameters},
        told={entry.name: entry.told for entry in parameters},
        verdict={entry.name: entry.verdict for entry in parameters},
        # of one log: the same holds for all
        sentences=words(parameters, combined, fit, logs[:1], vehicle),
    )


def log_of(trial: PoolTrial) -> WaterLog:
    """A trial as a log; its times begin at zero."""
    begin = trial.times[0]
    time = trial.times - begin
    quats = Rotation.from_euler("ZYX", trial.attitude[:, ::-1]).as_quat()

    return WaterLog(
        name=trial.name,
        time=time,
        channels={
            ATTITUDE: Channel(time=time, values=quats),
            DEPTH: Channel(time=time, values=-trial.position[:, 2:3]),
        },
        commands={},
        thrusts={},
        joints={
            name: np.interp(time, trial.joint_times - begin, trial.joints[:, j])
            for j, name in enumerate(JOINTS)
        },
    )


pool_water.page = (
    Page()
    .table(
        "Water identified from the pool trials",
        by="parameter",
        columns=["unit", "nominal", "value", "interval", "told", "verdict"],
    )
    .add(lambda rows: [line for row in rows for line in row["sentences"]])
)

if __name__ == "__main__":
    run_scenario(pool_water.main)
