"""Momentum balance of the hull: the missing wrench, and the thruster whose loss explains it."""

from typing import NamedTuple

import numpy as np

from uuv.models.water.thruster_curves import thrust_in_flow
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_SLACK = 1.2  # [-] factor by which a stuck thruster may seem to exceed its largest thrust
# Entries of `HullResiduals.numbers`: times [s] of the first estimate and of the last balance; index
# of the suspect; unexplained part of its thrust [N]
BEGAN, BALANCED, MISSED, NUMBERS = range(4)
NOBODY = -1  # value for no suspect


class HullResiduals(NamedTuple):
    """Momentum balance of the hull, and the predicted propellers, as arrays that are changed in
    place.
    """

    numbers: Array  # (NUMBERS,)
    speed: Array  # (m,) [-] predicted propeller speeds, normalised
    passed: Array  # (m,) [-] command after the slew limit
    thrusters: Array  # (m,) [-] last command
    nu_slow: Array  # (6,) [m/s, rad/s] filtered velocity, hull axes
    rest: Array  # (6,) [N, N m] drag and gyroscopic terms minus thrust and arm wrench, filtered
    missing: Array  # (6,) [N, N m] unexplained wrench on the hull
    missing_usual: Array  # (6,) [N, N m] average of the unexplained wrench
    # (3,) [m/s] average of the estimated current; the present estimate also contains part of a
    # fault's effect
    current_W: Array
    inflow: Array  # (m,) [m/s] speed of advance through that current along the thrust
    thrust: Array  # (m,) [N] predicted thrust, in the inflow
    thrust_usual: Array  # (m,) [N] average of the thrust while the missing wrench was usual
    lost_for: Array  # (m,) [s] for which this thruster has explained the missing wrench

    @classmethod
    def start(cls, thrusters: int, time: float) -> "HullResiduals":
        """Initial residuals for `thrusters` thrusters at `time` [s]."""
        numbers = np.zeros(NUMBERS)
        numbers[[BEGAN, BALANCED]] = time
        m = (np.zeros(thrusters) for _ in range(7))
        return cls(
            numbers=numbers,
            speed=next(m),
            passed=next(m),
            thrusters=next(m),
            nu_slow=np.zeros(6),
            rest=np.zeros(6),
            missing=np.zeros(6),
            missing_usual=np.zeros(6),
            current_W=np.zeros(3),
            inflow=next(m),
            thrust=next(m),
            thrust_usual=next(m),
            lost_for=next(m),
        )


class HullLimits(NamedTuple):
    """Bounds and time constants of the balance: fields of `FaultLimits`."""

    warm_up: float  # [s]
    time: float  # [s] of the filter
    learning_time: float  # [s]
    # [-] share of the missing wrench that the loss of a thruster may leave unexplained
    leftover: float
    force: float  # [N] bound: constant part,
    share: float  # [-] share of all thrusts,
    change: float  # [-] share of their change
    speed: float  # [N s/m] and part proportional to the hull's speed
    least_loss: float  # [-] least missing share of the thrust of a lost thruster
    most_loss: float  # [-] largest missing share


class HullBalanceModel(NamedTuple):
    """Model of hull and thrusters."""

    inertia: Array  # (6, 6) with added mass
    added: Array  # (6, 6)
    linear: Array  # (6, 6)
    quadratic: Array  # (6,)
    curves: Array  # of the thrusters
    lags: Array  # (m, 2) time constant [s], slew rate [1/s]
    loss: Array  # (m,) [N s/m] of thrust by inflow
    advance: Array  # (6, m) levers of the inflow
    B: Array  # (6, m) wrench of unit thrusts
    ends: Array  # (m, 2) [N] full thrust astern and ahead
    scale: Array  # (6,) that converts moments to forces
    confirm: Array  # (m,) [s] for which a thruster has to explain the missing wrench
    limits: HullLimits


