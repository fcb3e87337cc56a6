"""Joint-space PD with J^T force control, a simple contact controller for comparison.

    tau = g(q) + Kp (q_d - q) + Kd (qd_d - qd) - J^T f_G + friction
    f_G = [0, 0, F + F_I],    dF_I/dt = w (F - F_e)

g compensates the arm's weight in still water. Kp and Kd are diagonal, from the inertia in the home
posture and one bandwidth. F is the set force, F_e the force estimated from the joint torques.
Inverse kinematics, force estimate and station keeping are those of
`uuv.controllers.whole_body.work_controller`; inverse dynamics of the motion, identified compliance
and displacement of the tool are not used.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.estimation.tip_force_estimator import ContactState, DriveState, TorqueSensors
from uuv.controllers.hull.hull_control import HullControl, HullControlState
from uuv.controllers.tuning import DRIVE_PERIOD, ArmTuning
from uuv.controllers.whole_body.tool_control import ToolControl, ToolControlState
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import Command, HullLoad, Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array

BANDWIDTH = 40.0  # [rad/s] bandwidth of each joint alone, critically damped
FORCE_BANDWIDTH = 5.0  # [rad/s] bandwidth of the integral of the force error
FORCE_LIMIT = 60.0  # [N] limit of that integral, in both directions


class NoDisplacement:
    """Force law that does not displace the tool's reference
    (`uuv.controllers.whole_body.tool_control.ForceLaw`).
    """

    closed_loop = True

    def init(self) -> None:
        """No state."""

    def step(
        self, state: None, set_force: float, felt: float, servo_compliance: float, dt: float
    ) -> float:
        """No displacement [m]."""
        return 0.0

    def release(self, state: None, dt: float, *, inwards: bool = True) -> float:
        """No displacement [m]."""
        return 0.0


@dataclass(slots=True, eq=False)
class JointForceState:
    """State of the controller, changed in place."""

    contact: ContactState
    tool: ToolControlState
    hull: HullControlState
    tau: Array  # (n,) [N m] last commands of the drives
    extra: float = 0.0  # [N] integral of the force error
    load: HullLoad | None = None
    tick: int = 0


class JointForceController:
    """Joint-space PD with J^T force control (`uuv.sim.interfaces.protocols.Controller`)."""

    period = DRIVE_PERIOD

    def __init__(self, model: mujoco.MjModel, *, water_error: float = 0.0) -> None:
        """Set up for the controller's `model`, with coefficients that are wrong by the share
        `water_error`.
        """
        tuning = ArmTuning()
        vehicle = Vehicle.of(model)
        self._arm = ArmDynamics(model, water_error=water_error)
        self._contact = TorqueSensors(model, arm=self._arm, tuning=tuning)
        self._tool = ToolControl(model, self._arm, tuning, force_law=NoDisplacement())

        self._task_ticks = max(1, round(tuning.task_period / DRIVE_PERIOD))
        self._hull_ticks = max(1, round(tuning.hover_period / DRIVE_PERIOD))
        self._hull = HullControl(
            model, self._arm, period=self._hull_ticks * DRIVE_PERIOD, water_error=water_error
        )

        # One bandwidth for all joints: gains from the inertia of each, in the home posture.
        inertia = np.diag(self._arm.inertia(np.array(vehicle.q_home))) + vehicle.armature
        self._stiffness = BANDWIDTH**2 * inertia  # [N m/rad]
        self._damping = 2.0 * BANDWIDTH * inertia  # [N m s/rad]
        self._limits = np.array(vehicle.torque_limits)

    def init(self, estimate: StateEstimate) -> JointForceState:
        """Initial state: the arm held at its present angles, thrusters off."""
        return JointForceState(
            contact=self._contact.init(estimate),
            tool=self._tool.init(estimate),
            hull=self._hull.init(),
            tau=np.zeros(self._arm.n),
        )

    def step(
        self, state: JointForceState, estimate: StateEstimate, reference: Reference
    ) -> tuple[JointForceState, Command]:
        """Torques of the joints, and commands of the thrusters if due.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: hull pose, tool pose or joint angles, set force and mode.
        """
        contact = state.contact
        motion = state.tool.motion
        drives = DriveState(tau=state.tau, qd_wanted=motion.qd, current_W=state.hull.current_W)
        self._contact.step(contact, estimate, reference, drives)

        # Desired motion, computed when due; in between it is extrapolated.
        since = state.tick % self._task_ticks
        if since == 0:
            self._tool.step(state.tool, estimate, reference, contact)
        error = motion.q + since * self.period * motion.qd - estimate.q

        # Weight and friction are fed forward, the error fed back.
        tau = self._borne(state, estimate, reference) + contact.friction
        tau += self._stiffness * error + self._damping * (motion.qd - estimate.qd)
        state.tau = np.clip(tau, -self._limits, self._limits)

        # Thrusters, when due.
        if state.tick % self._hull_ticks == 0:
            wrench_B = contact.sensed.wrench_B + (
                contact.wrench_B() if reference.in_contact else np.zeros(6)
            )
            self._hull.step(state.hull, estimate, reference, wrench_B)
            state.load = HullLoad(arm_wrench_B=wrench_B, current_W=state.hull.current_W.copy())

        state.tick += 1
        return state, Command(
            time=estimate.time,
            joint_torque=state.tau,
            thrusters=state.hull.thrusters.copy(),
            scan=reference.scan,
            contact=contact.estimate,
            hull_load=state.load,
        )

    def _borne(
        self, state: JointForceState, estimate: StateEstimate, reference: Reference
    ) -> Array:
        """Torques (n,) [N m] that compensate the arm's weight and press with set force and
        integral.
        """
        press = 0.0
        if reference.force_control:
            lacking = reference.set_force - state.contact.estimate.normal
            grown = state.extra + FORCE_BANDWIDTH * self.period * lacking
            state.extra = min(max(grown, -FORCE_LIMIT), FORCE_LIMIT)
            press = max(0.0, reference.set_force + state.extra)
        else:
            state.extra = 0.0

        rest = np.zeros(self._arm.n)
        none = np.zeros(6)
        tau, _ = self._arm.inverse(
            estimate.q,
            rest,
            rest,
            R_WB=estimate.X_WB[:3, :3],
            nu_B=none,
            a_B=none,
            v_current_W=none[:3],
            wrench_tip_G=np.array([0.0, 0.0, -press, 0.0, 0.0, 0.0]),
        )

        return tau
