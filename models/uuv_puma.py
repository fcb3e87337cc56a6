"""A generic work-class hovering UUV with a six-DOF PUMA-type arm: every hydrodynamic figure and its source.

No numbers of a real vehicle are used or implied. Hull: an open frame of 1.6 x 0.9 x 0.8 m, 323 kg. Its derivatives are
estimates for a box-like ROV: added mass 0.6, 1.1 and 1.7 times the displaced mass in surge, sway and heave (Fossen
2011, ch. 6; published sets for open frames, those of BlueROV2 and RexROV2, lie between 0.4 and 2.1), coupling from a
centre of added mass 4 cm above the origin; drag 0.5 rho C_d A on the frontal areas with C_d 0.9, 1.1, 1.2 (Hoerner
3-17, box with openings). Links: cylinders by strip theory (Newman 4.15; Hoerner 3-9). Thrusters: generic, 300 N.
Gears: sliding friction 4 % of each drive's limit, the middle of what was measured on the PUMA 560 (Corke,
Armstrong-Helouvry 1994, A search for consensus among model parameters reported for the PUMA 560 robot: 1.4 to 8 % of
the limits of its joints 2 to 6, 27 % of that of the first); stiction 1.3 times that below 0.03 rad/s, an assumption.
"""

from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from models import gear_friction, hydrodynamics, sampler, thrusters
from models.gear_friction import GearFriction
from models.hydrodynamics import BodyHydrodynamics, cylinder

_ASSET = Path(__file__).parent / "assets" / "uuv_puma.xml"

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

_THRUSTER = thrusters.Thruster(forward=300.0, reverse=220.0, dead_band=0.05, time_constant=0.15, inflow_loss=90.0)


_SLIDING_FRICTION = (6.0, 8.0, 4.8, 2.4, 1.2, 0.6)  # [N m] of the gears; the viscous part is in the asset


def _hull() -> BodyHydrodynamics:
    """The hull alone; its volume and centre of buoyancy are set by trimming the whole vehicle."""
    surge, sway, heave = 200.0, 370.0, 570.0  # [kg]
    height = 0.04  # [m] centre of added mass above the origin: foam above, open frame below
    added = np.diag([surge, sway, heave, 28.0, 75.0, 60.0])
    added[0, 4] = added[4, 0] = surge * height
    added[1, 3] = added[3, 1] = -sway * height
    return BodyHydrodynamics(
        volume=0.33,  # [m^3]
        center_of_buoyancy=np.array([0.0, 0.0, 0.06]),
        added_mass=added,
        linear_damping=np.array([60.0, 90.0, 120.0, 40.0, 60.0, 50.0]),
        quadratic_damping=np.array([330.0, 720.0, 885.0, 110.0, 240.0, 190.0]),
    )


def build(tool: Literal["pad", "sampler"] = "pad") -> mujoco.MjSpec:
    """The vehicle alone, coefficients attached, trimmed in its home pose (arm folded), with `tool` on the arm."""
    spec = mujoco.MjSpec.from_file(str(_ASSET))
    bodies = {
        "hull": _hull(),
        "arm_base": cylinder(0.1, (0, 0, -0.03), (0, 0, 0.03)),
        "link1": cylinder(0.08, (0, 0, 0.03), (0, 0, 0.27)),
        "link2": cylinder(0.06, (0, 0, 0), (0.6, 0, 0)),
        "link3": cylinder(0.05, (0, 0, 0), (0.5, 0, 0)),
        "link4": cylinder(0.045, (-0.05, 0, 0), (0.05, 0, 0)),
        "link5": cylinder(0.04, (0, 0, 0), (0.08, 0, 0)),
        "link6": cylinder(0.03, (0.08, 0, 0), (0.17, 0, 0)),
        "pad": cylinder(0.045, (0.01, 0, 0), (0.05, 0, 0)),
    }
    if tool == "sampler":
        bodies |= sampler.fit(spec)
    hydrodynamics.attach(spec, bodies)
    gears = {
        f"joint{i}": GearFriction(coulomb=dry, stiction=1.3 * dry, stribeck_speed=0.03)
        for i, dry in enumerate(_SLIDING_FRICTION, start=1)
    }
    gear_friction.attach(spec, gears)
    thrusters.attach(spec, {a.name: _THRUSTER for a in spec.actuators if a.name.startswith("thruster_")})
    home = next(key for key in spec.keys if key.name == "home")
    hydrodynamics.trim(spec, "hull", metacentric_height=METACENTRIC_HEIGHT, qpos=home.qpos)
    return spec
