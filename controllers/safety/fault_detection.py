"""Fault detection by residuals: each sensor and thruster against a redundant source.

The plant is not used. A fault is a disagreement of two sources that should agree:

- Frozen reading: bitwise equal for much longer than ever while sound, since sensors have noise.
- Torque sensor against its motor: the gear passes the motor's torque less rotor inertia and gear friction.
- Age of the newest picture, where the estimator reports it. Only this fault is cleared, when pictures come again.
- Encoder: its angle against the integral of its speed.
- Hull momentum, the residual of [DeLuca 2003] for the hull as one body. It is what the hull gains beyond the commanded
  thrust, the arm's wrench, weight and drag.

A missing wrench along the column of one thruster, in proportion to that thruster's demand, is attributed to that
thruster. Any other is a gust or a snag, and counts only by its effect on station keeping. A thruster with a column that
is almost a pure force (one sway thruster amidships) needs a longer confirmation. Its loss and a current that has just
risen look alike until the controller has learnt the current.

Each residual is compared with its own average (`learning_time`), so that constant biases and model errors are no fault.
Thresholds are in `FaultLimits`; the tests measure the distance of sound runs from them.
"""

from dataclasses import dataclass, field

import mujoco
import numba
import numpy as np

from controllers.hull.station_keeping import hull_inertia
from controllers.tuning import FaultLimits
from models import hydrodynamics
from models.vehicle import Vehicle
from models.water.thruster_curves import thrust_at
from models.water.thrusters import SLEW_RATE, TIME_CONSTANT, curves
from sim.interfaces.kernels import keyed_by_imports
from sim.interfaces.messages import Command, Fault, FaultKind, HullLoad, StateEstimate
from sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class FaultDetectionState:
    """State of fault detection; arrays change in place."""

    time: float  # [s] of the last estimate
    began: float  # [s] of the first estimate
    q: Array  # (n,) [rad] last readings
    qd: Array  # (n,) [rad/s]
    tau: Array  # (n,) [N m]
    same: np.ndarray  # (2, n) consecutive equal samples of torque sensor and encoder
    longest: np.ndarray  # (2, n) the longest such run while sound
    qd_slow: Array  # (n,) [rad/s] filtered
    gear: Array  # (n,) [N m] sensor less motor, filtered, without rotor inertia
    excess: Array  # (n,) [N m] sensor less motor, filtered
    usual: Array  # (n,) [N m] its average
    beyond: Array  # (n,) [s] for which it has exceeded its bound
    slip: Array  # (n,) [rad] angle less integral of speed
    tau_motor: Array  # (n,) [N m] last command
    hull_time: float  # [s] of the last momentum balance of the hull
    speed: Array  # (m,) [-] predicted propeller speeds, normalised
    passed: Array  # (m,) [-] command after the slew limit
    thrusters: Array  # (m,) [-] last command
    nu_slow: Array  # (6,) [m/s, rad/s] filtered, hull axes
    rest: Array  # (6,) [N, N m] drag and gyroscopic terms less thrust and arm wrench, filtered
    missing: Array  # (6,) [N, N m] unexplained wrench on the hull
    missing_usual: Array  # (6,) [N, N m] its average
    thrust: Array  # (m,) [N] predicted
    thrust_usual: Array  # (m,) [N] its average while the missing wrench was usual
    lost_for: Array  # (m,) [s] for which this thruster has explained the missing wrench
    load_seen: HullLoad | None = None  # of the last momentum balance, to recognise a new one
    faults: list[Fault] = field(default_factory=list)  # found so far

    def has(self, kind: FaultKind, index: int = -1) -> bool:
        """True if a fault of this kind, on the part with this index, has been found."""
        return any(fault.kind is kind and fault.index == index for fault in self.faults)


