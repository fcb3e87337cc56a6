"""Perturbations of the vehicle: hydrodynamics, payload, thrusters, gears.

For each number a factor is drawn independently and uniformly in 1 +- spread.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.models.naming import ARM_BASE_BODY, HULL_BODY
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number

if TYPE_CHECKING:
    import mujoco

_TRANSLATION = slice(0, 3)


@dataclass(frozen=True, kw_only=True)
class _Spread(Perturbation):
    """Perturbation whose fields are spreads, except for those in `signed`."""

    signed: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            name = f"{type(self).__name__} {field.name}"
            spread = getattr(self, field.name)
            if field.name in self.signed:
                finite_number(spread, name)
            elif not 0.0 <= finite_number(spread, name) < 1.0:
                raise ConfigurationError(f"{name}: must be in [0, 1), got {spread}")


@dataclass(frozen=True, kw_only=True)
class Water(_Spread):
    """Perturbation of added mass and drag of every body of the plant."""

    stream: ClassVar[int | None] = 0
    spread: float = 0.0  # spread of each coefficient

    def on_vehicle(self, spec: "mujoco.MjSpec", rng: np.random.Generator) -> Mapping[str, float]:
        """Scale each diagonal coefficient by its factor, and couplings by the geometric mean of two
        factors.

        All matrices stay semidefinite.
        """
        from uuv.models import hydrodynamics

        if not self.spread:
            return {}

        bodies = hydrodynamics.attached(spec)
        hull: dict[str, float] = {}
        for name, body in bodies.items():
            added, linear, quadratic, strip = (
                _factors(rng, self.spread, size) for size in (6, 6, 6, 2)
            )

            bodies[name] = replace(
                body,
                added_mass=_scaled(body.added_mass, added),
                linear_damping=_scaled(body.linear_damping, linear),
                quadratic_damping=quadratic * body.quadratic_damping,
                strips=tuple(
                    replace(s, normal=strip[0] * s.normal, tangential=strip[1] * s.tangential)
                    for s in body.segments
                ),
                forms=tuple(
                    form.scaled(float(factor))
                    for form, factor in zip(
                        body.terms, _factors(rng, self.spread, len(body.terms)), strict=True
                    )
                ),
            )

            if name == HULL_BODY:
                hull = {
                    "hull_added_mass": float(added[_TRANSLATION].mean()),
                    "hull_drag": float(quadratic[_TRANSLATION].mean()),
                }

        hydrodynamics.attach(spec, bodies)
        return hull


@dataclass(frozen=True, kw_only=True)
class Payload(_Spread):
    """Perturbation of the masses of the arm's parts, and of the ballast of the hull."""

    stream: ClassVar[int | None] = 1
    signed: ClassVar[tuple[str, ...]] = ("trim_error",)
    spread: float = 0.0  # spread of the mass of each part of the arm
    # share of the arm's mass by which the hull is too light (negative: too heavy)
    trim_error: float = 0.0

    def on_vehicle(self, spec: "mujoco.MjSpec", rng: np.random.Generator) -> Mapping[str, float]:
        """Scale masses and inertias. The hull is ballasted for the nominal arm, minus the trim
        error.
        """
        import mujoco

        from uuv.models import hydrodynamics

        if not (self.spread or self.trim_error):
            return {}
        arm = spec.body(ARM_BASE_BODY)
        if arm is None:
            raise ConfigurationError(
                f"Payload: varies the arm, so the vehicle must have a body named {ARM_BASE_BODY!r}"
            )

        parts = [arm, *arm.find_all(mujoco.mjtObj.mjOBJ_BODY)]
        before = sum(float(part.mass) for part in parts)
        for part, factor in zip(parts, _factors(rng, self.spread, len(parts)), strict=True):
            part.mass = factor * float(part.mass)
            part.inertia = factor * np.array(part.inertia)
        after = sum(float(part.mass) for part in parts)

        water = hydrodynamics.attached(spec)[HULL_BODY]
        lift = self.trim_error * before / hydrodynamics.density_of(spec)  # [m^3]
        hydrodynamics.attach(spec, {HULL_BODY: replace(water, volume=water.volume + lift)})
        return {
            "arm_mass": after / before,
            "too_heavy_kg": after - before - self.trim_error * before,
        }


