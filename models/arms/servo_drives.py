"""MuJoCo model of a serial arm in air whose joints have proportional drives, as small servos do.

A proportional drive holds a load only with an error: torque = stiffness (desired - actual). Under
its own weight the arm therefore rests at other joint values than the commanded ones.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.arms.published_arms import VectorArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose

_REST = 1e-6  # [rad/s] joint speeds of an arm at rest
_LONGEST = 30.0  # [s] within which it must come to rest


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """A hobby servo and the link that it moves.

    The defaults are those of the common 55 g class with a rated torque of 0.94 N m.
    """

    mass: float = 0.075  # [kg] of servo and link together, at the middle of the link
    stiffness: float = 10.8  # [N m/rad] gives the rated torque at an error of 5 deg
    damping: float = 0.5  # [N m s/rad]


def servo_model(arm: VectorArm, servo: Servo, up: tuple[float, float, float]) -> mujoco.MjModel:
    """Arm with a position actuator for each hinge, and a site "tip" whose axes at zero are those of
    the base.

    Args:
        arm: Links and hinge axes.
        servo: Servo of every joint.
        up: Direction against gravity in the base frame.

    Raises:
        ConfigurationError: If a joint of the arm is no hinge.
    """
    if not np.all(np.asarray(arm.p) == 1.0):
        raise ConfigurationError(
            f"{arm.title}: every joint must be a hinge (kind 1) to have a proportional drive, got "
            f"the kinds {arm.p.tolist()}"
        )

    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = -9.81 * np.asarray(up) / np.linalg.norm(up)

    # Links, each with its joint at the end of the link before it.
    body = spec.worldbody
    at = np.zeros(3)
    for i, (link, axis) in enumerate(zip(arm.M, arm.e, strict=True)):
        body = body.add_body(name=f"link{i + 1}", pos=at)
        body.add_joint(
            name=f"joint{i + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, damping=servo.damping
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*np.zeros(3), *link],
            size=[0.012, 0.0, 0.0],
            mass=servo.mass,
            contype=0,
            conaffinity=0,
        )

        actuator = spec.add_actuator(
            name=f"servo{i + 1}", target=f"joint{i + 1}", trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        actuator.set_to_position(kp=servo.stiffness)
        at = np.asarray(link)

    body.add_site(name="tip", pos=at)
    return spec.compile()


def rest(model: mujoco.MjModel, q_wanted: Array) -> Array:
    """Joint angles (n,) [rad] at which the arm rests with its drives set to `q_wanted` (n,) [rad].

    Raises:
        ConfigurationError: If it does not come to rest.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q_wanted
    data.ctrl[:] = q_wanted

    while data.time < _LONGEST:
        mujoco.mj_step(model, data, nstep=50)
        if np.abs(data.qvel).max() < _REST:
            return np.array(data.qpos)
    raise ConfigurationError(f"the arm does not come to rest within {_LONGEST:g} s")


def tip_pose(model: mujoco.MjModel, q: Array) -> Array:
    """Pose (4, 4) of the site "tip" in the base at joint angles `q` (n,) [rad]."""
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    site = data.site("tip")
    return pose(site.xmat.reshape(3, 3), site.xpos)
