"""Joint servo: computed torque at the rate of the drives, and tool motion relative to the drifting
hull.

The kernels are compiled as a whole, since they run at the rate of the drives. Their dynamics are
those of `uuv.controllers.arm.inverse_dynamics`; the tests compare them with their plain forms.
Records are passed as plain tuples of their fields, which numba types faster.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uuv.controllers.arm.inverse_dynamics import (
    ArmDynamics,
    ArmParameters,
    JointMotion,
    newton_euler,
    workspace,
)
from uuv.controllers.ik.priorities import DAMPING, prioritised
from uuv.controllers.tuning import ArmTuning
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

DAMPED = 1e-6  # damping of J J^T everywhere, in units of m^2 and rad^2
MOST_DAMPED = 1e-3  # the same added beside a singular posture, at most
SINGULAR = 1e-3  # pivot of its Cholesky factor, below which a posture is singular


class FrictionTracking(NamedTuple):
    """Gears and filter of `track_gear_friction`."""

    armature: Array  # (n,) [kg m^2] rotor inertias at the joints
    damping: Array  # (n,) [N m s/rad] viscous friction
    most: Array  # (n,) [N m] largest dry friction in either direction
    share: float  # [-] weight of the new sample in the filter


class Drives(NamedTuple):
    """Drives of the arm, and the gains of their servo."""

    # stiffness [1/s^2], damping [1/s], integral gain [1/s^3], limit of the integral [rad s]
    gains: Array
    armature: Array  # (n,) [kg m^2] rotor inertias at the joints
    damping: Array  # (n,) [N m s/rad] viscous friction of the gears
    limits: Array  # (n,) [N m] torque limits
    period: float  # [s] of the servo


class SeenArm(NamedTuple):
    """Measured motion of joints and hull, input of the servo."""

    q: Array  # (n,) [rad] joint angles
    qd: Array  # (n,) [rad/s] joint speeds
    hull: Array  # (24,) motion of the hull as in `newton_euler`


class JointTarget(NamedTuple):
    """Desired joint motion."""

    q: Array  # (n,) [rad] angles desired `age` ago; extrapolated at `qd`
    qd: Array  # (n,) [rad/s] speeds
    qdd: Array  # (n,) [rad/s^2] accelerations
    age: float  # [s]


class SoftAxis(NamedTuple):
    """Tool axis along which the servo has less stiffness for force control."""

    # (2, n) tip motion along the tool axis per joint angle [m/rad]; joint motion that causes it
    # [rad/m]
    yielding: Array
    softness: float  # [-] share of the stiffness by which the tip is softer along the tool axis


class BorneLoad(NamedTuple):
    """Loads that are fed forward to the drives."""

    wrench_G: Array  # (6,) [N, N m] contact wrench on the tip, tool axes
    friction: Array  # (n,) [N m] dry friction of the gears


class ToolTarget(NamedTuple):
    """Desired tool motion."""

    X_WG: Array  # (4, 4) pose
    v_WG_W: Array  # (3,) [m/s] velocity of its origin, W
    w_WG_W: Array  # (3,) [rad/s] angular velocity, W


class ResolvedMotion(NamedTuple):
    """Output of `resolve_tool_motion`."""

    X_AG: Array  # (4, 4) tool pose in the arm's base
    qd: Array  # (n,) [rad/s] joint speeds
    # (n,) [rad/s^2] joint accelerations that compensate the hull's; zero without drift correction
    qdd: Array
    yielding: Array  # (2, n) as in `SoftAxis`


@dataclass(slots=True, eq=False)
class JointServoState:
    """State of the servo."""

    integral: Array  # (n,) [rad s] integral of the angle errors; changed in place
    tau: Array  # (n,) [N m] last commands of the motors


class JointServo:
    """Computed-torque servo of the arm's joints."""

    def __init__(self, vehicle: Vehicle, tuning: ArmTuning, period: float) -> None:
        self._tuning = tuning
        self._period = period
        self._n = vehicle.joints.size
        self.drives = Drives(
            gains=tuning.servo_gains,
            armature=np.array(vehicle.armature),
            damping=np.array(vehicle.joint_damping),
            limits=np.array(vehicle.torque_limits),
            period=period,
        )
        self._drive_fields = tuple(self.drives)

    @property
    def hardening(self) -> float:
        """Share [-] of the stiffness that is restored in a period after force control."""
        return self._tuning.normal_softness * self._period / self._tuning.hardening_time

    def init(self) -> JointServoState:
        """Initial state: no torque commanded."""
        return JointServoState(integral=np.zeros(self._n), tau=np.zeros(self._n))

    def step(
        self,
        state: JointServoState,
        arm: ArmParameters,
        seen: SeenArm,
        wanted: JointTarget,
        borne: BorneLoad,
    ) -> Array:
        """Torques (n,) [N m] of the drives for one period, with the same stiffness along the tool
        axis as elsewhere.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            arm: arm model.
            seen: measured motion.
            wanted: desired joint motion.
            borne: loads that are fed forward.

        Returns:
            The torques, within the drives' limits.
        """
        soft = (np.zeros((2, self._n)), 0.0)
        state.tau = servo_joints(
            tuple(arm),
            self._drive_fields,
            tuple(seen),
            tuple(wanted),
            soft,
            tuple(borne),
            state.integral,
        )
        return state.tau


