"""One step of the arm's drives in one kernel: feel the contact, then bear it and follow the wanted joint motion.

Compiled as a whole because it runs at the rate of the drives; the parts are those of `controllers.arm.inverse_dynamics`
and `controllers.estimation.contact_force`, whose plain forms the tests hold against it.
"""

import numba
import numpy as np

from controllers.arm.inverse_dynamics import newton_euler, tip_kinematics
from sim.interfaces.kernels import keyed_by_imports


@numba.njit(cache=True)
@keyed_by_imports
def estimate_tip_force(
    layout,
    numbers,
    stations,
    work,
    hull,
    X_WB,
    v_B,
    w_B,
    a_B,
    current_W,
    q,
    qd,
    tau_measured,
    bias,
    noise,
    floor,
    dt,
    filters,
    qd_slow,
    w_slow_B,
    qdd,
    tau_e,
    wrench_B,
    X_BG,
    J_B,
    f_tip_B,
    f_tip_G,
    f_tip_W,
):
    """Force of the world on the tip from what the torque sensors show beyond the model; returns the normal one [N].

    `bias` (n,) [N m] is not the contact's; `noise`, a share of the reading, and `floor` (n,) [N m] say how far each
    torque is trusted. Writes the hull's motion to `hull` for `newton_euler`. Updates the filtered rates of the joints
    `qd_slow` (n,) and of the hull `w_slow_B` (3,), whose lags give the accelerations `qdd` (n,) and the hull's angular
    one, and the filtered force `f_tip_B` (3,) [N]; `filters` holds the time constants of rates and force [s]. Leaves
    the external torques `tau_e` (n,) before `bias` is taken off, the arm's wrench on the hull without contact
    `wrench_B` (6,), the tip's pose and Jacobian in the hull's frame, and the force in tool axes and in world axes.
    """
    lag = min(1.0, dt / filters[0])
    for i in range(3):
        for j in range(3):
            hull[3 * i + j] = X_WB[i, j]
        hull[9 + i], hull[12 + i], hull[21 + i] = v_B[i], w_B[i], current_W[i]
        j, k = (i + 1) % 3, (i + 2) % 3
        hull[15 + i] = a_B[i] - (w_B[j] * v_B[k] - w_B[k] * v_B[j])  # rate of the components of v_B
        hull[18 + i] = (w_B[i] - w_slow_B[i]) / filters[0]
        w_slow_B[i] += lag * (w_B[i] - w_slow_B[i])
    for j in range(q.shape[0]):
        qdd[j] = (qd[j] - qd_slow[j]) / filters[0]
        qd_slow[j] += lag * (qd[j] - qd_slow[j])
    f_B = tip_force(
        layout, numbers, stations, work, hull, q, qd, qdd, tau_measured, bias, noise, floor, tau_e, wrench_B, X_BG, J_B
    )
    lag = min(1.0, dt / filters[1])
    for i in range(3):
        f_tip_B[i] += lag * (f_B[i] - f_tip_B[i])
    return _in_axes(X_WB, X_BG, f_tip_B, f_tip_G, f_tip_W)


@numba.njit(cache=True)
@keyed_by_imports
def resolve(X_WB, X_BG, J_B, tau_e, bias, tau_measured, noise, floor, f_tip_B, f_tip_G, f_tip_W):
    """As `estimate_tip_force`, from external torques `tau_e` (n,) of an observer; no further filter.

    `tau_measured` (n,) says how much to trust each.
    """
    f_B = _least_squares(J_B, tau_e, bias, tau_measured, noise, floor)
    for i in range(3):
        f_tip_B[i] = f_B[i]
    return _in_axes(X_WB, X_BG, f_tip_B, f_tip_G, f_tip_W)


@numba.njit(cache=True)
@keyed_by_imports
def _in_axes(X_WB, X_BG, f_tip_B, f_tip_G, f_tip_W):
    """The force in tool axes and in world axes; returns the normal one."""
    for i in range(3):
        f_tip_G[i] = X_BG[0, i] * f_tip_B[0] + X_BG[1, i] * f_tip_B[1] + X_BG[2, i] * f_tip_B[2]
        f_tip_W[i] = X_WB[i, 0] * f_tip_B[0] + X_WB[i, 1] * f_tip_B[1] + X_WB[i, 2] * f_tip_B[2]
    return -f_tip_G[2]  # the tool presses along its z axis; the world pushes back


