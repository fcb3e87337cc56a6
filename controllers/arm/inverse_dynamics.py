"""Inverse dynamics of an underwater arm on a moving hull, by recursive Newton-Euler.

The computation is independent of MuJoCo's dynamics. Only names, sizes and coefficients are read
from a compiled model, possibly one with deliberately wrong coefficients. Per body, in body axes at
the body's origin, six-vectors (linear; angular):

    rigid body    f = M nudot + (w x momentum terms) - weight
    water         f = A nudot_r + (w x p_l; w x p_a + v_r x p_l)
                      + D nu_r + Dq |nu_r| nu_r + strips - buoyancy,
                  p = A nu_r, nu_r = nu - (R^T v_c; 0)          [Fossen 2011, ch. 6 and 8]

The sum is the load of the body's joint; loads are passed down from tip to base. In [Konoplin 2022]
these are the inverse dynamics that give iM_wz, and the vectors C_D_F, C_D_M of the arm on the hull.
"""

from copy import copy
from typing import NamedTuple, Self

import mujoco
import numpy as np

from uuv.controllers.arm.arm_tree import HINGE, OF_BODIES, SLIDE, read_tree
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import HeldLoad
from uuv.sim.interfaces.spatial import Array, finite_number


class ArmParameters(NamedTuple):
    """Arm model of the controller in the form of the kernels; see `ArmDynamics.parameters`."""

    # (4, nb) parent row, joint kind, column in q (-1: none), and row of the tip's body
    layout: np.ndarray
    numbers: Array  # packed parameters of the bodies, gravity and tip
    # (ns, 9) drag stations: row of the body, position, axis, normal and tangential drag
    stations: Array


class JointMotion(NamedTuple):
    """Motion of the joints."""

    q: Array  # (n,) [rad, m] coordinates
    qd: Array  # (n,) [rad/s, m/s] speeds
    qdd: Array  # (n,) [rad/s^2, m/s^2] accelerations


@kernel
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _rotate(R, a, out):
    for i in range(3):
        out[i] = R[i, 0] * a[0] + R[i, 1] * a[1] + R[i, 2] * a[2]


@kernel
def _rotate_back(R, a, out):
    for i in range(3):
        out[i] = R[0, i] * a[0] + R[1, i] * a[1] + R[2, i] * a[2]


@kernel
def workspace(layout):
    """Working memory of `newton_euler` for a tree of this layout (4, nb)."""
    return np.empty(39 * layout.shape[1] + 27)


