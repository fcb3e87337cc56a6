"""Slots: components that a compiled tick calls by address, whether they are kernels or plain
Python.

A slot is a C function `int64 slot(double* memory, double* values)`. `memory` holds the component's
state from tick to tick, and `values` holds its inputs and outputs. A component without a kernel
gets a ctypes trampoline, which acquires the GIL itself and works on the same arrays. For compiled
code there is no difference. An exception in it is kept: the kernel returns RAISED, and its caller
in Python raises the exception (`PythonSlots.check`).
"""

import ctypes
from collections.abc import Callable
from types import FunctionType
from typing import Any, NamedTuple, Protocol, TypeGuard, cast

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from uuv.sim.interfaces.errors import ConfigurationError, UuvError, plain
from uuv.sim.interfaces.kernels.stored import c_function, kernel
from uuv.sim.interfaces.spatial import Array

# Answers of a slot. A kernel that fails inside prints the reason, and numba then returns 0.
FAILED, FINE, RAISED = range(3)

SLOT = types.int64(types.CPointer(types.float64), types.CPointer(types.float64))  # of `c_function`
_Trampoline = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)


class Slot(NamedTuple):
    """One part of a tick."""

    address: int  # of its C function; 0: the part that the tick contains
    memory: Array  # state of the component
    values: Array  # inputs and outputs of the component


def empty_slot(memory: Array | None = None, values: int = 0) -> Slot:
    """Slot of a component that is built into the tick, with its `memory` and `values` values."""
    return Slot(0, np.zeros(0) if memory is None else memory, np.zeros(values))


def _call(_typing: Any, _address: Any, _memory: Any, _values: Any) -> Any:
    """Intrinsic that calls a C function of two addresses."""

    def codegen(_context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
        number = ir.IntType(64)
        kind = ir.FunctionType(number, [number, number]).as_pointer()
        return builder.call(builder.inttoptr(args[0], kind), args[1:])

    return types.int64(types.intp, types.intp, types.intp), codegen


# In compiled code only: call_at(address, memory, values) with three addresses.
call_at = cast(Any, intrinsic(_call))


@kernel
def call(slot):
    """Call a `Slot` that is not empty, and return its answer."""
    return call_at(slot.address, slot.memory.ctypes.data, slot.values.ctypes.data)


def _address(_typing: Any, box: Any) -> Any:
    """Intrinsic that returns the address of a record box."""

    def codegen(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> ir.Value:
        proxy = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
        return builder.ptrtoint(proxy.meminfo, ir.IntType(64))

    return types.intp(box), codegen


_address_in = cast(Any, intrinsic(_address))


@kernel
def address_of_box(box):
    """Address at which a kernel called by address receives `box`, a `RecordBox`."""
    return _address_in(box)


def address_of_kernel(compiled: Any, *boxes: Any) -> int:
    """Address of a kernel, compiled for these arguments; it is valid as long as the kernel exists.

    Args:
        compiled: Function compiled by `kernel`, with its C wrapper, that returns an int64.
        *boxes: Arguments of the kernel, each a `RecordBox`.
    """
    overload = compiled.get_compile_result(types.int64(*map(numba.typeof, boxes)))
    return int(overload.library.get_pointer_to_function(overload.fndesc.llvm_cfunc_wrapper_name))


def slot_function(function: Callable[[Any, Any], int], part: str = "") -> Any:
    """C function of a slot, compiled by numba; keep a reference as long as its address is used.

    Args:
        function: function(memory, values), both pointers; returns FINE.
        part: Name of a user's component, with which the error message begins.

    Raises:
        ConfigurationError: Numba cannot compile the function.
    """
    try:
        return c_function(SLOT)(function)
    except NumbaError as error:
        lines = [line.strip() for line in plain(str(error)).splitlines()]
        reasons = [line for line in lines if line and not line.startswith("Failed in")]
        raise ConfigurationError(
            f"{part}: numba cannot compile the function: {reasons[0]}"
        ) from None


class PythonSlots:
    """Slots in plain Python, and their exceptions. Their addresses are valid as long as this object
    exists.
    """

    def __init__(self) -> None:
        self._callbacks: list[Any] = []
        self._raised: list[BaseException] = []

    def add(self, function: Callable[[], int | None]) -> int:
        """Address of a slot that calls `function()`. The result is the answer; None means FINE."""

        def guarded(_memory: int, _values: int) -> int:
            try:
                answer = function()
            except BaseException as error:  # the caller of the kernel raises it, whatever its type
                self._raised.append(error)
                return RAISED
            return FINE if answer is None else answer

        callback = _Trampoline(guarded)
        self._callbacks.append(callback)
        # `ctypes.cast` would leave a reference cycle.
        return int(ctypes.c_void_p.from_buffer(callback).value or 0)

    def clear(self) -> None:
        """Free the callbacks; none of the addresses may be called afterwards."""
        self._callbacks.clear()

    def check(self, answer: int) -> int:
        """Return the answer of a kernel, unless a component has failed.

        Raises:
            BaseException: The exception of a slot in Python.
            UuvError: A kernel failed inside.
        """
        if answer == RAISED and self._raised:
            error = self._raised.pop()
            self._raised.clear()
            raise error
        if answer in (RAISED, FAILED):
            raise UuvError("a kernel of the controller failed; its message is above")
        return answer


class HasSlot(Protocol):
    """Component with a kernel."""

    def slot(self, state: Any) -> Slot:
        """The kernel, bound to the arrays of `state`."""
        ...


def has_slot(part: object) -> TypeGuard[HasSlot]:
    """True if `part` provides a kernel (`gives_kernel`)."""
    return gives_kernel(part, "slot")


def gives_kernel(part: object, name: str) -> bool:
    """True if a component has the method `name`, and no subclass below it overrides another method.

    A class that inherits a kernel and overrides a method that the kernel implements runs in Python,
    until it provides its own kernel.
    """
    classes = type(part).__mro__
    defining = next((row for row, kind in enumerate(classes) if name in vars(kind)), None)
    if defining is None:
        return False
    bodies = [member for kind in classes[defining:] for member in vars(kind).items()]
    methods = {word for word, member in bodies if _is_method(word, member)}
    later = {word for kind in classes[:defining] for word in vars(kind)}
    return methods.isdisjoint(later | set(getattr(part, "__dict__", ())))


_METHODS = FunctionType, property, classmethod, staticmethod


def _is_method(name: str, value: Any) -> bool:
    return not name.startswith("__") and isinstance(value, _METHODS)
