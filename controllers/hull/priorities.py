"""Hierarchical least squares within bounds, in which no level is degraded in favour of a lower one.

Levels l = 1, 2, ... of rows A_l x = b_l are solved in this order [Escande 2014]. Level l minimises
|A_l x - b_l|^2 over low <= x <= high, with A_j x = A_j x_j kept for every level j above, where x_j
is the solution of level j. Here the bounds rank above all levels. A last, diagonal level (the
effort) makes the solution unique. The solution is continuous in b.

Each level is a primal active-set method on the bounds. It starts where the level above ended, so
every iterate is feasible and leaves the levels above unchanged. Steps are found by orthogonal
projection, never by normal equations.
"""

from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

# Axes of a wrench on the hull, hull axes, by priority: the first level is given up last if
# thrusters saturate.
PRIORITIES = (("roll", "pitch"), ("surge", "sway", "heave"), ("yaw",))
# Priorities after the loss of a thruster: a small tilt, which weight and buoyancy resist, is better
# than loss of depth control.
PRIORITIES_AFTER_LOSS = (("heave", "roll", "pitch"), ("surge", "sway"), ("yaw",))
# [-] share of a row's norm, below which its remainder after projection is rounding noise
_SAME = 1e-10
# [-] share of a unit step: below it the levels above fix a variable, and its bound adds no
# constraint
_HELD = 1e-9


@kernel
def solve_levels(A, b, starts, effort, low, high, x):
    """Solve least-squares priority levels, then the effort, within bounds; result in `x`.

    Args:
        A: (k, m) rows of all levels, the first level first.
        b: (k,) right sides.
        starts: (levels + 1,) level l is rows starts[l] to starts[l + 1].
        effort: (m,) diagonal of the last level.
        low: (m,) lower bounds.
        high: (m,) upper bounds; a variable with equal bounds is a constant.
        x: (m,) start of the search, clipped to the bounds; overwritten by the solution.

    Returns:
        The number of active-set steps.
    """
    k, m = A.shape
    rows = A.copy()
    right = b.copy()

    # Start within the bounds; constants move to the right sides.
    alive = 0
    for i in range(m):
        x[i] = min(max(x[i], low[i]), high[i])
        if low[i] == high[i]:
            for r in range(k):
                right[r] -= rows[r, i] * x[i]
                rows[r, i] = 0.0
        else:
            alive += 1

    # The levels in their order; the rows of each are kept for those below.
    kept = np.zeros((m, m))  # orthonormal rows that span those of the levels above
    count = steps = 0
    for level in range(starts.shape[0] - 1):
        first, last = starts[level], starts[level + 1]
        steps += _level(rows[first:last], right[first:last], kept, count, low, high, x)
        for r in range(first, last):
            if count < alive:
                count = _keep(rows[r], kept, count)

    # The effort decides the directions that the levels leave free.
    if count < alive:
        spare = np.zeros((m, m))
        none = np.zeros(m)
        for i in range(m):
            if low[i] != high[i]:
                spare[i, i] = effort[i]
        steps += _level(spare, none, kept, count, low, high, x)
    return steps


@kernel
def _keep(row, kept, count):
    """Append the part of `row` outside the span of the rows `kept`; returns the new number of
    rows.
    """
    m = row.shape[0]
    new = row.copy()

    length = _off(new, kept, count)
    if length > _SAME * np.sqrt((row * row).sum()):
        for i in range(m):
            kept[count, i] = new[i] / length
        return count + 1
    return count


@kernel
def _off(v, basis, count):
    """Remove from `v`, in place, its part in the span of the rows of `basis`, twice because of
    rounding; returns the norm.
    """
    m = v.shape[0]
    for _ in range(2):
        for j in range(count):
            along = 0.0
            for i in range(m):
                along += v[i] * basis[j, i]
            for i in range(m):
                v[i] -= along * basis[j, i]

    total = 0.0
    for i in range(m):
        total += v[i] * v[i]
    return np.sqrt(total)


