"""Judges of episodes: whether the work was done, by the rules and bounds of `uuv.sim.evaluation`.

A judge gets true states, each with its duration; in contact it gets every step of the plant. `done`
stays true once it is true. `failed` is a sentence, or empty if nothing has failed.

After compiled substeps, a judge of contact with a method `watch_steps(steps, dt)` gets several
steps at once, as rows of `uuv.environments.ticks.action_ticks`.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from uuv.environments.ticks import action_ticks as row
from uuv.sim.evaluation.bounds import TAP_ERROR, Bounds
from uuv.sim.evaluation.insertion_metrics import InsertionBounds, TrueHole
from uuv.sim.evaluation.running import RunningForce, place_on_path, places_on_path
from uuv.sim.evaluation.surface.force_levels import force_peak, is_lost, unsettled
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.truth import Truth

# Entries of a row, in the order of `ContactStep`.
_FORCES = [row.STEP_NORMAL, row.STEP_LEAST, row.STEP_MOST]


class Judge(Protocol):
    """Judge of one episode after the other."""

    done: bool
    failed: str

    def start(self) -> None:
        """Begin an episode."""
        ...

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge a state that has lasted for `dt` [s]."""
        ...


class KeptFor:
    """Judge of a condition: success once the condition has held for some time without
    interruption.
    """

    def __init__(self, condition: Callable[[Truth], bool], seconds: float) -> None:
        self._condition = condition
        self._seconds = seconds
        self.done = False
        self.failed = ""
        self._held = 0.0

    def start(self) -> None:
        """Begin an episode."""
        self.done = False
        self.failed = ""
        self._held = 0.0

    def watch(self, truth: Truth, dt: float) -> None:
        """Count the time."""
        self._held = self._held + dt if self._condition(truth) else 0.0
        self.done = self.done or self._held >= self._seconds


class TurnedTo:
    """Judge: success once a handle has stayed beyond an angle for some time; a moment above its
    bound is a failure.
    """

    def __init__(
        self,
        angle: float,
        seconds: float,
        *,
        most: float,
        handle: Callable[[], tuple[float, float]],
    ) -> None:
        """Set up the judge.

        Args:
            angle: [rad] to be reached.
            seconds: [s] for which the handle must stay beyond it.
            most: [N m] largest moment.
            handle: Reads angle [rad] and moment [N m] of the handle.
        """
        self._angle = angle
        self._seconds = seconds
        self._most = most
        self._handle = handle
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done = False
        self.failed = ""
        self._held = 0.0

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge angle and moment."""
        del truth
        angle, moment = self._handle()
        if self.done or self.failed:
            return
        if abs(moment) > self._most:
            self.failed = f"moment of {abs(moment):.0f} N m"
            return
        self._held = self._held + dt if angle >= self._angle else 0.0
        self.done = self._held >= self._seconds


class ContactStep(NamedTuple):
    """A step in contact, as input of judges of a set force."""

    s: float  # [m] arc length of the path point nearest to the pad
    deviation: float  # [m] distance of that point on the surface
    normal: float  # [N] normal force, mean over the step
    least: float  # [N] smallest normal force
    most: float  # [N] largest normal force


@dataclass(frozen=True, slots=True, eq=False)
class SetForce:
    """Set force [N] along a path, or at its first point, and the bounds of the job."""

    path: ToolPath
    force: float
    bounds: Bounds = field(default_factory=Bounds)

    def touch(self, truth: Truth) -> ContactStep:
        """Input of a judge from a true state."""
        s, deviation = place_on_path(self.path, truth.p_pad)
        forces = truth.contact_normal, truth.contact_least, truth.contact_most
        return ContactStep(s, deviation, *forces)

    def touches(self, steps: Array) -> Iterable[ContactStep]:
        """The same for several steps, which are rows of `watch_steps`."""
        places = places_on_path(self.path, _three(steps, row.STEP_PAD))
        return map(ContactStep, *places.T.tolist(), *steps[:, _FORCES].T.tolist())

    def running(self) -> RunningForce:
        """Error of the force, for judgement step by step."""
        return RunningForce(self.force, self.bounds)


class PressedAt:
    """Judge: success once the set force was held at a point for some time, within the bounds."""

    def __init__(self, at: SetForce, seconds: float) -> None:
        self._at = at
        self._seconds = seconds
        self._error = at.running()
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed = False, ""
        self._error.start()

    def watch(self, truth: Truth, dt: float) -> None:
        """Count the time, and the force error in it; an error out of bounds restarts both."""
        self._judge(self._at.touch(truth), dt)

    def watch_steps(self, steps: Array, dt: float) -> None:
        """Same as `watch`, for several steps."""
        for touch in self._at.touches(steps):
            self._judge(touch, dt)

    def _judge(self, touch: ContactStep, dt: float) -> None:
        at = self._at
        bounds = self._at.bounds
        error = self._error

        # An error out of bounds restarts the time.
        peak = force_peak(touch.least, touch.most, at.force)
        if peak > bounds.force_error_max or touch.deviation > bounds.path_deviation:
            error.start()
            return
        error.add(touch.normal, touch.least, touch.most, dt)

        if error.since < self._seconds:
            return
        if error.missed():
            error.start()
        else:
            self.done = True


class WipedAlong:
    """Judge: success once the tool has moved along the whole path with the set force, within
    bounds.

    The work begins with the first contact at the path's start with half the set force, and is
    judged once the force has settled. Loss of contact, or a value out of bounds, is a final
    failure.
    """

    REACHED = 0.99  # share of the path's length

    def __init__(self, along: SetForce) -> None:
        self._along = along
        self._error = along.running()
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed = False, ""
        self.s = 0.0  # [m] arc length reached
        self._begun = False
        self._error.start()

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge force, path and progress."""
        self._judge(self._along.touch(truth), dt)

    def watch_steps(self, steps: Array, dt: float) -> None:
        """Same as `watch`, for several steps."""
        for touch in self._along.touches(steps):
            self._judge(touch, dt)

    def _judge(self, touch: ContactStep, dt: float) -> None:
        along = self._along
        error = self._error
        end = float(self._along.path.s[-1])
        bound = along.bounds.path_deviation
        s = touch.s

        # The work begins at the path's start.
        if not self._begun:
            at_start = s < (1.0 - self.REACHED) * end + bound
            self._begun = touch.normal > 0.5 * along.force and at_start
            return
        if self.done or self.failed:
            return

        # Force and progress; deviations count after the force has settled.
        wrong = error.add(touch.normal, touch.least, touch.most, dt)
        if s > self.s and s < self.s + 10.0 * bound:  # progress may not jump across a bend
            self.s = s
        if error.since < unsettled(0.0):
            return
        if not wrong and touch.deviation > bound:
            wrong = f"{1e3 * touch.deviation:.1f} mm path error"

        at_end = self.s >= self.REACHED * end
        self.failed = wrong or (error.missed() if at_end else "")
        self.done = at_end and not self.failed


