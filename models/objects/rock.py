"""Free-form rock: a random star-shaped boulder, one shape per seed, to test identification.

A boulder is a ball cut by planes at random distances, with rounded edges. Its radius in a direction
is the smooth minimum of the distances to the planes along that ray. Broad swells and hollows make
it concave in places.
"""

import numpy as np

from uuv.models.meshes.closed_shells import sphere
from uuv.models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

STONE = 0.08  # [m] extent of a stone
_PLANES = 14  # number of random cutting planes, besides the six that bound the rock
_WORN = 9.0  # exponent of the smooth minimum; larger gives sharper edges
_SWELLS = 10  # number of swells and hollows
_LEVEL = 5  # subdivisions of the sphere: 20480 triangles, sides about 1 cm


def rock(seed: int = 0, size: float = 0.6, roughness: float = 0.06) -> TargetModel:
    """Random rock as a target, star-shaped about its origin, z_T up.

    The paths "over" along x_T and "across" along y_T run over the top and span 80 deg seen from the
    origin.

    Args:
        seed: seed of the shape.
        size: [m] largest extent.
        roughness: height of swells and hollows, as a share of the radius, in [0, 0.15].

    Returns:
        The target.

    Raises:
        ConfigurationError: a seed, size or roughness is out of range.
    """
    if not (np.isfinite(size) and size > 0.0):
        raise ConfigurationError(f"rock: size must be > 0 m, got {size}")
    if not 0.0 <= roughness <= 0.15:
        raise ConfigurationError(f"rock: roughness must lie in [0, 0.15], got {roughness}")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ConfigurationError(f"rock: seed must be a whole number >= 0, got {seed!r}")

    form = _Form(np.random.default_rng([int(seed), 7]), roughness)
    ways, triangles = sphere(_LEVEL)
    scale = size / float(np.ptp(form.surface(ways), axis=0).max())
    paths = {
        name: form.path(along, scale)
        for name, along in (("over", [1, 0, 0]), ("across", [0, 1, 0]))
    }

    return TargetModel(
        name="rock", vertices=scale * form.surface(ways), triangles=triangles, paths=paths
    )


def stone(seed: int = 0) -> TargetModel:
    """Stone of 80 mm, small enough for a gripper."""
    return rock(seed, size=STONE)


class _Form:
    """Seeded star-shaped surface: distance from the middle in every direction."""

    def __init__(self, rng: np.random.Generator, roughness: float) -> None:
        normals = rng.normal(size=(_PLANES, 3))
        swells = rng.normal(size=(_SWELLS, 3))

        # Six planes along the axes bound the rock, the others are random.
        self._normals = np.vstack(
            [np.eye(3), -np.eye(3), normals / np.linalg.norm(normals, axis=1, keepdims=True)]
        )

        stretch = np.sort(rng.uniform(0.62, 1.0, 3))[::-1]  # x is the longest axis, z the shortest
        self._reach = rng.uniform(0.85, 1.1, len(self._normals)) * np.linalg.norm(
            self._normals * stretch, axis=1
        )
        self._swells = swells / np.linalg.norm(swells, axis=1, keepdims=True)
        self._heights = roughness * rng.uniform(-1.0, 1.0, _SWELLS)

    def surface(self, ways: Array) -> Array:
        """Points (N, 3) of the surface in the unit directions `ways` (N, 3)."""
        facing = np.maximum(ways @ self._normals.T, 0.0) / self._reach
        radius = np.linalg.norm(facing, ord=_WORN, axis=1) ** -1.0
        # each swell or hollow is about 40 deg wide
        swell = np.exp((ways @ self._swells.T - 1.0) / 0.12) @ self._heights
        return (radius * (1.0 + swell))[:, None] * ways

    def path(self, along: list[int], scale: float) -> ModelPath:
        """Path over the top in the plane of z and `along`, to 40 deg off z; tool axis inwards."""
        side = np.array(along, dtype=np.float64)
        fine = np.radians(np.linspace(-40.0, 40.0, 2001))
        p = scale * self.surface(
            np.sin(fine)[:, None] * side + np.cos(fine)[:, None] * [0.0, 0.0, 1.0]
        )

        # Even steps along the arc.
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
        angle = np.interp(
            np.linspace(0.0, arc[-1], max(8, 1 + round(arc[-1] / PATH_STEP))), arc, fine
        )
        way = np.sin(angle)[:, None] * side + np.cos(angle)[:, None] * [0.0, 0.0, 1.0]
        ahead = np.cos(angle)[:, None] * side - np.sin(angle)[:, None] * [0.0, 0.0, 1.0]
        aside = np.cross(way, ahead)

        # Normals by central differences along and across the path.
        h = 1e-5
        along_path = self._moved(way, h * ahead) - self._moved(way, -h * ahead)
        normal = np.cross(along_path, self._moved(way, h * aside) - self._moved(way, -h * aside))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)

        return ModelPath(
            p=scale * self.surface(way),
            a=-normal * np.sign(np.einsum("ij,ij->i", normal, way))[:, None],
            b=along_path / np.linalg.norm(along_path, axis=1, keepdims=True),
        )

    def _moved(self, ways: Array, by: Array) -> Array:
        moved = ways + by
        return self.surface(moved / np.linalg.norm(moved, axis=1, keepdims=True))
