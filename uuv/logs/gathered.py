"""Samples of a log while it is read, whatever its format."""

import contextlib
import math
import struct
from typing import Any

import numpy as np

from uuv.logs.vehicle_log import LABELS, UNITS, Stream, VehicleLog
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.spatial import Array

MOST = 5_000_000  # messages of a log
_FRAMES = {1: "vectored", 2: "vectored_6dof"}  # FRAME_CONFIG of ArduSub
# What libraries raise at a file that is cut or forged.
BROKEN = (
    *(ValueError, KeyError, IndexError, TypeError, AttributeError, EOFError, OSError),
    *(OverflowError, RuntimeError, AssertionError, struct.error, ZeroDivisionError),
)


class Gathered:
    """Samples of a log while it is read, by quantity; the best source of each counts."""

    def __init__(self, what: str) -> None:
        """For a log of that description."""
        self.what = what
        self.messages = 0
        self._first = math.inf
        self._last = -math.inf
        self._parameters: dict[str, float] = {}
        self._rows: dict[tuple[str, int, str], list[tuple[float, Array]]] = {}
        self._labels: dict[str, tuple[str, ...]] = {}
        self._notes: list[str] = []

    def count(self, time: float | None) -> None:
        """Note a message.

        Raises:
            ConfigurationError: There are more than MOST.
        """
        self.messages += 1
        if self.messages > MOST:
            raise ConfigurationError(f"{self.what}: more than {MOST} messages")
        if time is not None and math.isfinite(time):
            self._first = min(self._first, time)
            self._last = max(self._last, time)

    def note(self, line: str) -> None:
        """Keep a line for the reader of the log."""
        self._notes.append(one_line(line))

    def parameter(self, name: str, value: Any) -> None:
        """Keep a parameter of the autopilot."""
        with contextlib.suppress(TypeError, ValueError):
            self._parameters[name] = float(value)

    def add(
        self,
        quantity: str,
        time: float,
        values: Array,
        source: str,
        *,
        rank: int = 0,
        labels: tuple[str, ...] = (),
    ) -> None:
        """Add a sample; of several sources of a quantity that of the lowest rank is taken."""
        sample = np.asarray(values, dtype=np.float64)
        if math.isfinite(time) and np.isfinite(sample).all():
            self._rows.setdefault((quantity, rank, source), []).append((time, sample))
            if labels:
                self._labels[quantity] = labels

    def log(self, name: str, kind: str) -> VehicleLog:
        """The log of all that was added."""
        streams: dict[str, Stream] = {}
        for quantity, _, source in sorted(self._rows, key=lambda key: key[:2]):
            if quantity not in streams:
                rows = next(
                    rows
                    for key, rows in self._rows.items()
                    if (key[0], key[2]) == (quantity, source)
                )
                streams[quantity] = self._stream(quantity, rows, source)

        # What the autopilot's parameters say of its motors.
        motors = [
            int(self._parameters[name])
            for name in (f"MOT_{n}_DIRECTION" for n in range(1, 9))
            if name in self._parameters
        ]
        frame = _FRAMES.get(int(self._parameters.get("FRAME_CONFIG", -1)), "")

        # Only as many as the frame has.
        count = {"vectored": 6, "vectored_6dof": 8}.get(frame, len(motors))
        return VehicleLog(
            name=name,
            kind=kind,
            duration=max(0.0, self._last - self._first) if self.messages else 0.0,
            messages=self.messages,
            streams=streams,
            frame=frame,
            directions=tuple(motors[:count]),
            notes=tuple(self._notes),
        )

    def _stream(self, quantity: str, rows: list[tuple[float, Array]], source: str) -> Stream:
        """Samples in the order of time; one that repeats a time, or goes back, is left out."""
        width = len(rows[0][1])
        kept = [row for row in rows if len(row[1]) == width]
        time = np.array([row[0] for row in kept])
        values = np.array([row[1] for row in kept])

        rising = np.r_[True, time[1:] > np.maximum.accumulate(time)[:-1]]

        if not rising.all():
            self.note(f"{quantity}: {int((~rising).sum())} samples whose time does not rise")

        # Names and unit, of the quantity or of the log.
        labels, unit = LABELS.get(
            quantity,
            (
                self._labels.get(quantity, tuple(str(i + 1) for i in range(width))),
                UNITS.get(quantity, ""),
            ),
        )

        start = self._first if math.isfinite(self._first) else 0.0
        return Stream(time[rising] - start, values[rising], labels, unit, source)


def short(error: BaseException) -> str:
    """What a library raised, in one line."""
    return one_line(f"{type(error).__name__}: {error}", 120)
