"""Fault detection by residuals, which compare each sensor and thruster with a redundant source.

The plant is not used. A fault is a disagreement of two sources that should agree:

- Frozen reading: bitwise equal for much longer than ever while healthy, since sensors have noise.
- Torque sensor against its motor: the torque at the gear output is the motor's torque minus rotor
  inertia and gear friction.
- Age of the newest picture, where the estimator reports it. Only this fault is cleared, when
  pictures arrive again.
- Encoder: its angle against the integral of its speed.
- Gyro, attitude reference, accelerometer: the estimator detects that one of them is faulty
  (`uuv.controllers.safety.sensor_checks`). The work continues unless it is the attitude reference.
- Hull momentum, the residual of [DeLuca 2003] for the hull as one body. The residual is the change
  of momentum that the commanded thrust, the arm's wrench, weight and drag do not explain.

A missing wrench that persists along the column of one thruster is attributed to that thruster, if
the thruster could give the remaining thrust: the thruster is lost, or stuck. Any other missing
wrench is a gust or a snag, and only matters by its effect on station keeping. If the column is
almost a pure force (one sway thruster amidships), a wave, or a current that has just risen, looks
like the loss of the thruster. Such a thruster is probed by a small doublet
(`uuv.controllers.safety.thruster_probe`).

Each residual is compared with its own average (`learning_time`), so that constant biases and model
errors do not count as faults. Thresholds are in `FaultLimits`; the tests measure the margin of
fault-free runs.
"""

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from uuv.controllers.hull.station_keeping import hull_inertia
from uuv.controllers.safety.hull_residuals import (
    BEGAN,
    MISSED,
    NOBODY,
    HullBalance,
    HullBalanceModel,
    HullLimits,
    HullResiduals,
)
from uuv.controllers.safety.joint_residuals import JointResidualModel, JointResiduals
from uuv.controllers.safety.sensor_checks import sensor_faults
from uuv.controllers.safety.thruster_probe import ProbeState, ThrusterProbe, is_lost
from uuv.controllers.tuning import FaultLimits
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves, inflow_levers
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.messages import Fault, FaultKind, StateEstimate
from uuv.sim.interfaces.spatial import Array

_FOLLOWED = 1.0  # [s] after the detection of a stuck thruster, during which its thrust is followed
# [-] share of the commanded thrust, below which a failed thruster counts as giving none
_DEAD = 0.2


@dataclass(slots=True, eq=False)
class FaultDetectionState:
    """State of fault detection, as arrays that are changed in place."""

    joints: JointResiduals
    hull: HullResiduals
    asked: Array  # (m,) last thruster commands of the controller
    probe: ProbeState | None = None  # probe of a thruster under suspicion
    # [s] for each thruster, when a probe last found it healthy
    cleared: list[float] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)  # faults found so far

    @property
    def began(self) -> float:
        """Time [s] of the first estimate."""
        return float(self.hull.numbers[BEGAN])

    def has(self, kind: FaultKind, index: int = -1) -> bool:
        """True if a fault of this kind, on the part with this index, has been found."""
        return any(fault.kind is kind and fault.index == index for fault in self.faults)

    def add(self, fault: Fault) -> None:
        """Register a fault, unless its component has been found faulty already."""
        if not self.has(fault.kind, fault.index):
            self.faults.append(fault)


