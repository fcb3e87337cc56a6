"""REMUS 100 beside the equations of PythonVehicleSimulator, from which the model is taken.

The vehicle runs from rest with its propeller at a constant speed, straight and with the rudder put
over. The source is no package, so its equations are written down in NumPy
(`experiments.water.remus100`) and stepped as it steps them, by Euler with 0.02 s. Ours are stepped
by the plant, with the propeller as a thruster and the fins' force from
`uuv.models.vehicles.remus100.fin_wrench`. Differences near zero have no share.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.water import remus100 as source
from uuv import models
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.naming import HULL_BODY
from uuv.models.vehicles import remus100
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, finite_number
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

STEP = 0.002  # [s] of the model
VELOCITIES = {"u [m/s]": 0, "v [m/s]": 1, "r [rad/s]": 5}  # entry of the twist
NEAR_ZERO = 0.01  # of a figure in its unit: a share of it says nothing
_FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])  # from our axes to the source's


@dataclass(frozen=True, kw_only=True)
class RemusCase:
    """One run from rest."""

    rudder: float
    """Rudder angle [deg]."""
    duration: float = 30.0
    """Duration of a run [s], a multiple of the source's step."""
    rpm: float = 1000.0
    """Speed of the propeller."""
    step: float = 0.02
    """Step of the source [s], a multiple of ours, 0.002 s."""

    def __post_init__(self) -> None:
        finite_number(self.duration, "--duration", above=0.0)
        finite_number(self.step, "--step", above=0.0)
        finite_number(self.rpm, "--rpm", least=-remus100.MOST_RPM, most=remus100.MOST_RPM)

        most = math.degrees(remus100.MOST_FIN)
        finite_number(self.rudder, "--rudder", least=-most, most=most)
        for name, value, part in (
            ("--step", self.step, STEP),
            ("--duration", self.duration, self.step),
        ):
            if round(value / part) < 1 or abs(value / part - round(value / part)) > 1e-6:
                raise ConfigurationError(f"{name}: must be a multiple of {part:g} s, got {value:g}")


@dataclass(frozen=True, kw_only=True)
class RemusRow:
    """Figures at the end of the run, and the largest differences of velocities during it."""

    here: Mapping[str, float] = column("here", by="at the end")
    source: Mapping[str, float] = column("source", by="at the end")
    off: Mapping[str, float] = column("largest difference", digits=6, by="velocity")
    largest: Mapping[str, float] = column("largest of the source", digits=5, by="velocity")


@experiment("remus", vary={"rudder": (0.0, 5.0)}, quick={"rudder": (5.0,)})
def remus(case: RemusCase) -> RemusRow:
    """Runs the vehicle here and by the source's equations."""
    rudder = math.radians(case.rudder)
    theirs = source.run(case.duration, rudder, case.rpm, case.step)
    states = ours(case.duration, rudder, case.rpm)

    every = (len(states) - 1) // (len(theirs) - 1)
    off = np.abs(states[::every, 6:] - theirs[:, 6:12]).max(axis=0)
    largest = np.abs(theirs[:, 6:12]).max(axis=0)

    return RemusRow(
        here=at_end(states),
        source=at_end(theirs),
        off={name: float(off[i]) for name, i in VELOCITIES.items()},
        largest={name: float(largest[i]) for name, i in VELOCITIES.items()},
    )


def at_end(states: Array) -> dict[str, float]:
    """Figures of the last of some states (n, 12 or more)."""
    return {
        "distance [m]": float(np.linalg.norm(states[-1, :2])),
        "speed [m/s]": float(np.linalg.norm(states[-1, 6:9])),
        "heading [deg]": float(np.degrees(np.unwrap(states[:, 5])[-1])),
    }


def ours(duration: float, rudder: float, rpm: float) -> Array:
    """States (n + 1, 12) at each step of the plant, in the source's axes: position, Euler angles,
    twist.

    Args:
        duration: [s].
        rudder: Commanded angle [rad]; the fin follows with its time constant.
        rpm: Commanded propeller speed.
    """
    plant = Plant(hydrodynamics.compile(models.load("remus100")), current=Current([0.0, 0.0, 0.0]))
    hull, fin, states = plant.model.body(HULL_BODY).id, 0.0, []
    follow = 1.0 - math.exp(-plant.timestep / remus100.FIN_TIME)

    command, none = np.array([rpm / remus100.MOST_RPM]), np.zeros(0)
    for k in range(round(duration / plant.timestep) + 1):
        # Pose and twist in the source's axes: forward, starboard, down.
        true = plant.observe()
        R, v_B = true.R_WB, true.R_WB.T @ true.v_WB_W
        twist = _FLIP * np.concatenate([v_B, true.w_WB_B])
        angles = math.atan2(R[2, 1], R[2, 2]), math.asin(R[2, 0]), -math.atan2(R[1, 0], R[0, 0])
        states.append(np.concatenate([_FLIP[:3] * true.p_WB, angles, twist]))

        # The fins' wrench about the hull's origin, applied at its centre of mass.
        wrench = remus100.fin_wrench(v_B, fin, 0.0)
        force, arm = R @ wrench[:3], R @ plant.model.body_ipos[hull]
        plant.data.xfrc_applied[hull, :3] = force
        plant.data.xfrc_applied[hull, 3:] = R @ wrench[3:] - np.cross(arm, force)

        # The fin follows its command with a lag of first order.
        fin += (rudder - fin) * follow
        plant.step(
            Command(time=k * plant.timestep, joint_torque=none, thrusters=command, scan=False)
        )

    return np.array(states)


def _share(difference: float, reference: float) -> float | None:
    """Difference over the reference; None near zero."""
    return abs(difference / reference) if abs(reference) > NEAR_ZERO else None


def _off_at_end(row: Row) -> float | None:
    return _share(row["here"] - row["source"], row["source"])


def _largest_off(row: Row) -> float | None:
    return _share(row["off"], row["largest"])


remus.page = (
    Page()
    .table(
        "REMUS 100 at the end of its run",
        by=("rudder", "at the end"),
        columns=[
            stat("value", "here", digits=3),
            stat("value", "source", digits=3),
            stat("value", _off_at_end, "off", unit="%", digits=2, factor=100.0),
        ],
    )
    .table(
        "Differences over the whole run",
        by=("rudder", "velocity"),
        columns=[
            "off",
            "largest",
            stat("value", _largest_off, "off", unit="%", digits=2, factor=100.0),
        ],
    )
)

if __name__ == "__main__":
    run_scenario(remus.main)
