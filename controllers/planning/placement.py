"""Hull placements, the surroundings and grid of their search, and the error if there is none."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np
from scipy.spatial import ConvexHull

from uuv.controllers.planning.arm_margins import ArmMargins, Dropped
from uuv.controllers.planning.hull_path import Skin, skin_of
from uuv.controllers.planning.path_poses import STANDOFF_STEPS
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.spatial import Array, exp_so3

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """Hull pose from which the whole path can be worked, with the arm's posture at its start."""

    X_WB: Array  # (4, 4) hull pose at the path's start
    travel_W: Array  # (3,) [m] displacement of the hull by the end of the path
    roll: float  # [rad] rotation of the tool about its own axis from the path's x
    q_start: Array  # (n,) [rad] joint angles at the stand-off before the path's first point
    margin: float  # [-] smallest margin along the path: 1 is far from all limits, 0 is at a limit
    reached: float  # [-] share of the path within reach
    # True: the thrusters bear set force and friction along the whole path, or are not considered
    held: bool = True
    # Displacement (3) [m] in W and turn [rad] of a hull that carries its arm along the path, over
    # the completed share of the path; None: a straight line without turning, by `travel_W`.
    way: "CubicSpline | None" = None
    note: str = ""  # message for the user

    def hull_at(self, share: float) -> Array:
        """Hull pose (4, 4) when the tool has completed `share` [-] of the path."""
        X_WB = self.X_WB.copy()
        if self.way is None:
            X_WB[:3, 3] += share * self.travel_W
            return X_WB

        moved = self.way(min(max(share, 0.0), 1.0))
        X_WB[:3, 3] += moved[:3]
        X_WB[:3, :3] = exp_so3([0.0, 0.0, moved[3]]) @ X_WB[:3, :3]
        return X_WB

    def hull_rate(self, share: float) -> Array:
        """Displacement (3,) [m] of the hull in W per share [-] of the path, at `share` of it."""
        return self.travel_W if self.way is None else self.way(min(max(share, 0.0), 1.0), 1)[:3]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementSearch:
    """Search grid and clearances of the placement; heights and radii in arm lengths."""

    # distances of the base from the middle, against its own axis
    heights: tuple[float, ...] = (0.4, 0.5, 0.6, 0.7)
    # distances of the base from the middle, perpendicular to that axis
    radii: tuple[float, ...] = (0.13, 0.26, 0.4, 0.53)
    bearings: int = 12  # number of directions around the middle
    asides: int = 6  # number of directions across the axis of a base with a horizontal axis
    # [rad] hull yaw, relative to reaching forward
    turns: tuple[float, ...] = (0.0, -0.5 * np.pi, 0.5 * np.pi)
    # [rad] hull yaw relative to facing the surface, for a horizontal axis
    headings: tuple[float, ...] = (-0.6, 0.0, 0.6)
    refinements: tuple[float, ...] = (0.06, 0.02)  # [m] steps of the final local search
    rolls: int = 4  # number of rotations of the tool about its axis
    clearance: float = 0.25  # [m] least distance of the hull to the object
    # [m] distance of joint centres to the object that gives a margin of 1
    arm_clearance: float = 0.06
    samples: int = 15  # number of poses tried along the path

    @classmethod
    def of_size(cls, size: float) -> Self:
        """The search of a vehicle whose lengths are `size` [-] times those of the defaults."""
        usual = cls()
        return cls(
            clearance=size * usual.clearance,
            arm_clearance=size * usual.arm_clearance,
            refinements=tuple(size * step for step in usual.refinements),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """The hull's box, and the objects from which it keeps clear."""

    # (k, 3) [m] points of the object in W; hull and arm keep clear of their convex hull
    obstacle: Array
    hull_box: Array  # (2, 3) [m] corners of the hull's box in B
    # [m] height in W of the seabed, above which the hull keeps its clearance
    floor: float = -np.inf
    shell: ConvexHull = field(init=False, repr=False)  # convex hull of the object
    skin: Skin = field(init=False, repr=False)  # points on it

    def __post_init__(self) -> None:
        """Compute the object's hull, which all candidates share."""
        shell = ConvexHull(self.obstacle)
        object.__setattr__(self, "shell", shell)
        object.__setattr__(self, "skin", skin_of(self.obstacle, shell))


def out_of_reach(
    shares: Array, furthest: Dropped | None, arm: ArmMargins, *, held: bool
) -> ReachError:
    """Error for a path that the arm can follow from no hull pose, with the share that it can
    follow.

    Args:
        shares: [m] arc lengths of the poses tried on the path.
        furthest: result of the best candidate; None: there was no room for the hull.
        arm: margins that were tested.
        held: True: the thrusters were considered.
    """
    while_held = " while the thrusters hold it" if held else ""
    where = "0%: no room for the hull"

    if furthest is not None:
        at = float(shares[min(max(furthest.at - STANDOFF_STEPS, 0), len(shares) - 1)])
        where = f"{furthest.reached:.0%}, up to {at:.2f} m, where {arm.said(furthest)}"

    return ReachError(
        f"the tool path is out of reach: no hull pose lets the arm reach all of it{while_held}; "
        f"at best {where}"
    )
