"""REMUS 100, a torpedo-shaped vehicle with one propeller, as in PythonVehicleSimulator.

The model is that of [Fossen 2021]. Figures and forms are those of the source's remus100.py (commit
7e1db8e), which was read; its helper gnc.py was read in copies. Axes of the source are forward,
starboard, down; the few signs that change are marked. The vehicle is an example of effects that
matrices of constant coefficients cannot describe:

- The Munk moment in pitch and yaw, and the force that belongs to it, are removed: `MunkFactor`.
- Damping in surge and sway fades with speed: `FadingDamping`.
- The body generates lift in the vertical plane: `LiftDrag.of_wing`.
- Cross-flow drag in sway and yaw: `PlanarStrip`. The source sums 21 strips of a twentieth of the
  length, so that the segment here is longer than the hull by a twentieth.

The propeller is a thruster. In the source its thrust decreases with the magnitude of the speed;
here it decreases with the speed ahead, also for thrust astern. The ratio of torque to thrust
decreases with the advance number; here it is constant, that at the largest advance number. Rudder
and stern plane have no actuator, since their force is proportional to the square of the speed:
`fin_wrench` returns it.
"""

import math

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.naming import HULL_BODY
from uuv.models.vehicles import published_hulls
from uuv.models.water import thrusters
from uuv.models.water.forms import FadingDamping, LiftDrag, MunkFactor, PlanarStrip
from uuv.sim.interfaces.spatial import GRAVITY, Array, checked, skew

LENGTH = 1.6  # [m]
DIAMETER = 0.19  # [m]
DENSITY = 1026.0  # [kg/m^3] density of the source; the vehicle is ballasted for any density
LOW = 0.02  # [m] centre of mass below the centre of buoyancy, which is the origin
MOST_RPM = 1525.0  # largest propeller speed [1/min]
FIN_TIME = 0.1  # [s] time constant of rudder and stern plane
MOST_FIN = math.radians(15.0)  # [rad]
_A = LENGTH / 2.0  # [m] semi-axes
_B = DIAMETER / 2.0
_FIN_AREA = 2.0 * 0.00665  # [m^2]
_RUDDER_LIFT = 0.5  # [1/rad]
_STERN_LIFT = 0.7  # [1/rad]
_DRAG = 0.42  # drag coefficient of the hull on its frontal area [Allen 2000]
# drag coefficient of a circle, from the curve of [Hoerner 1965] that the source interpolates
_CROSS_FLOW = 1.19773
_SUMMED = 21.0 / 20.0  # ratio of the length of the source's strips to that of the hull
_D = 0.14  # [m] diameter of the propeller
_DEDUCTION = 0.1  # thrust deduction
_WAKE = 0.944  # ratio of advance speed to speed
_KT = (0.4566, 0.1798)  # thrust coefficient at rest, and at the largest advance number
_KQ = (0.0700, 0.0312)  # torque coefficient
_MOST_ADVANCE = 0.6632  # largest advance number tested
_SHARE = 0.1  # share of the propeller's torque that the source applies
PROPELLER_TIME = 1.0  # [s]


def build() -> mujoco.MjSpec:
    """The vehicle with its propeller, `thruster_main`."""
    spec = published_hulls.new_spec("remus100")
    body = spec.worldbody.add_body(name=HULL_BODY)
    body.add_freejoint(name=HULL_BODY)

    mass, roll, pitch = rigid()
    published_hulls.set_inertial(body, mass, [0.0, 0.0, -LOW], np.diag([roll, pitch, pitch]))
    hydrodynamics.attach(spec, {HULL_BODY: coefficients()})

    body.add_geom(
        name="hull",
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=[_A, _B, _B],
        mass=0.0,
        contype=1,
        conaffinity=2,
        rgba=[0.95, 0.75, 0.1, 1.0],
    )

    name = published_hulls.add_thruster(spec, body, "main", [-_A, 0.0, 0.0], [1.0, 0.0, 0.0])
    thrusters.attach(spec, {name: propeller()})
    published_hulls.add_keys(spec)
    published_hulls.ballast(spec)
    return spec


