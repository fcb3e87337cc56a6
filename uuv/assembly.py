"""Assembly of a scenario: the one place where plant, parts and evaluation of a run are made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from uuv.components.contact_parts import believed_and_built, controller
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import OwnVehicle
from uuv.perception.navigation.raw_navigation import RawNavigation
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.perturbations.perturbation import Loop, perturb
from uuv.scenario import PlacedTask, Scenario
from uuv.sensors.arm_camera import arm_camera, believed_mount
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.loop.rollout import Parts, ticks_per_period
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors.arm_camera import beside_tool
from uuv.sim.water.current import Current, Wave
from uuv.tasks.start_place import check_start

REACTION_TICKS = 10  # loop steps between measurements of the arm's reaction wrench on the hull, for the report


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assembly:
    """An assembled scenario, to be run once: its random number generators are consumed."""

    scenario: Scenario
    placed: PlacedTask
    own: OwnVehicle  # the vehicle's model of itself
    plant: Plant
    loop: Loop  # plant and parts as perturbed
    X_WB: Array  # (4, 4) initial pose of the hull
    gusts: np.random.Generator
    noise: np.random.Generator  # of the sensors
    full: bool  # record what the report needs
    said: str  # lines about computed parts and the arm for the terminal, or empty
    drawn: Mapping[str, float]  # means of the factors that perturbations drew

    @property
    def parts(self) -> Parts:
        """Parts of the loop."""
        return self.loop.parts

    def current(self, profile: Callable[[float], tuple[float, float]] | None = None) -> Current:
        """The current from its beginning, with wave and gusts; `profile` changes it in time."""
        site, dt = self.scenario.site, self.plant.timestep
        wave = Wave(amplitude_W=site.wave, frequency=site.wave_frequency)
        return Current(site.current, gust=site.gust, wave=wave, timestep=dt, rng=self.gusts, profile=profile)

    def restart(self) -> None:
        """Resets the plant to its start, gusts included."""
        self.plant.reset(current=self.current(), X_WB=self.X_WB)


def assemble(scenario: Scenario, *, full: bool = False) -> Assembly:
    """Assembles a scenario without any output.

    Args:
        scenario: The description.
        full: Record what the report needs.

    Returns:
        Plant, parts and evaluation, ready to run.

    Raises:
        UuvError: The vehicle lacks a part, or a value of the scenario is out of range.
    """
    rng, task = np.random.default_rng(scenario.seed), scenario.task
    believed, built, said = believed_and_built(scenario.vehicle, scenario.belief, task)
    timestep = float(built.option.timestep)  # of the loop; a stiff surface needs a shorter timestep of the physics
    drawn = perturb(built, scenario.perturbations, scenario.perturbation_seed)
    own = OwnVehicle.of(believed, task.spares)
    placed = task.place(scenario, own, rng)
    gusts, noise, start, sampling = rng.spawn(4)
    scene = placed.scene(built)
    for perturbation in scenario.perturbations:
        perturbation.on_scene(scene)
    model = hydrodynamics.compile(scene)
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    X_WB = placed.X_WB if placed.exact_start else placed.X_WB @ offset
    check_start(model, Vehicle.of(model), X_WB)
    plant = Plant(
        model,
        current=Current(scenario.site.current),
        X_WB=X_WB,
        reaction_ticks=REACTION_TICKS if full else 0,
        soil=placed.soil,
        substeps=ticks_per_period(timestep, float(model.opt.timestep), "the loop's step"),
    )
    seeing, sensor_model = placed.sensors(model)
    without = frozenset(scenario.control.without)
    on_arm, checked = scenario.sensing.arm_camera, "gyro-check" not in without
    if on_arm is not None:  # last, so that the other sensors draw as without it
        seeing = [*seeing, arm_camera(on_arm, model)]
        fused = Navigation(arm_camera=believed_mount(own, beside_tool()), check_gyro=checked)
    else:
        fused = Navigation(standing=believed_mount(own) if placed.stands else None, check_gyro=checked)
    parts = Parts(
        sensors=[*scenario.sensing.proprioception(), *seeing],
        estimator=placed.estimator(RawNavigation() if "fusion" in without else fused),
        finder=placed.finder(sensor_model, int(sampling.integers(2**31))),
        planner=placed.planner(),
        controller=placed.controller()
        or controller(scenario.control, own.model, water_error=scenario.belief.water_error),
        follower=placed.follower(sensor_model) if scenario.sensing.follow else None,
    )
    loop = Loop(plant=plant, parts=parts, observers=placed.observers())
    for perturbation in scenario.perturbations:
        loop = perturbation.on_loop(loop)
    return Assembly(
        scenario=scenario,
        placed=placed,
        own=own,
        plant=plant,
        loop=loop,
        X_WB=X_WB,
        gusts=gusts,
        noise=noise,
        full=full,
        said=said,
        drawn=drawn,
    )
