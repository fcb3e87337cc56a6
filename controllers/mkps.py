"""Inverse kinematics of any serial chain by MKPS, the method of "finite rotation and displacement" [Danilov 2021].

    chain = Chain.from_dh(dh, limits=limits)
    result = solve(chain, X_base_tip, q0)

This module is the public interface. Chains are built in `controllers.ik.chain`, pose sequences are tracked in
`controllers.ik.tracking`. The compiled loops are in `controllers.ik`: `kinematics`, `damped_descent` (hybrid), `sweeps`
(jacobian_free), `paper_stages` (plain).
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, NoReturn, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from controllers.ik import chain_kernels as kernels
from controllers.ik.chain import Chain
from controllers.ik.damped_descent import SETTLE_STEPS
from controllers.ik.entries import entry
from controllers.ik.tracking import Track, Tracker, TrackState, TrackStep, track
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import (
    Array,
    checked,
    log_so3,
    not_a_pose,
    number,
    one_of,
    readonly,
    real_array,
    shown,
    whole_number,
)

__all__ = [
    "Branch",
    "Chain",
    "IkBatch",
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

Method = Literal["hybrid", "jacobian_free", "plain"]
Branch = Literal["free", "keep"]
Precision = Literal["double", "single"]
StageAxes = Literal["joint", "tip"]

_METHODS = get_args(Method)
_MOST: dict[str, int] = {"hybrid": 4000, "jacobian_free": 12000, "plain": 4000}  # iterations; sweeps are cheap
_MOST_COUNTED = 10**9  # largest number of iterations or restarts that may be asked for
_MOST_THREADS = 1024  # largest number of threads that may be asked for
_MOST_KEPT = 10**6  # largest number of iterations in a history, which is allocated beforehand
_CHUNK = 64  # targets per task of a thread in `solve_many`
_SINGLE_MARGIN = 0.7  # share of the tolerances that errors computed in single precision must meet
_CONVERGED = kernels.CONVERGED


class IkResult(NamedTuple):  # constructing a frozen dataclass would take as long as a warm solve
    """Solution of `solve`: joint values, always within the limits, and their pose errors."""

    q: Array  # (n,) [rad] or [m]
    converged: bool  # both errors are within their tolerances; with branch="keep" the branch was kept too
    iterations: int  # Levenberg-Marquardt steps or sweeps, restarts included
    position_error: float  # [m] distance from tip to target
    orientation_error: float  # [rad] angle between tip and target, by atan2
    cause: str  # why the iteration ended
    restarts: int = 0  # other starts tried; after any, the solution may lie on another branch than q0
    history: Array | None = None  # (iterations + 1, n) joint values from start to solution, if asked for
    goals: Array | None = None  # (iterations + 1, 3) F_R [m], F_alpha1, F_alpha2 [rad] of it [Danilov 2021, eq. 6]


_CAUSES = {
    kernels.CONVERGED: "converged",
    kernels.STALLED: "no joint values found for this pose; this is the nearest pose found",
    kernels.EXHAUSTED: "max_iterations spent; this is the nearest pose found",
    kernels.BRANCH_LOST: "the pose was reached only beyond a singular configuration, on another branch than q0",
    kernels.OUT_OF_REACH: "the target is farther away than the chain is long; this is the nearest pose found",
}
_RESTARTED = "converged after restarts: the branch may not be that of q0"
_COARSE = "single precision does not resolve these tolerances here; this is the nearest pose found"
_NO_OUTCOME = (kernels.BAD_OPTION, 0, 0, 0.0, 0.0)
_quick: dict[str, Any] = {}  # compiled entries for the usual options, by branch


def solve(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    position_tolerance: float = 1e-4,
    orientation_tolerance: float = 1e-3,
    method: Method = "hybrid",
    branch: Branch = "free",
    max_iterations: int | None = None,
    max_restarts: int = 200,
    history: bool = False,
    precision: Precision = "double",
    axis_tolerances: tuple[float, float] | None = None,
    stage_axes: StageAxes = "joint",
) -> IkResult:
    """Solve the inverse kinematics of a chain for one tip pose, starting at `q0`, within the joint limits.

    Where no solution is found, `q` is that of the nearest pose found. "Nearest" minimises the sum of the squares of
    both errors. Metres are divided by a power of two near the chain's length; the angle counts as its chord 2
    sin(angle/2).

    The GIL is held during the call.

    Args:
        chain: the serial chain.
        X_base_tip: (4, 4) target pose of the tip in the base frame.
        q0: (n,) [rad] or [m] start; values beyond the limits are brought within them.
        position_tolerance: [m] largest position error of a solution; with infinity it does not count.
        orientation_tolerance: [rad] largest orientation error of a solution; with infinity it does not count.
        method: "hybrid" (Levenberg-Marquardt), "jacobian_free" (accelerated sweeps) or "plain" ([Danilov 2021]).
        branch: "free" restarts until a pose is met, from the same places for the same chain and q0. "keep" is for
            tracking: it moves from `q0` by short steps only, without restarts or jumps by a whole turn. A solution to
            which some joint moved by more than half a radian (or half the chain's length) is then tested further. It is
            refused if the straight line in joint space from `q0` to it crosses a singular configuration.
        max_iterations: limit of the iterations; default 4000, 12000 for "jacobian_free".
        max_restarts: limit of the restarts; "plain" makes none, nor does branch="keep".
        history: also return the joint values after every iteration and their three goals ([Danilov 2021, fig. 9]).
        precision: "single" iterates in four-byte numbers and tests the solution in double precision.
        axis_tolerances: (2,) [rad] of the stages F_alpha1 and F_alpha2 of "plain". By default the whole rotation is
            then within `orientation_tolerance`. The other methods take the smaller of the two for the whole rotation.
        stage_axes: axes that the stages of "plain" align. "joint": the last joint's axis and one perpendicular to it.
            "tip": the tip's own z and x, as in [Danilov 2021]; the two stages then mostly undo each other.

    Returns:
        The joint values with errors, counts and the reason why the iteration ended.

    Raises:
        ConfigurationError: for a target that is not a pose, a bad `q0`, a tolerance that is not positive, or an unknown
            option.
    """
    plain_types = type(method) is str and type(precision) is str and type(stage_axes) is str
    usual = plain_types and method == "hybrid" and precision == "double" and stage_axes == "joint"
    if usual and history is False and axis_tolerances is None:
        q = np.empty(chain.n)
        try:
            outcome = _quick[branch](
                chain._memory,
                X_base_tip,
                q0,
                position_tolerance,
                orientation_tolerance,
                _MOST[method] if max_iterations is None else max_iterations,
                max_restarts,
                q,
            )
        except (TypeError, KeyError, OverflowError, ValueError):
            outcome = _NO_OUTCOME  # not yet compiled, or arguments of other types: the general way below
        code, iterations, restarts, error_p, error_r = outcome
        if code < kernels.BAD_TARGET:
            cause = _CAUSES[code] if code or not restarts else _RESTARTED
            done = code == kernels.CONVERGED
            return tuple.__new__(IkResult, (q, done, iterations, error_p, error_r, cause, restarts, None, None))
    return _solve(
        chain,
        _as_array(X_base_tip, (4, 4), "X_base_tip"),
        _as_array(q0, (chain.n,), "q0"),
        _Options(
            position_tolerance,
            orientation_tolerance,
            method,
            branch,
            max_iterations,
            max_restarts,
            precision,
            axis_tolerances,
            stage_axes,
        ),
        history,
    )


def _tolerance(value: Any, name: str) -> float:
    """Return `value` if it is > 0; infinity means that this error does not count."""
    given = number(value, name)
    if not given > 0.0:
        raise ConfigurationError(f"{name}: must be positive, got {given:g}")
    return given


class _Options:
    """Validated options of `solve`, in the terms of the compiled loops."""

    def __init__(
        self,
        position_tolerance: float,
        orientation_tolerance: float,
        method: str,
        branch: str,
        max_iterations: int | None,
        max_restarts: int,
        precision: str,
        axis_tolerances: tuple[float, float] | None,
        stage_axes: str,
    ) -> None:
        for name, value, kinds in (
            ("method", method, Method),
            ("branch", branch, Branch),
            ("precision", precision, Precision),
            ("stage_axes", stage_axes, StageAxes),
        ):
            one_of(value, get_args(kinds), name)
        self.tol_p = _tolerance(position_tolerance, "position_tolerance [m]")
        self.tol_r = _tolerance(orientation_tolerance, "orientation_tolerance [rad]")
        self.tol_1 = self.tol_2 = self.tol_r * 0.5**0.5
        if axis_tolerances is not None:
            both = real_array(axis_tolerances, "axis_tolerances [rad]", "two numbers")
            if both.shape != (2,):
                raise ConfigurationError(f"axis_tolerances [rad]: expected two numbers, got shape {both.shape}")
            self.tol_1, self.tol_2 = (_tolerance(value, "axis_tolerances [rad]") for value in both.tolist())
            self.tol_r = min(self.tol_1, self.tol_2)  # a rotation error within this keeps both axes within theirs
        max_iterations = _MOST[method] if max_iterations is None else max_iterations
        self.method, self.keep, self.single = method, branch == "keep", precision == "single"
        self.max_iterations = whole_number(max_iterations, "max_iterations", least=1, most=_MOST_COUNTED)
        self.max_restarts = whole_number(max_restarts, "max_restarts", most=_MOST_COUNTED)
        self.tip_axes = stage_axes == "tip"
        self.margin = _SINGLE_MARGIN if self.single else 1.0

    def tolerances(self) -> tuple[float, float]:
        """Position [m] and orientation [rad] tolerance, with the margin of single precision."""
        return self.margin * self.tol_p, self.margin * self.tol_r

    def axis_tolerances(self) -> tuple[float, float]:
        """Tolerances [rad] of the two axis stages, with the margin of single precision."""
        return self.margin * self.tol_1, self.margin * self.tol_2


def _solve(chain: Chain, target: Array, start: Array, options: _Options, history: bool) -> IkResult:
    if not isinstance(history, bool | np.bool_):
        raise ConfigurationError(f"history: must be True or False, got {shown(history)}")
    if history:
        whole_number(options.max_iterations, "max_iterations with history", most=_MOST_KEPT)
    rows = options.max_iterations + SETTLE_STEPS + 1 if history else 0
    trail, q = np.empty((rows, chain.n)), np.empty(chain.n)
    count, keep = options.max_iterations, options.keep
    rest: tuple[Any, ...]
    if options.method == "plain":
        name, rest = "plain", (*options.axis_tolerances(), count, keep, options.tip_axes)
    elif options.method == "jacobian_free":
        name, rest = "jacobian_free", (count, options.max_restarts, keep)
    else:
        name = ("traced_" if history else "") + ("keep" if keep else "hybrid")
        rest = (count, options.max_restarts)
    memory = chain.single() if options.single else chain._memory
    solver = entry(name, memory.dtype)
    if options.method == "hybrid" and not history:
        _quick["keep" if keep else "free"] = solver
    else:
        rest = (*rest, trail)
    outcome = solver(memory, target, start, *options.tolerances(), *rest, q)
    code, iterations, restarts, error_p, error_r = outcome
    if code >= kernels.BAD_TARGET:
        _refuse(code, target, start, "")
    cause = _cause(code, restarts)
    if options.single:
        error_p, error_r = _errors(chain, q, target)
        if code == _CONVERGED and not (error_p <= options.tol_p and error_r <= options.tol_r):
            code, cause = kernels.STALLED, _COARSE
    path = goals = None
    if history:
        trail[iterations] = q  # without convergence the result is the best iterate, not the last
        trail, goals = trail[: iterations + 1], np.empty((iterations + 1, 3))
        entry("goals")(chain._memory, target, options.tip_axes, trail, goals)
        path, goals = readonly(trail), readonly(goals)
    return IkResult(q, code == _CONVERGED, iterations, error_p, error_r, cause, restarts, path, goals)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IkBatch:
    """Solutions of `solve_many`, one row per target.

    `batch[i]` is what `solve` would have returned for target i.
    """

    q: Array  # (N, n) [rad] or [m], within the limits
    converged: NDArray[np.bool_]  # (N,)
    iterations: NDArray[np.int64]  # (N,)
    position_error: Array  # (N,) [m]
    orientation_error: Array  # (N,) [rad]
    restarts: NDArray[np.int64]  # (N,)
    codes: NDArray[np.int64]  # (N,) why each ended, a code of `controllers.ik.chain_kernels`

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
            _cause(int(self.codes[i]), restarts),
            restarts,
        )


def solve_many(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    position_tolerance: float = 1e-4,
    orientation_tolerance: float = 1e-3,
    method: Method = "hybrid",
    branch: Branch = "free",
    max_iterations: int | None = None,
    max_restarts: int = 200,
    threads: int | None = None,
    axis_tolerances: tuple[float, float] | None = None,
    stage_axes: StageAxes = "joint",
) -> IkBatch:
    """Solve the inverse kinematics for many tip poses in parallel, on all cores.

    The solutions equal those of `solve` to the last bit, for any number of `threads`. The GIL is free during the call.

    Args:
        chain: the serial chain.
        X_base_tip: (N, 4, 4) target poses of the tip in the base frame.
        q0: (n,) [rad] or [m] one start for all targets, or (N, n) one per target.
        position_tolerance: [m] as in `solve`.
        orientation_tolerance: [rad] as in `solve`.
        method: as in `solve`.
        branch: as in `solve`.
        max_iterations: per target, as in `solve`.
        max_restarts: per target, as in `solve`.
        threads: number of threads; default the cores that this process may use.
        axis_tolerances: (2,) [rad] as in `solve`.
        stage_axes: as in `solve`.

    Returns:
        One row per target.

    Raises:
        ConfigurationError: as `solve`; it names the first bad row, and no other row is returned.
    """
    targets = _stack(X_base_tip, "X_base_tip")
    count = len(targets) if targets.ndim == 3 else 0
    if targets.shape != (count, 4, 4):
        raise ConfigurationError(f"X_base_tip: expected shape (N, 4, 4), got {targets.shape}")
    starts = _stack(q0, "q0")
    if starts.shape not in ((chain.n,), (count, chain.n)):
        raise ConfigurationError(f"q0: expected shape ({chain.n},) or ({count}, {chain.n}), got {starts.shape}")
    starts = np.ascontiguousarray(np.broadcast_to(starts, (count, chain.n)))
    options = _Options(
        position_tolerance,
        orientation_tolerance,
        method,
        branch,
        max_iterations,
        max_restarts,
        "double",
        axis_tolerances,
        stage_axes,
    )
    if threads is None:
        threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads = whole_number(threads, "threads", least=1, most=_MOST_THREADS)
    q, out = np.empty((count, chain.n)), np.empty((count, 5))
    many = entry("many")

    def work(first: int) -> None:
        many(
            chain._memory.copy(),
            _METHODS.index(method),
            targets,
            starts,
            *options.tolerances(),
            *options.axis_tolerances(),
            options.max_iterations,
            options.max_restarts,
            options.keep,
            options.tip_axes,
            first,
            min(first + _CHUNK, count),
            chain._no_trail,
            q,
            out,
        )

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
        codes=codes,
    )
    for name in batch.__slots__:
        getattr(batch, name).setflags(write=False)
    return batch


def _cause(code: int, restarts: int) -> str:
    """Reason in words for a code of the compiled loops."""
    return _RESTARTED if restarts and code == _CONVERGED else _CAUSES[code]


def _errors(chain: Chain, q: Array, target: Array) -> tuple[float, float]:
    """Position [m] and orientation [rad] error of `q`, in double precision."""
    X = chain.forward(q)
    turn = log_so3(X[:3, :3].T @ target[:3, :3])
    return float(np.linalg.norm(X[:3, 3] - target[:3, 3])), float(np.linalg.norm(turn))


def _refuse(code: int, target: Array, start: Array, row: str) -> NoReturn:
    """Raise ConfigurationError for the input error that the compiled loops reported."""
    checked(target, (4, 4), f"X_base_tip{row}")
    if code == kernels.BAD_TARGET:
        raise not_a_pose(f"X_base_tip{row}", target)
    raise ConfigurationError(f"q0{row}: every number must be finite, got {shown(start)}")


def _as_array(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Convert `values` to contiguous float64 of `shape`; the compiled loops validate the numbers."""
    array = _stack(values, name)
    if array.shape != shape:
        raise ConfigurationError(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def _stack(values: ArrayLike, name: str) -> Array:
    """Convert `values` to contiguous float64 of any shape."""
    return np.ascontiguousarray(real_array(values, name))
