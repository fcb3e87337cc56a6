"""Tip-force estimator that runs in the loop: one compiled call from joint torques to the force on the tool.

The parts are those of `controllers.arm.inverse_dynamics` and `controllers.estimation.force_from_torques`. The tests
compare the compiled forms here with the plain forms there.
"""

import numba
import numpy as np

from controllers.arm.inverse_dynamics import newton_euler, tip_kinematics
from controllers.estimation.force_from_torques import PRIOR
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
    """Filtered force of the world on the tip from torque sensors less the arm model; returns the normal force [N].

    Joint and hull angular accelerations come from the lag of filtered rates.

    Args:
        layout: (4, nb) tree of the arm, `ArmDynamics.layout`.
        numbers: packed parameters of the arm, `ArmDynamics.numbers`.
        stations: (ns, 9) drag stations, `ArmDynamics.stations`.
        work: working memory of `newton_euler`.
        hull: (24,) output: motion of the hull for `newton_euler`.
        X_WB: (4, 4) hull pose.
        v_B: (3,) [m/s] velocity of the hull, hull axes.
        w_B: (3,) [rad/s] angular velocity of the hull, hull axes.
        a_B: (3,) [m/s^2] acceleration of the hull's origin, hull axes.
        current_W: (3,) [m/s] steady current.
        q: (n,) [rad] joint angles.
        qd: (n,) [rad/s] joint speeds.
        tau_measured: (n,) [N m] torques at the gear outputs.
        bias: (n,) [N m] tare, not due to contact.
        noise: [-] error of a torque as a share of its reading.
        floor: (n,) [N m] constant error of a torque.
        dt: [s] since the last step.
        filters: time constants of rates and force [s].
        qd_slow: (n,) [rad/s] filtered joint speeds; updated.
        w_slow_B: (3,) [rad/s] filtered angular velocity of the hull; updated.
        qdd: (n,) [rad/s^2] output: joint accelerations.
        tau_e: (n,) [N m] output: external torques before `bias` is subtracted.
        wrench_B: (6,) [N, N m] output: wrench of the arm on the hull without contact, hull axes.
        X_BG: (4, 4) output: tip pose in the hull's frame.
        J_B: (6, n) output: Jacobian of the tip, hull axes.
        f_tip_B: (3,) [N] filtered force, hull axes; updated.
        f_tip_G: (3,) [N] output: the same in tool axes.
        f_tip_W: (3,) [N] output: the same in W.

    Returns:
        The normal force [N], positive when the tool presses.
    """
    lag = min(1.0, dt / filters[0])
    for i in range(3):
        for j in range(3):
            hull[3 * i + j] = X_WB[i, j]
        hull[9 + i], hull[12 + i], hull[21 + i] = v_B[i], w_B[i], current_W[i]
        j, k = (i + 1) % 3, (i + 2) % 3
        hull[15 + i] = a_B[i] - (w_B[j] * v_B[k] - w_B[k] * v_B[j])  # time derivative of the components of v_B
        hull[18 + i] = (w_B[i] - w_slow_B[i]) / filters[0]
        w_slow_B[i] += lag * (w_B[i] - w_slow_B[i])
    for j in range(q.shape[0]):
        qdd[j] = (qd[j] - qd_slow[j]) / filters[0]
        qd_slow[j] += lag * (qd[j] - qd_slow[j])
    f_B = unfiltered_tip_force(
        layout, numbers, stations, work, hull, q, qd, qdd, tau_measured, bias, noise, floor, tau_e, wrench_B, X_BG, J_B
    )
    lag = min(1.0, dt / filters[1])
    for i in range(3):
        f_tip_B[i] += lag * (f_B[i] - f_tip_B[i])
    return _in_axes(X_WB, X_BG, f_tip_B, f_tip_G, f_tip_W)


