"""Phase in which an operator drives: velocities are integrated to poses of hull and tool, within
limits.

The tool moves with the hull. The mode of the phase restricts its own motion. In the mode "free"
there is no restriction. In the mode "guarded" a set force is requested, and the tool advances
slowly until contact. In the mode "contact" only the force loop moves the tool along its axis.
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
# [m] distances tried across the tool axis and back along it, from the ready posture, for an arm of
# size 1
_ASIDE = (-0.25, -0.125, 0.0, 0.125, 0.25)
_BACK = (0.0, -0.1, -0.2)
# [rad] distance of every joint from its limits, in the posture in which the drive begins
_ROOM = 0.3
_CALM = 0.3  # [s] at touch speed before a force counts as contact, since braking causes a force too
_STILL = 1e-6  # [m/s], [rad/s] below which a velocity counts as zero
OUT_OF_REACH = "the tool is at the end of the arm's reach"
INPUTS_ENDED = "the inputs ended"


class Mode(StrEnum):
    """How the tool may move."""

    FREE = "free"
    GUARDED = "guarded"  # a force is set; slow motion until contact
    CONTACT = "contact"  # under force control; motion only perpendicular to the tool axis


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveLimits:
    """Limits of the motion that an operator commands; limits of the input speeds are in
    `operator_inputs`.
    """

    motion: HullMotion = field(default_factory=HullMotion)
    near_hull: float = 0.03  # [m/s] of the hull, with a set force
    near_yaw: float = 0.03  # [rad/s] of the hull, with a set force
    near_tool: float = 0.05  # [m/s] of the tool perpendicular to its axis, with a set force
    tool_acceleration: float = 0.1  # [m/s^2]
    turn_acceleration: float = 0.3  # [rad/s^2] of hull and tool
    joint_speed: float = 0.6  # [rad/s] turning rate of the hull above which the tool stops
    # [-] margin from singular postures, below which the tool may only move away from them, since
    # the force loop needs some centimetres more along the tool axis
    singular: float = 0.5
    roomy: float = 0.9  # [-] such a margin for the posture in which the drive begins
    # [s] without contact, after which the tool approaches again; shorter than the time that ends
    # the work
    lost: float
    hold: float = 2.0  # [s] of rest after the last input


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cockpit:
    """The arm that the operator drives, and the operator's inputs."""

    work_vehicle: WorkVehicle
    source: OperatorInputs
    delay: float  # [s] delay between operator and vehicle
    approach: ApproachLimits
    force_rate: float  # [N/s] rate of the set force
    limits: DriveLimits

    def line(self, X_WB: Array, X_WG: Array, q: Array) -> ToolLine:
        """Path of a single tool pose, along whose axis the tool is withdrawn."""
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
        """Joint angles (n,) of a tool pose, starting from `q`; None if they cannot be reached
        within a period [s].
        """
        q_next = self.posture(X_WB, X_WG, q)
        if q_next is None or np.abs(q_next - q).max() > self.limits.joint_speed * period:
            return None

        # Near a singular posture only motion away from it is allowed
        margin = self._margin(q_next)
        near = margin < self.limits.singular
        return None if near and margin < self._margin(q) else q_next

    def posture(self, X_WB: Array, X_WG: Array, q: Array) -> Array | None:
        """Joint angles (n,) of a tool pose, on the branch of `q` but at any distance; None if there
        are none.
        """
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

        The tool axis is that of the ready posture. Since the wrist may be singular there, the
        nearest of some positions around it that is not singular is used, else the least singular
        one.
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
    """Present poses and speeds of the drive, stored in `Held.plan`."""

    start: float  # [s] time of the vehicle at which the time of the inputs begins
    X_WG: Array  # (4, 4) tool pose
    q: Array  # (n,) [rad] joint angles for it
    # velocities in the form of `OperatorInput`
    hull: Array = field(default_factory=lambda: np.zeros(4))
    tool: Array = field(default_factory=lambda: np.zeros(3))
    turn: Array = field(default_factory=lambda: np.zeros(3))
    along: float = 0.0  # [m/s] speed of the tool, along its axis
    asked_force: float = 0.0  # [N] set force of the last input with a closed clutch
    ended: float = math.inf  # [s] time since which there is no input any more
    v_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [m/s] velocity of the tool, W
    # (3,) [rad/s] angular velocity of the tool, W
    w_WB_W: Array = field(default_factory=lambda: ZERO)
    v_WG_W: Array = field(default_factory=lambda: ZERO)
    w_WG_W: Array = field(default_factory=lambda: ZERO)

    def rest(self) -> None:
        """Set all speeds to zero at once."""
        self.hull = np.zeros(4)
        self.tool = np.zeros(3)
        self.turn = np.zeros(3)
        self.along = 0.0
        self.v_WB_W = self.w_WB_W = self.v_WG_W = self.w_WG_W = ZERO


