"""Client of `uuv serve udp`: a controller of your own behind a socket. One file, no dependencies.

    from client import Client

    with Client(port=9010) as client:
        for measured in client:
            torque = my_arm(measured.q, measured.qd, measured.q_set)
            client.send(measured, joint_torque=torque, thrusters=my_hull(measured))

Copy it to where your controller runs, or write its like in another language: the frames are below,
every field in docs/udp.md. All numbers are little-endian; lengths are in m, angles in rad, forces
in N, times in s. Frames: W world (z up), B hull (forward, port, up), G tool (z out of it).
"""

import contextlib
import math
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

VERSION = 2  # of the frames
PORT = 9010  # UDP, of the simulation
MEASURED = b"UUVM"  # begins a frame with measurements and set points
COMMANDED = b"UUVC"  # begins a frame with a command
ENDED = b"UUVE"  # begins the last frame, after which the simulation has ended

# Header: what it is, version, joints n, thrusters m, count, flags, lost thrusters, simulated time.
HEADER = struct.Struct("<4sHBBIIId")
SCAN = 1  # flag: a frame of the camera is asked for; to be handed back in the command
FORCE_CONTROL = 2  # flag: press with the set force
TARE = 4  # flag: average the joint torques now
COMPLIANT = 8  # flag: yield to forces across the tool axis
STANDING = 16  # flag: the pressed tool stands on the surface
FRESH = 32  # flag: the set points changed since the last frame
START = 64  # flag: the first frame, before the run; its command is not carried out

# Numbers of a frame with measurements after its header; n: one for each joint.
MEASUREMENT: dict[str, int | str] = {
    "vision_age": 1,
    "dvl_age": 1,
    "imu_age": 1,
    "imu_jump_age": 1,
    "link_age": 1,
    "p_WB": 3,
    "R_WB": 9,
    "v_WB_B": 3,
    "w_WB_B": 3,
    "a_WB_B": 3,
    "position_sigma": 3,
    "attitude_sigma": 1,
    "q": "n",
    "qd": "n",
    "tau": "n",
    "tau_doubt": "n",
    "applied_torque": "n",
    "object_moved_W": 3,
    "gyro_off_B": 3,
    "attitude_off_B": 3,
    # Set points.
    "set_time": 1,
    "state": 1,
    "p_WB_set": 3,
    "R_WB_set": 9,
    "v_WB_set": 3,
    "w_WB_set": 3,
    "p_WG_set": 3,
    "R_WG_set": 9,
    "v_WG_set": 3,
    "w_WG_set": 3,
    "q_set": "n",
    "qd_set": "n",
    "set_force": 1,
    "path_s": 1,
    "lost_thrust": "m",
}
# Numbers of a frame with a command after its header; m: one for each thruster, nn: for each pair of
# joints, n6: for each joint and each of six axes, both row by row.
COMMAND: dict[str, int | str] = {
    "joint_torque": "n",
    "thrusters": "m",
    "force_W": 3,
    "normal": 1,
    "sigma_G": 3,
    "arm_wrench_B": 6,
    "current_W": 3,
    "stiffness": "nn",
    "damping": "nn",
    "compensation": "n6",
    "gear_friction": "n",
}
# What each number of a command is if the controller does not give the quantity.
UNSTATED: dict[str, float] = {
    "force_W": math.nan,
    "normal": math.nan,
    "sigma_G": math.inf,
    "arm_wrench_B": math.nan,
    "current_W": math.nan,
    "stiffness": 0.0,
    "damping": 0.0,
    "compensation": 0.0,
    "gear_friction": math.nan,
}
LARGEST = 16_384  # [bytes] of a frame
_GREETING = 300.0  # [s] that the first frame is waited for
_PATIENCE = 0.5  # [s] after which hello is said again


class PacketError(ValueError):
    """A datagram that is no frame of this version."""


@dataclass(frozen=True)
class Packet:
    """One frame: its header, and its numbers by name, a number or a tuple."""

    kind: bytes
    joints: int
    thrusters: int
    count: int
    flags: int
    lost: int  # bit i: thruster i is not to be used
    time: float  # [s] simulated, of the measurement; a command has that of the one it answers
    values: dict[str, Any]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["values"][name]
        except KeyError:
            raise AttributeError(name) from None

    def flag(self, mask: int) -> bool:
        """Whether a flag is set."""
        return bool(self.flags & mask)


def pack(frame: Packet) -> bytes:
    """A frame as bytes.

    Raises:
        PacketError: A quantity is missing or has another size.
    """
    numbers: list[float] = []
    for name, size in _fields(frame.kind).items():
        if name not in frame.values:
            raise PacketError(f"{name}: is missing")

        value = frame.values[name]
        width = _width(size, frame.joints, frame.thrusters)
        entries = [float(value)] if size == 1 else list(value)

        if len(entries) != width:
            raise PacketError(f"{name}: must have {width} numbers, got {len(entries)}")
        numbers += entries

    header = (frame.kind, VERSION, frame.joints, frame.thrusters)
    more = (frame.count, frame.flags, frame.lost, frame.time)
    return HEADER.pack(*header, *more) + struct.pack(f"<{len(numbers)}d", *numbers)


