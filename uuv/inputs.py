"""Inputs of a run, checked before compiling: names by the registries, files by their readers.

A door calls `check_inputs` before it imports what runs a scenario, and before `first_start.build`.
Nothing compiled is called here, so that what is refused is refused at once, also in a clone without
compiled kernels.
"""

from collections.abc import Collection
from pathlib import Path

import mujoco

from uuv.controllers.driving.operator_inputs import OperatorInputs
from uuv.kinds import CONTROLLER, CONTROLLERS, SENSORS, class_of
from uuv.models.files.vehicle_file import check_name
from uuv.models.tools.tools import TOOLS
from uuv.own_vehicle import vehicle_spec
from uuv.scenario import KEYBOARD, Operator, Scenario, VehicleSetup
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number

_MOST_SECONDS = 1e6  # [s] simulated in one run


def check_inputs(
    scenario: Scenario, longest: float | None = None, *, keyboard: bool = False
) -> None:
    """Refuses a scenario with unknown names, or files that are unreadable or lack what it needs.

    Args:
        scenario: The description.
        longest: [s] limit of the simulated time; None: that of the task.
        keyboard: An operator's inputs may come while the run goes on.

    Raises:
        ConfigurationError: Which name or file, what is allowed, and what was given.
    """
    # Names cost nothing: they come first.
    CONTROLLERS.resolve(scenario.control.controller)
    SENSORS.resolve(scenario.sensing.sensor)
    _check_names(scenario.vehicle)

    # Files of the job, and the object that it works on.
    scenario.task.check_inputs(scenario)
    _check_operator(scenario.control.operator, keyboard=keyboard)
    if longest is not None:
        _check_limit(scenario, longest)
    if scenario.belief.arm is not None:
        from uuv.calib.arm_files import read_arm

        read_arm(Path(scenario.belief.arm))

    # A user's own classes.
    if ":" in scenario.control.controller:
        class_of(scenario.control.controller, CONTROLLER)
    if ":" in scenario.sensing.sensor:
        SENSORS.maker(scenario.sensing.sensor)

    # Last the vehicle: its thrusters bring numba, though they call nothing compiled.
    spec = check_vehicle(scenario.vehicle, scenario.task.tool, scenario.task.spares)
    for perturbation in scenario.perturbations:
        perturbation.check_inputs(spec)


def check_vehicle(
    setup: VehicleSetup, needs: str | None = None, spares: Collection[str] | None = None
) -> mujoco.MjSpec:
    """Refuses a vehicle that there is not, whose files cannot be read, or that lacks parts.

    Args:
        setup: The vehicle.
        needs: Tool of a task, as for `uuv.own_vehicle.vehicle_spec`.
        spares: Named parts that it can do without; None: it is not asked for any.

    Returns:
        Its spec, without the parts that are computed.

    Raises:
        ConfigurationError: Which vehicle, file or part.
    """
    _check_names(setup)
    spec = vehicle_spec(
        setup.vehicle, setup.tool, setup.parts, needs, spares=spares, computed=False
    )
    if setup.battery is not None:
        from uuv.models.water import battery_feed

        battery_feed.attach(spec, setup.battery)
    return spec


def _check_operator(operator: Operator | None, *, keyboard: bool) -> None:
    if operator is None:
        return
    if operator.inputs != KEYBOARD:
        OperatorInputs.read(operator.inputs)
    elif not keyboard:
        raise ConfigurationError(
            f"control.operator.inputs: only `uuv drive` has a {KEYBOARD}; elsewhere the name of a "
            "file"
        )


def _check_limit(scenario: Scenario, longest: float) -> None:
    finite_number(longest, "longest [s]", above=0.0, most=_MOST_SECONDS)
    least = scenario.task.least_seconds(scenario) if scenario.control.operator is None else 0.0
    if longest < least:
        raise ConfigurationError(f"longest {longest:g} s: the work alone takes {least:.0f} s")


def _check_names(setup: VehicleSetup) -> None:
    if setup.tool is not None:
        TOOLS.resolve(setup.tool)
    check_name(setup.vehicle)
