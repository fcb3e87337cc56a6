"""Identification of a known object in one cloud, from a file or a simulated scene: options, result, report, picture."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from models.objects.targets import TargetModel
from perception.clouds.cloud_files import load_cloud
from perception.clouds.scan import SIGMA_ALLOWED, SensorModel
from perception.registration.identification import Identification, Method, identify
from perception.registration.pose_check import PoseCheck
from perception.registration.pose_covariance import PoseCovariance
from scenarios.object_scenes import object_scene
from scenarios.site import with_growth_and_dents
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import exp_so3, transform_points

_TOO_LARGE = 20.0  # times the extent of the cloud: a larger object means a mistake in the units
_SHOWN = 20_000  # largest number of points of each cloud in the picture


@dataclass(kw_only=True)
class IdentificationOptions:
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

    def __post_init__(self) -> None:
        least, most = SIGMA_ALLOWED
        if self.sigma is not None and not least <= self.sigma <= most:
            raise ConfigurationError(f"--sigma: must lie in {least:g} to {most:g} m (at 1 m), got {self.sigma}")


def found_in(options: IdentificationOptions, target: TargetModel) -> tuple[Identification, list[str]]:
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

    def doubt(covariance: PoseCovariance) -> dict[str, Any]:
        return {
            "position_sigma_m": number(covariance.position_sigma),
            "rotation_sigma_rad": number(covariance.rotation_sigma),
            "size_sigma": number(covariance.size_sigma),
            "twist_m2": covariance.matrix.tolist(),
            "free": covariance.free.tolist(),
            "center_m": covariance.center.tolist(),
            "radius_m": covariance.radius,
        }

    return {
        "object": target.name,
        "decision": found.decision.value,
        "reason": found.reason,
        "X_sensor_target": found.X_sensor_target.tolist(),
        "center_m": transform_points(found.X_sensor_target, target.center).tolist(),
        "check": None if found.check is None else figures(found.check),
        "covariance": None if found.covariance is None else doubt(found.covariance),
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
