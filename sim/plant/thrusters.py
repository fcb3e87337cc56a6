"""Thrusters of one plant, compiled: writes commands to MuJoCo's controls, reads speeds and
thrusts.
"""

from typing import NamedTuple, Self

import mujoco
import numpy as np

from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import ACTIVATIONS, SPEED, curves
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

# share of full thrust that counts as saturated, since thrust allocation stops slightly below 1
SATURATED = 0.979
_CURVED = 0.9  # command above which a thrust may be saturated


class Drive(NamedTuple):
    """Thrusters of one plant. MuJoCo's arrays are views; the kernels write the others."""

    curves: Array  # (m, ...) static curves
    commanded: Array  # (m,) commands of the step, input
    ctrl: Array  # (nu,) MuJoCo's controls
    act: Array  # (na,) MuJoCo's activations
    force: Array  # (nu,) [N] MuJoCo's actuator forces
    actuators: np.ndarray  # (m,) indices into `ctrl` and `force`
    activations: np.ndarray  # (m,) index of the first activation of each thruster
    speed: Array  # (m,) normalised propeller speed
    thrust: Array  # (m,) [N] in the last physics step
    saturated: np.ndarray  # (1,) bool: a command was at its limit

    @classmethod
    def of(
        cls, model: mujoco.MjModel, data: mujoco.MjData, thrusters: tuple[np.ndarray, Array]
    ) -> Self:
        """Record of thrusters at rest, which are given as rows from
        `uuv.models.water.thrusters.read`.
        """
        actuators, table = thrusters
        m = len(actuators)
        return cls(
            curves=curves(table),
            commanded=np.zeros(m),
            ctrl=data.ctrl,
            act=data.act,
            force=data.actuator_force,
            actuators=actuators,
            activations=np.asarray(model.actuator_actadr)[actuators].astype(np.int64),
            speed=np.zeros(m),
            thrust=np.zeros(m),
            saturated=np.zeros(1, dtype=np.bool_),
        )

    def stop(self) -> None:
        """Stop all propellers."""
        for k in range(ACTIVATIONS):
            self.act[self.activations + k] = 0.0
        self.speed[:] = self.thrust[:] = 0.0
        self.saturated[0] = False


@kernel
def command_thrusters(drive):
    """Set the controls of the thrusters of a `Drive`, or of its fields as a tuple, to the commands.

    Returns:
        True if a command was at its limit.
    """
    curve, commanded, ctrl, _, _, actuators, _, _, _, saturated = drive
    saturated[0] = False

    for i in range(actuators.shape[0]):
        command = min(max(commanded[i], -1.0), 1.0)
        ctrl[actuators[i]] = command

        # The thrust decides about saturation, not the command.
        if abs(command) > _CURVED:
            end = 1.0 if command > 0.0 else -1.0
            saturated[0] |= thrust_at(curve[i], command) / thrust_at(curve[i], end) >= SATURATED

    return saturated[0]


@kernel
def read_thrusters(drive):
    """Read speeds and thrusts of a `Drive`, or of its fields as a tuple, after a step."""
    _, _, _, act, force, actuators, activations, speed, thrust, _ = drive

    for i in range(actuators.shape[0]):
        speed[i] = act[activations[i] + SPEED]
        thrust[i] = force[actuators[i]]
