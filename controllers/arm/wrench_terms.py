"""Terms of the arm's wrench on the hull, to study the value of compensating each one.

[Konoplin 2022] feeds C_F = D_F + A f_e forward as one. Here, with the equations of `controllers.arm.inverse_dynamics`:

    wrench = weight and buoyancy + dynamic (rigid inertia) + hydrodynamic (added mass and drag) + contact
"""

import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics, newton_euler
from sim.interfaces.spatial import Array


class WrenchTerms:
    """Single terms of the arm's wrench (6,) [N, N m] on the hull, at the hull's origin in hull axes."""

    def __init__(self, arm: ArmDynamics) -> None:
        self._arm = arm
        self._dry = arm.numbers.copy()
        for water in arm.of_bodies(self._dry, "added", "linear", "quadratic"):
            water[:] = 0.0
        self._no_stations = arm.stations[:0]
        self._no_contact, self._tau = np.zeros(6), np.empty(arm.n)

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
        arm = self._arm
        return self._wrench(arm.numbers, arm.stations, hull, q, qd, qdd) - self._without_water(hull, q, qd, qdd)

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
        return self._without_water(hull, q, qd, qdd) - self._without_water(at_rest, q, still, still)

    def _without_water(self, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
        return self._wrench(self._dry, self._no_stations, hull, q, qd, qdd)

    def _wrench(self, numbers: Array, stations: Array, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
        wrench_B = np.empty(6)
        newton_euler(
            self._arm.layout, numbers, stations, q, qd, qdd, hull, self._no_contact, self._arm.work, self._tau, wrench_B
        )
        return wrench_B
