"""Phase that an operator drives: velocities become poses of hull and tool, within limits.

The tool is carried by the hull. Its way is bounded by the mode of the phase: free; guarded, where a
set force is asked for and the tool advances slowly until it touches; in contact, where the force
loop alone moves the tool along its axis.
"""

import itertools
import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from uuv.controllers.driving.operator_inputs import OPEN, OperatorInput, OperatorInputs
from uuv.controllers.planning.arm_margins import posture_for, singular_margin
from uuv.controllers.planning.arm_size import reach
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.approach_limits import ApproachLimits
from uuv.controllers.tasks.hull_phases import HullMotion
from uuv.controllers.tasks.phase import (
    ZERO,
    Context,
    Held,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
    ToolLine,
    towards,
)
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose

_UP = np.array([0.0, 0.0, 1.0])
# [m] across the tool axis and back along it, from the ready posture, for an arm of size 1
_ASIDE = (-0.25, -0.125, 0.0, 0.125, 0.25)
_BACK = (0.0, -0.1, -0.2)
_ROOM = 0.3  # [rad] of every joint to its limits, in the posture in which the drive begins
_CALM = 0.3  # [s] at touch speed before a force counts as contact: braking is felt too
_STILL = 1e-6  # [m/s], [rad/s] below which a velocity is none
OUT_OF_REACH = "the tool is at the end of the arm's reach"
INPUTS_ENDED = "the inputs ended"


class Mode(StrEnum):
    """How the tool may move."""

    FREE = "free"
    GUARDED = "guarded"  # a force is set; slowly until contact
    CONTACT = "contact"  # under force control; across its axis only


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveLimits:
    """Limits of what an operator moves; those of his speeds are in `operator_inputs`."""

    motion: HullMotion = field(default_factory=HullMotion)
    near_hull: float = 0.03  # [m/s] of the hull, with a set force
    near_yaw: float = 0.03  # [rad/s] likewise
    near_tool: float = 0.05  # [m/s] of the tool across its axis, likewise
    tool_acceleration: float = 0.1  # [m/s^2]
    turn_acceleration: float = 0.3  # [rad/s^2] of hull and tool
    joint_speed: float = 0.6  # [rad/s] above which the tool stops
    # [-] margin from singular postures below which the tool moves away from them only: the force
    # loop needs some centimetres more along its axis
    singular: float = 0.5
    roomy: float = 0.9  # [-] such a margin of the posture in which the drive begins
    # [s] without contact, after which the tool approaches again; before the work ends for it
    lost: float
    hold: float = 2.0  # [s] of rest after the last input


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cockpit:
    """What the operator drives, and by what."""

    work_vehicle: WorkVehicle
    source: OperatorInputs
    delay: float  # [s] between operator and vehicle
    approach: ApproachLimits
    force_rate: float  # [N/s] of the set force
    limits: DriveLimits

    def line(self, X_WB: Array, X_WG: Array, q: Array) -> ToolLine:
        """Line of one tool pose, along whose axis the tool is withdrawn."""
        ends = np.array([0.0, 0.01])
        axes = np.repeat(X_WG[None, :3, :3], 2, axis=0)
        path = ToolPath(
            s=ends,
            p=X_WG[:3, 3] + ends[:, None] * X_WG[:3, 0],
            z=axes[:, :, 2],
            x=axes[:, :, 0],
            on_scan=np.zeros(2, dtype=bool),
        )
        placement = Placement(
            X_WB=X_WB, travel_W=np.zeros(3), roll=0.0, q_start=q, margin=1.0, reached=1.0
        )
        return ToolLine(path, placement, 0.0)

    def reached(self, X_WB: Array, X_WG: Array, q: Array, period: float) -> Array | None:
        """Joint angles (n,) of a tool pose, from `q`; None: out of reach within a period [s]."""
        q_next = self.posture(X_WB, X_WG, q)
        if q_next is None or np.abs(q_next - q).max() > self.limits.joint_speed * period:
            return None

        # Near a singular posture only away from it
        margin = self._margin(q_next)
        near = margin < self.limits.singular
        return None if near and margin < self._margin(q) else q_next

    def posture(self, X_WB: Array, X_WG: Array, q: Array) -> Array | None:
        """Joint angles (n,) of a tool pose, of those around `q`, however far; None: none."""
        X_AG = inverse(X_WB @ self.work_vehicle.vehicle.X_BA) @ X_WG
        solution = posture_for(self.work_vehicle.chain, X_AG, q)
        return solution.q if solution.converged else None

    def tool_at(self, X_WB: Array, q: Array) -> Array:
        """Tool pose (4, 4) of joint angles (n,), W."""
        work_vehicle = self.work_vehicle
        return X_WB @ work_vehicle.vehicle.X_BA @ work_vehicle.chain.forward(q)

    def _margin(self, q: Array) -> float:
        """Margin [-] of joint angles (n,) from singular postures."""
        return singular_margin(self.work_vehicle.chain.jacobian(q), reach(self.work_vehicle.chain))

    def roomy_posture(self) -> Array:
        """Joint angles (n,) near the ready posture with room to drive the tool in.

        The tool axis is that of the ready posture, whose wrist may be singular: the nearest of some
        places around it that is not, else the least singular one.
        """
        chain = self.work_vehicle.chain
        size = self.work_vehicle.size
        ready = np.array(self.work_vehicle.vehicle.q_ready)
        X_AG = chain.forward(ready)
        around = [size * np.array(shift) for shift in itertools.product(_ASIDE, _ASIDE, _BACK)]

        best = ready
        most = self._margin(ready)
        for shift in sorted(around, key=np.linalg.norm):
            if most >= self.limits.roomy:
                break
            solution = posture_for(chain, X_AG @ pose(p=shift), ready)
            room = np.minimum(solution.q - chain.limits[:, 0], chain.limits[:, 1] - solution.q)
            if not solution.converged or room.min() < _ROOM:
                continue
            margin = self._margin(solution.q)
            if margin > most:
                best = solution.q
                most = margin
        return best


