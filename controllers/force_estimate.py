"""Force on the tool from joint torques alone: what remains after the model of the arm, put through J^T.

Signs: `tau_e` is the torque that the contact puts on the joints, J^T f, with f the force of the world on the tip.
"""

from dataclasses import dataclass

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array


def tip_force(tau_e: Array, J: Array, sigma: Array) -> tuple[Array, Array]:
    """Least-squares force on the tip from the external torques of all joints.

    Args:
        tau_e: (n,) [N m].
        J: (3, n) linear Jacobian of the tip, in the axes in which the force is wanted [m/rad].
        sigma: (n,) standard deviation of each torque [N m].

    Returns:
        The force (3,) [N] and its covariance (3, 3) [N^2], which grows near singular postures.
    """
    A = J.T / sigma[:, None]
    information = A.T @ A
    # A posture that cannot feel one direction gives no answer there; a weak prior (sigma 1 kN) says zero instead.
    covariance = np.asarray(np.linalg.inv(information + 1e-6 * np.eye(3)), dtype=np.float64)
    return covariance @ (A.T @ (tau_e / sigma)), covariance


def tip_force_closed_form(tau_e: Array, q: Array, lengths: tuple[float, float, float]) -> Array:
    """The paper's force on the tool from joints 1, 3 and 4 (paper 002, eq. 5), for show and comparison.

    Holds for a pure force on the paper's arm: yaw joint, then three parallel pitch joints, joints 5 and 6 at zero.

    Args:
        tau_e: (n >= 4,) [N m].
        q: (n >= 4,) [rad].
        lengths: l2, l3 and l4, the last up to the tip [m].

    Returns:
        (Fx, Fy, Fz) [N] in the paper's G: x along link 4, z across it in the arm's plane, y out of the plane.

    Raises ConfigurationError at its singularities: sin q4 = 0, and the tip over the yaw axis.
    """
    l2, l3, l4 = lengths
    c2, c23, c234 = np.cos(q[1]), np.cos(q[1] + q[2]), np.cos(q[1] + q[2] + q[3])
    c4, s4 = np.cos(q[3]), np.sin(q[3])
    radius = l2 * c2 + l3 * c23 + l4 * c234
    if abs(s4) < 1e-6 or abs(radius) < 1e-6:
        raise ConfigurationError(f"eq. (5) is singular here: sin q4 = {s4:.2e}, tip {radius:.2e} m from the yaw axis")
    Fz = tau_e[3] / l4
    Fx = (tau_e[2] - (1.0 + l3 * c4 / l4) * tau_e[3]) / (l3 * s4)
    return np.array([Fx, tau_e[0] / radius, Fz])


@dataclass(slots=True, eq=False)
class Tare:
    """Mean of what the torque sensors show free of contact: their bias, and what the model does not know here."""

    total: Array  # (n,) [N m]
    count: int = 0

    def add(self, tau_e: Array) -> None:
        self.total += tau_e
        self.count += 1

    def bias(self) -> Array:
        """(n,) [N m]; zero before the first sample."""
        return self.total / max(self.count, 1)
