"""Assembly of a scenario: makes plant, components and evaluation of a run, for every caller."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from uuv.components.contact_parts import believed_and_built, controller
from uuv.driving.driven_work import DrivenWork
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import OwnVehicle
from uuv.perception.navigation.raw_navigation import RawNavigation
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.perturbations.perturbation import Loop, perturb
from uuv.scenario import PlacedTask, Scenario
from uuv.sensors.arm_camera import arm_camera, believed_mount
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown
from uuv.sim.loop.rollout import Parts, ticks_per_period
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors.arm_camera import beside_tool
from uuv.sim.water.current import Current, Profile, Wave
from uuv.tasks.start_place import RunStreams, start_pose, start_refusal

# number of loop steps between measurements of the arm's reaction wrench on the hull, for the report
REACTION_TICKS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assembly:
    """An assembled scenario at its start, to be run once, since components may hold state."""

    scenario: Scenario
    placed: PlacedTask
    own: OwnVehicle  # the vehicle's model of itself
    plant: Plant  # plant of the loop, without its wrappers
    loop: Loop  # plant and components, with perturbations
    X_WB: Array  # (4, 4) initial pose of the hull
    # current before the plant's current, which is a copy, has drawn from it
    gusts: np.random.Generator
    noise: np.random.Generator  # random generator of the sensors
    full: bool  # whether the series that the report needs are recorded
    said: str  # lines for the terminal about computed components and the arm, or empty
    refused: str  # reason for which a checked run would not begin here, or empty
    drawn: Mapping[str, float]  # mean values of the factors that perturbations drew

    @property
    def parts(self) -> Parts:
        """Components of the loop."""
        return self.loop.parts

    def current(self, profile: Profile | None = None) -> Current:
        """The current of the plant from its beginning, with the additional `profile` over time."""
        current = current_of(self.scenario, self.plant.timestep, self.gusts)
        return current if profile is None else current.with_profile(profile)

    def check_start(self) -> None:
        """Refuse a run that would not begin at time 0.

        Raises:
            ConfigurationError: The plant has been stepped, as by an earlier run.
        """
        if (time := float(self.plant.truth.time)) > 0.0:
            raise ConfigurationError(
                f"run: an assembly can be run only once, and this one is at {time:.3f} s; assemble "
                "a new one for each run"
            )


def current_of(scenario: Scenario, timestep: float, gusts: np.random.Generator) -> Current:
    """The current of a scenario: current, wave, gusts and flow fields, changed by perturbations.

    Args:
        scenario: The description.
        timestep: [s] Step of the plant.
        gusts: Random generator of the gusts; its state is not changed.

    Raises:
        ConfigurationError: `on_water` of a perturbation does not return a current, or drops a flow
            field.
    """
    site = scenario.site
    wave = Wave(amplitude_W=site.wave, frequency=site.wave_frequency)
    rng = deepcopy(gusts)
    current = Current(site.current, gust=site.gust, wave=wave, timestep=timestep, rng=rng)
    if site.flow is not None:
        current = current.with_flow(site.flow)

    for perturbation in scenario.perturbations:
        changed: Any = perturbation.on_water(current)
        if not isinstance(changed, Current):
            hook = f"{type(perturbation).__name__}.on_water"
            needs = "must return a uuv.sim.water.current.Current"
            raise ConfigurationError(f"{hook}: {needs}, got {shown(changed)}")

        # Flow fields of the argument must be in the result, or an error names the missing one.
        for flow in current.flows:
            if all(flow is not remaining for remaining in changed.flows):
                hook = f"{type(perturbation).__name__}.on_water"
                field = type(flow).__name__
                lost = f"returns a current without the flow field {field} of its argument"
                raise ConfigurationError(f"{hook}: {lost}; use `with_flow`, which keeps all fields")
        current = changed
    return current


def innermost(plant: Any) -> Plant | None:
    """The `Plant` inside wrappers that hold it in an attribute `plant`; None if there is none."""
    while not isinstance(plant, Plant):
        if not hasattr(plant, "plant"):
            return None
        plant = plant.plant
    return plant


def assemble(scenario: Scenario, *, full: bool = False) -> Assembly:
    """Assemble a scenario without any output.

    Args:
        scenario: The description.
        full: Whether to record the series that the report needs.

    Returns:
        Plant, components and evaluation, ready to run.

    Raises:
        UuvError: The vehicle lacks a part, or a value of the scenario is out of range.
    """
    rng = np.random.default_rng(scenario.seed)
    task = scenario.task
    believed, built, message = believed_and_built(scenario.vehicle, scenario.belief, task)

    # Timestep of the loop; the physics of a stiff surface needs a shorter one.
    timestep = float(built.option.timestep)
    drawn = perturb(built, scenario.perturbations, scenario.perturbation_seed)
    believed_vehicle = OwnVehicle.of(believed, task.spares)
    placed = _placed(scenario, believed_vehicle, rng)

    # The true world, and a start that deviates from the task's unless that is exact.
    streams = RunStreams.of(rng)
    model = _compiled(placed.scene(built), scenario)
    X_WB = start_pose(placed, streams.start)
    refused = start_refusal(model, Vehicle.of(model), X_WB)
    if refused and not scenario.vehicle.unchecked:
        raise ConfigurationError(refused)

    substeps = ticks_per_period(timestep, float(model.opt.timestep), "the loop's step")
    plant = Plant(
        model,
        current=current_of(scenario, substeps * float(model.opt.timestep), streams.gusts),
        X_WB=X_WB,
        reaction_ticks=REACTION_TICKS if full else 0,
        substeps=substeps,
    )

    parts = _parts(scenario, placed, believed_vehicle, model, int(streams.sampling.integers(2**31)))
    loop = Loop(plant=plant, parts=parts, observers=placed.observers())
    for perturbation in scenario.perturbations:
        loop = perturbation.on_loop(loop)

    return Assembly(
        scenario=scenario,
        placed=placed,
        own=believed_vehicle,
        plant=innermost(loop.plant) or plant,
        loop=loop,
        X_WB=X_WB,
        gusts=streams.gusts,
        noise=streams.noise,
        full=full,
        said=message,
        refused=refused,
        drawn=drawn,
    )


def _placed(scenario: Scenario, vehicle: OwnVehicle, rng: np.random.Generator) -> PlacedTask:
    """The task at its site; the result of a user's own task is checked."""
    placed: Any = scenario.task.place(scenario, vehicle, rng)
    if not isinstance(placed, PlacedTask):
        kind = type(scenario.task).__name__
        got = type(placed).__name__
        raise ConfigurationError(f"task {kind}: place must return a PlacedTask, got {got}")
    return placed if scenario.control.operator is None else DrivenWork.of(placed, scenario, vehicle)


