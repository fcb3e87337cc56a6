"""Starfish of [Konoplin 2022, fig. 2]: thin, with five equal arms, so that yaw is ambiguous by 72
deg.

The paper gives no sizes; here the starfish is 0.4 m across and 35 mm thick. The underside is flat,
the upper side domed.
"""

import numpy as np

from uuv.models.objects.grasps import Grasp
from uuv.models.objects.target_model import PATH_STEP, ModelPath, Symmetry, TargetModel
from uuv.sim.interfaces.spatial import Array, exp_so3

THICKNESS = 0.035  # [m] thickness in the middle
ARMS = 5  # equal arms, so the symmetry is a turn of 72 deg
REACH = 0.2  # [m] from the middle to an arm's tip
WAIST = 0.07  # [m] from the middle to the outline between two arms
RIM = 0.3  # thickness of the rim, as a share of that in the middle
GRIPPED = 0.1  # [m] from the middle to where an arm's sides are parallel, and can be gripped
_AROUND = 36 * ARMS  # number of vertices of a ring
_RINGS = 16  # number of rings of vertices, from the rim to the middle


def outline(angle: Array) -> Array:
    """Distance (N,) [m] of the outline from the middle at `angle` (N,) [rad]; an arm is on x_T."""
    return WAIST + (REACH - WAIST) * (0.5 + 0.5 * np.cos(ARMS * angle)) ** 2


def _height(share: Array) -> Array:
    """Height [m] over the flat underside at `share` of the distance from the middle to the
    outline.
    """
    return THICKNESS * (
        RIM + (1.0 - RIM) * np.sqrt(1.0 - 0.96 * share**2) - 0.2 * (1.0 - RIM) * share**8
    )


def arm() -> ModelPath:
    """Path along the ridge of the arm that lies along x_T, outwards."""
    x = np.arange(0.02, 0.8 * REACH, PATH_STEP)
    return _on_top(np.column_stack([x, np.zeros_like(x)]))


def ring(radius: float = 0.05) -> ModelPath:
    """Circular path of `radius` [m] around the middle, right-handed about z_T, within the waist."""
    angle = np.linspace(0.0, 2.0 * np.pi, max(16, round(2.0 * np.pi * radius / PATH_STEP)))
    return _on_top(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def grasps() -> dict[str, Grasp]:
    """Grasps across each arm, at its rim."""
    angle = np.linspace(0.0, np.pi / ARMS, 2000)
    x, y = outline(angle) * np.array([np.cos(angle), np.sin(angle)])
    half = float(np.interp(GRIPPED, x[::-1], y[::-1]))
    height = 0.9 * RIM * THICKNESS - 0.5 * THICKNESS

    along_z = [exp_so3([0.0, 0.0, 2.0 * np.pi * k / ARMS]) for k in range(ARMS)]
    return {
        f"arm_{k}": Grasp(
            p=turn @ [GRIPPED, 0.0, height], x=turn @ [0.0, 1.0, 0.0], width=2.0 * half
        )
        for k, turn in enumerate(along_z)
    }


def _on_top(xy: Array) -> ModelPath:
    """Path over `xy` (N, 2) [m] on the upper side, tool axis along the inward normal."""

    def surface(at: Array) -> Array:
        share = np.hypot(*at.T) / outline(np.arctan2(at[:, 1], at[:, 0]))
        return np.column_stack([at, _height(share) - 0.5 * THICKNESS])

    p = surface(xy)
    h = 1e-5

    along_x = surface(xy + np.array([h, 0.0])) - surface(xy - np.array([h, 0.0]))
    along_y = surface(xy + np.array([0.0, h])) - surface(xy - np.array([0.0, h]))
    normal = np.cross(along_x, along_y)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    along = np.gradient(p, axis=0)
    along -= np.einsum("ij,ij->i", along, normal)[:, None] * normal

    return ModelPath(p=p, a=-normal, b=along / np.linalg.norm(along, axis=1, keepdims=True))


def starfish() -> TargetModel:
    """Starfish as a target: z_T out of its domed side, x_T along an arm, origin at half thickness.

    The paths are "arm" (a line along an arm) and "ring" (a circle in the middle). The shape is
    symmetric under turns of 72 deg about z_T.
    """
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    share = (np.arange(1, _RINGS + 1) / _RINGS) ** 0.8  # rings are denser where the dome is steep
    edge = outline(angle)

    rings = np.stack(
        [
            share[:, None] * edge * np.cos(angle),
            share[:, None] * edge * np.sin(angle),
            np.repeat(_height(share)[:, None], _AROUND, axis=1) - 0.5 * THICKNESS,
        ],
        axis=-1,
    )
    under = rings * [1.0, 1.0, 0.0] - [0.0, 0.0, 0.5 * THICKNESS]

    n = _AROUND * _RINGS
    vertices = np.vstack(
        [
            rings.reshape(-1, 3),
            under.reshape(-1, 3),
            [[0, 0, 0.5 * THICKNESS], [0, 0, -0.5 * THICKNESS]],
        ]
    )

    # Upper side, lower side below, and the rim between them.
    i = np.arange(_AROUND)
    j = (i + 1) % _AROUND
    top = [np.column_stack([np.full_like(i, 2 * n), i, j])]
    for k in range(_RINGS - 1):
        inner = k * _AROUND
        outer = (k + 1) * _AROUND
        top += [
            np.column_stack([inner + i, outer + i, outer + j]),
            np.column_stack([inner + i, outer + j, inner + j]),
        ]

    upper = np.vstack(top)
    lower = np.where(upper == 2 * n, 2 * n + 1, upper + n)[:, ::-1]
    last = n - _AROUND
    rim = [
        np.column_stack([n + last + i, n + last + j, last + j]),
        np.column_stack([n + last + i, last + j, last + i]),
    ]
    triangles = np.vstack([upper, lower, *rim])

    return TargetModel(
        name="starfish",
        vertices=vertices,
        triangles=triangles,
        symmetry=Symmetry(
            rotations=np.stack([exp_so3([0.0, 0.0, 2.0 * np.pi * k / ARMS]) for k in range(ARMS)])
        ),
        paths={"arm": arm(), "ring": ring()},
        grasps=grasps(),
    )
