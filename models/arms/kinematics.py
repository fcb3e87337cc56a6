"""Compiled forward kinematics of serial arms: link frames.

Tips and their derivatives are in `uuv.models.arms.tip_places`. A joint's row in `table` is (theta0,
d, a, alpha, beta). The transform over a hinge is Rz(theta0 + q) Tz(d) Tx(a) Rx(alpha) Ry(beta); for
a slide Rz(theta0) Tz(d + q) replaces the first two factors. beta is the angle of [Hayati 1985],
zero except between near-parallel axes. Angles are in rad, lengths in m, and all vectors in base
axes.
"""

import math

import numpy as np
from numba import boolean, float64, types

from uuv.sim.interfaces.kernels import kernel

THETA, D, A, ALPHA, BETA, ROW = 0, 1, 2, 3, 4, 5  # columns of a table row, and their number

# The explicit signature compiles once, for read-only and writable arrays alike.
_M = types.Array(float64, 2, "C", readonly=True)
_FLAGS = types.Array(boolean, 1, "C", readonly=True)


@kernel
def frame_step(R, o, row, q, slide, axes):
    """Advance frame (R, o) in place over a joint. `axes` (4, 3) receives z and o before the joint,
    and x and y after it.
    """
    theta = row[THETA] + (0.0 if slide else q)
    d = row[D] + (q if slide else 0.0)
    c, s = math.cos(theta), math.sin(theta)
    ca, sa = math.cos(row[ALPHA]), math.sin(row[ALPHA])
    cb, sb = math.cos(row[BETA]), math.sin(row[BETA])

    for i in range(3):
        x, y, z = R[i, 0], R[i, 1], R[i, 2]
        axes[0, i] = z
        axes[1, i] = o[i]

        # Rz(theta), then Tz(d) and Tx(a).
        x, y = c * x + s * y, c * y - s * x
        o[i] += d * z + row[A] * x

        # Rx(alpha), then Ry(beta), written back into R.
        y, z = ca * y + sa * z, ca * z - sa * y
        axes[2, i] = x
        axes[3, i] = y
        R[i, 0] = cb * x - sb * z
        R[i, 1] = y
        R[i, 2] = cb * z + sb * x


@kernel(signature=float64[:, :, :, ::1](_M, _FLAGS, _M, _M))
def frames(table, slides, X_base, q):
    """Link frames X (M, n + 1, 4, 4) in the base at each joint vector. The z axis of frame k is the
    axis of joint k + 1.

    Args:
        table: (n, 5) rows (theta0, d, a, alpha, beta).
        slides: (n,) bool, True for a slide.
        X_base: (4, 4) frame 0 in the base.
        q: (M, n) joint values [rad], slides [m].

    Returns:
        Frames (M, n + 1, 4, 4).
    """
    touches, n = q.shape
    X = np.zeros((touches, n + 1, 4, 4))

    R = np.empty((3, 3))
    o = np.empty(3)
    axes = np.empty((4, 3))

    for m in range(touches):
        R[:, :] = X_base[:3, :3]
        o[:] = X_base[:3, 3]
        for k in range(n + 1):
            X[m, k, :3, :3] = R
            X[m, k, :3, 3] = o
            X[m, k, 3, 3] = 1.0
            if k < n:
                frame_step(R, o, table[k], q[m, k], slides[k], axes)

    return X
