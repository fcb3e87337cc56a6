"""Motion of redundant joints away from singular postures and joint limits, with the tool at rest.

The clearance c of a posture is 1 / sqrt(trace((J J^T)^-1)), with lengths in J divided by the scale
of the chain. It is smooth, at most the smallest singular value of J, and 0 where the posture is
singular. With A = J J^T its gradient is

    dc/dq_k = c^3 tr(A^-2 dJ/dq_k J^T),

where dJ/dq_k follows from the columns of J: a hinge turns all that it carries. The arm moves up
this gradient as far as its tool stays where it is [Liegeois 1977].
"""

import math

import numpy as np

from uuv.controllers.ik.chain_kernels import (
    AXIS,
    HEAD,
    KIND,
    LOWER,
    PANTOGRAPH,
    SCALE,
    SLIDE,
    UPPER,
    column,
    jit,
    trace,
)
from uuv.controllers.ik.priorities import ZONE, out_of_the_zone

# Clearance under which the arm moves away from singular postures; the best of published arms of
# seven joints is 0.15 to 0.23.
NEAR = 0.2
SLOPE = 0.05  # [1/rad] relative gradient of the clearance, under which it moves more slowly
_LEAST = 1e-9  # added to the squares of the singular values


@jit
def spare_motion(table, q, work, blocked, rates):
    """Joint motion that leaves the tool where it is and leads to a clearer posture.

    It grows from zero at the clearance `NEAR`, and at the zones by the joint limits, to about one.

    Args:
        table: the chain.
        q: (n,) [rad] or [m] joint values.
        work: scratch values, overwritten.
        blocked: (6, 6) projector on the twists that the chain can never give its tool; zero where
            it can give all.
        rates: (n,) out; a slide's is in m, a hinge's in rad.

    Returns:
        The clearance.
    """
    n = q.shape[0]
    J = np.empty((6, n))
    A = np.empty((6, 6))
    inverse = np.empty((6, 6))
    scale = table[0, SCALE]

    # Jacobian, and the square of it
    px, py, pz, _, _, _, _, _, _, _, _, _ = trace(table, q, work)
    for j in range(n):
        J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j] = column(table, work, j, px, py, pz)
        if table[HEAD + j, KIND] == SLIDE:
            for r in range(3):
                J[r, j] /= scale

    never = 0.0
    for r in range(6):
        never += blocked[r, r]
        for s in range(6):
            A[r, s] = blocked[r, s] + (_LEAST if r == s else 0.0)
            for j in range(n):
                A[r, s] += J[r, j] * J[s, j]

    # Clearance
    _invert(A, inverse)
    total = -never
    for r in range(6):
        total += inverse[r, r]
    clearance = 1.0 / math.sqrt(total)

    # Up the gradient of the clearance, and out of the zones by the limits
    for j in range(n):
        rates[j] = 0.0
    if clearance < NEAR:
        _up_the_slope(table, work, J, inverse, rates)
        _at_rest(J, inverse, rates)

        # About unit length, but for slopes that lead nowhere: per radian of the clearance itself
        square = (SLOPE / clearance**2) ** 2
        for j in range(n):
            square += rates[j] * rates[j]
        for j in range(n):
            rates[j] *= (1.0 - clearance / NEAR) / math.sqrt(square)

    for j in range(n):
        low = table[HEAD + j, LOWER]
        high = table[HEAD + j, UPPER]
        if math.isfinite(high - low) and high > low:
            rates[j] += out_of_the_zone(q[j], low, high) / (ZONE * (high - low))

    _at_rest(J, inverse, rates)
    for j in range(n):
        if table[HEAD + j, KIND] == SLIDE:
            rates[j] /= scale

    return clearance


@jit
def _invert(A, inverse):
    """Inverse of a symmetric positive definite `A` (6, 6), which its Cholesky factor replaces."""
    for r in range(6):
        for s in range(r + 1):
            total = A[r, s]
            for k in range(s):
                total -= A[r, k] * A[s, k]
            A[r, s] = math.sqrt(total) if r == s else total / A[s, s]

    for c in range(6):
        for r in range(6):
            total = 1.0 if r == c else 0.0
            for k in range(r):
                total -= A[r, k] * inverse[k, c]
            inverse[r, c] = total / A[r, r]
        for r in range(5, -1, -1):
            total = inverse[r, c]
            for k in range(r + 1, 6):
                total -= A[k, r] * inverse[k, c]
            inverse[r, c] = total / A[r, r]


@jit
def _at_rest(J, inverse, rates):
    """Subtract from `rates` (n,) the part that moves the tool, `J.T @ inv(A) @ J @ rates`.

    Args:
        J: (6, n) Jacobian, scaled.
        inverse: (6, 6) of its square A.
        rates: (n,) updated.
    """
    n = rates.shape[0]
    twist = np.zeros(6)
    for r in range(6):
        for j in range(n):
            twist[r] += J[r, j] * rates[j]

    wrench = inverse @ twist
    for j in range(n):
        for r in range(6):
            rates[j] -= J[r, j] * wrench[r]


@jit
def _up_the_slope(table, work, J, inverse, slope):
    """Write into `slope` (n,) the gradient of the clearance, divided by the clearance cubed.

    Args:
        table: the chain.
        work: scratch values, as `trace` left them.
        J: (6, n) Jacobian, scaled.
        inverse: (6, 6) of its square A.
        slope: (n,) out.
    """
    n = slope.shape[0]
    steep = inverse @ (inverse @ J)

    for k in range(n):
        slope[k] = 0.0
        for j in range(n):
            # the joint that turns, and the column that turns or moves with it
            turn = k if k <= j else j
            other = j if k <= j else k
            w = J[3:, turn]
            if k == j and table[HEAD + k, KIND] == PANTOGRAPH:
                w = work[k, AXIS : AXIS + 3]
            for r in range(3):
                s = (r + 1) % 3
                t = (r + 2) % 3
                slope[k] += steep[r, j] * (w[s] * J[t, other] - w[t] * J[s, other])
                if k < j:
                    slope[k] += steep[3 + r, j] * (w[s] * J[3 + t, j] - w[t] * J[3 + s, j])
