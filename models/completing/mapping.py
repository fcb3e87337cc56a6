"""Mapping of a user's model to the names of `uuv.models.naming`: renames parts, adds sites and
actuators.

    spec = mapped(read("rov.urdf"))  # a VehicleFile, under its own names, becomes a vehicle

`mapped` changes the spec of the file in place.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.completing.actuators import actuate, part_missing
from uuv.models.completing.axes import UP, turn_hull
from uuv.models.completing.hull_box import hull_box
from uuv.models.completing.masses import give_masses
from uuv.models.files.keyframes import keyframes_kept
from uuv.models.files.mjcf_files import compiled, reason_of
from uuv.models.files.notes import keep_entries, note
from uuv.models.files.parts_file import PartPlace, PartsMap
from uuv.models.files.vehicle_file import VehicleFile
from uuv.models.naming import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, TOOL_GEOM
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, rotation_from_z

BARE_ARM = "it looks like a bare arm"
MOUNT = "uuv.models.completing.mounting.mount_arm puts it on a hull (docs/own_vehicle.md)"
_ARM = 3  # number of joints from which on a file without thrusters is taken for an arm
_HULL = 0.5  # share of the total mass that a hull has at least
# distance of buoyancy below the centre of mass, over the height, from which on it is reported
_BELOW = 0.1
_LOW = 0.05  # [m] smallest height of the hull that is used for this
_UP = (0.0, 0.0, 1.0)
_AHEAD = (1.0, 0.0, 0.0)


def mapped(file: VehicleFile) -> mujoco.MjSpec:
    """The vehicle of a file, its parts renamed by the contract. Notes about the file are stored in
    the spec.

    A model without a mapping keeps its names, except that its only floating body becomes the hull.
    If the format has neither free joints nor motors, both are added.

    Args:
        file: description of the vehicle, as `uuv.models.files.vehicle_file.read` returns it; its
            spec is changed in place.

    Returns:
        The spec of the file.

    Raises:
        ConfigurationError: a part that the mapping names is not in the model or cannot be used, or
            the model cannot be compiled.
    """
    spec = file.spec
    note(spec, file.notes)
    keep_entries(spec, file.entries)

    if file.bare or file.parts is not None:
        _apply(spec, file)
    elif line := _name_hull(spec):
        note(spec, [line])

    # A model that compiled before, such as an MJCF, which is compiled when it is read, was broken
    # by the mapping.
    model = compiled(spec, file.name if file.bare else file.parts_name)
    note(spec, [*_upside_down(spec, model), *_bare_arm(spec, file, model)])
    return spec


def _upside_down(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[str]:
    """A line about a hull whose buoyancy acts below its centre of mass, for instance because z of
    the file is down.
    """
    water = hydrodynamics.attached(spec).get(HULL_BODY)
    if water is None or not water.volume > 0.0:
        return
    above = float(water.center_of_buoyancy[2] - model.body(HULL_BODY).ipos[2])

    arm = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, ARM_BASE_BODY)
    low, high = hull_box(model, model.body(HULL_BODY).id, arm)[:, 2]
    if above < -_BELOW * max(float(high - low), _LOW):
        yield (
            f"the hull's centre of buoyancy is {-1e3 * above:.0f} mm below its centre of mass; "
            "if z points down in the file, write `up: -z` in the mapping"
        )


def _bare_arm(spec: mujoco.MjSpec, file: VehicleFile, model: mujoco.MjModel) -> Iterator[str]:
    """A line about a file that describes only an arm: no thrusters, and most of the mass is in its
    links.
    """
    parts = file.parts or PartsMap()
    pushed = parts.thrusters or file.thrusters or len(spec.actuators)
    share = float(model.body_mass[1] / model.body_subtreemass[1]) if model.nbody > 1 else 1.0
    if file.bare and not pushed and len(file.speeds) >= _ARM and share < _HULL:
        yield f"{BARE_ARM}: no thrusters, {len(file.speeds)} joints; {MOUNT}"


def _apply(spec: mujoco.MjSpec, file: VehicleFile) -> None:
    """Give the parts of `spec` the names of the contract, in place.

    Args:
        spec: a user's model.
        file: description of the vehicle, with its mapping.

    Raises:
        ConfigurationError: a part that the mapping names is not in the model, or cannot be used.
    """
    parts = file.parts or PartsMap()
    name = file.parts_name

    try:
        renamed = _name_parts(spec, parts, name)
        actuate(spec, file, renamed)
        if parts.up != "z":
            turn_hull(spec, parts.up, name)
            note(spec, [f"axes turned, since {parts.up} of the file points up"])
    except ConfigurationError:
        raise
    except (ValueError, mujoco.FatalError) as error:
        # raised by MuJoCo, for instance for a name that exists already, or a link without mass
        raise ConfigurationError(f"{name}: {reason_of(error)}") from error


def _name_parts(spec: mujoco.MjSpec, parts: PartsMap, name: str) -> dict[str | None, str]:
    """Give the parts of a model the names of the contract; returns the new names of bodies by the
    old.

    Raises:
        ConfigurationError: a part is not in the model, or cannot be used.
    """
    hull = _body(spec, parts.hull, name) if parts.hull else _only_body(spec, name)
    before = parts.hull if hull is None else hull.name

    if parts.masses:
        aliases = {HULL_BODY: before or HULL_BODY}
        masses = {aliases.get(body, body): mass for body, mass in parts.masses.items()}
        note(spec, give_masses(spec, masses, name))

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
    camera_up = UP[parts.up].T @ np.array(_UP)
    _add_site(spec, CAMERA_SITE, parts.camera, renamed, name, camera_up)
    if parts.tool:
        _rename_geom(spec, parts.tool, name)

    return renamed


def _name_hull(spec: mujoco.MjSpec) -> str:
    """Name the only body on the world the hull, if it floats and no body is named so; returns a
    line about it.
    """
    roots = list(spec.worldbody.bodies)
    free = len(roots) == 1 and any(
        joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in roots[0].joints
    )
    if not free or any(body.name == HULL_BODY for body in spec.bodies):
        return ""

    before = roots[0].name
    _rename_body(spec, roots[0], HULL_BODY)
    return f"body hull: {before!r}, since it is the only body on the world"


def _only_body(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody | None:
    """The hull by its usual name, or the only body whose parent is the world."""
    usual = next((body for body in spec.bodies if body.name == HULL_BODY), None)
    if usual is not None:
        return usual
    roots = list(spec.worldbody.bodies)

    if len(roots) != 1:
        raise ConfigurationError(
            f"{name}: hull: state which body it is; the bodies on the world are "
            f"{', '.join(b.name for b in roots)}"
        )

    return roots[0]


def _check_root(spec: mujoco.MjSpec, hull: mujoco.MjsBody, before: str | None, name: str) -> None:
    """Refuse a hull that another body carries, since such a body cannot float."""
    roots = [body.name for body in spec.worldbody.bodies]
    if hull.name not in roots:
        raise ConfigurationError(
            f"{name}: hull: {before!r} is carried by another body and cannot float; name a body on "
            f"the world: {', '.join(roots)}"
        )


def _body(spec: mujoco.MjSpec, sought: str, name: str, hull: str | None = None) -> mujoco.MjsBody:
    bodies = [body for body in spec.bodies if body.name != "world"]
    if hull is not None and sought == hull:
        raise ConfigurationError(
            f"{name}: arm_base: must be a separate body that is fixed to the hull, got {sought!r}"
        )

    for body in bodies:
        if body.name == sought:
            return body

    raise part_missing(name, "body", sought, [body.name for body in bodies])


def _rename_body(spec: mujoco.MjSpec, body: mujoco.MjsBody, to: str) -> None:
    """Rename a body, and all references to it."""
    before = body.name
    body.name = to
    if before == to:
        return

    # MuJoCo renames none of the references to a body.
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
        raise part_missing(name, "geom", sought, [geom.name for geom in spec.geoms])
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
    up: Array | None = None,
) -> None:
    """Site of the contract's name, at another site or on a body. It replaces a site of that
    name.
    """
    if where is None or where == usual:
        return

    sites = {site.name: site for site in spec.sites}
    if usual in sites:
        sites[usual].name = f"{usual}_of_the_model"

    # The place is a site of the model.
    if isinstance(where, str):
        if where not in sites:
            hint = ""
            if any(body.name == where for body in spec.bodies):
                hint = f"; there is a body of that name: write {usual}: {{body: {where}}}"
            elif any(camera.name == where for camera in spec.cameras):
                hint = (
                    f"; there is a <camera> of that name: write its position, {usual}: "
                    f"{{body: NAME, pos: [x, y, z]}}"
                )

            raise ConfigurationError(f"{part_missing(name, 'site', where, list(sites))}{hint}")

        original = sites[where]
        added = original.parent.add_site(name=usual, pos=original.pos, quat=original.quat, group=4)
        added.alt = original.alt
        return

    # The place is on a body, with the axes that are usual for the site.
    body = _body(spec, renamed.get(where.body, where.body), name)
    upright = abs(where.z[2]) > 0.999

    if usual == CAMERA_SITE:  # OpenCV axes: x to the right of the view, y down
        over = np.array(_UP) if up is None else up
        x = np.cross(over, _AHEAD) * -1.0 if upright else np.cross(where.z, over)
    else:
        x = np.array(_AHEAD) if upright else np.array(_UP)

    R = rotation_from_z(where.z, x)
    body.add_site(name=usual, pos=where.pos, quat=quat_wxyz_from_rotation(R), group=4)
