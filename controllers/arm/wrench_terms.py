"""Terms of the arm's wrench on the hull, to study the benefit of compensating each of them.

[Konoplin 2022] feeds C_F = D_F + A f_e forward as one wrench. Here, with the equations of
`uuv.controllers.arm.inverse_dynamics`:

    wrench = weight and buoyancy + dynamic + hydrodynamic + contact

"dynamic" is the wrench of rigid inertia, "hydrodynamic" that of added mass and drag.
"""

import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics, ArmParameters, inverse_dynamics
from uuv.sim.interfaces.spatial import Array


class WrenchTerms:
    """Terms of the arm's wrench (6,) [N, N m] on the hull, at the hull's origin in hull axes."""

    def __init__(self, arm: ArmDynamics) -> None:
        self._wet = arm.parameters
        dry = self._wet.numbers.copy()
        for water in arm.of_bodies(dry, "added", "linear", "quadratic"):
            water[:] = 0.0
        self._dry = self._wet._replace(numbers=dry, stations=self._wet.stations[:0])

    def hydrodynamic(self, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Wrench (6,) [N, N m] of added mass and drag.

        Args:
            hull: (24,) motion of the hull as in `newton_euler`.
            q: (n,) [rad] joint angles.
            qd: (n,) [rad/s] joint speeds.
            qdd: (n,) [rad/s^2] joint accelerations.

        Returns:
            The wrench on the hull, hull axes.
        """
        return _wrench(self._wet, hull, q, qd, qdd) - _wrench(self._dry, hull, q, qd, qdd)

    def dynamic(self, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Wrench (6,) [N, N m] of the rigid-body inertia of the arm, as in air.

        Args:
            hull: (24,) motion of the hull as in `newton_euler`.
            q: (n,) [rad] joint angles.
            qd: (n,) [rad/s] joint speeds.
            qdd: (n,) [rad/s^2] joint accelerations.

        Returns:
            The wrench on the hull, hull axes.
        """
        at_rest = hull.copy()
        at_rest[9:21] = 0.0
        still = np.zeros_like(q)
        return _wrench(self._dry, hull, q, qd, qdd) - _wrench(self._dry, at_rest, q, still, still)


def _wrench(arm: ArmParameters, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
    return inverse_dynamics(tuple(arm), (q, qd, qdd), hull, np.zeros(6))[1]
