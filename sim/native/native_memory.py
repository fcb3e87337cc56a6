"""Loads, stores and calls by raw address in compiled code, which uses MuJoCo without its Python
binding.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def loader(result: types.Type, kind: ir.Type, scale: int) -> Callable[[int, int], Any]:
    """Intrinsic f(address, index) that loads a value from `index` times `scale` bytes after
    `address`.

    Args:
        result: Numba type of the value.
        kind: LLVM type of the value.
        scale: [bytes] per index.

    Returns:
        The intrinsic, callable in compiled code only.
    """

    def load(_typing: Any, _address: Any, _index: Any) -> Any:
        def codegen(_context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
            address = builder.add(args[0], builder.mul(args[1], ir.Constant(args[1].type, scale)))
            return builder.load(builder.inttoptr(address, kind.as_pointer()))

        return result(types.intp, types.intp), codegen

    return cast(Any, intrinsic(load))


f64 = loader(types.float64, ir.DoubleType(), 8)
i32 = loader(types.int32, ir.IntType(32), 4)
pointer = loader(types.intp, ir.IntType(64), 1)  # index in bytes


def _storer() -> Callable[[int, int, float], None]:
    """Intrinsic f(address, index, value) that stores a float64 at 8 * `index` bytes after
    `address`.
    """

    def store(_typing: Any, _address: Any, _index: Any, _value: Any) -> Any:
        def codegen(context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
            address = builder.add(args[0], builder.mul(args[1], ir.Constant(args[1].type, 8)))
            builder.store(args[2], builder.inttoptr(address, ir.DoubleType().as_pointer()))

            return context.get_dummy_value()

        return types.void(types.intp, types.intp, types.float64), codegen

    return cast(Any, intrinsic(store))


put = _storer()


def _numbers() -> Callable[[int], Any]:
    """Intrinsic f(address) that returns the address as a pointer to float64, for `numba.carray`."""

    def point(_typing: Any, _address: Any) -> Any:
        def codegen(_context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
            return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

        return types.CPointer(types.float64)(types.intp), codegen

    return cast(Any, intrinsic(point))


numbers_at = _numbers()


def _stepper() -> Callable[[int, int, int], Any]:
    """Intrinsic f(function, model, data) that calls the C function `void (const mjModel*, mjData*)`
    at an address.
    """

    def call(_typing: Any, _function: Any, _model: Any, _data: Any) -> Any:
        def codegen(context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
            pointer = ir.IntType(8).as_pointer()
            kind = ir.FunctionType(ir.VoidType(), [pointer, pointer]).as_pointer()
            model = builder.inttoptr(args[1], pointer)
            data_pointer = builder.inttoptr(args[2], pointer)
            builder.call(builder.inttoptr(args[0], kind), [model, data_pointer])
            return context.get_dummy_value()

        return types.void(types.intp, types.intp, types.intp), codegen

    return cast(Any, intrinsic(call))


# `mj_step1` or `mj_step2`, whose addresses are in `uuv.sim.plant.readout.places_of`
call_physics = _stepper()
