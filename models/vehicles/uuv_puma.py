"""Generic work-class hovering UUV with a six-DOF PUMA-type arm, and the source of every figure.

No numbers of a real vehicle are used or implied.

- Hull: an open frame of 1.6 x 0.9 x 0.8 m, 323 kg. Its derivatives are estimates for a box-like
  ROV.
- Added mass: 0.6, 1.1 and 1.7 times the displaced mass in surge, sway and heave [Fossen 2011, ch.
  6]. Published sets for open frames, those of BlueROV2 and RexROV2, lie between 0.4 and 2.1. The
  coupling terms follow from a centre of added mass 4 cm above the origin.
- Drag: 0.5 rho C_d A on the frontal areas with C_d 0.9, 1.1, 1.2 (box with openings, [Hoerner 1965,
  p. 3-17]).
- Links: cylinders by strip theory [Newman 1977, section 4.15], [Hoerner 1965, p. 3-9].
- Thrusters: generic, 300 N.
- Gears: sliding friction is 4 % of each drive's limit, the middle of the values measured on the
  PUMA 560 [Corke 1994]. The measured values are 1.4 to 8 % of the limits of joints 2 to 6, and 27 %
  of that of joint 1. Stiction below 0.03 rad/s is assumed to be 1.3 times the sliding friction.

The arm hangs under the hull, below the centre of buoyancy. For vertical structures an arm may be
mounted at the side of the hull's vertical axis [Konoplin 2022, section 3]. `build(arm="side")` has
the same hull and arm, with the arm on the port side, forward of the jet of the sway thruster, and
the camera beside it.
"""

from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.arms import gear_friction
from uuv.models.arms.gear_friction import GearFriction
from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import ARM_BASE_BODY, CAMERA_SITE, HOME_KEY, HULL_BODY, PAD_BODY
from uuv.models.tools import attachment, sampler
from uuv.models.tools.tools import TOOLS
from uuv.models.water import thrusters
from uuv.sim.interfaces.spatial import Array, pose, quat_wxyz_from_rotation, rotation_from_z

_ASSET = Path(__file__).with_suffix(".xml")

METACENTRIC_HEIGHT = 0.08  # [m] centre of buoyancy above the centre of mass

# Standard DH of the arm: theta0 [rad], d [m], a [m], alpha [rad]; tip frame G, z out of the tool.
DH = np.array(
    [
        [0.0, 0.2, 0.0, np.pi / 2],
        [0.0, 0.0, 0.6, 0.0],
        [0.0, 0.0, 0.5, 0.0],
        [0.0, 0.0, 0.0, -np.pi / 2],
        [np.pi / 2, 0.0, 0.0, np.pi / 2],
        [0.0, 0.22, 0.0, 0.0],
    ]
)

_THRUSTER = thrusters.Thruster(
    forward=300.0, reverse=220.0, dead_band=0.05, time_constant=0.15, inflow_loss=90.0
)


# [N m] Coulomb friction of the gears; viscous friction is in the XML file
_SLIDING_FRICTION = (6.0, 8.0, 4.8, 2.4, 1.2, 0.6)


def _hull() -> BodyHydrodynamics:
    """Coefficients of the hull alone; the vehicle's trim sets volume and centre of buoyancy."""
    surge, sway, heave = 200.0, 370.0, 570.0  # [kg]
    height = 0.04  # [m] centre of added mass above the origin: foam above, open frame below
    added = np.diag([surge, sway, heave, 28.0, 75.0, 60.0])
    added[0, 4] = added[4, 0] = surge * height
    added[1, 3] = added[3, 1] = -sway * height

    return BodyHydrodynamics(
        volume=0.33,  # [m^3] displaced volume
        center_of_buoyancy=np.array([0.0, 0.0, 0.06]),
        added_mass=added,
        linear_damping=np.array([60.0, 90.0, 120.0, 40.0, 60.0, 50.0]),
        quadratic_damping=np.array([330.0, 720.0, 885.0, 110.0, 240.0, 190.0]),
    )


