"""Point touching for kinematic calibration: the arm presses its ball tip into fixed nests.

Free motion follows joint angles. Over the nest the tip is held by a soft spring. In the nest the
spring's end then follows the tip, so that no side force remains, and a small constant force presses
the ball home. The arm is under joint-torque control; the torques bear its weight in water.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.mkps import Chain, solve
from uuv.controllers.tasks.phase import Context, Held, Hold, Outcome, Phase, PhaseEvent, Setpoint
from uuv.controllers.tasks.task import TaskPlanner, TaskRow
from uuv.controllers.tuning import TOUCH, TouchTuning
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array, inverse, pose, rotation_from_z


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nest:
    """Nest in W, as known to the vehicle."""

    p_WN: Array  # (3,) [m] position of a seated tip
    z_WN: Array  # (3,) unit axis, out of the nest


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touch:
    """One touch: its nest, and the direction of the tool."""

    nest: int  # index
    R_WG: Array  # (3, 3) wanted tool frame, z out of the tool


def draw_touches(
    chain: Chain,
    X_AW: Array,
    nests: Sequence[Nest],
    count: int,
    rng: np.random.Generator,
    q_start: Array,
    *,
    cone: float = np.deg2rad(65.0),
    tries: int = 4000,
) -> list[Touch]:
    """Draw random, reachable tool directions for each nest.

    Every direction lies within `cone` of the nest's axis and is reachable at the nest and above it.
    Consecutive touches of a nest are ordered by nearest joint angles.

    Args:
        chain: the arm, base to tool.
        X_AW: (4, 4) pose of W in the arm's base frame A.
        nests: the nests.
        count: touches per nest.
        rng: random generator.
        q_start: (n,) [rad] start of the inverse kinematics.
        cone: [rad] largest angle from the nest's axis.
        tries: largest number of directions drawn per nest.

    Returns:
        The touches, nest by nest.

    Raises:
        ReachError: if too few directions of a nest are within reach.
    """
    out = []
    for k, nest in enumerate(nests):
        reachable: list[tuple[Array, Touch]] = []
        for _ in range(tries):
            if len(reachable) == count:
                break

            R_WG = _direction(nest.z_WN, cone, rng)
            above = pose(R_WG, nest.p_WN + TOUCH.lift * nest.z_WN)
            over, seated = (
                solve(chain, X_AW @ X, q_start, 1e-4, 1e-3) for X in (above, pose(R_WG, nest.p_WN))
            )
            if over.converged and seated.converged:
                reachable.append((over.q, Touch(nest=k, R_WG=R_WG)))

        if len(reachable) < count:
            raise ReachError(
                f"nest {k + 1} at {np.round(nest.p_WN, 2)} m: {len(reachable)} of {count} "
                "directions within reach"
            )

        # In the order of nearest joint angles
        at = q_start
        while reachable:  # next the one nearest in joint angles
            q, touch = reachable.pop(int(np.argmin([np.abs(q - at).max() for q, _ in reachable])))
            out.append(touch)
            at = q
    return out


def _direction(z: Array, cone: float, rng: np.random.Generator) -> Array:
    """Random tool frame, its z against `z` within `cone`, uniform over the cap and about itself."""
    height = rng.uniform(np.cos(cone), 1.0)
    turn, spin = rng.uniform(0.0, 2.0 * np.pi, 2)
    side = np.sqrt(1.0 - height**2)

    R = rotation_from_z(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    along = -R @ [side * np.cos(turn), side * np.sin(turn), height]
    R = rotation_from_z(along, np.eye(3)[int(np.argmin(np.abs(along)))])

    c, s = np.cos(spin), np.sin(spin)
    return R @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(slots=True, eq=False)
class TouchProgress:
    """Progress of the touches, in `Held.plan`."""

    at: int = 0  # index of the touch
    # (3,) [m] per nest: found minus known position, W
    offsets: dict[int, list[Array]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchJob:
    """Touches to make, and the nests' positions."""

    vehicle: Vehicle
    chain: Chain  # its arm, base to tool
    nests: Sequence[Nest]
    touches: Sequence[Touch]  # in this order
    X_WB: Array  # (4, 4) hull pose in W, held throughout
    tuning: TouchTuning

    @property
    def X_WA(self) -> Array:
        """Pose (4, 4) of the arm's base in W."""
        return self.X_WB @ np.array(self.vehicle.X_BA)

    def aim(self, plan: TouchProgress) -> tuple[Touch, Nest, Array]:
        """Present touch, its nest, and p_WN (3,) by the arm model, corrected by past touches."""
        touch = self.touches[plan.at]
        nest = self.nests[touch.nest]
        offsets = plan.offsets.get(touch.nest)
        return touch, nest, nest.p_WN if not offsets else nest.p_WN + np.mean(offsets[-5:], axis=0)

    def way(self, plan: TouchProgress, q: Array) -> list[Array]:
        """Joint angles (n,) on the way to a posture above the next nest, or at the end to the ready
        posture.

        The way passes through the ready posture if the straight motion would strike a nest.
        """
        ready = np.array(self.vehicle.q_ready)
        if plan.at >= len(self.touches):
            return [ready]

        touch, nest, aim = self.aim(plan)
        over = aim + self.tuning.lift * nest.z_WN
        goal = solve(self.chain, inverse(self.X_WA) @ pose(touch.R_WG, over), ready, 1e-4, 1e-3).q

        return [goal] if self._clear(q, goal) else [ready, goal]

    def _clear(self, q_from: Array, q_to: Array) -> bool:
        """True if the pin keeps clear of every nest on the straight line in joint space."""
        for share in np.linspace(0.0, 1.0, 30):
            X_WG = self.X_WA @ self.chain.forward(q_from + share * (q_to - q_from))
            for nest in self.nests:
                apart = X_WG[:3, 3] - nest.p_WN
                if (
                    float(np.linalg.norm(apart)) < 0.12
                    and float(apart @ nest.z_WN) < 0.7 * self.tuning.lift
                ):
                    return False
        return True


