"""Tool control: force loop, lateral compliance, drift correction and inverse kinematics give the joints' motion.

Two corrections of the tool's reference [Konoplin 2022, section 3]: a displacement k along the tool axis from the force
error, and the drift of the hull, p*_C = R^T (p*_O - r). MKPS gives the joint angles.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np

from uuv.controllers.arm.compliance import LateralCompliance
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.position_force import ForceDisplacement
from uuv.controllers.arm.tool_motion import ToolMotion, ToolTracking, hold_joints, track_tool
from uuv.controllers.estimation.tip_force_estimator import ContactState, SensedArm
from uuv.controllers.mkps import Chain, solve
from uuv.controllers.tuning import ArmTuning
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array, inverse


class ForceLaw(Protocol):
    """Displacement k [m] of the tool along its axis, positive into the surface, for a set and an estimated force."""

    @property
    def closed_loop(self) -> bool:
        """True if the estimated force is controlled; the servo is then softer along the tool axis."""
        ...

    def init(self) -> Any:
        """Initial state: no displacement."""
        ...

    def step(self, state: Any, set_force: float, felt: float, servo_compliance: float, dt: float) -> float:
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
        """Displacement [m] on its way back to zero; `inwards=False` keeps a negative one."""
        ...


class SideDisplacement(Protocol):
    """Displacement of the tool across its axis, for an estimated force."""

    def init(self) -> Any:
        """Initial state: no displacement; its `offset_W` (3,) [m] is the present one."""
        ...

    def acts(self, reference: Reference) -> bool:
        """True while the loop is closed under `reference`."""
        ...

    def step(self, state: Any, f_tip_W: Array, z_WG: Array, dt: float, *, gently: bool = False) -> Array:
        """Displacement (3,) [m], W, with the loop closed.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            f_tip_W: (3,) [N] force of the world on the tip, W.
            z_WG: (3,) unit tool axis, W.
            dt: [s] since the last step.
            gently: the tool stands on a surface, whose friction it is to unload slowly.
        """
        ...

    def release(self, state: Any, dt: float) -> Array:
        """Displacement (3,) [m], W, on its way back to zero."""
        ...


class DriftCorrection(Protocol):
    """Hull pose by which the arm places the tool."""

    @property
    def follows_hull(self) -> bool:
        """True if the joints compensate the hull's velocity and acceleration too."""
        ...

    def hull_pose(self, estimate: StateEstimate, reference: Reference) -> Array:
        """Hull pose X_WB (4, 4)."""
        ...


class FromEstimate:
    """The tool stays where it is asked to be while the hull drifts."""

    follows_hull = True

    def hull_pose(self, estimate: StateEstimate, reference: Reference) -> Array:
        """Estimated hull pose X_WB (4, 4)."""
        return estimate.X_WB


class FromReference:
    """The tool drifts with the hull: no drift correction."""

    follows_hull = False

    def hull_pose(self, estimate: StateEstimate, reference: Reference) -> Array:
        """Hull pose wanted X_WB (4, 4)."""
        return reference.X_WB


@dataclass(slots=True, eq=False)
class ToolControlState:
    """State of tool control."""

    force: Any  # of the force law
    compliance: Any  # of the displacement across the tool axis
    k: float  # [m] displacement along the tool axis
    motion: ToolMotion
    servo_compliance: float = 0.0  # [m/N] of the tip along the tool axis
    tick: int = 0


