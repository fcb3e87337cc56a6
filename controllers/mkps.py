"""MKPS inverse kinematics: the method of "finite rotation and displacement" (paper 003), any serial chain.

    chain = Chain.from_dh(dh, limits=limits)
    result = solve(chain, X_base_tip, q0)

This is the door. Chains are made in `mkps_chain`, sequences of poses tracked in `mkps_tracking`; the compiled loops are
in `mkps_kinematics`, `mkps_descent` (hybrid), `mkps_sweeps` (jacobian_free) and `mkps_stages` (plain).
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, NoReturn, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from controllers.ik import kinematics as kernels
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
_MOST: dict[str, int] = {"hybrid": 4000, "jacobian_free": 12000, "plain": 4000}  # iterations: sweeps are cheap
_MOST_COUNTED = 10**9  # iterations or restarts
_MOST_THREADS = 1024
_MOST_KEPT = 10**6  # iterations in a history
_CHUNK = 64  # targets that a thread takes at a time in `solve_many`
_SINGLE_MARGIN = 0.7  # of the tolerances, which single precision must reach by its own reckoning
_CONVERGED = kernels.CONVERGED


class IkResult(NamedTuple):  # a frozen dataclass would take as long to make as a warm solve
    """What `solve` found. `q` is always within the limits, and the errors are those of `q`."""

    q: Array  # (n,) [rad] or [m]
    converged: bool  # both errors are within their tolerances, and the branch was kept if that was asked
    iterations: int  # Levenberg-Marquardt steps or sweeps, restarts included
    position_error: float  # [m] distance of the tip from the target
    orientation_error: float  # [rad] angle between tip and target, by atan2
    cause: str  # why it ended
    restarts: int = 0  # other starts tried; after any, the answer may lie on another branch than q0
    history: Array | None = None  # (iterations + 1, n) joint values from the start to the answer, if asked for
    goals: Array | None = None  # (iterations + 1, 3) F_R [m], F_alpha1, F_alpha2 [rad] (paper 003, (6)) of `history`


_CAUSES = {
    kernels.CONVERGED: "converged",
    kernels.STALLED: "no joint values found for this pose; this is the nearest pose found",
    kernels.EXHAUSTED: "max_iterations spent; this is the nearest pose found",
    kernels.BRANCH_LOST: "the pose was reached only beyond a singular configuration, on another branch than q0",
    kernels.OUT_OF_REACH: "the target is farther away than the chain is long; this is the nearest pose found",
}
_RESTARTED = "converged after restarts: the branch may not be that of q0"
_NO_OUTCOME = (kernels.BAD_OPTION, 0, 0, 0.0, 0.0)
_quick: dict[str, Any] = {}  # compiled entries for the usual call, by branch
_COARSE = "single precision does not resolve these tolerances here; this is the nearest pose found"


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
    """Joint values within the limits that bring the tip to `X_base_tip` (4, 4), sought from `q0` (n,) [rad] or [m].

    Tolerances are in [m] and [rad]. `branch="keep"` moves from `q0` by short steps only: no restart, no leap by a whole
    turn. An answer to which some joint moved by more than half a radian (or half the chain's length) is refused if the
    straight way from `q0` to it crosses a singular configuration. It is the call for tracking. `branch="free"`
    restarts, from the same places for the same chain and q0, until a pose is met. "Nearest" is by the sum of squares of
    both errors, metres divided by a power of two near the length of the chain, the angle as its chord 2 sin(angle/2).
    A `q0` beyond the limits is brought within them. `max_iterations` is 4000 by default, 12000 for `jacobian_free`.

    With `history` the result holds the joint values after every iteration and their three goals (paper 003, fig. 9).
    `precision="single"` iterates in four-byte numbers, and checks the answer in double. For `plain`, `axis_tolerances`
    [rad] are those of the stages F_alpha1 and F_alpha2 (default: such that the whole rotation is within
    `orientation_tolerance`; the other methods take the smaller of the two for the whole rotation). `stage_axes="tip"`
    makes it aim the tip's own z and x, as the dissertation does, rather than the last joint's axis and one across it,
    without which the stages mostly undo each other.

    The GIL is held meanwhile. Raises ConfigurationError for a target that is not a pose, a bad `q0`, a tolerance that
    is not positive, and an unknown option.
    """
    usual = type(method) is str and type(precision) is str and history is False and axis_tolerances is None
    if usual and method == "hybrid" and precision == "double":
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
            outcome = _NO_OUTCOME  # not yet compiled, or not the usual types
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
    """`value` > 0; infinite where that error does not count."""
    given = number(value, name)
    if not given > 0.0:
        raise ConfigurationError(f"{name}: must be positive, got {given:g}")
    return given


class _Options:
    """Options of `solve`, checked, in the terms of the compiled loops."""

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
            self.tol_r = min(self.tol_1, self.tol_2)  # a frame within this has both axes within theirs
        max_iterations = _MOST[method] if max_iterations is None else max_iterations
        self.method, self.keep, self.single = method, branch == "keep", precision == "single"
        self.max_iterations = whole_number(max_iterations, "max_iterations", least=1, most=_MOST_COUNTED)
        self.max_restarts = whole_number(max_restarts, "max_restarts", most=_MOST_COUNTED)
        self.tip_axes = stage_axes == "tip"
        self.margin = _SINGLE_MARGIN if self.single else 1.0

    def tolerances(self) -> tuple[float, float]:
        return self.margin * self.tol_p, self.margin * self.tol_r

    def axis_tolerances(self) -> tuple[float, float]:
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
        trail[iterations] = q  # where nothing converged, the answer is the best of the way
        trail, goals = trail[: iterations + 1], np.empty((iterations + 1, 3))
        entry("goals")(chain._memory, target, options.tip_axes, trail, goals)
        path, goals = readonly(trail), readonly(goals)
    return IkResult(q, code == _CONVERGED, iterations, error_p, error_r, cause, restarts, path, goals)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IkBatch:
    """What `solve_many` found, one row a target. `batch[i]` is what `solve` would have returned for target i."""

    q: Array  # (N, n) [rad] or [m], within the limits
    converged: NDArray[np.bool_]  # (N,)
    iterations: NDArray[np.int64]  # (N,)
    position_error: Array  # (N,) [m]
    orientation_error: Array  # (N,) [rad]
    restarts: NDArray[np.int64]  # (N,)
    codes: NDArray[np.int64]  # (N,) why each ended, in the numbers of `mkps_kinematics`

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
    """`solve` for many targets `X_base_tip` (N, 4, 4), from one `q0` (n,) or one a target (N, n), on all cores.

    The answers are those of `solve`, to the last bit, whatever `threads` is (default: the cores that this process may
    use). The GIL is free meanwhile. Raises as `solve`, and names the first bad row; the other rows are then not given.
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
    return _RESTARTED if restarts and code == _CONVERGED else _CAUSES[code]


def _errors(chain: Chain, q: Array, target: Array) -> tuple[float, float]:
    """Position [m] and orientation error [rad] of `q`, in double precision."""
    X = chain.forward(q)
    turn = log_so3(X[:3, :3].T @ target[:3, :3])
    return float(np.linalg.norm(X[:3, 3] - target[:3, 3])), float(np.linalg.norm(turn))


def _refuse(code: int, target: Array, start: Array, row: str) -> NoReturn:
    """Raise what the compiled loops found wrong with their input."""
    checked(target, (4, 4), f"X_base_tip{row}")
    if code == kernels.BAD_TARGET:
        raise not_a_pose(f"X_base_tip{row}", target)
    raise ConfigurationError(f"q0{row}: every number must be finite, got {shown(start)}")


def _as_array(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """`values` as contiguous float64 of `shape`; the compiled loops check the numbers."""
    array = _stack(values, name)
    if array.shape != shape:
        raise ConfigurationError(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def _stack(values: ArrayLike, name: str) -> Array:
    """`values` as contiguous float64 of any shape."""
    return np.ascontiguousarray(real_array(values, name))
