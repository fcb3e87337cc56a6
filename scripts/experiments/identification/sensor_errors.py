"""Depth and identification errors of cameras behind a flat port and of a sonar: one scene, and the
table of many.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from uuv.clouds.frames import camera_pose
from uuv.clouds.object_scenes import add_seabed
from uuv.experiment import Row, Summary, Table
from uuv.models.objects.target_model import TargetModel
from uuv.models.objects.targets import barrel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.clouds.sonar_cloud import sonar_model, without_isolated_echoes
from uuv.perception.registration.identification import identify
from uuv.sim.interfaces.messages import DepthImage, SonarScan
from uuv.sim.interfaces.spatial import Array, exp_so3
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.depth_camera import DepthCamera, Optics
from uuv.sim.sensors.refraction import FlatPort, in_air, in_water
from uuv.sim.sensors.sonar import BEAMS, Sonar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOCAL, CORNER = 554.0, 400.0  # [px] focal length; distance from the image's middle to its corner
PORT = FlatPort()
CAMERAS: Mapping[str, Optics] = {
    "no port": Optics(),
    "port, calibrated in air": Optics(port=PORT, calibration=in_air(FOCAL)),
    "port, in water, lens for centre": Optics(
        port=PORT, calibration=in_water(PORT, FOCAL, CORNER, move_center=False)
    ),
    "port, in water": Optics(port=PORT),
}
FLOOR = 0.5  # [m] of the seabed below the axis of the barrel
SONAR = "sonar"
OF_SONAR = sonar_model(BEAMS.pitch)


@dataclass(frozen=True)
class SensorCase:
    """One scene for all sensors; a case of the study."""

    run: int
    seed: int  # of the study
    ranges: tuple[float, float]  # [m] from sensor to barrel


def scene(
    rng: np.random.Generator, target: TargetModel, ranges: tuple[float, float]
) -> tuple[mujoco.MjModel, Array]:
    """Barrel on its stand on a flat seabed, seen from the origin of W.

    Args:
        rng: Draws the view.
        target: The barrel.
        ranges: [m] bounds of the distance.

    Returns:
        Compiled model, pose X_ST (4, 4) of the barrel in the sensor frame.
    """
    distance, climb, heading = rng.uniform([ranges[0], 0.2, -np.pi], [ranges[1], 1.1, np.pi])
    p_TS = distance * np.array(
        [np.cos(climb) * np.cos(heading), np.cos(climb) * np.sin(heading), np.sin(climb)]
    )
    X_ST = camera_pose(p_TS, np.zeros(3))

    spec = mujoco.MjSpec()
    target.add_to(spec, X_ST)
    add_seabed(spec, X_ST, -FLOOR)
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

    camera = DepthCamera(model, "world", np.eye(4), optics=CAMERAS[name])
    return camera.step(camera.init(np.random.default_rng(seed)), data)[1]


def depth_error(seen: DepthImage | SonarScan, model: mujoco.MjModel) -> Array:
    """Error of depth or range (H, W) [m], along the rays that the sensor's model assumes."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    height, width = (seen.depth if isinstance(seen, DepthImage) else seen.points[..., 0]).shape

    if isinstance(seen, SonarScan):
        exact = Sonar(model, "world", np.eye(4), noise=None)
        true = exact.ping(data, np.random.default_rng(0))
        return np.linalg.norm(seen.points, axis=-1) - np.linalg.norm(true, axis=-1)

    optics = Optics(width=width, height=height, focal=float(seen.K[0, 0]))
    ideal = DepthCamera(model, "world", seen.X_BC, noise=None, optics=optics)
    true = ideal.step(ideal.init(np.random.default_rng(0)), data)[1].depth
    return seen.depth - true


def run(case: SensorCase) -> Row:
    """Errors of each sensor in one scene, by its name."""
    streams, target = Streams(case.seed, case.run), barrel()
    model, X_ST = scene(streams["view"], target, case.ranges)

    # The coarse start: a displaced position and a turned attitude.
    aside = streams["approach direction"].standard_normal(3)
    distance = streams["approach distance"].uniform(0.0, 0.3)
    approach = X_ST[:3, 3] + distance * aside / np.linalg.norm(aside)
    axis = streams["turn axis"].standard_normal(3)
    angle = np.radians(streams["turn angle"].uniform(0.0, 30.0))
    turn = exp_so3(angle * axis / np.linalg.norm(axis)) @ X_ST[:3, :3]

    sensors = {}
    for name in (*CAMERAS, SONAR):
        seen = look(name, model, case.run)
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

        sensors[name] = {
            "range_m": float(np.linalg.norm(X_ST[:3, 3])),
            "depth_error_m": float(np.median(finite)) if len(finite) else None,
            "position_m": float(np.linalg.norm(off)),
            "axis_deg": float(np.degrees(np.arccos(min(1.0, tilt)))),
            "accepted": float(found.accepted),
        }

    return {"run": case.run, "sensors": sensors}


def summarise(rows: list[Row], seed: int, ranges: tuple[float, float]) -> Summary:
    """Errors by sensor.

    Args:
        rows: Rows of all scenes.
        seed: Seed of the study.
        ranges: [m] bounds of the distance.
    """
    cells, metrics = [], {}

    for name in (*CAMERAS, SONAR):
        depth, position, axis, accepted = (
            np.array([row["sensors"][name][key] for row in rows], dtype=np.float64)
            for key in ("depth_error_m", "position_m", "axis_deg", "accepted")
        )

        metrics[name] = {
            "depth_error_median_m": float(np.nanmedian(depth)),
            "position_median_m": float(np.median(position)),
            "position_max_m": float(position.max()),
            "axis_median_deg": float(np.median(axis)),
            "accepted": int(accepted.sum()),
        }

        cells.append(
            (
                name,
                f"{1e3 * np.nanmedian(depth):.1f}",
                f"{1e3 * np.median(position):.1f}, {1e3 * position.max():.1f}",
                f"{np.median(axis):.2f}",
                f"{accepted.sum():.0f} of {len(rows)}",
            )
        )

    table = Table(
        title=f"Barrel, {len(rows)} scenes at {ranges[0]} to {ranges[1]} m",
        columns=(
            "sensor",
            "depth, median [mm]",
            "position, median, worst [mm]",
            "axis, median [deg]",
            "accepted",
        ),
        rows=cells,
    )

    return Summary(metrics={"sensors": metrics}, tables=[table], pictures=_pictures(seed, ranges))


def _pictures(seed: int, ranges: tuple[float, float]) -> Iterator[tuple[str, str, "Figure"]]:
    yield (
        "Depth errors",
        "Depth read less true depth over the image, in the first scene.",
        picture(seed, ranges),
    )


def picture(seed: int, ranges: tuple[float, float]) -> "Figure":
    """Plots the depth errors of the first scene of a study, one panel for each sensor.

    Args:
        seed: Seed of the study.
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
        figure.colorbar(
            shown, ax=panel, label="depth read less true [mm]; grey: nothing", location="bottom"
        )
    return figure
