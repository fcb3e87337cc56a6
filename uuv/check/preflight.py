"""The fast part of a vehicle's check, before a job starts: refusals and doubts."""

import mujoco
import numpy as np

from uuv.check import doubts
from uuv.check.ready_force import BEYOND, VIEW, ReadyForce, looks_by_camera
from uuv.check.statics import AXES, authority, strongest_current, trim_of, weight_of
from uuv.models.completing.postures import PostureSearch
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import Scenario
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.tasks.insertion import InsertionTask
from uuv.tasks.seabed_sampling import SeabedSamplingTask
from uuv.tasks.surface_work import SurfaceWorkTask


def preflight(scenario: Scenario, believed: OwnVehicle) -> list[str]:
    """Doubts about a vehicle for a job, one line each.

    Args:
        scenario: Scenario of the job.
        believed: The vehicle's model of itself.

    Returns:
        The lines; none for a vehicle without doubts, and for a job without the arm.

    Raises:
        ConfigurationError: The job cannot be done: thrusters that leave a direction without thrust,
            servos instead of motors, weight that MuJoCo cancels, an arm, tool or thrusters that are
            far too weak for its set force, a camera whose view is mostly blocked by the vehicle.
    """
    task, model, vehicle = scenario.task, believed.model, believed.vehicle
    if (
        not isinstance(task, SurfaceWorkTask | InsertionTask | SeabedSamplingTask)
        or vehicle.tip < 0
    ):
        return []
    if isinstance(task, SurfaceWorkTask) and task.contactless is not None:
        return []

    more = f"; uuv check {scenario.vehicle.vehicle} gives the details"

    # Faults of the model, whatever the job.
    for fault in (
        *doubts.thruster_doubts(vehicle),
        *doubts.motor_doubts(model, vehicle),
        *doubts.gravity_doubts(model, vehicle),
    ):
        if fault.level == "fault":
            raise ConfigurationError(f"the work was not started: {fault.said}{more}")

    ready = ReadyForce.of(scenario, believed)
    if (refused := ready.refusal(scenario, BEYOND)) is not None:
        raise ConfigurationError(f"the work was not started: {refused[1]}{more}")

    search = PostureSearch(model)
    lines = []
    home = vehicle.q_home
    blocked, body = search.view_hits(home, doubts.HALF_VIEW)
    if looks_by_camera(scenario) and blocked > VIEW:
        raise ConfigurationError(
            f"the work was not started: {blocked:.0%} of the camera's view is blocked by the "
            f"vehicle itself, mostly by {body}{more}"
        )

    # Doubts, one line each.
    if (weak := ready.refusal(scenario)) is not None:
        lines.append(weak[1])
    if _wet(believed):
        lines += _water_doubts(scenario, model, vehicle)
        lines += [
            finding.said
            for finding in doubts.trim_doubts(trim_of(model, vehicle), weight_of(model, vehicle))
        ]
    return [f"doubtful: {line}" for line in lines]


def _wet(believed: OwnVehicle) -> bool:
    return hydrodynamics.is_installed() and hydrodynamics.carries_hydrodynamics(believed.model)


def _water_doubts(scenario: Scenario, model: mujoco.MjModel, vehicle: Vehicle) -> list[str]:
    """Doubts about water at the hull, near the origin, that is too fast for the thrusters."""
    lines = []
    for axis, speed in enumerate(scenario.site.strongest_water(np.zeros(3))):
        # Along one axis of the level hull.
        limit = strongest_current(model, vehicle, axis, min(authority(vehicle, axis)))
        if abs(speed) > limit:
            way = f"{abs(speed):.2f} m/s along {AXES[axis]}"
            held = f"the thrusters can hold against {limit:.2f} m/s"
            lines.append(f"the water at the hull moves at {way}, {held}")

    return lines
