"""What the panels of a report draw, in their units, of a recording made by hand."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from recorded_work import STEPS, TIME, TRUTH, recorded
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array, exp_so3, quat_wxyz_from_rotation
from uuv.sim.loop.recording import Recording, Series
from uuv.sim.reporting.timelines import panels, timelines

ALONG, ASIDE, OUTWARD = TRUTH.X_WT[:3, :3].T


def drawn(recording: Recording, bounds: Bounds | None = None) -> dict[str, dict[str, Array]]:
    """Last values of the lines by name, for each panel by title; the bounds under their own
    name.
    """
    panels_of = {}
    for panel in panels(recording, bounds):
        panels_of[panel.title] = {line.name: line.value[-1] for line in panel.lines} | {
            "bounds": tuple(panel.bounds)
        }
    return panels_of


def test_errors_have_the_signs_and_units_of_their_panels():
    """At the end 5 N too much, 2 mm behind and 1 mm too deep; the hull 3 cm off and turned by 4
    deg.
    """
    end = (TIME >= 9.0)[:, None]
    start = exp_so3([0.3, -0.2, 2.0])
    quats = [
        quat_wxyz_from_rotation(start @ exp_so3([0.0, turn, 0.0]))
        for turn in (0.0, np.radians(4.0))
    ]
    panels_of = drawn(
        recorded(
            contact_normal=60.0 + 5.0 * end,
            p_pad=recorded()["p_command"].value - end * (0.002 * ALONG + 0.001 * OUTWARD),
            p_WB=end * [0.01, -0.02, 0.02],
            quat_WB_wxyz=np.where(end, quats[1], quats[0]),
        ),
        Bounds(force_error_max=9.0, path_deviation=0.003),
    )
    error = panels_of["force error [N]"]
    assert (error["true − set"], error["bounds"]) == (pytest.approx(5.0), (9.0, -9.0))
    assert np.isnan(error["not judged"])  # but for the first second
    path = panels_of["tip path error [mm]"]
    assert [path[name] for name in ("along", "across", "along the tool axis")] == pytest.approx(
        [-2.0, 0.0, 1.0]
    )
    assert path["bounds"] == (3.0, -3.0)
    hull = panels_of["hull position error [mm]"]
    assert [hull[axis] for axis in "xyz"] == pytest.approx([10.0, -20.0, 20.0])
    assert panels_of["turn of the hull [deg]"]["turn"] == pytest.approx(4.0)


def test_the_force_error_spans_what_is_judged():
    """20 N too much at the start, which is not judged, and 2 N at the end, within a step 3 N."""
    wrong = np.where(TIME < 0.5, 20.0, 0.0) + np.where(TIME > 9.0, 2.0, 0.0)
    worked = recorded(
        contact_normal=60.0 + wrong[:, None], contact_most=60.0 + (wrong + (TIME > 9.0))[:, None]
    )
    (panel,) = (p for p in panels(worked) if p.title == "force error [N]")
    assert panel.span == pytest.approx(1.3 * 3.0)
    judged, left_out = panel.lines
    assert np.nanmax(judged.value) == pytest.approx(2.0)
    assert np.nanmax(left_out.value) == pytest.approx(20.0)
    page = timelines({"run": worked})
    assert '"range":[-3.9' in page


@pytest.mark.parametrize("state", [WorkState.SEARCH, WorkState.INSERT, WorkState.WITHDRAW])
def test_the_force_of_an_insertion_is_drawn(state):
    assert drawn(recorded(during=state))["normal force [N]"]["true"] == 60.0


def test_neighbouring_joints_differ_in_colour():
    names = tuple(f"joint{i}" for i in range(9))
    joints = Series(time=TIME, value=np.zeros((STEPS, 9)), unit="rad", labels=names)
    whole = recorded()
    run = replace(whole, series=MappingProxyType({**whole.series, "q": joints}))
    (panel,) = (panel for panel in panels(run) if panel.title == "joint angle [deg]")
    assert len({line.colour for line in panel.lines[:8]}) == 8


def test_slower_series_keep_their_columns_and_units():
    """A joint angle in degrees; moments of the arm on the hull beside its forces, true and
    believed.
    """
    few = TIME[::10]
    six = np.arange(6, dtype=np.float64)
    ones = np.ones((STEPS // 10, 1))
    more = {
        "q": Series(time=few, value=ones * [0.5], unit="rad", labels=("joint1",)),
        "arm_wrench": Series(time=few, value=ones * six, unit="", labels=tuple("abcdef")),
        "believed.arm_wrench_B": Series(
            time=few, value=ones * -six, unit="", labels=tuple("abcdef")
        ),
    }
    whole = recorded()
    panels_of = drawn(replace(whole, series=MappingProxyType({**whole.series, **more})))
    assert panels_of["joint angle [deg]"]["joint1"] == pytest.approx(np.degrees(0.5))
    moment = panels_of["arm's moment on the hull [N m]"]
    assert [moment[name] for name in ("x", "y", "z", "x believed")] == [3.0, 4.0, 5.0, -3.0]
    assert panels_of["arm's force on the hull [N]"]["y"] == 1.0
