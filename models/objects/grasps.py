"""Grasps of an object by parallel jaws: declared with the object, or searched on its mesh.

A grasp is a pair of antipodal places: two points of the surface whose normals lie within the
friction cone about the line between them [Nguyen 1988]. Along this line the jaws close. From which
side they come is chosen at the site (`uuv.controllers.planning.grasp_choice`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, finite_number, readonly

PAIRS = 1500  # places of the surface from which an opposite one is searched
_INSIDE = 1e-5  # [m] below the surface, where a ray begins
_ONE = 1.0 - 1e-9
# Fractions of the plastic number: points in a triangle that fill it evenly without chance.
_EVEN = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grasp:
    """A position on an object, in T, at which parallel jaws can close."""

    p: Array  # (3,) [m] middle between the two points
    x: Array  # (3,) unit, along which the jaws close
    width: float  # [m] between the points
    slope: float = 0.0  # tangent of the larger angle between a normal and x

    def __post_init__(self) -> None:
        """Raise ConfigurationError for invalid vectors, or a width that is not above 0."""
        axis = checked(self.x, (3,), "grasp x")
        if abs(np.linalg.norm(axis) - 1.0) > 1e-6:
            raise ConfigurationError("grasp x: must be a unit vector")
        object.__setattr__(self, "x", readonly(axis))
        object.__setattr__(self, "p", readonly(checked(self.p, (3,), "grasp p [m]")))
        finite_number(self.width, "grasp: width [m]", above=0.0)
        finite_number(self.slope, "grasp: slope", least=0.0)


def checked_grasps(grasps: object, whose: str) -> dict[str, Grasp]:
    """Grasps by name.

    Raises:
        ConfigurationError: they are no mapping of names to grasps.
    """
    if isinstance(grasps, Mapping):
        kept = {str(name): grasp for name, grasp in grasps.items() if isinstance(grasp, Grasp)}
        if len(kept) == len(grasps):
            return kept
    raise ConfigurationError(f"{whose}: grasps must be a mapping of names to Grasp")


def antipodal(
    vertices: Array, triangles: np.ndarray, *, friction: float, count: int = PAIRS
) -> tuple[Grasp, ...]:
    """Grasps on a mesh, from points spread evenly over its surface.

    Args:
        vertices: (V, 3) [m] of the mesh; where it is open, nothing is found opposite the hole.
        triangles: (T, 3) indices.
        friction: coefficient between pads and object.
        count: number of places.
    """
    points, normals = surface_points(vertices, triangles, count)
    scene = RayScene(vertices, triangles)
    hit = scene.cast(points - _INSIDE * normals, -normals)
    width = np.asarray(hit["t"], dtype=np.float64) + _INSIDE

    # A ray leaves the object where the normal there points along it.
    cosine = -np.einsum("ij,ij->i", np.asarray(hit["normal"], dtype=np.float64), normals)
    cosine = np.minimum(cosine, _ONE)
    opposite = np.isfinite(width) & (cosine > 0.0)
    slope = np.full(len(width), np.inf)
    slope[opposite] = np.sqrt(1.0 - cosine[opposite] ** 2) / cosine[opposite]

    return tuple(
        Grasp(
            p=points[i] - 0.5 * width[i] * normals[i],
            x=normals[i],
            width=float(width[i]),
            slope=float(slope[i]),
        )
        for i in np.flatnonzero(slope < friction)
    )


def surface_points(vertices: Array, triangles: np.ndarray, count: int) -> tuple[Array, Array]:
    """Points (count, 3) [m] spread evenly over a mesh, and its unit normals (count, 3) there."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    size = np.linalg.norm(cross, axis=1)

    # As many points on each triangle as it has area.
    upto = np.cumsum(size)
    at = (np.arange(count) + 0.5) / count * upto[-1]
    chosen = np.minimum(np.searchsorted(upto, at), len(size) - 1)

    # Within the triangle: the unit square, folded.
    shares = (np.arange(count)[:, None] + 1.0) * _EVEN % 1.0
    beyond = shares.sum(axis=1) > 1.0
    shares[beyond] = 1.0 - shares[beyond]
    points = a[chosen] + shares[:, :1] * (b - a)[chosen] + shares[:, 1:] * (c - a)[chosen]
    return points, cross[chosen] / size[chosen, None]
