"""Calibration rig: a pin with a ball at its end in place of the tool, and nests of three balls.

A ball on three balls rests in one position only, however the pin is tilted. The centre of the pin's
ball then coincides with the nest's point. The contact is frictionless, so the ball always slides to
this position.
"""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.naming import HULL_BODY, TIP_SITE, TOOL_GEOM
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, quat_wxyz_from_rotation, rotation_from_z

BALL = 0.017  # [m] radius of the pin's ball
SEAT = 0.040  # [m] radius of each of a nest's balls
# The three contact normals are orthogonal, so all directions are held equally. A ball is caught
# from 23 mm aside, the middle between two of the three balls, which just clear each other.
_SPREAD = (BALL + SEAT) * np.sqrt(2.0 / 3.0)  # [m] of a nest's balls from its axis
_DEPTH = (BALL + SEAT) * np.sqrt(1.0 / 3.0)  # [m] of a nest's balls below its point


def add_pin(spec: mujoco.MjSpec) -> None:
    """Replace the tool by a ball centred at the tip site; no other geom of the last link collides.

    Raises:
        ConfigurationError: the vehicle has no tip site.
    """
    site = next((site for site in spec.sites if site.name == TIP_SITE), None)
    if site is None:
        raise ConfigurationError(f"the vehicle has no site {TIP_SITE!r}")

    link = site.parent
    for body in (link, *link.bodies):
        for geom in body.geoms:
            geom.contype = geom.conaffinity = 0
            if geom.name == TOOL_GEOM:
                geom.name = f"{TOOL_GEOM}_idle"

    link.add_geom(
        name=TOOL_GEOM,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[BALL, 0, 0],
        pos=site.pos,
        mass=0.0,
        condim=1,
        priority=2,
        contype=1,
        conaffinity=2,
        rgba=[0.8, 0.8, 0.85, 1.0],
    )


def add_nests(spec: mujoco.MjSpec, p_WN: ArrayLike, z_WN: ArrayLike) -> None:
    """Fix nests of three balls to the world.

    Args:
        spec: scene.
        p_WN: (k, 3) [m] points of the nests in W.
        z_WN: (k, 3) directions in which they are open, in W.
    """
    points = np.asarray(p_WN, dtype=np.float64)
    points = checked(points, (len(points), 3), "p_WN")
    axes = checked(z_WN, (len(points), 3), "z_WN")

    for k, (p, z) in enumerate(zip(points, axes, strict=True)):
        R = rotation_from_z(z, np.eye(3)[int(np.argmin(np.abs(z)))])
        body = spec.worldbody.add_body(name=f"nest{k}", pos=p, quat=quat_wxyz_from_rotation(R))
        for turn in 2.0 * np.pi / 3.0 * np.arange(3):
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[SEAT, 0, 0],
                condim=1,
                rgba=[0.6, 0.45, 0.2, 1.0],
                pos=[_SPREAD * np.cos(turn), _SPREAD * np.sin(turn), -_DEPTH],
            )


def clamp(spec: mujoco.MjSpec, X_WB: Array) -> None:
    """Weld the hull to the world at `X_WB` (4, 4)."""
    weld = spec.add_equality(
        name="clamp", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY
    )
    weld.name1 = "world"
    weld.name2 = HULL_BODY

    weld.solref = [2.0 * spec.option.timestep, 1.0]
    weld.data[:] = 0.0
    weld.data[3:6] = X_WB[:3, 3]  # pose of the hull in the world
    weld.data[6:10] = quat_wxyz_from_rotation(X_WB[:3, :3])
    weld.data[10] = 1.0