class FaultDetection:
    """Fault detection for one vehicle; explicit state, one step per controller period."""

    def __init__(self, model: mujoco.MjModel, *, period: float, limits: FaultLimits | None = None) -> None:
        """Take the believed model of the vehicle.

        Args:
            model: compiled model that the controller uses.
            period: [s] of the steps.
            limits: thresholds; None takes the defaults.
        """
        self._vehicle = vehicle = Vehicle.of(model)
        self._period, self.limits = period, limits or FaultLimits()
        self._armature, self._damping = np.array(vehicle.armature), np.array(vehicle.joint_damping)
        limits = self.limits
        self._floor = limits.torque_floor * vehicle.torque_limits + limits.friction * vehicle.dry_friction.stiction
        table = vehicle.thruster_table
        self._curves, self._B = curves(table), np.array(vehicle.thruster_wrench)
        self._lags = np.array(table[:, [TIME_CONSTANT, SLEW_RATE]])
        water = hydrodynamics.unpack(model.body_user[vehicle.hull])
        self._inertia = hull_inertia(model, vehicle.hull, 1.0)
        self._added, self._linear = np.array(water.added_mass), np.array(water.linear_damping)
        self._quadratic = np.array(water.quadratic_damping)
        self._scale = np.array([1.0, 1.0, 1.0, *(1.0 / limits.lever,) * 3])
        force, moment = (np.linalg.norm(part, axis=0) for part in np.vsplit(self._scale[:, None] * self._B, 2))
        telling = moment > limits.thruster_moment * force
        self._confirm = np.where(telling, limits.thruster_confirm, limits.current_confirm)

    def init(self, estimate: StateEstimate) -> FaultDetectionState:
        """Initial state at the first `estimate`: no faults."""
        n, m = self._vehicle.joints.size, len(self._vehicle.thruster_names)
        joint, thruster, six = (lambda: np.zeros(n)), (lambda: np.zeros(m)), (lambda: np.zeros(6))
        return FaultDetectionState(
            time=estimate.time,
            began=estimate.time,
            q=np.array(estimate.q),
            qd=np.array(estimate.qd),
            tau=np.array(estimate.tau),
            same=np.zeros((2, n), dtype=np.int64),
            longest=np.zeros((2, n), dtype=np.int64),
            qd_slow=np.array(estimate.qd),
            gear=joint(),
            excess=joint(),
            usual=joint(),
            beyond=joint(),
            slip=joint(),
            tau_motor=joint(),
            hull_time=estimate.time,
            speed=thruster(),
            passed=thruster(),
            thrusters=thruster(),
            nu_slow=six(),
            rest=six(),
            missing=six(),
            missing_usual=six(),
            thrust=thruster(),
            thrust_usual=thruster(),
            lost_for=thruster(),
        )

    def step(self, state: FaultDetectionState, estimate: StateEstimate, command: Command) -> tuple[Fault, ...]:
        """Update the residuals with one sample and return all faults found so far.

        The hull is examined whenever the controller reports a new `Command.hull_load`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: the vehicle's state now, all numbers finite.
            command: the command that followed from it; it acts until the next step.

        Returns:
            The faults, in the order in which they were found.
        """
        limits, time = self.limits, estimate.time
        warm = time - state.began > limits.warm_up
        found = _joints(
            estimate.q,
            estimate.qd,
            estimate.tau,
            state.tau_motor,
            self._armature,
            self._damping,
            self._period,
            (limits.torque_time, limits.encoder_time, limits.learning_time, limits.torque_share),
            self._floor,
            time - state.began,
            warm,
            state.q,
            state.qd,
            state.tau,
            state.same,
            state.longest,
            state.qd_slow,
            state.gear,
            state.excess,
            state.usual,
            state.beyond,
            state.slip,
        )
        if warm and found:
            self._judge_joints(state, time)
        if not estimate.vision_age > limits.vision_age:  # also where the age is unknown (nan)
            state.faults = [fault for fault in state.faults if fault.kind is not FaultKind.VISION]
        else:
            self._add(state, FaultKind.VISION, "", -1, time)
        state.time = time
        state.tau_motor[:] = command.joint_torque
        load = command.hull_load
        if load is not None and load is not state.load_seen:
            state.load_seen = load
            self._look_at_hull(state, estimate, command, load, warm)
        return tuple(state.faults)

    def _judge_joints(self, state: FaultDetectionState, time: float) -> None:
        limits = self.limits
        least = np.round(np.array([[limits.frozen_time], [limits.frozen_encoder_time]]) / self._period)
        frozen = state.same > np.maximum(least, limits.frozen_factor * state.longest)
        torque = frozen[0] | (state.beyond > limits.torque_confirm)
        encoder = frozen[1] | (np.abs(state.slip) > limits.encoder_slip)
        torque_off, encoder_off = state.excess - state.usual, state.slip
        for j in np.flatnonzero(torque | encoder).tolist():
            name, still = self._vehicle.joint_names[j], 1e3 * self._period * state.same[:, j]
            if torque[j]:
                said = (
                    f"stood still for {still[0]:.0f} ms" if frozen[0, j] else f"{torque_off[j]:+.3g} N m off its motor"
                )
                self._add(state, FaultKind.TORQUE_SENSOR, name, j, time, said)
            if encoder[j]:
                said = (
                    f"stood still for {still[1]:.0f} ms"
                    if frozen[1, j]
                    else f"{1e3 * encoder_off[j]:+.3g} mrad off the integral of its speed"
                )
                self._add(state, FaultKind.ENCODER, name, j, time, said)

    def blame_torque_sensors(self, state: FaultDetectionState, wrong: np.ndarray, time: float) -> None:
        """Register torque sensors with readings that are not finite as faulty.

        Args:
            state: of the detection; changed in place.
            wrong: (n,) bool, True for each such sensor.
            time: [s] of the readings.
        """
        for j in np.flatnonzero(wrong).tolist():
            self._add(state, FaultKind.TORQUE_SENSOR, self._vehicle.joint_names[j], j, time, "no number")

    @staticmethod
    def _add(
        state: FaultDetectionState, kind: FaultKind, part: str, index: int, time: float, figures: str = ""
    ) -> None:
        if not state.has(kind, index):
            state.faults.append(Fault(kind=kind, part=part, index=index, time=time, figures=figures))

    def _look_at_hull(
        self, state: FaultDetectionState, estimate: StateEstimate, command: Command, load: HullLoad, warm: bool
    ) -> None:
        limits, dt = self.limits, estimate.time - state.hull_time
        state.hull_time = estimate.time
        if dt <= 0.0:
            return
        _hull(
            estimate.X_WB[:3, :3],
            estimate.v_WB_B,
            estimate.w_WB_B,
            load.current_W,
            load.arm_wrench_B,
            self._inertia,
            self._added,
            self._linear,
            self._quadratic,
            self._curves,
            self._lags,
            self._B,
            state.thrusters,
            dt,
            limits.hull_time,
            state.speed,
            state.passed,
            state.nu_slow,
            state.rest,
            state.missing,
        )
        state.thrusters[:] = command.thrusters
        self._judge_hull(state, estimate.time, dt, float(np.linalg.norm(estimate.v_WB_B)), warm)

    def _judge_hull(self, state: FaultDetectionState, time: float, dt: float, speed: float, warm: bool) -> None:
        limits = self.limits
        size, asked, changed, best, share = _explain(
            state.missing,
            state.missing_usual,
            self._scale,
            self._B,
            self._curves,
            state.speed,
            state.thrust,
            state.thrust_usual,
            limits.thruster_leftover,
        )
        bound = limits.hull_force + limits.hull_share * asked + limits.hull_change * changed + limits.hull_speed * speed
        low, high = limits.thruster_loss
        suspect = best >= 0 and low < share < high
        # A residual that no thruster loss explains, however large, is model drift and enters the average.
        if not warm or size < 0.7 * bound or not suspect:
            learn = min(1.0, dt / min(limits.hull_learning_time, max(time - state.began, dt)))
            state.missing_usual += learn * (state.missing - state.missing_usual)
            state.thrust_usual += learn * (state.thrust - state.thrust_usual)
        lost_for = float(state.lost_for[best]) + dt if warm and suspect and size > bound else 0.0
        state.lost_for[:] = 0.0
        if lost_for > 0.0:
            state.lost_for[best] = lost_for
            if lost_for > self._confirm[best]:
                asked_of_it = abs(float(state.thrust[best]))
                figures = f"gave {(1.0 - share) * asked_of_it:.0f} N where {asked_of_it:.0f} N were asked for"
                self._add(state, FaultKind.THRUSTER, self._vehicle.thruster_names[best], best, time, figures)


