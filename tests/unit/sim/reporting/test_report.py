"""The page is whole in itself, shows what the run lived to give, and says why a run was not
accepted.
"""

import base64
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from rich.console import Console

from run_records import every_run
from uuv import models
from uuv.models.objects.targets import barrel
from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.metrics import assess
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.surface.tool_errors import TrueObject
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import ObjectMotion, Target, ToolPath, WorkState
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import pose
from uuv.sim.loop.recording import STATES, Event, Recording, Series
from uuv.sim.reporting import series_files
from uuv.sim.reporting.report import ReportedRun, write_report
from uuv.sim.reporting.report_figures import object_as_found, path_by_force_error
from uuv.sim.reporting.results_table import figures_of, results_table
from uuv.sim.reporting.series_tables import PastRun, write_series
from uuv.sim.reporting.timelines import thinned, timelines

DT = 0.01  # [s]
TRUTH = TrueObject(model=barrel(), path="longitudinal", X_WT=pose(p=[0.0, 0.0, -1.5]))
VEHICLE = Vehicle.of(models.load("uuv_puma").compile())


class Reader(HTMLParser):
    """Counts pictures, and collects what the page would fetch and the names of its panels."""

    def __init__(self) -> None:
        super().__init__()
        self.pictures = 0
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.pictures += tag == "img"
        self.fetched += [attribute or "" for name, attribute in attrs if name in ("src", "href")]


WORKED = [
    "normal force [N]",
    "tangential force [N]",
    "force error [N]",
    "tip path error [mm]",
    "hull position error [mm]",
    "turn of the hull [deg]",
]


def panels_of(page: str) -> list[str]:
    """Titles of the panels of a page, from above down."""
    return re.findall(
        r'"title":\{"text":"([^"]*\[[^"]*\])"\},"gridcolor":"[^"]*","zerolinecolor"', page
    )


def recorded(state: WorkState, final: WorkState) -> Recording:
    n = 1000
    time = DT * np.arange(n, dtype=np.float64)
    ones = np.ones((n, 1))
    tip = np.column_stack([0.02 * time, np.zeros(n), np.full(n, -1.2)])
    columns = {
        "state": STATES.index(state) * ones,
        "set_force": 60.0 * ones,
        "path_s": 0.02 * time[:, None],
        **dict.fromkeys(
            ("contact_normal", "contact_least", "contact_most"),
            (60.0 if state is WorkState.WORK else 0.0) * ones,
        ),
        "felt_normal": 60.0 * ones,
        "felt_force": ones * [0, 0, 60.0],
        "contact_force": ones * [0, 0, 60.0],
        "saturated": 0 * ones,
        "collision": 0 * ones,
        "p_command": tip,
        "v_command": ones * [0.02, 0, 0],
        "p_pad": tip,
        "tool_axis": ones * [0, 0, -1.0],
        "p_WB": 0 * tip,
        "quat_WB_wxyz": ones * [1.0, 0, 0, 0],
        "thrust": ones * np.arange(6.0),
        "tau_drive": ones * np.arange(6.0),
    }
    labels = {"thrust": VEHICLE.thruster_names, "tau_drive": VEHICLE.joint_names}
    target = Target(
        time=0.0, X_WT=TRUTH.X_WT, accepted=True, check_m=0.001, range_m=1.2, reason="", path=None
    )
    return Recording(
        timestep=DT,
        duration=n * DT,
        vehicle=VEHICLE,
        series=MappingProxyType(
            {
                name: Series(time=time, value=v, unit="", labels=labels.get(name, ()))
                for name, v in columns.items()
            }
        ),
        events=(
            Event(time=0.0, state=state, note=""),
            Event(time=10.0, state=final, note="felt < 1 N & lost"),
        ),
        targets=(target,) if state is WorkState.WORK else (),
        clouds=MappingProxyType({"scan": np.random.default_rng(0).normal(size=(100, 3))}),
    )


def written(folder: Path, recording: Recording) -> tuple[str, Assessment]:
    assessment = assess(recording, TRUTH, seed=0, wall_s=1.0)
    file = folder / "report.html"
    write_report(
        file,
        recording,
        assessment,
        run=ReportedRun(title="clean <barrel>", options={"path": "longitudinal"}),
        pictures=object_as_found(recording, TRUTH),
    )
    return file.read_text(encoding="utf-8"), assessment


