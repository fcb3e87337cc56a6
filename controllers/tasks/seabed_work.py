"""Seabed work: takes a core with a set push, or drags a tool at a set depth [Konoplin 2019].

settle (-> settle, nearer) -> scan -> close-in -> tare -> approach -> insert (-> press) -> work ->
withdraw -> done
                                             any of these -> withdraw -> abort

The hull pose is chosen by `uuv.controllers.planning.seabed_height`.

A core enters by the damping law of `uuv.controllers.tasks.axial_phases` until the soil bears nearly
the set push. Then the force loop closes, and the tool stays for some time under that push. A
dragged tool descends to its depth, slower as the soil resists, and then follows the path at that
depth. The controller estimates the soil's force from the joint torques and feeds its push forward
to the thrusters.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from uuv.controllers.planning.ground_approach import GroundApproach
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.seabed_height import HeightSearch, choose_height
from uuv.controllers.planning.trajectories import Progress
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import ArrivalLimits, ScanLimits, WorkSite, arrival
from uuv.controllers.tasks.axial_phases import (
    PARK,
    WITHDRAW,
    AxialApproach,
    AxialContact,
    AxialLimits,
    AxialPhase,
    Push,
    Stay,
    Withdraw,
    axial_end,
    axial_monitors,
)
from uuv.controllers.tasks.contact_phases import FollowState, Press, PressLimits
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, PhaseEvent, Setpoint
from uuv.controllers.tasks.settings import SeabedSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import AbortCode, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, readonly


@dataclass(frozen=True, slots=True, kw_only=True)
class SeabedJob(SeabedSettings):
    """Settings and limits of seabed work; depths are of the tip below the surface as scanned."""

    guard: float = 0.05  # [m] height over the surface below which contact is expected
    drag_speed: float = 0.02  # [m/s] along the path
    ramp: float = 2.0  # [s] time from rest to that speed
    close: float = 0.9  # share of the push at which the force loop closes
    press: PressLimits = field(default_factory=partial(PressLimits, held=1.0, within=10.0))
    stay: float = 3.0  # [s] time under the push
    touch: float = 8.0  # [N] axial force above `guard` that counts as an obstacle
    axial: AxialLimits = field(
        default_factory=partial(
            AxialLimits,
            standoff=0.1,
            approach_speed=0.03,
            speed=0.015,
            longest=60.0,
            force_limit=160.0,
        )
    )
    scans: int = 3  # views taken before giving up

    def __post_init__(self) -> None:
        for name, number in (
            ("depth", self.depth),
            ("push", self.push),
            ("guard", self.guard),
            ("speed", self.axial.speed),
            ("drag_speed", self.drag_speed),
            ("approach_speed", self.axial.approach_speed),
        ):
            if not (math.isfinite(number) and number > 0.0):
                raise ConfigurationError(f"seabed job {name}: must be > 0, got {number}")

        limit = self.axial.force_limit
        if self.push > 0.5 * limit:
            raise ConfigurationError(
                f"seabed job push: {self.push} N leaves no room: at most half the limit of "
                f"{limit} N"
            )

        if not self.axial.standoff > self.guard:
            raise ConfigurationError("seabed job: standoff > guard [m] must hold")


class Penetrate(AxialPhase):
    """Penetrate the soil to the depth (dragged tool), or until it bears nearly the push (core)."""

    def __init__(self, job: SeabedJob, push: Push) -> None:
        super().__init__(job.axial, push)
        self._job = job

    def step(self, state: None, held: Held, context: Context) -> Outcome:
        """Report DONE at the depth, or under the push."""
        del state
        job = self._job
        axial, _ = self._forces(held, context)
        self._advance(held, context, job.axial.speed, axial / job.push)

        if held.depth >= job.depth if job.drag else axial >= job.close * job.push:
            held.speed = 0.0
            held.set_force = job.push
            return PhaseEvent.DONE

        if held.depth < job.depth:
            return None
        reason = f"the tube is full at {1e3 * job.depth:.0f} mm, the soil bears {axial:.0f} N"
        return Abort(AbortCode.TUBE_FULL, reason)


class Drag(AxialPhase):
    """Follow the path at the depth reached."""

    def __init__(self, job: SeabedJob, push: Push) -> None:
        super().__init__(job.axial, push)
        self._speed = job.drag_speed
        self._ramp = job.ramp

    def enter(self, held: Held, context: Context) -> FollowState:
        """Begin at rest at the path's begin."""
        assert held.line is not None
        return FollowState(
            Progress(float(held.line.path.s[-1]), self._speed, self._ramp), context.time
        )

    def step(self, state: FollowState, held: Held, context: Context) -> Outcome:
        """Report DONE at the end of the path."""
        held.s, _ = state.progress.at(context.time - state.since)
        return PhaseEvent.DONE if context.time - state.since > state.progress.duration else None

    def setpoint(self, state: FollowState, held: Held, context: Context) -> Setpoint:
        """The tool on the path, at its depth."""
        _, rate = state.progress.at(context.time - state.since)
        X_WG, tangent, turn = held.tool()
        way = tangent + held.depth * np.cross(turn, X_WG[:3, 2])

        return replace(
            super().setpoint(state, held, context), v_WG_W=rate * way, w_WG_W=rate * turn
        )


