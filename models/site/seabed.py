"""Random seabed terrains as MuJoCo height fields, or as meshes for sensors only.

A terrain is a grid of heights. Between its nodes it consists of the triangles of MuJoCo's height
field, so that sensors, collision and evaluation use one surface. MuJoCo collides meshes as their
convex hulls. The mesh therefore serves camera and sonar, the height field collision.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.site.terrain_kinds import KINDS, Kind
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, readonly

if TYPE_CHECKING:
    import mujoco

SEABED_GEOM = "seabed"
_BASE = 0.3  # [m] thickness of solid ground under the lowest point
_RGBA = (0.55, 0.5, 0.4, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seabed:
    """Terrain on an even grid of heights over the square of half side `half` around `center_W`."""

    kind: Kind
    heights: Array  # (n, n) [m] heights over `center_W`, rows along y, columns along x
    half: float  # [m] half side of the square
    center_W: Array  # (3,) [m] centre of the terrain
    rocks: Array  # (k, 3) [m] x, y in W and radius of each rock; (0, 3) without rocks

    def __post_init__(self) -> None:
        heights = np.asarray(self.heights, dtype=np.float64)
        if heights.ndim != 2 or heights.shape[0] != heights.shape[1] or heights.shape[0] < 2:
            raise ConfigurationError(
                f"seabed heights: expected an (n, n) grid, got shape {heights.shape}"
            )
        if not np.all(np.isfinite(heights)):
            raise ConfigurationError("seabed heights: every height must be finite")
        if not self.half > 0.0:
            raise ConfigurationError(f"seabed half: must be > 0 m, got {self.half}")

        object.__setattr__(self, "heights", readonly(heights))
        object.__setattr__(self, "center_W", checked(self.center_W, (3,), "seabed center_W"))
        object.__setattr__(
            self, "rocks", readonly(np.asarray(self.rocks, dtype=np.float64).reshape(-1, 3))
        )

    @property
    def step(self) -> float:
        """Spacing of the nodes [m]."""
        return 2.0 * self.half / (len(self.heights) - 1)

    def height(self, xy_W: ArrayLike) -> Array:
        """Height (N,) [m] in W of the surface at `xy_W` (N, 2 or more) [m]; NaN off the grid."""
        at = np.atleast_2d(np.asarray(xy_W, dtype=np.float64))
        last = len(self.heights) - 1
        u = (at[:, 0] - self.center_W[0] + self.half) / self.step
        v = (at[:, 1] - self.center_W[1] + self.half) / self.step
        with np.errstate(invalid="ignore"):
            inside = (u >= 0.0) & (u <= last) & (v >= 0.0) & (v <= last)

        # Cell of each point, and position in it.
        u = np.where(inside, u, 0.0)
        v = np.where(inside, v, 0.0)
        i = np.minimum(u.astype(int), last - 1)
        j = np.minimum(v.astype(int), last - 1)
        u = u - i
        v = v - j

        a = self.heights[j, i]
        b = self.heights[j, i + 1]
        c = self.heights[j + 1, i + 1]
        d = self.heights[j + 1, i]

        # Each cell is divided along the diagonal from corner a to corner c.
        z = np.where(v <= u, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))
        return np.where(inside, z + self.center_W[2], np.nan)

    def mesh(self) -> tuple[Array, np.ndarray]:
        """Mesh of the terrain: vertices (V, 3) [m] in W, triangles (T, 3) counter-clockwise seen
        from above.
        """
        n = len(self.heights)
        x, y = np.meshgrid(*(np.linspace(-self.half, self.half, n) + c for c in self.center_W[:2]))

        index = np.arange(n * n).reshape(n, n)
        a = index[:-1, :-1].ravel()
        b = index[:-1, 1:].ravel()
        c = index[1:, 1:].ravel()
        d = index[1:, :-1].ravel()

        vertices = np.column_stack(
            [x.ravel(), y.ravel(), (self.heights + self.center_W[2]).ravel()]
        )
        return vertices, np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])

    def add_to(
        self, spec: "mujoco.MjSpec", shape: Literal["height field", "mesh"] = "height field"
    ) -> None:
        """Add the terrain to the world of `spec` as geom SEABED_GEOM; as a mesh it has no
        collision.
        """
        import mujoco

        geom = spec.worldbody.add_geom(name=SEABED_GEOM, rgba=_RGBA)
        if shape == "mesh":
            vertices, triangles = self.mesh()
            mesh = spec.add_mesh(
                name=SEABED_GEOM, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            )
            mesh.uservert = (vertices - self.center_W).ravel()
            mesh.userface = triangles.ravel()
            geom.type = mujoco.mjtGeom.mjGEOM_MESH
            geom.meshname = SEABED_GEOM
            geom.pos = self.center_W
            geom.contype = geom.conaffinity = 0
            return

        low = float(self.heights.min())
        high = float(self.heights.max())
        n = len(self.heights)
        top = max(high - low, 1e-3)  # MuJoCo requires a positive height
        spec.add_hfield(
            name=SEABED_GEOM,
            nrow=n,
            ncol=n,
            size=[self.half, self.half, top, _BASE],
            userdata=((self.heights - low) / top).ravel(),
        )

        geom.type = mujoco.mjtGeom.mjGEOM_HFIELD
        geom.hfieldname = SEABED_GEOM
        geom.pos = [*self.center_W[:2], self.center_W[2] + low]


def seabed(
    kind: Kind,
    rng: np.random.Generator,
    *,
    center_W: ArrayLike = (0.0, 0.0, 0.0),
    half: float = 2.5,
    step: float = 0.02,
    steepest: float = 20.0,
) -> Seabed:
    """Random terrain of `kind`; heading, size and position of its features vary.

    - flat: undulation of 3 to 10 mm over 1 to 3 m.
    - ripples: asymmetric sand ripples, 0.15 to 0.6 m long and a tenth to a fifteenth as high. Sand
      ripples are steeper than 1:20 [Soulsby 1997, ch. 7.2].
    - slope: a plane of 5 degrees to `steepest`.
    - rocks: 6 to 14 half-buried ellipsoids of 0.08 to 0.3 m radius.

    All kinds also have the undulation, and bumps of 1 mm.

    Args:
        kind: one of `KINDS`.
        rng: source of randomness.
        center_W: (3,) [m] centre of the terrain, at its surface.
        half: [m] half side of the square.
        step: [m] spacing of the nodes.
        steepest: [deg] largest slope.

    Returns:
        The terrain.

    Raises:
        ConfigurationError: the kind is unknown, or a size is out of range.
    """
    if kind not in KINDS:
        raise ConfigurationError(f"unknown seabed {kind!r}; there are {', '.join(KINDS)}")
    if not (half > 0.0 and 0.0 < step <= half and 5.0 <= steepest < 60.0):
        raise ConfigurationError(
            "seabed: must have half > 0 m, 0 < step <= half and 5 <= steepest < 60 deg, got "
            f"{half}, {step}, {steepest}"
        )

    center = checked(center_W, (3,), "center_W")
    n = 1 + 2 * round(half / step)
    x, y = np.meshgrid(np.linspace(-half, half, n), np.linspace(-half, half, n))
    z = _waves(x, y, rng, lengths=(1.0, 3.0), height=rng.uniform(0.003, 0.01), count=4)
    z += _waves(x, y, rng, lengths=(0.1, 0.25), height=0.001, count=6)

    rocks = np.zeros((0, 3))
    if kind == "ripples":
        z += _ripples(x, y, rng)
    elif kind == "slope":
        heading = rng.uniform(-np.pi, np.pi)
        tangent = np.tan(np.radians(rng.uniform(5.0, steepest)))
        z += tangent * (np.cos(heading) * x + np.sin(heading) * y)
    elif kind == "rocks":
        stones = []
        for _ in range(rng.integers(6, 15)):
            middle = rng.uniform(-0.8 * half, 0.8 * half, 2)
            radius = rng.uniform(0.08, 0.3)
            squash = rng.uniform(0.5, 1)
            stones.append([*(middle + center[:2]), radius])
            inside = 1.0 - ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / radius**2

            # More than half of each rock is buried, since a height field has no overhangs.
            z = np.maximum(
                z, z.mean() - 0.1 * radius + squash * radius * np.sqrt(np.maximum(inside, 0.0))
            )
        rocks = np.array(stones)

    return Seabed(kind=kind, heights=z - z[n // 2, n // 2], half=half, center_W=center, rocks=rocks)


def _waves(
    x: Array,
    y: Array,
    rng: np.random.Generator,
    *,
    lengths: tuple[float, float],
    height: float,
    count: int,
) -> Array:
    """Sum of `count` sine waves of random heading; its standard deviation is `height` [m]."""
    z = np.zeros_like(x)
    for _ in range(count):
        k = 2.0 * np.pi / rng.uniform(*lengths)
        heading = rng.uniform(-np.pi, np.pi)
        phase = rng.uniform(0.0, 2 * np.pi)
        z += np.sin(k * (np.cos(heading) * x + np.sin(heading) * y) + phase)
    return z * height / np.sqrt(0.5 * count)


def _ripples(x: Array, y: Array, rng: np.random.Generator) -> Array:
    """Ripples with a steep lee side and meandering crests."""
    length = rng.uniform(0.15, 0.6)
    heading = rng.uniform(-np.pi, np.pi)
    height = length / rng.uniform(10.0, 15.0)  # [m] height from trough to crest

    # Crests meander, and are steeper on one side.
    along = np.cos(heading) * x + np.sin(heading) * y
    across = np.cos(heading) * y - np.sin(heading) * x
    along = along + 0.15 * length * np.sin(
        2.0 * np.pi * across / rng.uniform(1.0, 2.0) + rng.uniform(0.0, 2 * np.pi)
    )

    phase = 2.0 * np.pi * along / length
    return 0.5 * height * np.sin(phase + 0.4 * np.sin(phase))
