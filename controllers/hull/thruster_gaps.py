"""Gaps of thrusters: search of the nearest possible thrusts, if a rotating propeller gives at least
a minimal thrust.

A rotating propeller gives at least a minimal thrust (`uuv.models.water.thrusters`). Thrusts between
zero and that minimum are impossible (the gap), so the problem is not convex. With a thruster in its
gap, the wrench that the priority levels have chosen is approximated by weighted least squares, |W
(B x - w)|^2 + e^2 |D x|^2. Weights spread the small remaining error over all axes instead of
putting all of it on one:

- With more thrusters than directions, some work against each other (preload). All such sign
  patterns are tried in a fixed order until one gives the wrench as accurately as without a gap. The
  fixed order keeps the pattern from changing between steps.
- Otherwise thrusters in the gap are fixed one at a time, first the one nearest to a possible
  thrust; after each, the others are solved again. Then each thruster is tried on its other branches
  as long as that lowers the cost.

This is a search by single changes: its wrench error may exceed the least possible one. It has no
memory, so a thrust near the middle of a gap may chatter.
"""

import itertools

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_ROUNDS = 4  # maximal number of passes over all thrusters in search of a better branch
_EFFORT = 1e-10  # [-] weight of the effort, relative to the mean diagonal of A^T A
# number of directions of the null space from which sign patterns are made, each with a factor 1, 0
# or -1
_MIXES = 3
MOST_PATTERNS = 3**_MIXES


def preloads(B: Array) -> np.ndarray:
    """Sign patterns (p, m), 1 or -1 each, with which the thrusters of `B` (k, m) oppose each other.

    These are the signs of thrusts in the null space of B, sampled in a few of its directions. p = 0
    if B has no null space, or if the null space has no component for some thruster.
    """
    null = np.linalg.svd(B)[2][np.linalg.matrix_rank(B) :]
    found: list[tuple[int, ...]] = []
    for mix in itertools.product((1, 0, -1), repeat=min(len(null), _MIXES)):
        along = np.array(mix) @ null[:_MIXES]
        signs = tuple(np.sign(along).astype(int).tolist())
        if np.all(np.abs(along) > 1e-6) and signs not in found:
            found.append(signs)
    return np.array(sorted(found), dtype=np.int64).reshape(-1, B.shape[1])


def normal_equations(A: Array, effort: Array) -> tuple[Array, Array]:
    """Normal equations of min |A x - b|^2 + e^2 |effort x|^2: the matrix (m, m), and A^T (m, k).

    A^T b is the right side. `e` is so small that `effort` (m,) only decides among solutions that
    are equal for `A` (k, m).
    """
    H = A.T @ A
    return H + _EFFORT * np.trace(H) / len(H) * np.diag(effort**2 / np.mean(effort**2)), A.T.copy()


@kernel
def bounded(H, c, low, high, x):
    """Minimise x^T H x / 2 - c^T x over low <= x <= high by a primal active-set method, into `x`.

    Each step solves for the free variables, and moves to this solution or to the first bound on the
    way. At a minimum of the free variables, the bound variable with the steepest inward descent is
    set free. The cost falls with every step, so no active set occurs twice.

    Args:
        H: (m, m) positive definite.
        c: (m,) linear term.
        low: (m,) lower bounds.
        high: (m,) upper bounds.
        x: (m,) output; its content on entry is ignored.

    Returns:
        The number of steps.
    """
    m = c.shape[0]
    at = np.zeros(m, dtype=np.int8)
    L = np.empty((m, m))
    z = np.empty(m)
    free = np.empty(m, dtype=np.int64)
    scale = 0.0
    for i in range(m):
        scale = max(scale, abs(c[i]), H[i, i] * max(abs(low[i]), abs(high[i])))

    first = True
    steps = 0
    while steps < 20 * (m + 1):
        steps += 1
        count = 0
        for i in range(m):
            if at[i] == 0:
                free[count] = i
                count += 1
        _solve_free(H, c, x, free, count, L, z)

        # Initial active set: the variables whose free minimum lies beyond their bounds.
        if first:
            first = False
            outside = False
            for i in range(m):
                x[i] = min(max(z[i], low[i]), high[i])
                if z[i] < low[i]:
                    at[i] = -1
                    outside = True
                elif z[i] > high[i]:
                    at[i] = 1
                    outside = True
            if outside:
                continue
            return steps

        # Move towards the minimum as far as the bounds allow.
        share = 1.0
        hit = -1
        for a in range(count):
            i = free[a]
            if z[a] < low[i]:
                s = (low[i] - x[i]) / (z[a] - x[i])
            elif z[a] > high[i]:
                s = (high[i] - x[i]) / (z[a] - x[i])
            else:
                continue
            if s < share or hit < 0:
                share = max(s, 0.0)
                hit = i
        for a in range(count):
            i = free[a]
            x[i] += share * (z[a] - x[i])
            if share == 1.0 and hit < 0:
                x[i] = z[a]
        if hit >= 0:
            at[hit] = -1 if x[hit] - low[hit] < high[hit] - x[hit] else 1
            x[hit] = low[hit] if at[hit] < 0 else high[hit]
            continue

        # At the minimum: choose the bound to release.
        worst = 1e-13 * scale
        release = -1
        for i in range(m):
            if at[i] == 0 or low[i] == high[i]:
                continue
            slope = -c[i]
            for j in range(m):
                slope += H[i, j] * x[j]
            pull = -slope if at[i] < 0 else slope
            if pull > worst:
                worst = pull
                release = i
        if release < 0:
            break
        at[release] = 0
    return steps


