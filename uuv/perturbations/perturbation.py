"""Perturbation: base class, registry, and the application of a list of perturbations.

A new perturbation is a frozen dataclass that overrides one hook, here with its own random draw:

    @dataclass(frozen=True, kw_only=True)
    class HeavyTool(Perturbation):
        spread: float = 0.2

        def on_vehicle(self, spec, rng):
            factor = rng.uniform(1.0, 1.0 + self.spread)
            spec.body("pad").mass = factor * spec.body("pad").mass
            return {"tool_mass": factor}

A package registers a perturbation for scenario files by an entry point of the group
`uuv_arm.perturbation`.
"""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.models.registry import Registry
from uuv.sim.loop.rollout import Observer, Parts, SteppedPlant

if TYPE_CHECKING:  # imports kernels
    import mujoco

    from uuv.sim.water.current import Current


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop:
    """Contents of the loop: plant, components, and observers besides the recorder."""

    plant: SteppedPlant
    parts: Parts
    observers: tuple[Observer, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """Base of perturbations: deviations of the plant from the model. A subclass overrides one hook
    or more.
    """

    # seed of the random draws; None: derived from the class's name
    stream: ClassVar[int | None] = None
    # True if it may be added to a saved run, since it changes nothing before its onset
    joins: ClassVar[bool] = False

    def check_inputs(self, spec: "mujoco.MjSpec") -> None:
        """Refuse names that `spec` lacks, before compilation; by default there are no names."""

    def on_vehicle(self, spec: "mujoco.MjSpec", rng: np.random.Generator) -> Mapping[str, float]:
        """Change the true vehicle's spec in place; return the mean values of drawn factors by
        name.
        """
        return {}

    def on_scene(self, scene: "mujoco.MjSpec") -> None:
        """Change the spec of vehicle and site in place."""

    def on_water(self, current: "Current") -> "Current":
        """The current of the run: `current`, `current` with a further flow field, or another
        current.
        """
        return current

    def on_loop(self, loop: Loop) -> Loop:
        """The loop with components wrapped or replaced; its plant is at the start of the run."""
        return loop

    def rng(self, seed: int) -> np.random.Generator:
        """Random stream of this kind, independent of other perturbations."""
        stream = zlib.crc32(type(self).__name__.encode()) if self.stream is None else self.stream
        return np.random.default_rng(np.random.SeedSequence([seed, 7], spawn_key=(stream,)))


def perturb(
    spec: "mujoco.MjSpec", perturbations: Iterable[Perturbation], seed: int = 0
) -> dict[str, float]:
    """Apply perturbations to a vehicle's `spec` in place, in their order.

    Args:
        spec: The true vehicle.
        perturbations: Perturbations of a scenario.
        seed: Seed of the draws.

    Returns:
        Mean values of the drawn factors by name.

    Raises:
        ConfigurationError: The vehicle lacks a part that a perturbation changes.
    """
    drawn: dict[str, float] = {}
    for perturbation in perturbations:
        drawn |= perturbation.on_vehicle(spec, perturbation.rng(seed))
    return drawn


@cache
def registry() -> Registry[Perturbation]:
    """All kinds of perturbation, those of other packages included."""
    # Names in a scenario file are those of the classes, which are imported when used.
    kinds = {
        "Water": "uuv.perturbations.vehicle:Water",
        "Payload": "uuv.perturbations.vehicle:Payload",
        "Thrusters": "uuv.perturbations.vehicle:ThrusterSpread",
        "BelievedVoltage": "uuv.perturbations.vehicle:BelievedVoltage",
        "Gears": "uuv.perturbations.vehicle:Gears",
        "Wake": "uuv.perturbations.wake:Wake",
        "Pad": "uuv.perturbations.pad:Pad",
        "ElasticGears": "uuv.perturbations.elastic_gears:ElasticGears",
        "WanderingVision": "uuv.perturbations.sensing:WanderingVision",
        "DriftingTorque": "uuv.perturbations.sensing:DriftingTorque",
        "AttitudeError": "uuv.perturbations.sensing:AttitudeError",
        "MovingObject": "uuv.perturbations.target:MovingObject",
        "MountedObject": "uuv.perturbations.target:MountedObject",
        "MisplacedSurface": "uuv.perturbations.loop:MisplacedSurface",
        "PushedObject": "uuv.perturbations.target:PushedObject",
        "ThrusterFailure": "uuv.perturbations.loop:ThrusterFailure",
        "SensorFailure": "uuv.perturbations.loop:SensorFailure",
        "JawFailure": "uuv.perturbations.jaws:JawFailure",
    }

    return Registry("perturbation", kinds)
