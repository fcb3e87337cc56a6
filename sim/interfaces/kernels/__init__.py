"""Compiled kernels: the decorators that compile them, and the store that keeps the machine code.

    from uuv.sim.interfaces.kernels import kernel

    @kernel
    def norm2(x): ...

    @kernel(error_model="numpy", nogil=True)
    def solve(A, b, x): ...

`stamps` says what machine code depends on, `store` keeps it in the user's cache folder, and
`stored` joins both to numba. Every clone, worktree, environment and process of a user shares the
one store. `slots` calls kernels and plain Python by address, `control` a whole controller so.
"""

from uuv.sim.interfaces.kernels.stored import c_function, is_stored, kernel

__all__ = ["c_function", "is_stored", "kernel"]
