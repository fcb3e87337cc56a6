"""Covariance of a fitted pose, from the fit itself: how far noise like that of this scan moves it.

The pose is an M-estimate: it makes the sum of the pairs' scores zero. Each tile of the image is left out in turn, and
the motion of the estimate follows by one Newton step (delete-a-group jackknife [Cameron 2015]). Within a tile the
errors of pixels may be correlated in whatever way. Motions that no pair resists are unbounded, not estimated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from perception.registration.evidence import Evidence
from perception.registration.fine_fit import GATES
from perception.registration.model_surface import ModelSurface
from perception.registration.pairing import Pairing, PairRows
from sim.interfaces.spatial import (
    Array,
    checked,
    checked_pose,
    inverse,
    log_so3,
    readonly,
    transform_points,
    unit_vector,
)

_TILE = 4.0  # [noise lengths] edge of a tile
_DRAWN = 20.0  # tiles that the assumption of equal, independent errors counts for
_LEAST_SLOPE = 0.2  # [-] of the score over the weight
_LEFT_OUT = 0.9  # [-] of a tile's hold: the last tile that holds a motion is not left out wholly
_FEWEST = 4  # tiles, below which nothing is said
_RESISTED = 0.02  # [-] share of a free twist in a motion, below which the motion counts as resisted


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseCovariance:
    """Uncertainty of a pose: the covariance of the small twist that leads from the estimate to the truth.

    The twist (linear; angular x radius) [m] is about the model's centre, in S.
    """

    matrix: Array  # (6, 6) [m^2], 0 along the free twists
    free: Array  # (k, 6) orthonormal twists that nothing in the scan resists: their variance is infinite
    center: Array  # (3,) [m] of the model, in S
    radius: float  # [m] of the model
    size_sigma: float  # [-] standard deviation of the object's scale, if it were solved for; inf if it is free

    @property
    def degrees(self) -> int:
        """Number of the degrees of freedom that the scan determines, up to 6."""
        return 6 - len(self.free)

    @property
    def held_sigmas(self) -> tuple[float, float]:
        """Largest standard deviations of position [m] and rotation [rad] among the twists that are held."""
        parts = (self.matrix[:3, :3], self.matrix[3:, 3:])
        position, turn = (float(np.sqrt(max(0.0, np.linalg.eigvalsh(part)[-1]))) for part in parts)
        return position, turn / self.radius

    @property
    def position_sigma(self) -> float:
        """Standard deviation [m] of the centre along its least certain direction; inf if it can slide."""
        return self._largest(slice(0, 3))

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation [rad] of the rotation about its least certain axis; inf if it can turn."""
        return self._largest(slice(3, 6)) / self.radius

    def sigma(self, p_S: ArrayLike, direction_S: ArrayLike) -> float:
        """Standard deviation [m] of a point of the object along a direction; inf where a free twist moves it so.

        Args:
            p_S: (3,) [m] the point.
            direction_S: (3,) the direction, of any length.

        Raises:
            ConfigurationError: For a direction of length 0, or arrays of another shape.
        """
        n = unit_vector(direction_S, "direction_S")
        row = np.concatenate([n, np.cross((checked(p_S, (3,), "p_S") - self.center) / self.radius, n)])
        if np.linalg.norm(self.free @ row) > _RESISTED:
            return np.inf
        return float(np.sqrt(max(0.0, row @ self.matrix @ row)))

    def normalised_error(self, X_ST: ArrayLike, X_ST_true: ArrayLike) -> float:
        """Squared error of the estimate over its covariance (NEES): chi-square with `degrees` if all is right.

        Args:
            X_ST: (4, 4) the estimate, to which this covariance belongs.
            X_ST_true: (4, 4) the true pose, of all that look the same the one next to the estimate.
        """
        estimate, truth = checked_pose(X_ST, "X_ST"), checked_pose(X_ST_true, "X_ST_true")
        middle = transform_points(inverse(estimate), self.center)
        off = transform_points(truth, middle) - self.center
        twist = np.concatenate([off, self.radius * log_so3(truth[:3, :3] @ estimate[:3, :3].T)])
        twist -= self.free.T @ (self.free @ twist)
        return float(twist @ np.linalg.pinv(self.matrix, rcond=1e-10, hermitian=True) @ twist)

    def _largest(self, part: slice) -> float:
        if len(self.free) and np.linalg.norm(self.free[:, part], axis=1).max() > _RESISTED:
            return np.inf
        return float(np.sqrt(np.linalg.eigvalsh(self.matrix[part, part])[-1]))


