"""Station keeping by feedback on the hull's pose and feedforward; stage 3 of [Konoplin 2022].

    wrench = M (frequency^2 e + 2 damping frequency rate) - static - arm - unknown
    e = (R_WB^T (p_wanted - p), log(R_WB^T R_wanted))
    rate = (R_WB^T v_wanted - v_B, R_WB^T w_wanted - w_B)

All quantities are in hull axes, wrenches at the hull's origin. M is the inertia of hull and arm
with added mass, with the arm in its home posture. Proportional and rate feedback act on the pose.
Weight, buoyancy and the arm's wrench are fed forward. A disturbance observer
(`uuv.controllers.estimation.disturbance_observer`) estimates the remaining wrench, mainly current
drag, and cancels it. The observer replaces an integral term. It uses the thrust actually given, so
saturation causes no windup.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.estimation.disturbance_observer import (
    DisturbanceObserver,
    DisturbanceObserverState,
    ObservedHull,
    observe,
    unknown_wrench,
)
from uuv.controllers.tuning import HULL, ObserverDeviations
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.rotations import log_of_rotation
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, checked, readonly, skew

_STILL = readonly(np.zeros(3))


class StationKeepingState(NamedTuple):
    """State of station keeping, as arrays that are changed in place."""

    observer: DisturbanceObserverState
    # (6,) [N, N m] mean wrench of the thrusters since the last step; the demand, unless overwritten
    given_B: Array


class StationGains(NamedTuple):
    """Constants of station keeping."""

    stiffness: float  # [1/s^2]
    damping: float  # [1/s]
    # (6, 6) [kg, kg m, kg m^2] inertia including the arm, hull axes at the hull's origin
    inertia: Array
    # (6, 3) matrix that gives weight and buoyancy when multiplied by the unit vector up in hull
    # axes
    static: Array
    hull: ObservedHull  # number of thrusters, or inertia, without the arm


class MeasuredMotion(NamedTuple):
    """Estimated motion of the hull."""

    X_WB: Array  # (4, 4) pose
    v_B: Array  # (3,) [m/s] velocity, hull axes
    w_B: Array  # (3,) [rad/s] angular velocity, hull axes


class HullTarget(NamedTuple):
    """Desired motion of the hull."""

    X_WB: Array  # (4, 4) pose
    v_W: Array  # (3,) [m/s] its velocity, W
    w_W: Array  # (3,) [rad/s] its angular velocity, W


@kernel
def keep_station(gains, state, motion, target, arm_B, dt):
    """Wrench (6,) [N, N m] that the thrusters should put on the hull, hull axes at its origin.

    Args:
        gains: `StationGains`.
        state: `StationKeepingState`; updated; the demand is stored as the wrench given.
        motion: present `MeasuredMotion`.
        target: `HullTarget`.
        arm_B: (6,) [N, N m] wrench of the arm on the hull, hull axes, to be cancelled.
        dt: [s] since the last step.
    """
    R_WB = motion.X_WB[:3, :3].copy()
    static_B = gains.static @ R_WB[2]
    wrenches = state.given_B, arm_B, static_B
    observe(gains.hull, state.observer, (R_WB, motion.v_B, motion.w_B), wrenches, dt)

    # Feedback.
    p_error_B = R_WB.T @ (target.X_WB[:3, 3] - motion.X_WB[:3, 3])
    turn_error_B = log_of_rotation(R_WB.T @ target.X_WB[:3, :3].copy())
    v_wanted_B = R_WB.T @ target.v_W
    w_wanted_B = R_WB.T @ target.w_W
    acceleration = np.empty(6)
    for i in range(3):
        v_error = v_wanted_B[i] - motion.v_B[i]
        w_error = w_wanted_B[i] - motion.w_B[i]
        acceleration[i] = gains.stiffness * p_error_B[i] + gains.damping * v_error
        acceleration[3 + i] = gains.stiffness * turn_error_B[i] + gains.damping * w_error

    # Feedforward.
    unknown_B = unknown_wrench(gains.hull, state.observer, R_WB, v_wanted_B, state.given_B)
    wrench_B = gains.inertia @ acceleration - static_B - arm_B - unknown_B
    state.given_B[:] = wrench_B
    return wrench_B


@kernel
def through_water(state, motion):
    """Velocity of the hull relative to the water (6,) [m/s, rad/s], hull axes.

    Args:
        state: `StationKeepingState`.
        motion: present `MeasuredMotion`.
    """
    flow_B = motion.X_WB[:3, :3].copy().T @ state.observer.current_W
    nu_B = np.empty(6)
    for i in range(3):
        nu_B[i] = motion.v_B[i] - flow_B[i]
        nu_B[3 + i] = motion.w_B[i]
    return nu_B


class StationKeeping:
    """Pose control of the hull in six degrees of freedom with feedforward of all known wrenches."""

    def __init__(
        self,
        model: mujoco.MjModel,
        arm: ArmDynamics | None = None,
        *,
        frequency: float | None = None,
        damping: float = HULL.damping,
        water_error: float = 0.0,
        beliefs: ObserverDeviations | None = None,
    ) -> None:
        """Read the hull of the vehicle in `model`, and the inertia of its arm in the home pose.

        Args:
            model: compiled model of the vehicle, with hydrodynamics on its hull.
            arm: modelled dynamics of the arm; None: read from `model`, in which the vehicle may
                have no arm.
            frequency: [rad/s] natural frequency of the closed loop; None: that of the tuning,
                scaled up by Froude's law for a vehicle smaller than the one on which it was tuned.
            damping: [-] damping ratio of the closed loop.
            water_error: [-] share by which added mass and drag of the hull are deliberately wrong.
            beliefs: standard deviations assumed by the disturbance observer.

        Raises:
            ConfigurationError: a figure is out of range, or the hull has no hydrodynamics.
        """
        if frequency is None:
            frequency = HULL.frequency * quickness(model)
        for name, value in (("frequency", frequency), ("damping", damping)):
            if not checked([value], (1,), f"hover {name}")[0] > 0.0:
                raise ConfigurationError(f"hover {name}: must be > 0, got {value}")
        checked([water_error], (1,), "hover water_error")

        # Inertia, with the arm in its home posture.
        vehicle = Vehicle.of(model)
        if not hydrodynamics.carries(model.body_user[vehicle.hull]):
            raise ConfigurationError(
                "the hull has no hydrodynamics: call uuv.models.hydrodynamics.attach on its spec"
            )
        of_hull = hull_inertia(model, vehicle.hull, 1.0 + water_error)
        inertia = of_hull.copy()
        if arm is None and float(model.body_subtreemass[vehicle.hull]) > float(
            model.body_mass[vehicle.hull]
        ):
            arm = ArmDynamics(model, water_error=water_error)
        if arm is not None:
            inertia += arm_inertia(arm, vehicle.q_home)

        # Drag of the hull.
        water = hydrodynamics.without_forms(
            model.body_user[vehicle.hull], "station keeping's model of the hull"
        )
        self._observer = DisturbanceObserver(
            of_hull,
            (1.0 + water_error) * water.linear_damping.diagonal(),
            (1.0 + water_error) * water.quadratic_damping,
            beliefs,
        )
        self.gains = StationGains(
            stiffness=float(frequency**2),
            damping=float(2.0 * damping * frequency),
            inertia=inertia,
            static=_static(model, vehicle.hull),
            hull=self._observer.hull,
        )

    @property
    def inertia(self) -> Array:
        """Inertia (6, 6) of `StationGains`, as the kernel uses it."""
        return self.gains.inertia

    def init(self) -> StationKeepingState:
        """Initial state, with no estimate of the current and no thrust."""
        return StationKeepingState(self._observer.init(), np.zeros(6))

    def static_wrench(self, R_WB: Array) -> Array:
        """Weight and buoyancy (6,) [N, N m] of the hull alone at `R_WB` (3, 3), in hull axes."""
        return self.gains.static @ R_WB[2]

    def current(self, state: StationKeepingState) -> Array:
        """Estimated current (3,) [m/s] in W, also during contact.

        See `uuv.controllers.estimation.disturbance_observer` for the assumptions. A steady force
        that no sensor measures (a tether, a wrong weight) appears as current. A direction without
        drag gives no information on the current.
        """
        return state.observer.current_W.copy()

    def through_water(self, state: StationKeepingState, estimate: StateEstimate) -> Array:
        """Velocity of the hull relative to the water (6,) [m/s, rad/s], hull axes."""
        return through_water(state, motion_of(estimate))

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
        """Wrench (6,) [N, N m] that the thrusters should put on the hull, hull axes.

        The wrench is also stored in `state.given_B`. A caller that knows the wrench of the
        thrusters until the next step more accurately writes it there.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: the vehicle's state now.
            X_WB_wanted: (4, 4) hull pose wanted.
            v_WB_W_wanted: (3,) [m/s] velocity of the pose wanted, W.
            arm_wrench_B: (6,) [N, N m] wrench of the arm on the hull, hull axes, to be cancelled:
                C_F_M, C_M_M of [Konoplin 2022].
            dt: [s] since the last step.
            w_WB_W_wanted: (3,) [rad/s] angular velocity of the pose wanted, W.

        Returns:
            The wrench (6,) [N, N m], hull axes at the hull's origin.
        """
        parts = (np.array(part) for part in (X_WB_wanted, v_WB_W_wanted, w_WB_W_wanted))
        target = HullTarget(*parts)
        arm_B = np.array(arm_wrench_B)
        return keep_station(self.gains, state, motion_of(estimate), target, arm_B, float(dt))


def motion_of(estimate: StateEstimate) -> MeasuredMotion:
    """Motion of the hull from an estimate, as copies."""
    e = estimate
    return MeasuredMotion(np.array(e.X_WB), np.array(e.v_WB_B), np.array(e.w_WB_B))


def _static(model: mujoco.MjModel, hull: int) -> Array:
    """Weight and buoyancy of the hull (6, 3), as in `StationGains`."""
    gravity = -float(model.opt.gravity[2])
    mass = float(model.body_mass[hull])
    water = hydrodynamics.unpack(model.body_user[hull])
    displaced = hydrodynamics.water_density(model) * water.volume
    net = gravity * (displaced - mass)  # [N] up

    # Moment of weight and buoyancy = righting x (unit vector up, hull axes).
    righting = gravity * (
        displaced * water.center_of_buoyancy - mass * np.array(model.body_ipos[hull])
    )
    return np.vstack([net * np.eye(3), skew(righting)])


def quickness(model: mujoco.MjModel) -> float:
    """Ratio [-] of the frequencies of the vehicle in `model` to those of the vehicle on which
    `HULL` was tuned; at least 1.

    By Froude's law it is the square root of the ratio of lengths, which are cube roots of the
    displaced volumes.
    """
    wet = [
        hydrodynamics.unpack(row).volume
        for row in model.body_user[1:]
        if hydrodynamics.carries(row)
    ]
    length = sum(wet) ** (1.0 / 3.0)
    return max(1.0, float(np.sqrt(HULL.length / length))) if length > 0.0 else 1.0


def hull_inertia(model: mujoco.MjModel, hull: int, water_scale: float) -> Array:
    """Rigid-body plus added inertia (6, 6) of the hull alone at its origin, hull axes.

    Args:
        model: compiled model of the vehicle.
        hull: id of the hull's body in `model`.
        water_scale: [-] factor on the added mass, 1 for the model's own.

    Returns:
        The inertia (6, 6) [kg, kg m, kg m^2], linear over angular.
    """
    water = hydrodynamics.unpack(model.body_user[hull])
    m = float(model.body_mass[hull])
    c = np.array(model.body_ipos[hull])
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.body_iquat[hull])
    principal = R.reshape(3, 3)
    S = skew(c)
    rigid = np.zeros((6, 6))
    rigid[:3, :3] = m * np.eye(3)
    rigid[:3, 3:] = -m * S
    rigid[3:, :3] = m * S
    rigid[3:, 3:] = principal @ np.diag(model.body_inertia[hull]) @ principal.T - m * S @ S
    return rigid + water_scale * water.added_mass


def arm_inertia(arm: ArmDynamics, q: Array) -> Array:
    """Inertia (6, 6) that the arm, held at `q` (n,) [rad], adds, computed as the wrenches of unit
    accelerations.
    """
    rest = np.zeros(arm.n)

    def wrench(a_B: Array) -> Array:
        return arm.inverse(
            q,
            rest,
            rest,
            R_WB=np.eye(3),
            nu_B=np.zeros(6),
            a_B=a_B,
            v_current_W=np.zeros(3),
            wrench_tip_G=np.zeros(6),
        )[1]

    still = wrench(np.zeros(6))
    return np.column_stack([still - wrench(unit) for unit in np.eye(6)])
