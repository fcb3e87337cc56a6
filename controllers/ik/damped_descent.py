"""Compiled loops of the hybrid method: Levenberg-Marquardt, after a sweep where it pays off.

Arrays are those of `uuv.controllers.ik.chain_kernels`.
"""

import math
from typing import NamedTuple

import numpy as np

from uuv.controllers.ik.chain_kernels import (
    ALONG,
    BAD_TARGET,
    BEST,
    BRANCH_LOST,
    CONVERGED,
    EXHAUSTED,
    HEAD,
    KIND,
    LOWER,
    OUT_OF_REACH,
    SLIDE,
    STALLED,
    STEP,
    SWEEPS,
    THROUGH,
    TWO_PI,
    UPPER,
    WITHIN,
    admit,
    begin,
    branch_left,
    column,
    drawn_in,
    errors,
    fold,
    hand_over,
    jit,
    note,
    partition,
    reach_fault,
    scatter,
    trace,
)
from uuv.controllers.ik.pose_parts import (
    PartsNear,
    Weights,
    judged_by,
    measured,
    nearest_corner,
    options_good,
    parts_at,
    scaled_weights,
    tool_axis,
    weighted_column,
    within,
)
from uuv.controllers.ik.sweeps import sweep

# Tuned on several arms; success rates and times change little within a factor of two of each value.
DAMPING = 0.1  # share of the squared error that is the damping
LONG_STEP = 1.5  # [rad] longest step of a joint
SHORT_STEP = 0.5  # [rad] the same while keeping the branch
CORNERS = 4  # corners of the limits tried as last starts
CORNERED = 10  # largest number of joints for that
# [rad] or [m] beyond the limits, from where a solution that ignored them is drawn onto them
BEYOND = 1.0
FAR = 0.1  # squared error of a start, above which a sweep before the descent pays off
FAR_WEIGHT = 0.1  # [1/rad^2] weight of the tool axes against the scaled position in that sweep
STALL_WINDOW = 4  # [steps] a descent stalls if in so many its error does not
STALL_FACTOR = 0.5  # fall to this times itself
SETTLE_STEPS = 200  # largest number of steps of `settle`
SETTLE_GAIN = 1e-7  # relative gain in squared error, under which a step of `settle` counts as quiet
TRADES = 12  # largest number of times that `trade` changes the weights
LEAST_RATIO = 1e-2  # least factor of the square of a weight in one trade
# largest sum of squares after `settle`, over that of the tolerances, that a trade may still mend
ALLOWED = 1.2
MOST_AFTER = (1 + TRADES) * SETTLE_STEPS  # largest number of steps after the iterations have ended
KEPT = 0  # column of `past` in which `trade` keeps joint values


class Pace(NamedTuple):
    """Steps that a descent may take."""

    limit: int  # largest number
    cap: float  # [rad] or [m] longest step of a joint
    # ALONG moves within the limits without jumps. WITHIN also jumps by whole turns. THROUGH lets
    # hinges pass their limits on the way; only the solution must lie within them.
    mode: int


