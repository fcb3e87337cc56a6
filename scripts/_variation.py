"""What of a contact job is other than its model says: water, payload, thrusters, gears, surface, sensors.

The controller knows the vehicle as it is drawn; the plant is built from the varied spec. A spread draws a factor in
1 +- spread for each number by itself.
"""

from dataclasses import dataclass, fields, replace

import mujoco
import numpy as np

from models import gear_friction, hydrodynamics, thrusters
from models.gear_friction import GearFriction
from models.hydrodynamics import BodyHydrodynamics
from models.vehicle import ARM_BASE_BODY, HULL_BODY
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array
from sim.plant import PAD_GEOM

PAD_BODY = PAD_JOINT = "pad"
STEPS_PER_SOLREF = 3.0  # of the contact's time constant; two are MuJoCo's least
RESTLESS = 0.3  # square of the pad's phase in a step, from about which on it bounces for ever, whoever presses it
SOFTEST_CONTACT = 1.6  # times the stiffness asked for, that the contact alone has at least
_TRANSLATION = slice(0, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """One state of the world around a contact job; the defaults are a job's nominal one."""

    water_error: float = 0.15  # share by which the controller's added masses and drags are wrong, all alike
    water_spread: float = 0.0  # of each added mass and drag coefficient of the plant
    payload_spread: float = 0.0  # of the mass of each part of the arm
    trim_error: float = 0.0  # share of the arm's mass by which the hull is too light (negative: too heavy)
    thruster_lag_spread: float = 0.0
    thruster_gain_spread: float = 0.0
    gear_spread: float = 0.0  # of the friction in each gear, dry and viscous alike
    friction: float | None = None  # between pad and surface; None: as the vehicle's pad has it
    stiffness: float | None = None  # [N/m] of pad and surface together; None: as the vehicle's pad has it
    surface_offset: float = 0.0  # [m] by which the surface is farther, along the tool, than it was identified
    vision_period: float = 0.1  # [s]
    vision_delay: float = 0.1  # [s]
    vision_noise: float = 2e-3  # [m]
    torque_noise: float = 0.01  # share of the reading
    torque_bias: float = 0.5  # [N m] uniform in +-
    seed: int = 0  # of the factors

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not np.isfinite(value):
                raise ConfigurationError(f"variation {field.name}: must be finite, got {value}")
        for name in ("water_spread", "payload_spread", "thruster_lag_spread", "thruster_gain_spread", "gear_spread"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ConfigurationError(f"variation {name}: must be in [0, 1), got {getattr(self, name)}")
        for name in ("friction", "stiffness"):
            if getattr(self, name) is not None and not getattr(self, name) > 0.0:
                raise ConfigurationError(f"variation {name}: must be > 0, got {getattr(self, name)}")


NOMINAL = Variation()


def vary(spec: mujoco.MjSpec, variation: Variation) -> dict[str, float]:
    """Make `spec`, a vehicle, what `variation` says; the means and extremes of the drawn factors by name.

    Raises ConfigurationError for a stiffness or a friction of a vehicle without a pad on a spring.
    """
    water, payload, drives, gears = np.random.default_rng([variation.seed, 7]).spawn(4)
    said: dict[str, float] = {}
    if variation.water_spread:
        said |= _water(spec, variation.water_spread, water)
    if variation.payload_spread or variation.trim_error:
        said |= _payload(spec, variation.payload_spread, variation.trim_error, payload)
    if variation.thruster_lag_spread or variation.thruster_gain_spread:
        said |= _thrusters(spec, variation.thruster_lag_spread, variation.thruster_gain_spread, drives)
    if variation.gear_spread:
        said |= _gears(spec, variation.gear_spread, gears)
    if variation.friction is not None or variation.stiffness is not None:
        _pad(spec, variation.friction, variation.stiffness)
    return said


def _factors(rng: np.random.Generator, spread: float, size: int) -> Array:
    return rng.uniform(1.0 - spread, 1.0 + spread, size)


def _water(spec: mujoco.MjSpec, spread: float, rng: np.random.Generator) -> dict[str, float]:
    """Each diagonal coefficient by a factor of its own, couplings by the root of two, so that all stay semidefinite."""
    bodies = hydrodynamics.attached(spec)
    hull: dict[str, float] = {}
    for name, body in bodies.items():
        added, linear, quadratic, strip = (_factors(rng, spread, size) for size in (6, 6, 6, 2))
        bodies[name] = BodyHydrodynamics(
            volume=body.volume,
            center_of_buoyancy=body.center_of_buoyancy,
            added_mass=_scaled(body.added_mass, added),
            linear_damping=_scaled(body.linear_damping, linear),
            quadratic_damping=quadratic * body.quadratic_damping,
            strips=tuple(
                replace(s, normal=strip[0] * s.normal, tangential=strip[1] * s.tangential) for s in body.segments
            ),
        )
        if name == HULL_BODY:
            hull = {
                "hull_added_mass": float(added[_TRANSLATION].mean()),
                "hull_drag": float(quadratic[_TRANSLATION].mean()),
            }
    hydrodynamics.attach(spec, bodies)
    return hull


def _scaled(matrix: Array, factors: Array) -> Array:
    root = np.sqrt(factors)
    return root[:, None] * matrix * root


def _payload(spec: mujoco.MjSpec, spread: float, trim_error: float, rng: np.random.Generator) -> dict[str, float]:
    """Masses of the arm's parts, inertia in proportion; the hull is ballasted for the arm as drawn, less an error."""
    arm = spec.body(ARM_BASE_BODY)
    if arm is None:
        raise ConfigurationError(f"a payload varies the arm, but the vehicle has no body named {ARM_BASE_BODY!r}")
    parts = [arm, *arm.find_all(mujoco.mjtObj.mjOBJ_BODY)]
    before = sum(float(part.mass) for part in parts)
    for part, factor in zip(parts, _factors(rng, spread, len(parts)), strict=True):
        part.mass = factor * float(part.mass)
        part.inertia = factor * np.array(part.inertia)
    after = sum(float(part.mass) for part in parts)
    water = hydrodynamics.attached(spec)[HULL_BODY]
    lift = trim_error * before / hydrodynamics.density_of(spec)  # [m^3]
    hydrodynamics.attach(spec, {HULL_BODY: replace(water, volume=water.volume + lift)})
    return {"arm_mass": after / before, "too_heavy_kg": after - before - trim_error * before}


def _thrusters(spec: mujoco.MjSpec, lag: float, gain: float, rng: np.random.Generator) -> dict[str, float]:
    carriers = [actuator for actuator in spec.actuators if thrusters.carries(np.array(actuator.userdata))]
    lags, gains = _factors(rng, lag, len(carriers)), _factors(rng, gain, len(carriers))
    table = {}
    for actuator, slower, stronger in zip(carriers, lags, gains, strict=True):
        one = thrusters.unpack(np.array(actuator.userdata))
        curve = {}
        if one.polynomial is not None:
            curve["polynomial"] = tuple(tuple(stronger * c for c in side) for side in one.polynomial)
        if one.table is not None:
            curve["table"] = (one.table[0], tuple(stronger * t for t in one.table[1]))
        table[actuator.name] = replace(
            one, forward=stronger * one.forward, reverse=stronger * one.reverse,
            least_thrust=stronger * one.least_thrust, time_constant=slower * one.time_constant, **curve,
        )  # fmt: skip
    thrusters.attach(spec, table)
    return {"thruster_lag": float(lags.mean()), "thruster_gain": float(gains.mean())} if carriers else {}


def _gears(spec: mujoco.MjSpec, spread: float, rng: np.random.Generator) -> dict[str, float]:
    names = {actuator.target for actuator in spec.actuators}
    joints = [joint for joint in spec.joints if joint.name in names]
    model, factors, table = spec.copy().compile(), _factors(rng, spread, len(joints)), {}
    dry = gear_friction.read(model, np.array([model.joint(joint.name).id for joint in joints], dtype=np.int64))
    for i, (joint, factor) in enumerate(zip(joints, factors, strict=True)):
        joint.damping = factor * np.asarray(joint.damping)
        if dry.coulomb[i] > 0.0:
            table[joint.name] = GearFriction(
                coulomb=factor * dry.coulomb[i], stiction=factor * dry.stiction[i], stribeck_speed=dry.stribeck_speed[i]
            )
    gear_friction.attach(spec, table)
    return {"gear_friction": float(factors.mean())} if joints else {}


def _pad(spec: mujoco.MjSpec, friction: float | None, stiffness: float | None) -> None:
    geom, joint = spec.geom(PAD_GEOM), spec.joint(PAD_JOINT)
    if geom is None or (stiffness is not None and joint is None):
        raise ConfigurationError(f"friction and stiffness are those of a geom {PAD_GEOM!r} on a slide {PAD_JOINT!r}")
    if friction is not None:
        geom.priority = 1  # the pad's friction holds, whatever the surface has
        geom.friction = [friction, *np.array(geom.friction)[1:]]
    if stiffness is not None:
        # Contact and the pad's spring yield one after the other: the contact is made stiff by a short time constant,
        # and the spring takes the rest. A stiffer contact by `solimp` chatters, as does a rigid pad. The time constant
        # is that of friction too; so stiff it would let go for a step in every few: its own softness is kept.
        solref = STEPS_PER_SOLREF * float(spec.option.timestep)
        drawn = spec.copy().compile()
        contact, softest = _contact_stiffness(drawn, geom, solref), SOFTEST_CONTACT * stiffness
        while contact < softest:
            solref, contact = 0.5 * solref, 4.0 * contact
            spec.option.impratio *= 0.25
        geom.solref = [solref, 1.0]
        spring, mass = 1.0 / (1.0 / stiffness - 1.0 / contact), float(drawn.body(PAD_BODY).mass[0])
        while solref < STEPS_PER_SOLREF * spec.option.timestep or spring * spec.option.timestep**2 > RESTLESS * mass:
            spec.option.timestep *= 0.5
        old_spring, old_damping = (float(np.ravel(value)[0]) for value in (joint.stiffness, joint.damping))
        # The same damping ratio on any surface.
        ratio = np.sqrt(spring / old_spring) if old_spring > 0.0 else 1.0
        damping = ratio * old_damping
        joint.stiffness, joint.damping = _first(joint.stiffness, spring), _first(joint.damping, damping)


def _contact_stiffness(model: mujoco.MjModel, geom: mujoco.MjsGeom, solref: float) -> float:
    """Force per penetration [N/m] of a light touch of `geom`, with a time constant `solref` [s] of the contact.

    MuJoCo's constraint model (documentation, Computation, Parameters): at rest f = d / (1 - d) k r / A, with the
    impedance d at no depth, k = 1 / (d_max solref)^2, and A the inverse weight of the bodies.
    """
    least, most = np.clip(np.array(geom.solimp)[:2], 1e-4, 0.9999)
    weight = float(model.body_invweight0[model.geom(geom.name).bodyid[0], 0])
    return least / (1.0 - least) / (most * solref) ** 2 / weight


def _first(old: float | Array, value: float) -> float | Array:
    """`value` in the shape of `old`: MuJoCo has made polynomials of these numbers."""
    if np.ndim(old) == 0:
        return value
    new = np.zeros_like(old)
    new[0] = value
    return new
