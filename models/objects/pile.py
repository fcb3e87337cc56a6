"""Vertical pile, such as a jetty leg, with a bolted flange, and the tool paths on it.

A plain pipe seen in part can slide along its axis undetected by registration. The flange determines
the height. It is two rings on a pipe of 600 mm, bolted together, with the proportions of EN 1092-1
type 11 and sizes chosen for this project.
"""

from collections.abc import Mapping

import numpy as np

from uuv.models.meshes.closed_shells import revolve
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import PATH_STEP, ModelPath, Symmetry, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose

PILE_DIAMETER = 0.6  # [m] chosen for this project
PILE_LENGTH = 3.0  # [m] chosen for this project
FLANGE_DIAMETER = 0.76  # [m] chosen for this project
FLANGE = (0.2, 0.3)  # [m] lower and upper face of the flange, along z_T
# [m] from flange or end to a path: half a pad plus the error of identification
FLANGE_MARGIN = 0.08
SIDES = 256  # number of sides of the pile in the mesh; their sagitta is 0.02 mm


def vertical(length: float = 0.5, azimuth: float = 0.0, height: float = -0.15) -> ModelPath:
    """Straight path up the pile.

    Args:
        length: [m].
        azimuth: [rad] about z_T, from x_T.
        height: [m] of its middle, along z_T.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: the path meets the flange or an end.
    """
    if not (np.isfinite(length) and length > 0.0):
        raise ConfigurationError(f"vertical path: length must be > 0 m, got {length}")

    rise = np.linspace(-0.5 * length, 0.5 * length, max(4, 1 + round(length / PATH_STEP)))
    return _on_shell("vertical", height + rise, np.full_like(rise, azimuth), climb=1.0)


def ring(arc: float = 2.0 * np.pi / 3.0, azimuth: float = 0.0, height: float = -0.15) -> ModelPath:
    """Circular path around the pile, right-handed about z_T.

    Args:
        arc: [rad] angle of the path.
        azimuth: [rad] of its middle, about z_T from x_T.
        height: [m] along z_T.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: an arc outside (0, 2 pi], or a path at the flange or an end.
    """
    if not 0.0 < arc <= 2.0 * np.pi + 1e-9:
        raise ConfigurationError(f"ring path: arc must lie in (0, 2 pi] rad, got {arc}")

    turn = np.linspace(
        -0.5 * arc, 0.5 * arc, max(4, 1 + round(0.5 * PILE_DIAMETER * arc / PATH_STEP))
    )
    return _on_shell("ring", np.full_like(turn, height), azimuth + turn, climb=0.0)


def helix(
    arc: float = 2.0 * np.pi / 3.0, rise: float = 0.3, azimuth: float = 0.0, height: float = -0.15
) -> ModelPath:
    """Helical path around the pile, right-handed about z_T.

    Args:
        arc: [rad] angle of the path.
        rise: [m] from start to end; negative goes down.
        azimuth: [rad] of its middle, about z_T from x_T.
        height: [m] of its middle, along z_T.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: an arc that is not positive and finite, or a path that meets the flange
            or an end.
    """
    if not (np.isfinite(arc) and arc > 0.0):
        raise ConfigurationError(f"helix path: arc must be > 0 rad, got {arc}")

    around = 0.5 * PILE_DIAMETER * arc
    length = float(np.hypot(around, rise))
    share = np.linspace(-0.5, 0.5, max(4, 1 + round(length / PATH_STEP)))
    return _on_shell("helix", height + share * rise, azimuth + share * arc, climb=rise / length)


def _on_shell(name: str, height: Array, azimuth: Array, climb: float) -> ModelPath:
    """Path through `height` (N,) [m] and `azimuth` (N,) [rad]; `climb` is the sine of the path's
    slope.
    """
    low = float(np.min(height))
    high = float(np.max(height))
    end = 0.5 * PILE_LENGTH - FLANGE_MARGIN
    under = FLANGE[0] - FLANGE_MARGIN
    over = FLANGE[1] + FLANGE_MARGIN
    if not ((-end <= low and high <= under) or (over <= low and high <= end)):
        raise ConfigurationError(
            f"{name} path: the whole path must be in one of the height ranges [{-end:.2f}, "
            f"{under:.2f}] and [{over:.2f}, {end:.2f}] m, clear of the flange and the ends; got "
            f"{low:.3g} to {high:.3g} m"
        )

    zero = np.zeros_like(azimuth)
    outward = np.column_stack([np.cos(azimuth), np.sin(azimuth), zero])
    around = np.column_stack([-np.sin(azimuth), np.cos(azimuth), zero])
    return ModelPath(
        p=0.5 * PILE_DIAMETER * outward + height[:, None] * [0.0, 0.0, 1.0],
        a=-outward,
        b=np.sqrt(1.0 - climb**2) * around + climb * np.array([0.0, 0.0, 1.0]),
    )


def pile(paths: Mapping[str, ModelPath] | None = None, flange: bool = True) -> TargetModel:
    """Pile as a target, 0.6 m in diameter, 3 m long; z_T is its axis, up, the origin its middle.

    Args:
        paths: tool paths by name; by default "vertical", "ring" and "helix" with their defaults.
        flange: False: no flange, so that no feature determines the height while the ends are out of
            view.

    Returns:
        The target.
    """
    r = 0.5 * PILE_DIAMETER
    h = 0.5 * PILE_LENGTH
    R = 0.5 * FLANGE_DIAMETER
    collar = [(FLANGE[0], r), (FLANGE[0], R), (FLANGE[1], R), (FLANGE[1], r)] if flange else []
    vertices, triangles = revolve(np.array([(-h, 0.0), (-h, r), *collar, (h, r), (h, 0.0)]), SIDES)

    solids = [Solid(name="target", kind="cylinder", size=(r, h), X_TS=pose())]
    if flange:
        half = 0.5 * (FLANGE[1] - FLANGE[0])
        solids.append(
            Solid(
                name="target_flange",
                kind="cylinder",
                size=(R, half),
                X_TS=pose(p=[0.0, 0.0, FLANGE[0] + half]),
            )
        )

    return TargetModel(
        name="pile",
        vertices=vertices[:, [1, 2, 0]],  # axis along z instead of x
        triangles=triangles,
        symmetry=Symmetry(axis=np.array([0.0, 0.0, 1.0])),
        paths={"vertical": vertical(), "ring": ring(), "helix": helix()}
        if paths is None
        else paths,
        solids=tuple(solids),
    )