@kernel
def _solve_free(H, c, x, free, count, L, z):
    """Minimise over the `count` variables in `free`, with the others held; the result is written to
    `z`, in the order of `free`.
    """
    m = c.shape[0]
    for a in range(count):
        # Right side, less the part of the variables that are held.
        i = free[a]
        total = c[i]
        held = 0
        for j in range(m):
            if held < count and free[held] == j:
                held += 1
            else:
                total -= H[i, j] * x[j]
        z[a] = total

        # Row of the Cholesky factor L, and forward substitution.
        for b in range(a + 1):
            total = H[i, free[b]]
            for k in range(b):
                total -= L[a, k] * L[b, k]
            L[a, b] = np.sqrt(total) if a == b else total / L[b, b]
        for k in range(a):
            z[a] -= L[a, k] * z[k]
        z[a] /= L[a, a]

    # Back substitution.
    for a in range(count - 1, -1, -1):
        for k in range(a + 1, count):
            z[a] -= L[k, a] * z[k]
        z[a] /= L[a, a]


@kernel
def nearest_thrusts(H, c, low, high, least, patterns):
    """Thrusts of least cost x^T H x / 2 - c^T x within bounds, each zero or at least its minimum.

    If a thruster is in its gap, the cost is near the least one; the search is described in the
    module's docstring.

    Args:
        H: (m, m) matrix of `normal_equations`.
        c: (m,) right side, A^T b.
        low: (m,) [N] lower bounds.
        high: (m,) [N] upper bounds.
        least: (m,) [N] minimal thrust of each rotating propeller, in both directions; 0 for a
            thruster without a gap.
        patterns: (p, m) sign patterns of `preloads`.

    Returns:
        Thrusts (m,) [N].
    """
    m = c.shape[0]
    x = np.zeros(m)
    y = np.zeros(m)

    # Without the gaps: a lower bound of the cost, and the accepted difference from it.
    bounded(H, c, low, high, x)
    free = _cost(H, c, x)
    from_ = low.copy()
    to = high.copy()
    enough = 0.0
    for i in range(m):
        enough = max(enough, 1e-6 * H[i, i] * least[i] ** 2)
    met = False

    # One thruster after another, first the one nearest to a possible thrust.
    while True:
        nearest = np.inf
        which = -1
        for i in range(m):
            if from_[i] == to[i] or abs(x[i]) >= least[i] * (1.0 - 1e-9):
                continue
            distance = min(abs(x[i]), least[i] - abs(x[i])) / least[i]
            if distance < nearest:
                nearest = distance
                which = i
        if which < 0:
            break

        # At first all sign patterns.
        if not met:
            for row in range(patterns.shape[0]):
                for i in range(m):
                    _limit(patterns[row, i], low[i], high[i], least[i], from_, to, i)
                bounded(H, c, from_, to, y)
                if _cost(H, c, y) - free <= enough:
                    return y
            from_[:] = low
            to[:] = high
            met = True

        # Its branch.
        branch = 0 if abs(x[which]) < 0.5 * least[which] else int(np.sign(x[which]))
        _limit(branch, low[which], high[which], least[which], from_, to, which)
        bounded(H, c, from_, to, x)

    # Changes of single branches, as long as they lower the cost.
    best = _cost(H, c, x)
    for _ in range(_ROUNDS if met else 0):
        better = False
        for i in range(m):
            _limit(int(np.sign(x[i])), low[i], high[i], least[i], from_, to, i)
        for i in range(m):
            for other in range(-1, 2):
                kept = int(np.sign(x[i]))
                if least[i] == 0.0 or other == kept:
                    continue
                _limit(other, low[i], high[i], least[i], from_, to, i)
                bounded(H, c, from_, to, y)
                cost = _cost(H, c, y)
                if cost < best - 1e-12 * abs(best):
                    best = cost
                    better = True
                    x[:] = y
                else:
                    _limit(kept, low[i], high[i], least[i], from_, to, i)
        if not better:
            break
    return x


@kernel
def _limit(branch, low, high, least, from_, to, i):
    """Set the bounds `from_`, `to` of thruster `i` on a branch: -1 reverse, 0 off, 1 forward."""
    if least == 0.0:  # this thruster has no gap
        from_[i] = low
        to[i] = high
        return
    from_[i] = low if branch < 0 else least if branch > 0 else 0.0
    to[i] = high if branch > 0 else -least if branch < 0 else 0.0


@kernel
def _cost(H, c, x):
    total = 0.0
    for i in range(c.shape[0]):
        total -= c[i] * x[i]
        for j in range(c.shape[0]):
            total += 0.5 * x[i] * H[i, j] * x[j]
    return total