class ToolControl:
    """Joint motion wanted, from the reference of tool or joints."""

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
            model: believed model, compiled.
            arm: its arm's dynamics.
            tuning: gains of the arm.
            force_law: force loop along the tool axis; None: `ForceDisplacement`.
            compliance: displacement across the tool axis; None: `LateralCompliance`.
            drift: drift correction; None: `FromEstimate`.
        """
        vehicle = Vehicle.of(model)
        self.force_law: ForceLaw = force_law or ForceDisplacement()
        self.compliance: SideDisplacement = compliance or LateralCompliance()
        self.drift: DriftCorrection = drift or FromEstimate()
        self._arm, self._tuning = arm, tuning
        passive = [model.joint(j).name for j in range(model.njnt) if j not in vehicle.joints and model.jnt_type[j] != 0]
        self._chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=passive)
        X_AB = inverse(np.array(vehicle.X_BA))
        self.tracking = ToolTracking.of(X_AB, vehicle.joints.size, tuning, follows_hull=self.drift.follows_hull)
        self._tracking_fields = tuple(self.tracking)
        self._armature = np.array(vehicle.armature)
        self.compliance_ticks = max(1, round(tuning.compliance_period / tuning.task_period))

    def init(self, estimate: StateEstimate) -> ToolControlState:
        """Initial state: the arm held where it is."""
        return ToolControlState(
            force=self.force_law.init(),
            compliance=self.compliance.init(),
            k=0.0,
            motion=ToolMotion.start(estimate.q, self._chain.memory()),
        )

    def presses(self, reference: Reference) -> bool:
        """True while the force loop is closed."""
        return reference.force_control and self.force_law.closed_loop

    def step(
        self, state: ToolControlState, estimate: StateEstimate, reference: Reference, contact: ContactState
    ) -> None:
        """Leave the joint angles and speeds wanted in `state`, once in a task period.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: tool pose or joint angles, set force and mode.
            contact: estimated force, and motion of arm and hull.
        """
        since = estimate.time - reference.time
        if reference.X_WG is None:
            dt = self._tuning.task_period
            state.k = self.force_law.release(state.force, dt)
            self.compliance.release(state.compliance, dt)
            hold_joints(tuple(state.motion), reference.q, reference.qd, since)
        else:
            self._follow(state, estimate, reference, contact, reference.X_WG, since)
        state.tick += 1

    def _follow(
        self,
        state: ToolControlState,
        estimate: StateEstimate,
        reference: Reference,
        contact: ContactState,
        X_WG: Array,
        since: float,
    ) -> None:
        """Follow the tool pose `X_WG` (4, 4), wanted `since` [s] ago, after both corrections."""
        dt, force = self._tuning.task_period, contact.estimate
        if reference.force_control:
            servo_compliance = self._servo_compliance(state, estimate, contact.sensed)
            state.k = self.force_law.step(state.force, reference.set_force, force.normal, servo_compliance, dt)
        else:
            state.k = self.force_law.release(state.force, dt, inwards=False)
        if self.compliance.acts(reference):
            how = {"gently": True} if reference.standing else {}
            offset_W = self.compliance.step(state.compliance, force.force_W, X_WG[:3, 2], dt, **how)
        else:
            offset_W = self.compliance.release(state.compliance, dt)
        solved, X_AG = track_tool(
            self._tracking_fields,
            tuple(state.motion),
            (X_WG, np.array(reference.v_WG_W), np.array(reference.w_WG_W)),  # read-only ones would be compiled anew
            since,
            (state.k, offset_W),
            self.drift.hull_pose(estimate, reference),
            contact.sensed.hull,
            (contact.sensed.X_BG, contact.sensed.J_B),
        )
        if not solved:
            solve(self._chain, X_AG, state.motion.q)  # raises and says why

    def _servo_compliance(self, state: ToolControlState, estimate: StateEstimate, sensed: SensedArm) -> float:
        """Compliance [m/N] of the servoed arm at the tip along the tool axis."""
        if state.servo_compliance == 0.0 or state.tick % self.compliance_ticks == 0:
            inertia = self._arm.inertia(estimate.q) + np.diag(self._armature)
            along = sensed.J_B[:3].T @ sensed.X_BG[:3, 2]
            state.servo_compliance = float(along @ np.linalg.solve(inertia, along)) / (
                self._tuning.joint_frequency**2 * (1.0 - self._tuning.normal_softness)
            )
        return state.servo_compliance
