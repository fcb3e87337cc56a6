"""PHOENIX with a COMAU SMART-3S, the vehicle of SIMURV 4.0 [Antonelli 2013], without thrusters.

The figures were read in SIAEthen/simurv_unicas: data/data_phoenix_smart3s.m (arm),
func/InverseDynamics_vehicle.m (vehicle). The vehicle follows [Fossen 1994, example B.2], the NPS
AUV of [Healey 1993]. The published figures include no thrusters, so the hull is driven by a wrench,
the actuators `wrench_surge` to `wrench_yaw`.

Added mass: the acceleration derivatives, which with the rigid body give the source's printed matrix
M_v. The Coriolis terms are computed here from that matrix. The source's velocity derivatives (lift
and the like, for a hull under way at 2 m/s) do not apply to a hovering hull and are left out.

Drag in sway, heave, pitch and yaw: the source's cross flow on a block of 0.6 x 1 m, integrated over
the hull's length for motion along one axis. The source integrates from amidships to twice the
distance of the bow, and its drag in heave has the sign that adds energy. MSS (cybergalactic/MSS,
npsauv.m) has since corrected the bounds. Drag in surge: that of a stopped propeller [Healey 1993],
which SIMURV leaves out. There is no drag in roll at rest.

Arm: a cylinder per link; masses, inertias, volumes and added masses as in the source. The added
inertia of a link has L^2, as in the source's code, where strip theory has L^3. Drag across a link
acts on strips, with the coefficient 0.6. How the source applies it, and its linear skin friction of
0.4, could not be read (func/Hydro.m is not public in that copy), so skin friction is zero here.
Joint friction is the source's. The source has no joint limits, torque limits or rotor inertia; the
limits are chosen for this project.
"""

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag, moved_added_mass
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicles import published_hulls
from uuv.models.vehicles.published_hulls import PublishedHull
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, rotation_from_z

LENGTH = 5.3  # [m] of the hull
DENSITY = 1000.0  # [kg/m^3] density for which the source is written
# units of the non-dimensional derivatives
_R2, _R3, _R4, _R5 = (0.5 * DENSITY * LENGTH**n for n in (2, 3, 4, 5))


def _added_mass() -> Array:
    """Added mass (6, 6) of the hull, forward-starboard-down, from non-dimensional derivatives."""
    A = np.zeros((6, 6))
    A[0, 0] = 7.6e-3 * _R3  # -Xudot
    A[1, 1] = 5.5e-2 * _R3  # -Yvdot
    A[2, 2] = 2.4e-1 * _R3  # -Zwdot
    A[1, 3] = -1.2e-4 * _R4  # -Ypdot
    A[1, 5] = -1.2e-3 * _R4  # -Yrdot
    A[2, 4] = 6.8e-3 * _R4  # -Zqdot
    A[3, 3] = 1.0e-3 * _R5  # -Kpdot
    A[3, 5] = 3.4e-5 * _R5  # -Krdot
    A[4, 4] = 1.7e-2 * _R5  # -Mqdot
    A[5, 5] = 3.4e-3 * _R5  # -Nrdot
    return A + np.triu(A, 1).T


def _drag() -> Array:
    """Quadratic damping (6,) of the hull for motion along one axis."""
    # [kg/m^2] drag per length: 0.5 rho C_d h
    sway = 0.5 * DENSITY * 0.5 * 0.6
    heave = 0.5 * DENSITY * 0.6 * 1.0
    third = 2.0 * (LENGTH / 2.0) ** 4 / 4.0  # [m^4] integral of |x|^3 over the length
    surge = 0.00385 * _R2  # Cd0 of [Healey 1993]
    return np.array([surge, sway * LENGTH, heave * LENGTH, 0.0, heave * third, sway * third])


HULL = PublishedHull(
    mass=5454.54,
    center_of_gravity=[0.0, 0.0, 0.061],
    # Ixy = Ixz = Iyz = -13.58
    inertia=[[2038.0, 13.58, 13.58], [13.58, 13587.0, 13.58], [13.58, 13.58, 13587.0]],
    volume=53400.0 / (DENSITY * 9.81),  # printed as a buoyancy of 53 400 N
    center_of_buoyancy=[0.0, 0.0, 0.0],
    added_mass=_added_mass(),
    linear_damping=np.zeros(6),
    quadratic_damping=_drag(),
)

