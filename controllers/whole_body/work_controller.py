"""Position-force controller of contact work: contact estimator, tool, joint servo and hull.

One step at the rate of the drives does the following [Konoplin 2022, section 3]: 1. Inverse
  dynamics give the joint torques without contact. The residual of the measured torques is the
  contact; J^T maps it to the force on the tool, without a force sensor
  (`uuv.controllers.estimation.tip_force_estimator`). 2. The tool's reference is displaced by the
  force error and corrected by the drift of the hull; MKPS gives the joint angles
  (`uuv.controllers.whole_body.tool_control`). 3. The drives get the inverse dynamics of the wanted
  motion, with the contact force (`uuv.controllers.arm.joint_servo`). 4. The thrusters get the arm's
  wrench on the hull, beside the closed loop of station keeping
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
from uuv.controllers.hull.feedforward import (
    CONTACT_B,
    FEEDFORWARD_VALUES,
    LEFT_OUT_B,
    WRENCH_B,
    ArmLoad,
    ArmWrench,
    Feedforward,
)
from uuv.controllers.hull.hull_control import HullControl, HullControlState
from uuv.controllers.hull.station_keeping import hull_inertia
from uuv.controllers.tuning import DRIVE_PERIOD, HULL, ArmTuning, ObserverDeviations
from uuv.controllers.whole_body.drive_tick import DriveGains, DriveRecord, drive_box, drive_tick
from uuv.controllers.whole_body.hull_step import HullStepRecord, LoggedStep
from uuv.controllers.whole_body.servo_bandwidth import slowed_down
from uuv.controllers.whole_body.tool_control import (
    DriftCorrection,
    ForceLaw,
    SideDisplacement,
    ToolControl,
    ToolControlState,
)
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels.control import BoundFields, Commanded, Inputs, Unsaved, commanded
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.kernels.slots import (
    PythonSlots,
    Slot,
    address_of_box,
    address_of_kernel,
    empty_slot,
    has_slot,
)
from uuv.sim.interfaces.messages import (
    Command,
    HeldLoad,
    HullLoad,
    JawReference,
    Reference,
    StateEstimate,
)
from uuv.sim.interfaces.records import (
    ReferenceRecord,
    estimate_record,
    reference_record,
    take_reference,
)
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class WorkControllerState:
    """State of the controller: the states of its components, and the arrays that they share.

    The arrays are bound at the first step, so write into them but do not replace them.
    """

    contact: ContactState
    tool: ToolControlState
    integral: Array  # (n,) [rad s] integral of the joint servo
    hull: HullControlState
    command: Commanded
    reference: ReferenceRecord
    softness: Array  # (1,) [-] share of the stiffness given up at present along the tool axis
    ticks: np.ndarray  # (1,) number of ticks so far
    logged: LoggedStep
    unloaded: Array  # numbers of the arm's model without what the jaws hold
    holds: HeldLoad | None = None  # that load, which is a part of the arm's model
    # Messages of the last step of the hull, with the number of that step: loads on the hull, and
    # quantities that are only logged
    reported_steps: int = 0
    hull_load: HullLoad | None = None
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
        """Compose the controller for its own model of the vehicle.

        Args:
            model: model of the controller, compiled.
            tuning: gains of the arm.
            estimator: estimator of the contact force; None: `TorqueSensors`.
            force_law: force loop along the tool axis; None: `ForceDisplacement`.
            compliance: displacement perpendicular to the tool axis; None: `LateralCompliance`.
            drift: correction of the tool for the hull's drift; None: `FromEstimate`.
            feedforward: feedforward of the arm's wrench to the thrusters; None: `ArmWrench`.
            water_error: [-] share by which added masses and drags are deliberately wrong.
        """
        self._vehicle = vehicle = Vehicle.of(model)
        self._arm = arm = ArmDynamics(model, water_error=water_error)
        tuning = tuning or ArmTuning()
        self.task_ticks = max(1, round(tuning.task_period / DRIVE_PERIOD))
        self.hull_ticks = max(1, round(tuning.hover_period / DRIVE_PERIOD))
        self._hull = HullControl(
            model, arm, period=self.hull_ticks * DRIVE_PERIOD, water_error=water_error
        )

        # The servo of the joints is slowed down where the hull is light for its arm.
        of_hull = hull_inertia(model, vehicle.hull, 1.0 + water_error)
        self.tuning = tuning = slowed_down(tuning, arm, of_hull, vehicle, DRIVE_PERIOD)
        self._torque_sensors = TorqueSensors(model, arm=arm, tuning=tuning)
        self.contact: ContactEstimator = estimator or self._torque_sensors
        self.tool = ToolControl(
            model, arm, tuning, force_law=force_law, compliance=compliance, drift=drift
        )

        # Components that are the same for all.
        self.servo = JointServo(self._vehicle, tuning, DRIVE_PERIOD)
        self._feedforward: Feedforward = feedforward or ArmWrench()

    @property
    def slow(self) -> tuple[str, ...]:
        """Components in plain Python that every tick calls."""
        parts = self.contact, self._feedforward
        slow = (type(part).__name__ for part in parts if not has_slot(part))
        return *slow, *self.tool.slow

    @property
    def tunings(self) -> tuple[Any, ...]:
        """The gains in use, for `uuv.controllers.tuning.table`."""
        return self.tuning, self.tool.force_law, self.tool.compliance, HULL, ObserverDeviations()

    def init(self, estimate: StateEstimate) -> WorkControllerState:
        """Initial state: the arm held at its present angles, thrusters off."""
        n = len(estimate.q)
        contact = self.contact.init(estimate)
        tool = self.tool.init(estimate)
        command = commanded(n, len(self._vehicle.thruster_names))
        felt = contact.record

        return WorkControllerState(
            contact=contact,
            tool=tool,
            integral=np.zeros(n),
            hull=self._hull.init(),
            command=command._replace(f_W=felt.f_W, felt=felt.felt, sigma_G=felt.sigma_G),
            reference=reference_record(n),
            softness=np.zeros(1),
            ticks=np.zeros(1, dtype=np.int64),
            unloaded=contact.arm.numbers.copy(),
            logged=LoggedStep(
                displacement=np.zeros(1),
                compliance_W=np.zeros(3),
                q_wanted=np.zeros(n),
                ik_error=tool.motion.ik_error.copy(),
            ),
        )

    def tick_on(self, state: WorkControllerState, inputs: Inputs) -> "WorkTick":
        """The tick of `state`, with the inputs `inputs`."""
        return WorkTick(self, state, inputs)

    def step(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference
    ) -> tuple[WorkControllerState, Command]:
        """One control step: contact force, tool motion, joint torques, and the thrusters if due.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
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

    def refer(self, state: WorkControllerState, reference: Reference) -> None:
        """Copy the set points of the following ticks into the arrays of `state`."""
        take_reference(state.reference, reference)
        self._hull.refer(state.hull, reference)
        if isinstance(reference, JawReference):
            state.contact.weigh(reference.jaws.weigh)
            self._bear(state, reference.jaws.holds)

    def _bear(self, state: WorkControllerState, load: HeldLoad | None) -> None:
        """Make what the jaws hold a part of the arm's model, in place of what they held before."""
        if load is state.holds:
            return
        numbers = state.contact.arm.numbers
        bare = state.unloaded
        if state.holds is None:
            bare[:] = numbers
        numbers[:] = bare if load is None else self._arm.with_load(bare, load)
        state.holds = load

    def reported(self, state: WorkControllerState) -> HullLoad | None:
        """Loads on the hull at its last step, the same message until the next step; None before the
        first step.

        Args:
            state: of `init`, after a step; the log of that step is also made.
        """
        command = state.command
        if state.reported_steps != command.hull_steps[0]:
            state.reported_steps = int(command.hull_steps[0])
            arm_wrench_B = command.arm_wrench_B.copy()
            current_W = command.current_W.copy()
            state.hull_load = HullLoad(arm_wrench_B=arm_wrench_B, current_W=current_W)
            state.log = _log(state)
        return state.hull_load

    def record(self, state: WorkControllerState, inputs: Inputs, slots: PythonSlots) -> DriveRecord:
        """The state in the form of the kernel.

        Args:
            state: of `init`.
            inputs: inputs of the ticks.
            slots: slots for components in plain Python.
        """
        contact = state.contact
        tuning = self.tuning
        estimator = self.contact

        # Gains.
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

        # Components in Python.
        def feel() -> None:
            tau = state.command.tau
            qd = state.tool.motion.qd
            drives = DriveState(tau=tau, qd_wanted=qd, current_W=state.command.current_W)
            estimator.step(contact, inputs.seen(), inputs.reference, drives)

        def weigh() -> None:
            feeling.weigh(contact, inputs.record, inputs.reference)

        # Record.
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
            hull=HullStepRecord(
                hull=self._hull.record(state.hull),
                feedforward=self._feedforward_slot(state, inputs, slots),
                log=state.logged,
            ),
            command=state.command,
            softness=state.softness,
            ticks=state.ticks,
        )

    def _feedforward_slot(
        self, state: WorkControllerState, inputs: Inputs, slots: PythonSlots
    ) -> Slot:
        part = self._feedforward
        if has_slot(part):
            return part.slot(None)
        values = np.zeros(FEEDFORWARD_VALUES)

        def leave_out() -> None:
            contact_B = values[CONTACT_B:WRENCH_B]
            wrench_B = values[WRENCH_B:LEFT_OUT_B]
            load = ArmLoad(contact_B=contact_B.copy(), wrench_B=wrench_B.copy())
            left_out_B = part.left_out(load, state.contact, inputs.seen())
            values[LEFT_OUT_B:] = 0.0 if left_out_B is None else left_out_B

        return Slot(slots.add(leave_out), np.zeros(0), values)


