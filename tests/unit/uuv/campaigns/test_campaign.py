"""Campaigns: what is drawn follows its distribution and its seed alone, and a mistake in a file is
one line.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from uuv import write_scenario
from uuv.campaigns import campaign_report
from uuv.campaigns.campaign import EXPERIMENT, Campaign, CampaignRun, read_campaign, read_drawn
from uuv.campaigns.campaign_rows import one_run
from uuv.campaigns.distributions import DESIGNS, Design, Distribution, drawn
from uuv.experiment import Summary
from uuv.experiment.drawn_cases import DrawnCase, write_cases
from uuv.experiment.row_table import SCHEMA_VERSION, RowTable
from uuv.jobs import clean_barrel
from uuv.perturbations.pad import Pad
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.provenance import versions
from uuv.sim.runs.run_folder import alone_in

FILE = """
base = "clean-barrel"
quick = true
cases = 4

[set]
"belief.water_error" = 0.0

[distributions]
"site.current" = { direction = [0.1, 0.4] }
"perturbations.Pad.stiffness" = { log_uniform = [1e4, 1e6] }

[metrics]
names = ["contact.force_error_rms_n"]

[bounds]
"contact.lost_s" = 0.0
"""


def distribution(**given: Any) -> Distribution:
    return Distribution.of(given)


def values_of(one: Distribution, n: int, design: Design = "random") -> np.ndarray:
    return np.array([row["x"] for row in drawn({"x": one}, n, 0, design)])


# -- distributions ---------------------------------------------------------------------------------


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize(
    ("given", "cumulative"),
    [
        ({"uniform": [-1.0, 3.0]}, lambda x: (x + 1.0) / 4.0),
        ({"log_uniform": [1e4, 1e6]}, lambda x: np.log(x / 1e4) / math.log(100.0)),
        ({"reciprocal": [5.0, 20.0]}, lambda x: 1.0 - (1.0 / x - 5.0) / 15.0),
    ],
)
def test_values_follow_their_distribution(design, given, cumulative):
    """Greatest distance of the empirical from the true distribution; at random 1.63 / sqrt(n) at 99
    %.
    """
    n = 1024
    u = np.sort(cumulative(values_of(distribution(**given), n, design)))
    distance = np.abs(u - (np.arange(n) + 0.5) / n).max()
    assert (
        distance
        < {"random": 1.63 / math.sqrt(n), "sobol": 2.0 / n, "latin-hypercube": 1.0 / n}[design]
    )


def test_directions_are_uniform_on_the_sphere():
    vectors = values_of(distribution(direction=[0.1, 0.4]), 2048, "sobol")
    length = np.linalg.norm(vectors, axis=1)
    assert length.min() >= 0.1
    assert length.max() <= 0.4
    unit = vectors / length[:, None]
    assert np.abs(unit.mean(axis=0)).max() < 0.01  # measured 8e-4
    assert np.abs(unit.T @ unit / len(unit) - np.eye(3) / 3.0).max() < 0.01  # measured 1e-3


def test_a_step_and_categories():
    steps = values_of(distribution(uniform=[0.0, 0.01], step=0.002), 200) / 0.002
    assert {*np.round(steps).astype(int).tolist()} == {1, 2, 3, 4, 5}
    assert np.array_equal(steps, np.round(steps))
    assert {*values_of(distribution(categorical=["a", "b"]), 20)} == {"a", "b"}


def test_neither_more_cases_nor_another_parameter_change_what_is_drawn():
    narrow, other = distribution(uniform=[0.0, 1.0]), distribution(uniform=[0.0, 2.0])
    few = drawn({"x": narrow}, 5, 3, "random")
    more = drawn({"y": other, "x": narrow}, 9, 3, "random")
    assert [row["x"] for row in more[:5]] == [row["x"] for row in few]
    assert drawn({"x": narrow, "y": other}, 9, 3, "sobol")[:5] == drawn(
        {"x": narrow, "y": other}, 5, 3, "sobol"
    )
    assert drawn({"x": narrow}, 5, 4, "random") != few


# -- campaigns -------------------------------------------------------------------------------------


def read(folder: Path, text: str) -> Campaign:
    file = folder / "mine.toml"
    file.write_text(text)
    return read_campaign(file)


def test_a_file_gives_the_scenarios_of_its_runs(tmp_path):
    campaign = read(tmp_path, FILE)
    runs = campaign.runs()
    assert [run.case for run in runs] == [0, 1, 2, 3]
    scenarios = [run.scenario() for run in runs]
    assert (
        len({scenario.seed for scenario in scenarios})
        == len({scenario.perturbation_seed for scenario in scenarios})
        == 4
    )
    for run, scenario_of_run in zip(runs, scenarios, strict=True):
        assert scenario_of_run.belief.water_error == 0.0
        assert (
            scenario_of_run.perturbation(Pad).stiffness == run.values["perturbations.Pad.stiffness"]
        )
        assert list(scenario_of_run.site.current) == run.values["site.current"]
        assert scenario_of_run.site.object == clean_barrel(quick=True).site.object
    assert campaign.name == scenarios[0].name == "mine"
    assert campaign.runs(2) == runs[:2]


def test_cases_from_a_file_are_those_that_were_drawn_but_for_what_is_set(tmp_path):
    campaign = read(tmp_path, FILE)
    write_cases(tmp_path / "drawn.json", EXPERIMENT, campaign.drawn())
    changed = ["perturbations.Pad.stiffness=5e4", "belief.water_error=0.1"]
    other = read_campaign(tmp_path / "mine.toml", changed)

    assert campaign.runs_of(read_drawn(tmp_path / "drawn.json", campaign)) == campaign.runs()
    set_here = other.runs_of(read_drawn(tmp_path / "drawn.json", other, changed))
    for run, drawn_run in zip(set_here, campaign.runs(), strict=True):
        scenario = run.scenario()
        assert scenario.perturbation(Pad).stiffness == 5e4
        assert scenario.belief.water_error == 0.1
        assert scenario.site == drawn_run.scenario().site


def test_a_value_of_a_file_that_is_not_allowed_is_told_with_its_case(tmp_path):
    campaign = read(tmp_path, FILE)
    case = DrawnCase(case=3, values={"site.gusts": 0.1})
    write_cases(tmp_path / "drawn.json", EXPERIMENT, [case])
    with pytest.raises(ConfigurationError, match=r"drawn.json': case 3: .*gusts"):
        read_drawn(tmp_path / "drawn.json", campaign)


def test_a_scenario_file_may_be_the_base(tmp_path):
    write_scenario(clean_barrel(quick=True, path="transverse"), tmp_path / "base.toml")
    text = FILE.replace('"clean-barrel"', '"base.toml"').replace("quick = true\n", "")
    assert (
        read(tmp_path, text).runs()[0].scenario().task
        == clean_barrel(quick=True, path="transverse").task
    )


def test_a_campaign_like_another_has_its_own_values_in_place_of_those(tmp_path):
    """A value that it sets is not drawn; the base of the other is found from its own folder."""
    (tmp_path / "first").mkdir()
    write_scenario(clean_barrel(quick=True), tmp_path / "first" / "base.toml")
    text = FILE.replace('"clean-barrel"', '"base.toml"').replace("quick = true\n", "")
    (tmp_path / "first" / "first.toml").write_text(text)
    campaign = read(
        tmp_path,
        'like = "first/first.toml"\ncases = 2\n[set]\n"perturbations.Pad.stiffness" = 3e4\n'
        '[grid]\n"site.gust" = [0.01, 0.02]\n',
    )
    assert (campaign.name, campaign.cases, campaign.bounds) == ("mine", 2, {"contact.lost_s": 0.0})
    scenarios = [run.scenario() for run in campaign.runs()]
    assert [scenario.perturbation(Pad).stiffness for scenario in scenarios] == [3e4, 3e4]
    assert [scenario.site.gust for scenario in scenarios] == [0.01, 0.02]
    assert scenarios[0].belief.water_error == 0.0
    assert list(campaign.distributions) == ["site.current"]

    with pytest.raises(ConfigurationError, match="like: must not lead back to the file itself"):
        read(tmp_path, 'like = "mine.toml"\n')


@pytest.mark.parametrize(
    "name",
    [
        *("ablation", "collect", "contact", "contact_quick"),
        *("insertion", "seabed", "versions", "waves"),
    ],
)
def test_examples_can_be_read(root, name):
    campaign = read_campaign(root / f"scripts/campaigns/{name}.toml")
    assert campaign.name == name
    assert len(campaign.runs()) == campaign.cases


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"site.current" =', '"site.curent" =', r"\[site\] has no 'curent'; it has"),
        ('"site.current" =', '"wind.speed" =', r"has no 'wind'"),
        (
            "perturbations.Pad.stiffness",
            "perturbations.Pat.stiffness",
            r"unknown perturbation 'Pat'",
        ),
        ("perturbations.Pad.stiffness", "perturbations.Pad.softness", r"has no 'softness'"),
        ("perturbations.Pad.stiffness", "perturbations.Pad", r"perturbations.KIND.FIELD"),
        ("perturbations.Pad.stiffness", "seed", r"'seed': must not be drawn"),
        (
            "log_uniform",
            "normal",
            r"distributions\..*stiffness: no distribution 'normal'; allowed "
            r"uniform, log_",
        ),
        ("log_uniform = [1e4, 1e6]", "log_uniform = [0, 1e6]", r"two increasing numbers above 0"),
        ("log_uniform = [1e4, 1e6]", "log_uniform = [1e6, 1e4]", r"two increasing numbers above 0"),
        ("{ log_uniform = [1e4, 1e6] }", "3", r"must be one of \{ uniform = \[...\] \}"),
        ("log_uniform = [1e4, 1e6]", "categorical = []", r"categorical: must have values"),
        ("contact.force_error_rms_n", "contact.luck", r"no metric 'contact.luck'; this task has"),
        ("contact.lost_s", "timings.wall_s", r"no metric 'timings.wall_s'"),
        (
            "names = [",
            "name = [",
            r"\[metrics\] has no 'name'; it has names \(did you mean "
            r"names\?\)",
        ),
        ("cases = 4", "cases = 0", r"cases"),
        ("cases = 4", "", r"cases is missing"),
        ("cases = 4", "cases = 4\nworkers = 2", r"the file has no 'workers'; it has base, cases"),
        (
            "cases = 4",
            'cases = 4\ndesign = "grid"',
            r"design: allowed random, sobol, "
            r"latin-hypercube, got 'grid'",
        ),
        ("cases = 4", "cases = 4\nkept = 2.0", r"kept"),
        ('"clean-barrel"', '"ship"', r"base: allowed clean-barrel, .* got 'ship'"),
        ('"clean-barrel"', '"gone.toml"', r"quick: only allowed with a job as base"),
        ("[set]", "[limits]\ntime = 3\n[set]", r"\[limits\] has no 'time'; it has time_s"),
        (
            "[set]",
            "[limits]\ntime_s = 'x'\n[set]",
            r"limits.time_s \[s\]: must be a number, above "
            r"0, got 'x'",
        ),
        ("[set]", "[limits]\nretries = 0\n[set]", r"limits.retries: must be at least 1, got 0"),
        (
            "cases = 4",
            "cases = '4'",
            r"cases: must be a whole number, at least 1 and at most 10000000, got '4'; it is text",
        ),
        ("cases = 4", "casse = 4", r"the file has no 'casse'; it has base, .*did you mean cases"),
        (
            "log_uniform",
            "log_unifrom",
            r"no distribution 'log_unifrom'; .*did you mean log_uniform",
        ),
        (
            "contact.force_error_rms_n",
            "contact.force_error_rms",
            r"did you mean "
            r"contact.force_error_rms_n",
        ),
        (
            "log_uniform = [1e4, 1e6]",
            "log_uniform = [nan, 1e6]",
            r"log_uniform\[0\]: must not be NaN",
        ),
        ('error" = 0.0', 'error" = nan', r"set.belief.water_error: must not be NaN"),
        (
            '"clean-barrel"',
            "5",
            r"base: must be clean-barrel, .* or a scenario file \(.toml\), "
            r"got 5",
        ),
        (
            'names = ["contact.force_error_rms_n"]',
            "names = [1]",
            r"metrics.names\[0\]: must be a name, "
            r"got 1",
        ),
        (
            "[set]",
            "[grid]\n'site.gust' = []\n[set]",
            r"grid: site.gust: must have at least one value",
        ),
        (
            "[set]",
            "[grid]\n'site.current' = [[0, 0, 0]]\n[set]",
            r"site.current: must not also be drawn",
        ),
        ("[set]", "[grid]\n'site.gust, seed' = [0.1]\n[set]", r"'seed': must not be drawn"),
        ("[set]", "[grid]\n'site.gust, task.least' = [0.1]\n[set]", r"lists of 2 values, got 0.1"),
        ("[set]", "[versions.x]\n'control.with' = 1\n[set]", r"versions: x: .*has no 'with'"),
        ("[set]", "[also]\n'contact.luck' = 1.0\n[set]", r"no metric 'contact.luck'"),
        ("cases = 4", "cases = 4\nversion_cases = 0", r"version_cases"),
        ("cases = 4", "cases = 4\nlike = 3", r"like: must be a campaign file, got 3"),
        ("[set]", "[set", r"cannot be read"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, old, new, said):
    assert old in FILE
    with pytest.raises(ConfigurationError, match=said) as caught:
        read(tmp_path, FILE.replace(old, new))
    assert str(caught.value).startswith("campaign ")
    assert "\n" not in str(caught.value)


def test_a_run_that_cannot_be_set_up_has_a_row(tmp_path):
    (run, *_) = read(tmp_path, FILE).runs()
    bad = CampaignRun(
        case=7, base=run.base, values={**run.values, "vehicle.vehicle": "boat"}, metrics=run.metrics
    )
    row = one_run(bad)
    assert (row["case"], row["state"], row["accepted"], row["metrics"]) == (
        7,
        "not set up",
        False,
        {},
    )
    assert "boat" in row["failed"][0]


def test_outcomes_are_counted_by_code(tmp_path):
    campaign = read(tmp_path, FILE)

    def row(
        case: int, state: str = "done", code: str = "", lost: float | None = 0.0
    ) -> dict[str, Any]:
        metrics: Mapping[str, Any] = {
            "contact.force_error_rms_n": 1.0 + case,
            "contact.lost_s": lost,
        }
        draws = {"values": {"x": float(case)}, "drawn": {}}
        return {
            "case": case,
            "state": state,
            "code": code,
            "accepted": True,
            "metrics": metrics,
            **draws,
        }

    rows = [row(0), row(1), row(2, lost=0.1), row(3, "abort", "jammed"), row(4, lost=None)]
    summary = campaign_report.summarise(rows, campaign, "mine.toml")
    assert summary.metrics["outcomes"] == {
        "kept": 2,
        "missed: contact.lost_s": 2,
        "abort: jammed": 1,
    }
    interval = summary.metrics["kept"]
    # Wilson's interval in closed form
    z = 1.959963984540054
    n = 5
    p = 0.4
    middle = p + z * z / (2 * n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    assert interval["low"] == pytest.approx((middle - half) / (1 + z * z / n), rel=1e-9)
    assert interval["high"] == pytest.approx((middle + half) / (1 + z * z / n), rel=1e-9)
    assert summary.metrics["metrics"]["contact.force_error_rms_n"]["median"] == 3.0
    assert any("--replay 3" in cell for line in summary.tables[0].rows for cell in line)
    assert summary.failed is None


def test_shares_and_quantiles_of_many_runs(tmp_path):
    """21 runs with 0 to 20 N: quantiles fall on runs.

    A share that is just the wanted one does not fail.
    """
    campaign = replace(read(tmp_path, FILE), kept=20.0 / 21.0)

    def summed(lost: float) -> Summary:
        rows = [
            {
                "case": case,
                "state": "done",
                "code": "",
                "accepted": True,
                "metrics": {
                    "contact.force_error_rms_n": float(case),
                    "contact.lost_s": lost if case < 2 else 0.0,
                },
                "values": {"x": float(case)},
                "drawn": {},
            }
            for case in range(21)
        ]
        rows[0]["metrics"]["contact.lost_s"] = 0.1
        return campaign_report.summarise(rows, campaign, "mine.toml")

    summed_up = summed(0.0)
    force = summed_up.metrics["metrics"]["contact.force_error_rms_n"]
    assert force == pytest.approx(
        {
            "runs": 21,
            "least": 0.0,
            "low": 1.0,
            "median": 10.0,
            "high": 19.0,
            "top": 19.8,
            "largest": 20.0,
        }
    )
    assert summed_up.metrics["kept"]["runs"] == 20
    assert summed_up.failed == []
    assert summed(0.1).failed == ["90.5% of the runs passed, but 95.2% are required"]


def test_the_page_shows_what_explains_the_misses(tmp_path):
    """Contact is lost in stiff runs only; the ranking, the reasons and the page say so."""
    campaign = read(tmp_path, FILE)
    rows = [
        {
            "case": run.case,
            "values": run.values,
            "drawn": {"arm_mass": 1.0 + 0.01 * (run.case * 7 % 11)},
            "state": "done" if run.case % 9 else "abort",
            "code": "" if run.case % 9 else "jammed",
            "accepted": True,
            "metrics": {
                "contact.force_error_rms_n": 1.0 + (run.case * 5 % 13),
                "contact.lost_s": max(0.0, run.values["perturbations.Pad.stiffness"] / 3e5 - 1.0),
            },
        }
        for run in replace(campaign, cases=60, bounds={"contact.lost_s": 0.5}).runs()
    ]
    campaign = replace(campaign, bounds={"contact.lost_s": 0.5})
    summary = campaign_report.summarise(rows, campaign, "mine.toml")
    sensitivity_of = summary.metrics["sensitivity"]
    assert (
        sensitivity_of["responses"]["worst ratio to a bound"]["parameters"][0]["name"]
        == "perturbations.Pad.stiffness"
    )
    moved = {(shift["reason"], shift["parameter"]): shift for shift in sensitivity_of["reasons"]}
    assert moved["contact.lost_s", "perturbations.Pad.stiffness"]["median_rank"] > 0.8
    assert moved["contact.lost_s", "perturbations.Pad.stiffness"]["p"] < 1e-4
    assert {"contact.lost_s", "abort: jammed", "any reason"} == {reason for reason, _ in moved}
    summary.write_page(tmp_path / "report.html", "T", {}, "")
    assert (tmp_path / "report.html").read_text().count("<img") == 4


# -- the command -----------------------------------------------------------------------------------


def refused(done: Any) -> str:
    """The only line that a command printed before it ended with code 2."""
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    return done.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"site.current" =', '"site.curent" =', "[site] has no 'curent'"),
        ("log_uniform", "normal", "no distribution 'normal'; allowed uniform"),
        ("contact.force_error_rms_n", "contact.luck", "no metric 'contact.luck'"),
    ],
)
def test_the_command_refuses_a_mistake_in_one_line(verb, tmp_path, old, new, said):
    file = tmp_path / "mine.toml"
    file.write_text(FILE.replace(old, new))
    out = tmp_path / "out"
    assert said in refused(verb("campaign", file, "--out", out, "--workers", 1))
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--version", "with luck"), "--version: only with --only or --replay"),
        (("--only", 1, "--version", "luck"), "--version: allowed without fusion, got 'luck'"),
        (("--only", 9), "case: allowed 0 to 3, got 9"),
        (("--drawn", "gone.json"), "drawn cases 'gone.json': there is no such file"),
        (("--drawn", "gone.json", "--seed", 1), "--drawn and --seed: give only one of them"),
    ],
)
def test_the_command_refuses_runs_that_there_are_not(verb, tmp_path, options, said):
    file = tmp_path / "mine.toml"
    file.write_text(FILE + "\n[versions.'without fusion']\n'control.without' = ['fusion']\n")
    out = tmp_path / "out"
    assert said in refused(verb("campaign", file, "--out", out, "--workers", 1, *options))
    assert not out.exists()


def test_the_command_refuses_rows_of_another_version(verb, tmp_path):
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(FILE)
    table = RowTable(out)
    out.mkdir()
    table.extend([{"case": 0}])
    rows = out / "rows" / "000000.parquet"
    about = {"schema": SCHEMA_VERSION, "settings": {}, "versions": versions(), "code": {}}
    (out / "study.json").write_text(json.dumps(about))
    pq.write_table(
        pq.read_table(rows).replace_schema_metadata({"uuv_arm.schema_version": "99"}), rows
    )
    message = refused(verb("campaign", file, "--out", out, "--workers", 1))
    assert "version" in message
    assert "99" in message


def test_two_commands_do_not_share_a_folder(verb, tmp_path):
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(FILE)
    out.mkdir()
    with alone_in(out):
        message = refused(verb("campaign", file, "--out", out, "--workers", 1))
    assert f"{out}: in use by the process" in message
    assert "in use by the process" in message


def test_each_task_names_the_figures_of_its_runs():
    from uuv.campaigns.campaign import metric_names
    from uuv.jobs import identify_friction, inspect_object

    friction, inspection = (metric_names(job()) for job in (identify_friction, inspect_object))
    assert any(name.startswith("friction.") for name in friction - inspection), sorted(friction)
    assert any(name.startswith("inspection.") for name in inspection - friction), sorted(inspection)
