"""Benchmark: REMUS 100 here against the equations of PythonVehicleSimulator, from which the model
is taken.

    ./uvw run scripts/experiments/water/remus.py

The vehicle runs from rest with its propeller at a constant speed, straight and with the rudder put
over. The source is no package, so its equations are written down in NumPy
(`experiments.water.remus100`) and stepped as it steps them, by Euler with 0.02 s. Ours are stepped
by the plant, with the propeller as a thruster and the fins' force from
`uuv.models.vehicles.remus100.fin_wrench`. Without --out nothing is written.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from rich.console import Console

from experiments.water import remus100 as source
from uuv import models
from uuv.experiment import Table
from uuv.models.naming import HULL_BODY
from uuv.models.vehicles import remus100
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.plant import Plant
from uuv.sim.runs.saving import write_whole
from uuv.sim.water.current import Current
from uuv.start import parse, run_scenario

_FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])  # from our axes to the source's


@dataclass
class Options:
    """REMUS 100 from rest, against the source of its figures."""

    seconds: float = 30.0
    """Duration of a run [s]."""
    rpm: float = 1000.0
    """Speed of the propeller."""
    rudder: tuple[float, ...] = (0.0, 5.0)
    """Rudder angles [deg], a run each."""
    step: float = 0.02
    """Step of the source [s]; ours is that of the model, 0.002 s."""
    out: Path | None = None
    """JSON file for the figures."""


def ours(seconds: float, rudder: float, rpm: float) -> Array:
    """Rows (n + 1, 12) at each step of the plant, in the source's axes: position, Euler angles,
    twist.

    Args:
        seconds: duration [s].
        rudder: commanded angle [rad]; the fin follows with its time constant.
        rpm: commanded propeller speed.
    """
    plant = Plant(hydrodynamics.compile(models.load("remus100")), current=Current([0.0, 0.0, 0.0]))
    model, hull, fin, rows = plant.model, plant.model.body(HULL_BODY).id, 0.0, []
    follow = 1.0 - math.exp(-plant.timestep / remus100.FIN_TIME)

    command, none = np.array([rpm / remus100.MOST_RPM]), np.zeros(0)
    for k in range(round(seconds / plant.timestep) + 1):
        # Pose and twist in the source's axes: forward, starboard, down.
        true = plant.observe()
        R, v_B = true.R_WB, true.R_WB.T @ true.v_WB_W
        twist = _FLIP * np.concatenate([v_B, true.w_WB_B])
        angles = math.atan2(R[2, 1], R[2, 2]), math.asin(R[2, 0]), -math.atan2(R[1, 0], R[0, 0])
        rows.append(np.concatenate([_FLIP[:3] * true.p_WB, angles, twist]))

        # The fins' wrench about the hull's origin, applied at its centre of mass.
        wrench = remus100.fin_wrench(v_B, fin, 0.0)
        force = R @ wrench[:3]
        plant.data.xfrc_applied[hull, :3] = force  # at the centre of mass
        plant.data.xfrc_applied[hull, 3:] = R @ wrench[3:] - np.cross(
            R @ model.body_ipos[hull], force
        )

        # The fin follows its command with a lag of first order.
        fin += (rudder - fin) * follow
        plant.step(
            Command(time=k * plant.timestep, joint_torque=none, thrusters=command, scan=False)
        )

    return np.array(rows)


def figures(options: Options, degrees: float) -> dict[str, float]:
    """Figures of one run, ours and the source's, and the largest differences of u, v and r."""
    rudder = math.radians(degrees)
    theirs, mine = (
        source.run(options.seconds, rudder, options.rpm, options.step),
        ours(options.seconds, rudder, options.rpm),
    )

    every = (len(mine) - 1) // (len(theirs) - 1)
    off = np.abs(mine[::every, 6:] - theirs[:, 6:12]).max(axis=0)
    largest = np.abs(theirs[:, 6:12]).max(axis=0)

    def end(rows: Array, prefix: str) -> dict[str, float]:
        return {
            f"{prefix}_distance_m": float(np.linalg.norm(rows[-1, :2])),
            f"{prefix}_speed_ms": float(np.linalg.norm(rows[-1, 6:9])),
            f"{prefix}_heading_deg": float(np.degrees(np.unwrap(rows[:, 5])[-1])),
        }

    return {
        "rudder_deg": degrees,
        **end(mine, "our"),
        **end(theirs, "their"),
        **{f"off_{name}": float(off[i]) for i, name in ((0, "u_ms"), (1, "v_ms"), (5, "r_rads"))},
        **{
            f"largest_{name}": float(largest[i])
            for i, name in ((0, "u_ms"), (1, "v_ms"), (5, "r_rads"))
        },
    }


def main() -> int:
    """Runs the benchmark, prints its table and returns the exit code."""
    options = parse(Options)

    if not (options.seconds > 0.0 and options.step > 0.0 and abs(options.rpm) <= remus100.MOST_RPM):
        raise ConfigurationError(f"seconds and step must be > 0, rpm within {remus100.MOST_RPM:g}")
    if max(map(abs, options.rudder), default=0.0) > math.degrees(remus100.MOST_FIN):
        raise ConfigurationError(f"rudder: must be within {math.degrees(remus100.MOST_FIN):g} deg")
    if abs(options.step / 0.002 - round(options.step / 0.002)) > 1e-9:
        raise ConfigurationError(f"step: must be a multiple of 0.002 s, got {options.step:g}")

    found = [figures(options, degrees) for degrees in options.rudder]
    rows = []
    for run in found:
        # At the end of the run.
        for name, unit in (("distance", "m"), ("speed", "ms"), ("heading", "deg")):
            own, their = run[f"our_{name}_{unit}"], run[f"their_{name}_{unit}"]
            shown = unit.replace("ms", "m/s")
            rows.append(
                [
                    f"{run['rudder_deg']:g}",
                    f"{name} [{shown}]",
                    f"{own:.4g}",
                    f"{their:.4g}",
                    _share(own, their),
                ]
            )

        # Over the whole run.
        for name, shown in (("u_ms", "u [m/s]"), ("v_ms", "v [m/s]"), ("r_rads", "r [rad/s]")):
            off, largest = run[f"off_{name}"], run[f"largest_{name}"]
            rows.append(
                [
                    f"{run['rudder_deg']:g}",
                    f"largest off in {shown}",
                    f"{off:.2g}",
                    f"of {largest:.3g}",
                    _share(off + largest, largest),
                ]
            )

    columns = (
        "rudder [deg]",
        f"{options.rpm:g} rpm, {options.seconds:g} s",
        "here",
        "source",
        "off",
    )

    table = Table(title=f"REMUS 100, MuJoCo {mujoco.__version__}", columns=columns, rows=rows)
    Console().print(table.printed())
    if options.out is not None:
        write_whole(options.out, json.dumps(found, indent=1) + "\n")

    return 0


def _share(own: float, their: float) -> str:
    return f"{100.0 * abs(own / their - 1.0):.2f} %" if abs(their) > 0.01 else "-"


if __name__ == "__main__":
    run_scenario(main)
