"""Deviations of the plant from the controller's model: water, payload, thrusters, gears, surface, sensors.

The controller's model is nominal; the plant is built from the varied spec. A spread draws a factor uniform in 1 +-
spread for each number independently.
"""

from dataclasses import dataclass, fields, replace

import mujoco
import numpy as np
from scipy.optimize import brentq

from models import hydrodynamics
from models.arms import gear_friction
from models.arms.gear_friction import GearFriction
from models.hydrodynamics import BodyHydrodynamics
from models.naming import ARM_BASE_BODY, HULL_BODY, PAD_BODY, PAD_JOINT, TOOL_GEOM
from models.water import thrusters
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

TARGET_BODY = "target"
STEPS_PER_SOLREF = 3.0  # physics steps per time constant of the contact; MuJoCo needs at least two
RESTLESS = 0.2  # squared phase of the pad's spring in one step; from 0.26 on the pad may bounce without end
WORKING_FORCE = 60.0  # [N] at which the stiffness of pad and surface holds; a contact hardens with depth
FRICTION_TIME = 0.045  # [s] time constant of friction on a pad of set stiffness
FRICTION_STIFFNESS = 100.0  # MuJoCo's impratio: the pad creeps less than 2 mm/s under 0.8 of the friction limit
SOFTEST_CONTACT = 1.6  # least stiffness of the contact alone, times the stiffness asked for
_TRANSLATION = slice(0, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """One state of the world around a contact job; the defaults are nominal."""

    water_error: float = 0.15  # share by which all added masses and drags of the controller are wrong, alike
    water_spread: float = 0.0  # spread of each added mass and drag coefficient of the plant
    payload_spread: float = 0.0  # spread of the mass of each part of the arm
    trim_error: float = 0.0  # share of the arm's mass by which the hull is too light (negative: too heavy)
    thruster_lag_spread: float = 0.0  # spread of the time constant of each thruster
    thruster_gain_spread: float = 0.0  # spread of the gain of each thruster
    gear_spread: float = 0.0  # spread of the friction in each gear, dry and viscous alike
    friction: float | None = None  # between pad and surface; None: as the vehicle's pad
    stiffness: float | None = None  # [N/m] of pad and surface in series; None: as the vehicle's pad
    surface_offset: float = 0.0  # [m] by which the surface lies farther along the tool than identified
    vision_period: float = 0.1  # [s]
    vision_delay: float = 0.1  # [s]
    vision_noise: float = 2e-3  # [m]
    torque_noise: float = 0.01  # share of the reading
    torque_bias: float = 0.5  # [N m] uniform in +-
    seed: int = 0  # seed of the factors

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
    """Applies `variation` to a vehicle's spec in place.

    Returns:
        Means of the drawn factors by name.

    Raises:
        ConfigurationError: Stiffness or friction are set for a vehicle without a pad on a spring, or payload or trim
            for one without an arm.
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
    """Scales diagonal coefficients by one factor each, couplings by the geometric mean: all stay semidefinite."""
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
    """Scales masses and inertias of the arm's parts; the hull is ballasted for the nominal arm, less the trim error."""
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
            one,
            forward=stronger * one.forward,
            reverse=stronger * one.reverse,
            least_thrust=stronger * one.least_thrust,
            time_constant=slower * one.time_constant,
            **curve,
        )
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
    geom, joint = spec.geom(TOOL_GEOM), spec.joint(PAD_JOINT)
    if geom is None or (stiffness is not None and joint is None):
        raise ConfigurationError(f"friction and stiffness are those of a geom {TOOL_GEOM!r} on a slide {PAD_JOINT!r}")
    if friction is not None:
        geom.priority = 1  # contact pairs take the pad's friction, whatever the surface has
        geom.friction = [friction, *np.array(geom.friction)[1:]]
    if stiffness is not None:
        # Contact and pad spring are in series: the contact is made stiff by a short time constant, and the spring gives
        # the remaining compliance. A contact that is stiffer by `solimp` chatters, and so does a rigid pad. Sliding
        # lifts the contact in proportion to the time constant; the contact force presses it in with its square. The
        # longest time constant that is stiff enough is therefore the best.
        timestep, drawn = float(spec.option.timestep), spec.copy().compile()
        longest = STEPS_PER_SOLREF * timestep
        contact, softest = _contact_stiffness(drawn, geom, longest), SOFTEST_CONTACT * stiffness
        share = min(1.0, np.sqrt(contact / softest))
        geom.solref = [share * longest, 1.0]
        sunk = _sunk(WORKING_FORCE, geom, contact / share**2)
        spring, mass = WORKING_FORCE / (WORKING_FORCE / stiffness - sunk), float(drawn.body(PAD_BODY).mass[0])
        phase = timestep * np.sqrt(spring / (RESTLESS * mass))
        spec.option.timestep = timestep / np.ceil(max(1.0 / share, phase) - 1e-9)
        old_spring, old_damping = (float(np.ravel(value)[0]) for value in (joint.stiffness, joint.damping))
        # The damping ratio is the same on any surface.
        ratio = np.sqrt(spring / old_spring) if old_spring > 0.0 else 1.0
        damping = ratio * old_damping
        joint.stiffness, joint.damping = _first(joint.stiffness, spring), _first(joint.damping, damping)


