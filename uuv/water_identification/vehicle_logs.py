"""Logs of autopilots and ROS recorders, converted to logs for the identification of
hydrodynamics.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from uuv.calib.water.logs import JOINT, THRUST, THRUSTER, WaterLog, log_of
from uuv.logs.ardusub_frames import MotorMap
from uuv.logs.readers import read_vehicle_log
from uuv.logs.vehicle_log import JOINTS, LABELS, PULSES, THRUSTS, Stream, VehicleLog
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array


def read_as_water_log(
    file: Path, vehicle: Vehicle, *, thrusters: Sequence[str], joints: Mapping[str, tuple]
) -> WaterLog:
    """Read a vehicle's log (`uuv.logs.readers`) for a vehicle model.

    Args:
        file: .BIN, .tlog, .mcap or a bag.
        vehicle: Model of the vehicle; servo outputs are assigned to its thrusters by their effect.
        thrusters: Names of its thrusters.
        joints: Ranges [rad] of its joints by name.

    Raises:
        ConfigurationError: The log cannot be read, or does not fit the vehicle.
        MissingLibraryError: The extra `bridge` is not installed.
    """
    log = read_vehicle_log(file)
    columns = water_columns(log, vehicle, joints)
    return log_of(f"log {log.name}", columns, thrusters=thrusters, joints=joints)


def water_columns(
    log: VehicleLog, vehicle: Vehicle, joints: Mapping[str, tuple]
) -> dict[str, Array]:
    """Columns (N,) for `uuv.calib.water.logs` by name, with a row for each time of any stream.

    Raises:
        ConfigurationError: The motor frame of the servo outputs does not fit the vehicle's
            thrusters, or the log has names that the vehicle does not have.
    """
    streams = dict(log.streams)
    pulses = streams.pop(PULSES, None)
    angles = streams.pop(JOINTS, None)
    thrusts = streams.pop(THRUSTS, None)

    named = [streams[quantity] for quantity in LABELS if quantity in streams]
    if pulses is not None and thrusts is None:
        named.append(_commands(log, pulses, vehicle))
    if thrusts is not None:
        named.append(_prefixed(thrusts, THRUST, vehicle.thruster_names))
    if angles is not None and joints:
        named.append(_prefixed(angles, JOINT, tuple(joints)))

    # A row for each time of any stream.
    time = np.unique(np.concatenate([stream.time for stream in named] or [np.zeros(0)]))
    columns = {"time": time}

    for stream in named:
        at = np.searchsorted(time, stream.time)
        for i, label in enumerate(stream.labels):
            columns[label] = np.full(len(time), np.nan)
            columns[label][at] = stream.values[:, i]
    return columns


def _commands(log: VehicleLog, pulses: Stream, vehicle: Vehicle) -> Stream:
    """Commands of the vehicle's thrusters from the servo outputs of a motor frame."""
    if not log.frame:
        raise ConfigurationError(
            f"log {log.name}: servo outputs need a known motor frame (FRAME_CONFIG), which assigns "
            "them to thrusters"
        )
    if not log.directions:
        raise ConfigurationError(
            f"log {log.name}: must contain MOT_n_DIRECTION of the motors, which decides whether a "
            "pulse drives ahead or astern"
        )
    motors = MotorMap.of(
        log.frame, vehicle.thruster_wrench, directions=log.directions, vehicle="the vehicle"
    )

    # Pulse by pulse; an output that is off commands zero.
    commands = np.array([motors.commands(row) for row in pulses.values])
    labels = tuple(f"{THRUSTER}{name}" for name in vehicle.thruster_names)
    return Stream(pulses.time, commands, labels, "", pulses.source)


def _prefixed(stream: Stream, prefix: str, names: Sequence[str]) -> Stream:
    """The columns of a stream that the vehicle has names for, with the names of a water log."""
    lacking = [name for name in names if name not in stream.labels]
    if lacking:
        raise ConfigurationError(
            f"{stream.source}: must have {lacking[0]!r}, it has {', '.join(stream.labels)}"
        )

    columns = np.column_stack([stream.values[:, stream.labels.index(name)] for name in names])
    labels = tuple(f"{prefix}{name}" for name in names)
    return Stream(stream.time, columns, labels, stream.unit, stream.source)