def unpack(data: bytes) -> Packet:
    """The frame in a datagram.

    Raises:
        PacketError: It is none, or of another version.
    """
    if len(data) < HEADER.size:
        raise PacketError(f"a frame has at least {HEADER.size} bytes, got {len(data)}")
    kind, version, joints, thrusters, count, flags, lost, stamp = HEADER.unpack_from(data)

    if kind not in (MEASURED, COMMANDED, ENDED):
        raise PacketError(f"a frame begins with UUVM, UUVC or UUVE, got {kind!r}")
    if version != VERSION:
        raise PacketError(f"the version must be {VERSION}, got {version}")

    fields = _fields(kind)
    widths = [_width(size, joints, thrusters) for size in fields.values()]
    if len(data) != HEADER.size + 8 * sum(widths):
        raise PacketError(
            f"{joints} joints and {thrusters} thrusters take {HEADER.size + 8 * sum(widths)} "
            f"bytes, got {len(data)}"
        )

    numbers = struct.unpack_from(f"<{sum(widths)}d", data, HEADER.size)
    values: dict[str, Any] = {}
    start = 0
    for (name, size), width in zip(fields.items(), widths, strict=True):
        part = numbers[start : start + width]
        values[name] = part[0] if size == 1 else part
        start += width
    return Packet(kind, joints, thrusters, count, flags, lost, stamp, values)


def _fields(kind: bytes) -> dict[str, int | str]:
    return {MEASURED: MEASUREMENT, COMMANDED: COMMAND}.get(kind, {})


def _width(size: int | str, joints: int, thrusters: int) -> int:
    return size if isinstance(size, int) else _widths(joints, thrusters)[size]


def _widths(joints: int, thrusters: int) -> dict[str, int]:
    return {"n": joints, "m": thrusters, "nn": joints * joints, "n6": 6 * joints}


def answer(measured: Packet, **quantities: float | Sequence[float]) -> bytes:
    """Frame of the command that answers a measurement.

    Args:
        measured: Measurement that is answered.
        quantities: Quantities of `COMMAND` by name; those of `UNSTATED` may be left out.

    Raises:
        PacketError: A quantity is unknown, is missing, or has another size.
    """
    for name in quantities:
        if name not in COMMAND:
            raise PacketError(f"{name}: is no quantity of a command ({', '.join(COMMAND)})")

    values: dict[str, Any] = dict(quantities)
    for name, number in UNSTATED.items():
        if name not in values:
            width = _width(COMMAND[name], measured.joints, measured.thrusters)
            values[name] = number if COMMAND[name] == 1 else (number,) * width
    return pack(
        replace(measured, kind=COMMANDED, flags=measured.flags & SCAN, lost=0, values=values)
    )


class Client:
    """Connection to `uuv serve udp`: iterate over its measurements, and send a command for each."""

    def __init__(
        self, host: str = "127.0.0.1", port: int = PORT, *, patience: float = 10.0
    ) -> None:
        """Open the connection.

        Args:
            host: Address of the simulation.
            port: Its port.
            patience: [s] without a frame after which the simulation is taken as gone; the first
                frame is waited for 300 s, for a simulation may have to compile.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((host, port))
        self._patience = patience
        self._count = -1  # of the newest measurement
        self._sent = b""  # command that answered it
        self._refused = ""  # why the last datagram was no frame

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def __iter__(self) -> Iterator[Packet]:
        """Measurements until the simulation ends, the newest each time.

        One with the flag START begins a run; its answer is not carried out.

        Raises:
            TimeoutError: The simulation is gone.
        """
        end = time.monotonic() + _GREETING
        while True:
            frame = self._newest()
            if frame is None:
                if time.monotonic() > end:
                    raise TimeoutError(f"no frame of the simulation{self._refused}")
                self.hello()
                continue

            end = time.monotonic() + self._patience
            if frame.kind == ENDED:
                return
            if frame.count == self._count:  # asked again: the answer was lost
                if self._sent:
                    self._transmit(self._sent)
                continue
            if frame.count < self._count and not frame.flag(START):
                continue  # it came late

            self._count = frame.count
            self._sent = b""
            yield frame

    def _newest(self) -> Packet | None:
        """Newest frame that is there, or comes within half a second."""
        newest: Packet | None = None
        self._socket.settimeout(_PATIENCE)
        while True:
            try:
                frame = unpack(self._socket.recv(LARGEST))
            except PacketError as error:
                self._refused = f"; the last datagram: {error}"
                continue
            except ConnectionError:  # nobody listens yet, or any more
                time.sleep(0.0 if newest else _PATIENCE)
                return newest
            except (TimeoutError, BlockingIOError):
                return newest

            if frame.kind != COMMANDED:
                newest = frame
            if frame.kind == ENDED:
                return newest
            self._socket.settimeout(0.0)

    def hello(self) -> None:
        """Ask for measurements."""
        self._transmit(HEADER.pack(ENDED, VERSION, 0, 0, 0, 0, 0, 0.0))

    def send(
        self,
        measured: Packet,
        *,
        joint_torque: Sequence[float],
        thrusters: Sequence[float],
        **further: float | Sequence[float],
    ) -> None:
        """Command the vehicle.

        Args:
            measured: Packet that the command answers.
            joint_torque: (n,) [N m].
            thrusters: (m,) in [-1, 1].
            further: Quantities that may be left out:
                force_W (3,) [N], estimated force of the world on the tip;
                normal [N], the same along the tool axis, positive when it presses;
                sigma_G (3,) [N], standard deviation of the force, tool axes;
                arm_wrench_B (6,) [N, N m] of the arm on the hull, as the controller believes;
                current_W (3,) [m/s] of the water, as the controller believes;
                stiffness (n * n) [N m/rad], damping (n * n) [N m s/rad], compensation (n * 6)
                [rad/m, rad/rad] and gear_friction (n,) [N m], by which the vehicle carries on a
                late command, see docs/udp.md.

        Raises:
            PacketError: A quantity is unknown or has another size.
        """
        self._sent = answer(measured, joint_torque=joint_torque, thrusters=thrusters, **further)
        self._transmit(self._sent)

    def _transmit(self, data: bytes) -> None:
        with contextlib.suppress(ConnectionError):  # nobody listens
            self._socket.send(data)
