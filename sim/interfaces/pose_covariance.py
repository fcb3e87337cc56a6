"""Covariance of a pose, expressed as a small twist about a point; some directions may have infinite
variance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_pose,
    checked_rows,
    exp_so3,
    inverse,
    log_so3,
    pose,
    readonly,
    skew,
    transform_points,
    unit_vector,
)

# [-] share of a free twist in a motion below which the motion counts as constrained
_RESISTED = 0.02
_CHI_95 = 2.7955  # [-] radius of the ball that holds 95 % of a standard normal in three dimensions
_NULL = 1e-10  # [-] share of the largest variance below which a variance is that of a free twist
# [-] share of a free direction inside another find's free directions for them to count as the same
_ONE = 0.98
_DRAWS = 4096  # number of draws for probabilities, which are accurate to half a percent


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseCovariance:
    """Uncertainty of a pose: covariance of the small twist from the estimate to the truth.

    The twist (linear; angular x radius) [m] is about the object's centre, in the frame A of the
    pose X_AT: S for an object found in a scan, W in a `Target`.
    """

    matrix: Array  # (6, 6) [m^2], 0 along the free twists
    # (k, 6) orthonormal twists that the scan does not constrain; their variance is infinite
    free: Array
    # (j, 6) twists that map the object onto itself
    same: Array = field(default_factory=lambda: readonly(np.zeros((0, 6))))
    center: Array  # (3,) [m] of the object, in A
    radius: float  # [m] of the object
    # [-] standard deviation of the object's scale, if the scale were solved for; inf if it is free
    size_sigma: float

    @property
    def degrees(self) -> int:
        """Number of the degrees of freedom that the scan determines, up to 6."""
        return 6 - len(self.free)

    @property
    def information(self) -> Array:
        """Inverse (6, 6) [1/m^2] of the covariance, 0 along the free twists."""
        return np.asarray(
            np.linalg.pinv(self.matrix, rcond=_NULL, hermitian=True), dtype=np.float64
        )

    @property
    def held_sigmas(self) -> tuple[float, float]:
        """Largest standard deviations of position [m] and rotation [rad] among the constrained
        twists.
        """
        parts = (self.matrix[:3, :3], self.matrix[3:, 3:])
        position, turn = (float(np.sqrt(max(0.0, np.linalg.eigvalsh(part)[-1]))) for part in parts)
        return position, turn / self.radius

    def chance_within(self, position: float, angle: float) -> float:
        """Probability that the constrained error is within `position` [m] and `angle` [rad], by
        Monte Carlo.
        """
        eigenvalues, vectors = np.linalg.eigh(self.matrix)
        drawn = _normal_draws() @ (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))).T
        near = np.sum(drawn[:, :3] ** 2, axis=1) < position**2

        return float(
            np.mean(near & (np.sum(drawn[:, 3:] ** 2, axis=1) < (angle * self.radius) ** 2))
        )

    @property
    def position_sigma(self) -> float:
        """Standard deviation [m] of the centre along its least certain direction; inf if free."""
        return self._largest(slice(0, 3))

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation [rad] of the rotation about its least certain axis; inf if free."""
        return self._largest(slice(3, 6)) / self.radius

    @property
    def free_in_words(self) -> str:
        """The free twists in words, such as "a turn about (0.00, 0.00, 1.00)"; "none" if there are
        none.
        """
        if not len(self.free):
            return "none"

        mixed, turns, _ = np.linalg.svd(self.free[:, 3:])
        phrases = []
        for i, twist in enumerate(mixed.T @ self.free):
            turn = i < len(turns) and turns[i] > _RESISTED
            axis = twist[3:] if turn else twist[:3]
            axis = (
                axis / np.linalg.norm(axis) * (1.0 if axis[np.abs(axis).argmax()] > 0.0 else -1.0)
            )
            x, y, z = (f"{coordinate:.2f}".replace("-0.00", "0.00") for coordinate in axis)
            phrases.append(f"a {'turn about' if turn else 'slide along'} ({x}, {y}, {z})")

        return ", ".join(phrases)

    def sigma(self, p_A: ArrayLike, direction_A: ArrayLike) -> float:
        """Standard deviation [m] of a point of the object along a direction; inf if the point is
        free there.

        Args:
            p_A: (3,) [m] the point.
            direction_A: (3,) the direction, of any length.

        Raises:
            ConfigurationError: For a direction of length 0, or arrays of another shape.
        """
        n = unit_vector(direction_A, "direction")
        row = self._rows(checked(p_A, (3,), "point")[None], n[None])[0]

        if np.linalg.norm(self.free @ row) > _RESISTED:
            return np.inf
        return float(np.sqrt(max(0.0, row @ self.matrix @ row)))

    def surface_sigma(self, points_A: ArrayLike, directions_A: ArrayLike) -> Array:
        """Standard deviations (n,) [m] of surface points, without twists that map the object onto
        itself.

        Args:
            points_A: (n, 3) [m] the points.
            directions_A: (n, 3) unit directions.

        Returns:
            The same as `sigma`, without the twists of `same`, which leave the surface unchanged.

        Raises:
            ConfigurationError: For arrays of another shape.
        """
        points = checked_rows(points_A, 3, "points")
        rows = self._rows(points, checked(directions_A, points.shape, "directions"))
        observed = rows - rows @ self.same.T @ self.same
        square = np.einsum("ni,ij,nj->n", rows, self.matrix, rows)

        loose = np.linalg.norm(observed @ self.free.T, axis=1) > _RESISTED
        return np.where(loose, np.inf, np.sqrt(np.maximum(square, 0.0)))

    def normalised_error(self, X_AT: ArrayLike, X_AT_true: ArrayLike) -> float:
        """Squared error over the covariance (NEES): chi-square with `degrees` if the covariance is
        correct.

        Args:
            X_AT: (4, 4) the estimate with this covariance.
            X_AT_true: (4, 4) the true pose; of symmetric poses the one nearest to the estimate.
        """
        twist = self.twist(X_AT, X_AT_true)
        twist -= self.free.T @ (self.free @ twist)
        return float(twist @ self.information @ twist)

    def twist(self, X_AT: ArrayLike, X_AT_other: ArrayLike) -> Array:
        """Twist (6,) [m] from this covariance's estimate `X_AT` (4, 4) to another pose (4, 4)."""
        estimate = checked_pose(X_AT, "X_AT")
        other = checked_pose(X_AT_other, "other X_AT")

        middle = transform_points(inverse(estimate), self.center)
        off = transform_points(other, middle) - self.center
        return np.concatenate([off, self.radius * log_so3(other[:3, :3] @ estimate[:3, :3].T)])

    def distance(self, X_AT: ArrayLike, other: "PoseCovariance", X_AT_other: ArrayLike) -> float:
        """Distance of two estimates over its standard deviation [-], RMS over twists that both
        constrain.

        Args:
            X_AT: (4, 4) the estimate with this covariance.
            other: covariance of the other estimate, independent of this one.
            X_AT_other: (4, 4) the other estimate; of symmetric poses the one nearest to this.
        """
        twist = self.twist(X_AT, X_AT_other)

        # Twists that are free in either estimate are left out.
        aligned = other.in_frame(pose(np.asarray(X_AT)[:3, :3] @ np.asarray(X_AT_other)[:3, :3].T))
        free = np.linalg.svd(
            np.vstack([self.free, aligned.free, np.zeros((1, 6))]), full_matrices=True
        )
        held = free[2][int((free[1] > _RESISTED).sum()) :]
        if not len(held):
            return 0.0

        spread = held @ (self.matrix + aligned.matrix) @ held.T
        off = held @ twist
        return float(
            np.sqrt(off @ np.linalg.pinv(spread, rcond=_NULL, hermitian=True) @ off / len(held))
        )

    def ellipsoid(self) -> tuple[Array, Array]:
        """Region that contains the centre with a probability of 95 %: half axes (3,) [m], and their
        directions (3, 3) as columns, right-handed.

        A free translation has a half axis of 0, since an infinite one cannot be plotted.
        """
        square, axes = np.linalg.eigh(self.matrix[:3, :3])
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0

        return _CHI_95 * np.sqrt(np.maximum(square, 0.0)), np.asarray(axes, dtype=np.float64)

    def in_frame(self, X_CA: ArrayLike) -> "PoseCovariance":
        """The same uncertainty for X_CT = X_CA X_AT, with X_CA (4, 4) taken as exact."""
        X = checked_pose(X_CA, "X_CA")
        turn = np.kron(np.eye(2), X[:3, :3])
        return replace(
            self,
            matrix=readonly(turn @ self.matrix @ turn.T),
            free=readonly(self.free @ turn.T),
            same=readonly(self.same @ turn.T),
            center=readonly(transform_points(X, self.center)),
        )

    def of_carrier(self, p_A: ArrayLike, position_sigma: ArrayLike, angle_sigma: float) -> Array:
        """Covariance (6, 6) [m^2] of the object's twist caused by a pose error of the body with the
        sensor.

        Args:
            p_A: (3,) [m] position of this body.
            position_sigma: (3,) [m] standard deviation of that position, along the axes of A.
            angle_sigma: [rad] standard deviation of its attitude, about any axis.

        Returns:
            The covariance, to be added by `plus`.

        Raises:
            ConfigurationError: For arrays of another shape.
        """
        lever = self.center - checked(p_A, (3,), "position of the carrier")
        turn = np.vstack([-skew(lever), self.radius * np.eye(3)])
        moved = np.zeros((6, 6))
        moved[:3, :3] = np.diag(np.square(checked(position_sigma, (3,), "position sigma")))
        return moved + angle_sigma**2 * turn @ turn.T

    def plus(self, covariance: ArrayLike) -> "PoseCovariance":
        """Covariance with an independent error added: a twist about the centre, of `covariance` (6,
        6) [m^2].
        """
        held = np.eye(6) - self.free.T @ self.free
        added = held @ checked(covariance, (6, 6), "covariance") @ held
        return replace(self, matrix=readonly(self.matrix + added))

    def _rows(self, points: Array, directions: Array) -> Array:
        """Motions (n, 6) of points (n, 3) along unit directions (n, 3), for unit components of the
        twist.
        """
        return np.column_stack(
            [directions, np.cross((points - self.center) / self.radius, directions)]
        )

    def _largest(self, part: slice) -> float:
        if len(self.free) and np.linalg.norm(self.free[:, part], axis=1).max() > _RESISTED:
            return np.inf
        return float(np.sqrt(max(0.0, np.linalg.eigvalsh(self.matrix[part, part])[-1])))