def _compiled(scene: mujoco.MjSpec, scenario: Scenario) -> mujoco.MjModel:
    """The perturbed scene, compiled. A scene with its own current is refused, since a run would
    overwrite it.
    """
    for perturbation in scenario.perturbations:
        perturbation.on_scene(scene)
    model = hydrodynamics.compile(scene)
    if np.any(model.opt.wind):
        raise ConfigurationError(
            "opt.wind of vehicle or scene: must be 0, since a run overwrites it, got "
            f"{shown(model.opt.wind)} m/s; set the current by site.current, site.flow or "
            "`on_water` of a perturbation"
        )
    return model


def _parts(
    scenario: Scenario, placed: PlacedTask, vehicle: OwnVehicle, model: mujoco.MjModel, seed: int
) -> Parts:
    """Components of the loop.

    Args:
        scenario: The description.
        placed: Task of the scenario at the site.
        vehicle: The vehicle's model of itself.
        model: The true world, compiled.
        seed: Seed of the finder's random sampling.
    """
    seeing, sensor_model = placed.sensors(model)
    without = frozenset(scenario.control.without)
    on_arm = scenario.sensing.arm_camera
    checked = "gyro-check" not in without

    # The camera on the arm comes last, so that the other sensors draw the same numbers as without
    # it.
    if on_arm is not None:
        seeing = [*seeing, arm_camera(on_arm, model)]
        fused = Navigation(arm_camera=believed_mount(vehicle, beside_tool()), check_gyro=checked)
    else:
        standing = believed_mount(vehicle) if placed.stands else None
        fused = Navigation(standing=standing, check_gyro=checked)

    work = placed.controller()
    if work is None:
        error = scenario.belief.water_error
        work = controller(scenario.control, vehicle.model, water_error=error)
    return Parts(
        sensors=[*scenario.sensing.proprioception(), *seeing],
        estimator=placed.estimator(RawNavigation() if "fusion" in without else fused),
        finder=placed.finder(sensor_model, seed),
        planner=placed.planner(),
        controller=work,
        follower=placed.follower(sensor_model) if scenario.sensing.follow else None,
    )
