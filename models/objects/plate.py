"""Panel of a steel hull for tests of cleaning: a flat plate with two stiffeners and a nozzle.

The sizes are chosen for this project. The stiffeners are flat bars of 60 by 12 mm, the nozzle is a
short closed pipe.
"""

import numpy as np

from uuv.models.meshes.closed_shells import box, joined, revolve
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose

SIZE = (0.9, 0.6, 0.02)  # [m] of the plate, along x_T, y_T, z_T
BAR = (0.012, 0.06)  # [m] thickness and height of a stiffener
NOZZLE = (0.057, 0.12)  # [m] radius and height
_SIDES = 96  # number of sides of the nozzle in the mesh
# [m] size and middle of the stiffener along x_T
_LONG = ([0.9, BAR[0], BAR[1]], [0.0, 0.22, 0.5 * BAR[1]])
# [m] size and middle of the stiffener along y_T
_SHORT = ([BAR[0], 0.3, BAR[1]], [0.33, -0.1, 0.5 * BAR[1]])
_NOZZLE_AT = (-0.34, -0.19)  # [m] position of the nozzle's axis
# [m] clearance of a path from parts on the plate: radius of the pad and room for the tool
_MARGIN = 0.11


def middle(length: float = 0.4) -> ModelPath:
    """Line of `length` [m] over the plate's free middle, towards +x_T."""
    return _line("middle", length, 0.54, np.array([-0.03, 0.05]), np.array([1.0, 0.0]))


def along_bar(length: float = 0.4) -> ModelPath:
    """Line of `length` [m] beside the long stiffener, towards +x_T."""
    return _line("along_bar", length, 0.7, np.array([0.0, 0.22 - _MARGIN]), np.array([1.0, 0.0]))


def across(length: float = 0.3) -> ModelPath:
    """Line of `length` [m] across the plate's free middle, towards +y_T."""
    return _line("across", length, 0.32, np.array([0.0, -0.06]), np.array([0.0, 1.0]))


def _line(name: str, length: float, longest: float, through: Array, along: Array) -> ModelPath:
    if not 0.0 < length <= longest:
        raise ConfigurationError(
            f"{name} path: length must lie between 0 and {longest:g} m, got {length}"
        )

    s = np.linspace(-0.5 * length, 0.5 * length, max(4, 1 + round(length / PATH_STEP)))
    ones = np.ones((len(s), 1))
    p = np.column_stack([through + s[:, None] * along, np.zeros(len(s))])
    return ModelPath(p=p, a=-ones * [0.0, 0.0, 1.0], b=ones * [*along, 0.0])


def plate() -> TargetModel:
    """Plate as a target: z_T out of its stiffened side, x_T along the long bar.

    The origin is in the middle of that side. Plate, bars and nozzle are closed shells that
    intersect. The paths are "middle", "along_bar" and "across". The short bar and the nozzle remove
    every symmetry.
    """
    radius, height = NOZZLE
    tube, faces = revolve(
        np.array([(-0.01, 0.0), (-0.01, radius), (height, radius), (height, 0.0)]), _SIDES
    )
    nozzle = tube[:, [1, 2, 0]] + [*_NOZZLE_AT, 0.0]

    sheet = (list(SIZE), [0.0, 0.0, -0.5 * SIZE[2]])
    vertices, triangles = joined(
        [*(box(size, at) for size, at in (sheet, _LONG, _SHORT)), (nozzle, faces)]
    )

    return TargetModel(
        name="plate",
        vertices=vertices,
        triangles=triangles,
        paths={"middle": middle(), "along_bar": along_bar(), "across": across()},
        solids=(
            *(
                Solid(name=name, kind="box", size=tuple(0.5 * np.array(size)), X_TS=pose(p=at))
                for name, (size, at) in (
                    ("target", sheet),
                    ("target_long_bar", _LONG),
                    ("target_short_bar", _SHORT),
                )
            ),
            Solid(
                name="target_nozzle",
                kind="cylinder",
                size=(radius, 0.5 * (height + 0.01)),
                X_TS=pose(p=[*_NOZZLE_AT, 0.5 * (height - 0.01)]),
            ),
        ),
    )
