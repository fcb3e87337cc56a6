"""Identification of a known object in one cloud, from a file or a simulated scene."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.clouds.frames import ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.clouds.options import IdentificationOptions
from uuv.models.objects import targets
from uuv.models.objects.targets import TargetModel
from uuv.perception.clouds.cloud_files import load_cloud
from uuv.perception.clouds.scan import SensorModel
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.pose_check import PoseCheck
from uuv.perception.registration.pose_covariance import PoseCovariance
from uuv.perception.registration.recognition import Recognition, model_files, recognise
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, transform_points
from uuv.site import with_growth_and_dents

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# multiple of the cloud's extent above which a model's size indicates a mistake in the units
_TOO_LARGE = 20.0
_SHOWN = 20_000  # largest number of points of each cloud in the picture


def models_among(options: IdentificationOptions) -> dict[str, TargetModel]:
    """The models of `options.among` by name; a folder gives one model for each file.

    Raises:
        ConfigurationError: A name is unknown, a file cannot be read, a folder has no models, or two
            models have the same name.
    """
    files = [
        file
        for path in options.among
        for file in (model_files(path) if Path(path).is_dir() else [path])
    ]
    models: dict[str, TargetModel] = {}
    for file in files:
        # A scale applies to files only, since named objects have their size.
        model = targets.of(file, options.mesh_scale if Path(file).suffix else None)
        if model.name in models:
            raise ConfigurationError(
                f"--among: the names of the models must differ, got {model.name!r} twice"
            )
        models[model.name] = model
    return models


@dataclass(frozen=True, slots=True)
class Seen:
    """A scan as input of `identify`, with the information known beforehand."""

    cloud: Any  # points or Scan
    approach: Any  # (3,) [m], None if unknown
    orientation: Any  # (3, 3), None if unknown
    sensor: SensorModel
    notes: list[str]  # notes on the input
    scene: ObjectScene | None  # the scene, if it was simulated


def seen_by(options: IdentificationOptions, target: TargetModel, sizes: dict[str, float]) -> Seen:
    """The cloud, or the simulated scene with `target`, of `options`.

    Args:
        options: Options of the command.
        target: Object of the simulated scene.
        sizes: Radius [m] of each model that is searched for, by name.

    Raises:
        ConfigurationError: The cloud is unusable, its units do not match a model's, or a number is
            out of range.
    """
    R = None if options.rotation is None else exp_so3(np.radians(options.rotation))

    if options.cloud is not None:
        cloud = load_cloud(options.cloud, options.scale)
        points = cloud.points.reshape(-1, 3)
        extent = 2.0 * float(
            np.nanmax(np.linalg.norm(points - np.nanmedian(points, axis=0), axis=1))
        )

        for name, radius in sizes.items():
            if 2.0 * radius > _TOO_LARGE * extent:
                raise ConfigurationError(
                    f"{name!r} is {2.0 * radius:.3g} m across, the cloud {extent:.3g} m; if one of "
                    "them is in millimetres, give --scale (for the cloud) or --mesh-scale"
                )

        return Seen(
            cloud.points,
            options.approach,
            R,
            with_noise(SensorModel(), options.sigma),
            [*cloud.notes],
            None,
        )

    grown = with_growth_and_dents(
        target, options.fouled, options.dented, np.random.default_rng([options.seed, 4])
    )
    scene = object_scene(target, options.seed, options.sensor, there=grown)
    return Seen(
        cloud=scene.scan,
        approach=scene.approach if options.approach is None else options.approach,
        orientation=scene.orientation if R is None else R,
        sensor=with_noise(scene.sensor.model, options.sigma),
        notes=[],
        scene=scene,
    )


def found_in(
    options: IdentificationOptions, target: TargetModel
) -> tuple[Identification, list[str]]:
    """Identify the object in the cloud or simulated scene of `options`; also return notes.

    Raises:
        ConfigurationError: The cloud is unusable, its units do not match the object's, or a number
            is out of range.
    """
    observed = seen_by(options, target, {target.name: target.radius})
    identification = identify(
        observed.cloud,
        target,
        observed.approach,
        observed.orientation,
        sensor=observed.sensor,
        seed=options.seed,
        method=options.method,
    )

    return identification, _notes(options, observed, identification)


def recognised_in(
    options: IdentificationOptions, models: dict[str, TargetModel]
) -> tuple[Recognition, list[str]]:
    """Recognise which of `models` is in the cloud or scene of `options`; also return notes.

    Raises:
        ConfigurationError: As for `found_in`, or the method is not that of the library.
    """
    if options.method != "planes":
        raise ConfigurationError(f"--among: needs --method planes, got {options.method}")

    shown = next(iter(models.values())) if options.cloud is not None else targets.of(options.object)
    observed = seen_by(options, shown, {name: model.radius for name, model in models.items()})

    # Each model has its own axes, so that a coarse attitude of one object does not apply.
    orientation = None if options.rotation is None else observed.orientation
    recognition = recognise(
        observed.cloud,
        models,
        observed.approach,
        orientation,
        sensor=observed.sensor,
        seed=options.seed,
    )

    return recognition, _notes(options, observed, recognition.found)


def _notes(
    options: IdentificationOptions, observed: Seen, identification: Identification
) -> list[str]:
    notes = [*observed.notes, *([identification.model_note] if identification.model_note else [])]
    if observed.scene is None:
        return notes

    position, angle = observed.scene.error(identification.X_sensor_target)
    error = (
        f"error {1e3 * position:.2f} mm and {np.degrees(angle):.2f} deg, at "
        f"{observed.scene.range_m:.2f} m"
    )
    return [*notes, f"scene of seed {options.seed}, {options.sensor}: {error}"]


def with_noise(sensor: SensorModel, sigma: float | None) -> SensorModel:
    """`sensor` with depth noise `sigma` [m] at 1 m range; unchanged where `sigma` is None."""
    return (
        sensor
        if sigma is None
        else replace(sensor, disparity_sigma=sigma * sensor.focal * sensor.baseline)
    )


def report(identification: Identification, target: TargetModel, notes: list[str]) -> dict[str, Any]:
    """Contents of identification.json; numbers that are not finite become None.

    Args:
        identification: Result of the identification.
        target: Model of the object.
        notes: Notes on the input.

    Returns:
        Dictionary for a JSON file, in SI units, with poses (4, 4) in the sensor's frame.
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

    symmetry, covariance = identification.symmetry, identification.covariance
    return {
        "object": target.name,
        "decision": identification.decision.value,
        "reason": identification.reason,
        "X_sensor_target": identification.X_sensor_target.tolist(),
        "center_m": transform_points(identification.X_sensor_target, target.center).tolist(),
        # Quality of the fit, and its uncertainty.
        "check": None if identification.check is None else figures(identification.check),
        "covariance": None if covariance is None else doubt(covariance),
        "score": identification.score,
        # Poses that the cloud cannot distinguish.
        "symmetry": {
            "axis": None if symmetry.axis is None else symmetry.axis.tolist(),
            "turns": symmetry.turns,
            "policy": symmetry.policy,
        },
        "hypotheses": [
            {
                "log_likelihood": hypothesis.log_likelihood,
                "X_sensor_target": hypothesis.X_sensor_target.tolist(),
            }
            for hypothesis in identification.hypotheses
        ],
        "duration_s": identification.duration_s,
        "notes": notes,
    }


