"""Study: depth and identification errors of stereo cameras behind a flat port, by calibration, and of a 3D sonar.

All sensors see the same scenes. Stereo is ideal without a port, or behind a flat port with three calibrations. A figure
shows the depth errors over the image.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from models.objects.target_model import TargetModel
from models.objects.targets import barrel
from perception.clouds.scan import Scan, SensorModel
from perception.clouds.sonar_cloud import sonar_model, without_isolated_echoes
from perception.registration.identification import identify
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import DepthImage, SonarScan
from sim.interfaces.spatial import Array, exp_so3, inverse, pose, quat_wxyz_from_rotation, rotation_from_z
from sim.runs.saving import write_whole
from sim.sensors.depth_camera import DepthCamera
from sim.sensors.refraction import FlatPort, in_air, in_water
from sim.sensors.sonar import BEAMS, Sonar

FOCAL, CORNER = 554.0, 400.0  # [px] focal length; distance from the image's middle to its corner
PORT = FlatPort()
CAMERAS: Mapping[str, dict[str, Any]] = {
    "no port": {},
    "port, calibrated in air": {"port": PORT, "calibration": in_air(FOCAL)},
    "port, in water, lens for centre": {"port": PORT, "calibration": in_water(PORT, FOCAL, CORNER, move_center=False)},
    "port, in water": {"port": PORT},
}
SONAR = "sonar"
OF_SONAR = sonar_model(BEAMS.pitch)


@dataclass(kw_only=True)
class Options:
    """Compare sensors by depth and identification of a barrel on the seabed."""

    runs: int = 20
    """Number of scenes."""
    seed: int = 0
    """Seed of the first scene."""
    ranges: tuple[float, float] = (1.0, 2.0)
    """Distance from sensor to barrel [m]."""
    out: Path | None = None
    """Folder for sensors.json and sensors.png."""


def scene(rng: np.random.Generator, target: TargetModel, ranges: tuple[float, float]) -> tuple[mujoco.MjModel, Array]:
    """Barrel on its stand on a flat seabed, seen from the origin of W.

    Args:
        rng: Draws the view.
        target: The barrel.
        ranges: [m] bounds of the distance.

    Returns:
        Compiled model, pose X_ST (4, 4) of the barrel in the sensor frame.
    """
    distance, climb, heading = rng.uniform([ranges[0], 0.2, -np.pi], [ranges[1], 1.1, np.pi])
    p_TS = distance * np.array([np.cos(climb) * np.cos(heading), np.cos(climb) * np.sin(heading), np.sin(climb)])
    X_ST = inverse(pose(rotation_from_z(-p_TS, np.cross(-p_TS, [0.0, 0.0, 1.0])), p_TS))
    spec = mujoco.MjSpec()
    target.add_to(spec, X_ST)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.1],
        pos=X_ST[:3, 3] - 0.5 * X_ST[:3, 2],
        quat=quat_wxyz_from_rotation(X_ST[:3, :3]),
    )
    return spec.compile(), X_ST


def look(name: str, model: mujoco.MjModel, seed: int) -> DepthImage | SonarScan:
    """One measurement of a sensor.

    Args:
        name: Name in CAMERAS, or SONAR.
        model: The scene.
        seed: Seed of the noise.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    if name == SONAR:
        sonar = Sonar(model, "world", np.eye(4))
        return sonar.step(sonar.init(np.random.default_rng(seed)), data)[1]
    camera = DepthCamera(model, "world", np.eye(4), **CAMERAS[name])
    return camera.step(camera.init(np.random.default_rng(seed)), data)[1]