# [m] arm base in the hull, forward-starboard-down; its axes are the hull's axes in the source
BASE = (0.0, 0.0, 1.5)
# Standard DH, theta0 0: a [m], alpha [rad], d [m].
DH = np.array(
    [
        [0.15, -np.pi / 2, 0.0],
        [0.61, 0.0, 0.0],
        [0.11, -np.pi / 2, 0.0],
        [0.0, np.pi / 2, 0.61],
        [0.0, -np.pi / 2, -0.113],
        [0.0, 0.0, 0.103],
    ]
)
MASS = (80.0, 80.0, 30.0, 50.0, 20.0, 25.0)  # [kg]
# [m] radius, length
SIZE = ((0.2, 0.85), (0.1, 1.0), (0.15, 0.2), (0.1, 0.8), (0.15, 0.2), (0.1, 0.3))
AXIS = (1, 0, 1, 1, 1, 2)  # index of the axis of frame i that lies along the link
# [m] centre of mass, and of buoyancy, from the origin of frame i - 1, along the axes of frame i.
CENTER = (
    (0.0, 0.425, 0.0),
    (0.11, 0.0, 0.0),
    (0.055, 0.0, 0.0),
    (0.0, 0.21, 0.0),
    (0.0, 0.055, 0.0),
    (0.0, 0.0, -0.05),
)
# [kg m^2] diagonal, about the centre of mass
INERTIA = 20.0 * np.array(
    [
        [5.0, 1.5, 5.0],
        [1.0, 4.0, 4.0],
        [0.1, 0.025, 0.1],
        [2.5, 0.45, 2.5],
        [0.25, 0.2, 0.25],
        [0.25, 0.25, 0.17],
    ]
)
FRICTION = (30.0, 20.0, 5.0, 10.0, 5.0, 6.0)  # [N m s/rad]
DRAG_COEFFICIENT = 0.6  # drag coefficient of a link across its axis, on the diameter
HOME = np.radians([0.0, -45.0, 0.0, 0.0, 0.0, 0.0])  # q_nominal
_RANGE = (-np.pi, np.pi)  # [rad] joint limits, chosen for this project
# [N m] chosen for this project: about three times the weight moments
_TORQUE = (1500.0, 1500.0, 800.0, 300.0, 200.0, 100.0)


def build() -> mujoco.MjSpec:
    """Vehicle and arm, ballasted in the arm's nominal posture."""
    spec = published_hulls.new_spec("phoenix_smart3s")
    hull = published_hulls.add_hull(spec, HULL)
    hull.add_geom(
        name="hull",
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=[LENGTH / 2.0, 0.7, 0.5],
        mass=0.0,
        contype=1,
        conaffinity=2,
        rgba=[0.93, 0.72, 0.13, 1.0],
    )
    published_hulls.add_wrench(spec, hull)

    # A half turn about x, since in the source the base's axes are the hull's.
    base = hull.add_body(
        name=ARM_BASE_BODY, pos=published_hulls.from_ned(BASE), quat=[0.0, 1.0, 0.0, 0.0]
    )

    bodies: dict[str, BodyHydrodynamics] = {}
    body = base
    for i in range(len(DH)):
        body = _add_link(spec, body, i)
        bodies[body.name] = _water(i)

    body.add_site(name=TIP_SITE, group=4, size=[0.02, 0.02, 0.02])
    hydrodynamics.attach(spec, bodies)
    published_hulls.add_keys(spec, HOME)
    published_hulls.ballast(spec)
    return spec


def _add_link(spec: mujoco.MjSpec, parent: mujoco.MjsBody, i: int) -> mujoco.MjsBody:
    """Add link i to `parent`.

    As in the source, the body frame of a link is the DH frame at the distal end. The joint is at
    the proximal end.
    """
    a, alpha, d = DH[i]
    body = parent.add_body(
        name=f"link{i + 1}",
        pos=[a, 0.0, d],
        quat=[np.cos(alpha / 2.0), np.sin(alpha / 2.0), 0.0, 0.0],
    )
    published_hulls.set_inertial(body, MASS[i], _center(i), np.diag(INERTIA[i]))

    name = f"joint{i + 1}"
    body.add_joint(
        name=name,
        pos=-_offset(i),
        axis=[0.0, np.sin(alpha), np.cos(alpha)],
        range=_RANGE,
        damping=[FRICTION[i], 0.0, 0.0],
    )
    motor = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
    motor.ctrlrange = [-_TORQUE[i], _TORQUE[i]]

    # Shape, for contact and rendering.
    radius, length = SIZE[i]
    R = rotation_from_z(np.eye(3)[AXIS[i]], np.eye(3)[AXIS[i] - 1])
    body.add_geom(
        name=body.name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, length / 2.0, 0.0],
        pos=_center(i),
        quat=quat_wxyz_from_rotation(R),
        mass=0.0,
        contype=1,
        conaffinity=2,
        rgba=[0.85, 0.87, 0.9, 1.0],
    )
    return body


def _water(i: int) -> BodyHydrodynamics:
    radius, length = SIZE[i]
    along = np.eye(3)[AXIS[i]]
    center = _center(i)
    volume = np.pi * radius**2 * length

    translation = np.where(along > 0.0, 0.1 * MASS[i], DENSITY * volume)
    rotation = np.where(along > 0.0, 0.0, np.pi * DENSITY * radius**2 * length**2 / 12.0)

    return BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=center,
        added_mass=moved_added_mass(np.diag([*translation, *rotation]), np.eye(3), center),
        strips=StripDrag(
            start=center - 0.5 * length * along,
            end=center + 0.5 * length * along,
            normal=0.5 * DENSITY * DRAG_COEFFICIENT * 2.0 * radius,
        ),
    )


def _offset(i: int) -> Array:
    """Offset (3,) [m] from the origin of frame i - 1 to that of frame i, in axes of frame i."""
    a, alpha, d = DH[i]
    return np.array([a, d * np.sin(alpha), d * np.cos(alpha)])


def _center(i: int) -> Array:
    """Centre of mass (3,) [m] of link i in its frame."""
    return np.array(CENTER[i]) - _offset(i)
