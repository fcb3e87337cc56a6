"""Arms from tables of links: masses, joints and shapes as a URDF states them.

Links are cylinders or spheres in the water (`uuv.models.hydrodynamics.cylinder`, `sphere`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import TIP_SITE
from uuv.models.vehicles import published_hulls
from uuv.sim.interfaces.spatial import Array, exp_so3, quat_wxyz_from_rotation

_GREY = (0.3, 0.3, 0.33, 1.0)
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointedLink:
    """A link in the frame of its joint, and the joint in the frame of the link before."""

    name: str
    joint: str
    p: Triple  # [m] position of the joint
    rpy: Triple = (0.0, 0.0, 0.0)  # [rad] its orientation, about fixed x, then y, then z
    axis: Triple = (0.0, 0.0, 1.0)  # of the joint
    limits: tuple[float, float]  # [rad]
    torque: float  # [N m]
    damping: float  # [N m s/rad]
    stiction: float = 0.0  # [N m] dry friction
    rotor: float  # [kg m^2] behind the gear
    mass: float  # [kg]
    center: Triple  # [m] centre of mass
    inertia: Triple  # [kg m^2] about it, along the link's axes
    radius: float  # [m] of the cylinder that displaces the link's water
    start: Triple  # [m] its ends
    end: Triple


def rotation(rpy: Triple) -> Array:
    """Rotation (3, 3) of a URDF's roll, pitch, yaw [rad]."""
    roll, pitch, yaw = rpy
    return exp_so3([0.0, 0.0, yaw]) @ exp_so3([0.0, pitch, 0.0]) @ exp_so3([roll, 0.0, 0.0])


def add_links(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, links: Sequence[JointedLink]
) -> mujoco.MjsBody:
    """Add links to the arm's base, with their motors and coefficients.

    Args:
        spec: model.
        base: body that carries the first link.
        links: base to tip.

    Returns:
        The body of the last link.
    """
    body = base
    water: dict[str, BodyHydrodynamics] = {}

    for link in links:
        body = body.add_body(
            name=link.name, pos=link.p, quat=quat_wxyz_from_rotation(rotation(link.rpy))
        )
        published_hulls.set_inertial(body, link.mass, link.center, np.diag(link.inertia))
        body.add_joint(
            name=link.joint,
            axis=link.axis,
            range=link.limits,
            damping=[link.damping, 0.0, 0.0],
            frictionloss=link.stiction,
            armature=link.rotor,
        )

        motor = spec.add_actuator(
            name=link.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=link.joint
        )
        motor.ctrlrange = [-link.torque, link.torque]
        published_hulls.add_capsule(body, link.name, link.radius, _drawn(link), _GREY)
        water[link.name] = cylinder(link.radius, link.start, link.end)

    hydrodynamics.attach(spec, water)
    return body


def add_tip(last: mujoco.MjsBody, away: float) -> None:
    """Add the tip `away` [m] along x of the last link, its z axis along x."""
    last.add_site(
        name=TIP_SITE,
        pos=[away, 0.0, 0.0],
        quat=quat_wxyz_from_rotation(rotation((0.0, 0.5 * np.pi, 0.0))),
        group=4,
        size=[0.01, 0.01, 0.01],
    )


def _drawn(link: JointedLink) -> tuple[Array, Array]:
    """Ends of a capsule as long as the cylinder, its round ends included."""
    start = np.array(link.start)
    end = np.array(link.end)
    length = float(np.linalg.norm(end - start))
    inset = min(link.radius, 0.45 * length) * (end - start) / length
    return start + inset, end - inset