class _Factors(NamedTuple):
    """Active bounds, and the factors over the variables without an active bound."""

    # (m,) int8: -1, 0 or 1; active bounds are independent of each other and of the kept rows
    at: np.ndarray
    U: Array  # (m, m) orthonormal rows: kept rows over the free variables = L U
    L: Array  # (m, m)
    V: Array  # (m, m) orthonormal rows: the part of A there outside their span = T V
    T: Array  # (k, m)


@kernel
def _level(A, b, kept, count, low, high, x):
    """Minimise |A x - b|^2 from `x` within bounds, with `kept[:count] @ x` unchanged; returns the
    number of steps.
    """
    k, m = A.shape
    at = np.zeros(m, dtype=np.int8)
    U, L, V, T = np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m)), np.zeros((k, m))
    factors = _Factors(at, U, L, V, T)
    residual, p, s = np.empty(k), np.empty(m), np.empty(m)

    # Measures of rounding: the longest row, for the rank, and the largest gradient.
    longest = 0.0
    for r in range(k):
        longest = max(longest, np.sqrt((A[r] * A[r]).sum()))
    if longest == 0.0:
        return 0
    scale = 0.0
    for r in range(k):
        reach = abs(b[r])
        for i in range(m):
            reach += abs(A[r, i]) * max(abs(low[i]), abs(high[i]))
        scale = max(scale, longest * reach)

    stuck = 0
    for step in range(30 * (m + 1)):
        # Residual at the present x.
        for r in range(k):
            total = -b[r]
            for i in range(m):
                total += A[r, i] * x[i]
            residual[r] = total

        # Kept rows over the free variables as L U, and the rows of A as T V.
        for j in range(count):
            for i in range(m):
                U[j, i] = kept[j, i] if at[i] == 0 and low[i] != high[i] else 0.0
            _split(U, j, L)
        rank = _beside(A, low, high, factors, count, longest)

        # Step to the minimum over the free variables.
        _least(T, residual, k, rank, s)
        for i in range(m):
            p[i] = 0.0
            for j in range(rank):
                p[i] += s[j] * V[j, i]

        # The first bound on the way to the minimum.
        share, hit = 1.0, -1
        for i in range(m):
            if at[i] != 0 or low[i] == high[i] or p[i] == 0.0:
                continue
            room = (high[i] - x[i]) / p[i] if p[i] > 0.0 else (low[i] - x[i]) / p[i]
            if room < share or (room == share and hit >= 0 and abs(p[i]) > abs(p[hit])):
                share, hit = max(room, 0.0), i

        for i in range(m):
            if at[i] == 0 and low[i] != high[i]:
                x[i] = min(max(x[i] + share * p[i], low[i]), high[i])

        # A bound was reached and becomes active.
        if hit >= 0:
            at[hit] = 1 if p[hit] > 0.0 else -1
            x[hit] = high[hit] if at[hit] > 0 else low[hit]
            stuck = stuck + 1 if share == 0.0 else 0
            continue

        # At the minimum: the active bound that is best released.
        release = _wrong_way(
            A, residual, s[:rank], kept[:count], factors, 1e-12 * scale, stuck > 2 * m
        )
        if release < 0:
            return step + 1
        at[release] = 0
    return 30 * (m + 1)


@kernel
def _split(U, j, L):
    """Orthonormalise row `j` of U against the rows before it; the coefficients are written into row
    `j` of L.
    """
    m = U.shape[1]
    for c in range(j + 1):
        L[j, c] = 0.0

    # Twice, against rounding.
    for _ in range(2):
        for c in range(j):
            along = 0.0
            for i in range(m):
                along += U[j, i] * U[c, i]
            L[j, c] += along
            for i in range(m):
                U[j, i] -= along * U[c, i]

    length = np.sqrt((U[j] * U[j]).sum())
    L[j, j] = length
    if length > 0.0:
        for i in range(m):
            U[j, i] /= length


