"""Thousands of datagrams that nobody should send, at the doors for other programs."""

import json
import struct
import tracemalloc
from collections import Counter

import numpy as np
import pytest

from uuv.serve import client
from uuv.serve.ardupilot import ArduPilotDoor
from uuv.serve.client import Packet, PacketError, pack, unpack
from uuv.serve.datagrams import listening

MOST = 65_507  # [bytes] of a datagram


def thrown(rng: np.random.Generator, sound: bytes) -> bytes:
    """A datagram: noise, or a sound one with bits turned, cut, or of extreme numbers."""
    match rng.integers(5):
        case 0:
            return rng.bytes(int(rng.integers(0, 300)))
        case 1:
            return rng.bytes(int(rng.integers(0, MOST)))
        case 2:
            return sound[: int(rng.integers(0, len(sound)))] + rng.bytes(int(rng.integers(0, 9)))
        case 3:
            content = bytearray(sound)
            for at in rng.integers(0, len(content), int(rng.integers(1, 5))):
                content[at] ^= 1 << int(rng.integers(8))
            return bytes(content)
        case _:
            # Whole numbers and floats at their ends.
            content = bytearray(sound)
            at = int(rng.integers(0, len(content) - 8))
            extreme = [b"\xff" * 8, bytes(8), struct.pack("<d", float("nan")), b"\x7f" * 8]
            content[at : at + 8] = extreme[int(rng.integers(4))]
            return bytes(content)


def check_autopilots_door(count: int) -> Counter[str]:
    """Each is answered by finite numbers, or counted; what the vehicle does stays finite."""
    door = ArduPilotDoor("vectored")
    rng = np.random.default_rng(31)
    outcomes: Counter[str] = Counter()
    for number in range(count):
        sound = struct.pack("<HHI16H", 18458, 400, number + 1, *rng.integers(0, 65_536, 16))
        reply = door.reply(thrown(rng, sound))
        outcomes["answered" if reply else "refused"] += 1
        if reply:
            state = json.loads(reply)
            assert np.isfinite([*state["position"], *state["quaternion"]]).all()
    traffic = door.traffic
    assert outcomes["refused"] == traffic.refused
    assert outcomes["answered"] == traffic.stepped + traffic.repeated + traffic.late
    return outcomes


def check_frames(count: int) -> Counter[str]:
    """Each is a frame, or refused by the one error of frames."""
    rng = np.random.default_rng(32)
    sizes = {"n": 6, "m": 8, "nn": 36, "n6": 36}
    outcomes: Counter[str] = Counter()
    for number in range(count):
        values = {}
        for name, size in client.COMMAND.items():
            width = size if isinstance(size, int) else sizes[size]
            numbers = tuple(rng.normal(size=width).tolist())
            values[name] = numbers[0] if size == 1 else numbers
        sound = pack(Packet(client.COMMANDED, 6, 8, number, 37, 5, 1.25, values))
        try:
            unpack(thrown(rng, sound))
            outcomes["read"] += 1
        except PacketError:
            outcomes["refused"] += 1
    return outcomes


def test_some_hundred_datagrams_are_answered_or_counted() -> None:
    assert min(check_autopilots_door(150).values()) > 20
    assert min(check_frames(150).values()) > 20


def test_a_datagram_of_full_size_is_received_whole() -> None:
    with listening(0) as endpoint, listening(0) as other:
        other.bound.sendto(bytes(MOST), ("127.0.0.1", endpoint.port))
        assert endpoint.receive(5.0) == bytes(MOST)


@pytest.mark.long(
    guarded_by="tests/unit/uuv/serve/test_many_datagrams.py::"
    "test_some_hundred_datagrams_are_answered_or_counted"
)
def test_5000_datagrams_cost_bounded_memory() -> None:
    tracemalloc.start()
    try:
        for check in (check_autopilots_door, check_frames):
            outcomes = check(2500)
            peak = tracemalloc.get_traced_memory()[1]
            print(check.__name__, dict(outcomes), f"{peak / 1e6:.1f} MB")
            assert peak < 50e6
    finally:
        tracemalloc.stop()
