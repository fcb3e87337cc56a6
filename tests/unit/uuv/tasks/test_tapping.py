"""Tapping is judged by what it does: force at points, no speed along a path."""

from dataclasses import replace

import numpy as np

from uuv.check.checked_jobs import ARM_JOBS
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.tasks.surface_work import PlacedSurfaceWork


def test_no_speed_is_asked_of_a_tool_that_only_touches() -> None:
    scenario = ARM_JOBS["tap"](forces=(30.0,))
    own = OwnVehicle.of(vehicle_spec("uuv_puma"))
    placed = scenario.task.place(scenario, own, np.random.default_rng(0))
    assert isinstance(placed, PlacedSurfaceWork)
    assert (placed.asked.forces, placed.asked.speed) == ((30.0,), None)

    # Work along a path is judged by its speed too.
    along = replace(ARM_JOBS["barrel-longitudinal"](), seed=1)
    worked = along.task.place(along, own, np.random.default_rng(1))
    assert isinstance(worked, PlacedSurfaceWork)
    assert worked.asked.speed == 0.02
