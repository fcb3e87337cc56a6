"""Hull placement for arms of fewer than six joints: the hull carries the arm along the path.

Such an arm cannot give its tool any direction. Hull and arm are therefore one chain: three slides
and the yaw of the level hull, then the arm's joints. Its inverse kinematics by priorities gives the
hull pose at every point of the path: the tool's position first, then its axis. Of many working
postures of the arm, the one with the largest margin is used.

The arm alone holds the tool's position while the hull drifts. The tool axis then tilts, which a
round pad tolerates.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.ik.chain import Chain
from uuv.controllers.mkps import IkOptions, solve
from uuv.controllers.planning.arm_margins import BENT, ArmMargins, Dropped, ToolTrack
from uuv.controllers.planning.arm_size import reach
from uuv.controllers.planning.hull_path import Skin, hull_keeps
from uuv.controllers.planning.path_poses import (
    STANDOFF_STEPS,
    samples_along,
    tool_loads,
    tool_poses,
)
from uuv.controllers.planning.placement import (
    Placement,
    PlacementSearch,
    Surroundings,
    out_of_reach,
)
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, readonly

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

HULL_JOINTS = 4  # surge, sway and heave [m] in W, and yaw [rad]
_POSTURES = 512  # number of working postures of the arm that are tried
_KEPT = 24  # number of these that are tried along the whole path
_ENOUGH = 0.7  # margin, from which on no further posture is tried
_INSIDE = 0.1  # share of a joint's range, at both ends, that a working posture avoids
_UPRIGHT = 0.2  # [-] horizontal part of a tool axis, below which it defines no heading
_YAWS = 8  # number of headings of the hull tried under a vertical tool axis
_POSITION, _TILT = 1e-5, 0.02  # [m], [rad] tolerances within which the whole chain reaches the path
_STEPS = IkOptions(max_iterations=60)


def with_hull(chain: Chain, X_BA: Array) -> Chain:
    """The arm's chain behind the hull's: slides along x, y, z of W and the yaw of a level hull.

    Args:
        chain: the arm, base to tip.
        X_BA: (4, 4) pose of the arm's base on the hull.
    """
    R = X_BA[:3, :3]
    free = np.inf * np.array([[-1.0, 1.0]])

    return Chain(
        joint_types="pppr" + chain.joint_types,
        axes=np.vstack([np.eye(3), [[0.0, 0.0, 1.0]], chain.axes @ R.T]),
        points=np.vstack([np.zeros((HULL_JOINTS, 3)), chain.points @ R.T + X_BA[:3, 3]]),
        links=np.vstack([np.zeros((HULL_JOINTS, 3)), chain.links @ R.T]),
        X_base_tip0=X_BA @ chain.X_base_tip0,
        limits=np.vstack([np.repeat(free, HULL_JOINTS, axis=0), chain.limits]),
        travels=np.concatenate([np.ones(HULL_JOINTS), chain.travels]),
        names=("surge", "sway", "heave", "yaw", *chain.names),
    )


def hull_pose(joints: Array) -> Array:
    """Pose (4, 4) of the hull at joint values (4 + n,) of `with_hull`."""
    return pose(exp_so3([0.0, 0.0, joints[3]]), joints[:3])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CarriedArm:
    """Search for the hull's path along a tool path, for an arm that the hull carries along."""

    vehicle: Vehicle
    chain: Chain  # of the arm
    around: Surroundings
    force: float  # [N] largest set force
    standoff: float  # [m] stand-off from which the tool approaches
    search: PlacementSearch
    holding: ThrustMargin | None = None  # thrust margin; None: thrust is not considered

    def place(self, path: ToolPath) -> Placement:
        """Placement with the largest margin for all of `path`.

        Raises:
            ReachError: There is none; the message states how far the best one gets.
        """
        whole = with_hull(self.chain, self.vehicle.X_BA)
        shares = samples_along(path, self.search.samples)

        skin = self.around.skin
        arm = self._margins(self.around.shell.equations)

        drag = self.holding.drag if self.holding else 0.0
        poses = tool_poses(path, shares, 0.0, self.standoff)
        on_path = poses[STANDOFF_STEPS:-STANDOFF_STEPS]
        middle = len(shares) // 2
        most = -np.inf
        best = cast("Placement | None", None)
        furthest = cast("Dropped | None", None)
        met: list[Array] = []

        for start in self._starts(whole, on_path[middle], skin, met):
            if most >= _ENOUGH:
                break

            # The hull's path along the tool path, with clearance everywhere
            hulls = self._along(whole, on_path, middle, start, keeps_x=path.keeps_x)
            if hulls is None or any(not self._has_room(X_WB, skin) for X_WB in hulls):
                continue

            at_ends = [hulls[0]] * STANDOFF_STEPS, [hulls[-1]] * STANDOFF_STEPS
            roll = self._roll(whole, start, on_path[middle])
            track = ToolTrack(
                poses=tool_poses(path, shares, roll, self.standoff),
                gone=np.zeros((len(poses), 3)),
                loads=tool_loads(path, shares, roll, self.force, drag),
                hulls=[*at_ends[0], *hulls, *at_ends[1]],
                q=start[HULL_JOINTS:],
            )

            # Margins of the arm on this path
            outcome = arm.along(track, hulls[0], 0.0)
            if isinstance(outcome, Dropped):
                if best is None and (furthest is None or outcome.reached > furthest.reached):
                    furthest = outcome
                continue

            worth = min(outcome.margin, 1.0) - self._side(start[HULL_JOINTS:])
            if worth <= most:
                continue
            most = worth

            best = Placement(
                X_WB=hulls[0],
                travel_W=readonly(hulls[-1][:3, 3] - hulls[0][:3, 3]),
                roll=roll,
                q_start=outcome.q_start,
                margin=outcome.margin,
                reached=1.0,
                way=_way(shares, hulls),
            )

        if best is None and not met:
            raise ReachError(
                "the tool path is out of reach: with a level hull, no joint angles within the "
                "limits reach the orientation of the tool"
            )
        if best is None:
            raise out_of_reach(shares, furthest, arm, held=self.holding is not None)
        return best

    def _margins(self, planes: Array) -> ArmMargins:
        """Margins of the arm beside an object of faces `planes` (f, 4), as of `ArmMargins`."""
        return ArmMargins(
            vehicle=self.vehicle,
            chain=self.chain,
            planes=planes,
            force=self.force,
            clearance=self.search.arm_clearance,
            holding=self.holding,
        )

    def _postures(self, z_W: Array) -> list[tuple[float, Array, Array]]:
        """Working postures for a tool axis `z_W` (3,), those with the largest margin first.

        Returns:
            Value [-], joint angles (n,) [rad] and tip pose X_BG (4, 4) of each.
        """
        # imported here, since it costs a second and few jobs carry the arm along
        from scipy.stats import qmc

        low, high = self.vehicle.q_limits.T
        span = high - low
        even = qmc.Halton(len(low), scramble=False).random(_POSTURES)
        postures = low + _INSIDE * span + (1.0 - 2.0 * _INSIDE) * span * even

        # Postures in which the first joint is as in the ready posture are tried too
        straight = postures.copy()
        straight[:, 0] = self.vehicle.q_ready[0]
        postures = np.vstack([self.vehicle.q_ready, straight, postures])

        candidates = []
        for q in postures:
            X_BG = self.vehicle.X_BA @ self.chain.kinematics(q)[0]
            J = self.chain.kinematics(q)[1]
            z_B = X_BG[:3, 2]
            if abs(z_B[2] - z_W[2]) > 0.5:  # the hull stays level, so only the arm tilts the tool
                continue

            room = float(np.minimum(q - low, high - q).min())
            push = (
                np.abs(J[:3].T @ self.chain.forward(q)[:3, 2])
                * self.force
                / self.vehicle.torque_limits
            )
            bent = float(np.linalg.svd(J[:3], compute_uv=False)[-1])
            margin = min(room, 1.0 - float(push.max()), bent / (BENT * reach(self.chain)))
            candidates.append((margin - abs(z_B[2] - z_W[2]) - self._side(q), q, X_BG))

        return sorted(candidates, key=lambda candidate: -candidate[0])

    def _starts(self, whole: Chain, X_WG: Array, skin: Skin, met: list[Array]) -> Iterator[Array]:
        """Joint values (4 + n,) of hull and arm for the middle of the path, those with the largest
        margin first.

        `met` collects those that reach it, with or without clearance for the hull.
        """
        fitting = 0
        for _, q, X_BG in self._postures(X_WG[:3, 2]):
            fits = False
            for yaw in self._yaws(X_BG[:3, 2], X_WG[:3, 2]):
                R_WB = exp_so3([0.0, 0.0, yaw])
                near = np.concatenate([X_WG[:3, 3] - R_WB @ X_BG[:3, 3], [yaw], q])
                result = solve(
                    whole,
                    self._round(whole, near, X_WG),
                    near,
                    _POSITION,
                    _TILT,
                    "priority",
                    options=_STEPS,
                )
                if not result.converged:
                    continue

                met.append(result.q)
                if self._has_room(hull_pose(result.q), skin):
                    yield result.q
                    fits = True

            fitting += fits
            if fitting >= _KEPT:
                return

    def _side(self, q: Array) -> float:
        """Lateral offset of the tool at `q` (n,), in arm lengths; a force at such an offset rolls
        the hull.
        """
        return abs(float((self.vehicle.X_BA @ self.chain.forward(q))[1, 3])) / reach(self.chain)

    @staticmethod
    def _yaws(z_B: Array, z_W: Array) -> Array:
        """Headings [rad] of the hull that turn the tool axis of a posture to that of the path."""
        if np.hypot(z_W[0], z_W[1]) < _UPRIGHT:
            return np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False, dtype=np.float64)
        return np.array([np.arctan2(z_W[1], z_W[0]) - np.arctan2(z_B[1], z_B[0])], dtype=np.float64)

    @staticmethod
    def _round(whole: Chain, joints: Array, X_WG: Array) -> Array:
        """Tool pose (4, 4) with position and axis of `X_WG`, and the turn about the axis that it
        has at `joints`.
        """
        z = X_WG[:3, 2]
        x = whole.forward(joints)[:3, 0]
        x = x - (x @ z) * z
        if np.linalg.norm(x) < 1e-3:
            return X_WG
        x = x / np.linalg.norm(x)
        return pose(np.column_stack([x, np.cross(z, x), z]), X_WG[:3, 3])

    def _along(
        self, whole: Chain, poses: list[Array], middle: int, start: Array, *, keeps_x: bool
    ) -> list[Array] | None:
        """Hull poses (4, 4) along the path, from the middle to its ends; None if the path is not
        reached.
        """
        hulls: dict[int, Array] = {}
        for way in (range(middle, len(poses)), range(middle, -1, -1)):
            joints = start
            for i in way:
                target = poses[i] if keeps_x else self._round(whole, joints, poses[i])
                met = solve(whole, target, joints, _POSITION, _TILT, "priority", options=_STEPS)
                if not met.converged:
                    return None
                joints = met.q
                hulls[i] = hull_pose(joints)
        return [hulls[i] for i in range(len(poses))]

    def _has_room(self, X_WB: Array, skin: Skin) -> bool:
        """True if the hull is clear of object and seabed."""
        clearance = self.search.clearance
        box = self.around.hull_box
        above = X_WB[2, 3] + box[0, 2] >= self.around.floor + clearance
        return above and hull_keeps(X_WB, box, skin, clearance)

    @staticmethod
    def _roll(whole: Chain, joints: Array, X_WG: Array) -> float:
        """Turn [rad] of the tool about its axis from that of `X_WG`, at `joints`."""
        x = X_WG[:3, :3].T @ whole.forward(joints)[:3, 0]
        return float(np.arctan2(x[1], x[0]))


def _way(shares: Array, hulls: list[Array]) -> "CubicSpline":
    """Displacement [m] in W and turn [rad] of the hull from its first pose, over the path."""
    from scipy.interpolate import CubicSpline

    p = np.array([X[:3, 3] for X in hulls]) - hulls[0][:3, 3]
    yaw = np.unwrap([np.arctan2(X[1, 0], X[0, 0]) for X in hulls])
    return CubicSpline(shares / shares[-1], np.column_stack([p, yaw - yaw[0]]), bc_type="natural")