@kernel
def _beside(A, low, high, factors, count, longest):
    """Factorise A over the free variables, outside the span of `count` rows of U, into T V; returns
    the rank.
    """
    k, m = A.shape
    at = factors.at
    U = factors.U
    V = factors.V
    T = factors.T
    G = np.empty((k, m))

    # Rows over the free variables, outside the span of U.
    for r in range(k):
        for i in range(m):
            G[r, i] = A[r, i] if at[i] == 0 and low[i] != high[i] else 0.0
        _off(G[r], U, count)

    rank = 0
    # pivoting: the longest remainder first, so that rank is judged against it
    while rank < min(k, m):
        most, which = 0.0, -1
        for r in range(k):
            length = (G[r] * G[r]).sum()
            if length > most:
                most, which = length, r
        most = np.sqrt(most)
        if most <= _SAME * longest:
            break

        for i in range(m):
            V[rank, i] = G[which, i] / most
        _off(V[rank], U, count)
        length = _off(V[rank], V, rank)
        for i in range(m):
            V[rank, i] /= length

        # Coefficients of all rows, and their remainder after the new direction.
        for r in range(k):
            along = 0.0
            for i in range(m):
                along += G[r, i] * V[rank, i]
            T[r, rank] = along
            for i in range(m):
                G[r, i] -= along * V[rank, i]
        rank += 1

    # Variables that the levels above fix do not move.
    for i in range(m):
        moves = 0.0
        for j in range(rank):
            moves += V[j, i] * V[j, i]
        if moves < _HELD * _HELD:
            for j in range(rank):
                V[j, i] = 0.0

    return rank


@kernel
def _least(T, residual, k, rank, s):
    """Minimise |T s + residual| over s (rank,), T of full column rank, by modified Gram-Schmidt."""
    Q = np.empty((rank, k))
    R = np.empty((rank, rank))
    right = residual.copy()

    # Columns: each orthonormalised twice, against rounding.
    for c in range(rank):
        for r in range(k):
            Q[c, r] = T[r, c]
        for d in range(c):
            R[d, c] = 0.0
        for _ in range(2):
            for d in range(c):
                along = 0.0
                for r in range(k):
                    along += Q[c, r] * Q[d, r]
                R[d, c] += along
                for r in range(k):
                    Q[c, r] -= along * Q[d, r]
        R[c, c] = np.sqrt((Q[c] * Q[c]).sum())
        for r in range(k):
            Q[c, r] /= R[c, c]

        # Projection of the right side.
        along = 0.0
        for r in range(k):
            along += Q[c, r] * right[r]
        s[c] = -along
        for r in range(k):
            right[r] -= along * Q[c, r]

    # Back substitution.
    for c in range(rank - 1, -1, -1):
        for d in range(c + 1, rank):
            s[c] -= R[c, d] * s[d]
        s[c] /= R[c, c]


@kernel
def _wrong_way(A, residual, s, kept, factors, enough, in_order):
    """Active bound whose release lowers the cost most, or the first such one if `in_order` [Bland
    1977]; -1 if none.
    """
    k, m = A.shape
    rank = s.shape[0]
    count = kept.shape[0]
    at = factors.at
    U = factors.U
    L = factors.L
    T = factors.T
    gradient = np.zeros(m)
    multiplier = np.zeros(m)

    # Gradient of the cost.
    for r in range(k):
        now = residual[r]  # residual after the step just taken
        for j in range(rank):
            now += T[r, j] * s[j]
        for i in range(m):
            gradient[i] += A[r, i] * now

    # Multipliers of the kept rows.
    for j in range(count - 1, -1, -1):  # L^T multiplier = -U gradient
        total = 0.0
        for i in range(m):
            total -= U[j, i] * gradient[i]
        for c in range(j + 1, count):
            total -= L[c, j] * multiplier[c]
        multiplier[j] = total / L[j, j]

    # Slope of the Lagrangian along each active bound.
    worst, release = enough, -1
    for i in range(m):
        if at[i] == 0:
            continue
        slope = gradient[i]
        for j in range(count):
            slope += kept[j, i] * multiplier[j]
        pull = -slope if at[i] < 0 else slope
        if pull > worst:
            release = i
            if in_order:
                break
            worst = pull
    return release
