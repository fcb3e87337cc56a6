"""SIMD type of four float64 lanes for numba: the same arithmetic on four bodies at a time.

`FOUR` is LLVM's <4 x double>, which takes one AVX register, or two registers of SSE2 or NEON. It
supports +, -, *, /, `abs` and `math.sqrt`, also with a float64 on one side, so a function written
for floats compiles for it unchanged. Lanes are independent: a result does not depend on the other
three. A multiply and an add may be fused, as in the scalar code.
"""

import math
import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

_typed: Any = intrinsic  # callers of the functions below do not pass their first parameter

_VECTOR = ir.VectorType(ir.DoubleType(), 4)
_FLAGS = ("contract",)


class _FourType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Four")


FOUR = _FourType()


@register_model(_FourType)
class _FourModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _binary(function: Any, operation: str) -> None:
    """Register `function` with numba for two Fours, and for a float64 and a Four."""

    def typing(_context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            return FOUR if {a, b} <= {FOUR, types.float64} and FOUR in (a, b) else None

        return typer

    def lowering(_context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, b = (
            x if t is FOUR else _splat(builder, x)
            for x, t in zip(args, signature.args, strict=True)
        )
        return getattr(builder, operation)(a, b, flags=_FLAGS)

    type_callable(function)(typing)
    for pair in ((_FourType, _FourType), (types.Float, _FourType), (_FourType, types.Float)):
        lower_builtin(function, *pair)(lowering)


def _unary(function: Any, llvm_name: str) -> None:
    def typing(_context: Any) -> Any:
        def typer(a: Any) -> Any:
            return FOUR if a is FOUR else None

        return typer

    def lowering(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        return builder.call(
            cgutils.get_or_insert_function(builder.module, kind, f"{llvm_name}.v4f64"), args
        )

    type_callable(function)(typing)
    lower_builtin(function, _FourType)(lowering)


def _splat(builder: Any, number: Any) -> Any:
    lane = builder.insert_element(
        ir.Constant(_VECTOR, ir.Undefined), number, ir.Constant(ir.IntType(32), 0)
    )
    return _shuffle(builder, lane, lane, (0, 0, 0, 0))


def _shuffle(builder: Any, a: Any, b: Any, lanes: tuple[int, ...]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), 4), lanes))


for _function, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _binary(_function, _name)
_unary(abs, "llvm.fabs")
_unary(math.sqrt, "llvm.sqrt")


def _place(builder: Any, address: Any, index: Any) -> Any:
    """Pointer to the four numbers that begin `index` numbers after `address`."""
    eight = ir.Constant(index.type, 8)
    return builder.inttoptr(builder.add(address, builder.mul(index, eight)), _VECTOR.as_pointer())


@_typed
def load_four(typingctx, address, index):
    """Load the four float64 that begin 8 * `index` bytes after `address`.

    Args:
        typingctx: Numba's typing context; callers do not pass it.
        address: Raw address.
        index: Offset, in float64.

    Returns:
        Four lanes.
    """

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.load(_place(builder, *args), align=8)

    return FOUR(types.intp, types.intp), codegen


@_typed
def put_four(typingctx, address, index, value):
    """Store the four lanes of `value`, beginning 8 * `index` bytes after `address`.

    Args:
        typingctx: Numba's typing context; callers do not pass it.
        address: Raw address.
        index: Offset, in float64.
        value: The four lanes.
    """

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        builder.store(args[2], _place(builder, args[0], args[1]), align=8)
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, FOUR), codegen


@_typed
def transposed_four(typingctx, a, b, c, d):
    """Transpose a 4 x 4 block: lane i of the k-th argument becomes lane k of the i-th result.

    Args:
        typingctx: Numba's typing context; callers do not pass it.
        a: First row, four lanes.
        b: Second row.
        c: Third row.
        d: Fourth row.

    Returns:
        The four columns, four lanes each.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, b, c, d = args
        low = (0, 4, 2, 6)
        high = (1, 5, 3, 7)
        pairs = [
            _shuffle(builder, x, y, lanes) for x, y in ((a, b), (c, d)) for lanes in (low, high)
        ]
        halves = [
            _shuffle(builder, pairs[k], pairs[k + 2], lanes)
            for lanes in ((0, 1, 4, 5), (2, 3, 6, 7))
            for k in (0, 1)
        ]
        return context.make_tuple(builder, signature.return_type, halves)

    return types.UniTuple(FOUR, 4)(FOUR, FOUR, FOUR, FOUR), codegen


@_typed
def all_four(typingctx, number):
    """`number` in every lane."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _splat(builder, args[0])

    return FOUR(types.float64), codegen


@_typed
def four_of(typingctx, a, b, c, d):
    """Pack four float64 into lanes.

    Args:
        typingctx: Numba's typing context; callers do not pass it.
        a: Lane 0.
        b: Lane 1.
        c: Lane 2.
        d: Lane 3.

    Returns:
        The four lanes.
    """

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        vector = ir.Constant(_VECTOR, ir.Undefined)
        for lane, number in enumerate(args):
            vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), lane))
        return vector

    return FOUR(*[types.float64] * 4), codegen


@_typed
def at_least(typingctx, value, floor):
    """Maximum of `value` and `floor` lane by lane; NaN stays NaN.

    Args:
        typingctx: Numba's typing context; callers do not pass it.
        value: Four lanes.
        floor: One float64 for all lanes.

    Returns:
        Four lanes.
    """

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        floor = _splat(builder, args[1])
        return builder.select(builder.fcmp_ordered("<", args[0], floor), floor, args[0])

    return FOUR(FOUR, types.float64), codegen
