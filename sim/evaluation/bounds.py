"""Bounds that the figures of an accepted run keep."""

from dataclasses import dataclass

import numpy as np

DAMAGE = 1.5  # multiple of the largest set force beyond which contact counts as damage
TAP_ERROR = 0.2  # largest error of a tap, as a share of the set force


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Acceptance bounds of a run."""

    force_error_rms: float = 3.0  # [N]
    force_error_max: float = 9.0  # [N]
    lost: float = 0.0  # [s]
    path_deviation: float = 0.003  # [m]; infinite: there is no path
    speed_error: float = 0.1  # of the set speed
    off_speed: float = 2.0 / 3.0  # share of the path below that speed, in ramps, bends and stops
    position_error: float = 0.005  # [m] of the identification
    position_error_share: float = 0.005  # of the range
    tilt: float = float(np.radians(3.0))  # [rad] of the tool; infinite: it is not judged
    heel: float = float(np.radians(3.0))  # [rad] about the tool axis; infinite: it is not judged
    # [m] of work without contact: sum of the bounds of identification and path
    gap_error: float = 0.008