@dataclass(slots=True, eq=False)
class Driven:
    """What the operator has moved so far, in `Held.plan`."""

    start: float  # [s] time of the vehicle at which that of the inputs begins
    X_WG: Array  # (4, 4) tool pose
    q: Array  # (n,) [rad] joint angles for it
    hull: Array = field(default_factory=lambda: np.zeros(4))  # velocities as `OperatorInput`
    tool: Array = field(default_factory=lambda: np.zeros(3))
    turn: Array = field(default_factory=lambda: np.zeros(3))
    along: float = 0.0  # [m/s] of the tool, along its axis
    asked_force: float = 0.0  # [N] by the last input with a closed clutch
    ended: float = math.inf  # [s] since when there is no input any more
    v_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [m/s]
    w_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [rad/s]
    v_WG_W: Array = field(default_factory=lambda: ZERO)
    w_WG_W: Array = field(default_factory=lambda: ZERO)

    def rest(self) -> None:
        """Come to rest at once."""
        self.hull = np.zeros(4)
        self.tool = np.zeros(3)
        self.turn = np.zeros(3)
        self.along = 0.0
        self.v_WB_W = self.w_WB_W = self.v_WG_W = self.w_WG_W = ZERO


@dataclass(slots=True)
class OperatorDriveState:
    """State of `OperatorDrive`."""

    felt_for: float = 0.0  # [s] for which contact has lasted, or in contact has been lost
    slow_for: float = 0.0  # [s] for which the tool has been slow enough for a touch to be felt


