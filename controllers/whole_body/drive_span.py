"""Compiled ticks of a `SafetyWrapper` around a `WorkController`: what they take, and what they leave in its state.

The step of the hull, twenty times slower than the drives or so, stays in Python: `DriveSpan.store` makes it.
"""

import numpy as np

from uuv.controllers.arm.compliance import LateralCompliance
from uuv.controllers.arm.kernel_force_law import KernelForceLaw
from uuv.controllers.arm.position_force import ForceDisplacement, ForceDisplacementState
from uuv.controllers.estimation.tip_force_estimator import TorqueSensors
from uuv.controllers.safety.safety_wrapper import SafetyWrapper, SafetyWrapperState
from uuv.controllers.tuning import SAFETY
from uuv.controllers.whole_body.drive_tick import (
    BEGAN,
    BROKEN,
    FINE,
    NORMAL,
    NUMBERS,
    SERVO_COMPLIANCE,
    SOFTNESS,
    SUSPECT,
    TICK,
    TOOL_TICK,
    DriveGains,
    DriveRecord,
    ReferenceRecord,
)
from uuv.controllers.whole_body.tool_control import FromEstimate
from uuv.controllers.whole_body.work_controller import WorkController, WorkControllerState
from uuv.sim.interfaces.messages import Command, ContactEstimate, FaultKind, Reference, StateEstimate
from uuv.sim.interfaces.protocols import Controller


def replaced_part(controller: Controller) -> str:
    """Part of a controller for which `drive_tick` has no kernel; empty if there is none."""
    if type(controller) is not SafetyWrapper:
        return f"controller {type(controller).__name__}"
    inner = controller.controller
    if type(inner) is not WorkController:
        return f"controller {type(inner).__name__}"
    tool = inner.tool
    for part, kind in (
        (inner.contact, TorqueSensors),
        (tool.compliance, LateralCompliance),
        (tool.drift, FromEstimate),
    ):
        if type(part) is not kind:
            return type(part).__name__
    if type(tool.force_law) not in (ForceDisplacement, KernelForceLaw):
        return type(tool.force_law).__name__
    if tool.compliance_ticks * inner.task_ticks % inner.hull_ticks:
        return "compliance_period that is no multiple of hover_period"
    return ""


