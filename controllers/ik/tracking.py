"""Tracking of a sequence of tool poses, also through singular configurations.

    path = track(chain, X_base_tip, q0, period=0.01)                   # a whole sequence of poses
    tracker = Tracker(chain, period=0.01); state = tracker.init(q0)    # or one pose at a time
    state, step = tracker.step(state, X_base_tip)

Each pose is solved for from the last joint values, by short steps on their branch. Near a singular
configuration this may spin some joints ("looping" in [Danilov 2021, chapter 4, figs. 6 and 7]).
There the arm passes in one of its two ways. `limit` clamps the joints to their travel in one period
at the speed limits. `hold` keeps the joint that would spin constant. The tool then leaves its path
by the least amount that this allows, in position less than in orientation. It returns at the same
speed limits.

Nearness is the smallest singular value of the Jacobian, lengths divided by the scale of the chain.
Lengths thus count in arm lengths, comparable to radians. Nearness 0 is singular, and 1/nearness
bounds the joint speed [rad/s] for a tool speed of 1. Passing begins where nearness is under `near`
and the plain solution exceeds `speed_limits`. It ends where the plain solution is within
`speed_limits` again. By default it is `limit`, which leaves the path least
(scripts/experiments/papers/singular_crossings.py). With `auto` it is `hold` under a quarter of
`near`, else `limit`.

An arm with joints to spare seldom comes so far. While the tool follows its path they move the arm
off singular configurations and joint limits (`uuv.controllers.ik.spare_joints`).
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuv.controllers.ik import chain_kernels as kernels
from uuv.controllers.ik.chain import Chain, memory_of, set_limits
from uuv.controllers.ik.entries import entry
from uuv.controllers.ik.method import Method
from uuv.controllers.ik.pose_parts import count_alike
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    not_a_pose,
    number,
    one_of,
    readonly,
    real_array,
    shown,
    whole_number,
)

Passing = Literal["auto", "limit", "hold", "off"]
Way = Literal["none", "limit", "hold"]

_HOLD_SHARE = 0.25  # share of `near` under which a joint is held
# [s] after which a joint is let go: while it stands still the arm may stay singular
_LONGEST_HOLD = 2.0
_STEPS = 400  # largest number of solver steps per pose
_SPARE_SHARE = 0.5  # of the speed limits, up to which joints to spare move the arm
_SPARE_SPEED = 0.3  # [rad/s] largest speed of a joint that is used for this
NEAR = 0.1  # nearness under which passing may begin
_LEAD = 8.0  # factor of position against orientation errors where the tool must leave its path


def passing_memory(chain: Chain) -> Array:
    """Kernel memory of a chain for a tool that must leave its path: positions count more."""
    return memory_of(chain, _LEAD * chain._scale)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackState:
    """Memory of a `Tracker` from pose to pose."""

    q: Array  # (n,) [rad] or [m]
    way: Way = "none"  # active way of passing a singular configuration
    held: int | None = None  # index of the joint that is held
    held_for: float = 0.0  # [s] for which a joint has been held since passing began


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackStep:
    """Result of one tracked pose."""

    q: Array  # (n,) [rad] or [m]
    qd: Array  # (n,) [rad/s] or [m/s] mean speed since the last pose
    position_error: float  # [m]
    orientation_error: float  # [rad]
    converged: bool  # both errors within their tolerances
    nearness: float  # to singular configurations, at the start of the step (see the module)
    way: Way  # active way of passing
    restricted: NDArray[np.bool_]  # (n,) joints that passing held or clamped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """Result of a tracked sequence, one row per pose; fields as in `TrackStep`."""

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
    """Inverse kinematics of a moving tool pose, sampled every `period` [s].

    It has no state of its own: one tracker may serve many arms and threads.
    """

    def __init__(
        self,
        chain: Chain,
        period: float,
        *,
        speed_limits: ArrayLike = 1.0,
        passing: Passing = "limit",
        near: float = NEAR,
        position_tolerance: float = 1e-6,
        orientation_tolerance: float = 1e-5,
        method: Method = "hybrid",
        hold_joint: int | None = None,
        spare_joints: bool = True,
    ) -> None:
        """Validate and store the options of the tracking.

        Args:
            chain: the serial chain.
            period: [s] between poses.
            speed_limits: [rad/s] or [m/s], one or (n,), kept while a singular configuration is
                passed.
            passing: "limit" never holds a joint. "hold" holds one while the arm is near a singular
                configuration, for 2 s at most. "auto" holds one only very near. "off" tracks the
                pose at any joint speed.
            near: nearness (see the module) under which passing may begin; infinite to keep the
                speed limits everywhere.
            position_tolerance: [m] of each pose.
            orientation_tolerance: [rad] of each pose.
            method: solver, as in `uuv.controllers.mkps.solve`.
            hold_joint: index of the joint that is held, theta_1 in [Danilov 2021]; default: the one
                that would spin.
            spare_joints: with more joints than the tool needs, move off singular postures and joint
                limits on the way (`uuv.controllers.ik.spare_joints`).

        Raises:
            ConfigurationError: for a period, speed limit, nearness or tolerance that is not
                positive and finite, or for an unknown passing, method or joint.
        """
        _check_sizes(period, near, position_tolerance, orientation_tolerance)
        speeds = _checked_speeds(speed_limits, chain.n)
        one_of(passing, get_args(Passing), "passing")
        one_of(method, get_args(Method), "method")
        if hold_joint is not None:
            whole_number(hold_joint, "hold_joint", most=chain.n - 1)
        if not isinstance(spare_joints, bool | np.bool_):
            raise ConfigurationError(
                f"spare_joints: must be True or False, got {shown(spare_joints)}"
            )

        self.hold_joint = hold_joint
        self.chain = chain
        self.period = period
        self.near = near
        self.passing = passing
        self.method = method
        self._travel = speeds * period
        units = np.where([letter == "p" for letter in chain.joint_types], chain._scale, 1.0)
        self._spare_travel = min(float(np.min(units * self._travel)), _SPARE_SPEED * period)

        # Settings of the compiled solver; in an axis stage each axis may take its share of `tol_r`
        tol_p = float(position_tolerance)
        tol_r = float(orientation_tolerance)
        self._tolerances = tol_p, tol_r
        axis = tol_r * 0.5**0.5
        kinds = {
            "plain": kernels.PLAIN,
            "jacobian_free": kernels.JACOBIAN_FREE,
            "priority": kernels.PRIORITY,
        }
        self._settings = kernels.Settings(
            kinds.get(method, kernels.HYBRID), tol_p, tol_r, axis, axis, _STEPS, 0, True, False
        )

        self._memory = passing_memory(chain)
        # The entry of usual calls leaves tolerances that differ very much to another one.
        self._usual = method == "hybrid" and count_alike(_LEAD * chain._scale, tol_p, tol_r)
        self._entry = entry(
            "keep" if self._usual else "traced_keep" if method == "hybrid" else method
        )
        self._rank, blocked = _generic_rank(chain)
        self._spare = blocked if spare_joints and chain.n > self._rank else None

    @property
    def uses_spare_joints(self) -> bool:
        """True if the chain has redundant joints that move it away from singular configurations."""
        return self._spare is not None

    def init(self, q0: ArrayLike) -> TrackState:
        """State at `q0` (n,) [rad] or [m]; ConfigurationError if bad or beyond the limits."""
        q = checked(q0, (self.chain.n,), "q0")

        lower, upper = self.chain.limits.T
        for i in np.flatnonzero((q < lower - 1e-9) | (q > upper + 1e-9)):
            raise ConfigurationError(
                f"q0: {self.chain.names[i]} must be within {lower[i]} and {upper[i]}, got {q[i]}"
            )
        return TrackState(q=readonly(np.clip(q, lower, upper)))

    def step(self, state: TrackState, X_base_tip: ArrayLike) -> tuple[TrackState, TrackStep]:
        """Joint values for the next pose; ConfigurationError if `X_base_tip` (4, 4) is no pose."""
        target = checked(X_base_tip, (4, 4), "X_base_tip")
        nearness, motion = self._weakest(state.q)
        limits = self.chain.limits
        solution = self._solve(target, state.q, limits)

        way: Way = "none"
        held = None

        # Too fast near a singular configuration: pass it within the speed limits
        too_fast = bool(np.any(np.abs(solution.q - state.q) > self._travel))
        if self.passing != "off" and too_fast and (state.way != "none" or nearness < self.near):
            way, held = self._choose(state, nearness, motion)

            lower = np.maximum(limits[:, 0], state.q - self._travel)
            upper = np.minimum(limits[:, 1], state.q + self._travel)
            if held is not None:
                lower[held] = upper[held] = state.q[held]

            limits = np.column_stack([lower, upper])
            solution = self._solve(target, state.q, limits)

        if self._spare is not None and solution.met and held is None:
            solution = self._cleared(target, state.q, solution, limits, self._spare)

        # Joints at a bound that the passing has drawn in, not at one of the arm's own
        lower, upper = limits.T
        restricted = ((solution.q <= lower) & (lower > self.chain.limits[:, 0])) | (
            (solution.q >= upper) & (upper < self.chain.limits[:, 1])
        )

        step = TrackStep(
            q=solution.q,
            qd=readonly((solution.q - state.q) / self.period),
            position_error=solution.position_error,
            orientation_error=solution.orientation_error,
            converged=solution.met,
            nearness=nearness,
            way=way,
            restricted=restricted,
        )

        held_for = state.held_for + self.period * (held is not None) if way != "none" else 0.0
        return TrackState(q=solution.q, way=way, held=held, held_for=held_for), step

    def _choose(self, state: TrackState, nearness: float, motion: Array) -> tuple[Way, int | None]:
        """Way of passing, and the joint to hold, which moves most in the weakest motion."""
        near = self.near if self.passing == "hold" else _HOLD_SHARE * self.near
        if self.passing == "limit" or not nearness < near or state.held_for >= _LONGEST_HOLD:
            return "limit", None  # also on the way back after a joint was held

        if self.hold_joint is not None:
            return "hold", self.hold_joint
        return "hold", int(np.argmax(np.abs(motion))) if state.held is None else state.held

    def _weakest(self, q: Array) -> tuple[float, Array]:
        """Nearness at `q`, and the unit joint motion (n,) that moves the tool least."""
        # Jacobian in arm lengths and radians
        J = self.chain.jacobian(q)
        J[:3] *= self.chain._scale
        slides = np.array([letter == "p" for letter in self.chain.joint_types])
        J[:, slides] /= self.chain._scale

        # The singular vector of the smallest singular value of a rank that the chain can have
        _, nearnesses, motions = np.linalg.svd(J, full_matrices=False)
        return float(nearnesses[self._rank - 1]), motions[self._rank - 1]

    def _cleared(
        self, target: Array, q_last: Array, solution: "_Solution", limits: Array, blocked: Array
    ) -> "_Solution":
        """The solution, moved away from singular configurations and limits by the redundant joints.

        Unchanged where the joints are fast already, or the tool would leave its path.

        Args:
            target: (4, 4) pose.
            q_last: (n,) joint values one period ago.
            solution: within `limits`.
            limits: (n, 2) of the joints in this period.
            blocked: (6, 6) of `spare_motion`.
        """
        rates = np.empty(self.chain.n)
        entry("spare")(self.chain._memory, solution.q, blocked, rates)
        if not np.any(rates):
            return solution

        # Not faster than the share of the speed limits that is for this, or than the fastest joint
        moved = solution.q - q_last
        share = min(max(_SPARE_SHARE, float(np.max(np.abs(moved) / self._travel))), 1.0)
        room = share * self._travel - np.sign(rates) * moved
        with np.errstate(divide="ignore"):
            far = min(self._spare_travel, float(np.min(room / np.abs(rates))))
        if far <= 0.0:
            return solution

        # The tool back on its path, which this leaves to second order
        start = np.clip(solution.q + far * rates, limits[:, 0], limits[:, 1])
        cleared = self._solve(target, start, limits)
        fast = np.abs(cleared.q - q_last) > np.maximum(self._travel, np.abs(moved))
        return cleared if cleared.met and not np.any(fast) else solution

    def _solve(self, target: Array, q0: Array, limits: Array) -> "_Solution":
        """Nearest pose within `limits` by short steps from `q0`."""
        chain = self.chain
        memory = self._memory.copy()
        set_limits(memory, kernels.LOWER, limits[:, 0])
        set_limits(memory, kernels.UPPER, limits[:, 1])

        q = np.empty(chain.n)
        if self._usual:
            outcome = self._entry(memory, target, q0, *self._tolerances, _STEPS, 0, q)
        else:
            outcome = self._entry(memory, target, q0, self._settings, chain._no_trail, q)

        code, _, _, error_p, error_r = outcome
        if code == kernels.BAD_TARGET:
            raise not_a_pose("X_base_tip", target)
        return _Solution(
            q=readonly(q),
            position_error=error_p,
            orientation_error=error_r,
            met=error_p <= self._tolerances[0] and error_r <= self._tolerances[1],
        )


class _Solution(NamedTuple):
    """Joint values for a pose."""

    q: Array  # (n,) [rad] or [m]
    position_error: float  # [m]
    orientation_error: float  # [rad]
    met: bool  # both within their tolerances


class TrackingOptions(TypedDict, total=False):
    """Options of a `Tracker`, by keyword."""

    speed_limits: ArrayLike
    passing: Passing
    near: float
    position_tolerance: float
    orientation_tolerance: float
    method: Method
    hold_joint: int | None
    spare_joints: bool


def track(
    chain: Chain,
    X_base_tip: ArrayLike,
    q0: ArrayLike,
    period: float,
    **options: Unpack[TrackingOptions],
) -> Track:
    """Track a whole sequence of tool poses.

    Joints to spare may lead an arm to where its tool must leave the path. A sequence from which the
    tool would be off is therefore tracked without them too, and that run is returned if its largest
    error of position or of orientation is smaller.

    Args:
        chain: the serial chain.
        X_base_tip: (N, 4, 4) tip poses in the base frame.
        q0: (n,) [rad] or [m] joint values one period before the first pose.
        period: [s] between poses.
        **options: of the `Tracker`, with its defaults.

    Returns:
        Joint values, speeds and errors, one row per pose.

    Raises:
        ConfigurationError: as `Tracker`, and for poses or joint values that are not valid.
    """
    tracker = Tracker(chain, period, **options)

    targets = real_array(X_base_tip, "X_base_tip")
    if targets.ndim != 3 or targets.shape[1:] != (4, 4) or len(targets) == 0:
        raise ConfigurationError(
            f"X_base_tip: expected shape (N, 4, 4) with N > 0, got {targets.shape}"
        )

    run = _tracked(tracker, targets, q0)
    if run.converged.all() or not tracker.uses_spare_joints:
        return run

    options["spare_joints"] = False
    plain = _tracked(Tracker(chain, period, **options), targets, q0)
    farther = (
        run.position_error.max() > plain.position_error.max()
        or run.orientation_error.max() > plain.orientation_error.max()
    )
    return plain if farther else run


def _tracked(tracker: Tracker, targets: Array, q0: ArrayLike) -> Track:
    """Run of a tracker along poses (N, 4, 4) from `q0`."""
    state = tracker.init(q0)
    steps = []
    for target in targets:
        state, step = tracker.step(state, target)
        steps.append(step)

    return Track(
        time=readonly(tracker.period * np.arange(1, len(steps) + 1)),
        q=readonly([step.q for step in steps]),
        qd=readonly([step.qd for step in steps]),
        position_error=readonly([step.position_error for step in steps]),
        orientation_error=readonly([step.orientation_error for step in steps]),
        converged=np.array([step.converged for step in steps]),
        nearness=readonly([step.nearness for step in steps]),
        way=tuple(step.way for step in steps),
        restricted=np.array([step.restricted for step in steps]),
    )


def _check_sizes(
    period: float, near: float, position_tolerance: float, orientation_tolerance: float
) -> None:
    """Refuse numbers of a tracker that are not positive and finite; `near` may be infinite."""
    positive = {
        "period": period,
        "near": near,
        "position_tolerance": position_tolerance,
        "orientation_tolerance": orientation_tolerance,
    }
    for name, value in ((name, number(value, name)) for name, value in positive.items()):
        if not (value > 0.0 and (np.isfinite(value) or name == "near")):
            raise ConfigurationError(f"{name}: must be positive and finite, got {value}")

    if not orientation_tolerance < np.pi:
        raise ConfigurationError(
            "orientation_tolerance: must be under pi, for the whole pose is tracked, got "
            f"{orientation_tolerance:g}"
        )


def _checked_speeds(speed_limits: ArrayLike, n: int) -> Array:
    """Speed limits (n,) [rad/s] or [m/s], one for each joint."""
    speeds = real_array(speed_limits, "speed_limits")
    speeds = checked(
        np.broadcast_to(speeds, (n,)) if speeds.ndim == 0 else speeds, (n,), "speed_limits"
    )
    if not np.all(speeds > 0.0):
        raise ConfigurationError(f"speed_limits: every one must be positive, got {speeds.tolist()}")
    return speeds


def _generic_rank(chain: Chain) -> tuple[int, Array | None]:
    """Rank of the chain's Jacobian almost everywhere (3 for a planar arm), and the projector (6, 6)
    on the twists that its tool never has; None where these depend on the posture.
    """
    rng = np.random.default_rng(0)
    samples = rng.uniform(-3.0, 3.0, (8, chain.n))
    tolerance = 1e-9 * max(1.0, 1.0 / chain._scale)
    jacobians = [chain.jacobian(q) for q in samples]
    rank = max(int(np.linalg.matrix_rank(J, tol=tolerance)) for J in jacobians)

    U, sizes, _ = np.linalg.svd(np.hstack(jacobians))
    if np.sum(sizes > tolerance) > rank:
        return rank, None
    return rank, np.ascontiguousarray(U[:, rank:] @ U[:, rank:].T)
