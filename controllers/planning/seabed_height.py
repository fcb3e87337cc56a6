"""Height of the vehicle above the seabed for work on it [Konoplin 2019, section 1].

With constant heading the vehicle descends until the arm reaches every point of the path with a
margin. The hull keeps clear of the ground, and the jets of its thrusters do not stir it up. If no
height above the site is feasible, positions next to it are tried. If none is feasible, the work is
refused with the reason.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from uuv.controllers.mkps import Chain
from uuv.controllers.planning.arm_margins import ArmMargins, Dropped, ToolTrack, posture_for
from uuv.controllers.planning.arm_size import reach
from uuv.controllers.planning.hull_path import joint_centres
from uuv.controllers.planning.path_poses import tool_poses
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, checked, inverse, readonly

# Largest shear under a round turbulent jet that strikes a wall perpendicularly from height H
# [Beltaos 1974]: 0.16 rho U0^2 (d / H)^2. Expressed by its thrust rho U0^2 pi d^2 / 4, the diameter
# d cancels.
_SHEAR = 0.16 * 4.0 / np.pi  # [-] largest shear stress times H^2 over thrust


def jet_shear(thrust: float, height: float) -> float:
    """Largest shear stress [Pa] on the ground under a jet of `thrust` [N] at `height` [m]."""
    return _SHEAR * thrust / height**2


def silt_height(thrust: float, critical_shear: float) -> float:
    """Least height [m] of a downward jet of `thrust` [N] over ground of `critical_shear` [Pa]."""
    return float(np.sqrt(_SHEAR * thrust / critical_shear))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSearch:
    """Search grid and constraints of the height search."""

    clearance: float = 0.3  # [m] least distance of the hull to the ground
    arm_clearance: float = 0.06  # [m] least distance of joint centres to the ground
    margin: float = (
        # [-] least margin of the placement (`uuv.controllers.planning.hull_placement`), below which
        # the arm is too close to a limit
        0.1
    )
    roomy: float = 0.5  # [-] margin at which the search ends
    step: float = 0.04  # [m] steps of the descent
    # [m] horizontal offsets from the site, the nearest first
    asides: tuple[float, ...] = (0.0, 0.2, 0.4, 0.6, 0.8)
    directions: int = 8  # number of directions of these offsets
    rolls: int = 4  # number of rotations of the tool about its axis
    samples: int = 15  # number of poses tried along the path
    jet: float = 1.0  # [N] thrust of the strongest downward jet while the hull keeps station
    jets_above: float = 0.0  # [m] height of that thruster above the hull's underside
    # [Pa] shear at which the ground moves: fine sand of 0.2 mm [Soulsby 1997, ch. 6.4]
    critical_shear: float = 0.2

    def __post_init__(self) -> None:
        for name in ("clearance", "arm_clearance", "margin", "step", "critical_shear"):
            if not getattr(self, name) > 0.0:
                raise ConfigurationError(
                    f"height search: {name} must be > 0, got {getattr(self, name)}"
                )
        if not self.jet >= 0.0:
            raise ConfigurationError(f"height search: jet must be >= 0 N, got {self.jet}")
        if min(self.directions, self.rolls, self.samples, len(self.asides)) < 1:
            raise ConfigurationError(
                "height search: directions, rolls, samples and asides must be at least one each"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkHeight:
    """Chosen hull pose above the work site with its clearances."""

    placement: Placement
    aside: float  # [m] horizontal offset from the requested position
    # [m] from the hull to the highest ground below it or within the clearance of its outline
    hull_gap: float
    # [m] from the thrusters to the median ground below, since rocks are not stirred up
    jet_height: float
    shear: float  # [Pa] largest shear on the ground under the jet


def choose_height(
    own: WorkVehicle,
    path: ToolPath,
    *,
    ground: Array,
    X_WB: Array,
    force: float,
    standoff: float,
    search: HeightSearch | None = None,
) -> WorkHeight:
    """Highest feasible hull pose above `path` with a sufficient margin, else the best margin.

    Args:
        own: the vehicle.
        path: tool path in W; from the surface into the ground for a core sampler, along it for a
            box.
        ground: (V, 3) [m] points of the seabed in W, dense enough to show obstacles on it.
        X_WB: (4, 4) level hull pose above the work site, whose position and heading are kept.
        force: [N] largest set force.
        standoff: [m] from which the tool approaches.
        search: grid and constraints; None: the defaults.

    Returns:
        The pose with its clearances.

    Raises:
        ReachError: no pose is feasible; the message gives the reason.
        ConfigurationError: `ground` or `X_WB` is invalid.
    """
    search = search or HeightSearch()
    start = np.array(checked(X_WB, (4, 4), "X_WB"))
    points = _checked_points(ground)
    if start[2, 2] < np.cos(np.radians(5.0)):
        raise ConfigurationError("X_WB: the hull must be level to descend")

    highest = float(path.p[:, 2].max()) + reach(own.chain) - own.vehicle.X_BA[2, 3]
    descents = _Descents(
        vehicle=own,
        search=search,
        points=points,
        tools=_tools(path, search, standoff),
        force=force,
        calm=silt_height(search.jet, search.critical_shear),
    )

    for aside in search.asides:
        for i in range(search.directions if aside else 1):
            bearing = 2.0 * np.pi * i / search.directions
            X = start.copy()
            X[:3, 3] += aside * (start[:3, :3] @ [np.cos(bearing), np.sin(bearing), 0.0])
            X[2, 3] = highest
            if descents.descend(X, aside):
                break

        if descents.best is not None:
            return descents.best
    raise ReachError(f"no feasible working height: {descents.reason}")


def _tools(path: ToolPath, search: HeightSearch, standoff: float) -> dict[float, ToolTrack]:
    """Poses of the tool along the path, by its roll [rad] about its axis."""
    shares = np.linspace(0.0, float(path.s[-1]), search.samples)
    rolls = [2.0 * np.pi / search.rolls * i for i in range(1 if path.keeps_x else search.rolls)]
    poses = {roll: tool_poses(path, shares, roll, standoff) for roll in rolls}
    return {
        roll: ToolTrack(poses=tool, gone=np.zeros((len(tool), 3))) for roll, tool in poses.items()
    }


class _Descents:
    """Descents of a level hull towards the ground, each as far as hull and jets allow."""

    def __init__(
        self,
        *,
        vehicle: WorkVehicle,
        search: HeightSearch,
        points: Array,
        tools: Mapping[float, ToolTrack],
        force: float,
        calm: float,
    ) -> None:
        """Set up, with `points` (V, 3) [m] of the ground and the least height `calm` [m] of the
        jets.
        """
        self.best: WorkHeight | None = None
        self._vehicle = vehicle
        self._search = search
        self._points = points
        self._tools = tools
        self._calm = calm
        self._obstacles = _Obstacles()

        # `arm_gap` tests the arm
        self._tree = cKDTree(points)
        self._arm = ArmMargins(
            vehicle=vehicle.vehicle,
            chain=vehicle.chain,
            planes=np.array([[0.0, 0.0, 0.0, np.inf]]),
            force=force,
            clearance=search.arm_clearance,
        )

    @property
    def reason(self) -> str:
        """Why no height was feasible."""
        return self._obstacles.reason(self._search, self._calm)

    def descend(self, X_WB: Array, aside: float) -> bool:
        """Descend from `X_WB` (4, 4), which is changed, until a tool roll has a roomy margin.

        Args:
            X_WB: pose of the hull at the highest place of interest.
            aside: [m] horizontal offset of that place from the requested one.

        Returns:
            Whether the best margin so far is roomy.
        """
        search = self._search
        gap, over = _hull_gaps(X_WB, self._vehicle.hull_box, self._points, search.clearance)
        if gap == np.inf:
            return False  # no ground points below: the descent would be blind

        over += search.jets_above
        self._obstacles.see(gap - search.clearance, over - self._calm)

        while gap >= search.clearance and over >= self._calm:
            for roll, tool in self._tools.items():
                placement = self._better(X_WB, roll, tool)
                if placement is not None:
                    shear = jet_shear(search.jet, over)
                    self.best = WorkHeight(
                        placement=placement, aside=aside, hull_gap=gap, jet_height=over, shear=shear
                    )

            if self.best is not None and self.best.placement.margin >= search.roomy:
                return True

            X_WB[2, 3] -= search.step
            gap = gap - search.step
            over = over - search.step
        return False

    def _better(self, X_WB: Array, roll: float, tool: ToolTrack) -> Placement | None:
        """Placement of a tool roll at `X_WB`; None if it is not feasible, or no better."""
        search = self._search
        to_beat = self.best.placement.margin if self.best else search.margin
        worked = self._arm.along(tool, X_WB, to_beat)
        reached = worked.reached if isinstance(worked, Dropped) else 1.0
        self._obstacles.furthest = max(self._obstacles.furthest, reached)
        if isinstance(worked, Dropped) or worked.margin < search.margin:
            return None

        X_WA = X_WB @ self._vehicle.vehicle.X_BA
        gap = arm_gap(self._vehicle.chain, X_WA, tool.poses, worked.q_start, self._tree)
        if gap < search.arm_clearance:
            self._obstacles.hit = True
            return None

        return Placement(
            X_WB=readonly(X_WB),
            travel_W=readonly(np.zeros(3)),
            roll=roll,
            q_start=worked.q_start,
            margin=worked.margin,
            reached=1.0,
        )


@dataclass(slots=True)
class _Obstacles:
    """Reasons why the search found no height."""

    known: bool = False  # points of the ground under the hull
    # [m] largest height above the least height, at which the arm is stretched
    room: float = -np.inf
    silt: bool = False  # True: the least height there is that of the jets
    hit: bool = False  # True: the arm reached all of the path, but was too close to the ground
    furthest: float = 0.0  # largest share of the path within reach

    def see(self, hull_room: float, jet_room: float) -> None:
        """Record the heights [m] of hull and jets above their least heights at a position."""
        self.known = True
        if min(hull_room, jet_room) > self.room:
            self.room = min(hull_room, jet_room)
            self.silt = jet_room < hull_room

    def reason(self, search: HeightSearch, calm: float) -> str:
        """Reason why there is no height; `calm` [m] is the least height of the jets."""
        if not self.known:
            return "no point of the ground is known under the hull or beside it"

        why = (
            f"its thrusters must stay {calm:.2f} m over the ground, or a jet of {search.jet:g} N "
            "would stir it up"
            if self.silt
            else f"the hull must stay {search.clearance:.2f} m clear of the ground"
        )
        if self.room < 0.0:
            return f"{why}; that is higher than the arm reaches"
        if self.hit:
            return (
                f"{why}; where the arm reaches the whole path, the arm comes within "
                f"{search.arm_clearance:.2f} m of the ground"
            )
        return (
            f"{why}; at this height and above, the arm reaches at best {self.furthest:.0%} of the "
            f"path, up to {max(search.asides):.1f} m aside"
        )


def _checked_points(ground: Array) -> Array:
    """Points (V, 3) [m] of the ground; ConfigurationError for none, or another shape."""
    points = np.asarray(ground, dtype=np.float64)
    if (
        points.ndim != 2
        or points.shape[1] != 3
        or not len(points)
        or not np.all(np.isfinite(points))
    ):
        raise ConfigurationError(
            f"ground: expected finite points (V, 3), V > 0, got shape {points.shape}"
        )
    return points


def _hull_gaps(X_WB: Array, hull_box: Array, ground: Array, beside: float) -> tuple[float, float]:
    """Heights [m] of the hull's underside above highest and median ground; inf without points.

    Ground within `beside` [m] of the hull's outline is included.
    """
    p_B = (ground - X_WB[:3, 3]) @ X_WB[:3, :3]
    near = np.all(
        (p_B[:, :2] > hull_box[0, :2] - beside) & (p_B[:, :2] < hull_box[1, :2] + beside), axis=1
    )
    if not near.any():
        return np.inf, np.inf
    return float(hull_box[0, 2] - p_B[near, 2].max()), float(
        hull_box[0, 2] - np.median(p_B[near, 2])
    )


def arm_gap(
    chain: Chain, X_WA: Array, tools: list[Array], q_start: Array, ground: cKDTree
) -> float:
    """Least distance [m] of the ground to arm joints and their midpoints, over all tool poses.

    The first joint, at the hull, and the last two, which move into the ground with the tool, are
    left out.

    Args:
        chain: kinematics of the arm.
        X_WA: (4, 4) pose of the arm's base.
        tools: tool poses (4, 4) in W.
        q_start: (n,) [rad] joint angles near the first tool pose.
        ground: tree of the ground points in W.

    Returns:
        The distance [m]; inf for an arm without further joints.
    """
    q = q_start
    gap = np.inf

    for X_WG in tools:
        q = posture_for(chain, inverse(X_WA) @ X_WG, q).q
        joints = joint_centres(chain, q)[: chain.n - 2]
        places = np.vstack([joints[1:], 0.5 * (joints[1:] + joints[:-1])])
        if len(places):
            gap = min(gap, float(ground.query(places @ X_WA[:3, :3].T + X_WA[:3, 3])[0].min()))
    return gap
