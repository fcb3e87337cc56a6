"""Plant in which an object of the scene has a prescribed motion: a single push, or an
oscillation.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    exp_so3,
    finite_number,
    log_so3,
    quat_wxyz_from_rotation,
    rotation_from_quat_wxyz,
)
from uuv.sim.plant.compiled_step import PlantRecord
from uuv.sim.plant.onset import Onset
from uuv.sim.plant.plant import NO_HOOKS, Plant, PlantHooks
from uuv.sim.plant.truth import Truth

# Displacement (3,) [m] and rotation vector (3,) [rad] in W as a function of time [s].
Motion = Callable[[float], tuple[Array, Array]]


def push(onset: Onset, by: ArrayLike, turn: ArrayLike, ramp: float) -> Motion:
    """Motion that begins at `onset`, and ends after `ramp` [s].

    Args:
        onset: Time at which the motion begins.
        by: (3,) [m] displacement in W.
        turn: (3,) [rad] rotation vector in W, about the body's origin.
        ramp: [s] Duration of the smooth motion.

    Raises:
        ConfigurationError: A number is not finite or out of range.
    """
    p, phi = checked(by, (3,), "push by [m]"), checked(turn, (3,), "push turn [rad]")
    finite_number(ramp, "push: ramp [s]", above=0.0)

    def motion(time: float) -> tuple[Array, Array]:
        x = min(max(onset.elapsed(time) / ramp, 0.0), 1.0)
        share = x * x * (3.0 - 2.0 * x)
        return share * p, share * phi

    return motion


def swing(amplitude: ArrayLike, frequency: float) -> Motion:
    """Oscillation along a line, which starts at its centre at time 0.

    Args:
        amplitude: (3,) [m] in W.
        frequency: [Hz] of the oscillation.

    Raises:
        ConfigurationError: A number is not finite or out of range.
    """
    a = checked(amplitude, (3,), "swing: amplitude [m]")
    omega = 2.0 * np.pi * finite_number(frequency, "swing: frequency [Hz]", above=0.0)

    def motion(time: float) -> tuple[Array, Array]:
        return np.sin(omega * time) * a, np.zeros(3)

    return motion


class MovedObjectPlant:
    """Plant (`uuv.sim.loop.rollout.SteppedPlant`) in which a free body has a prescribed motion.

    Position and velocity of its joint are set before every step of the loop, so that contact and
    friction depend on the velocity of the surface.
    """

    def __init__(self, plant: Any, body: str, motion: Motion) -> None:
        """Wrap `plant`, a `Plant` or a wrapper of one.

        Args:
            plant: The plant.
            body: Name of a body of its model with a free joint.
            motion: Prescribed motion of the body.

        Raises:
            ConfigurationError: There is no such body.
        """
        sound = plant
        while not isinstance(sound, Plant):
            sound = sound.plant
        self.plant = plant
        self._sound = sound
        self.timestep = plant.timestep

        model = sound.model
        number = mujoco.mj_name2id(sound.model, mujoco.mjtObj.mjOBJ_BODY, body)
        joint = int(model.body_jntadr[number]) if number >= 0 else -1
        if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
            raise ConfigurationError(
                f"moved object: the scene has no body {body!r} on a free joint"
            )

        self._qpos = int(model.jnt_qposadr[joint])
        self._dof = int(model.jnt_dofadr[joint])
        self._motion = motion
        self._p = np.array(model.body_pos[number])
        self._R = rotation_from_quat_wxyz(model.body_quat[number])

    def observe(self) -> Truth:
        """Same as `Plant.observe`, with the body at its pose at this time."""
        self._place()
        return self.plant.observe()

    def spans(self) -> str:
        """Same as `Plant.spans`."""
        return self.plant.spans()

    def record(self, hooks: PlantHooks = NO_HOOKS) -> PlantRecord:
        """Same as `Plant.record`, with the motion."""
        return self.plant.record(replace(hooks, placed=(*hooks.placed, self._place)))

    def step(self, command: Command) -> None:
        """Same as `Plant.step`."""
        self.plant.step(command)

    def _place(self) -> None:
        """Write pose and velocity of the body at this time."""
        data = self._sound.data
        dt = self.timestep
        (p, phi), (p_next, phi_next) = (
            self._motion(t) for t in (float(data.time), float(data.time) + dt)
        )

        R = exp_so3(phi) @ self._R
        R_next = exp_so3(phi_next) @ self._R

        data.qpos[self._qpos : self._qpos + 3] = self._p + p
        data.qpos[self._qpos + 3 : self._qpos + 7] = quat_wxyz_from_rotation(R)
        data.qvel[self._dof : self._dof + 3] = (p_next - p) / dt
        data.qvel[self._dof + 3 : self._dof + 6] = log_so3(R.T @ R_next) / dt
