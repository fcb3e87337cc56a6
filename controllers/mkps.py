"""MKPS inverse kinematics: the method of "finite rotation and displacement" (paper 003), any serial chain.

    chain = Chain.from_dh(dh, limits=limits)
    result = solve(chain, X_base_tip, q0)

This is the door: chains are made in `mkps_chain`, sequences of poses tracked in `mkps_tracking`, the loops compiled.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, NoReturn, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from controllers import mkps_kernels as kernels
from controllers.mkps_chain import Chain, not_a_pose
from controllers.mkps_tracking import Track, Tracker, TrackState, TrackStep, track
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, checked, readonly

__all__ = [
    "Branch", "Chain", "IkBatch", "IkResult", "Method", "Track", "TrackState", "TrackStep", "Tracker", "solve",
    "solve_many", "track",
]  # fmt: skip

Method = Literal["hybrid", "jacobian_free", "plain"]
Branch = Literal["free", "keep"]

_FLOAT64 = np.dtype(np.float64)
_METHODS, _BRANCHES = get_args(Method), get_args(Branch)
_CHUNK = 64  # targets that a thread takes at a time in `solve_many`


@dataclass(frozen=True, slots=True, eq=False)
class IkResult:
    """What `solve` found. `q` is always within the limits, and the errors are those of `q`."""

    q: Array  # (n,) [rad] or [m], read-only
    converged: bool  # both errors are within their tolerances, and the branch was kept if that was asked
    iterations: int  # Levenberg-Marquardt steps, sweeps or macro-iterations, restarts included
    position_error: float  # [m] distance of the tip from the target
    orientation_error: float  # [rad] angle between tip and target, by atan2
    cause: str  # why it ended
    restarts: int = 0  # other starts tried; after any, the answer may lie on another branch than q0
    history: Array | None = None  # (iterations + 1, n) joint values from the start to the answer, if asked for


_CAUSES = {
    kernels.CONVERGED: "converged",
    kernels.STALLED: "no joint values found for this pose; this is the nearest pose found",
    kernels.EXHAUSTED: "max_iterations spent; this is the nearest pose found",
    kernels.BRANCH_LOST: "the pose was reached only beyond a singular configuration, on another branch than q0",
    kernels.OUT_OF_REACH: "the target is farther away than the chain is long; this is the nearest pose found",
}
_RESTARTED = "converged after restarts: the branch may not be that of q0"


def solve(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    position_tolerance: float = 1e-4,
    orientation_tolerance: float = 1e-3,
    method: Method = "hybrid",
    branch: Branch = "free",
    max_iterations: int = 4000,
    max_restarts: int = 200,
    history: bool = False,
) -> IkResult:
    """Joint values within the limits that bring the tip to `X_base_tip` (4, 4), sought from `q0` (n,) [rad] or [m].

    Tolerances are in [m] and [rad]. `branch="keep"` moves from `q0` by short steps only: no restart, no leap by a whole
    turn; for six joints the answer is refused if it lies beyond a singular configuration, unless all joints moved by
    less than half a radian. It is the call for tracking. `branch="free"` restarts, from the same places for the same
    chain and q0, until a pose is met. "Nearest" is by the sum of squares of both errors, metres divided by a power of
    two near the length of the chain. A `q0` beyond the limits is brought within them. With `history` the result holds
    the joint values after every iteration (paper 003, fig. 9).

    Raises ConfigurationError for a target that is not a pose, a bad `q0`, a tolerance that is not positive, and an
    unknown method or branch.
    """
    target = _as_array(X_base_tip, (4, 4), "X_base_tip")
    start = _as_array(q0, (chain.n,), "q0")
    _check_options(position_tolerance, orientation_tolerance, method, branch, max_iterations, max_restarts)
    scale, keep = chain._scale, branch == "keep"
    q, scratch = np.empty(len(start)), np.empty(chain._scratch)
    trail = np.empty((max_iterations + kernels.SETTLE_STEPS + 1, len(start))) if history else chain._no_trail
    given = (chain._joints, chain._ends, scale, target, start, scale * position_tolerance, orientation_tolerance)
    if method == "jacobian_free":
        outcome = kernels.solve_jacobian_free(
            *given, max_iterations, 0 if keep else max_restarts, keep, scratch, q, trail
        )
    elif method == "plain":
        outcome = kernels.solve_plain(*given, max_iterations, keep, scratch, q, trail)
    elif keep:
        outcome = kernels.solve_keep(*given, max_iterations, scratch, q, trail)
    else:
        outcome = kernels.solve_hybrid(*given, max_iterations, max_restarts, scratch, q, trail)
    code, iterations, restarts, error_p, error_r = outcome
    if code >= kernels.BAD_TARGET:
        _refuse(code, target, start, "")
    q.setflags(write=False)
    path = None
    if history:
        trail[iterations] = q  # where nothing converged, the answer is the best of the way
        path = readonly(trail[: iterations + 1])
    return IkResult(
        q, code == kernels.CONVERGED, iterations, error_p / scale, error_r, _cause(code, restarts), restarts, path
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IkBatch:
    """What `solve_many` found, one row a target. `batch[i]` is what `solve` would have returned for target i."""

    q: Array  # (N, n) [rad] or [m], within the limits
    converged: NDArray[np.bool_]  # (N,)
    iterations: NDArray[np.int64]  # (N,)
    position_error: Array  # (N,) [m]
    orientation_error: Array  # (N,) [rad]
    restarts: NDArray[np.int64]  # (N,)
    codes: NDArray[np.int64]  # (N,) why each ended, in the numbers of `mkps_kernels`

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
    max_iterations: int = 4000,
    max_restarts: int = 200,
    threads: int | None = None,
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
    _check_options(position_tolerance, orientation_tolerance, method, branch, max_iterations, max_restarts)
    if threads is None:
        threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if threads < 1:
        raise ConfigurationError(f"threads: must be at least 1, got {threads}")
    keep = branch == "keep"
    q, out = np.empty((count, chain.n)), np.empty((count, 5))

    def work(first: int) -> None:
        kernels.solve_range(
            _METHODS.index(method), chain._joints, chain._ends, chain._scale, targets, starts,
            chain._scale * position_tolerance, orientation_tolerance, max_iterations, 0 if keep else max_restarts, keep,
            first, min(first + _CHUNK, count), np.empty(chain._scratch), q, out,
        )  # fmt: skip

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(0, count, _CHUNK)))
    codes = out[:, 0].astype(np.int64)
    for i in np.flatnonzero(codes >= kernels.BAD_TARGET):
        _refuse(int(codes[i]), targets[i], starts[i], f"[{i}]")
    batch = IkBatch(
        q=q,
        converged=codes == kernels.CONVERGED,
        iterations=out[:, 1].astype(np.int64),
        position_error=out[:, 3].copy(),
        orientation_error=out[:, 4].copy(),
        restarts=out[:, 2].astype(np.int64),
        codes=codes,
    )
    for name in batch.__slots__:
        getattr(batch, name).setflags(write=False)
    return batch


def _check_options(
    position_tolerance: float,
    orientation_tolerance: float,
    method: str,
    branch: str,
    max_iterations: int,
    max_restarts: int,
) -> None:
    if not (position_tolerance > 0.0 and orientation_tolerance > 0.0):
        raise ConfigurationError(
            f"tolerances must be positive, got {position_tolerance} [m] and {orientation_tolerance} [rad]"
        )
    if max_iterations < 1 or max_restarts < 0:
        raise ConfigurationError(
            f"max_iterations must be at least 1 and max_restarts at least 0, got {max_iterations} and {max_restarts}"
        )
    if method not in _METHODS:
        raise ConfigurationError(f"method: allowed {', '.join(_METHODS)}, got {method!r}")
    if branch not in _BRANCHES:
        raise ConfigurationError(f"branch: allowed {', '.join(_BRANCHES)}, got {branch!r}")


def _cause(code: int, restarts: int) -> str:
    return _RESTARTED if restarts and code == kernels.CONVERGED else _CAUSES[code]


def _refuse(code: int, target: Array, start: Array, row: str) -> NoReturn:
    """Raise what the kernel found wrong with its input."""
    checked(target, (4, 4), f"X_base_tip{row}")
    if code == kernels.BAD_TARGET:
        raise not_a_pose(f"X_base_tip{row}", target)
    raise ConfigurationError(f"q0{row}: every number must be finite, got {start.tolist()}")


def _as_array(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """`values` as contiguous float64 of `shape`; as they are where possible, for the kernel checks their numbers."""
    if type(values) is np.ndarray and values.dtype is _FLOAT64 and values.flags.c_contiguous and values.shape == shape:
        return values
    return checked(values, shape, name)


def _stack(values: ArrayLike, name: str) -> Array:
    """`values` as contiguous float64 of any shape; the kernel checks the numbers, row by row."""
    try:
        return np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{name}: expected numbers, got {type(values).__name__}: {error}") from error