class HullBalance(NamedTuple):
    """One balance of the hull's momentum."""

    dt: float  # [s] since the last balance; not positive: no balance was computed
    suspect: int  # thruster whose loss has explained the missing wrench for long enough, or NOBODY


class HullSeen(NamedTuple):
    """Estimated motion of the hull, and the loads on it that the controller reported."""

    time: float  # [s]
    X_WB: Array  # (4, 4)
    v_B: Array  # (3,) [m/s]
    w_B: Array  # (3,) [rad/s]
    current_W: Array  # (3,) [m/s]
    arm_wrench_B: Array  # (6,) [N, N m]


@kernel
def balance_hull(model, seen, residuals):
    """Compute the balance of the hull's momentum since the last one.

    Args:
        model: `HullBalanceModel`.
        seen: `HullSeen`.
        residuals: `HullResiduals`; updated.

    Returns:
        The fields of `HullBalance`.
    """
    r = residuals
    limits = model.limits
    dt = seen.time - r.numbers[BALANCED]
    r.numbers[BALANCED] = seen.time
    if dt <= 0.0:
        return dt, NOBODY

    # Weight of this sample in the averages: a plain mean at first, then of the learning time.
    age = seen.time - r.numbers[BEGAN]
    learn = min(1.0, dt / min(limits.learning_time, max(age, dt)))
    for i in range(3):
        r.current_W[i] += learn * (seen.current_W[i] - r.current_W[i])

    find_missing(model, seen, dt, r)
    return dt, _suspect(model, seen.v_B, dt, learn, age > limits.warm_up, r)


@kernel
def _suspect(model, v_B, dt, learn, warm, r):
    """Update the averages, or suspect a thruster; returns the thruster if it was suspected for long
    enough.
    """
    limits = model.limits
    size, asked, changed, best, missed = _explain(model, r, limits.leftover)
    r.numbers[MISSED] = missed
    bound = limits.force + limits.share * asked + limits.change * changed
    bound += limits.speed * np.sqrt(np.dot(v_B, v_B))

    # The thruster is lost, or stuck at another thrust than the commanded one.
    suspect = False
    if best >= 0:
        size_asked = abs(r.thrust[best])
        short = missed * np.sign(r.thrust[best])
        lost = limits.least_loss * size_asked < short < limits.most_loss * size_asked
        suspect = lost or size > bound

    # A residual that no thruster loss explains, however large, is treated as model drift and enters
    # the average.
    if not warm or size < 0.7 * bound or not suspect:
        for k in range(6):
            r.missing_usual[k] += learn * (r.missing[k] - r.missing_usual[k])
        for t in range(r.thrust.shape[0]):
            r.thrust_usual[t] += learn * (r.thrust[t] - r.thrust_usual[t])

    # Time for which the same thruster has explained it.
    lost_for = 0.0
    if warm and suspect and size > bound:
        lost_for = r.lost_for[best] + dt
    r.lost_for[:] = 0.0
    if lost_for <= 0.0:
        return NOBODY
    r.lost_for[best] = lost_for
    return NOBODY if lost_for < model.confirm[best] else best