@numba.njit(cache=True)
@keyed_by_imports
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
        total += 0.0 * (v_B[i] + w_B[i] + a_B[i] + X_WB[i, 0] + X_WB[i, 1] + X_WB[i, 2] + X_WB[i, 3])
    for j in range(q.shape[0]):
        total += 0.0 * (q[j] + qd[j])
    return total == 0.0


@numba.njit(cache=True)
@keyed_by_imports
def _joints(
    q,
    qd,
    tau,
    tau_motor,
    armature,
    damping,
    dt,
    numbers,
    floor,
    age,
    warm,
    q_last,
    qd_last,
    tau_last,
    same,
    longest,
    qd_slow,
    gear,
    excess,
    usual,
    beyond,
    slip,
):
    """Update the residuals of torque sensors and encoders by one sample; True if any needs evaluation."""
    torque_time, encoder_time, learning_time, share = numbers
    lag, leak, learn = min(1.0, dt / torque_time), dt / encoder_time, dt / min(learning_time, max(age, dt))
    look = False
    for j in range(q.shape[0]):
        for k in range(2):
            equal = tau[j] == tau_last[j] if k == 0 else (q[j] == q_last[j] and qd[j] == qd_last[j])
            if equal:
                same[k, j] += 1
                look |= same[k, j] > longest[k, j]
            else:
                longest[k, j] = max(longest[k, j], same[k, j])
                same[k, j] = 0
        slip[j] += q[j] - q_last[j] - 0.5 * dt * (qd[j] + qd_last[j]) - leak * slip[j]
        if not warm:
            slip[j] = 0.0
        look |= abs(slip[j]) > 1e-3
        gear[j] += lag * (tau[j] - tau_motor[j] + damping[j] * qd[j] - gear[j])
        excess[j] = gear[j] + armature[j] * (qd[j] - qd_slow[j]) / torque_time
        qd_slow[j] += lag * (qd[j] - qd_slow[j])
        off = abs(excess[j] - usual[j]) / (floor[j] + share * abs(tau[j]))
        if off < 0.5 or not warm:
            usual[j] += learn * (excess[j] - usual[j])
        beyond[j] = beyond[j] + dt if off > 1.0 else 0.0
        look |= off > 1.0
        q_last[j], qd_last[j], tau_last[j] = q[j], qd[j], tau[j]
    return look


