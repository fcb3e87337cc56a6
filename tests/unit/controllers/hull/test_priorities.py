"""Least squares by levels against SciPy's sequential programmes, Kuhn and Tucker's conditions, and
what order means.
"""

import itertools

import numpy as np
from scipy.optimize import linprog, lsq_linear, nnls

from uuv.controllers.hull.priorities import solve_levels
from uuv.sim.interfaces.spatial import Array


def random_layout(rng: np.random.Generator) -> tuple[Array, Array, np.ndarray, Array, Array, Array]:
    """A (6, m), b (6,), starts of levels, effort (m,), bounds (m,): 1 to 10 thrusters, some dead,
    some alike, some in rows of whole numbers so that levels and bounds meet exactly, some of low
    rank.
    """
    m = int(rng.integers(1, 11))
    A = rng.normal(size=(6, m)) * rng.uniform(0.1, 4.0, (6, 1))
    kind = rng.integers(4)
    if kind == 0:
        rank = min(int(rng.integers(1, 6)), m)
        A = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, m))
    elif kind == 1:
        A = np.round(A)
    low = -rng.uniform(1.0, 60.0, m)
    high = rng.uniform(1.0, 60.0, m)
    if rng.random() < 0.3:
        low = -high
    dead = rng.random(m) < 0.15
    low[dead] = high[dead] = 0.0
    cuts = np.sort(rng.choice(np.arange(1, 6), size=int(rng.integers(0, 6)), replace=False))
    b = rng.normal(size=6) * rng.choice([1.0, 50.0, 1000.0])
    return A, b, np.array([0, *cuts, 6]), rng.uniform(0.3, 3.0, m), low, high


def stationarity(A: Array, b: Array, above: Array, low: Array, high: Array, x: Array) -> float:
    """Least |A^T (A x - b) + above^T l + m| over all l and over m that press x on the bounds it
    lies on: zero at the minimum of |A x - b| within bounds and `above` x, and there only, for the
    problem is convex.
    """
    live = high > low
    close = 1e-9 * (high - low)
    eye = np.eye(len(x))
    pull = np.hstack(
        [above.T, -above.T, -eye[:, live & (x - low <= close)], eye[:, live & (high - x <= close)]]
    )[live]
    slope = (A.T @ (A @ x - b))[live]
    if not slope.size or not pull.size:
        return float(np.linalg.norm(slope))
    return float(nnls(pull, -slope, maxiter=10_000)[1])


def test_every_level_is_at_its_minimum_under_those_above(rng, within):
    bound = 0
    for _ in range(300):
        A, b, starts, effort, low, high = random_layout(rng)
        x = rng.normal(size=len(low)) * 100.0
        # measured up to 58 for ten thrusters
        assert solve_levels(A, b, starts, effort, low, high, x) < 30 * len(x)
        assert np.all((x >= low) & (x <= high))
        scale = np.abs(A).max() * (np.abs(b).max() + np.abs(A).max() * 60.0)
        for first, last in itertools.pairwise(starts):
            rest = stationarity(A[first:last], b[first:last], A[:first], low, high, x)
            within("level", rest / scale, 1e-12)  # measured 6e-15 in 3000
        within("effort", stationarity(np.diag(effort), 0.0 * x, A, low, high, x) / 600.0, 1e-12)
        bound += bool(np.any(((x == low) | (x == high)) & (high > low)))
    assert bound > 100


def test_one_level_is_bounded_least_squares(rng, within):
    for _ in range(100):
        A, b, _, effort, low, high = random_layout(rng)
        live = high > low
        if not live.any():
            continue
        x = np.zeros(len(low))
        solve_levels(A, b, np.array([0, 6]), effort, low, high, x)
        reference = lsq_linear(
            A[:, live], b, bounds=(low[live], high[live]), method="bvls", tol=1e-14, max_iter=1000
        )
        cost = float(np.sum((A @ x - b) ** 2))
        scale = float(b @ b) + float(np.sum(A**2)) * 60.0**2
        within("cost", (cost - 2.0 * reference.cost) / scale, 1e-12)


