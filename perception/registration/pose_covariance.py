"""Covariance of a fitted pose from the fit itself: the motion that noise as in this scan causes.

The pose is an M-estimate: the sum of the pairs' scores is zero. Each tile of the image is left out
in turn, and the resulting motion of the estimate is computed by one Newton step (delete-a-group
jackknife [Cameron 2015]). Within a tile the errors of pixels may be correlated in any way. Motions
that no pair resists are unbounded and not estimated.
"""

import numpy as np

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pairing import PairRows
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, readonly, transform_points

_TILE = 4.0  # [noise lengths] edge of a tile
_DRAWN = 20.0  # number of tiles that the assumption of equal, independent errors is worth
_LEAST_SLOPE = 0.2  # [-] least slope of the score over the weight
# [-] largest share of a tile in the information: the only tile that determines a motion is not left
# out wholly
_LEFT_OUT = 0.9
# [-] share of the turn about the axis of symmetry in the free twists, from which on it is one of
# them
_OF_AXIS = 0.98
_FEWEST = 4  # number of tiles, below which no covariance is estimated


def pose_covariance(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, free: Array, rows: PairRows | None
) -> PoseCovariance | None:
    """Covariance of a pose to which a fit has converged.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) the pose.
        free: (k, 6) free twists as in `IcpFit`.
        rows: Pairs that the fit compared, at this pose; None if there were none.

    Returns:
        The covariance; None if the object covers too few tiles of the image to estimate one.
    """
    if rows is None:
        return None

    # Tiles of the image
    cells = np.floor(
        rows.tangents / (_TILE * evidence.sensor.noise_length * evidence.scan.pitch)
    ).astype(np.int64)
    tiles = np.unique(cells, axis=0, return_inverse=True)[1]
    if not len(tiles) or tiles.max() + 1 < _FEWEST:
        return None

    # Pose, in the directions that are not free
    H, s = _of_tiles(rows, tiles)
    held = np.linalg.svd(np.vstack([free, np.zeros((1, 6))]))[2][len(free) :]
    common = _common(rows)
    matrix = held.T @ _spread(H[:, :6, :6], s[:, :6], common[:, :6], held) @ held

    # Growth, as one more unknown
    grown = np.block([[held, np.zeros((len(held), 1))], [np.zeros((1, 6)), np.ones((1, 1))]])
    growth = _spread(H, s, common, grown)[-1, -1]

    return PoseCovariance(
        matrix=readonly(matrix),
        free=readonly(free),
        same=_same(surface, X_ST, free),
        center=readonly(transform_points(X_ST, surface.center)),
        radius=surface.radius,
        size_sigma=float(np.sqrt(growth)) / surface.radius if growth > 0.0 else np.inf,
    )


def turn_of_symmetry(surface: ModelSurface, X_ST: Array) -> Array:
    """Unit twist (1, 6) in S about the axis of symmetry, as in `IcpFit.free`; (0, 6) without."""
    symmetry = surface.symmetry
    if symmetry.axis is None:
        return np.zeros((0, 6))
    linear = np.cross(symmetry.axis, surface.center - symmetry.center) / surface.radius
    twist = np.concatenate([X_ST[:3, :3] @ linear, X_ST[:3, :3] @ symmetry.axis])
    return twist[None] / np.linalg.norm(twist)


def _same(surface: ModelSurface, X_ST: Array, free: Array) -> Array:
    """Twist (1, 6) in S about the axis of symmetry if it is among the free twists; else (0, 6)."""
    along = turn_of_symmetry(surface, X_ST) @ free.T @ free
    length = np.linalg.norm(along)
    return readonly(along / length if length > _OF_AXIS else np.zeros((0, 6)))


def _of_tiles(rows: PairRows, tiles: np.ndarray) -> tuple[Array, Array]:
    """Derivatives of the scores (g, 7, 7), and scores (g, 7), summed over each of the g tiles."""
    order = np.argsort(tiles, kind="stable")
    first = np.flatnonzero(np.diff(tiles[order], prepend=-1))
    J = rows.J[order]
    edge = rows.common > 0.0

    slope = np.empty(len(rows.J))
    for kind in (edge, ~edge):
        # Slopes of single pairs may be negative; their mean ratio to the weights keeps every tile
        # positive.
        ratio = float(rows.slope[kind].sum() / max(rows.weight[kind].sum(), 1e-300))
        slope[kind] = max(ratio, _LEAST_SLOPE) * rows.weight[kind]

    H = np.add.reduceat(slope[order, None, None] * J[:, :, None] * J[:, None, :], first)
    return H, np.add.reduceat((rows.weight * rows.distance)[order, None] * J, first)


def _common(rows: PairRows) -> Array:
    """Scores (3, 7) of the errors that all depth edges share: sideways, upwards and outward."""
    aside = rows.J[:, 0]
    up = rows.J[:, 1]
    outward = np.ones(len(rows.J))
    return np.array([(rows.slope * rows.common * share) @ rows.J for share in (aside, up, outward)])


def _spread(H: Array, s: Array, common: Array, held: Array) -> Array:
    """Covariance (k, k) of the root of the summed scores, in the directions `held` (k, n).

    Args:
        H: (g, n, n) derivatives of the tiles' scores, with opposite sign.
        s: (g, n) scores of the tiles.
        common: (c, n) scores of independent errors that the tiles share.
        held: (k, n) orthonormal.
    """
    H = held @ H @ held.T
    s = s @ held.T
    g, k = s.shape
    if k == 0:
        return np.zeros((0, 0))
    total = H.sum(axis=0) + 1e-9 * np.trace(H.sum(axis=0)) / k * np.eye(k)

    # Newton step of the estimate without each tile
    # by leaving one tile out
    moved = np.linalg.solve(total - _LEFT_OUT * H, (s - s.mean(axis=0))[..., None])
    alone = moved[..., 0]

    # Error that all tiles share
    shared = np.linalg.solve(total, (common @ held.T).T)
    drawn = (g - 1) / g * alone.T @ alone
    ideal = np.linalg.inv(total)

    # A few tiles give only a rough covariance, which is shrunk towards that of equal, independent
    # errors of the same size.
    ideal *= np.trace(total @ drawn) / k
    return (g * drawn + _DRAWN * ideal) / (g + _DRAWN) + shared @ shared.T
