"""Compiled kernels: size of the arm, centred touches, loads of joints, inverse kinematics.

Tables are those of `uuv.models.arms.kinematics`. Angles are in rad, lengths in m, all vectors in
base axes.
"""

import math

import numpy as np
from numba import boolean, float64, int64, types

from uuv.models.arms.kinematics import ALPHA, BETA, ROW, A, D, frame_step
from uuv.models.arms.tip_places import cross_into
from uuv.sim.interfaces.kernels import kernel

# Explicit signatures: each kernel compiles once, for read-only and writable arrays alike.
_V, _M, _T, _X4 = (types.Array(float64, d, "C", readonly=True) for d in (1, 2, 3, 4))
_FLAGS = types.Array(boolean, 1, "C", readonly=True)
_PLACES = types.Array(int64, 1, "C", readonly=True)


@kernel(signature=types.Tuple((float64, float64[::1]))(_M, _M, _V, _FLAGS))
def arm_size(table, X_flange, tcp, parallel):
    """Size of the arm [m], the root of summed squares of observable lengths, and its derivative.

    The last link and the tool count as one length, from the last joint to the tip. The d of the
    first joint is left out, because it only moves the base. Along parallel axes the sum of the d is
    used: shifts that cancel move no tip, and otherwise an arm could grow by such shifts, so that
    its residuals become small compared with its size.

    Args:
        table: (n, 5) rows (theta0, d, a, alpha, beta).
        X_flange: (4, 4) flange in the last frame.
        tcp: (3,) [m] tool point in the flange.
        parallel: (n,) bool, True where the axis is parallel to that of the next joint.

    Returns:
        The size, and its derivative (5 n + 3,) by the table row by row, then by the tool point.
    """
    n = table.shape[0]
    gradient = np.zeros(ROW * n + 3)
    offset = np.empty(3)

    # Tool point in the last frame.
    for i in range(3):
        offset[i] = (
            X_flange[i, 3]
            + X_flange[i, 0] * tcp[0]
            + X_flange[i, 1] * tcp[1]
            + X_flange[i, 2] * tcp[2]
        )

    # Position of the tip relative to the last joint.
    row = table[n - 1]
    ca, sa, cb, sb = (
        math.cos(row[ALPHA]),
        math.sin(row[ALPHA]),
        math.cos(row[BETA]),
        math.sin(row[BETA]),
    )
    # Rx(alpha) Ry(beta)
    R = np.array([[cb, 0.0, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]])
    tip = np.empty(3)
    for i in range(3):
        tip[i] = R[i, 0] * offset[0] + R[i, 1] * offset[1] + R[i, 2] * offset[2]

    # Squared length, with derivatives with respect to a, d, alpha and the tool point.
    last = ROW * (n - 1)
    y, z = tip[1], tip[2]
    tip[0] += row[A]
    tip[2] += row[D]
    square = tip[0] ** 2 + tip[1] ** 2 + tip[2] ** 2
    gradient[last + A], gradient[last + D] = tip[0], tip[2]
    gradient[last + ALPHA] = tip[2] * y - tip[1] * z
    for j in range(3):
        for i in range(3):
            column = R[i, 0] * X_flange[0, j] + R[i, 1] * X_flange[1, j] + R[i, 2] * X_flange[2, j]
            gradient[ROW * n + j] += tip[i] * column

    # Lengths between the axes; for parallel axes only the sum of the shifts is observed.
    first = 0
    for k in range(n - 1):
        square += table[k, A] ** 2
        gradient[ROW * k + A] = table[k, A]
        if k < n - 2 and parallel[k]:
            continue
        # along the axis of joint `first`, which is parallel to those of the joints up to k
        shift, way = 0.0, 1.0
        for j in range(first, k + 1):
            shift += way * table[j, D]
            gradient[ROW * j + D] = way
            way *= math.copysign(1.0, math.cos(table[j, ALPHA]))

        # Shifts along the first axis are not observed.
        if first == 0:
            shift = 0.0

        square += shift**2
        for j in range(first, k + 1):
            gradient[ROW * j + D] *= shift
        first = k + 1

    length = math.sqrt(square)
    return length, gradient / max(length, 1e-300)


@kernel(
    signature=types.Tuple(
        (float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1])
    )(_M, _T, _V, _PLACES, _PLACES)
)
def centred_rows(p, J, weights, starts, index):
    """Tips and their derivatives about the weighted mean of each series.

    Args:
        p: (M, 3) [m] tips.
        J: (M, F, 3) derivatives by the full vector.
        weights: (M,) of the touches; 0 excludes one.
        starts: (S,) first row of each series.
        index: (P,) columns of the free parameters.

    Returns:
        Residuals (M, 3); residuals (3 M,) and derivatives (3 M, P), both times the root of the
        weights; means (S, 3); and derivatives of the means (S, P, 3).
    """
    touches = p.shape[0]
    series = starts.shape[0]
    free = index.shape[0]
    residuals = np.empty((touches, 3))
    r = np.empty(3 * touches)
    rows = np.empty((3 * touches, free))
    c = np.zeros((series, 3))
    C = np.zeros((series, free, 3))

    for s in range(series):
        end = starts[s + 1] if s + 1 < series else touches

        # Weighted mean of the series.
        total = 0.0
        for m in range(starts[s], end):
            w = weights[m]
            total += w
            if w > 0.0:
                for i in range(3):
                    c[s, i] += w * p[m, i]
                for f in range(free):
                    for i in range(3):
                        C[s, f, i] += w * J[m, index[f], i]
        if total > 0.0:
            c[s] /= total
            C[s] /= total

        # Residuals and rows about it, times the root of the weight.
        for m in range(starts[s], end):
            root = math.sqrt(weights[m])
            for i in range(3):
                residuals[m, i] = p[m, i] - c[s, i]
                r[3 * m + i] = root * residuals[m, i]
                for f in range(free):
                    rows[3 * m + i, f] = root * (J[m, index[f], i] - C[s, f, i])

    return residuals, r, rows, c, C


