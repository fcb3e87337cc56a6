"""RexROV 2, a work-class vehicle of 1.9 t, with an arm of seven joints under its bow.

Hull and thrusters are those of the package rexrov2 of [Manhaes 2016], which states the added mass
and damping of [Berg 2012]. All figures were read in that package (rexrov2_base.xacro,
rexrov2.gazebo.xacro, rexrov2_actuators.xacro, thruster_manager.yaml). One entry of the added mass
is printed as 10.775, the symmetric entry as 10.774; their mean is used. Added mass and damping are
assumed to be in axes forward, starboard, down. Inertia and positions of the package are in axes
forward, port, up; the inertia is converted to the other axes here. The propellers' time constant is
an estimate.

The vehicle of that package carries an Oberon, whose figures were not found. The arm here has the
kinematics, joint limits and torques of the KUKA LBR iiwa 7 R800 (`uuv.models.arms.published_arms`,
KUKA's technical data) and a pad. Its links are cylinders. Their masses are estimates that add up to
the 24 kg of that arm. No such arm is sold for use under water; it is an example of an arm of seven
joints. The camera looks down past the bow.
"""

import math
from typing import cast

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.arms import published_arms
from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.tools import attachment
from uuv.models.tools.tools import TOOLS
from uuv.models.vehicles import published_hulls
from uuv.models.vehicles.published_hulls import PublishedHull
from uuv.models.water import thrusters
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, quat_wxyz_from_rotation

HULL = PublishedHull(
    mass=1862.87,
    center_of_gravity=[0.0, 0.0, 0.0],
    inertia=[[525.39, -1.44, -33.41], [-1.44, 794.20, 2.6], [-33.41, 2.6, 691.23]],
    volume=1.83826,
    center_of_buoyancy=[0.0, 0.0, -0.3],
    added_mass=[
        [779.79, -6.8773, -103.32, 8.5426, -165.54, -7.8033],
        [-6.8773, 1222.0, 51.29, 409.44, -5.8488, 62.726],
        [-103.32, 51.29, 3659.9, 6.1112, -386.42, 10.7745],
        [8.5426, 409.44, 6.1112, 534.9, -10.027, 21.019],
        [-165.54, -5.8488, -386.42, -10.027, 842.69, -1.1162],
        [-7.8033, 62.726, 10.7745, 21.019, -1.1162, 224.32],
    ],
    linear_damping=[74.82, 69.48, 728.4, 268.8, 309.77, 105.0],
    quadratic_damping=[748.22, 992.53, 1821.01, 672.0, 774.44, 523.27],
)
# Forward, port, up: position [m]; turn about y, then about z [deg], of a thrust along x.
_THRUSTERS = (
    ((0.4878, 0.0, 0.2373), (0.0, 90.0)),
    ((-0.8217, 0.0, 0.589), (-75.0, 0.0)),
    ((0.8654, -0.5322, 0.5332), (-67.5, 90.0)),
    ((0.8654, 0.5322, 0.5332), (67.5, 90.0)),
    ((-0.7076, 0.5129, 0.2404), (0.0, 25.0)),
    ((-0.7076, -0.5129, 0.2404), (0.0, -25.0)),
)
_THRUST = 1540.0  # [N] in each direction
_LAG = 0.2  # [s]
# Plates of the frame: position of the middle and half edges [m].
_PLATES = {
    "bottom": ((0.0, 0.0, -0.75), (1.28, 0.75, 0.05)),
    "top": ((0.0, 0.0, 0.6), (1.28, 0.75, 0.2)),
    "port": ((-0.2, 0.7, -0.15), (1.1, 0.05, 0.55)),
    "starboard": ((-0.2, -0.7, -0.15), (1.1, 0.05, 0.55)),
}
_BASE = (1.1, 0.0, -0.82)  # [m] position of the arm's base, with the first axis pointing down
_CAMERA = (1.3, 0.0, -0.6)  # [m]
_DOWN = math.radians(35.0)  # [rad] of the camera
_TORQUES = (176.0, 176.0, 110.0, 110.0, 110.0, 40.0, 40.0)  # [N m]
# [kg] together with the water that they displace; the links sink
_MASSES = (4.0, 4.0, 3.5, 3.5, 3.5, 3.5, 1.0)
_RADII = (0.07, 0.065, 0.06, 0.055, 0.05, 0.05, 0.03)  # [m]
_ROTOR = 0.3  # [kg m^2] of every joint
_FRICTION = 2.0  # [N m s/rad]
HOME = (0.0, -1.5, 0.0, -2.0, 0.0, 1.0, 0.0)  # [rad] folded under the hull
READY = (0.0, 0.3, 0.0, -1.6, 0.0, -1.4, 0.0)  # [rad] tool ahead of the bow, pointing down


