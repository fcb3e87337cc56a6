"""The fast part of a vehicle's check, before a job starts: refusals and doubts."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.check import doubts
from uuv.check.hidden_force import HiddenForce
from uuv.check.range_error import RangeError
from uuv.check.ready_force import BEYOND, VIEW, ReadyForce, looks_by_camera
from uuv.check.statics import AXES, authority, strongest_current, trim_of, weight_of
from uuv.models.completing.postures import PostureSearch
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import Scenario
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.site import Workpiece
from uuv.tasks.approach import object_of
from uuv.tasks.insertion import InsertionTask
from uuv.tasks.seabed_sampling import SeabedSamplingTask
from uuv.tasks.surface_work import SurfaceWorkTask, work_bounds


@dataclass(frozen=True, slots=True, kw_only=True)
class Preflight:
    """Refusals and doubts about a job before its start, one line each."""

    refused: tuple[str, ...] = ()  # why it would not be started, of an unchecked run
    doubtful: tuple[str, ...] = ()

    @property
    def lines(self) -> tuple[str, ...]:
        """All lines, for the terminal."""
        refused = (f"not checked: {line}" for line in self.refused)
        return (*refused, *(f"doubtful: {line}" for line in self.doubtful))


def preflight(scenario: Scenario, believed: OwnVehicle) -> Preflight:
    """Refusals of a job by the fast checks, and doubts about the vehicle, one line each.

    Args:
        scenario: Scenario of the job.
        believed: The vehicle's model of itself.

    Returns:
        The lines; none for a vehicle without doubts, and for a job without the arm.

    Raises:
        ConfigurationError: The job cannot be done, and it is not to run `unchecked`: thrusters
            that leave a direction without thrust, servos for motors, weight that MuJoCo takes away,
            an arm, tool or thrusters that bear far less than it sets, a camera that sees little but
            the vehicle.
    """
    task, model, vehicle = scenario.task, believed.model, believed.vehicle
    if (
        not isinstance(task, SurfaceWorkTask | InsertionTask | SeabedSamplingTask)
        or vehicle.tip < 0
    ):
        return Preflight()
    if isinstance(task, SurfaceWorkTask) and task.contactless is not None:
        return Preflight()

    ready = ReadyForce.of(scenario, believed)
    refused = tuple(_refusals(scenario, believed, ready))
    if refused and not scenario.vehicle.unchecked:
        more = (
            f"uuv check {scenario.vehicle.vehicle} lists feasible jobs, --unchecked runs this one"
        )
        raise ConfigurationError(f"the work was not started: {refused[0]}; {more}")

    # What is doubtful only.
    lines = []
    if not refused and (weak := ready.refusal()) is not None:
        lines.append(f"{weak[1]}; uuv check finds a set force that passes")
    if _wet(believed):
        lines += _water_doubts(scenario, model, vehicle)
        lines += [
            finding.said
            for finding in doubts.trim_doubts(trim_of(model, vehicle), weight_of(model, vehicle))
        ]
    return Preflight(refused=refused, doubtful=tuple(lines))


def _refusals(scenario: Scenario, believed: OwnVehicle, ready: ReadyForce) -> Iterator[str]:
    """Reasons not to start the work, one line each."""
    model = believed.model
    vehicle = believed.vehicle

    # Faults of the model, whatever the job.
    for fault in (
        *doubts.thruster_doubts(vehicle),
        *doubts.motor_doubts(model, vehicle),
        *doubts.gravity_doubts(model, vehicle),
    ):
        if fault.level == "fault":
            yield fault.said

    if (weak := ready.refusal(BEYOND)) is not None:
        yield weak[1]

    if scenario.control.force_from == "motors":
        bounds = work_bounds(believed)
        hidden = HiddenForce.of(believed)
        if message := hidden.refusal(bounds.force_error_rms, bounds.force_error_max):
            yield message

    if isinstance(scenario.task, SurfaceWorkTask) and looks_by_camera(scenario):
        workpiece: Workpiece = object_of(scenario, Workpiece)
        errors = RangeError.of(workpiece.target(scenario.task.path)[0])
        if message := errors.refusal(scenario.task.range, work_bounds(believed)):
            yield message

    blocked, body = PostureSearch(model).view_hits(vehicle.q_home, doubts.HALF_VIEW)
    if looks_by_camera(scenario) and blocked > VIEW:
        share = f"{blocked:.0%} of the camera's view is blocked by the vehicle itself"
        yield f"{share}, mostly by {body}"


def _wet(believed: OwnVehicle) -> bool:
    return hydrodynamics.is_installed() and hydrodynamics.carries_hydrodynamics(believed.model)


def _water_doubts(scenario: Scenario, model: mujoco.MjModel, vehicle: Vehicle) -> list[str]:
    """Doubts about water near the origin, if it is faster than the thrusters can hold against."""
    lines = []
    for axis, speed in enumerate(scenario.site.strongest_water(np.zeros(3))):
        # Along one axis of the level hull.
        limit = strongest_current(model, vehicle, axis, min(authority(vehicle, axis)))
        if abs(speed) > limit:
            way = f"{abs(speed):.2f} m/s along {AXES[axis]}"
            held = f"the thrusters can hold against {limit:.2f} m/s"
            lines.append(f"the water at the hull moves at {way}, {held}")

    return lines