class OperatorDrive(Phase):
    """Hull and tool follow the operator; more or refused where another mode is to follow."""

    def __init__(self, cockpit: Cockpit, mode: Mode) -> None:
        self._cockpit = cockpit
        self._mode = mode

    def enter(self, held: Held, now: Context) -> OperatorDriveState:
        """Go on in this mode; in contact from rest, with the force that is felt."""
        if self._mode is Mode.CONTACT:
            held.plan_of(Driven).rest()
            held.set_force = max(now.normal, 0.0)
        else:
            held.set_force = 0.0
        return OperatorDriveState()

    def step(self, state: OperatorDriveState, held: Held, now: Context) -> Outcome:
        """Done some time after the last input; the other events change the mode."""
        cockpit = self._cockpit
        driven = held.plan_of(Driven)
        asked = self._asked(driven, held, now)

        if now.time - driven.ended >= cockpit.limits.hold and not self._moves(driven):
            return PhaseEvent.DONE
        if event := self._change(state, driven, now):
            return event

        if self._mode is Mode.CONTACT:
            most = cockpit.force_rate * now.period
            held.set_force = towards(held.set_force, driven.asked_force, most)
        self._follow(asked, driven, held, now)
        return None

    def _asked(self, driven: Driven, held: Held, context: Context) -> OperatorInput:
        """What the operator asks for; nothing while the clutch is open or motion is to wait."""
        source = self._cockpit.source
        time = context.time - driven.start
        source.poll(time)
        asked = source.at(time - self._cockpit.delay)
        if asked is None:
            if not math.isfinite(driven.ended):
                driven.ended = context.time
                held.note = INPUTS_ENDED
            return OPEN

        if asked.clutch and not context.paused:
            driven.asked_force = asked.set_force
            return asked
        return OPEN

    def _moves(self, driven: Driven) -> bool:
        speeds = np.concatenate((driven.hull, driven.tool, driven.turn))
        return bool(np.abs(speeds).max() > _STILL)

    def _change(
        self, state: OperatorDriveState, driven: Driven, context: Context
    ) -> PhaseEvent | None:
        """Event that ends the mode."""
        approach = self._cockpit.approach
        if self._mode is Mode.FREE:
            return PhaseEvent.MORE if driven.asked_force > 0.0 else None
        if driven.asked_force == 0.0:
            return PhaseEvent.REFUSED

        # Slipped off: slowly on to the surface again
        if self._mode is Mode.CONTACT:
            lost = context.normal < 0.5 * approach.touch
            state.felt_for = state.felt_for + context.period if lost else 0.0
            return PhaseEvent.MORE if state.felt_for >= self._cockpit.limits.lost else None

        slow = driven.along <= approach.touch_speed + _STILL
        state.slow_for = state.slow_for + context.period if slow else 0.0
        felt = context.normal > approach.touch and state.slow_for >= _CALM
        state.felt_for = state.felt_for + context.period if felt else 0.0
        return PhaseEvent.TOUCHED if state.felt_for >= approach.touch_time else None

    def _follow(self, asked: OperatorInput, driven: Driven, held: Held, context: Context) -> None:
        """Move hull and tool for one period."""
        period = context.period
        self._speed_up(asked, driven, held, context)

        # The hull stays level; the tool is carried along
        R_WB = held.X_WB[:3, :3]
        X_WG = driven.X_WG
        v_WB_W = R_WB @ driven.hull[:3]
        w_WB_W = driven.hull[3] * _UP
        X_WB = _moved(held.X_WB, v_WB_W, w_WB_W, period)
        carried = v_WB_W + np.cross(w_WB_W, X_WG[:3, 3] - held.X_WB[:3, 3])

        # The tool's own motion, bounded along its axis
        axis = X_WG[:3, 2]
        v_WG_W = carried + X_WG[:3, :3] @ driven.tool
        along = self._inwards(float(v_WG_W @ axis), driven, context)
        v_WG_W = v_WG_W + (along - v_WG_W @ axis) * axis
        w_WG_W = w_WB_W + X_WG[:3, :3] @ driven.turn
        X_next = _moved(X_WG, v_WG_W, w_WG_W, period)

        # Within reach, or the tool is only carried
        q = self._cockpit.reached(X_WB, X_next, driven.q, period)
        if q is None:
            held.note = OUT_OF_REACH
            carried_in = float(carried @ axis)
            into_contact = carried_in > self._inwards(carried_in, driven, context)
            if self._mode is not Mode.FREE or into_contact:
                driven.rest()
                return
            driven.tool = np.zeros(3)
            driven.turn = np.zeros(3)
            X_next = X_WB @ inverse(held.X_WB) @ X_WG
            v_WG_W = carried
            w_WG_W = w_WB_W
            q = driven.q
        elif held.note == OUT_OF_REACH:
            held.note = ""

        # As it is commanded
        driven.v_WB_W = v_WB_W
        driven.w_WB_W = w_WB_W
        driven.v_WG_W = v_WG_W
        driven.w_WG_W = w_WG_W
        driven.along = float(v_WG_W @ axis)
        driven.X_WG = X_next
        driven.q = q
        held.X_WB = X_WB
        held.q = q
        held.line = self._cockpit.line(X_WB, X_next, q)

    def _speed_up(self, asked: OperatorInput, driven: Driven, held: Held, context: Context) -> None:
        """Change the speeds towards what is asked for, by the accelerations."""
        limits = self._cockpit.limits
        motion = limits.motion
        hull = asked.hull * motion.pace(held.off(context.estimate))
        tool = asked.tool
        if self._mode is not Mode.FREE:
            near = np.array([*[limits.near_hull] * 3, limits.near_yaw])
            hull = np.clip(hull, -near, near)
            tool = np.clip(tool, -limits.near_tool, limits.near_tool)

        turning = limits.turn_acceleration
        most = np.array([*[motion.acceleration] * 3, turning]) * context.period
        driven.hull = driven.hull + np.clip(hull - driven.hull, -most, most)
        most_tool = limits.tool_acceleration * context.period
        driven.tool = driven.tool + np.clip(tool - driven.tool, -most_tool, most_tool)
        most_turn = turning * context.period
        driven.turn = driven.turn + np.clip(asked.turn - driven.turn, -most_turn, most_turn)

    def _inwards(self, speed: float, driven: Driven, context: Context) -> float:
        """Speed [m/s] of the tool along its axis, as far as the mode allows it."""
        approach = self._cockpit.approach
        if self._mode is Mode.CONTACT:
            return 0.0
        touches = context.normal > approach.touch
        if self._mode is Mode.FREE:
            return min(speed, 0.0) if touches else speed

        # Guarded: from a faster motion it brakes
        braking = driven.along - self._cockpit.limits.tool_acceleration * context.period
        return min(speed, max(approach.touch_speed, 0.0 if touches else braking))

    def setpoint(self, state: OperatorDriveState, held: Held, now: Context) -> Setpoint:
        """Hull and tool as driven."""
        del state, now
        driven = held.plan_of(Driven)
        return Setpoint(
            X_WG=driven.X_WG,
            v_WG_W=driven.v_WG_W,
            w_WG_W=driven.w_WG_W,
            v_WB_W=driven.v_WB_W,
            w_WB_W=driven.w_WB_W,
            set_force=held.set_force,
            force_control=self._mode is Mode.CONTACT,
        )


def _moved(X: Array, v_W: Array, w_W: Array, period: float) -> Array:
    """Pose (4, 4) after `period` [s] at a velocity (3,) [m/s] and an angular one (3,) [rad/s]."""
    return pose(exp_so3(w_W * period) @ X[:3, :3], X[:3, 3] + v_W * period)
