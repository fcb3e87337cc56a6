"""Equations of remus100.py in PythonVehicleSimulator (commit 7e1db8e), written down from its
source, in NumPy.

Axes as there: forward, starboard, down; position north, east, down; Euler angles. Nothing of this
project's models is used. The state (15,) is position (3) [m], Euler angles (3) [rad], twist (6)
[m/s, rad/s], rudder and stern plane [rad], and propeller speed [rpm].
"""

import math

import numpy as np

from uuv.sim.interfaces.spatial import Array

RHO, G, L, D, KG = 1026.0, 9.81, 1.6, 0.19, 0.02
A, B = L / 2.0, D / 2.0
M = 4.0 / 3.0 * math.pi * RHO * A * B**2
# at B / (2 T) = 0.5 of its table
_HOERNER = 1.2108 + (0.5 - 0.4933) / (0.5585 - 0.4933) * (1.0836 - 1.2108)


def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _masses() -> tuple[Array, Array]:
    """Rigid-body and added mass (6, 6) at the origin."""
    roll, pitch = 0.4 * M * B**2, 0.2 * M * (A**2 + B**2)

    # Rigid body, moved from the centre of mass to the origin.
    H = np.eye(6)
    H[:3, 3:] = _skew(np.array([0.0, 0.0, KG])).T
    rigid = H.T @ np.diag([M, M, M, roll, pitch, pitch]) @ H

    # Added mass of a prolate spheroid.
    e = math.sqrt(1.0 - (B / A) ** 2)
    log = math.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e**2) / e**3 * (0.5 * log - e)
    beta = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * log
    turning = e**4 * (beta - alpha) / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (beta - alpha)))
    k1, k2 = alpha / (2.0 - alpha), beta / (2.0 - beta)

    return rigid, np.diag([M * k1, M * k2, M * k2, 0.3 * roll, turning * pitch, turning * pitch])


RIGID, ADDED = _masses()
TOTAL = RIGID + ADDED
INVERSE = np.linalg.inv(TOTAL)


def _coriolis(mass: Array, nu: Array) -> Array:
    p, h = (mass @ nu)[:3], (mass @ nu)[3:]
    C = np.zeros((6, 6))
    C[:3, 3:] = C[3:, :3] = -_skew(p)
    C[3:, 3:] = -_skew(h)
    return C


def rates(state: Array, rudder: float, stern: float, rpm: float) -> Array:
    """Derivative (15,) of the state in still water, for commanded fin angles [rad] and propeller
    speed [rpm].
    """
    phi, theta, psi = state[3:6]
    nu, fins, n = state[6:12], state[12:14], state[14] / 60.0
    u, v, w = nu[:3]
    speed = math.sqrt(u * u + v * v + w * w)

    # Coriolis terms of the added mass, without those that the source sets to zero.
    CA = _coriolis(ADDED, nu)
    for i, j in ((4, 0), (4, 2), (5, 0), (5, 1)):
        CA[i, j] = CA[j, i] = 0.0

    # Linear damping; the source lets that of surge and sway fade with the speed.
    righting = M * G * KG
    damping = np.diag(TOTAL) / [20.0, 20.0, 20.0, 1.0, 1.0, 1.0]
    damping[:2] *= math.exp(-3.0 * speed)
    damping[3] *= 2.0 * 0.3 * math.sqrt(righting / TOTAL[3, 3])
    damping[4] *= 2.0 * 0.8 * math.sqrt(righting / TOTAL[4, 4])

    # Lift and drag of the hull at its angle of attack.
    area = 0.7 * L * D
    ratio = D**2 / area
    angle = math.atan2(w, u)
    lift = math.pi * ratio / (1.0 + math.sqrt(1.0 + (ratio / 2.0) ** 2)) * angle
    drag = 0.42 * math.pi * B**2 / area + lift**2 / (math.pi * 0.7 * ratio)
    q = 0.5 * RHO * speed**2 * area

    tau = np.zeros(6)
    tau[0] = q * (-math.cos(angle) * drag + math.sin(angle) * lift)
    tau[2] = q * (-math.sin(angle) * drag - math.cos(angle) * lift)

    # Cross-flow drag by strips along the hull.
    x = np.linspace(-A, A, 21)
    across = -0.5 * RHO * D * _HOERNER * L / 20.0 * np.abs(v + x * nu[5]) * (v + x * nu[5])
    tau[1] += across.sum()
    tau[5] += (x * across).sum()

    # Fins: rudder across, stern plane up and down.
    side, heave = (
        -0.5 * RHO * q2 * 2.0 * 0.00665 * slope * fin
        for q2, slope, fin in ((u * u + v * v, 0.5, fins[0]), (u * u + w * w, 0.7, fins[1]))
    )

    # Propeller.
    advance = 0.944 * speed / 0.14
    flow = advance * abs(n) if n > 0.0 else 0.0
    thrust = RHO * 0.14**4 * (0.4566 * abs(n) * n + (0.1798 - 0.4566) / 0.6632 * flow)
    torque = RHO * 0.14**5 * (0.0700 * abs(n) * n + (0.0312 - 0.0700) / 0.6632 * flow)

    tau += [
        0.9 * thrust + side * fins[0] + heave * fins[1],
        side,
        heave,
        torque / 10.0,
        A * heave,
        -A * side,
    ]

    # Less Coriolis terms, damping and the righting moment.
    tau -= (_coriolis(RIGID, nu) + CA) @ nu + damping * nu
    tau[3:5] -= righting * np.array([math.cos(theta) * math.sin(phi), math.sin(theta)])

    # Kinematics: rotation, and rates of the Euler angles.
    s, c, t = math.sin, math.cos, math.tan(theta)
    R = np.array(
        [
            [c(psi) * c(theta), -s(psi) * c(phi) + c(psi) * s(theta) * s(phi), 0.0],
            [s(psi) * c(theta), c(psi) * c(phi) + s(phi) * s(theta) * s(psi), 0.0],
            [-s(theta), c(theta) * s(phi), c(theta) * c(phi)],
        ]
    )
    R[:, 2] = np.cross(R[:, 0], R[:, 1])
    T = np.array(
        [
            [1.0, s(phi) * t, c(phi) * t],
            [0.0, c(phi), -s(phi)],
            [0.0, s(phi) / c(theta), c(phi) / c(theta)],
        ]
    )

    drives = [(rudder - fins[0]) / 0.1, (stern - fins[1]) / 0.1, rpm - state[14]]
    return np.concatenate([R @ nu[:3], T @ nu[3:], INVERSE @ tau, drives])


def run(seconds: float, rudder: float, rpm: float, step: float = 0.02) -> Array:
    """States (n + 1, 15) from rest, by the source's own integration: Euler's, of the pose with the
    new twist.

    Args:
        seconds: duration [s].
        rudder: commanded angle [rad].
        rpm: commanded propeller speed.
        step: [s]; 0.02 is the source's.
    """
    states = [np.zeros(15)]

    for _ in range(round(seconds / step)):
        # Euler's steps: the twist first, then the pose with the new twist.
        state = states[-1].copy()
        state[6:] += step * rates(state, rudder, 0.0, rpm)[6:]
        moved = np.concatenate([states[-1][:6], state[6:]])
        state[:6] += step * rates(moved, rudder, 0.0, rpm)[:6]

        states.append(state)
    return np.array(states)
