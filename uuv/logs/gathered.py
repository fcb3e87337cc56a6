"""Samples of a log while it is read, whatever its format."""

import contextlib
import math
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uuv.logs.ardusub_frames import FRAME_CONFIGS, FRAMES
from uuv.logs.vehicle_log import LABELS, UNITS, Stream, VehicleLog
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.spatial import Array

MOST = 5_000_000  # messages of a log that are read
Key = tuple[str, int, str]  # quantity, rank and description of a source


@dataclass(slots=True)
class _Samples:
    """Samples of one source, packed."""

    labels: tuple[str, ...]
    time: array = field(default_factory=lambda: array("d"))
    values: array = field(default_factory=lambda: array("d"))


class Gathered:
    """Samples of a log while it is read, by quantity, each from its best source."""

    def __init__(self, what: str) -> None:
        """Begin a log, which messages call `what`."""
        self.what = what
        self.messages = 0  # that were read
        self.has_position = True  # the autopilot's filter has a source for it, by its own word
        self._parameters: dict[str, float] = {}
        self._sources: dict[Key, _Samples] = {}
        self._left_out: dict[str, int] = {}  # samples by reason
        self._notes: list[str] = []

    def count(self) -> None:
        """Count a message.

        Raises:
            ConfigurationError: There are more than MOST.
        """
        self.messages += 1
        if self.messages > MOST:
            raise ConfigurationError(f"{self.what}: more than {MOST} messages")

    def note(self, line: str) -> None:
        """Keep a line for the reader of the log."""
        self._notes.append(one_line(line))

    def leave_out(self, reason: str) -> None:
        """Count a sample that is not taken."""
        self._left_out[reason] = self._left_out.get(reason, 0) + 1

    def parameter(self, name: str, value: Any) -> None:
        """Keep a parameter of the autopilot, if it is a number."""
        with contextlib.suppress(TypeError, ValueError):
            if math.isfinite(number := float(value)):
                self._parameters[name] = number

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
        """Add a sample. If a quantity has several sources, the one of the lowest rank is used.

        Args:
            quantity: Such as `ATTITUDE` (`uuv.logs.vehicle_log`).
            time: [s]
            values: (k,) in SI units and our axes.
            source: Message or topic, with unit and axes there.
            rank: Of the source.
            labels: Names of the values, where the log names them; their order may change.
        """
        sample = np.asarray(values, dtype=np.float64)
        if not (math.isfinite(time) and np.isfinite(sample).all()):
            self.leave_out(f"{quantity}: not finite")
            return

        key = quantity, rank, source
        names = labels or tuple(str(i + 1) for i in range(len(sample)))
        samples = self._sources.setdefault(key, _Samples(names))
        if samples.labels != names:
            if sorted(samples.labels) != sorted(names):
                self.leave_out(f"{source}: names differ from those of its first sample")
                return
            sample = sample[[names.index(name) for name in samples.labels]]

        samples.time.append(time)
        samples.values.extend(sample)

    def log(self, name: str, kind: str) -> VehicleLog:
        """The log of all that was added."""
        streams: dict[str, Stream] = {}
        for key in sorted(self._sources, key=lambda key: key[:2]):
            if key[0] not in streams and len(self._sources[key].time) > 1:
                streams[key[0]] = self._stream(key)

        start = min((float(stream.time[0]) for stream in streams.values()), default=0.0)
        end = max((float(stream.time[-1]) for stream in streams.values()), default=0.0)
        for reason, count in self._left_out.items():
            self.note(f"{count} samples left out: {reason}")

        frame = FRAME_CONFIGS.get(int(self._parameters.get("FRAME_CONFIG", -1)), "")
        return VehicleLog(
            name=name,
            kind=kind,
            duration=end - start,
            messages=self.messages,
            streams={quantity: stream.from_time(start) for quantity, stream in streams.items()},
            frame=frame,
            directions=self._directions(frame),
            notes=tuple(self._notes),
        )

    def _directions(self, frame: str) -> tuple[int, ...]:
        """MOT_n_DIRECTION of the motors of a frame; empty if one of them is not known."""
        motors = range(1, len(FRAMES[frame]) + 1) if frame else ()
        known = [self._parameters.get(f"MOT_{motor}_DIRECTION") for motor in motors]
        stated = [int(direction) for direction in known if direction in (1.0, -1.0)]
        return tuple(stated) if len(stated) == len(known) else ()

    def _stream(self, key: Key) -> Stream:
        """Samples in order of time, without those that repeat a time or go back."""
        quantity, _, source = key
        samples = self._sources[key]
        time = np.array(samples.time)
        table = np.array(samples.values).reshape(len(time), -1)

        rising = _rising(time)
        if not rising.all():
            self.note(f"{quantity}: {int((~rising).sum())} samples whose time does not rise")

        # Names and unit, of the quantity or of the log.
        labels, unit = LABELS.get(quantity, (samples.labels, UNITS.get(quantity, "")))
        return Stream(time[rising], table[rising], labels, unit, source)


def _rising(time: Array) -> np.ndarray:
    """Mask (N,) of rising times; a single wrong time is masked alone.

    Seen from the front a time must exceed all before it, from the back be below all after it; an
    outlier ahead spoils the first way, one behind the second.
    """
    ahead = np.r_[True, time[1:] > np.maximum.accumulate(time)[:-1]]
    behind = np.r_[time[:-1] < np.minimum.accumulate(time[::-1])[::-1][1:], True]
    return ahead if ahead.sum() >= behind.sum() else behind


def short(error: BaseException) -> str:
    """Message of a library's exception, in one line."""
    return one_line(f"{type(error).__name__}: {error}", 120)
