"""One MCAP file: channels by topic, messages in the encoding of ROS 2."""

from collections import Counter
from collections.abc import Mapping
from typing import IO, Any

from uuv.export.topics import RosTypes, Topic, nanoseconds
from uuv.sim.interfaces.extras import wanted

_PROFILE = "ros2"
_LATCHED = ("/robot_description", "/clouds")  # begin topics whose last message stays valid
# Of a latched topic, as ROS 2 records it: transient local, reliable, depth 1.
QOS = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
    "  deadline: {sec: 9223372036, nsec: 854775807}\n"
    "  lifespan: {sec: 9223372036, nsec: 854775807}\n"
    "  liveliness: 1\n  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}\n"
    "  avoid_ros_namespace_conventions: false\n"
)


def is_latched(topic: Topic) -> bool:
    """Whether a topic's last message stays valid."""
    return topic.name.startswith(_LATCHED)


class McapFile:
    """An MCAP file that is written message by message."""

    def __init__(self, stream: IO[bytes], types: RosTypes, *, chunk: int | None = None) -> None:
        """Begin the file.

        Args:
            stream: To write to.
            types: Message types.
            chunk: [bytes] after which messages are compressed and written; None: mcap's usual.

        Raises:
            MissingLibraryError: The package mcap is not installed.
        """
        with wanted():
            from mcap.writer import Writer

        self._types = types
        self._writer: Any = Writer(stream) if chunk is None else Writer(stream, chunk_size=chunk)
        self._writer.start(profile=_PROFILE, library="uuv-arm")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: Counter[str] = Counter()

    def describe(self, name: str, texts: Mapping[str, str]) -> None:
        """Keep texts by name as metadata."""
        self._writer.add_metadata(name, dict(texts))

    def add(self, topic: Topic, index: int) -> None:
        """Write a topic's message at its time."""
        if topic.name not in self._channels:
            self.open(topic)

        # Its own time is that of writing too.
        stamp = nanoseconds(float(topic.time[index]))
        data = self._types.encoded(topic.kind, topic.message(index))
        sequence = self._counts[topic.name]
        self._writer.add_message(self._channels[topic.name], stamp, data, stamp, sequence=sequence)
        self._counts[topic.name] += 1

    def open(self, topic: Topic) -> None:
        """Register a topic, with the definition of its type, before its first message."""
        if topic.kind not in self._schemas:
            text = self._types.definition(topic.kind).encode()
            self._schemas[topic.kind] = self._writer.register_schema(topic.kind, "ros2msg", text)

        qos = {"offered_qos_profiles": QOS} if is_latched(topic) else {}
        schema = self._schemas[topic.kind]
        self._channels[topic.name] = self._writer.register_channel(topic.name, "cdr", schema, qos)

    @property
    def count(self) -> int:
        """Messages so far."""
        return self._counts.total()

    def finish(self) -> None:
        """Write what is left, and the file's index."""
        self._writer.finish()
