"""Configuration and state of the contact-work supervisor: forces, speeds, limits, and progress."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from controllers.planning.hull_placement import Placement
from controllers.planning.trajectories import JointMove, PoseMove, Progress
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import AbortCode, Target, ToolPath, WorkState
from sim.interfaces.spatial import Array

_HEADROOM = 0.85  # largest set force as a share of the force limit; the rest is for overshoot


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceTaskConfig:
    """Parameters of contact work: set forces, speeds, tolerances, time limits."""

    forces: Sequence[float]  # [N] set normal forces on consecutive, equally long parts of the path
    speed: float = 0.02  # [m/s] along the path
    ramp: float = 1.0  # [s] time from rest to that speed
    standoff: float = 0.1  # [m] distance to the surface from which the tool approaches
    approach_speed: float = 0.03  # [m/s] farther than `guard` from the expected surface, and of the retreat
    touch_speed: float = 0.004  # [m/s] nearer than `guard`; gives 30 N at once on 3.6e5 N/m
    guard: float = 0.03  # [m] distance before the expected surface
    touch: float = 6.0  # [N] estimated normal force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last
    search: float = 0.06  # [m] by which the approach goes beyond the expected surface
    tare_after: float = 1.5  # [s] for the arm to come to rest before the torque bias is averaged
    tare_time: float = 2.0  # [s] over which it is averaged
    force_rate: float = 60.0  # [N/s] at which a set force changes
    force_limit: float = 160.0  # [N] estimated normal force above which the work ends
    lost_time: float = 0.5  # [s] without contact after which the work ends
    excess: float = 0.3  # share of the set force, `touch` added, by which the estimated force may exceed it
    excess_time: float = 0.3  # [s] after which a larger excess ends the work
    blind_time: float = 5.0  # [s] without vision after which the work ends; until then it waits
    press_time: float = 6.0  # [s] limit for reaching the first set force
    lift: float = 0.45  # [m] distance before the work pose, along the axis of the arm's base, at which the arm unfolds
    hull_speed: float = 0.25  # [m/s] of a hull move
    hull_acceleration: float = 0.08  # [m/s^2] of a hull move
    hull_turn_rate: float = 0.15  # [rad/s] of a hull move
    joint_speed: float = 0.5  # [rad/s] of the unfolding arm
    settle_speed: float = 0.018  # [m/s] below which the hull counts as at rest, together with
    settle_turn: float = 0.02  # [rad/s] and
    settle_error: float = 0.06  # [m] position error
    settle_time: float = 4.0  # [s] for which it must be at rest
    settle_limit: float = 60.0  # [s] within which that must be reached, else the current is too strong
    lost_place: float = 0.6  # [m] position error of the hull above which the work ends
    lost_place_at_work: float = 0.04  # [m] the same from the approach on; in normal station-keeping it stays in 0.025
    scans: int = 3  # views taken before giving up
    finds: int = 6  # identifications of a known object per view, of which the mean is used
    find_interval: float = 4.0  # [s] between them
    least_share: float = 1.0  # share of the path that must be reached; the rest is cut off equally at both ends
    roomy: float = 0.8  # placement margin under which the hull travels with the tool
    cramped: float = 0.6  # placement margin under which part of the path is left out
    force_control: bool = True  # False: work begins after `press_time` at any force (ablation)
    contactless: float | None = None  # [m] distance at which the tool works without contact; None: it presses

    def __post_init__(self) -> None:
        if not self.forces:
            raise ConfigurationError("forces: at least one set force is needed")
        for force in self.forces:
            if not (np.isfinite(force) and force > 0.0):
                raise ConfigurationError(f"forces: every set force must be > 0 N, got {force}")
            if force > _HEADROOM * self.force_limit:
                raise ConfigurationError(
                    f"forces: {force} N leaves no room for overshoot: at most {_HEADROOM:.0%} of the force limit of "
                    f"{self.force_limit} N"
                )
        if self.contactless is not None and not 0.0 < self.contactless <= self.standoff:
            raise ConfigurationError(
                f"contactless: the distance must be > 0 and at most the stand-off of {self.standoff} m, got "
                f"{self.contactless}"
            )
        if isinstance(self.finds, bool) or self.finds < 1:
            raise ConfigurationError(f"finds: must be at least 1, got {self.finds}")
        if not 0.0 <= self.find_interval < np.inf:
            raise ConfigurationError(f"find_interval: must be >= 0 s, got {self.find_interval}")
        if not self.speed > 0.0:
            raise ConfigurationError(f"speed: must be > 0 m/s, got {self.speed}")


@dataclass(slots=True, eq=False)
class SupervisorState:
    """State of the supervisor of contact work."""

    state: WorkState
    since: float  # [s] time at which the state was entered
    X_WB: Array  # (4, 4) hull pose reference
    q: Array  # (n,) [rad] joint angle reference while the arm does not follow the tool
    X_WB_near: Array | None = None  # (4, 4) nearer hull pose to scan from, if there is one
    quiet_since: float = np.inf  # [s] time since when the hull is at rest; inf: it is not
    still_since: float = 0.0  # [s] time since when hull and arm are asked to stand still
    scans: int = 0  # views so far
    looks: int = 0  # depth frames from this view
    look_from: float = 0.0  # [s] earliest time of the next depth frame
    finds: tuple[Target, ...] = ()  # accepted identifications from this view
    path: ToolPath | None = None  # in W, the part that is worked
    placement: Placement | None = None  # hull pose to work from
    hull_move: PoseMove | None = None  # present move of the hull
    hull_way: list[Array] = field(default_factory=list)  # (4, 4) hull poses of the moves after it
    hull_pace: float = 1.0  # speed of the hull move as a share of that planned
    hull_waited: float = 0.0  # [s] by which the hull move is delayed
    joint_moves: list[JointMove] = field(default_factory=list)  # present move of the arm, if any
    X_WG: Array | None = None  # (4, 4) tool reference while it is not on the path
    depth: float = 0.0  # [m] of the approach, from the stand-off
    speed: float = 0.0  # [m/s] of the approach
    felt_for: float = 0.0  # [s] for which contact has lasted
    path_s: float = 0.0  # [m] arc length reached on the path
    work_start: float = 0.0  # [s] start of `progress`, later by every pause
    progress: Progress | None = None  # along the path
    contact_at: float = 0.0  # [s] time of the last contact
    held_at: float = 0.0  # [s] time at which the force was last within its excess
    set_since: float = np.inf  # [s] time since when the first set force is reached; inf: it is not
    force: float = 0.0  # [N] set force now
    unloading: bool = False  # the work is done, the force ramps down
    paused: bool = False  # the path waits for vision
    pace: float = 1.0  # speed along the path as a share of that planned
    arm_held: bool = False  # the hull withdraws the tool, the arm holds `q`
    halted: float = np.inf  # [s] left until ABORT once no control is possible; inf: it is
    lost_thrusters: tuple[int, ...] = ()  # indices
    adrift: bool = False  # the hull cannot keep station: ascend once the tool is off the surface
    rising_from: Array | None = None  # (3,) [m] position of the hull in W at the start of the ascent
    risen: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] displacement since then, in W
    abort: AbortCode | None = None  # why the work was broken off
    reason: str = ""  # the same in a sentence
    note: str = ""  # other message for the user
