"""Tracking of a tool pose, through singular configurations too (paper 003, chapter 4, figs. 6 and 7).

    path = track(chain, X_base_tip, q0, period=0.01)                   # a whole sequence of poses
    tracker = Tracker(chain, period=0.01); state = tracker.init(q0)    # or one pose at a time
    state, step = tracker.step(state, X_base_tip)

Each pose is solved for from the last joint values, by short steps on their branch. Near a singular configuration this
may spin some joints ("looping" in the paper), so there the arm passes in one of the paper's two ways: `limit` clamps
the joints to what they can travel in a period, `hold` keeps the joint that would spin constant. The tool then leaves
its path, by the least that this allows, its position less than its direction, and comes back at the same speed limits.

Nearness is the smallest singular value of the Jacobian, lengths divided by the scale of the chain, so that it counts
metres of an arm's length and radians alike: 0 is singular, and 1/nearness bounds the joint speed [rad/s] that a tool
speed of 1 may ask for. Passing begins where it is under `near` and the plain answer is too fast for `speed_limits`. It
is `hold` under a quarter of `near`, else `limit`. It ends where the plain answer is slow enough again.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from controllers.ik import kinematics as kernels
from controllers.ik.chain import Chain, memory_of, set_limits
from controllers.ik.entries import entry
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, checked, not_a_pose, number, one_of, readonly, real_array

Passing = Literal["auto", "limit", "hold", "off"]
Way = Literal["none", "limit", "hold"]
TrackingMethod = Literal["hybrid", "jacobian_free", "plain"]

_HOLD_SHARE = 0.25  # of `near`, under which a joint is held
_STEPS = 400  # of the solver a pose
_LEAD = 8.0  # weight of the position against the orientation where the tool must leave its path


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackState:
    """All that a `Tracker` remembers from pose to pose."""

    q: Array  # (n,) [rad] or [m]
    way: Way = "none"  # how it passes a singular configuration, if it does
    held: int | None = None  # index of the joint that is held


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackStep:
    """One pose tracked."""

    q: Array  # (n,) [rad] or [m]
    qd: Array  # (n,) [rad/s] or [m/s] mean speed since the last pose
    position_error: float  # [m]
    orientation_error: float  # [rad]
    converged: bool  # both errors within their tolerances
    nearness: float  # to singular configurations, at the start of the step
    way: Way  # the passing that was active
    restricted: NDArray[np.bool_]  # (n,) joints that passing held or clamped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """A sequence of poses tracked, one row a pose; the fields of `TrackStep`."""

    time: Array  # (N,) [s], the first pose at one period
    q: Array  # (N, n)
    qd: Array  # (N, n)
    position_error: Array  # (N,) [m]
    orientation_error: Array  # (N,) [rad]
    converged: NDArray[np.bool_]  # (N,)
    nearness: Array  # (N,)
    way: tuple[Way, ...]  # (N,)
    restricted: NDArray[np.bool_]  # (N, n)


class Tracker:
    """Follows tool poses given every `period` [s]. Holds no state of its own: one may serve many arms and threads."""

    def __init__(
        self,
        chain: Chain,
        period: float,
        *,
        speed_limits: ArrayLike = 1.0,
        passing: Passing = "auto",
        near: float = 0.1,
        position_tolerance: float = 1e-6,
        orientation_tolerance: float = 1e-5,
        method: TrackingMethod = "hybrid",
    ) -> None:
        """`speed_limits` [rad/s] or [m/s], one or (n,), are kept while a singular configuration is passed.

        `passing`: "auto" chooses, "limit" never holds a joint, "hold" holds one while the arm is near, "off" tracks
        the pose whatever the speed. `near` is the nearness (see the module) under which passing may begin; infinite
        where the speed limits are to be kept everywhere. Tolerances in [m] and [rad].

        Raises ConfigurationError for a period, speed limit, nearness or tolerance that is not positive and finite, and
        for an unknown passing or method.
        """
        given = {
            "period": period,
            "near": near,
            "position_tolerance": position_tolerance,
            "orientation_tolerance": orientation_tolerance,
        }
        for name, value in ((name, number(value, name)) for name, value in given.items()):
            if not (value > 0.0 and (np.isfinite(value) or name == "near")):
                raise ConfigurationError(f"{name}: must be positive and finite, got {value}")
        speeds = real_array(speed_limits, "speed_limits")
        speeds = checked(
            np.broadcast_to(speeds, (chain.n,)) if speeds.ndim == 0 else speeds, (chain.n,), "speed_limits"
        )
        if not np.all(speeds > 0.0):
            raise ConfigurationError(f"speed_limits: every one must be positive, got {speeds.tolist()}")
        one_of(passing, get_args(Passing), "passing")
        one_of(method, get_args(TrackingMethod), "method")
        self.chain, self.period, self.near, self.passing, self.method = chain, period, near, passing, method
        self._travel = speeds * period
        self._tolerances = float(position_tolerance), float(orientation_tolerance)
        self._memory = memory_of(chain, _LEAD * chain._scale)
        self._entry = entry("keep" if method == "hybrid" else method)
        self._rank = _generic_rank(chain)

    def init(self, q0: ArrayLike) -> TrackState:
        """The state at joint values `q0` (n,) [rad] or [m]; ConfigurationError if they are bad or beyond the limits."""
        q = checked(q0, (self.chain.n,), "q0")
        lower, upper = self.chain.limits.T
        for i in np.flatnonzero((q < lower - 1e-9) | (q > upper + 1e-9)):
            raise ConfigurationError(f"q0: {self.chain.names[i]} must be within {lower[i]} and {upper[i]}, got {q[i]}")
        return TrackState(q=readonly(np.clip(q, lower, upper)))

    def step(self, state: TrackState, X_base_tip: ArrayLike) -> tuple[TrackState, TrackStep]:
        """Joint values for the next pose; ConfigurationError if `X_base_tip` (4, 4) is not a pose."""
        target = checked(X_base_tip, (4, 4), "X_base_tip")
        nearness, motion = self._weakest(state.q)
        q, errors, converged = self._solve(target, state.q, self.chain.limits)
        way: Way = "none"
        held = None
        restricted = np.zeros(self.chain.n, dtype=bool)
        too_fast = bool(np.any(np.abs(q - state.q) > self._travel))
        if self.passing != "off" and too_fast and (state.way != "none" or nearness < self.near):
            way, held = self._choose(state, nearness, motion)
            lower = np.maximum(self.chain.limits[:, 0], state.q - self._travel)
            upper = np.minimum(self.chain.limits[:, 1], state.q + self._travel)
            if held is not None:
                lower[held] = upper[held] = state.q[held]
            q, errors, converged = self._solve(target, state.q, np.column_stack([lower, upper]))
            restricted = ((q <= lower) & (lower > self.chain.limits[:, 0])) | (
                (q >= upper) & (upper < self.chain.limits[:, 1])
            )
        step = TrackStep(
            q=q,
            qd=readonly((q - state.q) / self.period),
            position_error=errors[0],
            orientation_error=errors[1],
            converged=converged,
            nearness=nearness,
            way=way,
            restricted=restricted,
        )
        return TrackState(q=q, way=way, held=held), step

    def _choose(self, state: TrackState, nearness: float, motion: Array) -> tuple[Way, int | None]:
        """The way to pass, and the joint to hold: the one that moves most in the weakest motion."""
        near = self.near if self.passing == "hold" else _HOLD_SHARE * self.near
        if self.passing == "limit" or not nearness < near:
            return "limit", None  # the way back from holding too
        return "hold", int(np.argmax(np.abs(motion))) if state.held is None else state.held

    def _weakest(self, q: Array) -> tuple[float, Array]:
        """Nearness at `q`, and the unit joint motion (n,) that moves the tool least though it should."""
        J = self.chain.jacobian(q)
        J[:3] *= self.chain._scale
        slides = np.array([letter == "p" for letter in self.chain.joint_types])
        J[:, slides] /= self.chain._scale
        _, values, motions = np.linalg.svd(J, full_matrices=False)
        return float(values[self._rank - 1]), motions[self._rank - 1]

    def _solve(self, target: Array, q0: Array, limits: Array) -> tuple[Array, tuple[float, float], bool]:
        """The nearest pose within `limits`, by short steps from `q0`: (q, errors [m] [rad], converged)."""
        chain, memory = self.chain, self._memory.copy()
        set_limits(memory, kernels.LOWER, limits[:, 0])
        set_limits(memory, kernels.UPPER, limits[:, 1])
        q = np.empty(chain.n)
        given = (memory, target, q0, *self._tolerances)
        if self.method == "jacobian_free":
            outcome = self._entry(*given, _STEPS, 0, True, chain._no_trail, q)
        elif self.method == "plain":
            axis_tolerance = self._tolerances[1] * 0.5**0.5
            outcome = self._entry(*given, axis_tolerance, axis_tolerance, _STEPS, True, False, chain._no_trail, q)
        else:
            outcome = self._entry(*given, _STEPS, 0, q)
        code, _, _, error_p, error_r = outcome
        if code == kernels.BAD_TARGET:
            raise not_a_pose("X_base_tip", target)
        close = error_p <= self._tolerances[0] and error_r <= self._tolerances[1]
        return readonly(q), (error_p, error_r), close


def track(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    period: float,
    *,
    speed_limits: ArrayLike = 1.0,
    passing: Passing = "auto",
    near: float = 0.1,
    position_tolerance: float = 1e-6,
    orientation_tolerance: float = 1e-5,
    method: TrackingMethod = "hybrid",
) -> Track:
    """Follow the poses `X_base_tip` (N, 4, 4), one every `period` [s], from `q0` (n,); options as for `Tracker`."""
    tracker = Tracker(
        chain,
        period,
        speed_limits=speed_limits,
        passing=passing,
        near=near,
        position_tolerance=position_tolerance,
        orientation_tolerance=orientation_tolerance,
        method=method,
    )
    targets = np.asarray(X_base_tip, dtype=np.float64)
    if targets.ndim != 3 or targets.shape[1:] != (4, 4) or len(targets) == 0:
        raise ConfigurationError(f"X_base_tip: expected shape (N, 4, 4) with N > 0, got {targets.shape}")
    state, steps = tracker.init(q0), []
    for target in targets:
        state, step = tracker.step(state, target)
        steps.append(step)
    return Track(
        time=readonly(period * np.arange(1, len(steps) + 1)),
        q=readonly([step.q for step in steps]),
        qd=readonly([step.qd for step in steps]),
        position_error=readonly([step.position_error for step in steps]),
        orientation_error=readonly([step.orientation_error for step in steps]),
        converged=np.array([step.converged for step in steps]),
        nearness=readonly([step.nearness for step in steps]),
        way=tuple(step.way for step in steps),
        restricted=np.array([step.restricted for step in steps]),
    )


def _generic_rank(chain: Chain) -> int:
    """Rank that the Jacobian of the chain has almost everywhere (3 for a planar arm)."""
    rng = np.random.default_rng(0)
    samples = rng.uniform(-3.0, 3.0, (8, chain.n))
    return max(int(np.linalg.matrix_rank(chain.jacobian(q), tol=1e-9 * max(1.0, 1.0 / chain._scale))) for q in samples)
