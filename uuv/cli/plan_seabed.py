"""`uuv plan-seabed`: tool path on the seabed from a point cloud and targets above it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuv.cli.json_output import print_json
from uuv.sim.interfaces.spatial import finite_number
from uuv.start import new_folder, parse

if TYPE_CHECKING:  # not needed for a help text
    from rich.console import Console

    from uuv.perception.seabed.terrain_path import SeabedPlan
    from uuv.sim.interfaces.spatial import Array


@dataclass(kw_only=True)
class PlanOptions:
    """Plan a tool path on a seabed: points T_j with their axes, and a picture.

    The cloud is a text file (x y z a line), PLY or PCD. The targets are a text file of points B_i
    and the direction z [Konoplin 2019]. A cloud without a surface, a hole under a target or a
    relief that is too rough is refused, with one line and exit code 2.
    """

    cloud: Path
    """Point cloud [m]: text, PLY or PCD file."""
    targets: Path
    """Text file: points B_i [m], three numbers a line, and a line `z X Y Z`."""
    width: float = 0.1
    """Width of the tool [m]: normals are averaged over it."""
    speed: float = 0.02
    """Speed of the tool along the path [m/s]."""
    out: Path | None = None
    """Folder for profile.csv, path.csv and plan.png."""
    json: bool = False
    """Print the figures of the plan as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Plans the path, writes its files; returns the exit code."""
    del verb
    options = parse(PlanOptions, args)
    from uuv.controllers.planning.trajectories import FASTEST, SLOWEST
    from uuv.perception.clouds.point_files import read_cloud, read_targets
    from uuv.perception.seabed.tool_width import checked_width

    checked_width(options.width, "--width [m]")
    finite_number(options.speed, "--speed [m/s]", least=SLOWEST, most=FASTEST)
    cloud = read_cloud(options.cloud)
    B, z = read_targets(options.targets)
    folder = new_folder("plan_seabed", options.out)

    # Imported, and compiled, after the files are read.
    from uuv.perception.seabed.terrain_path import plan_seabed_work
    from uuv.sim.runs.terminal import PlainConsole

    plan = plan_seabed_work(cloud, B, z, width=options.width)
    write(plan, options.speed, folder)
    if options.json:
        print_json({**figures(plan), "folder": folder})
    else:
        console = PlainConsole()
        print_plan(plan, console)
        console.print(f"written to {folder}/", highlight=False)
    return 0


def feet_of(plan: "SeabedPlan") -> list[tuple["Array", float]]:
    """Foot A_i (3,) [m] on the ground of each target, and its standard deviation [m]."""
    return list(zip(plan.targets.A, plan.targets.sigma, strict=True))


def figures(plan: "SeabedPlan") -> dict[str, Any]:
    """Figures of a plan, SI units and radians: of the ground, and of the targets' feet A_i."""
    terrain = plan.terrain
    relief = plan.relief
    return {
        "points": terrain.points,
        "outliers": terrain.outliers,
        "noise_m": terrain.noise,
        "triangles": len(terrain.triangles),
        "slope_rad": relief.slope,
        "roughness_m": relief.roughness,
        "targets": [{"A_m": list(A), "sigma_m": sigma} for A, sigma in feet_of(plan)],
        "duration_s": plan.duration_s,
    }


def print_plan(plan: "SeabedPlan", console: "Console") -> None:
    """Prints the figures of a plan."""
    import numpy as np

    terrain = plan.terrain
    relief = plan.relief
    console.print(
        f"{terrain.points} points, {terrain.outliers} outliers; noise {1e3 * terrain.noise:.1f} "
        f"mm; {len(terrain.triangles)} triangles; slope {np.degrees(relief.slope):.1f} deg, "
        f"roughness {1e3 * relief.roughness:.1f} mm; {plan.duration_s:.2f} s",
        highlight=False,
    )

    for i, (A, sigma) in enumerate(feet_of(plan), start=1):
        position = f"{A[0]:.4f} {A[1]:.4f} {A[2]:.4f} m, +- {1e3 * sigma:.1f} mm"
        console.print(f"A_{i}: {position}", highlight=False)


def write(plan: "SeabedPlan", speed: float, folder: Path) -> None:
    """Writes profile.csv, path.csv with times at that speed [m/s], and plan.png."""
    import numpy as np

    from uuv.clouds.seabed_picture import picture
    from uuv.controllers.planning.trajectories import speed_law

    if plan.profile is not None and plan.path is not None:
        rows = np.column_stack([plan.profile.T, plan.profile.a, plan.profile.n])
        head = "x,y,z,a_x,a_y,a_z,n_x,n_y,n_z"
        np.savetxt(folder / "profile.csv", rows, "%.6f", ",", header=head, comments="")

        law = speed_law(plan.path, speed)
        rows = np.column_stack(
            [law.time, plan.path.s, law.speed, plan.path.p, plan.path.z, plan.path.x]
        )
        head = "time,s,speed,x,y,z,a_x,a_y,a_z,n_x,n_y,n_z"
        np.savetxt(folder / "path.csv", rows, "%.6f", ",", header=head, comments="")
    picture(plan).savefig(folder / "plan.png", dpi=120, bbox_inches="tight")
