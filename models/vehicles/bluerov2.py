"""BlueROV2 (Blue Robotics) with six thrusters: four vectored at 45 degrees, two vertical.

Geometry, inertia and quadratic drag are those of the Gazebo model of clydemcqueen/bluerov2_gz
(models/bluerov2/model.sdf), which was read; its author calls it "not tuned". That model has no
added mass, because the simulator that it was made for does not support it. Here the added mass is
that of [Wu 2018] for BlueROV2 Heavy. The model's axes are forward, port, up; its figures are
entered here in axes forward, starboard, down.

Thrusters: six T200 at 16 V (`uuv.models.water.thrusters.t200`), without reaction torque, as for
BlueROV2 Heavy. The two vertical thrusters are abreast of each other, so no thruster controls pitch.
Only the hull's hydrostatic stability acts on it.

`with_alpha_5` carries the Reach Alpha 5 where BlueROV2 Heavy does; this is not published.
"""

import mujoco
import numpy as np

from uuv.models.vehicles import bluerov2_heavy, published_hulls, reach_alpha_5
from uuv.models.vehicles.bluerov2_heavy import LENGTH, WU_2018, slanted_thrusters
from uuv.models.vehicles.published_hulls import PublishedHull

WIDTH = 0.338  # [m]
_MASS = 10.0  # [kg]
_CENTER_OF_GRAVITY = np.array([0.0, 0.0, -0.011])  # [m]
_ABOUT_IT = np.diag([0.099, 0.178, 0.269])  # [kg m^2]
_DISPLACED = LENGTH * WIDTH * 0.065  # [m^3] displaced volume, that of a box in the source

GAZEBO = PublishedHull(
    mass=_MASS,
    center_of_gravity=_CENTER_OF_GRAVITY,
    inertia=_ABOUT_IT
    + _MASS * (np.dot(_CENTER_OF_GRAVITY, _CENTER_OF_GRAVITY) * np.eye(3))
    - _MASS * np.outer(_CENTER_OF_GRAVITY, _CENTER_OF_GRAVITY),
    volume=_DISPLACED,
    center_of_buoyancy=[0.0, 0.0, -0.06],
    added_mass=WU_2018.added_mass,
    linear_damping=np.zeros(6),
    quadratic_damping=[33.732, 54.16, 73.225, 3.992, 3.992, 3.992],
)

# Forward, starboard, down: position [m], direction of positive thrust. 1-4 are horizontal, 5 and 6
# vertical.
_UP = (0.0, 0.0, -1.0)
THRUSTERS = (
    *slanted_thrusters(front=0.14, rear=0.15, abreast=0.092, below=0.0),
    ((0.0, 0.109, -0.077), _UP),
    ((0.0, -0.109, -0.077), _UP),
)


def build() -> mujoco.MjSpec:
    """The vehicle, ballasted to be neutral."""
    spec = published_hulls.new_spec("bluerov2")
    bluerov2_heavy.add_hull(spec, GAZEBO, THRUSTERS, width=WIDTH)
    published_hulls.add_keys(spec)
    published_hulls.ballast(spec)
    return spec


def with_alpha_5() -> mujoco.MjSpec:
    """The vehicle with the Reach Alpha 5 under its bow, joint 1 pointing down; ballast compensates
    the arm's weight.
    """
    spec = published_hulls.new_spec("bluerov2_alpha5")
    hull = bluerov2_heavy.add_hull(spec, GAZEBO, THRUSTERS, width=WIDTH)
    reach_alpha_5.add_arm(spec, hull, [0.19, 0.0, -0.12], [0.0, 1.0, 0.0, 0.0])
    published_hulls.add_keys(spec, reach_alpha_5.HOME, reach_alpha_5.READY)
    published_hulls.ballast(spec)
    return spec
