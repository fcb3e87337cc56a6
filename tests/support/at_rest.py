"""A vehicle of six joints at rest, as it believes itself to be."""

from typing import Any

import numpy as np

from uuv.sim.interfaces.messages import StateEstimate


def at_rest(**changed: Any) -> StateEstimate:
    """Estimate at time 0, hull at the origin, all velocities and joint angles 0; any field may be
    changed.
    """
    still = {name: np.zeros(3) for name in ("v_WB_B", "w_WB_B", "a_WB_B")}
    joints = {name: np.zeros(6) for name in ("q", "qd", "tau")}
    return StateEstimate(**{"time": 0.0, "X_WB": np.eye(4), **still, **joints, **changed})
