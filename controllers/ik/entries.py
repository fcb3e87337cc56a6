"""Compiled, cached entry points of the inverse kinematics `uuv.controllers.mkps`.

The entries for one target hold the GIL on purpose. They may then share the memory of their chain,
and one solution takes far less time than a switch to another thread. The entry for many targets
releases the GIL and needs memory of its own.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numpy.typing import DTypeLike

from uuv.controllers.ik.chain_kernels import (
    BAD_OPTION,
    HYBRID,
    JACOBIAN_FREE,
    PLAIN,
    PRIORITY,
    SCALE,
    Settings,
    forward,
    partition,
    set_goal,
)
from uuv.controllers.ik.damped_descent import solve_hybrid, solve_keep
from uuv.controllers.ik.paper_stages import solve_plain, stage_axes, three_goals
from uuv.controllers.ik.pose_parts import PartTolerances, alike, split
from uuv.controllers.ik.priorities import solve_priority
from uuv.controllers.ik.spare_joints import spare_motion
from uuv.controllers.ik.sweeps import solve_jacobian_free
from uuv.sim.interfaces.kernels import kernel

_VECTOR = types.float64[::1]
_TABLE = types.float64[:, ::1]
# writable arrays are accepted too
_GIVEN = {d: types.Array(types.float64, d, "C", readonly=True) for d in (1, 2, 3)}
_REAL = types.float64
_COUNT = types.int64
_FLAG = types.boolean
_SETTINGS = types.NamedTuple((_COUNT, *(_REAL,) * 4, _COUNT, _COUNT, _FLAG, _FLAG), Settings)
_holding = kernel(error_model="numpy")
_releasing = kernel(nogil=True, error_model="numpy")


def _make_entries() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Build the entries, each with the types of its arguments after `memory`."""

    @_holding
    def kinematics(memory, q, X, J):
        table, _, _, work, _, _ = partition(memory, q.shape[0])
        forward(table, q, work, X, J)

    # The usual calls of `solve` take plain numbers: numba would have to take a record of settings
    # apart at each call.
    @_holding
    def hybrid(memory, X, q0, tol_p, tol_r, limit, restarts, out):
        if not alike(memory[SCALE], tol_p, tol_r):
            return BAD_OPTION, 0, 0, 0.0, 0.0  # for `parts`
        settings = Settings(HYBRID, tol_p, tol_r, tol_r, tol_r, limit, restarts, False, False)
        return solve_hybrid(memory, X, q0, settings, None, memory[:0].reshape(0, 1), out)

    @_holding
    def keep(memory, X, q0, tol_p, tol_r, limit, restarts, out):
        if not alike(memory[SCALE], tol_p, tol_r):
            return BAD_OPTION, 0, 0, 0.0, 0.0  # for `parts_keep`
        settings = Settings(HYBRID, tol_p, tol_r, tol_r, tol_r, limit, restarts, True, False)
        return solve_keep(memory, X, q0, settings, None, memory[:0].reshape(0, 1), out)

    @_holding
    def traced_hybrid(memory, X, q0, settings, trail, out):
        return solve_hybrid(memory, X, q0, settings, None, trail, out)

    @_holding
    def traced_keep(memory, X, q0, settings, trail, out):
        return solve_keep(memory, X, q0, settings, None, trail, out)

    @_holding
    def parts(memory, X, q0, settings, axis, turn, trail, out):
        outcome = solve_hybrid(memory, X, q0, settings, PartTolerances(axis, turn), trail, out)
        return *outcome, *split(memory, outcome[0], out)

    @_holding
    def parts_keep(memory, X, q0, settings, axis, turn, trail, out):
        outcome = solve_keep(memory, X, q0, settings, PartTolerances(axis, turn), trail, out)
        return *outcome, *split(memory, outcome[0], out)

    @_holding
    def jacobian_free(memory, X, q0, settings, trail, out):
        return solve_jacobian_free(memory, X, q0, settings, trail, out)

    @_holding
    def plain(memory, X, q0, settings, trail, out):
        return solve_plain(memory, X, q0, settings, trail, out)

    @_holding
    def priority(memory, X, q0, settings, trail, out):
        return solve_priority(memory, X, q0, settings, trail, out)

    @_holding
    def goals(memory, X, tip_axes, trail, out):
        """Evaluate the three goals of [Danilov 2021, eq. 6] for each row of a trail.

        F_R [m], F_alpha1 and F_alpha2 [rad] of each row of `trail` (N, n) go to `out` (N, 3).
        """
        table, goal, _, work, _, q = partition(memory, trail.shape[1])
        set_goal(table, X, goal)
        for row in range(trail.shape[0]):
            for i in range(q.shape[0]):
                q[i] = trail[row, i]
            along, across = stage_axes(table, tip_axes, q, work)
            p2, out[row, 1], out[row, 2], _ = three_goals(table, goal, along, across, q, work)
            out[row, 0] = math.sqrt(p2) / table[0, SCALE]

    @_releasing
    def many(memory, X, q0, settings, first, last, q, out):
        """Solve for the targets `first` to `last` of `X` (N, 4, 4) from `q0` (N, n).

        Joint values go to `q` (N, n), the five numbers that the solver of one target returns to
        `out` (N, 5).
        """
        trail = memory[:0].reshape(0, 1)
        for i in range(first, last):
            if settings.method == JACOBIAN_FREE:
                outcome = solve_jacobian_free(memory, X[i], q0[i], settings, trail, q[i])
            elif settings.method == PLAIN:
                outcome = solve_plain(memory, X[i], q0[i], settings, trail, q[i])
            elif settings.method == PRIORITY:
                outcome = solve_priority(memory, X[i], q0[i], settings, trail, q[i])
            elif settings.keep:
                outcome = solve_keep(memory, X[i], q0[i], settings, None, trail, q[i])
            else:
                outcome = solve_hybrid(memory, X[i], q0[i], settings, None, trail, q[i])
            out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = outcome

    @_releasing
    def many_parts(memory, X, q0, settings, axis, turn, first, last, q, out):
        """As `many` for poses by parts; the angles of `split` end the rows of `out` (N, 7)."""
        trail = memory[:0].reshape(0, 1)
        for i in range(first, last):
            tolerances = PartTolerances(axis, turn)
            if settings.keep:
                outcome = solve_keep(memory, X[i], q0[i], settings, tolerances, trail, q[i])
            else:
                outcome = solve_hybrid(memory, X[i], q0[i], settings, tolerances, trail, q[i])
            out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = outcome
            out[i, 5], out[i, 6] = split(memory, outcome[0], q[i])

    usual = (_GIVEN[2], _GIVEN[1], _REAL, _REAL, _COUNT, _COUNT, _VECTOR)
    traced = (_GIVEN[2], _GIVEN[1], _SETTINGS, _TABLE, _VECTOR)
    by_parts = (_GIVEN[2], _GIVEN[1], _SETTINGS, _REAL, _REAL, _TABLE, _VECTOR)
    return {
        "kinematics": (kinematics, (_GIVEN[1], _TABLE, _TABLE)),
        "hybrid": (hybrid, usual),
        "keep": (keep, usual),
        "traced_hybrid": (traced_hybrid, traced),
        "traced_keep": (traced_keep, traced),
        "parts": (parts, by_parts),
        "parts_keep": (parts_keep, by_parts),
        "jacobian_free": (jacobian_free, traced),
        "plain": (plain, traced),
        "priority": (priority, traced),
        "goals": (goals, (_GIVEN[2], _FLAG, _TABLE, _TABLE)),
        "many": (many, (_GIVEN[3], _GIVEN[2], _SETTINGS, _COUNT, _COUNT, _TABLE, _TABLE)),
        "many_parts": (
            many_parts,
            (_GIVEN[3], _GIVEN[2], _SETTINGS, _REAL, _REAL, _COUNT, _COUNT, _TABLE, _TABLE),
        ),
    }


@_holding
def _spare(memory, q, blocked, rates):
    views = partition(memory, q.shape[0])
    return spare_motion(views.table, q, views.work, blocked, rates)


_ENTRIES = _make_entries() | {"spare": (_spare, (_GIVEN[1], _GIVEN[2], _VECTOR))}


@cache
def entry(name: str, precision: DTypeLike = np.float64) -> Any:
    """Return the entry `name`, compiled for memory of `precision` or loaded from the store.

    Compilation for other argument types is disabled: the entry raises TypeError for them. Numba
    would otherwise compile another copy of the solver for each new combination of types.
    """
    function, rest = _ENTRIES[name]
    memory = types.float32[::1] if np.dtype(precision) == np.float32 else _VECTOR

    if (memory, *rest) not in function.overloads:
        if function.signatures:
            function.disable_compile(False)
        function.compile((memory, *rest))
        function.disable_compile()
    return function
