"""Tip-force estimator that runs in the loop: contact force from the torques of the joints.

`TorqueSensors` reads sensors on the gear outputs, with tare, payload and sigma. Another
`ContactEstimator` replaces it by `WorkController(model, estimator=...)`, such as
`uuv.controllers.estimation.load_observer.MomentumObserver`.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics, ArmParameters, JointMotion
from uuv.controllers.arm.joint_servo import FrictionTracking
from uuv.controllers.estimation.load_identification import LoadIdentification
from uuv.controllers.estimation.payload_identification import PayloadIdentification
from uuv.controllers.estimation.tip_force_kernels import (
    ArmReadings,
    ContactRecord,
    FeelGains,
    SensedArm,
    SenseTiming,
    Tare,
    add_to_tare,
    contact_wrench,
    estimate_tip_force,
    feel_by_torques,
    find_sigma,
)
from uuv.controllers.tuning import DRIVE_PERIOD, ArmTuning
from uuv.models.arms.gear_friction import DryFriction
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels.slots import Slot, empty_slot
from uuv.sim.interfaces.messages import ContactEstimate, HeldLoad, Reference, StateEstimate
from uuv.sim.interfaces.records import EstimateRecord
from uuv.sim.interfaces.spatial import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveState:
    """Last commands of the drives, and the current estimated by the station keeping."""

    tau: Array  # (n,) [N m] motor torques
    qd_wanted: Array  # (n,) [rad/s]
    current_W: Array  # (3,) [m/s]


@dataclass(slots=True, eq=False)
class ContactState:
    """State of an estimator, as arrays that are changed in place."""

    # separate copy of the arm model, including the payload once it is identified
    arm: ArmParameters
    record: ContactRecord
    memory: Array = field(default_factory=lambda: np.zeros(0))  # memory of a kernel
    own: Any = None  # state of the kind of estimator: payload identification, or load observer
    excess: Array | None = None  # (nb,) [-] identified excess masses of the arm's parts
    expected: HeldLoad | None = None  # load in the jaws that is to be identified, as expected
    load: HeldLoad | None = None  # the same, as identified so far

    @property
    def sensed(self) -> SensedArm:
        """Motion of arm and hull, and the force in hull axes."""
        return self.record.sensed

    @property
    def bias(self) -> Array:
        """Tare (n,) [N m] of the external torques."""
        return self.record.bias

    @property
    def floor(self) -> Array:
        """Standard deviation (n,) [N m] of the external torques, in addition to the sensors'
        noise.
        """
        return self.record.floor

    @property
    def friction(self) -> Array:
        """Dry friction (n,) [N m] in the gears that the drives have to overcome."""
        return self.record.friction

    @property
    def estimate(self) -> ContactEstimate:
        """Present force, as a message with copies of the arrays."""
        return ContactEstimate(
            force_W=self.record.f_W.copy(),
            normal=float(self.record.felt[0]),
            sigma_G=self.record.sigma_G.copy(),
            load=self.load,
            torques=self.sensed.tau_e - self.bias,
        )

    @estimate.setter
    def estimate(self, estimate: ContactEstimate) -> None:
        """Set the present force."""
        self.record.f_W[:] = estimate.force_W
        self.record.felt[0] = estimate.normal
        self.record.sigma_G[:] = estimate.sigma_G

    def weigh(self, expected: HeldLoad | None) -> None:
        """Ask for the identification of a load in the jaws, or end it by None.

        Args:
            expected: where its middle is, and the water that it displaces.
        """
        if expected is self.expected:
            return
        self.expected = expected
        self.own = self.load = None
        self.record.weighing[0] = expected is not None

    def wrench_B(self) -> Array:
        """Contact wrench (6,) [N, N m] on the hull, through the arm, at the hull's origin in hull
        axes.
        """
        contact_B = np.empty(6)
        contact_wrench(self.sensed.X_BG, self.sensed.f_B, contact_B)
        return contact_B


class ContactEstimator(Protocol):
    """Estimator of the contact force, and of the gear friction that the drives have to overcome."""

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact."""
        ...

    def step(
        self, state: ContactState, estimate: StateEstimate, reference: Reference, drives: DriveState
    ) -> None:
        """Process one sample; force, friction, and motion of arm and hull are stored in `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: shows when to tare.
            drives: last commands of the drives.
        """
        ...


