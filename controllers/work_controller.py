"""The controller of contact work: arm drives and thrusters together, from estimates and references.

In one step, at the rate of the drives (paper 002, third section):
  1. the arm's inverse dynamics give the torques without contact; what the sensors show beyond them is the contact,
     and J^T turned round gives the force on the tool, without a force sensor;
  2. the tool's reference is corrected twice: by the displacement k along the tool axis from the force error, and for
     the drift of the hull, p*_C = R^T (p*_O - r); MKPS gives the joint angles;
  3. the drives get the inverse dynamics of the wanted motion, the felt contact included;
  4. the thrusters get the arm's wrench on the hull, beside the closed loop of the hover.
"""

from collections.abc import Set
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np

from controllers.allocation import Allocation
from controllers.arm_dynamics import ArmDynamics
from controllers.force_estimate import Tare, tip_force
from controllers.hover import Hover, HoverState
from controllers.mkps import Chain, solve
from controllers.position_force import Displacement, DisplacementState
from models.vehicle import ARM_BASE_BODY, TIP_SITE, Vehicle
from sim.interfaces.messages import Command, Reference, StateEstimate
from sim.interfaces.spatial import Array, exp_so3, inverse

Method = Literal["compensation", "drift-correction", "force-control"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Gains of the arm's side; the hover has its own (`controllers.hover`)."""

    joint_frequency: float = 25.0  # [rad/s] of the joint servo
    joint_damping: float = 1.0
    joint_integral_time: float = 0.25  # [s]; takes up friction at the tool and what the model lacks
    force_filter: float = 0.012  # [s] first-order filter of the felt force
    contact_feedforward: float = 1.0  # share of the felt force that the drives bear at once
    torque_noise: float = 0.01  # share of the reading, as the sensors' makers state it
    torque_floor: float = 0.1  # [N m]
    hover_period: float = 0.02  # [s]
    task_period: float = 0.004  # [s] of IK and force loop
    joint_speed_limit: float = 0.8  # [rad/s]
    integral_limit: float = 0.01  # [rad s] either way
    nominal_stiffness: float = 3e4  # [N/m] of the pad, for pressing without force control


@dataclass(slots=True, eq=False)
class WorkControllerState:
    """Everything that the controller remembers."""

    hover: HoverState
    displacement: DisplacementState
    tare: Tare
    bias: Array  # (n,) [N m]
    tick: int
    q_wanted: Array  # (n,) [rad] at the last task step
    qd_wanted: Array  # (n,) [rad/s]
    qdd: Array  # (n,) [rad/s^2] last wanted acceleration, filtered: stands for the true one in the model
    integral: Array  # (n,) [rad s]
    f_tip_B: Array  # (3,) [N] felt force of the world on the tip, hull axes
    arm_wrench_B: Array  # (6,)
    thrusters: Array  # (m,)
    wrench_wanted_B: Array  # (6,)
    believed: dict[str, Array] = field(default_factory=dict)


class WorkController:
    """Position-force controller of a hovering vehicle with an arm (`sim.interfaces.protocols.Controller`)."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        period: float = 0.002,
        without: Set[Method] = frozenset(),
        tuning: Tuning | None = None,
        displacement: Displacement | None = None,
        water_error: float = 0.0,
    ) -> None:
        """Take the controller's own model of the vehicle (not the plant's).

        `without` names methods to leave out, for ablation; `water_error` makes the controller's hydrodynamic
        coefficients wrong by that share.
        """
        self.period = period
        self._tuning = tuning or Tuning()
        self._displacement = displacement or Displacement()
        self._without = frozenset(without)
        self._vehicle = vehicle = Vehicle.of(model)
        self._arm = ArmDynamics(model, water_error=water_error)
        passive = [
            model.joint(j).name for j in range(model.njnt) if j not in vehicle.joints and model.jnt_type[j] != 0
        ]
        self._chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=passive)
        self._X_BA = np.array(vehicle.X_BA)
        self._X_AB = inverse(self._X_BA)
        self._hover = Hover(model, self._arm)
        self._allocation = Allocation(vehicle)
        self._task_ticks = max(1, round(self._tuning.task_period / period))
        self._hover_ticks = max(1, round(self._tuning.hover_period / period))
        self._rest = np.zeros(vehicle.joints.size)
        self._home_wrench = self._wrench_at_rest(np.array(vehicle.q_home))

    def init(self, estimate: StateEstimate) -> WorkControllerState:
        n = self._vehicle.joints.size
        return WorkControllerState(
            hover=self._hover.init(),
            displacement=DisplacementState(),
            tare=Tare(np.zeros(n)),
            bias=np.zeros(n),
            tick=0,
            q_wanted=np.array(estimate.q),
            qd_wanted=np.zeros(n),
            qdd=np.zeros(n),
            integral=np.zeros(n),
            f_tip_B=np.zeros(3),
            arm_wrench_B=np.zeros(6),
            thrusters=np.zeros(self._vehicle.thruster_actuators.size),
            wrench_wanted_B=np.zeros(6),
        )

    def step(self, state: WorkControllerState, estimate: StateEstimate, reference: Reference) -> tuple[WorkControllerState, Command]:
        tuning, vehicle, dt = self._tuning, self._vehicle, self.period
        R_WB = estimate.X_WB[:3, :3]
        hull = {
            "R_WB": R_WB,
            "nu_B": np.concatenate([estimate.v_WB_B, estimate.w_WB_B]),
            "a_B": np.concatenate([estimate.a_WB_B, np.zeros(3)]),
            "v_current_W": np.zeros(3),
        }
        X_AG, J_A = self._chain.kinematics(estimate.q)
        R_BG = self._X_BA[:3, :3] @ X_AG[:3, :3]

        # 1. Contact from torques: what the sensors lack against the model is borne by the world.
        tau_model, wrench_free_B = self._arm.inverse(estimate.q, estimate.qd, state.qdd, wrench_tip_G=np.zeros(6), **hull)
        tau_e = tau_model - estimate.tau
        if reference.tare:
            state.tare.add(tau_e)
            state.bias = state.tare.bias()
        sigma = tuning.torque_floor + tuning.torque_noise * np.abs(estimate.tau)
        J_B = self._X_BA[:3, :3] @ J_A[:3]
        f_B, _ = tip_force(tau_e - state.bias, J_B, sigma)
        state.f_tip_B += min(1.0, dt / tuning.force_filter) * (f_B - state.f_tip_B)
        f_tip_G = R_BG.T @ state.f_tip_B
        felt = -float(f_tip_G[2])  # the tool presses along its z axis; the world pushes back

        # 2. Where the tool should be, in the arm's base frame.
        if state.tick % self._task_ticks == 0:
            self._task(state, estimate, reference, J_A, felt)

        # 3. Drives.
        wanted = state.q_wanted + (state.tick % self._task_ticks) * dt * state.qd_wanted
        servo = tuning.joint_frequency
        state.integral += dt * (wanted - estimate.q)
        np.clip(state.integral, -tuning.integral_limit, tuning.integral_limit, out=state.integral)
        qdd = (
            servo**2 * (wanted - estimate.q)
            + 2.0 * tuning.joint_damping * servo * (state.qd_wanted - estimate.qd)
            + servo**2 / tuning.joint_integral_time * state.integral
        )
        in_contact = reference.force > 0.0 or reference.force_control
        borne_G = np.zeros(6)
        if in_contact:
            borne_G[:3] = tuning.contact_feedforward * f_tip_G
        tau, _ = self._arm.inverse(estimate.q, estimate.qd, qdd, wrench_tip_G=borne_G, **hull)
        tau += vehicle.armature * qdd + vehicle.joint_damping * estimate.qd
        np.clip(tau, -vehicle.torque_limits, vehicle.torque_limits, out=tau)
        state.qdd += min(1.0, dt / 0.02) * (qdd - state.qdd)

        # 4. Thrusters.
        if state.tick % self._hover_ticks == 0:
            state.arm_wrench_B = wrench_free_B.copy()
            if in_contact:
                state.arm_wrench_B[:3] += state.f_tip_B
                state.arm_wrench_B[3:] += np.cross(self._X_BA[:3, 3] + self._X_BA[:3, :3] @ X_AG[:3, 3], state.f_tip_B)
            fed = self._home_wrench if "compensation" in self._without else state.arm_wrench_B
            state.wrench_wanted_B = self._hover.step(
                state.hover, estimate, reference.X_WB, reference.v_WB_W, fed, self._hover_ticks * dt
            )
            state.thrusters = self._allocation.command(self._allocation.thrust(state.wrench_wanted_B))
            state.believed = {
                "arm_wrench_B": state.arm_wrench_B,
                "hover_wrench_B": state.wrench_wanted_B,
                "q_wanted": state.q_wanted,
            }
        state.tick += 1
        believed = {
            **state.believed,
            "f_tip_W": R_WB @ state.f_tip_B,
            "felt_normal": np.array([felt]),
            "displacement": np.array([state.displacement.k]),
        }
        return state, Command(
            time=estimate.time, joint_torque=tau, thrusters=state.thrusters, scan=reference.scan, believed=believed
        )

    def _task(
        self, state: WorkControllerState, estimate: StateEstimate, reference: Reference, J_A: Array, felt: float
    ) -> None:
        """Joint angles and speeds wanted now, from the tool's reference corrected twice."""
        tuning, dt = self._tuning, self._tuning.task_period
        since = estimate.time - reference.time
        if reference.X_WG is None:
            self._displacement.release(state.displacement, dt)
            state.q_wanted, state.qd_wanted = reference.q + since * reference.qd, reference.qd
            return
        if not reference.force_control:
            k = self._displacement.release(state.displacement, dt)
        elif "force-control" in self._without:
            # Ablation: press by a depth computed from the pad's nominal stiffness, and hope.
            k = state.displacement.k = reference.force / tuning.nominal_stiffness
        else:
            k = self._displacement.step(state.displacement, reference.force - felt, dt)
        R_WG = exp_so3(since * reference.w_WG_W) @ reference.X_WG[:3, :3]
        X_WG = np.eye(4)
        X_WG[:3, :3] = R_WG
        X_WG[:3, 3] = reference.X_WG[:3, 3] + since * reference.v_WG_W + k * R_WG[:, 2]
        # Re-aiming, p*_C = R^T (p*_O - r): the tool stays on the object while the hull drifts (paper 002).
        X_WB = reference.X_WB if "drift-correction" in self._without else estimate.X_WB
        X_AG = self._X_AB @ inverse(X_WB) @ X_WG
        result = solve(self._chain, X_AG, state.q_wanted, 1e-6, 1e-5, branch="keep")
        most = tuning.joint_speed_limit * dt
        step = np.clip(result.q - state.q_wanted, -most, most)
        state.q_wanted = state.q_wanted + step
        state.believed["ik_error"] = np.array([result.position_error, result.orientation_error])
        # Speed of the tool against the hull, in the arm's base axes, and J^-1 damped near singular postures.
        R_WA = X_WB[:3, :3] @ self._X_BA[:3, :3]
        v_W, w_W = reference.v_WG_W, reference.w_WG_W
        if "drift-correction" not in self._without:
            w_hull_W = X_WB[:3, :3] @ estimate.w_WB_B
            arm_W = X_WG[:3, 3] - X_WB[:3, 3]
            v_W = v_W - X_WB[:3, :3] @ estimate.v_WB_B - np.cross(w_hull_W, arm_W)
            w_W = w_W - w_hull_W
        twist_A = np.concatenate([v_W @ R_WA, w_W @ R_WA])
        qd = J_A.T @ np.linalg.solve(J_A @ J_A.T + 1e-6 * np.eye(6), twist_A)
        state.qd_wanted = np.clip(qd, -tuning.joint_speed_limit, tuning.joint_speed_limit)

    def _wrench_at_rest(self, q: Array) -> Array:
        """Wrench (6,) of the arm on the hull, both still and level."""
        rest = np.zeros(q.size)
        return self._arm.inverse(
            q, rest, rest, R_WB=np.eye(3), nu_B=np.zeros(6), a_B=np.zeros(6), v_current_W=np.zeros(3),
            wrench_tip_G=np.zeros(6),
        )[1]  # fmt: skip

