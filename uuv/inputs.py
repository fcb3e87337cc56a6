"""Inputs of a run, checked before compilation: names by the registries, files by their readers.

Every command calls `check_inputs` before it imports the code that runs a scenario, and before
`first_start.build`. Nothing compiled is called here, so that an invalid input is refused at once,
also in a clone without compiled kernels.
"""

from collections.abc import Collection
from pathlib import Path

import mujoco

from uuv.controllers.driving.operator_inputs import OperatorInputs
from uuv.kinds import CONTROLLER, CONTROLLERS, SENSORS, class_of
from uuv.models.files.vehicle_file import check_name
from uuv.models.tools.tools import TOOLS
from uuv.own_vehicle import vehicle_spec
from uuv.scenario import LIVE, Operator, Scenario, VehicleSetup
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number

_MOST_SECONDS = 1e6  # [s] largest simulated time of one run


def check_inputs(scenario: Scenario, longest: float | None = None, *, live: bool = False) -> None:
    """Refuse a scenario with unknown names, or with files that cannot be read or lack required
    content.

    Args:
        scenario: The description.
        longest: [s] limit of the simulated time; None: that of the task.
        live: Whether an operator's inputs may come during the run.

    Raises:
        ConfigurationError: The message names the name or file, the allowed values and the given
            one.
    """
    # Names come first, because their check is fast.
    CONTROLLERS.resolve(scenario.control.controller)
    SENSORS.resolve(scenario.sensing.sensor)
    _check_names(scenario.vehicle)

    # Files of the job, and the object that it works on.
    scenario.task.check_inputs(scenario)
    _check_operator(scenario.control.operator, live=live)
    if longest is not None:
        _check_limit(scenario, longest)
    if scenario.belief.arm is not None:
        from uuv.calib.arm_files import read_arm

        read_arm(Path(scenario.belief.arm))

    # User-defined classes.
    if ":" in scenario.control.controller:
        class_of(scenario.control.controller, CONTROLLER)
    if ":" in scenario.sensing.sensor:
        SENSORS.maker(scenario.sensing.sensor)

    # The vehicle comes last: its thrusters import numba, although nothing compiled is called.
    spec = check_vehicle(scenario.vehicle, scenario.task.tool, scenario.task.spares)
    for perturbation in scenario.perturbations:
        perturbation.check_inputs(spec)


def check_vehicle(
    setup: VehicleSetup, needs: str | None = None, spares: Collection[str] | None = None
) -> mujoco.MjSpec:
    """Refuse a vehicle that does not exist, whose files cannot be read, or that lacks parts.

    Args:
        setup: The vehicle.
        needs: Tool that a task needs, as for `uuv.own_vehicle.vehicle_spec`.
        spares: Named parts that the work does not need; None: no part is required.

    Returns:
        Spec of the vehicle, without computed parts.

    Raises:
        ConfigurationError: The message names the vehicle, file or part.
    """
    _check_names(setup)
    spec = vehicle_spec(
        setup.vehicle, setup.tool, setup.parts, needs, spares=spares, computed=False
    )
    if setup.battery is not None:
        from uuv.models.water import battery_feed

        battery_feed.attach(spec, setup.battery)
    return spec


def _check_operator(operator: Operator | None, *, live: bool) -> None:
    if operator is None:
        return
    if operator.inputs not in LIVE:
        OperatorInputs.read(operator.inputs)
    elif not live:
        raise ConfigurationError(
            f"control.operator.inputs: must be the name of a file; {operator.inputs} is only "
            "allowed in `uuv drive`"
        )


def _check_limit(scenario: Scenario, longest: float) -> None:
    finite_number(longest, "longest [s]", above=0.0, most=_MOST_SECONDS)
    least = scenario.task.least_seconds(scenario) if scenario.control.operator is None else 0.0
    if longest < least:
        raise ConfigurationError(
            f"longest {longest:g} s: must be longer than the work, which takes at least "
            f"{least:.0f} s"
        )


def _check_names(setup: VehicleSetup) -> None:
    if setup.tool is not None:
        TOOLS.resolve(setup.tool)
    check_name(setup.vehicle)