def test_page_fetches_nothing_and_shows_every_picture(tmp_path: Path):
    page, assessment = written(tmp_path, recorded(WorkState.WORK, WorkState.DONE))
    reader = Reader()
    reader.feed(page)
    assert assessment.accepted, assessment.failed
    assert reader.pictures == 2  # the path by force error, and the object
    assert all(source.startswith("data:image/svg+xml;base64,") for source in reader.fetched)
    assert panels_of(page) == [*WORKED, "thrust [N]", "joint torque [N m]"]
    assert "clean &lt;barrel&gt;" in page
    assert re.search(r"<h1>.*<span class='accepted'>accepted</span></h1>", page)


def test_page_begins_with_stills_of_the_scene(tmp_path: Path):
    recording = recorded(WorkState.WORK, WorkState.DONE)
    file = tmp_path / "report.html"
    stills = [("scan, 3.0 s", b"first"), ("work, <9> s", b"second")]
    write_report(
        file,
        recording,
        assess(recording, TRUTH, seed=3, wall_s=1.0, identification_s=None),
        run=ReportedRun(title="barrel", options={}, stills=stills),
    )
    page = file.read_text(encoding="utf-8")
    assert page.index("<h2>Scene</h2>") < page.index("<h2>Path by force error</h2>")
    assert page.index("<h2>Path by force error</h2>") < page.index("<h2>Figures</h2>")
    first = base64.b64encode(b"first").decode()
    assert f'<img alt="scan, 3.0 s" src="data:image/webp;base64,{first}">' in page
    assert "<figcaption>work, &lt;9&gt; s</figcaption>" in page


def test_path_by_force_error_has_its_colours_where_the_error_is_judged():
    recording = recorded(WorkState.WORK, WorkState.DONE)
    ((title, caption, figure),) = path_by_force_error(recording)
    assert title == "Path by force error"
    drawn = next(c for c in figure.axes[0].collections if c.get_array() is not None)
    error = np.ma.filled(np.ma.asarray(drawn.get_array()), np.nan)
    settled = np.isfinite(error)
    assert 0.85 < settled.mean() < 0.95  # of 10 s, all but the first
    contact = recording["contact_normal"].scalar - 60.0
    assert np.nanmax(abs(error)) <= abs(contact).max() + 1e-9
    rms = np.sqrt(np.mean(contact[recording["state"].time >= 1.0] ** 2))
    assert f"RMS {rms:.2f} N" in caption
    assert not list(path_by_force_error(recorded(WorkState.APPROACH, WorkState.ABORT)))


def test_page_states_the_covariance_of_the_pose_and_what_it_means_on_the_path(tmp_path: Path):
    """A barrel free to turn about its axis: that turn is named, and does not count on a path around
    it.
    """
    recording = recorded(WorkState.WORK, WorkState.DONE)
    center = TRUTH.X_WT[:3, 3]
    turn = np.concatenate([np.zeros(3), TRUTH.X_WT[:3, 0]])[None]
    held = np.eye(6) - turn.T @ turn
    doubt = PoseCovariance(
        matrix=4e-6 * held, free=turn, same=turn, center=center, radius=0.5, size_sigma=1.0
    )
    n = np.zeros(20)
    angle = np.linspace(0.0, 1.0, 20)
    round_it = np.column_stack([n, np.cos(angle), np.sin(angle)])
    path = ToolPath(
        s=0.2 * angle,
        p=center + 0.2 * round_it,
        z=-round_it,
        x=np.column_stack([n, -np.sin(angle), np.cos(angle)]),
        on_scan=n > 0.0,
    )
    target = replace(recording.targets[0], path=path, covariance=doubt)
    page, assessment = written(tmp_path, replace(recording, goes_by=target))
    stated = assessment.metrics["uncertainty"]
    assert stated["position_sigma_m"] == pytest.approx(2e-3)
    assert stated["rotation_sigma_rad"] == pytest.approx(4e-3)
    assert stated["normalised_error"] == pytest.approx(0.0, abs=1e-9)
    assert stated["path_along_max_m"] == pytest.approx(2e-3, rel=0.1)
    assert stated["path_normal_p95_m"] == pytest.approx(2e-3, rel=0.01)
    assert "Not observable in these views: a turn about (" in page
    assert "surface under the path, across the path" in page
    assert (
        "<td>position of the centre</td><td class=n>2.00</td><td class=n></td><td>mm</td>" in page
    )
    # of 4 mrad
    assert "<td>orientation</td><td class=n>0.23</td><td class=n></td><td>deg</td>" in page
    assert "standard deviation of the object pose" not in written(tmp_path, recording)[0]


