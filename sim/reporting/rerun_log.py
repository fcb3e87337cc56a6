"""Visual log of a run, written during the run: `run.rrd` for the Rerun viewer, timeline "sim_time".

Rows are gathered in memory and sent as columns a few times per second of wall time. This costs the
loop little, and a killed run loses less than a second of work. Rerun is imported only when a log is
opened. If the log can no longer be written (the disk is full), it is abandoned with one line on
stderr and the run continues.
"""

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.messages import DepthImage, ObjectMotion, Reference, Target, WorkState
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import (
    Array,
    inverse,
    pose,
    quat_wxyz_from_rotation,
    transform_points,
)
from uuv.sim.loop.rollout import Moment, ticks_per_period
from uuv.sim.reporting.rerun_rows import PoseRows, SeriesRows
from uuv.sim.reporting.rerun_scene import (
    LIFT,
    LINES,
    SKY,
    STATE_COLORS,
    YELLOW,
    blueprint,
    describe_series,
    draw,
    middle_of,
)
from uuv.sim.reporting.rerun_stream import LogStream

_ENLARGED = 20.0  # [-] scale at which a few millimetres show beside an object of half a metre
# [s] of wall time between flushes; a killed run loses this plus the time of writing
FLUSH_WALL_S = 0.4


class RerunLog:
    """Observer of `uuv.sim.loop.rollout` that writes an .rrd; use it in `with`, or call `close`.

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
        bounds: Bounds | None = None,
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
            bounds: Bounds to draw; None: none.

        Raises:
            ConfigurationError: The folder does not exist, the model has no vehicle, or a period is
                no multiple of `timestep`.
            MissingLibraryError: Rerun is not installed.
        """
        with wanted():
            import rerun as rr  # heavy, and not needed by a run without a log

        path = Path(file)
        if not path.parent.is_dir():
            raise ConfigurationError(f"run log: there is no folder {str(path.parent)!r}")
        timestep = float(model.opt.timestep) if timestep is None else timestep

        self._rr = rr
        vehicle = Vehicle.of(model)
        self._pose_ticks = ticks_per_period(pose_period, timestep, "log's pose period")
        self._ticks = ticks_per_period(period, timestep, "log's period")

        # Static content.
        self._stream = stream = LogStream(path, title, view=view)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        moving = draw(stream.static, model, data, vehicle)
        stream.show(blueprint(middle_of(model, data, vehicle)))
        describe_series(stream.static, vehicle)

        # Thrusters in the frame of the hull.
        sites = model.actuator_trnid[vehicle.thruster_actuators, 0]
        places = inverse(pose(data.xmat[vehicle.hull].reshape(3, 3), data.xpos[vehicle.hull]))
        thrusters_B = transform_points(places, data.site_xpos[sites])

        self._series, self._poses = (
            SeriesRows(vehicle, bounds),
            PoseRows(vehicle, moving, thrusters_B),
        )

        # What was logged last.
        self._cloud_colors: dict[str, tuple[int, int, int]] = {}
        self._state: WorkState | None = None
        self._target: Target | None = None
        self._goes_by: Target | None = None
        self._motion_said = False
        self._frame: DepthImage | None = None
        self._note = ""
        self._sent_at = perf_counter()
        self._time = 0.0  # [s] of the last step observed
        self._closed = False

        self.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def lost(self) -> str:
        """Reason why the log was abandoned; empty if it was not."""
        return self._stream.lost

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

        # What has changed.
        if moment.reference.state is not self._state:
            self._enter(moment.reference, truth.time)
        if moment.target is not None and moment.target is not self._target:
            self._log_target(moment.target, truth.time)
        if moment.reference.target is not None and moment.reference.target is not self._goes_by:
            self._decided(moment.reference.target, truth.time)
        if moment.motion is not None and moment.motion.moved and not self._motion_said:
            self._motion_said = True
            self._moved(moment.motion, truth.time)
        if isinstance(moment.frame, DepthImage) and moment.frame is not self._frame:
            self._frame = moment.frame
            self._look(moment.frame, pose(truth.R_WB, truth.p_WB), truth.time)

        # Rows, each kind at its rate.
        if moment.tick % self._ticks == 0:
            self._series.add(moment)
            if perf_counter() - self._sent_at > FLUSH_WALL_S:
                self.flush()
        if moment.tick % self._pose_ticks == 0:
            self._poses.add(moment)

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
        tint = self._cloud_colors.setdefault(name, LINES[len(self._cloud_colors) % len(LINES)])
        points = np.asarray(points_W, dtype=np.float32)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ConfigurationError(f"cloud {name!r}: expected shape (N, 3), got {points.shape}")

        self._stream.event(
            f"world/clouds/{name}", rr.Points3D(points, colors=color or tint, radii=radius), time
        )

    def log_mesh(
        self,
        name: str,
        vertices_W: ArrayLike,
        triangles: ArrayLike,
        time: float = 0.0,
        colours: ArrayLike | None = None,
    ) -> None:
        """Show a measured surface under "world/found/<name>".

        Args:
            name: Name of the surface.
            vertices_W: (V, 3) [m]
            triangles: (T, 3)
            time: From which it is shown [s].
            colours: (V, 3) of the vertices, in [0, 1]; None: one colour.
        """
        vertices = np.asarray(vertices_W, dtype=np.float32) + np.array(
            [0.0, 0.0, LIFT], dtype=np.float32
        )
        mesh = self._rr.Mesh3D(
            vertex_positions=vertices,
            triangle_indices=np.asarray(triangles, dtype=np.uint32),
            vertex_colors=None
            if colours is None
            else np.rint(255.0 * np.asarray(colours)).astype(np.uint8),
            albedo_factor=SKY if colours is None else None,
        )

        self._stream.event(f"world/found/{name}", mesh, time)

    def log_arrows(
        self, name: str, origins_W: ArrayLike, vectors_W: ArrayLike, time: float = 0.0
    ) -> None:
        """Show arrows under "world/found/<name>".

        Args:
            name: Name of the arrows.
            origins_W: (N, 3) [m]
            vectors_W: (N, 3) [m]
            time: From which they are shown [s].
        """
        color = self._cloud_colors.setdefault(name, LINES[len(self._cloud_colors) % len(LINES)])
        arrows = self._rr.Arrows3D(
            origins=np.asarray(origins_W), vectors=np.asarray(vectors_W), colors=color, radii=0.002
        )
        self._stream.event(f"world/found/{name}", arrows, time)

    def flush(self) -> None:
        """Write all rows so far to the file; on failure the log is abandoned."""
        if self.lost:
            return
        try:
            self._series.send(self._stream)
            self._poses.send(self._stream)
            self._stream.flush()
        except RuntimeError as error:  # of Rerun, whose writer has stopped
            self._stream.give_up(str(error), self._time)

        self._sent_at = perf_counter()

    def close(self) -> None:
        """Write the remaining rows and close the file; idempotent."""
        if self._closed:
            return
        self._closed = True
        self.flush()
        self._stream.close()

    def _enter(self, reference: Reference, time: float) -> None:
        rr, state = self._rr, reference.state
        self._state = state

        level = "INFO" if reference.abort is None else "WARN"
        text = (
            f"{state.value}: {reference.note}"
            if reference.note not in ("", self._note)
            else state.value
        )
        self._note = reference.note

        if self._frame is not None and state is not WorkState.SCAN:  # it would hide the work
            self._stream.event("world/camera/depth", rr.Clear(recursive=False), time)
            self._frame = None

        self._stream.event(
            "state/log", rr.TextLog(text, level=level, color=STATE_COLORS[state]), time
        )
        self._stream.event("state/now", rr.StateChange(state=state.value), time)
        self.flush()

    def _log_target(self, target: Target, time: float) -> None:
        rr = self._rr
        self._target = target
        verdict = "accepted" if target.accepted else f"refused: {target.reason}"
        text = f"target at {target.range_m:.2f} m, check {target.check_m * 1e3:.1f} mm: {verdict}"
        if target.covariance is not None:
            text += f"; {_deviations(target.covariance)}"
            self._show_ellipsoid("found", target.covariance, time)

        self._stream.event(
            "state/log", rr.TextLog(text, level="INFO" if target.accepted else "WARN"), time
        )

        if target.path is not None:
            lifted = target.path.p - LIFT * target.path.z
            self._stream.event(
                "world/path/planned", rr.LineStrips3D([lifted], colors=YELLOW, radii=0.004), time
            )

    def _decided(self, target: Target, time: float) -> None:
        """Log the mean of the finds, which the work uses, with the covariances of mean and path."""
        self._goes_by = target
        if target.covariance is None:
            return

        text = f"mean of the detections: {_deviations(target.covariance)}"
        if (sigma := target.path_sigma) is not None:
            normal, along, across = (f"{1e3 * component:.1f}" for component in sigma.max(axis=0))
            text += f"; path: normal {normal} mm, along {along} mm, across {across} mm"

        self._stream.event("state/log", self._rr.TextLog(text, level="INFO"), time)
        self._show_ellipsoid("mean", target.covariance, time)

    def _look(self, image: DepthImage, X_WB: Array, time: float) -> None:
        """Show a depth frame where the camera took it, every second pixel."""
        rr, X_WC = self._rr, X_WB @ image.X_BC

        depth = (
            np.nan_to_num(1e3 * image.depth[::2, ::2], nan=0.0, posinf=0.0)
            .clip(0.0, 65535.0)
            .astype(np.uint16)
        )

        # Every second pixel halves the camera matrix.
        height, width = depth.shape
        K = image.K / 2.0
        K[2, 2] = 1.0

        w, x, y, z = quat_wxyz_from_rotation(X_WC[:3, :3])
        view = rr.Transform3D(translation=X_WC[:3, 3], quaternion=rr.Quaternion(xyzw=[x, y, z, w]))
        eye = rr.Pinhole(image_from_camera=K, width=width, height=height, image_plane_distance=0.4)

        self._stream.event("world/camera", view, time)
        self._stream.event("world/camera", eye, time)
        self._stream.event("world/camera/depth", rr.DepthImage(depth, meter=1000.0), time)

    def _moved(self, motion: ObjectMotion, time: float) -> None:
        text = (
            f"the object has moved by {1e3 * motion.distance:.1f} mm (sigma "
            f"{1e3 * motion.distance_sigma:.1f} mm) and "
            f"turned by {np.degrees(motion.turn):.1f} deg"
        )
        self._stream.event("state/log", self._rr.TextLog(text, level="WARN"), time)

    def _show_ellipsoid(self, name: str, covariance: PoseCovariance, time: float) -> None:
        """Show the 95 % ellipsoid of the object's centre: solid to scale, and enlarged as lines."""
        rr = self._rr
        half, axes = covariance.ellipsoid()
        w, x, y, z = quat_wxyz_from_rotation(axes)
        color = SKY if name == "found" else YELLOW

        for suffix, scale, fill, label in (
            ("", 1.0, rr.components.FillMode.Solid, None),
            (
                "_enlarged",
                _ENLARGED,
                rr.components.FillMode.MajorWireframe,
                f"95 %, {_ENLARGED:.0f} times enlarged",
            ),
        ):
            shape = rr.Ellipsoids3D(
                centers=[covariance.center],
                half_sizes=[scale * half],
                quaternions=[rr.Quaternion(xyzw=[x, y, z, w])],
                colors=[color],
                fill_mode=fill,
                labels=None if label is None else [label],
                show_labels=False,
            )
            self._stream.event(f"world/uncertainty/{name}{suffix}", shape, time)


def _deviations(covariance: PoseCovariance) -> str:
    """Standard deviations of a pose in words."""
    position, turn = covariance.held_sigmas
    return (
        f"sigma {1e3 * position:.1f} mm, {np.degrees(turn):.2f} deg; free: "
        f"{covariance.free_in_words}"
    )
