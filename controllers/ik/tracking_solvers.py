"""Solvers that the compiled loop calls by address, to track a tool pose by another method.

A method is compiled only where it is chosen; the loop then need not contain all three.
"""

from functools import cache
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from uuv.controllers.ik.chain_kernels import JACOBIAN_FREE, PLAIN, PRIORITY, Settings, memory_size
from uuv.controllers.ik.method import Method
from uuv.controllers.ik.paper_stages import solve_plain
from uuv.controllers.ik.priorities import solve_priority
from uuv.controllers.ik.sweeps import solve_jacobian_free
from uuv.sim.interfaces.kernels import c_function, kernel

_NUMBER = types.CPointer(types.float64)
# code = solver(n, tolerances (3), most sweeps, memory, X (4, 4), q0 (n), q (n) out, errors (2) out)
_SOLVER = types.int64(types.int64, *(types.float64,) * 2, types.int64, *(_NUMBER,) * 5)
_size = kernel(memory_size)


@cache
def _compiled(method: Method) -> Any:
    """C function of a method; it must stay alive, since its address is in use."""
    # closed over: each method is compiled for itself
    plain = method == "plain"
    priority = method == "priority"

    def of_pointers(n, tol_p, tol_r, limit, memory, X, q0, q, errors):
        chain = carray(memory, _size(n))
        trail = carray(memory, (0, 1))
        target = carray(X, (4, 4))
        start = carray(q0, n)
        out = carray(q, n)
        residual = carray(errors, 2)

        axis = tol_r * 0.5**0.5

        if plain:
            settings = Settings(PLAIN, tol_p, tol_r, axis, axis, limit, 0, True, True)
            code, _, _, residual[0], residual[1] = solve_plain(
                chain, target, start, settings, trail, out
            )
        elif priority:
            settings = Settings(PRIORITY, tol_p, tol_r, axis, axis, limit, 0, True, False)
            code, _, _, residual[0], residual[1] = solve_priority(
                chain, target, start, settings, trail, out
            )
        else:
            settings = Settings(JACOBIAN_FREE, tol_p, tol_r, axis, axis, limit, 0, True, False)
            code, _, _, residual[0], residual[1] = solve_jacobian_free(
                chain, target, start, settings, trail, out
            )

        return code

    return c_function(_SOLVER, error_model="numpy")(of_pointers)


def solver_address(method: Method) -> int:
    """Address for `solve_at`; 0 for "hybrid", which the loop contains."""
    return 0 if method == "hybrid" else int(_compiled(method).address)


def _call(
    _typing: Any,
    _address: Any,
    _n: Any,
    _p: Any,
    _r: Any,
    _most: Any,
    _memory: Any,
    _X: Any,
    _q0: Any,
    _q: Any,
    _errors: Any,
) -> Any:
    """Intrinsic that calls a solver; arrays are given by their addresses."""

    def codegen(_context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
        number = ir.DoubleType()
        count = ir.IntType(64)
        arrays = [builder.inttoptr(address, number.as_pointer()) for address in args[5:]]
        kind = ir.FunctionType(
            count, [count, number, number, count, *(array.type for array in arrays)]
        )

        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [*args[1:5], *arrays])

    numbers = (types.intp, types.float64, types.float64, types.int64)
    return types.int64(types.intp, *numbers, *(types.intp,) * 5), codegen


_call_solver = cast(Any, intrinsic(_call))


@kernel
def solve_at(address, chain, X, q0, tolerances, limit, q, errors):
    """Solve by the method at `address`, on the branch of `q0` and without restarts.

    Args:
        address: of `solver_address`, not 0.
        chain: kernel memory of the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] start.
        tolerances: [m], [rad] errors within which the pose is met.
        limit: most sweeps.
        q: (n,) [rad] out.
        errors: (2,) out, [m] and [rad].

    Returns:
        A code of `uuv.controllers.ik.chain_kernels`.
    """
    addresses = chain.ctypes.data, X.ctypes.data, q0.ctypes.data, q.ctypes.data, errors.ctypes.data

    return _call_solver(
        address,
        q0.shape[0],
        tolerances[0],
        tolerances[1],
        limit,
        addresses[0],
        addresses[1],
        addresses[2],
        addresses[3],
        addresses[4],
    )
