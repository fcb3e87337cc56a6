"""The vehicle of a model as a URDF: links, joints, inertias and simple shapes, for other tools.

Bodies are links. A body with several joints gets links without mass between them. What a URDF
cannot say is left out: the water, drives, meshes.
"""

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from uuv.models.naming import body_label
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import Array

_FLOATING = "floating"  # a joint whose pose is only in /tf
_TYPES = {
    int(mujoco.mjtJoint.mjJNT_HINGE): "revolute",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic",
    int(mujoco.mjtJoint.mjJNT_BALL): _FLOATING,  # URDF has no ball joint
}
_NO_LIMIT = 1e3  # [N, N m], [m/s, rad/s] where the model states none


def robot_description(model: mujoco.MjModel) -> str:
    """URDF of the vehicle in a compiled model; its root is the hull.

    Raises:
        ConfigurationError: The model has no vehicle.
    """
    vehicle = Vehicle.of(model)
    data = mujoco.MjData(model)
    _straighten(model, data)
    root = ET.Element("robot", name=body_label(model, vehicle.hull))

    for body in _subtree(model, vehicle.hull):
        _add_link(root, model, body)
        if body != vehicle.hull:
            _add_joints(root, model, data, body)

    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _straighten(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Put all hinges and slides to 0, where a URDF's joint frames are stated."""
    for joint in range(model.njnt):
        if _TYPES.get(int(model.jnt_type[joint]), _FLOATING) != _FLOATING:
            data.qpos[model.jnt_qposadr[joint]] = 0.0
    mujoco.mj_kinematics(model, data)


def _subtree(model: mujoco.MjModel, top: int) -> Iterator[int]:
    """Bodies from `top` on, parents first."""
    within = {top}
    yield top
    for body in range(top + 1, model.nbody):
        if int(model.body_parentid[body]) in within:
            within.add(body)
            yield body


def _add_link(root: ET.Element, model: mujoco.MjModel, body: int) -> None:
    link = ET.SubElement(root, "link", name=body_label(model, body))
    if model.body_mass[body] > 0.0:
        inertial = ET.SubElement(link, "inertial")
        _add_origin(inertial, model.body_ipos[body], model.body_iquat[body])
        ET.SubElement(inertial, "mass", value=f"{model.body_mass[body]:.9g}")

        xx, yy, zz = (f"{value:.9g}" for value in model.body_inertia[body])
        ET.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")

    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        shape = _shape(model, geom)
        if shape is None:
            continue

        visual = ET.SubElement(link, "visual")
        _add_origin(visual, model.geom_pos[geom], model.geom_quat[geom])
        ET.SubElement(visual, "geometry").append(shape)


def _shape(model: mujoco.MjModel, geom: int) -> ET.Element | None:
    """Geometry of a geom that URDF has; None for others, such as meshes."""
    size = model.geom_size[geom]
    match int(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_BOX:
            return ET.Element("box", size=" ".join(f"{2.0 * s:.9g}" for s in size))
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return ET.Element("sphere", radius=f"{size[0]:.9g}")
        case mujoco.mjtGeom.mjGEOM_CYLINDER | mujoco.mjtGeom.mjGEOM_CAPSULE:
            return ET.Element("cylinder", radius=f"{size[0]:.9g}", length=f"{2.0 * size[1]:.9g}")
        case _:
            return None


def _add_joints(root: ET.Element, model: mujoco.MjModel, data: mujoco.MjData, body: int) -> None:
    """Joints from a body's parent to it: one each, or a fixed one."""
    parent = int(model.body_parentid[body])
    offset, attitude = _pose_in(data, parent, body)
    name = body_label(model, body)
    parent_name = body_label(model, parent)
    first = int(model.body_jntadr[body])
    joints = range(first, first + int(model.body_jntnum[body]))

    if not joints:
        _add_joint(root, f"{name}_fixed", "fixed", parent_name, name, offset, attitude)
        return

    # A joint's axis may pass beside the body's origin: a link on the axis carries the body.
    for joint in joints:
        anchor = np.asarray(model.jnt_pos[joint])
        beside = bool(np.any(anchor)) or joint != joints[-1]
        joint_name = model.joint(joint).name or f"joint_{joint}"
        child = f"{name}_{joint_name}_axis" if beside else name

        origin = offset + attitude.apply(anchor)
        element = _add_joint(
            root,
            joint_name,
            _TYPES[int(model.jnt_type[joint])],
            parent_name,
            child,
            origin,
            attitude,
        )
        if element.get("type") != _FLOATING:
            _add_motion(element, model, joint)
        if child == name:
            return

        ET.SubElement(root, "link", name=child)
        offset = -anchor
        attitude = Rotation.identity()
        parent_name = child

    _add_joint(root, f"{name}_fixed", "fixed", parent_name, name, offset, attitude)


def _add_joint(
    root: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: Array,
    attitude: Rotation,
) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    _add_origin(joint, place, attitude.as_quat(scalar_first=True))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _add_motion(element: ET.Element, model: mujoco.MjModel, joint: int) -> None:
    """Axis and limits of a joint."""
    axis = " ".join(f"{value:.9g}" for value in model.jnt_axis[joint])
    ET.SubElement(element, "axis", xyz=axis)

    if not model.jnt_limited[joint]:
        element.set("type", "continuous" if element.get("type") == "revolute" else "prismatic")
    low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-_NO_LIMIT, _NO_LIMIT)
    effort = _effort(model, joint)
    ET.SubElement(
        element,
        "limit",
        lower=f"{low:.9g}",
        upper=f"{high:.9g}",
        effort=f"{effort:.9g}",
        velocity=f"{_NO_LIMIT:.9g}",
    )


def _effort(model: mujoco.MjModel, joint: int) -> float:
    """Largest torque of the joint's drive."""
    of_joints = np.asarray(model.actuator_trntype) == mujoco.mjtTrn.mjTRN_JOINT
    of_this = of_joints & (np.asarray(model.actuator_trnid)[:, 0] == joint)
    drives = np.flatnonzero(of_this & (np.asarray(model.actuator_ctrllimited) > 0))
    return float(model.actuator_ctrlrange[drives[0], 1]) if len(drives) else _NO_LIMIT


def _pose_in(data: mujoco.MjData, parent: int, body: int) -> tuple[Array, Rotation]:
    """Place (3,) [m] and attitude of a body in another."""
    R_WP = Rotation.from_quat(data.xquat[parent], scalar_first=True)
    R_WC = Rotation.from_quat(data.xquat[body], scalar_first=True)
    return R_WP.inv().apply(data.xpos[body] - data.xpos[parent]), R_WP.inv() * R_WC


def _add_origin(element: ET.Element, place: Array, wxyz: Array) -> None:
    with warnings.catch_warnings():  # at a pitch of 90 degrees the angles are not unique, but right
        warnings.simplefilter("ignore", UserWarning)
        rpy = Rotation.from_quat(wxyz, scalar_first=True).as_euler("xyz")
    ET.SubElement(
        element,
        "origin",
        xyz=" ".join(f"{value:.9g}" for value in place),
        rpy=" ".join(f"{value:.9g}" for value in rpy),
    )
