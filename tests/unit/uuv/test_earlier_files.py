"""Files of earlier and of later versions: read, or refused by name in one line."""

import json
import re
import sys
from importlib.machinery import PathFinder
from pathlib import Path

import pytest

from run_records import every_run
from uuv.cli.past.compare_runs import numbers
from uuv.jobs import clean_barrel
from uuv.kinds import where_moved
from uuv.scenario_file import read_scenario, to_toml, write_scenario
from uuv.sim.evaluation.run_metrics import EveryRun
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.reporting.series_tables import PastRun
from uuv.sim.runs.run_folder import FORMAT

SCENARIO = clean_barrel(seed=4, quick=True)


def test_a_scenario_has_the_format_of_its_file_and_is_read_without_one(tmp_path: Path):
    write_scenario(SCENARIO, tmp_path / "now.toml")
    assert (tmp_path / "now.toml").read_text().startswith(f"format = {FORMAT}\n")
    (tmp_path / "before.toml").write_text(to_toml(SCENARIO))
    assert (
        read_scenario(tmp_path / "now.toml") == read_scenario(tmp_path / "before.toml") == SCENARIO
    )


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (FORMAT + 1, f"format: must be 1 to {FORMAT} for this version of uuv, got {FORMAT + 1}"),
        (0, "format: must be a whole number >= 1, got 0"),
        ("'2'", "format: must be a whole number >= 1, got '2'"),
        ("true", "format: must be a whole number >= 1, got True"),
    ],
)
def test_another_format_is_refused_by_name(number: object, said: str, tmp_path: Path):
    (tmp_path / "s.toml").write_text(f"format = {number}\n{to_toml(SCENARIO)}")
    with pytest.raises(ConfigurationError, match=re.escape(f"s.toml': {said}")):
        read_scenario(tmp_path / "s.toml")
    (tmp_path / "metrics.json").write_text(
        json.dumps({"format": json.loads(str(number).replace("'", '"'))})
    )
    with pytest.raises(ConfigurationError, match=re.escape(f"metrics.json': {said}")):
        _ = PastRun.of(tmp_path).metrics


def test_figures_without_a_format_are_read_and_the_format_is_no_figure(tmp_path: Path):
    (tmp_path / "metrics.json").write_text(json.dumps(every_run()))
    past = PastRun.of(tmp_path)
    assert past.metrics["accepted"]
    assert EveryRun.__dataclass_fields__["format"].default == FORMAT
    assert "format" not in dict(numbers({**past.metrics, "format": FORMAT}))


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (
            "scenarios.tasks.surface_work:SurfaceWorkTask",
            "that module is now uuv.tasks.surface_work",
        ),
        ("scenarios.nowhere:Task", "scenarios is now part of uuv, which has no module nowhere"),
        (
            "controllers.whole_body.work_controller:Mine",
            "that module is now uuv.controllers.whole_body.work_controller",
        ),
        ("models:hull", "that module is now uuv.models"),
    ],
)
@pytest.mark.parametrize("trust", [False, True])
def test_code_of_an_earlier_package_is_named_where_it_is_now(
    kind: str, said: str, trust: bool, tmp_path: Path
):
    text = re.sub(r'(\[task\]\nkind = )"\w+"', rf'\1"{kind}"', to_toml(SCENARIO))
    assert kind in text
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=re.escape(f"names '{kind}': {said}")) as refused:
        read_scenario(tmp_path / "s.toml", trust=trust)
    assert "\n" not in str(refused.value)


def test_a_module_of_the_users_own_may_have_such_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "models.py").write_text("")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.setattr(sys, "meta_path", [PathFinder])
    monkeypatch.delitem(sys.modules, "models", raising=False)
    assert where_moved("models:hull") == ""
    assert where_moved("mine.models:hull") == ""
