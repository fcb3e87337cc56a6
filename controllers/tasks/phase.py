"""Phases of a task: their protocol, shared data, inputs, and requests to the controller.

A phase is a small object with its own limits. It is entered, stepped once a period, and gives the
set points of that period. `uuv.controllers.tasks.task` runs the phases of a table;
`uuv.controllers.tasks.monitors` watches over them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np

from uuv.controllers.planning.path_poses import tool_pose
from uuv.controllers.planning.placement import Placement
from uuv.sim.interfaces.errors import ConfigurationError, ReachError, StrongCurrentError
from uuv.sim.interfaces.kernels.foresight import EstimateBounds
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    HandleReading,
    JawSetpoint,
    Promise,
    StateEstimate,
    Target,
    ToolAtRest,
    ToolPath,
)
from uuv.sim.interfaces.spatial import Array, readonly

Plan = TypeVar("Plan")
ZERO = readonly(np.zeros(3))
INSTANT = 1e-9  # [s] far below any period: what comes so soon is now
NO_ESTIMATE = "the controller gives no contact estimate: Command.contact.normal [N] is not a number"


class PhaseEvent(StrEnum):
    """End of a phase; the table of the task states the next phase."""

    DONE = "done"
    REFUSED = "refused"  # what was looked for was not found
    TOUCHED = "touched"  # the tool met something that is to be searched along
    MORE = "more"  # done, and there is another place to work at


@dataclass(frozen=True, slots=True)
class Abort:
    """End of the work before its time."""

    code: AbortCode
    reason: str  # the same in a sentence

    def after(self, earlier: "Abort | None") -> "Abort":
        """This abort after an earlier one, whose code is kept."""
        return self if earlier is None else Abort(earlier.code, f"{earlier.reason}; {self.reason}")


@dataclass(frozen=True, slots=True, eq=False)
class ToolLine:
    """Tool path in W from a chosen hull pose, with the straight approach to the path.

    Another way than the straight one changes three places alike: `Held.aside`, set before the tare,
    the velocity of the phase's set point, and `uuv.controllers.planning.hull_placement.tool_poses`,
    by which reach is tested.
    """

    path: ToolPath
    placement: Placement
    # [m] added to `Held.depth`: minus the stand-off where depths are counted from there
    offset: float

    def at(
        self, s: float, depth: float, aside: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[Array, Array, Array]:
        """Tool pose X_WG (4, 4) at a point of the path, and the derivatives of the path's pose.

        Args:
            s: [m] arc length.
            depth: [m] along the tool axis, from the path.
            aside: [m] along the tool's x and y.

        Returns:
            The pose, and the derivatives of position (3,) and orientation (3,) [rad/m] with respect
            to s.
        """
        X, tangent, turn = tool_pose(self.path, s, self.placement.roll)
        X[:3, 3] += X[:3, :3] @ [*aside, depth]
        return X, tangent, turn


@dataclass(slots=True, eq=False)
class Held:
    """Data that the phases of a task share: commanded poses, and results of earlier phases."""

    X_WB: Array  # (4, 4) hull pose reference
    X_WB_scan: Array  # (4, 4) hull pose of the first view
    q: Array  # (n,) [rad] joint angle reference while no tool pose is commanded
    way: list[Array] = field(default_factory=list)  # (4, 4) hull poses to move through next
    views: int = 0  # views so far
    finds: tuple[Target, ...] = ()  # accepted identifications of earlier views
    # (4, 4) hull pose proposed for the next view; None: in the fixed order
    next_X_WB: Array | None = None
    target: Target | None = None  # the accepted identification, the mean of several
    plan: object = None  # of a task's own kind
    line: ToolLine | None = None  # where the tool works
    promise: Promise | None = None  # chance to keep its tolerance
    s: float = 0.0  # [m] arc length reached on the path
    depth: float = 0.0  # [m] of the tool along its axis, see `ToolLine.offset`
    speed: float = 0.0  # [m/s] of that depth
    aside: tuple[float, float] = (0.0, 0.0)  # [m] offset of the tool along its x and y
    set_force: float = 0.0  # [N] normal force to press with
    tries: int = 0  # times that the tool has stopped on its way in
    places: tuple[Array, ...] = ()  # (3,) [m] places in W that were touched
    note: str = ""  # message for the user

    def tool(self, back: float = 0.0) -> tuple[Array, Array, Array]:
        """Tool pose at the present depth minus `back` [m], with derivatives as `ToolLine.at`."""
        assert self.line is not None
        return self.line.at(self.s, self.depth + self.line.offset - back, self.aside)

    def start_of_line(self) -> Placement:
        """Placement of the line."""
        assert self.line is not None
        return self.line.placement

    def off(self, estimate: StateEstimate) -> float:
        """Distance [m] of the hull from its reference."""
        return math.dist(estimate.X_WB[:3, 3].tolist(), self.X_WB[:3, 3].tolist())

    def plan_of(self, kind: type[Plan]) -> Plan:
        """The plan of the task, whose type depends on the task.

        Raises:
            TypeError: It is of another kind, or there is none yet.
        """
        if isinstance(self.plan, kind):
            return self.plan

        raise TypeError(f"plan: expected {kind.__name__}, got {type(self.plan).__name__}")


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """Inputs of a phase in one period."""

    time: float  # [s] that of the estimate if finite, else of the phase's begin
    period: float  # [s]
    estimate: StateEstimate
    target: Target | None  # newest identification
    last: Command | None  # newest command of the controller
    paused: bool = False  # motion is to wait, at a reduced force

    @property
    def normal_sigma(self) -> float:
        """Stated standard deviation of the normal force [N]; inf: none is stated."""
        return math.inf if self.last is None else float(self.last.contact.sigma_G[2])

    @property
    def current_W(self) -> Array:
        """Estimated current (3,) [m/s], W; zero if none is stated."""
        load = None if self.last is None else self.last.hull_load
        return ZERO if load is None else load.current_W

    @property
    def normal(self) -> float:
        """Estimated normal force [N]; 0 if unknown."""
        return (
            self.last.contact.normal if self.last is not None and self.last.contact.known else 0.0
        )

    def contact_force(self, axis_W: Array) -> tuple[float, float]:
        """Estimated contact force along and across the tool axis.

        Args:
            axis_W: (3,) unit direction of advance in W.

        Returns:
            Force [N] against the advance, and magnitude [N] of the force across it.

        Raises:
            ConfigurationError: if the controller does not estimate the contact force.
        """
        if self.last is None or not self.last.contact.known:
            raise ConfigurationError(NO_ESTIMATE)
        f_tip_W = self.last.contact.force_W
        return self.last.contact.normal, float(
            np.linalg.norm(f_tip_W - (f_tip_W @ axis_W) * axis_W)
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setpoint:
    """Set points of a phase in addition to `Held`; fields as those of `Reference`."""

    X_WG: Array | None = None
    v_WG_W: Array = field(default_factory=lambda: ZERO)
    w_WG_W: Array = field(default_factory=lambda: ZERO)
    v_WB_W: Array = field(default_factory=lambda: ZERO)
    w_WB_W: Array = field(default_factory=lambda: ZERO)
    qd: Array | None = None  # None: at rest
    set_force: float = 0.0
    force_control: bool = False
    tare: bool = False
    scan: bool = False
    compliant: bool = False
    standing: bool = False
    touch: int | None = None
    at_rest: ToolAtRest | None = None
    jaws: JawSetpoint | None = None  # for a gripper; None: its drive goes on with the last one
    handle: HandleReading | None = None  # estimated, of the handle that is turned


Outcome = PhaseEvent | Abort | None  # of a period; None: the phase goes on


@dataclass(frozen=True, slots=True)
class Foreseen:
    """Periods of a phase that depend on the time alone."""

    until: float = math.inf  # [s] first time of one that may not
    # while the estimate is within these
    within: EstimateBounds = field(default_factory=EstimateBounds)


_ALL = Foreseen()


class Phase:
    """Base of all phases; one that overrides nothing holds hull and joint angles for ever."""

    def enter(self, held: Held, context: Context) -> Any:
        """State of the phase at its begin."""
        del held, context

    def step(self, state: Any, held: Held, context: Context) -> Outcome:
        """Advance by one period; `state` and `held` are changed in place.

        Args:
            state: state of the phase.
            held: what the phases share.
            context: estimate, target and contact of this period.

        Returns:
            None while the phase goes on, else how it ended.
        """
        del state, held, context
        return None

    def setpoint(self, state: Any, held: Held, context: Context) -> Setpoint:
        """Set points of this period; changes nothing.

        Args:
            state: state of the phase.
            held: what the phases share.
            context: estimate, target and contact of this period.

        Returns:
            The set points.
        """
        del state, held, context
        return Setpoint()

    def foresee(self, state: Any, held: Held) -> Foreseen | None:
        """The next periods, if `step` and `setpoint` read only time and period of `Context`.

        Of its estimate they may use what does not change while that is within the bounds given
        here: the hull counts as being at its reference.

        Both are then called ahead of time on copies of `state` and `held`, whose fields they may
        assign, but whose arrays and parts they must not change. A phase that overrides one of them
        gives this too, or nothing of it is foreseen; one that goes by the time in all periods
        repeats `foresee = Phase.foresee`.

        Args:
            state: state of the phase, after a step that went on.
            held: what the phases share.

        Returns:
            How far that is so, while the work is not paused; None: not in the next period.
        """
        del state, held
        return _ALL


class Hold(Phase):
    """Hold hull and joint angles: the end of a task with the arm away from the object."""


class HoldTool(Phase):
    """Hold the tool where the retreat ended: the end of a task beside the object."""

    foresee = Phase.foresee

    def __init__(self, clearance: float = 0.0) -> None:
        self._clearance = clearance

    def setpoint(self, state: Any, held: Held, context: Context) -> Setpoint:
        """The tool at the end of `Retreat`."""
        del state, context
        return Setpoint(X_WG=held.tool(way_back(held, self._clearance))[0])


class Decide(Phase):
    """A decision within one period that may fail, such as on a placement or a move."""

    def __init__(self, decide: Callable[[Held, Context], None], code: AbortCode) -> None:
        """Set up the phase.

        Args:
            decide: writes its result into `Held`; raises ReachError if there is none.
            code: that of the abort then.
        """
        self._decide = decide
        self._code = code

    def step(self, state: Any, held: Held, context: Context) -> Outcome:
        """Decide, or abort with the message of the ReachError."""
        del state
        try:
            self._decide(held, context)
        except StrongCurrentError as error:
            return Abort(AbortCode.CURRENT, str(error))
        except ReachError as error:
            return Abort(self._code, str(error))
        return PhaseEvent.DONE


def way_back(held: Held, clearance: float) -> float:
    """Length [m] of the way off the surface: the approach, at least `clearance`; 0 without that."""
    return max(held.depth, clearance) if clearance else 0.0


def towards(value: float, wanted: float, most: float) -> float:
    """`value`, moved towards `wanted` by `most` at the most."""
    return value + min(max(wanted - value, -most), most)