class FaultDetection:
    """Verdicts on the residuals of one vehicle, which `guard_tick` computes; the state is
    explicit.
    """

    def __init__(
        self, model: mujoco.MjModel, *, period: float, limits: FaultLimits | None = None
    ) -> None:
        """Set up from the controller's model of the vehicle.

        Args:
            model: compiled model that the controller uses.
            period: [s] of the steps.
            limits: thresholds; None: the defaults.
        """
        self._vehicle = vehicle = Vehicle.of(model)
        self._period = period
        self.limits = limits = limits or FaultLimits.of_mass(float(model.body_subtreemass[0]))

        # Joints: bounds of torque sensors and encoders.
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

        # Hull: modelled hydrodynamics and thrusters.
        table = vehicle.thruster_table
        water = hydrodynamics.without_forms(
            model.body_user[vehicle.hull], "fault detection's model of the hull"
        )
        B = np.array(vehicle.thruster_wrench)

        # A column with enough moment cannot be mistaken for a wave; thrusters without are probed.
        scale = np.array([1.0, 1.0, 1.0, *(1.0 / limits.lever,) * 3])
        force, moment = (np.linalg.norm(part, axis=0) for part in np.vsplit(scale[:, None] * B, 2))
        self._telling = telling = moment > limits.thruster_moment * force

        # Momentum balance of that hull.
        model_of_hull = HullBalanceModel(
            inertia=hull_inertia(model, vehicle.hull, 1.0),
            added=np.array(water.added_mass),
            linear=np.array(water.linear_damping),
            quadratic=np.array(water.quadratic_damping),
            curves=curves(table),
            lags=np.array(table[:, [TIME_CONSTANT, SLEW_RATE]]),
            loss=np.array(table[:, INFLOW_LOSS]),
            advance=inflow_levers(table, vehicle.thruster_wrench),
            B=B,
            ends=np.array(
                [[thrust_at(curve, end) for end in (-1.0, 1.0)] for curve in curves(table)]
            ).reshape(-1, 2),
            scale=scale,
            confirm=np.where(telling, limits.thruster_confirm, limits.current_confirm),
            limits=_hull_limits(limits),
        )
        self.hull: HullBalanceModel = as_annotated(model_of_hull)
        self._probe = ThrusterProbe(self.hull.curves, self.hull.lags, self.hull.loss, limits)

    def init(self, estimate: StateEstimate) -> FaultDetectionState:
        """Initial state at the first `estimate`: no faults."""
        m = len(self._vehicle.thruster_names)
        return FaultDetectionState(
            joints=JointResiduals.start(estimate.q, estimate.qd, estimate.tau),
            hull=HullResiduals.start(m, estimate.time),
            asked=np.zeros(m),
            cleared=[-np.inf] * m,
        )

    def judge(
        self,
        state: FaultDetectionState,
        estimate: StateEstimate,
        thrusters: Array,
        *,
        suspect: bool,
        balance: HullBalance | None,
    ) -> tuple[Fault, ...]:
        """All faults after a sample.

        Args:
            state: of the detection, with the present residuals; changed in place.
            estimate: present estimate of the vehicle.
            thrusters: (m,) commands of the controller.
            suspect: True: the residuals of the joints need evaluation.
            balance: balance of the hull's momentum, if there was one.
        """
        if suspect:
            self.judge_joints(state, estimate.time)

        # Loss of vision is the only fault that is cleared.
        if not estimate.vision_age > self.limits.vision_age:  # also if the age is unknown (nan)
            state.faults = [fault for fault in state.faults if fault.kind is not FaultKind.VISION]
        else:
            state.add(Fault(kind=FaultKind.VISION, part="", index=-1, time=estimate.time))

        if balance is not None:
            self._judge_hull(state, estimate, thrusters, balance)
        return tuple(state.faults)

    def _judge_hull(
        self,
        state: FaultDetectionState,
        estimate: StateEstimate,
        thrusters: Array,
        balance: HullBalance,
    ) -> None:
        """Register faults from navigation and from a balance of the hull's momentum."""
        state.faults.extend(
            fault for fault in sensor_faults(estimate) if not state.has(fault.kind, fault.index)
        )

        if balance.dt <= 0.0:
            return

        # A probe that begins now uses the next balance first.
        probe = state.probe
        if balance.suspect != NOBODY:
            self._accuse(state, balance.suspect, estimate.time)
        if probe is not None:
            self._go_on_probing(state, probe, estimate.time, balance.dt)

        self._refine(state, estimate.time)

        state.asked[:] = thrusters
        state.hull.thrusters[:] = self.sent(state, thrusters)

    def sent(self, state: FaultDetectionState, thrusters: Array) -> Array:
        """Commands (m,) to the thrusters, which are `thrusters` (m,) plus the doublet of a
        probe.
        """
        return thrusters if state.probe is None else self._probe.sent(state.probe, thrusters)

    def _refine(self, state: FaultDetectionState, time: float) -> None:
        """Follow the thrust of a stuck thruster for some time, since lags hide half of it at
        first.
        """
        hull = state.hull
        for k, fault in enumerate(state.faults):
            if (
                fault.kind is FaultKind.THRUSTER
                and fault.thrust != 0.0
                and time - fault.time < _FOLLOWED
            ):
                gives = float(hull.thrust[fault.index]) + self._along(hull, fault.index)
                ends = self.hull.ends[fault.index]
                state.faults[k] = replace(fault, thrust=float(np.clip(gives, *ends)))

    def _along(self, hull: HullResiduals, thruster: int) -> float:
        """Unusual part of the missing wrench along the column of a thruster [N]."""
        column = self.hull.scale * self.hull.B[:, thruster]
        scale = self.hull.scale
        return float(column @ (scale * (hull.missing - hull.missing_usual)) / (column @ column))

    def _go_on_probing(
        self, state: FaultDetectionState, probe: ProbeState, time: float, dt: float
    ) -> None:
        """Add the balance to the probe; register a thruster that does not respond as lost."""
        i = probe.thruster
        hull = state.hull

        missing = self._along(hull, i)
        thrust = float(hull.thrust[i])
        share = self._probe.step(
            probe, time, dt, float(state.asked[i]), float(hull.inflow[i]), thrust, missing
        )

        # Verdict, once there is one; then suspicion restarts.
        if share is None:
            return
        state.probe = None
        hull.lost_for[:] = 0.0

        if is_lost(share):
            figures = f"{share:.0%} of a test thrust was missing"
            self._fail(state, i, time, figures, thrust, -missing)
        elif np.isfinite(share):
            state.cleared[i] = time

    def judge_joints(self, state: FaultDetectionState, time: float) -> None:
        """Register the joints' sensors with residuals beyond their bounds as faulty.

        Args:
            state: of the detection, with the present residuals; changed in place.
            time: [s] of the readings.
        """
        limits = self.limits
        joints = state.joints

        # Frozen: equal for longer than the least time, and longer than ever while healthy.
        least = np.round(
            np.array([[limits.frozen_time], [limits.frozen_encoder_time]]) / self._period
        )
        frozen = joints.same > np.maximum(least, limits.frozen_factor * joints.longest)
        torque = frozen[0] | (joints.beyond > limits.torque_confirm)

        # Torque sensor differs from its motor, encoder differs from the integral of its speed.
        encoder = frozen[1] | (np.abs(joints.slip) > limits.encoder_slip)
        torque_off = joints.excess - joints.usual
        encoder_off = joints.slip
        for j in np.flatnonzero(torque | encoder).tolist():
            name = self._vehicle.joint_names[j]
            still = 1e3 * self._period * joints.same[:, j]
            if torque[j]:
                said = (
                    f"frozen for {still[0]:.0f} ms"
                    if frozen[0, j]
                    else f"{torque_off[j]:+.3g} N m difference from its motor"
                )
                kind = FaultKind.TORQUE_SENSOR
                state.add(Fault(kind=kind, part=name, index=j, time=time, figures=said))
            if encoder[j]:
                said = (
                    f"frozen for {still[1]:.0f} ms"
                    if frozen[1, j]
                    else f"{1e3 * encoder_off[j]:+.3g} mrad from the integral of its speed, "
                    f"{1e3 * limits.encoder_slip:g} allowed"
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
            kind = FaultKind.TORQUE_SENSOR
            name = self._vehicle.joint_names[j]
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
        """Register a thruster to give `thrust` [N], of which `missed` [N] are missing."""
        gives = thrust - missed

        # A small remainder counts as none; the thruster is then lost, and not stuck.
        gives = (
            0.0
            if abs(gives) < _DEAD * abs(thrust)
            else float(np.clip(gives, *self.hull.ends[thruster]))
        )

        kind = FaultKind.THRUSTER
        name = self._vehicle.thruster_names[thruster]
        state.add(
            Fault(kind=kind, part=name, index=thruster, time=time, figures=figures, thrust=gives)
        )

    def _accuse(self, state: FaultDetectionState, thruster: int, time: float) -> None:
        """Register a thruster that explains the missing wrench as lost, or probe it first."""
        if state.has(FaultKind.THRUSTER, thruster):
            return
        hull = state.hull

        # If a wave may look the same, a probe decides.
        if not self._telling[thruster]:
            if state.probe is None and time - state.cleared[thruster] > self.limits.probe_again:
                state.probe = self._probe.begin(thruster, time, hull.passed, hull.speed)
            return

        thrust = float(hull.thrust[thruster])
        missed = float(hull.numbers[MISSED])
        figures = f"produced {thrust - missed:.0f} N where {thrust:.0f} N were commanded"
        self._fail(state, thruster, time, figures, thrust, missed)


def _hull_limits(limits: FaultLimits) -> HullLimits:
    least_loss, most_loss = limits.thruster_loss
    return HullLimits(
        warm_up=limits.warm_up,
        time=limits.hull_time,
        learning_time=limits.hull_learning_time,
        leftover=limits.thruster_leftover,
        force=limits.hull_force,
        share=limits.hull_share,
        change=limits.hull_change,
        speed=limits.hull_speed,
        least_loss=least_loss,
        most_loss=most_loss,
    )