@dataclass(slots=True, eq=False)
class WayState:
    """State of `MoveOver`."""

    way: list[Array]  # (n,) [rad] joint angles still to reach
    since: float  # [s] begin of the present motion
    q_from: Array  # (n,) [rad] its start
    duration: float  # [s] of it
    qd: Array  # (n,) [rad/s]


class MoveOver(Phase):
    """Move the joints to a posture above the next nest (MORE), or at the end to the ready posture
    (DONE).
    """

    def __init__(self, job: TouchJob) -> None:
        self._job = job

    def enter(self, held: Held, context: Context) -> WayState:
        """Plan the way and begin."""
        if held.plan is None:
            held.plan = TouchProgress()
        plan = held.plan_of(TouchProgress)
        return self._depart(self._job.way(plan, np.array(context.estimate.q)), held, context)

    def _depart(self, way: list[Array], held: Held, context: Context) -> WayState:
        """Begin the motion to the first joint angles of the way."""
        held.q = np.array(context.estimate.q)
        # A quintic's peak speed is 15/8 of its mean.
        duration = max(
            0.5, 1.875 * float(np.abs(way[0] - held.q).max()) / self._job.tuning.move_speed
        )
        return WayState(way, context.time, held.q, duration, np.zeros(len(held.q)))

    def step(self, state: WayState, held: Held, context: Context) -> Outcome:
        """A quintic in time; the pin comes to rest for 0.3 s over a nest."""
        t = context.time - state.since
        last = held.plan_of(TouchProgress).at >= len(self._job.touches)

        if last and t >= state.duration:
            held.q = state.way[-1]
            state.qd = np.zeros(len(held.q))
            return PhaseEvent.DONE

        # Over the nest, or on to the next joint angles
        if t >= state.duration + (0.3 if len(state.way) == 1 else 0.0):
            if len(state.way) == 1:
                return PhaseEvent.MORE
            departure = self._depart(state.way[1:], held, context)
            state.way = departure.way
            state.since = departure.since
            state.q_from = departure.q_from
            state.duration = departure.duration
            t = 0.0

        # Quintic from rest to rest
        s = min(1.0, t / state.duration)
        blend = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        rate = 30.0 * s * s * (1.0 - s) ** 2 / state.duration
        way = state.way[0] - state.q_from
        held.q = state.q_from + blend * way
        state.qd = rate * way
        return None

    def setpoint(self, state: WayState, held: Held, context: Context) -> Setpoint:
        """The joints' velocity."""
        del held, context
        return Setpoint(qd=state.qd)


@dataclass(slots=True, eq=False)
class NestState:
    """State of `OverNest`."""

    since: float  # [s]
    # (3,) [m] found minus known position of the seated pin, W, not yet taken over
    offset: Array | None = None


