"""The true state as an estimate: what controllers inside an environment are given, in place of navigation."""

from typing import Any

import numpy as np

from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.loop.true_estimate import true_estimate
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.proprioception import JointTorqueSensors

_EXACT = JointTorqueSensors(noise=0.0, bias=0.0)


class TrueState:
    """Makes estimates of the truth; torques are those at the gear outputs, free of noise."""

    def __init__(self) -> None:
        self._torques: Any = _EXACT.init(np.random.default_rng(0))

    def estimate(self, truth: Truth) -> StateEstimate:
        """Estimate that equals the truth."""
        self._torques, measured = _EXACT.step(self._torques, truth)
        return true_estimate(truth, measured.tau)


def tool_pose(truth: Truth) -> Array:
    """Pose X_WG (4, 4) of the tool's tip."""
    return pose(truth.R_WG, truth.p_WG)
