"""A hull whose file has another axis up, NED for instance: turned, with all that it carries."""

from dataclasses import replace
from typing import Final

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics, moved_added_mass
from uuv.models.naming import HULL_BODY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, quat_wxyz_from_rotation, readonly

# Axis of the file that points up, x ahead: the file's axes in ours.
UP: Final[dict[str, Array]] = {
    "z": readonly(np.eye(3)),
    "-z": readonly(np.diag([1.0, -1.0, -1.0])),
    "y": readonly([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": readonly([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}


def turn_hull(spec: mujoco.MjSpec, up: str, name: str) -> None:
    """Turn what the hull has and carries, in place, so that its z is up and x stays ahead.

    Args:
        spec: model with a body `hull`.
        up: axis of the file, of `UP`.
        name: with which errors begin.

    Raises:
        ConfigurationError: parts that state their orientation otherwise than as a quaternion, or
            water with terms that are not turned.
    """
    R = UP[up]
    hull = spec.body(HULL_BODY)
    if hull.frames:
        raise ConfigurationError(f"{name}: up: a hull with <frame> is not turned; write it without")
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
    """Coefficients in axes that are turned by quarters against those they are stated in.

    Args:
        water: in the file's axes.
        R: (3, 3) the file's axes in ours.
        name: with which errors begin.

    Raises:
        ConfigurationError: they have further forms.
    """
    if water.forms:
        raise ConfigurationError(
            f"{name}: `forms` of the hull's water are not turned; state them in the turned axes"
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
    """Turn the place of a part in the hull."""
    if part.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
        raise ConfigurationError(f"{name}: up: {part.name!r} must have its orientation as a `quat`")
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
