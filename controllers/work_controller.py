"""Position-force controller of contact work: composes joint servo, force loop, station keeping and allocation.

One step at the rate of the drives [Konoplin 2022, section 3]:
  1. Inverse dynamics give the joint torques without contact. The residual of the measured torques is the contact;
     J^T maps it to the force on the tool, without a force sensor.
  2. Two corrections of the tool's reference: a displacement k along the tool axis from the force error, and the drift
     of the hull, p*_C = R^T (p*_O - r). MKPS gives the joint angles.
  3. The drives get the inverse dynamics of the wanted motion, with the estimated contact force.
  4. The thrusters get the arm's wrench on the hull, beside the closed loop of station keeping.
"""

from collections.abc import Set
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import numpy as np

from controllers.arm.believed_friction import dry_friction, dry_friction_sigma
from controllers.arm.compliance import ComplianceState, LateralCompliance
from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.arm.joint_servo import resolve_tool_motion, servo_joints, track_gear_friction
from controllers.arm.position_force import ForceDisplacement, ForceDisplacementState
from controllers.arm.tool_motion import bumpless, extrapolated
from controllers.arm.wrench_terms import WrenchTerms
from controllers.estimation.force_from_torques import Tare, force_covariance
from controllers.estimation.load_observer import SMOOTHING, LoadObserver, LoadObserverState
from controllers.estimation.payload_identification import PayloadIdentification, PayloadIdentificationState
from controllers.estimation.tip_force_estimator import estimate_tip_force, force_from_external_torques
from controllers.hull.allocation import PRIORITIES_AFTER_LOSS, Allocation
from controllers.hull.station_keeping import StationKeeping, StationKeepingState
from controllers.hull.thruster_lead import ThrusterLead, ThrusterLeadState
from controllers.mkps import Chain, solve
from controllers.tuning import HULL, ArmTuning, ObserverDeviations
from models.arms.gear_friction import DryFriction
from models.naming import ARM_BASE_BODY, TIP_SITE
from models.vehicle import Vehicle
from sim.interfaces.messages import Command, ContactEstimate, HullLoad, Reference, StateEstimate
from sim.interfaces.spatial import Array, inverse, skew

Method = Literal[
    "compensation", "hydrodynamic-term", "dynamic-term", "contact-term", "drift-correction", "force-control"
]


@dataclass(slots=True, eq=False)
class WorkControllerState:
    """State of the controller; arrays change in place."""

    hover: StationKeepingState
    propellers: ThrusterLeadState
    displacement: ForceDisplacementState
    compliance: ComplianceState
    tare: Tare
    bias: Array  # (n,) [N m]
    tick: int
    q_wanted: Array  # (n,) [rad] at the last task step
    qd_wanted: Array  # (n,) [rad/s]
    qdd_wanted: Array  # (n,) [rad/s^2] by which the arm does not go with the hull
    holding: bool  # joint angles were held at the last task step, no tool pose followed
    current_W: Array  # (3,) [m/s] of the water
    offset: Array  # (n,) [rad] what is left of the jump where the arm began to follow a tool pose
    offset_rate: Array  # (n,) [rad/s]
    yielding: Array  # (2, n) how the joints move the tip along its axis, see `resolve_tool_motion`
    softness: float  # share of the servo's stiffness that is given up now along the tool axis
    servo_compliance: float  # [m]/[N] of the tip along the tool axis
    qd_slow: Array  # (n,) [rad/s] filtered speed, whose lag against the measured one gives the acceleration
    w_slow_B: Array  # (3,) [rad/s] filtered turn of the hull, alike
    integral: Array  # (n,) [rad s]
    load: LoadObserverState
    numbers: Array  # of the arm, as it was weighed (`controllers.arm.inverse_dynamics`)
    weighing: PayloadIdentificationState | None  # until the arm is at its work
    tau: Array  # (n,) [N m] last asked of the motors
    friction: Array  # (n,) [N m] dry friction in the gears that the drives overcome
    floor: Array  # (n,) [N m] of the external torques, beside the noise of the sensors
    sigma_G: Array  # (3,) [N] standard deviation of the felt force, tool axes
    f_tip_B: Array  # (3,) [N] felt force of the world on the tip, hull axes
    thrusters: Array  # (m,) normalised
    hull_load: HullLoad | None = None
    believed: dict[str, Array] = field(default_factory=dict)


