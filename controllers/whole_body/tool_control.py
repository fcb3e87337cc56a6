"""Tool control: motion of the joints from force loop, compliance, drift correction and kinematics.

The tool's reference has two corrections [Konoplin 2022, section 3]: a displacement k along the tool
axis from the force error, and the drift of the hull, p*_C = R^T (p*_O - r). MKPS gives the joint
angles.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol, runtime_checkable

import mujoco
import numpy as np
from numba.np.numpy_support import carray

from uuv.controllers.arm import compliance, position_force
from uuv.controllers.arm.compliance import OFFSET, LateralCompliance
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.position_force import ANSWER, CLOSED, INWARDS, WHOLE, ForceDisplacement
from uuv.controllers.arm.tool_motion import ToolMotion, ToolTracking
from uuv.controllers.estimation.tip_force_estimator import ContactState
from uuv.controllers.estimation.tip_force_kernels import SensedArm
from uuv.controllers.ik.tracking import passing_memory
from uuv.controllers.mkps import Chain, solve
from uuv.controllers.tuning import ArmTuning
from uuv.controllers.whole_body.tool_tick import (
    DRIFT_VALUES,
    HELD,
    NUMBERS,
    PLACED,
    SERVO_COMPLIANCE,
    K,
    ToolGains,
    ToolRecord,
    ToolWork,
    tool_box,
    tool_tick,
)
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels.control import NO_POSE, BoundFields, Inputs, Unsaved
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.kernels.slots import (
    FINE,
    PythonSlots,
    Slot,
    empty_slot,
    has_slot,
    slot_function,
)
from uuv.sim.interfaces.messages import Reference, StateEstimate
from uuv.sim.interfaces.records import (
    EstimateRecord,
    estimate_record,
    reference_record,
    take_reference,
)
from uuv.sim.interfaces.spatial import Array, inverse


class ForceLaw(Protocol):
    """Displacement k [m] of the tool along its axis, positive inwards, from set and measured
    force.
    """

    @property
    def closed_loop(self) -> bool:
        """True if the estimated force is controlled; the servo is then softer along the axis."""
        ...

    def init(self) -> Any:
        """Initial state: no displacement."""
        ...

    def step(
        self, state: Any, set_force: float, felt: float, servo_compliance: float, dt: float
    ) -> float:
        """Displacement [m] while the force is controlled.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            set_force: [N] normal force to press with.
            felt: [N] estimated normal force.
            servo_compliance: [m/N] of the arm's servo along the tool axis.
            dt: [s] since the last step.
        """
        ...

    def release(self, state: Any, dt: float, *, inwards: bool = True) -> float:
        """Displacement [m] while it returns to zero; `inwards=False` keeps a negative
        displacement.
        """
        ...


@runtime_checkable
class WholeForceLaw(ForceLaw, Protocol):
    """Force law that takes the whole force, friction included, in place of the normal part."""

    def step_whole(self, state: Any, set_force: float, f_tip_W: Array, dt: float) -> float:
        """Displacement [m] while the force is controlled.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            set_force: [N] normal force to press with.
            f_tip_W: (3,) [N] estimated force of the world on the tip, W.
            dt: [s] since the last step.
        """
        ...


class SideDisplacement(Protocol):
    """Displacement of the tool perpendicular to its axis, from an estimated force."""

    def init(self) -> Any:
        """Initial state: no displacement; the state's `offset_W` (3,) [m] is the present
        displacement.
        """
        ...

    def acts(self, reference: Reference) -> bool:
        """True while the loop is closed under `reference`."""
        ...

    def step(
        self, state: Any, f_tip_W: Array, z_WG: Array, dt: float, *, gently: bool = False
    ) -> Array:
        """Displacement (3,) [m], W, with the loop closed.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            f_tip_W: (3,) [N] force of the world on the tip, W.
            z_WG: (3,) unit tool axis, W.
            dt: [s] since the last step.
            gently: True: the tool is at rest on a surface, and has to unload friction slowly.
        """
        ...

    def release(self, state: Any, dt: float) -> Array:
        """Displacement (3,) [m], W, while it returns to zero."""
        ...


class DriftCorrection(Protocol):
    """Hull pose from which the arm places the tool."""

    @property
    def follows_hull(self) -> bool:
        """True if the joints also compensate the hull's velocity and acceleration."""
        ...

    def hull_pose(self, estimate: StateEstimate, reference: Reference) -> Array:
        """Hull pose X_WB (4, 4)."""
        ...


