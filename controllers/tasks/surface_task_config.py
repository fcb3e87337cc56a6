"""What contact work is to be done, within which limits, and how far it has come: the supervisor's job and memory."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from controllers.planning.hull_placement import Placement
from controllers.planning.trajectories import JointMove, PoseMove, Progress
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import Target, ToolPath, WorkState
from sim.interfaces.spatial import Array

_HEADROOM = 0.85  # of the force limit that a set force may take


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceTaskConfig:
    """What is to be done, and within which limits."""

    forces: Sequence[float]  # [N] set normal force on equal parts of the path, one after another
    speed: float = 0.02  # [m/s] along the path
    ramp: float = 1.0  # [s] from rest to that speed
    standoff: float = 0.1  # [m] from which the tool approaches
    approach_speed: float = 0.03  # [m/s] while the surface is not yet expected, and of the retreat
    touch_speed: float = 0.004  # [m/s] from `guard` before the expected surface on: 30 N at once on 3.6e5 N/m
    guard: float = 0.03  # [m]
    touch: float = 6.0  # [N] felt force that counts as contact
    touch_time: float = 0.04  # [s] that it must be felt
    search: float = 0.06  # [m] beyond the expected surface that the approach goes on
    tare_after: float = 1.5  # [s] for the arm to come to rest before the torques' bias is taken
    tare_time: float = 2.0  # [s] over which it is taken
    force_rate: float = 60.0  # [N/s] at which a set force changes
    force_limit: float = 160.0  # [N] felt force that ends the work
    lost_time: float = 0.5  # [s] without contact that ends the work
    excess: float = 0.3  # share of the set force, and `touch` more, by which the felt one may be above it
    excess_time: float = 0.3  # [s] so long; else the work ends
    blind_time: float = 5.0  # [s] without vision that the work waits
    press_time: float = 6.0  # [s] within which the first set force must be reached
    lift: float = 0.45  # [m] before the work pose, as the arm's base faces it, at which the arm unfolds
    hull_speed: float = 0.25  # [m/s]
    hull_acceleration: float = 0.08  # [m/s^2]
    hull_turn_rate: float = 0.15  # [rad/s]
    joint_speed: float = 0.5  # [rad/s]
    settle_speed: float = 0.018  # [m/s] below which the hull counts as quiet,
    settle_turn: float = 0.02  # [rad/s] and below which,
    settle_error: float = 0.06  # [m] and within which of its place
    settle_time: float = 4.0  # [s] that it must be quiet
    settle_limit: float = 60.0  # [s] within which it must become quiet, else the current is too strong
    lost_place: float = 0.6  # [m] off its place at which the hull counts as carried away,
    lost_place_at_work: float = 0.04  # [m] and while the tool approaches or touches: a hull that holds stays in 0.025
    scans: int = 3  # views taken before giving up
    finds: int = 6  # of a known object from one view, of which the mean counts,
    find_interval: float = 4.0  # [s] apart
    least_share: float = 1.0  # of the path that must be reached; the rest is left out at both ends alike
    roomy: float = 0.8  # margin of the placement under which the hull travels with the tool,
    cramped: float = 0.6  # and under which less of the path is worked
    force_control: bool = True  # False: go on after `press_time` whatever the force (ablation)
    contactless: float | None = None  # [m] distance from the surface to work at without touching it; None: press

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
    """Where the work stands."""

    state: WorkState
    since: float  # [s] the state was entered
    X_WB: Array  # (4, 4) hull pose held
    q: Array  # (n,) joint angles held while the arm is not following the tool
    X_WB_near: Array | None = None  # (4, 4) it scans from, where it first came nearer
    quiet_since: float = np.inf  # [s]
    still_since: float = 0.0  # [s] hull and arm are asked to stand still
    scans: int = 0
    looks: int = 0  # from this view
    look_from: float = 0.0  # [s] of the next
    finds: tuple[Target, ...] = ()  # from this view
    path: ToolPath | None = None  # in W, as far as it is worked
    placement: Placement | None = None
    hull_move: PoseMove | None = None
    hull_way: list[Array] = field(default_factory=list)  # poses (4, 4) to go through after it
    hull_pace: float = 1.0  # share of its speed at which the hull's move goes on
    hull_waited: float = 0.0  # [s] that it has waited for the hull
    joint_moves: list[JointMove] = field(default_factory=list)
    X_WG: Array | None = None  # (4, 4) tool reference while it is not on the path
    depth: float = 0.0  # [m] of the approach, from the stand-off
    speed: float = 0.0  # [m/s] of the approach
    felt_for: float = 0.0  # [s] that the touch has been felt
    path_s: float = 0.0  # [m]
    work_start: float = 0.0  # [s]
    progress: Progress | None = None
    contact_at: float = 0.0  # [s] of the last felt contact
    held_at: float = 0.0  # [s] the felt force was last no more than allowed
    set_since: float = np.inf  # [s] the first force is held
    force: float = 0.0  # [N] now asked for
    unloading: bool = False  # the work is done, the force goes down
    paused: bool = False
    pace: float = 1.0  # share of its speed at which the path goes on
    arm_held: bool = False  # the hull withdraws the tool, the arm holds `q`
    halted: float = np.inf  # [s] until it is over, once nothing can be controlled
    lost_thrusters: tuple[int, ...] = ()
    adrift: bool = False  # the hull cannot be held as it should be: rise, once the tool is off
    rising_from: Array | None = None  # (3,) [m] where the hull was then, in W
    risen: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] that it has come since
    reason: str = ""  # why the work was broken off
    note: str = ""  # what else the user should know