class TorqueResidual:
    """Common part of the estimators: motion, and the torques that differ from the contact-free
    model.
    """

    def __init__(
        self, model: mujoco.MjModel, arm: ArmDynamics, tuning: ArmTuning, period: float
    ) -> None:
        self._arm = arm
        self._tuning = tuning
        self._vehicle = Vehicle.of(model)

        self.timing = SenseTiming(period, tuning.acceleration_filter, tuning.force_filter)
        self._slow_ticks = max(1, round(tuning.hover_period / period))

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, no tare, no friction."""
        n = self._arm.n
        believed = self._arm.parameters

        return ContactState(
            arm=believed._replace(numbers=believed.numbers.copy()),
            record=ContactRecord(
                sensed=SensedArm.start(estimate.qd, estimate.w_WB_B),
                tare=Tare.start(n),
                bias=np.zeros(n),
                floor=np.full(n, self._tuning.torques.floor),
                friction=np.zeros(n),
                f_W=np.full(3, np.nan),
                felt=np.full(1, np.nan),
                sigma_G=np.array(ContactEstimate().sigma_G),
                weighing=np.zeros(1, dtype=np.bool_),
                ticks=np.zeros(1, dtype=np.int64),
            ),
        )

    def _sense(
        self, state: ContactState, estimate: StateEstimate, current_W: Array, f_tip_W: Array
    ) -> float:
        """Write the force from torque sensors into `f_tip_W` and the residual into `state.sensed`;
        returns the normal force.
        """
        e = estimate
        floor = state.floor

        # The uncertainty of a replaced sensor adds to the noise of its joint.
        if e.tau_doubt is not None:
            floor = np.hypot(floor, e.tau_doubt)

        readings = (e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, current_W, e.q, e.qd, e.tau)
        errors = (state.bias, floor, self._tuning.torques.share)
        return estimate_tip_force(
            tuple(state.arm), readings, errors, self.timing, tuple(state.sensed), f_tip_W
        )

    def _tare(self, state: ContactState, reference: Reference) -> None:
        if reference.tare:
            add_to_tare(tuple(state.record.tare), state.sensed.tau_e, state.bias)

    def _is_slow_tick(self, state: ContactState) -> bool:
        """True if the slow part of a step, at the rate of the hull, is due."""
        return bool(state.record.ticks[0] % self._slow_ticks == 0)


class TorqueSensors(TorqueResidual):
    """Contact force from torque sensors on the gear outputs; the payload is identified while
    unfolding.
    """

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
            arm: believed dynamics of the arm; None: read from `model`.
            tuning: filters and noise.
            period: [s] of a step.
            water_error: [-] share by which added masses and drags are wrong; used only if `arm` is
                None.
            friction: identified friction of the gears; None: the model's.
        """
        tuning = tuning or ArmTuning()
        super().__init__(model, arm or ArmDynamics(model, water_error=water_error), tuning, period)
        self._period = period

        self._payload = PayloadIdentification(self._arm)
        self._force_share = share = min(1.0, period / tuning.force_filter)

        gears = FrictionTracking(
            armature=np.array(self._vehicle.armature),
            damping=np.array(self._vehicle.joint_damping),
            most=tuning.gears.excess * (friction or self._vehicle.dry_friction).stiction,
            share=min(1.0, period / tuning.gears.filter),
        )

        # A first-order filter passes `share / (2 - share)` of the variance of white noise.
        self.gains = FeelGains(
            timing=self.timing,
            noise=tuning.torques.share,
            kept=share / (2.0 - share),
            drift=tuning.torques.drift,
            gears=gears,
            slow_ticks=self._slow_ticks,
        )

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, no tare, no friction, no payload."""
        state = super().init(estimate)

        state.own = self._payload.init()
        state.record.weighing[0] = True
        return state

    def slot(self, state: ContactState) -> Slot:
        """The estimator is contained in the tick, which works on the record of `state`."""
        return empty_slot(state.record.felt)

    def step(
        self, state: ContactState, estimate: StateEstimate, reference: Reference, drives: DriveState
    ) -> None:
        """Process one sample; force, friction, and motion of arm and hull are stored in `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: shows when to tare, and when the arm begins its work.
            drives: last commands of the drives.
        """
        self.sense(state, estimate, drives)
        self._tare(state, reference)

        if self._is_slow_tick(state):
            self.follow_up(state, estimate, reference)

        state.record.ticks[0] += 1

    def follow_up(self, state: ContactState, estimate: StateEstimate, reference: Reference) -> None:
        """Rest of a slow step after `sense` and tare: payload and sigma.

        Args:
            state: as `sense` left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: shows when the arm begins its work.
        """
        if state.record.weighing[0]:
            self.weigh(state, estimate, reference)
        find_sigma(self.gains, estimate.tau, state.record)

    def sense(self, state: ContactState, estimate: StateEstimate, drives: DriveState) -> None:
        """Force, friction and motion of one sample, without tare and payload; sigma is unchanged.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            drives: last commands of the drives.
        """
        e = estimate
        moving = e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B
        readings = ArmReadings(*moving, drives.current_W, e.q, e.qd, e.tau)

        doubt = np.zeros(len(e.q)) if e.tau_doubt is None else e.tau_doubt
        feel_by_torques(state.arm, self.gains, readings, doubt, drives.tau, state.record)

    def weigh(
        self, state: ContactState, estimate: StateEstimate | EstimateRecord, reference: Reference
    ) -> None:
        """Identify the payload while the arm unfolds, and adopt it at the first tool pose; later
        what the jaws hold, when that is asked for.

        Args:
            state: as `sense` left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: shows when the arm begins its work.
        """
        sensed = state.sensed
        payload = state.own
        motion = JointMotion(estimate.q, estimate.qd, sensed.qdd)
        if state.expected is not None:
            # What the jaws hold, beside the arm whose payload is known.
            if payload is None:
                doubt = self._tuning.torques.drift
                others = 0.0 if estimate.tau_doubt is None else estimate.tau_doubt
                of_each = np.hypot(np.full(self._arm.n, doubt), others)
                payload = state.own = LoadIdentification(self._arm, state.expected, of_each)
            payload.add(motion, sensed.hull, sensed.tau_e - state.bias)
            state.load = payload.load
        elif reference.X_WG is not None:
            # At the first tool pose: adopt the payload.
            state.excess = self._payload.excess(payload)
            state.arm.numbers[:] = self._payload.weighed(state.excess).numbers
            state.own = None
            state.record.weighing[0] = False
        elif state.record.ticks[0] * self._period > self._tuning.weighing_after:
            # Before that, once the start is over, each step adds one sample.
            self._payload.add(payload, motion, sensed.hull, sensed.tau_e)
