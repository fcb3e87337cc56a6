"""Margins of the arm along a tool path: joints, torques, singularities, distance, thrust."""

from dataclasses import dataclass, field
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.mkps import Chain, IkOptions, IkResult, solve
from uuv.controllers.planning.arm_size import FULL, reach
from uuv.controllers.planning.hull_path import (
    ROUNDING,
    arm_gap,
    joint_centres_kernel,
    joint_gap_kernel,
)
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, inverse

FEW_STEPS = IkOptions(max_iterations=60)
# [rad] largest error of the tool axis of an arm with fewer joints while the tool presses
TILT = 0.35
_ROOMY_TILT = 0.15  # [rad] error that gives a margin of 1
# share of a shorter arm's length: least singular value of its position Jacobian that gives a margin
# of 1
BENT = 0.3
_LARGEST_STEP = 0.8  # [rad] largest motion of a joint between two poses of a path
_AT_LIMIT = 0.02  # [rad] from its limit within which a joint counts as at the limit, in a message
_ROOMY_THRUST = 0.4  # [-] unused share of thrust, left for the current, that gives a margin of 1
# [m/rad] weight of rotation against translation
_SCALE = np.array([1.0, 1.0, 1.0, 0.4, 0.4, 0.4])[:, None]
_SINGULAR = 0.12  # smallest singular value of the weighted Jacobian that gives a margin of 1


@kernel
def _step_and_room(before, q, low, high):
    """Largest joint step from `before` to `q`, and least distance of `q` (n,) to its limits."""
    jump = 0.0
    room = np.inf
    for j in range(q.shape[0]):
        jump = max(jump, abs(q[j] - before[j]))
        room = min(room, min(q[j] - low[j], high[j] - q[j]))
    return jump, room


@kernel
def _are_above(margin, J, push, torque_limits):
    """True if the margins of torque and singular postures exceed `margin` beyond rounding.

    Args:
        margin: [-]
        J: (6, n) Jacobian of the tip.
        push: (3,) [N] force on it, same axes.
        torque_limits: (n,) [N m]
    """
    n = J.shape[1]
    for j in range(n):
        load = abs(J[0, j] * push[0] + J[1, j] * push[1] + J[2, j] * push[2]) / torque_limits[j]
        if 3.0 * (1.0 - load) < margin + 1e-9:
            return False

    # The smallest singular value is above t if the Gram matrix minus t^2 has a Cholesky
    # factorisation.
    k = min(6, n)
    t = _SINGULAR * margin * (1.0 + 1e-6)
    L = np.empty((k, k))
    trace = 0.0

    for a in range(k):
        for b in range(a + 1):
            # Gram matrix of the weighted Jacobian, less t^2
            total = -t * t if a == b else 0.0
            for m in range(max(6, n)):
                if n < 6:
                    total += J[m, a] * J[m, b] * _SCALE[m, 0] * _SCALE[m, 0]
                else:
                    total += J[a, m] * J[b, m] * _SCALE[a, 0] * _SCALE[b, 0]
            if a == b:
                trace += total

            # Its Cholesky factor
            for m in range(b):
                total -= L[a, m] * L[b, m]
            if a == b:
                if not total > 1e-12 * abs(trace):
                    return False
                L[a, a] = np.sqrt(total)
            else:
                L[a, b] = total / L[b, b]
    return True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolTrack:
    """Tool poses along a path, from the stand-off to the path and back."""

    poses: list[Array]  # k poses (4, 4) in W, relative to the travelling hull
    gone: Array  # (k, 3) [m] displacement of the hull since mid-path at each pose, W
    # (k, 3) [N] force of the world on the tip at each, tool axes; None: thrust is left out
    loads: Array | None = None
    # k poses (4, 4) of a hull that carries its arm along the path; the tool poses are then in W
    # itself, and `gone` is zero. None: the candidate hull pose.
    hulls: list[Array] | None = None
    # (n,) [rad] start of the inverse kinematics; None: the ready posture
    q: Array | None = None


