"""Hull paths past an object with folded arm: their clearance, and a path that keeps clear."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from controllers.mkps import Chain
from controllers.planning.hull_placement import hull_gap, joint_centres, skin_of
from controllers.planning.trajectories import PoseMove
from models.vehicle import Vehicle
from sim.interfaces.spatial import Array, pose, transform_points

CLEARANCE = 0.2  # [m] of hull, joints and tip to the object; covers the tool's size, marine growth and tracking lag
_CHECKED = 40  # number of poses along a move at which its clearance is computed
_BACK = (0.4, 0.8, 1.2)  # [m] detours away from the object, tried in this order where a straight path is too near


class HullPath:
    """Clearance and paths of a vehicle with folded arm beside the convex hull of an object."""

    def __init__(self, vehicle: Vehicle, chain: Chain, hull_box: Array, obstacle: Array) -> None:
        """Take the vehicle and the object.

        Args:
            vehicle: the vehicle, its arm in the home pose.
            chain: kinematics of its arm.
            hull_box: (2, 3) [m] corners of the hull's box in B.
            obstacle: (k, 3) [m] points of the object in W.
        """
        q = np.array(vehicle.q_home)
        arm_A = np.vstack([joint_centres(chain, q), chain.kinematics(q)[0][:3, 3]])
        self._arm_B, self._hull_box = transform_points(np.array(vehicle.X_BA), arm_A), hull_box
        shell = ConvexHull(obstacle)
        self._skin, self._planes, self._middle = skin_of(obstacle, shell), shell.equations, obstacle.mean(axis=0)

    def gap(self, X_WB: Array) -> float:
        """Distance [m] of the hull's box, the arm's joints and its tip to the object; negative inside."""
        arm_W = transform_points(X_WB, self._arm_B)
        to_arm = float((self._planes[:, :3] @ arm_W.T + self._planes[:, 3:]).max(axis=0).min())
        return min(hull_gap(X_WB, self._hull_box, self._skin), to_arm)

    def lowest(self, X_WB: Array) -> float:
        """Height [m] in W of the lowest point of arm joints, tip and underside of a level hull at `X_WB` (4, 4)."""
        arm_W = transform_points(X_WB, self._arm_B)
        return min(float(arm_W[:, 2].min()), float(X_WB[2, 3] + self._hull_box[0, 2]))

    def least_gap(self, poses: Sequence[Array]) -> float:
        """Least distance [m] to the object on straight moves through `poses` (4, 4), each with uniform rotation."""
        return min(
            self.gap(PoseMove(0.0, 1.0, start, end).at(share)[0])
            for start, end in pairwise(poses)
            for share in np.linspace(0.0, 1.0, _CHECKED)
        )

    def way(self, X_from: Array, X_to: Array) -> list[Array]:
        """Poses (4, 4) of a path from `X_from` (4, 4), excluded, to `X_to` (4, 4), included.

        A straight path if it keeps CLEARANCE, or as much as either end has. Otherwise the first detour that does, the
        shortest detours first. If none does, the path with the largest clearance.
        """
        wanted = min(CLEARANCE, self.gap(X_from), self.gap(X_to))
        best, widest = [X_to], -np.inf
        for way in self._ways(X_from, X_to):
            gap = self.least_gap([X_from, *way])
            if gap > widest:
                best, widest = way, gap
            if gap >= wanted - 1e-9:
                break
        return best

    def _ways(self, X_from: Array, X_to: Array) -> Iterator[list[Array]]:
        yield [X_to]
        R_from, R_to = X_from[:3, :3], X_to[:3, :3]
        yield [pose(R_to, X_from[:3, 3]), X_to]  # rotation first, then a straight move: the arm is on the other side
        for back in _BACK:
            yield [pose(R_from, self._off(X_from, back)), pose(R_to, self._off(X_to, back)), X_to]

    def _off(self, X_WB: Array, back: float) -> Array:
        """Position (3,) [m] of a pose, moved horizontally away from the middle of the object by `back` [m]."""
        away = (X_WB[:3, 3] - self._middle) * [1.0, 1.0, 0.0]
        return X_WB[:3, 3] + back * away / max(float(np.linalg.norm(away)), 1e-9)
