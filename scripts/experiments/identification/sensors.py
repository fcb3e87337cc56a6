"""Depth and identification errors of stereo cameras behind a flat port, by calibration, and of a 3D
sonar.

All sensors see the same scenes: a barrel that stands on the seabed. Stereo is ideal without a port,
or behind a flat port with three calibrations. A figure shows the depth errors over the image.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, radians
from typing import TYPE_CHECKING

import numpy as np

from experiments.identification.scene_cases import identified, surface_of
from uuv.clouds.frames import FOCAL, Camera, Imager, ObjectScene
from uuv.clouds.object_scenes import RANGES, object_scene
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.perception.clouds.scan import SensorModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.depth_camera import NOISE, OPTICS, Optics
from uuv.sim.sensors.refraction import FlatPort, in_air, in_water

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CORNER = 0.5 * float(np.hypot(OPTICS.width, OPTICS.height))  # [px] from the image's middle
PORT = FlatPort()
IN_AIR = "port, calibrated in air"
VIEWS: Mapping[str, Optics] = {
    "no port": OPTICS,
    IN_AIR: Optics(port=PORT, calibration=in_air(FOCAL)),
    "port, in water, lens for centre": Optics(
        port=PORT, calibration=in_water(PORT, FOCAL, CORNER, move_center=False)
    ),
    "port, in water": Optics(port=PORT, calibration=in_water(PORT, FOCAL, CORNER)),
}
TRIED: Mapping[str, Camera | Imager] = {
    **{
        name: Camera(stereo=NOISE, optics=optics, model=SensorModel(focal=optics.rectified.focal))
        for name, optics in VIEWS.items()
    },
    "sonar": Imager(),
}
START_ERROR = (0.3, radians(30.0))  # [m], [rad] of the coarse start, at most
_LIMITS = {IN_AIR: 500.0}  # [mm] of the colours, where they are wider
_LIMIT = 50.0  # [mm]


@dataclass(frozen=True, kw_only=True)
class SensorCase:
    """One scene for all sensors."""

    ranges: tuple[float, float] = RANGES
    """Distance from sensor to barrel [m]."""
    seed: int

    def __post_init__(self) -> None:
        if not 0.3 < self.ranges[0] <= self.ranges[1] < 10.0:
            raise ConfigurationError(f"--ranges: must rise within 0.3 and 10 m, got {self.ranges}")

    def scene(self, sensor: str) -> ObjectScene:
        """The scene as a sensor of TRIED sees it."""
        return object_scene(
            "barrel",
            self.seed,
            TRIED[sensor],
            ranges=self.ranges,
            start_error=START_ERROR,
            gap=(0.0, 0.0),  # it stands on the seabed
        )


@dataclass(frozen=True, kw_only=True)
class SensorRow:
    """Errors by sensor."""

    range: float = column("range", "m")
    depth: Mapping[str, float | None] = column(
        "depth or range", "mm", digits=1, factor=1e3, by="sensor"
    )
    position: Mapping[str, float] = column("position", "mm", digits=1, factor=1e3, by="sensor")
    axis: Mapping[str, float] = column("axis", "deg", digits=2, factor=degrees(1.0), by="sensor")
    accepted: Mapping[str, bool] = column("accepted", by="sensor")


@experiment("sensors", seeds=20, quick={"runs": 3})
def sensors(case: SensorCase) -> SensorRow:
    """Identifies the barrel in one scene by each sensor."""
    scenes = {name: case.scene(name) for name in TRIED}
    verdicts = {
        name: identified(scene, surface_of(scene.target.name)) for name, scene in scenes.items()
    }
    errors = {name: scenes[name].error(v.X_sensor_target) for name, v in verdicts.items()}

    return SensorRow(
        range=next(iter(scenes.values())).range_m,
        depth={name: _median(depth_error(scene)) for name, scene in scenes.items()},
        position={name: position for name, (position, _) in errors.items()},
        axis={name: axis for name, (_, axis) in errors.items()},
        accepted={name: verdict.accepted for name, verdict in verdicts.items()},
    )


def depth_error(scene: ObjectScene) -> Array:
    """Error of depth, of a sonar of range, (h, w) [m] in one more frame of a scene, along the rays
    that the sensor's calibration assumes.
    """
    reading = scene.sensor.readings(scene.model, Streams(scene.seed)["depth noise"])
    return reading - scene.sensor.exact(scene.model)


def _median(error: Array) -> float | None:
    """Median of the sizes of errors that are finite."""
    finite = np.abs(error[np.isfinite(error)])
    return float(np.median(finite)) if len(finite) else None


def depth_errors(rows: list[Row]) -> "tuple[str, str, Figure]":
    """Picture of the depth errors in the first scene, one panel for each sensor."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    case = SensorCase(ranges=tuple(rows[0]["ranges"]), seed=rows[0]["seed"])
    figure = Figure(figsize=(16, 3.6), layout="constrained")
    colors = colormaps["RdBu"].with_extremes(bad="0.2")

    for panel, name in zip(figure.subplots(1, len(TRIED)), TRIED, strict=True):
        error = 1e3 * depth_error(case.scene(name))
        error[~np.isfinite(error)] = np.nan
        limit = _LIMITS.get(name, _LIMIT)
        shown = panel.imshow(error, cmap=colors, vmin=-limit, vmax=limit, aspect="auto")
        panel.set_title(f"{name}\nmedian |error| {np.nanmedian(np.abs(error)):.0f} mm", fontsize=10)
        panel.set_xticks([])
        panel.set_yticks([])
        figure.colorbar(
            shown, ax=panel, label="depth read less true [mm]; grey: nothing", location="bottom"
        )
    return "Depth errors", "Depth read less true depth over the image, in the first scene.", figure


sensors.page = (
    Page()
    .table(
        "A barrel seen by cameras and a sonar",
        by="sensor",
        columns=[
            stat("median", "depth"),
            stat("median", "position"),
            stat("largest", "position"),
            stat("median", "axis"),
            stat("share", "accepted", digits=0),
        ],
    )
    .add(depth_errors)
)

if __name__ == "__main__":
    run_scenario(sensors.main)