# Arm base on the port side, with z to port and x down. The folded arm lies along the side, no lower
# than the skids. It is forward of the sway thruster, whose jet leaves the hull at the middle of the
# side. The camera is aft of that jet and faces port.
_SIDE_X_BA = pose(rotation_from_z([0.0, 1.0, 0.0], [0.0, 0.0, -1.0]), [0.45, 0.48, 0.27])
_SIDE_X_BC = pose(rotation_from_z([0.0, 1.0, 0.0], [1.0, 0.0, 0.0]), [-0.3, 0.5, 0.0])


def build_side() -> mujoco.MjSpec:
    """The vehicle with the arm, the camera and the workspace on the port side, trimmed for this
    arrangement.
    """
    return build(arm="side")


def build_two_sway() -> mujoco.MjSpec:
    """The vehicle with two sway thrusters, 0.6 m before and behind the middle, in place of one."""
    spec = build()
    spec.modelname = "uuv_puma_two_sway"
    bow = spec.site("thruster_sway")
    name = "thruster_sway_stern"
    bow.pos = [0.6, 0.0, 0.0]
    turn = quat_wxyz_from_rotation(rotation_from_z([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]))  # x to port
    spec.body(HULL_BODY).add_site(
        name=name, pos=[-0.6, 0.0, 0.0], quat=turn, group=4, size=[0.01, 0.01, 0.01]
    )

    actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_SITE, target=name)
    actuator.gear = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    thrusters.attach(spec, {name: _THRUSTER})
    return spec


def build(tool: str = "pad", arm: Literal["under", "side"] = "under") -> mujoco.MjSpec:
    """The vehicle with `tool` on the arm, with coefficients attached, trimmed in the posture `home`
    (arm folded).

    The `arm` is under the hull, or on the port side with the camera beside it.
    """
    spec = mujoco.MjSpec.from_file(str(_ASSET))
    if arm == "side":
        spec.modelname = "uuv_puma_side"
        _move(spec.body(ARM_BASE_BODY), _SIDE_X_BA)
        _move(spec.site(CAMERA_SITE), _SIDE_X_BC)
        # the housing is coaxial with the camera, and its window is just behind the camera
        behind = pose(p=[0.0, 0.0, -0.07])
        _move(spec.geom("camera_housing"), _SIDE_X_BC @ behind)

    bodies = {
        HULL_BODY: _hull(),
        ARM_BASE_BODY: cylinder(0.1, (0, 0, -0.03), (0, 0, 0.03)),
        "link1": cylinder(0.08, (0, 0, 0.03), (0, 0, 0.27)),
        "link2": cylinder(0.06, (0, 0, 0), (0.6, 0, 0)),
        "link3": cylinder(0.05, (0, 0, 0), (0.5, 0, 0)),
        "link4": cylinder(0.045, (-0.05, 0, 0), (0.05, 0, 0)),
        "link5": cylinder(0.04, (0, 0, 0), (0.08, 0, 0)),
        "link6": cylinder(0.03, (0.08, 0, 0), (0.17, 0, 0)),
        PAD_BODY: cylinder(0.045, (0.01, 0, 0), (0.05, 0, 0)),
    }

    # A sampler replaces the pad before the trim, other tools after it.
    held = None if tool == "pad" else TOOLS.load(tool)
    if isinstance(held, sampler.Tube | sampler.Box):
        bodies |= sampler.fit(spec, held)
    hydrodynamics.attach(spec, bodies)

    gears = {
        f"joint{i}": GearFriction(coulomb=dry, stiction=1.3 * dry, stribeck_speed=0.03)
        for i, dry in enumerate(_SLIDING_FRICTION, start=1)
    }
    gear_friction.attach(spec, gears)

    thrusters.attach(
        spec, {a.name: _THRUSTER for a in spec.actuators if a.name.startswith("thruster_")}
    )

    home = next(key for key in spec.keys if key.name == HOME_KEY)
    hydrodynamics.trim(spec, HULL_BODY, metacentric_height=METACENTRIC_HEIGHT, qpos=home.qpos)
    if held is not None and not isinstance(held, sampler.Tube | sampler.Box):
        attachment.attach(spec, held)
    return spec


def _move(element: mujoco.MjsBody | mujoco.MjsGeom | mujoco.MjsSite, X: Array) -> None:
    element.pos = X[:3, 3]
    element.quat = quat_wxyz_from_rotation(X[:3, :3])
    # replaces the Euler angles or axes of the file
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
