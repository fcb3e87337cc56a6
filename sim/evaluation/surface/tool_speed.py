"""Mean speed of the true tip along its path, at the times for which the set speed is commanded."""

from typing import TYPE_CHECKING

import numpy as np

from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.evaluation.surface_metrics import SpeedMetrics
from uuv.sim.interfaces.messages import WorkState

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

STANDSTILL = 1e-6  # [m/s] commanded speed below which the point counts as at rest
AT_SPEED = 0.9  # share of the set speed; slower motion is a ramp, a bend or a stop


def speed_figures(recording: "Recording", asked: float | None) -> SpeedMetrics:
    """Mean speed of the tip and the set speed, without ramps, slow bends and stops.

    Args:
        recording: The run.
        asked: [m/s] requested speed along the path, multiplied by `ToolPath.pace` if the surface
            allows a share of it only. None: the fastest commanded speed.

    Returns:
        The figures, without a mean if that speed was never commanded.
    """
    work = recording.within(WorkState.WORK)
    velocity = recording["v_command"].value[work]
    commanded = np.linalg.norm(velocity, axis=1)
    moving = commanded > STANDSTILL
    if not moving.any():
        return unmeasured(SpeedMetrics, set=asked)
    paces = [target.path.pace for target in recording.targets if target.path is not None]
    set_speed = float(commanded.max()) if asked is None else asked * (paces[-1] if paces else 1.0)

    # Displacement of the tip along the commanded motion, between neighbouring rows of one stretch.
    time = recording["p_pad"].time[work]
    tip = recording["p_pad"].value[work]
    tangent = velocity[1:] / np.maximum(commanded[1:], STANDSTILL)[:, None]
    way = np.sum(np.diff(tip, axis=0) * tangent, axis=1)
    intervals = np.diff(time)
    together = moving[1:] & moving[:-1] & (intervals < 1.5 * recording.timestep)

    fast = together & (commanded[1:] >= AT_SPEED * set_speed)
    travelled = float(commanded[1:][together] @ intervals[together])
    at_speed = float(commanded[1:][fast] @ intervals[fast])

    return SpeedMetrics(
        set=set_speed,
        mean=float(way[fast].sum() / intervals[fast].sum()) if fast.any() else None,
        share=at_speed / travelled if travelled > 0.0 else None,
    )
