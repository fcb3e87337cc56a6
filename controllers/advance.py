"""The advance of a tool along its axis, let in by what is felt: a damping law, shared by holes and soil.

The wanted speed at no force, less as the force against the motion grows, none at the set force and back beyond it: what
stops the tool is pressed with the set force.
"""

import math

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import Command
from sim.interfaces.spatial import Array


def next_speed(
    speed: float, wanted: float, resisted: float, *, acceleration: float, yielding: float, period: float
) -> float:
    """Speed [m/s] one `period` [s] after `speed`, where `wanted` [m/s] is the speed at no force.

    `resisted` is the force against the motion as a share of that at which it stands still; beyond, the tool gives way,
    no faster than it came. It changes by at most `acceleration` [m/s^2], or `yielding` [m/s^2] where a force is felt.
    """
    wanted *= min(max(1.0 - resisted, -1.0), 1.0)
    most = (yielding if resisted > 0.0 else acceleration) * period
    return speed + min(max(wanted - speed, -most), most)


def felt_by_tool(last: Command | None, axis_W: Array) -> tuple[float, float]:
    """Force [N] felt against the advance along `axis_W` (3,), and across it.

    Raises ConfigurationError if the controller does not say what it feels.
    """
    if last is None or not math.isfinite(last.felt_normal) or "f_tip_W" not in last.believed:
        raise ConfigurationError(
            "the controller must say what it feels: Command.felt_normal [N] and believed['f_tip_W'] (3,) [N]"
        )
    f_tip_W = last.believed["f_tip_W"]
    return last.felt_normal, float(np.linalg.norm(f_tip_W - (f_tip_W @ axis_W) * axis_W))
