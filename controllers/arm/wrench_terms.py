"""The arm's wrench on the hull taken apart, so that a study can tell what each term of its compensation is worth.

Paper 002 feeds C_F = D_F + A f_e forward as one. Here, with the equations of `controllers.arm.inverse_dynamics`:

    wrench = weight and buoyancy + dynamic (rigid inertia) + hydrodynamic (added mass and drag) + contact
"""

import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics, newton_euler
from sim.interfaces.spatial import Array


class WrenchTerms:
    """Single terms of the wrench (6,) [N, N m] of the arm on the hull, at its origin in hull axes."""

    def __init__(self, arm: ArmDynamics) -> None:
        self._arm = arm
        self._dry = arm.numbers.copy()
        for water in arm.of_bodies(self._dry, "added", "linear", "quadratic"):
            water[:] = 0.0
        self._no_stations = arm.stations[:0]
        self._no_contact, self._tau = np.zeros(6), np.empty(arm.n)

    def hydrodynamic(self, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Of added mass and drag. `hull` (24,) as for `newton_euler`; `q`, `qd`, `qdd` (n,) [rad, rad/s, rad/s^2]."""
        arm = self._arm
        return self._wrench(arm.numbers, arm.stations, hull, q, qd, qdd) - self._without_water(hull, q, qd, qdd)

    def dynamic(self, hull: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Of the inertia of the arm's bodies, in air as in water; arguments as above."""
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
