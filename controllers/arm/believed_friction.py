"""Nominal ("believed") dry friction of the gears, for drives without torque sensors."""

import numpy as np

from uuv.sim.interfaces.kernels import kernel


@kernel
def dry_friction(coulomb, stiction, stribeck_speed, width, qd, friction):
    """Stribeck friction torque of every gear, with the step at rest smoothed.

    Args:
        coulomb: (n,) [N m] Coulomb friction.
        stiction: (n,) [N m] friction at rest.
        stribeck_speed: (n,) [rad/s] speed over which stiction falls to Coulomb friction.
        width: [rad/s] width of the smoothed step, so that noise of the speed causes no chatter.
        qd: (n,) [rad/s] joint speeds.
        friction: (n,) [N m] output: torque that the drives must overcome.
    """
    for j in range(qd.shape[0]):
        share = np.exp(-((qd[j] / stribeck_speed[j]) ** 2))
        friction[j] = (coulomb[j] + (stiction[j] - coulomb[j]) * share) * np.tanh(qd[j] / width)


@kernel
def dry_friction_sigma(coulomb, stiction, width, known, qd, sigma):
    """Standard deviation of dry friction: 0.6 of stiction at rest, and the unknown share of the
    friction in motion.

    Args:
        coulomb: (n,) [N m] Coulomb friction.
        stiction: (n,) [N m] friction at rest; the torque at rest may have any value below it.
        width: [rad/s] width of the smoothed step at rest.
        known: [-] share of the friction in motion that is known.
        qd: (n,) [rad/s] joint speeds.
        sigma: (n,) [N m] output: standard deviation.
    """
    for j in range(qd.shape[0]):
        held = 1.0 - np.tanh(qd[j] / width) ** 2
        sigma[j] = np.sqrt((0.6 * stiction[j] * held) ** 2 + ((1.0 - known) * coulomb[j]) ** 2)
