"""A user's force law as a kernel, which the tick of the drives calls by its address."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.np.numpy_support import carray

from uuv.controllers.arm.position_force import (
    ANSWER,
    ASKED,
    CLOSED,
    INWARDS,
    LASTING,
    LOOP,
    MEASURED,
    NUMBERS,
    SET_FORCE,
    SOFT,
    VALUES,
    ForceDisplacement,
    ForceDisplacementState,
    K,
    let_go,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import FINE, Slot, call, slot_function


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelForceLaw(ForceDisplacement):
    """Force law from a plain function, which is compiled, so that the tick calls it without Python.

    Its displacement is limited by `speed` and `limit` and released like that of
    `ForceDisplacement`; the other gains are not used.
    """

    # law(memory, set_force, felt, servo_compliance, dt), see `step`: returns the displacement [m]
    law: Callable[..., float]
    numbers: int = 1  # length of the memory, which is set to zero whenever the loop closes
    # kept here so that the code stays alive: `slot` calls it
    _compiled: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Compile the law.

        Raises:
            ConfigurationError: numba cannot compile it, or `numbers` is below 1.
        """
        super(KernelForceLaw, self).__post_init__()
        if self.numbers < 1:
            raise ConfigurationError(
                f"numbers of the force law: must be at least 1, got {self.numbers}"
            )

        name = getattr(self.law, "__name__", repr(self.law))
        limited = _of_pointers(kernel(self.law), self.numbers, self.speed, self.limit)
        compiled = slot_function(limited, f"force law {name}")
        object.__setattr__(self, "_compiled", compiled)

    def init(self) -> ForceDisplacementState:
        """Initial state: no displacement, and the memory after the usual numbers."""
        usual = ForceDisplacementState().numbers
        return ForceDisplacementState(np.concatenate([usual, np.zeros(self.numbers)]))

    def slot(self, state: ForceDisplacementState) -> Slot:
        """The compiled law, on the numbers of `state`."""
        return Slot(self._compiled.address, state.numbers, np.zeros(VALUES))

    def step(
        self,
        state: ForceDisplacementState,
        set_force: float,
        felt: float,
        servo_compliance: float,
        dt: float,
    ) -> float:
        """Displacement k from the law.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            set_force: [N] normal force to press with.
            felt: [N] measured normal force.
            servo_compliance: [m/N] of the arm's servo along the tool axis.
            dt: [s] since the last step.

        Returns:
            The displacement k [m] along the tool axis, positive into the surface.
        """
        slot = self.slot(state)
        slot.values[:ANSWER] = set_force, felt, servo_compliance, dt, CLOSED
        call(slot)
        return float(slot.values[ANSWER])


def _of_pointers(law: Any, size: int, speed: float, limit: float) -> Callable[[Any, Any], int]:
    """Function of a slot: the law, its limits, and its release."""

    def limited(memory: Any, values: Any) -> int:
        numbers = carray(memory, NUMBERS + size)
        packed = carray(values, VALUES)
        most = speed * packed[LASTING]
        if packed[LOOP] != CLOSED:
            packed[ANSWER] = let_go(numbers, most, packed[LOOP] == INWARDS)
            return FINE

        # The law, with a memory of zeros whenever the loop closes.
        law_memory = numbers[NUMBERS:]
        if np.isnan(numbers[SET_FORCE]):
            law_memory[:] = 0.0
        numbers[SET_FORCE] = packed[ASKED]
        k = law(law_memory, packed[ASKED], packed[MEASURED], packed[SOFT], packed[LASTING])

        # Its limits.
        k = min(max(k, numbers[K] - most), numbers[K] + most)
        packed[ANSWER] = numbers[K] = min(max(k, -limit), limit)
        return FINE

    return limited
