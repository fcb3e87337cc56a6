"""Largest load on the tool that joints and thrusters of a vehicle at rest can bear along a path."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.mkps import Chain
from uuv.controllers.planning.arm_margins import posture_for
from uuv.controllers.planning.path_poses import tool_pose
from uuv.controllers.planning.placement import Placement
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, inverse

_SAMPLES = 9  # poses at which the load is computed
_TORQUE = 0.95  # share of a joint's torque that the work may take
_THRUST = 0.9  # share of a thruster's thrust
_SEARCH = "the search"  # where nothing bounds the load up to the largest one that is computed
LoadAt = Callable[[Array], Array]  # wrench (6,) on the tip, tool axes, for a tool pose (4, 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadBound:
    """Largest load that a vehicle can bear, and what bounds it."""

    most: float  # [N] or [N m]
    by: str  # what bounds it, in words

    def in_words(self, unit: str) -> str:
        """The load in `unit` with what bounds it; or more, where only the search ended."""
        return f"{self.most:.0f} {unit} {'or more' if self.by == _SEARCH else f'({self.by})'}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolStatics:
    """Joints and thrusters of a vehicle that loads its tool."""

    vehicle: Vehicle
    chain: Chain
    holding: ThrustMargin
    most: float = field(default=200.0)  # [N] or [N m] beyond which nothing is computed

    def largest(self, unit: LoadAt, path: ToolPath, placement: Placement) -> LoadBound:
        """Largest multiple of a load that joints and thrusters can bear along a path.

        Args:
            unit: the load of 1 N, or 1 N m.
            path: of the tool.
            placement: where the hull stands.
        """
        X_WB = placement.X_WB
        X_AW = inverse(X_WB @ self.vehicle.X_BA)
        q = placement.q_start
        least = LoadBound(most=self.most, by=_SEARCH)

        for s in np.linspace(0.0, float(path.s[-1]), _SAMPLES):
            X_WG = tool_pose(path, s, placement.roll)[0]
            q = posture_for(self.chain, X_AW @ X_WG, q).q
            load = unit(X_WG)

            # The least of joints and thrusters.
            by_joints = self._by_joints(q, X_WB[:3, :3], load)
            least = min(least, by_joints, key=lambda bound: bound.most)
            by_thrust = self._by_thrust(q, X_WB[:3, :3], load, least.most)
            least = min(least, by_thrust, key=lambda bound: bound.most)
        return least

    def _by_joints(self, q: Array, R_WB: Array, unit: Array) -> LoadBound:
        """Bound of the joint torques, which are linear in the load."""
        rest = self.holding.torques(q, R_WB, np.zeros(6))
        rise = self.holding.torques(q, R_WB, unit) - rest

        limits = _TORQUE * self.vehicle.torque_limits
        with np.errstate(divide="ignore"):
            rooms = (limits - np.sign(rise) * rest) / np.abs(rise)
        j = int(np.argmin(rooms))
        return LoadBound(most=float(rooms[j]), by=self.vehicle.joint_names[j])

    def _by_thrust(self, q: Array, R_WB: Array, unit: Array, most: float) -> LoadBound:
        """Bound of the thrusters below `most`, by halving."""
        by = "the thrusters"
        if self.holding.used(q, R_WB, most * unit) <= _THRUST:
            return LoadBound(most=most, by=by)

        low = 0.0
        step = 0.5 * most
        while step > 1e-3 * most:
            if self.holding.used(q, R_WB, (low + step) * unit) <= _THRUST:
                low += step
            step *= 0.5

        return LoadBound(most=low, by=by)
