"""Barrel lying on a stand, after [Konoplin 2022], with the tool paths on it."""

import numpy as np

from uuv.models.meshes.closed_shells import joined, revolve
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import (
    PATH_STEP,
    SHARPEST_CORNER,
    ModelPath,
    Symmetry,
    TargetModel,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    finite_number,
    pose,
    rotation_from_z,
    transform_points,
)

BARREL_DIAMETER = 0.6  # [m] of the shell; chosen for this project
BARREL_LENGTH = 0.9  # [m] chosen for this project
RIM_WIDTH = 0.03  # [m], along the axis, at each end
# [m] from a rim to the end of an axial path: half a pad plus the error of identification
RIM_MARGIN = 0.05
RIM_HEIGHT = 0.01  # [m], above the shell
BUNG = (0.035, 0.025, 0.15)  # [m] radius, height above the shell, and x_T of a bung
# number of sides in the mesh; their sagitta of 0.02 mm is negligible for a camera; contact uses an
# exact cylinder
BARREL_SIDES = 256


def longitudinal(length: float = 0.6, azimuth: float = 0.0) -> ModelPath:
    """Straight path of `length` [m] along a generator of the barrel, from -x_T to +x_T.

    `azimuth` [rad] turns it about x_T from the top generator (+z_T).

    Raises:
        ConfigurationError: the path meets a rim.
    """
    limit = BARREL_LENGTH - 2.0 * (RIM_WIDTH + RIM_MARGIN)
    if not 0.0 < length < limit:
        raise ConfigurationError(
            f"longitudinal path: length must lie between 0 and {limit:.2f} m, got {length}"
        )

    x = np.linspace(-0.5 * length, 0.5 * length, max(4, 1 + round(length / PATH_STEP)))
    outward = np.array([0.0, -np.sin(azimuth), np.cos(azimuth)])
    ones = np.ones((len(x), 1))

    return ModelPath(
        p=np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
        + 0.5 * BARREL_DIAMETER * outward,
        a=-ones * outward,
        b=ones * [1.0, 0.0, 0.0],
    )


def transverse(arc: float = np.pi, azimuth: float = 0.0, x: float = 0.0) -> ModelPath:
    """Circular path around the barrel in a plane across its axis, right-handed about x_T.

    Args:
        arc: [rad] angle of the path.
        azimuth: [rad] of the middle of the path, from the top (+z_T).
        x: [m] position of the plane along x_T.

    Returns:
        The path in T.

    Raises:
        ConfigurationError: an arc outside (0, pi], or a plane on or beyond a rim.
    """
    if not 0.0 < arc <= np.pi + 1e-9:
        raise ConfigurationError(f"transverse path: arc must lie in (0, pi] rad, got {arc}")
    limit = 0.5 * BARREL_LENGTH - RIM_WIDTH
    if not abs(x) < limit:
        raise ConfigurationError(
            f"transverse path: |x| must be below {limit:.2f} m (the rims), got {x}"
        )

    radius = 0.5 * BARREL_DIAMETER
    angle = azimuth + np.linspace(
        -0.5 * arc, 0.5 * arc, max(4, 1 + round(radius * arc / PATH_STEP))
    )
    zero = np.zeros_like(angle)
    outward = np.column_stack([zero, -np.sin(angle), np.cos(angle)])

    return ModelPath(
        p=radius * outward + [x, 0.0, 0.0],
        a=-outward,
        b=np.column_stack([zero, -np.cos(angle), -np.sin(angle)]),
    )


def around_corner(corner: float = 0.5 * np.pi, length: float = 0.2) -> ModelPath:
    """Path along the top generator for `length` [m] and then, after a turn by `corner`, on around
    the shell.

    Both parts are straight on the unrolled shell, and have the same length.

    Raises:
        ConfigurationError: the corner is beyond 150 degrees in either direction, or the path meets
            a rim.
    """
    finite_number(corner, "barrel corner [rad]", least=-SHARPEST_CORNER, most=SHARPEST_CORNER)
    limit = 0.5 * BARREL_LENGTH - RIM_WIDTH - RIM_MARGIN
    if not 0.0 < length <= limit:
        raise ConfigurationError(
            f"corner path: length must lie between 0 and {limit:.2f} m, got {length}"
        )

    # Path length along the axis and around the shell, on the unrolled shell.
    s = np.linspace(-length, length, 2 * max(4, round(length / PATH_STEP)) + 1)
    ahead = np.minimum(s, 0.0) + np.maximum(s, 0.0) * np.cos(corner)
    around = np.maximum(s, 0.0) * np.sin(corner)

    radius = 0.5 * BARREL_DIAMETER
    zero = np.zeros_like(s)
    angle = -around / radius
    outward = np.column_stack([zero, -np.sin(angle), np.cos(angle)])
    onward = np.column_stack([zero, np.cos(angle), np.sin(angle)])
    turned = np.where(s > 0.0, corner, 0.0)[:, None]

    return ModelPath(
        p=radius * outward + ahead[:, None] * [1.0, 0.0, 0.0],
        a=-outward,
        b=np.cos(turned) * [1.0, 0.0, 0.0] + np.sin(turned) * onward,
    )