@numba.njit(cache=True)
@keyed_by_imports
def force_from_external_torques(X_WB, X_BG, J_B, tau_e, bias, tau_measured, noise, floor, f_tip_B, f_tip_G, f_tip_W):
    """Force of the world on the tip from external torques of a load observer, unfiltered; returns the normal force [N].

    Args:
        X_WB: (4, 4) hull pose.
        X_BG: (4, 4) tip pose in the hull's frame.
        J_B: (6, n) Jacobian of the tip, hull axes.
        tau_e: (n,) [N m] external torques.
        bias: (n,) [N m] tare, not due to contact.
        tau_measured: (n,) [N m] torques that scale the error of each joint.
        noise: [-] error of a torque as a share of `tau_measured`.
        floor: (n,) [N m] constant error of a torque.
        f_tip_B: (3,) [N] output: force, hull axes.
        f_tip_G: (3,) [N] output: the same in tool axes.
        f_tip_W: (3,) [N] output: the same in W.

    Returns:
        The normal force [N], positive when the tool presses.
    """
    f_B = _least_squares(J_B, tau_e, bias, tau_measured, noise, floor)
    for i in range(3):
        f_tip_B[i] = f_B[i]
    return _in_axes(X_WB, X_BG, f_tip_B, f_tip_G, f_tip_W)


@numba.njit(cache=True)
@keyed_by_imports
def _in_axes(X_WB, X_BG, f_tip_B, f_tip_G, f_tip_W):
    """Force in tool axes and in W; returns the normal force."""
    for i in range(3):
        f_tip_G[i] = X_BG[0, i] * f_tip_B[0] + X_BG[1, i] * f_tip_B[1] + X_BG[2, i] * f_tip_B[2]
        f_tip_W[i] = X_WB[i, 0] * f_tip_B[0] + X_WB[i, 1] * f_tip_B[1] + X_WB[i, 2] * f_tip_B[2]
    return -f_tip_G[2]  # the tool presses along its z axis; the world pushes back


@numba.njit(cache=True)
@keyed_by_imports
def unfiltered_tip_force(
    layout, numbers, stations, work, hull, q, qd, qdd, tau_measured, bias, noise, floor, tau_e, wrench_B, X_BG, J_B
):
    """Unfiltered force of the world on the tip (3,) [N], hull axes, from torque sensors less the arm model.

    Args:
        layout: (4, nb) tree of the arm, `ArmDynamics.layout`.
        numbers: packed parameters of the arm, `ArmDynamics.numbers`.
        stations: (ns, 9) drag stations, `ArmDynamics.stations`.
        work: working memory of `newton_euler`.
        hull: (24,) motion of the hull as in `newton_euler`.
        q: (n,) [rad] joint angles.
        qd: (n,) [rad/s] joint speeds.
        qdd: (n,) [rad/s^2] joint accelerations.
        tau_measured: (n,) [N m] torques at the gear outputs.
        bias: (n,) [N m] tare, not due to contact.
        noise: [-] error of a torque as a share of its reading.
        floor: (n,) [N m] constant error of a torque.
        tau_e: (n,) [N m] output: external torques before `bias` is subtracted.
        wrench_B: (6,) [N, N m] output: wrench of the arm on the hull without contact, hull axes.
        X_BG: (4, 4) output: tip pose in the hull's frame.
        J_B: (6, n) output: Jacobian of the tip, hull axes.

    Returns:
        The force (3,) [N].
    """
    no_contact = np.zeros(6)
    newton_euler(layout, numbers, stations, q, qd, qdd, hull, no_contact, work, tau_e, wrench_B)
    tip_kinematics(layout, numbers, work, X_BG, J_B)
    for j in range(q.shape[0]):
        tau_e[j] -= tau_measured[j]
    return _least_squares(J_B, tau_e, bias, tau_measured, noise, floor)


@numba.njit(cache=True)
@keyed_by_imports
def _least_squares(J_B, tau_e, bias, tau_measured, noise, floor):
    """Force on the tip (3,) [N], hull axes: `controllers.estimation.force_from_torques.tip_force` by Cholesky."""
    a00, a11, a22, a01, a02, a12 = PRIOR, PRIOR, PRIOR, 0.0, 0.0, 0.0
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
