"""Fault detection by residuals: each sensor and thruster against a redundant source.

The plant is not used. A fault is a disagreement of two sources that should agree:

- Frozen reading: bitwise equal for much longer than ever while sound, since sensors have noise.
- Torque sensor against its motor: the gear passes the motor's torque less rotor inertia and gear
  friction.
- Age of the newest picture, where the estimator reports it. Only this fault is cleared, when
  pictures come again.
- Encoder: its angle against the integral of its speed.
- Gyro, attitude reference, accelerometer: the estimator finds that one is off
  (`uuv.controllers.safety.sensor_checks`). The work goes on but for the attitude.
- Hull momentum, the residual of [DeLuca 2003] for the hull as one body. It is what the hull gains
  beyond the commanded thrust, the arm's wrench, weight and drag.

A missing wrench that persists along the column of one thruster is attributed to that thruster, if
it could give the
thrust that is left: it is lost, or stuck. Any other is a gust or a snag, and counts only by its
effect on station keeping. Where the column is almost a pure force (one sway thruster amidships) a
wave, or a current that has just risen, looks like the thruster's loss. Such a thruster is probed by
a small doublet (`uuv.controllers.safety.thruster_probe`).

Each residual is compared with its own average (`learning_time`), so that constant biases and model
errors are no fault. Thresholds are in `FaultLimits`; the tests measure the distance of sound runs
from them.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import mujoco
import numpy as np

from uuv.controllers.hull.station_keeping import hull_inertia
from uuv.controllers.safety.joint_residuals import (
    JointResidualModel,
    JointResiduals,
    update_residuals,
)
from uuv.controllers.safety.sensor_checks import sensor_faults
from uuv.controllers.safety.thruster_probe import ProbeState, ThrusterProbe, is_lost
from uuv.controllers.tuning import FaultLimits
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at, thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves, inflow_levers
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import Command, Fault, FaultKind, HullLoad, StateEstimate
from uuv.sim.interfaces.spatial import Array

_SLACK = 1.2  # [-] by which a thruster that is stuck may seem to give more than it can
_FOLLOWED = 1.0  # [s] after a stuck thruster was found, for which what it gives is followed
# [-] share of the thrust asked for, below which a failed thruster counts as giving none
_DEAD = 0.2


class HullResiduals(NamedTuple):
    """Momentum balance of the hull, and the propellers as predicted; arrays, changed in place."""

    speed: Array  # (m,) [-] predicted propeller speeds, normalised
    passed: Array  # (m,) [-] command after the slew limit
    thrusters: Array  # (m,) [-] last command
    nu_slow: Array  # (6,) [m/s, rad/s] filtered, hull axes
    rest: Array  # (6,) [N, N m] drag and gyroscopic terms less thrust and arm wrench, filtered
    missing: Array  # (6,) [N, N m] unexplained wrench on the hull
    missing_usual: Array  # (6,) [N, N m] its average
    # (3,) [m/s] average of the estimated current; that of now also holds part of what a fault does
    current_W: Array
    inflow: Array  # (m,) [m/s] speed of advance through that current along the thrust
    thrust: Array  # (m,) [N] predicted, in the inflow
    thrust_usual: Array  # (m,) [N] its average while the missing wrench was usual
    lost_for: Array  # (m,) [s] for which this thruster has explained the missing wrench


class _HullModel(NamedTuple):
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


@dataclass(slots=True, eq=False)
class FaultDetectionState:
    """State of fault detection; arrays change in place."""

    began: float  # [s] of the first estimate
    joints: JointResiduals
    hull: HullResiduals
    hull_time: float  # [s] of the last momentum balance of the hull
    asked: Array  # (m,) last thruster commands of the controller
    load_seen: HullLoad | None = None  # of the last momentum balance, to recognise a new one
    probe: ProbeState | None = None  # of a thruster under suspicion
    # [s] for each thruster, when a probe last found it sound
    cleared: list[float] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)  # found so far

    def has(self, kind: FaultKind, index: int = -1) -> bool:
        """True if a fault of this kind, on the part with this index, has been found."""
        return any(fault.kind is kind and fault.index == index for fault in self.faults)

    def add(self, fault: Fault) -> None:
        """Register a fault, unless its part has been found faulty already."""
        if not self.has(fault.kind, fault.index):
            self.faults.append(fault)


class FaultDetection:
    """Fault detection for one vehicle; explicit state, one step per controller period."""

    def __init__(
        self, model: mujoco.MjModel, *, period: float, limits: FaultLimits | None = None
    ) -> None:
        """Take the believed model of the vehicle.

        Args:
            model: compiled model that the controller uses.
            period: [s] of the steps.
            limits: thresholds; None takes the defaults.
        """
        self._vehicle = vehicle = Vehicle.of(model)
        self._period = period
        self.limits = limits = limits or FaultLimits.of_mass(float(model.body_subtreemass[0]))
        self.joints = JointResidualModel(
            armature=np.array(vehicle.armature),
            damping=np.array(vehicle.joint_damping),
            floor=limits.torque_floor * vehicle.torque_limits
            + limits.friction * vehicle.dry_friction.stiction,
            share=limits.torque_share,
            period=period,
            torque_time=limits.torque_time,
            encoder_time=limits.encoder_time,
            learning_time=limits.learning_time,
        )
        table = vehicle.thruster_table
        water = hydrodynamics.without_forms(
            model.body_user[vehicle.hull], "fault detection's model of the hull"
        )
        self._hull = hull = _HullModel(
            inertia=hull_inertia(model, vehicle.hull, 1.0),
            added=np.array(water.added_mass),
            linear=np.array(water.linear_damping),
            quadratic=np.array(water.quadratic_damping),
            curves=curves(table),
            lags=np.array(table[:, [TIME_CONSTANT, SLEW_RATE]]),
            loss=np.array(table[:, INFLOW_LOSS]),
            advance=inflow_levers(table, vehicle.thruster_wrench),
            B=np.array(vehicle.thruster_wrench),
            ends=np.array(
                [[thrust_at(curve, end) for end in (-1.0, 1.0)] for curve in curves(table)]
            ),
            scale=np.array([1.0, 1.0, 1.0, *(1.0 / limits.lever,) * 3]),
        )
        force, moment = (
            np.linalg.norm(part, axis=0) for part in np.vsplit(hull.scale[:, None] * hull.B, 2)
        )
        telling = moment > limits.thruster_moment * force
        self._telling = telling
        self._confirm = np.where(telling, limits.thruster_confirm, limits.current_confirm)
        self._probe = ThrusterProbe(hull.curves, hull.lags, hull.loss, limits)

    def init(self, estimate: StateEstimate) -> FaultDetectionState:
        """Initial state at the first `estimate`: no faults."""
        m = len(self._vehicle.thruster_names)
        thruster, six = (lambda: np.zeros(m)), (lambda: np.zeros(6))
        return FaultDetectionState(
            began=estimate.time,
            hull_time=estimate.time,
            asked=thruster(),
            cleared=[-np.inf] * m,
            joints=JointResiduals.start(estimate.q, estimate.qd, estimate.tau),
            hull=HullResiduals(
                speed=thruster(),
                passed=thruster(),
                thrusters=thruster(),
                nu_slow=six(),
                rest=six(),
                missing=six(),
                missing_usual=six(),
                current_W=np.zeros(3),
                inflow=thruster(),
                thrust=thruster(),
                thrust_usual=thruster(),
                lost_for=thruster(),
            ),
        )

    def step(
        self, state: FaultDetectionState, estimate: StateEstimate, command: Command
    ) -> tuple[Fault, ...]:
        """Update the residuals with one sample and return all faults found so far.

        The hull is examined whenever the controller reports a new `Command.hull_load`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: the vehicle's state now, all numbers finite.
            command: the command that followed from it; it acts until the next step.

        Returns:
            The faults, in the order in which they were found.
        """
        age = estimate.time - state.began
        warm = age > self.limits.warm_up
        seen = (estimate.q, estimate.qd, estimate.tau)
        suspect = update_residuals(tuple(self.joints), seen, age, warm, tuple(state.joints))
        state.joints.tau_motor[:] = command.joint_torque
        return self.judge(state, estimate, command, suspect=warm and suspect)

    def judge(
        self,
        state: FaultDetectionState,
        estimate: StateEstimate,
        command: Command,
        *,
        suspect: bool,
    ) -> tuple[Fault, ...]:
        """All faults after a sample; `suspect`: the residuals of the joints need evaluation."""
        if suspect:
            self.judge_joints(state, estimate.time)
        if not estimate.vision_age > self.limits.vision_age:  # also where the age is unknown (nan)
            state.faults = [fault for fault in state.faults if fault.kind is not FaultKind.VISION]
        else:
            state.add(Fault(kind=FaultKind.VISION, part="", index=-1, time=estimate.time))
        self.judge_hull(state, estimate, command)
        return tuple(state.faults)

    def judge_hull(
        self, state: FaultDetectionState, estimate: StateEstimate, command: Command
    ) -> None:
        """Balance the hull's momentum, and register a thruster as lost that explains what is
        missing.

        Args:
            state: of the detection; changed in place.
            estimate: of the vehicle now.
            command: nothing is done unless its `hull_load` is new.
        """
        load = command.hull_load
        if load is None or load is state.load_seen:
            return
        state.load_seen = load
        state.faults.extend(
            found for found in sensor_faults(estimate) if not state.has(found.kind, found.index)
        )
        dt = estimate.time - state.hull_time
        state.hull_time = estimate.time
        if dt <= 0.0:
            return
        state.hull.current_W[:] += self._learning(state, estimate.time, dt) * (
            load.current_W - state.hull.current_W
        )
        seen = (
            estimate.X_WB[:3, :3],
            estimate.v_WB_B,
            estimate.w_WB_B,
            load.current_W,
            load.arm_wrench_B,
        )
        _hull(self._hull, seen, dt, self.limits.hull_time, state.hull)
        warm = estimate.time - state.began > self.limits.warm_up
        probe = state.probe
        self._learn_or_suspect(
            state, estimate.time, dt, float(np.linalg.norm(estimate.v_WB_B)), warm
        )
        if probe is not None:
            self._go_on_probing(state, probe, estimate.time, dt)
        self._refine(state, estimate.time)
        state.asked[:] = command.thrusters
        state.hull.thrusters[:] = self.sent(state, command.thrusters)

    def sent(self, state: FaultDetectionState, thrusters: Array) -> Array:
        """Commands (m,) to the thrusters, `thrusters` (m,) of the controller with the doublet of a
        probe.
        """
        return thrusters if state.probe is None else self._probe.sent(state.probe, thrusters)

    def _refine(self, state: FaultDetectionState, time: float) -> None:
        """Follow what a stuck thruster gives for some time: when it is found, lags still hide half
        of it.
        """
        hull = state.hull
        for k, fault in enumerate(state.faults):
            if (
                fault.kind is FaultKind.THRUSTER
                and fault.thrust != 0.0
                and time - fault.time < _FOLLOWED
            ):
                gives = float(hull.thrust[fault.index]) + self._along(hull, fault.index)
                ends = self._hull.ends[fault.index]
                state.faults[k] = replace(fault, thrust=float(np.clip(gives, *ends)))

    def _along(self, hull: HullResiduals, thruster: int) -> float:
        """Unusual part of the missing wrench along the column of a thruster [N]."""
        column, scale = self._hull.scale * self._hull.B[:, thruster], self._hull.scale
        return float(column @ (scale * (hull.missing - hull.missing_usual)) / (column @ column))

    def _go_on_probing(
        self, state: FaultDetectionState, probe: ProbeState, time: float, dt: float
    ) -> None:
        """Take the balance into the probe, and register its thruster as lost if it does not
        answer.
        """
        i = probe.thruster
        hull = state.hull
        missing = self._along(hull, i)
        thrust = float(hull.thrust[i])
        share = self._probe.step(
            probe, time, dt, float(state.asked[i]), float(hull.inflow[i]), thrust, missing
        )
        if share is None:
            return
        state.probe = None
        hull.lost_for[:] = 0.0
        if is_lost(share):
            figures = f"{share:.0%} of a test thrust were missing"
            self._fail(state, i, time, figures, thrust, -missing)
        elif np.isfinite(share):
            state.cleared[i] = time

    def judge_joints(self, state: FaultDetectionState, time: float) -> None:
        """Register the joints' sensors with residuals beyond their bounds as faulty.

        Args:
            state: of the detection, with the residuals of now; changed in place.
            time: [s] of the readings.
        """
        limits = self.limits
        joints = state.joints
        least = np.round(
            np.array([[limits.frozen_time], [limits.frozen_encoder_time]]) / self._period
        )
        frozen = joints.same > np.maximum(least, limits.frozen_factor * joints.longest)
        torque = frozen[0] | (joints.beyond > limits.torque_confirm)
        encoder = frozen[1] | (np.abs(joints.slip) > limits.encoder_slip)
        torque_off, encoder_off = joints.excess - joints.usual, joints.slip
        for j in np.flatnonzero(torque | encoder).tolist():
            name, still = self._vehicle.joint_names[j], 1e3 * self._period * joints.same[:, j]
            if torque[j]:
                said = (
                    f"stood still for {still[0]:.0f} ms"
                    if frozen[0, j]
                    else f"{torque_off[j]:+.3g} N m off its motor"
                )
                kind = FaultKind.TORQUE_SENSOR
                state.add(Fault(kind=kind, part=name, index=j, time=time, figures=said))
            if encoder[j]:
                said = (
                    f"stood still for {still[1]:.0f} ms"
                    if frozen[1, j]
                    else f"{1e3 * encoder_off[j]:+.3g} mrad off the integral of its speed, "
                    f"{1e3 * limits.encoder_slip:g} are allowed"
                )
                kind = FaultKind.ENCODER
                state.add(Fault(kind=kind, part=name, index=j, time=time, figures=said))

    def blame_torque_sensors(
        self, state: FaultDetectionState, wrong: np.ndarray, time: float
    ) -> None:
        """Register torque sensors with readings that are not finite as faulty.

        Args:
            state: of the detection; changed in place.
            wrong: (n,) bool, True for each such sensor.
            time: [s] of the readings.
        """
        for j in np.flatnonzero(wrong).tolist():
            kind, name = FaultKind.TORQUE_SENSOR, self._vehicle.joint_names[j]
            state.add(Fault(kind=kind, part=name, index=j, time=time, figures="reading not finite"))

    def _fail(
        self,
        state: FaultDetectionState,
        thruster: int,
        time: float,
        figures: str,
        thrust: float,
        missed: float,
    ) -> None:
        """Register a thruster that was to give `thrust` [N] and of which `missed` [N] are
        missing.
        """
        gives = thrust - missed
        gives = (
            0.0
            if abs(gives) < _DEAD * abs(thrust)
            else float(np.clip(gives, *self._hull.ends[thruster]))
        )
        kind, name = FaultKind.THRUSTER, self._vehicle.thruster_names[thruster]
        state.add(
            Fault(kind=kind, part=name, index=thruster, time=time, figures=figures, thrust=gives)
        )

    def _learning(self, state: FaultDetectionState, time: float, dt: float) -> float:
        """Weight of a sample of `dt` [s] in the averages: a plain mean at first, then of the
        learning time.
        """
        return min(1.0, dt / min(self.limits.hull_learning_time, max(time - state.began, dt)))

    def _learn_or_suspect(
        self, state: FaultDetectionState, time: float, dt: float, speed: float, warm: bool
    ) -> None:
        limits, hull = self.limits, state.hull
        size, asked, changed, best, missed = _explain(self._hull, hull, limits.thruster_leftover)
        bound = (
            limits.hull_force
            + limits.hull_share * asked
            + limits.hull_change * changed
            + limits.hull_speed * speed
        )
        low, high = limits.thruster_loss
        thrust = float(hull.thrust[best])
        # Lost, or stuck at another thrust than is asked for.
        suspect = best >= 0 and (
            low * abs(thrust) < missed * np.sign(thrust) < high * abs(thrust) or size > bound
        )
        # A residual that no thruster loss explains, however large, is model drift and enters the
        # average.
        if not warm or size < 0.7 * bound or not suspect:
            learn = self._learning(state, time, dt)
            hull.missing_usual[:] += learn * (hull.missing - hull.missing_usual)
            hull.thrust_usual[:] += learn * (hull.thrust - hull.thrust_usual)
        lost_for = float(hull.lost_for[best]) + dt if warm and suspect and size > bound else 0.0
        hull.lost_for[:] = 0.0
        if lost_for > 0.0:
            hull.lost_for[best] = lost_for
            if lost_for < self._confirm[best] or state.has(FaultKind.THRUSTER, best):
                return
            if not self._telling[best]:
                if state.probe is None and time - state.cleared[best] > limits.probe_again:
                    state.probe = self._probe.begin(best, time, hull.passed, hull.speed)
            else:
                figures = f"gave {thrust - missed:.0f} N where {thrust:.0f} N were asked for"
                self._fail(state, best, time, figures, thrust, missed)


@kernel
def _hull(model, seen, dt, time, residuals):
    """Unexplained wrench on the hull, `residuals.missing` (6,) [N, N m], after thrusts commanded
    for `dt` [s].

    Weight and righting moment of the hull change slowly and are left to the average.

    Args:
        model: `_HullModel`.
        seen: attitude R_WB, velocities v_B and w_B, current in W, and wrench of the arm on the
            hull.
        dt: [s] since the last balance.
        time: [s] of the filter.
        residuals: `HullResiduals`; updated.
    """
    R_WB, v_B, w_B, current_W, arm_wrench_B = seen
    inertia, lags, B, r = model.inertia, model.lags, model.B, residuals
    nu, relative, advancing, force = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for i in range(3):
        nu[i], nu[3 + i] = v_B[i], w_B[i]
        relative[i], relative[3 + i] = v_B[i], w_B[i]
        advancing[i], advancing[3 + i] = v_B[i], w_B[i]
        for j in range(3):
            relative[i] -= R_WB[j, i] * current_W[j]
            advancing[i] -= R_WB[j, i] * r.current_W[j]
    p = inertia @ nu + model.added @ (relative - nu)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[i] = w_B[j] * p[k] - w_B[k] * p[j]
        force[3 + i] = (
            w_B[j] * p[3 + k] - w_B[k] * p[3 + j] + relative[j] * p[k] - relative[k] * p[j]
        )
    for i in range(6):
        force[i] += model.quadratic[i] * abs(relative[i]) * relative[i] - arm_wrench_B[i]
        for j in range(6):
            force[i] += model.linear[i, j] * relative[j]
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
    """Attribute the unusual part of the missing wrench to the thruster that explains it best.

    Returns the size [N] of the unusual part, moments scaled; the sum of all thrusts [N], and how
    much of it differs from the usual [N]; then the thruster, -1 if each leaves more than the share
    `leftover` or would have to give more than it can, and the missing part of its thrust [N].
    """
    scale, B, missing, usual = model.scale, model.B, residuals.missing, residuals.missing_usual
    thrust = residuals.thrust
    best, missed = -1, 0.0
    square, asked, changed = 0.0, 0.0, 0.0
    for k in range(6):
        square += (scale[k] * (missing[k] - usual[k])) ** 2
    size = np.sqrt(square)
    least = leftover * size
    for t in range(thrust.shape[0]):
        asked += abs(thrust[t])
        changed += abs(thrust[t] - residuals.thrust_usual[t])
        along, own = 0.0, 0.0
        for k in range(6):
            column = scale[k] * B[k, t]
            along += column * scale[k] * (missing[k] - usual[k])
            own += column * column
        lost, left = -along / own, 0.0
        for k in range(6):
            left += (scale[k] * (missing[k] - usual[k]) + lost * scale[k] * B[k, t]) ** 2
        left = np.sqrt(left)
        gives = thrust[t] - lost
        if left < least and _SLACK * model.ends[t, 0] <= gives <= _SLACK * model.ends[t, 1]:
            best, missed, least = t, lost, left
    return size, asked, changed, best, missed
