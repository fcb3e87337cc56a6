"""The truth as an estimate, as sensors and navigation without errors would give it to a
controller.
"""

from typing import Any

import numpy as np

from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, pose, readonly

SIGMA = readonly([1e-4] * 3)  # [m] stated standard deviation of an exact position


def true_estimate(truth: Any, tau: Array | None = None) -> StateEstimate:
    """Estimate that equals the truth, in arrays of its own.

    Args:
        truth: `uuv.sim.plant.truth.Truth`.
        tau: Torques (n,) [N m] at the gear outputs, which the truth does not contain; None: zeros.
    """
    R_BW = truth.R_WB.T

    return StateEstimate(
        # Pose and velocity.
        time=truth.time,
        X_WB=pose(truth.R_WB, truth.p_WB),
        v_WB_B=R_BW @ truth.v_WB_W,
        w_WB_B=truth.w_WB_B.copy(),
        a_WB_B=R_BW @ truth.acceleration[:3],
        q=truth.q.copy(),
        qd=truth.qd.copy(),
        tau=np.zeros(len(truth.q)) if tau is None else tau,
        # No errors and no faults.
        position_sigma=SIGMA,
        attitude_sigma=0.0,
        vision_age=0.0,
        dvl_age=0.0,
        imu_age=0.0,
        imu_jump_age=np.inf,
    )