def depth_error(seen: DepthImage | SonarScan, model: mujoco.MjModel) -> Array:
    """Error of depth or range (H, W) [m], along the rays that the sensor's model assumes."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    height, width = (seen.depth if isinstance(seen, DepthImage) else seen.points[..., 0]).shape
    if isinstance(seen, SonarScan):
        exact = Sonar(model, "world", np.eye(4), noise=None, echo="strongest")
        true = exact.ping(data, np.random.default_rng(0))
        return np.linalg.norm(seen.points, axis=-1) - np.linalg.norm(true, axis=-1)
    ideal = DepthCamera(model, "world", seen.X_BC, noise=None, width=width, height=height, focal=float(seen.K[0, 0]))
    true = ideal.step(ideal.init(np.random.default_rng(0)), data)[1].depth
    return seen.depth - true


def study(options: Options) -> dict[str, list[dict[str, float]]]:
    """For each sensor the rows of all scenes."""
    target = barrel()
    results: dict[str, list[dict[str, float]]] = {name: [] for name in (*CAMERAS, SONAR)}
    for run in track(range(options.runs), description="scenes", transient=True):
        rng = np.random.default_rng([options.seed, run])
        model, X_ST = scene(rng, target, options.ranges)
        aside, axis = rng.standard_normal((2, 3))
        approach = X_ST[:3, 3] + rng.uniform(0.0, 0.3) * aside / np.linalg.norm(aside)
        turn = exp_so3(np.radians(rng.uniform(0.0, 30.0)) * axis / np.linalg.norm(axis)) @ X_ST[:3, :3]
        for name, rows in results.items():
            seen = look(name, model, run)
            if isinstance(seen, SonarScan):
                cloud, X_BS, sensor = without_isolated_echoes(seen.points), seen.X_BS, OF_SONAR
            else:
                cloud, X_BS = Scan.from_depth(seen), seen.X_BC
                sensor = SensorModel(focal=float(seen.K[0, 0]))
            shift = X_BS[:3, 3]
            found = identify(cloud, target, approach - shift, turn, sensor=sensor)
            off = found.X_sensor_target[:3, 3] + shift - X_ST[:3, 3]
            tilt = abs(float(found.X_sensor_target[:3, 0] @ X_ST[:3, 0]))
            off_depth = depth_error(seen, model)
            finite = np.abs(off_depth[np.isfinite(off_depth)])
            rows.append(
                {
                    "range_m": float(np.linalg.norm(X_ST[:3, 3])),
                    "depth_error_m": float(np.median(finite)) if len(finite) else float("nan"),
                    "position_m": float(np.linalg.norm(off)),
                    "axis_deg": float(np.degrees(np.arccos(min(1.0, tilt)))),
                    "accepted": float(found.accepted),
                }
            )
    return results


def picture(path: Path, seed: int, ranges: tuple[float, float]) -> None:
    """Plots the depth errors of one scene, one panel for each sensor.

    Args:
        path: PNG file.
        seed: Seed of the scene.
        ranges: [m] bounds of the distance.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    model, _ = scene(np.random.default_rng([seed, 0]), barrel(), ranges)
    figure = Figure(figsize=(16, 3.6), layout="constrained")
    axes = figure.subplots(1, len(CAMERAS) + 1)
    colors = colormaps["RdBu"].with_extremes(bad="0.2")
    for panel, name in zip(axes, (*CAMERAS, SONAR), strict=True):
        error = 1e3 * depth_error(look(name, model, seed), model)
        limit = 500.0 if name == "port, calibrated in air" else 50.0
        shown = panel.imshow(error, cmap=colors, vmin=-limit, vmax=limit, aspect="auto")
        panel.set_title(f"{name}\nmedian |error| {np.nanmedian(np.abs(error)):.0f} mm", fontsize=10)
        panel.set_xticks([])
        panel.set_yticks([])
        figure.colorbar(shown, ax=panel, label="depth read less true [mm]; grey: nothing", location="bottom")
    figure.savefig(path, dpi=110)


def main() -> int:
    """Runs the study, writes its files and returns the exit code."""
    options = parse(Options)
    if options.runs < 1 or not 0.3 < options.ranges[0] <= options.ranges[1] < 10.0:
        raise ConfigurationError(f"--runs must be positive and --ranges lie within 0.3 and 10 m, got {options}")
    folder = new_folder("study_sensors", options.out, options.seed)
    results = study(options)
    write_whole(folder / "sensors.json", json.dumps(results, indent=1))
    picture(folder / "sensors.png", options.seed, options.ranges)
    table = Table(title=f"Barrel, {options.runs} scenes at {options.ranges[0]} to {options.ranges[1]} m")
    for column in ("sensor", "depth, median [mm]", "position, median, worst [mm]", "axis, median [deg]", "accepted"):
        table.add_column(column)
    for name, rows in results.items():
        depth, position, axis = (
            np.array([row[key] for row in rows]) for key in ("depth_error_m", "position_m", "axis_deg")
        )
        table.add_row(
            name,
            f"{1e3 * np.nanmedian(depth):.1f}",
            f"{1e3 * np.median(position):.1f}, {1e3 * position.max():.1f}",
            f"{np.median(axis):.2f}",
            f"{sum(row['accepted'] for row in rows):.0f} of {len(rows)}",
        )
    console = Console()
    console.print(table)
    console.print(f"written to {folder}/", highlight=False)
    return 0


if __name__ == "__main__":
    run_scenario(main)
