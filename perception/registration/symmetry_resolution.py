"""How far is an object turned about its axis of symmetry? Told by what breaks the symmetry: a bung in a barrel's shell.

A target declares the symmetry of its body; parts of its mesh that do not share it may be in view or not. The model is
looked at in many turns: the median depth of a pixel over them is that of the bare body. A turn is told if its parts
explain the scan better than the bare body does, and better than they do in any other turn.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from perception.registration.fine_fit import Evidence, ModelSurface
from sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

_STEP = np.deg2rad(3.0)  # between turns that are tried
_FINE = np.linspace(-1.0, 1.0, 13)  # steps around the best of them
_PROBES = np.deg2rad([25.0, 60.0, 100.0, 155.0, 205.0, 260.0, 320.0])  # turns in which the body must look the same
_OFF = 0.004  # [m], or 1.2 spacings of the model's points, by which a part must stand out of the body
_MOST = 0.3  # share of the surface beyond which it is the declaration that is wrong
_POINTS = 300  # on the parts
_PIXELS = 2500
_TOLERANCE = 0.002  # [m] of model and fitted pose
_OUTLIER = 4.5  # nats that one independent error costs at most, as one of 3 sigma
_NOISE_AREA = 25.0  # [px] over which the errors of a stereo matcher hang together
_TELLING = 10.0  # nats over the bare body, and over any other turn
_AGREE = 0.7  # share of the pixels that the parts change by 2 sigma or more which must agree with them to 2 sigma
_OTHER = np.deg2rad(15.0)  # between turns that are not the same


@lru_cache(maxsize=16)
def asymmetric_parts(surface: ModelSurface) -> Array:
    """Points (N, 3) [m] in T of parts that the declared turns do not map onto the mesh; none without an axis."""
    axis, points = surface.target.symmetry.axis, surface.points
    if axis is None:
        return np.zeros((0, 3))
    tree = cKDTree(points)
    off = np.median([tree.query(points @ exp_so3(angle * axis).T)[0] for angle in _PROBES], axis=0)
    parts = points[off > max(_OFF, 1.2 * surface.spacing)]
    if len(parts) > _MOST * len(points):
        return np.zeros((0, 3))
    return parts[:: max(1, len(parts) // _POINTS)]


def resolve_symmetry(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> Array | None:
    """Of the poses that look like `X_ST` (4, 4) by declaration, the one (4, 4) that the scan tells; None if none."""
    symmetry = surface.target.symmetry
    if symmetry.axis is None or not len(asymmetric_parts(surface)):
        return None

    def turned(angles: Array, rotations: Array) -> list[Array]:
        return [X_ST @ pose(G @ exp_so3(angle * symmetry.axis)) for G in rotations for angle in angles]

    angles = np.arange(0.0, 2.0 * np.pi, _STEP)
    poses = turned(angles, symmetry.rotations)
    pixels = _Pixels.of(evidence, surface, poses)
    if pixels is None:
        return None
    seen = pixels.depths(surface, poses)
    bare = np.median(seen, axis=0)
    gain, agree = pixels.gains(seen, bare)
    best = int(gain.argmax())
    group, at = divmod(best, len(angles))
    beside = np.abs(np.angle(np.exp(1j * (angles - angles[at])))) < _OTHER
    others = np.delete(gain, group * len(angles) + np.nonzero(beside)[0])
    if gain[best] < _TELLING + max(0.0, float(others.max())) or agree[best] < _AGREE:
        return None
    G, near = symmetry.rotations[group : group + 1], angles[at] + _STEP * _FINE
    gain = pixels.gains(pixels.depths(surface, turned(near, G)), bare)[0]
    # The middle of the peak, not its top: that one is flat, and noise decides on it.
    return turned(np.array([np.average(near, weights=gain - gain.min() + 1e-9)]), G)[0]


@dataclass(frozen=True, slots=True, eq=False)
class _Pixels:
    """Pixels of the scan where the parts may be seen in one turn or another."""

    rays: Array  # (P, 3) in S, as long as their depth is 1 m
    depth: Array  # (P,) [m]
    sigma: Array  # (P,) [m]
    weight: float  # of a pixel, as a share of an independent error

    @classmethod
    def of(cls, evidence: Evidence, surface: ModelSurface, poses: list[Array]) -> "_Pixels | None":
        """None if the sensor got no echo where any of the parts could be in view."""
        scan, points = evidence.scan, asymmetric_parts(surface)
        where = np.zeros(scan.depth.shape, dtype=bool)
        for X in poses:
            row, column, inside = scan.pixels(transform_points(X, points))
            where[row[inside], column[inside]] = True
        rows, columns = np.nonzero(where & (scan.depth > 0.0))
        if not len(rows):
            return None
        step = -(-len(rows) // _PIXELS)
        rows, columns = rows[::step], columns[::step]
        depth = scan.depth[rows, columns]
        rays = np.column_stack([scan.tangent_x[columns], scan.tangent_y[rows], np.ones(len(rows))])
        sigma = np.hypot(evidence.sensor.sigma(depth), _TOLERANCE)
        return cls(rays, depth, sigma, min(1.0, step / _NOISE_AREA))

    def depths(self, surface: ModelSurface, poses: list[Array]) -> Array:
        """Depths (len(poses), P) [m] of the model; inf where it is not met."""
        found = np.empty((len(poses), len(self.rays)))
        for k, X_TS in enumerate(map(inverse, poses)):
            found[k] = surface.scene.cast(X_TS[:3, 3], self.rays @ X_TS[:3, :3].T)["t"]
        return found

    def gains(self, seen: Array, bare: Array) -> tuple[Array, Array]:
        """Nats (K,) by which `seen` (K, P) [m] explains the scan better than `bare` (P,), and the share that agrees."""
        cost = np.minimum(0.5 * ((seen - self.depth) / self.sigma) ** 2, _OUTLIER)
        gain = np.minimum(0.5 * ((bare - self.depth) / self.sigma) ** 2, _OUTLIER) - cost
        with np.errstate(invalid="ignore"):
            changed = np.abs(seen - bare) > 2.0 * self.sigma
        agree = np.sum(changed & (cost < 2.0), axis=1) / np.maximum(1, changed.sum(axis=1))
        return self.weight * gain.sum(axis=1), agree