def barrel(
    line_length: float = 0.6,
    line_azimuth: float = 0.0,
    arc: float = np.pi,
    arc_azimuth: float = 0.0,
    stand_height: float = 0.45,
    bung_azimuth: float | None = None,
    corner: float = 0.5 * np.pi,
) -> TargetModel:
    """Barrel as a target, after [Konoplin 2022, fig. 3]: 0.6 m in diameter, 0.9 m long, with rims.

    The sizes are chosen for this project. x_T is the axis and the origin the centre. The paths are
    "longitudinal", "transverse" and "corner". The declared symmetry is that of the shell and rims;
    a bung does not change it.

    Args:
        line_length: [m] of the longitudinal path.
        line_azimuth: [rad] of the longitudinal path.
        arc: [rad] of the transverse path.
        arc_azimuth: [rad] of the middle of the transverse path.
        stand_height: [m] from the axis down (-z_T) to the stand's feet.
        bung_azimuth: [rad] about x_T from the top (+z_T) of a bung in the shell; None: no bung.
        corner: [rad] by which the path "corner" turns.

    Returns:
        The target with stand.

    Raises:
        ConfigurationError: a path off the shell, or a stand inside it.
    """
    r = 0.5 * BARREL_DIAMETER
    h = 0.5 * BARREL_LENGTH
    rim = r + RIM_HEIGHT
    profile = [(-h, 0.0), (-h, rim), (RIM_WIDTH - h, rim), (RIM_WIDTH - h, r)]
    profile += [(-x, radius) for x, radius in reversed(profile)]
    vertices, triangles = revolve(np.array(profile), BARREL_SIDES)

    # MuJoCo's cylinders have their axis along z
    R_axis = rotation_from_z([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    x_rim = h - 0.5 * RIM_WIDTH
    size = (rim, 0.5 * RIM_WIDTH)
    solids = (
        Solid(name="target", kind="cylinder", size=(r, h), X_TS=pose(R_axis)),
        Solid(name="target_rim_aft", kind="cylinder", size=size, X_TS=pose(R_axis, [-x_rim, 0, 0])),
        Solid(name="target_rim_fore", kind="cylinder", size=size, X_TS=pose(R_axis, [x_rim, 0, 0])),
    )

    if bung_azimuth is not None:
        disc, solid = _bung(bung_azimuth, r)
        vertices, triangles = joined([(vertices, triangles), disc])
        solids += (solid,)

    return TargetModel(
        name="barrel",
        vertices=vertices,
        triangles=triangles,
        symmetry=Symmetry(
            axis=np.array([1.0, 0.0, 0.0]),
            rotations=np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])]),
        ),
        paths={
            "longitudinal": longitudinal(line_length, line_azimuth),
            "transverse": transverse(arc, arc_azimuth),
            "corner": around_corner(corner),
        },
        solids=solids,
        stand=_stand(r, stand_height),
    )


def _bung(azimuth: float, r: float) -> tuple[tuple[Array, np.ndarray], Solid]:
    """Mesh and solid, both in T, of a bung in the shell of radius `r` [m] at `azimuth` [rad]."""
    radius, height, x = BUNG
    # z out of the shell, origin on it
    X_bung = pose(exp_so3([azimuth, 0.0, 0.0])) @ pose(p=[x, 0.0, r])
    inside = -0.5 * RIM_HEIGHT
    disc, faces = revolve(
        np.array([(inside, 0.0), (inside, radius), (height, radius), (height, 0.0)]), 64
    )

    half = 0.5 * (height - inside)
    X_TS = X_bung @ pose(p=[0.0, 0.0, half + inside])
    solid = Solid(name="target_bung", kind="cylinder", size=(radius, half), X_TS=X_TS)
    return (transform_points(X_bung, disc[:, [1, 2, 0]]), faces), solid


def _stand(r: float, height: float) -> tuple[Solid, ...]:
    """Two beams under the shell of radius `r` [m], with their feet `height` [m] below the barrel's
    axis.
    """
    half_width = 0.18
    top = np.sqrt(r**2 - half_width**2)  # the beam's upper edges just touch the shell
    if not height > r + RIM_HEIGHT:
        raise ConfigurationError(
            f"barrel: stand_height must exceed {r + RIM_HEIGHT} m, got {height}"
        )

    beam = (0.03, half_width, 0.5 * (height - top))
    return tuple(
        Solid(
            name=f"target_stand_{end}",
            kind="box",
            size=beam,
            X_TS=pose(p=[x, 0.0, -0.5 * (height + top)]),
        )
        for end, x in (("aft", -0.28), ("fore", 0.28))
    )
