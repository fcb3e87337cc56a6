"""A user's contact estimator as a kernel, which the tick of the drives calls by its address."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numba.np.numpy_support import carray

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.estimation.tip_force_estimator import ContactState, DriveState, TorqueSensors
from uuv.controllers.estimation.tip_force_kernels import feel_by_slot
from uuv.controllers.tuning import ArmTuning
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import FINE, Slot, slot_function
from uuv.sim.interfaces.messages import StateEstimate


class KernelContact(TorqueSensors):
    """Contact force from a plain function, which is compiled and replaces the least squares.

    Motion of arm and hull, tare and payload are those of `TorqueSensors`, and the force and
    friction of `TorqueSensors` are the initial values for the function.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        function: Callable[..., Any],
        *,
        numbers: int = 1,
        arm: ArmDynamics | None = None,
        tuning: ArmTuning | None = None,
        water_error: float = 0.0,
    ) -> None:
        """Compile the function.

        Args:
            model: believed model, compiled.
            function: function(memory, joints, torques, J_B, f_B, friction, dt). `joints` (3, n) are
                angles [rad], speeds and accelerations; `torques` (3, n) [N m] the measured ones,
                those of the motors, and the external ones minus their tare; `J_B` (3, n) [m] is the
                Jacobian of the tip, hull axes; dt is in s. The function writes the force of the
                world on the tip `f_B` (3,) [N], hull axes, and the dry friction of the gears
                `friction` (n,) [N m].
            numbers: length of the function's memory, which is zero at first.
            arm: believed dynamics of the arm; None: read from `model`.
            tuning: filters and noise.
            water_error: [-] share by which added masses and drags are wrong; used only if `arm` is
                None.

        Raises:
            ConfigurationError: numba cannot compile it, or `numbers` is below 1.
        """
        super().__init__(model, arm=arm, tuning=tuning, water_error=water_error)
        if numbers < 1:
            name = "numbers of the contact estimator"
            raise ConfigurationError(f"{name}: must be at least 1, got {numbers}")

        self._numbers = numbers
        name = getattr(function, "__name__", repr(function))

        of_pointers = _of_pointers(kernel(function), numbers, self._arm.n, self.timing.period)
        self._compiled = slot_function(of_pointers, f"contact estimator {name}")

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, a memory of zeros."""
        state = super().init(estimate)
        state.memory = np.zeros(self._numbers)
        return state

    def slot(self, state: ContactState) -> Slot:
        """The compiled function, on the memory of `state`."""
        return Slot(self._compiled.address, state.memory, np.zeros(10 * self._arm.n + 3))

    def sense(self, state: ContactState, estimate: StateEstimate, drives: DriveState) -> None:
        """Force, friction and motion of one sample, without tare and payload.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            drives: last commands of the drives.
        """
        super().sense(state, estimate, drives)
        seen = estimate.X_WB, estimate.q, estimate.qd, estimate.tau
        feel_by_slot(self.slot(state), seen, drives.tau, state.record)


def _of_pointers(function: Any, size: int, n: int, dt: float) -> Callable[[Any, Any], int]:
    """Function of a slot, whose values are those of `feel_by_slot`."""

    def of_pointers(memory: Any, values: Any) -> int:
        packed = carray(values, 10 * n + 3)
        joints = packed[: 3 * n].reshape(3, n)
        torques = packed[3 * n : 6 * n].reshape(3, n)
        J_B = packed[6 * n : 9 * n].reshape(3, n)

        # Outputs of the function.
        f_B = packed[9 * n : 9 * n + 3]
        friction = packed[9 * n + 3 :]
        function(carray(memory, size), joints, torques, J_B, f_B, friction, dt)
        return FINE

    return of_pointers
