"""Baseline of the IK benchmark: textbook damped least squares, compiled with numba as our own
kernels are.
"""

import math

import numpy as np

from experiments.kinematics.ik_peers import Solver, SolverTask
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

STEPS = 60  # iterations from one start
STARTS = 200  # starts, the given one first, before a target counts as failed
DAMPING = 0.1  # lambda^2 over the squared error


@kernel(nogil=True, error_model="numpy")
def damped_least_squares(dh, slides, limits, tool, target, q, tol_p, tol_r, J, A, X):
    """Solves in place from `q`, steps clamped to the limits, with random restarts within them.

    dq = J^T (J J^T + lambda^2 I)^-1 e with lambda^2 = 0.1 |e|^2.

    Args:
        dh: (n, 4) theta [rad], d [m], a [m], alpha [rad].
        slides: (n,) 1 for a prismatic joint, else 0.
        limits: (n, 2) [rad] or [m].
        tool: (4, 4) tip in the last frame.
        target: (4, 4) tip pose.
        q: (n,) start; holds the result.
        tol_p: [m].
        tol_r: [rad].
        J: (n, 6) scratch.
        A: (6, 7) scratch.
        X: (4, 4) scratch.

    Returns:
        True if solved.
    """
    n = dh.shape[0]
    for start in range(STARTS):
        # Restarts are drawn within the limits by a hash of start and joint.
        if start:
            for i in range(n):
                share = math.sin(12.9898 * (start * n + i)) * 43758.5453 % 1.0
                q[i] = limits[i, 0] + share * (limits[i, 1] - limits[i, 0])

        for _ in range(STEPS):
            forward(dh, slides, tool, q, J, X)

            px, py, pz = target[0, 3] - X[0, 3], target[1, 3] - X[1, 3], target[2, 3] - X[2, 3]
            # Rotation vector of target R_tip^T from sin(angle) times the axis, and the cosine.
            wx = wy = wz = 0.0
            cosine = -0.5
            for m in range(3):
                wx += 0.5 * (X[1, m] * target[2, m] - X[2, m] * target[1, m])
                wy += 0.5 * (X[2, m] * target[0, m] - X[0, m] * target[2, m])
                wz += 0.5 * (X[0, m] * target[1, m] - X[1, m] * target[0, m])
                cosine += 0.5 * (
                    X[0, m] * target[0, m] + X[1, m] * target[1, m] + X[2, m] * target[2, m]
                )

            sine = math.sqrt(wx * wx + wy * wy + wz * wz)
            angle = math.atan2(sine, cosine)
            gain = angle / sine if sine > 1e-9 else 1.0
            square = px * px + py * py + pz * pz

            if square <= tol_p * tol_p and angle <= tol_r:
                return True

            # dq = J^T (J J^T + lambda^2 I)^-1 e.
            A[0, 6], A[1, 6], A[2, 6] = px, py, pz
            A[3, 6], A[4, 6], A[5, 6] = gain * wx, gain * wy, gain * wz
            damping = DAMPING * (square + angle * angle) + 1e-12
            for k in range(6):
                for m in range(k, 6):
                    total = damping if m == k else 0.0
                    for i in range(n):
                        total += J[i, k] * J[i, m]
                    A[k, m] = total
                    A[m, k] = total
            eliminate(A)

            for i in range(n):
                step = 0.0
                for k in range(6):
                    step += J[i, k] * A[k, 6]

                # Within the limits; a hinge with a range of a whole turn wraps.
                moved = q[i] + step
                lower = limits[i, 0]
                upper = limits[i, 1]
                if slides[i] == 0.0 and upper - lower >= 2.0 * math.pi - 1e-9:
                    moved = lower + (moved - lower) % (2.0 * math.pi)
                q[i] = min(max(moved, lower), upper)

    return False


