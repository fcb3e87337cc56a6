"""A real vehicle's log compared with a simulation that is driven by its pulses or thrusts.

The simulation begins anew in each window, at the state that was measured there, so that its errors
do not add up over the whole log.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import mujoco
import numpy as np
from matplotlib.figure import Figure

from uuv.calib.water.logs import ATTITUDE, CHANNELS, DEPTH, POSITION, RATE, UNITS, VELOCITY
from uuv.logs.picture_file import save_figure
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.water_identification.log_residuals import LogReplay
from uuv.water_identification.options import log_at
from uuv.water_identification.replayed_parts import ranges_of
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

WINDOW = 10.0  # [s]
_COMPARED = (ATTITUDE, DEPTH, VELOCITY, RATE, POSITION)
_ANGLES = ("roll", "pitch", "yaw")
_SIZE = (9.0, 2.1)  # [inch] of a panel
_DOTS = 110  # per inch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SideBySide:
    """One quantity of a log, measured and simulated."""

    name: str
    unit: str
    time: Array  # (k,) [s]
    measured: Array  # (k,)
    simulated: Array  # (k,)
    window: np.ndarray  # (k,) of each sample

    @property
    def rms(self) -> float:
        """RMS of the difference, in `unit`."""
        return float(np.sqrt(np.mean((self.simulated - self.measured) ** 2)))

    @property
    def largest(self) -> float:
        """Largest difference, in `unit`."""
        return float(np.abs(self.simulated - self.measured).max())

    @property
    def motion(self) -> float:
        """Standard deviation of the measured values about their mean in each window, in `unit`."""
        means = np.bincount(self.window, self.measured) / np.maximum(np.bincount(self.window), 1)
        return float(np.sqrt(np.mean((self.measured - means[self.window]) ** 2)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogBeside:
    """A log compared with its simulation."""

    name: str
    windows: int
    diverged: int  # windows whose simulation ran away; they are left out
    quantities: tuple[SideBySide, ...]

    @classmethod
    def of(cls, file: Path, spec: mujoco.MjSpec, window: float = WINDOW) -> Self:
        """Simulate a log.

        Args:
            file: Of an autopilot or a ROS recorder, or a log of the identification of water.
            spec: The vehicle.
            window: [s] after which the simulation begins anew.

        Raises:
            ConfigurationError: The log cannot be read or does not fit the vehicle, has nothing to
                compare, or its simulation runs away in all windows.
            MissingLibraryError: The extra `bridge` is not installed.
        """
        replay = ReplayVehicle(spec)
        log = log_at(file, replay.vehicle, replay.names, ranges_of(replay.vehicle))

        # With the vehicle's own water, in still water.
        cut = LogReplay(replay, log, FitSettings(window=window))
        values = {parameter.name: parameter.nominal for parameter in replay.water.parameters}
        rows = replay.run(values, cut.script, cut.starts, np.zeros((cut.script.rows, 3)))

        # Windows whose simulation diverges are not compared; their rows are held at the start.
        parts = np.split(rows, cut.script.first[1:])
        stayed = np.array([bool(np.isfinite(part).all()) for part in parts])
        for wild in np.flatnonzero(~stayed).tolist():
            parts[wild][:] = cut.starts[wild]  # a view of the rows

        diverged = int((~stayed).sum())
        if not stayed.any():
            raise ConfigurationError(
                f"{log.name}: the simulation runs away in all {diverged} windows; the thrusts or "
                "the vehicle's water are wrong, or the windows are too long"
            )
        compared = tuple(_compared(cut, rows, values, stayed))
        if not compared:
            channels = ", ".join(" ".join(CHANNELS[kind]) for kind in _COMPARED)
            raise ConfigurationError(f"{log.name}: must have one of {channels} to compare with")
        return cls(name=log.name, windows=len(cut.windows), diverged=diverged, quantities=compared)

    def write_picture(self, file: Path) -> None:
        """Write a PNG: a panel for each quantity, measured and simulated."""
        count = len(self.quantities)
        figure = Figure(figsize=(_SIZE[0], _SIZE[1] * count), layout="constrained")
        figure.suptitle(f"{self.name}: measured, and simulated anew in each window", fontsize=10)
        axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]

        for axis, quantity in zip(axes, self.quantities, strict=True):
            axis.plot(quantity.time, quantity.measured, ".", ms=2, color="0.5", label="measured")
            # A line is not drawn from one window to the next.
            breaks = np.flatnonzero(np.diff(quantity.window, prepend=quantity.window[:1]))
            axis.plot(
                np.insert(quantity.time, breaks, np.nan),
                np.insert(quantity.simulated, breaks, np.nan),
                lw=1.0,
                color="tab:orange",
                label="simulated",
            )
            axis.set_ylabel(f"{quantity.name} [{quantity.unit}]", fontsize=8)
            axis.grid(alpha=0.3)

        axes[0].legend(fontsize=7, ncols=2)
        axes[-1].set_xlabel("time [s]")
        save_figure(figure, file, _DOTS)


def _compared(
    cut: LogReplay, rows: Array, values: dict[str, float], stayed: np.ndarray
) -> Iterator[SideBySide]:
    """Comparison of attitude, depth, velocity and other quantities, axis by axis, in the windows
    (W,) that `stayed` marks.
    """
    for kind in _COMPARED:
        if kind not in cut.kinds:
            continue
        time, measured, simulated, window = cut.replayed(rows, kind, values)
        scale = float(np.degrees(1.0)) if kind == ATTITUDE else 1.0
        labels = _ANGLES if kind == ATTITUDE else CHANNELS[kind]

        kept = stayed[window]
        for i, label in enumerate(labels):
            yield SideBySide(
                name=label,
                unit=UNITS.get(kind, "deg"),
                time=time[kept],
                measured=scale * measured[kept, i],
                simulated=scale * simulated[kept, i],
                window=window[kept],
            )
