"""Visual log of a run, written during the run: `run.rrd` for the Rerun viewer, timeline "sim_time".

Rows are gathered in memory and sent as columns a few times per second of wall time. This costs the loop little, and a
killed run loses less than a second of work. Rerun is imported only when a log is opened. If the log can no longer be
written (the disk is full), it is abandoned with one line on stderr and the run continues.
"""

import ctypes
import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import Reference, Target, WorkState
from sim.interfaces.spatial import Array
from sim.loop.rollout import Moment, ticks_per_period
from sim.reporting.rerun_program import compact, spawn_viewer
from sim.reporting.rerun_scene import TIMELINE, blueprint, body_mesh, middle_of

FLUSH_WALL_S = 0.4  # [s] of wall time between flushes; a killed run loses this plus the time of writing
FORCE_SCALE = 1 / 150.0  # [m]/[N] of force arrows: those of the tool must be visible beyond the wrist
ROOM = 4 << 20  # [bytes] cut off a log that filled the disk, so that metrics and report can be written
LIFT = 0.006  # [m] offset of drawn paths from the surface, which would hide them
CURRENT_SCALE = 3.0  # [m]/[m/s] of the current's arrow

# Palette [Okabe 2008]: distinguishable for colour-blind readers, also on a dark background.
BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, YELLOW, GREY = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (213, 94, 0),
    (240, 228, 66),
    (160, 160, 160),
)
_LINES = (SKY, ORANGE, GREEN, VERMILION, PURPLE, YELLOW, BLUE, GREY)
_STATE_COLORS = dict(
    zip(
        WorkState,
        (GREY, SKY, BLUE, GREY, YELLOW, ORANGE, GREEN, YELLOW, ORANGE, PURPLE, PURPLE, SKY, VERMILION),
        strict=True,
    )
)


