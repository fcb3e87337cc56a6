"""Controller of touches for calibration: joint servo in free motion, soft tip spring at a nest."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.joint_servo import (
    BorneLoad,
    JointServo,
    JointServoState,
    JointTarget,
    SeenArm,
)
from uuv.controllers.estimation.tip_force_estimator import ContactState, DriveState, TorqueSensors
from uuv.controllers.hull.hull_control import HullControl, HullControlState
from uuv.controllers.tuning import DRIVE_PERIOD, TouchTuning
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array, log_so3

# [m/s] assumed current, since the current's drag on the arm is small compared with the push
_STILL_WATER = np.zeros(3)


@dataclass(slots=True, eq=False)
class CompliantState:
    """State of the controller."""

    contact: ContactState
    servo: JointServoState
    hull: HullControlState
    p_WG_held: Array | None = None  # (3,) [m] end of the spring in W while it follows the tip
    push: float = 0.0  # [N] present push
    tick: int = 0


class CompliantTouch:
    """Controller of arm and hull for `TouchSequence`: `uuv.sim.interfaces.protocols.Controller`."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        clamped: bool,
        push_W: Array | None = None,
        period: float = DRIVE_PERIOD,
        tuning: TouchTuning | None = None,
        water_error: float = 0.0,
    ) -> None:
        """Set up the controller.

        Args:
            model: the controller's own model of the vehicle.
            clamped: True: the thrusters stay off.
            push_W: (3,) unit direction into a nest in W; default down.
            period: [s] of the controller.
            tuning: motion, stiffness and force of the touches.
            water_error: relative error of the modelled hydrodynamic coefficients.
        """
        self.period = period
        self._clamped = clamped
        self._tuning = tuning or TouchTuning()
        self._vehicle, drives = Vehicle.of(model), self._tuning.drives

        self._arm = arm = ArmDynamics(model, water_error=water_error)
        self._contact = TorqueSensors(model, arm=arm, tuning=drives, period=period)
        self._servo = JointServo(self._vehicle, drives, period)

        self._hull_ticks = max(1, round(drives.hover_period / period))
        self._hull = HullControl(
            model, arm, period=self._hull_ticks * period, water_error=water_error
        )
        self._push_W = np.array([0.0, 0.0, -1.0]) if push_W is None else push_W

    def init(self, estimate: StateEstimate) -> CompliantState:
        """State at the start: no contact force, no friction estimate, thrusters off."""
        return CompliantState(
            contact=self._contact.init(estimate), servo=self._servo.init(), hull=self._hull.init()
        )

    def step(
        self, state: CompliantState, estimate: StateEstimate, reference: Reference
    ) -> tuple[CompliantState, Command]:
        """Compute joint torques and thruster commands for one period.

        Args:
            state: state of the controller, changed in place.
            estimate: estimated state of the vehicle.
            reference: joint angles to follow, or the pose of the spring's end if `X_WG` is set.

        Returns:
            The state and the command, with the estimated force at the tip.
        """
        contact = state.contact
        servo = state.servo
        rest = np.zeros(len(estimate.q))
        self._contact.sense(
            contact, estimate, DriveState(tau=servo.tau, qd_wanted=rest, current_W=_STILL_WATER)
        )

        # Free motion by the servo, otherwise compliance at the tip.
        if reference.X_WG is None:
            age = estimate.time - reference.time
            self._servo.step(
                servo,
                contact.arm,
                SeenArm(estimate.q, estimate.qd, contact.sensed.hull),
                JointTarget(reference.q, reference.qd, rest, age),
                BorneLoad(np.zeros(6), contact.friction),
            )
            state.p_WG_held = None
            state.push = 0.0
        else:
            servo.tau = self._give_way(state, estimate, reference)
            servo.integral[:] = 0.0

        # Thrusters, when due.
        if state.tick % self._hull_ticks == 0 and not self._clamped:
            contact_B = contact.wrench_B() if reference.X_WG is not None else np.zeros(6)
            self._hull.step(state.hull, estimate, reference, contact.sensed.wrench_B + contact_B)

        state.tick += 1
        return state, Command(
            time=estimate.time,
            joint_torque=servo.tau,
            thrusters=state.hull.thrusters.copy(),
            scan=False,
            contact=contact.estimate,
        )

    def _give_way(
        self, state: CompliantState, estimate: StateEstimate, reference: Reference
    ) -> Array:
        """Joint torques (n,) [N m] of compliant motion: weight, spring, push, friction, damping."""
        tuning = self._tuning
        vehicle = self._vehicle
        dt = self.period
        assert reference.X_WG is not None

        X_WG = estimate.X_WB @ state.contact.sensed.X_BG
        end = reference.X_WG[:3, 3]

        # Pressing: the spring force decreases while the push increases.
        if reference.state is WorkState.PRESS:
            share = min(1.0, dt / tuning.let_go)
            state.p_WG_held = np.array(end if state.p_WG_held is None else state.p_WG_held)
            state.p_WG_held += share * (X_WG[:3, 3] - state.p_WG_held)
            state.push += share * (reference.set_force - state.push)
            end = state.p_WG_held
        else:
            state.p_WG_held = None
            state.push = 0.0

        # Force and moment at the tip.
        f_W = (
            _at_most(tuning.stiffness * (end - X_WG[:3, 3]), tuning.most)
            + state.push * self._push_W
        )
        turn_G = log_so3(X_WG[:3, :3].T @ reference.X_WG[:3, :3])
        m_W = _at_most(tuning.turn_stiffness * (X_WG[:3, :3] @ turn_G), tuning.turn_most)

        # Torques: weight, wrench at the tip, friction and damping.
        R_BW = estimate.X_WB[:3, :3].T
        weight, _ = self._arm.inverse(
            estimate.q,
            np.zeros(len(estimate.q)),
            np.zeros(len(estimate.q)),
            R_WB=estimate.X_WB[:3, :3],
            nu_B=np.zeros(6),
            a_B=np.zeros(6),
            v_current_W=np.zeros(3),
            wrench_tip_G=np.zeros(6),
        )
        tau = weight + state.contact.sensed.J_B.T @ np.concatenate([R_BW @ f_W, R_BW @ m_W])
        tau += state.contact.friction - tuning.damping * vehicle.joint_damping * estimate.qd

        return np.clip(tau, -vehicle.torque_limits, vehicle.torque_limits)


def _at_most(v: Array, most: float) -> Array:
    """Scale the vector `v` down to a length of at most `most`."""
    length = float(np.linalg.norm(v))
    return v if length <= most else v * (most / length)