@kernel
def newton_euler(arm, joints, hull, wrench_tip, work, tau, wrench_B):
    """Recursive Newton-Euler: forward pass for motion, backward pass for forces.

    The tree is passed as one packed block of numbers (`ArmTree.packed`), because passing thirty
    arrays costs more than the computation.

    Args:
        arm: `ArmParameters`.
        joints: `JointMotion`.
        hull: (24,) attitude R_WB (9), velocity nu_B (6) and the time derivative of its components
            (6), current v_current_W (3).
        wrench_tip: (6,) [N, N m] of the world on the tip, tool axes.
        work: working memory of `workspace`; keeps rotations, positions and velocities for further
            kernels.
        tau: (n,) [N m] output: torques at the gear outputs.
        wrench_B: (6,) [N, N m] output: wrench of the arm on the hull at its origin, hull axes.
    """
    layout, numbers, stations = arm
    q, qd, qdd = joints
    nb = layout.shape[1]
    parent = layout[0]
    kind = layout[1]
    column = layout[2]

    # Views of the packed numbers, in the order of `OF_BODIES`
    axis = numbers[0 : 3 * nb].reshape(nb, 3)
    R0 = numbers[3 * nb : 12 * nb].reshape(nb, 3, 3)
    p0 = numbers[12 * nb : 15 * nb].reshape(nb, 3)
    mass = numbers[15 * nb : 16 * nb]
    com = numbers[16 * nb : 19 * nb].reshape(nb, 3)
    inertia = numbers[19 * nb : 28 * nb].reshape(nb, 3, 3)
    added = numbers[28 * nb : 64 * nb].reshape(nb, 6, 6)
    linear = numbers[64 * nb : 100 * nb].reshape(nb, 6, 6)
    quadratic = numbers[100 * nb : 106 * nb].reshape(nb, 6)
    buoyancy = numbers[106 * nb : 107 * nb]
    cob = numbers[107 * nb : 110 * nb].reshape(nb, 3)
    origin = numbers[110 * nb : 113 * nb].reshape(nb, 3)
    gravity = numbers[113 * nb : 113 * nb + 3]
    p_tip = numbers[113 * nb + 3 : 113 * nb + 6]
    R_tip = numbers[113 * nb + 6 : 113 * nb + 15].reshape(3, 3)
    tip_body = layout[3, 0]

    # Motion of the hull
    R_WB = hull[:9].reshape(3, 3)
    nu_B = hull[9:15]
    nudot_B = hull[15:21]
    v_current_W = hull[21:24]

    # Views of the working memory
    R = work[: 9 * nb].reshape(nb, 3, 3)
    p = work[9 * nb : 12 * nb].reshape(nb, 3)
    R_W = work[12 * nb : 21 * nb].reshape(nb, 3, 3)
    nu = work[21 * nb : 27 * nb].reshape(nb, 6)
    nudot = work[27 * nb : 33 * nb].reshape(nb, 6)
    force = work[33 * nb : 39 * nb].reshape(nb, 6)
    t1 = work[39 * nb : 39 * nb + 3]
    t2 = work[39 * nb + 3 : 39 * nb + 6]
    t3 = work[39 * nb + 6 : 39 * nb + 9]
    v_r = work[39 * nb + 9 : 39 * nb + 15]
    mom = work[39 * nb + 15 : 39 * nb + 21]
    a_r = work[39 * nb + 21 : 39 * nb + 27]

    # Forward pass: motion of each body, and the force that it takes
    for b in range(nb):
        up = parent[b]

        # Joint: rotation and position of this body in its parent (Rodrigues about a fixed axis, or
        # a slide).
        k = kind[b]
        u = axis[b]
        angle = q[column[b]] if column[b] >= 0 else 0.0
        rate = qd[column[b]] if column[b] >= 0 else 0.0
        accel = qdd[column[b]] if column[b] >= 0 else 0.0
        Rb = R[b]
        pb = p[b]
        for i in range(3):
            pb[i] = p0[b, i]

        if k == HINGE:
            c, s = np.cos(angle), np.sin(angle)
            d = 1.0 - c
            e00 = c + d * u[0] * u[0]
            e01 = d * u[0] * u[1] - s * u[2]
            e02 = d * u[0] * u[2] + s * u[1]
            e10 = d * u[1] * u[0] + s * u[2]
            e11 = c + d * u[1] * u[1]
            e12 = d * u[1] * u[2] - s * u[0]
            e20 = d * u[2] * u[0] - s * u[1]
            e21 = d * u[2] * u[1] + s * u[0]
            e22 = c + d * u[2] * u[2]

            for i in range(3):
                x, y, z = R0[b, i, 0], R0[b, i, 1], R0[b, i, 2]
                Rb[i, 0] = x * e00 + y * e10 + z * e20
                Rb[i, 1] = x * e01 + y * e11 + z * e21
                Rb[i, 2] = x * e02 + y * e12 + z * e22
        else:
            for i in range(3):
                for j in range(3):
                    Rb[i, j] = R0[b, i, j]
            if k == SLIDE:
                _rotate(Rb, u, t1)
                for i in range(3):
                    pb[i] += t1[i] * angle

        # Motion of the joint frame, in its own axes.
        nu_up = nu_B if up < 0 else nu[up]
        acc_up = nudot_B if up < 0 else nudot[up]
        R_up = R_WB if up < 0 else R_W[up]
        for i in range(3):
            for j in range(3):
                R_W[b, i, j] = R_up[i, 0] * Rb[0, j] + R_up[i, 1] * Rb[1, j] + R_up[i, 2] * Rb[2, j]
        v = nu[b]
        a = nudot[b]

        _cross(nu_up[3:], pb, t1)
        _cross(acc_up[3:], pb, t2)
        for i in range(3):
            t1[i] += nu_up[i]
            t2[i] += acc_up[i]

        if k == SLIDE:  # the lever p(q) changes at rate R u qd
            _rotate(Rb, u, t3)
            x, y, z = t3[0] * rate, t3[1] * rate, t3[2] * rate
            t2[0] += nu_up[4] * z - nu_up[5] * y
            t2[1] += nu_up[5] * x - nu_up[3] * z
            t2[2] += nu_up[3] * y - nu_up[4] * x

        _rotate_back(Rb, t1, v[:3])
        _rotate_back(Rb, nu_up[3:], v[3:])
        _rotate_back(Rb, t2, a[:3])
        _rotate_back(Rb, acc_up[3:], a[3:])

        if k == HINGE:  # d/dt(R^T x) = R^T xdot - (u qd) x R^T x
            _cross(u, v[:3], t1)
            _cross(u, v[3:], t2)
            for i in range(3):
                a[i] -= rate * t1[i]
                a[3 + i] += u[i] * accel - rate * t2[i]
                v[3 + i] += u[i] * rate
        elif k == SLIDE:
            for i in range(3):
                v[i] += u[i] * rate
                a[i] += u[i] * accel

        # Rigid body: force = m (vdot + w x v + wdot x c + w x (w x c)) - m g.
        f = force[b]
        w = v[3:]
        c_b = com[b]
        _rotate_back(R_W[b], gravity, t3)
        _cross(w, v[:3], t1)
        for i in range(3):
            t1[i] += a[i] - t3[i]  # acceleration of the joint frame less gravity

        _cross(a[3:], c_b, t2)
        for i in range(3):
            f[i] = t1[i] + t2[i]
        _cross(w, c_b, t2)
        _cross(w, t2, mom[:3])
        for i in range(3):
            f[i] = mass[b] * (f[i] + mom[i])

        # Moment = I wdot + w x (I w) + m c x (acceleration less gravity)
        _cross(c_b, t1, t2)
        _rotate(inertia[b], w, mom[:3])
        _cross(w, mom[:3], t1)
        _rotate(inertia[b], a[3:], mom[3:])
        for i in range(3):
            f[3 + i] = mom[3 + i] + t1[i] + mass[b] * t2[i]

        # Water, at the body's own origin o (the joint frame moved by `origin`).
        o = origin[b]
        _rotate_back(R_W[b], v_current_W, t3)
        _cross(w, o, t1)
        _cross(a[3:], o, t2)
        for i in range(3):
            v_r[i] = v[i] + t1[i] - t3[i]
            v_r[3 + i] = w[i]
            a_r[3 + i] = a[3 + i]

        _cross(w, t3, t1)  # a steady current rotates in body axes
        for i in range(3):
            a_r[i] = a[i] + t2[i] + t1[i]

        # Momentum p = A nu_r, which the rotation turns
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += added[b, i, j] * v_r[j]
            mom[i] = total
        _cross(w, mom[:3], t1)
        _cross(w, mom[3:], t2)
        _cross(v_r[:3], mom[:3], t3)
        h0, h1, h2 = t1[0], t1[1], t1[2]
        h3, h4, h5 = t2[0] + t3[0], t2[1] + t3[1], t2[2] + t3[2]
        mom[0], mom[1], mom[2], mom[3], mom[4], mom[5] = h0, h1, h2, h3, h4, h5

        # Added mass and damping
        for i in range(6):
            total = mom[i] + quadratic[b, i] * abs(v_r[i]) * v_r[i]
            for j in range(6):
                total += added[b, i, j] * a_r[j] + linear[b, i, j] * v_r[j]
            mom[i] = total

        # Buoyancy, and all of it in the joint frame
        _rotate_back(R_W[b], gravity, t3)
        for i in range(3):  # buoyancy lifts with -rho V g: the joint must hold it down
            t3[i] *= buoyancy[b]
            mom[i] += t3[i]
        _cross(cob[b], t3, t1)
        _cross(o, mom[:3], t2)
        for i in range(3):
            f[i] += mom[i]
            f[3 + i] += mom[3 + i] + t1[i] + t2[i]

    # Drag of the strips, at their stations
    for k in range(stations.shape[0]):
        b = int(stations[k, 0])
        w = nu[b, 3:]
        for i in range(3):
            t1[i] = stations[k, 1 + i] + origin[b, i]
        _cross(w, t1, t2)
        _rotate_back(R_W[b], v_current_W, t3)

        # Velocity along and across the strip
        along = 0.0
        for i in range(3):
            t2[i] += nu[b, i] - t3[i]
            along += t2[i] * stations[k, 4 + i]
        across = 0.0
        for i in range(3):
            t3[i] = t2[i] - along * stations[k, 4 + i]
            across += t3[i] * t3[i]
        across = np.sqrt(across)

        for i in range(3):
            t2[i] = (
                stations[k, 7] * across * t3[i]
                + stations[k, 8] * abs(along) * along * stations[k, 4 + i]
            )

        _cross(t1, t2, t3)
        for i in range(3):
            force[b, i] += t2[i]
            force[b, 3 + i] += t3[i]

    # The contact wrench on the tip reduces the load of the joints.
    _rotate(R_tip, wrench_tip[:3], t1)
    _rotate(R_tip, wrench_tip[3:], t2)
    _cross(p_tip, t1, t3)
    for i in range(3):
        force[tip_body, i] -= t1[i]
        force[tip_body, 3 + i] -= t2[i] + t3[i]

    # Backward pass: torque of each joint, and the load that it hands to its parent
    for i in range(6):
        wrench_B[i] = 0.0
    for b in range(nb - 1, -1, -1):
        f = force[b]
        if column[b] >= 0:
            first = 3 if kind[b] == HINGE else 0
            tau[column[b]] = (
                axis[b, 0] * f[first] + axis[b, 1] * f[first + 1] + axis[b, 2] * f[first + 2]
            )

        _rotate(R[b], f[:3], t1)
        _rotate(R[b], f[3:], t2)
        _cross(p[b], t1, t3)

        if parent[b] < 0:
            for i in range(3):
                wrench_B[i] -= t1[i]
                wrench_B[3 + i] -= t2[i] + t3[i]
        else:
            up = force[parent[b]]
            for i in range(3):
                up[i] += t1[i]
                up[3 + i] += t2[i] + t3[i]