@numba.njit(cache=True)
@keyed_by_imports
def tip_force(
    layout, numbers, stations, work, hull, q, qd, qdd, tau_measured, bias, noise, floor, tau_e, wrench_B, X_BG, J_B
):
    """Unfiltered force of the world on the tip (3,) [N], hull axes; leaves behind what `estimate_tip_force` does."""
    no_contact = np.zeros(6)
    newton_euler(layout, numbers, stations, q, qd, qdd, hull, no_contact, work, tau_e, wrench_B)
    tip_kinematics(layout, numbers, work, X_BG, J_B)
    for j in range(q.shape[0]):
        tau_e[j] -= tau_measured[j]
    return _least_squares(J_B, tau_e, bias, tau_measured, noise, floor)


@numba.njit(cache=True)
@keyed_by_imports
def _least_squares(J_B, tau_e, bias, tau_measured, noise, floor):
    """Force on the tip (3,) [N], hull axes, from external torques: `force_estimate.tip_force` by Cholesky."""
    a00, a11, a22, a01, a02, a12 = 1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0
    b0 = b1 = b2 = 0.0
    for j in range(tau_e.shape[0]):
        weight = 1.0 / (floor[j] + noise * abs(tau_measured[j])) ** 2
        x, y, z, t = J_B[0, j], J_B[1, j], J_B[2, j], weight * (tau_e[j] - bias[j])
        a00 += weight * x * x
        a11 += weight * y * y
        a22 += weight * z * z
        a01 += weight * x * y
        a02 += weight * x * z
        a12 += weight * y * z
        b0 += t * x
        b1 += t * y
        b2 += t * z
    l00 = np.sqrt(a00)
    l10, l20 = a01 / l00, a02 / l00
    l11 = np.sqrt(a11 - l10 * l10)
    l21 = (a12 - l20 * l10) / l11
    l22 = np.sqrt(a22 - l20 * l20 - l21 * l21)
    y0 = b0 / l00
    y1 = (b1 - l10 * y0) / l11
    y2 = (b2 - l20 * y0 - l21 * y1) / l22
    z = y2 / l22
    y = (y1 - l21 * z) / l11
    return (y0 - l10 * y - l20 * z) / l00, y, z


@numba.njit(cache=True)
@keyed_by_imports
def track_gear_friction(tau_motor, tau_measured, qd, qdd, armature, damping, most, share, friction):
    """Follow the dry friction `friction` (n,) [N m] that the drives must overcome, as the torque sensors show it.

    What the motors gave beyond the rotors' inertia, viscous friction, and what passed the sensors; `share` of the news
    is taken over each time, and never more than `most` (n,) either way. Fed to the motors it makes of them sources of
    torque at the gear output, at rest too: there friction is whatever keeps the joint, and the motors' torque grows
    until it breaks away.
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
    """Drive torques `tau` (n,) [N m] for the wanted joint motion: inverse dynamics of a servoed acceleration.

    `q_wanted` was wanted `since` [s] ago and has moved on at `qd_wanted`, whose rate should be `qdd_wanted`. `gains`:
    stiffness [1/s^2], damping [1/s], integral [1/s^3], limit of the integral [rad s]. `friction` (n,) [N m] is lost in
    the gears beside the viscous one of `damping`. `borne_G` (6,) is the contact that the drives bear at once. Where a
    drive is at its torque limit its integral stands still.

    `yielding` (2, n): rows are how the joints move the tip along its axis, and how they would be moved to do only that;
    `softness` is the share of its stiffness that the tip loses along that axis.
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
            # Along the tool axis the force loop is the integral.
            grown = integral[j] + dt * (error[j] - (along * yielding[1, j] if softness > 0.0 else 0.0))
            integral[j] = min(max(grown, -most), most)


@numba.njit(cache=True)
@keyed_by_imports
def resolve_tool_motion(X_AB, X_WB, X_WG, v_WG_W, w_WG_W, hull, J_B, drift, speed_limit, X_AG, qd, qdd, yielding):
    """Re-aiming (paper 002: p*_C = R^T (p*_O - r)): the tool pose in the arm's base `X_AG`, and joint speeds `qd`.

    With `drift` the hull's own motion, as `estimate_tip_force` left it in `hull`, is taken off, so that the tool stands
    still on the object: its velocity, and its acceleration, which makes the joint accelerations `qdd`. Without these
    the drives would carry the arm along with a hull that the contact pushes, and what they push meanwhile goes into the
    contact. The speeds are J^-1 of the tool's velocity against the hull, damped near singular postures. The rows of
    `yielding` (2, n) are how joint angles move the tip along its axis, and joint angles that move it so by a metre.
    """
    X_BW = np.eye(4)
    wanted = np.zeros((3, 6))  # velocity and acceleration of the tool against the hull, and a metre along its axis
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
    # J^T (J J^T + damping)^-1 by Cholesky in place: LAPACK's call costs more than these sums.
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
