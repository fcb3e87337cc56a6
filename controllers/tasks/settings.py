"""User settings of the tasks, which a task's description and its planner inherit.

Nothing here brings compiled kernels, as the planners do.
"""

from dataclasses import dataclass, field, fields
from typing import Any

from uuv.controllers.planning.hull_place import HullPlace
from uuv.controllers.planning.promise import PromiseLimits
from uuv.controllers.planning.trajectories import FASTEST, SLOWEST
from uuv.controllers.tasks.approach_limits import ApproachLimits
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.spatial import finite_number

_MOST_FORCE = 1e3  # [N] beyond the capability of any vehicle here


@dataclass(frozen=True, kw_only=True)
class SurfaceSettings:
    """Settings of work along a path on a surface."""

    forces: tuple[float, ...] = option(
        (60.0, 90.0, 60.0),
        "Set forces [N] on equal parts of the path, by default fewer on a path around the object.",
        group="work",
    )
    speed: float = option(0.02, "Speed of the tool along the path [m/s].", group="work")
    force_rate: float = 60.0  # [N/s] rate of change of the set force
    contactless: float | None = option(
        None,
        "Keep the tool at this distance [m] from the surface without contact, as in [Konoplin "
        "2019]; default: press.",
        group="work",
    )
    least: float = option(
        1.0,
        "Least share of the path that must be within reach; the rest is dropped at both of its "
        "ends, and reported.",
        group="object",
    )
    # place of the hull at work; None: it is searched for, away from singular postures of the arm
    hull_place: HullPlace | None = None
    approach: ApproachLimits = field(default_factory=ApproachLimits)
    promise: PromiseLimits = field(default_factory=PromiseLimits)

    def __post_init__(self) -> None:
        finite_number(self.speed, "task.speed [m/s]", least=SLOWEST, most=FASTEST)
        finite_number(self.least, "task.least, a share of the path", above=0.0, most=1.0)
        finite_number(self.force_rate, "task.force_rate [N/s]", above=0.0)
        if self.contactless is not None:
            finite_number(self.contactless, "task.contactless [m]", above=0.0)

        if not self.forces:
            raise ConfigurationError("task.forces [N]: needs at least one set force, got none")
        for force in self.forces:
            finite_number(force, "task.forces [N]", above=0.0, most=_MOST_FORCE)


@dataclass(frozen=True, kw_only=True)
class InsertionSettings:
    """Settings of an insertion."""

    depth: float = 0.06  # [m] to reach below the mouth, as identified
    compliance: bool = option(True, "Compliance to side forces; without it for ablation.")


@dataclass(frozen=True, kw_only=True)
class SeabedSettings:
    """Settings of work in the seabed."""

    drag: bool = False  # drag a box along the path; False: push a core tube in and withdraw it
    push: float = option(50.0, "Set force on the core tube [N].")
    depth: float = 0.18  # [m] of the box; of a core: depth at which the tube is full


@dataclass(frozen=True, kw_only=True)
class CollectSettings:
    """Settings for an object that is picked up and put into a basket."""

    grip: float = option(40.0, "Set grip force of each finger [N].", group="work")
    load: float = option(
        12.0,
        "Largest weight in water [N] that the work reckons with before the object is lifted; a "
        "heavier one is put back.",
        group="work",
    )
    carry_speed: float = option(0.05, "Speed of the tool with the object [m/s].", group="work")

    def __post_init__(self) -> None:
        finite_number(self.grip, "task.grip [N]", above=0.0, most=_MOST_FORCE)
        finite_number(self.load, "task.load [N]", above=0.0, most=_MOST_FORCE)
        finite_number(self.carry_speed, "task.carry_speed [m/s]", least=SLOWEST, most=FASTEST)


@dataclass(frozen=True, kw_only=True)
class TurnSettings:
    """Settings of a turn of a valve."""

    moment: float = option(
        30.0, "Set moment about the valve's axis [N m], at which the tool stands.", group="work"
    )
    speed: float = option(0.1, "Speed of the handle [rad/s] far below that moment.", group="work")

    def __post_init__(self) -> None:
        finite_number(self.moment, "task.moment [N m]", above=0.0, most=_MOST_FORCE)
        finite_number(self.speed, "task.speed [rad/s]", least=0.01, most=0.5)


@dataclass(frozen=True, kw_only=True)
class PlugSettings:
    """Settings for a plug that is moved from one receptacle into another."""

    grip: float = option(70.0, "Set grip force of each finger [N].", group="work")
    pull: float = option(
        40.0,
        "Largest pull on the plug [N], at which the tool stands; the friction of its seat is "
        "unknown.",
        group="work",
    )
    push: float = option(
        40.0, "Axial force [N] at which the advance into the receptacle stands.", group="work"
    )
    carry_speed: float = option(0.04, "Speed of the tool with the plug [m/s].", group="work")

    def __post_init__(self) -> None:
        finite_number(self.grip, "task.grip [N]", above=0.0, most=_MOST_FORCE)
        finite_number(self.pull, "task.pull [N]", above=0.0, most=_MOST_FORCE)
        finite_number(self.push, "task.push [N]", above=0.0, most=_MOST_FORCE)
        finite_number(self.carry_speed, "task.carry_speed [m/s]", least=SLOWEST, most=FASTEST)


@dataclass(frozen=True, kw_only=True)
class InspectionSettings:
    """Settings of an inspection flight."""

    distance: float = option(1.4, "Distance from the camera to the object's outline [m].")
    clearance: float = option(0.3, "Least clearance of hull and folded arm to all obstacles [m].")
    speed: float = option(0.15, "Speed of the hull [m/s].")


def settings_of(kind: type[Any], task: Any) -> dict[str, Any]:
    """The settings of a class that a task has, by name."""
    return {setting.name: getattr(task, setting.name) for setting in fields(kind)}