def servo_feedback(
    arm: ArmDynamics, drives: Drives, q: Array, soft: SoftAxis
) -> tuple[Array, Array]:
    """How the servo's torques follow the joints' motion, for drives that carry a command on.

    Args:
        arm: arm model.
        drives: drives and gains.
        q: (n,) [rad] joint angles.
        soft: tool axis along which the servo is softer.

    Returns:
        Stiffness (n, n) [N m/rad] and damping (n, n) [N m s/rad]: the torques change by less each
        of them times the change of angles and speeds, as long as they are within their limits.
    """
    n = len(q)
    rest = np.zeros(n)
    hull = {"R_WB": np.eye(3), "nu_B": np.zeros(6), "a_B": np.zeros(6)}
    still = {"v_current_W": np.zeros(3), "wrench_tip_G": np.zeros(6)}

    # Torque of a unit acceleration of each joint, beyond that at rest: inertia, with the rotors'.
    borne = arm.inverse(q, rest, rest, **hull, **still)[0]
    columns = [arm.inverse(q, rest, unit, **hull, **still)[0] - borne for unit in np.eye(n)]
    inertia = np.column_stack(columns) + np.diag(drives.armature)

    stiffness, damper = drives.gains[:2]
    kept = np.eye(n) - soft.softness * np.outer(soft.yielding[1], soft.yielding[0])
    return stiffness * inertia @ kept, damper * inertia - np.diag(drives.damping)


