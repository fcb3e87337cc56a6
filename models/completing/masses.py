"""Masses that a mapping states because the vehicle's file leaves them out."""

from collections.abc import Mapping

import mujoco
import numpy as np

from uuv.models.water.bounds import SEA_WATER
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean


def give_masses(spec: mujoco.MjSpec, masses: Mapping[str, float], name: str) -> list[str]:
    """Give bodies the masses that a mapping states, in place.

    The inertia is that of the body's shapes scaled to that mass; for a body without shapes it is
    that of a sphere of water.

    Args:
        spec: model under the names of its file.
        masses: [kg] by body.
        name: first words of error messages.

    Returns:
        A line about the masses.

    Raises:
        ConfigurationError: there is no such body.
    """
    bodies = {body.name: body for body in spec.bodies if body.name != "world"}

    for name_of, mass in masses.items():
        if name_of not in bodies:
            raise ConfigurationError(
                f"{name}: masses: the model has no body {name_of!r}{did_you_mean(name_of, bodies)}"
            )

        body = bodies[name_of]
        shapes = [geom for geom in body.geoms if _weighs(geom)]
        body.explicitinertial = not shapes
        weight = _weight(spec, body) if shapes else 0.0

        for geom in shapes:
            if np.isfinite(geom.mass):
                geom.mass *= mass / weight
            else:
                geom.density *= mass / weight

        if shapes:
            continue

        radius = np.cbrt(0.75 * mass / (np.pi * SEA_WATER))
        body.mass = mass
        body.ipos = np.zeros(3)
        body.inertia = np.full(3, 0.4 * mass * radius**2)
        body.fullinertia = np.full(6, np.nan)

    stated = ", ".join(f"{body} {mass:g} kg" for body, mass in masses.items())

    return [
        "masses stated in the mapping, with the inertia of the shapes or of a sphere of water: "
        f"{stated}"
    ]


def _weighs(geom: mujoco.MjsGeom) -> bool:
    """True if a shape has a mass: the stated one or, without it, that of its density."""
    return (geom.mass if np.isfinite(geom.mass) else geom.density) > 0.0


def _weight(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> float:
    """Mass [kg] of the shapes of a body, computed with that body alone on the world."""
    alone = spec.copy()
    for part in [*alone.keys, *alone.equalities, *alone.actuators, *alone.sensors, *alone.excludes]:
        alone.delete(part)
    for joint in list(alone.joints):
        alone.delete(joint)

    return float(alone.compile().body(body.name).mass[0])
