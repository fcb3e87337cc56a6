"""Joints of a user's arm: one motor each, a range, and all others held."""

from collections.abc import Collection, Iterable, Mapping

import mujoco
import numpy as np

from uuv.models.files.holding import TURNING, followed, hold, range_of
from uuv.models.files.notes import note
from uuv.models.naming import ARM_BASE_BODY, HULL_BODY, TIP_SITE
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean


def drive(spec: mujoco.MjSpec, joints: Mapping[str, float | None], name: str) -> None:
    """Give each joint of the arm one motor, gear 1, with its torque limit; hold the others.

    The others are all joints that the hull carries but those on springs: of a second arm, a
    gripper, a camera's pan.
    """
    movable = {joint.name: joint for joint in spec.joints if joint.type in TURNING}
    for joint_name in joints:
        if joint_name not in movable:
            raise ConfigurationError(
                f"{name}: the model has no joint {joint_name!r}; it has "
                f"{', '.join(movable) or 'none with a name'}{did_you_mean(joint_name, movable)}"
            )

    # The mapping lists the arm's joints, all of them and in order.
    chain = joints_between(spec)
    check_followers(spec, chain, name)
    listed = [joint for joint in chain if joint in joints]
    if listed != list(joints):
        raise ConfigurationError(
            f"{name}: joints: must be those from {ARM_BASE_BODY} to {TIP_SITE} in this order, "
            f"{', '.join(chain)}; got "
            f"{', '.join(joints)}"
        )

    hold_others(spec, joints, "which the mapping does not list")
    for joint_name, limit in joints.items():
        _add_motor(spec, movable[joint_name], limit, name)


def check_followers(spec: mujoco.MjSpec, chain: list[str], name: str) -> None:
    """Refuse an arm with a joint that follows another: each has a motor of its own."""
    for follower, (leader, _) in followed(spec).items():
        if follower in chain:
            raise ConfigurationError(
                f"{name}: joint {follower!r} between {ARM_BASE_BODY} and {TIP_SITE} follows "
                f"{leader!r} (mimic), but each joint of a vehicle's arm has a motor of its own; "
                "the inverse kinematics alone takes it (Chain.from_urdf)"
            )


def hold_others(spec: mujoco.MjSpec, joints: Collection[str], why: str) -> None:
    """Hold all joints that the hull carries but those of the arm and those on springs."""
    hull = next((body for body in spec.bodies if body.name == HULL_BODY), None)
    carried = [] if hull is None else hull.find_all(mujoco.mjtObj.mjOBJ_JOINT)
    others = [
        other
        for other in carried
        if other.type in TURNING and other.name not in joints and not other.stiffness[0]
    ]
    note(spec, hold(spec, others, why))


def bound(spec: mujoco.MjSpec, joints: Collection[str], name: str) -> None:
    """Give the arm's joints that turn without end one turn, for a posture needs a range.

    Raises:
        ConfigurationError: a joint whose lower limit lies above its upper.
    """
    arm = [joint for joint in spec.joints if joint.name in joints]
    for joint in arm:
        if joint.range[0] > joint.range[1]:
            raise ConfigurationError(
                f"{name}: joint {joint.name!r}: its lower limit {joint.range[0]:g} lies above the "
                f"upper {joint.range[1]:g}; exchange them in the file"
            )

    half = 180.0 if spec.compiler.degree else np.pi
    endless = [
        joint
        for joint in arm
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE
        and not np.isfinite(range_of(spec, joint)).all()
    ]
    for joint in endless:
        joint.range = [-half, half]
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    if endless:
        names = ", ".join(joint.name for joint in endless)
        note(spec, [f"joints that turn without end get the range -180 to 180 deg: {names}"])


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
            joint.name for joint in body.joints if joint.type in TURNING and not joint.stiffness[0]
        ]
        body = body.parent
    return names
