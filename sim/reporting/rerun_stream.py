"""File of a visual log: data sent to it, and the end of logging if it cannot be written."""

import ctypes
import os
import shutil
import sys
from pathlib import Path
from typing import Any

from uuv.sim.interfaces.spatial import Array
from uuv.sim.reporting.rerun_program import compact, send_to
from uuv.sim.reporting.rerun_scene import TIMELINE

# [bytes] cut off a log that filled the disk, so that metrics and report can be written
ROOM = 4 << 20


class LogStream:
    """A Rerun recording in a file, which is abandoned after a failed write, with one line on
    stderr.
    """

    def __init__(self, path: Path, title: str, *, view: bool) -> None:
        """Open the file.

        Args:
            path: file to write, in a folder that exists.
            title: name of the recording in the viewer.
            view: also show it in a Rerun viewer.
        """
        import rerun as rr  # heavy, and not needed by a run without a log

        self._rr = rr
        self._path = path
        self._whole: list[int] = []  # [bytes] readable size of the file after each flush
        self.lost = ""  # why the log was abandoned; empty: it was not

        self._stream = rr.RecordingStream("uuv-arm")
        send_to(rr, self._stream, path, view=view)
        self._stream.send_recording_name(title)

    def static(self, entity: str, what: Any) -> None:
        """Log something that does not change."""
        self._stream.log(entity, what, static=True)

    def show(self, blueprint: Any) -> None:
        """Set the layout of the viewer."""
        self._stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def event(self, entity: str, what: Any, time: float) -> None:
        """Log something from `time` [s] on."""
        if self.lost:
            return
        self._stream.set_time(TIMELINE, duration=time)
        self._stream.log(entity, what)
        self._stream.reset_time()

    def columns(self, entity: str, time: Array, columns: Any) -> None:
        """Send many values of an entity, at times (N,) [s]."""
        self._stream.send_columns(
            entity, indexes=[self._rr.TimeColumn(TIMELINE, duration=time)], columns=columns
        )

    def flush(self) -> None:
        """Write all that was sent.

        Raises:
            RuntimeError: Rerun's writer has stopped.
        """
        self._stream.flush(timeout_sec=10.0)
        if self._path.is_file():
            self._whole.append(self._path.stat().st_size)

    def give_up(self, reason: str, time: float) -> None:
        """Abandon the log with one message, and keep its readable part, minus ROOM on a full disk.

        Args:
            reason: why it can no longer be written.
            time: [s] of the run.
        """
        full = shutil.disk_usage(self._path.parent).free < ROOM
        self.lost = "no space left" if full else reason
        print(
            f"run log: lost from {time:.1f} s on, the run continues ({self.lost}): {self._path}",
            file=sys.stderr,
        )

        # Closing or destroying a stream whose writer is dead can block forever: keep it alive.
        self._rr.unregister_shutdown()
        for stream in (self._stream, getattr(self._stream, "inner", None)):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))

        most = (self._path.stat().st_size if self._path.is_file() else 0) - (ROOM if full else 0)
        self._whole = [size for size in self._whole if size <= most] or [0]
        self._cut()

    def close(self) -> None:
        """Close the file."""
        if self.lost:
            self._cut()  # once more: the writer may have had rows left
        else:
            self._stream.disconnect()
            compact(self._path)

    def _cut(self) -> None:
        """Truncate the file of an abandoned log to its size after a flush."""
        if self._path.is_file():
            os.truncate(self._path, self._whole[-1])
