"""Girona 500 (University of Girona) with five thrusters and the four joints of an ARM 5E.

Hull and thrusters: underwater_vehicle_dynamics/config/dynamics_g500.yaml of
uji-ros-pkg/underwater_simulation (UWSim), which was read: mass, inertia, centre of gravity, radius
of the sphere that displaces the hull's water, added mass, damping, thrust and lag, lever arms of
the thrusters. Its axes are forward, starboard, down. It has no added inertia in rotation. Each
thruster has 153.8 N either way: the factor 6.835e-5 N s^2 times the square of 1500 1/s. Nothing
drives roll; weight and buoyancy right it.

Arm: joint frames of uwsim/data/scenes/g500ARM5.urdf of the same repository, which was read. It has
neither masses, limits nor efforts. All these are estimates: links that weigh more than the water
that they displace, joint limits that keep the arm before the hull, and torques that lift 12 kg at
full reach. Place of the arm, shapes of hull and links, and the camera are chosen.
"""

import math

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import cylinder
from uuv.models.naming import ARM_BASE_BODY
from uuv.models.vehicles import published_hulls
from uuv.models.vehicles.jointed_links import JointedLink, add_links, add_tip
from uuv.models.vehicles.published_hulls import PublishedHull
from uuv.models.water import thrusters

_MASS = 98.0  # [kg]
_RADIUS = 0.286  # [m] of the sphere that displaces the hull's water
HULL = PublishedHull(
    mass=_MASS,
    center_of_gravity=[0.0, 0.0, 0.05],
    inertia=np.diag([8.0, 8.0, 8.0]),
    volume=4.0 / 3.0 * math.pi * _RADIUS**3,
    center_of_buoyancy=[0.0, 0.0, 0.0],
    added_mass=np.diag([49.0, 49.0, 49.0, 0.0, 0.0, 0.0]),
    linear_damping=[0.0, 0.0, 0.0, 130.0, 130.0, 130.0],
    quadratic_damping=[148.0, 148.0, 148.0, 180.0, 180.0, 180.0],
)
THRUST = 6.835e-5 * 1500.0**2  # [N] in each direction
_LAG = 0.2  # [s]
# Forward, starboard, down: position [m], direction of positive thrust. Only the lever arms 0.4 m of
# yaw and 0.35 m of pitch are published.
_AHEAD = (1.0, 0.0, 0.0)
_UP = (0.0, 0.0, -1.0)
THRUSTERS = {
    "surge_port": ((0.0, -0.4, 0.0), _AHEAD),
    "surge_starboard": ((0.0, 0.4, 0.0), _AHEAD),
    "heave_stern": ((-0.35, 0.0, 0.0), _UP),
    "heave_bow": ((0.35, 0.0, 0.0), _UP),
    "sway": ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}
# The three tubes of the hull, forward, port, up: position of the middle [m], half length, radius.
_TUBES = {
    "lower": ((-0.05, 0.0, -0.28), 0.45, 0.13),
    "port": ((-0.05, 0.3, 0.28), 0.6, 0.14),
    "starboard": ((-0.05, -0.3, 0.28), 0.6, 0.14),
}
_FRAMES = (0.25, -0.35)  # [m] of the two upright frames that join them
_BASE = (0.5, 0.0, -0.28)  # [m] of the arm, forward, port, up
_CAMERA = (0.62, 0.0, 0.3)  # [m]
_DOWN = math.radians(25.0)  # [rad] of the camera

