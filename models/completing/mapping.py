"""Names of `uuv.models.naming` for a user's model: renames its parts, adds sites and actuators.

    spec = mapped(read("rov.urdf"))  # a VehicleFile, under its own names, becomes a vehicle

`mapped` changes the spec of the file in place.
"""

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

from uuv.models.files.keyframes import keyframes_kept
from uuv.models.files.mjcf_files import compiled
from uuv.models.files.notes import note
from uuv.models.files.parts_file import MappedThruster, PartPlace, PartsMap
from uuv.models.files.vehicle_file import VehicleFile
from uuv.models.naming import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, TOOL_GEOM
from uuv.models.water import thrusters
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, rotation_from_z

_UP = (0.0, 0.0, 1.0)
_AHEAD = (1.0, 0.0, 0.0)
_STARBOARD = (0.0, -1.0, 0.0)


def mapped(file: VehicleFile) -> mujoco.MjSpec:
    """The vehicle of a file under the names of the contract; lines about the file are kept in it.

    A model without a mapping keeps its names, but its only body, if it floats, is the hull. A
    format that has neither free joints nor motors gets both.

    Args:
        file: as `uuv.models.files.vehicle_file.read` returns it; its spec is changed in place.

    Returns:
        The spec of the file.

    Raises:
        ConfigurationError: a part that the mapping names is not in the model, or cannot serve; or
            the model cannot be compiled.
    """
    spec = file.spec
    lines = list(file.notes)
    if file.bare:
        _apply(spec, file.parts or PartsMap(), file.parts_name)
        add_motors(spec, joints_between(spec), file.name)
    elif file.parts is not None:
        _apply(spec, file.parts, file.parts_name)
    elif line := _name_hull(spec):
        lines.append(line)

    # What compiled before, as an MJCF does when it is read, was broken by the mapping.
    compiled(spec, file.name if file.bare else file.parts_name)
    note(spec, lines)
    return spec


def _apply(spec: mujoco.MjSpec, parts: PartsMap, name: str) -> None:
    """Give the parts of `spec` the names of the contract, in place.

    Args:
        spec: a user's model.
        parts: what its parts are called.
        name: of the mapping, with which errors begin.

    Raises:
        ConfigurationError: a part that the mapping names is not in the model, or cannot serve.
    """
    try:
        _name_parts(spec, parts, name)
    except ConfigurationError:
        raise
    except (ValueError, mujoco.FatalError) as error:
        # of MuJoCo, such as a name that is there already
        raise ConfigurationError(f"{name}: {' '.join(str(error).split())}") from error


def _name_parts(spec: mujoco.MjSpec, parts: PartsMap, name: str) -> None:
    hull = _body(spec, parts.hull, name) if parts.hull else _only_body(spec, name)
    before = parts.hull if hull is None else hull.name

    if hull is not None:
        _rename_body(spec, hull, HULL_BODY)
        if not hull.joints:
            _check_root(spec, hull, before, name)
            with keyframes_kept(spec):
                hull.add_freejoint(name=HULL_BODY)
    if parts.arm_base:
        _rename_body(spec, _body(spec, parts.arm_base, name, parts.hull), ARM_BASE_BODY)

    renamed = {before: HULL_BODY, parts.arm_base: ARM_BASE_BODY}
    _add_site(spec, TIP_SITE, parts.tip, renamed, name)
    _add_site(spec, CAMERA_SITE, parts.camera, renamed, name)
    if parts.tool:
        _rename_geom(spec, parts.tool, name)

    if parts.torque_limits is not None:
        _drive(spec, parts.torque_limits, name)
    for thruster in parts.thrusters:
        _thruster(spec, thruster, renamed, name)


def _name_hull(spec: mujoco.MjSpec) -> str:
    """Call the only body on the world the hull, if it floats and no other is; a line about it."""
    roots = list(spec.worldbody.bodies)
    free = len(roots) == 1 and any(
        joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in roots[0].joints
    )
    if not free or any(body.name == HULL_BODY for body in spec.bodies):
        return ""

    before = roots[0].name
    _rename_body(spec, roots[0], HULL_BODY)
    return f"body hull: {before!r}, the only body on the world"


