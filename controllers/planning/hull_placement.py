"""Hull placement: the level hull pose, and the arm's posture, that reach a whole tool path.

Candidate positions of the arm's base around the path are tried, each with the hull level. If the
axis of the base points down (or up), the hull is turned so that the arm reaches forward, or at
right angles to that. If the axis is horizontal, the axis faces the surface. Along the path the
inverse kinematics (MKPS [Danilov 2021]) keeps to one branch.

The best candidate maximises the smallest margin. Margins: joint limits, singular postures, torque
limits under the set force, distance to the object, and thrust under that force and its friction.
The thrust margin decides the heading, because a force applied a metre below a hull tilts the hull,
and thrusters have shorter levers in roll.

If the smallest margin is small, the hull may travel while the tool works [Konoplin 2019, section
6]. The hull moves straight, by a share of the line between the ends of the path, at the pace of the
tool. The arm then reaches every point in nearly the posture of the middle, drives stay away from
their limits, and the path may be longer than the arm. `PathStanding` chooses this share, and the
part of the path that is worked.
"""

import itertools
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import ConvexHull

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.mkps import Chain
from uuv.controllers.planning.arm_margins import ArmMargins, Dropped, ToolTrack, posture_for
from uuv.controllers.planning.arm_size import FULL, base_axis, reach, size
from uuv.controllers.planning.carried_arm import CarriedArm
from uuv.controllers.planning.hull_path import hull_keeps, skin_of
from uuv.controllers.planning.hull_place import HullPlace
from uuv.controllers.planning.path_poses import (
    STANDOFF_STEPS,
    from_moving_hull,
    middle_part,
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
from uuv.controllers.planning.promise import MOST_THRUST
from uuv.controllers.planning.singular_passage import ChosenPlace
from uuv.models.objects.targets import TargetModel
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ReachError, StrongCurrentError
from uuv.sim.interfaces.messages import Target, ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, readonly, transform_points

# travels of the hull that are tried, as shares of the line between the path's ends
_TRAVELS = (0.0, 0.5, 1.0, 1.4)
_SHORTER = 0.04  # share of a path by which it is shortened in each try, if it is too long
_STILL = readonly(np.zeros(3))
# relative difference by which a margin must be larger to be preferred, since a round tool turned by
# half has the same margin
_BETTER = 1e-4


def place_hull(
    vehicle: Vehicle,
    chain: Chain,
    path: ToolPath,
    *,
    around: Surroundings,
    force: float,
    standoff: float,
    travel: float = 0.0,
    search: PlacementSearch | None = None,
    holding: ThrustMargin | None = None,
) -> Placement:
    """Hull pose with the largest margin for `path`.

    Args:
        vehicle: the vehicle.
        chain: kinematics of its arm, from base to tip.
        path: tool path in W.
        around: surroundings from which hull and arm keep clear.
        force: [N] largest set force.
        standoff: [m] from which the tool approaches.
        travel: [-] share of the line between the path's ends that the hull travels while the tool
            works.
        search: grid and clearances; None: the defaults.
        holding: thrust margin of the vehicle; None: thrust is not considered.

    Returns:
        The placement, with the hull pose at the start of the path.

    An arm of fewer than six joints is carried along by the hull, see
    `uuv.controllers.planning.carried_arm`.

    Raises:
        ReachError: no candidate reaches all of the path; the message gives the largest share
            reached.
    """
    search = search or PlacementSearch.of_size(size(chain))
    if chain.n < FULL:
        carried = CarriedArm(
            vehicle=vehicle,
            chain=chain,
            around=around,
            force=force,
            standoff=standoff,
            search=search,
            holding=holding,
        )
        return carried.place(path)

    shares = samples_along(path, search.samples)
    rolls = [2.0 * np.pi / search.rolls * i for i in range(1 if path.keeps_x else search.rolls)]
    travel_W = travel * (path.p[-1] - path.p[0])

    # What the tool asks for at each roll, seen from the travelling hull
    gone = _displacements(path, shares, search.samples)[:, None] * travel_W
    drag = holding.drag if holding else 0.0
    tracks = {
        roll: ToolTrack(
            poses=from_moving_hull(tool_poses(path, shares, roll, standoff), gone),
            gone=gone,
            loads=tool_loads(path, shares, roll, force, drag),
        )
        for roll in rolls
    }
    arm = ArmMargins(
        vehicle=vehicle,
        chain=chain,
        planes=around.shell.equations,
        force=force,
        clearance=search.arm_clearance,
        holding=holding,
    )

    candidates = _Candidates(
        arm=arm, tracks=tracks, around=around, clearance=search.clearance, travel_W=travel_W
    )
    middle = 0.5 * (path.p.min(axis=0) + path.p.max(axis=0))
    mounting = _Mounting.of(vehicle.X_BA, base_axis(chain, vehicle.q_ready))
    for base, yaw in mounting.candidates(path, middle, reach(chain), search):
        candidates.consider(base, yaw)

    # Local search around the best candidate, by decreasing steps
    for step in search.refinements:
        while candidates.best is not None:
            near = mounting.neighbours(candidates.best_base, candidates.best_yaw, middle, step)
            better = [candidates.consider(*candidate) for candidate in near]
            if not any(better):
                break

    best = candidates.best
    if best is None:
        raise out_of_reach(shares, candidates.furthest, arm, held=holding is not None)

    # Half of the travel is before mid-path
    start = best.X_WB.copy()
    start[:3, 3] -= 0.5 * travel_W
    return replace(best, X_WB=start)


@dataclass(slots=True, kw_only=True, eq=False)
class _Candidates:
    """Placements that were tried for one path: the best one, or how far one reached."""

    arm: ArmMargins
    tracks: Mapping[float, ToolTrack]  # by the tool's roll [rad]
    around: Surroundings
    clearance: float  # [m] of the hull
    travel_W: Array  # (3,) [m] of the hull along the whole path

    best: Placement | None = None
    best_base: Array = field(
        default_factory=lambda: _STILL
    )  # (3,) [m] of the arm in W, of the best one
    best_yaw: float = 0.0  # [rad]
    furthest: Dropped | None = None

    def consider(self, base: Array, yaw: float) -> bool:
        """Try all tool rolls at an arm base (3,) [m] and hull yaw [rad]; True if better."""
        R_WB = exp_so3([0.0, 0.0, yaw])
        X_WB = pose(R_WB, base - R_WB @ self.arm.vehicle.X_BA[:3, 3])
        if not self._hull_is_clear(X_WB):
            return False

        better = False
        for roll, track in self.tracks.items():
            to_beat = (1.0 + _BETTER) * self.best.margin if self.best else 0.0
            outcome = self.arm.along(track, X_WB, to_beat)
            if isinstance(outcome, Dropped):
                further = self.furthest is None or outcome.reached > self.furthest.reached
                if self.best is None and further:
                    self.furthest = outcome
            elif outcome.margin > to_beat:
                self.best = Placement(
                    X_WB=X_WB,
                    travel_W=self.travel_W,
                    roll=roll,
                    q_start=outcome.q_start,
                    margin=outcome.margin,
                    reached=1.0,
                )
                self.best_base = R_WB @ self.arm.vehicle.X_BA[:3, 3] + X_WB[:3, 3]
                self.best_yaw = yaw
                better = True
        return better

    def _hull_is_clear(self, X_WB: Array) -> bool:
        """Whether the hull keeps clear of seabed and object along its travel about `X_WB`."""
        box = self.around.hull_box
        lowest = X_WB[2, 3] - 0.5 * abs(self.travel_W[2]) + box[0, 2]
        if lowest < self.around.floor + self.clearance:
            return False

        parts = (-0.5, 0.0, 0.5) if self.travel_W.any() else (0.0,)
        return all(
            hull_keeps(X_WB, box, self.around.skin, self.clearance, part * self.travel_W)
            for part in parts
        )


def _displacements(path: ToolPath, shares: Array, samples: int) -> Array:
    """Displacement of a travelling hull from its place at mid-path, as a fraction of its travel,
    for each tool pose.
    """
    even = np.linspace(0.0, float(path.s[-1]), samples)
    done = np.interp(shares, even, np.linspace(-0.5, 0.5, samples))
    return np.pad(done, STANDOFF_STEPS, mode="edge")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Mounting:
    """Mounting of the arm's base on a level hull."""

    axis_B: Array  # (3,) axis of the base towards the work, z_A or its opposite
    sign: float  # 1 if this axis is z_A, else -1
    R_BA: Array  # (3, 3)
    # True: the axis is closer to vertical than to horizontal, and hull yaw rotates about it
    upright: bool
    # [rad] heading on the hull of the arm's forward direction, or of a horizontal axis
    forward: float

    @classmethod
    def of(cls, X_BA: Array, sign: float) -> "_Mounting":
        axis = sign * X_BA[:3, 2]
        reach = X_BA[:3, 0]

        upright = bool(abs(axis[2]) > np.sqrt(0.5))
        ahead = reach if upright else axis
        return cls(
            axis_B=axis,
            sign=sign,
            R_BA=X_BA[:3, :3],
            upright=upright,
            forward=float(np.arctan2(ahead[1], ahead[0])),
        )

    def candidates(
        self, path: ToolPath, middle: Array, reach: float, search: PlacementSearch
    ) -> Iterator[tuple[Array, float]]:
        """Positions (3,) [m] of the arm's base in W, each with the hull's yaw [rad]."""
        if self.upright:
            # Bearings are relative to the path's direction, so that the search turns with the
            # object.
            chord = path.p[-1] - path.p[0]
            start = np.arctan2(chord[1], chord[0])
            bearings = start + np.arange(search.bearings) * (2.0 * np.pi / search.bearings)
            up = -np.sign(self.axis_B[2])
            aside = itertools.product(search.turns, search.heights, search.radii, bearings)
            for turn, height, radius, bearing in aside:
                base = middle + reach * np.array(
                    [radius * np.cos(bearing), radius * np.sin(bearing), up * height]
                )
                yield base, self._facing(base, middle) + turn
            return

        into = path.z.mean(axis=0)  # mean direction of the tool axis
        facing = float(np.arctan2(into[1], into[0])) - self.forward
        asides = np.arange(search.asides) * (2.0 * np.pi / search.asides)

        for turn, height, radius, aside in itertools.product(
            search.headings, search.heights, search.radii, asides
        ):
            R_WA = exp_so3([0.0, 0.0, facing + turn]) @ self.R_BA
            yield (
                middle
                + reach
                * R_WA
                @ [radius * np.cos(aside), radius * np.sin(aside), -self.sign * height],
                facing + turn,
            )

    def neighbours(
        self, base: Array, yaw: float, middle: Array, step: float
    ) -> list[tuple[Array, float]]:
        """Candidates `step` [m] away from a good one, and with yaw changed by 2 `step` [rad]."""
        moved = [base + step * way for way in np.vstack([np.eye(3), -np.eye(3)])]
        turned = [(base, yaw + turn) for turn in (-2.0 * step, 2.0 * step)]  # [rad]

        if self.upright:
            aside = yaw - self._facing(base, middle)
            return [(near, self._facing(near, middle) + aside) for near in moved] + turned
        return [(near, yaw) for near in moved] + turned

    def _facing(self, base: Array, middle: Array) -> float:
        """Hull yaw [rad] with which the arm reaches forward from `base` to `middle`."""
        away = base - middle
        return float(np.arctan2(away[1], away[0])) + np.pi - self.forward


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingLimits:
    """Requirements on a placement."""

    force: float  # [N] largest set force
    standoff: float  # [m] distance to the surface from which the tool approaches
    # share of the path that must be reached; the rest is cut off equally at both ends
    least_share: float = 1.0
    roomy: float = 0.8  # placement margin, below which the hull travels with the tool
    cramped: float = 0.6  # placement margin, below which part of the path is left out
    # share of full thrust for set force and steady current, up to which the hull is not turned
    spared: float = 0.7
    thrust: float = MOST_THRUST  # largest share that they may take
    place: HullPlace | None = None  # chosen by hand; None: searched for
    speed: float = 0.02  # [m/s] of the tool along the path
    # True: from a chosen place also where the tool would leave its path at a singular posture
    unchecked: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathStanding:
    """Hull placement near a known object, for the part of a path that is within reach."""

    vehicle: Vehicle
    chain: Chain  # kinematics of the arm, base to tool
    model: TargetModel  # points of the object
    # (2, 3) [m] corners of the hull in B, kept clear of the object and of the seabed
    hull_box: Array
    limits: StandingLimits
    floor: float = -np.inf  # [m] height of the seabed in W
    search: PlacementSearch | None = None  # search of hull placements
    # thrust margin of the hull near the object; None: not tested
    holding: ThrustMargin | None = None

    def __call__(
        self, target: Target, whole: ToolPath, current_W: Array = _STILL
    ) -> tuple[Placement, ToolPath, float]:
        """Best placement, the part of the path worked from it, and its share.

        A placement without thrust margin against the worst friction is accepted as a second choice,
        marked `held=False`. The placement is first chosen in still water. If set force and current
        would require much thrust there, it is chosen again in the current, which turns the hull.

        Args:
            target: the object.
            whole: tool path on it.
            current_W: (3,) [m/s] steady current, W.

        Raises:
            ReachError: there is no placement.
            StrongCurrentError: the thrusters can hold no placement in the current.
        """
        obstacle = transform_points(target.X_WT, self.model.vertices)
        if self.limits.place is not None:
            X_WB = self.limits.place.in_world(target.X_WT)
            return self._chosen(obstacle, whole, X_WB), whole, 1.0

        try:
            chosen = self._best(obstacle, whole, self.holding)
        except ReachError:
            if self.holding is None:
                raise
            # Friction may be less than the worst case, and a hull that is pushed off its position
            # retreats.
            placement, path, worked = self._best(obstacle, whole, self.holding.without_friction())
            chosen = replace(placement, held=False), path, worked

        if self.holding is None or not np.any(current_W):
            return chosen

        # If set force and current require much thrust, the hull is turned
        moved = self.holding.in_current(current_W)
        smooth = moved.without_friction()
        used = self.used(chosen[0], chosen[1], smooth)
        if used <= self.limits.spared:
            return chosen

        for holding in (moved, smooth):
            with suppress(ReachError):
                turned, path, worked = self._best(obstacle, whole, holding)
                if (least := self.used(turned, path, smooth)) < used:
                    chosen = (replace(turned, held=holding is moved), path, worked)
                    used = least
                break

        if used <= self.limits.thrust:
            return chosen
        raise StrongCurrentError(
            f"the current of {np.linalg.norm(current_W):.2f} m/s is too strong: against it and the "
            f"set force a thruster needs {used:.0%} of its thrust, but at most "
            f"{self.limits.thrust:.0%} is allowed"
        )

    def _chosen(self, obstacle: Array, path: ToolPath, X_WB: Array) -> Placement:
        """Placement at a hull pose (4, 4) that was chosen, or ReachError."""
        limits = self.limits
        search = self.search or PlacementSearch.of_size(size(self.chain))
        if self.chain.n < FULL:
            raise ReachError(
                f"task.hull_place: an arm of {self.chain.n} joints is carried along by its hull, "
                "which needs no place"
            )

        hull = ConvexHull(obstacle)
        skin = skin_of(obstacle, hull)
        height = X_WB[2, 3] + self.hull_box[0, 2] - self.floor
        if height < search.clearance or not hull_keeps(X_WB, self.hull_box, skin, search.clearance):
            raise ReachError(
                f"the chosen place leaves the hull less than {search.clearance:.2f} m to the "
                "object or the seabed"
            )

        arm = ArmMargins(
            vehicle=self.vehicle,
            chain=self.chain,
            planes=hull.equations,
            force=limits.force,
            clearance=search.arm_clearance,
            holding=self.holding,
        )
        chosen = ChosenPlace(
            arm=arm,
            path=path,
            X_WB=X_WB,
            speed=limits.speed,
            standoff=limits.standoff,
            rolls=search.rolls,
        )
        return chosen.placement(checked=not limits.unchecked)

    def used(self, placement: Placement, path: ToolPath, holding: ThrustMargin) -> float:
        """Largest share of full thrust that a thruster uses along a path from a placement.

        Args:
            placement: hull placement for the path.
            path: tool path.
            holding: thrust margin of the vehicle.

        Returns:
            The share [-].
        """
        count = (self.search or PlacementSearch()).samples
        shares = samples_along(path, count)
        poses = tool_poses(path, shares, placement.roll, self.limits.standoff)
        loads = tool_loads(path, shares, placement.roll, self.limits.force, holding.drag)

        done = np.interp(
            shares, np.linspace(0.0, float(path.s[-1]), count), np.linspace(0.0, 1.0, count)
        )
        done = np.pad(done, STANDOFF_STEPS, mode="edge")
        q = placement.q_start
        most = 0.0

        for X_WG, load, share in zip(poses, loads, done, strict=True):
            X_WB = placement.hull_at(share)
            X_AG = inverse(X_WB @ self.vehicle.X_BA) @ X_WG
            q = posture_for(self.chain, X_AG, q).q
            most = max(most, holding.used(q, X_WB[:3, :3], load))
        return most

    def _best(
        self, obstacle: Array, whole: ToolPath, holding: ThrustMargin | None
    ) -> tuple[Placement, ToolPath, float]:
        """Best placement over shares of the path and travels of the hull, or ReachError."""
        limits = self.limits
        around = Surroundings(obstacle=obstacle, hull_box=self.hull_box, floor=self.floor)
        best: tuple[Placement, ToolPath, float] | None = None
        failure: ReachError | None = None

        for share, travel in self._candidates():
            if share < 1.0 and best is not None and best[0].margin >= limits.cramped:
                break
            shorter = middle_part(whole, share)
            try:
                placement = place_hull(
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

            if best is None or placement.margin > best[0].margin:
                best = placement, shorter, share
            if best[0].margin >= limits.roomy:
                break

        if best is None:
            raise failure or ReachError("no hull placement was tried")
        return best

    def _candidates(self) -> Iterator[tuple[float, float]]:
        """Candidates (share of the path to work, share that the hull travels), best first."""
        yield from ((1.0, travel) for travel in (_TRAVELS if self.chain.n >= FULL else (1.0,)))

        share = 1.0 - _SHORTER
        while share >= self.limits.least_share - 1e-9:
            yield share, 1.0
            share -= _SHORTER
