"""Turn a hull, with all it carries, if an axis of its file other than z points up, as in NED."""

from dataclasses import replace
from typing import Final

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics, moved_added_mass
from uuv.models.naming import HULL_BODY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, quat_wxyz_from_rotation, readonly

# Axis of the file that points up, with x ahead: the file's axes in hull axes.
UP: Final[dict[str, Array]] = {
    "z": readonly(np.eye(3)),
    "-z": readonly(np.diag([1.0, -1.0, -1.0])),
    "y": readonly([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": readonly([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}


def turn_hull(spec: mujoco.MjSpec, up: str, name: str) -> None:
    """Turn all parts of the hull, in place, so that z of the hull is up and x stays ahead.

    Args:
        spec: model with a body `hull`.
        up: axis of the file that points up, a key of `UP`.
        name: first words of error messages.

    Raises:
        ConfigurationError: a part states its orientation in another form than a quaternion, or the
            hydrodynamic data have terms that cannot be turned.
    """
    R = UP[up]
    hull = spec.body(HULL_BODY)
    if hull.frames:
        raise ConfigurationError(
            f"{name}: up: the hull has a <frame> and cannot be turned; write the hull without "
            "<frame>"
        )
    for part in (*hull.bodies, *hull.geoms, *hull.sites, *hull.cameras):
        _turn(part, R, name)

    for light in hull.lights:
        light.pos = R @ np.array(light.pos)
        light.dir = R @ np.array(light.dir)

    if hull.explicitinertial:
        hull.ipos = R @ np.array(hull.ipos)
        if np.isfinite(hull.fullinertia[0]):
            xx, yy, zz, xy, xz, yz = hull.fullinertia
            tensor = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
            hull.fullinertia = tensor[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        else:
            hull.iquat = quat_wxyz_from_rotation(R @ _rotation(hull.iquat))

    water = hydrodynamics.attached(spec).get(HULL_BODY)
    if water is not None:
        hydrodynamics.attach(spec, {HULL_BODY: turned_water(water, R, f"{name}: up")})


def turned_water(water: BodyHydrodynamics, R: Array, name: str) -> BodyHydrodynamics:
    """Coefficients in axes that are turned by multiples of 90 deg from the file's axes.

    Args:
        water: coefficients in the file's axes.
        R: (3, 3) the file's axes in hull axes.
        name: first words of error messages.

    Raises:
        ConfigurationError: the coefficients have further `forms`.
    """
    if water.forms:
        raise ConfigurationError(
            f"{name}: `forms` of the hull's water cannot be turned; state them in the turned axes"
        )

    turn = np.kron(np.eye(2), R)
    strips = tuple(replace(part, start=R @ part.start, end=R @ part.end) for part in water.segments)

    return replace(
        water,
        center_of_buoyancy=R @ water.center_of_buoyancy,
        added_mass=moved_added_mass(water.added_mass, R, np.zeros(3)),
        linear_damping=turn @ water.linear_damping @ turn.T,
        quadratic_damping=np.abs(turn) @ water.quadratic_damping,
        strips=strips,
    )


def _turn(
    part: mujoco.MjsBody | mujoco.MjsGeom | mujoco.MjsSite | mujoco.MjsCamera, R: Array, name: str
) -> None:
    """Turn the position and orientation of a part of the hull."""
    if part.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
        raise ConfigurationError(
            f"{name}: up: {part.name!r} must state its orientation as a `quat`"
        )
    fromto = np.array(getattr(part, "fromto", [np.nan] * 6))

    if np.isfinite(fromto[0]):
        part.fromto = np.kron(np.eye(2), R) @ fromto
        return

    X = pose(R) @ pose(_rotation(part.quat), np.array(part.pos))
    part.pos = X[:3, 3]
    part.quat = quat_wxyz_from_rotation(X[:3, :3])


def _rotation(quat_wxyz: Array) -> Array:
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, np.array(quat_wxyz, dtype=np.float64))
    return R.reshape(3, 3)
