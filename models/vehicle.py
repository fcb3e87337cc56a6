"""A vehicle in a compiled model: indices, limits, keyframes and thrusters, looked up once."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.arms import gear_friction
from uuv.models.naming import HOME_KEY, READY_KEY, USUAL_NAMES, PartNames, find
from uuv.models.water import thrusters
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, readonly


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vehicle:
    """Indices, limits and postures of one vehicle in one MjModel."""

    hull: int  # index of the body
    hull_qpos: int  # address of the free joint in qpos
    hull_dof: int  # address of the free joint in qvel
    arm_base: int  # index of the body; without an arm that of the hull
    X_BA: Array  # (4, 4) arm base on the hull
    tip: int  # index of the site; -1 without an arm
    joint_names: tuple[str, ...]  # names of driven joints, base to tip; empty without an arm
    joints: np.ndarray  # (n,) joint indices
    qpos: np.ndarray  # (n,) addresses in qpos
    dof: np.ndarray  # (n,) addresses in qvel
    actuators: np.ndarray  # (n,) actuator of each driven joint
    q_limits: Array  # (n, 2) [rad]
    torque_limits: Array  # (n,) [N m]
    # (n,) [kg m^2] inertia of rotor and gear, on the motor's side of the torque sensor
    armature: Array
    # (n,) [N m s/rad] friction in the gear, on the motor's side of the torque sensor
    joint_damping: Array
    # friction of the gears, on the motor's side of the torque sensor
    dry_friction: gear_friction.DryFriction
    q_home: Array  # (n,) [rad] arm folded; the vehicle is trimmed in this posture
    q_ready: Array  # (n,) [rad] initial posture of inverse kinematics
    thruster_actuators: np.ndarray  # (m,) actuator indices
    thruster_table: Array  # (m, ...) rows of uuv.models.water.thrusters
    # (6, m) wrench on the hull at its origin per newton of thrust, in hull axes
    thruster_wrench: Array
    thruster_names: tuple[str, ...]

    @classmethod
    def of(cls, model: mujoco.MjModel, names: PartNames = USUAL_NAMES) -> "Vehicle":
        """The vehicle in a compiled model; with neither `arm_base` nor `tip` it has no arm.

        Args:
            model: compiled model with a vehicle that follows the contract of `uuv.models.naming`.
            names: names of the vehicle's parts in the model.

        Returns:
            The vehicle.

        Raises:
            ConfigurationError: a part is missing, or a joint or actuator of the arm has no limits.
        """
        hull = find(model, mujoco.mjtObj.mjOBJ_BODY, names.hull)
        free = _free_joint(model, hull)

        arm_base = hull
        tip = -1
        joints: list[int] = []
        if _has_arm(model, names):
            arm_base = find(model, mujoco.mjtObj.mjOBJ_BODY, names.arm_base)
            tip = find(model, mujoco.mjtObj.mjOBJ_SITE, names.tip)
            joints = _driven_joints(model, arm_base, tip)

        actuators = np.array([_actuator_of(model, j) for j in joints], dtype=np.int64)
        joint_names = tuple(
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, int(j)) for j in joints
        )
        _check_limits(model, joints, actuators, joint_names)

        qpos = np.asarray(model.jnt_qposadr)[joints]
        dof = np.asarray(model.jnt_dofadr)[joints]
        limits = model.jnt_range[joints]
        thruster_actuators, table = thrusters.read(model)

        return cls(
            hull=hull,
            hull_qpos=int(model.jnt_qposadr[free]),
            hull_dof=int(model.jnt_dofadr[free]),
            arm_base=arm_base,
            X_BA=readonly(body_in_body(model, arm_base, hull)),
            tip=tip,
            # Joints of the arm, base to tip.
            joint_names=joint_names,
            joints=np.array(joints, dtype=np.int64),
            qpos=qpos,
            dof=dof,
            actuators=actuators,
            q_limits=readonly(limits),
            torque_limits=readonly(np.abs(model.actuator_ctrlrange[actuators]).min(axis=1)),
            armature=readonly(np.asarray(model.dof_armature)[dof]),
            joint_damping=readonly(np.asarray(model.dof_damping).reshape(model.nv, -1)[dof, 0]),
            dry_friction=gear_friction.read(model, np.array(joints, dtype=np.int64)),
            q_home=readonly(_keyframe(model, HOME_KEY, model.qpos0)[qpos]),
            q_ready=readonly(
                np.clip(_keyframe(model, READY_KEY, model.qpos0)[qpos], limits[:, 0], limits[:, 1])
            ),
            # Thrusters.
            thruster_actuators=thruster_actuators,
            thruster_table=readonly(table),
            thruster_wrench=readonly(_thruster_wrench(model, hull, thruster_actuators)),
            thruster_names=_names_of(model, thruster_actuators),
        )

    def damping_in(self, model: mujoco.MjModel) -> Array:
        """Viscous friction (n,) [N m s/rad] of the joints, as a view if their indices are
        consecutive.

        With the view, a change of the friction in `model` during a run also reaches the sensors.
        """
        of_dofs = np.asarray(model.dof_damping).reshape(model.nv, -1)[:, 0]
        first = int(self.dof[0]) if len(self.dof) else 0
        view = of_dofs[first : first + len(self.dof)].view()
        view.setflags(write=False)

        neighbours = np.array_equal(self.dof, first + np.arange(len(self.dof)))
        return view if neighbours and view.flags.c_contiguous else self.joint_damping


def thruster_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of a vehicle's thrusters, such as "heave_front": names of the actuators without
    "thruster_".
    """
    return _names_of(model, thrusters.read(model)[0])


