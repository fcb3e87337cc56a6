"""Ways of the hull past an object, its arm folded: how near they come, and one that keeps clear."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from controllers.mkps import Chain
from controllers.planning.hull_placement import hull_gap, joint_centres, skin_of
from controllers.planning.trajectories import PoseMove
from models.vehicle import Vehicle
from sim.interfaces.spatial import Array, pose, transform_points

CLEARANCE = 0.2  # [m] of hull, joints and tip to the object: for the tool's size, growth, and a hull that lags
_CHECKED = 40  # poses of a move that are checked
_BACK = (0.4, 0.8, 1.2)  # [m] by which the hull backs off where a straight way comes too near


class HullPath:
    """A vehicle with its arm folded, beside the convex hull of an object."""

    def __init__(self, vehicle: Vehicle, chain: Chain, hull_box: Array, obstacle: Array) -> None:
        """Take the corners (2, 3) [m] of the hull in B, and points (k, 3) [m] of the object in W."""
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
        """Height [m] in W of the lowest of the arm's joints, its tip, and the underside of a level hull at `X_WB`."""
        arm_W = transform_points(X_WB, self._arm_B)
        return min(float(arm_W[:, 2].min()), float(X_WB[2, 3] + self._hull_box[0, 2]))

    def least_gap(self, poses: Sequence[Array]) -> float:
        """The least such distance [m] on straight moves through `poses` (4, 4), each turning evenly."""
        return min(
            self.gap(PoseMove(0.0, 1.0, start, end).at(share)[0])
            for start, end in pairwise(poses)
            for share in np.linspace(0.0, 1.0, _CHECKED)
        )

    def way(self, X_from: Array, X_to: Array) -> list[Array]:
        """Poses (4, 4) to go through from `X_from`; the last is `X_to`.

        Straight there if that keeps CLEARANCE, or as much as either end has; else farther out, as little as that takes;
        if nothing that is tried keeps clear, the way that comes least near.
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
        yield [pose(R_to, X_from[:3, 3]), X_to]  # turning first: a straight way with the arm on the other side
        for back in _BACK:
            yield [pose(R_from, self._off(X_from, back)), pose(R_to, self._off(X_to, back)), X_to]

    def _off(self, X_WB: Array, back: float) -> Array:
        """The place (3,) [m] of a pose, moved away from the middle of the object on its level."""
        away = (X_WB[:3, 3] - self._middle) * [1.0, 1.0, 0.0]
        return X_WB[:3, 3] + back * away / max(float(np.linalg.norm(away)), 1e-9)
