"""Survey of the site: a sensor that reports the object's pose, which is known beforehand, on
request.
"""

from typing import Any

import mujoco
import numpy as np

from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import SurveyedPose
from uuv.sim.interfaces.spatial import pose, readonly, rotation_from_quat_wxyz
from uuv.sim.plant.truth import Truth


class Survey:
    """Sensor that reports the object's exact pose in W; for control work without perception."""

    period = 0.0  # [s] on request
    delay = 0.0  # [s]

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take the compiled world `model`.

        Raises:
            ConfigurationError: There is no object in it.
        """
        self._body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, TARGET_BODY)
        if self._body < 0:
            raise ConfigurationError(f"survey: the world has no body {TARGET_BODY!r}")

    def init(self, rng: np.random.Generator) -> None:
        """A survey has no state."""

    def step(self, state: Any, truth: Truth) -> tuple[None, SurveyedPose]:
        """Pose of the object now."""
        R_WT = rotation_from_quat_wxyz(truth.xquat[self._body])
        return None, SurveyedPose(
            time=truth.time, X_WT=readonly(pose(R_WT, truth.xpos[self._body]))
        )
