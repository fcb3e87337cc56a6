"""Rerun log of arms that move along given joint values, with the timeline "sim_time"."""

from pathlib import Path
from typing import Any

import numpy as np

from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.spatial import Array
from uuv.sim.reporting.rerun_program import send_to

TIMELINE = "sim_time"


class ArmLog:
    """Writer of one Rerun file, which `view` also sends to a viewer; a context manager, or call
    `close`.
    """

    def __init__(self, file: Path, title: str, blueprint: Any, *, view: bool) -> None:
        import rerun as rr  # slow to import, and only needed for a log

        self._rr = rr
        self._stream = rr.RecordingStream("uuv-arm")
        send_to(rr, self._stream, file, view=view)
        self._stream.send_recording_name(title)
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def __enter__(self) -> "ArmLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def arm(
        self,
        name: str,
        arm: SerialArm,
        time: Array,
        q: Array,
        color: tuple[int, int, int],
        *,
        stride: int = 1,
    ) -> None:
        """Log an arm's links and joints over time.

        Args:
            name: Name of the entity.
            arm: Kinematics.
            time: (N,) [s].
            q: (N, n) [rad] or [m] joint values.
            color: RGB, 0 to 255.
            stride: Rows per logged frame.
        """
        rr = self._rr
        points = np.array([arm.joint_frames(row)[:, :3, 3] for row in q[::stride]])
        strips = [np.vstack([np.zeros(3), row]) for row in points]

        size = 0.006 * float(np.linalg.norm(np.diff(strips[0], axis=0), axis=1).sum())
        self._columns(f"world/{name}/links", time[::stride], rr.LineStrips3D.columns(strips=strips))
        self._columns(
            f"world/{name}/joints",
            time[::stride],
            rr.Points3D.columns(positions=points.reshape(-1, 3)).partition(
                [points.shape[1]] * len(points)
            ),
        )

        # Colours and sizes do not change.
        style = {"colors": color, "radii": size}
        self._stream.log(f"world/{name}/links", rr.LineStrips3D.from_fields(**style), static=True)
        self._stream.log(
            f"world/{name}/joints",
            rr.Points3D.from_fields(colors=color, radii=2.0 * size),
            static=True,
        )

    def line(self, name: str, points: Array, color: tuple[int, int, int], radius: float) -> None:
        """Log a static line.

        Args:
            name: Name of the entity.
            points: (N, 3) [m] in W.
            color: RGB, 0 to 255.
            radius: [m].
        """
        rr = self._rr
        self._stream.log(
            f"world/{name}", rr.LineStrips3D([points], colors=color, radii=radius), static=True
        )

    def series(self, name: str, labels: list[str], time: Array, values: Array) -> None:
        """Log curves over time.

        Args:
            name: Name of the entity.
            labels: k names of the curves.
            time: (N,) [s].
            values: (N, k).
        """
        rr = self._rr
        self._stream.log(f"series/{name}", rr.SeriesLines(names=labels, widths=1.5), static=True)
        self._columns(f"series/{name}", time, rr.Scalars.columns(scalars=values))

    def close(self) -> None:
        """Flush and close the file."""
        self._stream.flush(timeout_sec=10.0)
        self._stream.disconnect()

    def _columns(self, entity: str, time: Array, columns: Any) -> None:
        self._stream.send_columns(
            entity, indexes=[self._rr.TimeColumn(TIMELINE, duration=time)], columns=columns
        )
