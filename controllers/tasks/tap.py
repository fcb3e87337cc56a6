"""Tapping: touches points along a path with a set force for some time, one after another."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

from uuv.controllers.tasks import contact_phases as contact
from uuv.controllers.tasks.arrival import WorkSite, arrival
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.phase import Context, Decide, Held, Phase, PhaseEvent
from uuv.controllers.tasks.surface_work import (
    BREAK_OFF,
    SurfaceTaskConfig,
    retreat_rows,
    surface_monitors,
)
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array


def tap(
    site: WorkSite,
    job: SurfaceTaskConfig,
    points: Sequence[float],
    tip: Callable[[StateEstimate], Array],
    hold: float,
) -> TaskPlanner:
    """Planner that touches points of the path with `job.forces[0]` [N].

    Args:
        site: what is known before the work.
        job: force, speeds and limits.
        points: [m] arc lengths of the points, from 0 on.
        tip: position (3,) [m] of the tool's tip in W as estimated; `TaskState.held.places` collects
            it.
        hold: [s] time at each point.

    Returns:
        The planner.

    Raises:
        ConfigurationError: if the points do not increase from 0.
    """
    if not points or points[0] != 0.0 or any(not b > a for a, b in pairwise(points)):
        raise ConfigurationError(f"tap points: must increase from 0 m, got {points}")

    def mark(held: Held, context: Context) -> None:
        held.places = (*held.places, tip(context.estimate))

    def rows() -> Iterable[tuple[str, TaskRow]]:
        approach = job.approach
        clear = job.approach.standoff
        ends = PhaseEvent
        states = WorkState

        yield from arrival(
            site, job.arrival, then="approach", depth=0.0, offset=-clear, broken=BREAK_OFF
        )

        table: tuple[tuple[str, Phase, WorkState, str], ...] = (
            ("approach", contact.GuardedApproach(approach), states.APPROACH, "press"),
            (
                "press",
                contact.Press(job.press, job.forces[0], job.force_rate, tip=tip),
                states.PRESS,
                "dwell",
            ),
            ("dwell", contact.Dwell(hold), states.WORK, at_once("mark")),
            ("mark", Decide(mark, AbortCode.OUT_OF_REACH), states.WORK, "let go"),
            ("let go", contact.Unload(job.force_rate, approach.touch), states.RETREAT, "lift"),
            ("lift", contact.Retreat(approach.speed, clear), states.RETREAT, "next"),
        )

        for name, phase, state, then in table:
            yield name, TaskRow(phase, state, {ends.DONE: then}, BREAK_OFF)

        move = contact.NextPoint(points, FollowLimits(speed=job.speed), clear)
        yield (
            "next",
            TaskRow(move, states.CLOSE_IN, {ends.MORE: "approach", ends.DONE: "parked"}, BREAK_OFF),
        )
        yield from retreat_rows(site.own, job)

    return TaskPlanner(
        rows(), surface_monitors(job), X_WB=site.X_WB_scan, q=site.own.vehicle.q_home
    )
