"""Limits of the motion along a path, without the phases, which bring compiled kernels."""

from dataclasses import dataclass

from uuv.controllers.planning.promise import StopLimits
from uuv.controllers.planning.trajectories import BEND


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowLimits:
    """Motion along the path."""

    speed: float = 0.02  # [m/s] along the path
    ramp: float = 1.0  # [s] time from rest to that speed
    bend: float = BEND  # [m/s^2] largest acceleration across the path, by which bends are slower
    linger: float = 0.5  # [s] at its end
    paused_force: float = 0.5  # share of the set force during a pause
    pace_time: float = 0.5  # [s] for motion along the path to stop, and to resume
    stops: StopLimits | None = None  # of a pressed tool, for navigation; None: it does not stop
