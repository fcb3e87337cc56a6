"""An autopilot of another maker for the door of ArduPilot, after its public document alone.

Sockets, JSON and the table of ArduSub's motor frames; nothing of this project.
"""

import json
import math
import socket
import struct
from dataclasses import dataclass, field
from typing import Any

RATE = 100  # [Hz]
NEUTRAL, SPAN = 1500.0, 400.0  # [us]
ANSWER = 65_536  # [bytes] at most
# Factors of roll right, pitch up, yaw right, up, forward, right on each motor's command.
LEVEL = ((0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1))
MOTORS = {
    "vectored": (*LEVEL, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0)),
    "vectored_6dof": (
        *LEVEL,
        (1, -1, 0, -1, 0, 0),
        (-1, -1, 0, -1, 0, 0),
        (1, 1, 0, -1, 0, 0),
        (-1, 1, 0, -1, 0, 0),
    ),
}


class Link:
    """Packets of servo pulses out, states in, in lockstep; a lost answer is asked for again."""

    def __init__(self, port: int, *, channels: int = 16) -> None:
        self.magic = {16: 18458, 32: 29569}[channels]
        self.channels = channels
        self.count = -1
        self.repeats = 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(5.0)
        self.socket.connect(("127.0.0.1", port))

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()

    def exchange(self, pulses: list[float]) -> dict[str, Any]:
        """The state after one frame of these pulses."""
        self.count += 1
        return self.again(pulses)

    def again(self, pulses: list[float]) -> dict[str, Any]:
        """The answer to the last count, sent once more."""
        values = [round(pulse) for pulse in pulses]
        values += [round(NEUTRAL)] * (self.channels - len(values))
        packet = struct.pack(
            f"<HHI{self.channels}H", self.magic, RATE, self.count, *values[: self.channels]
        )
        for _ in range(10):
            try:
                self.socket.send(packet)
                return json.loads(self.socket.recv(ANSWER))
            except (TimeoutError, ConnectionRefusedError):
                self.repeats += 1
        raise TimeoutError("no answer")


@dataclass
class Pid:
    """One axis of a controller."""

    kp: float
    kd: float
    ki: float = 0.0
    most: float = 0.4  # of the integral
    summed: float = 0.0

    def demand(self, error: float, rate: float) -> float:
        """Share of full thrust for an error and the rate at which the axis moves."""
        step = self.ki * error / RATE
        self.summed = min(max(self.summed + step, -self.most), self.most)
        return self.kp * error - self.kd * rate + self.summed


@dataclass
class Autopilot:
    """Holds depth, heading and place at 100 Hz; roll and pitch where the frame has them."""

    frame: str
    place: list[Pid] = field(default_factory=lambda: [Pid(1.2, 1.0, 0.4) for _ in range(2)])
    depth: Pid = field(default_factory=lambda: Pid(1.2, 0.9, 0.4))
    turns: list[Pid] = field(
        default_factory=lambda: [Pid(0.5, 0.12), Pid(0.5, 0.12), Pid(0.8, 0.3, 0.2)]
    )

    def pulses(self, state: dict[str, Any], north: float, east: float, down: float) -> list[float]:
        """Pulses [us] of the motors toward a place, heading north."""
        w, x, y, z = state["quaternion"]
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

        # Errors to the north and east, along the hull.
        c, s = math.cos(yaw), math.sin(yaw)
        gap = [north - state["position"][0], east - state["position"][1]]
        speed = state["velocity"][:2]
        forward = self.place[0].demand(*(c * v[0] + s * v[1] for v in (gap, speed)))
        right = self.place[1].demand(*(-s * v[0] + c * v[1] for v in (gap, speed)))
        up = -self.depth.demand(down - state["position"][2], state["velocity"][2])

        gyro = state["imu"]["gyro"]
        turned = [
            pid.demand(-angle, rate)
            for pid, angle, rate in zip(self.turns, (roll, pitch, yaw), gyro, strict=True)
        ]
        asked = (*turned, up, forward, right)
        shares = [sum(f * a for f, a in zip(row, asked, strict=True)) for row in MOTORS[self.frame]]
        return [NEUTRAL + SPAN * max(-1.0, min(1.0, share)) for share in shares]


def square(time: float, side: float = 2.0, speed: float = 0.2) -> tuple[float, float]:
    """Place [m] on a square to the north and east, with 2 s of rest at each corner."""
    leg = side / speed + 2.0
    number, into = divmod(time, leg)
    share = min(into * speed, side)
    corners = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)]
    begin, end = corners[int(number) % 4], corners[(int(number) + 1) % 4]
    north, east = (a + (b - a) * share / side for a, b in zip(begin, end, strict=True))
    return north, east