@dataclass(frozen=True, kw_only=True)
class ThrusterSpread(_Spread):
    """Perturbation of time constant and gain of each thruster."""

    stream: ClassVar[int | None] = 2
    lag: float = 0.0  # spread of the time constants
    gain: float = 0.0  # spread of the gains

    def on_vehicle(self, spec: "mujoco.MjSpec", rng: np.random.Generator) -> Mapping[str, float]:
        """Scale the thrusters' tables."""
        from uuv.models.water import thrusters

        if not (self.lag or self.gain):
            return {}

        carriers = [
            actuator
            for actuator in spec.actuators
            if thrusters.carries(np.array(actuator.userdata))
        ]
        lags, gains = (
            _factors(rng, self.lag, len(carriers)),
            _factors(rng, self.gain, len(carriers)),
        )

        table = {}
        for actuator, slower, stronger in zip(carriers, lags, gains, strict=True):
            thruster = thrusters.unpack(np.array(actuator.userdata))
            curve = {}

            if thruster.polynomial is not None:
                curve["polynomial"] = tuple(
                    tuple(stronger * c for c in side) for side in thruster.polynomial
                )
            if thruster.table is not None:
                curve["table"] = (thruster.table[0], tuple(stronger * t for t in thruster.table[1]))

            table[actuator.name] = replace(
                thruster,
                forward=stronger * thruster.forward,
                reverse=stronger * thruster.reverse,
                least_thrust=stronger * thruster.least_thrust,
                sheets=tuple(sheet.stronger(float(stronger)) for sheet in thruster.sheets),
                time_constant=slower * thruster.time_constant,
                **curve,
            )

        thrusters.attach(spec, table)
        return (
            {"thruster_lag": float(lags.mean()), "thruster_gain": float(gains.mean())}
            if carriers
            else {}
        )


@dataclass(frozen=True, kw_only=True)
class BelievedVoltage(Perturbation):
    """The controller assumes a wrong voltage of the thrusters' supply.

    The thrust allocation uses the voltage of the vehicle's thrusters, or of its battery. The true
    voltage is lower by `error`, and the true battery's voltage sags in addition.
    """

    error: float = 0.0  # [V] believed minus true voltage

    def __post_init__(self) -> None:
        finite_number(self.error, "BelievedVoltage error [V]")

    def check_inputs(self, spec: "mujoco.MjSpec") -> None:
        """Refuse a vehicle whose thrusters have no tables at that voltage."""
        self.on_vehicle(spec.copy(), np.random.default_rng(0))

    def on_vehicle(self, spec: "mujoco.MjSpec", rng: np.random.Generator) -> Mapping[str, float]:
        """Set the true thrusters' curves, and the battery, to the lower voltage."""
        from uuv.models.water import battery_feed

        del rng
        if not self.error:
            return {}
        try:
            battery_feed.weaken(spec, self.error)
        except ConfigurationError as error:
            raise ConfigurationError(f"BelievedVoltage error {self.error:g} V: {error}") from error
        return {"voltage_error": self.error}


@dataclass(frozen=True, kw_only=True)
class Gears(_Spread):
    """Friction in each gear; dry and viscous friction get the same factor."""

    stream: ClassVar[int | None] = 3
    spread: float = 0.0

    def on_vehicle(self, spec: "mujoco.MjSpec", rng: np.random.Generator) -> Mapping[str, float]:
        """Scale the friction of each driven joint."""
        from uuv.models.arms import gear_friction
        from uuv.models.arms.gear_friction import GearFriction

        if not self.spread:
            return {}

        names = {actuator.target for actuator in spec.actuators}
        joints = [joint for joint in spec.joints if joint.name in names]
        model = spec.copy().compile()
        factors = _factors(rng, self.spread, len(joints))
        table = {}

        dry = gear_friction.read(
            model, np.array([model.joint(joint.name).id for joint in joints], dtype=np.int64)
        )

        for i, (joint, factor) in enumerate(zip(joints, factors, strict=True)):
            joint.damping = factor * np.asarray(joint.damping)
            if dry.coulomb[i] > 0.0:
                table[joint.name] = GearFriction(
                    coulomb=factor * dry.coulomb[i],
                    stiction=factor * dry.stiction[i],
                    stribeck_speed=dry.stribeck_speed[i],
                )

        gear_friction.attach(spec, table)
        return {"gear_friction": float(factors.mean())} if joints else {}


def _factors(rng: np.random.Generator, spread: float, size: int) -> Array:
    return rng.uniform(1.0 - spread, 1.0 + spread, size)


def _scaled(matrix: Array, factors: Array) -> Array:
    root = np.sqrt(factors)
    return root[:, None] * matrix * root