@kernel
def tip_kinematics(arm, work, X_BG, J_B):
    """Tip pose in the hull's frame and its Jacobian, from what `newton_euler` left in `work`.

    Args:
        arm: `ArmParameters`.
        work: working memory of `newton_euler`, with the joint rotations and positions.
        X_BG: (4, 4) output: tip pose in the hull's frame.
        J_B: (6, n) output: Jacobian of the tip, linear over angular, hull axes.
    """
    layout = arm.layout
    numbers = arm.numbers
    nb = layout.shape[1]
    R = work[: 9 * nb].reshape(nb, 3, 3)
    p = work[9 * nb : 12 * nb].reshape(nb, 3)
    axis = numbers[0 : 3 * nb].reshape(nb, 3)
    p_tip = numbers[113 * nb + 3 : 113 * nb + 6]
    R_tip = numbers[113 * nb + 6 : 113 * nb + 15].reshape(3, 3)
    J_B[:, :] = 0.0

    # From the tip inward: tip pose relative to each body, and the columns of all joints rotated
    # along.
    X_BG[:3, :3] = R_tip
    X_BG[:3, 3] = p_tip
    X_BG[3, :3] = 0.0
    X_BG[3, 3] = 1.0

    t = work[39 * nb : 39 * nb + 3]
    b = layout[3, 0]
    while b >= 0:
        column = layout[2, b]
        kind = layout[1, b]
        if column >= 0:
            if kind == HINGE:
                _cross(axis[b], X_BG[:3, 3], t)
                for i in range(3):
                    J_B[i, column] = t[i]
                    J_B[3 + i, column] = axis[b, i]
            else:
                for i in range(3):
                    J_B[i, column] = axis[b, i]

        # Pose and columns in the frame of the parent
        for j in range(J_B.shape[1]):
            for first in (0, 3):
                x, y, z = J_B[first, j], J_B[first + 1, j], J_B[first + 2, j]
                for i in range(3):
                    J_B[first + i, j] = R[b, i, 0] * x + R[b, i, 1] * y + R[b, i, 2] * z

        for j in range(4):
            x, y, z = X_BG[0, j], X_BG[1, j], X_BG[2, j]
            for i in range(3):
                X_BG[i, j] = R[b, i, 0] * x + R[b, i, 1] * y + R[b, i, 2] * z
        for i in range(3):
            X_BG[i, 3] += p[b, i]

        b = layout[0, b]


