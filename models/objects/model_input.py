"""Checks of a user's input for models: meshes, and point clouds with their normals."""

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, real_array

SMALLEST = 1e-3  # [m] smallest extent across, below tool and sensor resolution
FARTHEST_VERTEX = 1e5  # [m] largest distance of vertices and path points from the origin


def checked_mesh(vertices: ArrayLike, triangles: ArrayLike, what: str) -> tuple[Array, np.ndarray]:
    """Validated vertices (V, 3) [m] and triangles (T, 3) of a mesh whose size suits tool and
    sensors.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices.
        what: first words of error messages.

    Raises:
        ConfigurationError: a shape is wrong, a number is not finite or too large, an index refers
            to no vertex, the area is zero, or the extent is below SMALLEST.
    """
    points = real_array(vertices, f"{what}: vertices", "(V, 3) numbers")
    corners = real_array(triangles, f"{what}: triangles", "(T, 3) indices")
    if points.ndim != 2 or points.shape[1] != 3 or not np.all(np.isfinite(points)):
        raise ConfigurationError(f"{what}: vertices must be finite, (V, 3); got {points.shape}")
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners):
        raise ConfigurationError(f"{what}: triangles must be (T, 3), T > 0; got {corners.shape}")
    if not (
        corners.min() >= 0 and corners.max() < len(points) and np.all(corners == np.floor(corners))
    ):
        raise ConfigurationError(
            f"{what}: triangles must be indices of vertices, whole numbers from 0 to "
            f"{len(points) - 1}, "
            f"got {corners.min():g} to {corners.max():g}"
        )

    faces = corners.astype(np.int64)
    farthest = float(np.abs(points).max())
    if farthest > FARTHEST_VERTEX:
        raise ConfigurationError(
            f"{what}: vertices must lie within {FARTHEST_VERTEX:g} m of its "
            f"origin, got {farthest:g}"
        )

    a, b, c = points[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if not area.any():
        raise ConfigurationError(f"{what}: none of its {len(faces)} triangles has an area")

    used = points[np.unique(faces[area > 0.0])]
    across = float(np.linalg.norm(np.ptp(used, axis=0)))
    if across < SMALLEST:
        raise ConfigurationError(
            f"{what}: must be at least {SMALLEST:g} m across, got {across:.3g} m; check its scale"
        )
    return points, faces


def usable_cloud(
    points: ArrayLike, normals: ArrayLike | None, what: str
) -> tuple[Array, Array | None, list[str]]:
    """Usable points (m, 3) [m] of a cloud, their outward normals (m, 3) if usable, and notes on
    points left out.

    Args:
        points: (n, 3) [m]; those that are not finite are left out.
        normals: (n, 3), of any length; points whose normal is zero or not finite are left out. If
            no normal is usable, all points are kept without normals.
        what: first words of error messages.

    Raises:
        ConfigurationError: an array has another shape, or points are too far from the origin.
    """
    positions = real_array(points, f"{what}: points", "(n, 3) numbers [m]")
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise ConfigurationError(
            f"{what}: points must be (n, 3) numbers [m], got shape {positions.shape}"
        )

    finite = np.asarray(np.isfinite(positions).all(axis=1))
    outward = None
    notes: list[str] = []
    if normals is not None:
        outward, usable, note = _usable_normals(normals, positions.shape, finite, what)
        finite &= usable
        notes += [note] if note else []

    positions = positions[finite]
    if len(positions) and not np.abs(positions).max() <= FARTHEST_VERTEX:
        farthest = float(np.abs(positions).max())
        raise ConfigurationError(
            f"{what}: points must lie within {FARTHEST_VERTEX:g} m of its origin, got "
            f"{farthest:g}; subtract their middle, about "
            f"{' '.join(f'{v:.0f}' for v in np.median(positions, axis=0))}"
        )
    return positions, outward, notes


def _usable_normals(
    normals: ArrayLike, shape: tuple[int, ...], finite: np.ndarray, what: str
) -> tuple[Array | None, np.ndarray, str]:
    """Usable normals (m, 3) of the `finite` points (n,), the mask (n,) of these points, and a note.

    If no normal is usable: None, the mask of all finite points, and a note.
    """
    outward = real_array(normals, f"{what}: normals", "(n, 3) numbers")
    if outward.shape != shape:
        raise ConfigurationError(
            f"{what}: normals must be {shape}, one for each point, got {outward.shape}"
        )

    largest = np.abs(outward).max(axis=1, initial=0.0, where=np.isfinite(outward))
    usable = np.isfinite(outward).all(axis=1) & (largest > 0.0)
    if not (finite & usable).any():
        note = "all normals are zero or not finite, so they are ignored"
        return None, np.ones(len(usable), dtype=bool), note

    note = ""
    if unusable := int((finite & ~usable).sum()):
        note = (
            f"{unusable} of {int(finite.sum())} points left out: their normal is zero or not finite"
        )

    # Scaled first, because the square of a very long normal overflows.
    both = finite & usable
    return outward[both] / largest[both, None], usable, note
