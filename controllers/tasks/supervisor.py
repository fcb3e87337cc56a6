r"""Supervisor of contact work: the state machine of the vehicle, and the reference of each state.

settle -> scan -> close-in -> tare -> approach -> press -> work -> retreat -> done
             \-> other view -> scan ...          any state with contact -> retreat -> abort

Work without contact [Konoplin 2019] goes from approach directly to work: there is no surface to press on.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from controllers.hull.thrust_margin import ThrustMargin
from controllers.mkps import Chain
from controllers.planning.hull_path import HullPath
from controllers.planning.hull_placement import Placement, PlacementSearch, middle_part, place_hull, tool_pose
from controllers.planning.trajectories import JointMove, PoseMove, Progress
from controllers.tasks.fault_reactions import Reaction, choose_reaction
from controllers.tasks.pose_fusion import fuse_poses
from controllers.tasks.surface_task_config import SupervisorState, SurfaceTaskConfig
from models.objects.targets import TargetModel
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError, ReachError
from sim.interfaces.messages import AbortCode, Command, FaultKind, Reference, StateEstimate, Target, ToolPath, WorkState
from sim.interfaces.spatial import Array, checked, exp_so3, pose, transform_points

_OVER = (WorkState.RETREAT, WorkState.DONE, WorkState.ABORT)
_TRAVELS = (0.0, 0.5, 1.0, 1.4)  # travels of the hull that are tried, as shares of the line between the path's ends
_SHORTER = 0.04  # share of a path by which it is shortened per try, where it is too long
_ZERO = np.zeros(3)
_ZERO.setflags(write=False)

# Chooses the hull placement for a path on a target: (placement, part of the path, its share); raises ReachError.
Standing = Callable[[Target, ToolPath], tuple[Placement, ToolPath, float]]
# Chooses a nearer hull pose (4, 4) to scan from, given the estimate and the present one; raises ReachError.
ComingNear = Callable[[StateEstimate, Array], Array]


class SurfaceWork:
    """Planner (`sim.interfaces.protocols.Planner`) that works along one tool path on one known object."""

    _APPROACH_ACCELERATION = 0.03  # [m/s^2] of the tool
    _PAUSED_FORCE = 0.5  # share of the set force during a pause
    _PACE_TIME = 0.5  # [s] for motion along the path to stop, and to resume
    _BEHIND = (
        0.3,
        0.7,
    )  # shares of `SurfaceTaskConfig.lost_place`: lag of the hull at which its move slows down, and stops
    _HALT = 3.0  # [s] for a vehicle without control to come to rest before ABORT

    def __init__(
        self,
        vehicle: Vehicle,
        chain: Chain,
        target: TargetModel | Standing,
        job: SurfaceTaskConfig,
        *,
        X_WB_scan: Array,
        hull_box: Array,
        view_B: ArrayLike = (1.0, 0.0, 0.0),
        floor: float = -np.inf,
        period: float = 0.01,
        search: PlacementSearch | None = None,
        come_near: ComingNear | None = None,
        holding: ThrustMargin | None = None,
    ) -> None:
        """Set up the planner.

        Args:
            vehicle: the vehicle.
            chain: its arm, base to tool.
            target: model of the object, or a function that chooses the hull placement.
            job: set forces, speeds and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            hull_box: (2, 3) [m] corners of the hull in B, kept clear of the object and of the seabed.
            view_B: (3,) direction of the camera's axis in B.
            floor: [m] height of the seabed in W.
            period: [s] of the planner.
            search: hull placements that are tried.
            come_near: if given, chooses a nearer hull pose to scan from, once the hull is at rest at `X_WB_scan`.
            holding: thrust margin of the hull beside the object; without it placements are not tested for it.
        """
        self.period = period
        self._vehicle, self._chain, self._job = vehicle, chain, job
        self._known = target if isinstance(target, TargetModel) else None
        self._stand = partial(self._beside, target) if isinstance(target, TargetModel) else target
        self._X_WB_scan, self._hull_box, self._search = np.array(X_WB_scan), hull_box, search
        self._floor, self._come_near, self._holding = floor, come_near, holding
        ahead = checked(view_B, (3,), "view_B") * [1.0, 1.0, 0.0]
        self._view_B = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else np.array([1.0, 0.0, 0.0])

    def init(self, estimate: StateEstimate) -> SupervisorState:
        """State at the start: settling before the scan."""
        return SupervisorState(
            state=WorkState.SETTLE, since=estimate.time, X_WB=self._X_WB_scan, q=np.array(self._vehicle.q_home)
        )

    def step(
        self, state: SupervisorState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[SupervisorState, Reference]:
        """Advance the work by one period.

        Args:
            state: state of the supervisor, changed in place.
            estimate: estimated state of the vehicle.
            target: newest identification, if any.
            last: the controller's last command, with its estimate of the contact force and its faults.

        Returns:
            The state and the reference for the controller.

        Raises:
            ConfigurationError: if the controller does not estimate the contact force during approach, press and work.
        """
        felt = self._felt(state, last)
        time = estimate.time if math.isfinite(estimate.time) else state.since
        self._watch(state, estimate, felt, last)
        if math.isfinite(state.halted):
            state.halted -= self.period
            if state.halted <= 0.0:
                state.state = WorkState.ABORT
            return state, self._reference(state, time)
        self._wait_for_hull(state, estimate)
        match state.state:
            case WorkState.SETTLE:
                self._settle(state, estimate)
            case WorkState.SCAN:
                self._scan(state, time, target)
            case WorkState.CLOSE_IN:
                self._close_in(state, estimate)
            case WorkState.TARE:
                if time - state.since > self._job.tare_after + self._job.tare_time:
                    self._enter(state, WorkState.APPROACH, time)
            case WorkState.APPROACH:
                self._approach(state, time, felt)
            case WorkState.PRESS:
                self._press(state, time, felt)
            case WorkState.WORK:
                self._work(state, time)
            case WorkState.RETREAT:
                self._retreat(state, estimate)
        return state, self._reference(state, time)

    # -- states ----------------------------------------------------------------------------------------------------

    @staticmethod
    def _enter(state: SupervisorState, what: WorkState, time: float) -> None:
        """Change to another state."""
        state.state, state.since, state.quiet_since = what, time, np.inf

    def _quiet(self, state: SupervisorState, estimate: StateEstimate) -> bool:
        """True once the hull has been at rest within `settle_error` of its reference for `settle_time`."""
        error = math.dist(estimate.X_WB[:3, 3].tolist(), state.X_WB[:3, 3].tolist())
        job = self._job
        moving = math.hypot(*estimate.v_WB_B.tolist()) > job.settle_speed
        turning = math.hypot(*estimate.w_WB_B.tolist()) > job.settle_turn
        if moving or turning or error > job.settle_error:
            state.quiet_since = np.inf
        elif not math.isfinite(state.quiet_since):
            state.quiet_since = estimate.time
        return estimate.time - state.quiet_since > self._job.settle_time

    def _settle(self, state: SupervisorState, estimate: StateEstimate) -> None:
        """Wait until the hull is at rest, then come nearer or scan."""
        if state.hull_move is not None and state.hull_move.done(estimate.time):
            self._end_hull_move(state, state.hull_move)
        if state.hull_move is None and self._quiet(state, estimate):
            if self._come_near is not None and state.X_WB_near is None:
                self._come_nearer(state, estimate, self._come_near)
                return
            state.scans += 1
            state.looks, state.finds, state.look_from = 0, (), estimate.time
            self._enter(state, WorkState.SCAN, estimate.time)

    def _come_nearer(self, state: SupervisorState, estimate: StateEstimate, come_near: ComingNear) -> None:
        """Move the hull to the nearer pose to scan from; give up if there is none."""
        try:
            state.X_WB_near = come_near(estimate, self._X_WB_scan)
        except ReachError as error:
            self._give_up(state, estimate.time, AbortCode.NO_GROUND, str(error))
            return
        state.quiet_since = np.inf
        self._move_hull(state, estimate.time, state.X_WB_near)

    def _scan(self, state: SupervisorState, time: float, target: Target | None) -> None:
        """Take depth frames until the object is identified often enough; change the view if the first one fails."""
        if target is None or target.time < state.look_from:
            if time - max(state.since, state.look_from) > 5.0:
                self._give_up(state, time, AbortCode.NO_FRAME, "no depth frame arrived within 5 s")
            return
        state.looks += 1
        if target.accepted and target.path is not None:
            state.finds = (*state.finds, target)
        if state.finds and state.looks < (self._job.finds if self._known is not None else 1):
            state.look_from = time + self._job.find_interval
        elif state.finds:
            fused = fuse_poses(state.finds)
            assert fused.path is not None
            self._plan(state, time, fused, fused.path)
        elif state.scans >= self._job.scans:
            said = f"not identified in {state.scans} views: {target.reason}"
            self._give_up(state, time, AbortCode.NOT_IDENTIFIED, said)
        else:
            self._other_view(state, time)

    def _other_view(self, state: SupervisorState, time: float) -> None:
        """Move the hull sideways, to scan from another view."""
        side = 0.3 * (1.0 if state.scans % 2 else -1.0)
        X = np.array(self._X_WB_scan if state.X_WB_near is None else state.X_WB_near)
        X[:3, 3] += X[:3, :3] @ np.cross([0.0, 0.0, side], self._view_B)
        X[:3, :3] = X[:3, :3] @ exp_so3([0.0, 0.0, -0.6 * side])
        self._move_hull(state, time, X)
        self._enter(state, WorkState.SETTLE, time)

    def _plan(self, state: SupervisorState, time: float, target: Target, path: ToolPath) -> None:
        """Choose the hull placement for the path and start the move there; give up if there is none."""
        job = self._job
        try:
            placement, path, worked = self._stand(target, path)
        except ReachError as error:
            self._give_up(state, time, AbortCode.OUT_OF_REACH, str(error))
            return
        if worked < 1.0:
            state.note = f"the reach ends at {worked:.0%} of the path; that part is worked"
        if not placement.held:
            state.note = "the thrusters may not hold the hull against friction at the set force"
        state.path, state.placement = path, placement
        state.progress = Progress(float(path.s[-1]), job.speed, job.ramp)
        before = np.array(placement.X_WB)
        away = -(placement.X_WB @ self._vehicle.X_BA)[:3, 2]  # against the arm base's axis, which points to the work
        before[:3, 3] += away * max(job.lift, float(away @ (state.X_WB - before)[:3, 3]))
        state.hull_way = [before]
        if self._known is not None:
            obstacle = transform_points(target.X_WT, self._known.vertices)
            state.hull_way = HullPath(self._vehicle, self._chain, self._hull_box, obstacle).way(state.X_WB, before)
        self._move_hull(state, time, state.hull_way.pop(0))
        self._enter(state, WorkState.CLOSE_IN, time)

    def _beside(self, model: TargetModel, target: Target, whole: ToolPath) -> tuple[Placement, ToolPath, float]:
        """Hull placement beside a known object, for as much of the path as is within reach (a `Standing`).

        A placement without thrust margin against the worst friction is accepted as a second choice, marked
        `held=False`.
        """
        obstacle = transform_points(target.X_WT, model.vertices)
        holding = self._holding if self._job.contactless is None else None
        try:
            return self._stand_beside(obstacle, whole, holding)
        except ReachError:
            if holding is None:
                raise
        # Friction may be less than the worst case, and a hull that is pushed off its place retreats.
        placement, path, worked = self._stand_beside(obstacle, whole, holding.without_friction())
        return replace(placement, held=False), path, worked

    def _stand_beside(
        self, obstacle: Array, whole: ToolPath, holding: ThrustMargin | None
    ) -> tuple[Placement, ToolPath, float]:
        """Best placement over shares of the path and travels of the hull; raises ReachError if none exists."""
        job = self._job
        best: tuple[Placement, ToolPath, float] | None = None
        failure: ReachError | None = None
        for share, travel in self._ways_to_stand():
            if share < 1.0 and best is not None and best[0].margin >= job.cramped:
                break
            shorter = middle_part(whole, share)
            try:
                found = place_hull(
                    self._vehicle,
                    self._chain,
                    shorter,
                    obstacle=obstacle,
                    hull_box=self._hull_box,
                    force=max(job.forces),
                    standoff=job.standoff,
                    floor=self._floor,
                    travel=travel,
                    search=self._search,
                    holding=holding,
                )
            except ReachError as error:
                failure = failure or error
                continue
            if best is None or found.margin > best[0].margin:
                best = found, shorter, share
            if best[0].margin >= job.roomy:
                break
        if best is None:
            raise failure or ReachError("there is no way to stand")
        return best

    def _ways_to_stand(self) -> Iterator[tuple[float, float]]:
        """Candidates (share of the path to work, travel of the hull as a share of it), the best first."""
        yield from ((1.0, travel) for travel in _TRAVELS)
        share = 1.0 - _SHORTER
        while share >= self._job.least_share - 1e-9:
            yield share, 1.0
            share -= _SHORTER

    def _move_hull(self, state: SupervisorState, time: float, X_WB: Array) -> None:
        """Start a hull move from the present reference pose to `X_WB` (4, 4)."""
        job, state.hull_waited = self._job, 0.0
        state.hull_move = PoseMove.between(
            time,
            state.X_WB,
            X_WB,
            speed=job.hull_speed,
            acceleration=job.hull_acceleration,
            turn_rate=job.hull_turn_rate,
        )

    @staticmethod
    def _end_hull_move(state: SupervisorState, move: PoseMove) -> None:
        """Set the reference to the exact end of the hull move.

        The last reference was computed up to one period before the end.
        """
        state.X_WB, state.hull_move = move.X_to, None

    def _wait_for_hull(self, state: SupervisorState, estimate: StateEstimate) -> None:
        """Slow the hull move down to the motion of the hull.

        In a current the hull may be unable to follow.
        """
        state.hull_pace = 1.0
        if state.hull_move is None or state.state in _OVER:  # a retreat does not wait
            return
        near, far = (share * self._job.lost_place for share in self._BEHIND)
        behind = math.dist(estimate.X_WB[:3, 3].tolist(), state.X_WB[:3, 3].tolist())
        state.hull_pace = min(max((far - behind) / (far - near), 0.0), 1.0)
        if state.hull_pace < 1.0:
            late = (1.0 - state.hull_pace) * self.period
            state.hull_move, state.hull_waited = state.hull_move.later(late), state.hull_waited + late

    def _close_in(self, state: SupervisorState, estimate: StateEstimate) -> None:
        """Move to before the work pose, unfold the arm, move to the work pose, and wait until the hull is at rest."""
        time = estimate.time
        placement = state.placement
        assert placement is not None
        if state.hull_move is not None and state.hull_move.done(time):
            self._end_hull_move(state, state.hull_move)
            if state.hull_way:
                self._move_hull(state, time, state.hull_way.pop(0))
            elif np.array_equal(state.X_WB, placement.X_WB) and np.array_equal(state.q, placement.q_start):
                state.quiet_since = np.inf
            else:
                state.joint_moves = [JointMove.between(time, state.q, placement.q_start, speed=self._job.joint_speed)]
        elif state.joint_moves and state.joint_moves[0].done(time):
            state.q, state.joint_moves = np.array(placement.q_start), []
            self._move_hull(state, time, placement.X_WB)
        elif state.hull_move is None and not state.joint_moves and self._quiet(state, estimate):
            state.X_WG = self._on_path(state, 0.0, -self._job.standoff)[0]
            state.depth = 0.0
            self._enter(state, WorkState.TARE, time)

    def _approach(self, state: SupervisorState, time: float, felt: float) -> None:
        """Guarded move along the tool axis until contact."""
        job = self._job
        state.felt_for = state.felt_for + self.period if felt > job.touch else 0.0
        if job.contactless is not None:
            self._approach_without_contact(state, time, job.standoff - job.contactless)
            return
        if state.felt_for >= job.touch_time:
            state.force, state.contact_at, state.set_since, state.speed = felt, time, np.inf, 0.0
            self._enter(state, WorkState.PRESS, time)
            return
        self._advance(state, job.standoff)
        if state.depth > job.standoff + job.search:
            said = f"no contact within {job.search} m beyond the expected surface"
            self._break_off(state, time, AbortCode.NO_CONTACT, said)

    def _approach_without_contact(self, state: SupervisorState, time: float, depth: float) -> None:
        """Move to `depth` [m] from the stand-off, where the work begins; any contact on the way ends it."""
        if state.felt_for >= self._job.touch_time:
            said = "the tool touched something on its way to the distance that it is to keep"
            self._break_off(state, time, AbortCode.OBSTACLE, said)
            return
        self._advance(state, depth)
        if state.depth >= depth:
            state.depth, state.work_start = depth, time
            self._enter(state, WorkState.WORK, time)

    def _advance(self, state: SupervisorState, depth: float) -> None:
        """One period of the approach, at `touch_speed` from `guard` before `depth` [m] on."""
        job = self._job
        wanted = job.approach_speed if state.depth < depth - job.guard else job.touch_speed
        wanted = 0.0 if state.paused else wanted
        most = self._APPROACH_ACCELERATION * self.period
        state.speed += min(max(wanted - state.speed, -most), most)
        state.depth += state.speed * self.period

    def _press(self, state: SupervisorState, time: float, felt: float) -> None:
        """Ramp the force to its first set value, and wait until it is reached."""
        job = self._job
        state.contact_at = time
        if state.paused:
            state.since += self.period
        first = job.forces[0]
        self._ramp_force(state, first)
        if abs(felt - first) > 0.05 * first or state.force != first:
            state.set_since = np.inf
        elif not math.isfinite(state.set_since):
            state.set_since = time
        reached = time - state.set_since > 0.5
        late = time - state.since > job.press_time
        if reached or (late and not job.force_control):
            state.work_start = time
            self._enter(state, WorkState.WORK, time)
        elif late:
            said = f"the force of {first} N was not reached in {job.press_time} s: {felt:.1f} N"
            self._break_off(state, time, AbortCode.FORCE_NOT_REACHED, said)

    def _work(self, state: SupervisorState, time: float) -> None:
        """Advance along the path with the set force of the present part; retreat at its end."""
        progress = state.progress
        assert progress is not None
        most = self.period / self._PACE_TIME
        state.pace += min(max((0.0 if state.paused else 1.0) - state.pace, -most), most)
        state.work_start += (1.0 - state.pace) * self.period
        state.path_s, _ = progress.at(time - state.work_start)
        part = min(int(state.path_s / progress.length * len(self._job.forces)), len(self._job.forces) - 1)
        if self._job.contactless is None:
            self._ramp_force(state, self._job.forces[part] * (self._PAUSED_FORCE if state.paused else 1.0))
        if time - state.work_start > progress.duration + 0.5:
            state.unloading = self._job.force_control and self._job.contactless is None
            self._enter(state, WorkState.RETREAT, time)

    def _ramp_force(self, state: SupervisorState, wanted: float) -> None:
        """Change the set force towards `wanted` [N] at `force_rate`."""
        most = self._job.force_rate * self.period
        state.force += min(max(wanted - state.force, -most), most)

    def _retreat(self, state: SupervisorState, estimate: StateEstimate) -> None:
        """Withdraw the tool along its axis, by the arm or (if it is held) by the hull; then ascend if adrift.

        During an ascent on the remaining thrusters the hull tilts. The tool pose is therefore kept in W, moved along
        with the hull's displacement; a tool fixed to the hull would swing into the object.

        After finished work the force is ramped down first. A tool released at 90 N rebounds from a hard surface.
        """
        time = estimate.time
        if state.unloading:
            self._ramp_force(state, 0.0)
            state.unloading, state.since = state.force > self._job.touch, time
            return
        if rising := state.rising_from is not None:
            state.risen = estimate.X_WB[:3, 3] - state.rising_from
        if rising or state.arm_held:
            away = state.hull_move is None or state.hull_move.done(time)
        else:
            away = (time - state.since) * self._job.approach_speed > self._way_back(state)
        if not away:
            return
        if state.adrift and not (rising or state.arm_held):
            self._rise(state, estimate)
            return
        if rising:  # the ascent is finished: hold the joint angles
            state.q, state.arm_held = np.array(estimate.q), True
        self._enter(state, WorkState.ABORT if state.reason else WorkState.DONE, time)

    def _rise(self, state: SupervisorState, estimate: StateEstimate) -> None:
        """Start the ascent off the object from the present hull position."""
        state.rising_from = np.array(estimate.X_WB[:3, 3])
        state.X_WB = pose(state.X_WB[:3, :3], state.rising_from)
        normal = -self._on_path(state, state.path_s, 0.0)[0][:3, 2]
        clear = pose(state.X_WB[:3, :3], state.rising_from + self._job.lift * ascent_direction(normal))
        self._move_hull(state, estimate.time, clear)

    def _way_back(self, state: SupervisorState) -> float:
        """Length [m] of the retreat: the depth of the approach, at least the stand-off distance."""
        return max(state.depth, self._job.standoff)

    @staticmethod
    def _felt(state: SupervisorState, last: Command | None) -> float:
        """Normal force [N] as the controller estimates it; ConfigurationError without an estimate in contact."""
        if last is not None and last.contact.known:
            return last.contact.normal
        if last is not None and state.state in (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK):
            raise ConfigurationError(
                "the controller gives no contact estimate: Command.contact.normal [N] is not a number"
            )
        return 0.0

    def _watch(self, state: SupervisorState, estimate: StateEstimate, felt: float, last: Command | None) -> None:
        """Apply the response of `controllers.tasks.fault_reactions`: go on, pause, or break the work off."""
        time, faults = estimate.time, last.faults if last is not None else ()
        state.lost_thrusters = tuple(fault.index for fault in faults if fault.kind is FaultKind.THRUSTER)
        verdict = choose_reaction(self._job, state, estimate, felt, faults)
        state.paused = verdict.reaction is Reaction.PAUSE
        if verdict.reaction is Reaction.STOP and not math.isfinite(state.halted):
            state.abort, state.reason = verdict.code, verdict.reason
            state.halted, state.hull_move, state.joint_moves = self._HALT, None, []
            self._enter(state, WorkState.RETREAT, time if np.isfinite(time) else state.since)
        state.adrift |= verdict.reaction is Reaction.RISE or bool(state.lost_thrusters)
        if verdict.reaction in (Reaction.GO_ON, Reaction.PAUSE) or state.state in _OVER:
            return
        if state.state in (WorkState.SETTLE, WorkState.SCAN, WorkState.CLOSE_IN):
            self._give_up(state, time, verdict.code, verdict.reason)
        elif verdict.reaction is Reaction.WITHDRAW:
            state.q, state.joint_moves, state.arm_held = np.array(estimate.q), [], True
            off = np.array(state.X_WB)
            off[:3, 3] -= self._way_back(state) * self._on_path(state, state.path_s, 0.0)[0][:3, 2]
            self._move_hull(state, time, off)
            self._break_off(state, time, verdict.code, verdict.reason)
        else:
            self._break_off(state, time, verdict.code, verdict.reason)

    def _break_off(self, state: SupervisorState, time: float, code: AbortCode | None, reason: str) -> None:
        """Retreat, for the given reason."""
        state.abort, state.reason = code, reason
        self._enter(state, WorkState.RETREAT, time)

    def _give_up(self, state: SupervisorState, time: float, code: AbortCode | None, reason: str) -> None:
        """End the work where the vehicle is, for the given reason."""
        state.abort, state.reason = code, reason
        self._enter(state, WorkState.ABORT, time)

    # -- references ------------------------------------------------------------------------------------------------

    def _on_path(self, state: SupervisorState, s: float, offset: float) -> tuple[Array, Array, Array]:
        """Tool pose at arc length `s`, moved by `offset` [m] along its axis; its derivatives with s."""
        assert state.path is not None
        assert state.placement is not None
        X, tangent, turn = tool_pose(state.path, s, state.placement.roll)
        X[:3, 3] += offset * X[:3, 2]
        return X, tangent, turn

    def _reference(self, state: SupervisorState, time: float) -> Reference:
        """Reference for the controller in the present state."""
        job = self._job
        tare = state.state is WorkState.TARE and time - state.since > job.tare_after
        v_hull = _ZERO
        if state.hull_move is not None:
            state.X_WB, v_hull = state.hull_move.at(time)
            v_hull = state.hull_pace * v_hull
        q, qd = state.q, np.zeros(len(state.q))
        if state.joint_moves:
            q, qd = state.joint_moves[0].at(time)
        X_WG, v_tool, w_tool, force, force_control = None, _ZERO, _ZERO, 0.0, False
        if state.state is WorkState.TARE:
            X_WG = state.X_WG
        elif state.state is WorkState.APPROACH:
            X_WG = self._on_path(state, 0.0, state.depth - job.standoff)[0]
            v_tool = state.speed * X_WG[:3, 2]
        elif state.state is WorkState.PRESS:
            X_WG = self._on_path(state, 0.0, state.depth - job.standoff)[0]
            force, force_control = state.force, True
        elif state.state is WorkState.WORK:
            assert state.progress is not None
            rate = state.progress.at(time - state.work_start)[1]
            X_WG, tangent, turn = self._on_path(state, state.path_s, state.depth - job.standoff)
            rate *= state.pace
            v_tool, w_tool = rate * tangent, rate * turn
            if state.hull_move is None and not state.reason:
                assert state.placement is not None
                done, length = state.path_s / state.progress.length, state.progress.length
                state.X_WB, v_hull = state.placement.hull_at(done), rate / length * state.placement.travel_W
            force, force_control = state.force, job.contactless is None
        elif state.arm_held or math.isfinite(state.halted):
            pass  # the joint angles are held
        elif state.state in _OVER and state.placement is not None:
            back = self._way_back(state)
            if state.state is WorkState.RETREAT:
                back = min((time - state.since) * job.approach_speed, back)
            X_WG = self._on_path(state, state.path_s, state.depth - job.standoff - back)[0]
            if state.rising_from is not None:
                X_WG[:3, 3] += state.risen
                v_tool = v_hull
            elif state.unloading:
                force, force_control = state.force, True
            elif state.state is WorkState.RETREAT:
                v_tool = -job.approach_speed * X_WG[:3, 2]
        return Reference(
            time=time,
            state=state.state,
            X_WB=state.X_WB,
            v_WB_W=v_hull,
            X_WG=X_WG,
            v_WG_W=v_tool,
            w_WG_W=w_tool,
            q=q,
            qd=qd,
            force=force,
            force_control=force_control,
            tare=tare,
            scan=state.state is WorkState.SCAN and time >= state.look_from,
            path_s=state.path_s,
            abort=state.abort,
            note=state.reason or state.note,
            lost_thrusters=state.lost_thrusters,
        )


def ascent_direction(normal_W: Array) -> Array:
    """Direction (3,) of an ascent off a surface with normal `normal_W` (3,): up, and up to half as much along it.

    Straight up a steep flank the tool would strike parts of the object that bulge above it.
    """
    return np.array([0.0, 0.0, 1.0]) + max(0.0, 0.5 - normal_W[2]) * normal_W
