"""Cost of the engines of campaigns: rows that differ are not accepted, and what is refused."""

import pytest

from experiments.runtime.campaign_engines import EnginesCase, campaign_engines, row_costs
from uuv.sim.interfaces.errors import ConfigurationError


@pytest.mark.parametrize(
    ("option", "value"), [("tasks", 1), ("campaign_runs", 1), ("engines", ("rays",))]
)
def test_a_campaign_needs_two_runs_and_known_engines(option, value):
    with pytest.raises(ConfigurationError, match=option.replace("_", "-")):
        EnginesCase(**{option: value})


def test_rows_that_differ_are_not_accepted(monkeypatch):
    monkeypatch.setattr("experiments.runtime.campaign_engines._SIZES", (0, 60))
    monkeypatch.setattr("experiments.runtime.campaign_engines._ADDED", 2)
    costs = row_costs([{"case": 0, "force": 1.5}])
    assert set(costs["add"]) == {"alone, after 0", "alone, after 60", "50 at once"}

    names = ("first", "task", "message", "end", "wall", "own", "overhead")
    row = {name: {"processes": 0.02, "ray": 0.04} for name in names} | costs
    row |= {"campaign": "c.toml", "campaign_runs": 2, "processes": 2, "tasks": 2, "engines": []}
    row |= {"disk": 8.0, "plan": 1e-3, "plan_memory": 10.0, "equal": False}
    summary = campaign_engines.summary([row])
    assert summary.failed
    assert [line[-1] for line in summary.tables[0].rows] == ["2.00", "4.00"]
