"""The true state as an estimate: what controllers inside an environment are given, in place of navigation."""

from typing import Any

import numpy as np

from sim.interfaces.messages import StateEstimate
from sim.interfaces.spatial import Array, pose
from sim.plant.plant import Truth
from sim.sensors.proprioception import JointTorqueSensors

_EXACT = JointTorqueSensors(noise=0.0, bias=0.0)
_SIGMA = 1e-4  # [m] stated of a position that is exact


class TrueState:
    """Makes estimates of the truth; torques are those at the gear outputs, free of noise."""

    def __init__(self) -> None:
        self._torques: Any = _EXACT.init(np.random.default_rng(0))

    def estimate(self, truth: Truth) -> StateEstimate:
        """Estimate that equals the truth."""
        self._torques, measured = _EXACT.step(self._torques, truth)
        R_BW = truth.R_WB.T
        return StateEstimate(
            time=truth.time,
            X_WB=pose(truth.R_WB, truth.p_WB),
            v_WB_B=R_BW @ truth.v_WB_W,
            w_WB_B=truth.w_WB_B.copy(),
            a_WB_B=R_BW @ truth.acceleration[:3],
            q=truth.q.copy(),
            qd=truth.qd.copy(),
            tau=measured.tau,
            position_sigma=np.full(3, _SIGMA),
            attitude_sigma=0.0,
            vision_age=0.0,
            dvl_age=0.0,
            imu_age=0.0,
            imu_jump_age=np.inf,
        )


def tool_pose(truth: Truth) -> Array:
    """Pose X_WG (4, 4) of the tool's tip."""
    return pose(truth.R_WG, truth.p_WG)
