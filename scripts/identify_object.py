"""Identification of a known object from one depth frame: a point cloud from a file, or a simulated scene.

The result is the pose, the decision, the clouds and pictures. Where an accepted object differs from its model (growth,
silt, dents) the regions are listed and shown in colour.

The object is one of the library by name, or a mesh file. Coordinates are those of the sensor (x right, y down, z
ahead). Exit code 0: accepted; 1: rescan or refused; 2: invalid file or option.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from models.meshes.ply_files import write_ply
from models.objects import targets
from models.objects.targets import TargetModel
from perception.clouds.cloud_files import load_cloud
from perception.clouds.scan import SIGMA_ALLOWED, SensorModel
from perception.registration.identification import Identification, Method, identify
from perception.registration.pose_check import PoseCheck
from perception.toolpath.deformation import map_deformation
from scenarios.deformation_report import figures, picture_of_deviations, save_cloud, table
from scenarios.object_scenes import object_scene
from scenarios.site import with_growth_and_dents
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import exp_so3, transform_points
from sim.runs.saving import write_json

NOT_ACCEPTED = 1  # exit code for the decisions rescan and refuse
_TOO_LARGE = 20.0  # times the extent of the cloud: a larger object means a mistake in the units
_SHOWN = 20_000  # largest number of points of each cloud in the picture


@dataclass(kw_only=True)
class Options:
    """Identify a known object in a point cloud."""

    object: str = "barrel"
    """A name of models.objects.targets.available(), or a mesh file (STL, PLY, OBJ, OFF, glTF)."""
    cloud: Path | None = None
    """Text (x y z a line), PLY or PCD, in the sensor's frame; default: a simulated scene."""
    scale: float | None = None
    """Unit of the cloud in metres: 0.001 for millimetres."""
    mesh_scale: float | None = None
    """Unit of the mesh file in metres."""
    approach: tuple[float, float, float] | None = None
    """Coarse position of the object's centre in the sensor's frame [m]; default: unknown."""
    rotation: tuple[float, float, float] | None = None
    """Coarse attitude of the object in the sensor's frame as a rotation vector [deg]; default: unknown."""
    sigma: float | None = None
    """Standard deviation of the sensor's depth [m] at 1 m range; it grows with the square of the range."""
    sensor: Literal["stereo", "white", "sonar"] = "stereo"
    """Sensor of the simulated scene."""
    method: Method = "planes"
    """Registration method; paper: as published, for comparison."""
    fouled: float = 0.0
    """Growth on the object in the simulated scene, up to this height [m]; its model stays clean."""
    dented: float = 0.0
    """Dents in the object in the simulated scene, up to this depth [m]; its model stays undamaged."""
    seed: int = 0
    """Seed of the simulated scene and of random samples."""
    out: Path | None = None
    """Folder for identification.json, cloud.ply, model.ply and identification.png. Where the object differs from its
    model, also deformation.ply and deformation.png."""


def found_in(options: Options, target: TargetModel) -> tuple[Identification, list[str]]:
    """Identifies the object in the cloud or the simulated scene of `options`; also returns notes on the input.

    Raises:
        ConfigurationError: The cloud is unusable, its units do not match the object's, or a number is out of range.
    """
    R = None if options.rotation is None else exp_so3(np.radians(options.rotation))
    if options.cloud is not None:
        cloud = load_cloud(options.cloud, options.scale)
        points = cloud.points.reshape(-1, 3)
        extent = 2.0 * float(np.nanmax(np.linalg.norm(points - np.nanmedian(points, axis=0), axis=1)))
        if 2.0 * target.radius > _TOO_LARGE * extent:
            raise ConfigurationError(
                f"{target.name!r} is {2.0 * target.radius:.3g} m across, the cloud {extent:.3g} m: is one of them in "
                "millimetres? Give --scale (of the cloud) or --mesh-scale"
            )
        sensor = told(SensorModel(), options.sigma)
        found = identify(
            cloud.points, target, options.approach, R, sensor=sensor, seed=options.seed, method=options.method
        )
        return found, [*cloud.notes]
    there = with_growth_and_dents(target, options.fouled, options.dented, np.random.default_rng([options.seed, 4]))
    scene = object_scene(target, options.seed, options.sensor, there=there)
    approach = scene.approach if options.approach is None else options.approach
    found = identify(
        scene.scan,
        target,
        approach,
        scene.orientation if R is None else R,
        sensor=told(scene.sensor.model, options.sigma),
        seed=options.seed,
        method=options.method,
    )
    position, angle = scene.error(found.X_sensor_target)
    said = f"off the truth by {1e3 * position:.2f} mm and {np.degrees(angle):.2f} deg, at {scene.range_m:.2f} m"
    return found, [f"scene of seed {options.seed}, {options.sensor}: {said}"]