_ORANGE = (0.94, 0.55, 0.12, 1.0)
_LINKS = (
    JointedLink(
        name="slew_link",
        joint="slew",
        p=(0.0, 0.0, 0.0),
        axis=(0.0, 0.0, 1.0),
        limits=(-1.2, 1.2),
        torque=100.0,
        damping=10.0,
        rotor=0.2,
        mass=5.0,
        center=(0.04, 0.0, -0.065),
        inertia=(0.02, 0.02, 0.02),
        radius=0.06,
        start=(0.04, 0.0, 0.0),
        end=(0.04, 0.0, -0.15),
    ),
    JointedLink(
        name="upper_arm",
        joint="shoulder",
        p=(0.077, 0.0, -0.130),
        rpy=(0.0, -0.209, 0.0),
        axis=(0.0, 1.0, 0.0),
        limits=(-1.2, 1.4),
        torque=180.0,
        damping=10.0,
        rotor=0.3,
        mass=9.0,
        center=(0.22, 0.0, 0.0),
        inertia=(0.02, 0.16, 0.16),
        radius=0.068,
        start=(0.02, 0.0, 0.0),
        end=(0.44, 0.0, 0.0),
    ),
    JointedLink(
        name="forearm",
        joint="elbow",
        p=(0.44278, 0.0, 0.0),
        rpy=(0.0, -0.262, 0.0),
        axis=(0.0, 1.0, 0.0),
        limits=(-0.4, 2.3),
        torque=110.0,
        damping=6.0,
        rotor=0.2,
        mass=7.0,
        center=(0.16, 0.0, 0.03),
        inertia=(0.02, 0.08, 0.08),
        radius=0.065,
        start=(0.0, 0.0, 0.0),
        end=(0.3, 0.0, 0.04),
    ),
    JointedLink(
        name="jaw",
        joint="jaw_rotate",
        p=(0.320, 0.0, 0.077),
        axis=(1.0, 0.0, 0.0),
        limits=(-math.pi, math.pi),
        torque=20.0,
        damping=1.0,
        rotor=0.05,
        mass=3.0,
        center=(0.06, 0.0, 0.0),
        inertia=(0.004, 0.006, 0.006),
        radius=0.045,
        start=(0.0, 0.0, 0.0),
        end=(0.14, 0.0, 0.0),
    ),
)
_TIP = 0.16  # [m] of the jaws' tip along the last joint
HOME = (0.0, 1.12, 2.2, 0.0)  # [rad] folded under the bow
READY = (0.0, -0.7, 1.8, 0.0)  # [rad] tool ahead of the bow


def with_arm_4() -> mujoco.MjSpec:
    """The vehicle with the arm of four joints under its bow; ballast compensates its weight."""
    spec = published_hulls.new_spec("girona500_arm4")
    hull = published_hulls.add_hull(spec, HULL)
    _add_shapes(hull)

    names = [
        published_hulls.add_thruster(
            spec, hull, name, published_hulls.from_ned(p), published_hulls.from_ned(direction)
        )
        for name, (p, direction) in THRUSTERS.items()
    ]
    thruster = thrusters.Thruster(
        forward=THRUST, reverse=THRUST, dead_band=0.0, time_constant=_LAG, inflow_loss=0.0
    )
    thrusters.attach(spec, dict.fromkeys(names, thruster))

    published_hulls.add_camera(hull, _CAMERA, _DOWN)

    # The arm.
    base = hull.add_body(name=ARM_BASE_BODY, pos=_BASE)
    published_hulls.set_inertial(base, 2.0, [0.0, 0.0, 0.03], 0.01 * np.eye(3))
    hydrodynamics.attach(spec, {ARM_BASE_BODY: cylinder(0.06, (0.0, 0.0, 0.0), (0.0, 0.0, 0.08))})
    last = add_links(spec, base, _LINKS)
    add_tip(last, _TIP)

    published_hulls.add_keys(spec, HOME, READY)
    published_hulls.ballast(spec)
    return spec


def _add_shapes(hull: mujoco.MjsBody) -> None:
    """Add the tubes of the hull and the frames that join them."""
    for name, (middle, half, radius) in _TUBES.items():
        ends = [np.add(middle, [x, 0.0, 0.0]) for x in (-half + radius, half - radius)]
        published_hulls.add_capsule(hull, f"tube_{name}", radius, (ends[0], ends[1]), _ORANGE)

    for i, x in enumerate(_FRAMES):
        for side in (-1.0, 1.0):
            ends = np.array([x, 0.0, -0.28]), np.array([x, 0.3 * side, 0.28])
            published_hulls.add_capsule(
                hull, f"frame_{i}_{'port' if side > 0.0 else 'starboard'}", 0.025, ends, _ORANGE
            )
