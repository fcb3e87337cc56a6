"""Load observer for external joint torques from momentum, without accelerations or torque sensors.

The hull moves freely. T is the kinetic energy of rigid bodies and water (added mass included), and
p = dT/dqd. Lagrange's equation of joint j is

    dp/dt = tau + dT/dq - g(q) - d(q, qd, nu) - friction + tau_e,

where p and T depend on the hull's velocity nu, but no acceleration of the hull appears. The right
side is integrated without tau_e and compared with the measured p. The residual r = K (p - integral
of (right side + r)) follows tau_e with a first-order lag 1/K [DeLuca 2003], here applied to a
moving base. A steady current is a change of frame: the arm's equations are unchanged in a frame
that drifts with the water.

Let s_j be the axis of the joint, h_j the momentum of all bodies that it carries and v_j the twist
of its body, six-vectors at the joint. Then p_j = s_j . h_j, and dT/dq_j = h_j . (v_j x s_j): a
rotation of a joint rotates the twists of all bodies beyond it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from uuv.controllers.arm.arm_tree import HINGE
from uuv.controllers.arm.believed_friction import dry_friction, dry_friction_sigma
from uuv.controllers.arm.inverse_dynamics import (
    ArmDynamics,
    ArmParameters,
    JointMotion,
    newton_euler,
    workspace,
)
from uuv.controllers.estimation.tip_force_estimator import ContactState, DriveState, TorqueResidual
from uuv.controllers.estimation.tip_force_kernels import force_from_external_torques, force_sigma
from uuv.controllers.tuning import DRIVE_PERIOD, ArmTuning
from uuv.models.arms.gear_friction import DryFriction
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import ContactEstimate, Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array, fitting

# [rad/s] width of the sign change of dry friction: five times the noise of the encoders' speed
SMOOTHING = 1e-3


class GearModel(NamedTuple):
    """Gear model of the controller: rotor inertia and friction, (n,) each."""

    armature: Array  # [kg m^2] rotor inertia at the joint
    viscous: Array  # [N m s/rad]
    coulomb: Array  # [N m] Coulomb friction
    stiction: Array  # [N m] stiction
    stribeck_speed: Array  # [rad/s] Stribeck speed


@dataclass(slots=True, eq=False)
class LoadObserverState:
    """State of the observer."""

    integral: Array  # (n,) [N m s] momentum that the known torques account for
    known: Array  # (n,) [N m] all known torques except the motors', at the last step
    tau_e: Array  # (n,) [N m] estimated external torque
    started: bool = False


class LoadObserver:
    """External torque on every joint of an arm, from motor torques, joint and hull velocities."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        period: float,
        time_constant: float = 0.012,
        water_error: float = 0.0,
        friction: DryFriction | None = None,
    ) -> None:
        """Set up the observer for the arm of the vehicle in `model`.

        Args:
            model: compiled model of the vehicle.
            period: [s] of the observer's steps.
            time_constant: [s] lag of the estimate.
            water_error: [-] share by which the hydrodynamic coefficients are deliberately wrong.
            friction: modelled dry friction of the gears; None: that of the model. At rest the
                friction may have any value below stiction, and is assumed to be zero.

        Raises:
            ConfigurationError: a time is not finite or not > 0.
        """
        for name, number in (("period", period), ("time_constant", time_constant)):
            if not (np.isfinite(number) and number > 0.0):
                raise ConfigurationError(
                    f"load observer {name}: must be finite and > 0 s, got {number}"
                )

        vehicle = Vehicle.of(model)
        self._arm = arm = ArmDynamics(model, water_error=water_error)
        bare = arm.parameters.numbers.copy()
        for drag in arm.of_bodies(bare, "linear", "quadratic"):
            drag[:] = 0.0
        arm.weightless(bare)

        # Without weight, buoyancy and drag.
        self._bare = arm.parameters._replace(numbers=bare, stations=arm.parameters.stations[:0])

        dry = friction or vehicle.dry_friction
        self._gears = GearModel(
            armature=np.array(vehicle.armature),
            viscous=np.array(vehicle.joint_damping),
            coulomb=dry.coulomb,
            stiction=dry.stiction,
            stribeck_speed=dry.stribeck_speed,
        )

        self._period = period
        # [1/s] gain whose pole is exactly exp(-period / time_constant)
        self._gain = -np.expm1(-period / time_constant) / period

    def init(self) -> LoadObserverState:
        """Initial state: no external torque; the first step sets the momentum."""
        n = self._arm.n
        return LoadObserverState(np.zeros(n), np.zeros(n), np.zeros(n))

    def step(
        self,
        state: LoadObserverState,
        q: Array,
        qd: Array,
        tau_motor: Array,
        *,
        R_WB: Array,
        nu_B: Array,
        v_current_W: Array,
    ) -> Array:
        """External torques (n,) [N m], which are J^T f of the world on the arm; also advances
        `state` by a period.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            q: (n,) [rad] joint angles now.
            qd: (n,) [rad/s] joint speeds now.
            tau_motor: (n,) [N m] motor torques over the period that has just ended.
            R_WB: (3, 3) attitude of the hull.
            nu_B: (6,) [m/s, rad/s] velocity of the hull, (linear; angular), hull axes.
            v_current_W: (3,) [m/s] steady current.

        Returns:
            The torques (n,) [N m].

        Raises:
            ConfigurationError: an input has another shape, or a number is not finite.
        """
        hull = np.zeros(24)
        joints = (self._arm.n,)
        q = fitting(q, joints, "load observer q")
        qd = fitting(qd, joints, "load observer qd")
        tau_motor = fitting(tau_motor, joints, "load observer tau_motor")
        R_WB = fitting(R_WB, (3, 3), "load observer R_WB")
        nu_B = fitting(nu_B, (6,), "load observer nu_B")
        v_current_W = fitting(v_current_W, (3,), "load observer v_current_W")

        hull[:9] = R_WB.ravel()
        hull[9:15] = nu_B
        hull[9:12] -= R_WB.T @ v_current_W

        timing = (self._period, self._gain, not state.started)
        arms = tuple(self._arm.parameters), tuple(self._bare)
        _observe(
            *arms,
            tuple(self._gears),
            hull,
            (q, qd, tau_motor),
            timing,
            (state.integral, state.known, state.tau_e),
        )

        state.started = True
        return state.tau_e.copy()


