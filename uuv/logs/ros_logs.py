"""Logs of ROS: MCAP files and bags, by the types of their topics."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from uuv.logs.gathered import Gathered, short
from uuv.logs.vehicle_log import (
    ATTITUDE,
    DEPTH,
    FORCE,
    JOINTS,
    POSITION,
    PULSES,
    RATE,
    THRUSTS,
    VELOCITY,
    VehicleLog,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import GRAVITY, Array, shown

_WATER_DENSITY = 1025.0  # [kg/m^3] of sea water, for depths from pressures
_AIR = 101_325.0  # [Pa] at the surface
_NOT_MEASURED = -1.0  # begins a covariance
_RC_OUT = "std_msgs/Header header\nuint16[] channels\n"  # of a package that is not in ROS
_LARGEST_RECORD = 1 << 28  # [bytes]
_MOST_NOTES = 10  # on what is not read
_MOST_RANK = 99  # of a topic among those of its kind
_UNIT = 1e-2  # by which the norm of a quaternion may differ from 1
_SECOND = 1e-9  # [s] of a nanosecond


def read_ros_log(path: Path, what: str) -> VehicleLog:
    """Read an MCAP file or a bag, the first topic of each type.

    Raises:
        ConfigurationError: It cannot be opened.
        MissingLibraryError: The package rosbags is not installed.
    """
    with wanted():
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    gathered = Gathered(what)
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(_RC_OUT, "mavros_msgs/msg/RCOut"))

    try:
        reader = AnyReader([path], default_typestore=types)
        with reader:
            _read(reader, gathered)
    except ConfigurationError:
        raise
    except Exception as error:  # of rosbags and its decompressors, which have no common base
        reason = short(error)
        if not gathered.messages and (files := _mcap_files(path)):
            # A sound file of other software may lack what rosbags asks for, such as a profile.
            refused = reason
            reason = _read_streams(files, gathered, types)
            if path.is_dir() and gathered.messages:
                gathered.note(f"the bag's metadata are not used: {refused}")
        if reason and not gathered.messages:
            raise ConfigurationError(
                f"{what}: is not a complete bag or MCAP file ({reason})"
            ) from error

        if reason:
            gathered.note(f"damaged after {gathered.messages} messages: {reason}")
    return gathered.log(path.name, "ROS (bag, MCAP)")


def _read(reader: Any, gathered: Gathered) -> None:
    """Add the messages of all types that are read, topics with shorter names first."""
    connections = [topic for topic in reader.connections if topic.msgtype in _TYPES]
    names = {connection.topic for connection in connections}
    order = sorted(names, key=lambda name: (len(name), name))

    # What is there and of no use is noted.
    others = sorted({topic.msgtype for topic in reader.connections} - set(_TYPES))
    if others:
        gathered.note(f"topics of types that are not read: {', '.join(others)}")

    if not connections:  # of which the reader would make all
        return

    for connection, stamp, raw in reader.messages(connections):
        message = reader.deserialize(raw, connection.msgtype)
        time = _time_of(message, stamp)
        gathered.count()
        rank = order.index(connection.topic)
        _TYPES[connection.msgtype](gathered, time, message, connection.topic, rank)

    # A recorder states how many there are; 0 where it did not.
    missing = sum(connection.msgcount for connection in connections) - gathered.messages
    if missing > 0:
        gathered.note(f"{missing} messages are missing, by the counts of the recorder")


def _mcap_files(path: Path) -> list[Path]:
    """The MCAP file, or those of a bag's folder."""
    if path.is_dir():
        return sorted(path.glob("*.mcap"))
    return [path] if path.suffix.lower() == ".mcap" else []


def _read_streams(files: Iterable[Path], gathered: Gathered, types: Any) -> str:
    """Add the messages of MCAP files from their beginning to the last readable one, by the names
    of their types.

    A recorder that was killed leaves no index at the end.

    Returns:
        Why a file could not be read to its end; empty: all could.
    """
    from mcap.reader import NonSeekingReader

    decoders = _decoders(types)
    unread: Counter[str] = Counter()
    reason = ""
    for file in files:
        try:
            with file.open("rb") as stream:
                reader = NonSeekingReader(stream, record_size_limit=_LARGEST_RECORD)
                for schema, channel, message in reader.iter_messages(log_time_order=False):
                    name = schema.name if schema else "no type"
                    why = _add_raw(gathered, decoders, name, channel, message)
                    unread[why] += bool(why)
        except ConfigurationError:
            raise
        except Exception as error:  # of mcap and its decompressors
            reason = short(error)

    for why, count in unread.most_common(_MOST_NOTES):
        if count:
            gathered.note(f"{count} messages are not read: {why}")
    return reason


