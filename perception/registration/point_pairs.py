"""Starts of the search by point pair features: pairs of scan points vote for poses [Drost 2010].

A pair of oriented points has four numbers that no motion changes: the distance, the angles of both
normals with the line between the points, and the angle between the normals. Pairs of the model are
sorted by these numbers. Each pair of the scan votes for all model points, and turns about the
normal, that map a model pair of the same numbers onto it. Objects in contact need no segmentation,
because the votes of pairs across two objects are scattered.
"""

from typing import NamedTuple

import numpy as np

from uuv.perception.registration.model_surface import MODELS, ModelSurface, one_per_cube
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array

_MODEL_POINTS = 500  # approximate number of model points that are paired
_SCAN_POINTS = 900  # approximate largest number of scan points that are paired
_REFERENCES = 120  # approximate largest number of these that are first points
_DISTANCES = 20  # number of steps of distance over the model's extent
_ANGLES = 12  # number of steps of an angle over 180 deg
_TURNS = 24  # number of steps of the turn about the first point's normal
_PEAKS = 3  # number of poses of a first point, those with most votes
_NEARBY = 0.2  # [radii] between model points, within which two peaks count as the same


class _Pairs(NamedTuple):
    """Pairs of model points sorted by their features, as a tuple, so that compiled kernels accept
    it as one argument.
    """

    points: Array  # (m, 3, 3) rows: normal, and two directions perpendicular to it
    frames: Array  # (m, 3, 3) rows: normal, and two directions across it
    step: float  # [m] of distance
    start: np.ndarray  # (features + 1,) first pair of each feature
    first: np.ndarray  # (pairs,) index of the first point
    # (pairs,) [rad] turn about its normal that brings the second point to the first perpendicular
    # direction
    turn: Array


def point_pair_poses(points: Array, normals: Array, surface: ModelSurface) -> Array:
    """Poses for which most pairs vote, three for each of a selection of scan points.

    Args:
        points: (n, 3) [m] of the scan, in S.
        normals: (n, 3) unit, towards the sensor.
        surface: Sampled model, its normals outward.

    Returns:
        Poses X_ST (k, 4, 4), those with most votes first.
    """
    pairs = _model_pairs(surface)

    # One point per cube, few enough
    size = float(pairs.step)
    chosen = one_per_cube(points, size)
    while len(chosen) > _SCAN_POINTS:
        size *= 1.2
        chosen = one_per_cube(points, size)
    points = points[chosen]
    frames = _frames(normals[chosen])

    # Votes of a selection of these as first points
    references = np.unique(np.linspace(0, len(points) - 1, _REFERENCES).astype(np.int64))
    X, votes = _vote(points, frames, references, pairs, _NEARBY * surface.radius)
    return X.reshape(-1, 4, 4)[np.argsort(-votes.ravel(), kind="stable")]


