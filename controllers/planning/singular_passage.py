"""Work from a hull place that was chosen by hand, also through singular postures of the arm.

The search of `uuv.controllers.planning.hull_placement` keeps away from singular postures. A place
that is given may have one on the path, such as the lock of the wrist, where the tool axis is
parallel to the pitch axes. There the joints turn at their speed limit, and the tool leaves its path
by the least amount that this allows (`uuv.controllers.ik.tracking`). How far depends on how closely
the singular posture is missed, and therefore on the drift of the hull: the motion is computed at
the place, and with the hull off it to every side. The work is refused where the tool would be off
by more than its limits.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uuv.controllers.ik.tracking import NEAR
from uuv.controllers.mkps import Tracker, solve
from uuv.controllers.planning.arm_margins import ArmMargins
from uuv.controllers.planning.hull_path import arm_gap
from uuv.controllers.planning.path_poses import STANDOFF_STEPS, tool_pose
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tuning import ArmTuning
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, inverse, pose

_PERIOD = 0.02  # [s] between two poses of a motion that is computed
_STARTS = 24  # number of initial joint values for the postures at the beginning of a path
_POSTURES = 3  # number of these postures that are tried, with the most room to their limits
_ALIKE = 0.05  # [rad] within which two postures are the same
_AT_LIMIT = 1e-3  # [rad] from its limit within which a joint is at it
_TRIED = 3  # number of motions that are computed with drift, the best at the place itself
_CHECKED = 40  # number of poses of a motion at which loads and clearance are tested


@dataclass(frozen=True, slots=True, kw_only=True)
class PassageLimits:
    """Limits of a tool that passes a singular posture."""

    deviation: float = 0.003  # [m] from the path, across the tool axis
    tilt: float = float(np.radians(5.0))  # [rad] of the tool axis
    # [m] by which the hull may be off its place in any direction
    drift: float = 0.01
    # [rad/s] of the fastest joint
    joint_speed: float = ArmTuning().joint_speed_limit


class Passage(NamedTuple):
    """Motion of the arm along a path from one hull pose."""

    q: Array  # (N, n) [rad]
    deviation: float  # [m] largest distance from the path, across the tool axis
    tilt: float  # [rad] largest tilt of the tool axis
    at: float  # [m] arc length at which the larger of both, over its limit, is largest
    near: float  # nearness to singular postures there
    stopped: int  # joint that is at its limit there; -1: none is
    worst: float  # larger of both over its limit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChosenPlace:
    """Hull pose at work that was given, with the tests of the work from there."""

    arm: ArmMargins
    path: ToolPath
    X_WB: Array  # (4, 4) hull pose
    speed: float  # [m/s] of the tool
    standoff: float  # [m] from which the tool approaches
    rolls: int  # number of rotations of the tool about its axis
    limits: PassageLimits = PassageLimits()

    def placement(self, *, checked: bool) -> Placement:
        """The placement with the motion that leaves the path least.

        Args:
            checked: False: also where the tool would leave its path by more than the limits.

        Raises:
            ReachError: The arm does not reach the beginning, cannot bear the force, comes too close
                to the object, or would leave the path.
        """
        motions = sorted(self._at_place(), key=lambda motion: motion[0].worst)
        if not motions:
            raise ReachError("the tool path is out of reach from the chosen place")

        # With the hull off its place, from the best ones on
        best: tuple[Passage, float] | None = None
        for motion, roll in motions[:_TRIED]:
            worst = max(
                (motion, *self._with_drift(motion, roll)), key=lambda passage: passage.worst
            )
            if best is None or worst.worst < best[0].worst:
                best = worst._replace(q=motion.q), roll

        assert best is not None
        passage, roll = best

        # Refused, or begun at the stand-off
        q_start = self._above(passage.q[0], roll)
        assert q_start is not None  # of all postures that are tried
        if checked and passage.worst > 1.0:
            raise ReachError(self._refusal(passage))
        return Placement(
            X_WB=self.X_WB,
            travel_W=np.zeros(3),
            roll=roll,
            q_start=q_start,
            margin=self._margin(passage.q, roll),
            reached=1.0,
            note=self._note(passage),
        )

    def _note(self, passage: Passage) -> str:
        if passage.near >= NEAR:
            return ""
        return (
            f"the arm passes a singular posture at {passage.at:.2f} m of the path: the tool may "
            f"leave the path by {_off(passage)}"
        )

    def _refusal(self, passage: Passage) -> str:
        limits = self.limits
        drifting = f"with the hull off its place by up to {1e3 * limits.drift:.0f} mm"
        off = f"the tool would leave the path by {_off(passage)}"
        allowed = f"{1e3 * limits.deviation:.0f} mm and {np.degrees(limits.tilt):.0f} deg"
        at = f"{passage.at:.2f} m of the path"
        if passage.stopped >= 0:
            joint = self.arm.vehicle.joint_names[passage.stopped]
            return f"{joint} is at its limit at {at}: {drifting}, {off}, allowed are {allowed}"
        if passage.near < NEAR:
            return (
                f"the arm cannot pass its singular posture at {at}: within its joint speeds, and "
                f"{drifting}, {off}, allowed are {allowed}"
            )
        return (
            f"the tool path is out of reach from the chosen place, at {at}: {drifting}, {off}, "
            f"allowed are {allowed}"
        )

    def _at_place(self) -> Iterator[tuple[Passage, float]]:
        """Motions from the place itself by posture at the beginning and roll of the tool."""
        for i in range(1 if self.path.keeps_x else self.rolls):
            roll = 2.0 * np.pi / self.rolls * i
            for q in self._postures(roll):
                yield self._motion(self.X_WB, q, roll), roll

    def _with_drift(self, motion: Passage, roll: float) -> Iterator[Passage]:
        """The same motion with the hull off its place to every side."""
        for way in np.vstack([np.eye(3), -np.eye(3)]):
            X_WB = self.X_WB.copy()
            X_WB[:3, 3] += self.limits.drift * way
            yield self._motion(X_WB, motion.q[0], roll)

    def _postures(self, roll: float) -> list[Array]:
        """Joint values (n,) at the beginning of the path, with the most room to the limits, of
        postures from which the tool reaches its stand-off.
        """
        chain = self.arm.chain
        X_AG = self._tool(self.X_WB, 0.0, roll)
        lower, upper = self.arm.vehicle.q_limits.T
        rng = np.random.default_rng(0)
        starts = [self.arm.vehicle.q_ready, *rng.uniform(lower, upper, (_STARTS, chain.n))]

        postures: list[tuple[float, Array]] = []
        # Different ones, from which the tool reaches its stand-off
        for q0 in starts:
            result = solve(chain, X_AG, q0, 1e-5, 1e-4)
            if not result.converged or any(
                np.abs(result.q - q).max() < _ALIKE for _, q in postures
            ):
                continue
            if self._above(result.q, roll) is not None:
                room = float(np.minimum(result.q - lower, upper - result.q).min())
                postures.append((room, result.q))
        postures.sort(key=lambda entry: -entry[0])
        return [q for _, q in postures[:_POSTURES]]

    def _tool(self, X_WB: Array, s: float, roll: float) -> Array:
        """Tool pose (4, 4) in the arm's base at arc length `s` [m] of the path."""
        return inverse(X_WB @ self.arm.vehicle.X_BA) @ tool_pose(self.path, s, roll)[0]

    def _motion(self, X_WB: Array, q0: Array, roll: float) -> Passage:
        """Motion along the path from joint values `q0` (n,), with the hull at X_WB (4, 4)."""
        chain = self.arm.chain
        length = float(self.path.s[-1])
        at = np.linspace(0.0, length, 1 + int(np.ceil(length / (self.speed * _PERIOD))))
        first = solve(chain, self._tool(X_WB, 0.0, roll), q0, 1e-5, 1e-4, branch="keep")
        tracker = Tracker(chain, _PERIOD, speed_limits=self.limits.joint_speed)
        state = tracker.init(first.q)

        # Errors of the tool at each pose
        q = np.empty((len(at), chain.n))
        off = np.empty((len(at), 2))  # [m], [rad]
        near = np.empty(len(at))
        for i, s in enumerate(at):
            X_AG = self._tool(X_WB, s, roll)
            state, step = tracker.step(state, X_AG)
            reached = chain.forward(step.q)
            aside = reached[:3, 3] - X_AG[:3, 3]
            aside -= (aside @ X_AG[:3, 2]) * X_AG[:3, 2]
            off[i] = np.linalg.norm(aside), _between(reached[:3, 2], X_AG[:3, 2])
            q[i] = step.q
            near[i] = step.nearness

        # Where they are largest over their limits
        shares = (off / [self.limits.deviation, self.limits.tilt]).max(axis=1)
        k = int(np.argmax(shares))
        return Passage(
            q=q,
            deviation=float(off[:, 0].max()),
            tilt=float(off[:, 1].max()),
            at=float(at[k]),
            near=float(near[k]),
            worst=float(shares[k]),
            stopped=self._at_limit(q[k]),
        )

    def _at_limit(self, q: Array) -> int:
        """Joint of `q` (n,) [rad] that is at its limit; -1: none is."""
        lower, upper = self.arm.vehicle.q_limits.T
        room = np.minimum(q - lower, upper - q)
        joint = int(np.argmin(room))
        return joint if room[joint] < _AT_LIMIT else -1

    def _above(self, q: Array, roll: float) -> Array | None:
        """Joint values (n,) at the stand-off before the path's beginning, on the branch of `q`;
        None if it is out of reach.
        """
        X_AG = self._tool(self.X_WB, 0.0, roll)
        for step in self.standoff * np.arange(1, STANDOFF_STEPS + 1) / STANDOFF_STEPS:
            back = pose(X_AG[:3, :3], X_AG[:3, 3] - step * X_AG[:3, 2])
            result = solve(self.arm.chain, back, q, 1e-4, 1e-3, branch="keep")
            if not result.converged:
                return None
            q = result.q
        return q

    def _margin(self, q: Array, roll: float) -> float:
        """Least margin of loads and clearance along a motion (N, n), as of `ArmMargins`.

        Raises:
            ReachError: One is not positive.
        """
        arm = self.arm
        X_AW = inverse(self.X_WB @ arm.vehicle.X_BA)
        lower, upper = arm.vehicle.q_limits.T
        margin = np.inf

        for i in np.unique(np.linspace(0, len(q) - 1, _CHECKED).astype(int)):
            s = float(self.path.s[-1]) * i / (len(q) - 1)
            X_AG, J = arm.chain.kinematics(q[i])
            load = J[:3].T @ (X_AG[:3, 2] * arm.force) / arm.vehicle.torque_limits

            # Left of each limit, as a share
            limits = {
                "a joint cannot bear the set force": 3.0 * (1.0 - float(np.abs(load).max())),
                "the arm comes too close to the object": arm_gap(
                    arm.chain, q[i], X_AW, arm.planes, np.zeros(3)
                )
                / arm.clearance,
            }
            if arm.holding is not None:
                X_WG, tangent, _ = tool_pose(self.path, s, roll)
                drag = arm.holding.drag * X_WG[:3, :3].T @ tangent
                push = -arm.force * (np.array([0.0, 0.0, 1.0]) + drag)
                used = arm.holding.used(q[i], self.X_WB[:3, :3], push)
                limits["the thrusters cannot bear set force and friction"] = 1.0 - used

            # Margin
            for reason, left in limits.items():
                if left <= 0.0:
                    raise ReachError(f"from the chosen place, at {s:.2f} m of the path, {reason}")
            room = float(np.minimum(q[i] - lower, upper - q[i]).min())
            margin = min(margin, 2.0 * room, *limits.values())
        return margin


def _off(passage: Passage) -> str:
    return f"{1e3 * passage.deviation:.1f} mm and {np.degrees(passage.tilt):.1f} deg"


def _between(a: Array, b: Array) -> float:
    """Angle [rad] between two unit vectors (3,)."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