def test_axis_by_axis_is_what_linear_programmes_say_in_turn(rng, within):
    """Six levels of one row: min |a_l x - b_l| with all rows above held, by linear programmes that
    start afresh.
    """
    for _ in range(40):
        A, b, _, effort, low, high = random_layout(rng)
        m = len(low)
        x = np.zeros(m)
        solve_levels(A, b, np.arange(7), effort, low, high, x)
        for row in range(6):  # variables x and t >= |a x - b|
            over = np.column_stack([np.vstack([A[row], -A[row]]), [-1.0, -1.0]])
            held = np.column_stack([A[:row], np.zeros(row)]) if row else None
            least = linprog(
                np.append(np.zeros(m), 1.0),
                A_ub=over,
                b_ub=[b[row], -b[row]],
                A_eq=held,
                b_eq=A[:row] @ x if row else None,
                bounds=[*zip(low, high, strict=True), (0.0, None)],
            )
            # its own tolerance on the rows held; the conditions above are the exact test
            if least.status != 0:
                continue
            scale = np.abs(b[row]) + np.abs(A).sum() * 60.0
            # measured 3e-16; HiGHS: 1e-7
            within("row", (abs(A[row] @ x - b[row]) - least.fun) / scale, 1e-6)


def test_a_level_below_changes_nothing_above(rng, within):
    """What stands in the lower levels may change as it will: those above come out the same."""
    for _ in range(100):
        A, b, starts, effort, low, high = random_layout(rng)
        first, second = np.zeros(len(low)), np.zeros(len(low))
        solve_levels(A, b, starts, effort, low, high, first)
        level = int(rng.integers(1, len(starts)))
        other, wish = A.copy(), b.copy()
        other[starts[level] :] = rng.normal(size=(6 - starts[level], len(low)))
        wish[starts[level] :] = 40.0
        solve_levels(other, wish, starts, effort, low, high, second)
        change = A[: starts[level]] @ (first - second)
        within("levels above", change / (np.abs(A).sum() * 60.0), 1e-12)


def test_the_answer_changes_continuously_with_what_is_wanted(rng, within):
    """Along a line of wishes, looked at ever closer where the thrusts change most: a jump would
    stay a jump.
    """
    A = rng.normal(size=(6, 8))
    starts = np.array([0, 2, 5, 6])
    low = -rng.uniform(10.0, 60.0, 8)
    high = rng.uniform(10.0, 60.0, 8)
    effort = np.ones(8)
    start, end = rng.normal(size=(2, 6)) * 150.0
    change = np.inf
    left = 0.0
    right = 1.0
    for _ in range(5):
        shares = np.linspace(left, right, 201)
        xs = np.zeros((len(shares), 8))
        for s, x in zip(shares, xs, strict=True):
            solve_levels(A, start + s * (end - start), starts, effort, low, high, x)
        changes = np.abs(np.diff(xs, axis=0)).max(axis=1)
        i = int(changes.argmax())
        change = float(changes[i])
        width = shares[1] - shares[0]
        left = max(shares[i] - width, 0.0)
        right = min(shares[i + 1] + width, 1.0)
    within("change within 3e-10 of the line [N]", change, 5e-3)  # of 303 lines 5.2e-5 at most


def test_where_the_search_begins_makes_no_difference(rng, within):
    for _ in range(60):
        A, b, starts, effort, low, high = random_layout(rng)
        first, second = rng.normal(size=(2, len(low))) * 100.0
        for x in (first, second):
            solve_levels(A, b, starts, effort, low, high, x)
        rank_clear = np.linalg.matrix_rank(A, tol=1e-6) == np.linalg.matrix_rank(A)
        if rank_clear:
            within("thrusts [N]", first - second, 1e-7)  # measured 1e-12