@kernel
def _observe(arm, bare, gears, hull, seen, timing, state):
    """Step of the observer; with `first` it only stores the momentum, since the past is unknown."""
    arm = ArmParameters(*arm)
    bare = ArmParameters(*bare)
    gears = GearModel(*gears)
    q, qd, tau_motor = seen
    dt, gain, first = timing
    integral, known, tau_e = state
    n = q.shape[0]

    no_contact = np.zeros(6)
    wrench_B = np.empty(6)
    work = workspace(arm.layout)
    static = np.empty(n)
    velocity = np.empty(n)
    p = np.empty(n)
    turning = np.empty(n)

    # Torques without accelerations, with and without weight, buoyancy and drag
    joints = JointMotion(q, qd, np.zeros(n))
    newton_euler(arm, joints, hull, no_contact, work, static, wrench_B)
    newton_euler(bare, joints, hull, no_contact, work, velocity, wrench_B)
    momentum(arm, work, p, turning)

    dry = np.empty(n)
    dry_friction(gears.coulomb, gears.stiction, gears.stribeck_speed, SMOOTHING, qd, dry)

    # Residual of the momentum
    for j in range(n):
        p[j] += gears.armature[j] * qd[j]
        present = turning[j] - (static[j] - velocity[j]) - gears.viscous[j] * qd[j] - dry[j]
        if first:
            integral[j] = p[j]
            tau_e[j] = 0.0
        else:
            # Motor torques are constant over a step. All other terms vary: the trapezoidal rule is
            # second order.
            integral[j] += dt * (tau_motor[j] + 0.5 * (known[j] + present) + tau_e[j])
            tau_e[j] = gain * (p[j] - integral[j])
        known[j] = present