def rigid() -> tuple[float, float, float]:
    """Mass [kg] of the hull as a spheroid with the density of water, and inertia [kg m^2] in roll,
    and in pitch or yaw.
    """
    mass = 4.0 / 3.0 * math.pi * DENSITY * _A * _B**2
    return mass, 0.4 * mass * _B**2, 0.2 * mass * (_A**2 + _B**2)


def coefficients() -> BodyHydrodynamics:
    """Hydrodynamic coefficients of the hull at its middle; all numbers are the same in the source's
    axes.
    """
    mass, roll, pitch = rigid()

    # The mass is that of the displaced water; inertia about the middle of the hull.
    added = np.diag(hydrodynamics.ellipsoid([_A, _B, _B], water_density=DENSITY).added_mass).copy()
    added[3] = 0.3 * roll
    S = skew([0.0, 0.0, -LOW])
    total = added + np.array([mass] * 3 + [*np.diag(np.diag([roll, pitch, pitch]) - mass * S @ S)])

    # Damping ratios of the source in roll and pitch, and time constant of the source in yaw.
    righting = mass * GRAVITY * LOW  # [N m/rad]
    turning = [
        2.0 * 0.3 * math.sqrt(righting * total[3]),  # 2 zeta w I
        2.0 * 0.8 * math.sqrt(righting * total[4]),
        total[5] / 1.0,  # inertia over its time constant [s]
    ]

    area = 0.7 * LENGTH * DIAMETER
    half = _SUMMED * _A

    return BodyHydrodynamics(
        volume=mass / DENSITY,
        added_mass=np.diag(added),
        linear_damping=np.array([0.0, 0.0, total[2] / 20.0, *turning]),
        forms=(
            MunkFactor(factor=np.array([1.0, 0.0, 0.0])),
            FadingDamping(
                linear=np.array([total[0] / 20.0, total[1] / 20.0, 0.0, 0.0, 0.0, 0.0]), rate=3.0
            ),
            LiftDrag.of_wing(
                area=area,
                span=DIAMETER,
                drag_0=_DRAG * math.pi * _B**2 / area,
                sweep=-2,
                water_density=DENSITY,
            ),
            PlanarStrip(
                start=np.array([-half, 0.0, 0.0]),
                end=np.array([half, 0.0, 0.0]),
                direction=np.array([0.0, 1.0, 0.0]),
                drag=0.5 * DENSITY * _CROSS_FLOW * DIAMETER,
            ),
        ),
    )


def propeller() -> thrusters.Thruster:
    """The propeller; command 1 is MOST_RPM."""
    most = MOST_RPM / 60.0  # [1/s]
    thrust = (1.0 - _DEDUCTION) * DENSITY * _D**4
    loss = (_KT[0] - _KT[1]) / _MOST_ADVANCE * _WAKE / _D
    return thrusters.Thruster(
        forward=thrust * _KT[0] * most**2,
        reverse=thrust * _KT[0] * most**2,
        time_constant=PROPELLER_TIME,
        inflow_loss=thrust * loss * most,
        torque_per_thrust=_SHARE * _D * _KQ[1] / ((1.0 - _DEDUCTION) * _KT[1]),
        handedness=-1,  # the propeller's torque on the hull is along the thrust
    )


def fin_wrench(v_B: ArrayLike, rudder: float, stern_plane: float) -> Array:
    """Force and moment of rudder and stern plane on the hull at its origin, hull axes.

    The force grows with the square of the speed in the fin's plane and with the angle of the fin.
    The source neglects the angle of the flow at the tail.

    Args:
        v_B: (3,) [m/s] velocity relative to the water, hull axes.
        rudder: [rad], positive turns the bow to starboard.
        stern_plane: [rad], positive turns the bow down.

    Returns:
        Wrench (6,) [N, N m].
    """
    u, v, w = checked(v_B, (3,), "velocity [m/s]")
    level, upright = 0.5 * DENSITY * _FIN_AREA * np.array([u * u + v * v, u * u + w * w])
    ahead = -level * _RUDDER_LIFT * rudder**2 - upright * _STERN_LIFT * stern_plane**2

    # forces to port, and up
    side = level * _RUDDER_LIFT * rudder
    heave = upright * _STERN_LIFT * stern_plane

    force = np.array([ahead, side, heave])
    return np.concatenate([force, np.cross([-_A, 0.0, 0.0], force)])
