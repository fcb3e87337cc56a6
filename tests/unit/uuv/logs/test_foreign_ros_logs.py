"""Logs of ROS by other recorders: other profiles, encodings and compressions, whole and damaged."""

import contextlib
import json
import sqlite3
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

if find_spec("rosbags") is None:  # nor is the rest of the extra `bridge`
    pytest.skip("rosbags is not here", allow_module_level=True)

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from uuv.logs.readers import read_vehicle_log
from uuv.logs.vehicle_log import ATTITUDE, DEPTH
from uuv.sim.interfaces.errors import ConfigurationError

KIND = "sensor_msgs/msg/FluidPressure"
IMU = "sensor_msgs/msg/Imu"
N = 60


def pressures(store: Any) -> list[Any]:
    """A pressure message for each sample, 2 to 3 m deep."""
    kinds = store.types
    messages = []
    for row in range(N):
        stamp = kinds["builtin_interfaces/msg/Time"](100 + row, 0)
        first = (row,) if store is ROS1 else ()
        header = kinds["std_msgs/msg/Header"](*first, stamp, "base_link")
        deep = 2.0 + row / N
        messages.append(kinds[KIND](header, 101_325.0 + 1025.0 * 9.81 * deep, 0.0))
    return messages


ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)


def write_mcap(
    file: Path,
    *,
    profile: str = "ros2",
    encoding: str = "cdr",
    compression: CompressionType = CompressionType.NONE,
    beside: bool = False,
    chunk_size: int = 1 << 20,
) -> Path:
    """An MCAP file by the library of its format; `beside`: with a topic in JSON."""
    with file.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=chunk_size, compression=compression)
        writer.start(profile=profile, library="another recorder")
        older = encoding == "ros1"
        store = ROS1 if older else ROS2
        text, _ = store.generate_msgdef(KIND, ros_version=1 if older else 2)
        name = KIND.replace("/msg/", "/") if older else KIND
        schema = writer.register_schema(name, "ros1msg" if older else "ros2msg", text.encode())
        topic = writer.register_channel("/pressure", encoding, schema)
        note = writer.register_channel(
            "/note", "json", writer.register_schema("Note", "jsonschema", b"{}")
        )

        encode = store.serialize_ros1 if older else store.serialize_cdr
        for row, message in enumerate(pressures(store)):
            stamp = (100 + row) * 10**9
            writer.add_message(topic, stamp, bytes(encode(message, KIND)), stamp)
            if beside:
                writer.add_message(note, stamp, json.dumps({"row": row}).encode(), stamp)
        writer.finish()
    return file


@pytest.mark.parametrize(
    ("words", "note"),
    [
        ({"profile": ""}, ""),
        ({"profile": "ros1", "encoding": "ros1"}, ""),
        ({"beside": True}, f"{N} messages are not read: 'Note' in the encoding 'json'"),
    ],
)
def test_a_sound_mcap_file_of_another_recorder_is_read_whole(
    words: dict[str, Any], note: str, tmp_path: Path
) -> None:
    log = read_vehicle_log(write_mcap(tmp_path / "dive.mcap", **words))
    assert log.streams[DEPTH].values[:, 0] == pytest.approx(2.0 + np.arange(N) / N, abs=1e-6)
    assert "; ".join(log.notes) == note


def test_an_mcap_file_of_another_encoding_is_refused_by_what_it_holds(tmp_path: Path) -> None:
    file = write_mcap(tmp_path / "dive.mcap", encoding="protobuf")
    words = rf"has no message .*{N} messages are not read: '{KIND}' in the encoding 'protobuf'"
    with pytest.raises(ConfigurationError, match=words):
        read_vehicle_log(file)


