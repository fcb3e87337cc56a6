"""The vehicle of the pool trials by a published hull and the parameters that no table states.

Nominal values are those of the tables, or plain guesses where there are none; a prior says how far
they may be off. The vehicle floats in fresh water with its thrusters off, and its joints follow the
measured angles stiffly.
"""

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from uuv.calib.water.named_fit import NamedParameter
from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.naming import HULL_BODY
from uuv.models.vehicles import bluerov2_heavy, published_hulls, reach_alpha_5
from uuv.models.vehicles.published_hulls import PublishedHull
from uuv.sim import hydrodynamics as wet
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import GRAVITY, Array, shown

FRESH_WATER = 997.0  # [kg/m^3] as the trials' authors state
TIMESTEP = 0.005  # [s]
JAW = (0.0, 0.0, -0.19)  # [m] of the jaw's mass in the wrist
# [N m/rad], [N m s/rad], [kg m^2] of the servos that replay the angles
_STIFF, _DAMPED, _ROTOR = 800.0, 16.0, 0.02

# Hull of the trials' authors (N, m, z up there): 20.9 kg with what it entrains, so the added mass
# of [Wu 2018] is left.
KOLANO_2022 = PublishedHull(
    mass=13.17,
    center_of_gravity=[0.0, 0.0, 0.0],
    inertia=np.diag([0.28, 0.28, 0.28]),
    volume=13.082e-3,
    center_of_buoyancy=[0.0074, 0.0, -0.02],
    added_mass=np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12]),
    linear_damping=[4.03, 6.22, 5.18, 0.07, 0.07, 0.07],
    quadratic_damping=[18.18, 21.66, 36.99, 1.55, 1.55, 1.55],
)
HULLS = {
    "benzon2022": bluerov2_heavy.BENZON_2022,
    "wu2018": bluerov2_heavy.WU_2018,
    "kolano2022": KOLANO_2022,
}


def _factor(name: str, sigma: float) -> NamedParameter:
    return NamedParameter(name=name, unit="1", nominal=1.0, sigma=sigma, factor=True)


def _offset(name: str, unit: str, sigma: float, nominal: float = 0.0) -> NamedParameter:
    return NamedParameter(name=name, unit=unit, nominal=nominal, sigma=sigma)


def _positive(name: str, unit: str, nominal: float) -> NamedParameter:
    return NamedParameter(name=name, unit=unit, nominal=nominal, sigma=1.0, factor=True)


PARAMETERS = (
    _offset("center of mass x", "m", 0.02),  # of the hull with its kit, from the table's
    _offset("center of mass y", "m", 0.02),
    _offset("center of mass z", "m", 0.02),
    _offset("center of buoyancy x", "m", 0.03),  # from where foam balances the folded arm
    _offset("center of buoyancy y", "m", 0.02),
    _offset("net buoyancy", "N", 1.0, 0.3),
    _factor("heave drag", 0.7),
    _factor("roll drag", 0.7),
    _factor("pitch drag", 0.7),
    _factor("yaw drag", 0.7),
    _positive("linear roll damping", "N m s", 0.3),
    _positive("linear pitch damping", "N m s", 0.3),
    _positive("linear yaw damping", "N m s", 0.1),
    _factor("heave added mass", 0.4),
    _factor("roll added inertia", 0.4),
    _factor("pitch added inertia", 0.4),
    _factor("arm drag", 0.5),
    _factor("arm added mass", 0.4),
    _offset("jaw mass", "kg", 0.05, 0.05),
    *(_offset(f"zero of joint {joint}", "rad", 0.05) for joint in (1, 2, 3, 4)),
    _offset("IMU mount roll", "rad", 0.05),
    _offset("IMU mount pitch", "rad", 0.05),
)
_ADDED = ("heave added mass", "roll added inertia", "pitch added inertia")
NOMINAL = {each.name: each.nominal for each in PARAMETERS}