def told(sensor: SensorModel, sigma: float | None) -> SensorModel:
    """`sensor` with depth noise `sigma` [m] at 1 m range; unchanged where `sigma` is None."""
    return sensor if sigma is None else replace(sensor, disparity_sigma=sigma * sensor.focal * sensor.baseline)


def report(found: Identification, target: TargetModel, notes: list[str]) -> dict[str, Any]:
    """Contents of identification.json; numbers that are not finite become None.

    Args:
        found: Result of identification.
        target: Model of the object.
        notes: Notes on the input.

    Returns:
        Dictionary that JSON can hold; SI units, poses (4, 4) in the sensor's frame.
    """

    def number(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    def figures(check: PoseCheck) -> dict[str, float | None]:
        names = (
            "figure_m",
            "threshold_m",
            "form_m",
            "form_threshold_m",
            "agreement",
            "through",
            "coverage",
            "hidden",
            "size",
            "margin",
        )
        return {name: number(getattr(check, name)) for name in names}

    return {
        "object": target.name,
        "decision": found.decision.value,
        "reason": found.reason,
        "X_sensor_target": found.X_sensor_target.tolist(),
        "center_m": transform_points(found.X_sensor_target, target.center).tolist(),
        "check": None if found.check is None else figures(found.check),
        "score": found.score,
        "symmetry": {
            "axis": None if found.symmetry.axis is None else found.symmetry.axis.tolist(),
            "turns": found.symmetry.turns,
            "policy": found.symmetry.policy,
        },
        "hypotheses": [
            {"log_likelihood": each.log_likelihood, "X_sensor_target": each.X_sensor_target.tolist()}
            for each in found.hypotheses
        ],
        "duration_s": found.duration_s,
        "notes": notes,
    }


def picture(found: Identification, title: str) -> Figure:
    """Scatter plots of cloud and fitted model: along the sensor's z axis, and from the side."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    parts = ((found.model_after, "tab:orange", "model, where found", 8.0), (found.cloud, "k", "cloud", 1.0))
    left, right = figure.subplots(1, 2)
    for axes, x, name in ((left, 0, "x"), (right, 2, "z")):
        for points, colour, label, size in parts:
            some = points[:: max(1, len(points) // _SHOWN)]
            axes.scatter(some[:, x], some[:, 1], s=size, c=colour, label=label, linewidths=0.0)
        axes.set(aspect="equal", xlabel=f"{name} [m]", ylabel="y [m]")
        axes.invert_yaxis()
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=4.0)
    figure.suptitle(title, fontsize="medium")
    return figure


def main() -> int:
    """Runs the identification, writes its files and returns the exit code."""
    options, console = parse(Options), Console()
    least, most = SIGMA_ALLOWED
    if options.sigma is not None and not least <= options.sigma <= most:
        raise ConfigurationError(f"--sigma: must lie in {least:g} to {most:g} m (at 1 m), got {options.sigma}")
    folder = new_folder("identify_object", options.out, options.seed)
    target = targets.of(options.object, options.mesh_scale)
    found, notes = found_in(options, target)
    decision = found.decision.value
    for note in notes:
        console.print(note, highlight=False)
    console.print(f"{target.name}: {decision}{': ' + found.reason if found.reason else ''}", highlight=False)
    if found.accepted:
        center = ", ".join(f"{value:.4f}" for value in transform_points(found.X_sensor_target, target.center))
        console.print(f"middle at ({center}) m; {found.symmetry.policy}; {found.duration_s:.2f} s", highlight=False)
    said = report(found, target, notes)
    if found.accepted:
        made = map_deformation(found)
        said["deformation"] = figures(made)
        if made.regions:
            console.print(table(made))
            save_cloud(made, folder / "deformation.ply")
            title = f"{target.name}: off its model by more than {1e3 * made.size_m:.1f} mm"
            picture_of_deviations(made, title).savefig(folder / "deformation.png", dpi=120)
        else:
            compared = f"of the {made.compared:.0%} of the surface in view that was compared"
            console.print(f"nothing {compared} lies off its model beyond doubt", highlight=False)
    write_json(folder / "identification.json", said)
    write_ply(folder / "cloud.ply", found.cloud)
    write_ply(folder / "model.ply", found.model_after)
    picture(found, f"{target.name}: {decision}").savefig(folder / "identification.png", dpi=120)
    console.print(f"written to {folder}/", highlight=False)
    return 0 if found.accepted else NOT_ACCEPTED


if __name__ == "__main__":
    run_scenario(main)
