"""Subsea manifold block with sampling holes: mesh for identification, collision shapes with real
holes.

Frame T has its origin in the middle of the block's face and z out of it. A hole is a blind bore
with a chamfered mouth. The wall of a hole is a ring of boxes whose inner faces are tangent to the
bore's circle from outside. The free bore is at least that circle, and at the corners between boxes
wider by r (1 / cos(pi / SIDES) - 1). All parts are whole boxes, so contact with them is exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.meshes.closed_shells import joined, revolve, welded
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import ModelPath, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, readonly, rotation_from_z

SIZE = (0.56, 0.42, 0.14)  # [m] of the block
SIDES = 24  # boxes around a bore; its corners lie 0.17 mm outside the circle for a radius of 20 mm
_CELL = 0.05  # [m] half side of the square cell around a hole
_PIPE_SIDES = 48  # number of sides of a pipe in the mesh
_FACETS = 96  # number of sides of a bore's circle in the mesh
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hole:
    """Blind bore with a chamfered mouth."""

    p_T: Array  # (3,) [m] middle of the mouth, in T
    z_T: Array  # (3,) unit vector out of the bore, in T
    radius: float  # [m] radius of the bore
    depth: float  # [m] from the face to the bottom
    chamfer: float  # [m] width and depth of the 45 deg chamfer at the mouth

    def pose(self, X_WT: Array) -> Array:
        """Pose X_WH (4, 4) for a target at `X_WT`: origin in the mouth, z inwards, x near x_T."""
        R_TH = rotation_from_z(-self.z_T, [1.0, 0.0, 0.0])
        return np.asarray(X_WT) @ pose(R_TH, self.p_T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Manifold:
    """Manifold block as a target, with its holes by name."""

    target: TargetModel
    holes: Mapping[str, Hole]

    def hole(self, name: str) -> Hole:
        """Hole by name.

        Raises:
            ConfigurationError: an unknown name; the message lists the known ones.
        """
        if name not in self.holes:
            raise ConfigurationError(
                f"the manifold has no hole {name!r}; it has {sorted(self.holes)}"
            )
        return self.holes[name]


def manifold(radius: float = 0.02, depth: float = 0.08, chamfer: float = 0.002) -> Manifold:
    """Manifold block with pipes in three directions and two holes, "a" and "b".

    The pipes are closed shells that intersect the block, and remove every symmetry. The target's
    paths "beside_a" and "beside_b" are short lines on the face next to the holes.

    Args:
        radius: [m] of the bores.
        depth: [m] of the bores, from the face to the bottom.
        chamfer: [m] width and depth of the chamfer.

    Returns:
        The block with its holes.

    Raises:
        ConfigurationError: a hole does not fit into the block.
    """
    length, width, height = SIZE
    if not (radius > 0.0 and chamfer >= 0.0 and radius + chamfer < 0.9 * _CELL):
        raise ConfigurationError(
            f"manifold: radius must be > 0 and chamfer >= 0 m, together below {0.9 * _CELL} m; "
            f"got {radius}, {chamfer}"
        )
    if not chamfer < depth < height - 0.01:
        raise ConfigurationError(
            f"manifold: depth must lie between the chamfer's {chamfer} m and {height - 0.01:.2f} "
            f"m, got {depth}"
        )

    holes = {
        name: Hole(
            p_T=readonly([x, -0.07, 0.0]),
            z_T=readonly(_Z),
            radius=radius,
            depth=depth,
            chamfer=chamfer,
        )
        for name, x in (("a", 0.05), ("b", -0.1))
    }

    # The face is divided into cells by these lines; a cell is whole or has a hole.
    columns = sorted(
        {
            -0.5 * length,
            0.5 * length,
            *(h.p_T[0] + s * _CELL for h in holes.values() for s in (-1, 1)),
        }
    )
    rows = [-0.5 * width, -0.07 - _CELL, -0.07 + _CELL, 0.5 * width]

    mesh = _Mesh()
    solids: list[Solid] = [
        _box("target", [0, 0, -0.5 * (height + depth)], [length, width, height - depth])
    ]

    for x0, x1 in pairwise(columns):
        for y0, y1 in pairwise(rows):
            middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0])
            bored = [name for name, hole in holes.items() if np.allclose(hole.p_T, middle, 0, 1e-9)]
            if bored:
                mesh.bore(holes[bored[0]])
                solids += _ring(bored[0], holes[bored[0]])
            else:
                mesh.quad([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
                cell = f"target_face_{len(solids)}"
                solids.append(_box(cell, middle - [0, 0, 0.5 * depth], [x1 - x0, y1 - y0, depth]))

    mesh.sides(columns, rows, height)
    shells = [welded(*mesh.arrays())]

    for pipe in _PIPES:
        solids.append(pipe.solid)
        shells.append(pipe.shell)

    x = np.linspace(-0.02, 0.02, 9)
    ones = np.ones((9, 1))
    line = np.column_stack([x, np.full(9, radius + chamfer + 0.015), np.zeros(9)])
    beside = {
        name: ModelPath(p=hole.p_T + line, a=-ones * _Z, b=ones * [1.0, 0.0, 0.0])
        for name, hole in holes.items()
    }

    vertices, triangles = joined(shells)
    target = TargetModel(
        name="manifold",
        vertices=vertices,
        triangles=triangles,
        paths={f"beside_{name}": path for name, path in beside.items()},
        solids=tuple(solids),
    )
    return Manifold(target=target, holes=MappingProxyType(holes))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pipe:
    """A pipe through the block, a closed cylinder."""

    name: str
    radius: float  # [m]
    length: float  # [m]
    axis: tuple[float, float, float]
    middle: tuple[float, float, float]  # [m] in T

    @property
    def _R(self) -> Array:
        return rotation_from_z(self.axis, [0.3, 0.5, 0.7])

    @property
    def solid(self) -> Solid:
        """Its body, with the axis along z."""
        return Solid(
            name=f"target_{self.name}",
            kind="cylinder",
            size=(self.radius, 0.5 * self.length),
            X_TS=pose(self._R, self.middle),
        )

    @property
    def shell(self) -> tuple[Array, np.ndarray]:
        """Vertices and triangles of its surface, revolved about x."""
        half = 0.5 * self.length
        outline = [(-half, 0.0), (-half, self.radius), (half, self.radius), (half, 0.0)]
        vertices, triangles = revolve(outline, _PIPE_SIDES)
        R = self._R @ exp_so3([0.0, -0.5 * np.pi, 0.0])
        return vertices @ R.T + np.array(self.middle), triangles


_PIPES = (
    _Pipe(name="header", radius=0.045, length=0.5, axis=(1, 0, 0), middle=(-0.03, 0.14, 0.07)),
    _Pipe(name="branch", radius=0.03, length=0.26, axis=(0, 1, 0), middle=(0.2, -0.03, 0.05)),
    _Pipe(name="valve", radius=0.04, length=0.13, axis=(0, 0, 1), middle=(-0.22, -0.14, 0.06)),
)


def _box(name: str, middle: ArrayLike, size: ArrayLike, R: Array | None = None) -> Solid:
    half = 0.5 * np.asarray(size, dtype=np.float64)
    return Solid(name=name, kind="box", size=tuple(half.tolist()), X_TS=pose(R, middle))


def _ring(name: str, hole: Hole) -> list[Solid]:
    """Boxes around the bore, out to the corners of its cell: wall, lip and chamfer for each
    side.
    """
    r = hole.radius
    c = hole.chamfer
    out = np.sqrt(2.0) * _CELL
    wide = 2.0 * out * np.tan(np.pi / SIDES)
    boxes = []
    for k in range(SIDES):
        R = exp_so3([0.0, 0.0, 2.0 * np.pi * k / SIDES])

        def part(
            kind: str,
            x: float,
            z: float,
            size: list[float],
            tilt: float = 0.0,
            k: int = k,
            R: Array = R,
        ) -> Solid:
            middle = hole.p_T + R @ [x, 0.0, z]
            return _box(f"target_{name}_{kind}_{k}", middle, size, R @ exp_so3([0.0, tilt, 0.0]))

        boxes.append(
            part("wall", 0.5 * (r + out), -0.5 * (hole.depth + c), [out - r, wide, hole.depth - c])
        )
        if c > 0.0:
            boxes.append(part("lip", 0.5 * (r + c + out), -0.5 * c, [out - r - c, wide, c]))

            # One face of this box is the chamfer from (r, -c) to (r + c, 0), and the box lies
            # behind it.
            s = 0.25 * c
            boxes.append(
                part(
                    "chamfer",
                    r + 0.5 * c + s,
                    -0.5 * c - s,
                    [2.0 * np.sqrt(2) * s, wide, c * np.sqrt(2)],
                    0.25 * np.pi,
                )
            )

    return boxes


class _Mesh:
    """Builder that collects vertices and triangles, counter-clockwise from outside."""

    def __init__(self) -> None:
        self._parts: list[tuple[Array, np.ndarray]] = []

    def add(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        self._parts.append(
            (np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64))
        )

    def quad(self, corners: ArrayLike) -> None:
        self.add(corners, [[0, 1, 2], [0, 2, 3]])

    def bore(self, hole: Hole) -> None:
        """Add the face's cell around a hole, the chamfer, the wall and the bottom."""
        n = _FACETS
        angle = 2.0 * np.pi * np.arange(n) / n
        circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
        r = hole.radius
        c = hole.chamfer
        i = np.arange(n)
        j = (i + 1) % n

        # Each corner of the square is joined to the nearest quarter of the mouth's circle.
        corners = hole.p_T + _CELL * np.array(
            [[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=np.float64
        )
        corner = i // (n // 4)
        fan = np.column_stack([n + corner, j, i])
        gaps = [[n + k, n + (k + 1) % 4, (n // 4) * (k + 1) % n] for k in range(4)]
        self.add(np.vstack([hole.p_T + (r + c) * circle, corners]), np.vstack([fan, gaps]))

        rings = (
            [(r + c, 0.0), (r, -c), (r, -hole.depth)] if c > 0.0 else [(r, 0.0), (r, -hole.depth)]
        )
        for (r0, z0), (r1, z1) in pairwise(rings):
            upper = hole.p_T + r0 * circle + [0, 0, z0]
            lower = hole.p_T + r1 * circle + [0, 0, z1]
            self.add(
                np.vstack([upper, lower]),
                np.vstack([np.column_stack([i, j, n + j]), np.column_stack([i, n + j, n + i])]),
            )

        bottom = hole.p_T + r * circle - [0, 0, hole.depth]
        self.add(
            np.vstack([bottom, hole.p_T - [0, 0, hole.depth]]),
            np.column_stack([i, j, np.full(n, n)]),
        )

    def sides(self, columns: list[float], rows: list[float], height: float) -> None:
        """Add the block without its front face. The edge of that face has corners at `columns` (x),
        `rows` (y).
        """
        x = np.array(columns)
        y = np.array(rows)
        rim = np.concatenate(
            [
                np.column_stack([x[:-1], np.full(len(x) - 1, y[0])]),
                np.column_stack([np.full(len(y) - 1, x[-1]), y[:-1]]),
                np.column_stack([x[:0:-1], np.full(len(x) - 1, y[-1])]),
                np.column_stack([np.full(len(y) - 1, x[0]), y[:0:-1]]),
            ]
        )

        n = len(rim)
        top = np.column_stack([rim, np.zeros(n)])
        i = np.arange(n)
        j = (i + 1) % n
        wall = np.vstack([np.column_stack([i + n, j + n, j]), np.column_stack([i + n, j, i])])

        bottom = top - [0.0, 0.0, height]
        under = np.column_stack([j + n, i + n, np.full(n, 2 * n)])
        self.add(np.vstack([top, bottom, bottom.mean(axis=0)]), np.vstack([wall, under]))

    def arrays(self) -> tuple[Array, np.ndarray]:
        return joined(self._parts)
