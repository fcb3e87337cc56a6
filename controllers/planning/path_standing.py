"""Choice of the hull placement for a tool path on a known object, and of how much of the path is worked from there."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from controllers.hull.thrust_margin import ThrustMargin
from controllers.mkps import Chain
from controllers.planning.hull_placement import Placement, PlacementSearch, Surroundings, middle_part, place_hull
from models.objects.targets import TargetModel
from models.vehicle import Vehicle
from sim.interfaces.errors import ReachError
from sim.interfaces.messages import Target, ToolPath
from sim.interfaces.spatial import Array, transform_points

_TRAVELS = (0.0, 0.5, 1.0, 1.4)  # travels of the hull that are tried, as shares of the line between the path's ends
_SHORTER = 0.04  # share of a path by which it is shortened per try, where it is too long


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingLimits:
    """What a placement must allow."""

    force: float  # [N] largest set force
    standoff: float  # [m] distance to the surface from which the tool approaches
    least_share: float = 1.0  # share of the path that must be reached; the rest is cut off equally at both ends
    roomy: float = 0.8  # placement margin under which the hull travels with the tool
    cramped: float = 0.6  # placement margin under which part of the path is left out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathStanding:
    """Hull placement beside a known object, for as much of a path as is within reach."""

    vehicle: Vehicle
    chain: Chain  # its arm, base to tool
    model: TargetModel  # of the object
    hull_box: Array  # (2, 3) [m] corners of the hull in B, kept clear of the object and of the seabed
    limits: StandingLimits
    floor: float = -np.inf  # [m] height of the seabed in W
    search: PlacementSearch | None = None  # hull placements that are tried
    holding: ThrustMargin | None = None  # thrust margin of the hull beside the object; None: not tested

    def __call__(self, target: Target, whole: ToolPath) -> tuple[Placement, ToolPath, float]:
        """Best placement, the part of the path worked from it, and its share.

        A placement without thrust margin against the worst friction is accepted as a second choice, marked
        `held=False`.

        Raises:
            ReachError: if there is none.
        """
        obstacle = transform_points(target.X_WT, self.model.vertices)
        try:
            return self._best(obstacle, whole, self.holding)
        except ReachError:
            if self.holding is None:
                raise
        # Friction may be less than the worst case, and a hull that is pushed off its place retreats.
        placement, path, worked = self._best(obstacle, whole, self.holding.without_friction())
        return replace(placement, held=False), path, worked

    def _best(
        self, obstacle: Array, whole: ToolPath, holding: ThrustMargin | None
    ) -> tuple[Placement, ToolPath, float]:
        """Best placement over shares of the path and travels of the hull; raises ReachError if none exists."""
        limits = self.limits
        around = Surroundings(obstacle=obstacle, hull_box=self.hull_box, floor=self.floor)
        best: tuple[Placement, ToolPath, float] | None = None
        failure: ReachError | None = None
        for share, travel in self._candidates():
            if share < 1.0 and best is not None and best[0].margin >= limits.cramped:
                break
            shorter = middle_part(whole, share)
            try:
                found = place_hull(
                    self.vehicle,
                    self.chain,
                    shorter,
                    around=around,
                    force=limits.force,
                    standoff=limits.standoff,
                    travel=travel,
                    search=self.search,
                    holding=holding,
                )
            except ReachError as error:
                failure = failure or error
                continue
            if best is None or found.margin > best[0].margin:
                best = found, shorter, share
            if best[0].margin >= limits.roomy:
                break
        if best is None:
            raise failure or ReachError("there is no way to stand")
        return best

    def _candidates(self) -> Iterator[tuple[float, float]]:
        """Candidates (share of the path to work, travel of the hull as a share of it), the best first."""
        yield from ((1.0, travel) for travel in _TRAVELS)
        share = 1.0 - _SHORTER
        while share >= self.limits.least_share - 1e-9:
            yield share, 1.0
            share -= _SHORTER
