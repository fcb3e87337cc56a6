"""Drive of a gripper: its motor's force, from a set point of opening, speed and force.

The gripper has this drive in its own housing, as those of the field have: the vehicle sends set
points, and each holds until the next one. The drive is a speed loop around a bounded force, run at
each step of the plant,

    F = d v / 2 + friction + integral of d (v - speed) / (2 T),

with the speed v of the opening that the set point asks for, and the damping d of a finger. Jaws
that meet something stop; the integral then raises the force to its bound.
"""

import math
from dataclasses import dataclass, field
from typing import Self

import mujoco
import numpy as np

from uuv.models.naming import GRIPPER, has_gripper
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import JawSetpoint
from uuv.sim.interfaces.spatial import Array, finite_number
from uuv.sim.plant.onset import Onset

_NEAR = 0.1  # [s] in which the rest of the way is to be gone
_AT = 2e-4  # [m] from the opening that was asked for, within which the motor rests
_INTEGRAL = 0.15  # [s] time constant of the integral
# Memory: integral [N]; opening [m], force [N] and speed [m/s] of the last set point; 1 if there is
# one, else 0.
_SUM, _TARGET, _MOST, _FASTEST, _SET, _MEMORY = range(6)
_JAM = 5e4  # [N/m] stiffness of jaws that are stuck


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueJaws:
    """True state of a gripper as live views, each of one number, or empty without a gripper."""

    opening: Array  # (1,) [m] between the pads
    speed: Array  # (1,) [m/s] of the opening
    force: Array  # (1,) [N] of the motor on each finger, negative: it closes

    @classmethod
    def of(cls, data: mujoco.MjData, name: str = GRIPPER) -> Self:
        """The views of one simulation, of the gripper with that motor."""
        model = data.model
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        at = slice(motor, motor + 1) if has_gripper(model, name) else slice(0)
        return cls(
            opening=data.actuator_length[at],
            speed=data.actuator_velocity[at],
            force=data.actuator_force[at],
        )

    def row(self) -> Array:
        """Opening [m] and closing force [N] (2,), or (0,) without a gripper, for a recording."""
        return np.concatenate([self.opening, -self.force])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JawDrive:
    """Speed loop of one gripper on the arrays of its simulation."""

    data: mujoco.MjData
    jaws: TrueJaws
    motor: int  # actuator; -1: there is no gripper
    damping: float = 0.0  # [N s/m] of a finger
    friction: float = 0.0  # [N] of a finger
    force: float = 0.0  # [N] most of the motor
    widest: float = 0.0  # [m] largest opening
    timestep: float  # [s] step of the plant
    memory: Array  # (_MEMORY,)
    # Addresses of the fingers' travels and speeds in the state, and their shares in the opening.
    # Between two steps these are newer than the views of `jaws`.
    travels: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    speeds: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    shares: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(
        cls, model: mujoco.MjModel, data: mujoco.MjData, timestep: float, name: str = GRIPPER
    ) -> Self:
        """Drive of the gripper in a model, for a plant of `timestep` [s].

        Without a gripper whose motor has that name, a drive that refuses set points.
        """
        jaws = TrueJaws.of(data, name)
        memory = np.zeros(_MEMORY)
        if not has_gripper(model, name):
            return cls(data=data, jaws=jaws, motor=-1, timestep=timestep, memory=memory)

        # Fingers, which the tendon couples.
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        tendon = int(model.actuator_trnid[motor, 0])
        first = int(model.tendon_adr[tendon])
        joints = slice(first, first + int(model.tendon_num[tendon]))
        fingers = model.wrap_objid[joints]
        dof = model.jnt_dofadr[fingers]
        damping = np.asarray(model.dof_damping).reshape(model.nv, -1)[dof, 0]

        return cls(
            data=data,
            jaws=jaws,
            motor=motor,
            damping=float(damping.mean()),
            friction=float(np.asarray(model.dof_frictionloss)[dof].mean()),
            force=float(model.actuator_ctrlrange[motor, 1]),
            widest=float(model.jnt_range[fingers, 1].sum()),
            timestep=timestep,
            memory=memory,
            travels=np.array(model.jnt_qposadr[fingers]),
            speeds=np.array(dof),
            shares=np.array(model.wrap_prm[joints]),
        )

    def start(self) -> None:
        """Begin anew: without a set point, the motor without force."""
        self.memory[:] = 0.0
        if self.motor >= 0:
            self.data.ctrl[self.motor] = 0.0

    def follow(self, setpoint: JawSetpoint) -> None:
        """Take a set point, which holds until the next one.

        Raises:
            ConfigurationError: The vehicle has no gripper, or the set point is out of its range.
        """
        if self.motor < 0:
            raise ConfigurationError(
                "gripper: this vehicle has none; give it one, for instance vehicle.tool = gripper"
            )
        target = finite_number(setpoint.opening, "jaws: opening [m]", least=0.0, most=self.widest)
        most = finite_number(setpoint.force, "jaws: force [N]", least=0.0, most=self.force)
        fastest = finite_number(setpoint.speed, "jaws: speed [m/s]", above=0.0)

        self.memory[_TARGET:] = target, most, fastest, 1.0

    def act(self) -> None:
        """Set the motor's force for one step of the plant."""
        total, target, most, fastest, is_set = self.memory.tolist()
        if not is_set:
            return

        # Where the jaws are to be, the friction of the spindle holds them.
        way = target - float(self.shares @ self.data.qpos[self.travels])
        if abs(way) < _AT:
            self.data.ctrl[self.motor] = self.memory[_SUM] = 0.0
            return

        speed = min(max(way / _NEAR, -fastest), fastest)
        behind = 0.5 * self.damping * (speed - float(self.shares @ self.data.qvel[self.speeds]))
        rolling = 0.5 * self.damping * speed + float(np.copysign(self.friction, speed))

        # The integral stops at the bound.
        total += behind * self.timestep / _INTEGRAL
        total = min(max(total, -most - rolling), most - rolling)
        self.memory[_SUM] = total
        self.data.ctrl[self.motor] = min(max(rolling + total, -most), most)


class FaultyJaws:
    """Drive of a gripper with a fault: jaws that are stuck where they are, or without force."""

    def __init__(self, drive: JawDrive, onset: Onset, *, stuck: bool) -> None:
        """Wrap `drive`; `stuck`: the jaws keep their opening, else the motor gives no force."""
        self._drive = drive
        self._onset = onset
        self._stuck = stuck
        self._at = math.nan  # [m] opening at which the jaws are stuck
        self.motor = drive.motor
        self.start = drive.start
        self.follow = drive.follow

    def act(self) -> None:
        """Set the motor's force for one step, as the drive does or as the fault has it."""
        drive = self._drive
        drive.act()
        if not self._onset.active(float(drive.data.time)):
            self._at = math.nan
            return

        # A jam is a spring about the opening; the motor's bound is then that of the spindle.
        opening = float(drive.jaws.opening[0])
        if math.isnan(self._at):
            self._at = opening
        held = _JAM * (self._at - opening)
        most = drive.force
        drive.data.ctrl[drive.motor] = min(max(held, -most), most) if self._stuck else 0.0