class OverNest(Phase):
    """Motion of the spring's end along a nest's axis."""

    def __init__(
        self, job: TouchJob, seconds: float, start: float, speed: float, *, reads: bool = False
    ) -> None:
        """Set up the phase.

        Args:
            job: touches to make.
            seconds: [s] of the phase.
            start: [m] first height over the nest.
            speed: [m/s] upwards.
            reads: the pin is pressed home and the encoders are read.
        """
        self._job = job
        self._seconds = seconds
        self._start = start
        self._speed = speed
        self._reads = reads

    def enter(self, held: Held, context: Context) -> NestState:
        """Begin at the first height."""
        del held
        return NestState(context.time)

    def step(self, state: NestState, held: Held, context: Context) -> Outcome:
        """Report DONE when the time is over."""
        del held
        return None if context.time - state.since < self._seconds else PhaseEvent.DONE

    def setpoint(self, state: NestState, held: Held, context: Context) -> Setpoint:
        """The end of the spring."""
        plan = held.plan_of(TouchProgress)
        t = context.time - state.since
        tuning = self._job.tuning

        touch, nest, aim = self._job.aim(plan)
        X_WG = pose(touch.R_WG, aim + (self._start + self._speed * t) * nest.z_WN)
        if not self._reads:
            return Setpoint(X_WG=X_WG)

        settled = plan.at if t >= tuning.settle else None
        return Setpoint(X_WG=X_WG, set_force=tuning.push, touch=settled)


class LeaveNest(OverNest):
    """Motion out of the nest; the position of the seated pin corrects the next touches of it."""

    def enter(self, held: Held, context: Context) -> NestState:
        """Compute where the pin is."""
        plan = held.plan_of(TouchProgress)
        job = self._job
        estimate = context.estimate
        X_WG = estimate.X_WB @ job.vehicle.X_BA @ job.chain.forward(estimate.q)
        return NestState(context.time, X_WG[:3, 3] - job.nests[job.touches[plan.at].nest].p_WN)

    def step(self, state: NestState, held: Held, context: Context) -> Outcome:
        """Adopt the offset; report DONE above the nest."""
        plan = held.plan_of(TouchProgress)
        job = self._job

        if state.offset is not None and float(np.linalg.norm(state.offset)) < job.tuning.believable:
            plan.offsets.setdefault(job.touches[plan.at].nest, []).append(state.offset)
        state.offset = None

        outcome = super().step(state, held, context)
        plan.at += outcome is not None
        return outcome


class TouchSequence(TaskPlanner):
    """Planner (`uuv.sim.interfaces.protocols.Planner`) that asks for one touch after the other.

    `Reference.touch` is the index of the touch while the encoders are to be read.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        chain: Chain,
        nests: Sequence[Nest],
        touches: Sequence[Touch],
        X_WB: Array,
        tuning: TouchTuning | None = None,
    ) -> None:
        """Set up the planner.

        Args:
            vehicle: the vehicle.
            chain: its arm, base to tool.
            nests: the nests.
            touches: touches to make, in this order.
            X_WB: (4, 4) hull pose in W, held throughout.
            tuning: motion, stiffness and force of the touches.
        """
        tuning = tuning or TouchTuning()
        job = TouchJob(
            vehicle=vehicle,
            chain=chain,
            nests=tuple(nests),
            touches=tuple(touches),
            X_WB=X_WB,
            tuning=tuning,
        )

        way = tuning.lift + tuning.beyond
        fast = 2.0 * tuning.descent
        ends = PhaseEvent
        states = WorkState

        down = OverNest(job, way / tuning.descent, tuning.lift, -tuning.descent)
        press = OverNest(job, tuning.settle + tuning.reading, -tuning.beyond, 0.0, reads=True)
        up = LeaveNest(job, way / fast, -tuning.beyond, fast)

        rows = {
            "over": TaskRow(MoveOver(job), states.CLOSE_IN, {ends.MORE: "down", ends.DONE: "held"}),
            "down": TaskRow(down, states.APPROACH, {ends.DONE: "press"}),
            "press": TaskRow(press, states.PRESS, {ends.DONE: "up"}),
            "up": TaskRow(up, states.RETREAT, {ends.DONE: "over"}),
            "held": TaskRow(Hold(), states.DONE),
        }

        super().__init__(rows.items(), (), X_WB=X_WB, q=vehicle.q_home, period=0.004)
