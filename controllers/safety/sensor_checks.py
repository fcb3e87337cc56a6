"""Faults of sensors that navigation detects from two measurements that must agree.

Each row of `SENSOR_CHECKS` is one check. Navigation has every sample, so it computes the statistic,
applies the limit, and continues without the sensor. The estimate contains the error of the sensor,
which is converted to a fault here. A new check is a field of the estimate and a row. The tick of
the safety wrapper reads the entries of the rows, and requests the faults if an entry differs from
its value without a fault.

| sensor | field | statistic | limit |
|---|---|---|---|
| gyro | rate, against the attitude's change | cumulative sum of the innovation | `rate_check` |
| attitude reference | the same, where it alone changed at the onset | the same | the same |
| accelerometer | velocity, against the Doppler log | mean innovation | `fixes` |

The limits are in `uuv.perception.navigation`, in the modules of these names.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.messages import Fault, FaultKind, StateEstimate
from uuv.sim.interfaces.records import EstimateRecord
from uuv.sim.interfaces.spatial import Array

_AXES = "xyz"


class SensorFinding(NamedTuple):
    """A sensor that was found to be faulty."""

    part: str
    axis: int  # index of the sensor; -1 for the whole sensor
    time: float  # [s] time of the detection
    figures: str


@dataclass(frozen=True, slots=True)
class SensorCheck:
    """One row: the kind of fault, and a function that reads it from the estimate."""

    kind: FaultKind
    found: Callable[[StateEstimate], Iterator[SensorFinding]]
    entries: Callable[[EstimateRecord], Array]  # (k,) entries of the record in which it appears
    quiet: float = 0.0  # value of all of them while the sensor is healthy


def sensor_faults(estimate: StateEstimate) -> Iterator[Fault]:
    """All faults that `estimate` contains, computed anew at each call."""
    for check in SENSOR_CHECKS:
        for part, axis, time, figures in check.found(estimate):
            yield Fault(kind=check.kind, part=part, index=axis, time=time, figures=figures)


def _gyro(estimate: StateEstimate) -> Iterator[SensorFinding]:
    """Axes of the gyro that disagree with the change of the attitude."""
    for i, off in enumerate(estimate.gyro_off_B.tolist()):
        if off:
            either = ", unless the attitude drifts" if estimate.attitude_off_B[i] else ""
            said = f"{math.degrees(off):+.2f} deg/s from the rate of the attitude{either}"
            yield SensorFinding(_AXES[i], i, estimate.time, said)


def _attitude(estimate: StateEstimate) -> Iterator[SensorFinding]:
    """An attitude that disagrees with the integral of the rates."""
    off = estimate.attitude_off_B.tolist()

    if any(map(math.isnan, off)):
        yield SensorFinding("", -1, estimate.time, "no rotation")
        return
    axes = [i for i in range(3) if off[i]]
    if axes:
        turned = ", ".join(f"{math.degrees(off[i]):+.2f} deg about {_AXES[i]}" for i in axes)
        either = ", unless the gyro does" if estimate.gyro_off_B[axes].any() else ""
        yield SensorFinding(
            "", -1, estimate.time, f"leaves the integral of the rate by {turned}{either}"
        )


def _accelerometer(estimate: StateEstimate) -> Iterator[SensorFinding]:
    """A jump of the accelerometer's bias."""
    if math.isfinite(estimate.imu_jump_age):
        time = estimate.time - estimate.imu_jump_age
        yield SensorFinding(
            "accelerometer", -1, time, "the bias of the accelerometer jumped and is estimated again"
        )


SENSOR_CHECKS = (
    SensorCheck(FaultKind.IMU, _accelerometer, lambda record: record.ages[3:4], quiet=math.inf),
    SensorCheck(FaultKind.GYRO, _gyro, lambda record: record.gyro_off_B),
    SensorCheck(FaultKind.ATTITUDE, _attitude, lambda record: record.attitude_off_B),
)


def checked_entries(record: EstimateRecord) -> tuple[tuple[Array, ...], Array]:
    """Entries of all checks, and the quiet value (number of checks,) of each.

    Args:
        record: record of the estimate; the result contains the record's own arrays.
    """
    entries = tuple(check.entries(record) for check in SENSOR_CHECKS)

    return entries, np.array([check.quiet for check in SENSOR_CHECKS])