def test_page_states_how_an_object_moved(tmp_path: Path):
    """By 3 and 4 cm, turned by 0.1 rad: 0.05 m at its radius of 0.5 m; known to 2 mm an axis."""
    twist = np.array([0.03, -0.04, 0.0, 0.0, 0.0, 0.05])
    still = ObjectMotion(
        time=1.0,
        X_WT=TRUTH.X_WT,
        twist_W=0.0 * twist,
        covariance_W=4e-6 * np.eye(6),
        radius=0.5,
        moved=False,
    )
    run = replace(
        recorded(WorkState.WORK, WorkState.DONE),
        motions=(still, replace(still, time=2.5, twist_W=twist, moved=True)),
    )
    page, _ = written(tmp_path, run)
    assert (
        "followed in 2 frames: motion was detected at 2.5 s; final displacement 50.0 mm "
        "(standard deviation 2.0 mm), rotation 5.7 deg."
    ) in page


def test_page_of_a_run_that_was_broken_off_says_why(tmp_path: Path):
    page, assessment = written(tmp_path, recorded(WorkState.SCAN, WorkState.ABORT))
    reader = Reader()
    reader.feed(page)
    assert not assessment.accepted
    assert reader.pictures == 0
    assert panels_of(page) == ["thrust [N]", "joint torque [N m]"]
    assert re.search(
        r"<li>the work was aborted in \S+ at \S+ s: felt &lt; 1 N &amp; lost</li>", page
    )
    assert (
        "nan" not in re.sub(r'src="[^"]*"|<script.*?</script>', "", page, flags=re.DOTALL).lower()
    )


def test_page_of_an_unchecked_run_says_why_it_would_have_been_refused(tmp_path: Path) -> None:
    recording = recorded(WorkState.WORK, WorkState.DONE)
    assessment = assess(recording, TRUTH, seed=0, wall_s=1.0)
    for unchecked, line in ((["an arm & a leg"], True), ([], False)):
        file = tmp_path / "report.html"
        asked = assessment.extended(unchecked=unchecked)
        write_report(file, recording, asked, run=ReportedRun(title="barrel", options={}))
        text = "Not checked; it would have been refused: an arm &amp; a leg."
        assert (text in file.read_text(encoding="utf-8")) is line


def test_page_without_slow_series_leaves_their_pictures_out(tmp_path: Path):
    recording = recorded(WorkState.WORK, WorkState.DONE)
    few = {
        name: series
        for name, series in recording.series.items()
        if name not in ("thrust", "tau_drive")
    }
    page, _ = written(tmp_path, replace(recording, series=MappingProxyType(few)))
    assert panels_of(page) == WORKED
    assert "against their limits" not in page


def test_drives_are_held_against_their_limits(tmp_path: Path):
    page, _ = written(tmp_path, recorded(WorkState.WORK, WorkState.DONE))
    forward = np.asarray(VEHICLE.thruster_table)[1, 0]
    row = (
        "<td class=n>1.0</td><td class=n>1.0</td><td class=n>N</td><td "
        f"class=n>{1.0 / forward:.0%}</td>"
    )
    assert f"<td>{VEHICLE.thruster_names[1].replace('_', ' ')}</td>{row}" in page


def test_thrust_astern_is_held_against_the_limit_astern(tmp_path: Path):
    run = recorded(WorkState.WORK, WorkState.DONE)
    forward, reverse = np.asarray(VEHICLE.thruster_table)[2, :2]
    thrust = run["thrust"].value.copy()
    thrust[100, 2] = -0.9 * reverse
    thrust[200, 2] = 0.3 * forward
    run = replace(
        run, series=MappingProxyType({**run.series, "thrust": replace(run["thrust"], value=thrust)})
    )
    page, _ = written(tmp_path, run)
    row = re.findall(rf"<td>{VEHICLE.thruster_names[2].replace('_', ' ')}</td>(.*?)</tr>", page)[0]
    assert re.findall(r">([^<]+)</td>", row) == [
        f"{-0.9 * reverse:.1f}",
        f"{0.3 * forward:.1f}",
        "N",
        "90%",
    ]


