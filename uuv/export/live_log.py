"""MCAP log of a run while it goes on: `uuv run JOB --log mcap`.

Every two seconds of the run its new rows are written. A run that dies leaves a file that readers
take up to there: it only lacks the index at its end.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco

from uuv.export.files import ordered
from uuv.export.mcap_file import McapFile
from uuv.export.robot_description import robot_description
from uuv.export.topics import RosTypes, RunTopics, Topic
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.loop.recording import RecordedSeries, Recorder, Series
from uuv.sim.loop.rollout import Moment

FILE = "run.mcap"  # in the folder of a run
_TICKS = 1000  # of the loop between two parts
_CHUNK = 64 * 1024  # [bytes] that wait for being written
_OVERLAP = 2  # rows: one is held back, and one is needed before it, for difference quotients


class McapLog:
    """Observer that writes a run's topics to an MCAP file; close it at the end of the run."""

    slow_ticks = (_TICKS,)

    def __init__(self, file: Path, recorder: Recorder, model: mujoco.MjModel) -> None:
        """Begin the file, with the vehicle's description.

        Args:
            file: New file.
            recorder: Of the run, an earlier observer.
            model: Of the plant.

        Raises:
            ConfigurationError: The file cannot be written.
            MissingLibraryError: The packages of the extra `bridge` are not installed.
        """
        self._types = RosTypes()
        self._recorder = recorder
        try:
            self._stream = file.open("wb")
        except OSError as error:
            raise ConfigurationError(f"log {file}: {error.strerror}") from error

        self._file = McapFile(self._stream, self._types, chunk=_CHUNK)
        self._rows: dict[str, int] = {}  # of each series, up to now
        self._last: dict[str, float] = {}  # [s] time of the last message of each topic
        self._clouds: set[str] = set()
        self._events = 0
        empty = RecordedSeries(duration=0.0, series={}, events=())
        self._write(RunTopics(empty, {}, robot_description(model), types=self._types).topics)
        self._stream.flush()

    def observe(self, moment: Moment) -> None:
        """Write the rows since the last part, now and then."""
        if moment.tick and moment.tick % _TICKS == 0:
            self._go_on(held=1)

    def close(self, *, accepted: bool | None = None) -> None:
        """Write the rest and the file's index; again: nothing.

        Args:
            accepted: Whether the run is accepted; None: it was broken off.
        """
        if self._stream.closed:
            return
        try:
            self._go_on(held=0)
            if accepted is not None:
                self._file.describe("run", {"accepted": str(accepted)})
            self._file.finish()
        finally:
            self._stream.close()

    def _go_on(self, *, held: int) -> None:
        """Write what is new; `held` rows of each series wait for the row after them."""
        try:
            record = self._recorder.recording()
        except ConfigurationError:  # no step yet
            return

        new = {name: self._new(name, series) for name, series in record.series.items()}
        rest = RecordedSeries(duration=record.duration, series=new, events=())
        parts = [self._unwritten(t, held) for t in RunTopics(rest, {}, types=self._types).topics]
        self._write(parts)

        # What has no rows: written once, as it comes.
        clouds = {name: c for name, c in record.clouds.items() if name not in self._clouds}
        self._clouds.update(clouds)
        once = replace(rest, series={}, events=record.events[self._events :])
        self._events = len(record.events)
        self._write(RunTopics(once, clouds, types=self._types).topics)
        self._stream.flush()

    def _new(self, name: str, series: Series) -> Series:
        """The rows of a series that were not written, and the ones before them."""
        first = max(self._rows.get(name, 0) - _OVERLAP, 0)
        self._rows[name] = len(series.time)
        return replace(series, time=series.time[first:], value=series.value[first:])

    def _unwritten(self, topic: Topic, held: int) -> Topic:
        """The part of a topic after its last message, without the rows that are held back."""
        last = self._last.get(topic.name)
        first = 0 if last is None else int((topic.time <= last).sum())
        stop = max(len(topic.time) - held, first)
        if stop > first:
            self._last[topic.name] = float(topic.time[stop - 1])
        return replace(
            topic, time=topic.time[first:stop], message=lambda i: topic.message(first + i)
        )

    def _write(self, topics: Sequence[Topic]) -> None:
        for _, number, index in ordered(topics):
            self._file.add(topics[number], index)