class DriveSpan:
    """Compiled ticks of the controller; for one run."""

    def __init__(self, wrapper: SafetyWrapper, state: SafetyWrapperState) -> None:
        """Bind the arrays of the state.

        Args:
            wrapper: of which `replaced_part` names none.
            state: of it, with fault detection begun.
        """
        inner = wrapper.controller
        assert isinstance(inner, WorkController)
        assert isinstance(inner.contact, TorqueSensors)
        force_law = inner.tool.force_law
        assert isinstance(force_law, ForceDisplacement)
        assert state.health is not None
        self._wrapper, self._inner, self._state, self._health = wrapper, inner, state, state.health
        self._estimator = inner.contact
        own: WorkControllerState = state.inner
        law: ForceDisplacementState = own.tool.force
        tuning, contact = inner.tuning, own.contact
        gains = DriveGains(
            timing=inner.contact.timing,
            gears=inner.contact.gears,
            tracking=inner.tool.tracking,
            force=force_law.gains,
            law=force_law.address if isinstance(force_law, KernelForceLaw) else 0,
            drives=inner.servo.drives,
            softness=tuning.normal_softness,
            hardening=inner.servo.hardening,
            friction_feedforward=tuning.gears.feedforward,
            torque_noise=tuning.torques.share,
            task_ticks=inner.task_ticks,
            hull_ticks=inner.hull_ticks,
            period=inner.period,
            warm_up=wrapper.health.limits.warm_up,
            oldest=np.array([wrapper.health.limits.vision_age, np.inf, SAFETY.old_imu]),
        )
        self.record = DriveRecord(
            gains=gains,
            arm=contact.arm,
            sensed=contact.sensed,
            bias=contact.bias,
            tare=contact.tare,
            floor=contact.floor,
            friction=contact.friction,
            force=law.numbers,
            motion=own.tool.motion,
            integral=own.servo.integral,
            tau=np.array(own.servo.tau),
            f_W=np.zeros(3),
            offset_W=np.zeros(3),
            current_W=np.zeros(3),
            model=wrapper.health.joints,
            residuals=state.health.joints,
            numbers=np.zeros(NUMBERS),
            ticks=np.zeros(2, dtype=np.int64),
        )
        self.record.numbers[BEGAN] = state.health.began
        self.reference = ReferenceRecord.empty(len(contact.bias))

    def ready(self, reference: Reference) -> int:
        """Number of ticks that may now run compiled under `reference`; 0 where Python has to take the next one."""
        state, inner, hull_ticks = self._state, self._state.inner, self._inner.hull_ticks
        if state.stopped is not None or state.blind_for or self._health.faults:
            return 0
        x, y, z = inner.tool.compliance.offset_W.tolist()
        if reference.scan or reference.compliant or reference.abort is not None or x or y or z:
            return 0
        if reference.force_control and not inner.tool.servo_compliance:
            return 0
        until = -inner.tick % hull_ticks  # the next step of the hull
        tool_ticks = self._inner.tool.compliance_ticks * self._inner.task_ticks
        adopts_payload = inner.contact.own is not None and reference.X_WG is not None
        renews_compliance = reference.force_control and (inner.tick + until) % tool_ticks == 0
        return until if adopts_payload or renews_compliance else until + hull_ticks

    def load(self, reference: Reference) -> None:
        """Take over what Python has changed since the last ticks."""
        own, record = self._state.inner, self.record
        record.tau[:], record.current_W[:] = own.servo.tau, own.hull.current_W
        record.numbers[SOFTNESS], record.numbers[SERVO_COMPLIANCE] = own.servo.softness, own.tool.servo_compliance
        record.ticks[TICK], record.ticks[TOOL_TICK] = own.tick, own.tool.tick
        self.reference.refer(reference)

    def store(self, estimate: StateEstimate, reference: Reference, code: int) -> Command:
        """Leave the ticks done in the state, as if Python had done them, and make the hull's step where it is due.

        Args:
            estimate: of the last tick.
            reference: under which they ran.
            code: outcome of the last tick.

        Returns:
            The command of the last tick.
        """
        state, own, record = self._state, self._state.inner, self.record
        done = int(record.ticks[TICK]) - own.tick
        hull_due = code != FINE and (own.tick + done - 1) % self._inner.hull_ticks == 0
        own.contact.tick += done
        own.tick, own.tool.tick = int(record.ticks[TICK]), int(record.ticks[TOOL_TICK])
        own.servo.tau, own.servo.softness = record.tau.copy(), float(record.numbers[SOFTNESS])
        own.tool.k = own.tool.force.k
        contact = own.contact
        contact.estimate = ContactEstimate(
            force_W=record.f_W.copy(), normal=float(record.numbers[NORMAL]), sigma_G=contact.estimate.sigma_G
        )
        if hull_due:
            contact.tick -= 1
            self._estimator.follow_up(contact, estimate, reference)
            self._inner.step_hull(own, estimate, reference)
            record.current_W[:] = own.hull.current_W
        command = Command(
            time=estimate.time,
            joint_torque=own.servo.tau,
            thrusters=own.hull.thrusters,
            scan=reference.scan,
            contact=contact.estimate,
            hull_load=own.hull_load,
            believed=own.log,
        )
        state.time = estimate.time
        if code == BROKEN or (hull_due and not np.isfinite(command.thrusters).all()):
            return self._wrapper.without(state, estimate, FaultKind.CONTROLLER)
        if code == SUSPECT:
            self._wrapper.health.judge_joints(self._health, estimate.time)
        if hull_due:
            self._wrapper.health.judge_hull(self._health, estimate, command)
        return self._wrapper.passed(state, estimate, command, reference, tuple(self._health.faults))