# Entries from Python take plain tuples: numba finds the type of a NamedTuple ten times slower.


@kernel
def inverse_dynamics(arm, joints, hull, wrench_tip):
    """Joint torques (n,) [N m] and wrench (6,) [N, N m] of the arm on the hull, by `newton_euler`.

    Args:
        arm: fields of `ArmParameters`, in a tuple.
        joints: fields of `JointMotion`, in a tuple.
        hull: (24,) motion of the hull as in `newton_euler`.
        wrench_tip: (6,) [N, N m] of the world on the tip, tool axes.

    Returns:
        Torques and wrench, as in `newton_euler`.
    """
    arm = ArmParameters(*arm)
    joints = JointMotion(*joints)
    tau = np.empty(joints.q.shape[0])
    wrench_B = np.empty(6)

    newton_euler(arm, joints, hull, wrench_tip, workspace(arm.layout), tau, wrench_B)
    return tau, wrench_B


@kernel
def _tip(arm, q):
    arm = ArmParameters(*arm)
    n = q.shape[0]
    rest = np.zeros(n)
    work = workspace(arm.layout)
    X_BG = np.empty((4, 4))
    J_B = np.empty((6, n))

    newton_euler(
        arm, JointMotion(q, rest, rest), np.zeros(24), np.zeros(6), work, np.empty(n), np.empty(6)
    )

    tip_kinematics(arm, work, X_BG, J_B)
    return X_BG, J_B


