"""Figures of an insertion against what was put into a recording made by hand, at a hole that lies
askew.
"""

from types import MappingProxyType

import numpy as np
import pytest

from uuv import models
from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.insertion_metrics import TrueHole, assess_insertion, hole_error
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points
from uuv.sim.loop.recording import STATES, Event, Recording, Series

DT, STEPS = 0.002, 1000  # [s], a second in each of two states
X_WH = pose(exp_so3([0.7, -0.4, 1.1]), [1.0, -2.0, -3.0])  # the hole: z into it
TRUTH = TrueHole(X_WH=X_WH, radius=0.021, tool_radius=0.02, depth=0.05)
VEHICLE = Vehicle.of(models.load("uuv_puma").compile())


def recorded() -> Recording:
    """Before the mouth for a second, with 30 N across; in the bore for another, 6 N and then 8 N
    across, 20 N back.
    """
    time = DT * np.arange(STEPS, dtype=np.float64)
    inside, late = time >= 1.0, time >= 1.5
    tip_H = np.column_stack(
        [np.full(STEPS, 5e-4), np.zeros(STEPS), np.where(inside, 0.03 + 0.02 * late, -0.04)]
    )
    across = np.where(inside, np.where(late, 8.0, 6.0), 30.0)
    force_H = np.column_stack([0.6 * across, -0.8 * across, np.where(inside, -20.0, 0.0)])
    columns = {
        "state": np.where(inside, STATES.index(WorkState.INSERT), STATES.index(WorkState.APPROACH)),
        "p_pad": transform_points(X_WH, tip_H),
        "contact_force": force_H @ X_WH[:3, :3].T,
        "collision": np.zeros(STEPS),
    }
    series = {
        name: Series(
            time=time,
            value=np.asarray(column, dtype=np.float64).reshape(STEPS, -1),
            unit="",
            labels=(),
        )
        for name, column in columns.items()
    }
    return Recording(
        timestep=DT,
        duration=STEPS * DT,
        vehicle=VEHICLE,
        series=MappingProxyType(series),
        events=(Event(time=0.0, state=WorkState.DONE, note=""),),
        targets=(),
        clouds=MappingProxyType({}),
    )


def test_forces_and_depth_are_those_about_the_axis_of_the_hole():
    figures = assess_insertion(recorded(), TRUTH, found_X_WH=X_WH, seed=1, wall_s=1.0).metrics[
        "insertion"
    ]
    assert figures["side_force_max_n"] == pytest.approx(30.0)
    assert figures["side_force_rms_n"] == pytest.approx(np.sqrt(50.0))  # in the bore alone
    assert figures["axial_force_max_n"] == pytest.approx(20.0)
    assert figures["depth_m"] == pytest.approx(0.05)
    assert figures["clearance_m"] == pytest.approx(0.001)


def test_a_hole_found_too_high_along_its_axis_is_not_off_it():
    """3 and 4 mm across, 20 mm along, tilted by 0.1 rad; its turn about the axis is none of its
    error.
    """
    off = pose(exp_so3([0.0, 0.1, 0.0]) @ exp_so3([0.0, 0.0, 2.0]), [0.003, -0.004, 0.02])
    assert hole_error(X_WH @ off, X_WH) == (pytest.approx(0.005), pytest.approx(0.1))
