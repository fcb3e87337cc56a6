"""What a file leaves out of the inertia of its links and joints: masses, and those of rotors."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from uuv.models.water.bounds import SEA_WATER
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean

JERKY = 30.0  # [rad/s] that a joint may gain at full torque in one time step
START_UP = 2e-3  # [s] in which full torque brings a rotor alone to a joint's speed: a prior
_SPEED = 1.0  # [rad/s] or [m/s] of a joint whose file states none


def give_masses(spec: mujoco.MjSpec, masses: Mapping[str, float], name: str) -> list[str]:
    """Give bodies the masses that a mapping states, in place.

    The inertia is that of the body's shapes at that mass, of a body without any that of a sphere of
    water.

    Args:
        spec: model under the names of its file.
        masses: [kg] by body.
        name: with which errors begin.

    Returns:
        A line about them.

    Raises:
        ConfigurationError: there is no such body.
    """
    bodies = {body.name: body for body in spec.bodies if body.name != "world"}
    for wanted, mass in masses.items():
        if wanted not in bodies:
            raise ConfigurationError(
                f"{name}: masses: the model has no body {wanted!r}{did_you_mean(wanted, bodies)}"
            )
        body = bodies[wanted]
        shapes = [geom for geom in body.geoms if geom.density or np.isfinite(geom.mass)]
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
    return [f"masses of the mapping, inertia of the shapes or of a sphere of water: {stated}"]


def _weight(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> float:
    """Mass [kg] of the shapes of a body, alone on the world."""
    alone = spec.copy()
    for part in [*alone.keys, *alone.equalities, *alone.actuators, *alone.sensors, *alone.excludes]:
        alone.delete(part)
    for joint in list(alone.joints):
        alone.delete(joint)
    return float(alone.compile().body(body.name).mass[0])


def give_armature(
    spec: mujoco.MjSpec,
    joints: Sequence[str],
    stated: float | Mapping[str, float] | None,
    speeds: Mapping[str, float],
) -> list[str]:
    """Give joints the inertia of their rotors, in place: as stated, or a prior for light ones.

    A joint is light if full torque makes it fast within one time step, which no drive does: its
    file states no rotor. The prior is the rotor that full torque brings to the joint's speed in
    2 ms.

    Args:
        spec: model whose joints have motors.
        joints: names, base to tip.
        stated: [kg m^2] or [kg] of all or of each; None: the prior.
        speeds: [rad/s] or [m/s] rated, by joint.

    Returns:
        A line about what was added.
    """
    given = stated if isinstance(stated, Mapping) else dict.fromkeys(joints, stated)
    for joint in joints:
        if (armature := given.get(joint)) is not None:
            spec.joint(joint).armature = armature
    left = [joint for joint in joints if given.get(joint) is None]
    left = [joint for joint in left if not spec.joint(joint).armature]
    if not left:
        return []

    model = spec.compile()
    added = {}
    for joint in left:
        motor = [a for a in range(model.nu) if model.actuator_trnid[a, 0] == model.joint(joint).id]
        motor = [a for a in motor if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT]
        if not motor:
            continue
        torque = float(np.abs(model.actuator_ctrlrange[motor[0]]).min())
        inertia = float(model.dof_M0[model.joint(joint).dofadr[0]])
        if torque * model.opt.timestep > JERKY * inertia:
            added[joint] = torque * START_UP / (speeds.get(joint) or _SPEED)
            spec.joint(joint).armature = added[joint]
    if not added:
        return []
    figures = ", ".join(f"{joint} {armature:.2g}" for joint, armature in added.items())
    return [
        "rotor inertia of light joints, a prior (effort for 2 ms over speed; `armature:` in the "
        f"mapping states it) [kg m^2]: {figures}"
    ]
