"""Contact force from the torques of the joints: two estimators with one protocol, each with its tare and its sigma.

`TorqueSensors` reads sensors on the gear outputs. `MomentumObserver` does without them; it takes motor torques, joint
speeds and the believed friction of the gears. `WorkController(model, estimator=...)` takes either.
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import mujoco
import numpy as np

from controllers.arm.believed_friction import dry_friction, dry_friction_sigma
from controllers.arm.inverse_dynamics import ArmDynamics, ArmParameters, JointMotion
from controllers.arm.joint_servo import FrictionTracking, track_gear_friction
from controllers.estimation.load_observer import SMOOTHING, LoadObserver, LoadObserverState
from controllers.estimation.payload_identification import PayloadIdentification, PayloadIdentificationState
from controllers.estimation.tip_force_estimator import (
    SensedArm,
    SenseTiming,
    Tare,
    add_to_tare,
    estimate_tip_force,
    force_from_external_torques,
    force_sigma,
)
from controllers.tuning import DRIVE_PERIOD, ArmTuning
from models.arms.gear_friction import DryFriction
from models.vehicle import Vehicle
from sim.interfaces.messages import ContactEstimate, Reference, StateEstimate
from sim.interfaces.spatial import Array, skew


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveState:
    """What the drives were last asked for, and the current that the station keeping estimates."""

    tau: Array  # (n,) [N m] motor torques
    qd_wanted: Array  # (n,) [rad/s]
    current_W: Array  # (3,) [m/s]


@dataclass(slots=True, eq=False)
class ContactState:
    """State of an estimator; arrays change in place."""

    arm: ArmParameters  # own copy of the believed arm, with its payload as soon as that is identified
    sensed: SensedArm
    tare: Tare
    bias: Array  # (n,) [N m] of the external torques
    floor: Array  # (n,) [N m] standard deviation of the external torques, beside the noise of the sensors
    friction: Array  # (n,) [N m] dry friction in the gears that the drives have to overcome
    estimate: ContactEstimate
    own: Any = None  # of the kind of estimator: payload identification, or load observer
    excess: Array | None = None  # (nb,) [-] identified excess masses of the arm's parts
    tick: int = 0

    def wrench_B(self) -> Array:
        """Contact wrench (6,) [N, N m] on the hull through the arm, at the hull's origin in hull axes."""
        contact_B = np.zeros(6)
        contact_B[:3] = self.sensed.f_B
        contact_B[3:] = skew(self.sensed.X_BG[:3, 3]) @ self.sensed.f_B
        return contact_B


