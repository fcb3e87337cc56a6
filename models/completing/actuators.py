"""Actuators of a user's vehicle: motors of its arm and thrusters. All other joints are held.

actuate(spec, file, renamed)
"""

from collections.abc import Collection, Iterable, Mapping, Sequence

import mujoco
import numpy as np

from uuv.models.completing.postures import set_posture
from uuv.models.files.holding import TURNING, followed, hold, range_of
from uuv.models.files.notes import note
from uuv.models.files.parts_file import MappedThruster, PartsMap
from uuv.models.files.vehicle_file import VehicleFile
from uuv.models.naming import ARM_BASE_BODY, HOME_KEY, HULL_BODY, READY_KEY, TIP_SITE
from uuv.models.water import thrusters
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, rotation_from_z

# [s] in which full torque accelerates a rotor alone to the joint's rated speed; a prior
START_UP = 2e-3
_SPEED = 1.0  # [rad/s] or [m/s] of a joint whose file states no speed
# cosine between axis and thrust from which on the joint is taken for that of the propeller
_PARALLEL = 0.99
_AHEAD = (1.0, 0.0, 0.0)


def actuate(spec: mujoco.MjSpec, file: VehicleFile, renamed: Mapping[str | None, str]) -> None:
    """Give a vehicle its motors and thrusters, in place; the arm its ranges, rotors and postures.

    Args:
        spec: model of the file, whose parts have the names of the contract.
        file: description of the vehicle, with its mapping.
        renamed: present names of bodies by their names in the file.

    Raises:
        ConfigurationError: a joint, or a thruster's place, is not in the model or cannot be used.
    """
    parts = file.parts or PartsMap()
    name = file.parts_name
    turning = {
        joint.parent.name: (joint.name, np.array(joint.axis))
        for joint in spec.joints
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE
    }

    arm = joints_between(spec)
    _check_followers(spec, arm, name)

    if parts.torque_limits is not None:
        _drive(spec, parts.torque_limits, name)
        arm = list(parts.torque_limits)
    else:
        add_motors(spec, arm, file.name)
        if file.bare:
            _hold_others(spec, arm, "which no actuator drives")

    bound(spec, arm, file.name)
    note(spec, _give_armature(spec, arm, parts.armature, file.speeds, name))
    for key, values in ((HOME_KEY, parts.home), (READY_KEY, parts.ready)):
        if values is not None:
            set_posture(spec, key, arm, values, f"{name}: {key}")

    for thruster in parts.thrusters or file.thrusters:
        _add_thruster(spec, thruster, renamed, name)
        place = thruster.place
        joint, axis = turning.get("" if place is None else place.body, ("", np.zeros(3)))

        if place is not None and joint and abs(float(axis @ place.z)) < _PARALLEL:
            note(
                spec,
                [
                    f"thruster {thruster.name} turns with joint {joint!r}, which is held, so its "
                    "direction is fixed"
                ],
            )


def _drive(spec: mujoco.MjSpec, joints: Mapping[str, float | None], name: str) -> None:
    """Give each joint of the arm one motor with gear 1 and a torque limit; hold the other joints.

    The other joints are all those of the vehicle except those on springs: joints of a second arm,
    of a gripper, of a camera's pan.
    """
    movable = {joint.name: joint for joint in spec.joints if joint.type in TURNING}

    for joint_name in joints:
        if joint_name not in movable:
            raise part_missing(name, "joint", joint_name, list(movable))

    # The mapping must list all joints of the arm, in order.
    chain = joints_between(spec)
    _check_followers(spec, chain, name)
    listed = [joint for joint in chain if joint in joints]

    if listed != list(joints):
        raise ConfigurationError(
            f"{name}: joints: must list all joints from {ARM_BASE_BODY} to {TIP_SITE} in this "
            f"order: {', '.join(chain)}; got {', '.join(joints)}"
        )

    _hold_others(spec, joints, "which the mapping does not list")
    for joint_name, limit in joints.items():
        _add_motor(spec, movable[joint_name], limit, name)


def _check_followers(spec: mujoco.MjSpec, chain: list[str], name: str) -> None:
    """Refuse an arm in which a joint follows another, since each joint needs a motor of its own."""
    for follower, (leader, _) in followed(spec).items():
        if follower in chain:
            raise ConfigurationError(
                f"{name}: joint {follower!r} between {ARM_BASE_BODY} and {TIP_SITE} follows "
                f"{leader!r} (mimic), but each joint of a vehicle's arm has a motor of its own; "
                "only the inverse kinematics accepts such an arm (Chain.from_urdf)"
            )


def _hold_others(spec: mujoco.MjSpec, joints: Collection[str], why: str) -> None:
    """Hold all joints of the vehicle except those of the arm and those on springs."""
    hull = next((body for body in spec.bodies if body.name == HULL_BODY), None)
    carried = [] if hull is None else hull.find_all(mujoco.mjtObj.mjOBJ_JOINT)
    others = [
        other
        for other in carried
        if other.type in TURNING and other.name not in joints and not other.stiffness[0]
    ]

    note(spec, hold(spec, others, why))


