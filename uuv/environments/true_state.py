"""The true state as an estimate: what controllers inside an environment are given, in place of navigation."""

from typing import Any

import numpy as np

from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, pose, readonly
from uuv.sim.plant.plant import Truth
from uuv.sim.sensors.proprioception import JointTorqueSensors

_EXACT = JointTorqueSensors(noise=0.0, bias=0.0)
_SIGMA = readonly([1e-4] * 3)  # [m] stated of a position that is exact


class TrueState:
    """Makes estimates of the truth; torques are those at the gear outputs, free of noise."""

    def __init__(self) -> None:
        self._torques: Any = _EXACT.init(np.random.default_rng(0))

    def estimate(self, truth: Truth) -> StateEstimate:
        """Estimate that equals the truth."""
        self._torques, measured = _EXACT.step(self._torques, truth)
        R_BW = truth.R_WB.T
        X_WB = np.eye(4)
        X_WB[:3, :3], X_WB[:3, 3] = truth.R_WB, truth.p_WB
        return StateEstimate(
            time=truth.time,
            X_WB=X_WB,
            v_WB_B=R_BW @ truth.v_WB_W,
            w_WB_B=truth.w_WB_B.copy(),
            a_WB_B=R_BW @ truth.acceleration[:3],
            q=truth.q.copy(),
            qd=truth.qd.copy(),
            tau=measured.tau,
            position_sigma=_SIGMA,
            attitude_sigma=0.0,
            vision_age=0.0,
            dvl_age=0.0,
            imu_age=0.0,
            imu_jump_age=np.inf,
        )


def tool_pose(truth: Truth) -> Array:
    """Pose X_WG (4, 4) of the tool's tip."""
    return pose(truth.R_WG, truth.p_WG)
