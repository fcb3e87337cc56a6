"""Least-squares contact force at the tool from joint torques, in plain form, with covariance.

The residual of the torques against the arm model is mapped through J^T. The form that runs in the
loop is compiled, in `uuv.controllers.estimation.tip_force_estimator`.

Signs: `tau_e` is the torque that the contact puts on the joints, J^T f, with f the force of the
world on the tip.
"""

from dataclasses import dataclass

import numpy as np

from uuv.controllers.estimation.tip_force_kernels import PRIOR
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array


def tip_force(tau_e: Array, J: Array, sigma: Array) -> tuple[Array, Array]:
    """Least-squares force on the tip from the external torques of all joints.

    Args:
        tau_e: (n,) [N m] external torques.
        J: (3, n) [m/rad] linear Jacobian of the tip, in the axes of the resulting force.
        sigma: (n,) [N m] standard deviation of each torque.

    Returns:
        The force (3,) [N] and its covariance (3, 3) [N^2], which grows near singular postures.
    """
    A = J.T / sigma[:, None]
    information = A.T @ A
    covariance = np.asarray(np.linalg.inv(information + PRIOR * np.eye(3)), dtype=np.float64)
    return covariance @ (A.T @ (tau_e / sigma)), covariance


def force_covariance(J: Array, sigma: Array, torque_covariance: Array) -> Array:
    """Covariance of the force of `tip_force` for torque errors other than its weights `sigma`.

    Args:
        J: (3, n) [m/rad] linear Jacobian of the tip.
        sigma: (n,) [N m] standard deviations used as weights by `tip_force`.
        torque_covariance: (n, n) [N^2 m^2] covariance of the actual torque errors.

    Returns:
        The covariance (3, 3) [N^2].
    """
    A = J.T / sigma[:, None]
    stated = np.asarray(np.linalg.inv(A.T @ A + PRIOR * np.eye(3)), dtype=np.float64)
    gain = stated @ (J / sigma**2)
    return gain @ torque_covariance @ gain.T + PRIOR * stated @ stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WrenchEstimate:
    """Estimated force and moment on the tip, (force; moment), with their observability."""

    wrench: Array  # (6,) [N, N m] force and moment
    covariance: Array  # (6, 6) covariance, that of the prior in unobservable directions
    seen: Array  # (6,) [-] share of the prior's variance that the torques removed, from 0 to 1
    # (6,) least observable direction: unit vector in units of the prior's standard deviations
    blind: Array


def tip_wrench(
    tau_e: Array, J: Array, sigma: Array, *, force_prior: float = 1e3, moment_prior: float = 30.0
) -> WrenchEstimate:
    """Force and moment on the tip from external torques of any joints, with a prior of zero mean.

    Six joints or more observe all six components outside singular postures. Fewer joints observe as
    many combinations as there are joints, and the prior decides the rest. A small `moment_prior`
    explains torques by a force rather than by a moment.

    Args:
        tau_e: (n,) [N m] external torques.
        J: (6, n) Jacobian of the tip, linear over angular, in the axes of the resulting wrench.
        sigma: (n,) [N m] standard deviation of each torque.
        force_prior: [N] prior standard deviation of each force component.
        moment_prior: [N m] prior standard deviation of each moment component.

    Returns:
        The wrench on the tip with its covariance and observability.
    """
    scale = np.repeat([force_prior, moment_prior], 3)
    A = J.T * scale / sigma[:, None]  # the unknowns in units of the prior

    eigenvalues, axes = np.linalg.eigh(A.T @ A)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    scaled = (axes / (1.0 + eigenvalues)) @ axes.T

    return WrenchEstimate(
        wrench=scale * (scaled @ (A.T @ (tau_e / sigma))),
        covariance=scale[:, None] * scaled * scale,
        seen=1.0 - np.diag(scaled),
        blind=axes[:, 0],
    )


def tip_force_closed_form(tau_e: Array, q: Array, lengths: tuple[float, float, float]) -> Array:
    """Closed-form force on the tool from joints 1, 3 and 4 [Konoplin 2022, eq. 5], for comparison.

    It is valid for a pure force on the arm of the paper: a yaw joint, then three parallel pitch
    joints, with joints 5 and 6 at zero.

    Args:
        tau_e: (n >= 4,) [N m] external torques.
        q: (n >= 4,) [rad] joint angles.
        lengths: [m] l2, l3 and l4, the last up to the tip.

    Returns:
        (Fx, Fy, Fz) [N] in frame G of [Konoplin 2022]: x along link 4, z across it in the arm's
        plane, y out of the plane.

    Raises:
        ConfigurationError: the posture is singular: sin q4 = 0, or the tip is over the yaw axis.
    """
    l2, l3, l4 = lengths
    c2 = np.cos(q[1])
    c23 = np.cos(q[1] + q[2])
    c234 = np.cos(q[1] + q[2] + q[3])
    c4, s4 = np.cos(q[3]), np.sin(q[3])

    radius = l2 * c2 + l3 * c23 + l4 * c234
    if abs(s4) < 1e-6 or abs(radius) < 1e-6:
        raise ConfigurationError(
            "closed form of the tip force: eq. (5) is singular in this posture: sin q4 = "
            f"{s4:.2e}, tip {radius:.2e} m from the yaw axis"
        )

    Fz = tau_e[3] / l4
    Fx = (tau_e[2] - (1.0 + l3 * c4 / l4) * tau_e[3]) / (l3 * s4)
    return np.array([Fx, tau_e[0] / radius, Fz])
