"""Search for a motion in which the damping of a body adds energy, as only cross terms can do."""

import numpy as np

from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.water.forms import CrossTerms
from uuv.sim.interfaces.spatial import Array, skew

_SPEEDS = (0.3, 1.0, 3.0)  # [m/s, rad/s] of the sampled motions
_SAMPLES = 2000  # number of motions at each speed
_ROUNDS = 12  # number of steps of refinement about the best motion
# share of the cross terms' gross power above which energy counts as added, beyond rounding
_SHARE = 1e-6


def damping_wrench(body: BodyHydrodynamics, nu: Array) -> Array:
    """Wrench of all damping, strips and forms at the body origin, body axes, in NumPy.

    Args:
        body: Coefficients of the body.
        nu: (n, 6) [m/s, rad/s] Twists relative to the water.

    Returns:
        Wrenches (n, 6) [N, N m].
    """
    v = nu[:, :3]
    w = nu[:, 3:]
    total: Array = -nu @ body.linear_damping.T - body.quadratic_damping * np.abs(nu) * nu

    for strip in body.segments:
        along = strip.end - strip.start
        length = float(np.linalg.norm(along))
        for node, weight in zip(*np.polynomial.legendre.leggauss(strip.stations), strict=True):
            p = strip.start + 0.5 * (1.0 + float(node)) * along
            u = v - w @ skew(p).T
            slip = (u @ along)[:, None] / length
            across = u - slip * along / length
            force = -strip.normal * np.linalg.norm(across, axis=1)[:, None] * across
            force -= strip.tangential * np.abs(slip) * slip * along / length
            total += 0.5 * float(weight) * length * np.hstack([force, force @ skew(p).T])

    for form in body.terms:
        total += form.wrench(v, w, body.added_mass)
    return total


def largest_power(body: BodyHydrodynamics) -> tuple[float, Array] | None:
    """Largest power [W] that damping adds to the body, and the twist (6,) there; None if none was
    found.

    The search samples motions at speeds up to 3 m/s and rad/s; its result is no proof. Without
    cross terms there is no such motion.
    """
    cross = [form for form in body.terms if isinstance(form, CrossTerms)]
    if not cross:
        return None
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(_SAMPLES, 6))
    involved = np.unique(np.concatenate([form.terms[:, :3].ravel() for form in cross]).astype(int))

    # half of the motions in the components that the cross terms couple
    direction[::2] *= np.isin(np.arange(6), involved)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    nu = np.vstack([speed * direction for speed in _SPEEDS])
    power = np.sum(nu * damping_wrench(body, nu), axis=1)

    # Relative to the speed cubed, so that slow motions count as much as fast ones.
    best = nu[int(np.argmax(power / np.linalg.norm(nu, axis=1) ** 3))]

    for step in 0.5 ** np.arange(_ROUNDS):
        near = best + step * np.linalg.norm(best) * rng.normal(size=(100, 6)) * np.isin(
            np.arange(6), involved
        )
        near = np.vstack(
            [best, near * (np.linalg.norm(best) / np.linalg.norm(near, axis=1))[:, None]]
        )
        best = near[int(np.argmax(np.sum(near * damping_wrench(body, near), axis=1)))]

    power_in = float(best @ damping_wrench(body, best[None])[0])
    gross = (
        sum(float(np.abs(form.terms[:, 4]).sum()) for form in cross)
        * float(np.linalg.norm(best)) ** 3
    )
    return (power_in, best) if power_in > _SHARE * gross else None
