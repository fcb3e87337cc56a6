"""Topics of a run: its series and events as messages of standard ROS 2 types.

Every series is on some topic. What has a message of its own in ROS gets that; the rest is on
`/series/NAME` as an array with labels. Times are the run's, from 0.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import Event, RecordedSeries, Series

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

WORLD = "world"
HULL = "hull"
_SECOND = 1_000_000_000  # [ns]
_ERROR = 40  # level of rcl_interfaces/msg/Log
_INFO = 20  # level of rcl_interfaces/msg/Log
_FLOAT32 = 7  # datatype of sensor_msgs/msg/PointField
_POSE_WIDTH = 7  # columns of a body's pose: position and quaternion wxyz


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """Messages of one type at their times."""

    name: str
    kind: str  # such as "nav_msgs/msg/Odometry"
    time: Array  # (N,) [s]
    message: Callable[[int], Any]  # the i-th, 0 <= i < N


class RosTypes:
    """Standard message types of ROS 2, by name."""

    def __init__(self) -> None:
        """Load the definitions.

        Raises:
            MissingLibraryError: The package rosbags is not installed.
        """
        with wanted():
            from rosbags.typesys import Stores, get_typestore

        self.store: Typestore = get_typestore(Stores.ROS2_HUMBLE)

    def make(self, kind: str, **fields: Any) -> Any:
        """A message, such as `make("Vector3", x=0.0, y=0.0, z=1.0)`; its package may be left out
        where the name is known.
        """
        return self.store.types[_PACKAGES.get(kind, kind)](**fields)

    def definition(self, kind: str) -> str:
        """Text of a message type with all that it contains, as a recorder stores it."""
        return self.store.generate_msgdef(kind, ros_version=2)[0]

    def encoded(self, kind: str, message: Any) -> bytes:
        """A message in the encoding of ROS 2 (CDR)."""
        return bytes(self.store.serialize_cdr(message, kind))

    def header(self, time: float, frame: str) -> Any:
        """Header with a stamp [s] and a frame."""
        return self.make("Header", stamp=self.stamp(time), frame_id=frame)

    def stamp(self, time: float) -> Any:
        """Time [s] as a message."""
        sec, nanosec = divmod(nanoseconds(time), _SECOND)
        return self.make("Time", sec=sec, nanosec=nanosec)

    def vector(self, values: Array, kind: str = "Vector3") -> Any:
        """A Vector3 or Point of (3,)."""
        return self.make(kind, **dict(zip("xyz", map(float, values), strict=True)))

    def quaternion(self, wxyz: Array) -> Any:
        """A Quaternion of (4,)."""
        return self.make("Quaternion", **dict(zip("wxyz", map(float, wxyz), strict=True)))

    def array(self, values: Array, labels: tuple[str, ...]) -> Any:
        """A Float64MultiArray of (k,) whose dimension is named by the labels."""
        dimension = self.make(
            "MultiArrayDimension", label=" ".join(labels), size=len(values), stride=len(values)
        )
        layout = self.make("MultiArrayLayout", dim=[dimension], data_offset=0)
        return self.make("Float64MultiArray", layout=layout, data=np.array(values, np.float64))


_PACKAGES = {
    name.rpartition("/")[2]: name
    for name in (
        *("builtin_interfaces/msg/Time", "std_msgs/msg/Header", "std_msgs/msg/String"),
        *("std_msgs/msg/Float64MultiArray", "std_msgs/msg/MultiArrayLayout"),
        *("std_msgs/msg/MultiArrayDimension", "geometry_msgs/msg/Vector3"),
        *("geometry_msgs/msg/Vector3Stamped", "geometry_msgs/msg/Point"),
        *("geometry_msgs/msg/PointStamped", "geometry_msgs/msg/Quaternion"),
        *("geometry_msgs/msg/Pose", "geometry_msgs/msg/PoseStamped"),
        *("geometry_msgs/msg/PoseWithCovariance", "geometry_msgs/msg/Transform"),
        *("geometry_msgs/msg/TransformStamped", "geometry_msgs/msg/Twist"),
        *("geometry_msgs/msg/TwistWithCovariance", "geometry_msgs/msg/Wrench"),
        *("geometry_msgs/msg/WrenchStamped", "nav_msgs/msg/Odometry"),
        *("rcl_interfaces/msg/Log", "sensor_msgs/msg/JointState"),
        *("sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/PointField", "tf2_msgs/msg/TFMessage"),
    )
}


def nanoseconds(time: float) -> int:
    """A time [s] in whole nanoseconds."""
    return round(time * _SECOND)


class RunTopics:
    """All topics of a run, from its series, events and clouds."""

    def __init__(
        self,
        run: RecordedSeries,
        clouds: Mapping[str, Array],
        description: str = "",
        *,
        types: RosTypes | None = None,
    ) -> None:
        """Take what was recorded.

        Args:
            run: Series and events.
            clouds: Points (N, 3) [m] in W, by name.
            description: URDF of the vehicle; empty: none.
            types: Message types; None: loaded.

        Raises:
            MissingLibraryError: The package rosbags is not installed.
        """
        self._run = run
        self._clouds = clouds
        self._description = description
        self._types = types or RosTypes()
        self._used: set[str] = set()  # series that are on a topic of their own

    @cached_property
    def topics(self) -> tuple[Topic, ...]:
        """Every topic; those with standard messages first."""
        special = [topic for make in _MAKERS for topic in make(self)]
        rest = [
            self._series(name, series)
            for name, series in sorted(self._run.series.items())
            if name not in self._used
        ]
        return (*special, *rest)

    def _take(self, *names: str) -> tuple[Series, ...] | None:
        """Series for a topic of their own; None if one was not recorded."""
        if any(name not in self._run for name in names):
            return None
        self._used.update(names)
        return tuple(self._run[name] for name in names)

    def _series(self, name: str, series: Series) -> Topic:
        """A series as arrays, its unit in the topic's labels."""
        labels = series.labels or (name,)
        if series.unit:
            labels = tuple(f"{label}[{series.unit}]".replace(" ", "_") for label in labels)

        topic = re.sub(r"\W", "_", name)
        return Topic(
            f"/series/{topic}",
            _PACKAGES["Float64MultiArray"],
            series.time,
            lambda i: self._types.array(series.value[i], labels),
        )

    # --- Topics with standard messages ---

    def joints(self) -> Iterator[Topic]:
        """Joint angles, speeds and drive torques."""
        taken = self._take("q", "qd", "tau_drive")
        if taken is None:
            return
        q, qd, tau = taken

        def message(i: int) -> Any:
            return self._types.make(
                "JointState",
                header=self._types.header(q.time[i], ""),
                name=list(q.labels),
                position=q.value[i],
                velocity=qd.value[i],
                effort=tau.value[i],
            )

        yield Topic("/joint_states", _PACKAGES["JointState"], q.time, message)

    def thrusters(self) -> Iterator[Topic]:
        """Thrusts [N] as efforts, by thruster."""
        taken = self._take("thrust")
        if taken is None or not taken[0].labels:
            return
        (thrust,) = taken
        empty = np.empty(0)

        def message(i: int) -> Any:
            return self._types.make(
                "JointState",
                header=self._types.header(thrust.time[i], HULL),
                name=list(thrust.labels),
                position=empty,
                velocity=empty,
                effort=thrust.value[i],
            )

        yield Topic("/thrusters", _PACKAGES["JointState"], thrust.time, message)

    def odometry(self) -> Iterator[Topic]:
        """True and estimated pose of the hull; the twist is the poses' difference quotient."""
        for topic, place, attitude, sigma in (
            ("/odometry", "p_WB", "quat_WB_wxyz", ""),
            ("/odometry/estimate", "p_WB_estimate", "quat_WB_estimate_wxyz", "position_sigma"),
        ):
            taken = self._take(place, attitude)
            if taken is None:
                continue

            spread = self._run[sigma] if sigma and sigma in self._run else None
            yield self._odometry(topic, taken[0], taken[1], spread)

    def _odometry(self, topic: str, place: Series, attitude: Series, sigma: Series | None) -> Topic:
        twists = twists_of(place.time, place.value, attitude.value)

        def message(i: int) -> Any:
            covariance = np.zeros(36)
            if sigma is not None:
                covariance[[0, 7, 14]] = sigma.value[i] ** 2

            pose = self._types.make(
                "Pose",
                position=self._types.vector(place.value[i], "Point"),
                orientation=self._types.quaternion(attitude.value[i]),
            )
            twist = self._types.make(
                "Twist",
                linear=self._types.vector(twists[i, :3]),
                angular=self._types.vector(twists[i, 3:]),
            )
            return self._types.make(
                "Odometry",
                header=self._types.header(place.time[i], WORLD),
                child_frame_id=HULL,
                pose=self._types.make("PoseWithCovariance", pose=pose, covariance=covariance),
                twist=self._types.make("TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
            )

        return Topic(topic, _PACKAGES["Odometry"], place.time, message)

    def wrenches(self) -> Iterator[Topic]:
        """Force on the tool, true and estimated, and wrench of the arm on the hull."""
        for topic, name, frame in (
            ("/tool/contact", "contact_force", WORLD),
            ("/tool/contact/estimate", "felt_force", WORLD),
            ("/arm/base_wrench", "arm_wrench", HULL),
        ):
            taken = self._take(name)
            if taken is not None:
                yield self._wrench(topic, taken[0], frame)

    def _wrench(self, topic: str, series: Series, frame: str) -> Topic:
        no_torque = np.zeros(3)

        def message(i: int) -> Any:
            row = series.value[i]
            torque = row[3:] if len(row) > 3 else no_torque
            wrench = self._types.make(
                "Wrench", force=self._types.vector(row[:3]), torque=self._types.vector(torque)
            )
            return self._types.make(
                "WrenchStamped", header=self._types.header(series.time[i], frame), wrench=wrench
            )

        return Topic(topic, _PACKAGES["WrenchStamped"], series.time, message)

    def vectors(self) -> Iterator[Topic]:
        """Water at the hull, and points of the tool."""
        for topic, name, kind, part in (
            ("/current", "current", "Vector3Stamped", "vector"),
            ("/tool/point", "p_pad", "PointStamped", "point"),
            ("/tool/point/command", "p_command", "PointStamped", "point"),
        ):
            taken = self._take(name)
            if taken is not None:
                yield self._vector(topic, taken[0], kind, part)

    def _vector(self, topic: str, series: Series, kind: str, part: str) -> Topic:
        inner = "Point" if part == "point" else "Vector3"

        def message(i: int) -> Any:
            stamped = {
                "header": self._types.header(series.time[i], WORLD),
                part: self._types.vector(series.value[i], inner),
            }
            return self._types.make(kind, **stamped)

        return Topic(topic, _PACKAGES[kind], series.time, message)

    def transforms(self) -> Iterator[Topic]:
        """Poses of all bodies in the world, for `/tf`."""
        taken = self._take("body_pose")
        if taken is None:
            return
        (poses,) = taken
        # In memory a body has one label, in a folder one for each column.
        one_each = len(poses.labels) == poses.value.shape[1]
        labels = poses.labels[::_POSE_WIDTH] if one_each else poses.labels
        names = [label.removesuffix(".x") for label in labels]

        def message(i: int) -> Any:
            rows = poses.value[i].reshape(-1, _POSE_WIDTH)
            header = self._types.header(poses.time[i], WORLD)
            return self._types.make(
                "TFMessage",
                transforms=[
                    self._types.make(
                        "TransformStamped",
                        header=header,
                        child_frame_id=name,
                        transform=self._types.make(
                            "Transform",
                            translation=self._types.vector(row[:3]),
                            rotation=self._types.quaternion(row[3:]),
                        ),
                    )
                    for name, row in zip(names, rows, strict=True)
                    if name != WORLD
                ],
            )

        yield Topic("/tf", _PACKAGES["TFMessage"], poses.time, message)

    def events(self) -> Iterator[Topic]:
        """Changes of the phase of the work."""
        events = self._run.events
        time = np.array([event.time for event in events])

        def message(i: int) -> Any:
            event: Event = events[i]
            cause = "" if event.abort is None else f" ({event.abort})"
            note = f": {event.note}" if event.note else ""
            return self._types.make(
                "Log",
                stamp=self._types.stamp(event.time),
                level=_ERROR if event.abort is not None else _INFO,
                name="work",
                msg=f"{event.state}{cause}{note}",
                file="",
                function="",
                line=0,
            )

        yield Topic("/events", _PACKAGES["Log"], time, message)

    def clouds(self) -> Iterator[Topic]:
        """Point clouds that the run kept, at its start: it keeps no time with them."""
        for name, points in self._clouds.items():
            topic = re.sub(r"\W", "_", name)
            yield Topic(
                f"/clouds/{topic}",
                _PACKAGES["PointCloud2"],
                np.zeros(1),
                lambda _, points=points: self._cloud(points),
            )

    def _cloud(self, points: Array) -> Any:
        fields = [
            self._types.make("PointField", name=axis, offset=4 * k, datatype=_FLOAT32, count=1)
            for k, axis in enumerate("xyz")
        ]
        packed = np.frombuffer(np.ascontiguousarray(points, "<f4").tobytes(), np.uint8)
        return self._types.make(
            "PointCloud2",
            header=self._types.header(0.0, WORLD),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=12,
            row_step=12 * len(points),
            data=packed,
            is_dense=bool(np.isfinite(points).all()),
        )

    def description(self) -> Iterator[Topic]:
        """The vehicle as a URDF, once."""
        if self._description:
            text = self._types.make("String", data=self._description)
            yield Topic("/robot_description", _PACKAGES["String"], np.zeros(1), lambda _: text)


_MAKERS = (
    RunTopics.joints,
    RunTopics.thrusters,
    RunTopics.odometry,
    RunTopics.wrenches,
    RunTopics.vectors,
    RunTopics.transforms,
    RunTopics.events,
    RunTopics.clouds,
    RunTopics.description,
)


def twists_of(time: Array, p_WB: Array, quat_WB_wxyz: Array) -> Array:
    """Twists (N, 6) of the hull in its own axes [m/s, rad/s], from the differences of its poses.

    Args:
        time: (N,) [s].
        p_WB: (N, 3) [m].
        quat_WB_wxyz: (N, 4).
    """
    from scipy.spatial.transform import Rotation

    if len(time) < 2:
        return np.zeros((len(time), 6))

    attitude = Rotation.from_quat(quat_WB_wxyz, scalar_first=True)
    steps = np.diff(time)
    turns_B = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / steps[:, None]
    rates_W = np.gradient(p_WB, time, axis=0)

    # Turns are those between samples: their mean belongs to the sample.
    padded = np.vstack([turns_B[:1], turns_B, turns_B[-1:]])
    return np.hstack([attitude.inv().apply(rates_W), (padded[:-1] + padded[1:]) / 2.0])