def slide(scene: mujoco.MjSpec) -> None:
    """Makes the pad in `scene` slide on the target without lifting, however stiff `vary` has made it.

    MuJoCo's friction is convex: sliding at v [m/s] with the coefficient mu causes a separating acceleration mu (b v +
    r). Here b is the rate of the friction constraint and r its regularisation. A stiff contact is pressed in by no more
    than that, and loses contact every few steps. Friction therefore gets a slow rate of its own, and little
    regularisation. Parts of a mesh (`TargetModel.add_to`) have contacts of their own, and keep them.
    """
    pad, target = scene.geom(TOOL_GEOM), scene.body(TARGET_BODY)
    scene.option.impratio = FRICTION_STIFFNESS
    for geom in target.geoms:
        if not (geom.contype or geom.conaffinity) or geom.priority > pad.priority or not geom.name:
            continue
        pair = scene.add_pair(geomname1=TOOL_GEOM, geomname2=geom.name)
        sliding, spinning, rolling = np.array(pad.friction)
        pair.friction = [sliding, sliding, spinning, rolling, rolling]
        pair.condim, pair.solref, pair.solimp = pad.condim, pad.solref, pad.solimp
        pair.solreffriction = [FRICTION_TIME, 1.0]


def _contact_stiffness(model: mujoco.MjModel, geom: mujoco.MjsGeom, solref: float) -> float:
    """Stiffness [N/m] of a light touch of `geom`, with a time constant `solref` [s] of the contact.

    MuJoCo's constraint model (MuJoCo documentation, Computation, Parameters): at rest f = d / (1 - d) k r / A. Here d
    is the impedance at zero depth, k = 1 / (d_max solref)^2, and A the inverse weight of the bodies.
    """
    least, most = np.clip(np.array(geom.solimp)[:2], 1e-4, 0.9999)
    weight = float(model.body_invweight0[model.geom(geom.name).bodyid[0], 0])
    return least / (1.0 - least) / (most * solref) ** 2 / weight


def _sunk(force: float, geom: mujoco.MjsGeom, light: float) -> float:
    """Depth [m] of a contact of `geom` under `force` [N], with the stiffness `light` [N/m] at zero depth.

    MuJoCo's impedance over depth, by `solimp` (MuJoCo documentation, Modeling, Solver parameters).
    """
    least, most, width, middle, power = np.array(geom.solimp)
    low = least / (1.0 - least)

    def excess(depth: float) -> float:
        x = min(depth / width, 1.0)
        under = x <= middle
        share = (
            x**power / middle ** (power - 1.0) if under else 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
        )
        d = least + share * (most - least)
        return light / low * d / (1.0 - d) * depth - force

    return float(brentq(excess, 0.0, force / light, xtol=1e-12))


def _first(old: float | Array, value: float) -> float | Array:
    """`value` in the shape of `old`: newer MuJoCo stores polynomials for these numbers."""
    if np.ndim(old) == 0:
        return value
    new = np.zeros_like(old)
    new[0] = value
    return new