class WorkController:
    """Position-force controller of a hovering vehicle with an arm (`sim.interfaces.protocols.Controller`)."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        period: float = 0.002,
        without: Set[Method] = frozenset(),
        tuning: ArmTuning | None = None,
        displacement: ForceDisplacement | None = None,
        compliance: LateralCompliance | None = None,
        water_error: float = 0.0,
        friction: DryFriction | None = None,
    ) -> None:
        """Set up from the controller's own (believed) model of the vehicle.

        Args:
            model: believed model, compiled.
            period: [s] of a step.
            without: methods to leave out, for ablation.
            tuning: gains of the arm.
            displacement: force loop along the tool axis.
            compliance: lateral compliance.
            water_error: [-] share by which added masses and drags are deliberately wrong.
            friction: identified friction of the gears; None: the model's.
        """
        self.period = period
        self._tuning = tuning or ArmTuning()
        self._displacement = displacement or ForceDisplacement()
        self._compliance = compliance or LateralCompliance()
        self._without = frozenset(without)
        self._vehicle = vehicle = Vehicle.of(model)
        self._arm = ArmDynamics(model, water_error=water_error)
        passive = [model.joint(j).name for j in range(model.njnt) if j not in vehicle.joints and model.jnt_type[j] != 0]
        self._chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=passive)
        self._X_BA = np.array(vehicle.X_BA)
        self._X_AB = inverse(self._X_BA)
        self._hover = StationKeeping(model, self._arm, water_error=water_error)
        self._allocation = Allocation(vehicle)
        self._lead = ThrusterLead(vehicle)
        self._left: dict[tuple[int, ...], Allocation] = {(): self._allocation}  # by the thrusters that are lost
        self._observer = LoadObserver(
            model, period=period, time_constant=self._tuning.observer_lag, water_error=water_error, friction=friction
        )
        self._weighing = PayloadIdentification(self._arm)
        self._task_ticks = max(1, round(self._tuning.task_period / period))
        self._hover_ticks = max(1, round(self._tuning.hover_period / period))
        n, tuning = vehicle.joints.size, self._tuning
        self._gains, self._filters = tuning.servo_gains, tuning.motion_filters
        self._armature, self._joint_damping = np.array(vehicle.armature), np.array(vehicle.joint_damping)
        self._torque_limits = np.array(vehicle.torque_limits)
        self._dry = friction or vehicle.dry_friction
        self._most_friction = tuning.friction_excess * self._dry.stiction
        self._force_share = min(1.0, period / tuning.force_filter)
        self._friction_share = min(1.0, period / tuning.friction_filter)
        # Scratch of one step; nothing in it outlives the step, so the state stays explicit.
        self._hull, self._borne_G, self._f_tip_G = np.zeros(24), np.zeros(6), np.zeros(3)
        self._tau_e, self._qdd, self._wrench_free_B, self._wrench_borne_B = (np.empty(k) for k in (n, n, 6, 6))
        self._X_BG, self._J_B = np.empty((4, 4)), np.empty((6, n))
        self._home_wrench = self._wrench_at_rest(np.array(vehicle.q_home))
        self._terms = WrenchTerms(self._arm) if self._without & {"hydrodynamic-term", "dynamic-term"} else None

    @property
    def tunings(self) -> tuple[Any, ...]:
        """The gains in use, for `controllers.tuning.table`."""
        return self._tuning, self._displacement, self._compliance, HULL, ObserverDeviations()

    def init(self, estimate: StateEstimate) -> WorkControllerState:
        """Initial state: the arm held where it is, thrusters off."""
        n = self._vehicle.joints.size
        return WorkControllerState(
            hover=self._hover.init(),
            propellers=self._lead.init(),
            displacement=ForceDisplacementState(),
            compliance=ComplianceState(),
            tare=Tare(np.zeros(n)),
            bias=np.zeros(n),
            tick=0,
            q_wanted=np.array(estimate.q),
            qd_wanted=np.zeros(n),
            qdd_wanted=np.zeros(n),
            holding=True,
            current_W=np.zeros(3),
            offset=np.zeros(n),
            offset_rate=np.zeros(n),
            yielding=np.zeros((2, n)),
            softness=0.0,
            servo_compliance=0.0,
            qd_slow=np.array(estimate.qd),
            w_slow_B=np.array(estimate.w_WB_B),
            integral=np.zeros(n),
            load=self._observer.init(),
            numbers=self._arm.numbers,
            weighing=self._weighing.init() if self._tuning.torque_source == "sensor" else None,
            tau=np.zeros(n),
            friction=np.zeros(n),
            floor=np.full(n, self._tuning.torque_floor),
            sigma_G=np.full(3, np.inf),
            f_tip_B=np.zeros(3),
            thrusters=np.zeros(self._vehicle.thruster_actuators.size),
        )

    def step(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference
    ) -> tuple[WorkControllerState, Command]:
        """One control step: contact force, tool motion, joint torques, and on its tick the thrusters.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: hull pose, tool pose or joint angles, set force and mode.

        Returns:
            The state, and the command with what the controller believes.
        """
        tuning, vehicle, dt, arm, hull = self._tuning, self._vehicle, self.period, self._arm, self._hull
        f_tip_W = np.empty(3)

        # 1. Contact force from torques: the residual against the model without contact.
        floor = state.floor if estimate.tau_doubt is None else np.hypot(state.floor, estimate.tau_doubt)
        felt = estimate_tip_force(
            arm.layout,
            state.numbers,
            arm.stations,
            arm.work,
            hull,
            estimate.X_WB,
            estimate.v_WB_B,
            estimate.w_WB_B,
            estimate.a_WB_B,
            state.current_W,
            estimate.q,
            estimate.qd,
            estimate.tau,
            state.bias,
            tuning.torque_noise,
            floor,
            dt,
            self._filters,
            state.qd_slow,
            state.w_slow_B,
            self._qdd,
            self._tau_e,
            self._wrench_free_B,
            self._X_BG,
            self._J_B,
            state.f_tip_B,
            self._f_tip_G,
            f_tip_W,
        )
        if tuning.torque_source == "observer":
            self._tau_e[:] = self._observer.step(
                state.load,
                estimate.q,
                estimate.qd,
                state.tau,
                R_WB=estimate.X_WB[:3, :3],
                nu_B=hull[9:15],
                v_current_W=state.current_W,
            )
            felt = force_from_external_torques(
                estimate.X_WB,
                self._X_BG,
                self._J_B,
                self._tau_e,
                state.bias,
                state.tau,
                0.0,
                state.floor,
                state.f_tip_B,
                self._f_tip_G,
                f_tip_W,
            )
            dry = self._dry
            dry_friction(
                dry.coulomb, dry.stiction, dry.stribeck_speed, tuning.friction_reversal, state.qd_wanted, state.friction
            )
        else:
            track_gear_friction(
                state.tau,
                estimate.tau,
                estimate.qd,
                self._qdd,
                self._armature,
                self._joint_damping,
                self._most_friction,
                self._friction_share,
                state.friction,
            )
        if state.weighing is not None and state.tick % self._hover_ticks == 0:
            self._weigh(state, state.weighing, estimate, reference)
        if reference.tare:
            state.tare.add(self._tau_e)
            state.bias = state.tare.bias()
        if state.tick % self._hover_ticks == 0:
            self._doubt(state, estimate)

        # 2. Reference of the tool.
        since = state.tick % self._task_ticks
        if since == 0:
            self._task(state, estimate, reference, felt, f_tip_W)

        # 3. Drives.
        if self._presses(reference):
            state.softness = tuning.normal_softness
        elif state.softness > 0.0:
            state.softness = max(0.0, state.softness - tuning.normal_softness * dt / tuning.hardening_time)
        in_contact = reference.force > 0.0 or reference.force_control
        self._borne_G[:3] = tuning.friction_feedforward * self._f_tip_G if in_contact else 0.0
        self._borne_G[2] = -reference.force if self._presses(reference) else 0.0
        tau = np.empty(len(vehicle.joints))
        servo_joints(
            arm.layout,
            state.numbers,
            arm.stations,
            arm.work,
            hull,
            estimate.q,
            estimate.qd,
            state.q_wanted,
            state.qd_wanted,
            state.qdd_wanted,
            since * dt,
            state.integral,
            dt,
            self._gains,
            self._armature,
            self._joint_damping,
            state.friction,
            self._torque_limits,
            self._borne_G,
            state.yielding,
            state.softness,
            self._qdd,
            tau,
            self._wrench_borne_B,
        )

        state.tau = tau

        # 4. Thrusters.
        if state.tick % self._hover_ticks == 0:
            self._thrusters(state, estimate, reference, in_contact)
        state.tick += 1
        return state, Command(
            time=estimate.time,
            joint_torque=tau,
            thrusters=state.thrusters,
            scan=reference.scan,
            contact=ContactEstimate(force_W=f_tip_W, normal=felt, sigma_G=state.sigma_G),
            hull_load=state.hull_load,
            believed={
                **state.believed,
                "displacement": np.array([state.displacement.k]),
                "compliance_W": state.compliance.offset_W,
            },
        )

    def _weigh(
        self,
        state: WorkControllerState,
        weighing: PayloadIdentificationState,
        estimate: StateEstimate,
        reference: Reference,
    ) -> None:
        """Identify the payload while the arm unfolds; adopt it at the first tool pose, still free of contact."""
        if reference.X_WG is not None:
            excess = self._weighing.excess(weighing)
            state.numbers, state.weighing = self._weighing.weighed(excess), None
            state.believed["arm_excess"] = excess
        elif state.tick * self.period > self._tuning.weighing_after:
            self._weighing.add(weighing, estimate.q, estimate.qd, self._qdd, self._hull, self._tau_e)

    def _doubt(self, state: WorkControllerState, estimate: StateEstimate) -> None:
        """Update the standard deviations of the external torques and of the force estimate."""
        tuning, dry = self._tuning, self._dry
        if tuning.torque_source == "observer":
            dry_friction_sigma(dry.coulomb, dry.stiction, SMOOTHING, tuning.friction_known, state.qd_slow, state.floor)
            state.floor = np.hypot(tuning.observer_floor, state.floor)
            weighed, errors = state.floor, state.floor**2
        else:
            noise = tuning.torque_noise * np.abs(estimate.tau)
            kept = self._force_share / (2.0 - self._force_share)  # of white noise behind the filter of the felt force
            weighed, errors = state.floor + noise, kept * noise**2 + tuning.torque_drift**2
        J_G = self._X_BG[:3, :3].T @ self._J_B[:3]
        state.sigma_G = np.sqrt(np.diag(force_covariance(J_G, weighed, np.diag(errors))))

    def _task(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference, felt: float, f_tip_W: Array
    ) -> None:
        """Wanted joint angles and speeds from the tool's reference, after both corrections."""
        tuning, dt = self._tuning, self._tuning.task_period
        since = estimate.time - reference.time
        if reference.X_WG is None:
            self._displacement.release(state.displacement, dt)
            self._compliance.release(state.compliance, dt)
            state.q_wanted, state.qd_wanted = reference.q + since * reference.qd, reference.qd
            state.qdd_wanted[:] = 0.0
            state.holding = True
            return
        if not reference.force_control:
            k = self._displacement.release(state.displacement, dt, inwards=False)
        elif "force-control" in self._without:
            # Ablation: press by a depth computed from the pad's nominal stiffness, and hope.
            k = state.displacement.k = reference.force / tuning.nominal_stiffness
        else:
            k = self._displacement.step(
                state.displacement, reference.force, felt, self._servo_compliance(state, estimate), dt
            )
        if reference.compliant:
            offset_W = self._compliance.step(state.compliance, f_tip_W, reference.X_WG[:3, 2], dt)
        else:
            offset_W = self._compliance.release(state.compliance, dt)
        X_WG = extrapolated(reference.X_WG, reference.v_WG_W, reference.w_WG_W, since, k, offset_W)
        correct_drift = "drift-correction" not in self._without
        X_WB = estimate.X_WB if correct_drift else reference.X_WB
        X_AG, qd = np.empty((4, 4)), np.empty(len(state.q_wanted))
        resolve_tool_motion(
            self._X_AB,
            X_WB,
            X_WG,
            reference.v_WG_W,
            reference.w_WG_W,
            self._hull,
            self._J_B,
            correct_drift,
            tuning.joint_speed_limit,
            X_AG,
            qd,
            state.qdd_wanted,
            state.yielding,
        )
        result = solve(self._chain, X_AG, state.q_wanted, 1e-6, 1e-5, branch="keep")
        if state.holding:  # the hull stands a little off the place that the held angles were computed for
            state.offset, state.offset_rate, state.holding = state.q_wanted - result.q, state.qd_wanted - qd, False
        state.q_wanted, state.qd_wanted, state.offset, state.offset_rate = bumpless(
            result.q,
            qd,
            state.q_wanted,
            state.offset,
            state.offset_rate,
            tuning.blend_time,
            tuning.joint_speed_limit * dt,
            dt,
        )
        state.believed["ik_error"] = np.array([result.position_error, result.orientation_error])

    def _presses(self, reference: Reference) -> bool:
        """Whether the force loop is closed."""
        return reference.force_control and "force-control" not in self._without

    def _servo_compliance(self, state: WorkControllerState, estimate: StateEstimate) -> float:
        """Compliance [m/N] of the servoed arm at the tip along the tool axis."""
        every = max(1, round(self._tuning.compliance_period / self.period))
        if state.servo_compliance == 0.0 or state.tick % every < self._task_ticks:
            inertia = self._arm.inertia(estimate.q) + np.diag(self._armature)
            along = self._J_B[:3].T @ self._X_BG[:3, 2]
            state.servo_compliance = float(along @ np.linalg.solve(inertia, along)) / (
                self._tuning.joint_frequency**2 * (1.0 - self._tuning.normal_softness)
            )
        return state.servo_compliance

    def _thrusters(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference, in_contact: bool
    ) -> None:
        """Thruster commands: wrench of station keeping, less the arm's wrench on the hull."""
        contact_B = np.zeros(6)
        if in_contact:  # C_F_M = C_F_D + A f_e, C_M_M = C_M_D + C_M_e [Konoplin 2022]
            contact_B[:3] = state.f_tip_B
            contact_B[3:] = skew(self._X_BG[:3, 3]) @ state.f_tip_B
        arm_wrench_B = self._wrench_free_B + contact_B
        fed = arm_wrench_B - self._left_out(state, estimate, contact_B) if self._without else arm_wrench_B
        dt = self._hover_ticks * self.period
        wanted_B = self._hover.step(state.hover, estimate, reference.X_WB, reference.v_WB_W, fed, dt, reference.w_WB_W)
        state.current_W = self._hover.current(state.hover)
        lost = reference.lost_thrusters
        if lost not in self._left:
            self._left[lost] = self._allocation.without(*lost, priorities=PRIORITIES_AFTER_LOSS)
        command = self._left[lost].command(self._left[lost].thrust(wanted_B))
        through_water = self._hover.through_water(state.hover, estimate)
        state.thrusters = self._lead.step(state.propellers, command, through_water, dt)
        state.hover.given_B = state.propellers.given_B
        state.hull_load = HullLoad(arm_wrench_B=arm_wrench_B, current_W=state.current_W)
        state.believed = {**state.believed, "hover_wrench_B": wanted_B, "q_wanted": state.q_wanted}

    def _left_out(self, state: WorkControllerState, estimate: StateEstimate, contact_B: Array) -> Array:
        """Part (6,) of the arm's wrench that an ablation does not feed forward."""
        if "compensation" in self._without:
            return self._wrench_free_B + contact_B - self._home_wrench
        left_out = contact_B.copy() if "contact-term" in self._without else np.zeros(6)
        if self._terms is not None:
            time = self._tuning.acceleration_filter
            qdd = (estimate.qd - state.qd_slow) / max(
                time - self.period, self.period
            )  # `estimate_tip_force` has moved qd_slow on
            for name in ("hydrodynamic", "dynamic"):
                if f"{name}-term" in self._without:
                    left_out += getattr(self._terms, name)(self._hull, estimate.q, estimate.qd, qdd)
        return left_out

    def _wrench_at_rest(self, q: Array) -> Array:
        """Wrench (6,) of the arm on the hull, both at rest and level."""
        rest = np.zeros(q.size)
        return self._arm.inverse(
            q,
            rest,
            rest,
            R_WB=np.eye(3),
            nu_B=np.zeros(6),
            a_B=np.zeros(6),
            v_current_W=np.zeros(3),
            wrench_tip_G=np.zeros(6),
        )[1]