class FromEstimate:
    """The tool stays at its reference while the hull drifts."""

    follows_hull = True

    def hull_pose(self, estimate: StateEstimate, reference: Reference) -> Array:
        """Estimated hull pose X_WB (4, 4)."""
        return estimate.X_WB

    def slot(self, state: None) -> Slot:
        """The choice is contained in the tick."""
        return empty_slot(state, DRIFT_VALUES)


class FromReference:
    """The tool drifts with the hull: no drift correction."""

    follows_hull = False

    def hull_pose(self, estimate: StateEstimate, reference: Reference) -> Array:
        """Desired hull pose X_WB (4, 4)."""
        return reference.X_WB

    def slot(self, state: None) -> Slot:
        """The choice as a kernel."""
        return Slot(_held_pose().address, np.zeros(0), np.zeros(DRIFT_VALUES))


@cache
def _held_pose() -> Any:
    def choose(_memory: Any, values: Any) -> int:
        poses = carray(values, DRIFT_VALUES)
        poses[PLACED:] = poses[HELD:PLACED]
        return FINE

    return slot_function(choose)


@dataclass(slots=True, eq=False)
class ToolControlState:
    """State of tool control, as arrays that are changed in place."""

    force: Any  # state of the force law
    compliance: Any  # state of the displacement perpendicular to the tool axis
    motion: ToolMotion
    # (4, 4) last tool pose reference, in the arm's base; numbers of `ToolRecord`
    X_AG: Array = field(default_factory=lambda: np.eye(4))
    numbers: Array = field(default_factory=lambda: np.zeros(NUMBERS))
    ticks: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    alone: Unsaved["ToolTick"] = field(default_factory=Unsaved)  # tick of `ToolControl.step`

    @property
    def k(self) -> float:
        """Displacement [m] along the tool axis."""
        return float(self.numbers[K])