def test_a_figure_and_its_bound_are_told_in_their_unit():
    requirement = Requirement("path deviation, peak", 0.00234, 0.003, "mm", 1e3)
    assert figures_of(requirement) == ("2.34", "3.00")
    assert figures_of(replace(requirement, value=None)) == ("–", "3.00")


def test_second_run_is_laid_over_the_first_from_the_start_of_the_work():
    run = recorded(WorkState.WORK, WorkState.DONE)
    moved = {
        name: replace(series, time=series.time + 5.0) if len(series.time) else series
        for name, series in run.series.items()
    }
    late = replace(
        run, series=moved, duration=run.duration + 5.0, events=(replace(run.events[0], time=5.0),)
    )
    page = timelines({"first": run, "second": late})
    drawn = json.loads(
        re.findall(r'"timelines",\s*(\[.*?\]),\s*\{"template"', page, flags=re.DOTALL)[0]
    )
    force = [trace for trace in drawn if trace["name"] == "true" and trace["yaxis"] == "y"]
    assert [trace["line"]["dash"] for trace in force] == ["solid", "dot"]
    first, second = (
        np.frombuffer(base64.b64decode(trace["x"]["bdata"]), dtype=np.float32) for trace in force
    )
    assert second == pytest.approx(first, abs=1e-5)
    assert "time from the start of the work [s]" in page
    assert "solid: first; dotted: second" in page


@pytest.mark.parametrize("ending", [".parquet", ".npz"])
def test_series_are_read_back_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
):
    if ending == ".npz":
        monkeypatch.setattr(series_files, "find_spec", lambda _: None)
    run = recorded(WorkState.WORK, WorkState.DONE)
    run = replace(
        run,
        series={**run.series, "q": replace(run["thrust"], labels=VEHICLE.joint_names, unit="rad")},
    )
    write_series(run, tmp_path)
    (tmp_path / "metrics.json").write_text(json.dumps(every_run(simulated_s=run.duration)))
    past = PastRun.of(tmp_path)
    assert {file.suffix for file in tmp_path.iterdir()} == {".json", ending}
    assert past.units()["q.joint1"] == "rad"
    assert past.column("thrust." + VEHICLE.thruster_names[3]) == pytest.approx(3.0)
    read = past.recorded
    assert read.events == run.events
    assert read.duration == run.duration
    assert set(read.series) == set(run.series)
    for name, series in run.series.items():
        assert np.array_equal(read[name].value, series.value)
        assert np.array_equal(read[name].time, series.time)
    assert read["thrust"].labels == VEHICLE.thruster_names
    assert past.table("events").to_pydict()["note"] == ["", "felt < 1 N & lost"]


def test_second_run_keeps_its_dashes_where_the_first_lacks_a_panel():
    run = recorded(WorkState.WORK, WorkState.DONE)
    few = {name: series for name, series in run.series.items() if name != "thrust"}
    page = timelines({"first": replace(run, series=few), "second": run})
    drawn = json.loads(
        re.findall(r'"timelines",\s*(\[.*?\]),\s*\{"template"', page, flags=re.DOTALL)[0]
    )
    thrust = [
        trace for trace in drawn if trace["name"] == VEHICLE.thruster_names[0].replace("_", " ")
    ]
    assert [(trace["line"]["dash"], trace["showlegend"]) for trace in thrust] == [("dot", True)]


def test_thinned_lines_keep_every_peak():
    time = 0.002 * np.arange(60_001, dtype=np.float64)
    samples = np.zeros(60_001)
    samples[[17, 30_001, -2]] = 5.0, -7.0, 9.0
    samples[16] = np.nan  # beside a peak
    kept_time, thinned_samples = thinned(time, samples)
    assert len(thinned_samples) < 3000
    assert {5.0, -7.0, 9.0} <= set(thinned_samples)
    assert np.all(np.diff(kept_time) >= 0.0)
    assert np.isnan(thinned(time, np.full(60_001, np.nan))[1]).all()


def test_missing_folder_is_refused(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="no folder"):
        written(tmp_path / "nowhere", recorded(WorkState.SCAN, WorkState.ABORT))


def test_table_has_a_row_and_a_verdict_for_each_check():
    assessment = assess(recorded(WorkState.SCAN, WorkState.ABORT), TRUTH, seed=0, wall_s=1.0)
    output = io.StringIO()
    Console(width=100, file=output).print(results_table(assessment))
    for check in assessment.checks:
        assert check.name in output.getvalue()
    assert output.getvalue().count("missed") == sum(not check.ok for check in assessment.checks)