@remembered(16, owners=MODELS)
def _model_pairs(surface: ModelSurface) -> _Pairs:
    thinned = surface.thinned(_MODEL_POINTS)
    points = thinned.points
    frames = _frames(thinned.normals)

    step = 2.0 * surface.radius / _DISTANCES
    feature, turn = _features(points, frames, step)

    # Sorted by feature
    every = feature.ravel()
    order = np.argsort(every, kind="stable")
    order = order[every[order] >= 0]
    start = np.searchsorted(every[order], np.arange(_DISTANCES * _ANGLES**3 + 1))
    return _Pairs(points, frames, step, start, order // len(points), turn.ravel()[order])


def _frames(normals: Array) -> Array:
    """Rotations (n, 3, 3) whose first rows are the `normals` (n, 3)."""
    aside = np.eye(3)[np.abs(normals).argmin(axis=1)]
    u = np.cross(normals, aside)
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([normals, u, np.cross(normals, u)], axis=1).astype(np.float64)


@kernel
def _feature(p: Array, frame: Array, q: Array, normal: Array, step: float) -> tuple[int, float]:
    """Index of the feature of two oriented points, -1 for none, and the turn [rad] about the first
    normal.
    """
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    length = np.sqrt(x * x + y * y + z * z)
    far = int(length / step)
    if far >= _DISTANCES or length < 0.5 * step:
        return -1, 0.0

    # Cosines: both normals with the line, and one normal with the other
    along = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
    a = along / length
    b = (normal[0] * x + normal[1] * y + normal[2] * z) / length
    c = frame[0, 0] * normal[0] + frame[0, 1] * normal[1] + frame[0, 2] * normal[2]

    # Index of the feature: one digit for the distance and one for each angle
    number = far
    for cosine in (a, b, c):
        angle = np.arccos(min(1.0, max(-1.0, cosine)))
        number = number * _ANGLES + min(_ANGLES - 1, int(angle * (_ANGLES / np.pi)))

    u = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
    v = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    return number, np.arctan2(-v, u)


@kernel
def _features(points: Array, frames: Array, step: float) -> tuple[np.ndarray, Array]:
    """Features (m, m) of all ordered pairs, -1 for none, and turns (m, m) [rad]."""
    feature = np.full((len(points), len(points)), -1)
    turn = np.zeros((len(points), len(points)))
    for i in range(len(points)):
        for j in range(len(points)):
            if i != j:
                feature[i, j], turn[i, j] = _feature(
                    points[i], frames[i], points[j], frames[j, 0], step
                )
    return feature, turn


@kernel
def _vote(
    points: Array, frames: Array, references: np.ndarray, pairs: _Pairs, nearby: float
) -> tuple[Array, Array]:
    """Poses (k, peaks, 4, 4) and votes (k, peaks) for the k `references` among the scan's
    points.
    """
    X = np.zeros((len(references), _PEAKS, 4, 4))
    votes = np.zeros((len(references), _PEAKS))
    count = np.empty((len(pairs.points), _TURNS))
    votes_of = count.reshape(-1)
    row = pairs.first * _TURNS

    for k in range(len(references)):
        r = references[k]

        # Votes for model points and turns, shared between two steps of the turn
        count[:] = 0.0
        for s in range(len(points)):
            if s == r:
                continue
            number, turn = _feature(points[r], frames[r], points[s], frames[s, 0], pairs.step)
            if number < 0:
                continue
            # There are tens of millions of votes, hence no remainder (both turns are in -pi to pi)
            # and no check of an index's sign.
            for n in range(pairs.start[number], pairs.start[number + 1]):
                steps = (pairs.turn[n] - turn) * (_TURNS / (2.0 * np.pi))
                low = np.floor(steps)
                share = steps - low
                first = int(low)
                first += _TURNS if first < 0 else 0
                first -= _TURNS if first >= _TURNS else 0
                second = first + 1 if first + 1 < _TURNS else 0
                votes_of[np.uint64(row[n] + first)] += 1.0 - share
                votes_of[np.uint64(row[n] + second)] += share

        # Peaks, each with its surroundings removed
        for peak in range(_PEAKS):
            best = int(count.argmax())
            m = best // _TURNS
            at = best % _TURNS
            votes[k, peak] = count[m, at]
            _lay(
                X[k, peak],
                points[r],
                frames[r],
                pairs.points[m],
                pairs.frames[m],
                at * (2.0 * np.pi / _TURNS),
            )

            for other in range(len(pairs.points)):
                off = pairs.points[other] - pairs.points[m]
                if off[0] ** 2 + off[1] ** 2 + off[2] ** 2 < nearby**2:
                    for turned in (-1, 0, 1):
                        count[other, (at + turned) % _TURNS] = 0.0
    return X, votes


@kernel
def _lay(X: Array, p: Array, frame: Array, q: Array, model_frame: Array, angle: float) -> None:
    """Write the pose `X` (4, 4) that puts a model point with its frame on a scan point.

    `angle` [rad]: turn about the normal.
    """
    c, s = np.cos(angle), np.sin(angle)
    for a in range(3):
        for b in range(3):
            n, u, v = model_frame[0, b], model_frame[1, b], model_frame[2, b]
            X[a, b] = (
                frame[0, a] * n + frame[1, a] * (c * u - s * v) + frame[2, a] * (s * u + c * v)
            )

    for a in range(3):
        X[a, 3] = p[a] - (X[a, 0] * q[0] + X[a, 1] * q[1] + X[a, 2] * q[2])
    X[3, 3] = 1.0