def bound(spec: mujoco.MjSpec, joints: Collection[str], name: str) -> None:
    """Limit the arm's endless joints to one turn, since the search of postures needs a range.

    Raises:
        ConfigurationError: a joint whose lower limit lies above its upper.
    """
    arm = [joint for joint in spec.joints if joint.name in joints]

    for joint in arm:
        if joint.range[0] > joint.range[1]:
            raise ConfigurationError(
                f"{name}: joint {joint.name!r}: its lower limit {joint.range[0]:g} is above its "
                f"upper limit {joint.range[1]:g}; exchange them in the file"
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
    """Drive a joint by a motor with gear 1, in place of any other actuator of the joint.

    Args:
        spec: model.
        joint: of the arm.
        limit: [N m] of the motor; None: the limit of the joint's actuator, or its
            `actuatorfrcrange`, which is the effort of a URDF.
        name: first words of error messages.

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
                f"{name}: joint {joint.name!r} has no torque limit (URDF: <limit effort>); state "
                f"it in the mapping, joints: {{{joint.name}: 10}} [N m]"
            )

        limit = float(known[0])

    # One motor replaces what drove the joint.
    for actuator in actuators:
        spec.delete(actuator)
    # the motor's control range limits the torque
    joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    motor = spec.add_actuator(name=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
    motor.ctrlrange = [-limit, limit]
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE


def add_motors(spec: mujoco.MjSpec, joints: Iterable[str], name: str) -> None:
    """Add motors to those of `joints` that no actuator drives, limited to the effort of the URDF.

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


def _give_armature(
    spec: mujoco.MjSpec,
    joints: Sequence[str],
    stated: float | Mapping[str, float] | None,
    speeds: Mapping[str, float],
    name: str,
) -> list[str]:
    """Give joints the inertia of their rotors, in place: the stated one, or a prior for light
    joints.

    A joint is light if full torque accelerates it beyond its rated speed within one time step. No
    real drive does so: the file then states no rotor inertia, and the servo would chatter. The
    prior is the rotor inertia that full torque accelerates to that speed in 2 ms.

    Args:
        spec: model whose joints have motors.
        joints: names, base to tip.
        stated: [kg m^2] or [kg], one number for all joints or one for each; None: the prior.
        speeds: [rad/s] or [m/s] rated, by joint.
        name: first words of error messages.

    Returns:
        A line about what was added.

    Raises:
        ConfigurationError: an inertia is stated for a joint that the arm does not have.
    """
    of_joints = stated if isinstance(stated, Mapping) else dict.fromkeys(joints, stated)
    if unknown := [joint for joint in of_joints if joint not in joints]:
        raise ConfigurationError(
            f"{name}: armature: unknown joint {unknown[0]!r}; the arm has "
            f"{', '.join(joints) or 'no joints'}{did_you_mean(unknown[0], joints)}"
        )

    for joint in joints:
        if (armature := of_joints.get(joint)) is not None:
            spec.joint(joint).armature = armature

    left = [joint for joint in joints if of_joints.get(joint) is None]
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

        speed = speeds.get(joint) or _SPEED
        if torque * model.opt.timestep > speed * inertia:
            added[joint] = torque * START_UP / speed
            spec.joint(joint).armature = added[joint]

    if not added:
        return []
    figures = ", ".join(f"{joint} {armature:.2g}" for joint, armature in added.items())

    return [
        "assumed rotor inertia of light joints (effort times 2 ms over speed; state it by "
        f"`armature:` in the mapping) [kg m^2]: {figures}"
    ]


def _add_thruster(
    spec: mujoco.MjSpec, mapped: MappedThruster, renamed: Mapping[str | None, str], name: str
) -> None:
    """Add a thruster, or give an existing actuator of the model the table of a thruster.

    Args:
        spec: a user's model.
        mapped: the thruster.
        renamed: present names of bodies by their names in the file.
        name: first words of error messages.

    Raises:
        ConfigurationError: its actuator, site or body is not in the model.
    """
    actuators = {actuator.name: actuator for actuator in spec.actuators}

    # An actuator of the model.
    if mapped.actuator is not None:
        if mapped.actuator not in actuators:
            raise part_missing(name, "actuator", mapped.actuator, list(actuators))
        _make_plain(actuators[mapped.actuator])
        thrusters.attach(spec, {mapped.actuator: mapped.thruster})
        return

    # A site, of the model or added.
    site = mapped.site
    if mapped.place is not None:
        site = f"thruster_{mapped.name}"
        carrier = renamed.get(mapped.place.body, mapped.place.body) or HULL_BODY
        bodies = {body.name: body for body in spec.bodies if body.name != "world"}
        if carrier not in bodies:
            raise part_missing(name, "body", carrier, list(bodies))
        bodies[carrier].add_site(
            name=site, pos=mapped.place.pos, quat=_along_x(mapped.place.z), group=4
        )
    elif site not in {present.name for present in spec.sites}:
        raise part_missing(name, "site", str(site), [present.name for present in spec.sites])

    actuator = spec.add_actuator(
        name=f"thruster_{mapped.name}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site
    )

    along = np.array(_AHEAD)
    if mapped.place is None and mapped.axis is not None:
        along = mapped.axis
    actuator.gear = [*along, 0.0, 0.0, 0.0]
    thrusters.attach(spec, {actuator.name: mapped.thruster})


def _make_plain(actuator: mujoco.MjsActuator) -> None:
    """Turn an actuator on a site into a motor whose control is the thrust [N]. The mapping sets
    limits and curve.
    """
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


def part_missing(name: str, kind: str, part: str, present: list[str]) -> ConfigurationError:
    """Error about a part of a kind that a model does not have; `name` begins its message."""
    return ConfigurationError(
        f"{name}: the model has no {kind} {part!r}; it has "
        f"{', '.join(filter(None, present)) or 'none with a name'}{did_you_mean(part, present)}"
    )