def common_free(frees: Sequence[Array]) -> Array:
    """Orthonormal twists (k, 6) that are free in each of several sets (k_i, 6), up to noise in
    direction.
    """
    resisted = sum((np.eye(6) - free.T @ free for free in frees), np.zeros((6, 6))) / len(frees)
    eigenvalues, vectors = np.linalg.eigh(resisted)
    return np.asarray(vectors[:, eigenvalues < 1.0 - _ONE].T, dtype=np.float64)


def mean_pose(
    poses: Sequence[Array], covariances: Sequence[PoseCovariance], common: ArrayLike
) -> tuple[Array, PoseCovariance, float]:
    """Mean of several estimates of one pose, weighted by information, and its covariance.

    A free twist has no information. A twist that is free in all estimates keeps its value in the
    last estimate. Twists are expressed in the object's own axes, so that a turn about its axis is
    the same twist in every estimate.

    Args:
        poses: (4, 4) X_AT, all of one object and close to each other.
        covariances: Covariances of the poses.
        common: (6, 6) [m^2] covariance of an error that all poses share, included in `covariances`.
            0: none.

    Returns:
        The mean (4, 4), its covariance, and chi-square of the scatter over its degrees of freedom,
        0 if it has none.

    Raises:
        ConfigurationError: Without any pose, or for another number of covariances.
    """
    if not poses or len(poses) != len(covariances):
        raise ConfigurationError(
            f"mean_pose: got {len(poses)} poses with {len(covariances)} covariances"
        )

    # All expressed in the axes of the last pose.
    last, X = covariances[-1], poses[-1]
    aligned = []
    for X_AT, covariance in zip(poses, covariances, strict=True):
        aligned.append(covariance.in_frame(pose(X[:3, :3] @ X_AT[:3, :3].T)))

    # Mean over the twists that are constrained in at least one estimate.
    free = common_free([covariance.free for covariance in aligned])
    held = np.eye(6) - free.T @ free
    weights = [held @ covariance.information @ held for covariance in aligned]
    twists = [held @ last.twist(X, X_AT) for X_AT in poses]
    spread = np.linalg.pinv(sum(weights, np.zeros((6, 6))), rcond=_NULL, hermitian=True)
    mean = spread @ sum(
        (weight @ twist for weight, twist in zip(weights, twists, strict=True)), np.zeros(6)
    )

    # Scatter about the mean, relative to the stated covariance.
    off = [twist - mean for twist in twists]
    degrees = sum(covariance.degrees for covariance in aligned) - (6 - len(free))
    square = sum(float(twist @ weight @ twist) for twist, weight in zip(off, weights, strict=True))
    scatter = square / degrees if degrees > 0 else 0.0

    shared = held @ checked(common, (6, 6), "common") @ held
    # The error that all estimates share does not shrink. Scatter beyond the stated one widens the
    # rest.
    unshared = sum(
        (
            spread @ weight @ (covariance.matrix - shared) @ weight @ spread
            for weight, covariance in zip(weights, aligned, strict=True)
        ),
        np.zeros((6, 6)),
    )
    matrix = max(1.0, scatter) * unshared + shared
    same = last.same if len(free) else np.zeros((0, 6))

    return (
        _moved(X, last, mean),
        replace(
            last,
            matrix=readonly(0.5 * (matrix + matrix.T)),
            free=readonly(free),
            same=readonly(same),
            center=readonly(last.center + mean[:3]),
            size_sigma=min(covariance.size_sigma for covariance in covariances),
        ),
        scatter,
    )


def _moved(X_AT: Array, covariance: PoseCovariance, twist: Array) -> Array:
    """Pose (4, 4) moved by a twist (6,) about the centre."""
    R = exp_so3(twist[3:] / covariance.radius)
    off = X_AT[:3, 3] - covariance.center
    return pose(R @ X_AT[:3, :3], covariance.center + twist[:3] + R @ off)


@cache
def _normal_draws() -> Array:
    """Standard normal draws (_DRAWS, 6), the same at every call."""
    return readonly(np.random.default_rng(0).standard_normal((_DRAWS, 6)))
