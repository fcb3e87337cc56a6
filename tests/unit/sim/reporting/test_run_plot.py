"""What a run shows in a notebook: one figure, and its series as data frames."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from recorded_work import TIME, recorded
from uuv import PastRun
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import STATES, Event
from uuv.sim.reporting.run_plot import TITLES, plot_of
from uuv.sim.reporting.series_tables import write_series

EVENTS = tuple(
    Event(time=time, state=state, note="", abort=None)
    for time, state in ((0.0, WorkState.SCAN), (2.0, WorkState.APPROACH), (3.0, WorkState.WORK))
)


def test_the_figure_has_force_path_and_hull_with_the_phases():
    run = replace(recorded(contact_normal=60.0 + np.sin(TIME)[:, None]), events=EVENTS)
    figure = plot_of(run)
    assert tuple(axes.get_ylabel() for axes in figure.axes) == TITLES
    assert [text.get_text() for text in figure.axes[0].texts] == ["approach", "work"]
    assert figure.axes[-1].get_xlim() == pytest.approx((2.0, 10.0))

    force = {line.get_label(): np.asarray(line.get_ydata()) for line in figure.axes[0].lines}
    assert np.nanmax(force["true"]) == pytest.approx(61.0, abs=1e-3)
    assert set(force["set"]) == {60.0}
    assert figure._repr_png_()[:4] == b"\x89PNG"


def test_the_whole_run_begins_at_its_start():
    figure = plot_of(replace(recorded(), events=EVENTS), whole=True)
    assert [text.get_text() for text in figure.axes[0].texts] == ["scan", "approach", "work"]
    assert figure.axes[-1].get_xlim() == pytest.approx((0.0, 10.0))


def test_a_line_has_a_gap_where_the_tool_was_away():
    away = (TIME > 4.0) & (TIME < 6.0)
    states = np.where(away, STATES.index(WorkState.SETTLE), STATES.index(WorkState.WORK))
    figure = plot_of(replace(recorded(state=states[:, None]), events=EVENTS), whole=True)
    for line in figure.axes[0].lines[:3]:
        time, force = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert np.isnan(force).sum() == 1
        assert time[np.isnan(force)] == pytest.approx(4.0, abs=0.01)  # a bin of five rows
        assert not ((time > 4.003) & (time < 5.997)).any()


def test_a_run_that_never_worked_says_so():
    early = recorded(during=WorkState.SCAN, set_force=0.0 * TIME[:, None])
    with pytest.raises(ConfigurationError, match="the run recorded no force, path or hull"):
        plot_of(early)


@pytest.fixture
def past(tmp_path) -> PastRun:
    run = replace(recorded(), events=EVENTS)
    write_series(run, tmp_path)
    return PastRun(tmp_path)


def test_series_are_data_frames_over_time(past):
    frame = past.frame("loop")
    assert frame.index.name == "time"
    assert frame.index[-1] == TIME[-1]
    assert set(frame["contact_normal"]) == {60.0}
    assert list(past.frame("events")["state"]) == ["scan", "approach", "work"]
    with pytest.raises(ConfigurationError, match="no series 'fast'"):
        past.frame("fast")


@pytest.mark.parametrize(
    ("package", "call", "extra"),
    [("pandas", PastRun.frame, "pandas"), ("matplotlib.figure", PastRun.plot, "log")],
)
def test_without_the_package_the_line_names_the_extra(past, monkeypatch, package, call, extra):
    monkeypatch.delitem(sys.modules, "uuv.sim.reporting.run_plot", raising=False)
    monkeypatch.setitem(sys.modules, package, None)
    needed = package.partition(".")[0]
    with pytest.raises(MissingLibraryError, match=rf"needs the package {needed}: .*\[{extra}\]"):
        call(past)
