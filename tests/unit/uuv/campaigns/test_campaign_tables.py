"""Tables of a campaign: by what its cases take in turn, by the stated probability, and versions."""

from dataclasses import replace
from typing import Any

import pytest

from uuv.campaigns.campaign import Campaign
from uuv.campaigns.campaign_report import summarise
from uuv.campaigns.campaign_tables import CHANCE, group_tables, reliability, versions
from uuv.experiment import Row
from uuv.jobs import clean_barrel

FORCE, OFF = "contact.force_error_rms_n", "path.true_deviation_max_m"
CAMPAIGN = Campaign(
    name="turns",
    base=clean_barrel(quick=True),
    distributions={},
    metrics=(FORCE, CHANCE),
    cases=6,
    bounds={FORCE: 2.0},
    also={OFF: 0.003},
    grid={"task.path": ("longitudinal", "transverse"), "site.gust": (0.0, 0.01, 0.02)},
    versions={"without fusion": {"control.without": ["fusion"]}},
    version_cases=2,
)


def row(case: int, version: Any = "", **changed: Any) -> Row:
    """Row of a run that is kept; but for the metrics that are changed, or its `ended`."""
    ended = changed.pop("ended", "done")
    (drawn,) = CAMPAIGN.drawn(case + 1)[case:]
    return {
        "case": case,
        "version": version,
        "values": dict(drawn.values),
        "drawn": {},
        "state": "done" if ended == "done" else "abort",
        "ended": ended,
        "code": "" if ended == "done" else "force limit",
        "accepted": True,
        "metrics": {FORCE: 1.0, OFF: 0.001, CHANCE: None, **changed},
    }


def test_cases_take_the_values_of_the_grid_in_turn_the_first_key_fastest():
    draws = [case.values for case in CAMPAIGN.drawn()]
    assert [draw["task.path"][0] for draw in draws] == ["l", "t"] * 3
    assert [draw["site.gust"] for draw in draws] == [0.0, 0.0, 0.01, 0.01, 0.02, 0.02]
    joint = replace(CAMPAIGN, grid={"task.path, task.least": (["transverse", 0.5],)})
    (drawn,) = joint.drawn(1)
    assert (drawn.values["task.path"], drawn.values["task.least"]) == ("transverse", 0.5)


def test_versions_have_the_same_draws_and_their_own_values():
    runs = CAMPAIGN.all_runs(CAMPAIGN.drawn())
    assert [(run.case, run.version) for run in runs[6:]] == [
        (0, "without fusion"),
        (1, "without fusion"),
    ]
    plain, version = runs[1].scenario(), runs[7].scenario()
    assert version.control.without == ("fusion",)
    assert replace(version, control=plain.control) == plain


def test_runs_are_counted_by_each_value_and_by_two():
    rows = [row(case) for case in range(6)]
    rows[1] = row(1, **{FORCE: 3.0})
    rows[3] = row(3, **{OFF: 0.004})
    by_path, by_gust, both = group_tables(rows, CAMPAIGN)
    assert [(line[0], *line[1:3], line[-1]) for line in by_path.rows] == [
        ("longitudinal", "3", "3", "3"),
        ("transverse", "3", "2", "1"),
    ]
    assert by_path.rows[1][3:5] == ("66.7%", "20.8% to 93.9%")  # Wilson, of 2 in 3
    assert [line[:3] for line in by_gust.rows] == [
        ("0", "2", "1"),
        ("0.01", "2", "2"),
        ("0.02", "2", "2"),
    ]
    assert both.columns == ("task.path", "0", "0.01", "0.02")
    assert both.rows[1] == ("transverse", "0/1  3", "1/1  1", "1/1  1")


def test_a_run_is_in_one_bin_of_its_stated_probability():
    """On a bound it is in the upper one, and a probability of 1 in the last."""
    rows = [
        row(k, **{CHANCE: probability})
        for k, probability in enumerate((0.95, 0.96, 0.98, 1.0, None))
    ]
    rows[1]["ended"] = "broken off"
    assert reliability(rows, CAMPAIGN) == [
        {"least": 0.95, "most": 0.98, "runs": 2, "mean": pytest.approx(0.955), "kept": 1},
        {"least": 0.98, "most": 0.99, "runs": 1, "mean": 0.98, "kept": 1},
        {"least": 0.99, "most": 1.0, "runs": 1, "mean": 1.0, "kept": 1},
    ]


def test_the_factor_of_a_version_is_the_median_of_ratios_of_the_same_draws():
    rows = [row(case, **{FORCE: 1.0 + 0.1 * case}) for case in range(3)]
    rows += [
        row(case, "without fusion", **{FORCE: factor * (1.0 + 0.1 * case)})
        for case, factor in enumerate((2.0, 3.0, 10.0))
    ]
    rows.append(row(5, "without fusion", **{FORCE: 99.0}))  # of no run without the version
    rows[3]["ended"] = "broken off"
    of = versions(rows, CAMPAIGN)["without fusion"]
    assert (of["pairs"], of["kept_plain"], of["kept"]) == (3, 3, 0)
    assert (of["only_plain"], of["only_version"], of["p"]) == (3, 0, 0.25)  # 2 / 2^3
    force = of["metrics"][FORCE]
    assert force["factor"] == pytest.approx(3.0)
    assert (force["largest_plain"], force["largest"]) == pytest.approx((1.2, 12.0))


def test_a_page_holds_its_versions_and_counts_the_campaign_itself(tmp_path):
    rows = [row(case, **{FORCE: 0.5 + 0.1 * case}) for case in range(6)]
    rows[2] = row(2, ended="damage", **{FORCE: None})
    rows += [row(case, "without fusion", **{FORCE: 5.0}) for case in range(2)]
    summary = summarise(rows, replace(CAMPAIGN, never=("damage",)), "turns.toml")
    assert (summary.metrics["runs"], summary.metrics["kept"]["runs"]) == (6, 5)
    assert summary.metrics["by"]["task.path"]["longitudinal"] == {"runs": 3, "kept": 2}
    assert summary.failed == ["1 runs ended with a forbidden outcome: damage"]
    assert [line[0] for line in summary.tables[0].rows] == ["kept", "damage: force limit"]
    titles = [table.title for table in summary.tables]
    assert "Versions on the same draws: runs passed" in titles
    assert "Versions on the same draws: metrics" in titles
    summary.write_page(tmp_path / "report.html", "T & T", {}, "")
    page = (tmp_path / "report.html").read_text()
    assert page.count("<img") == 4
    assert "without fusion" in page


def test_values_that_are_taken_together_are_one_parameter():
    """Path and forces change together: both in one regression would have no solution."""
    grid = {"task.path, task.forces": (["longitudinal", [60.0, 90.0]], ["transverse", [60.0]])}
    campaign = replace(CAMPAIGN, grid=grid)
    rows = [
        row(drawn.case, **{FORCE: 1.0 + 0.1 * (drawn.case % 7)}) | {"values": dict(drawn.values)}
        for drawn in campaign.drawn(20)
    ]
    responses = summarise(rows, campaign, "turns.toml").metrics["sensitivity"]["responses"]
    names = {parameter["name"] for parameter in responses["worst ratio to a bound"]["parameters"]}
    assert names == {"task.path = transverse"}


def test_versions_alone_are_no_campaign():
    with pytest.raises(Exception, match="none of the campaign itself"):
        summarise([row(0, "without fusion")], CAMPAIGN, "turns.toml")
