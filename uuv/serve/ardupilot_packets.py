"""Packets of ArduPilot's JSON physics interface: servo pulses in, the vehicle's motion out.

The autopilot's simulation (SITL, `--model JSON:ADDRESS`) sends pulse widths in a binary packet and
waits for one line of JSON. Axes of the answer are forward, right, down for the body, and north,
east, down for the world [ArduPilot JSON].
"""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

# Little-endian: magic, frame rate [Hz], frame count; then a pulse [us] for each channel.
_HEADER = struct.Struct("<HHI")
CHANNELS = {18458: 16, 29569: 32}  # by the packet's magic number
LARGEST_PACKET = _HEADER.size + 2 * max(CHANNELS.values())  # [bytes]
SLOWEST = 10  # [Hz] frame rate that is served
FASTEST = 10_000  # [Hz]


@dataclass(frozen=True, slots=True, eq=False)
class ServoPacket:
    """One packet of the autopilot: what it commands, and the step that it asks for."""

    frame_rate: int  # [Hz] reciprocal of the step
    frame_count: int  # rises by one a packet
    pulses: Array  # (16,) or (32,) [us]; 0: this output is off


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleMotion:
    """State of the vehicle as the answer has it: body forward-right-down, world north-east-down."""

    time: float  # [s]
    gyro: Array  # (3,) [rad/s]
    specific_force: Array  # (3,) [m/s^2] acceleration less gravity; at rest (0, 0, -9.81)
    position: Array  # (3,) [m]
    velocity: Array  # (3,) [m/s]
    quaternion: Array  # (4,) wxyz, body in world
    ranges: Mapping[int, float]  # [m] of range finders, by their number from 1


def servo_packet(data: bytes) -> ServoPacket:
    """The packet in a datagram.

    Raises:
        ConfigurationError: Another magic number or length, or a frame rate that is not served.
    """
    if len(data) < _HEADER.size:
        raise ConfigurationError(f"packet of {len(data)} bytes: a header has {_HEADER.size}")
    magic, frame_rate, frame_count = _HEADER.unpack_from(data)

    if magic not in CHANNELS:
        allowed = " or ".join(f"{number} ({count} channels)" for number, count in CHANNELS.items())
        raise ConfigurationError(f"packet with magic number {magic}: {allowed} are served")

    size = _HEADER.size + 2 * CHANNELS[magic]
    if len(data) != size:
        raise ConfigurationError(
            f"packet of {len(data)} bytes: with magic number {magic} it has {size}"
        )
    if not SLOWEST <= frame_rate <= FASTEST:
        raise ConfigurationError(
            f"packet with frame rate {frame_rate} Hz: {SLOWEST} to {FASTEST} are served"
        )

    pulses = np.frombuffer(data, "<u2", offset=_HEADER.size).astype(np.float64)
    return ServoPacket(frame_rate, frame_count, pulses)


def answer(motion: VehicleMotion) -> bytes:
    """The motion as one line of JSON, with a line feed before and after it."""
    content = {
        "timestamp": motion.time,
        "imu": {"gyro": motion.gyro.tolist(), "accel_body": motion.specific_force.tolist()},
        "position": motion.position.tolist(),
        "velocity": motion.velocity.tolist(),
        "attitude": roll_pitch_yaw(motion.quaternion).tolist(),
        "quaternion": motion.quaternion.tolist(),
    }
    content |= {f"rng_{number}": distance for number, distance in motion.ranges.items()}
    return f"\n{json.dumps(content, allow_nan=False)}\n".encode()


def roll_pitch_yaw(quaternion: Array) -> Array:
    """Angles (3,) [rad] of a unit quaternion (4,) wxyz: yaw about z, then pitch, then roll."""
    w, x, y, z = quaternion
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.array([roll, pitch, yaw])