class ToolControl:
    """Desired joint motion, from the reference of tool or joints."""

    def __init__(
        self,
        model: mujoco.MjModel,
        arm: ArmDynamics,
        tuning: ArmTuning,
        *,
        force_law: ForceLaw | None = None,
        compliance: SideDisplacement | None = None,
        drift: DriftCorrection | None = None,
    ) -> None:
        """Set up for the arm of the vehicle in `model`.

        Args:
            model: model of the controller, compiled.
            arm: dynamics of the arm.
            tuning: gains of the arm.
            force_law: force loop along the tool axis; None: `ForceDisplacement`.
            compliance: displacement perpendicular to the tool axis; None: `LateralCompliance`.
            drift: drift correction; None: `FromEstimate`.
        """
        vehicle = Vehicle.of(model)
        self.force_law: ForceLaw = force_law or ForceDisplacement()
        self.compliance: SideDisplacement = compliance or LateralCompliance()
        self.drift: DriftCorrection = drift or FromEstimate()
        self._arm = arm
        self._tuning = tuning

        passive = [
            model.joint(j).name
            for j in range(model.njnt)
            if j not in vehicle.joints and model.jnt_type[j] != 0
        ]
        self._chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=passive)

        X_AB = inverse(np.array(vehicle.X_BA))
        self.tracking = ToolTracking.of(
            X_AB,
            vehicle.joints.size,
            1.0 / self._chain._scale,
            tuning,
            follows_hull=self.drift.follows_hull,
        )
        self._armature = np.array(vehicle.armature)
        self.compliance_ticks = max(1, round(tuning.compliance_period / tuning.task_period))

    def init(self, estimate: StateEstimate) -> ToolControlState:
        """Initial state: the arm held at its present angles."""
        return ToolControlState(
            force=self.force_law.init(),
            compliance=self.compliance.init(),
            motion=ToolMotion.start(estimate.q, self._chain.memory(), passing_memory(self._chain)),
        )

    @property
    def slow(self) -> tuple[str, ...]:
        """Components in plain Python."""
        parts = self.force_law, self.compliance, self.drift
        return tuple(type(part).__name__ for part in parts if not has_slot(part))

    def record(
        self, state: ToolControlState, inputs: Inputs, slots: PythonSlots, sensed: SensedArm
    ) -> ToolRecord:
        """The state in the form of the kernel.

        Args:
            state: of `init`.
            inputs: inputs of the ticks.
            slots: slots for components in plain Python.
            sensed: motion of the arm.
        """
        law: Any = self.force_law if has_slot(self.force_law) else ForceDisplacement()
        yielding: Any = self.compliance if has_slot(self.compliance) else LateralCompliance()

        gains = ToolGains(
            self.tracking,
            getattr(law, "gains", ForceDisplacement().gains),
            getattr(yielding, "gains", LateralCompliance().gains),
            self.compliance_ticks,
        )

        stiffness = slots.add(lambda: self._find_servo_compliance(state, inputs.record, sensed))
        return ToolRecord(
            gains=gains,
            force=self._force_slot(state, slots),
            side=self._side_slot(state, inputs, slots),
            drift=self._drift_slot(inputs, slots),
            stiffness=empty_slot()._replace(address=stiffness),
            motion=state.motion,
            X_AG=state.X_AG,
            numbers=state.numbers,
            ticks=state.ticks,
        )

    def step(
        self,
        state: ToolControlState,
        estimate: StateEstimate,
        reference: Reference,
        contact: ContactState,
    ) -> None:
        """Compute the desired joint angles and speeds once per task period; they are stored in
        `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: tool pose or joint angles, set force and mode.
            contact: estimated force, and motion of arm and hull.
        """
        tick = state.alone.get(lambda: ToolTick(self, state, contact))
        tick.bound.check()
        tick.inputs.take(estimate)
        tick.inputs.reference = reference
        take_reference(tick.reference, reference)

        self.checked(state, tick.slots.check(tool_tick(tick.box, tick.inputs.box)))

    def checked(self, state: ToolControlState, answer: int) -> int:
        """The return value of a tick; an error if the tick's target was not a pose.

        Raises:
            ConfigurationError: the target was not a pose.
        """
        if answer == NO_POSE:
            solve(self._chain, state.X_AG, state.motion.q)  # raises, with the reason
        return answer

    def _force_slot(self, state: ToolControlState, slots: PythonSlots) -> Slot:
        law = self.force_law
        if has_slot(law):
            return law.slot(state.force)
        values = np.zeros(position_force.VALUES)

        def displace() -> None:
            asked, felt, soft, dt, loop = values[:ANSWER].tolist()
            if loop == CLOSED and isinstance(law, WholeForceLaw):
                f_tip_W = values[WHOLE:].copy()
                values[ANSWER] = law.step_whole(state.force, asked, f_tip_W, dt)
            elif loop == CLOSED:
                values[ANSWER] = law.step(state.force, asked, felt, soft, dt)
            else:
                values[ANSWER] = law.release(state.force, dt, inwards=loop == INWARDS)

        return Slot(slots.add(displace), np.zeros(0), values)

    def _side_slot(self, state: ToolControlState, inputs: Inputs, slots: PythonSlots) -> Slot:
        part = self.compliance
        if has_slot(part):
            return part.slot(state.compliance)
        values = np.zeros(compliance.VALUES)

        def displace() -> None:
            reference = inputs.reference
            dt = values.item(compliance.DT)
            if reference.X_WG is not None and part.acts(reference):
                f_W = values[compliance.FORCE : compliance.AXIS].copy()
                z_WG = reference.X_WG[:3, 2]
                how = {"gently": True} if reference.standing else {}
                values[OFFSET:] = part.step(state.compliance, f_W, z_WG, dt, **how)
            else:
                values[OFFSET:] = part.release(state.compliance, dt)

        return Slot(slots.add(displace), np.zeros(0), values)

    def _drift_slot(self, inputs: Inputs, slots: PythonSlots) -> Slot:
        drift = self.drift
        if has_slot(drift):
            return drift.slot(None)
        values = np.zeros(DRIFT_VALUES)

        def place() -> None:
            values[PLACED:] = np.ravel(drift.hull_pose(inputs.seen(), inputs.reference))

        return Slot(slots.add(place), np.zeros(0), values)

    def _find_servo_compliance(
        self, state: ToolControlState, seen: EstimateRecord, sensed: SensedArm
    ) -> None:
        """Compute the compliance [m/N] of the servoed tip along the tool axis, and store it in
        `state`.
        """
        inertia = self._arm.inertia(seen.q) + np.diag(self._armature)
        along = sensed.J_B[:3].T @ sensed.X_BG[:3, 2]

        state.numbers[SERVO_COMPLIANCE] = float(along @ np.linalg.solve(inertia, along)) / (
            self._tuning.joint_frequency**2 * (1.0 - self._tuning.normal_softness)
        )


class ToolTick:
    """Tick of tool control alone, bound to the arrays of a state."""

    def __init__(
        self, control: ToolControl, state: ToolControlState, contact: ContactState
    ) -> None:
        n = len(state.motion.q)
        self.bound = BoundFields(state, contact)
        self.inputs = Inputs(estimate_record(n))
        self.slots = PythonSlots()
        self.reference = reference_record(n)
        tool = control.record(state, self.inputs, self.slots, contact.sensed)
        self.box: Any = tool_box(as_annotated(ToolWork(tool, contact.record, self.reference)))
