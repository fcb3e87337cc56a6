"""Position-force controller of contact work: composes contact estimator, tool control, joint servo and hull control.

One step at the rate of the drives [Konoplin 2022, section 3]:
  1. Inverse dynamics give the joint torques without contact. The residual of the measured torques is the contact;
     J^T maps it to the force on the tool, without a force sensor (`uuv.controllers.estimation.tip_force_estimator`).
  2. The tool's reference is displaced by the force error and corrected by the drift of the hull; MKPS gives the joint
     angles (`uuv.controllers.whole_body.tool_control`).
  3. The drives get the inverse dynamics of the wanted motion, with the contact force
  (`uuv.controllers.arm.joint_servo`).
  4. The thrusters get the arm's wrench on the hull, beside the closed loop of station keeping
     (`uuv.controllers.hull.hull_control`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.joint_servo import BorneLoad, JointServo, JointServoState, JointTarget, SeenArm
from uuv.controllers.estimation.tip_force_estimator import ContactEstimator, ContactState, DriveState, TorqueSensors
from uuv.controllers.hull.hull_control import ArmLoad, ArmWrench, Feedforward, HullControl, HullControlState
from uuv.controllers.tuning import DRIVE_PERIOD, HULL, ArmTuning, ObserverDeviations
from uuv.controllers.whole_body.tool_control import (
    DriftCorrection,
    ForceLaw,
    SideDisplacement,
    ToolControl,
    ToolControlState,
)
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import Command, HullLoad, Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class WorkControllerState:
    """State of the controller: that of its parts, changed in place."""

    contact: ContactState
    tool: ToolControlState
    servo: JointServoState
    hull: HullControlState
    hull_load: HullLoad | None = None
    log: Mapping[str, Array] = field(default_factory=dict)  # of the last step of the hull: what nobody decides on
    tick: int = 0


class WorkController:
    """Position-force controller of a hovering vehicle with an arm (`uuv.sim.interfaces.protocols.Controller`).

    It has no state of its own: one controller may step any number of states, also in several threads.
    """

    period = DRIVE_PERIOD

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        tuning: ArmTuning | None = None,
        estimator: ContactEstimator | None = None,
        force_law: ForceLaw | None = None,
        compliance: SideDisplacement | None = None,
        drift: DriftCorrection | None = None,
        feedforward: Feedforward | None = None,
        water_error: float = 0.0,
    ) -> None:
        """Compose the controller for its own (believed) model of the vehicle.

        Args:
            model: believed model, compiled.
            tuning: gains of the arm.
            estimator: of the contact force; None: `TorqueSensors`.
            force_law: force loop along the tool axis; None: `ForceDisplacement`.
            compliance: displacement across the tool axis; None: `LateralCompliance`.
            drift: correction of the tool for the hull's drift; None: `FromEstimate`.
            feedforward: of the arm's wrench to the thrusters; None: `ArmWrench`.
            water_error: [-] share by which added masses and drags are deliberately wrong.
        """
        self.tuning = tuning = tuning or ArmTuning()
        arm = ArmDynamics(model, water_error=water_error)
        self.contact: ContactEstimator = estimator or TorqueSensors(model, arm=arm, tuning=tuning)
        self.tool = ToolControl(model, arm, tuning, force_law=force_law, compliance=compliance, drift=drift)
        self.servo = JointServo(Vehicle.of(model), tuning, DRIVE_PERIOD)
        self.task_ticks = max(1, round(tuning.task_period / DRIVE_PERIOD))
        self.hull_ticks = max(1, round(tuning.hover_period / DRIVE_PERIOD))
        self._hull = HullControl(model, arm, period=self.hull_ticks * DRIVE_PERIOD, water_error=water_error)
        self._feedforward: Feedforward = feedforward or ArmWrench()

    @property
    def tunings(self) -> tuple[Any, ...]:
        """The gains in use, for `uuv.controllers.tuning.table`."""
        return self.tuning, self.tool.force_law, self.tool.compliance, HULL, ObserverDeviations()

    def init(self, estimate: StateEstimate) -> WorkControllerState:
        """Initial state: the arm held where it is, thrusters off."""
        return WorkControllerState(
            contact=self.contact.init(estimate),
            tool=self.tool.init(estimate),
            servo=self.servo.init(),
            hull=self._hull.init(),
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
            The state, and the command with what the controller estimated.
        """
        contact, tool, servo = state.contact, state.tool, state.servo
        drives = DriveState(tau=servo.tau, qd_wanted=tool.motion.qd, current_W=state.hull.current_W)
        self.contact.step(contact, estimate, reference, drives)
        since = state.tick % self.task_ticks
        if since == 0:
            self.tool.step(tool, estimate, reference, contact)
        presses = self.tool.presses(reference)
        self.servo.soften(servo, presses)
        borne_G = np.zeros(6)
        if in_contact(reference):
            borne_G[:3] = self.tuning.gears.feedforward * contact.sensed.f_G
        borne_G[2] = -reference.set_force if presses else 0.0
        tau = self.servo.step(
            servo,
            contact.arm,
            SeenArm(estimate.q, estimate.qd, contact.sensed.hull),
            JointTarget(tool.motion.q, tool.motion.qd, tool.motion.qdd, since * self.period),
            tool.motion.yielding,
            BorneLoad(borne_G, contact.friction),
        )
        if state.tick % self.hull_ticks == 0:
            self.step_hull(state, estimate, reference)
        state.tick += 1
        return state, Command(
            time=estimate.time,
            joint_torque=tau,
            thrusters=state.hull.thrusters,
            scan=reference.scan,
            contact=contact.estimate,
            hull_load=state.hull_load,
            believed=state.log,
        )

    def step_hull(self, state: WorkControllerState, estimate: StateEstimate, reference: Reference) -> None:
        """Thrusters: the arm's wrench C_F_M = C_F_D + A f_e, C_M_M = C_M_D + C_M_e of [Konoplin 2022] is cancelled.

        Args:
            state: after the joints' part of a step; changed in place.
            estimate: of the vehicle now.
            reference: hull pose, set force and mode.
        """
        contact_B = state.contact.wrench_B() if in_contact(reference) else np.zeros(6)
        arm_wrench_B = state.contact.sensed.wrench_B + contact_B
        load = ArmLoad(contact_B=contact_B, wrench_B=arm_wrench_B)
        left_out_B = self._feedforward.left_out(load, state.contact, estimate)
        fed_B = arm_wrench_B if left_out_B is None else arm_wrench_B - left_out_B
        self._hull.step(state.hull, estimate, reference, fed_B)
        state.hull_load = HullLoad(arm_wrench_B=arm_wrench_B, current_W=state.hull.current_W)
        state.log = _log(state)


def in_contact(reference: Reference) -> bool:
    """True while the tool is to touch something."""
    return reference.set_force > 0.0 or reference.force_control


def _log(state: WorkControllerState) -> dict[str, Array]:
    """What nobody decides on, by name."""
    tool, excess = state.tool, state.contact.excess
    log = {
        "displacement": np.array([tool.k]),
        "compliance_W": tool.compliance.offset_W,
        "hover_wrench_B": state.hull.wanted_B,
        "q_wanted": tool.motion.q.copy(),
    }
    if not np.isnan(tool.motion.ik_error[0]):
        log["ik_error"] = tool.motion.ik_error.copy()
    return log if excess is None else log | {"arm_excess": excess}
