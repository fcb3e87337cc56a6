"""Disturbance observer of the hull: current, error of the thrusters' gain, and a steady force.

The hull's momentum is predicted from its inertia, the thrust, and the arm's wrench. The remaining
change of momentum is split by the signature of each cause. Per hull axis i, with v the velocity of
the hull and c that of the water:

    (v - c)' = (F_i (1 + g_i) + f_arm + f_static - l_i u - q_i |u| u + d_i) / M_i,    u = v - c
    c' = noise,   g_i' = small noise,   d_i' = small noise;    v is measured

One extended Kalman filter per axis estimates the states v, c, g, d. An accelerating flow carries a
neutrally buoyant body along as if the water stood still; therefore the left side is (v - c)'.

Observability: c and g differ because F changes with the push of the tool while c does not. The
measured contact force identifies the gain while it grows, and the current stays observable in
contact. c and d cannot be told apart while the hull keeps station; only the curvature of the drag
tells, in motion. Therefore d is assumed small, and a steady force appears as current. On an axis
without drag everything is d. The sum, which station keeping must compensate, is always observable.
The moment is a single disturbance, estimated by a Luenberger observer, since a uniform current
gives next to none.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uuv.controllers.tuning import ObserverDeviations
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class DisturbanceObserverState:
    """State of the observer; arrays change in place."""

    v_W: Array  # (3,) [m/s] of the hull
    current_W: Array  # (3,) [m/s] of the water
    gain: Array  # (3,) [-] share by which the thrust exceeds the believed one, hull axes
    offset_W: Array  # (3,) [N] steady force
    P: Array  # (3, 4, 4) covariance of v, c, g, d for each hull axis
    w_B: Array  # (3,) [rad/s] of the hull
    moment_B: Array  # (3,) [N m] disturbance moment, hull axes
    arm_B: Array  # (6,) [N, N m] of the arm on the hull, at the last step
    begun: bool = False


class DisturbanceObserver:
    """Observer of current, thruster gain, steady force and moment on one hull."""

    def __init__(
        self,
        inertia: Array,
        linear: Array,
        quadratic: Array,
        beliefs: ObserverDeviations | None = None,
    ) -> None:
        """Take inertia and drag of the hull, in hull axes at its origin.

        Args:
            inertia: (6, 6) rigid plus added inertia.
            linear: (6,) linear drag [N/(m/s), N m/(rad/s)].
            quadratic: (6,) quadratic drag [N/(m/s)^2, N m/(rad/s)^2].
            beliefs: assumed standard deviations; None takes the defaults.
        """
        self._beliefs = beliefs or ObserverDeviations()
        b = self._beliefs
        mass = inertia[:3, :3].copy()
        turning = inertia[3:, 3:].copy()

        self._hull = _Hull(
            mass=mass,
            inverse_mass=np.asarray(np.linalg.inv(mass), dtype=np.float64),
            lever=inertia[:3, 3:].copy(),
            turning=turning,
            inverse_turning=np.asarray(np.linalg.inv(turning), dtype=np.float64),
            linear=np.array(linear),
            quadratic=np.array(quadratic),
            noise=np.array([b.velocity_noise, b.current_walk, b.gain_walk, b.offset_walk]),
            moment_bandwidth=b.moment_bandwidth,
        )

        self._hull_fields = tuple(self._hull)

    def init(self) -> DisturbanceObserverState:
        """Initial state: no current and no disturbance, with the assumed initial variances."""
        b = self._beliefs
        m = self._hull.mass.diagonal()
        P = np.zeros((3, 4, 4))
        for i in range(3):
            P[i] = np.diag([b.velocity_noise**2, b.current**2, b.gain**2, (b.offset * m[i]) ** 2])
        return DisturbanceObserverState(
            np.zeros(3),
            np.zeros(3),
            np.zeros(3),
            np.zeros(3),
            P,
            np.zeros(3),
            np.zeros(3),
            np.zeros(6),
        )

    def step(
        self,
        state: DisturbanceObserverState,
        R_WB: Array,
        v_WB_B: Array,
        w_WB_B: Array,
        given_B: Array,
        arm_B: Array,
        static_B: Array,
        dt: float,
    ) -> None:
        """Update the estimates with the hull's velocity and the wrenches during the last `dt`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            R_WB: (3, 3) attitude of the hull.
            v_WB_B: (3,) [m/s] measured velocity of the hull, hull axes.
            w_WB_B: (3,) [rad/s] measured angular velocity of the hull, hull axes.
            given_B: (6,) [N, N m] mean wrench of the thrusters during `dt`, hull axes.
            arm_B: (6,) [N, N m] wrench of the arm on the hull now, hull axes.
            static_B: (6,) [N, N m] weight and buoyancy of the hull, hull axes.
            dt: [s] since the last step.
        """
        if not state.begun:
            state.v_W[:] = R_WB @ v_WB_B
            state.w_B[:] = w_WB_B
            state.begun = True
            state.arm_B[:] = arm_B
            return

        # Mean of the arm's wrench over the step
        other_B = 0.5 * (arm_B + state.arm_B) + static_B

        _observe(
            self._hull_fields,
            (R_WB, v_WB_B, w_WB_B),
            (given_B, other_B),
            dt,
            (
                state.v_W,
                state.current_W,
                state.gain,
                state.offset_W,
                state.P,
                state.w_B,
                state.moment_B,
            ),
        )

        state.arm_B[:] = arm_B

    def unknown(
        self, state: DisturbanceObserverState, R_WB: Array, v_WB_B: Array, given_B: Array
    ) -> Array:
        """Estimated disturbance wrench (6,) beside thrusters, arm, weight and buoyancy, hull axes.

        Args:
            state: of the observer.
            R_WB: (3, 3) attitude of the hull.
            v_WB_B: (3,) [m/s] velocity of the hull, hull axes; its angular velocity is taken as
                zero.
            given_B: (6,) [N, N m] wrench demanded of the thrusters, hull axes.

        Returns:
            The wrench (6,) [N, N m], hull axes at the hull's origin.
        """
        u = v_WB_B - R_WB.T @ state.current_W
        wrench = np.empty(6)
        wrench[:3] = R_WB.T @ state.offset_W + state.gain * given_B[:3]
        wrench[:3] -= (self._hull.linear[:3] + self._hull.quadratic[:3] * np.abs(u)) * u
        wrench[3:] = state.moment_B
        return wrench


class _Hull(NamedTuple):
    """Inertia and drag of the hull, and the assumed noise."""

    mass: Array  # (3, 3) [kg]
    inverse_mass: Array  # (3, 3)
    lever: Array  # (3, 3) [kg m] momentum of the turning
    turning: Array  # (3, 3) [kg m^2]
    inverse_turning: Array  # (3, 3)
    linear: Array  # (6,)
    quadratic: Array  # (6,)
    # (4,) standard deviations of velocity, and of the walks of current, gain and offset
    noise: Array
    moment_bandwidth: float  # [rad/s]


@kernel
def _observe(hull, seen, wrenches, dt, state):
    """Step of all filters.

    Args:
        hull: fields of `_Hull`, in a tuple.
        seen: attitude R_WB, and velocities v_B [m/s] and w_B [rad/s].
        wrenches: (6,) [N, N m] mean wrenches over the step, hull axes: of the thrusters, all others
            known.
        dt: [s] of the step.
        state: v_W, current_W, gain, offset_W, P, w_B and moment_B of `DisturbanceObserverState`;
            updated.
    """
    hull = _Hull(*hull)
    R_WB, v_B, w_WB_B = seen
    given_B, other_B = wrenches
    v_W, current_W, gain, offset_W, P, w_B, moment_B = state

    _observe_moving(
        hull, (R_WB, v_B, w_WB_B - w_B), given_B, other_B, dt, (v_W, current_W, gain, offset_W, P)
    )
    _observe_turning(hull, w_WB_B, given_B, other_B, dt, w_B, moment_B)


@kernel
def _observe_moving(hull, seen, given_B, other_B, dt, state):
    """Step of the four-state filters; `seen` ends with the change of angular velocity [rad/s]."""
    R_WB, v_B, turned = seen
    v_W, current_W, gain, offset_W, P = state
    mass = hull.mass
    inverse_mass = hull.inverse_mass
    lever = hull.lever
    numbers = hull.noise
    linear = hull.linear
    quadratic = hull.quadratic

    R_WB = R_WB.copy()
    R_BW = R_WB.T.copy()
    u = R_BW @ (v_W - current_W)
    offset = R_BW @ offset_W

    # Known forces, with drag against the moving water
    known = given_B[:3] * (1.0 + gain) + other_B[:3] + offset
    for i in range(3):
        known[i] -= (linear[i] + quadratic[i] * abs(u[i])) * u[i]

    # Momentum in world axes: rotation adds no further terms, except that of the lever.
    v_W += R_WB @ (inverse_mass @ (dt * known - lever @ turned))

    # Innovation
    error = v_B - R_BW @ v_W

    dv = np.empty(3)
    dc = np.empty(3)
    dd = np.empty(3)
    noise = numbers * numbers
    F = np.eye(4)
    K = np.empty(4)

    # One extended Kalman filter per hull axis
    for i in range(3):
        slope = (linear[i] + 2.0 * quadratic[i] * abs(u[i])) * dt / mass[i, i]
        F[0, 0] = 1.0 - slope
        F[0, 1] = slope
        F[0, 2] = given_B[i] * dt / mass[i, i]
        F[0, 3] = dt / mass[i, i]

        # Prediction: water that accelerates carries the hull along
        Pi = F @ P[i] @ F.T.copy()
        walk = noise[1] * dt
        Pi[0, 0] += walk
        Pi[0, 1] += walk
        Pi[1, 0] += walk
        Pi[1, 1] += walk
        Pi[2, 2] += noise[2] * dt
        Pi[3, 3] += noise[3] * mass[i, i] ** 2 * dt

        # Update by the measured velocity
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

    # Corrections in world axes
    v_W += R_WB @ dv
    current_W += R_WB @ dc
    offset_W += R_WB @ dd


@kernel
def _observe_turning(hull, w_WB_B, given_B, other_B, dt, w_B, moment_B):
    """Step of the moment observer: `w_B` tracks the measured rate, by the moment `moment_B`."""
    turning = hull.turning
    inverse_turning = hull.inverse_turning
    pace = hull.moment_bandwidth * dt
    linear = hull.linear[3:]
    quadratic = hull.quadratic[3:]
    spin = np.empty(3)
    net = np.empty(3)
    error = np.empty(3)

    # Net moment: drag and gyroscopic moment of the measured rate
    for i in range(3):
        spin[i] = turning[i, 0] * w_WB_B[0] + turning[i, 1] * w_WB_B[1] + turning[i, 2] * w_WB_B[2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        drag = (linear[i] + quadratic[i] * abs(w_WB_B[i])) * w_WB_B[i]
        gyroscopic = w_WB_B[j] * spin[k] - w_WB_B[k] * spin[j]
        net[i] = given_B[3 + i] + other_B[3 + i] + moment_B[i] - drag - gyroscopic

    # Predicted rate and its error
    for i in range(3):
        w_B[i] += dt * (
            inverse_turning[i, 0] * net[0]
            + inverse_turning[i, 1] * net[1]
            + inverse_turning[i, 2] * net[2]
        )
        error[i] = w_WB_B[i] - w_B[i]
        w_B[i] += min(1.0, 2.0 * pace) * error[i]

    # Moment that takes the error away
    for i in range(3):
        moment_B[i] += (
            pace**2
            / dt
            * (turning[i, 0] * error[0] + turning[i, 1] * error[1] + turning[i, 2] * error[2])
        )
