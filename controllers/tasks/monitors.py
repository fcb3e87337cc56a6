"""Monitors of a task: conditions on estimate, faults and contact, each with the reaction to it.

| condition | reaction |
|---|---|
| vision old | the path waits at half the force until vision is back; after `blind_time` retreat |
| one torque sensor wrong | the motor's torque in its place (`safety_wrapper`); two: retreat |
| gyro or accelerometer off | attitude reference, or a bias estimated anew (navigation), instead |
| attitude reference off, or it cannot be told from the gyro | retreat along the tool axis |
| an encoder wrong | the arm holds its joint angles, the hull withdraws the tool along its axis |
| a thruster lost or stuck | ascent off the object on the others; the arm draws the tool off |
| hull off its place, or force above its limit on the way back | the same, with all thrusters |
| the object moves across the tool, as the camera on the arm sees it | retreat along the tool axis |
| force above its limit, long above the set one, or not felt; contact lost | retreat |
| estimate or command not finite | arm braked; hull off, then up (`safety_wrapper`); abort |

What a reaction means in a phase is in the table of the task: up to CLOSE_IN there is no contact to
retreat from, and the work ends where the vehicle is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from uuv.controllers.tasks.phase import Abort, Context, Held
from uuv.sim.interfaces.kernels.foresight import EstimateBounds
from uuv.sim.interfaces.messages import AbortCode, FaultKind, WorkState


class Reaction(StrEnum):
    """Response to a condition, the mildest first."""

    GO_ON = "go on"
    PAUSE = "pause"  # the path waits at a reduced force
    RETREAT = "retreat"  # the arm withdraws the tool along its axis
    RISE = "rise"  # the hull ascends off the object at once, the arm gives way
    WITHDRAW = "withdraw"  # the hull withdraws the tool, the arm holds its joint angles
    STOP = "stop"  # no control is possible


_SEVERITY = tuple(Reaction)
BEFORE_CONTACT = frozenset({WorkState.SETTLE, WorkState.SCAN, WorkState.CLOSE_IN, WorkState.TARE})
IN_CONTACT = frozenset({WorkState.APPROACH, WorkState.PRESS, WorkState.WORK})
LEAVING = frozenset({WorkState.RETREAT})

Condition = Callable[[Held, Context], str]  # the sentence if it holds, else empty
BoundsOfPeriod = Callable[[Held], EstimateBounds]


@dataclass(frozen=True, slots=True)
class Bounded:
    """Condition that is false within bounds of the estimate, unless a fault is reported.

    Compiled ticks, for which the bounds are, stop at a new fault; with a known one the safety
    wrapper's tick (`GuardTick.ready`) sends each tick to Python.
    """

    condition: Condition
    bounds: BoundsOfPeriod | EstimateBounds  # those of a period, or of all

    def __call__(self, held: Held, context: Context) -> str:
        """The sentence of the condition."""
        return self.condition(held, context)


@dataclass(frozen=True, slots=True, kw_only=True)
class Monitor:
    """One condition and the reaction to it."""

    condition: Condition
    reaction: Reaction
    code: AbortCode
    lasting: float = 0.0  # [s] for longer than which the condition must hold
    during: frozenset[WorkState] = frozenset(WorkState)  # states of the work in which it is watched


def watch(
    monitors: Sequence[Monitor], since: list[float], work: WorkState, held: Held, context: Context
) -> tuple[Reaction, Abort | None]:
    """The most severe reaction that any monitor requests, and the first of equally severe ones.

    Args:
        monitors: the monitors.
        since: [s] for each the time at which its condition was last false; changed in place.
        work: state of the work.
        held: what the phases share.
        context: estimate, target and contact of this period.

    Returns:
        The reaction, and its cause; None to go on.
    """
    hardest: tuple[Reaction, Abort | None] = (Reaction.GO_ON, None)

    for i, monitor in enumerate(monitors):
        sentence = monitor.condition(held, context) if work in monitor.during else ""
        if not sentence:
            since[i] = context.estimate.time
        elif monitor.lasting and not context.estimate.time - since[i] > monitor.lasting:
            continue
        elif _SEVERITY.index(monitor.reaction) > _SEVERITY.index(hardest[0]):
            hardest = monitor.reaction, Abort(monitor.code, sentence)

    return hardest


def fault_monitors(
    blind_time: float, during: frozenset[WorkState] = frozenset(WorkState)
) -> tuple[Monitor, ...]:
    """Monitors of the reported faults; `blind_time` [s] without vision ends the work."""
    rows = (
        # no control is possible
        (no_time, Reaction.STOP, AbortCode.ESTIMATE),
        (
            faulty(FaultKind.ESTIMATE, "the state estimate is lost"),
            Reaction.STOP,
            AbortCode.ESTIMATE,
        ),
        (
            faulty(FaultKind.CONTROLLER, "the controller's commands are not finite"),
            Reaction.STOP,
            AbortCode.CONTROLLER,
        ),
        # parts of the vehicle and its sensors
        (faulty(FaultKind.ENCODER, "encoder of {} is wrong"), Reaction.WITHDRAW, AbortCode.ENCODER),
        (faulty(FaultKind.THRUSTER, "thruster {} is lost"), Reaction.RISE, AbortCode.THRUSTER),
        (
            faulty(FaultKind.TORQUE_SENSOR, "torque sensors of {} are wrong", count=2),
            Reaction.RETREAT,
            AbortCode.TORQUE_SENSORS,
        ),
        (
            faulty(FaultKind.ATTITUDE, "the attitude reference is wrong"),
            Reaction.RETREAT,
            AbortCode.ATTITUDE,
        ),
        (
            # vision
            faulty(FaultKind.VISION, "vision is lost", age=blind_time),
            Reaction.RETREAT,
            AbortCode.VISION,
        ),
        (faulty(FaultKind.VISION, "vision is lost"), Reaction.PAUSE, AbortCode.VISION),
    )

    return tuple(
        Monitor(condition=what, reaction=how, code=code, during=during) for what, how, code in rows
    )


def _no_time(held: Held, context: Context) -> str:
    """The time of the estimate is not finite."""
    del held
    return "" if math.isfinite(context.estimate.time) else "the state estimate is lost"


no_time = Bounded(_no_time, EstimateBounds())


def faulty(kind: FaultKind, sentence: str, *, count: int = 1, age: float = -math.inf) -> Condition:
    """Condition: faults of a kind are reported.

    Args:
        kind: their kind.
        sentence: with {} for the names of the parts.
        count: least number of them.
        age: [s] since the detection of one of them that must be exceeded.

    Returns:
        The condition.
    """

    def condition(held: Held, context: Context) -> str:
        del held
        faults = () if context.last is None else context.last.faults
        if not faults:
            return ""

        alike = [fault for fault in faults if fault.kind is kind]
        if len(alike) < count or not any(
            context.estimate.time - fault.time > age for fault in alike
        ):
            return ""

        report = sentence.format(", ".join(fault.part for fault in alike))
        figures = "; ".join(fault.figures for fault in alike if fault.figures)
        return f"{report} ({figures})" if figures else report

    return Bounded(condition, EstimateBounds())


def adrift(limit: float) -> Condition:
    """Condition: the hull is farther than `limit` [m] from its reference."""

    def condition(held: Held, context: Context) -> str:
        off = held.off(context.estimate)
        return (
            f"the hull cannot hold its position: error {off:.3f} m, above the limit of {limit:g} m"
            if off > limit
            else ""
        )

    return Bounded(condition, EstimateBounds(off=limit))


def object_moves(limit: float) -> Condition:
    """Condition: the arm's camera sees the object move across the tool axis by > `limit` [m].

    Along the axis the force says so.
    """

    def condition(held: Held, context: Context) -> str:
        moved = context.estimate.object_moved_W
        if held.line is None or not moved.any():
            return ""

        axis = held.tool()[0][:3, 2]
        across = float(np.linalg.norm(moved - (moved @ axis) * axis))
        message = (
            "the object moves, or the model of the arm is wrong: the arm camera sees a shift of "
            f"{1e3 * across:.0f} mm"
        )
        return message if across > limit else ""

    return Bounded(condition, EstimateBounds(moved=0.0))


def too_much_force(limit: float, felt: Callable[[Held, Context], float]) -> Condition:
    """Condition: the estimated force `felt` [N], or a part of it, is above `limit` [N]."""

    def condition(held: Held, context: Context) -> str:
        force = felt(held, context)
        return (
            f"estimated force {force:.0f} N is above the limit of {limit:.0f} N"
            if force > limit
            else ""
        )

    along = felt is normal_force
    bounds = EstimateBounds(normal=limit) if along else EstimateBounds(force=limit)
    return Bounded(condition, bounds)


def uncertain_force(limit: float) -> Condition:
    """Condition: the stated standard deviation of the normal force is above `limit` [N]."""

    def condition(held: Held, context: Context) -> str:
        del held
        if not limit < context.normal_sigma < math.inf:
            return ""
        return (
            "the normal force is not observable in this posture: standard deviation "
            f"{context.normal_sigma:.0f} N"
        )

    return Bounded(condition, EstimateBounds(sigma=limit))


def normal_force(held: Held, context: Context) -> float:
    """Estimated normal force [N]."""
    del held
    return context.normal


def contact_force(held: Held, context: Context) -> float:
    """Magnitude [N] of the known part of the estimated contact force; 0 if no part is known."""
    if context.last is None or not context.last.contact.known or held.line is None:
        return 0.0
    normal, across = context.contact_force(held.tool()[0][:3, 2])
    return math.hypot(normal, across) if math.isfinite(across) else abs(normal)
