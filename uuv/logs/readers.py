"""Readers of vehicles' logs by maintained libraries: ArduPilot dataflash, MAVLink telemetry, ROS.

A file from elsewhere may be cut or damaged: what can be read before that is taken, and the damage
is noted. Sizes are bounded.
"""

import contextlib
import importlib
import io
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.logs.gathered import Gathered, short
from uuv.logs.kinds import ENDINGS
from uuv.logs.vehicle_log import (
    ATTITUDE,
    DEPTH,
    FORCE,
    POSITION,
    PULSES,
    RATE,
    VELOCITY,
    VehicleLog,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import GRAVITY, Array, shown

LARGEST = 2 << 30  # [bytes] of a file
_TO_OURS = np.array([1.0, -1.0, -1.0])  # from forward, right, down, and from north, east, down
_MILLI = 1e-3  # of g, in a message
_AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
_GROUND_STATION = 255  # usual system number
_RESTART = 1.0  # [s] by which a clock may go back without being a new one
_WRAP = 2**32 * 1e-6  # [s] after which microseconds of 32 bits begin anew
# Bits of the status of ArduPilot's filter: horizontal position relative or absolute.
_PLACED = 8 | 16
# Bit of the same status: constant position, for want of a source.
_CONSTANT = 128
_NO_SOURCE = "the autopilot's filter had no source of the position"
_BESIDE = ("BAD_DATA", "PARAM_VALUE", "EKF_STATUS_REPORT")  # messages without a sample
_NUMBERS = 256  # of a sender's messages, before they begin anew
_CHANNELS = 16  # servo outputs of a message

Message = tuple[float, Mapping[str, Any]]  # time [s] and fields


def read_vehicle_log(file: str | Path) -> VehicleLog:
    """Read the log of a vehicle.

    Args:
        file: .BIN of ArduPilot, .tlog of MAVLink, .mcap, or a ROS bag (file or folder).

    Raises:
        ConfigurationError: There is no such file, it is none of these or holds nothing that is
            read.
        MissingLibraryError: The extra `bridge` is not installed.
    """
    path = Path(file)
    what = f"log {shown(str(path))}"
    _check_file(path, what)

    ending = path.suffix.lower()
    if ending == ".bin":
        log = _ardupilot(path, what, _dataflash, "ArduPilot dataflash (.BIN)")
    elif ending == ".tlog":
        log = _ardupilot(path, what, _telemetry, "MAVLink telemetry (.tlog)")
    else:
        from uuv.logs.ros_logs import read_ros_log

        log = read_ros_log(path, what)

    if not log.messages:
        note = f" ({log.notes[0]})" if log.notes else ""
        raise ConfigurationError(f"{what}: has no message of a {log.kind} log{note}")
    return log


def _check_file(path: Path, what: str) -> None:
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise ConfigurationError(
                f"{what}: a folder without metadata.yaml is no ROS bag; a .mcap or .db3 file in it "
                "can be given"
            )
    elif not path.is_file():
        raise ConfigurationError(f"{what}: there is no such file")
    elif path.suffix.lower() not in ENDINGS:
        raise ConfigurationError(f"{what}: allowed are {', '.join(ENDINGS)}, or a bag's folder")

    files = path.iterdir() if path.is_dir() else (path,)
    if sum(file.stat().st_size for file in files) > LARGEST:
        raise ConfigurationError(f"{what}: larger than {LARGEST >> 30} GB")


# --- ArduPilot ---


def _ardupilot(
    path: Path, what: str, read: Callable[[Path, "Gathered"], None], kind: str
) -> VehicleLog:
    """A log of ArduPilot, whatever its container."""
    with wanted():
        importlib.import_module("pymavlink")

    gathered = Gathered(what)
    with _quiet() as printed:
        try:
            read(path, gathered)
        except ConfigurationError:
            raise
        except Exception as error:  # the plain class is what pymavlink raises
            gathered.note(f"damaged after {gathered.messages} messages: {short(error)}")

    skipped = sum(map(int, re.findall(r"[Ss]kipped (\d+) bad bytes", printed.getvalue())))
    if skipped:
        gathered.note(f"{skipped} bytes of the file belong to no message")
    return gathered.log(path.name, kind)


@contextlib.contextmanager
def _quiet() -> Iterator[io.StringIO]:
    """Context that captures what pymavlink prints, and hides its warnings about files left open."""
    printed = io.StringIO()
    with (
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore", ResourceWarning)
        yield printed


def _dataflash(path: Path, gathered: "Gathered") -> None:
    """Messages of a .BIN file, by their names."""
    from pymavlink import DFReader

    with contextlib.closing(DFReader.DFReader_binary(str(path), zero_time_base=True)) as log:
        while (message := log.recv_match(type=["PARM", *_DATAFLASH])) is not None:
            gathered.count()
            if message.get_type() == "PARM":
                gathered.parameter(str(message.Name), message.Value)
            else:
                _DATAFLASH[message.get_type()](gathered, 1e-6 * message.TimeUS, message)


def _telemetry(path: Path, gathered: "Gathered") -> None:
    """Messages of a .tlog file that the first vehicle's autopilot sent."""
    from pymavlink import mavutil

    clock = _BootClock()
    bad = lost = 0
    with contextlib.closing(mavutil.mavlink_connection(str(path), robust_parsing=True)) as log:
        vehicle: int | None = None
        last: int | None = None  # sequence number
        while (message := log.recv_msg()) is not None:
            kind = message.get_type()
            if kind == "BAD_DATA":
                bad += 1
                continue

            # A ground station, a companion computer and another vehicle may speak too.
            system = message.get_srcSystem()
            foreign = system == _GROUND_STATION or vehicle not in (None, system)
            if foreign or message.get_srcComponent() != _AUTOPILOT:
                continue
            vehicle = system

            # Each message of a sender has the next number; one that comes again is no loss.
            number = int(message.get_seq())
            gap = 0 if last is None else (number - last - 1) % _NUMBERS
            lost += gap if gap < _NUMBERS // 2 else 0
            last = number
            if kind not in _BESIDE and kind not in _TELEMETRY:
                continue

            gathered.count()
            time = clock.time_of(message)
            if kind == "PARAM_VALUE":
                gathered.parameter(str(message.param_id), message.param_value)
            elif kind == "EKF_STATUS_REPORT":  # which has no time, and needs none
                gathered.has_position = _has_position(int(message.flags))
            elif time is not None:
                _TELEMETRY[kind](gathered, time, message)

    if bad:
        gathered.note(f"{bad} parts of the file belong to no message")
    if lost:
        gathered.note(f"{lost} messages are missing, by their sequence numbers")
    if clock.restarts:
        gathered.note(f"the vehicle restarted {clock.restarts} times; its clock is continued")


class _BootClock:
    """Time [s] of telemetry by the vehicle's clock, also for messages that do not state it."""

    def __init__(self) -> None:
        self.restarts = 0
        self._ahead = math.inf  # [s] least difference between the recorder's clock and that
        self._boot = 0.0  # [s] newest time since the vehicle's start
        self._shift = 0.0  # [s] of that, since the vehicle began anew

    def time_of(self, message: Any) -> float | None:
        """Time since the vehicle's first start; before that is known, None."""
        recorded = float(message._timestamp)
        by_recorder = recorded - self._ahead if math.isfinite(self._ahead) else None

        boot_ms = getattr(message, "time_boot_ms", 0)
        if boot_ms:
            boot = 1e-3 * boot_ms
            if boot < self._boot - _RESTART and by_recorder is not None:
                self.restarts += 1
                self._shift = by_recorder - boot
            self._boot = boot
            self._ahead = min(self._ahead, recorded - boot - self._shift)
            return boot + self._shift

        # Microseconds since the start, of 32 bits in some messages, or of an epoch in others.
        time_us = getattr(message, "time_usec", 0)
        if by_recorder is None or not time_us:
            return by_recorder
        since_start = 1e-6 * time_us + self._shift
        since_start += round((by_recorder - since_start) / _WRAP) * _WRAP
        return since_start if abs(since_start - by_recorder) < _RESTART else by_recorder


def quaternion_xyzw(roll: float, pitch: float, yaw: float) -> Array:
    """Attitude (4,) of the hull, forward-port-up in a world with z up, from angles [rad] in NED."""
    in_ned = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    half_turn = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
    return (half_turn * in_ned * half_turn).as_quat()


def _pulses(message: Any, form: str) -> Array:
    return np.array([getattr(message, form.format(n), 0) for n in range(1, _CHANNELS + 1)])


def _att(to: Gathered, time: float, m: Any) -> None:
    angles = np.radians([m.Roll, m.Pitch, m.Yaw])
    to.add(ATTITUDE, time, quaternion_xyzw(*angles), "ATT [deg], NED")


def _imu(to: Gathered, time: float, m: Any) -> None:
    if getattr(m, "I", 0):  # a second unit
        return
    to.add(RATE, time, _TO_OURS * [m.GyrX, m.GyrY, m.GyrZ], "IMU [rad/s], FRD")
    to.add(FORCE, time, _TO_OURS * [m.AccX, m.AccY, m.AccZ], "IMU [m/s^2], FRD")


def _xkf1(to: Gathered, time: float, m: Any) -> None:
    if getattr(m, "C", 0):  # a second filter
        return
    if not to.has_position:
        to.leave_out(_NO_SOURCE)
        return

    source = "XKF1, NED: the autopilot's estimate"
    to.add(POSITION, time, _TO_OURS * [m.PN, m.PE, m.PD], f"{source} [m]")
    angles = np.radians([m.Roll, m.Pitch, m.Yaw])
    velocity = _TO_OURS * [m.VN, m.VE, m.VD]
    in_hull = Rotation.from_quat(quaternion_xyzw(*angles)).inv().apply(velocity)
    to.add(VELOCITY, time, in_hull, f"{source} [m/s], rotated to hull axes")


def _xkf4(to: Gathered, time: float, m: Any) -> None:
    del time
    if not getattr(m, "C", 0):
        to.has_position = _has_position(int(m.SS))


def _has_position(status: int) -> bool:
    """True if the autopilot's filter has a position, and not a constant one for lack of GPS and
    DVL.
    """
    return bool(status & _PLACED) and not status & _CONSTANT


def _ctun(to: Gathered, time: float, m: Any) -> None:
    to.add(DEPTH, time, np.array([-m.Alt]), "CTUN.Alt [m], up")


def _rcou(to: Gathered, time: float, m: Any) -> None:
    to.add(PULSES, time, _pulses(m, "C{}"), "RCOU [us]")


def _attitude(to: Gathered, time: float, m: Any) -> None:
    to.add(ATTITUDE, time, quaternion_xyzw(m.roll, m.pitch, m.yaw), "ATTITUDE [rad], NED")
    rates = _TO_OURS * [m.rollspeed, m.pitchspeed, m.yawspeed]
    to.add(RATE, time, rates, "ATTITUDE [rad/s], FRD")


def _raw_imu(to: Gathered, time: float, m: Any) -> None:
    if m.xacc or m.yacc or m.zacc:  # a unit that is not there sends zeros
        force = _TO_OURS * [m.xacc, m.yacc, m.zacc] * _MILLI * GRAVITY
        to.add(FORCE, time, force, f"{m.get_type()} [thousandths of g], FRD", rank=1)


def _local_position(to: Gathered, time: float, m: Any) -> None:
    if not to.has_position:
        to.leave_out(_NO_SOURCE)
        return
    source = "LOCAL_POSITION_NED: the autopilot's estimate"
    to.add(POSITION, time, _TO_OURS * [m.x, m.y, m.z], f"{source} [m]")


def _vfr_hud(to: Gathered, time: float, m: Any) -> None:
    to.add(DEPTH, time, np.array([-m.alt]), "VFR_HUD.alt [m], up")


def _servo(to: Gathered, time: float, m: Any) -> None:
    if not getattr(m, "port", 0):
        to.add(PULSES, time, _pulses(m, "servo{}_raw"), "SERVO_OUTPUT_RAW [us]")


_DATAFLASH: dict[str, Callable[[Gathered, float, Any], None]] = {
    "ATT": _att,
    "IMU": _imu,
    "XKF1": _xkf1,
    "XKF4": _xkf4,
    "CTUN": _ctun,
    "RCOU": _rcou,
}
_TELEMETRY: dict[str, Callable[[Gathered, float, Any], None]] = {
    "ATTITUDE": _attitude,
    "RAW_IMU": _raw_imu,
    "SCALED_IMU2": _raw_imu,
    "LOCAL_POSITION_NED": _local_position,
    "VFR_HUD": _vfr_hud,
    "SERVO_OUTPUT_RAW": _servo,
}