def _only_body(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody | None:
    """The hull by its usual name, or the only body that hangs on the world."""
    usual = next((body for body in spec.bodies if body.name == HULL_BODY), None)
    if usual is not None:
        return usual
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1:
        raise ConfigurationError(
            f"{name}: hull: which body is it? there are {', '.join(b.name for b in roots)}"
        )
    return roots[0]


def _check_root(spec: mujoco.MjSpec, hull: mujoco.MjsBody, before: str | None, name: str) -> None:
    """Refuse to let a body float that another one carries."""
    roots = [body.name for body in spec.worldbody.bodies]
    if hull.name not in roots:
        raise ConfigurationError(
            f"{name}: hull: {before!r} is carried by another body, and only one on the world "
            f"floats: {', '.join(roots)}"
        )


def _missing(name: str, kind: str, sought: str, names: list[str]) -> ConfigurationError:
    return ConfigurationError(
        f"{name}: the model has no {kind} {sought!r}; it has "
        f"{', '.join(filter(None, names)) or 'none with a name'}"
        f"{did_you_mean(sought, names)}"
    )


def _body(spec: mujoco.MjSpec, sought: str, name: str, hull: str | None = None) -> mujoco.MjsBody:
    bodies = [body for body in spec.bodies if body.name != "world"]
    if hull is not None and sought == hull:
        raise ConfigurationError(
            f"{name}: arm_base: must be a body of its own, fixed to the hull, got {sought!r}"
        )
    for body in bodies:
        if body.name == sought:
            return body
    raise _missing(name, "body", sought, [body.name for body in bodies])


def _rename_body(spec: mujoco.MjSpec, body: mujoco.MjsBody, to: str) -> None:
    """Rename a body, and what refers to it by name."""
    before = body.name
    body.name = to
    if before == to:
        return

    # Of all that refer to a body, MuJoCo renames none.
    for exclude in spec.excludes:
        exclude.bodyname1 = to if exclude.bodyname1 == before else exclude.bodyname1
        exclude.bodyname2 = to if exclude.bodyname2 == before else exclude.bodyname2
    for equality in spec.equalities:
        if equality.objtype == mujoco.mjtObj.mjOBJ_BODY:
            equality.name1 = to if equality.name1 == before else equality.name1
            equality.name2 = to if equality.name2 == before else equality.name2

    bodies = (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY)
    for sensor in spec.sensors:
        sensor.objname = (
            to if sensor.objtype in bodies and sensor.objname == before else sensor.objname
        )
        sensor.refname = (
            to if sensor.reftype in bodies and sensor.refname == before else sensor.refname
        )

    for camera in [*spec.cameras, *spec.lights]:
        camera.targetbody = to if camera.targetbody == before else camera.targetbody
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_BODY and actuator.target == before:
            actuator.target = to


def _rename_geom(spec: mujoco.MjSpec, sought: str, name: str) -> None:
    geom = next((geom for geom in spec.geoms if geom.name == sought), None)
    if geom is None:
        raise _missing(name, "geom", sought, [geom.name for geom in spec.geoms])
    geom.name = TOOL_GEOM

    for pair in spec.pairs:
        pair.geomname1 = TOOL_GEOM if pair.geomname1 == sought else pair.geomname1
        pair.geomname2 = TOOL_GEOM if pair.geomname2 == sought else pair.geomname2


def _add_site(
    spec: mujoco.MjSpec,
    usual: str,
    where: str | PartPlace | None,
    renamed: dict[str | None, str],
    name: str,
) -> None:
    """Site of the contract's name, at another site or on a body; the model's own gives way."""
    if where is None or where == usual:
        return

    sites = {site.name: site for site in spec.sites}
    if usual in sites:
        sites[usual].name = f"{usual}_of_the_model"

    # At a site of the model.
    if isinstance(where, str):
        if where not in sites:
            hint = ""
            if any(body.name == where for body in spec.bodies):
                hint = f"; a body is called so: {usual}: {{body: {where}}}"
            elif any(camera.name == where for camera in spec.cameras):
                hint = (
                    f"; a <camera> is called so: give its place, {usual}: {{body: NAME, pos: "
                    f"[x, y, z]}}"
                )
            raise ConfigurationError(f"{_missing(name, 'site', where, list(sites))}{hint}")

        original = sites[where]
        added = original.parent.add_site(name=usual, pos=original.pos, quat=original.quat, group=4)
        added.alt = original.alt
        return

    # On a body, with the axes that are usual for the site.
    body = _body(spec, renamed.get(where.body, where.body), name)
    upright = abs(where.z[2]) > 0.999
    if usual == CAMERA_SITE:  # OpenCV axes: x to the right of the view, y down
        x = np.array(_STARBOARD) if upright else np.cross(where.z, _UP)
    else:
        x = np.array(_AHEAD) if upright else np.array(_UP)

    R = rotation_from_z(where.z, x)
    body.add_site(name=usual, pos=where.pos, quat=quat_wxyz_from_rotation(R), group=4)


def _drive(spec: mujoco.MjSpec, joints: Mapping[str, float | None], name: str) -> None:
    """Give each joint of the arm one motor, gear 1, with its torque limit; lock others at zero.

    The others are all joints that the hull carries but those on springs: of a second arm, a
    gripper, a camera's pan.
    """
    movable = {joint.name: joint for joint in spec.joints if joint.type in _TURNING}
    for joint_name in joints:
        if joint_name not in movable:
            raise _missing(name, "joint", joint_name, list(movable))

    # The mapping lists the arm's joints, all of them and in order.
    chain = joints_between(spec)
    listed = [joint for joint in chain if joint in joints]
    if listed != list(joints):
        raise ConfigurationError(
            f"{name}: joints: must be those from {ARM_BASE_BODY} to {TIP_SITE} in this order, "
            f"{', '.join(chain)}; got "
            f"{', '.join(joints)}"
        )

    # Other joints of the hull are locked.
    carried = next(
        (
            body.find_all(mujoco.mjtObj.mjOBJ_JOINT)
            for body in spec.bodies
            if body.name == HULL_BODY
        ),
        [],
    )
    locked = [
        other
        for other in carried
        if other.type in _TURNING and other.name not in joints and not other.stiffness[0]
    ]
    if locked:
        # A keyframe keeps the values of the joints that stay.
        with keyframes_kept(spec):
            names = ", ".join([joint.name or "without a name" for joint in locked])
            for joint in locked:
                _lock(spec, joint)
        note(spec, [f"joints held at 0, which the mapping does not list: {names}"])

    for joint_name, limit in joints.items():
        _add_motor(spec, movable[joint_name], limit, name)


def _lock(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
    """Delete a joint, with what drives it or holds it to another."""
    for actuator in list(spec.actuators):
        if actuator.target == joint.name and actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            spec.delete(actuator)

    for equality in list(spec.equalities):
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and joint.name in (
            equality.name1,
            equality.name2,
        ):
            spec.delete(equality)

    for sensor in list(spec.sensors):
        if sensor.objtype == mujoco.mjtObj.mjOBJ_JOINT and sensor.objname == joint.name:
            spec.delete(sensor)

    spec.delete(joint)


_TURNING = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def _add_motor(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, limit: float | None, name: str) -> None:
    """Drive a joint by a motor, gear 1, in place of another kind of actuator that it has.

    Args:
        spec: model.
        joint: of the arm.
        limit: [N m] of the motor; None: that of its actuator, or of its `actuatorfrcrange`, a
            URDF's effort.
        name: with which errors begin.

    Raises:
        ConfigurationError: no limit is known.
    """
    actuators = [
        a
        for a in spec.actuators
        if a.target == joint.name and a.trntype == mujoco.mjtTrn.mjTRN_JOINT
    ]

    # Limits that the model states.
    known = [
        np.abs(a.ctrlrange).min() for a in actuators if _is_motor(a) and np.ptp(a.ctrlrange) > 0.0
    ]
    known += [np.abs(a.forcerange).min() for a in actuators if np.ptp(a.forcerange) > 0.0]
    known += [np.abs(joint.actfrcrange).min()] if np.ptp(joint.actfrcrange) > 0.0 else []

    if limit is None:
        if not known or not known[0] > 0.0:
            raise ConfigurationError(
                f"{name}: joint {joint.name!r} has no torque limit (URDF: <limit effort>); give "
                "it, "
                f"joints: {{{joint.name}: 10}} [N m]"
            )
        limit = float(known[0])

    # One motor in place of what drove the joint.
    for actuator in actuators:
        spec.delete(actuator)
    joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE  # the motor's own range limits it
    motor = spec.add_actuator(name=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
    motor.ctrlrange = [-limit, limit]
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE


def add_motors(spec: mujoco.MjSpec, joints: Iterable[str], name: str) -> None:
    """Drive those of `joints` that no actuator drives, with the effort of the URDF.

    Raises:
        ConfigurationError: a joint has no effort.
    """
    of_joints = [a for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_JOINT]
    driven = {actuator.target for actuator in of_joints}
    for joint in joints:
        if joint not in driven:
            _add_motor(spec, spec.joint(joint), None, name)


def _is_motor(actuator: mujoco.MjsActuator) -> bool:
    """True if the control of an actuator on a joint is its torque [N m]."""
    return (
        actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
        and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
        and actuator.gainprm[0] == 1.0
        and actuator.gear[0] == 1.0
    )


def joints_between(spec: mujoco.MjSpec) -> list[str]:
    """Names of the joints from the arm's base to the tip, base first, without those on springs."""
    tip = next((site for site in spec.sites if site.name == TIP_SITE), None)
    names: list[str] = []
    body = tip.parent if tip is not None else None
    while body is not None and body.name not in (ARM_BASE_BODY, HULL_BODY, "world"):
        names[:0] = [
            joint.name for joint in body.joints if joint.type in _TURNING and not joint.stiffness[0]
        ]
        body = body.parent
    return names


def _thruster(
    spec: mujoco.MjSpec, mapped: MappedThruster, renamed: dict[str | None, str], name: str
) -> None:
    """Add a thruster, or give an actuator of the model its table."""
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
        body = _body(spec, renamed.get(mapped.place.body, mapped.place.body) or HULL_BODY, name)
        body.add_site(name=site, pos=mapped.place.pos, quat=_along_x(mapped.place.z), group=4)
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
