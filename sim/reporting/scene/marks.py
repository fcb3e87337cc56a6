"""Marks drawn into a scene: rods and arrows without shading."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array

_SIDES = 10  # of a rod
_HEAD = 2.4  # radius of an arrow's head over that of its shaft
_HEAD_LENGTH = 6.0  # length of the head over the radius of the shaft
_GLOW = 0.35  # light that MuJoCo adds to that of the scene, for colours as by rays
_SHORT = 1e-6  # [m] a mark that is shorter is left out


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """Rod, or arrow, from one point to another."""

    start_W: Array  # (3,) [m]
    end_W: Array  # (3,) [m]
    radius: float  # [m] of the rod, or of the arrow's shaft
    colour: tuple[float, float, float]  # red, green, blue in [0, 1]
    arrow: bool = False


def line(points_W: Array, radius: float, colours: Array) -> list[Mark]:
    """Rods between neighbouring points (N, 3), the k-th in the k-th colour of (N - 1, 3)."""
    return [
        Mark(start, end, radius, (float(c[0]), float(c[1]), float(c[2])))
        for start, end, c in zip(points_W[:-1], points_W[1:], colours, strict=True)
    ]


def triangles(marks: Sequence[Mark]) -> tuple[Array, Array]:
    """Corners (3 T, 3) [m] in W, three for a triangle, and colours (T, 3) of the marks."""
    corners = [np.zeros((0, 3))]
    colours = [np.zeros((0, 3))]
    for mark in marks:
        along = mark.end_W - mark.start_W
        length = float(np.linalg.norm(along))
        if length < _SHORT:
            continue

        # Profile: distances along the mark, and radii there.
        r = mark.radius
        neck = max(length - _HEAD_LENGTH * r, 0.0)
        z = [0.0, 0.0, neck, neck, length] if mark.arrow else [0.0, 0.0, length, length]
        radii = [0.0, r, r, _HEAD * r, 0.0] if mark.arrow else [0.0, r, r, 0.0]

        rings = _rings(along / length, np.array(z), np.array(radii)) + mark.start_W
        low = rings[:-1]
        high = rings[1:]
        low_next = np.roll(low, -1, axis=1)
        high_next = np.roll(high, -1, axis=1)
        faces = np.concatenate(
            [np.stack([low, low_next, high_next], 2), np.stack([low, high_next, high], 2)]
        ).reshape(-1, 3)
        corners.append(faces)
        colours.append(np.tile(mark.colour, (len(faces) // 3, 1)))

    return np.concatenate(corners), np.concatenate(colours)


def _rings(along: Array, z: Array, radii: Array) -> Array:
    """Points (P, sides, 3) of rings about a unit vector, at distances and radii (P,)."""
    other = np.eye(3)[np.abs(along).argmin()]
    x = np.asarray(np.cross(along, other), dtype=np.float64)
    x /= np.linalg.norm(x)
    y = np.asarray(np.cross(along, x), dtype=np.float64)

    angle = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    circle = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    return radii[:, None, None] * circle + z[:, None, None] * along


def add_to(scene: mujoco.MjvScene, marks: Sequence[Mark]) -> None:
    """Adds marks to MuJoCo's scene, as many as it has room for."""
    for mark in marks:
        if np.linalg.norm(mark.end_W - mark.start_W) < _SHORT or scene.ngeom == scene.maxgeom:
            continue
        geom = scene.geoms[scene.ngeom]
        kind = mujoco.mjtGeom.mjGEOM_ARROW if mark.arrow else mujoco.mjtGeom.mjGEOM_CAPSULE
        rgba = np.array([*mark.colour, 1.0], dtype=np.float32)

        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), rgba)
        reach = 2.0 if mark.arrow else 1.0  # MuJoCo draws arrows half as long
        end_W = mark.start_W + reach * (mark.end_W - mark.start_W)
        mujoco.mjv_connector(geom, kind, mark.radius, mark.start_W, end_W)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        geom.emission = _GLOW
        geom.specular = 0.0
        geom.shininess = 0.0
        scene.ngeom += 1