def _names_of(model: mujoco.MjModel, actuators: Iterable[int]) -> tuple[str, ...]:
    names = (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, int(a)) for a in actuators)
    return tuple(name.rpartition("/")[2].removeprefix("thruster_") for name in names)


def pose_in_body(model: mujoco.MjModel, site: int, body: int) -> Array:
    """Pose (4, 4) of a site in a body to which it is fixed.

    Args:
        model: compiled model.
        site: index of the site.
        body: index of the body.

    Returns:
        The pose.

    Raises:
        ConfigurationError: `body` does not carry the site, or there is a joint between them.
    """
    X_site = _pose(model.site_pos[site], model.site_quat[site])
    return body_in_body(model, int(model.site_bodyid[site]), body) @ X_site


def body_in_body(model: mujoco.MjModel, body: int, ancestor: int) -> Array:
    """Pose (4, 4) of a body in another to which it is fixed.

    Args:
        model: compiled model.
        body: index of the body.
        ancestor: index of the body that carries it.

    Returns:
        The pose.

    Raises:
        ConfigurationError: `ancestor` does not carry the body, or there is a joint between them.
    """
    X = np.eye(4)
    at = body

    # Up the tree, as long as no joint is in between.
    while at != ancestor:
        if at == 0 or model.body_jntnum[at]:
            raise ConfigurationError(
                f"body {model.body(body).name!r} must be fixed to body "
                f"{model.body(ancestor).name!r}"
            )
        X = _pose(model.body_pos[at], model.body_quat[at]) @ X
        at = int(model.body_parentid[at])
    return X


def _pose(p: Array, quat_wxyz: Array) -> Array:
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quat_wxyz)
    return pose(R.reshape(3, 3), p)


def _keyframe(model: mujoco.MjModel, name: str, default: Array) -> Array:
    """Joint positions `qpos` (nq,) of the named keyframe; `default` where the model has none."""
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, name)
    return model.key_qpos[key] if key >= 0 else default


def _free_joint(model: mujoco.MjModel, hull: int) -> int:
    """The free joint of the hull, or of a body to which a scene has fixed the hull without an
    offset.
    """
    at = hull
    while at and not model.body_jntnum[at]:
        at = int(model.body_parentid[at])

    joint = int(model.body_jntadr[at])
    if (
        at == 0
        or model.body_jntnum[at] != 1
        or int(model.jnt_type[joint]) != mujoco.mjtJoint.mjJNT_FREE
    ):
        raise ConfigurationError(
            f"body {model.body(hull).name!r} must have exactly one joint, a free joint"
        )

    if not np.array_equal(body_in_body(model, hull, at), np.eye(4)):
        raise ConfigurationError(
            f"body {model.body(hull).name!r} must lie on its free joint, without an offset"
        )
    return joint


def _has_arm(model: mujoco.MjModel, names: PartNames) -> bool:
    """True if `model` has a part of an arm."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.arm_base)
    return body >= 0 or mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, names.tip) >= 0


def _driven_joints(model: mujoco.MjModel, base: int, tip: int) -> list[int]:
    """Joints between the body `base` and the site `tip` that have an actuator, base to tip."""
    joints: list[int] = []
    carrier = model.body(base).name
    end = model.site(tip).name

    body = int(model.site_bodyid[tip])
    while body != base:
        if body == 0:
            raise ConfigurationError(
                f"site {end!r} must be on the arm that starts at body {carrier!r}, but that body "
                "does not carry it"
            )
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        joints[:0] = [j for j in range(first, first + count) if _actuator_of(model, j) >= 0]
        body = int(model.body_parentid[body])

    if not joints:
        raise ConfigurationError(
            f"there is no driven joint between body {carrier!r} and site {end!r}; an arm needs at "
            "least one"
        )
    return joints


def _actuator_of(model: mujoco.MjModel, joint: int) -> int:
    """The actuator that drives `joint`, or -1."""
    drives = (np.asarray(model.actuator_trntype) == mujoco.mjtTrn.mjTRN_JOINT) & (
        np.asarray(model.actuator_trnid)[:, 0] == joint
    )
    drivers = np.flatnonzero(drives)
    return int(drivers[0]) if drivers.size else -1


def _check_limits(
    model: mujoco.MjModel, joints: list[int], actuators: np.ndarray, names: tuple[str, ...]
) -> None:
    """Raise ConfigurationError unless each driven joint and its actuator have a range."""
    for joint, actuator, name in zip(joints, actuators, names, strict=True):
        if not model.jnt_limited[joint]:
            raise ConfigurationError(f"joint {name!r} of the arm must have a range")
        if not model.actuator_ctrllimited[actuator]:
            most = float(np.abs(model.actuator_forcerange[actuator]).min())
            known = most if model.actuator_forcelimited[actuator] and most > 0.0 else 10.0
            raise ConfigurationError(
                f"the actuator of joint {name!r} must be a motor with a ctrlrange [N m]; a mapping "
                f"replaces a servo by a motor: joints: {{{name}: {known:g}, ...}}"
            )


def _thruster_wrench(model: mujoco.MjModel, hull: int, actuators: np.ndarray) -> Array:
    """Columns (6, m): wrench at the hull's origin of a unit thrust at each site, with its reaction
    torque.
    """
    B = np.zeros((6, len(actuators)))
    for column, actuator in enumerate(actuators):
        X = pose_in_body(model, int(model.actuator_trnid[actuator, 0]), hull)
        force = X[:3, :3] @ model.actuator_gear[actuator, :3]
        B[:3, column] = force
        B[3:, column] = np.cross(X[:3, 3], force) + X[:3, :3] @ model.actuator_gear[actuator, 3:]
    return B
