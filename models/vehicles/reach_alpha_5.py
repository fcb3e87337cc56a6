"""Reach Alpha 5 (Reach Robotics) from published figures, with four joints and a closed gripper.

Masses, volumes, centres: hkolano/PitchPrediction (MagicNumAlpha.jl, urdf/blue_rov_hardware.urdf),
the simulation that [Kolano 2022] compared with pool trials. The frames of that simulation are used,
since the inertias refer to them. In the manufacturer's URDF with inertias
(edxmorgan/uvms-simulator, floating-KinDyn) the centres of mass lie beside the links. Inertias with
their products: edxmorgan/floating-KinDyn, alpha_5_robot.urdf. Viscous friction: identified there
(usage/alpha_reach.py). All figures were read in other people's code; the manufacturer's data sheet
was not found.

Added mass: the values that Kolano adds to the masses of the links. Here they act across each link
only, since strip theory has no added mass along a link, and in rotation like that of a cylinder
with this mass. Drag: Kolano's coefficients for uniform flow across and along each link, spread
evenly over its length. An earlier version of that file has a thousand times these coefficients,
which is impossible for a link of 40 mm. Torque limits and joint limits are those of the same file.
No rotor inertia was found, so it is zero.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.files.urdf_places import rotation_from_rpy
from uuv.models.hydrodynamics import SEA_WATER, BodyHydrodynamics, StripDrag, cylinder
from uuv.models.naming import ARM_BASE_BODY, HOME_KEY, READY_KEY, TIP_SITE
from uuv.models.vehicles import published_hulls
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation

RADIUS = 0.020  # [m] radius of every link
_GREY = (0.3, 0.3, 0.33, 1.0)
HOME = (0.0, 2.9, 0.4, 0.0)  # [rad] folded posture
READY = (0.0, 1.6, 2.4, 0.0)  # [rad] working posture


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link:
    """One link, in the frame of its joint. The joint axis is z."""

    name: str
    p: tuple[float, float, float]  # [m] position of the frame in the previous one
    # [rad] orientation in the previous frame, roll, pitch, yaw as in a URDF
    rpy: tuple[float, float, float]
    limits: tuple[float, float]  # [rad]
    torque: float  # [N m]
    friction: float  # [N m s/rad]
    mass: float  # [kg]
    center: tuple[float, float, float]  # [m] centre of mass
    inertia: tuple[float, float, float, float, float, float]  # [1e-6 kg m^2] xx, yy, zz, xy, xz, yz
    volume: float  # [1e-3 m^3]
    buoyancy: tuple[float, float, float]  # [m] centre of buoyancy
    added: float  # [kg] added mass across the link
    across: float  # [N s^2/m^2] quadratic drag across the link
    along: float  # [N s^2/m^2] quadratic drag along the link
    start: tuple[float, float, float]  # [m] start of the segment that represents the link
    end: tuple[float, float, float]  # [m] end of the segment


_QUARTER = np.pi / 2

LINKS = (
    _Link(
        name="shoulder",
        p=(0.0, 0.0, 0.0),
        rpy=(0.0, 0.0, 0.0),
        limits=(-3.054, 3.054),
        torque=10.0,
        friction=2.396,
        mass=0.194,
        center=(0.005, -0.001, 0.016),
        inertia=(139.1, 158.49, 61.96, -5.97, -38.48, -6.1),
        volume=0.018,
        buoyancy=(-0.001, -0.003, 0.032),
        added=0.032,
        across=0.26,
        along=0.3,
        start=(0.0, 0.0, -0.023),
        end=(0.0, 0.0, 0.043),
    ),
    _Link(
        name="upper_arm",
        p=(0.020, 0.0, 0.046),
        rpy=(_QUARTER, 1.3, 0.0),
        limits=(0.0, 3.491),
        torque=10.0,
        friction=2.236,
        mass=0.429,
        center=(0.073563, -0.000091, -0.000734),
        inertia=(86.77, 868.23, 891.46, 73.13, -13.16, 0.03),
        volume=0.203,
        buoyancy=(0.073, 0.0, -0.002),
        added=0.201,
        across=1.6,
        along=0.3,
        start=(0.0025, 0.0, 0.0),
        end=(0.1475, 0.0, 0.0),
    ),
    _Link(
        name="elbow",
        p=(0.15, 0.0, 0.0),
        rpy=(np.pi, 0.0, 1.3),
        limits=(0.0, 3.491),
        torque=10.0,
        friction=0.820,
        mass=0.115,
        center=(0.017, -0.026, 0.002),
        inertia=(41.8, 28.3, 45.02, 10.17, 4.91, -5.98),
        volume=0.025,
        buoyancy=(0.003, 0.001, -0.017),
        added=0.032,
        across=0.26,
        along=0.3,
        start=(0.017, -0.006, 0.0),
        end=(0.017, -0.046, 0.0),
    ),
    _Link(
        name="wrist",
        p=(0.020, 0.0, 0.0),
        rpy=(-_QUARTER, 0.0, 0.0),
        limits=(-2.880, 2.880),
        torque=0.6,
        friction=0.357,
        mass=0.333,
        center=(-0.00003, -0.003, -0.098),
        inertia=(507.87, 535.87, 76.0, -1.97, 4.98, 97.9),
        volume=0.155,
        buoyancy=(0.0, 0.0, -0.098),
        added=0.226,
        across=1.8,
        along=0.3,
        start=(0.0, 0.0, 0.0),
        end=(0.0, 0.0, -0.14),
    ),
)
BASE_MASS = 0.341  # [kg]
BASE_CENTER = (-0.075, -0.006, -0.003)  # [m]
BASE_VOLUME = 0.202e-3  # [m^3]
# [1e-6 kg m^2] in the order of `_Link.inertia`
BASE_INERTIA = (83.66, 998.81, 1003.60, 14.45, -38.27, 3.14)
_TIP = (0.0, 0.0, -0.190)  # [m] tip between the jaws, in the wrist frame


def build() -> mujoco.MjSpec:
    """The arm alone, with its base fixed to the world and joint 1 pointing up."""
    spec = published_hulls.new_spec("reach_alpha_5")
    add_arm(spec, spec.worldbody, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    spec.add_key(name=HOME_KEY, qpos=HOME)
    spec.add_key(name=READY_KEY, qpos=READY)
    return spec


def add_arm(
    spec: mujoco.MjSpec, parent: mujoco.MjsBody, p: list[float], quat_wxyz: list[float]
) -> None:
    """Add the arm to `parent`, with its coefficients and motors.

    Args:
        spec: model.
        parent: body on which the arm is mounted.
        p: (3,) [m] position of the base in `parent`.
        quat_wxyz: orientation of the base in `parent`.
    """
    base = parent.add_body(name=ARM_BASE_BODY, pos=p, quat=quat_wxyz)
    published_hulls.set_inertial(base, BASE_MASS, BASE_CENTER, _inertia(BASE_INERTIA))
    published_hulls.add_capsule(
        base, ARM_BASE_BODY, RADIUS, ((-0.13, 0.0, 0.0), (-0.02, 0.0, 0.0)), _GREY
    )

    bodies = {
        ARM_BASE_BODY: replace(
            cylinder(RADIUS, (-0.15, 0.0, 0.0), (0.0, 0.0, 0.0)),
            volume=BASE_VOLUME,
            center_of_buoyancy=BASE_CENTER,
        )
    }

    body = base
    for i, link in enumerate(LINKS, start=1):
        body = body.add_body(
            name=link.name, pos=link.p, quat=quat_wxyz_from_rotation(rotation_from_rpy(link.rpy))
        )
        published_hulls.set_inertial(body, link.mass, link.center, _inertia(link.inertia))
        body.add_joint(
            name=f"joint{i}",
            axis=[0.0, 0.0, 1.0],
            range=link.limits,
            damping=[link.friction, 0.0, 0.0],
        )

        motor = spec.add_actuator(
            name=f"joint{i}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"joint{i}"
        )
        motor.ctrlrange = [-link.torque, link.torque]
        published_hulls.add_capsule(body, link.name, RADIUS, (link.start, link.end), _GREY)
        bodies[link.name] = _water(link)

    body.add_site(
        name=TIP_SITE, pos=_TIP, quat=[0.0, 1.0, 0.0, 0.0], group=4, size=[0.01, 0.01, 0.01]
    )
    hydrodynamics.attach(spec, bodies)


def _water(link: _Link) -> BodyHydrodynamics:
    length = float(np.linalg.norm(np.subtract(link.end, link.start)))
    # [m] radius of the cylinder that has this added mass
    radius = np.sqrt(link.added / (np.pi * SEA_WATER * length))

    return replace(
        cylinder(radius, link.start, link.end),
        volume=1e-3 * link.volume,
        center_of_buoyancy=link.buoyancy,
        strips=StripDrag(
            start=np.array(link.start),
            end=np.array(link.end),
            normal=link.across / length,
            tangential=link.along / length,
        ),
    )


def _inertia(figures: tuple[float, ...]) -> Array:
    xx, yy, zz, xy, xz, yz = figures
    return 1e-6 * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
