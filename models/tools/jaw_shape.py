"""Shape and strength of a gripper's jaws, read from a compiled model of its vehicle."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from uuv.models.naming import has_gripper
from uuv.models.tools.gripper import FINGERS, MOTOR, PADS
from uuv.sim.interfaces.errors import ConfigurationError

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True, kw_only=True)
class JawShape:
    """Parallel jaws: both fingers are boxes on either side of the tool's axis, along its x."""

    opening: float  # [m] most between the pads
    thickness: float  # [m] of a finger, along x
    breadth: float  # [m] of a finger, along y
    finger: float  # [m] length of a finger, along the tool
    force: float  # [N] most of the motor on each finger
    friction: float  # coefficient of the pads
    damping: float  # [N s/m] of a finger: half of it times the opening's speed is the motor's force
    loss: float  # [N] of the motor's force on each finger, lost to friction

    @classmethod
    def of(cls, model: "mujoco.MjModel") -> Self:
        """The jaws in a model.

        Raises:
            ConfigurationError: it has none, or one of another make.
        """
        if not has_gripper(model) or not _has_pads(model):
            raise ConfigurationError(
                "vehicle.tool: the work needs driven jaws, such as gripper or small_gripper"
            )

        pad = model.geom(PADS[0])
        thick, broad, long = 2.0 * np.asarray(pad.size, dtype=np.float64)
        return cls(
            opening=float(sum(model.joint(name).range[1] for name in FINGERS)),
            thickness=float(thick),
            breadth=float(broad),
            finger=float(long),
            force=float(model.actuator(MOTOR).ctrlrange[1]),
            friction=float(pad.friction[0]),
            damping=float(np.mean([model.joint(name).damping[0] for name in FINGERS])),
            loss=float(np.mean([model.joint(name).frictionloss[0] for name in FINGERS])),
        )


def _has_pads(model: "mujoco.MjModel") -> bool:
    """Whether the fingers and pads are those that `uuv.models.tools.gripper` makes."""
    import mujoco

    parts = [(mujoco.mjtObj.mjOBJ_JOINT, name) for name in FINGERS]
    parts += [(mujoco.mjtObj.mjOBJ_GEOM, name) for name in PADS]
    return all(mujoco.mj_name2id(model, kind, name) >= 0 for kind, name in parts)
