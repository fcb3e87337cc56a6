"""Force law of one's own that runs within the compiled ticks of the loop (`uuv.ticks.compiled_ticks`)."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.errors import NumbaError
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from uuv.controllers.arm.position_force import NUMBERS, SET_FORCE, ForceDisplacement, ForceDisplacementState, K
from uuv.sim.interfaces.errors import ConfigurationError, plain
from uuv.sim.interfaces.kernels import c_function, kernel

# double law(double* memory, double set_force, double felt, double servo_compliance, double dt)
_LAW = types.float64(types.CPointer(types.float64), *(types.float64,) * 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelForceLaw(ForceDisplacement):
    """Force law from a plain function, which is compiled: the loop calls it at its own rate, without Python.

    Its displacement is limited by `speed` and `limit` and released like that of `ForceDisplacement`; the other gains do
    not count.
    """

    law: Callable[..., float]  # law(memory, set_force, felt, servo_compliance, dt), see `step`: the displacement [m]
    numbers: int = 1  # length of its memory, which is zero whenever the loop closes
    _compiled: Any = field(init=False, repr=False, compare=False)  # kept alive: `address` points into it

    def __post_init__(self) -> None:
        """Compile the law.

        Raises:
            ConfigurationError: numba cannot compile it, or `numbers` is below 1.
        """
        super(KernelForceLaw, self).__post_init__()
        if self.numbers < 1:
            raise ConfigurationError(f"numbers of the force law: must be at least 1, got {self.numbers}")
        size, law = self.numbers, kernel(self.law)

        def of_pointer(memory: Any, set_force: float, felt: float, servo_compliance: float, dt: float) -> float:
            return law(carray(memory, size), set_force, felt, servo_compliance, dt)

        try:
            object.__setattr__(self, "_compiled", c_function(_LAW)(of_pointer))
        except NumbaError as error:
            lines = [line.strip() for line in plain(str(error)).splitlines()]
            said = [line for line in lines if line and not line.startswith("Failed in")]
            name = getattr(self.law, "__name__", repr(self.law))
            raise ConfigurationError(f"force law {name}: numba cannot compile it: {said[0]}") from None

    @property
    def address(self) -> int:
        """Address of the compiled law."""
        return self._compiled.address

    def init(self) -> ForceDisplacementState:
        """Initial state: no displacement, and the memory behind the usual numbers."""
        usual = ForceDisplacementState().numbers
        return ForceDisplacementState(np.concatenate([usual, np.zeros(self.numbers)]))

    def step(
        self, state: ForceDisplacementState, set_force: float, felt: float, servo_compliance: float, dt: float
    ) -> float:
        """Displacement k by the law.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            set_force: [N] normal force to press with.
            felt: [N] measured normal force.
            servo_compliance: [m/N] of the arm's servo along the tool axis.
            dt: [s] since the last step.

        Returns:
            The displacement k [m] along the tool axis, positive into the surface.
        """
        return displace_by(self.address, (self.speed, self.limit), state.numbers, set_force, felt, servo_compliance, dt)


def _call(
    _typing: Any, _address: Any, _memory: Any, _set_force: Any, _felt: Any, _servo_compliance: Any, _dt: Any
) -> Any:
    """Intrinsic that calls the law at an address; `memory` is an address too."""

    def codegen(_context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
        number = ir.DoubleType()
        kind = ir.FunctionType(number, [number.as_pointer(), *(number,) * 4]).as_pointer()
        memory = builder.inttoptr(args[1], number.as_pointer())
        return builder.call(builder.inttoptr(args[0], kind), [memory, *args[2:]])

    return types.float64(types.intp, types.intp, *(types.float64,) * 4), codegen


_call_law = cast(Any, intrinsic(_call))


@kernel
def displace_by(law, bounds, numbers, set_force, felt, servo_compliance, dt):
    """Step of `KernelForceLaw`.

    Args:
        law: address of the compiled law.
        bounds: speed [m/s] and size [m] of the displacement.
        numbers: state; updated.
        set_force: [N] normal force to press with.
        felt: [N] measured normal force.
        servo_compliance: [m/N] of the arm's servo along the tool axis.
        dt: [s] since the last step.

    Returns:
        The displacement k [m].
    """
    speed, limit = bounds
    memory = numbers[NUMBERS:]
    if np.isnan(numbers[SET_FORCE]):
        memory[:] = 0.0
    numbers[SET_FORCE] = set_force
    k = _call_law(law, memory.ctypes.data, set_force, felt, servo_compliance, dt)
    k = min(max(k, numbers[K] - speed * dt), numbers[K] + speed * dt)
    numbers[K] = min(max(k, -limit), limit)
    return numbers[K]