def hull_compensation(X_BG: Array, J_B: Array) -> Array:
    """Motion of the joints that keeps the tool at rest while the hull moves.

    Args:
        X_BG: (4, 4) pose of the tool on the hull.
        J_B: (6, n) its Jacobian, linear and angular, hull axes.

    Returns:
        (n, 6) [rad/m, rad/rad] by the displacement of the hull, (linear; angular), hull axes;
        damped beside singular postures.
    """
    x, y, z = X_BG[:3, 3]
    carried = np.eye(6)  # of the tool, by that of the hull
    carried[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return -J_B.T @ np.linalg.solve(J_B @ J_B.T + DAMPED * np.eye(6), carried)


@kernel
def track_gear_friction(tau_motor, tau_measured, qd, qdd, gears, friction):
    """Track the dry friction torque of the gears from the torque sensors.

    The dry friction is the motor torque minus rotor inertia, viscous friction and the sensor's
    reading. If it is added to the motor commands, the drives become torque sources at the gear
    output, also at rest. At rest the friction has any value that holds the joint, and the torque of
    the motor grows until the joint breaks away.

    Args:
        tau_motor: (n,) [N m] motor torques.
        tau_measured: (n,) [N m] torques at the gear outputs.
        qd: (n,) [rad/s] joint speeds.
        qdd: (n,) [rad/s^2] joint accelerations.
        gears: fields of `FrictionTracking`, in a tuple.
        friction: (n,) [N m] tracked friction; updated.
    """
    armature, damping, most, share = gears
    for j in range(qd.shape[0]):
        lost = tau_motor[j] - armature[j] * qdd[j] - damping[j] * qd[j] - tau_measured[j]
        friction[j] += share * (lost - friction[j])
        friction[j] = min(max(friction[j], -most[j]), most[j])


@kernel
def servo_joints(arm, drives, seen, wanted, soft, borne, integral):
    """Drive torques for a joint motion: computed torque with PID, and a compliant tool axis.

    The integral of a drive at its torque limit is frozen.

    Args:
        arm: fields of `ArmParameters`, in a tuple; likewise below.
        drives: `Drives`.
        seen: `SeenArm`.
        wanted: `JointTarget`.
        soft: `SoftAxis`.
        borne: `BorneLoad`.
        integral: (n,) [rad s] integral of the angle errors; updated.

    Returns:
        The drive torques (n,) [N m].
    """
    arm = ArmParameters(*arm)
    drives = Drives(*drives)
    seen = SeenArm(*seen)
    wanted = JointTarget(*wanted)
    soft = SoftAxis(*soft)
    borne = BorneLoad(*borne)

    gains = drives.gains
    stiffness = gains[0]
    damper = gains[1]
    integrator = gains[2]
    most = gains[3]
    q = seen.q
    qd = seen.qd
    yielding = soft.yielding
    softness = soft.softness
    n = q.shape[0]
    error = np.empty(n)
    qdd = np.empty(n)
    tau = np.empty(n)
    wrench_B = np.empty(6)

    # Angle errors, and their component along the tool axis
    along = 0.0
    for j in range(n):
        error[j] = wanted.q[j] + wanted.age * wanted.qd[j] - q[j]
        along += yielding[0, j] * error[j]

    # Accelerations by PID, with less stiffness along the tool axis
    for j in range(n):
        qdd[j] = (
            wanted.qdd[j]
            + stiffness * (error[j] - softness * along * yielding[1, j])
            + damper * (wanted.qd[j] - qd[j])
            + integrator * integral[j]
        )

    # Computed torque
    newton_euler(
        arm,
        JointMotion(q, qd, qdd),
        seen.hull,
        borne.wrench_G,
        workspace(arm.layout),
        tau,
        wrench_B,
    )

    # Add rotors and gears, within the limits
    for j in range(n):
        tau[j] += drives.armature[j] * qdd[j] + drives.damping[j] * qd[j] + borne.friction[j]
        if abs(tau[j]) > drives.limits[j]:
            tau[j] = np.sign(tau[j]) * drives.limits[j]
        else:
            # Along the tool axis the force loop provides the integral action.
            grown = integral[j] + drives.period * (
                error[j] - (along * yielding[1, j] if softness > 0.0 else 0.0)
            )
            integral[j] = min(max(grown, -most), most)

    return tau


@kernel
def resolve_tool_motion(X_AB, X_WB, tool, hull, tip, drift, joints, out):
    """Re-aiming, p*_C = R^T (p*_O - r) [Konoplin 2022]: tool pose in the arm's base, joint rates.

    Joint speeds are J^-1 of the tool's velocity relative to the hull, damped near singular
    postures. For an arm that does not have six joints they are computed by priorities. With `drift`
    the motion of the hull is compensated: the velocity in `qd`, the acceleration in `qdd`. The tool
    is then at rest relative to the object. Without `drift` the drives move the arm with the hull
    when contact pushes the hull, and their force adds to the contact force.

    Args:
        X_AB: (4, 4) hull pose in the arm's base.
        X_WB: (4, 4) hull pose.
        tool: fields of `ToolTarget`, in a tuple.
        hull: (24,) motion of the hull as in `newton_euler`.
        tip: pose X_BG (4, 4) and Jacobian J_B (6, n) of the tip as it is, hull axes.
        drift: True compensates the motion of the hull.
        joints: speed limit [rad/s] of the fastest, with which the others are slowed down; and
            speeds (n,) [rad/s] wanted where the tool leaves them free, with other than six joints.
        out: fields of `ResolvedMotion`, in a tuple; written.
    """
    tool = ToolTarget(*tool)
    out = ResolvedMotion(*out)
    tip_B, J_B = tip
    speed_limit, spare = joints
    qd = out.qd
    qdd = out.qdd
    yielding = out.yielding
    X_BW = np.eye(4)

    # tool relative to the hull: velocity, acceleration; and 1 m along its axis
    twists = np.zeros((3, 6))
    for i in range(3):
        for j in range(3):
            X_BW[i, j] = X_WB[j, i]
            X_BW[i, 3] -= X_WB[j, i] * X_WB[j, 3]
            twists[0, i] += X_WB[j, i] * tool.v_WG_W[j]
            twists[0, 3 + i] += X_WB[j, i] * tool.w_WG_W[j]

    X_BG = X_BW @ tool.X_WG
    out.X_AG[:, :] = X_AB @ X_BG

    # Subtract the motion of the hull, with which the tool moves
    if drift:
        p = X_BG[:3, 3]
        v = hull[9:12]
        w = hull[12:15]
        a = hull[15:18]
        b = hull[18:21]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            twists[0, i] -= v[i] + w[j] * p[k] - w[k] * p[j]
            twists[0, 3 + i] -= w[i]
            twists[1, i] = -(a[i] + w[j] * v[k] - w[k] * v[j] + b[j] * p[k] - b[k] * p[j])
            twists[1, 3 + i] = -b[i]

    twists[2, :3] = X_BG[:3, 2]

    n = qd.shape[0]
    if n == 6:
        _all_at_once(J_B, twists, qd, qdd, yielding)
    else:
        # The present axis is used, since otherwise a joint that turns the tool about its axis would
        # seem to tilt the axis, and would spin.
        z = tip_B[:3, 2].copy()
        rest = np.zeros(n)
        held = np.zeros(n, dtype=np.bool_)
        prioritised(J_B, z, twists[0], DAMPING, spare, held, qd)
        prioritised(J_B, z, twists[1], DAMPING, rest, held, qdd)
        prioritised(J_B, z, twists[2], DAMPING, rest, held, yielding[1])

    # Motion of the tip along its axis per joint, and the fastest joint
    fastest = 0.0
    for j in range(n):
        yielding[0, j] = 0.0
        for i in range(3):
            yielding[0, j] += J_B[i, j] * X_BG[i, 2]
        fastest = max(fastest, abs(qd[j]))

    if fastest > speed_limit:  # by the same factor, so that the tool lags but stays on its path
        for j in range(n):
            qd[j] *= speed_limit / fastest


@kernel
def _all_at_once(J_B, wanted, qd, qdd, yielding):
    """Joint speeds, accelerations and motion along the tool axis for `wanted` (3, 6), damped."""
    A = J_B @ J_B.T.copy()
    L = np.empty((6, 6))
    least = _factor(A, DAMPED, L)
    if least < SINGULAR:  # else the joints would spin for what a singular posture does not allow
        _factor(A, DAMPED + MOST_DAMPED * (1.0 - least / SINGULAR) ** 2, L)
    A = L

    for row in wanted:
        for i in range(6):
            for k in range(i):
                row[i] -= A[i, k] * row[k]
            row[i] /= A[i, i]
        for i in range(5, -1, -1):
            for k in range(i + 1, 6):
                row[i] -= A[k, i] * row[k]
            row[i] /= A[i, i]

    for j in range(qd.shape[0]):
        qd[j] = qdd[j] = yielding[1, j] = 0.0
        for i in range(6):
            qd[j] += J_B[i, j] * wanted[0, i]
            qdd[j] += J_B[i, j] * wanted[1, i]
            yielding[1, j] += J_B[i, j] * wanted[2, i]


@kernel
def _factor(A, damping, L):
    """Cholesky factor `L` (6, 6) of `A` (6, 6) with `damping` on its diagonal; its least pivot."""
    # In place of LAPACK, a call of which costs more than these sums.
    least = np.inf
    for i in range(6):
        for j in range(i + 1):
            total = A[i, j] + damping if i == j else A[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                least = min(least, total)
                L[i, i] = np.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return least