def pool_model(hull: str, values: Mapping[str, float]) -> mujoco.MjModel:
    """Compiled model of the vehicle with position servos in its joints.

    Args:
        hull: One of HULLS.
        values: A value for each of PARAMETERS.

    Raises:
        ConfigurationError: There is no such hull.
        HydrodynamicsError: The numbers are no vehicle, such as a volume below zero.
    """
    if hull not in HULLS:
        raise ConfigurationError(f"unknown hull {shown(hull)}; there are {', '.join(HULLS)}")

    # The model as its tables have it, with servos in place of motors.
    spec = published_hulls.new_spec(f"pool_{hull}")
    spec.option.timestep = TIMESTEP
    body = published_hulls.add_hull(spec, HULLS[hull])
    reach_alpha_5.add_arm(spec, body, [0.19, 0.0, -0.12], [0.0, 1.0, 0.0, 0.0])
    _load_jaw(spec, NOMINAL["jaw mass"])
    published_hulls.add_keys(spec, reach_alpha_5.HOME)
    published_hulls.ballast(spec, FRESH_WATER)

    for key in list(spec.keys):
        spec.delete(key)
    _servos(spec)

    # Deviations of mass and its centre.
    water = hydrodynamics.attached(spec)
    shift = [values[f"center of mass {axis}"] for axis in "xyz"]
    body.ipos = np.array(body.ipos) + shift
    _load_jaw(spec, values["jaw mass"] - NOMINAL["jaw mass"])

    # Deviations of the water: links first, for the hull's volume follows from theirs.
    for name in set(water) - {HULL_BODY}:
        water[name] = _scaled_link(water[name], values)

    total = sum(float(body.mass) for body in spec.bodies[1:])
    others = sum(water[name].volume for name in water if name != HULL_BODY)
    volume = (total + values["net buoyancy"] / GRAVITY) / FRESH_WATER - others

    water[HULL_BODY] = replace(_scaled_hull(water[HULL_BODY], values), volume=volume)
    hydrodynamics.attach(spec, water, FRESH_WATER)
    return wet.compile(spec)


def _servos(spec: mujoco.MjSpec) -> None:
    """Position servos in place of the arm's motors; no limits: an encoder's zero may be off."""
    for actuator in list(spec.actuators):
        joint = spec.joint(actuator.target)
        joint.damping, joint.armature, joint.limited = (
            [0.0, 0.0, 0.0],
            _ROTOR,
            mujoco.mjtLimited.mjLIMITED_FALSE,
        )
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
        actuator.set_to_position(kp=_STIFF, kv=_DAMPED)


def _load_jaw(spec: mujoco.MjSpec, mass: float) -> None:
    wrist = spec.body(reach_alpha_5.LINKS[-1].name)
    wrist_mass, center = float(wrist.mass), np.array(wrist.ipos)
    wrist.mass = wrist_mass + mass
    wrist.ipos = (wrist_mass * center + mass * np.array(JAW)) / (wrist_mass + mass)


def _scaled_link(link: BodyHydrodynamics, values: Mapping[str, float]) -> BodyHydrodynamics:
    drag = values["arm drag"]
    strips = tuple(
        replace(s, normal=drag * s.normal, tangential=drag * s.tangential) for s in link.segments
    )
    return replace(link, strips=strips, added_mass=values["arm added mass"] * link.added_mass)


def _scaled_hull(hull: BodyHydrodynamics, values: Mapping[str, float]) -> BodyHydrodynamics:
    roots = np.sqrt([1.0, 1.0, *(values[name] for name in _ADDED), 1.0])
    drag = np.array(
        [1.0, 1.0, *(values[f"{axis} drag"] for axis in ("heave", "roll", "pitch", "yaw"))]
    )

    turning = [values[f"linear {axis} damping"] for axis in ("roll", "pitch", "yaw")]
    center = np.array(hull.center_of_buoyancy)
    center[:2] += values["center of buoyancy x"], values["center of buoyancy y"]

    return replace(
        hull,
        center_of_buoyancy=center,
        added_mass=roots[:, None] * hull.added_mass * roots,
        linear_damping=hull.linear_damping + np.diag([0.0, 0.0, 0.0, *turning]),
        quadratic_damping=drag * hull.quadratic_damping,
    )


def mount(values: Mapping[str, float]) -> Array:
    """Rotation (3, 3) of the IMU's axes on the hull."""
    angles = [0.0, values["IMU mount pitch"], values["IMU mount roll"]]
    return Rotation.from_euler("ZYX", angles).as_matrix()


def joint_zeros(values: Mapping[str, float]) -> Array:
    """Offsets (4,) [rad] to be added to the measured angles."""
    return np.array([values[f"zero of joint {joint}"] for joint in (1, 2, 3, 4)])
