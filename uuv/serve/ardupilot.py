"""The physics behind an autopilot: ArduPilot's simulation flies a vehicle of this project.

Lockstep: a packet of servo pulses is one frame of physics and one answer. What goes wrong on the
way is answered by rule and counted: a packet that came twice is answered again and not stepped, a
packet that is missing is a loss, a count that begins anew is a restart.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from uuv.logs.ardusub_frames import (
    LARGEST_PULSE,
    LEAST_PULSE,
    NEUTRAL,
    SPAN,
    USUAL_VEHICLES,
    MotorMap,
)
from uuv.serve.ardupilot_packets import ServoPacket, VehicleMotion, answer, servo_packet
from uuv.serve.served_vehicle import DiveSite, ServedVehicle
from uuv.sim.interfaces.errors import ConfigurationError

_COUNTS = 1 << 32  # the frame count begins anew after as many
_FEW = 1 << 16  # packets; by fewer a count falls in one that came late
_FIRST = 1  # a count up to this one is that of a start
_DOWN = 1  # number of the range finder that looks down
_TO_FRD = np.array([1.0, -1.0, -1.0])  # from forward, port, up; also from our world to NED


@dataclass(slots=True)
class Traffic:
    """What arrived, and what was done with it."""

    stepped: int = 0  # packets that advanced the vehicle
    repeated: int = 0  # answered again, without a step
    late: int = 0  # older than the last, answered as a repeat
    lost: int = 0  # counts that never arrived
    restarts: int = 0  # the vehicle was put back to the start
    refused: int = 0  # datagrams that are no packet
    reason: str = field(default="", repr=False)  # why the last one was refused

    def summary(self) -> str:
        """In one line."""
        return ", ".join(
            f"{count} {name}" for name, count in asdict(self).items() if name != "reason"
        )


class ArduPilotDoor:
    """Answers an autopilot's packets with the motion of a vehicle."""

    def __init__(
        self,
        frame: str,
        *,
        vehicle: str = "",
        water: DiveSite | None = None,
        directions: Sequence[int] = (),
        arm_channels: Sequence[int] = (),
    ) -> None:
        """Match the frame's motors with the vehicle's thrusters.

        Args:
            frame: ArduSub's motor frame (`uuv.logs.ardusub_frames.FRAMES`).
            vehicle: Named vehicle; empty: that which usually has the frame.
            water: Where it begins; None: at rest, 1 m deep.
            directions: MOT_n_DIRECTION, 1 or -1 for each motor; empty: all 1.
            arm_channels: Channel, from 1, of each joint of the arm: its range over 1100 to 1900 us.
                Empty: the arm is held at home.

        Raises:
            ConfigurationError: Packet and vehicle do not fit, or channels and joints.
        """
        name = vehicle or USUAL_VEHICLES.get(frame, "")
        if not name:
            raise ConfigurationError(
                f"frame: must be one of {', '.join(USUAL_VEHICLES)}, got {frame!r}"
            )
        self.vehicle = ServedVehicle(name, water or DiveSite())
        parts = self.vehicle.vehicle

        self.motors = MotorMap.of(frame, parts.thruster_wrench, directions=directions, vehicle=name)
        self._arm = _arm_channels(arm_channels, len(self.motors.thrusters), parts.joint_names)
        self.traffic = Traffic()
        self._count = -1  # of the last packet; -1: none yet
        self._answer = b""

    def reply(self, datagram: bytes, interrupts: bool = False) -> bytes:
        """Answer (JSON) to a datagram; empty where it is no packet.

        Args:
            datagram: As it arrived.
            interrupts: Another sender's than the last one's, who spoke just now: it counts if an
                autopilot begins with it.

        Raises:
            HydrodynamicsError: The motion diverged.
        """
        try:
            packet = servo_packet(datagram)
        except ConfigurationError as error:
            return self._refuse(str(error))

        if interrupts and packet.frame_count > _FIRST:
            return self._refuse(f"packet {packet.frame_count} of a second sender")
        if self._count >= 0 and not self._is_next(packet.frame_count):
            return self._answer

        self._count = packet.frame_count
        self._step(packet)
        self.traffic.stepped += 1
        self._answer = answer(self._motion())
        return self._answer

    def _refuse(self, reason: str) -> bytes:
        """Count a datagram that is not answered."""
        self.traffic.refused += 1
        self.traffic.reason = reason
        return b""

    def _is_next(self, count: int) -> bool:
        """Whether a count asks for a step; a gap before it and a restart are noted."""
        traffic = self.traffic
        ahead = (count - self._count) % _COUNTS

        if ahead == 0:
            traffic.repeated += 1
            return False
        if ahead < _COUNTS // 2:  # the count may have begun anew after the last
            traffic.lost += ahead - 1
            return True

        behind = self._count - count  # below zero: ahead by too much for a gap
        if count > _FIRST and 0 < behind < _FEW and behind < self._count // 2:
            traffic.late += 1
            return False

        traffic.restarts += 1
        self.vehicle.reset()
        return True

    def _step(self, packet: ServoPacket) -> None:
        """Advance by the packet's frame."""
        if self._arm.size:
            limits = self.vehicle.vehicle.q_limits
            pulses = packet.pulses[self._arm - 1]
            share = np.clip((pulses - NEUTRAL) / (2.0 * SPAN) + 0.5, 0.0, 1.0)
            is_on = (pulses >= LEAST_PULSE) & (pulses <= LARGEST_PULSE)
            aims = limits[:, 0] + share * (limits[:, 1] - limits[:, 0])
            self.vehicle.q_set = np.where(is_on, aims, self.vehicle.q_set)

        self.vehicle.step(self.motors.commands(packet.pulses), 1.0 / packet.frame_rate)

    def _motion(self) -> VehicleMotion:
        """The vehicle's motion in the axes of the autopilot."""
        vehicle = self.vehicle
        altitude = vehicle.altitude

        return VehicleMotion(
            time=vehicle.time,
            gyro=_TO_FRD * vehicle.w_WB_B,
            specific_force=_TO_FRD * vehicle.specific_force_B,
            position=_TO_FRD * vehicle.p_WB,
            velocity=_TO_FRD * vehicle.v_WB_W,
            # A half turn about x on both sides turns the signs of y and z.
            quaternion=vehicle.quat_WB_wxyz * np.array([1.0, 1.0, -1.0, -1.0]),
            ranges={_DOWN: altitude} if math.isfinite(altitude) else {},
        )


def _arm_channels(channels: Sequence[int], motors: int, joints: Sequence[str]) -> np.ndarray:
    """Channels (n,) of the arm's joints; none, if the arm is held.

    Raises:
        ConfigurationError: Not one for each joint, a motor's, out of range, or one twice.
    """
    numbers = np.array(list(channels), dtype=np.int64)
    if not numbers.size:
        return numbers
    if len(numbers) != len(joints):
        raise ConfigurationError(
            f"arm channels: one for each of {len(joints)} joints ({', '.join(joints) or 'none'}), "
            f"got {len(numbers)}"
        )
    if numbers.min() <= motors or numbers.max() > 16 or len(set(channels)) < len(numbers):
        raise ConfigurationError(
            f"arm channels: must be different ones of {motors + 1} to 16, after the motors', "
            f"got {list(channels)}"
        )
    return numbers