@jit
def damped_step(views, limited, damping, tip, error, weights):
    """Levenberg-Marquardt step dq = J^T (J J^T + damping)^-1 e into `work[:, STEP]`.

    A joint that stands on a limit and would leave its range is removed from the problem: its column
    is set to zero.

    Args:
        views: memory of the chain, its work as `trace` left it; columns 0 to 5 and STEP are
            overwritten.
        limited: the limits of hinges count; those of slides always do.
        damping: added to the diagonal of J J^T.
        tip: the tip at the joint values of `views`.
        error: e, as of `measured`.
        weights: of the parts of the error, or None.

    Returns:
        Largest absolute entry of the step.
    """
    table, _, _, work, _, q = views
    px, py, pz = tip[0], tip[1], tip[2]
    ex, ey, ez, wx, wy, wz = error
    n = q.shape[0]

    # Lower half of J J^T, row by row. Scalars stay in registers: twice as fast as an array.
    none = damping - damping
    z = none, none, none
    if weights is not None:
        z = tool_axis(table, tip)
    a10 = a20 = a21 = a30 = a31 = a32 = a40 = a41 = a42 = a43 = a50 = a51 = a52 = a53 = a54 = none
    a00 = a11 = a22 = a33 = a44 = a55 = damping

    # Columns of J, zero for a joint that would leave its range
    for i in range(n):
        c0, c1, c2, c3, c4, c5 = column(table, work, i, px, py, pz)
        if weights is not None:
            c0, c1, c2, c3, c4, c5 = weighted_column((c0, c1, c2, c3, c4, c5), z, weights)
        if limited or table[HEAD + i, KIND] == SLIDE:
            slope = c0 * ex + c1 * ey + c2 * ez + c3 * wx + c4 * wy + c5 * wz
            if (slope < none and q[i] <= table[HEAD + i, LOWER]) or (
                slope > none and q[i] >= table[HEAD + i, UPPER]
            ):
                c0 = c1 = c2 = c3 = c4 = c5 = none
        work[i, 0], work[i, 1], work[i, 2], work[i, 3], work[i, 4], work[i, 5] = (
            c0,
            c1,
            c2,
            c3,
            c4,
            c5,
        )

        # J J^T, the sum of c c^T
        a00 += c0 * c0
        a10 += c1 * c0
        a11 += c1 * c1
        a20 += c2 * c0
        a21 += c2 * c1
        a22 += c2 * c2
        a30 += c3 * c0
        a31 += c3 * c1
        a32 += c3 * c2
        a33 += c3 * c3
        a40 += c4 * c0
        a41 += c4 * c1
        a42 += c4 * c2
        a43 += c4 * c3
        a44 += c4 * c4
        a50 += c5 * c0
        a51 += c5 * c1
        a52 += c5 * c2
        a53 += c5 * c3
        a54 += c5 * c4
        a55 += c5 * c5

    # L D L^T factorisation by columns, l = a / d; forward substitution of the right-hand side in
    # the same pass.
    unit = table.dtype.type(1.0)
    # Column 0
    d = unit / a00
    l1, l2, l3, l4, l5 = a10 * d, a20 * d, a30 * d, a40 * d, a50 * d
    a11 -= l1 * a10
    a21 -= l2 * a10
    a22 -= l2 * a20
    a31 -= l3 * a10
    a32 -= l3 * a20
    a33 -= l3 * a30
    a41 -= l4 * a10
    a42 -= l4 * a20
    a43 -= l4 * a30
    a44 -= l4 * a40
    a51 -= l5 * a10
    a52 -= l5 * a20
    a53 -= l5 * a30
    a54 -= l5 * a40
    a55 -= l5 * a50

    y0 = ex
    y1 = ey - l1 * ex
    y2 = ez - l2 * ex
    y3 = wx - l3 * ex
    y4 = wy - l4 * ex
    y5 = wz - l5 * ex
    y0 *= d

    # Column 1
    d = unit / a11
    m2, m3, m4, m5 = a21 * d, a31 * d, a41 * d, a51 * d
    a22 -= m2 * a21
    a32 -= m3 * a21
    a33 -= m3 * a31
    a42 -= m4 * a21
    a43 -= m4 * a31
    a44 -= m4 * a41
    a52 -= m5 * a21
    a53 -= m5 * a31
    a54 -= m5 * a41
    a55 -= m5 * a51
    y2 -= m2 * y1
    y3 -= m3 * y1
    y4 -= m4 * y1
    y5 -= m5 * y1
    y1 *= d

    # Column 2
    d = unit / a22
    n3, n4, n5 = a32 * d, a42 * d, a52 * d
    a33 -= n3 * a32
    a43 -= n4 * a32
    a44 -= n4 * a42
    a53 -= n5 * a32
    a54 -= n5 * a42
    a55 -= n5 * a52
    y3 -= n3 * y2
    y4 -= n4 * y2
    y5 -= n5 * y2
    y2 *= d

    # Column 3
    d = unit / a33
    o4, o5 = a43 * d, a53 * d
    a44 -= o4 * a43
    a54 -= o5 * a43
    a55 -= o5 * a53
    y4 -= o4 * y3
    y5 -= o5 * y3
    y3 *= d

    # Column 4
    d = unit / a44
    p5 = a54 * d
    a55 -= p5 * a54
    y5 -= p5 * y4
    y4 *= d

    # Back substitution
    y5 /= a55
    y4 -= p5 * y5
    y3 -= o4 * y4 + o5 * y5
    y2 -= n3 * y3 + n4 * y4 + n5 * y5
    y1 -= m2 * y2 + m3 * y3 + m4 * y4 + m5 * y5
    y0 -= l1 * y1 + l2 * y2 + l3 * y3 + l4 * y4 + l5 * y5

    # dq = J^T y
    largest = none
    for i in range(n):
        step = (
            work[i, 0] * y0
            + work[i, 1] * y1
            + work[i, 2] * y2
            + work[i, 3] * y3
            + work[i, 4] * y4
            + work[i, 5] * y5
        )
        work[i, STEP] = step
        largest = max(largest, abs(step))
    return largest


