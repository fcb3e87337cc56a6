"""Drift of a vehicle without thrust: how soon it moves with the water.

The vehicle starts at rest in a steady current with gusts, all thrusters off.
"""

from dataclasses import dataclass

import numpy as np

from uuv import models
from uuv.experiment import Page, column, experiment, stat
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.messages import Command
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current
from uuv.start import run_scenario


@dataclass(frozen=True, kw_only=True)
class DriftCase:
    """One vehicle in one current."""

    vehicle: str = "uuv_puma"
    """Name of the vehicle."""
    speed: float = 0.2
    """Speed of the current [m/s]."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class DriftRow:
    """What the vehicle does in the first two seconds."""

    drift: float = column("drift", "mm", digits=1, factor=1e3)  # stored in m, shown in mm
    share: float = column("share of the current's speed", "%", digits=0, factor=100.0)
    level: bool = column("hull within 2 deg of level")


@experiment(
    "my_drift",
    seeds=4,
    vary={"vehicle": ("uuv_puma", "bluerov2_heavy"), "speed": (0.1, 0.3)},
    paired=True,
    quick={"runs": 1, "speed": (0.3,)},
)
def my_drift(case: DriftCase) -> DriftRow:
    """Lets the vehicle drift for two seconds."""
    model = hydrodynamics.compile(models.load(case.vehicle))
    rng = np.random.default_rng(case.seed)
    current = Current([case.speed, 0, 0], gust=case.gust, timestep=model.opt.timestep, rng=rng)
    plant = Plant(model, current=current)
    still = Command(
        time=0.0,
        joint_torque=np.zeros(len(plant.vehicle.joint_names)),
        thrusters=np.zeros(len(plant.vehicle.thruster_names)),
        scan=False,
    )
    begin = plant.observe().p_WB.copy()
    for _ in range(round(2.0 / model.opt.timestep)):
        plant.step(still)
        truth = plant.observe()
    return DriftRow(
        drift=float(np.linalg.norm(truth.p_WB - begin)),
        share=float(np.linalg.norm(truth.v_WB_W) / case.speed),
        level=bool(truth.R_WB[2, 2] > np.cos(np.radians(2.0))),
    )


my_drift.page = (
    Page()
    .table(
        "Two seconds without thrust",
        by=("vehicle", "speed"),
        columns=[stat("mean", "drift"), stat("largest", "drift"), stat("mean", "share")],
    )
    .histogram("share", by="vehicle")
    .share("level")
    .accept(stat("largest", "drift"), most=0.6)
)

if __name__ == "__main__":
    run_scenario(my_drift.main)
