"""Added mass of a closed surface in unbounded water, by a panel method.

The potential of each of the six motions is constant on each flat triangle, and Green's identity
holds at the triangles' centroids [Hess 1967], [Katz 2001, section 3.2]. The integrals over a
triangle have a closed form: the solid angle [Oosterom 1983] and the logarithms of its edges [Hess
1967]. There is no free surface and no bottom, so that the added mass is that of deep water at any
frequency. The potential stays bounded at sharp edges and on thin parts, unlike a density of
sources.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.hydrodynamics import SEA_WATER
from uuv.models.water_from_geometry.solid_angle import half_solid_angle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, readonly, real_array, skew

MOST = 8000  # largest number of panels of one surface: 1 GB, half a minute
# order of convergence in panel size that edges of 90 degrees leave; smooth surfaces have order 2
_EDGE_ORDER = 4.0 / 3.0
TRUSTED = 0.15  # largest relative change by extrapolation that is accepted
_FLOOR = 0.05  # share of the largest term of its kind, to which smaller terms are compared
# share of the largest translational term times the squared size: least scale of rotational terms
_TURNING = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PanelSolution:
    """Added mass of one surface, with the errors of its discretisation."""

    # (6, 6) [kg, kg m, kg m^2] at the origin of the vertices, symmetric and positive semidefinite
    added_mass: Array
    panels: int
    size: float  # [m] longest extent of the surface
    # largest difference of two opposite terms before symmetrisation, over the largest term
    asymmetry: float
    lifted: float  # largest negative eigenvalue that was set to zero, over the largest eigenvalue
    # largest change of a term by extrapolation, over the root of its two diagonal terms
    changed: float | None = None


def added_mass(
    vertices: ArrayLike, triangles: ArrayLike, density: float = SEA_WATER
) -> PanelSolution:
    """Compute the added mass of a closed surface.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices, counter-clockwise from outside, without holes. Triangles without
            area are left out.
        density: [kg/m^3] of the water.

    Returns:
        The added mass at the origin of `vertices`, in their axes.

    Raises:
        ConfigurationError: no triangle has an area, or there are more than `MOST`.
    """
    points = real_array(vertices, "panels: vertices", "(V, 3) numbers [m]")
    corners = points[np.asarray(triangles, dtype=np.int64)]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    keep = double > 1e-14 * double.max(initial=0.0)
    if not keep.any():
        raise ConfigurationError(f"panels: none of the {len(corners)} triangles has an area")
    corners = corners[keep]
    area = 0.5 * double[keep]
    normals = cross[keep] / double[keep, None]
    if len(corners) > MOST:
        raise ConfigurationError(f"panels: must be at most {MOST} triangles, got {len(corners)}")

    # Coordinates are relative to the middle and in units of the size, so that no digits are lost.
    middle = points.mean(axis=0)
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    local = np.ascontiguousarray((corners - middle) / size)
    centers = local.mean(axis=1)
    # (N, 6) flux of the unit motions through each panel
    flux = np.hstack([normals, np.cross(centers, normals)])
    potential = np.linalg.solve(*_system(local, centers, normals, flux))
    matrix = -potential.T @ (flux * (area / size**2)[:, None])

    largest = float(np.abs(matrix).max())
    asymmetry = float(np.abs(matrix - matrix.T).max()) / largest
    positive, lifted = _nearest_positive(matrix)

    # Back to the vertices' origin and to SI units.
    shift = np.eye(6)
    shift[:3, 3:] = -skew(middle / size)
    scale = size ** np.array([1.5, 1.5, 1.5, 2.5, 2.5, 2.5])
    moved = density * (shift.T @ positive @ shift) * np.outer(scale, scale)

    return PanelSolution(
        added_mass=readonly(0.5 * (moved + moved.T)),
        panels=len(local),
        size=size,
        asymmetry=asymmetry,
        lifted=lifted,
    )


def extrapolated(coarse: PanelSolution, fine: PanelSolution) -> PanelSolution:
    """Richardson's extrapolation from two surfaces of the same body, by the order that edges leave.

    On a smooth body the extrapolation reverses the sign of the fine surface's error and keeps about
    its magnitude. If a term changes by more than `TRUSTED`, the two surfaces do not describe the
    same flow: then the fine surface's matrix is kept, and `changed` shows this.
    """
    ratio = (fine.panels / coarse.panels) ** (0.5 * _EDGE_ORDER)
    step = (fine.added_mass - coarse.added_mass) / (ratio - 1.0)

    # A term is compared with the root of its two diagonal terms.
    diagonal = np.diag(fine.added_mass)
    most = diagonal.reshape(2, 3).max(axis=1)
    most[1] = max(most[1], _TURNING * most[0] * fine.size**2)
    scale = np.sqrt(np.maximum(diagonal, _FLOOR * np.repeat(most, 3)))
    changed = float(np.max(np.abs(step) / np.outer(scale, scale)))

    matrix, lifted = _nearest_positive(
        fine.added_mass + step if changed <= TRUSTED else fine.added_mass
    )

    return PanelSolution(
        added_mass=readonly(matrix),
        panels=fine.panels,
        size=fine.size,
        asymmetry=max(coarse.asymmetry, fine.asymmetry),
        lifted=max(fine.lifted, lifted),
        changed=changed,
    )


def _nearest_positive(matrix: Array) -> tuple[Array, float]:
    """Symmetric part without negative eigenvalues, and the ratio of the most negative to the
    largest eigenvalue.
    """
    eigenvalues, axes = np.linalg.eigh(0.5 * (matrix + matrix.T))
    lifted = max(0.0, -float(eigenvalues[0])) / float(eigenvalues[-1])
    positive = (axes * np.maximum(eigenvalues, 0.0)) @ axes.T
    return 0.5 * (positive + positive.T), lifted


@kernel(error_model="numpy")
def _system(corners: Array, centers: Array, normals: Array, flux: Array) -> tuple[Array, Array]:
    """Green's identity at the centroids: (N, N) matrix of potentials, and (N, 6) right-hand sides.

    Args:
        corners: (N, 3, 3) corners of the triangles, counter-clockwise from outside.
        centers: (N, 3) their centroids.
        normals: (N, 3) their unit normals.
        flux: (N, 6) speed of the six unit motions along the normals.
    """
    n = len(corners)
    edges = np.empty((n, 3, 3))  # unit vectors, outward in the plane of the triangle
    lengths = np.empty((n, 3))

    for j in range(n):
        for k in range(3):
            along = corners[j, (k + 1) % 3] - corners[j, k]
            lengths[j, k] = np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
            t = along / lengths[j, k]
            m = normals[j]
            edges[j, k, 0] = t[1] * m[2] - t[2] * m[1]
            edges[j, k, 1] = t[2] * m[0] - t[0] * m[2]
            edges[j, k, 2] = t[0] * m[1] - t[1] * m[0]

    matrix = np.empty((n, n))
    right = np.zeros((n, 6))
    scale = 0.25 / np.pi
    r = np.empty((3, 3))
    d = np.empty(3)

    for i in range(n):
        for j in range(n):
            for k in range(3):
                for axis in range(3):
                    r[k, axis] = corners[j, k, axis] - centers[i, axis]
                d[k] = np.sqrt(r[k, 0] ** 2 + r[k, 1] ** 2 + r[k, 2] ** 2)

            # Dipoles: the solid angle [Oosterom 1983].
            angle = 0.0 if i == j else -2.0 * half_solid_angle(r, d)
            height = -(r[0, 0] * normals[j, 0] + r[0, 1] * normals[j, 1] + r[0, 2] * normals[j, 2])

            # Sources: logarithms of the edges [Hess 1967].
            total = 0.0
            for k in range(3):
                around = d[k] + d[(k + 1) % 3]
                away = (
                    r[k, 0] * edges[j, k, 0] + r[k, 1] * edges[j, k, 1] + r[k, 2] * edges[j, k, 2]
                )
                # otherwise the logarithm may be infinite, although its product is zero
                if abs(away) > 1e-14:
                    total += away * np.log((around + lengths[j, k]) / (around - lengths[j, k]))

            matrix[i, j] = 0.5 if i == j else -scale * angle
            source = scale * (total - height * angle)
            for mode in range(6):
                right[i, mode] -= source * flux[j, mode]

    return matrix, right
