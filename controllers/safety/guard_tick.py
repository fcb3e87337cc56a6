"""Tick of the safety wrapper, which calls a controller by its address between checks of its input
and output.

`SafetyWrapper.step` and the compiled ticks of the loop both call it. All residuals are computed
here, those of the joints at each tick, those of the hull at each of its steps. The verdicts are a
slot in Python, which is called if a residual is beyond its bound, or during a fault or a probe.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.safety.blind_departure import HeldHull, follow
from uuv.controllers.safety.hull_residuals import (
    NOBODY,
    HullBalanceModel,
    HullResiduals,
    HullSeen,
    balance_hull,
)
from uuv.controllers.safety.joint_residuals import (
    JointResidualModel,
    JointResiduals,
    update_residuals,
)
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import BROKEN, STOPPED, UNSOUND, Commanded, call_control
from uuv.sim.interfaces.kernels.record_box import new_box
from uuv.sim.interfaces.kernels.slots import FINE, Slot, call
from uuv.sim.interfaces.records import ReferenceRecord
from uuv.sim.interfaces.spatial import Array

# Entries of `GuardRecord.numbers`
BEGAN = 0  # [s] time of the first valid estimate
FRESH = 1  # not 0: the time of the estimate has advanced
SUSPECT = 2  # not 0: a residual of the joints' sensors needs evaluation
FAULTY = 3  # not 0: a fault has been found
JUDGED = 4  # number of steps of the hull that were evaluated
FOLLOWED = 5  # number of steps of the hull included in the means for a departure
BALANCE_DT = 6  # [s] interval of the `HullBalance` of this tick; nan: there was none in it
ACCUSED = 7  # suspect of that balance
PROBING = 8  # not 0: a thruster is being probed
NUMBERS = 9  # number of entries


class GuardLimits(NamedTuple):
    """Thresholds of a valid tick."""

    old_imu: float  # [s] age of the inertial unit's sample, from which on there is no estimate
    vision_age: float  # [s] age of the newest picture, from which on vision is lost
    warm_up: float  # [s] after which residuals are evaluated
    balance_time: float  # [s] time constant of the means of the loads that hold the hull


class GuardRecord(NamedTuple):
    """State of the wrapper, as arrays that are changed in place."""

    limits: GuardLimits
    model: JointResidualModel
    hull_model: HullBalanceModel
    inner: int  # address of the wrapped controller's tick
    memory: int  # address of the wrapped controller's data
    estimate: int  # address of the box of the estimate
    command: Commanded  # command of the wrapped controller
    reference: ReferenceRecord  # reference that it follows
    thrusters: Array  # (m,) commands sent, with the doublet of a probe
    residuals: JointResiduals
    hull: HullResiduals
    checks: tuple[Array, ...]  # entries of the estimate, of `sensor_checks.checked_entries`
    quiet: Array  # value of each check's entries while its sensor is healthy
    asked: Array  # (m,) thruster commands of the controller at the last balance
    held: HeldHull
    judge: Slot
    numbers: Array  # (NUMBERS,)


@kernel
def guard_box(record):
    """`RecordBox` of a `GuardRecord`."""
    return new_box(record)


@kernel(nogil=True)
def guard_tick(box, estimate):
    """One tick of the wrapped controller.

    Args:
        box: box of a `GuardRecord`; updated.
        estimate: box of the present `EstimateRecord` of the vehicle.

    Returns:
        FINE or STOPPED; UNSOUND, BROKEN, or the return value of the wrapped controller.
    """
    guard = box.record
    limits = guard.limits
    command = guard.command
    numbers = guard.numbers
    e = estimate.record
    sound = finite(e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, e.q, e.qd, e.time[0])
    if not sound or e.ages[2] > limits.old_imu:
        return UNSOUND

    # The controller.
    answer = call_control(guard.inner, guard.memory, guard.estimate)
    if answer not in (FINE, STOPPED):
        return answer
    if not (np.isfinite(command.tau).all() and np.isfinite(command.thrusters).all()):
        return BROKEN

    # Means for a blind departure.
    if command.hull_steps[0] != numbers[FOLLOWED]:
        numbers[FOLLOWED] = command.hull_steps[0]
        curves = guard.hull_model.curves
        follow(curves, limits.balance_time, command, guard.reference, e.time[0], guard.held)

    if numbers[FRESH] == 0.0:
        return answer

    # Residuals of the joints' sensors.
    age = e.time[0] - numbers[BEGAN]
    warm = age > limits.warm_up
    look = update_residuals(guard.model, (e.q, e.qd, e.tau), age, warm, guard.residuals)
    for j in range(command.tau.shape[0]):
        guard.residuals.tau_motor[j] = command.tau[j]
    numbers[SUSPECT] = warm and look

    # Residuals of the hull, and verdicts if needed.
    stepped = command.hull_steps[0] != numbers[JUDGED]
    numbers[JUDGED] = command.hull_steps[0]
    numbers[BALANCE_DT] = np.nan
    numbers[ACCUSED] = NOBODY
    hull_doubtful = stepped and _balance(guard, e)
    doubtful = numbers[SUSPECT] != 0.0 or numbers[FAULTY] != 0.0 or e.ages[0] > limits.vision_age
    if doubtful or hull_doubtful:
        judged = call(guard.judge)
        if judged != FINE:
            return judged
    elif stepped:
        for i in range(command.thrusters.shape[0]):
            guard.thrusters[i] = command.thrusters[i]
            if numbers[BALANCE_DT] > 0.0:
                guard.asked[i] = guard.hull.thrusters[i] = command.thrusters[i]
    return answer


@kernel
def _balance(guard, e):
    """Balance of the hull, after its step; True if it needs a verdict."""
    numbers = guard.numbers
    command = guard.command
    if np.isnan(command.arm_wrench_B[0]):
        return numbers[PROBING] != 0.0

    load_W = command.current_W
    load_B = command.arm_wrench_B
    seen = HullSeen(e.time[0], e.X_WB, e.v_WB_B, e.w_WB_B, load_W, load_B)
    numbers[BALANCE_DT], suspect = balance_hull(guard.hull_model, seen, guard.hull)
    numbers[ACCUSED] = suspect

    # Faults of sensors reported by navigation.
    off = False
    for k in range(len(guard.checks)):
        for value in guard.checks[k]:
            off = off or value != guard.quiet[k]
    return off or suspect != NOBODY or numbers[PROBING] != 0.0


@kernel
def finite(X_WB, v_B, w_B, a_B, q, qd, time):
    """True if all required numbers of an estimate are finite; compiled, since it runs every step.

    Args:
        X_WB: (4, 4) hull pose.
        v_B: (3,) velocity.
        w_B: (3,) angular velocity.
        a_B: (3,) acceleration.
        q: (n,) joint angles.
        qd: (n,) joint speeds.
        time: [s] of the estimate.
    """
    total = 0.0 * time
    for i in range(3):
        row = X_WB[i, 0] + X_WB[i, 1] + X_WB[i, 2] + X_WB[i, 3]
        total += 0.0 * (v_B[i] + w_B[i] + a_B[i] + row)
    for j in range(q.shape[0]):
        total += 0.0 * (q[j] + qd[j])
    return total == 0.0
