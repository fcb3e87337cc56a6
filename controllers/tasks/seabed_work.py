"""Seabed work: takes a core with a set push, or drags a tool along a path at a set depth [Konoplin 2019].

settle (-> settle, nearer) -> scan -> close-in -> tare -> approach -> insert (-> press) -> work -> withdraw -> done
                                             any of these -> withdraw -> abort

`controllers.tasks.supervisor` brings the tool to the stand-off, from the hull pose that
`controllers.planning.seabed_height` chooses.

A core enters by the damping law of `controllers.tasks.axial_work` until the soil bears nearly the set push. Then the
force loop closes, and the tool stays for some time under that push. A dragged tool descends to its depth, slower as the
soil resists, and then follows the path at that depth. The controller estimates the soil's force from the joint torques
and feeds its push forward to the thrusters.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from controllers.mkps import Chain
from controllers.planning.ground_approach import GroundApproach
from controllers.planning.hull_placement import Placement, tool_pose
from controllers.planning.seabed_height import HeightSearch, choose_height
from controllers.planning.trajectories import Progress
from controllers.tasks.axial_work import AxialState, AxialWork, contact_force_on_tool
from controllers.tasks.supervisor import SurfaceWork
from controllers.tasks.surface_task_config import SurfaceTaskConfig
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError, ReachError
from sim.interfaces.messages import AbortCode, Command, Reference, StateEstimate, Target, ToolPath, WorkState
from sim.interfaces.spatial import Array, readonly

_ZERO = readonly(np.zeros(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class SeabedJob:
    """Parameters of seabed work; depths are of the tip below the surface as scanned."""

    depth: float = 0.18  # [m] of the dragged tool; of a core: depth at which the tube is full
    push: float = 50.0  # [N] on a core; of a dragged tool: axial force at which its descent stops
    drag: bool = False  # True: drag along the path; False: take a core at its start
    standoff: float = 0.1  # [m] height over the surface from which the tool approaches
    guard: float = 0.05  # [m] height over the surface below which contact is expected
    approach_speed: float = 0.03  # [m/s] down to that height
    speed: float = 0.015  # [m/s] in the soil, in and out
    drag_speed: float = 0.02  # [m/s] along the path
    ramp: float = 2.0  # [s] time from rest to that speed
    acceleration: float = 0.03  # [m/s^2] limit
    yielding: float = 0.3  # [m/s^2] limit while a force opposes the motion
    close: float = 0.9  # share of the push at which the force loop closes
    near: float = 0.05  # tolerance of the push, as a share of it
    held: float = 1.0  # [s] for which the push must be within that tolerance
    press_time: float = 10.0  # [s] limit for reaching that
    stay: float = 3.0  # [s] time under the push
    touch: float = 8.0  # [N] axial force above `guard` that counts as an obstacle
    longest: float = 60.0  # [s] limit from the stand-off to the work
    force_limit: float = 160.0  # [N] contact force, in any direction, above which the work ends
    lost_place: float = 0.08  # [m] position error of the hull above which the work ends; up to it the arm compensates
    scans: int = 3  # views taken before giving up

    def __post_init__(self) -> None:
        for name in ("depth", "push", "guard", "speed", "drag_speed", "approach_speed"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigurationError(f"seabed job {name}: must be > 0, got {value}")
        if self.push > 0.5 * self.force_limit:
            raise ConfigurationError(
                f"seabed job push: {self.push} N leaves no room: at most half the limit of {self.force_limit} N"
            )
        if not self.standoff > self.guard:
            raise ConfigurationError("seabed job: standoff > guard [m] must hold")


@dataclass(slots=True, eq=False)
class SeabedWorkState(AxialState):
    """State of seabed work; the depth is below the surface as scanned."""

    path_s: float = 0.0  # [m] arc length along the path
    rate: float = 0.0  # [m/s] speed along the path
    borne_for: float = 0.0  # [s] for which the soil has borne the push


class SeabedWork(AxialWork[SeabedJob, SeabedWorkState]):
    """Planner (`sim.interfaces.protocols.Planner`) of one operation in the seabed: a core, or a dragged tool."""

    def __init__(
        self,
        vehicle: Vehicle,
        chain: Chain,
        job: SeabedJob,
        *,
        X_WB_scan: Array,
        hull_box: Array,
        search: HeightSearch | None = None,
        coarse: GroundApproach | None = None,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            vehicle: the vehicle.
            chain: its arm, base to tool.
            job: depths, push, speeds and limits.
            X_WB_scan: (4, 4) level hull pose in W over the site, from which it is scanned.
            hull_box: (2, 3) [m] corners of the hull in B.
            search: heights that are tried, and clearances and margins to keep there.
            coarse: if given, the vehicle first descends over the plane that the Doppler log sees, and scans from there.
            period: [s] of the planner.
        """
        self._vehicle, self._chain = vehicle, chain
        self._X_WB_scan, self._hull_box, self._search = np.array(X_WB_scan), hull_box, search
        arrival = SurfaceWork(
            vehicle,
            chain,
            self._stand,
            SurfaceTaskConfig(forces=(job.push,), standoff=job.standoff, scans=job.scans),
            X_WB_scan=X_WB_scan,
            hull_box=hull_box,
            period=period,
            come_near=None if coarse is None else coarse.pose,
        )
        super().__init__(job, arrival, too_long="it was not in the soil")

    def _stand(self, target: Target, path: ToolPath) -> tuple[Placement, ToolPath, float]:
        """Hull placement over the seabed from which the tool reaches its depth (a `Standing` of the supervisor)."""
        if target.ground is None:
            raise ReachError("no place to stand: nothing is known of the ground around the target")
        job = self._job
        sunk = replace(path, p=readonly(path.p + job.depth * path.z)) if job.drag else path
        found = choose_height(
            self._vehicle,
            self._chain,
            sunk,
            ground=target.ground,
            hull_box=self._hull_box,
            X_WB=self._X_WB_scan,
            force=job.push,
            standoff=job.standoff + (job.depth if job.drag else 0.0),
            search=self._search,
        )
        return found.placement, path, 1.0

    def init(self, estimate: StateEstimate) -> SeabedWorkState:
        """State at the start: settling before the scan."""
        arrival = self._arrival.init(estimate)
        return SeabedWorkState(arrival=arrival, state=arrival.state, since=arrival.since)

    def step(
        self, state: SeabedWorkState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[SeabedWorkState, Reference]:
        """Advance the work by one period.

        Args:
            state: state of the work, changed in place.
            estimate: estimated state of the vehicle.
            target: newest identification, if any.
            last: the controller's last command, with its estimate of the contact force.

        Returns:
            The state and the reference for the controller.

        Raises:
            ConfigurationError: if the controller does not estimate the contact force.
        """
        time = estimate.time
        on_the_way = self._arrive(state, estimate, target, last)
        if on_the_way is not None:
            return state, on_the_way
        axial, aside = contact_force_on_tool(last, self._on_path(state)[0][:3, 2])
        self._watch(state, estimate, math.hypot(axial, aside))
        match state.state:
            case WorkState.APPROACH:
                self._approach(state, time, axial)
            case WorkState.INSERT:
                self._insert(state, time, axial)
            case WorkState.PRESS:
                self._press(state, time, axial)
            case WorkState.WORK:
                self._work(state, time)
            case WorkState.WITHDRAW:
                self._withdraw(state, time, axial)
        return state, self._reference(state, time)

    # -- states ----------------------------------------------------------------------------------------------------

    def _enter(self, state: SeabedWorkState, what: WorkState, time: float) -> None:
        """Change to another state and restart its counter."""
        super()._enter(state, what, time)
        state.borne_for = 0.0

    def _approach(self, state: SeabedWorkState, time: float, axial: float) -> None:
        """Advance to `guard` over the ground; contact before that is an obstacle."""
        job = self._job
        self._advance(state, job.approach_speed)
        if axial > job.touch:
            said = f"something stands {-1e3 * state.depth:.0f} mm over the ground as scanned"
            self._break_off(state, time, AbortCode.OBSTACLE, said)
        elif state.depth >= -job.guard:
            self._enter(state, WorkState.INSERT, time)

    def _insert(self, state: SeabedWorkState, time: float, axial: float) -> None:
        """Penetrate the soil to the depth (dragged tool), or until the soil bears nearly the push (core)."""
        job = self._job
        self._advance(state, job.speed, axial / job.push)
        if job.drag:
            if state.depth >= job.depth:
                state.speed = 0.0
                self._enter(state, WorkState.WORK, time)
            return
        if axial >= job.close * job.push:
            state.speed = 0.0
            self._enter(state, WorkState.PRESS, time)
        elif state.depth >= job.depth:
            said = f"the tube is full at {1e3 * job.depth:.0f} mm, the soil bears {axial:.0f} N"
            self._break_off(state, time, AbortCode.TUBE_FULL, said)

    def _press(self, state: SeabedWorkState, time: float, axial: float) -> None:
        """Wait under force control until the push has been reached for long enough."""
        job = self._job
        borne = abs(axial - job.push) <= job.near * job.push
        state.borne_for = state.borne_for + self.period if borne else 0.0
        if state.borne_for >= job.held:
            self._enter(state, WorkState.WORK, time)
        elif time - state.since > job.press_time:
            said = f"the push of {job.push:g} N was not held in {job.press_time:g} s: {axial:.1f} N"
            self._break_off(state, time, AbortCode.FORCE_NOT_REACHED, said)

    def _work(self, state: SeabedWorkState, time: float) -> None:
        """Stay under the push (core), or follow the path (dragged tool)."""
        job, path = self._job, state.arrival.path
        assert path is not None
        if not job.drag:
            if time - state.since > job.stay:
                self._enter(state, WorkState.WITHDRAW, time)
            return
        progress = Progress(float(path.s[-1]), job.drag_speed, job.ramp)
        state.path_s, state.rate = progress.at(time - state.since)
        if time - state.since > progress.duration:
            self._enter(state, WorkState.WITHDRAW, time)

    def _withdraw(self, state: SeabedWorkState, time: float, axial: float) -> None:
        """Move out of the soil, back to the stand-off."""
        state.rate = 0.0
        self._draw_out(state, time, mouth=-self._job.guard, resisted=-axial / self._job.push)

    # -- references ------------------------------------------------------------------------------------------------

    def _on_path(self, state: SeabedWorkState) -> tuple[Array, Array, Array]:
        """Tool pose X_WG (4, 4) at its depth; derivatives of position (3,) and orientation (3,) [rad/m] with s."""
        arrival = state.arrival
        assert arrival.path is not None
        assert arrival.placement is not None
        X, tangent, turn = tool_pose(arrival.path, state.path_s, arrival.placement.roll)
        X[:3, 3] += state.depth * X[:3, 2]
        return X, tangent + state.depth * np.cross(turn, X[:3, 2]), turn

    def _reference(self, state: SeabedWorkState, time: float) -> Reference:
        """Reference for the controller in the present state."""
        X_WG, tangent, turn = self._on_path(state)
        over = state.state in (WorkState.DONE, WorkState.ABORT)
        in_soil = not over and state.depth > -self._job.guard
        pressing = not self._job.drag and state.state in (WorkState.PRESS, WorkState.WORK)
        return Reference(
            time=time,
            state=state.state,
            X_WB=state.arrival.X_WB,
            v_WB_W=_ZERO,
            X_WG=X_WG,
            v_WG_W=_ZERO if over else state.rate * tangent + state.speed * X_WG[:3, 2],
            w_WG_W=state.rate * turn,
            q=state.arrival.q,
            qd=np.zeros(len(state.arrival.q)),
            force=self._job.push if in_soil else 0.0,
            force_control=pressing,
            tare=False,
            scan=False,
            path_s=state.path_s,
            abort=state.abort,
            note=state.reason or state.arrival.note,
        )
