"""Thrusters of a mapping or a file: actuators on sites of the hull, with their tables."""

from collections.abc import Mapping

import mujoco
import numpy as np

from uuv.models.files.parts_file import MappedThruster
from uuv.models.naming import HULL_BODY
from uuv.models.water import thrusters
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, rotation_from_z

_AHEAD = (1.0, 0.0, 0.0)


def add_thruster(
    spec: mujoco.MjSpec, mapped: MappedThruster, renamed: Mapping[str | None, str], name: str
) -> None:
    """Add a thruster, or give an actuator of the model its table.

    Args:
        spec: a user's model.
        mapped: the thruster.
        renamed: names of bodies by those that they had in the file.
        name: with which errors begin.

    Raises:
        ConfigurationError: its actuator, site or body is not in the model.
    """
    actuators = {actuator.name: actuator for actuator in spec.actuators}

    # An actuator of the model.
    if mapped.actuator is not None:
        if mapped.actuator not in actuators:
            raise _missing(name, "actuator", mapped.actuator, list(actuators))
        _make_plain(actuators[mapped.actuator])
        thrusters.attach(spec, {mapped.actuator: mapped.thruster})
        return

    # A site, of the model or added.
    site = mapped.site
    if mapped.place is not None:
        site = f"thruster_{mapped.name}"
        wanted = renamed.get(mapped.place.body, mapped.place.body) or HULL_BODY
        bodies = {body.name: body for body in spec.bodies if body.name != "world"}
        if wanted not in bodies:
            raise _missing(name, "body", wanted, list(bodies))
        bodies[wanted].add_site(
            name=site, pos=mapped.place.pos, quat=_along_x(mapped.place.z), group=4
        )
    elif site not in {present.name for present in spec.sites}:
        raise _missing(name, "site", str(site), [present.name for present in spec.sites])

    actuator = spec.add_actuator(
        name=f"thruster_{mapped.name}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site
    )

    along = np.array(_AHEAD)
    if mapped.place is None and mapped.axis is not None:
        along = mapped.axis
    actuator.gear = [*along, 0.0, 0.0, 0.0]
    thrusters.attach(spec, {actuator.name: mapped.thruster})


def _make_plain(actuator: mujoco.MjsActuator) -> None:
    """Make an actuator on a site a motor of thrust [N]: limits and curve are the mapping's."""
    length = float(np.linalg.norm(actuator.gear[:3]))
    if actuator.trntype != mujoco.mjtTrn.mjTRN_SITE or actuator.refsite or not length > 0.0:
        return  # refused, with the reason, where its table is attached
    actuator.set_to_motor()
    actuator.gear[:3] = np.array(actuator.gear[:3]) / length
    actuator.ctrllimited = actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE


def _along_x(direction: Array) -> Array:
    """Quaternion wxyz of a frame whose x axis is `direction` (3,)."""
    R = rotation_from_z(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    return quat_wxyz_from_rotation(R[:, [2, 0, 1]])


def _missing(name: str, kind: str, wanted: str, present: list[str]) -> ConfigurationError:
    return ConfigurationError(
        f"{name}: the model has no {kind} {wanted!r}; it has "
        f"{', '.join(filter(None, present)) or 'none with a name'}{did_you_mean(wanted, present)}"
    )