@kernel
def find_missing(model, seen, dt, r):
    """Unexplained wrench on the hull, `r.missing` (6,) [N, N m], since the last balance.

    Weight and righting moment of the hull change slowly and are part of the average.

    Args:
        model: `HullBalanceModel`.
        seen: `HullSeen`.
        dt: [s] since the last balance.
        r: `HullResiduals`; updated.
    """
    R_WB = seen.X_WB  # (4, 4), of which the rotation is used
    v_B = seen.v_B
    w_B = seen.w_B
    current_W = seen.current_W
    inertia = model.inertia
    lags = model.lags
    B = model.B
    time = model.limits.time

    # Motion of the hull, through the water, and through the mean current for the inflow.
    nu = np.empty(6)
    relative = np.empty(6)
    advancing = np.empty(6)
    force = np.empty(6)
    for i in range(3):
        nu[i] = v_B[i]
        nu[3 + i] = w_B[i]
        relative[i] = v_B[i]
        relative[3 + i] = w_B[i]
        advancing[i] = v_B[i]
        advancing[3 + i] = w_B[i]
        for j in range(3):
            relative[i] -= R_WB[j, i] * current_W[j]
            advancing[i] -= R_WB[j, i] * r.current_W[j]

    # Momentum, and its change due to the rotation of the axes.
    p = inertia @ nu + model.added @ (relative - nu)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[i] = w_B[j] * p[k] - w_B[k] * p[j]
        force[3 + i] = (
            w_B[j] * p[3 + k] - w_B[k] * p[3 + j] + relative[j] * p[k] - relative[k] * p[j]
        )

    # Drag, minus the wrench of the arm.
    for i in range(6):
        force[i] += model.quadratic[i] * abs(relative[i]) * relative[i] - seen.arm_wrench_B[i]
        for j in range(6):
            force[i] += model.linear[i, j] * relative[j]

    # Thrusters.
    for t in range(r.speed.shape[0]):
        wanted = min(max(r.thrusters[t], -1.0), 1.0)
        if lags[t, 1] > 0.0:
            wanted = min(max(wanted, r.passed[t] - lags[t, 1] * dt), r.passed[t] + lags[t, 1] * dt)
        r.passed[t] = wanted
        decay = np.exp(-dt / lags[t, 0]) if lags[t, 0] > 0.0 else 0.0
        r.speed[t] = wanted + (r.speed[t] - wanted) * decay

        inflow = 0.0
        for i in range(6):
            inflow += model.advance[i, t] * advancing[i]
        r.inflow[t] = inflow
        r.thrust[t] = thrust_in_flow(model.curves[t], model.loss[t], inflow, r.speed[t])

        for i in range(6):
            force[i] -= B[i, t] * r.thrust[t]

    # Change of momentum beyond that.
    lag = min(1.0, dt / time)
    rate = (nu - r.nu_slow) / time
    for i in range(6):
        r.nu_slow[i] += lag * (nu[i] - r.nu_slow[i])
        r.rest[i] += lag * (force[i] - r.rest[i])
    gained = inertia @ rate
    for i in range(6):
        r.missing[i] = gained[i] + r.rest[i]


@kernel
def _explain(model, residuals, leftover):
    """Find the thruster that best explains the unusual part of the missing wrench.

    The results are the magnitude [N] of the unusual part, with scaled moments; the sum of all
    thrusts [N], and its change from the usual value [N]; the thruster, or -1 if each leaves more
    than the share `leftover` or would have to exceed its largest thrust; and the missing part of
    the thruster's thrust [N].
    """
    scale = model.scale
    B = model.B
    missing = residuals.missing
    usual = residuals.missing_usual
    thrust = residuals.thrust
    best = -1
    missed = 0.0
    square = 0.0
    asked = 0.0
    changed = 0.0

    # Size of the unusual part.
    for k in range(6):
        square += (scale[k] * (missing[k] - usual[k])) ** 2
    size = np.sqrt(square)
    least = leftover * size

    # The thruster whose loss leaves the least unexplained.
    for t in range(thrust.shape[0]):
        asked += abs(thrust[t])
        changed += abs(thrust[t] - residuals.thrust_usual[t])

        along = 0.0
        own = 0.0
        for k in range(6):
            column = scale[k] * B[k, t]
            along += column * scale[k] * (missing[k] - usual[k])
            own += column * column

        lost = -along / own
        left = 0.0
        for k in range(6):
            left += (scale[k] * (missing[k] - usual[k]) + lost * scale[k] * B[k, t]) ** 2
        left = np.sqrt(left)

        gives = thrust[t] - lost
        if left < least and _SLACK * model.ends[t, 0] <= gives <= _SLACK * model.ends[t, 1]:
            best = t
            missed = lost
            least = left

    return size, asked, changed, best, missed
