"""Position-force controller of contact work: composes contact estimator, tool control, joint servo
and hull control.

One step at the rate of the drives [Konoplin 2022, section 3]:
  1. Inverse dynamics give the joint torques without contact. The residual of the measured torques
     is the contact; J^T maps it to the force on the tool, without a force sensor
     (`uuv.controllers.estimation.tip_force_estimator`).
  2. The tool's reference is displaced by the force error and corrected by the drift of the hull;
     MKPS gives the joint angles (`uuv.controllers.whole_body.tool_control`).
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
from uuv.controllers.arm.joint_servo import JointServo
from uuv.controllers.estimation.tip_force_estimator import (
    ContactEstimator,
    ContactState,
    DriveState,
    TorqueSensors,
)
from uuv.controllers.hull.hull_control import (
    ArmLoad,
    ArmWrench,
    Feedforward,
    HullControl,
    HullControlState,
)
from uuv.controllers.tuning import DRIVE_PERIOD, HULL, ArmTuning, ObserverDeviations
from uuv.controllers.whole_body.drive_tick import DriveGains, DriveRecord, drive_box, drive_tick
from uuv.controllers.whole_body.tool_control import (
    DriftCorrection,
    ForceLaw,
    SideDisplacement,
    ToolControl,
    ToolControlState,
)
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels.control import Commanded, Inputs, Unsaved, commanded
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.kernels.slots import (
    PythonSlots,
    address_of_box,
    address_of_kernel,
    empty_slot,
    has_slot,
)
from uuv.sim.interfaces.messages import Command, HullLoad, Reference, StateEstimate
from uuv.sim.interfaces.records import (
    ReferenceRecord,
    estimate_record,
    reference_record,
    take_reference,
)
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class WorkControllerState:
    """State of the controller: that of its parts, and the arrays that they share; in place."""

    contact: ContactState
    tool: ToolControlState
    integral: Array  # (n,) [rad s] of the joint servo
    hull: HullControlState
    command: Commanded
    reference: ReferenceRecord
    current_W: Array  # (3,) [m/s] estimated current
    softness: Array  # (1,) [-] share of the stiffness that is given up now along the tool axis
    ticks: np.ndarray  # (1,) so far
    hull_load: HullLoad | None = None
    # of the last step of the hull: what nobody decides on
    log: Mapping[str, Array] = field(default_factory=dict)
    alone: Unsaved["WorkTick"] = field(default_factory=Unsaved)  # tick of `WorkController.step`


class WorkController:
    """Position-force controller of a hovering vehicle with an arm
    (`uuv.sim.interfaces.protocols.Controller`).

    It has no state of its own: one controller may step any number of states, also in several
    threads.
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
        self._torque_sensors = TorqueSensors(model, arm=arm, tuning=tuning)
        self.contact: ContactEstimator = estimator or self._torque_sensors
        self.tool = ToolControl(
            model, arm, tuning, force_law=force_law, compliance=compliance, drift=drift
        )
        self._vehicle = Vehicle.of(model)
        self.servo = JointServo(self._vehicle, tuning, DRIVE_PERIOD)
        self.task_ticks = max(1, round(tuning.task_period / DRIVE_PERIOD))
        self.hull_ticks = max(1, round(tuning.hover_period / DRIVE_PERIOD))
        self._hull = HullControl(
            model, arm, period=self.hull_ticks * DRIVE_PERIOD, water_error=water_error
        )
        self._feedforward: Feedforward = feedforward or ArmWrench()

    @property
    def slow(self) -> tuple[str, ...]:
        """Parts in plain Python that every tick calls."""
        estimator = () if has_slot(self.contact) else (type(self.contact).__name__,)
        return *estimator, *self.tool.slow

    @property
    def tunings(self) -> tuple[Any, ...]:
        """The gains in use, for `uuv.controllers.tuning.table`."""
        return self.tuning, self.tool.force_law, self.tool.compliance, HULL, ObserverDeviations()

    def init(self, estimate: StateEstimate) -> WorkControllerState:
        """Initial state: the arm held where it is, thrusters off."""
        n, contact = len(estimate.q), self.contact.init(estimate)
        command = commanded(n, len(self._vehicle.thruster_names))
        return WorkControllerState(
            contact=contact,
            tool=self.tool.init(estimate),
            integral=np.zeros(n),
            hull=self._hull.init(),
            command=command._replace(f_W=contact.record.f_W, felt=contact.record.felt),
            reference=reference_record(n),
            current_W=np.zeros(3),
            softness=np.zeros(1),
            ticks=np.zeros(1, dtype=np.int64),
        )

    def tick_on(self, state: WorkControllerState, inputs: Inputs) -> "WorkTick":
        """The tick of `state`, which sees `inputs`."""
        return WorkTick(self, state, inputs)

    def step(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference
    ) -> tuple[WorkControllerState, Command]:
        """One control step: contact force, tool motion, joint torques, and on its tick the
        thrusters.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: hull pose, tool pose or joint angles, set force and mode.

        Returns:
            The state, and the command with what the controller estimated.
        """
        n = len(estimate.q)
        tick = state.alone.get(lambda: self.tick_on(state, Inputs(estimate_record(n))))
        tick.refer(reference)
        tick.inputs.take(estimate)
        answer = tick.slots.check(drive_tick(tick.box, tick.inputs.box))
        return state, tick.done(estimate, reference, answer)

    def step_hull(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference
    ) -> None:
        """Thrusters: the arm's wrench C_F_M = C_F_D + A f_e, C_M_M = C_M_D + C_M_e of [Konoplin
        2022] is cancelled.

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
        state.command.thrusters[:], state.current_W[:] = state.hull.thrusters, state.hull.current_W
        state.command.hull_steps[0] += 1

    def record(self, state: WorkControllerState, inputs: Inputs, slots: PythonSlots) -> DriveRecord:
        """The state as the kernel takes it.

        Args:
            state: of `init`.
            inputs: what the ticks see.
            slots: where parts in plain Python go.
        """
        contact, tuning, estimator = state.contact, self.tuning, self.contact
        by_sensors = has_slot(estimator)
        feeling: Any = estimator if by_sensors else self._torque_sensors
        force_law: Any = self.tool.force_law
        gains = DriveGains(
            feel=feeling.gains,
            feels=by_sensors,
            closed_loop=force_law.closed_loop,
            drives=self.servo.drives,
            softness=tuning.normal_softness,
            hardening=self.servo.hardening,
            friction_feedforward=tuning.gears.feedforward,
            task_ticks=self.task_ticks,
            hull_ticks=self.hull_ticks,
            period=self.period,
        )

        def feel() -> None:
            tau, qd = state.command.tau, state.tool.motion.qd
            drives = DriveState(tau=tau, qd_wanted=qd, current_W=state.current_W)
            estimator.step(contact, inputs.seen(), inputs.reference, drives)

        def weigh() -> None:
            feeling.weigh(contact, inputs.seen(), inputs.reference)

        def step_hull() -> None:
            self.step_hull(state, inputs.seen(), inputs.reference)

        none = empty_slot()
        by_slot = feeling.slot(contact) if by_sensors else none._replace(address=slots.add(feel))
        return DriveRecord(
            gains=gains,
            arm=contact.arm,
            contact=contact.record,
            estimator=by_slot,
            weigh=none._replace(address=slots.add(weigh)),
            tool=self.tool.record(state.tool, inputs, slots, contact.sensed),
            reference=state.reference,
            integral=state.integral,
            current_W=state.current_W,
            hull=none._replace(address=slots.add(step_hull)),
            command=state.command,
            softness=state.softness,
            ticks=state.ticks,
        )


class WorkTick:
    """Tick of a `WorkController`, bound to the arrays of a state (`ControlTick`)."""

    def __init__(
        self, controller: WorkController, state: WorkControllerState, inputs: Inputs
    ) -> None:
        self._controller, self._state, self.inputs = controller, state, inputs
        self.slots, self.command = PythonSlots(), state.command
        record = controller.record(state, inputs, self.slots)
        self.slow = controller.slow
        self.box = drive_box(as_annotated(record))
        self.memory: int = address_of_box(self.box)
        self.address = address_of_kernel(drive_tick, self.box, inputs.box)

    def refer(self, reference: Reference) -> None:
        """Take the set points of the ticks that follow."""
        self.inputs.reference = reference
        take_reference(self._state.reference, reference)

    def ready(self, reference: Reference) -> bool:
        """False where a frame is asked for."""
        return not reference.scan

    def done(self, estimate: StateEstimate, reference: Reference, answer: int) -> Command:
        """Command of the last tick.

        Raises:
            ConfigurationError: the tool's target was no pose.
        """
        state = self._state
        self._controller.tool.checked(state.tool, answer)
        return Command(
            time=estimate.time,
            joint_torque=state.command.tau.copy(),
            thrusters=state.hull.thrusters,
            scan=reference.scan,
            contact=state.contact.estimate,
            hull_load=state.hull_load,
            believed=state.log,
        )


def in_contact(reference: Reference) -> bool:
    """True while the tool is to touch something."""
    return reference.set_force > 0.0 or reference.force_control


def _log(state: WorkControllerState) -> dict[str, Array]:
    """What nobody decides on, by name."""
    tool, excess = state.tool, state.contact.excess
    log = {
        "displacement": np.array([tool.k]),
        "compliance_W": np.array(tool.compliance.offset_W),
        "hover_wrench_B": state.hull.wanted_B,
        "q_wanted": tool.motion.q.copy(),
    }
    if not np.isnan(tool.motion.ik_error[0]):
        log["ik_error"] = tool.motion.ik_error.copy()
    return log if excess is None else log | {"arm_excess": excess}
