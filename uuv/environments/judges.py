"""Judges of episodes: whether the work was done, by the bounds of the jobs, and whether it did damage.

A judge watches true states that last for some time each; in contact it sees every step of the plant. `done` stays true
once it is. `failed` is a sentence, empty while nothing is wrong.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.force_levels import LOST_BELOW, SETTLING
from uuv.sim.evaluation.insertion_metrics import InsertionBounds, TrueHole
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.plant.plant import Truth

DAMAGE = 1.5  # times the largest set force, beyond which contact counts as damage
TOUCHING = 0.2  # share of the set force by which a tap may be off


class Judge(Protocol):
    """Judge of one episode after another."""

    done: bool
    failed: str

    def start(self) -> None:
        """Begin an episode."""
        ...

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge a state that has lasted for `dt` [s]."""
        ...


class KeptFor:
    """Done once a condition has held for some time without a break."""

    def __init__(self, condition: Callable[[Truth], bool], seconds: float) -> None:
        self._condition, self._seconds = condition, seconds
        self.done, self.failed, self._held = False, "", 0.0

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed, self._held = False, "", 0.0

    def watch(self, truth: Truth, dt: float) -> None:
        """Count the time."""
        self._held = self._held + dt if self._condition(truth) else 0.0
        self.done = self.done or self._held >= self._seconds


@dataclass(frozen=True, slots=True, eq=False)
class SetForce:
    """A force [N] to press with at a place of a path."""

    path: ToolPath
    force: float
    bounds: Bounds = field(default_factory=Bounds)

    def deviation(self, truth: Truth) -> tuple[float, float]:
        """Arc length [m] of the point of the path nearest to the pad, and its distance [m] along the surface."""
        gap = truth.p_pad - self.path.p
        gap -= np.sum(gap * self.path.z, axis=1, keepdims=True) * self.path.z
        at = int(np.argmin(np.sum(gap * gap, axis=1)))
        p, s = self.path.p, self.path.s
        best, distance = float(s[at]), float(np.linalg.norm(gap[at]))
        for a, b in ((at - 1, at), (at, at + 1)):  # between the samples
            if a >= 0 and b < len(s):
                along = p[b] - p[a]
                share = float(np.clip(gap[a] @ along / (along @ along), 0.0, 1.0))
                off = float(np.linalg.norm(gap[a] - share * along))
                if off < distance:
                    best, distance = float(s[a] + share * (s[b] - s[a])), off
        return best, distance


class PressedAt:
    """Done once the set force has been held at a point for some time, within the bounds of force and path."""

    def __init__(self, at: SetForce, seconds: float) -> None:
        self._at, self._seconds = at, seconds
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed = False, ""
        self._again()

    def _again(self) -> None:
        self._held = self._squares = 0.0

    def watch(self, truth: Truth, dt: float) -> None:
        """Count the time, and the force's error in it."""
        at, bounds = self._at, self._at.bounds
        error = truth.contact_normal - at.force
        if abs(error) > bounds.force_error_max or at.deviation(truth)[1] > bounds.path_deviation:
            self._again()
            return
        self._held += dt
        self._squares += dt * error * error
        if self._squares > self._held * bounds.force_error_rms**2 and self._held > SETTLING:
            self._again()
        self.done = self.done or self._held >= self._seconds


class WipedAlong:
    """Done once the tool has gone along the whole path under the set force, within the bounds of the surface job.

    The work begins with the first contact at the path's start under half the set force, and is judged from `SETTLING`
    later on. Losing contact, or leaving a bound, spoils it for good.
    """

    REACHED = 0.99  # share of the path's length

    def __init__(self, along: SetForce) -> None:
        self._along = along
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed = False, ""
        self.s = 0.0  # [m] arc length reached
        self._since = -1.0  # [s] for which the work lasts; negative: it has not begun
        self._squares = self._judged = 0.0

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge force, path and progress."""
        along, bounds, end = self._along, self._along.bounds, float(self._along.path.s[-1])
        s, deviation = along.deviation(truth)
        if self._since < 0.0:
            if truth.contact_normal > 0.5 * along.force and s < (1.0 - self.REACHED) * end + bounds.path_deviation:
                self._since = 0.0
            return
        if self.done or self.failed:
            return
        self._since += dt
        if s > self.s and s < self.s + 10.0 * bounds.path_deviation:  # no leap across a bend
            self.s = s
        if self._since < SETTLING:
            return
        error = truth.contact_normal - along.force
        self._judged += dt
        self._squares += dt * error * error
        if truth.contact_normal < LOST_BELOW:
            self.failed = "contact lost"
        elif abs(error) > bounds.force_error_max:
            self.failed = f"force off by {error:.1f} N"
        elif deviation > bounds.path_deviation:
            self.failed = f"{1e3 * deviation:.1f} mm off the path"
        elif self.s >= self.REACHED * end:
            rms = float(np.sqrt(self._squares / self._judged))
            self.done = rms <= bounds.force_error_rms
            self.failed = "" if self.done else f"force off by {rms:.1f} N RMS"


class TappedAt:
    """Done once the tool has touched points of a path one after another, leaving the surface in between."""

    def __init__(self, along: SetForce, points: Sequence[float], seconds: float) -> None:
        """Take force and path, arc lengths [m] of the points, and the time [s] at each."""
        self._along, self._points, self._seconds = along, tuple(points), seconds
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed = False, ""
        self.count, self._held, self._away = 0, 0.0, True

    def watch(self, truth: Truth, dt: float) -> None:
        """Count touches."""
        if self.done:
            return
        along = self._along
        if truth.contact_normal < LOST_BELOW:
            self._away, self._held = True, 0.0
            return
        s, deviation = along.deviation(truth)
        bound = along.bounds.path_deviation
        there = abs(s - self._points[self.count]) <= bound and deviation <= bound
        pressed = abs(truth.contact_normal - along.force) <= TOUCHING * along.force
        self._held = self._held + dt if there and pressed and self._away else 0.0
        if self._held >= self._seconds:
            self.count, self._held, self._away = self.count + 1, 0.0, False
            self.done = self.count == len(self._points)


class InsertedTo:
    """Done once the tip has reached a depth in a hole; side or axial force beyond the insertion's bounds spoils it."""

    def __init__(self, hole: TrueHole, bounds: InsertionBounds | None = None) -> None:
        """Take the hole with the depth to reach."""
        self._hole, self._bounds = hole, bounds or InsertionBounds()
        self.start()

    def start(self) -> None:
        """Begin an episode."""
        self.done, self.failed, self.depth = False, "", -np.inf

    def watch(self, truth: Truth, dt: float) -> None:
        """Judge depth and force."""
        hole, X_WH = self._hole, self._hole.X_WH
        tip_H = X_WH[:3, :3].T @ (truth.p_pad - X_WH[:3, 3])
        force_H = X_WH[:3, :3].T @ truth.contact_force_W
        in_bore = float(np.hypot(tip_H[0], tip_H[1])) < hole.radius
        self.depth = float(tip_H[2]) if in_bore else -np.inf
        side, axial = float(np.hypot(force_H[0], force_H[1])), float(force_H[2])
        if self.done or self.failed:
            return
        if side > self._bounds.side_force:
            self.failed = f"side force {side:.0f} N"
        elif abs(axial) > self._bounds.axial_force:
            self.failed = f"axial force {abs(axial):.0f} N"
        self.done = not self.failed and self.depth >= hole.depth - self._bounds.short