def _decoders(types: Any) -> dict[str, Callable[[bytes, str], Any]]:
    """Functions that decode a message of a type, by the encoding of its channel."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    older = get_typestore(Stores.ROS1_NOETIC)
    older.register(get_types_from_msg(_RC_OUT, "mavros_msgs/msg/RCOut"))
    return {"cdr": types.deserialize_cdr, "ros1": older.deserialize_ros1}


def _add_raw(
    gathered: Gathered,
    decoders: Mapping[str, Callable[[bytes, str], Any]],
    name: str,
    channel: Any,
    message: Any,
) -> str:
    """Add a message of an MCAP file; why it could not be, or nothing."""
    if channel.message_encoding not in decoders:
        return f"{shown(name)} in the encoding {shown(channel.message_encoding)}"

    # ROS 1 has no middle part in the name of a type.
    kind = name if name.count("/") != 1 else name.replace("/", "/msg/")
    if kind not in _TYPES:
        return f"type {shown(name)}"
    try:
        decoded = decoders[channel.message_encoding](message.data, kind)
    except Exception:  # of rosbags
        return f"{shown(name)} is not as ROS defines it"

    gathered.count()
    time = _time_of(decoded, message.log_time)
    rank = min(len(channel.topic), _MOST_RANK)
    _TYPES[kind](gathered, time, decoded, channel.topic, rank)
    return ""


def _time_of(message: Any, stamp: int) -> float:
    """Time [s] of measurement or, if the message has none, of recording."""
    header = getattr(message, "header", None)
    if header is not None and (header.stamp.sec or header.stamp.nanosec):
        return header.stamp.sec + _SECOND * header.stamp.nanosec
    return _SECOND * stamp


def _xyz(vector: Any) -> Array:
    return np.array([vector.x, vector.y, vector.z])


def _add_attitude(to: Gathered, time: float, quaternion: Any, source: str, rank: int) -> None:
    """Add an attitude, if the quaternion is a rotation."""
    xyzw = np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    if not abs(float(np.linalg.norm(xyzw)) - 1.0) < _UNIT:
        to.leave_out(f"{source}: the orientation is no unit quaternion")
        return
    to.add(ATTITUDE, time, xyzw, source, rank=rank)


def _imu(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    source = f"{topic}: sensor_msgs/Imu"

    # REP 145: a covariance that begins with -1 says that the quantity is not measured.
    if m.angular_velocity_covariance[0] != _NOT_MEASURED:
        to.add(RATE, time, _xyz(m.angular_velocity), source, rank=rank)
    if m.linear_acceleration_covariance[0] != _NOT_MEASURED:
        to.add(FORCE, time, _xyz(m.linear_acceleration), source, rank=rank)

    if m.orientation_covariance[0] != _NOT_MEASURED:
        _add_attitude(to, time, m.orientation, source, rank)


def _odometry(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    source = f"{topic}: nav_msgs/Odometry"
    to.add(POSITION, time, _xyz(m.pose.pose.position), source, rank=rank)
    _add_attitude(to, time, m.pose.pose.orientation, source, 100 + rank)  # an IMU's comes first


def _pose(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    source = f"{topic}: geometry_msgs/PoseStamped"
    to.add(POSITION, time, _xyz(m.pose.position), source, rank=200 + rank)
    _add_attitude(to, time, m.pose.orientation, source, 200 + rank)


def _twist(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    source = f"{topic}: a twist, hull axes"
    twist = m.twist.twist if hasattr(m.twist, "twist") else m.twist
    to.add(VELOCITY, time, _xyz(twist.linear), source, rank=rank)


def _pressure(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    depth = (m.fluid_pressure - _AIR) / (_WATER_DENSITY * GRAVITY)
    to.add(DEPTH, time, np.array([depth]), f"{topic}: sensor_msgs/FluidPressure [Pa]", rank=rank)


def _joints(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    names = tuple(map(str, m.name))
    source = f"{topic}: sensor_msgs/JointState"

    # Efforts alone are thrusts.
    if names and len(m.position) == len(names):
        to.add(JOINTS, time, m.position, source, rank=rank, labels=names)
    elif names and len(m.effort) == len(names):
        to.add(THRUSTS, time, m.effort, f"{source}, effort [N]", rank=rank, labels=names)


def _outputs(to: Gathered, time: float, m: Any, topic: str, rank: int) -> None:
    to.add(PULSES, time, np.asarray(m.channels), f"{topic}: mavros_msgs/RCOut [us]", rank=rank)


_TYPES: dict[str, Callable[[Gathered, float, Any, str, int], None]] = {
    "sensor_msgs/msg/Imu": _imu,
    "nav_msgs/msg/Odometry": _odometry,
    "geometry_msgs/msg/PoseStamped": _pose,
    "geometry_msgs/msg/TwistStamped": _twist,
    "geometry_msgs/msg/TwistWithCovarianceStamped": _twist,
    "sensor_msgs/msg/FluidPressure": _pressure,
    "sensor_msgs/msg/JointState": _joints,
    "mavros_msgs/msg/RCOut": _outputs,
}