class WorkTick:
    """Tick of a `WorkController`, bound to the arrays of a state (`ControlTick`)."""

    def __init__(
        self, controller: WorkController, state: WorkControllerState, inputs: Inputs
    ) -> None:
        self._controller = controller
        self._state = state
        self.inputs = inputs
        self.slots = PythonSlots()
        self.command = state.command
        self.reference = state.reference
        record = controller.record(state, inputs, self.slots)
        self.slow = controller.slow
        self.box = drive_box(as_annotated(record))
        self.memory: int = address_of_box(self.box)
        self.address = address_of_kernel(drive_tick, self.box, inputs.box)
        self._bound = BoundFields(state, state.contact, state.tool, state.hull)

    def refer(self, reference: Reference) -> None:
        """Set the set points of the following ticks.

        Raises:
            ConfigurationError: an array of the state was replaced.
        """
        self._bound.check()
        self.inputs.reference = reference
        self._controller.refer(self._state, reference)

    def ready(self, reference: Reference) -> bool:
        """False if a frame is requested."""
        return not reference.scan

    def done(self, estimate: StateEstimate, reference: Reference, answer: int) -> Command:
        """Command of the last tick.

        Raises:
            ConfigurationError: the tool's target was not a pose.
        """
        state = self._state
        self._controller.tool.checked(state.tool, answer)
        load = self._controller.reported(state)
        return Command(
            time=estimate.time,
            joint_torque=state.command.tau.copy(),
            thrusters=state.command.thrusters.copy(),
            scan=reference.scan,
            contact=state.contact.estimate,
            hull_load=load,
            believed=state.log,
        )


def _log(state: WorkControllerState) -> dict[str, Array]:
    """Quantities that are only logged, by name."""
    logged = state.logged
    excess = state.contact.excess
    log = {
        "displacement": logged.displacement.copy(),
        "compliance_W": logged.compliance_W.copy(),
        "hover_wrench_B": state.hull.wanted_B.copy(),
        "q_wanted": logged.q_wanted.copy(),
    }

    if not np.isnan(logged.ik_error[0]):
        log["ik_error"] = logged.ik_error.copy()
    return log if excess is None else log | {"arm_excess": excess}