@kernel(nogil=True, error_model="numpy")
def forward(dh, slides, tool, q, J, X):
    """Forward kinematics: tip pose into `X`, Jacobian into `J`.

    Args:
        dh: (n, 4) theta [rad], d [m], a [m], alpha [rad].
        slides: (n,) 1 for a prismatic joint, else 0.
        tool: (4, 4) tip in the last frame.
        q: (n,) joint values.
        J: (n, 6) one joint a row (linear; angular), written.
        X: (4, 4) written.
    """
    n = dh.shape[0]
    X[:] = 0.0
    X[0, 0] = X[1, 1] = X[2, 2] = X[3, 3] = 1.0

    # Along the chain, with origin and axis of each joint in its row of the Jacobian.
    for i in range(n):
        for r in range(3):
            J[i, r], J[i, 3 + r] = X[r, 3], X[r, 2]

        theta = dh[i, 0]
        d = dh[i, 1]
        a = dh[i, 2]
        if slides[i] != 0.0:
            d += q[i]
        else:
            theta += q[i]

        c = math.cos(theta)
        s = math.sin(theta)
        ca = math.cos(dh[i, 3])
        sa = math.sin(dh[i, 3])
        for r in range(3):
            x, y, z = X[r, 0], X[r, 1], X[r, 2]
            X[r, 0] = c * x + s * y
            v = c * y - s * x
            X[r, 1] = ca * v + sa * z
            X[r, 2] = ca * z - sa * v
            X[r, 3] += a * X[r, 0] + d * z

    # The tip, by the tool.
    for r in range(3):
        x, y, z = X[r, 0], X[r, 1], X[r, 2]
        for k in range(3):
            X[r, k] = x * tool[0, k] + y * tool[1, k] + z * tool[2, k]
        X[r, 3] += x * tool[0, 3] + y * tool[1, 3] + z * tool[2, 3]

    # Rows of the Jacobian: e x (p - p_joint) and e for a hinge, e and 0 for a slide.
    for i in range(n):
        ex, ey, ez = J[i, 3], J[i, 4], J[i, 5]
        if slides[i] != 0.0:
            J[i, 0], J[i, 1], J[i, 2] = ex, ey, ez
            J[i, 3] = J[i, 4] = J[i, 5] = 0.0
        else:
            sx, sy, sz = X[0, 3] - J[i, 0], X[1, 3] - J[i, 1], X[2, 3] - J[i, 2]
            J[i, 0], J[i, 1], J[i, 2] = ey * sz - ez * sy, ez * sx - ex * sz, ex * sy - ey * sx


@kernel(nogil=True, error_model="numpy")
def eliminate(A):
    """Solves a positive definite 6 x 6 system in place, in the last column of `A` (6, 7)."""
    # Elimination below the diagonal.
    for k in range(6):
        pivot = 1.0 / A[k, k]
        for r in range(k + 1, 6):
            f = A[r, k] * pivot
            for m in range(k + 1, 7):
                A[r, m] -= f * A[k, m]

    # Back substitution.
    for k in range(5, -1, -1):
        for m in range(k + 1, 6):
            A[k, 6] -= A[k, m] * A[m, 6]
        A[k, 6] /= A[k, k]


@kernel(nogil=True, error_model="numpy")
def solve_all(dh, slides, limits, tool, targets, q, tol_p, tol_r, J, A, X):
    """Solves every target in turn, without Python between them.

    Args:
        dh: (n, 4) theta [rad], d [m], a [m], alpha [rad].
        slides: (n,) 1 for a prismatic joint, else 0.
        limits: (n, 2) [rad] or [m].
        tool: (4, 4) tip in the last frame.
        targets: (N, 4, 4) tip poses.
        q: (N, n) starts; holds the results.
        tol_p: [m].
        tol_r: [rad].
        J: (n, 6) scratch.
        A: (6, 7) scratch.
        X: (4, 4) scratch.

    Returns:
        Number of targets solved.
    """
    solved = 0
    for i in range(len(targets)):
        solved += damped_least_squares(
            dh, slides, limits, tool, targets[i], q[i], tol_p, tol_r, J, A, X
        )
    return solved


def baseline(task: SolverTask) -> Solver:
    """`damped_least_squares` behind the call signature of the peers."""
    dh, slides, limits, tool, J, A, X = arguments(task)
    tol_p, tol_r = task.bar

    def solver(target: Array, q0: Array) -> Array:
        q = q0.copy()
        damped_least_squares(dh, slides, limits, tool, target, q, tol_p, tol_r, J, A, X)
        return q

    return solver


def arguments(task: SolverTask) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """Arguments of the kernels: dh, slides, limits, tool, and scratch J, A, X."""
    arm = task.arm
    slides = np.array([1.0 if kind == "p" else 0.0 for kind in arm.joint_types])
    scratch = np.empty((arm.n, 6)), np.empty((6, 7)), np.empty((4, 4))
    return np.array(arm.dh), slides, np.array(task.limits), np.array(arm.X_n_flange), *scratch