@kernel(signature=float64[:, ::1](_X4, _FLAGS, _T, _T, _T, _T))
def joint_loads(X, slides, forces, points, extra_forces, extra_points):
    """Load (M, n) of weights and buoyancy on each joint, along the joint's axis: [N m] for hinges,
    [N] for slides.

    Args:
        X: (M, n + 1, 4, 4) link frames, as `uuv.models.arms.kinematics.frames` returns them.
        slides: (n,) bool, True for a slide.
        forces: (n, B, 3) [N] on each link, in base axes.
        points: (n, B, 3) [m] where they act, fixed in frame k + 1.
        extra_forces: (M, E, 3) [N] of the payload, in base axes.
        extra_points: (M, E, 3) [m] where they act, fixed in frame n.

    Returns:
        Joint loads (M, n).
    """
    touches, n = X.shape[0], X.shape[1] - 1
    tau = np.zeros((touches, n))
    moment = np.empty(3)
    p = np.empty(3)
    zero = np.zeros(3)
    # resultant of all loads beyond the joint, and its moment about the base
    force = np.empty(3)
    about = np.empty(3)

    for m in range(touches):
        force[:] = 0.0
        about[:] = 0.0
        for k in range(n, 0, -1):
            # Bodies of link k; the last link also has those that differ from touch to touch.
            fixed = forces.shape[1]
            count = fixed + (extra_forces.shape[1] if k == n else 0)
            for b in range(count):
                f = forces[k - 1, b] if b < fixed else extra_forces[m, b - fixed]
                local = points[k - 1, b] if b < fixed else extra_points[m, b - fixed]
                for i in range(3):
                    p[i] = X[m, k, i, 3]
                    for j in range(3):
                        p[i] += X[m, k, i, j] * local[j]
                cross_into(moment, p, f, zero)
                force += f
                about += moment

            # Moment about the joint, along its axis.
            cross_into(moment, X[m, k - 1, :3, 3], force, zero)
            for i in range(3):
                tau[m, k - 1] += X[m, k - 1, i, 2] * (
                    force[i] if slides[k - 1] else about[i] - moment[i]
                )

    return tau


@kernel(signature=boolean(_M, _FLAGS, _M, _M, _V, _V, _M, float64[::1], boolean, int64))
def reach_pose(table, slides, X_base, X_flange, tcp, goal, R_goal, q, orient, iterations):
    """Inverse kinematics by damped least squares, for a tip at `goal` and optionally an
    orientation.

    Args:
        table: (n, 5) rows (theta0, d, a, alpha, beta).
        slides: (n,) bool, True for a slide.
        X_base: (4, 4) frame 0 in the base.
        X_flange: (4, 4) flange in the last frame.
        tcp: (3,) [m] tool point in the flange.
        goal: (3,) [m] tip position in the base.
        R_goal: (3, 3) orientation of the flange in the base.
        q: (n,) start, overwritten by the solution.
        orient: False solves for the position alone.
        iterations: largest number of steps.

    Returns:
        True if the tip is within 1e-11 m and 1e-6 rad.
    """
    n = len(q)
    rows = 6 if orient else 3
    R = np.empty((3, 3))
    o = np.empty(3)
    p = np.empty(3)
    axes = np.empty((n, 4, 3))
    J = np.zeros((rows, n))
    e = np.zeros(rows)
    column = np.empty(3)

    for _ in range(iterations):
        # Forward kinematics with the axes of the joints.
        R[:, :] = X_base[:3, :3]
        o[:] = X_base[:3, 3]
        for k in range(n):
            frame_step(R, o, table[k], q[k], slides[k], axes[k])
        F = R @ np.ascontiguousarray(X_flange[:3, :3])
        for i in range(3):
            p[i] = o[i]
            for j in range(3):
                p[i] += R[i, j] * X_flange[j, 3] + F[i, j] * tcp[j]

        # Error of position, and of orientation from the cross products of the frames' axes.
        e[:3] = goal - p
        if orient:
            e[3:] = 0.0
            for j in range(3):
                e[3] += 0.5 * (F[1, j] * R_goal[2, j] - F[2, j] * R_goal[1, j])
                e[4] += 0.5 * (F[2, j] * R_goal[0, j] - F[0, j] * R_goal[2, j])
                e[5] += 0.5 * (F[0, j] * R_goal[1, j] - F[1, j] * R_goal[0, j])

        # Convergence.
        turn = 0.0
        trace = 3.0
        if orient:
            turn = math.sqrt(e[3] ** 2 + e[4] ** 2 + e[5] ** 2)
            trace = np.sum(F * R_goal)
        if math.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2) < 1e-11 and turn < 1e-6 and trace > 0.0:
            return True

        # beyond 90 deg the sine decreases again, so the step gets full length
        if trace < 0.0 and turn > 0.0:
            for i in range(3):
                e[3 + i] /= turn

        # Jacobian of the tip.
        for k in range(n):
            z = axes[k, 0]
            if slides[k]:
                J[:3, k] = z
                if orient:
                    J[3:, k] = 0.0
            else:
                cross_into(column, z, p, axes[k, 1])
                J[:3, k] = column
                if orient:
                    J[3:, k] = z

        # Damped step; the damping falls with the error.
        H = J.T @ J
        damping = 1e-4 * min(1.0, e @ e) + 1e-14
        for k in range(n):
            H[k, k] += damping
        q += np.linalg.solve(H, J.T @ e)
    return False
