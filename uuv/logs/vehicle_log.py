"""Content of a vehicle's log: streams of samples in SI units and this project's axes, and gaps.

World: z up, x to the north where the log knows it (of a ROS log: its own). Hull: forward, port, up.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from uuv.logs.ardusub_frames import FRAMES, NEUTRAL
from uuv.sim.interfaces.spatial import Array

ATTITUDE = "attitude"
RATE = "angular rate"
FORCE = "specific force"
POSITION = "position"
VELOCITY = "velocity over ground"
DEPTH = "depth"
PULSES = "servo pulses"
THRUSTS = "thrusts"
JOINTS = "joint angles"
LABELS = {  # of a stream's columns, and their unit
    ATTITUDE: (("qx", "qy", "qz", "qw"), ""),
    RATE: (("wx", "wy", "wz"), "rad/s"),
    FORCE: (("ax", "ay", "az"), "m/s^2"),
    POSITION: (("x", "y", "z"), "m"),
    VELOCITY: (("vx", "vy", "vz"), "m/s"),
    DEPTH: (("depth",), "m"),
}
UNITS = {PULSES: "us", THRUSTS: "N", JOINTS: "rad"}
_GAP = 5.0  # median steps without a sample are a gap
_STILL = 40.0  # [us] a pulse that differs by less from neutral hardly drives


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Samples of one quantity."""

    time: Array  # (N,) [s] rising
    values: Array  # (N, k) in `unit`
    labels: tuple[str, ...]
    unit: str
    source: str  # message or topic of the log, its unit and axes there

    @property
    def rate(self) -> float:
        """Sampling rate [Hz], by the median step; 0 for a single sample."""
        return 1.0 / float(np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0

    def from_time(self, start: float) -> "Stream":
        """The stream with times since `start` [s]."""
        return replace(self, time=self.time - start)

    @property
    def gaps(self) -> tuple[int, float]:
        """Number of gaps, and the longest [s]."""
        steps = np.diff(self.time)
        wide = steps[steps > _GAP * np.median(steps)] if len(steps) else steps
        return len(wide), float(wide.max()) if len(wide) else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleLog:
    """Usable content of one log."""

    name: str
    kind: str  # such as "ArduPilot dataflash"
    duration: float  # [s] from the first message to the last
    messages: int
    streams: Mapping[str, Stream]  # by ATTITUDE and so on
    frame: str = ""  # ArduSub's motor frame (`uuv.logs.ardusub_frames.FRAMES`); empty: not known
    directions: tuple[int, ...] = ()  # MOT_n_DIRECTION; empty: not known
    notes: tuple[str, ...] = field(default=())  # damage, and what was left out

    @property
    def driven(self) -> float | None:
        """Share of the samples in which a motor's pulse is off neutral; None without pulses."""
        pulses = self.streams.get(PULSES)
        if pulses is None:
            return None

        motors = pulses.values[:, : self.motors]
        on = (motors > 0.0) & (np.abs(motors - NEUTRAL) > _STILL)
        return float(on.any(axis=1).mean())

    @property
    def motors(self) -> int:
        """Number of outputs that drive motors, which come first; all if the frame is unknown."""
        return len(FRAMES[self.frame]) if self.frame else self.streams[PULSES].values.shape[1]

    def lacking(self) -> list[str]:
        """Missing data that an identification of the water needs or can use, in words."""
        have = self.streams
        lines = []

        if not {PULSES, THRUSTS} & set(have):
            lines.append("no servo outputs and no thrusts: the inputs are unknown")
        if ATTITUDE not in have:
            lines.append("no attitude")
        if not {RATE, FORCE, POSITION, VELOCITY} & set(have):
            lines.append("no motion: none of rates, specific force, position, velocity")
        if PULSES in have and not self.frame:
            lines.append("no motor frame: which output is which thruster is not known")
        if PULSES in have and self.frame and not self.directions:
            lines.append("no MOT_n_DIRECTION of each motor: whether a pulse drives ahead or astern")

        pulses = have.get(PULSES)
        if pulses is not None and 0.0 < pulses.rate < 8.0:
            lines.append(f"servo outputs at {pulses.rate:.1f} Hz: values in between are unknown")

        driven = self.driven
        if driven is not None and driven < 0.1:
            lines.append(f"hardly driven: a motor is off neutral in {driven:.1%} of the samples")
        return lines
