"""Peers of the physics benchmark: other ways to simulate an underwater vehicle from Python."""

import math
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec

import mujoco
import numpy as np

from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim.interfaces.spatial import Array, skew

Stepper = Callable[[int], None]  # takes the given number of steps


def cross(a: Array, b: Array) -> Array:
    """Cross product row by row; numpy's own is ten times as slow on a few rows."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def numpy_callback(model: mujoco.MjModel) -> Callable[[mujoco.MjModel, mujoco.MjData], None]:
    """Passive callback with quadratic drag and buoyancy only, vectorised over the bodies in numpy.

    It shows the cost of a Python callback.
    """
    roots = model.body_rootid[1:]
    drag = 5.0
    lift = np.array([0.0, 0.0, 10.0])
    below = np.eye(model.nbody)  # below[i, j]: body j is i or a descendant of it
    for i in range(model.nbody - 1, 0, -1):
        below[model.body_parentid[i]] += below[i]
    below = below[model.dof_bodyid][:, 1:]

    def passive(_: mujoco.MjModel, d: mujoco.MjData) -> None:
        R = d.xmat[1:].reshape(-1, 3, 3)
        r = d.xpos[1:] - d.subtree_com[roots]
        w = d.cvel[1:, :3]
        nu = np.stack([d.cvel[1:, 3:] + cross(w, r), w], axis=2)
        nu = R.transpose(0, 2, 1) @ nu
        f = R @ (-drag * np.abs(nu) * nu)
        force = f[:, :, 0] + lift
        wrench = np.concatenate([f[:, :, 1] + cross(r, force), force], axis=1)
        d.qfrc_passive += np.sum(d.cdof * (below @ wrench), axis=1)

    return passive


def fossen_loop(
    mass: float, inertia: Array, body: BodyHydrodynamics, timestep: float, density: float
) -> Stepper:
    """Explicit Euler loop in numpy for one rigid body by the vectorial model of [Fossen 2021, eq.
    8.4].

    (M_RB + M_A) nudot + C_RB(nu) nu + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = 0, with Euler
    angles. The inverse of the inertia is computed once. Python vehicle simulators commonly work
    this way.

    Args:
        mass: [kg].
        inertia: (3,) [kg m^2] principal, about the centre of mass, which is the origin.
        body: Hydrodynamic coefficients.
        timestep: [s].
        density: [kg/m^3] of the water.

    Returns:
        Function that takes steps.
    """
    M_RB = np.diag([mass, mass, mass, *inertia])
    M_A, D, Dq = body.added_mass, body.linear_damping, body.quadratic_damping
    Minv = np.linalg.inv(M_RB + M_A)
    lift, r_b = density * body.volume * 9.81, body.center_of_buoyancy
    nu, eta, nu_c = np.array([0.3, 0.1, 0.0, 0.01, 0.02, 0.03]), np.zeros(6), np.zeros(6)

    def coriolis(M: Array, nu: Array) -> Array:
        C = np.zeros((6, 6))  # [Fossen 2021, theorem 3.2]
        momentum = M @ nu
        C[:3, 3:] = C[3:, :3] = -skew(momentum[:3])
        C[3:, 3:] = -skew(momentum[3:])
        return C

    def run(steps: int) -> None:
        nonlocal nu, eta
        for _ in range(steps):
            # Rotation, and rates of the Euler angles.
            phi, theta, psi = eta[3:].tolist()
            cf, sf, ct, st, cp, sp = (
                math.cos(phi),
                math.sin(phi),
                math.cos(theta),
                math.sin(theta),
                math.cos(psi),
                math.sin(psi),
            )

            R = np.array(
                [
                    [cp * ct, cp * st * sf - sp * cf, sp * sf + cp * cf * st],
                    [sp * ct, cp * cf + sf * st * sp, st * sp * cf - cp * sf],
                    [-st, ct * sf, ct * cf],
                ]
            )
            T = np.array(
                [[1.0, sf * st / ct, cf * st / ct], [0.0, cf, -sf], [0.0, sf / ct, cf / ct]]
            )

            # Equation of motion, and a step of Euler with the new velocity.
            nu_r = nu - nu_c
            up = R.T @ np.array([0.0, 0.0, 1.0])
            restoring = np.concatenate([(lift - 9.81 * mass) * up, np.cross(r_b, lift * up)])
            damping = D @ nu_r + Dq * np.abs(nu_r) * nu_r
            nudot = Minv @ (
                restoring - damping - coriolis(M_RB, nu) @ nu - coriolis(M_A, nu_r) @ nu_r
            )

            nu = nu + timestep * nudot
            eta = eta + timestep * np.concatenate([R @ nu[:3], T @ nu[3:]])

    return run


def auv_sim_bench(timestep: float) -> Stepper | None:
    """Dynamics of auv-sim-bench (one body, diagonal drag, no added mass); None if not installed."""
    if find_spec("auv_sim_bench") is None:
        return None

    vehicle = import_module("auv_sim_bench.dynamics").AUVDynamics()
    vehicle.s.v = np.array([0.3, 0.1, 0.0])
    force = np.zeros(3)
    torque = np.zeros(3)

    def run(steps: int) -> None:
        for _ in range(steps):
            vehicle.step(timestep, force, torque)

    return run
