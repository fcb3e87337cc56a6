"""RexROV, a work-class vehicle of 1.9 t, with the six joints of an Oberon 7 at its bow.

Hull: the figures of `uuv.models.vehicles.rexrov2.HULL`, which RexROV shares (mass, inertia, added
mass, damping, volume, centre of buoyancy). Thrusters: positions, directions and time constant of
uuv_descriptions/urdf/rexrov_actuators.xacro [Manhaes 2016], which was read. It states no bound of
the thrust; 1500 N is chosen, near the 1540 N of RexROV 2.

Arm: joints, limits, efforts, damping, masses, inertias and shapes of the Oberon 7 of
uuvsimulator/uuv_manipulators, and its place on the hull, as in the robot rexrov_oberon7 of
Field-Robotics-Lab/dave, which was read. Dry friction of that file is left out: in three joints it
is near the effort (150 of 200 N m, 1000 of 1000). Each link displaces a cylinder as long as its
shape there, of a radius that makes the link twice as dense as water. The gripper's fingers
are part of the last link. The rotors' inertia is an estimate: what full torque accelerates to the
rated speed in 2 ms. The camera is chosen.
"""

import math

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import SEA_WATER, sphere
from uuv.models.naming import ARM_BASE_BODY
from uuv.models.tools import attachment
from uuv.models.tools.tools import TOOLS
from uuv.models.vehicles import published_hulls, rexrov2
from uuv.models.vehicles.jointed_links import JointedLink, add_links, add_tip, rotation
from uuv.models.water import thrusters

# Forward, port, up: position [m]; turn about y, then about z [deg], of a thrust along x.
THRUSTERS = (
    ((-0.890895, 0.334385, 0.528822), (-74.53, -53.21)),
    ((-0.890895, -0.334385, 0.528822), (-74.53, 53.21)),
    ((0.890895, 0.334385, 0.528822), (-105.47, 53.21)),
    ((0.890895, -0.334385, 0.528822), (-105.47, -53.21)),
    ((-0.412125, 0.505415, 0.129), (0.0, 45.0)),
    ((-0.412125, -0.505415, 0.129), (0.0, -45.0)),
    ((0.412125, 0.505415, 0.129), (0.0, 135.0)),
    ((0.412125, -0.505415, 0.129), (0.0, -135.0)),
)
_THRUST = 1500.0  # [N] in each direction
_LAG = 0.05  # [s]
_BASE = (1.3, -0.5, -0.615)  # [m]
_BASE_MASS = 9.674677  # [kg]
_BASE_CENTER = (-0.101581, -0.001371, -0.009781)  # [m]
_BASE_INERTIA = np.diag([0.051173, 0.083677, 0.095803])
_DENSITY = 2.0  # of the links, over that of water
_CAMERA = (1.35, 0.0, 0.4)  # [m]
_DOWN = math.radians(42.0)  # [rad] of the camera
_START_UP = 2e-3  # [s] in which a drive reaches its rated speed
_TIP = 0.15  # [m] of the closed fingers' tip along the last joint
_QUARTER = 0.5 * math.pi


def _radius(mass: float, length: float) -> float:
    """Radius [m] of the cylinder that displaces a link's water."""
    return math.sqrt(mass / (_DENSITY * SEA_WATER * math.pi * length))