@kernel
def momentum(arm, work, p_joint, turning):
    """Generalised momentum of every joint and dT/dq, in still water.

    The function uses the joint rotations, positions and twists that `newton_euler` stored in
    `work`.

    Args:
        arm: `ArmParameters`.
        work: working memory of `newton_euler`.
        p_joint: (n,) [N m s] output: generalised momentum.
        turning: (n,) [N m] output: dT/dq.
    """
    layout = arm.layout
    numbers = arm.numbers
    nb = layout.shape[1]
    parent = layout[0]
    kind = layout[1]
    column = layout[2]

    # Views of the packed numbers
    axis = numbers[0 : 3 * nb].reshape(nb, 3)
    mass = numbers[15 * nb : 16 * nb]
    com = numbers[16 * nb : 19 * nb].reshape(nb, 3)
    inertia = numbers[19 * nb : 28 * nb].reshape(nb, 3, 3)
    added = numbers[28 * nb : 64 * nb].reshape(nb, 6, 6)
    origin = numbers[110 * nb : 113 * nb].reshape(nb, 3)
    R = work[: 9 * nb].reshape(nb, 3, 3)
    p = work[9 * nb : 12 * nb].reshape(nb, 3)
    nu = work[21 * nb : 27 * nb].reshape(nb, 6)

    h = np.zeros((nb, 6))
    at_origin = np.empty(6)
    water = np.empty(6)

    for b in range(nb - 1, -1, -1):
        v = nu[b, :3]
        w = nu[b, 3:]
        c = com[b]
        o = origin[b]

        # Momentum of the rigid body about its joint, and its twist at the origin of the water
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            h[b, i] += mass[b] * (v[i] + w[j] * c[k] - w[k] * c[j])
            h[b, 3 + i] += mass[b] * (c[j] * v[k] - c[k] * v[j])
            for m in range(3):
                h[b, 3 + i] += inertia[b, i, m] * w[m]
            at_origin[i] = v[i] + w[j] * o[k] - w[k] * o[j]
            at_origin[3 + i] = w[i]

        # Momentum of the water, moved to the joint
        for i in range(6):
            water[i] = 0.0
            for m in range(6):
                water[i] += added[b, i, m] * at_origin[m]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            h[b, i] += water[i]
            h[b, 3 + i] += water[3 + i] + o[j] * water[k] - o[k] * water[j]

        # p = s . h and dT/dq = h . (v x s)
        if column[b] >= 0:
            u = axis[b]
            at = column[b]
            p_joint[at] = turning[at] = 0.0
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                about = w[j] * u[k] - w[k] * u[j]
                if kind[b] == HINGE:
                    p_joint[at] += u[i] * h[b, 3 + i]
                    turning[at] += h[b, i] * (v[j] * u[k] - v[k] * u[j]) + h[b, 3 + i] * about
                else:
                    p_joint[at] += u[i] * h[b, i]
                    turning[at] += h[b, i] * about

        up = parent[b]
        if up < 0:
            continue
        for i in range(3):  # R h, moved to the parent's joint
            for m in range(3):
                h[up, i] += R[b, i, m] * h[b, m]
                h[up, 3 + i] += R[b, i, m] * h[b, 3 + m]
            j, k = (i + 1) % 3, (i + 2) % 3
            for m in range(3):
                h[up, 3 + i] += (p[b, j] * R[b, k, m] - p[b, k] * R[b, j, m]) * h[b, m]


class MomentumObserver(TorqueResidual):
    """Contact force from motor torques by the momentum of arm and hull [DeLuca 2003].

    Of a joint at rest, whatever its gears hold by dry friction counts as contact.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        arm: ArmDynamics | None = None,
        tuning: ArmTuning | None = None,
        period: float = DRIVE_PERIOD,
        water_error: float = 0.0,
        friction: DryFriction | None = None,
    ) -> None:
        """Set up from the believed model of the vehicle.

        Args:
            model: believed model, compiled.
            arm: modelled dynamics of the arm; None: read from `model`.
            tuning: filters and noise.
            period: [s] of a step.
            water_error: [-] share by which added masses and drags are wrong.
            friction: identified friction of the gears; None: the model's.
        """
        tuning = tuning or ArmTuning()
        super().__init__(model, arm or ArmDynamics(model, water_error=water_error), tuning, period)

        self._dry = friction or self._vehicle.dry_friction
        self._observer = LoadObserver(
            model,
            period=period,
            time_constant=tuning.observer_lag,
            water_error=water_error,
            friction=friction,
        )

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact, no tare, no friction."""
        state = super().init(estimate)
        state.own = self._observer.init()
        return state

    def step(
        self, state: ContactState, estimate: StateEstimate, reference: Reference, drives: DriveState
    ) -> None:
        """Process one sample; force, friction, and motion of arm and hull are stored in `state`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle; its torques are not used.
            reference: shows when to tare.
            drives: last commands of the drives.
        """
        tuning = self._tuning
        dry = self._dry
        sensed = state.sensed
        f_tip_W = np.empty(3)
        load: LoadObserverState = state.own

        # only the motion is used; the force is overwritten
        self._sense(state, estimate, drives.current_W, f_tip_W)
        sensed.tau_e[:] = self._observer.step(
            load,
            estimate.q,
            estimate.qd,
            drives.tau,
            R_WB=estimate.X_WB[:3, :3],
            nu_B=sensed.hull[9:15],
            v_current_W=drives.current_W,
        )

        errors = (state.bias, state.floor, 0.0)
        normal = force_from_external_torques(
            estimate.X_WB, drives.tau, errors, tuple(sensed), f_tip_W
        )

        reversal = tuning.gears.reversal
        qd_wanted = drives.qd_wanted
        dry_friction(
            dry.coulomb, dry.stiction, dry.stribeck_speed, reversal, qd_wanted, state.friction
        )

        # At rest the tare would take for its zero whatever the gears hold by their dry friction
        if not np.any(dry.stiction):
            self._tare(state, reference)

        sigma_G = state.record.sigma_G
        if self._is_slow_tick(state):
            known = tuning.gears.known
            dry_friction_sigma(
                dry.coulomb, dry.stiction, SMOOTHING, known, sensed.qd_slow, state.floor
            )
            state.floor[:] = np.hypot(tuning.torques.observer_floor, state.floor)
            sigma_G = force_sigma(sensed.X_BG, sensed.J_B, state.floor, state.floor**2)

        state.record.ticks[0] += 1
        state.estimate = ContactEstimate(force_W=f_tip_W, normal=normal, sigma_G=sigma_G)
