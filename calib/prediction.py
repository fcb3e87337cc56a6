"""Error of a calibrated arm at postures that it was not touched in: deviations and intervals that cover.

The posterior covariance speaks of touch noise alone. A real arm has errors that its parameters cannot express (gears,
sag, seating of the probe); they are alike in neighbouring postures, so that residuals of the fit understate them. Each
place is therefore predicted from the touches of the others, and the spread of those errors widens the intervals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.interfaces.spatial import Array, readonly

_ONE_PLACE = 0.1  # points closer than this share of the arm's reach are one place, predicted together


def places(points: ArrayLike, reach: float) -> np.ndarray:
    """Place (S,) of each point: points within a tenth of `reach` [m] of each other, in chains, share one."""
    p = np.asarray(points, dtype=np.float64)
    near = np.linalg.norm(p[:, None] - p[None], axis=2) < _ONE_PLACE * reach
    found = np.arange(len(p))
    for _ in range(len(p)):
        found = np.where(near, found[None], len(p)).min(axis=1)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Touches of one point under the identified arm, less their weighted mean."""

    rows: Array  # (m, P, 3) derivatives of the tips by the free parameters
    residuals: Array  # (m, 3) [m]
    weights: Array  # (m,) in the fit, above 0


def scores(series: Sequence[Series], place: np.ndarray, prior: Array, noise: float) -> Array:
    """Errors of touches predicted without their own place, over their predicted deviations, sorted.

    The parameters without a place follow from one Gauss-Newton step that removes its touches. Known distances are left
    aside: they settle the scale, which the spread of touches does not show.

    Args:
        series: touches in use.
        place: (S,) place of each series. Where all share one, each series counts as a place.
        prior: (P,) standard deviations of the prior.
        noise: [m] standard deviation of a touch along each axis.

    Returns:
        Absolute scores (3 M,); their 95 % quantile is 1.96 where the model is right.
    """
    if len(set(place.tolist())) == 1:
        place = np.arange(len(series))
    rows = [each.rows.transpose(0, 2, 1).reshape(-1, len(prior)) * prior / noise for each in series]
    weights = [np.repeat(each.weights, 3) for each in series]
    each_tells = np.array([(J * w[:, None]).T @ J for J, w in zip(rows, weights, strict=True)])
    total = np.eye(len(prior)) + each_tells.sum(axis=0)
    out = []
    for one in sorted(set(place.tolist())):
        mine = np.flatnonzero(place == one).tolist()
        without = np.linalg.inv(total - each_tells[mine].sum(axis=0))
        J, w = np.concatenate([rows[s] for s in mine]), np.concatenate([weights[s] for s in mine])
        r = np.concatenate([series[s].residuals.ravel() for s in mine]) / noise
        lost = np.repeat([1.0 - 1.0 / len(series[s].weights) for s in mine], [len(weights[s]) for s in mine])
        error = r + J @ (without @ (J.T @ (w * r)))
        out.append(np.abs(error) / np.sqrt(np.einsum("mp,pr,mr->m", J, without, J) + lost))
    return readonly(np.sort(np.concatenate(out)))