@jit
def take_step(table, cap, largest, mode, work, q):
    """Move `q` by `work[:, STEP]`, scaled to a longest joint step, with the limits of `mode`.

    Args:
        table: the chain.
        cap: [rad] or [m] longest step of a joint.
        largest: largest absolute entry of the step.
        mode: ALONG, WITHIN or THROUGH, see `descend`.
        work: scratch values with the step.
        q: (n,) joint values, changed in place.
    """
    real = q.dtype.type
    limited = mode != THROUGH
    factor = real(1.0) if largest <= real(cap) else real(cap) / largest

    for i in range(q.shape[0]):
        value = q[i] + factor * work[i, STEP]
        row = table[HEAD + i]
        slide = row[KIND] == SLIDE
        if limited or slide:
            value = admit(value, row[LOWER], row[UPPER], mode == WITHIN and not slide, real(TWO_PI))
        q[i] = value


@jit
def descend(views, near, weights, pace, best2, trail, row):
    """Levenberg-Marquardt steps from `views.q` until the pose is met or the error stalls.

    A stall is a squared error that does not fall to STALL_FACTOR times itself in STALL_WINDOW
    steps.

    Args:
        views: memory of the chain. Its `q` is the start, on return the joint values of the last
            result. Column BEST of its work takes joint values whose error is under `best2` and
            which are within the limits.
        near: errors within which the pose is met, `Near` or `PartsNear`.
        weights: of the parts of the error; None where `near` is `Near`.
        pace: most steps, their length, and the treatment of the limits.
        best2: least squared error so far.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        row: first row of `trail` to write.

    Returns:
        (code, steps, least squared error, squared errors as in `near`).
    """
    table, goal, _, work, _, q = views
    real = q.dtype.type
    limited = pace.mode != THROUGH

    # The damping must exceed the rounding of J J^T, or a singular J J^T is no longer positive
    # definite.
    floor = real(4.0) * np.finfo(q.dtype).eps
    mark = real(np.inf)
    steps = 0

    while True:
        note(q, trail, row + steps)
        tip = trace(table, q, work)
        error, error2, left = measured(table, goal, tip, weights)

        if within(left, near):
            code = CONVERGED if limited or fold(table, q) else STALLED
            return code, steps, best2, left

        # Best joint values so far, within the limits only
        if limited and error2 < best2:
            best2 = error2
            for i in range(q.shape[0]):
                work[i, BEST] = q[i]

        # Stalled: the error against that of STALL_WINDOW steps before
        if steps % STALL_WINDOW == 0:
            if not error2 < real(STALL_FACTOR) * mark:
                return STALLED, steps, best2, left
            mark = error2

        if steps >= pace.limit:
            return EXHAUSTED, steps, best2, left

        damping = real(DAMPING) * error2 + floor
        largest = damped_step(views, limited, damping, tip, error, weights)
        take_step(table, pace.cap, largest, pace.mode, work, q)
        steps += 1


@jit
def settle(views, near, weights, trail, row):
    """Descend from the best joint values to the nearest local minimum within the limits.

    The error never grows.

    Args:
        views: memory of the chain; column BEST of its work holds the best joint values, `q` takes
            the result.
        near: errors within which the pose is met, `Near` or `PartsNear`.
        weights: of the parts of the error; None where `near` is `Near`.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        row: first row of `trail` to write.

    Returns:
        (code, steps, squared errors as in `near`).
    """
    table, goal, _, work, _, q = views
    real = q.dtype.type
    n = q.shape[0]

    for i in range(n):
        q[i] = work[i, BEST]

    share = real(DAMPING)
    best2 = real(np.inf)
    quiet = 0
    steps = 0
    while steps < SETTLE_STEPS and quiet < 4 and share < real(1e6):
        note(q, trail, row + steps)
        tip = trace(table, q, work)
        error, error2, left = measured(table, goal, tip, weights)

        if within(left, near):
            return CONVERGED, steps, left

        # A better pose is kept, and the next step damped less
        if error2 < best2:
            quiet = quiet + 1 if error2 > (real(1.0) - real(SETTLE_GAIN)) * best2 else 0
            best2 = error2
            for i in range(n):
                work[i, BEST] = q[i]
            share = max(share * real(0.2), real(1e-9))
        else:  # the step was too long: go back and take a shorter one
            share *= real(5.0)
            for i in range(n):
                q[i] = work[i, BEST]
            tip = trace(table, q, work)
            error, _, _ = measured(table, goal, tip, weights)

        damping = share * best2 + real(4.0) * np.finfo(q.dtype).eps
        largest = damped_step(views, True, damping, tip, error, weights)
        take_step(table, SHORT_STEP, largest, ALONG, work, q)
        steps += 1

    for i in range(n):
        q[i] = work[i, BEST]
    return STALLED, steps, measured(table, goal, trace(table, q, work), weights)[2]