def write_bag(folder: Path) -> Path:
    """A bag in SQLite; its database."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/pressure", KIND, typestore=ROS2)
        for row, message in enumerate(pressures(ROS2)):
            writer.write(topic, (100 + row) * 10**9, bytes(ROS2.serialize_cdr(message, KIND)))
    return next(folder.glob("*.db3"))


def test_messages_that_the_recorder_counted_and_are_not_there_are_noted(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "bag")
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute("DELETE FROM messages WHERE id IN (SELECT id FROM messages LIMIT 2)")
        database.commit()
    log = read_vehicle_log(file.parent)
    assert len(log.streams[DEPTH].time) == N - 2
    assert log.notes == ("2 messages are missing, by the counts of the recorder",)


def test_a_bag_whose_metadata_are_damaged_is_read_and_that_is_noted(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/pressure", KIND, typestore=ROS2)
        for row, message in enumerate(pressures(ROS2)):
            writer.write(topic, (100 + row) * 10**9, bytes(ROS2.serialize_cdr(message, KIND)))
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: [1, {")
    log = read_vehicle_log(folder)
    assert len(log.streams[DEPTH].time) == N
    assert len(log.notes) == 1
    assert log.notes[0].startswith("the bag's metadata are not used: ")


@pytest.mark.parametrize("order", ["shuffled", "twice"])
def test_messages_out_of_order_or_twice_are_put_in_order_or_noted(
    order: str, tmp_path: Path
) -> None:
    rows = np.arange(N)
    rows = np.random.default_rng(4).permutation(rows) if order == "shuffled" else rows.repeat(2)
    messages = pressures(ROS2)
    with (tmp_path / "dive.mcap").open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros2", library="another recorder")
        text, _ = ROS2.generate_msgdef(KIND, ros_version=2)
        schema = writer.register_schema(KIND, "ros2msg", text.encode())
        topic = writer.register_channel("/pressure", "cdr", schema)
        for row in rows.tolist():
            stamp = (100 + row) * 10**9
            content = bytes(ROS2.serialize_cdr(messages[row], KIND))
            writer.add_message(topic, stamp, content, stamp)
        writer.finish()

    log = read_vehicle_log(tmp_path / "dive.mcap")
    assert log.streams[DEPTH].values[:, 0] == pytest.approx(2.0 + np.arange(N) / N, abs=1e-6)
    twice = f"depth: {N} samples whose time does not rise"
    assert log.notes == (() if order == "shuffled" else (twice,))


def test_an_orientation_that_is_no_rotation_is_noted(tmp_path: Path) -> None:
    kinds = ROS2.types
    nothing = kinds["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    zero = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 0.0)  # as an IMU without one sends
    empty = np.zeros(9)
    folder = tmp_path / "bag"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/imu", IMU, typestore=ROS2)
        for row in range(3):
            stamp = kinds["builtin_interfaces/msg/Time"](100 + row, 0)
            header = kinds["std_msgs/msg/Header"](stamp, "base_link")
            imu = kinds[IMU](header, zero, empty, nothing, empty, nothing, empty)
            writer.write(topic, (100 + row) * 10**9, bytes(ROS2.serialize_cdr(imu, IMU)))
    log = read_vehicle_log(folder)
    assert ATTITUDE not in log.streams
    note = "3 samples left out: /imu: sensor_msgs/Imu: the orientation is no unit quaternion"
    assert log.notes == (note,)


@pytest.mark.parametrize("kind", ["zstd", "lz4", "sqlite"])
def test_damage_under_a_compression_or_in_a_database_is_read_or_refused(
    kind: str, tmp_path: Path
) -> None:
    """Decompressors and databases raise errors of their own."""
    if kind == "sqlite":
        file = write_bag(tmp_path / "bag")
    else:
        file = tmp_path / "dive.mcap"
        write_mcap(file, compression=CompressionType[kind.upper()], chunk_size=500)

    whole = file.read_bytes()
    rng = np.random.default_rng(8)
    outcomes: Counter[str] = Counter()
    for _ in range(12):
        content = bytearray(whole)
        at = int(rng.integers(100, len(content) - 400))
        content[at : at + 300] = rng.bytes(300)
        file.write_bytes(content)
        try:
            log = read_vehicle_log(file)
        except ConfigurationError:
            outcomes["refused"] += 1
            continue
        short = len(log.streams[DEPTH].time) < N if DEPTH in log.streams else True
        outcomes["short" if short else "whole"] += 1
        assert log.notes or not short
    assert outcomes["refused"] + outcomes["short"] > 0