def pose_covariance(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, free: Array, pairing: Pairing | None = None
) -> PoseCovariance | None:
    """Covariance of a pose to which ICP has converged.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) the pose.
        free: (k, 6) free twists as in `IcpFit`.
        pairing: That of the last round of ICP at this pose; None: it is made.

    Returns:
        The covariance; None if the object covers too few tiles of the image to estimate one.
    """
    pairing = pairing or Pairing.of(evidence, surface, X_ST)
    if pairing is None:
        return None
    gate = GATES[-1] * surface.spacing
    rows = pairing.rows(X_ST, gate, pairing.nearest(X_ST, gate))
    cells = np.floor(rows.tangents / (_TILE * evidence.sensor.noise_length * evidence.scan.pitch)).astype(np.int64)
    tiles = np.unique(cells, axis=0, return_inverse=True)[1]
    if not len(tiles) or tiles.max() + 1 < _FEWEST:
        return None
    H, s = _of_tiles(rows, tiles)
    held = np.linalg.svd(np.vstack([free, np.zeros((1, 6))]))[2][len(free) :]
    common = _common(rows)
    matrix = held.T @ _spread(H[:, :6, :6], s[:, :6], common[:, :6], held) @ held
    grown = np.block([[held, np.zeros((len(held), 1))], [np.zeros((1, 6)), np.ones((1, 1))]])
    growth = _spread(H, s, common, grown)[-1, -1]
    return PoseCovariance(
        matrix=readonly(matrix),
        free=readonly(free),
        center=readonly(transform_points(X_ST, surface.center)),
        radius=surface.radius,
        size_sigma=float(np.sqrt(growth)) / surface.radius if growth > 0.0 else np.inf,
    )


def _of_tiles(rows: PairRows, tiles: np.ndarray) -> tuple[Array, Array]:
    """Derivatives of the scores (g, 7, 7), and scores (g, 7), summed over each of the g tiles."""
    order = np.argsort(tiles, kind="stable")
    first = np.flatnonzero(np.diff(tiles[order], prepend=-1))
    J, edge = rows.J[order], rows.common > 0.0
    slope = np.empty(len(rows.J))
    for kind in (edge, ~edge):
        # Slopes of single pairs may be negative: their mean ratio to the weights keeps every part positive.
        ratio = float(rows.slope[kind].sum() / max(rows.weight[kind].sum(), 1e-300))
        slope[kind] = max(ratio, _LEAST_SLOPE) * rows.weight[kind]
    H = np.add.reduceat(slope[order, None, None] * J[:, :, None] * J[:, None, :], first)
    return H, np.add.reduceat((rows.weight * rows.distance)[order, None] * J, first)


def _common(rows: PairRows) -> Array:
    """Scores (3, 7) of the errors that all depth edges share: one aside, one upwards and one outward."""
    aside, up, outward = rows.J[:, 0], rows.J[:, 1], np.ones(len(rows.J))
    return np.array([(rows.slope * rows.common * share) @ rows.J for share in (aside, up, outward)])


def _spread(H: Array, s: Array, common: Array, held: Array) -> Array:
    """Covariance (k, k) of the root of the summed scores, in the directions `held` (k, n).

    Args:
        H: (g, n, n) derivatives of the tiles' scores, with the other sign.
        s: (g, n) scores of the tiles.
        common: (c, n) scores of independent errors that the tiles share.
        held: (k, n) orthonormal.
    """
    H, s = held @ H @ held.T, s @ held.T
    g, k = s.shape
    if k == 0:
        return np.zeros((0, 0))
    total = H.sum(axis=0) + 1e-9 * np.trace(H.sum(axis=0)) / k * np.eye(k)
    moved = np.linalg.solve(total - _LEFT_OUT * H, (s - s.mean(axis=0))[..., None])  # by leaving one tile out
    alone = moved[..., 0]
    shared = np.linalg.solve(total, (common @ held.T).T)
    drawn, ideal = (g - 1) / g * alone.T @ alone, np.linalg.inv(total)
    # A few tiles give a rough covariance: it is drawn towards that of equal, independent errors of the same size.
    ideal *= np.trace(total @ drawn) / k
    return (g * drawn + _DRAWN * ideal) / (g + _DRAWN) + shared @ shared.T