@jit
def trade(views, near, weights, trail, row):
    """Trade one part of the error against another at the edge of reach, until each is in tolerance.

    The least sum of squares may exceed one tolerance where another is not used up. Lawson's rule
    for a least largest error [Lawson 1961] is to multiply the square of a weight by the error over
    its tolerance and to minimise again. A weighted sum of squares whose least value exceeds that of
    the tolerances themselves proves that no pose nearby is within all of them.

    Args:
        views: memory of the chain. Column BEST of its work holds joint values of the least sum of
            squares; `q` takes the result, which without success are the same joint values.
        near: `PartsNear`.
        weights: of the sum of squares that is the least at BEST.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        row: first row of `trail` to write.

    Returns:
        (code, steps, squared errors as in `near`).
    """
    table, goal, _, work, past, q = views
    real = q.dtype.type
    none = real(0.0)
    unit = real(1.0)
    least = real(LEAST_RATIO)
    for i in range(q.shape[0]):
        past[i, KEPT] = q[i] = work[i, BEST]
    left = first = parts_at(table, goal, q, work)

    # Squares of tolerances and weights: position, tool axis (or the whole rotation), turn.
    whole = near.chord2 < real(np.inf)
    near_p = near.p2
    near_a = near.chord2 if whole else near.axis2
    near_t = unit if whole else near.turn2
    p = weights.position**2
    a = weights.axis**2
    t = none if whole else weights.turn**2
    near_p = near_p if p > none else unit
    near_a = near_a if a > none else unit
    near_t = near_t if t > none else unit

    steps = 0
    for _ in range(TRADES):
        a2, t2 = left[1] if whole else left[2], left[3]
        if p * left[0] + a * a2 + t * t2 > real(ALLOWED) * (p * near_p + a * near_a + t * near_t):
            break

        # Lawson's rule: the square of a weight times error over tolerance
        p *= max(math.sqrt(left[0] / near_p), least)
        a *= max(math.sqrt(a2 / near_a), least)
        t *= max(math.sqrt(t2 / near_t), least)

        traded = scaled_weights(table, p, a, a if whole else t)
        code, spent, left = settle(views, near, traded, trail, row + steps)
        steps += spent
        if code == CONVERGED:
            return CONVERGED, steps, left

    for i in range(q.shape[0]):
        work[i, BEST] = q[i] = past[i, KEPT]
    return STALLED, steps, first


@jit
def finish(views, near, weights, trail, row):
    """End a search without success, at the nearest pose or within tolerance at the edge of reach.

    Args:
        views: memory of the chain; column BEST of its work holds the best joint values, `q` takes
            the result.
        near: errors within which the pose is met, `Near` or `PartsNear`.
        weights: of the parts of the error; None where `near` is `Near`.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        row: first row of `trail` to write.

    Returns:
        (code, steps, squared position error, squared chord of the whole rotation).
    """
    code, steps, left = settle(views, near, weights, trail, row)
    p2, chord2 = left[:2]

    if code == CONVERGED:
        return code, steps, p2, chord2

    real = views.q.dtype.type
    if weights is None:
        unit = real(1.0)
        unbounded = real(np.inf)
        code, spent, left = trade(
            views,
            PartsNear(near.p2, near.chord2, unbounded, unbounded),
            Weights(unit, unit, unit),
            trail,
            row + steps,
        )
    else:
        code, spent, left = trade(views, near, weights, trail, row + steps)
    return code, steps + spent, left[0], left[1]


