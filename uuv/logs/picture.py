"""Picture of a log over time: the vehicle's inputs, depth and attitude."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.logs.picture_file import save_figure
from uuv.logs.vehicle_log import ATTITUDE, DEPTH, PULSES, THRUSTS, VehicleLog
from uuv.sim.interfaces.extras import wanted

_SIZE = (9.0, 7.0)  # [inch]
_DOTS = 110  # per inch


def write_picture(file: Path, log: VehicleLog) -> None:
    """Write a PNG; a quantity that the log does not have is left out.

    Raises:
        MissingLibraryError: matplotlib is not installed.
    """
    with wanted():
        from matplotlib.figure import Figure

    shown = [
        (name, draw)
        for name, draw in (
            (PULSES, _pulses),
            (THRUSTS, _thrusts),
            (ATTITUDE, _attitude),
            (DEPTH, _depth),
        )
        if name in log.streams
    ]

    # One panel for each, one time axis.
    figure = Figure(figsize=_SIZE, layout="constrained")
    figure.suptitle(f"{log.name}, {log.kind}", fontsize=10)
    axes = figure.subplots(max(1, len(shown)), 1, sharex=True, squeeze=False)[:, 0]

    for axis, (name, draw) in zip(axes, shown, strict=False):
        draw(axis, log)
        axis.grid(alpha=0.3)
        axis.set_title(name, fontsize=9, loc="left")

    axes[-1].set_xlabel("time [s]")
    save_figure(figure, file, _DOTS)


def _pulses(axis: Any, log: VehicleLog) -> None:
    pulses = log.streams[PULSES]
    for motor in range(log.motors):
        axis.step(
            pulses.time, pulses.values[:, motor], where="post", lw=0.8, label=f"motor {motor + 1}"
        )

    axis.set_ylabel("pulse [us]")
    axis.legend(ncols=4, fontsize=7)


def _thrusts(axis: Any, log: VehicleLog) -> None:
    thrusts = log.streams[THRUSTS]
    for i, label in enumerate(thrusts.labels):
        axis.plot(thrusts.time, thrusts.values[:, i], lw=0.8, label=label)
    axis.set_ylabel("thrust [N]")
    axis.legend(ncols=4, fontsize=7)


def _attitude(axis: Any, log: VehicleLog) -> None:
    attitude = log.streams[ATTITUDE]

    # Unwrapped, so that a turn through north is no jump.
    angles = Rotation.from_quat(attitude.values).as_euler("ZYX", degrees=True)
    for i, label in enumerate(("yaw", "pitch", "roll")):
        unwrapped = np.degrees(np.unwrap(np.radians(angles[:, i])))
        axis.plot(attitude.time, unwrapped, lw=0.8, label=label)
    axis.set_ylabel("angle [deg]")
    axis.legend(ncols=3, fontsize=7)


def _depth(axis: Any, log: VehicleLog) -> None:
    depth = log.streams[DEPTH]
    axis.plot(depth.time, depth.values[:, 0], lw=0.8)
    axis.invert_yaxis()
    axis.set_ylabel("depth [m]")
