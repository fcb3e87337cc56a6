"""Disturbance observer of the hull: current, error of the thrusters' gain, and a steady force.

The hull's momentum is predicted from its inertia, the thrust, and the arm's wrench. The remaining
change of momentum is split by the signature of each cause. Per hull axis i, with v the velocity of
the hull and c that of the water:

    (v - c)' = (F_i (1 + g_i) + f_arm + f_static - l_i u - q_i |u| u + d_i) / M_i,    u = v - c
    c' = noise,   g_i' = small noise,   d_i' = small noise;    v is measured

One extended Kalman filter per axis estimates the states v, c, g, d. A neutrally buoyant body in an
accelerating flow is accelerated with the flow; therefore the left side is (v - c)'.

Observability: c and g can be distinguished because F changes with the force of the tool while c
does not. The measured contact force identifies the gain while this force grows, and the current
stays observable in contact. c and d cannot be distinguished while the hull keeps station; only in
motion does the curvature of the drag distinguish them. Therefore d is assumed small, and a steady
force appears as current. On an axis without drag the whole disturbance is d. The sum, which station
keeping must compensate, is always observable. The moment is a single disturbance, estimated by a
Luenberger observer, since a uniform current causes almost no moment.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.tuning import ObserverDeviations
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array


class DisturbanceObserverState(NamedTuple):
    """State of the observer, as arrays that are changed in place."""

    v_W: Array  # (3,) [m/s] velocity of the hull
    current_W: Array  # (3,) [m/s] velocity of the water
    gain: Array  # (3,) [-] relative excess of the thrust over the modelled thrust, hull axes
    offset_W: Array  # (3,) [N] steady force
    P: Array  # (3, 4, 4) covariance of v, c, g, d for each hull axis
    w_B: Array  # (3,) [rad/s] angular velocity of the hull
    moment_B: Array  # (3,) [N m] disturbance moment, hull axes
    arm_B: Array  # (6,) [N, N m] wrench of the arm on the hull, at the last step
    begun: np.ndarray  # (1,) bool


class ObservedHull(NamedTuple):
    """Inertia and drag of the hull, and the assumed noise."""

    mass: Array  # (3, 3) [kg]
    inverse_mass: Array  # (3, 3)
    lever: Array  # (3, 3) [kg m] linear momentum due to rotation
    turning: Array  # (3, 3) [kg m^2]
    inverse_turning: Array  # (3, 3)
    linear: Array  # (6,)
    quadratic: Array  # (6,)
    # (4,) standard deviations of velocity, and of the walks of current, gain and offset
    noise: Array
    moment_bandwidth: float  # [rad/s] bandwidth of the moment observer


class DisturbanceObserver:
    """Observer of current, thruster gain, steady force and moment on one hull."""

    def __init__(
        self,
        inertia: Array,
        linear: Array,
        quadratic: Array,
        beliefs: ObserverDeviations | None = None,
    ) -> None:
        """Set inertia and drag of the hull, in hull axes at its origin.

        Args:
            inertia: (6, 6) rigid plus added inertia.
            linear: (6,) linear drag [N/(m/s), N m/(rad/s)].
            quadratic: (6,) quadratic drag [N/(m/s)^2, N m/(rad/s)^2].
            beliefs: assumed standard deviations; None: the defaults.
        """
        self._beliefs = beliefs or ObserverDeviations()
        b = self._beliefs

        mass = inertia[:3, :3].copy()
        turning = inertia[3:, 3:].copy()
        self.hull = ObservedHull(
            mass=mass,
            inverse_mass=np.asarray(np.linalg.inv(mass), dtype=np.float64),
            lever=inertia[:3, 3:].copy(),
            turning=turning,
            inverse_turning=np.asarray(np.linalg.inv(turning), dtype=np.float64),
            linear=np.array(linear),
            quadratic=np.array(quadratic),
            noise=np.array([b.velocity_noise, b.current_walk, b.gain_walk, b.offset_walk]),
            moment_bandwidth=float(b.moment_bandwidth),
        )

    def init(self) -> DisturbanceObserverState:
        """Initial state: no current and no disturbance, with the assumed initial variances."""
        b = self._beliefs

        m = self.hull.mass.diagonal()
        P = np.zeros((3, 4, 4))
        for i in range(3):
            P[i] = np.diag([b.velocity_noise**2, b.current**2, b.gain**2, (b.offset * m[i]) ** 2])

        return DisturbanceObserverState(
            v_W=np.zeros(3),
            current_W=np.zeros(3),
            gain=np.zeros(3),
            offset_W=np.zeros(3),
            P=P,
            w_B=np.zeros(3),
            moment_B=np.zeros(3),
            arm_B=np.zeros(6),
            begun=np.zeros(1, dtype=np.bool_),
        )


@kernel
def observe(hull, state, seen, wrenches, dt):
    """Update the estimates with the hull's velocity now and the wrenches of the last `dt`.

    Args:
        hull: `ObservedHull`.
        state: `DisturbanceObserverState`; updated.
        seen: attitude R_WB (3, 3), and measured velocities v_WB_B [m/s] and w_WB_B [rad/s].
        wrenches: (6,) [N, N m] each, hull axes: mean wrench of the thrusters during `dt`, present
            wrench of the arm, weight and buoyancy of the hull.
        dt: [s] since the last step.
    """
    R_WB, v_B, w_B = seen
    given_B, arm_B, static_B = wrenches

    # The first sample only initialises the state, since there is no interval before it.
    if not state.begun[0]:
        state.v_W[:] = R_WB @ v_B
        state.w_B[:] = w_B
        state.begun[0] = True
        state.arm_B[:] = arm_B
        return

    # Known wrench in addition to that of the thrusters; that of the arm is averaged over the
    # interval.
    other_B = 0.5 * (arm_B + state.arm_B) + static_B
    _observe_moving(hull, (R_WB, v_B, w_B - state.w_B), given_B, other_B, dt, state)
    _observe_turning(hull, w_B, given_B, other_B, dt, state)
    state.arm_B[:] = arm_B


@kernel
def unknown_wrench(hull, state, R_WB, v_B, given_B):
    """Disturbance wrench (6,) [N, N m], hull axes, in addition to thrusters, arm, weight and
    buoyancy.

    Args:
        hull: `ObservedHull`.
        state: `DisturbanceObserverState`.
        R_WB: (3, 3) attitude of the hull.
        v_B: (3,) [m/s] velocity of the hull, hull axes; its angular velocity is assumed to be zero.
        given_B: (6,) [N, N m] wrench demanded of the thrusters, hull axes.
    """
    flow_B = R_WB.T @ state.current_W
    offset_B = R_WB.T @ state.offset_W

    # Per axis: steady force, excess of the thrust, and drag in the current.
    wrench_B = np.empty(6)
    for i in range(3):
        u = v_B[i] - flow_B[i]
        drag = (hull.linear[i] + hull.quadratic[i] * abs(u)) * u
        wrench_B[i] = offset_B[i] + state.gain[i] * given_B[i] - drag
        wrench_B[3 + i] = state.moment_B[i]
    return wrench_B


@kernel
def _observe_moving(hull, seen, given_B, other_B, dt, state):
    """Step of the three filters; `seen[2]` (3,) [rad/s] is the change of the angular velocity."""
    R_WB, v_B, turned = seen
    v_W = state.v_W
    current_W = state.current_W
    gain = state.gain
    offset_W = state.offset_W
    P = state.P
    mass = hull.mass
    inverse_mass = hull.inverse_mass
    lever = hull.lever
    numbers = hull.noise
    linear = hull.linear
    quadratic = hull.quadratic

    # Known force.
    R_BW = R_WB.T.copy()
    u = R_BW @ (v_W - current_W)
    offset = R_BW @ offset_W
    known = given_B[:3] * (1.0 + gain) + other_B[:3] + offset
    for i in range(3):
        known[i] -= (linear[i] + quadratic[i] * abs(u[i])) * u[i]

    # Momentum in world axes, in which rotation adds no terms except that of the lever.
    v_W += R_WB @ (inverse_mass @ (dt * known - lever @ turned))
    error = v_B - R_BW @ v_W

    # One filter per axis: prediction, then correction by the velocity.
    dv = np.empty(3)
    dc = np.empty(3)
    dd = np.empty(3)
    noise = numbers * numbers
    F = np.eye(4)
    K = np.empty(4)
    for i in range(3):
        slope = (linear[i] + 2.0 * quadratic[i] * abs(u[i])) * dt / mass[i, i]
        F[0, 0] = 1.0 - slope
        F[0, 1] = slope
        F[0, 2] = given_B[i] * dt / mass[i, i]
        F[0, 3] = dt / mass[i, i]
        Pi = F @ P[i] @ F.T.copy()

        # Process noise: a change of the current also accelerates the hull, hence the covariance.
        walk = noise[1] * dt
        Pi[0, 0] += walk
        Pi[0, 1] += walk
        Pi[1, 0] += walk
        Pi[1, 1] += walk
        Pi[2, 2] += noise[2] * dt
        Pi[3, 3] += noise[3] * mass[i, i] ** 2 * dt

        s = Pi[0, 0] + noise[0]
        for j in range(4):
            K[j] = Pi[j, 0] / s
        for j in range(4):
            for k in range(4):
                P[i, j, k] = Pi[j, k] - K[j] * s * K[k]
        dv[i] = K[0] * error[i]
        dc[i] = K[1] * error[i]
        dd[i] = K[3] * error[i]
        gain[i] = min(max(gain[i] + K[2] * error[i], -0.5), 0.5)

    # Corrections, transformed to world axes.
    v_W += R_WB @ dv
    current_W += R_WB @ dc
    offset_W += R_WB @ dd


@kernel
def _observe_turning(hull, w_WB_B, given_B, other_B, dt, state):
    """Step of the moment observer, in which `w_B` tracks the measured rate and `moment_B` the
    disturbance.
    """
    w_B = state.w_B
    moment_B = state.moment_B
    turning = hull.turning
    inverse_turning = hull.inverse_turning
    pace = hull.moment_bandwidth * dt
    linear = hull.linear[3:]
    quadratic = hull.quadratic[3:]

    # Angular momentum at the measured rate.
    spin = np.empty(3)
    net = np.empty(3)
    error = np.empty(3)
    for i in range(3):
        spin[i] = turning[i, 0] * w_WB_B[0] + turning[i, 1] * w_WB_B[1] + turning[i, 2] * w_WB_B[2]

    # Net moment, gyroscopic term included.
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        drag = (linear[i] + quadratic[i] * abs(w_WB_B[i])) * w_WB_B[i]
        gyroscopic = w_WB_B[j] * spin[k] - w_WB_B[k] * spin[j]
        net[i] = given_B[3 + i] + other_B[3 + i] + moment_B[i] - drag - gyroscopic

    # Predicted rate, corrected by the measured one.
    for i in range(3):
        w_B[i] += dt * (
            inverse_turning[i, 0] * net[0]
            + inverse_turning[i, 1] * net[1]
            + inverse_turning[i, 2] * net[2]
        )
        error[i] = w_WB_B[i] - w_B[i]
        w_B[i] += min(1.0, 2.0 * pace) * error[i]

    # The disturbance integrates the remaining error; the gains place both poles at the bandwidth.
    for i in range(3):
        moment_B[i] += (
            pace**2
            / dt
            * (turning[i, 0] * error[0] + turning[i, 1] * error[1] + turning[i, 2] * error[2])
        )