class TappedAt:
    """Judge: success once the tool has touched points of a path in turn, without contact in
    between.
    """

    def __init__(self, along: SetForce, points: Sequence[float], seconds: float) -> None:
        """Take force and path, arc lengths [m] of the points, and the time [s] at each."""
        self._along = along
        self._points = tuple(points)
        self._seconds = seconds
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done = False
        self.failed = ""
        self.count = 0
        self._held = 0.0
        self._away = True

    def watch(self, truth: Truth, dt: float) -> None:
        """Count touches."""
        self._judge(self._along.touch(truth), dt)

    def watch_steps(self, steps: Array, dt: float) -> None:
        """Same as `watch`, for several steps."""
        for touch in self._along.touches(steps):
            self._judge(touch, dt)

    def _judge(self, touch: ContactStep, dt: float) -> None:
        if self.done:
            return

        along = self._along
        if is_lost(touch.least):
            self._away, self._held = True, 0.0
            return

        bound = along.bounds.path_deviation
        at_point = abs(touch.s - self._points[self.count]) <= bound and touch.deviation <= bound
        pressed = abs(touch.normal - along.force) <= TAP_ERROR * along.force
        self._held = self._held + dt if at_point and pressed and self._away else 0.0

        if self._held >= self._seconds:
            self.count += 1
            self._held = 0.0
            self._away = False
            self.done = self.count == len(self._points)


class InsertedTo:
    """Judge: success once the tip has reached a depth in a hole; a force out of bounds is a
    failure.
    """

    def __init__(self, hole: TrueHole, bounds: InsertionBounds | None = None) -> None:
        """Take the hole, which contains the depth to reach, and the bounds."""
        self._hole = hole
        self._bounds = bounds or InsertionBounds()
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done = False
        self.failed = ""
        self.depth = -np.inf

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge depth and force."""
        del dt
        self._judge(truth.p_pad[None], truth.contact_force_W[None])

    def watch_steps(self, steps: Array, dt: float) -> None:
        """Same as `watch`, for several steps."""
        del dt
        self._judge(_three(steps, row.STEP_PAD), _three(steps, row.STEP_FORCE))

    def _judge(self, p_W: Array, f_W: Array) -> None:
        """Judge positions (k, 3) [m] of the tip, and forces (k, 3) [N] on it."""
        hole = self._hole
        bounds = self._bounds
        tip_H = hole.tips(p_W)
        depths = np.where(hole.within_wall(tip_H), tip_H[:, 2], -np.inf).tolist()
        sides, axials = hole.forces(f_W)

        for depth, side, axial in zip(depths, sides.tolist(), axials.tolist(), strict=True):
            self.depth = depth
            if self.done or self.failed:
                continue

            if side > bounds.side_force:
                self.failed = f"side force {side:.0f} N"
            elif abs(axial) > bounds.axial_force:
                self.failed = f"axial force {abs(axial):.0f} N"
            self.done = not self.failed and hole.depth - depth <= bounds.short


def _three(steps: Array, first: int) -> Array:
    """Three entries of each row, beginning with the entry `first`."""
    return steps[:, first : first + 3]
