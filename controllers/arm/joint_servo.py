"""Joint servo: computed torque at the rate of the drives, tool motion against the drifting hull, gear friction.

Compiled as a whole, since it runs at the rate of the drives. Its dynamics are those of
`controllers.arm.inverse_dynamics`; the tests compare it with their plain forms.
"""

import numba
import numpy as np

from controllers.arm.inverse_dynamics import newton_euler
from sim.interfaces.kernels import keyed_by_imports


@numba.njit(cache=True)
@keyed_by_imports
def track_gear_friction(tau_motor, tau_measured, qd, qdd, armature, damping, most, share, friction):
    """Track the dry friction torque of the gears, as the torque sensors show it.

    It is the motor torque less rotor inertia, viscous friction and the sensor's reading. Added to the motor commands,
    it turns the drives into torque sources at the gear output, also at rest. There friction takes any value that keeps
    the joint, and the motors' torque grows until the joint breaks away.

    Args:
        tau_motor: (n,) [N m] motor torques.
        tau_measured: (n,) [N m] torques at the gear outputs.
        qd: (n,) [rad/s] joint speeds.
        qdd: (n,) [rad/s^2] joint accelerations.
        armature: (n,) [kg m^2] rotor inertias at the joints.
        damping: (n,) [N m s/rad] viscous friction.
        most: (n,) [N m] largest friction in either direction.
        share: [-] weight of the new sample in the filter.
        friction: (n,) [N m] tracked friction; updated.
    """
    for j in range(qd.shape[0]):
        lost = tau_motor[j] - armature[j] * qdd[j] - damping[j] * qd[j] - tau_measured[j]
        friction[j] += share * (lost - friction[j])
        friction[j] = min(max(friction[j], -most[j]), most[j])


@numba.njit(cache=True)
@keyed_by_imports
def servo_joints(
    layout,
    numbers,
    stations,
    work,
    hull,
    q,
    qd,
    q_wanted,
    qd_wanted,
    qdd_wanted,
    since,
    integral,
    dt,
    gains,
    armature,
    damping,
    friction,
    limits,
    borne_G,
    yielding,
    softness,
    qdd,
    tau,
    wrench_B,
):
    """Drive torques for the wanted joint motion: computed torque with PID on the joints, and a compliant tool axis.

    The integral of a drive at its torque limit is frozen.

    Args:
        layout: (4, nb) tree of the arm, `ArmDynamics.layout`.
        numbers: packed parameters of the arm, `ArmDynamics.numbers`.
        stations: (ns, 9) drag stations, `ArmDynamics.stations`.
        work: working memory of `newton_euler`.
        hull: (24,) motion of the hull as in `newton_euler`.
        q: (n,) [rad] joint angles.
        qd: (n,) [rad/s] joint speeds.
        q_wanted: (n,) [rad] angles wanted `since` ago; extrapolated at `qd_wanted`.
        qd_wanted: (n,) [rad/s] speeds wanted.
        qdd_wanted: (n,) [rad/s^2] accelerations wanted.
        since: [s] age of `q_wanted`.
        integral: (n,) [rad s] integral of the angle errors; updated.
        dt: [s] since the last step.
        gains: stiffness [1/s^2], damping [1/s], integral gain [1/s^3], limit of the integral [rad s].
        armature: (n,) [kg m^2] rotor inertias at the joints.
        damping: (n,) [N m s/rad] viscous friction of the gears.
        friction: (n,) [N m] further friction of the gears.
        limits: (n,) [N m] torque limits.
        borne_G: (6,) [N, N m] contact wrench on the tip that the drives bear by feedforward, tool axes.
        yielding: (2, n) tip motion along the tool axis per joint angle [m/rad], and the joint motion that gives only
            that [rad/m].
        softness: [-] share of the stiffness that the tip loses along the tool axis.
        qdd: (n,) [rad/s^2] output: servoed accelerations.
        tau: (n,) [N m] output: drive torques.
        wrench_B: (6,) [N, N m] output: wrench of the arm on the hull, hull axes.
    """
    stiffness, damper, integrator, most = gains[0], gains[1], gains[2], gains[3]
    n = q.shape[0]
    error = np.empty(n)
    along = 0.0
    for j in range(n):
        error[j] = q_wanted[j] + since * qd_wanted[j] - q[j]
        along += yielding[0, j] * error[j]
    for j in range(n):
        qdd[j] = (
            qdd_wanted[j]
            + stiffness * (error[j] - softness * along * yielding[1, j])
            + damper * (qd_wanted[j] - qd[j])
            + integrator * integral[j]
        )
    newton_euler(layout, numbers, stations, q, qd, qdd, hull, borne_G, work, tau, wrench_B)
    for j in range(n):
        tau[j] += armature[j] * qdd[j] + damping[j] * qd[j] + friction[j]
        if abs(tau[j]) > limits[j]:
            tau[j] = np.sign(tau[j]) * limits[j]
        else:
            # Along the tool axis the force loop provides the integral action.
            grown = integral[j] + dt * (error[j] - (along * yielding[1, j] if softness > 0.0 else 0.0))
            integral[j] = min(max(grown, -most), most)


