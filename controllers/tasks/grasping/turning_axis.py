"""Way of a tool that turns a handle, and the moment that it can give along that way.

The tool is carried on an arc about the valve's axis and turns with the handle. On a T-bar the arc
has no radius: the tool turns about its own axis.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.tool_statics import LoadBound, ToolStatics
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, readonly

SHORTEST = 0.1  # [m] of the path for 1 rad, where the handle has no lever
_STEP = 0.03  # [rad] between samples of the path


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurningAxis:
    """Axis of a valve with its handle, in W."""

    p: Array  # (3,) [m] point on it at the height of the tip
    a: Array  # (3,) unit; the handle turns right-handed about it
    ahead: Array  # (3,) unit, across the axis: from it to the tip, or along the bar, at the start
    lever: float  # [m] from the axis to the tip

    @property
    def pace(self) -> float:
        """Length [m] of the path for 1 rad."""
        return max(self.lever, SHORTEST)

    def angle(self, X_WG: Array, x_start: Array) -> float:
        """Angle [rad] of a tool pose (4, 4) about the axis, from the start.

        Args:
            X_WG: pose of the tool.
            x_start: (3,) its x axis at the start, used where there is no lever.
        """
        start = self.ahead if self.lever else x_start
        present = X_WG[:3, 3] - self.p if self.lever else X_WG[:3, 0]
        return float(np.arctan2(present @ np.cross(self.a, start), present @ start))

    def moment(self, p: Array, wrench: Array) -> float:
        """Moment [N m] about the axis of a wrench (6,) [N, N m] that acts at `p` (3,) [m], W."""
        return float(self.a @ (np.cross(p - self.p, wrench[:3]) + wrench[3:]))

    def path(self, first: float, last: float) -> ToolPath:
        """Path of the tip with the tool's z against the axis, from angle `first` to `last` [rad].

        The tool's x is across the handle, against the motion.
        """
        count = max(8, 1 + round((last - first) / _STEP))
        angles = np.linspace(first, last, count)
        turns = np.stack([exp_so3(angle * self.a) for angle in angles])

        # The axis of the tool stays, and its x turns.
        ones = np.ones((count, 1))
        return ToolPath(
            s=readonly(self.pace * (angles - first)),
            p=readonly(self.p + self.lever * turns @ self.ahead),
            z=readonly(-ones * self.a),
            x=readonly(turns @ -np.cross(self.a, self.ahead)),
            on_scan=np.zeros(count, dtype=bool),
            keeps_x=True,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurningStatics(ToolStatics):
    """Joints and thrusters of a vehicle that turns a handle."""

    def bound(self, axis: TurningAxis, path: ToolPath, placement: Placement) -> LoadBound:
        """Largest moment [N m] that they can give along a path from a placement.

        Args:
            axis: of the valve.
            path: of the tool.
            placement: where the hull stands.
        """
        return self.largest(partial(_load, axis), path, placement)


def _load(axis: TurningAxis, X_WG: Array) -> Array:
    """Wrench (6,) of the world on the tip for 1 N m about the axis, tool axes."""
    R_GW = X_WG[:3, :3].T
    if not axis.lever:
        return np.concatenate([np.zeros(3), -R_GW @ axis.a])

    arm = X_WG[:3, 3] - axis.p
    arm = arm - (arm @ axis.a) * axis.a
    force = -np.cross(axis.a, arm) / float(arm @ arm)
    return np.concatenate([R_GW @ force, np.zeros(3)])
