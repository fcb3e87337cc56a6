"""Static content of a visual log: shapes of a model's bodies, and the layout of the viewer."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.surface.mesh_surface import Surface
from uuv.sim.interfaces import palette
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.palette import rgb
from uuv.sim.interfaces.spatial import Array
from uuv.sim.sensors.tessellation import tessellate

StaticLog = Callable[[str, Any], None]  # takes an entity and what it is

TIMELINE = "sim_time"
LIFT = 0.006  # [m] offset of drawn paths from the surface, which would hide them

BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, YELLOW = map(
    rgb,
    (
        palette.BLUE,
        palette.ORANGE,
        palette.GREEN,
        palette.PURPLE,
        palette.SKY,
        palette.VERMILION,
        palette.YELLOW,
    ),
)
GREY = (160, 160, 160)
LINES = (SKY, ORANGE, GREEN, VERMILION, PURPLE, YELLOW, BLUE, GREY)
STATE_COLORS = dict(
    zip(
        WorkState,
        (
            GREY,
            SKY,
            BLUE,
            GREY,
            YELLOW,
            ORANGE,
            GREEN,
            YELLOW,
            ORANGE,
            PURPLE,
            PURPLE,
            SKY,
            VERMILION,
        ),
        strict=True,
    )
)


def body_mesh(
    model: mujoco.MjModel, body: int, *, plane: float = 4.0
) -> tuple[Array, Array, np.ndarray] | None:
    """Corners (V, 3) [m], normals (V, 3), colours (V, 4) of a body's visible geoms, or None.

    Args:
        model: Compiled model.
        body: Its index.
        plane: [m] largest half side of a plane, so that the first view shows what is on it.
    """
    corners = []
    normals = []
    colors = []
    first = int(model.body_geomadr[body])
    count = int(model.body_geomnum[body])

    for geom in range(first, first + count):
        rgba = np.asarray(model.geom_rgba[geom])
        if rgba[3] == 0.0:
            continue
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            vertices, triangles = _plane(model.geom_size[geom], plane)
        else:
            vertices, triangles = tessellate(model, geom)

        surface = Surface.of(vertices, triangles)
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, model.geom_quat[geom])
        R_BG = R.reshape(3, 3)
        corners.append(surface.corners.reshape(-1, 3) @ R_BG.T + model.geom_pos[geom])
        normals.append(surface.normals.reshape(-1, 3) @ R_BG.T)
        colors.append(np.tile(np.round(255 * rgba).astype(np.uint8), (len(corners[-1]), 1)))

    return (
        (np.concatenate(corners), np.concatenate(normals), np.concatenate(colors))
        if corners
        else None
    )


def middle_of(model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle) -> Array:
    """Point to view: between the vehicle and the objects or height fields fixed in the world.

    Args:
        model: Compiled model.
        data: With up-to-date kinematics.
        vehicle: Vehicle of `model`.

    Returns:
        Point (3,) [m] in W.
    """
    fixed = [b for b in range(1, model.nbody) if model.body_weldid[b] == 0]
    fields = np.asarray(model.geom_type) == mujoco.mjtGeom.mjGEOM_HFIELD
    p_fixed = np.vstack([data.xpos[fixed], data.geom_xpos[fields]])
    hull = data.xpos[vehicle.hull]
    return 0.5 * (hull + p_fixed.mean(axis=0)) if len(p_fixed) else hull


def _plane(size: Array, most: float) -> tuple[Array, np.ndarray]:
    """Rectangle for a plane geom, of half sides [m] up to `most`, which an endless one has."""
    x, y = (min(half, most) if half > 0.0 else most for half in size[:2])
    return np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]), np.array(
        [[0, 1, 2], [0, 2, 3]]
    )


def blueprint(middle: Array) -> Any:
    """Viewer layout: 3D view around `middle` (3,) [m], time series beside it, states below."""
    import rerun as rr
    import rerun.blueprint as rrb

    until_now = rr.VisibleTimeRange(
        TIMELINE,
        start=rr.TimeRangeBoundary.infinite(),
        end=rr.TimeRangeBoundary.cursor_relative(seconds=0.0),
    )
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)

    def plot(name: str, title: str) -> Any:
        return rrb.TimeSeriesView(origin=f"series/{name}", name=title, plot_legend=legend)

    scene = rrb.Spatial3DView(
        origin="world",
        name="Scene",
        background=(24, 34, 46),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=middle + np.array([2.0, -3.2, 1.4]), look_target=middle
        ),
        overrides={"world/path/done": rrb.VisibleTimeRanges(until_now)},
    )

    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                scene,
                # time series, in tabs
                rrb.Tabs(
                    rrb.Vertical(
                        plot("force", "Normal force"),
                        plot("tangential_force", "Tangential force"),
                        plot("path_error", "Tip against commanded path"),
                        plot("hull_drift", "Hull against reference"),
                        name="Work",
                    ),
                    rrb.Vertical(
                        plot("thrust", "Thrust"),
                        plot("joint_torque", "Joint torques"),
                        plot("joint_angle", "Joint angles"),
                        name="Drives",
                    ),
                    rrb.Vertical(
                        plot("navigation", "Hull position: error and standard deviation"),
                        rrb.Spatial2DView(origin="world/camera", name="Depth image"),
                        name="Senses",
                    ),
                ),
                column_shares=[3, 2],
            ),
            # states and log, below
            rrb.Horizontal(
                rrb.StateTimelineView(origin="state/now", name="State"),
                rrb.TextLogView(origin="state/log", name="Log"),
                column_shares=[3, 2],
            ),
            row_shares=[4, 1],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def draw(
    log: StaticLog, model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle
) -> list[tuple[int, str]]:
    """Log the shape of every body once.

    Args:
        log: logs an entity that does not change.
        model: Compiled model.
        data: With up-to-date kinematics.
        vehicle: Vehicle of `model`.

    Returns:
        The vehicle's bodies, whose poses change, with their entities.
    """
    import rerun as rr

    moving = []
    log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)

    for body in range(model.nbody):
        name = model.body(body).name or f"body{body}"
        carried = model.body_rootid[body] == model.body_rootid[vehicle.hull]
        entity = f"world/vehicle/{name}" if carried else f"world/scene/{name}"

        mesh = body_mesh(model, body)
        if mesh is not None:
            vertices, normals, colors = mesh
            log(
                f"{entity}/shape",
                rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, vertex_colors=colors),
            )

        if carried:
            moving.append((body, entity))
        else:
            xyzw = np.roll(data.xquat[body], -1)
            log(entity, rr.Transform3D(translation=data.xpos[body], quaternion=xyzw))

    # Styles of the arrows and of the worked path, which the rows fill.
    for name, color, radius in (
        ("contact", VERMILION, 0.012),
        ("arm_on_hull", ORANGE, 0.012),
        ("jets", GREEN, 0.015),
        ("current", SKY, 0.02),
    ):
        style = rr.Arrows3D.from_fields(
            colors=color, radii=radius, labels=name.replace("_", " "), show_labels=False
        )
        log(f"world/arrows/{name}", style)
    log("world/path/done", rr.LineStrips3D.from_fields(colors=GREEN, radii=0.009))

    return moving


def describe_series(log: StaticLog, vehicle: Vehicle) -> None:
    """Log names and colours of the series and states.

    Args:
        log: logs an entity that does not change.
        vehicle: the vehicle.
    """
    import rerun as rr

    names = {
        "force": ("set [N]", "felt [N]", "true [N]"),
        "tangential_force": ("felt [N]", "true [N]"),
        "path_error": ("along [mm]", "across [mm]", "deeper [mm]"),
        "hull_drift": ("x [mm]", "y [mm]", "z [mm]"),
        "thrust": tuple(f"{name} [N]" for name in vehicle.thruster_names),
        "joint_angle": tuple(f"{name} [deg]" for name in vehicle.joint_names),
        "joint_torque": tuple(f"{name} [N m]" for name in vehicle.joint_names),
        "navigation": (
            *(f"error {axis} [mm]" for axis in "xyz"),
            *(f"sigma {axis} [mm]" for axis in "xyz"),
        ),
        "path_error/bound": ("bound [mm]", "bound [mm]"),
    }

    for name, labels in names.items():
        colors = [LINES[i % len(LINES)] for i in range(len(labels))]
        if name in ("force", "tangential_force"):
            colors = [YELLOW, ORANGE, SKY][-len(labels) :]
        if name.endswith("/bound"):
            colors = [VERMILION] * len(labels)
        log(f"series/{name}", rr.SeriesLines(names=labels, colors=colors, widths=1.5))

    log(
        "state/now",
        rr.StateConfiguration(
            values=[state.value for state in WorkState],
            colors=[STATE_COLORS[state] for state in WorkState],
        ),
    )