@numba.njit(cache=True)
@keyed_by_imports
def resolve_tool_motion(X_AB, X_WB, X_WG, v_WG_W, w_WG_W, hull, J_B, drift, speed_limit, X_AG, qd, qdd, yielding):
    """Re-aiming, p*_C = R^T (p*_O - r) in [Konoplin 2022]: tool pose in the arm's base, and its joint rates.

    Joint speeds are J^-1 of the tool's velocity relative to the hull, damped near singular postures. With `drift` the
    motion of the hull is compensated: its velocity in `qd`, its acceleration in `qdd`. The tool then stands still on
    the object. Without it the drives carry the arm along when contact pushes the hull, and their force adds to the
    contact force.

    Args:
        X_AB: (4, 4) hull pose in the arm's base.
        X_WB: (4, 4) hull pose.
        X_WG: (4, 4) tool pose wanted.
        v_WG_W: (3,) [m/s] velocity of the tool wanted, W.
        w_WG_W: (3,) [rad/s] angular velocity of the tool wanted, W.
        hull: (24,) motion of the hull as left by `estimate_tip_force`.
        J_B: (6, n) Jacobian of the tip, hull axes.
        drift: True compensates the motion of the hull.
        speed_limit: [rad/s] of every joint.
        X_AG: (4, 4) output: tool pose in the arm's base.
        qd: (n,) [rad/s] output: joint speeds.
        qdd: (n,) [rad/s^2] output: joint accelerations that cancel the hull's; zero without `drift`.
        yielding: (2, n) output: tip motion along the tool axis per joint angle [m/rad], and the joint motion for a
            metre [rad/m].
    """
    X_BW = np.eye(4)
    wanted = np.zeros((3, 6))  # tool relative to the hull: velocity, acceleration; and 1 m along its axis
    for i in range(3):
        for j in range(3):
            X_BW[i, j] = X_WB[j, i]
            X_BW[i, 3] -= X_WB[j, i] * X_WB[j, 3]
            wanted[0, i] += X_WB[j, i] * v_WG_W[j]
            wanted[0, 3 + i] += X_WB[j, i] * w_WG_W[j]
    X_BG = X_BW @ X_WG
    X_AG[:, :] = X_AB @ X_BG
    if drift:
        p, v, w, a, b = X_BG[:3, 3], hull[9:12], hull[12:15], hull[15:18], hull[18:21]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            wanted[0, i] -= v[i] + w[j] * p[k] - w[k] * p[j]
            wanted[0, 3 + i] -= w[i]
            wanted[1, i] = -(a[i] + w[j] * v[k] - w[k] * v[j] + b[j] * p[k] - b[k] * p[j])
            wanted[1, 3 + i] = -b[i]
    wanted[2, :3] = X_BG[:3, 2]
    # J^T (J J^T + damping)^-1 by Cholesky in place: a call of LAPACK costs more than these sums.
    A = J_B @ J_B.T.copy()
    for i in range(6):
        A[i, i] += 1e-6
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = np.sqrt(total) if i == j else total / A[j, j]
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
        qd[j] = qdd[j] = yielding[0, j] = yielding[1, j] = 0.0
        for i in range(6):
            qd[j] += J_B[i, j] * wanted[0, i]
            qdd[j] += J_B[i, j] * wanted[1, i]
            yielding[1, j] += J_B[i, j] * wanted[2, i]
        for i in range(3):
            yielding[0, j] += J_B[i, j] * X_BG[i, 2]
        qd[j] = min(max(qd[j], -speed_limit), speed_limit)