@numba.njit(cache=True)
@keyed_by_imports
def _hull(
    R_WB,
    v_B,
    w_B,
    current_W,
    arm_wrench_B,
    inertia,
    added,
    linear,
    quadratic,
    curve,
    lags,
    B,
    command,
    dt,
    time,
    speed,
    passed,
    nu_slow,
    rest,
    missing,
):
    """Unexplained wrench on the hull, `missing` (6,) [N, N m], after thrusts commanded for `dt` [s].

    Weight and righting moment of the hull change slowly and are left to the average.
    """
    nu, relative, force = np.empty(6), np.empty(6), np.empty(6)
    for i in range(3):
        nu[i], nu[3 + i] = v_B[i], w_B[i]
        relative[i], relative[3 + i] = v_B[i], w_B[i]
        for j in range(3):
            relative[i] -= R_WB[j, i] * current_W[j]
    p = inertia @ nu + added @ (relative - nu)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[i] = w_B[j] * p[k] - w_B[k] * p[j]
        force[3 + i] = w_B[j] * p[3 + k] - w_B[k] * p[3 + j] + relative[j] * p[k] - relative[k] * p[j]
    for i in range(6):
        force[i] += quadratic[i] * abs(relative[i]) * relative[i] - arm_wrench_B[i]
        for j in range(6):
            force[i] += linear[i, j] * relative[j]
    for t in range(speed.shape[0]):
        wanted = min(max(command[t], -1.0), 1.0)
        if lags[t, 1] > 0.0:
            wanted = min(max(wanted, passed[t] - lags[t, 1] * dt), passed[t] + lags[t, 1] * dt)
        passed[t] = wanted
        decay = np.exp(-dt / lags[t, 0]) if lags[t, 0] > 0.0 else 0.0
        speed[t] = wanted + (speed[t] - wanted) * decay
        thrust = thrust_at(curve[t], speed[t])
        for i in range(6):
            force[i] -= B[i, t] * thrust
    lag = min(1.0, dt / time)
    rate = (nu - nu_slow) / time
    for i in range(6):
        nu_slow[i] += lag * (nu[i] - nu_slow[i])
        rest[i] += lag * (force[i] - rest[i])
    gained = inertia @ rate
    for i in range(6):
        missing[i] = gained[i] + rest[i]


@numba.njit(cache=True)
@keyed_by_imports
def _explain(missing, usual, scale, B, curve, speed, thrust, thrust_usual, leftover):
    """Attribute the unusual part of the missing wrench to the thruster that explains it best.

    Writes the predicted thrusts [N] to `thrust` (m,). Returns the size [N] of the unusual part, moments scaled, the sum
    of all thrusts [N], and how much of it differs from the usual [N]. Then the thruster, -1 if each leaves more than
    the share `leftover`, and the missing share of its thrust.
    """
    best, share = -1, 0.0
    square, asked, changed = 0.0, 0.0, 0.0
    for k in range(6):
        square += (scale[k] * (missing[k] - usual[k])) ** 2
    size = np.sqrt(square)
    least = leftover * size
    for t in range(speed.shape[0]):
        thrust[t] = thrust_at(curve[t], speed[t])
        asked += abs(thrust[t])
        changed += abs(thrust[t] - thrust_usual[t])
        along, own = 0.0, 0.0
        for k in range(6):
            column = scale[k] * B[k, t]
            along += column * scale[k] * (missing[k] - usual[k])
            own += column * column
        lost, left = -along / own, 0.0
        for k in range(6):
            left += (scale[k] * (missing[k] - usual[k]) + lost * scale[k] * B[k, t]) ** 2
        left = np.sqrt(left)
        if left < least and lost * thrust[t] > 0.0:
            best, share, least = t, lost / thrust[t], left
    return size, asked, changed, best, share
