"""Drag of a shape from its projected areas, by published coefficients of plain shapes.

The bluntness of a silhouette is the mean, over the projected area, of the squared cosine between
flow and surface normal: 1/2 for a sphere, 2/3 for a cylinder across the flow, 1 for a flat face.
Between these the coefficient is interpolated. The coefficients are those of [Hoerner 1965, chapter
3] as [White 2011, table 7.3] lists them, at Reynolds numbers from 1e4 to the drag crisis.
"""

from dataclasses import dataclass

import numpy as np

from uuv.models.hydrodynamics import StripDrag
from uuv.models.water_from_geometry.scan import scanned
from uuv.models.water_from_geometry.surface import UnionSurface, box_axes
from uuv.sim.interfaces.spatial import Array, exp_so3

SLENDER = 3.0  # length over width, from which on a body is modelled as a strip
# share of the longest extent: a body whose middle is farther from its origin is modelled as a strip
ASIDE = 0.25
_LINES = 240  # number of lines across the longer side of the silhouettes
# [rad] angle of the grid of lines about the flow, so that no edge of a usual body is parallel to a
# line
_ASKEW = 0.4
_SPHERE, _CYLINDER, _FLAT = 0.5, 2.0 / 3.0, 1.0  # bluntness

# Length along the flow over width: drag coefficient. Beyond 8, skin friction of 0.005 on the
# surface is added. An ellipsoid of revolution, and a flat-faced body, a cube at 1.
_ROUND = ((0.75, 1.0, 2.0, 4.0, 8.0, 100.0), (0.5, 0.47, 0.27, 0.25, 0.2, 2.0))
_BLUNT = ((0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 100.0), (1.17, 1.15, 1.05, 0.85, 0.87, 0.99, 2.8))

# Length of a silhouette over its width: drag coefficient. A cylinder, and a rectangular plate.
_ACROSS = (
    (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 200.0),
    (0.64, 0.68, 0.74, 0.74, 0.82, 0.91, 0.98, 1.2),
)
_PLATE = ((1.0, 5.0, 10.0, 20.0, 100.0), (1.18, 1.2, 1.3, 1.5, 2.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Silhouettes:
    """What a flow along each of three axes meets."""

    area: Array  # (3,) [m^2]
    bluntness: Array  # (3,) mean squared cosine, front and back
    extent: Array  # (3,) [m] of the bounding box

    @property
    def coefficients(self) -> Array:
        """Drag coefficients (3,) on the projected areas."""
        return np.array([self._coefficient(k) for k in range(3)])

    def _coefficient(self, k: int) -> float:
        across = np.delete(self.extent, k)
        width = float(np.sqrt(self.area[k]))
        depth = float(self.extent[k]) / width
        slenderness = float(across.max() / across.min())

        flat = np.interp(depth, *_BLUNT) * np.interp(slenderness, *_PLATE) / _PLATE[1][0]
        cylinder = np.interp(slenderness, *_ACROSS)
        return float(
            np.interp(
                self.bluntness[k],
                (_SPHERE, _CYLINDER, _FLAT),
                (np.interp(depth, *_ROUND), cylinder, flat),
            )
        )


def silhouettes(corners: Array) -> Silhouettes:
    """Silhouettes of the union of closed shells (T, 3, 3) [m] along the axes of their frame."""
    a, b, c = corners.transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    area = np.zeros(3)
    blunt = np.zeros(3)
    for k in range(3):
        scan = scanned(corners @ exp_so3(_ASKEW * np.eye(3)[k]), _LINES, k)
        area[k] = scan.area
        met = normals[scan.triangle[scan.outer], k] ** 2
        blunt[k] = met.mean() if len(met) else 1.0

    return Silhouettes(area=area, bluntness=blunt, extent=np.ptp(corners.reshape(-1, 3), axis=0))


def spin_integral(vertices: Array, triangles: np.ndarray) -> Array:
    """Integrals (3,) [m^5] of |normal speed|^3 of unit turns about the axes, over the pushing half.

    For a box they are those of |r|^3 over its faces, as in `uuv.models.hydrodynamics.box`.
    """
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(cross, axis=1)
    n = cross / np.maximum(2.0 * area[:, None], 1e-300)

    # Quadrature at the midpoints of the edges, exact to degree 2.
    total = np.zeros(3)
    for point in (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)):
        total += np.sum(area[:, None] * np.abs(np.cross(point, n)) ** 3, axis=0) / 3.0
    return 0.5 * total


def strip_of(
    R: Array, extent: Array, center: Array, outline: Silhouettes, density: float
) -> StripDrag:
    """One strip along the longest axis of a body, through the body's centre of buoyancy.

    Args:
        R: (3, 3) principal axes in body axes, the longest first.
        extent: (3,) [m] lowest and highest position along the longest axis from `center`, and the
            length.
        center: (3,) [m] centre of buoyancy, body frame.
        outline: silhouettes along the principal axes.
        density: [kg/m^3].
    """
    low, high, length = extent
    force = 0.5 * density * outline.coefficients * outline.area

    return StripDrag(
        start=center + low * R[:, 0],
        end=center + high * R[:, 0],
        normal=float(force[1:].mean()) / length,
        tangential=float(force[0]) / length,
    )


def drag_of(
    corners: Array, center: Array, surface: UnionSurface, density: float
) -> tuple[StripDrag | None, Array, str, str]:
    """Strip or None, quadratic damping (6,), origin as text, value as text."""
    R = box_axes(corners)
    order = np.argsort(-np.ptp((corners @ R).reshape(-1, 3), axis=0), kind="stable")
    R = R[:, order]
    R = R * [1.0, 1.0, np.sign(np.linalg.det(R))]
    turned = corners @ R

    length, *across = np.ptp(turned.reshape(-1, 3), axis=0)
    slenderness = float(length / np.sqrt(np.prod(across)))
    aside = float(np.linalg.norm(center))

    if slenderness >= SLENDER or aside > ASIDE * length:
        outlines = silhouettes(turned)
        along = turned[..., 0] - center @ R[:, 0]
        strip = strip_of(R, np.array([along.min(), along.max(), length]), center, outlines, density)
        why = (
            f"{slenderness:.1f} times as long as wide"
            if slenderness >= SLENDER
            else "its middle is off its origin"
        )
        figure = f"{strip.normal:.3g} across, {strip.tangential:.3g} along kg/m^2"
        return strip, np.zeros(6), f"a strip, {why}; {_coefficients(outlines)}", figure

    outlines = silhouettes(corners)
    C = outlines.coefficients
    area = outlines.area
    turning = np.array([np.average(np.delete(C, k), weights=np.delete(area, k)) for k in range(3)])
    quadratic = 0.5 * density * np.concatenate([C * area, turning * _spin(corners, surface)])

    return (
        None,
        quadratic,
        f"projected areas; {_coefficients(outlines)}",
        figures(quadratic) + " N s^2/m^2, N m s^2",
    )


def _spin(corners: Array, surface: UnionSurface) -> Array:
    """Spin integrals (3,) of the surface, or of the shells if the surface does not contain the
    body.
    """
    if surface.holds_body:
        return spin_integral(surface.vertices, surface.triangles)
    return spin_integral(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _coefficients(outline: Silhouettes) -> str:
    return f"C_d {figures(outline.coefficients)} on {figures(1e4 * outline.area)} cm^2"


def figures(values: Array) -> str:
    """Numbers as text, with three digits."""
    return " ".join(f"{number:.3g}" for number in np.where(np.abs(values) < 1e-9, 0.0, values))