@dataclass(slots=True)
class OperatorDriveState:
    """State of `OperatorDrive`."""

    felt_for: float = 0.0  # [s] duration of contact, or, in contact, of its loss
    slow_for: float = 0.0  # [s] duration for which the tool has been slow enough to detect contact


class OperatorDrive(Phase):
    """Phase in which hull and tool follow the operator; it ends with the event "more" or "refused"
    if another mode is to follow.
    """

    def __init__(self, cockpit: Cockpit, mode: Mode) -> None:
        self._cockpit = cockpit
        self._mode = mode

    def enter(self, held: Held, context: Context) -> OperatorDriveState:
        """Continue in this mode; in contact the tool starts from rest, with the measured force."""
        if self._mode is Mode.CONTACT:
            held.plan_of(Driven).rest()
            held.set_force = max(context.normal, 0.0)
        else:
            held.set_force = 0.0
        return OperatorDriveState()

    def step(self, state: OperatorDriveState, held: Held, context: Context) -> Outcome:
        """Report "done" some time after the last input; other events change the mode."""
        cockpit = self._cockpit
        driven = held.plan_of(Driven)
        asked = self._asked(driven, held, context)

        if context.time - driven.ended >= cockpit.limits.hold and not self._moves(driven):
            return PhaseEvent.DONE
        if event := self._change(state, driven, held, context):
            return event

        if self._mode is Mode.CONTACT:
            most = cockpit.force_rate * context.period
            held.set_force = towards(held.set_force, driven.asked_force, most)
        self._follow(asked, driven, held, context)
        return None

    def _asked(self, driven: Driven, held: Held, context: Context) -> OperatorInput:
        """Motion that the operator requests; none while the clutch is open or motion has to
        wait.
        """
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
        self, state: OperatorDriveState, driven: Driven, held: Held, context: Context
    ) -> PhaseEvent | None:
        """Event that ends the mode."""
        approach = self._cockpit.approach
        if self._mode is Mode.FREE:
            return PhaseEvent.MORE if driven.asked_force > 0.0 else None
        if driven.asked_force == 0.0:
            return PhaseEvent.REFUSED

        # Contact was lost: move slowly to the surface again
        if self._mode is Mode.CONTACT:
            lost = context.normal < approach.lost_below(held.set_force)
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

        # The hull stays level; the tool moves with the hull
        R_WB = held.X_WB[:3, :3]
        X_WG = driven.X_WG
        v_WB_W = R_WB @ driven.hull[:3]
        w_WB_W = driven.hull[3] * _UP
        X_WB = _moved(held.X_WB, v_WB_W, w_WB_W, period)
        carried = v_WB_W + np.cross(w_WB_W, X_WG[:3, 3] - held.X_WB[:3, 3])

        # The tool's own motion, limited along its axis
        axis = X_WG[:3, 2]
        v_WG_W = carried + X_WG[:3, :3] @ driven.tool
        along = self._inwards(float(v_WG_W @ axis), driven, context)
        v_WG_W = v_WG_W + (along - v_WG_W @ axis) * axis
        w_WG_W = w_WB_W + X_WG[:3, :3] @ driven.turn
        X_next = _moved(X_WG, v_WG_W, w_WG_W, period)

        # The pose must be within reach, unless the tool only moves with the hull
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

        # Store the motion as commanded
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
        """Change the speeds towards the requested ones, within the limits of acceleration."""
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
        """Speed [m/s] of the tool along its axis, within the limits of the mode."""
        approach = self._cockpit.approach
        if self._mode is Mode.CONTACT:
            return 0.0
        touches = context.normal > approach.touch
        if self._mode is Mode.FREE:
            return min(speed, 0.0) if touches else speed

        # Guarded: the tool brakes from a faster motion
        braking = driven.along - self._cockpit.limits.tool_acceleration * context.period
        return min(speed, max(approach.touch_speed, 0.0 if touches else braking))

    def setpoint(self, state: OperatorDriveState, held: Held, context: Context) -> Setpoint:
        """References of hull and tool at their driven poses."""
        del state, context
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