LINKS = (
    JointedLink(
        name="shoulder_link",
        joint="azimuth",
        p=(0.0, 0.0, 0.0),
        limits=(-1.04719758, 1.04719758),
        torque=200.0,
        damping=100.0,
        rotor=200.0 * _START_UP / 0.17,
        mass=6.722252,
        center=(0.039670, 0.005441, 0.017383),
        inertia=(0.042584, 0.051326, 0.029577),
        radius=_radius(6.722252, 0.239627),
        start=(0.039670, 0.005441, 0.017383 - 0.1198135),
        end=(0.039670, 0.005441, 0.017383 + 0.1198135),
    ),
    JointedLink(
        name="upper_arm",
        joint="shoulder",
        p=(0.06955, 0.00015, 0.01536),
        rpy=(_QUARTER, 0.0, 0.0),
        limits=(-1.57079637, 1.57079637),
        torque=5000.0,
        damping=50.0,
        rotor=5000.0 * _START_UP / 0.17,
        mass=12.4444,
        center=(0.312501, 0.017478, -0.000002),
        inertia=(0.037823, 0.411488, 0.415421),
        radius=_radius(12.4444, 0.616809),
        start=(0.312501 - 0.3084045, 0.017478, 0.0),
        end=(0.312501 + 0.3084045, 0.017478, 0.0),
    ),
    JointedLink(
        name="elbow_link",
        joint="elbow",
        p=(0.55616, -0.01229, 0.0),
        limits=(-1.57079637, 1.04719758),
        torque=300.0,
        damping=50.0,
        rotor=300.0 * _START_UP / 0.15,
        mass=10.314509,
        center=(0.125269, -0.074675, 0.0),
        inertia=(0.071720, 0.072409, 0.102762),
        radius=_radius(10.314509, 0.245312),
        start=(0.125269, -0.074675 - 0.122656, 0.0),
        end=(0.125269, -0.074675 + 0.122656, 0.0),
    ),
    JointedLink(
        name="forearm",
        joint="roll",
        p=(0.1349014, -0.1936267, 0.0),
        rpy=(_QUARTER, 0.0, 0.0),
        limits=(-2.356194555, 2.356194555),
        torque=1000.0,
        damping=300.0,
        rotor=1000.0 * _START_UP / 0.25,
        mass=8.546262,
        center=(0.0, 0.0, 0.157979),
        inertia=(0.096179, 0.096190, 0.032684),
        radius=_radius(8.546262, 0.334827),
        start=(0.0, 0.0, 0.157979 - 0.1674135),
        end=(0.0, 0.0, 0.157979 + 0.1674135),
    ),
    JointedLink(
        name="wrist_link",
        joint="pitch",
        p=(0.0, 0.0, 0.315958),
        rpy=(-_QUARTER, -_QUARTER, 0.0),
        limits=(-1.57079637, 1.57079637),
        torque=50.0,
        damping=10.0,
        rotor=50.0 * _START_UP / 0.3,
        mass=3.902424,
        center=(0.104016, 0.003308, -0.000027),
        inertia=(0.010428, 0.021154, 0.020527),
        radius=_radius(3.902424, 0.219204),
        start=(0.104016 - 0.109602, 0.003308, 0.0),
        end=(0.104016 + 0.109602, 0.003308, 0.0),
    ),
    JointedLink(
        name="end_effector",
        joint="wrist",
        p=(0.19304, 0.0, 0.0),
        rpy=(-_QUARTER, 0.0, 0.0),
        axis=(1.0, 0.0, 0.0),
        limits=(-2.0 * math.pi, 2.0 * math.pi),
        torque=10.0,
        damping=10.0,
        rotor=10.0 * _START_UP / 0.15,
        # the hand, and the two fingers with their tips
        mass=3.461146 + 2.0 * (0.879771 + 1.125505),
        center=(0.0617, 0.0, 0.0),
        inertia=(0.0197, 0.0164, 0.0270),
        radius=_radius(7.471698, 0.15),
        start=(-0.012, 0.0, 0.0),
        end=(0.138, 0.0, 0.0),
    ),
)
HOME = (0.98, 1.48, -1.35, 1.27, 0.0, 0.0)  # [rad] folded
READY = (-0.2, 0.32, -0.47, -0.06, 1.05, 0.0)  # [rad] tool ahead of the bow


def with_oberon_7() -> mujoco.MjSpec:
    """The vehicle with its arm and a pad; ballast compensates the arm's weight."""
    spec = published_hulls.new_spec("rexrov_oberon7")
    hull = published_hulls.add_hull(spec, rexrov2.HULL)
    rexrov2.add_plates(hull)

    names = []
    for i, (p, (y, z)) in enumerate(THRUSTERS):
        R = rotation((0.0, math.radians(y), math.radians(z)))
        names.append(published_hulls.add_thruster(spec, hull, str(i), p, R[:, 0]))
    thruster = thrusters.Thruster(
        forward=_THRUST, reverse=_THRUST, dead_band=0.0, time_constant=_LAG, inflow_loss=0.0
    )
    thrusters.attach(spec, dict.fromkeys(names, thruster))

    published_hulls.add_camera(hull, _CAMERA, _DOWN)

    base = hull.add_body(name=ARM_BASE_BODY, pos=_BASE)
    published_hulls.set_inertial(base, _BASE_MASS, _BASE_CENTER, _BASE_INERTIA)
    displaced = _BASE_MASS / (_DENSITY * SEA_WATER)
    radius = (0.75 * displaced / math.pi) ** (1.0 / 3.0)
    hydrodynamics.attach(spec, {ARM_BASE_BODY: sphere(radius, center=_BASE_CENTER)})

    last = add_links(spec, base, LINKS)
    add_tip(last, _TIP)

    published_hulls.add_keys(spec, HOME, READY)
    published_hulls.ballast(spec)
    attachment.attach(spec, TOOLS.load("pad"))
    return spec
