"""What a vehicle has of the contract (`models.naming`), and what follows: `uuv check VEHICLE`."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import linprog

from models.naming import HOME_KEY, READY_KEY, lacks, parts
from models.site.scenes import vehicle_spec
from models.vehicle import Vehicle
from models.water.thruster_curves import thrust_at
from models.water.thrusters import curves
from sim import hydrodynamics
from sim.interfaces.errors import UuvError
from sim.interfaces.spatial import Array

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
HEAVY = 5.0  # [N] of weight or lift at rest, above which the trim is named
FASTEST = 2.0  # [m/s] of a current that is tried
_USAGE = """usage: uuv check VEHICLE

What a vehicle has of the contract, its trim, its thrust, and which jobs it can begin. VEHICLE: a name of
`uuv list vehicle`, an MJCF file, or MODULE:FUNCTION that returns an MjSpec."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the tables; 1 if no job can be begun."""
    del verb
    if len(args) != 1 or args[0].startswith("-"):
        print(_USAGE)
        return 0 if args and args[0] in ("-h", "--help") else 2
    model = hydrodynamics.compile(vehicle_spec(args[0]))
    console = Console(width=None if Console().is_terminal else 120)
    contract = Table("", "", "for", title=args[0], title_justify="left")
    for word, name, use, there in parts(model):
        contract.add_row(f"{word} {name}", "[green]there[/green]" if there else "[yellow]missing[/yellow]", use)
    console.print(contract)
    try:
        vehicle = Vehicle.of(model)
    except UuvError as error:
        console.print(f"[red]no job can be begun:[/red] {error}", highlight=False)
        return 1
    figures = Table("", "", title="figures", title_justify="left")
    for name, said in described(model, vehicle):
        figures.add_row(name, said)
    console.print(figures)
    lacking = lacks(model)
    if lacking:
        console.print(f"[red]jobs of the arm:[/red] it lacks {', '.join(lacking)}", highlight=False)
    else:
        console.print("[green]jobs of the arm:[/green] all parts are there; uuv run clean-barrel --vehicle " + args[0])
    return 1 if lacking else 0


def described(model: mujoco.MjModel, vehicle: Vehicle) -> Iterator[tuple[str, str]]:
    """Trim, thrust and arm in words."""
    hydrodynamics.install()
    force, turning = _at_rest(model, vehicle)
    said = "neutral" if abs(force[2]) < HEAVY else "too light" if force[2] > 0.0 else "too heavy"
    yield "mass", f"{float(np.sum(model.body_mass)):.1f} kg"
    yield "trim", f"{force[2]:+.1f} N ({said}), {turning[0]:+.1f} N m in roll, {turning[1]:+.1f} N m in pitch"
    if vehicle.thruster_names:
        most = {axis: _authority(vehicle, i) for i, axis in enumerate(AXES)}
        yield "thrusters", f"{len(vehicle.thruster_names)}: {', '.join(vehicle.thruster_names)}"
        for axis, (back, ahead) in most.items():
            unit = "N" if axis in AXES[:3] else "N m"
            extra = ""
            if unit == "N":
                speed = _strongest(model, vehicle, AXES.index(axis), min(back, ahead))
                extra = f"; holds {speed:.2f} m/s" if speed < FASTEST else f"; holds {FASTEST:g} m/s and more"
            yield axis, f"-{back:.0f} to {ahead:.0f} {unit}{extra}"
    for name, most_torque, (low, high) in zip(
        vehicle.joint_names, vehicle.torque_limits, vehicle.q_limits, strict=True
    ):
        yield f"joint {name}", f"{np.degrees(low):.0f} to {np.degrees(high):.0f} deg, {most_torque:.0f} N m"
    if vehicle.tip >= 0:
        data = _resting(model, READY_KEY)
        reach = float(np.linalg.norm(data.site_xpos[vehicle.tip] - data.xpos[vehicle.arm_base]))
        yield "tip", f"{reach:.2f} m from the arm's base in the ready posture"
    yield "time step", f"{1e3 * float(model.opt.timestep):g} ms"


def _resting(model: mujoco.MjModel, key: str = HOME_KEY) -> mujoco.MjData:
    """State at rest in a keyframe, forces computed."""
    data = mujoco.MjData(model)
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, key)
    if number >= 0:
        mujoco.mj_resetDataKeyframe(model, data, number)
    mujoco.mj_forward(model, data)
    return data


def _at_rest(model: mujoco.MjModel, vehicle: Vehicle) -> tuple[Array, Array]:
    """Force (3,) [N] and moment (3,) [N m] of weight and water on the vehicle at rest, at the hull's origin."""
    data = _resting(model)
    at = slice(vehicle.hull_dof, vehicle.hull_dof + 6)
    wrench = data.qfrc_passive[at] - data.qfrc_bias[at]
    return wrench[:3], wrench[3:]


def _authority(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Largest force or moment against and along an axis, all other components being zero; both positive."""
    B = vehicle.thruster_wrench
    others = np.delete(B, axis, axis=0)
    rank = [row for row in others if np.abs(row).max() > 1e-9]  # what no thruster reaches is zero anyhow
    bounds = [(thrust_at(curve, -1.0), thrust_at(curve, 1.0)) for curve in curves(vehicle.thruster_table)]
    equal = {"A_eq": np.array(rank), "b_eq": np.zeros(len(rank))} if rank else {}
    found = []
    for sign in (1.0, -1.0):
        solved = linprog(sign * B[axis], bounds=bounds, **equal)
        found.append(abs(float(solved.fun)) if solved.success else 0.0)
    return found[0], found[1]


def _strongest(model: mujoco.MjModel, vehicle: Vehicle, axis: int, force: float) -> float:
    """Speed [m/s] of a current along an axis whose drag equals `force` [N], at most FASTEST."""
    data = _resting(model)
    at, still = vehicle.hull_dof + axis, float(data.qfrc_passive[vehicle.hull_dof + axis])

    def drag(speed: float) -> float:
        data.qvel[:] = 0.0
        data.qvel[at] = speed
        mujoco.mj_forward(model, data)
        return abs(float(data.qfrc_passive[at]) - still)

    low, high = 0.0, FASTEST
    if drag(high) < force:
        return high
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if drag(middle) < force else (low, middle)
    return low