class Limit(Enum):
    """Reason why a path ends for the arm."""

    REACH = auto()  # the inverse kinematics has no solution
    TURN = auto()  # a joint would turn too far between two poses
    JOINT = auto()  # limit of a joint's angle
    TILT = auto()  # tilt of the tool axis
    TORQUE = auto()
    SINGULAR = auto()
    OBJECT = auto()  # nearness of the arm to the object
    THRUST = auto()


class Worked(NamedTuple):
    """Result for a path that the arm can follow from a hull pose."""

    margin: float  # [-] smallest margin along the path
    q_start: Array  # (n,) [rad] joint angles at its first pose


class Dropped(NamedTuple):
    """Result for a path that fails from a hull pose: its first pose that fails."""

    at: int  # index of the pose
    reached: float  # share of the poses before that pose
    limit: Limit
    # (n,) joint angles there [rad]; for TURN the joint steps to that pose [rad], for TORQUE the
    # torques per newton [m]
    q: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmMargins:
    """Margins of the arm at work from a hull pose."""

    vehicle: Vehicle
    chain: Chain  # kinematics of the vehicle's arm
    planes: Array  # (f, 4) faces of the object's convex hull, outward unit normal and offset [m], W
    force: float  # [N] largest set force
    clearance: float  # [m] distance of joint centres to the object that gives a margin of 1
    # thrust margin of the vehicle; None: thrust is not considered
    holding: ThrustMargin | None = None
    _length: float = field(init=False, repr=False)  # [m] length of the stretched arm
    _slides: Array = field(init=False, repr=False)  # (n,) true where a joint is a slide

    def __post_init__(self) -> None:
        """Compute quantities that are the same for all of the thousands of candidates."""
        object.__setattr__(self, "_length", reach(self.chain))
        slides = np.array([kind == "p" for kind in self.chain.joint_types])
        object.__setattr__(self, "_slides", slides)

    def along(self, track: ToolTrack, X_WB: Array, to_beat: float) -> "Worked | Dropped":
        """Smallest margin of a hull pose along tool poses, by inverse kinematics on one branch.

        Args:
            track: the tool poses.
            X_WB: (4, 4) hull pose.
            to_beat: [-] margin that must be exceeded, but at least 0.05; otherwise the candidate is
                dropped.

        Returns:
            The margin with the first joint angles; or the first pose that fails, with the reason.
        """
        X_AW = inverse(X_WB @ self.vehicle.X_BA)
        low = self.vehicle.q_limits[:, 0]
        high = self.vehicle.q_limits[:, 1]
        margin = np.inf
        floor = max(to_beat, 0.05)
        q = self.vehicle.q_ready if track.q is None else track.q
        q_start = None
        full = self.chain.n >= FULL

        for i, X_WG in enumerate(track.poses):
            share = i / len(track.poses)
            if track.hulls is not None:
                X_WB = track.hulls[i]
                X_AW = inverse(X_WB @ self.vehicle.X_BA)

            # Posture at this pose, on the branch of the previous one
            result = posture_for(self.chain, X_AW @ X_WG, q)
            jump, room = _step_and_room(q, result.q, low, high)
            if not result.converged:
                return Dropped(i, share, Limit.REACH, result.q)
            if i and jump > _LARGEST_STEP:
                return Dropped(i, share, Limit.TURN, result.q - q)

            q = result.q
            margin = min(margin, room / 0.5)
            if margin <= floor:  # cheap margins first, since most candidates are rejected by these
                return Dropped(i, share, Limit.JOINT, q)

            # Tilt of the tool axis, where an arm of fewer joints presses
            X_AG, J = self.chain.kinematics(q)
            pressed = track.loads is None or bool(np.any(track.loads[i]))
            if not full and pressed:
                margin = min(margin, (TILT - result.orientation_error) / (TILT - _ROOMY_TILT))
                if margin <= floor:
                    return Dropped(i, share, Limit.TILT, np.array([result.orientation_error]))

            # These two margins and the gap are seldom the smallest; kernels that agree up to
            # rounding decide when to compute them.
            if not (
                full and _are_above(margin, J, X_AG[:3, 2] * self.force, self.vehicle.torque_limits)
            ):
                load = J[:3].T @ (X_AG[:3, 2] * self.force) / self.vehicle.torque_limits
                margin = min(margin, 3.0 * (1.0 - np.abs(load).max()))
                if margin <= floor:
                    return Dropped(i, share, Limit.TORQUE, J[:3].T @ X_AG[:3, 2])

                margin = min(margin, singular_margin(J, self._length))
                if margin <= floor:
                    return Dropped(i, share, Limit.SINGULAR, q)

            # Distance to the object
            centres = joint_centres_kernel(self._slides, self.chain.motions, self.chain.points, q)[
                2 : self.chain.n - 2
            ]
            if (
                joint_gap_kernel(centres, X_AW, self.planes, track.gone[i])
                < margin * self.clearance + ROUNDING
            ):
                gap = arm_gap(self.chain, q, X_AW, self.planes, track.gone[i])
                margin = min(margin, gap / self.clearance)
                if margin <= floor:
                    return Dropped(i, share, Limit.OBJECT, q)

            # Thrust
            if self.holding is not None and track.loads is not None:
                used = self.holding.used(q, X_WB[:3, :3], track.loads[i])
                margin = min(margin, (1.0 - used) / _ROOMY_THRUST)
                if margin <= floor:
                    return Dropped(i, share, Limit.THRUST, q)

            if i == 0:
                q_start = q

        assert q_start is not None
        return Worked(float(margin), q_start)

    def said(self, dropped: "Dropped") -> str:
        """Short description of the reason why a candidate was dropped."""
        vehicle = self.vehicle

        def joint(sizes: Array) -> str:
            return vehicle.joint_names[int(np.argmax(sizes))]

        match dropped.limit:
            case Limit.REACH:
                low = vehicle.q_limits[:, 0]
                high = vehicle.q_limits[:, 1]
                at_limit = np.flatnonzero(np.minimum(dropped.q - low, high - dropped.q) < _AT_LIMIT)
                names = ", ".join(vehicle.joint_names[j] for j in at_limit)
                return (
                    f"{names} {'is' if len(at_limit) == 1 else 'are'} at the limit"
                    if names
                    else "the arm is too short"
                )

            case Limit.TURN:
                return (
                    f"{joint(np.abs(dropped.q))} would turn by "
                    f"{np.degrees(np.abs(dropped.q).max()):.0f} deg in one step"
                )

            case Limit.JOINT:
                low = vehicle.q_limits[:, 0]
                high = vehicle.q_limits[:, 1]
                return f"{joint(-np.minimum(dropped.q - low, high - dropped.q))} reaches its limit"
            case Limit.TILT:
                return f"the tool axis would be tilted by {np.degrees(dropped.q[0]):.0f} deg"

            case Limit.TORQUE:
                return (
                    f"{joint(np.abs(dropped.q) / vehicle.torque_limits)} cannot bear the set force"
                )
            case Limit.SINGULAR:
                return "the arm is stretched, or its wrist"
            case Limit.OBJECT:
                return "the arm comes too close to the object"
            case Limit.THRUST:
                return "the thrusters cannot bear set force and friction"


def singular_margin(J: Array, length: float) -> float:
    """Margin [-] of a posture from singular ones: 1 is far away, 0 is singular.

    Args:
        J: (6, n) Jacobian of the tip; for an arm of fewer than six joints only the position is
            used.
        length: [m] of the stretched arm.
    """
    full = J.shape[1] >= FULL
    weakest = np.linalg.svd(J * _SCALE if full else J[:3], compute_uv=False)[-1]
    return float(weakest) / (_SINGULAR if full else BENT * length)


def posture_for(chain: Chain, X_AG: Array, q: Array) -> IkResult:
    """Inverse kinematics of an arm for a tool pose near `q`, on its branch.

    With fewer than six joints the position is reached, and the tool axis as far as possible.

    Args:
        chain: kinematics of the arm.
        X_AG: (4, 4) tool pose in its base.
        q: (n,) [rad] initial joint angles.
    """
    if chain.n >= FULL:
        return solve(chain, X_AG, q, 1e-4, 1e-3, branch="keep", options=FEW_STEPS)
    return solve(chain, X_AG, q, 1e-4, np.pi, method="priority", options=FEW_STEPS)
