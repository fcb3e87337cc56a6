"""Hover of the hull: a closed position loop beside the fed-forward wrench of the arm (paper 002, third stage).

Proportional and rate feedback on the pose; weight, buoyancy and the arm's wrench fed forward; and what an observer of
the hull's momentum (`controllers.estimation.disturbance_observer`) finds beyond those, current drag above all,
cancelled as it is found. It stands where an integral would, and knows what the thrusters really gave: nothing winds up
where they run out.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.estimation.disturbance_observer import Beliefs, DisturbanceObserver, DisturbanceObserverState
from models import hydrodynamics
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import StateEstimate
from sim.interfaces.spatial import Array, checked, log_so3, readonly, skew

_STILL = readonly(np.zeros(3))


@dataclass(slots=True, eq=False)
class StationKeepingState:
    """Memory of the loop."""

    observer: DisturbanceObserverState
    given_B: Array  # (6,) [N, N m] what the thrusters gave in the mean since the last step; as wanted, unless told


class StationKeeping:
    """Feedback on the hull's pose in six directions, with all that is known of the wrench on it fed forward."""

    def __init__(
        self,
        model: mujoco.MjModel,
        arm: ArmDynamics | None = None,
        *,
        frequency: float = 1.6,
        damping: float = 1.0,
        water_error: float = 0.0,
        beliefs: Beliefs | None = None,
    ) -> None:
        """Read the hull of the vehicle in `model`; `arm` adds its inertia as it is in the home pose.

        `arm` is read from `model` too where it is not given, and may be missing there: a vehicle without an arm hovers.
        `frequency` [rad/s] and `damping` ratio of the closed loop; `water_error` makes the hull's added mass and drag
        wrong by that share; `beliefs` are the observer's. Raises ConfigurationError for a figure that cannot be, or if
        the hull carries no hydrodynamics.
        """
        for name, value in (("frequency", frequency), ("damping", damping)):
            if not checked([value], (1,), f"hover {name}")[0] > 0.0:
                raise ConfigurationError(f"hover {name}: must be > 0, got {value}")
        checked([water_error], (1,), "hover water_error")
        vehicle = Vehicle.of(model)
        if not hydrodynamics.carries(model.body_user[vehicle.hull]):
            raise ConfigurationError("the hull has no hydrodynamics: call models.hydrodynamics.attach on its spec")
        own = hull_inertia(model, vehicle.hull, 1.0 + water_error)
        self.inertia = own.copy()  # (6, 6)
        if arm is None and float(model.body_subtreemass[vehicle.hull]) > float(model.body_mass[vehicle.hull]):
            arm = ArmDynamics(model, water_error=water_error)
        if arm is not None:
            self.inertia += _arm_inertia(arm, vehicle.q_home)
        self._stiffness = frequency**2
        self._damping = 2.0 * damping * frequency
        gravity = -float(model.opt.gravity[2])
        mass, density = float(model.body_mass[vehicle.hull]), hydrodynamics.water_density(model)
        water = hydrodynamics.unpack(model.body_user[vehicle.hull])
        self._observer = DisturbanceObserver(
            own,
            (1.0 + water_error) * water.linear_damping.diagonal(),
            (1.0 + water_error) * water.quadratic_damping,
            beliefs,
        )
        net = gravity * (density * water.volume - mass)  # [N] up
        # Moment of weight and buoyancy is this vector x (up, in hull axes).
        righting = gravity * (
            density * water.volume * water.center_of_buoyancy - mass * np.array(model.body_ipos[vehicle.hull])
        )
        self._static = np.vstack([net * np.eye(3), skew(righting)])  # (6, 3), times up in hull axes

    def init(self) -> StationKeepingState:
        return StationKeepingState(self._observer.init(), np.zeros(6))

    def static_wrench(self, R_WB: Array) -> Array:
        """Weight and buoyancy of the hull alone (6,), hull axes [N, N m]."""
        return self._static @ R_WB[2]

    def current(self, state: StationKeepingState) -> Array:
        """Current (3,) [m/s] in W that explains what pushes the hull, in contact too.

        What is believed of it says `controllers.estimation.disturbance_observer`; a steady force that nobody feels, a
        tether's or a wrong weight's, passes for current. A direction without drag tells of none.
        """
        return state.observer.current_W.copy()

    def through_water(self, state: StationKeepingState, estimate: StateEstimate) -> Array:
        """Motion of the hull through the water (6,) [m/s, rad/s], hull axes."""
        through = estimate.v_WB_B - estimate.X_WB[:3, :3].T @ state.observer.current_W
        return np.concatenate([through, estimate.w_WB_B])

    def step(
        self,
        state: StationKeepingState,
        estimate: StateEstimate,
        X_WB_wanted: Array,
        v_WB_W_wanted: Array,
        arm_wrench_B: Array,
        dt: float,
        w_WB_W_wanted: Array = _STILL,
    ) -> Array:
        """Wrench (6,) that the thrusters should put on the hull, hull axes [N, N m].

        `v_WB_W_wanted` (3,) [m/s] and `w_WB_W_wanted` (3,) [rad/s] are the motion of the pose wanted.
        `arm_wrench_B` (6,) is what the arm puts on the hull, to be cancelled (the paper's C_F_M, C_M_M). Who knows
        better than "as wanted" what the thrusters will give until the next step says so in `state.given_B`.
        """
        R_WB, v_B, w_B = estimate.X_WB[:3, :3], estimate.v_WB_B, estimate.w_WB_B
        static = self.static_wrench(R_WB)
        self._observer.step(state.observer, R_WB, v_B, w_B, state.given_B, arm_wrench_B, static, dt)
        p_error = X_WB_wanted[:3, 3] - estimate.X_WB[:3, 3]
        turn_error = log_so3(R_WB.T @ X_WB_wanted[:3, :3])
        acceleration = np.concatenate(
            [
                self._stiffness * (R_WB.T @ p_error) + self._damping * (R_WB.T @ v_WB_W_wanted - v_B),
                self._stiffness * turn_error + self._damping * (R_WB.T @ w_WB_W_wanted - w_B),
            ]
        )
        unknown = self._observer.unknown(state.observer, R_WB, R_WB.T @ v_WB_W_wanted, state.given_B)
        wrench = self.inertia @ acceleration - static - arm_wrench_B - unknown
        state.given_B = wrench
        return wrench


def hull_inertia(model: mujoco.MjModel, hull: int, water_scale: float) -> Array:
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
