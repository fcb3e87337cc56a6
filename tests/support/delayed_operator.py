"""An operator by rules, who sees the vehicle with a delay and wipes the top of a barrel."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uuv.assembly import Assembly
from uuv.controllers.driving.driven_task import driven_task
from uuv.controllers.driving.operator_inputs import COLUMNS, OperatorInputs
from uuv.driving.driven_work import DrivenWork
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.rollout import Moment

_GAIN = 0.4  # [1/s] of the hull's velocity over its distance
_ABOVE = 0.12  # [m] of the tool over the surface, before it is lowered
_HALF = 0.06  # [m] of a wipe to either side


class DelayedOperator(OperatorInputs):
    """Rises, flies over the place, lowers the tool, presses and wipes; then lifts and ends."""

    slow_ticks = (10,)

    def __init__(self, tip: Callable[[StateEstimate], Array], p_W: Array, delay: float) -> None:
        """Set up the operator.

        Args:
            tip: place (3,) [m] of the tool's tip, W, by the estimate.
            p_W: (3,) [m] place on the surface, as surveyed.
            delay: [s] of the view.
        """
        super().__init__(ended=False)
        self._tip = tip
        self._p_W = p_W
        self._delay = delay
        self._views: deque[tuple[float, StateEstimate, float]] = deque()
        self._step = "rise"
        self._since = 0.0
        self._side = 1.0

    def observe(self, moment: Moment) -> None:
        """See the vehicle."""
        felt = moment.command.contact.normal
        self._views.append((moment.estimate.time, moment.estimate, felt))

    def poll(self, time: float) -> None:
        """Decide by the newest view that is old enough; a row for each change."""
        if self.ended or not self._views:
            return
        now = self._views[-1][0]
        while len(self._views) > 1 and self._views[1][0] <= now - self._delay:
            self._views.popleft()

        _, estimate, felt = self._views[0]
        values = self._decide(time, estimate, felt)
        row = [{"clutch": 1.0, "time": time, **values}.get(name, 0.0) for name in COLUMNS]
        if not self.rows or row[1:] != list(self.rows[-1][1:]):
            self.add(row)
        self.ended = self._step == "end"

    def _next(self, step: str, time: float) -> None:
        self._step = step
        self._since = time

    def _decide(self, time: float, estimate: StateEstimate, felt: float) -> dict[str, float]:
        R_WB = estimate.X_WB[:3, :3]
        off = self._p_W - self._tip(estimate)
        lasting = time - self._since

        if self._step == "rise":
            if off[2] < -_ABOVE:
                self._next("over", time)
            return {"heave": 0.08}

        if self._step == "over":
            v = np.clip(_GAIN * R_WB.T @ (off + np.array([0.0, 0.0, _ABOVE])), -0.2, 0.2)
            near = np.linalg.norm(off[:2]) < 0.03 and np.linalg.norm(estimate.v_WB_B) < 0.02
            if near:
                self._next("down", time)
            return {"surge": float(v[0]), "sway": float(v[1]), "heave": float(v[2])}

        if self._step == "down":
            if off[2] > -0.06:
                self._next("press", time)
            return {"tool_z": 0.03}

        if self._step == "press":
            if felt > 30.0:
                self._next("wipe", time)
            return {"tool_z": 0.01, "set_force": 60.0}

        if self._step == "wipe":
            ahead = -(R_WB.T @ off)[0] * self._side
            if ahead > _HALF:
                self._side = -self._side
            if lasting > 20.0:
                self._next("lift", time)
            # the tool's y axis is the hull's -x in the ready posture
            return {"tool_y": -0.02 * self._side, "set_force": 60.0}

        if lasting > 6.0:
            self._next("end", time)
        return {}


def operated(assembly: Assembly, p_W: Array, delay: float) -> tuple[Assembly, DelayedOperator]:
    """A driven assembly in the hands of the operator, and him, who observes its loop too."""
    placed = assembly.placed
    assert isinstance(placed, DrivenWork)
    own = assembly.own.at_work()
    operator = DelayedOperator(own.tip, p_W, delay)
    planner = driven_task(own, operator, delay, X_WB=placed.X_WB)
    parts = replace(assembly.parts, planner=planner)
    loop = replace(assembly.loop, parts=parts)
    return replace(assembly, placed=replace(placed, source=operator), loop=loop), operator
