"""Payload identification: mass errors of the arm's parts, estimated as the arm unfolds.

In a single posture the torque residual of a wrong mass looks like a sensor bias, and the tare
removes both. In another posture the residual of a part that is heavier than believed is different.
An error of 10 % in the weights of a PUMA-type arm became 6 N of false force half-way around a
barrel. While the arm moves from the folded posture to the work, it passes many postures free of
contact, in which the two causes can be distinguished:

    tau_model - tau_measured = -sum_k G_k(q) d_k - b - H w

G_k (n,) is the torque of weight and inertia of part k, and d_k the relative excess of its mass. b
is the sensors' bias. H is the torque due to moving water, and w the relative excess of H. This is a
least-squares problem with priors on d, b and w. A part whose excess is unobservable keeps its
modelled mass.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uuv.controllers.arm.inverse_dynamics import (
    ArmDynamics,
    ArmParameters,
    JointMotion,
    inverse_dynamics,
)
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class PayloadIdentificationState:
    """Accumulated normal equations, as arrays that are changed in place."""

    # (u, u) information matrix of the unknowns: nb mass excesses, n biases, the excess of the water
    information: Array
    seen: Array  # (u,) right side of the normal equations
    total: Array  # (n, u + 1) sums over the present posture: -G, -I, -H, tau_e
    count: int  # number of samples in these sums
    q: Array  # (n,) [rad] first angles of the present posture


class _Terms(NamedTuple):
    """Parameters of `newton_euler` with which it computes single terms of the arm's dynamics."""

    layout: np.ndarray  # of `ArmParameters`
    parts: Array  # (nb, k) numbers of the arm in vacuum with the mass of one part only
    water: Array  # (k,) numbers of added mass and drag only
    stations: Array  # drag stations of `ArmParameters`


def in_vacuum(arm: ArmDynamics) -> Array:
    """Packed numbers of an arm without water."""
    numbers = arm.parameters.numbers.copy()
    for wet in arm.of_bodies(numbers, "added", "linear", "quadratic", "buoyancy"):
        wet[:] = 0.0
    return numbers


class PayloadIdentification:
    """Least squares over the postures that an arm passes on its way to the work."""

    def __init__(
        self,
        arm: ArmDynamics,
        *,
        parts: Array | None = None,
        spread: float = 0.06,
        bias: float = 0.5,
        doubt: float | Array = 1.0,
        water: float = 0.2,
        step: float = 0.05,
    ) -> None:
        """Set the modelled arm and the prior standard deviations.

        The error of a torque in a posture combines `doubt` with a share `water` of the torque of
        the moving water, because the errors of single parts differ from their common error.

        Args:
            arm: believed dynamics of the arm.
            parts: (k, numbers) the arm in vacuum with the mass of one part each; None: of its own
                parts.
            spread: [-] prior of a part's mass error, as a share of its mass.
            bias: [N m] prior of a torque sensor's bias.
            doubt: [N m] standard deviation of all other errors of a torque in a posture, or that
                of each torque (n,). It is larger than for a single posture, because neighbouring
                postures share these errors but are treated as independent.
            water: [-] prior of the common relative error of the arm's drag and added mass.
            step: [rad] change of a joint from which on a posture counts as a new one.
        """
        self._arm = arm
        self._doubt = doubt
        self._water = water
        self._step = step

        believed = arm.parameters
        nb = believed.layout.shape[1]

        # The arm with the mass of one part only, and only its water
        if parts is None:
            parts = np.tile(in_vacuum(arm), (nb, 1))
            for k, alone in enumerate(parts):
                for masses in arm.of_bodies(alone, "mass", "inertia"):
                    masses[np.arange(nb) != k] = 0.0
        water_alone = believed.numbers.copy()
        for heavy in arm.of_bodies(water_alone, "mass", "com", "inertia", "buoyancy"):
            heavy[:] = 0.0

        self._terms = tuple(_Terms(believed.layout, parts, water_alone, believed.stations))
        self._prior = np.concatenate(
            [np.full(len(parts), spread**-2), np.full(arm.n, bias**-2), [water**-2]]
        )

    def init(self) -> PayloadIdentificationState:
        """Initial state: the priors only."""
        n = self._arm.n
        unknowns = self._prior.size
        return PayloadIdentificationState(
            np.diag(self._prior), np.zeros(unknowns), np.zeros((n, unknowns + 1)), 0, np.zeros(n)
        )

    def add(
        self, state: PayloadIdentificationState, joints: JointMotion, hull: Array, tau_e: Array
    ) -> None:
        """Add one sample of the torque residual, free of contact.

        Args:
            state: of `init`; changed in place.
            joints: motion of the joints.
            hull: (24,) motion of the hull as in `newton_euler`.
            tau_e: (n,) [N m] torques of the model minus the measured ones.
        """
        _add(self._terms, tuple(joints), hull, tau_e, state.total)

        if state.count == 0:
            state.q = joints.q.copy()
        state.count += 1
        if np.abs(joints.q - state.q).max() >= self._step:
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
        """Estimated excess mass (nb,) [-] of each part, as a share of the part's mass, from all
        samples.
        """
        if state.count:
            self._take(state)
        solution = np.asarray(np.linalg.solve(state.information, state.seen), dtype=np.float64)
        return solution[: len(self._terms[1])]

    def weighed(self, excess: Array) -> ArmParameters:
        """The arm with masses and inertias scaled by 1 + `excess` (nb,) [-]."""
        numbers = self._arm.parameters.numbers.copy()
        for masses in self._arm.of_bodies(numbers, "mass", "inertia"):
            masses *= (1.0 + excess)[:, None]
        return self._arm.parameters._replace(numbers=numbers)


@kernel
def _add(terms, joints, hull, tau_e, total):
    """Add a sample to `total` (n, nb + n + 2): -G, -I, -H, tau_e; `terms`: fields of `_Terms`."""
    layout, parts, water, stations = terms
    nb = parts.shape[0]
    n = tau_e.shape[0]
    none = np.zeros(6)

    # G of each part, then H of the water
    for k in range(nb + 1):
        of_part = k < nb
        alone = (
            ArmParameters(layout, parts[k], stations[:0])
            if of_part
            else ArmParameters(layout, water, stations)
        )
        tau, _ = inverse_dynamics(alone, joints, hull, none)
        for j in range(n):
            total[j, k if of_part else nb + n] -= tau[j]

    # Bias and residual
    for j in range(n):
        total[j, nb + j] -= 1.0
        total[j, nb + n + 1] += tau_e[j]
