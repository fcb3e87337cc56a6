"""Joints without a drive, held at a value that their range and their leaders determine.

    lines = hold(spec, joints) # the joints are deleted, their bodies fixed to their parents

A joint that follows another (an equality of joints, a URDF's `mimic`) is held at the value that its
leader prescribes. Any other joint is held at its reference, or at the nearer end of its range if
the reference is outside.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from uuv.models.files.keyframes import keyframes_kept
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, quat_wxyz_from_rotation, readonly

TURNING = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_NAMELESS = "body without a name"  # while its orientation is computed
_ZERO = 1e-12  # [rad] or [m] that counts as no motion


def hold(
    spec: mujoco.MjSpec,
    joints: Sequence[mujoco.MjsJoint],
    why: str,
    stated: Mapping[str, float] | None = None,
) -> list[str]:
    """Delete joints of a spec, in place; each body keeps the pose that it has with its joint held.

    Args:
        spec: model; actuators of the joints and constraints on them are deleted too.
        joints: hinges and slides of the model.
        why: reason of the holding, for the returned lines.
        stated: values [rad] or [m] at which to hold some of them, by name.

    Returns:
        A line about the joints held at 0, and one about the others with their values.
    """
    if not joints:
        return []
    leaders = followed(spec)
    by_name = {joint.name: joint for joint in spec.joints if joint.type in TURNING}
    values = {
        id(joint): (stated or {}).get(joint.name, _value(spec, joint, by_name, leaders))
        for joint in joints
    }

    # Each keyframe keeps the values of the joints that stay.
    still: list[str] = []
    away: list[str] = []

    with keyframes_kept(spec):
        for joint in joints:
            name = joint.name or "without a name"
            value = values[id(joint)]
            unit = "m" if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else "rad"
            motion = value - _in_si(spec, joint, joint.ref)
            if abs(motion) > _ZERO:
                _move(spec, joint, motion)

            if abs(value) > _ZERO:
                away.append(f"{name} at {value:.4g} {unit}")
            else:
                still.append(name)

            _delete(spec, joint)

    lines = []
    if still:
        lines.append(f"joints held at 0, {why}: {', '.join(still)}")
    if away:
        lines.append(f"joints held within their range, {why}: {', '.join(away)}")

    return lines


def follow(spec: mujoco.MjSpec, coupled: Mapping[str, tuple[str, float, float]]) -> None:
    """Let joints follow others by equality constraints: leader, factor and offset for each
    follower.
    """
    for follower, (leader, factor, offset) in coupled.items():
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=follower,
            name2=leader,
            data=[offset, factor, *(0.0,) * 10],
        )


def loops(spec: mujoco.MjSpec) -> list[str]:
    """Constraints of a spec that close loops (connections and welds), as text."""
    kinds = {mujoco.mjtEq.mjEQ_CONNECT: "connect", mujoco.mjtEq.mjEQ_WELD: "weld"}
    return [
        f"{kinds[equality.type]} of {equality.name1} and {equality.name2 or 'the world'}"
        for equality in spec.equalities
        if equality.type in kinds and equality.active
    ]


def massless(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    """Hinges and slides that carry no mass, which MuJoCo cannot move."""
    return [
        joint
        for body in spec.bodies
        if body.name != "world" and not _weighs(body)
        for joint in body.joints
        if joint.type in TURNING
    ]


def _weighs(body: mujoco.MjsBody) -> bool:
    """True if a body has mass and inertia, or carries a body without joints that has them."""
    if body.explicitinertial:
        inertia = body.fullinertia[:3] if np.isfinite(body.fullinertia[0]) else body.inertia
        weighs = body.mass > 0.0 and float(np.min(inertia)) > 0.0
    else:
        weighs = any(geom.density > 0.0 or geom.mass > 0.0 for geom in body.geoms)

    return weighs or any(_weighs(child) for child in body.bodies if not child.joints)


def followed(spec: mujoco.MjSpec) -> dict[str, tuple[str, Array]]:
    """Leader of each joint that follows another, and the polynomial (5,) of this coupling."""
    return {
        equality.name1: (equality.name2, readonly(equality.data[:5]))
        for equality in spec.equalities
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and equality.active and equality.name2
    }


def range_of(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> tuple[float, float]:
    """Range [rad] or [m] of a joint; infinite if the joint has none."""
    low, high = (_in_si(spec, joint, end) for end in joint.range)
    limited = joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and low < high
    )

    return (low, high) if limited else (-np.inf, np.inf)


def _value(
    spec: mujoco.MjSpec,
    joint: mujoco.MjsJoint,
    by_name: dict[str, mujoco.MjsJoint],
    leaders: dict[str, tuple[str, Array]],
    passed: tuple[str, ...] = (),
) -> float:
    """Value [rad] or [m] at which a joint is held."""
    reference = value = _in_si(spec, joint, joint.ref)
    leader, polynomial = leaders.get(joint.name, ("", np.zeros(5)))

    if leader in by_name and leader not in passed:
        lead = by_name[leader]
        moved = _value(spec, lead, by_name, leaders, (*passed, joint.name))
        moved -= _in_si(spec, lead, lead.ref)
        value = reference + float(np.polynomial.polynomial.polyval(moved, polynomial))

    return float(np.clip(value, *range_of(spec, joint)))


def _in_si(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, number: float) -> float:
    """A joint value of the spec in [rad] or [m]."""
    degrees = spec.compiler.degree and joint.type == mujoco.mjtJoint.mjJNT_HINGE
    return float(np.radians(number) if degrees else number)


def _move(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, motion: float) -> None:
    """Move the body of a joint to the pose that it has at the joint value `motion` [rad] or [m]."""
    body = joint.parent
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)

    if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        step = pose(None, motion * axis)
    else:
        p = np.array(joint.pos)
        R = exp_so3(motion * axis)
        step = pose(R, p - R @ p)

    R_parent = np.empty(9)
    mujoco.mju_quat2Mat(R_parent, _quat_of(spec, body))
    X = pose(R_parent.reshape(3, 3), np.array(body.pos)) @ step
    body.pos = X[:3, 3]
    body.quat = quat_wxyz_from_rotation(X[:3, :3])
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _quat_of(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> Array:
    """Orientation of a body as a quaternion wxyz, in whatever form the file states it."""
    if body.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT:
        return np.array(body.quat)
    name = body.name
    body.name = name or _NAMELESS
    still = spec.copy()
    body.name = name
    for part in [*still.keys, *still.equalities, *still.actuators, *still.sensors]:
        still.delete(part)
    for other in list(still.joints):
        still.delete(other)

    return np.array(still.compile().body(name or _NAMELESS).quat)


def _delete(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
    """Delete a joint, with its actuators and the constraints on it."""
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
