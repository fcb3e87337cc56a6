"""BlueROV2 Heavy (Blue Robotics) by two published parameter sets, whose drag differs up to tenfold.

[Benzon 2022, table A1] is validated in a test tank, according to the abstract. The table was read
in two transcriptions that agree (ViktorNfa/bluerov2_dynamics BlueROV2.py; a MATLAB script). A third
(AndreasKing-Goks/0_THESIS) prints more digits of the added masses, and 0.1858 kg m^2 in roll where
the others have 0.189. Of the paper itself only the abstract was read.

[Wu 2018, tables 5.1 and 5.2] was read in one transcription (edxmorgan/diff_uv usage/blue_rov.py;
its drag also in hkolano/PitchPrediction). The thesis itself was not read. The transcription states
that its inertia is about the origin, which is the centre of buoyancy.

Thrusters: eight T200 at 16 V (`uuv.models.water.thrusters.t200`). Their positions are those of
Benzon's set, and also reproduce Wu's matrix. The four horizontal thrusters are at 45 degrees, 85 mm
below the origin. Positive thrust of the four vertical thrusters is upward in Benzon's set, while in
Wu's set that of thrusters 6 and 7 is downward. Neither set has the torque of the propellers, so it
is zero here. Both sets give a slightly buoyant hull; here the hull is ballasted to be neutral
(`uuv.models.vehicles.published_hulls.ballast`).
"""

import math

import mujoco
import numpy as np

from uuv.models.naming import CAMERA_SITE
from uuv.models.vehicles import published_hulls, reach_alpha_5
from uuv.models.vehicles.published_hulls import PublishedHull
from uuv.models.water import thrusters

LENGTH = 0.457  # [m] [BlueRobotics Heavy]
WIDTH = 0.575  # [m]
HEIGHT = 0.254  # [m]
_FRESH_WATER = 1000.0  # [kg/m^3] density for Wu's set
_GRAVITY = 9.81  # [m/s^2] to convert Wu's buoyancy, which is printed in N

BENZON_2022 = PublishedHull(
    mass=13.5,
    center_of_gravity=[0.0, 0.0, 0.0],
    inertia=np.diag([0.26, 0.23, 0.37]),
    volume=0.0134,
    center_of_buoyancy=[0.0, 0.0, -0.01],
    added_mass=np.diag([6.36, 7.12, 18.68, 0.189, 0.135, 0.222]),
    linear_damping=[13.7, 0.0, 33.0, 0.0, 0.8, 0.0],
    quadratic_damping=[141.0, 217.0, 190.0, 1.19, 0.47, 1.5],
)

WU_2018 = PublishedHull(
    mass=11.5,
    center_of_gravity=[0.0, 0.0, 0.02],
    inertia=np.diag([0.16, 0.16, 0.16]),
    volume=114.8 / (_FRESH_WATER * _GRAVITY),  # printed as a buoyancy of 114.8 N
    center_of_buoyancy=[0.0, 0.0, 0.0],
    added_mass=np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12]),
    linear_damping=[4.03, 6.22, 5.18, 0.07, 0.07, 0.07],
    quadratic_damping=[18.18, 21.66, 36.99, 1.55, 1.55, 1.55],
)

# Forward, starboard, down, as printed: position [m], direction of positive thrust. 1-4 horizontal,
# 5-8 vertical.
_D = math.sqrt(0.5)


def slanted_thrusters(*, front: float, rear: float, abreast: float, below: float) -> tuple:
    """Four level thrusters at 45 degrees: bow starboard, bow port, stern starboard, stern port.

    Args:
        front: [m] distance of the two at the bow, ahead of the origin.
        rear: [m] distance of the two at the stern, behind the origin.
        abreast: [m] distance of each from the plane of symmetry.
        below: [m] distance of all below the origin.

    Returns:
        Position [m] and direction of positive thrust of each, forward, starboard, down.
    """
    return (
        ((front, abreast, below), (_D, -_D, 0.0)),
        ((front, -abreast, below), (_D, _D, 0.0)),
        ((-rear, abreast, below), (-_D, -_D, 0.0)),
        ((-rear, -abreast, below), (-_D, _D, 0.0)),
    )


