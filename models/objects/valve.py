"""Quarter-turn valve with its handle: a pipe with two flanges, a bonnet, a stem and a lever.

The sizes are chosen for this project, similar to a DN100 ball valve. The lever extends to one side,
so the shape has no symmetry.
"""

import numpy as np

from uuv.models.meshes.closed_shells import box, joined, revolve
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import pose, rotation_from_z

PIPE = (0.06, 0.44)  # [m] radius and length, along x_T
FLANGE = (0.11, 0.025)  # [m] radius and thickness; one at each end of the pipe
BONNET = (0.045, 0.13)  # [m] radius, and height of the bonnet's top over the pipe's axis
STEM = (0.014, 0.17)  # [m] radius, and height of the stem's top over the pipe's axis
LEVER = (0.32, 0.036, 0.022)  # [m] length, width, thickness
LEVER_BACK = 0.035  # [m] by which the lever extends behind the stem's axis
_SIDES = 96  # number of sides of surfaces of revolution in the mesh


def handle(length: float = 0.2) -> ModelPath:
    """Path of `length` [m] on the lever's upper side, outwards to the end where the lever is
    gripped.

    Raises:
        ConfigurationError: a length beyond the lever.
    """
    if not 0.0 < length < LEVER[0] - LEVER_BACK - 0.03:
        raise ConfigurationError(
            f"handle path: length must lie between 0 and {LEVER[0] - LEVER_BACK - 0.03:.3f} m"
        )

    end = LEVER[0] - LEVER_BACK - 0.02
    y = np.linspace(end - length, end, max(4, 1 + round(length / PATH_STEP)))
    ones = np.ones((len(y), 1))
    return ModelPath(
        p=np.column_stack([np.zeros_like(y), y, np.full_like(y, STEM[1])]),
        a=-ones * [0.0, 0.0, 1.0],
        b=ones * [0.0, 1.0, 0.0],
    )


def collar(arc: float = np.pi, x: float = 0.12) -> ModelPath:
    """Circular path of `arc` [rad] around the pipe at `x` [m], right-handed, with the middle of the
    path on top.

    Raises:
        ConfigurationError: an arc outside (0, 2 pi], or a path at the bonnet or a flange.
    """
    if not (
        0.0 < arc <= 2.0 * np.pi and BONNET[0] + 0.02 <= abs(x) <= 0.5 * PIPE[1] - FLANGE[1] - 0.02
    ):
        raise ConfigurationError(
            f"collar path: arc must lie in (0, 2 pi] rad and |x| between {BONNET[0] + 0.02:.3f} "
            f"and {0.5 * PIPE[1] - FLANGE[1] - 0.02:.3f} m (bonnet and flanges), got {arc}, {x}"
        )

    angle = np.linspace(-0.5 * arc, 0.5 * arc, max(8, 1 + round(PIPE[0] * arc / PATH_STEP)))
    zero = np.zeros_like(angle)
    outward = np.column_stack([zero, -np.sin(angle), np.cos(angle)])
    return ModelPath(
        p=PIPE[0] * outward + [x, 0.0, 0.0],
        a=-outward,
        b=np.column_stack([zero, -np.cos(angle), -np.sin(angle)]),
    )


def valve() -> TargetModel:
    """Valve as a target: x_T along its pipe, z_T up the stem, y_T along the lever.

    The origin is in the middle of the pipe. The closed shells (body, bonnet with stem, lever)
    intersect. The paths are "handle" and "collar".
    """
    # The body: a pipe with a flange at each end.
    r = PIPE[0]
    half = 0.5 * PIPE[1]
    wide, thick = FLANGE
    profile = [(-half, 0.0), (-half, wide), (thick - half, wide), (thick - half, r)]
    profile += [(-x, radius) for x, radius in reversed(profile)]

    # Bonnet and stem as one body of revolution, and the lever on top.
    bonnet = [(0.0, 0.0), (0.0, BONNET[0]), (BONNET[1], BONNET[0]), (BONNET[1], STEM[0])]
    bonnet += [(STEM[1] - 0.5 * LEVER[2], STEM[0]), (STEM[1] - 0.5 * LEVER[2], 0.0)]
    along_z, faces = revolve(np.array(bonnet), _SIDES)

    middle = np.array([0.0, 0.5 * LEVER[0] - LEVER_BACK, STEM[1] - 0.5 * LEVER[2]])
    lever = np.array([LEVER[1], LEVER[0], LEVER[2]])
    vertices, triangles = joined(
        [revolve(np.array(profile), _SIDES), (along_z[:, [1, 2, 0]], faces), box(lever, middle)]
    )

    R_pipe = rotation_from_z([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    flange_x = half - 0.5 * thick

    return TargetModel(
        name="valve",
        vertices=vertices,
        triangles=triangles,
        paths={"handle": handle(), "collar": collar()},
        solids=(
            Solid(name="target", kind="cylinder", size=(r, half), X_TS=pose(R_pipe)),
            *(
                Solid(
                    name=f"target_flange_{end}",
                    kind="cylinder",
                    size=(wide, 0.5 * thick),
                    X_TS=pose(R_pipe, [x, 0.0, 0.0]),
                )
                for end, x in (("aft", -flange_x), ("fore", flange_x))
            ),
            # On top of the pipe.
            Solid(
                name="target_bonnet",
                kind="cylinder",
                size=(BONNET[0], 0.5 * BONNET[1]),
                X_TS=pose(p=[0.0, 0.0, 0.5 * BONNET[1]]),
            ),
            Solid(
                name="target_stem",
                kind="cylinder",
                size=(STEM[0], 0.5 * (STEM[1] - 0.5 * LEVER[2])),
                X_TS=pose(p=[0.0, 0.0, 0.5 * (STEM[1] - 0.5 * LEVER[2])]),
            ),
            Solid(
                name="target_lever",
                kind="box",
                size=tuple((0.5 * lever).tolist()),
                X_TS=pose(p=middle),
            ),
        ),
    )