def with_arm_7() -> mujoco.MjSpec:
    """The vehicle with its arm and a pad."""
    spec = published_hulls.new_spec("rexrov2_arm7")
    hull = published_hulls.add_hull(spec, HULL)
    add_plates(hull)

    # Thrusters act along x of their sites.
    turned = (
        exp_so3([0.0, 0.0, math.radians(z)]) @ exp_so3([0.0, math.radians(y), 0.0])
        for _, (y, z) in _THRUSTERS
    )
    names = [
        published_hulls.add_thruster(spec, hull, str(i), p, R[:, 0])
        for i, ((p, _), R) in enumerate(zip(_THRUSTERS, turned, strict=True))
    ]
    thruster = thrusters.Thruster(
        forward=_THRUST, reverse=_THRUST, dead_band=0.0, time_constant=_LAG, inflow_loss=0.0
    )
    thrusters.attach(spec, dict.fromkeys(names, thruster))

    published_hulls.add_camera(hull, _CAMERA, _DOWN)

    _add_arm(spec, hull)
    published_hulls.add_keys(spec, HOME, READY)
    published_hulls.ballast(spec)
    attachment.attach(spec, TOOLS.load("pad"))
    return spec


def add_plates(hull: mujoco.MjsBody) -> None:
    """Add the plates of the frame, which RexROV has too."""
    for name, (middle, half) in _PLATES.items():
        hull.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=middle,
            size=half,
            mass=0.0,
            contype=1,
            conaffinity=2,
            rgba=[0.93, 0.72, 0.13, 1.0],
        )


def _add_arm(spec: mujoco.MjSpec, hull: mujoco.MjsBody) -> None:
    """Add the arm of seven joints, with its coefficients and motors."""
    base = hull.add_body(name=ARM_BASE_BODY, pos=_BASE, quat=[0.0, 1.0, 0.0, 0.0])
    published_hulls.set_inertial(base, 3.0, [0.0, 0.0, 0.05], 0.01 * np.eye(3))
    water: dict[str, BodyHydrodynamics] = {
        ARM_BASE_BODY: cylinder(0.08, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1))
    }

    # Links from the published table, each in the frame of the previous one.
    arm = published_arms.load("iiwa7")
    body = base
    X = np.eye(4)
    for i, (theta, d, a, alpha, _) in enumerate(arm.table):
        name = f"link{i + 1}"
        joint = f"joint{i + 1}"
        body = body.add_body(name=name, pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3]))
        body.add_joint(
            name=joint,
            axis=[0.0, 0.0, 1.0],
            range=arm.limits[i],
            damping=[_FRICTION, 0.0, 0.0],
            armature=_ROTOR,
        )
        motor = spec.add_actuator(name=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
        motor.ctrlrange = [-_TORQUES[i], _TORQUES[i]]

        # A cylinder along the link, or a short cylinder about the joint.
        r = _RADII[i]
        mass = _MASSES[i]
        start = (0.0, 0.0, 0.0 if d else -r)
        end = (0.0, 0.0, d or r)
        length = max(d, 2.0 * r)
        across = mass * (3.0 * r**2 + length**2) / 12.0
        published_hulls.set_inertial(
            body, mass, [0.0, 0.0, 0.5 * d], np.diag([across, across, 0.5 * mass * r**2])
        )
        if d:
            published_hulls.add_capsule(body, name, r, (start, end), (0.85, 0.87, 0.9, 1.0))
        water[name] = cylinder(r, start, end)
        X = _row(theta, d, a, alpha)

    body.add_site(
        name=TIP_SITE,
        pos=X[:3, 3],
        quat=quat_wxyz_from_rotation(X[:3, :3]),
        group=4,
        size=[0.01, 0.01, 0.01],
    )
    hydrodynamics.attach(spec, water)


def _row(theta: float, d: float, a: float, alpha: float) -> Array:
    """Pose (4, 4) of the next joint from a Denavit-Hartenberg row at zero."""
    R = cast(Array, exp_so3([0.0, 0.0, theta]) @ exp_so3([alpha, 0.0, 0.0]))
    return pose(R, [a * math.cos(theta), a * math.sin(theta), d])