class RerunLog:
    """Observer of `sim.loop.rollout` that writes an .rrd file; use it as a context manager, or call `close`.

    Poses are logged every `pose_period`, series every `period`.
    """

    def __init__(
        self,
        file: str | Path,
        model: mujoco.MjModel,
        *,
        timestep: float | None = None,
        title: str = "uuv-arm",
        period: float = 0.02,
        pose_period: float = 0.04,
        view: bool = False,
    ) -> None:
        """Open the file and log the static scene.

        Args:
            file: File to write.
            model: Model of the plant.
            timestep: Step of the plant [s]; default: the model's.
            title: Name of the recording in the viewer.
            period: Of the series [s].
            pose_period: Of the poses [s].
            view: Also show the run in a Rerun viewer.

        Raises:
            ConfigurationError: The folder does not exist, the model has no vehicle, or a period is no multiple of
                `timestep`.
        """
        import rerun as rr  # heavy, and not needed by a run without a log

        path = Path(file)
        if not path.parent.is_dir():
            raise ConfigurationError(f"run log: there is no folder {str(path.parent)!r}")
        timestep = float(model.opt.timestep) if timestep is None else timestep
        self._rr = rr
        self._path = path
        self._whole: list[int] = []  # [bytes] readable size of the file after each flush
        self.lost = ""  # why the log was abandoned; empty: it was not
        self._vehicle = vehicle = Vehicle.of(model)
        self._pose_ticks = ticks_per_period(pose_period, timestep, "log's pose period")
        self._ticks = ticks_per_period(period, timestep, "log's period")
        self._stream = rr.RecordingStream("uuv-arm")
        if view:
            spawn_viewer(rr)
            self._stream.set_sinks(rr.FileSink(str(path)), rr.GrpcSink())
        else:
            self._stream.save(str(path))
        self._stream.send_recording_name(title)
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._moving = self._draw(model, data)
        self._stream.send_blueprint(blueprint(middle_of(model, data, vehicle)), make_active=True, make_default=True)
        self._bodies = np.array([body for body, _ in self._moving])
        self._n, self._m = len(vehicle.joint_names), len(vehicle.thruster_names)
        self._describe_series()
        # Rows, which `_send_series` and `_send_poses` split into columns.
        self._series: list[Array] = []
        self._poses: list[Array] = []
        self._cloud_colors: dict[str, tuple[int, int, int]] = {}
        self._tip: Array | None = None
        self._state: WorkState | None = None
        self._target: Target | None = None
        self._sent_at = perf_counter()
        self._time = 0.0  # [s] of the last step observed
        self._closed = False
        self.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def slow_ticks(self) -> tuple[int, ...]:
        """Ticks of the loop between rows of the log."""
        return self._ticks, self._pose_ticks

    def observe(self, moment: Moment) -> None:
        """Log one step."""
        if self.lost:
            return
        truth = moment.truth
        self._time = truth.time
        if moment.reference.state is not self._state:
            self._enter(moment.reference, truth.time)
        if moment.target is not None and moment.target is not self._target:
            self._found(moment.target, truth.time)
        if moment.tick % self._ticks == 0:
            self._series.append(self._series_row(moment))
            if perf_counter() - self._sent_at > FLUSH_WALL_S:
                self.flush()
        if moment.tick % self._pose_ticks == 0:
            self._poses.append(self._pose_row(moment))

    def log_cloud(
        self,
        name: str,
        points_W: ArrayLike,
        time: float = 0.0,
        *,
        color: Sequence[int] | None = None,
        radius: float = 0.002,
    ) -> None:
        """Show a point cloud under "world/clouds/<name>"; an empty cloud removes it.

        Args:
            name: Name of the cloud.
            points_W: (N, 3) [m]
            time: From which it is shown [s].
            color: RGB, 0 to 255; default: one per name.
            radius: Of the points [m].

        Raises:
            ConfigurationError: The shape is wrong.
        """
        rr = self._rr
        own = self._cloud_colors.setdefault(name, _LINES[len(self._cloud_colors) % len(_LINES)])
        points = np.asarray(points_W, dtype=np.float32)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ConfigurationError(f"cloud {name!r}: expected shape (N, 3), got {points.shape}")
        self._log(f"world/clouds/{name}", rr.Points3D(points, colors=color or own, radii=radius), time)

    def log_mesh(self, name: str, vertices_W: ArrayLike, triangles: ArrayLike, time: float = 0.0) -> None:
        """Show a measured surface under "world/found/<name>".

        Args:
            name: Name of the surface.
            vertices_W: (V, 3) [m]
            triangles: (T, 3)
            time: From which it is shown [s].
        """
        vertices = np.asarray(vertices_W, dtype=np.float32) + np.array([0.0, 0.0, LIFT], dtype=np.float32)
        mesh = self._rr.Mesh3D(
            vertex_positions=vertices, triangle_indices=np.asarray(triangles, dtype=np.uint32), albedo_factor=SKY
        )
        self._log(f"world/found/{name}", mesh, time)

    def log_arrows(self, name: str, origins_W: ArrayLike, vectors_W: ArrayLike, time: float = 0.0) -> None:
        """Show arrows under "world/found/<name>".

        Args:
            name: Name of the arrows.
            origins_W: (N, 3) [m]
            vectors_W: (N, 3) [m]
            time: From which they are shown [s].
        """
        color = self._cloud_colors.setdefault(name, _LINES[len(self._cloud_colors) % len(_LINES)])
        arrows = self._rr.Arrows3D(
            origins=np.asarray(origins_W), vectors=np.asarray(vectors_W), colors=color, radii=0.002
        )
        self._log(f"world/found/{name}", arrows, time)

    def flush(self) -> None:
        """Write all rows so far to the file; on failure the log is abandoned."""
        if self.lost:
            return
        try:
            self._send_series()
            self._send_poses()
            self._stream.flush(timeout_sec=10.0)
            if self._path.is_file():
                self._whole.append(self._path.stat().st_size)
        except RuntimeError as error:  # of Rerun, whose writer has stopped
            self._give_up(str(error))
        self._sent_at = perf_counter()

    def close(self) -> None:
        """Write the remaining rows and close the file; idempotent."""
        if self._closed:
            return
        self._closed = True
        self.flush()
        if self.lost:
            self._cut()  # once more: the writer may have had rows left
        else:
            self._stream.disconnect()
            compact(self._path)

    def _give_up(self, reason: str) -> None:
        """Abandon the log with one message; keep the readable part of the file, less ROOM if the disk is full."""
        full = shutil.disk_usage(self._path.parent).free < ROOM
        self.lost = "no space left" if full else reason
        self._series.clear()
        self._poses.clear()
        print(f"run log: lost from {self._time:.1f} s on, the run goes on ({self.lost}): {self._path}", file=sys.stderr)
        # Closing or destroying a stream whose writer is dead can block forever: keep it alive.
        self._rr.unregister_shutdown()
        for each in (self._stream, getattr(self._stream, "inner", None)):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(each))
        most = (self._path.stat().st_size if self._path.is_file() else 0) - (ROOM if full else 0)
        self._whole = [size for size in self._whole if size <= most] or [0]
        self._cut()

    def _cut(self) -> None:
        """Truncate the file of an abandoned log to its size after a flush."""
        if self._path.is_file():
            os.truncate(self._path, self._whole[-1])

    # -- events ----------------------------------------------------------------------------------------------------

    def _log(self, entity: str, what: Any, time: float) -> None:
        if self.lost:
            return
        self._stream.set_time(TIMELINE, duration=time)
        self._stream.log(entity, what)
        self._stream.reset_time()

    def _enter(self, reference: Reference, time: float) -> None:
        rr, state = self._rr, reference.state
        self._state = state
        level = "WARN" if reference.note else "INFO"
        text = f"{state.value}: {reference.note}" if reference.note else state.value
        self._log("state/log", rr.TextLog(text, level=level, color=_STATE_COLORS[state]), time)
        self._log("state/now", rr.StateChange(state=state.value), time)
        self.flush()

    def _found(self, target: Target, time: float) -> None:
        rr = self._rr
        self._target = target
        verdict = "accepted" if target.accepted else f"refused: {target.reason}"
        text = f"target at {target.range_m:.2f} m, check {target.check_m * 1e3:.1f} mm: {verdict}"
        self._log("state/log", rr.TextLog(text, level="INFO" if target.accepted else "WARN"), time)
        if target.path is not None:
            lifted = target.path.p - LIFT * target.path.z
            self._log("world/path/planned", rr.LineStrips3D([lifted], colors=YELLOW, radii=0.004), time)

    # -- rows ------------------------------------------------------------------------------------------------------

    def _series_row(self, moment: Moment) -> Array:
        truth, reference = moment.truth, moment.reference
        commanded = _NOWHERE
        if reference.state is WorkState.WORK and reference.X_WG is not None:
            commanded = reference.X_WG[:3, 3] + (truth.time - reference.time) * reference.v_WG_W
        return np.concatenate(
            (
                (truth.time, reference.force, moment.command.contact.normal, truth.contact_normal),
                truth.p_pad - commanded,
                reference.v_WG_W,
                truth.R_WG[:, 2],
                truth.p_WB - reference.X_WB[:3, 3],
                truth.thrust,
                truth.q,
                truth.tau_drive,
            )
        )

    def _pose_row(self, moment: Moment) -> Array:
        truth, load = moment.truth, moment.command.hull_load
        working = moment.reference.state is WorkState.WORK
        return np.concatenate(
            (
                (truth.time, working),
                truth.xpos[self._bodies].ravel(),
                truth.xquat[self._bodies].ravel(),
                truth.p_pad,
                truth.R_WG[:, 2],
                truth.contact_force_W,
                truth.xpos[self._vehicle.arm_base],
                truth.p_WB,
                _STILL if load is None else truth.R_WB @ load.arm_wrench_B[:3],
                truth.current_W,
            )
        )

    def _send_series(self) -> None:
        if not self._series:
            return
        table = np.array(self._series)
        self._series.clear()
        n, m = self._n, self._m
        widths = (1, 3, 3, 3, 3, 3, m, n, n)
        time, force, error, velocity, axis, drift, thrust, q, tau = np.split(table, np.cumsum(widths)[:-1], axis=1)
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        tangent = np.divide(velocity, speed, out=np.full_like(velocity, np.nan), where=speed > 1e-6)
        parts = [np.sum(error * way, axis=1) for way in (tangent, np.cross(axis, tangent), axis)]
        self._columns("series/force", time, force)
        self._columns("series/path_error", time, 1e3 * np.column_stack(parts))
        self._columns("series/hull_drift", time, 1e3 * drift)
        self._columns("series/thrust", time, thrust)
        self._columns("series/joint_angle", time, np.degrees(q))
        self._columns("series/joint_torque", time, tau)

    def _columns(self, entity: str, time: Array, values: Array) -> None:
        rr = self._rr
        self._send(entity, time[:, 0], rr.Scalars.columns(scalars=values))

    def _send_poses(self) -> None:
        if not self._poses:
            return
        rr, table = self._rr, np.array(self._poses)
        self._poses.clear()
        k = len(self._bodies)
        widths = (1, 1, 3 * k, 4 * k, 3, 3, 3, 3, 3, 3, 3)
        parts = np.split(table, np.cumsum(widths)[:-1], axis=1)
        time, working, p, quat_wxyz, tip, axis, contact, base, hull, arm, current = parts
        time, rows = time[:, 0], len(table)
        p, quat_wxyz = p.reshape(rows, k, 3), quat_wxyz.reshape(rows, k, 4)
        for i, (_, entity) in enumerate(self._moving):
            xyzw = np.roll(quat_wxyz[:, i], -1, axis=1)  # Rerun's order
            self._send(entity, time, rr.Transform3D.columns(translation=p[:, i], quaternion=xyzw))
        above = hull + np.array([0.0, 0.0, 0.6])
        for name, origin, vector in (
            ("contact", tip, FORCE_SCALE * contact),
            ("arm_on_hull", base, FORCE_SCALE * arm),
            ("current", above, CURRENT_SCALE * current),
        ):
            self._send(f"world/arrows/{name}", time, rr.Arrows3D.columns(origins=origin, vectors=vector))
        self._send_done(time, working[:, 0] > 0.0, tip - 2.0 * LIFT * axis)  # over the planned one

    def _send_done(self, time: Array, working: np.ndarray, tip: Array) -> None:
        """Send the path pieces worked since the last pose; the view shows all up to its time."""
        rr = self._rr
        start = np.vstack([tip[:1] if self._tip is None else self._tip, tip[:-1]])
        self._tip = tip[-1:]
        if not working.any():
            return
        pieces = np.stack([start, tip], axis=1)[working]
        self._send("world/path/done", time[working], rr.LineStrips3D.columns(strips=list(pieces)))

    def _send(self, entity: str, time: Array, columns: Any) -> None:
        self._stream.send_columns(entity, indexes=[self._rr.TimeColumn(TIMELINE, duration=time)], columns=columns)

    # -- static content --------------------------------------------------------------------------------------------

    def _draw(self, model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[int, str]]:
        """Log the shape of every body once; return the vehicle's bodies, whose poses change, with their entities."""
        rr, moving = self._rr, []
        for body in range(model.nbody):
            name = model.body(body).name or f"body{body}"
            carried = model.body_rootid[body] == model.body_rootid[self._vehicle.hull]
            entity = f"world/vehicle/{name}" if carried else f"world/scene/{name}"
            mesh = body_mesh(model, body)
            if mesh is not None:
                vertices, normals, colors = mesh
                self._stream.log(
                    f"{entity}/shape",
                    rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, vertex_colors=colors),
                    static=True,
                )
            if carried:
                moving.append((body, entity))
            else:
                xyzw = np.roll(data.xquat[body], -1)
                self._stream.log(entity, rr.Transform3D(translation=data.xpos[body], quaternion=xyzw), static=True)
        for name, color, radius in (
            ("contact", VERMILION, 0.012),
            ("arm_on_hull", ORANGE, 0.012),
            ("current", SKY, 0.02),
        ):
            style = rr.Arrows3D.from_fields(
                colors=color, radii=radius, labels=name.replace("_", " "), show_labels=False
            )
            self._stream.log(f"world/arrows/{name}", style, static=True)
        self._stream.log("world/path/done", rr.LineStrips3D.from_fields(colors=GREEN, radii=0.009), static=True)
        return moving

    def _describe_series(self) -> None:
        rr, vehicle = self._rr, self._vehicle
        names = {
            "force": ("set [N]", "felt [N]", "true [N]"),
            "path_error": ("along [mm]", "across [mm]", "deeper [mm]"),
            "hull_drift": ("x [mm]", "y [mm]", "z [mm]"),
            "thrust": tuple(f"{name} [N]" for name in vehicle.thruster_names),
            "joint_angle": tuple(f"{name} [deg]" for name in vehicle.joint_names),
            "joint_torque": tuple(f"{name} [N m]" for name in vehicle.joint_names),
        }
        for name, labels in names.items():
            colors = [_LINES[i % len(_LINES)] for i in range(len(labels))]
            if name == "force":
                colors = [YELLOW, ORANGE, SKY]
            self._stream.log(f"series/{name}", rr.SeriesLines(names=labels, colors=colors, widths=1.5), static=True)
        self._stream.log(
            "state/now",
            rr.StateConfiguration(
                values=[state.value for state in WorkState], colors=[_STATE_COLORS[state] for state in WorkState]
            ),
            static=True,
        )


_NOWHERE = np.full(3, np.nan)
_STILL = np.zeros(3)
