"""True angle of a valve's handle, and the moment of the tool on it."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from uuv.models.naming import GRIPPER, HANDLE
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.jaw_drive import TrueJaws
from uuv.sim.plant.true_receptacles import TrueReceptacles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueHandle:
    """True state of a handle as live views, each of one number, or empty without a handle.

    The moment is that of all contacts, less that which accelerates the handle. MuJoCo's sensor of
    torque leaves out what friction, damping and stops of the hinge itself bear.
    """

    angle: Array  # (1,) [rad] from the start
    speed: Array  # (1,) [rad/s]
    borne: Array  # (1,) [N m] of the hinge on the handle about its axis, which opposes the tool

    @classmethod
    def of(cls, data: mujoco.MjData, name: str = HANDLE) -> Self:
        """The views of one simulation, of the hinge and its sensor with that name."""
        model = data.model
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint < 0:
            nothing = np.zeros(0)
            return cls(angle=nothing, speed=nothing, borne=nothing)

        at = int(model.jnt_qposadr[joint])
        dof = int(model.jnt_dofadr[joint])
        sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
        about_z = int(model.sensor_adr[sensor]) + 2
        return cls(
            angle=data.qpos[at : at + 1],
            speed=data.qvel[dof : dof + 1],
            borne=data.sensordata[about_z : about_z + 1],
        )

    @property
    def moment(self) -> Array:
        """Moment (1,) [N m] of the tool about the hinge's axis, or (0,)."""
        return -self.borne

    def row(self) -> Array:
        """Angle [rad] and moment [N m] (2,), or (0,) without a handle, for a recording."""
        return np.concatenate([self.angle, self.moment])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mechanisms:
    """What moves beside hull and arm."""

    jaws: TrueJaws  # of a gripper
    handle: TrueHandle  # of a valve
    receptacles: TrueReceptacles  # of a panel

    @classmethod
    def of(cls, data: mujoco.MjData, gripper: str = GRIPPER) -> Self:
        """The views of one simulation, of the gripper with that motor."""
        return cls(
            jaws=TrueJaws.of(data, gripper),
            handle=TrueHandle.of(data),
            receptacles=TrueReceptacles.of(data),
        )
