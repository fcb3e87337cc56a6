"""Perturbation of the arm: gears that twist under load, and have backlash."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.files.keyframes import keyframes_kept
from uuv.models.naming import READY_KEY
from uuv.perturbations.pad import RESTLESS, first_coefficient
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number

TWIST = "_twist"  # suffixes of a joint's name for the joint and the tendon of its gear's twist


@dataclass(frozen=True, kw_only=True)
class ElasticGears(Perturbation):
    """Torsional spring with backlash between each motor and its link; the encoders are on the
    motor's side.

    Each link gets a second, passive hinge on the axis of its joint: the gear's twist. It is held by
    a spring with a dead band, a tendon of MuJoCo with a range of spring lengths. Motor inertia and
    friction stay on the joint itself.
    """

    # [N m/rad] stiffness of the strongest joint's gear; others in proportion to their torque limits
    stiffness: float = 3e4
    backlash: float = 0.0  # [rad] backlash of each gear, from stop to stop
    # damping of each gear, as a share of the critical damping for its link alone
    damping: float = 0.05

    def __post_init__(self) -> None:
        finite_number(self.stiffness, "ElasticGears stiffness [N m/rad]", above=0.0)
        finite_number(self.backlash, "ElasticGears backlash [rad]", least=0.0, most=0.1)
        finite_number(self.damping, "ElasticGears damping", least=0.0)

    def on_vehicle(self, spec: mujoco.MjSpec, rng: np.random.Generator) -> Mapping[str, float]:
        """Add the gears' twist, and shorten the timestep to the value that its vibration
        requires.
        """
        actuators = {actuator.target: actuator for actuator in spec.actuators}
        joints = [joint for joint in spec.joints if joint.name in actuators]
        if not joints:
            raise ConfigurationError(
                "ElasticGears: the vehicle must have driven joints, it has none"
            )
        limits = np.array(
            [np.abs(np.array(actuators[joint.name].ctrlrange)).max() for joint in joints]
        )

        stiffness = self.stiffness * limits / limits.max()
        with keyframes_kept(spec):
            for joint, k in zip(joints, stiffness, strict=True):
                name = joint.name + TWIST
                twist = joint.parent.add_joint(
                    name=name, type=joint.type, axis=joint.axis, pos=joint.pos
                )
                twist.limited = mujoco.mjtLimited.mjLIMITED_FALSE
                # set explicitly, in case the vehicle's default class has another value
                twist.armature = twist.frictionloss = 0.0
                spring = spec.add_tendon(
                    name=name, springlength=[-0.5 * self.backlash, 0.5 * self.backlash]
                )
                spring.stiffness = first_coefficient(spring.stiffness, k)
                spring.wrap_joint(name, 1.0)

        inertia = _inertia(spec, [joint.name + TWIST for joint in joints])
        for joint, k, inertia_j in zip(joints, stiffness, np.diag(inertia), strict=True):
            twist = spec.joint(joint.name + TWIST)
            twist.damping = first_coefficient(
                twist.damping, 2.0 * self.damping * np.sqrt(k * inertia_j)
            )

        # Fastest vibration of the twists against each other, and against links and motors that are
        # free to move.
        root = np.sqrt(stiffness)
        # [rad^2/s^2]
        fastest = float(np.linalg.eigvalsh(root[:, None] * np.linalg.inv(inertia) * root).max())

        timestep = float(spec.option.timestep)
        spec.option.timestep = timestep / np.ceil(
            max(1.0, timestep * np.sqrt(fastest / RESTLESS)) - 1e-9
        )
        return {"gear_stiffness": self.stiffness, "backlash": self.backlash}


def _inertia(spec: mujoco.MjSpec, joints: list[str]) -> Array:
    """Inertia matrix (n, n) [kg m^2] of hinges in `ready`, with all other joints free to move."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, READY_KEY)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_fwdPosition(model, data)

    dof = [int(model.jnt_dofadr[model.joint(name).id]) for name in joints]
    response = np.empty((len(dof), model.nv))
    mujoco.mj_solveM(model, data, response, np.eye(model.nv)[dof])
    return np.asarray(np.linalg.inv(response[:, dof]), dtype=np.float64)