_LEVEL = slanted_thrusters(front=0.156, rear=0.156, abreast=0.111, below=0.085)
_UPRIGHT = ((0.120, 0.218, 0.0), (0.120, -0.218, 0.0), (-0.120, 0.218, 0.0), (-0.120, -0.218, 0.0))
_UP = (0.0, 0.0, -1.0)
_DOWN = (0.0, 0.0, 1.0)
BENZON_THRUSTERS = (*_LEVEL, *((p, _UP) for p in _UPRIGHT))
WU_THRUSTERS = (*_LEVEL, *zip(_UPRIGHT, (_UP, _DOWN, _DOWN, _UP), strict=True))


def benzon_2022() -> mujoco.MjSpec:
    """The vehicle by [Benzon 2022]."""
    return _vehicle("bluerov2_heavy_benzon2022", BENZON_2022, BENZON_THRUSTERS)


def wu_2018() -> mujoco.MjSpec:
    """The vehicle by [Wu 2018]."""
    return _vehicle("bluerov2_heavy_wu2018", WU_2018, WU_THRUSTERS)


def with_alpha_5() -> mujoco.MjSpec:
    """The vehicle by [Benzon 2022] with the Reach Alpha 5 under its bow, joint 1 pointing down.

    The arm's base is mounted as in edxmorgan/floating-KinDyn (usage/alpha_reach.py, "underarm").
    The combination is not published; ballast compensates the arm's weight.
    """
    spec = published_hulls.new_spec("bluerov2_heavy_alpha5")
    hull = add_hull(spec, BENZON_2022, BENZON_THRUSTERS)
    reach_alpha_5.add_arm(spec, hull, [0.19, 0.0, -0.12], [0.0, 1.0, 0.0, 0.0])
    published_hulls.add_keys(spec, reach_alpha_5.HOME, reach_alpha_5.READY)
    published_hulls.ballast(spec)
    return spec


def _vehicle(name: str, figures: PublishedHull, places: tuple) -> mujoco.MjSpec:
    spec = published_hulls.new_spec(name)
    add_hull(spec, figures, places)
    published_hulls.add_keys(spec)
    published_hulls.ballast(spec)
    return spec


def add_hull(
    spec: mujoco.MjSpec, figures: PublishedHull, places: tuple, *, width: float = WIDTH
) -> mujoco.MjsBody:
    """Add the hull with its shape, its camera and a T200 at each of `places`; return its body."""
    hull = published_hulls.add_hull(spec, figures)

    # Shapes for rendering and contact only: the frame as a box, the foam above the frame.
    frame = mujoco.mjtGeom.mjGEOM_BOX
    foam = [0.11, 0.38, 0.85, 1.0]
    hull.add_geom(
        name="frame",
        type=frame,
        size=[LENGTH / 2, width / 2, HEIGHT / 2],
        mass=0.0,
        contype=1,
        conaffinity=2,
        rgba=[0.2, 0.22, 0.26, 0.0],
        group=3,
    )

    inset = 0.1175  # [m] distance of the foam's middle from the side
    for side, y in (("port", width / 2 - inset), ("starboard", inset - width / 2)):
        hull.add_geom(
            name=f"foam_{side}",
            type=frame,
            size=[0.2, 0.1, 0.04],
            pos=[0.0, y, 0.085],
            mass=0.0,
            contype=0,
            conaffinity=0,
            rgba=foam,
        )

    hull.add_geom(
        name="housing",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[0.057, 0.12, 0.0],
        quat=[_D, 0.0, _D, 0.0],
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=[0.85, 0.87, 0.9, 1.0],
    )

    # OpenCV axes, camera horizontal: z forward, x to starboard.
    hull.add_site(
        name=CAMERA_SITE,
        pos=[0.2, 0.0, 0.0],
        quat=[0.5, -0.5, 0.5, -0.5],
        group=4,
        size=[0.01, 0.01, 0.01],
    )

    names = [
        published_hulls.add_thruster(
            spec, hull, str(i), published_hulls.from_ned(p), published_hulls.from_ned(direction)
        )
        for i, (p, direction) in enumerate(places, start=1)
    ]
    thrusters.attach(spec, {name: thrusters.t200(torque_per_thrust=0.0) for name in names})
    return hull