@jit
def solve_hybrid(memory, X, q0, settings, parts, trail, out):
    """Hybrid method: a combined sweep from a far start, Levenberg-Marquardt, then restarts.

    Every second restart lets hinges pass their limits on the way (THROUGH). A solution not far
    beyond the limits is drawn onto them and followed along them. The last starts are corners of the
    limits.

    Args:
        memory: kernel memory of the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] or [m] start.
        settings: tolerances and limits of the iterations.
        parts: `PartTolerances`, for a pose of which not all counts alike; else None.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        out: (n,) takes the solution.

    Returns:
        (code, steps, restarts, position error [m], orientation error [rad]).
    """
    views = partition(memory, out.shape[0])
    table, goal, _, work, _, q = views
    limit = settings.limit
    restarts = settings.restarts

    fault = begin(table, X, q0, options_good(settings, parts), True, goal, work, q)
    if fault >= BAD_TARGET:
        return fault, 0, 0, 0.0, 0.0

    real = q.dtype.type
    near, weights = judged_by(table, settings, parts)

    if parts is not None:
        fault = reach_fault(table, goal, settings.tol_p)

    if fault == OUT_OF_REACH:
        restarts = min(restarts, 4)

    steps = 0
    restart = 0
    best2 = real(np.inf)
    while True:
        mode = WITHIN if restart % 2 == 0 else THROUGH

        # A sweep first, from a far start
        if parts is None and restart == 0 and table[1, SWEEPS] > 0.0:
            p2, chord2 = errors(table, goal, q, work)
            if p2 + chord2 > real(FAR):
                note(q, trail, steps)
                sweep(table, goal, real(FAR_WEIGHT), mode, q, work)
                steps += 1

        pace = Pace(limit - steps, LONG_STEP, mode)
        code, spent, best2, left = descend(views, near, weights, pace, best2, trail, steps)
        steps += spent

        # met, but beyond limits
        if code == STALLED and within(left, near) and drawn_in(table, q, real(BEYOND)):
            pace = Pace(limit - steps, SHORT_STEP, ALONG)
            code, spent, best2, left = descend(views, near, weights, pace, best2, trail, steps)
            steps += spent

        if code == CONVERGED or steps >= limit or restart >= restarts:
            break
        restart += 1
        scatter(table, restart, work, q)

    # The last starts: corners of the limits
    corner = 0
    above = real(-1.0)
    while code == STALLED and corner < CORNERS and q.shape[0] <= CORNERED and fault != OUT_OF_REACH:
        above = nearest_corner(table, goal, weights, above, work, q)
        if not above < real(np.inf) or steps >= limit:
            break

        pace = Pace(limit - steps, SHORT_STEP, ALONG)
        code, spent, best2, left = descend(views, near, weights, pace, best2, trail, steps)
        steps += spent
        corner += 1

    p2, chord2 = left[:2]
    if code != CONVERGED:
        code, spent, p2, chord2 = finish(views, near, weights, trail, steps)
        if code != CONVERGED:
            code = (
                OUT_OF_REACH if fault == OUT_OF_REACH else EXHAUSTED if steps >= limit else STALLED
            )
        steps += spent

    return hand_over(table, q, p2, chord2, code, steps, restart + corner, out)


@jit
def solve_keep(memory, X, q0, settings, parts, trail, out):
    """Branch-keeping method: Levenberg-Marquardt by short steps from `q0`, no jumps, no restarts.

    Args:
        memory: kernel memory of the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] or [m] start.
        settings: tolerances and limit of the steps; the restarts are only validated.
        parts: `PartTolerances`, for a pose of which not all counts alike; else None.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        out: (n,) takes the solution.

    Returns:
        As `solve_hybrid`.
    """
    views = partition(memory, out.shape[0])
    table, _, _, work, _, q = views
    fault = begin(table, X, q0, options_good(settings, parts), False, views.goal, work, q)
    if fault >= BAD_TARGET:
        return fault, 0, 0, 0.0, 0.0

    near, weights = judged_by(table, settings, parts)
    if parts is not None:
        fault = reach_fault(table, views.goal, settings.tol_p)

    unknown = q.dtype.type(np.inf)
    pace = Pace(settings.limit, SHORT_STEP, ALONG)
    code, steps, _, left = descend(views, near, weights, pace, unknown, trail, 0)

    p2, chord2 = left[:2]
    if code != CONVERGED:
        stopped = EXHAUSTED if code == EXHAUSTED else STALLED
        code, spent, p2, chord2 = finish(views, near, weights, trail, steps)
        steps += spent
        if code != CONVERGED:
            code = OUT_OF_REACH if fault == OUT_OF_REACH else stopped

    if code == CONVERGED and branch_left(table, q, SHORT_STEP, work, views.past, views.normal):
        code = BRANCH_LOST

    return hand_over(table, q, p2, chord2, code, steps, 0, out)
