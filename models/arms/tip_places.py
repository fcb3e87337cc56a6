"""Compiled tip positions of serial arms, with their first derivatives with respect to the table.

This module is separate from `uuv.models.arms.kinematics` because only calibration needs it, and its
explicit signature compiles on import. Derivatives are analytic: a turn about an axis through o
moves the tip p by axis x (p - o), a shift moves it along the direction of the shift.
"""

import numpy as np
from numba import boolean, float64, types

from uuv.models.arms.kinematics import ALPHA, BETA, ROW, THETA, A, D, frame_step
from uuv.sim.interfaces.kernels import kernel

NO_JACOBIAN = np.empty((0, 0, 0))  # passed as `J` to `tips`, it skips the derivatives

# The explicit signature compiles once, for read-only and writable arrays alike.
_V, _M = (types.Array(float64, d, "C", readonly=True) for d in (1, 2))
_FLAGS = types.Array(boolean, 1, "C", readonly=True)


@kernel
def cross_into(out, a, b, c):
    """Write a x (b - c) into `out` (3,)."""
    x, y, z = b[0] - c[0], b[1] - c[1], b[2] - c[2]
    out[0] = a[1] * z - a[2] * y
    out[1] = a[2] * x - a[0] * z
    out[2] = a[0] * y - a[1] * x


@kernel(signature=float64[:, ::1](_M, _FLAGS, _M, _M, _V, _M, float64[:, :, ::1]))
def tips(table, slides, X_base, X_flange, tcp, q, J):
    """Tip positions (M, 3) [m] for joint values q (M, n), optionally with their Jacobian.

    Args:
        table: (n, 5) rows (theta0, d, a, alpha, beta).
        slides: (n,) bool, True for a slide.
        X_base: (4, 4) frame 0 in the base.
        X_flange: (4, 4) flange in the last frame.
        tcp: (3,) [m] tool point in the flange.
        q: (M, n) joint values [rad], slides [m].
        J: (M, 5 n + 3, 3), output, the derivatives with respect to the table, row by row, then to
            the tool point. An array of shape (0, 0, 0) skips them.

    Returns:
        Tip positions in the base.
    """
    touches, n = q.shape
    p = np.empty((touches, 3))
    R = np.empty((3, 3))
    o = np.empty(3)
    axes = np.empty((n, 4, 3))
    after = np.empty((n, 3))

    # Tool point in the last frame.
    offset = (
        X_flange[:3, 3]
        + tcp[0] * X_flange[:3, 0]
        + tcp[1] * X_flange[:3, 1]
        + tcp[2] * X_flange[:3, 2]
    )

    for m in range(touches):
        R[:, :] = X_base[:3, :3]
        o[:] = X_base[:3, 3]
        for k in range(n):
            frame_step(R, o, table[k], q[m, k], slides[k], axes[k])
            after[k] = o

        for i in range(3):
            p[m, i] = o[i] + R[i, 0] * offset[0] + R[i, 1] * offset[1] + R[i, 2] * offset[2]
        if J.shape[0] == 0:
            continue

        # With respect to the table: a turn moves the tip by axis x (p - o), a shift along its axis.
        for k in range(n):
            cross_into(J[m, ROW * k + THETA], axes[k, 0], p[m], axes[k, 1])
            J[m, ROW * k + D] = axes[k, 0]
            J[m, ROW * k + A] = axes[k, 2]
            cross_into(J[m, ROW * k + ALPHA], axes[k, 2], p[m], after[k])
            cross_into(J[m, ROW * k + BETA], axes[k, 3], p[m], after[k])

        # With respect to the tool point: along the axes of the flange.
        for j in range(3):
            for i in range(3):
                J[m, ROW * n + j, i] = (
                    R[i, 0] * X_flange[0, j] + R[i, 1] * X_flange[1, j] + R[i, 2] * X_flange[2, j]
                )

    return p