class ArmDynamics:
    """Inverse dynamics of a vehicle's arm: joint torques, and the arm's wrench on the hull.

    `parameters` is the arm as the kernels of this module take it. Nothing here changes after the
    set-up.
    """

    def __init__(
        self, model: mujoco.MjModel, *, passive: bool = False, water_error: float = 0.0
    ) -> None:
        """Read the arm of the vehicle in `model` (`uuv.models.vehicle.Vehicle`).

        Args:
            model: compiled model of the vehicle.
            passive: True makes joints without actuator (the sliding pad) coordinates too, in the
                order of the model. By default they are held at their qpos0, as a controller sees
                them.
            water_error: [-] scales every hydrodynamic coefficient by 1 + water_error, for a
                deliberately wrong model; volumes stay. Above -1.

        Raises:
            ConfigurationError: `water_error` is out of range, the arm has joints other than hinges
                and slides, or a body with several joints, or the hull carries no other body.
        """
        vehicle = Vehicle.of(model)
        share = 1.0 + finite_number(water_error, "water_error", above=-1.0)
        self._tree, self.joint_names, rows = read_tree(model, vehicle, passive, share)
        tree = self._tree
        nb = len(tree.parent)
        self.n = len(self.joint_names)

        if not rows:
            raise ConfigurationError("the hull carries no other body: there is no arm")

        tip_row = 0
        R_tip = np.eye(3).ravel()
        p_tip = np.zeros(3)
        if vehicle.tip >= 0:  # otherwise all bodies are fixed to the hull, and there is no tip
            tip_row = rows[int(model.site_bodyid[vehicle.tip])]
            mujoco.mju_quat2Mat(R_tip, model.site_quat[vehicle.tip])
            p_tip = model.site_pos[vehicle.tip] + tree.origin[tip_row]

        self.parameters = ArmParameters(
            layout=np.stack([tree.parent, tree.kind, tree.column, np.full(nb, tip_row)]),
            numbers=tree.packed(np.array(model.opt.gravity), R_tip, p_tip),
            stations=tree.stations,
        )

    def of_bodies(self, numbers: Array, *names: str) -> tuple[Array, ...]:
        """Views (nb, k) of parameters of each body in a packed block `numbers`, to change the arm.

        Names and widths k:

        - "mass" [kg] (1), "com" [m] (3), "inertia" about the joint frame's origin [kg m^2] (9).
        - Water, in SI: "added" and "linear" (6 x 6, 36), "quadratic" (6).
        - "buoyancy", the displaced mass [kg] (1), and "cob" [m] (3).
        - Kinematics: "axis" (3), "R0" (9), "p0" and "origin" [m] (3).

        Raises:
            KeyError: another name.
        """
        nb = len(self._tree.parent)
        views = {}
        first = 0

        for name, width in OF_BODIES.items():
            views[name] = numbers[first : first + nb * width].reshape(nb, width)
            first += nb * width
        return tuple(views[name] for name in names)

    def weightless(self, numbers: Array) -> None:
        """Set gravity to zero in a packed block `numbers`, which also removes buoyancy."""
        first = len(self._tree.parent) * sum(OF_BODIES.values())
        numbers[first : first + 3] = 0.0

    def with_load(self, numbers: Array, load: HeldLoad) -> Array:
        """Copy of a packed block `numbers` with a load that is fixed to the tip.

        The load's water is that of a sphere: half of the displaced mass moves with it. Its drag is
        left out.
        """
        loaded = numbers.copy()
        names = "mass", "com", "inertia", "added", "buoyancy", "cob", "origin"
        tip = int(self.parameters.layout[3, 0])
        mass, com, inertia, added, buoyancy, cob, origin = (
            view[tip] for view in self.of_bodies(loaded, *names)
        )

        # Places in the joint frame of the tip's body.
        first = len(self._tree.parent) * sum(OF_BODIES.values()) + 3
        p_tip = numbers[first : first + 3]
        R_tip = numbers[first + 3 : first + 12].reshape(3, 3)
        c = p_tip + R_tip @ load.center_G
        b = p_tip + R_tip @ load.buoyancy_G

        # Body.
        inertia += load.mass * np.ravel((c @ c + load.radius**2) * np.eye(3) - np.outer(c, c))
        if mass[0] + load.mass:
            com[:] = (mass[0] * com + load.mass * c) / (mass[0] + load.mass)
        mass += load.mass

        # Water, about the body's own origin.
        at = b - origin
        if buoyancy[0] + load.displaced:
            cob[:] = (buoyancy[0] * cob + load.displaced * at) / (buoyancy[0] + load.displaced)
        buoyancy += load.displaced
        lever = np.array([[0.0, -at[2], at[1]], [at[2], 0.0, -at[0]], [-at[1], at[0], 0.0]])
        along = np.hstack([np.eye(3), -lever])
        added += 0.5 * load.displaced * np.ravel(along.T @ along)
        return loaded

    def bearing(self, load: HeldLoad) -> Self:
        """The same arm with a load that is fixed to its tip."""
        loaded = copy(self)
        numbers = self.with_load(self.parameters.numbers, load)
        loaded.parameters = self.parameters._replace(numbers=numbers)
        return loaded

    def inverse(
        self,
        q: Array,
        qd: Array,
        qdd: Array,
        *,
        R_WB: Array,
        nu_B: Array,
        a_B: Array,
        v_current_W: Array,
        wrench_tip_G: Array,
    ) -> tuple[Array, Array]:
        """Torques at the gear outputs and the arm's wrench on the hull.

        Args:
            q: (n,) [rad] joint angles.
            qd: (n,) [rad/s] joint speeds.
            qdd: (n,) [rad/s^2] joint accelerations.
            R_WB: (3, 3) attitude of the hull.
            nu_B: (6,) [m/s, rad/s] velocity of the hull, (linear; angular), hull axes.
            a_B: (6,) [m/s^2, rad/s^2] acceleration of the hull's origin and its angular
                acceleration, hull axes.
            v_current_W: (3,) [m/s] steady current.
            wrench_tip_G: (6,) [N, N m] wrench of the world on the tip, tool axes.

        Returns:
            tau (n,) [N m] at the gear outputs, without rotor inertia and gear friction, and the
            wrench (6,) [N, N m] of the arm on the hull at the hull's origin, hull axes.
        """
        hull = np.empty(24)
        hull[:9] = R_WB.ravel()
        hull[9:15] = nu_B
        hull[15:21] = a_B  # converted to the time derivative of the components of nu_B: a - w x v

        v0, v1, v2, w0, w1, w2 = nu_B
        hull[15] -= w1 * v2 - w2 * v1
        hull[16] -= w2 * v0 - w0 * v2
        hull[17] -= w0 * v1 - w1 * v0

        hull[21:] = v_current_W
        # writable: for others the kernel were compiled again
        q, qd, qdd = np.array((q, qd, qdd), dtype=np.float64)
        return inverse_dynamics(tuple(self.parameters), (q, qd, qdd), hull, wrench_tip_G)

    def tip(self, q: Array) -> tuple[Array, Array]:
        """Tip pose X_BG (4, 4) and its Jacobian (6, n), hull axes, at joint angles `q` (n,)."""
        # writable, as in `inverse`
        return _tip(tuple(self.parameters), np.array(q, dtype=np.float64))

    def wrench_at_rest(self, q: Array) -> Array:
        """Wrench (6,) [N, N m] of the arm on the hull at `q` (n,), both at rest and level."""
        rest = np.zeros(self.n)
        none = np.zeros(6)
        return self.inverse(
            q,
            rest,
            rest,
            R_WB=np.eye(3),
            nu_B=none,
            a_B=none,
            v_current_W=none[:3],
            wrench_tip_G=none,
        )[1]

    def inertia(self, q: Array) -> Array:
        """Joint-space inertia (n, n) at `q` (n,), hull held, with added mass but not the rotors."""
        rest = np.zeros(self.n)
        none = np.zeros(6)

        def torque(qdd: Array) -> Array:
            return self.inverse(
                q,
                rest,
                qdd,
                R_WB=np.eye(3),
                nu_B=none,
                a_B=none,
                v_current_W=none[:3],
                wrench_tip_G=none,
            )[0]

        return np.column_stack([torque(unit) for unit in np.eye(self.n)]) - torque(rest)[:, None]
