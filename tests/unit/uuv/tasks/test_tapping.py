"""Tapping is judged by what it does: force at points, no speed along a path."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uuv.check.checked_jobs import ARM_JOBS
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.site import Barrel
from uuv.tasks.approach import object_of
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


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ({"contactless": 0.05}, r"task\.contactless: tapping presses at each of its points"),
        ({"least": 0.5}, r"task\.least: tapping presses"),
        ({"force_rate": 0.0}, r"task\.force_rate \[N/s\]"),
        ({"force_rate": math.nan}, r"task\.force_rate \[N/s\]"),
        ({"contactless": -1.0}, r"task\.contactless \[m\]"),
    ],
)
def test_what_tapping_cannot_do_is_refused_by_its_key(task: dict[str, float], message: str) -> None:
    scenario = ARM_JOBS["tap"]()
    with pytest.raises(ConfigurationError, match=message):
        replace(scenario, task=replace(scenario.task, **task)).task.check_inputs(scenario)


def test_points_beyond_the_path_are_refused() -> None:
    scenario = ARM_JOBS["tap"]()
    barrel = replace(object_of(scenario, Barrel), length=0.1)
    short = replace(scenario, site=replace(scenario.site, object=barrel))
    with pytest.raises(ConfigurationError, match=r"a path of 0\.12 m, got 0\.1 m"):
        short.task.check_inputs(short)
