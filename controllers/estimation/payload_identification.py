"""Weighing the arm while it unfolds: by how much each of its parts is heavier than believed.

What the torque sensors show beyond the model in one posture is a bias as good as any, and the tare takes it off. A part
that is heavier than believed shows more in another posture: 10 % of the weights of a PUMA-type arm became 6 N of false
force half around a barrel. On its way from folded to the work the arm passes many postures, free of contact, and there
the two can be told apart:

    tau_model - tau_measured = -sum_k G_k(q) d_k - b - H w

with G_k the torques (n,) of the weight and inertia of part k, d_k its excess as a share of its mass, b the sensors'
bias, H what moving water adds and w the share by which that is more, a least squares with priors on all three. A part
whose excess no torque shows keeps what was believed.
"""

from dataclasses import dataclass

import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics, newton_euler
from sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class PayloadIdentificationState:
    """What was seen so far; arrays change in place."""

    information: Array  # (u, u) of the unknowns: nb excesses, n biases, the water's share
    seen: Array  # (u,)
    total: Array  # (n, u + 1) sums over this posture: -G, -I, -H, tau_e
    count: int
    q: Array  # (n,) [rad] where it began


class PayloadIdentification:
    """Least squares over the postures that an arm passes on its way to work."""

    def __init__(
        self,
        arm: ArmDynamics,
        *,
        spread: float = 0.06,
        bias: float = 0.5,
        doubt: float = 0.4,
        water: float = 0.2,
        step: float = 0.05,
    ) -> None:
        """Take the arm as it is believed to be.

        `spread` of a part's mass as a share of it and `bias` [N m] of a torque sensor are believed beforehand
        (standard deviations), and so is the share `water` by which the arm's drag and added mass are wrong in common.
        What else is wrong in each torque of a posture: `doubt` [N m], and the share `water` of what moving water adds
        once more, for not all parts are wrong alike. A posture counts as another from `step` [rad] on.
        """
        self._arm, self._doubt, self._water, self._step = arm, doubt, water, step
        nb = arm.layout.shape[1]
        self._parts: list[Array] = []  # numbers of the arm if only its part k had a mass, and there were no water
        for k in range(nb):
            alone = arm.numbers.copy()
            for masses in arm.of_bodies(alone, "mass", "inertia"):
                masses[np.arange(nb) != k] = 0.0
            for wet in arm.of_bodies(alone, "added", "linear", "quadratic", "buoyancy"):
                wet[:] = 0.0
            self._parts.append(alone)
        self._of_water = arm.numbers.copy()  # added mass and drag alone
        for heavy in arm.of_bodies(self._of_water, "mass", "com", "inertia", "buoyancy"):
            heavy[:] = 0.0
        self._prior = np.concatenate([np.full(nb, spread**-2), np.full(arm.n, bias**-2), [water**-2]])
        self._none = np.zeros((0, 9))

    def init(self) -> PayloadIdentificationState:
        """Nothing seen: what is believed beforehand."""
        n, unknowns = self._arm.n, self._prior.size
        return PayloadIdentificationState(
            np.diag(self._prior), np.zeros(unknowns), np.zeros((n, unknowns + 1)), 0, np.zeros(n)
        )

    def add(
        self, state: PayloadIdentificationState, q: Array, qd: Array, qdd: Array, hull: Array, tau_e: Array
    ) -> None:
        """Take what the sensors lack against the model, `tau_e` (n,) [N m], free of contact.

        `q`, `qd`, `qdd` (n,) [rad, rad/s, rad/s^2] are the arm's motion, `hull` (24,) is the hull's as `newton_euler`
        takes it.
        """
        nb, n = len(self._parts), self._arm.n
        torque, wrench, none, layout, work = np.empty(n), np.empty(6), np.zeros(6), self._arm.layout, self._arm.work
        for k, alone in enumerate(self._parts):
            newton_euler(layout, alone, self._none, q, qd, qdd, hull, none, work, torque, wrench)
            state.total[:, k] -= torque
        newton_euler(layout, self._of_water, self._arm.stations, q, qd, qdd, hull, none, work, torque, wrench)
        state.total[:, nb : nb + n] -= np.eye(n)
        state.total[:, nb + n] -= torque
        state.total[:, -1] += tau_e
        if state.count == 0:
            state.q = q.copy()
        state.count += 1
        if np.abs(q - state.q).max() >= self._step:
            self._take(state)

    def _take(self, state: PayloadIdentificationState) -> None:
        mean = state.total / state.count
        weight = 1.0 / (self._doubt**2 + (self._water * mean[:, -2]) ** 2)
        A = mean[:, :-1]
        state.information += A.T @ (weight[:, None] * A)
        state.seen += A.T @ (weight * mean[:, -1])
        state.total[:] = 0.0
        state.count = 0

    def excess(self, state: PayloadIdentificationState) -> Array:
        """By how much each part (nb,) is heavier than believed, as a share."""
        if state.count:
            self._take(state)
        found = np.asarray(np.linalg.solve(state.information, state.seen), dtype=np.float64)
        return found[: len(self._parts)]

    def weighed(self, excess: Array) -> Array:
        """The arm's numbers, for `newton_euler`, with parts heavier by `excess` (nb,), shares of their masses."""
        numbers = self._arm.numbers.copy()
        for masses in self._arm.of_bodies(numbers, "mass", "inertia"):
            masses *= (1.0 + excess)[:, None]
        return numbers
