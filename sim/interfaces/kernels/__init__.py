"""Compiled kernels: the decorators that compile them, and the store that keeps the machine code.

    from uuv.sim.interfaces.kernels import kernel

    @kernel
    def norm2(x): ...

    @kernel(error_model="numpy", nogil=True)
    def solve(A, b, x): ...

`stamps` computes the hash of everything that machine code depends on, `store` keeps the code in the
user's cache folder, and `stored` connects both to numba. All clones, worktrees, environments and
processes of a user share one store. `slots` calls kernels and plain Python functions by address,
and `control` calls a whole controller by address.
"""

from uuv.sim.interfaces.kernels.stored import c_function, is_stored, kernel

__all__ = ["c_function", "is_stored", "kernel"]
