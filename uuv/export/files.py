"""Files of other tools from a run: an MCAP file, a ROS 2 bag, tables of CSV, a MATLAB file."""

import csv
import heapq
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from uuv.export.mcap_file import QOS, McapFile, is_latched
from uuv.export.topics import RosTypes, Topic, nanoseconds
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.reporting.series_tables import EVENTS, PastRun
from uuv.sim.runs.saving import whole_file, write_whole

_LONGEST_NAME = 63  # [characters] of a MATLAB variable


def ordered(topics: Sequence[Topic]) -> Iterator[tuple[float, int, int]]:
    """Time [s], topic and index of every message, in the order of time."""

    def of_topic(number: int) -> Iterator[tuple[float, int, int]]:
        for index, time in enumerate(topics[number].time):
            yield float(time), number, index

    return heapq.merge(*map(of_topic, range(len(topics))))


def write_mcap(
    file: Path, topics: Sequence[Topic], types: RosTypes, about: Mapping[str, str]
) -> int:
    """Write all messages to an MCAP file; returns their number.

    Args:
        file: New file.
        topics: Of a run.
        types: Message types.
        about: Texts by name, kept as metadata.

    Raises:
        MissingLibraryError: The package mcap is not installed.
    """
    with whole_file(file) as stream:
        written = McapFile(stream, types)
        written.describe("run", about)
        for topic in topics:
            written.open(topic)
        for _, number, index in ordered(topics):
            written.add(topics[number], index)
        written.finish()
    return written.count


def check_bag(folder: Path) -> None:
    """Refuse a folder for a bag that is there already.

    Raises:
        ConfigurationError: It is.
    """
    if folder.exists():
        raise ConfigurationError(f"bag {folder}: exists already; a bag needs a new folder")


def write_bag(folder: Path, topics: Sequence[Topic], types: RosTypes) -> int:
    """Write all messages to a ROS 2 bag, a new folder; returns their number.

    Raises:
        ConfigurationError: The folder exists.
        MissingLibraryError: The package rosbags is not installed.
    """
    with wanted():
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
        from rosbags.rosbag2.metadata import parse_qos

    check_bag(folder)
    latched = parse_qos(QOS)

    # A bag's file has the name of its folder: it is written in a folder beside, under its name.
    count = 0
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as beside:
        part = Path(beside) / folder.name
        bag = Writer(part, version=9, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with bag as writer:
            connections = [
                writer.add_connection(
                    topic.name,
                    topic.kind,
                    typestore=types.store,
                    offered_qos_profiles=latched if is_latched(topic) else (),
                )
                for topic in topics
            ]

            for time, number, index in ordered(topics):
                topic = topics[number]
                data = types.encoded(topic.kind, topic.message(index))
                writer.write(connections[number], nanoseconds(time), data)
                count += 1
        part.rename(folder)
    return count


def write_csv(folder: Path, run: PastRun) -> list[Path]:
    """Write a CSV file for each table of a run, with units in the heads of columns, and
    `states.csv`, the names of the numbers in the series `state`.

    Args:
        folder: New or existing folder.
        run: Run to export.

    Returns:
        The files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for rate in (*run.rates, EVENTS):
        units = run.units(rate)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(f"{name} [{unit}]" if unit else name for name, unit in units.items())
        writer.writerows(zip(*(run.column(name, rate).tolist() for name in units), strict=True))

        files.append(folder / f"{rate}.csv")
        write_whole(files[-1], text.getvalue().encode())

    files.append(folder / "states.csv")
    rows = [f"{number},{state}\n" for number, state in run.states.items()]
    write_whole(files[-1], "".join(["state,name\n", *rows]).encode())
    return files


def write_matlab(file: Path, run: PastRun) -> None:
    """Write a MATLAB file: a struct for each table, in it a matrix for each series, and `units`.

    `states` has the numbers of the series `state`, and the name of each.
    """
    from scipy.io import savemat

    content: dict[str, Any] = {}
    for rate in run.rates:
        columns = run.units(rate)
        series: dict[str, list[str]] = {}
        for name in columns:
            series.setdefault(_series_name(name), []).append(name)

        matrices: dict[str, Any] = {
            name: np.column_stack([run.numbers(column, rate) for column in parts])
            for name, parts in series.items()
        }
        matrices["units"] = {name: columns[parts[0]] for name, parts in series.items()}
        matrices["columns"] = {name: np.array(parts, object) for name, parts in series.items()}
        content[rate] = matrices

    content[EVENTS] = {
        "time": run.numbers("time", EVENTS)[:, None],
        **{
            name: np.array(run.column(name, EVENTS).tolist(), object)
            for name in ("state", "abort", "note")
        },
    }
    content["states"] = {
        "state": np.array(list(run.states))[:, None],
        "name": np.array(list(run.states.values()), object),
    }
    buffer = io.BytesIO()
    savemat(buffer, content, do_compression=True, long_field_names=True)
    write_whole(file, buffer.getvalue())


def _series_name(column: str) -> str:
    """Name of a column's series as MATLAB allows it: letters, digits and underscores."""
    head, _, tail = column.partition(".")
    if head in ("believed", "body_pose"):  # whose next word is a part of the name
        head = f"{head}_{tail.partition('.')[0]}"
    return re.sub(r"\W", "_", head)[:_LONGEST_NAME]