class SeabedWork(TaskPlanner):
    """Planner of one operation in the seabed: a core, or a dragged tool."""

    def __init__(
        self,
        own: WorkVehicle,
        job: SeabedJob,
        *,
        X_WB_scan: Array,
        search: HeightSearch | None = None,
        coarse: GroundApproach | None = None,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            own: the vehicle.
            job: depths, push, speeds and limits.
            X_WB_scan: (4, 4) level hull pose in W over the site, from which it is scanned.
            search: heights that are tried, and clearances and margins to keep there.
            coarse: if given, the vehicle first descends over the plane that the Doppler log sees,
                and scans from there.
            period: [s] of the planner.
        """
        X_WB = np.array(X_WB_scan)

        def stand(
            target: Target, path: ToolPath, current_W: Array
        ) -> tuple[Placement, ToolPath, float]:
            """Hull placement over the seabed from which the tool reaches its depth."""
            del current_W
            if target.ground is None:
                raise ReachError("no feasible hull pose: the ground around the target is unknown")

            sunk = replace(path, p=readonly(path.p + job.depth * path.z)) if job.drag else path
            height = choose_height(
                own,
                sunk,
                ground=target.ground,
                X_WB=X_WB,
                force=job.push,
                standoff=job.axial.standoff + (job.depth if job.drag else 0.0),
                search=search,
            )
            return height.placement, path, 1.0

        self.stand = stand
        limits = ArrivalLimits(scan=ScanLimits(views=job.scans, finds=1))
        site = WorkSite(
            own=own, X_WB_scan=X_WB, stand=stand, come_near=None if coarse is None else coarse.pose
        )

        monitors = axial_monitors(
            job.axial,
            lost_place=limits.lost_place,
            blind_time=limits.blind_time,
            too_long="it was not in the soil",
        )

        rows = seabed_rows(site, limits, job, period)
        super().__init__(rows, monitors, X_WB=X_WB, q=own.vehicle.q_home, period=period)


def seabed_rows(
    site: WorkSite, limits: ArrivalLimits, job: SeabedJob, period: float
) -> Iterable[tuple[str, TaskRow]]:
    """Table of seabed work.

    Args:
        site: what is known before the work.
        limits: of the way to the stand-off.
        job: depths, push and limits.
        period: [s] of the planner.

    Returns:
        Names and rows.
    """
    axial = job.axial
    states = WorkState
    soil = Push(force=job.push, beyond=-job.guard)
    stone = AxialContact(touch=job.touch, obstacle="obstacle {} mm above the scanned ground")
    approach = AxialApproach(axial, soil, stone, slow=(math.inf, 0.0), to=-job.guard)

    yield from arrival(
        site, limits, then=at_once("approach"), depth=-axial.standoff, offset=0.0, broken=PARK
    )
    yield "approach", TaskRow(approach, states.APPROACH, {PhaseEvent.DONE: "insert"}, WITHDRAW)
    after = {PhaseEvent.DONE: "work" if job.drag else "press"}
    yield "insert", TaskRow(Penetrate(job, soil), states.INSERT, after, WITHDRAW)

    if job.drag:
        yield "work", TaskRow(Drag(job, soil), states.WORK, {PhaseEvent.DONE: "withdraw"}, WITHDRAW)
    else:
        # the first period counts, and rounding does not
        held = replace(job.press, held=job.press.held - 1.5 * period)
        press = Press(held, job.push, math.inf)
        stay = Stay(axial, replace(soil, force_control=True), job.stay)
        yield "press", TaskRow(press, states.PRESS, {PhaseEvent.DONE: "work"}, WITHDRAW)
        yield "work", TaskRow(stay, states.WORK, {PhaseEvent.DONE: "withdraw"}, WITHDRAW)

    yield from axial_end(Withdraw(axial, soil, -job.guard))
