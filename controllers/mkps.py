"""Inverse kinematics of serial chains by MKPS, finite rotation and displacement [Danilov 2021].

    chain = Chain.from_dh(dh, limits=limits)
    result = solve(chain, X_base_tip, q0)

This module is the public interface. Chains are built in `uuv.controllers.ik.chain`, pose sequences
are tracked in `uuv.controllers.ik.tracking`. The compiled loops are in `uuv.controllers.ik`:
`chain_kernels`, `damped_descent` (hybrid), `sweeps` (jacobian_free), `paper_stages` (plain),
`priorities` (priority); options are in `options`.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuv.controllers.ik import chain_kernels as kernels
from uuv.controllers.ik.chain import Chain
from uuv.controllers.ik.damped_descent import MOST_AFTER
from uuv.controllers.ik.entries import entry
from uuv.controllers.ik.method import Method
from uuv.controllers.ik.options import (
    METHODS,
    MOST,
    Branch,
    IkOptions,
    Precision,
    StageAxes,
    Tolerances,
    solver_settings,
)
from uuv.controllers.ik.pose_parts import PartTolerances
from uuv.controllers.ik.tracking import Track, Tracker, TrackState, TrackStep, track
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    log_so3,
    not_a_pose,
    readonly,
    real_array,
    shown,
)

__all__ = [
    "Branch",
    "Chain",
    "IkBatch",
    "IkOptions",
    "IkResult",
    "Method",
    "Precision",
    "StageAxes",
    "Track",
    "TrackState",
    "TrackStep",
    "Tracker",
    "solve",
    "solve_many",
    "track",
]

_MOST_HYBRID = MOST["hybrid"]
_CHUNK = 64  # number of targets per task of a thread in `solve_many`
_SINGLE_MARGIN = 0.7  # share of the tolerances that errors in single precision must meet
_CONVERGED = kernels.CONVERGED
_BAD_TARGET = kernels.BAD_TARGET
_NAN = math.nan
_new = tuple.__new__
_empty = np.empty


# used because constructing a frozen dataclass takes as long as a warm solve
class IkResult(NamedTuple):
    """Solution of `solve`: joint values, always within the limits, and their pose errors."""

    q: Array  # (n,) [rad] or [m]
    # True: every error with a finite tolerance is within it; with branch="keep" the branch was kept
    # too
    converged: bool
    iterations: int  # number of Levenberg-Marquardt steps or sweeps, including restarts
    position_error: float  # [m] distance from tip to target
    orientation_error: float  # [rad] angle between tip and target, by atan2
    cause: str  # reason why the iteration ended
    # number of other starts tried; if any, the solution may be on another branch than q0
    restarts: int = 0
    # (iterations + 1, n) joint values from start to solution, if requested
    history: Array | None = None
    # (iterations + 1, 3) errors F_R [m], F_alpha1, F_alpha2 [rad] of this history [Danilov 2021,
    # eq. 6]
    goals: Array | None = None
    # [rad] parts of the orientation error, for a pose solved for by parts: angle between the tool
    # axes, and turn about that of the tip. NaN if position and whole orientation were solved for,
    # and with "priority".
    axis_error: float = math.nan
    turn_error: float = math.nan


_CAUSES = {
    kernels.CONVERGED: "converged",
    kernels.STALLED: "no joint values found for this pose; this is the nearest pose found",
    kernels.EXHAUSTED: "max_iterations spent; this is the nearest pose found",
    kernels.BRANCH_LOST: "the pose was reached only beyond a singular configuration, on another "
    "branch than q0",
    kernels.OUT_OF_REACH: "the target is farther away than the chain is long; this is the nearest "
    "pose found",
}
_RESTARTED = "converged after restarts: the branch may not be that of q0"
_COARSE = "single precision does not resolve these tolerances here; this is the nearest pose found"
_NO_OUTCOME = (kernels.BAD_OPTION, 0, 0, 0.0, 0.0)
_quick: dict[str, Any] = {}  # compiled entries for the usual options, by branch


_USUAL = IkOptions()


def solve(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    position_tolerance: float = 1e-4,
    orientation_tolerance: float = 1e-3,
    method: Method = "hybrid",
    branch: Branch = "free",
    options: IkOptions = _USUAL,
    *,
    axis_tolerance: float | None = None,
    turn_tolerance: float | None = None,
) -> IkResult:
    """Solve the inverse kinematics of a chain for one tip pose, from `q0`, within the joint limits.

    A part of the pose with an infinite tolerance is ignored: `orientation_tolerance=inf` asks for a
    position alone, `position_tolerance=inf` for an orientation, `turn_tolerance=inf` for position
    and tool axis.

    If no solution is found, `q` belongs to the nearest pose found. "Nearest" minimises the sum of
    the squares of both errors. Metres are divided by a power of two near the chain's length; the
    angle is replaced by its chord 2 sin(angle/2). Such a pose may be far off in position, if its
    orientation is near. For a pose solved for by parts, each error is divided by its tolerance.

    The GIL is held during the call.

    Args:
        chain: the serial chain.
        X_base_tip: (4, 4) target pose of the tip in the base frame.
        q0: (n,) [rad] or [m] start; values beyond the limits are brought within them.
        position_tolerance: [m] largest position error of a solution; with infinity the position is
            ignored.
        orientation_tolerance: [rad] largest angle of the whole rotation error of a solution; from
            pi on the orientation is ignored. It is the default of `axis_tolerance` and
            `turn_tolerance` if only one of these is stated.
        method: "hybrid" (Levenberg-Marquardt), "jacobian_free" (accelerated sweeps), "plain"
            ([Danilov 2021]), or "priority": the tip's position, then its z axis, then the turn
            about it. A pose counts as reached without that turn, and the orientation
            error is the angle between the axes. "priority" keeps the branch of `q0` without
            restarts for any `branch` and `max_restarts`, in double precision only.
        branch: "free" restarts until the pose is reached, with the same starts for the same chain
            and q0. "keep" is for tracking: the solver moves from `q0` by short steps only, without
            restarts or jumps by a whole turn. If some joint moved by more than half a radian (or
            half the chain's length), the solution is tested further, and refused if the straight
            line in joint space from `q0` to it crosses a singular configuration.
        options: limits of the iterations, precision, history, and options of "plain".
        axis_tolerance: [rad] largest angle between the tool axis, the tip's z, and that of the
            target. If this or `turn_tolerance` is stated, the two replace the tolerance of the
            whole rotation.
        turn_tolerance: [rad] largest remaining turn about the tool axis. "priority" ignores it.

    Returns:
        The joint values with errors, counts and the reason why the iteration ended.

    Raises:
        ConfigurationError: the target is not a pose, `q0` is bad, a tolerance is not positive, all
            tolerances are infinite, the method does not support a tolerance, or an option is
            unknown.
    """
    whole = axis_tolerance is turn_tolerance is None
    if (
        whole
        and type(method) is str
        and method == "hybrid"
        and type(options) is IkOptions
        and options.usual
    ):
        # Half a microsecond matters here, and names of this module are found faster than those of
        # another.

        q = _empty(chain.n)
        most = options.max_iterations
        try:
            outcome = _quick[branch](
                chain._memory,
                X_base_tip,
                q0,
                position_tolerance,
                orientation_tolerance,
                _MOST_HYBRID if most is None else most,
                options.max_restarts,
                q,
            )
        except (TypeError, KeyError, OverflowError, ValueError):
            # not yet compiled, or arguments of other types: use the general path below
            outcome = _NO_OUTCOME

        code, iterations, restarts, error_p, error_r = outcome
        if code < _BAD_TARGET:
            cause = _CAUSES[code] if code or not restarts else _RESTARTED
            done = code == _CONVERGED
            return _new(
                IkResult,
                (q, done, iterations, error_p, error_r, cause, restarts, None, None, _NAN, _NAN),
            )

    tolerances = Tolerances(
        position_tolerance, orientation_tolerance, axis_tolerance, turn_tolerance
    )
    settings, parts = solver_settings(chain, tolerances, method, branch, options)
    target = _as_array(X_base_tip, (4, 4), "X_base_tip")
    start = _as_array(q0, (chain.n,), "q0")
    return _solve(chain, target, start, settings, parts, options)


def _solve(
    chain: Chain,
    target: Array,
    start: Array,
    settings: kernels.Settings,
    parts: PartTolerances | None,
    options: IkOptions,
) -> IkResult:
    # Memory, tolerances and history of the compiled loop
    history = bool(options.history)
    single = options.precision == "single"
    memory = chain.single() if single else chain._memory
    q = np.empty(chain.n)

    rows = settings.limit + MOST_AFTER + 1 if history else 0
    trail = np.empty((rows, chain.n))
    used = settings
    if single:
        tol_p, tol_r, tol_1, tol_2 = (_SINGLE_MARGIN * tol for tol in settings[1:5])
        used = settings._replace(tol_p=tol_p, tol_r=tol_r, tol_1=tol_1, tol_2=tol_2)

    # By parts, by the usual entry, or by one that keeps a history
    outcome: tuple[int, int, int, float, float]
    split = math.nan, math.nan
    if parts is not None:
        solver = entry("parts_keep" if settings.keep else "parts", memory.dtype)
        axis, turn = (_SINGLE_MARGIN * tol for tol in parts) if single else parts
        reached = solver(memory, target, start, used, axis, turn, trail, q)
        outcome, split = reached[:5], reached[5:]
    elif settings.method == kernels.HYBRID and not history:
        name = "keep" if settings.keep else "hybrid"
        solver = entry(name, memory.dtype)
        _quick["keep" if settings.keep else "free"] = solver
        outcome = solver(
            memory, target, start, used.tol_p, used.tol_r, used.limit, used.restarts, q
        )
    else:
        traced = "traced_keep" if settings.keep else "traced_hybrid"
        name = traced if settings.method == kernels.HYBRID else METHODS[settings.method]
        outcome = entry(name, memory.dtype)(memory, target, start, used, trail, q)

    code, iterations, restarts, error_p, error_r = outcome
    if code >= kernels.BAD_TARGET:
        _refuse(code, target, start, "")
    cause = _cause(code, restarts)

    # Errors of a solution in single precision are recomputed in double precision
    if single:
        error_p, error_r, axis, turn = _errors(chain, q, target)
        met = error_p <= settings.tol_p and error_r <= settings.tol_r
        if parts is not None:
            met = met and axis <= parts.axis and turn <= parts.turn
            split = axis, turn
        if code == _CONVERGED and not met:
            code = kernels.STALLED
            cause = _COARSE

    path = goals = None
    if history:
        # without convergence the result is the best iterate, not the last one
        trail[iterations] = q
        trail = trail[: iterations + 1]
        goals = np.empty((iterations + 1, 3))
        entry("goals")(chain._memory, target, settings.tip_axes, trail, goals)
        path = readonly(trail)
        goals = readonly(goals)

    return IkResult(
        q, code == _CONVERGED, iterations, error_p, error_r, cause, restarts, path, goals, *split
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IkBatch:
    """Solutions of `solve_many`, one row per target.

    `batch[i]` equals the result of `solve` for target i.
    """

    q: Array  # (N, n) [rad] or [m], within the limits
    converged: NDArray[np.bool_]  # (N,)
    iterations: NDArray[np.int64]  # (N,)
    position_error: Array  # (N,) [m]
    orientation_error: Array  # (N,) [rad]
    restarts: NDArray[np.int64]  # (N,)
    axis_error: Array  # (N,) [rad], as in `IkResult`
    turn_error: Array  # (N,) [rad], as in `IkResult`
    # (N,) reason why each iteration ended, a code of `uuv.controllers.ik.chain_kernels`
    _codes: NDArray[np.int64]

    @property
    def causes(self) -> tuple[str, ...]:
        """Reason why each iteration ended, a sentence for each of the N targets."""
        pairs = zip(self._codes.tolist(), self.restarts.tolist(), strict=True)
        return tuple(_cause(code, restarts) for code, restarts in pairs)

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, i: int) -> IkResult:
        restarts = int(self.restarts[i])
        return IkResult(
            self.q[i],
            bool(self.converged[i]),
            int(self.iterations[i]),
            float(self.position_error[i]),
            float(self.orientation_error[i]),
            _cause(int(self._codes[i]), restarts),
            restarts,
            axis_error=float(self.axis_error[i]),
            turn_error=float(self.turn_error[i]),
        )


def solve_many(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    position_tolerance: float = 1e-4,
    orientation_tolerance: float = 1e-3,
    method: Method = "hybrid",
    branch: Branch = "free",
    options: IkOptions = _USUAL,
    *,
    axis_tolerance: float | None = None,
    turn_tolerance: float | None = None,
) -> IkBatch:
    """Solve the inverse kinematics for many tip poses in parallel, on all cores.

    The solutions equal those of `solve` to the last bit, for any number of threads. The GIL is free
    during the call.

    Args:
        chain: the serial chain.
        X_base_tip: (N, 4, 4) target poses of the tip in the base frame.
        q0: (n,) [rad] or [m] one start for all targets, or (N, n) one per target.
        position_tolerance: [m] as in `solve`.
        orientation_tolerance: [rad] as in `solve`.
        method: as in `solve`.
        branch: as in `solve`.
        options: as in `solve`, without history and in double precision; iterations and restarts are
            per target.
        axis_tolerance: [rad] as in `solve`.
        turn_tolerance: [rad] as in `solve`.

    Returns:
        One row per target.

    Raises:
        ConfigurationError: as for `solve`, or history or single precision is requested; the message
            names the first bad row, and no row is returned.
    """
    targets, starts = _stacks(chain, X_base_tip, q0)
    count = len(targets)

    tolerances = Tolerances(
        position_tolerance, orientation_tolerance, axis_tolerance, turn_tolerance
    )
    settings, parts = solver_settings(chain, tolerances, method, branch, options)
    if options.history or options.precision == "single":
        raise ConfigurationError("options: `solve_many` needs double precision and no history")

    threads = options.threads or _cores()
    q = np.empty((count, chain.n))
    out = np.full((count, 7), np.nan)
    many = entry("many" if parts is None else "many_parts")

    def work(first: int) -> None:
        last = min(first + _CHUNK, count)
        many(chain._memory.copy(), targets, starts, settings, *(parts or ()), first, last, q, out)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(0, count, _CHUNK)))

    codes = out[:, 0].astype(np.int64)
    for i in np.flatnonzero(codes >= kernels.BAD_TARGET):
        _refuse(int(codes[i]), targets[i], starts[i], f"[{i}]")

    batch = IkBatch(
        q=q,
        converged=codes == _CONVERGED,
        iterations=out[:, 1].astype(np.int64),
        position_error=out[:, 3].copy(),
        orientation_error=out[:, 4].copy(),
        restarts=out[:, 2].astype(np.int64),
        axis_error=out[:, 5].copy(),
        turn_error=out[:, 6].copy(),
        _codes=codes,
    )
    for name in batch.__slots__:
        getattr(batch, name).setflags(write=False)
    return batch


def _stacks(chain: Chain, X_base_tip: ArrayLike, q0: ArrayLike) -> tuple[Array, Array]:
    """Targets (N, 4, 4) and starts (N, n) of `solve_many`; the compiled loops check the numbers."""
    targets = _stack(X_base_tip, "X_base_tip")
    count = len(targets) if targets.ndim == 3 else 0
    if targets.shape != (count, 4, 4):
        raise ConfigurationError(f"X_base_tip: expected shape (N, 4, 4), got {targets.shape}")

    starts = _stack(q0, "q0")
    if starts.shape not in ((chain.n,), (count, chain.n)):
        raise ConfigurationError(
            f"q0: expected shape ({chain.n},) or ({count}, {chain.n}), got {starts.shape}"
        )
    starts = np.ascontiguousarray(np.broadcast_to(starts, (count, chain.n)))
    return targets, starts


def _cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cause(code: int, restarts: int) -> str:
    """Reason, as text, for a code of the compiled loops."""
    return _RESTARTED if restarts and code == _CONVERGED else _CAUSES[code]


def _errors(chain: Chain, q: Array, target: Array) -> tuple[float, float, float, float]:
    """Position [m], orientation, axis and turn errors [rad] of `q`, in double precision."""
    X = chain.forward(q)
    R = X[:3, :3].T @ target[:3, :3]
    whole = log_so3(R)
    tilt = np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])

    half = 0.5 * float(np.linalg.norm(whole))
    turn = (
        0.0
        if half == 0.0
        else 2.0 * abs(np.arctan2(np.sin(half) * whole[2] / (2.0 * half), np.cos(half)))
    )

    return float(np.linalg.norm(X[:3, 3] - target[:3, 3])), 2.0 * half, float(tilt), float(turn)


def _refuse(code: int, target: Array, start: Array, row: str) -> NoReturn:
    """Raise ConfigurationError for the input error that the compiled loops reported."""
    checked(target, (4, 4), f"X_base_tip{row}")
    if code == kernels.BAD_TARGET:
        raise not_a_pose(f"X_base_tip{row}", target)
    raise ConfigurationError(f"q0{row}: every number must be finite, got {shown(start)}")


def _as_array(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Convert `values` to contiguous float64 of `shape`; the compiled loops check the numbers."""
    array = _stack(values, name)
    if array.shape != shape:
        raise ConfigurationError(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def _stack(values: ArrayLike, name: str) -> Array:
    """Convert `values` to contiguous float64 of any shape."""
    return np.ascontiguousarray(real_array(values, name))
