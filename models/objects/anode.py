"""Stand-off anode as welded to jackets: a cast bar of trapezoidal section on a steel pipe.

The pipe has two legs. The sizes are chosen for this project, at the small end of anodes that are
cast (0.8 m, about 40 kg of aluminium).
"""

import numpy as np

from uuv.models.meshes.closed_shells import joined, prism, revolve
from uuv.models.objects.grasps import Grasp
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import PATH_STEP, ModelPath, Symmetry, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, rotation_from_z

LENGTH = 0.8  # [m] of the bar, along x_T
TOP = 0.12  # [m] width (y_T) of the section's upper side
BOTTOM = 0.16  # [m] width of the section's lower side
HEIGHT = 0.12  # [m] height (z_T) of the section
PIPE = (0.024, 1.06)  # [m] radius and length of the pipe
LEG = 0.26  # [m] distance by which the legs extend below the bar's middle
LEG_X = 0.48  # [m] from the middle to a leg's axis
_SIDES = 64  # number of sides of the pipe and legs in the mesh
SMALL = (0.25, 0.05, 0.06, 0.05)  # [m] length, width above and below, height of a small anode


def top(length: float = 0.5) -> ModelPath:
    """Line of `length` [m] along the middle of the upper face, towards +x_T."""
    return _line("top", length, np.array([0.0, 0.0, 0.5 * HEIGHT]), np.array([0.0, 0.0, 1.0]))


def side(length: float = 0.5) -> ModelPath:
    """Line of `length` [m] along the middle of the slanting face on the +y_T side, towards +x_T."""
    normal = np.array([0.0, HEIGHT, 0.5 * (BOTTOM - TOP)])
    return _line(
        "side", length, np.array([0.0, 0.25 * (TOP + BOTTOM), 0.0]), normal / np.linalg.norm(normal)
    )


def _line(name: str, length: float, middle: Array, normal: Array) -> ModelPath:
    if not 0.0 < length <= LENGTH - 0.1:
        raise ConfigurationError(
            f"{name} path: length must lie between 0 and {LENGTH - 0.1:.2f} m, got {length}"
        )

    x = np.linspace(-0.5 * length, 0.5 * length, max(4, 1 + round(length / PATH_STEP)))
    ones = np.ones((len(x), 1))

    return ModelPath(
        p=middle + x[:, None] * [1.0, 0.0, 0.0], a=-ones * normal, b=ones * [1.0, 0.0, 0.0]
    )


def small_anode() -> TargetModel:
    """Block anode of 0.25 m for a gripper: x_T along it, z_T out of its narrow face, 1.9 kg.

    Grasp "across", in its middle. Symmetric under half a turn about z_T.
    """
    length, top_width, low_width, height = SMALL
    x = 0.5 * length

    def face(width: float, z: float) -> Array:
        y = 0.5 * width
        return np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])

    low = face(low_width, -0.5 * height)
    high = face(top_width, 0.5 * height)
    vertices, triangles = prism(low, high)
    across = Grasp(
        p=np.zeros(3),
        x=np.array([0.0, 1.0, 0.0]),
        width=0.5 * (top_width + low_width),
        slope=0.5 * (low_width - top_width) / height,
    )
    return TargetModel(
        name="small_anode",
        vertices=vertices,
        triangles=triangles,
        symmetry=Symmetry(rotations=np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])])),
        grasps={"across": across},
        hulls=(np.vstack([low, high]),),
    )


def anode() -> TargetModel:
    """Anode as a target: x_T along the bar, z_T out of the bar's narrow face, origin in the bar's
    middle.

    Bar, core and legs are closed shells that intersect. The paths are "top" and "side". The shape
    is symmetric under half a turn about z_T.
    """
    x = 0.5 * LENGTH

    def face(width: float, z: float) -> Array:
        return np.array(
            [[-x, -0.5 * width, z], [x, -0.5 * width, z], [x, 0.5 * width, z], [-x, 0.5 * width, z]]
        )

    low = face(BOTTOM, -0.5 * HEIGHT)
    high = face(TOP, 0.5 * HEIGHT)

    # Pipe and legs are revolved about x; the axis of a leg is then turned to z.
    r = PIPE[0]
    half = 0.5 * PIPE[1]
    pipe = revolve(np.array([(-half, 0.0), (-half, r), (half, r), (half, 0.0)]), _SIDES)
    upright, faces = revolve(np.array([(-LEG, 0.0), (-LEG, r), (0.0, r), (0.0, 0.0)]), _SIDES)
    legs = [(upright[:, [1, 2, 0]] + [s * LEG_X, 0.0, 0.0], faces) for s in (-1.0, 1.0)]

    vertices, triangles = joined([prism(low, high), pipe, *legs])
    R_pipe = rotation_from_z([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])

    return TargetModel(
        name="anode",
        vertices=vertices,
        triangles=triangles,
        symmetry=Symmetry(rotations=np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])])),
        paths={"top": top(), "side": side()},
        solids=(
            Solid(name="target_core", kind="cylinder", size=(r, half), X_TS=pose(R_pipe)),
            *(
                Solid(
                    name=f"target_leg_{end}",
                    kind="cylinder",
                    size=(r, 0.5 * LEG),
                    X_TS=pose(p=[s * LEG_X, 0.0, -0.5 * LEG]),
                )
                for end, s in (("aft", -1.0), ("fore", 1.0))
            ),
        ),
        hulls=(np.vstack([low, high]),),
    )