def candidates_of(recognition: Recognition) -> list[dict[str, Any]]:
    """The candidates of a recognition for a JSON file, the most likely first."""
    return [
        {
            "object": candidate.name,
            "log_likelihood": float(candidate.log_likelihood)
            if np.isfinite(candidate.log_likelihood)
            else None,
            "decision": candidate.found.decision.value,
            "reason": candidate.found.reason,
            "X_sensor_target": candidate.found.X_sensor_target.tolist(),
        }
        for candidate in recognition.candidates
    ]


def picture(identification: Identification, title: str) -> "Figure":
    """Scatter plots of cloud and fitted model: along the sensor's z axis, and from the side."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 5), layout="constrained")
    parts = (
        (identification.model_after, "tab:orange", "model at the identified pose", 8.0),
        (identification.cloud, "k", "cloud", 1.0),
    )
    left, right = figure.subplots(1, 2)

    for axes, x, name in ((left, 0, "x"), (right, 2, "z")):
        for points, colour, label, size in parts:
            some = points[:: max(1, len(points) // _SHOWN)]
            axes.scatter(some[:, x], some[:, 1], s=size, c=colour, label=label, linewidths=0.0)
        axes.set(aspect="equal", xlabel=f"{name} [m]", ylabel="y [m]")
        axes.invert_yaxis()

    figure.legend(
        *left.get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=4.0
    )
    figure.suptitle(title, fontsize="medium")
    return figure
