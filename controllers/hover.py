"""Hover of the hull: a closed position loop beside the fed-forward wrench of the arm (paper 002, third stage)."""

from dataclasses import dataclass

import mujoco
import numpy as np

from controllers.arm_dynamics import ArmDynamics
from models import hydrodynamics
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import StateEstimate
from sim.interfaces.spatial import Array, checked, log_so3, skew


@dataclass(slots=True, eq=False)
class HoverState:
    """Memory of the loop."""

    integral: Array  # (6,) [N, N m] steady disturbance found so far: force in W, moment in hull axes
    lacking_B: Array  # (6,) [N, N m] what the thrusters could not give of the last wrench, hull axes


class Hover:
    """PID on the hull's pose in six directions, with the hull's own weight and buoyancy fed forward."""

    def __init__(
        self,
        model: mujoco.MjModel,
        arm: ArmDynamics | None = None,
        *,
        frequency: float = 1.6,
        damping: float = 1.0,
        integral_time: float = 6.0,
        water_error: float = 0.0,
    ) -> None:
        """Read the hull of the vehicle in `model`; `arm` adds its inertia as it is in the home pose.

        `arm` is read from `model` too where it is not given, and may be missing there: a vehicle without an arm hovers.
        `frequency` [rad/s] and `damping` ratio of the closed loop; `integral_time` [s] within which a steady
        disturbance is taken up; `water_error` makes the hull's added mass wrong by that share. Raises
        ConfigurationError for a figure that cannot be, or if the hull carries no hydrodynamics.
        """
        for name, value in (("frequency", frequency), ("damping", damping), ("integral_time", integral_time)):
            if not checked([value], (1,), f"hover {name}")[0] > 0.0:
                raise ConfigurationError(f"hover {name}: must be > 0, got {value}")
        checked([water_error], (1,), "hover water_error")
        vehicle = Vehicle.of(model)
        if not hydrodynamics.carries(model.body_user[vehicle.hull]):
            raise ConfigurationError("the hull has no hydrodynamics: call models.hydrodynamics.attach on its spec")
        self.inertia = _hull_inertia(model, vehicle.hull, 1.0 + water_error)  # (6, 6)
        if arm is None and float(model.body_subtreemass[vehicle.hull]) > float(model.body_mass[vehicle.hull]):
            arm = ArmDynamics(model, water_error=water_error)
        if arm is not None:
            self.inertia += _arm_inertia(arm, vehicle.q_home)
        self._stiffness = frequency**2
        self._damping = 2.0 * damping * frequency
        self._integral = frequency**2 / integral_time
        gravity = -float(model.opt.gravity[2])
        mass, density = float(model.body_mass[vehicle.hull]), hydrodynamics.water_density(model)
        water = hydrodynamics.unpack(model.body_user[vehicle.hull])
        self._drag = (1.0 + water_error) * np.array(
            [water.linear_damping.diagonal()[:3], water.quadratic_damping[:3]]
        )  # (2, 3) [N s/m], [N s^2/m^2]
        self._net = gravity * (density * water.volume - mass)  # [N] up
        # Moment of weight and buoyancy is this vector x (up, in hull axes).
        self._righting = gravity * (
            density * water.volume * water.center_of_buoyancy - mass * np.array(model.body_ipos[vehicle.hull])
        )

    def init(self) -> HoverState:
        return HoverState(np.zeros(6), np.zeros(6))

    def static_wrench(self, R_WB: Array) -> Array:
        """Weight and buoyancy of the hull alone (6,), hull axes [N, N m]."""
        up_B = R_WB[2]
        return np.concatenate([self._net * up_B, skew(self._righting) @ up_B])

    def current(self, state: HoverState, estimate: StateEstimate) -> Array:
        """Current (3,) [m/s] in W that explains the steady force found so far as the hull's drag, axis by axis.

        Good where the hull has hovered free of contact for some seconds: what else the model lacks (a thruster's gain
        while it bears a push) is taken for drag as well. A direction without drag tells of no current.
        """
        R_WB = estimate.X_WB[:3, :3]
        borne_B = R_WB.T @ state.integral[:3]
        linear, quadratic = self._drag
        # The root of quadratic u^2 + linear u = |borne|, in the form that holds without a quadratic part.
        divisor = linear + np.sqrt(linear**2 + 4.0 * quadratic * np.abs(borne_B))
        through_B = np.divide(2.0 * borne_B, divisor, out=np.zeros(3), where=divisor > 0.0)
        return R_WB @ (estimate.v_WB_B - through_B)

    def step(
        self, state: HoverState, estimate: StateEstimate, X_WB_wanted: Array, v_WB_W_wanted: Array, arm_wrench_B: Array,
        dt: float,
    ) -> Array:  # fmt: skip
        """Wrench (6,) that the thrusters should put on the hull, hull axes [N, N m].

        `arm_wrench_B` (6,) is what the arm puts on the hull, to be cancelled (the paper's C_F_M, C_M_M). Where
        `state.lacking_B` says that the last wrench was not given in full, the integral does not grow that way.
        """
        R_WB = estimate.X_WB[:3, :3]
        p_error = X_WB_wanted[:3, 3] - estimate.X_WB[:3, 3]
        turn_error = log_so3(R_WB.T @ X_WB_wanted[:3, :3])
        v_error = R_WB.T @ v_WB_W_wanted - estimate.v_WB_B
        acceleration = np.concatenate(
            [
                self._stiffness * (R_WB.T @ p_error) + self._damping * v_error,
                self._stiffness * turn_error - self._damping * estimate.w_WB_B,
            ]
        )
        growth = dt * self._integral * self.inertia.diagonal() * np.concatenate([R_WB.T @ p_error, turn_error])
        growth[growth * state.lacking_B > 0.0] = 0.0
        state.integral[:3] += R_WB @ growth[:3]
        state.integral[3:] += growth[3:]
        wrench = self.inertia @ acceleration - self.static_wrench(R_WB) - arm_wrench_B
        wrench[:3] += R_WB.T @ state.integral[:3]
        wrench[3:] += state.integral[3:]
        return wrench


def _hull_inertia(model: mujoco.MjModel, hull: int, water_scale: float) -> Array:
    """Rigid and added inertia (6, 6) of the hull alone at its origin."""
    water = hydrodynamics.unpack(model.body_user[hull])
    m, c = float(model.body_mass[hull]), np.array(model.body_ipos[hull])
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.body_iquat[hull])
    principal = R.reshape(3, 3)
    S = skew(c)
    rigid = np.zeros((6, 6))
    rigid[:3, :3] = m * np.eye(3)
    rigid[:3, 3:], rigid[3:, :3] = -m * S, m * S
    rigid[3:, 3:] = principal @ np.diag(model.body_inertia[hull]) @ principal.T - m * S @ S
    return rigid + water_scale * water.added_mass


def _arm_inertia(arm: ArmDynamics, q: Array) -> Array:
    """Inertia (6, 6) that the arm, held at `q`, adds to the hull: the wrench that unit accelerations cost."""
    rest = np.zeros(arm.n)

    def wrench(a_B: Array) -> Array:
        return arm.inverse(
            q, rest, rest, R_WB=np.eye(3), nu_B=np.zeros(6), a_B=a_B, v_current_W=np.zeros(3), wrench_tip_G=np.zeros(6)
        )[1]

    still = wrench(np.zeros(6))
    return np.column_stack([still - wrench(unit) for unit in np.eye(6)])
