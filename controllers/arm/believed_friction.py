"""Dry friction in the gears as the controller believes it, for drives without torque sensors."""

import numba
import numpy as np

from sim.interfaces.kernels import keyed_by_imports


@numba.njit(cache=True)
@keyed_by_imports
def dry_friction(coulomb, stiction, stribeck_speed, width, qd, friction):
    """Torque `friction` (n,) [N m] that the drives must overcome at the speeds `qd` (n,): Stribeck's curve.

    Its step at rest is drawn out over `width` [rad/s], so that no noise of the speed makes it chatter.
    """
    for j in range(qd.shape[0]):
        share = np.exp(-((qd[j] / stribeck_speed[j]) ** 2))
        friction[j] = (coulomb[j] + (stiction[j] - coulomb[j]) * share) * np.tanh(qd[j] / width)


@numba.njit(cache=True)
@keyed_by_imports
def doubt(coulomb, stiction, width, known, qd, sigma):
    """Standard deviation `sigma` (n,) [N m] of that torque: at rest anything up to stiction, else 1 - `known` of it."""
    for j in range(qd.shape[0]):
        held = 1.0 - np.tanh(qd[j] / width) ** 2
        sigma[j] = np.sqrt((0.6 * stiction[j] * held) ** 2 + ((1.0 - known) * coulomb[j]) ** 2)