class ContactEstimator(Protocol):
    """Estimator of the contact force, and of the gear friction that the drives have to overcome."""

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact."""
        ...

    def step(self, state: ContactState, estimate: StateEstimate, reference: Reference, drives: DriveState) -> None:
        """One sample: leaves force, friction, and motion of arm and hull in `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: says when to tare.
            drives: what they were last asked for.
        """
        ...


class _TorqueResidual:
    """Common part of both estimators: the arm's motion, and its torques less those of the model without contact."""

    def __init__(self, model: mujoco.MjModel, arm: ArmDynamics, tuning: ArmTuning, period: float) -> None:
        self._arm, self._tuning, self._vehicle = arm, tuning, Vehicle.of(model)
        self.timing = SenseTiming(period, tuning.acceleration_filter, tuning.force_filter)
        self._slow_ticks = max(1, round(tuning.hover_period / period))

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, no tare, no friction."""
        n, own = self._arm.n, self._arm.parameters
        return ContactState(
            arm=own._replace(numbers=own.numbers.copy()),
            sensed=SensedArm.start(estimate.qd, estimate.w_WB_B),
            tare=Tare.start(n),
            bias=np.zeros(n),
            floor=np.full(n, self._tuning.torques.floor),
            friction=np.zeros(n),
            estimate=ContactEstimate(),
        )

    def _sense(self, state: ContactState, estimate: StateEstimate, current_W: Array, f_tip_W: Array) -> float:
        """Force from the torque sensors into `f_tip_W`, motion and residual into `state.sensed`; the normal force."""
        e, floor = estimate, state.floor
        if e.tau_doubt is not None:
            floor = np.hypot(floor, e.tau_doubt)
        readings = (e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, current_W, e.q, e.qd, e.tau)
        errors = (state.bias, floor, self._tuning.torques.share)
        return estimate_tip_force(tuple(state.arm), readings, errors, self.timing, tuple(state.sensed), f_tip_W)

    def _tare(self, state: ContactState, reference: Reference) -> None:
        if reference.tare:
            add_to_tare(tuple(state.tare), state.sensed.tau_e, state.bias)


class TorqueSensors(_TorqueResidual):
    """Contact force from torque sensors on the gear outputs; the payload is identified while the arm unfolds."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        arm: ArmDynamics | None = None,
        tuning: ArmTuning | None = None,
        period: float = DRIVE_PERIOD,
        water_error: float = 0.0,
        friction: DryFriction | None = None,
    ) -> None:
        """Set up from the believed model of the vehicle.

        Args:
            model: believed model, compiled.
            arm: believed dynamics of the arm; None reads them from `model`.
            tuning: filters and noise.
            period: [s] of a step.
            water_error: [-] share by which added masses and drags are wrong; only where `arm` is None.
            friction: identified friction of the gears; None: the model's.
        """
        tuning = tuning or ArmTuning()
        super().__init__(model, arm or ArmDynamics(model, water_error=water_error), tuning, period)
        self._period = period
        self._payload = PayloadIdentification(self._arm)
        self._force_share = min(1.0, period / tuning.force_filter)
        self.gears = FrictionTracking(
            armature=np.array(self._vehicle.armature),
            damping=np.array(self._vehicle.joint_damping),
            most=tuning.gears.excess * (friction or self._vehicle.dry_friction).stiction,
            share=min(1.0, period / tuning.gears.filter),
        )
        self._gear_fields = tuple(self.gears)

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, no tare, no friction, no payload."""
        state = super().init(estimate)
        state.own = self._payload.init()
        return state

    def step(self, state: ContactState, estimate: StateEstimate, reference: Reference, drives: DriveState) -> None:
        """One sample: leaves force, friction, and motion of arm and hull in `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: says when to tare, and when the arm begins its work.
            drives: what they were last asked for.
        """
        self.sense(state, estimate, drives)
        self._tare(state, reference)
        self.follow_up(state, estimate, reference)

    def follow_up(self, state: ContactState, estimate: StateEstimate, reference: Reference) -> None:
        """Rest of a step after `sense` and tare: payload and sigma, where they are due.

        Args:
            state: as `sense` left it; changed in place.
            estimate: of the vehicle now.
            reference: says when the arm begins its work.
        """
        slow = state.tick % self._slow_ticks == 0
        if slow and state.own is not None:
            self._identify_payload(state, state.own, estimate, reference)
        if slow:
            noise = self._tuning.torques.share * np.abs(estimate.tau)
            kept = self._force_share / (2.0 - self._force_share)  # of white noise behind the filter of the force
            variance = kept * noise**2 + self._tuning.torques.drift**2
            sigma_G = force_sigma(state.sensed.X_BG, state.sensed.J_B, state.floor + noise, variance)
            state.estimate = replace(state.estimate, sigma_G=sigma_G)
        state.tick += 1

    def sense(self, state: ContactState, estimate: StateEstimate, drives: DriveState) -> None:
        """Force, friction and motion of one sample, without tare and payload; the sigma stays as it is.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            drives: what they were last asked for.
        """
        f_tip_W = np.empty(3)
        normal = self._sense(state, estimate, drives.current_W, f_tip_W)
        track_gear_friction(drives.tau, estimate.tau, estimate.qd, state.sensed.qdd, self._gear_fields, state.friction)
        state.estimate = ContactEstimate(force_W=f_tip_W, normal=normal, sigma_G=state.estimate.sigma_G)

    def _identify_payload(
        self, state: ContactState, own: PayloadIdentificationState, estimate: StateEstimate, reference: Reference
    ) -> None:
        """Identify the payload while the arm unfolds; adopt it at the first tool pose, still free of contact."""
        sensed = state.sensed
        if reference.X_WG is not None:
            state.excess = self._payload.excess(own)
            state.arm.numbers[:], state.own = self._payload.weighed(state.excess).numbers, None
        elif state.tick * self._period > self._tuning.weighing_after:
            self._payload.add(own, JointMotion(estimate.q, estimate.qd, sensed.qdd), sensed.hull, sensed.tau_e)


class MomentumObserver(_TorqueResidual):
    """Contact force from motor torques by the momentum of arm and hull, without torque sensors [DeLuca 2003]."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        arm: ArmDynamics | None = None,
        tuning: ArmTuning | None = None,
        period: float = DRIVE_PERIOD,
        water_error: float = 0.0,
        friction: DryFriction | None = None,
    ) -> None:
        """Set up from the believed model of the vehicle.

        Args:
            model: believed model, compiled.
            arm: believed dynamics of the arm; None reads them from `model`.
            tuning: filters and noise.
            period: [s] of a step.
            water_error: [-] share by which added masses and drags are wrong.
            friction: identified friction of the gears; None: the model's.
        """
        tuning = tuning or ArmTuning()
        super().__init__(model, arm or ArmDynamics(model, water_error=water_error), tuning, period)
        self._dry = friction or self._vehicle.dry_friction
        self._observer = LoadObserver(
            model, period=period, time_constant=tuning.observer_lag, water_error=water_error, friction=friction
        )

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, no tare, no friction."""
        state = super().init(estimate)
        state.own = self._observer.init()
        return state

    def step(self, state: ContactState, estimate: StateEstimate, reference: Reference, drives: DriveState) -> None:
        """One sample: leaves force, friction, and motion of arm and hull in `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now; its torques are not used.
            reference: says when to tare.
            drives: what they were last asked for.
        """
        tuning, dry, sensed, f_tip_W = self._tuning, self._dry, state.sensed, np.empty(3)
        load: LoadObserverState = state.own
        self._sense(state, estimate, drives.current_W, f_tip_W)  # for the motion; the force is overwritten
        sensed.tau_e[:] = self._observer.step(
            load,
            estimate.q,
            estimate.qd,
            drives.tau,
            R_WB=estimate.X_WB[:3, :3],
            nu_B=sensed.hull[9:15],
            v_current_W=drives.current_W,
        )
        errors = (state.bias, state.floor, 0.0)
        normal = force_from_external_torques(estimate.X_WB, drives.tau, errors, tuple(sensed), f_tip_W)
        reversal, wanted = tuning.gears.reversal, drives.qd_wanted
        dry_friction(dry.coulomb, dry.stiction, dry.stribeck_speed, reversal, wanted, state.friction)
        self._tare(state, reference)
        sigma_G = state.estimate.sigma_G
        if state.tick % self._slow_ticks == 0:
            known = tuning.gears.known
            dry_friction_sigma(dry.coulomb, dry.stiction, SMOOTHING, known, sensed.qd_slow, state.floor)
            state.floor = np.hypot(tuning.torques.observer_floor, state.floor)
            sigma_G = force_sigma(sensed.X_BG, sensed.J_B, state.floor, state.floor**2)
        state.tick += 1
        state.estimate = ContactEstimate(force_W=f_tip_W, normal=normal, sigma_G=sigma_G)
