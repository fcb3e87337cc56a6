"""Kept rows: how they are kept, written and read back, and what their status says."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from uuv.experiment import column, experiment
from uuv.results import kept_rows
from uuv.results.check import deviations, same
from uuv.results.kept_rows import Check, KeptRows, checked, command_of, keep, words_of
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(frozen=True, kw_only=True)
class Dive:
    """One dive."""

    site: str
    """Name of the site."""
    deep: bool = False
    """Whether it is deep."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class Dived:
    """Depth and time of a dive."""

    depth: float | None = column("depth", "m")
    by_hour: Mapping[str, int] = column("fish", by="hour")
    wall_s: float = column("time", "s", tolerance=None, default=0.5)


@experiment("dives", seeds=4, vary={"site": ("bay", "fjord")}, quick={"runs": 2})
def dives(case: Dive) -> Dived:
    """Dives."""
    depth = None if case.seed == 3 else 10.0 + case.seed / 3.0
    return Dived(depth=depth, by_hour={"noon": case.seed, "night": 1}, wall_s=0.1 * case.seed)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of a finished run of the dives."""
    monkeypatch.chdir(tmp_path)
    options = dives.options_with({"out": tmp_path / "run", "workers": 1})
    assert dives.carry_out(options) == 0
    return tmp_path / "run"


@pytest.fixture
def kept(run: Path, monkeypatch: pytest.MonkeyPatch) -> KeptRows:
    """The rows of that run, kept; the module of a test has no place among the experiments."""
    monkeypatch.setattr(kept_rows, "command_of", lambda *_: "dive")
    return keep(dives, run)


def test_rows_are_kept_in_the_order_of_the_cases_and_read_back(kept: KeptRows, tmp_path: Path):
    kept.write(tmp_path)
    back = kept_rows.kept_rows("dives", tmp_path)
    assert back == kept
    assert [row["seed"] for row in kept.rows] == [0, 1, 2, 3]
    assert kept.rows[1]["depth"] == 10.0 + 1.0 / 3.0  # every digit
    assert kept.rows[3]["depth"] is None
    assert kept.rows[2]["by_hour"] == {"noon": 2, "night": 1}
    assert kept.seeds == "seeds 0 to 3"
    assert kept_rows.kept_rows("others", tmp_path) is None


@dataclass(frozen=True, kw_only=True)
class DiveLogs:
    """Which logs."""

    data: Path
    """Folder of the logs."""


@dataclass(frozen=True, kw_only=True)
class DiveLog:
    """One log."""

    log: str


@dataclass(frozen=True, kw_only=True)
class LogLength:
    """Its length."""

    length: int = column("length")


def logs_in(logs: DiveLogs) -> list[DiveLog]:
    return [DiveLog(log=str(file)) for file in sorted(logs.data.glob("*.log"))]


@experiment("dive_logs", cases=logs_in)
def dive_logs(case: DiveLog) -> LogLength:
    """Reads logs."""
    return LogLength(length=len(Path(case.log).read_text()))


def test_rows_on_measured_data_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for name, length in (("a", 3), ("b", 5)):
        (tmp_path / f"{name}.log").write_text(length * "x")
    options = dive_logs.options_with({"data": Path(), "out": tmp_path / "run", "workers": 1})
    assert dive_logs.carry_out(options) == 0
    monkeypatch.setattr(kept_rows, "command_of", lambda *_: "read")
    assert [row["length"] for row in keep(dive_logs, tmp_path / "run").rows] == [3, 5]


def test_a_run_that_is_not_whole_or_of_other_code_is_not_kept(run: Path, tmp_path: Path):
    with pytest.raises(ConfigurationError, match="must be the folder of a finished run"):
        keep(dives, tmp_path)

    about = json.loads((run / "study.json").read_text())
    about["code"]["sim/interfaces/errors.py"] = "0123456789abcdef"
    (run / "study.json").write_text(json.dumps(about))
    with pytest.raises(
        ConfigurationError, match=r"made by the present code \(changed: sim/interfaces/errors"
    ):
        keep(dives, run)


def test_the_status_says_whether_the_code_or_the_values_have_changed(kept: KeptRows):
    assert kept.status.startswith("verified 20")
    assert any("errors.py" in files for files in kept.check.code.values())
    assert not any(folder.startswith("uuv/experiment") for folder in kept.check.code)

    other = {**kept.check.code, "sim/interfaces": {"errors.py": "01234567"}}
    stale = replace(kept, check=replace(kept.check, code=other))
    assert "*unverified*" in stale.status
    assert "`sim/interfaces/errors.py`" in stale.status

    deviating = replace(kept, check=checked({}, ["depth 3, kept was 4", "depth 5, kept was 6"]))
    assert deviating.status.endswith("depth 3, kept was 4 and 1 more")
    assert "*changed*" in deviating.status


def test_words_of_a_command_are_the_options_that_are_not_the_default():
    options = dives.options_with({"site": ("bay",), "deep": True, "workers": 2})
    assert words_of(options) == ["--site", "bay", "--deep"]
    hover = pytest.importorskip("experiments.vehicles.hover").hover
    options = hover.options_with({"currents": (0.2, 0.3), "table": ("lost",)})
    assert command_of(hover, options) == (
        "./uvw run scripts/experiments/vehicles/hover.py --table lost --currents 0.2 0.3"
    )


# -- comparison ------------------------------------------------------------------------------------


def row(seed: int, **changed: Any) -> dict[str, Any]:
    """Row of a dive in the bay or the fjord, as it is kept."""
    site = ("bay", "fjord")[seed % 2]
    outcome = vars(dives(Dive(site=site, seed=seed)))
    return {"site": site, "deep": False, "seed": seed} | outcome | changed


def test_equal_rows_deviate_in_nothing_and_times_are_never_compared(kept: KeptRows):
    assert list(deviations(dives, kept, [row(0), row(1, wall_s=9.0), row(3)])) == []


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (row(1, depth=10.4), "depth [m] of site fjord, deep False, seed 1: 10.4, kept was 10.3"),
        (row(1, depth=None), "-, kept was 10.3"),
        (row(2, by_hour={"noon": 2}), "noon 2, kept was noon 2, night 1"),
        (row(2, by_hour={"noon": 2, "night": 2}), "night 2, kept was noon 2, night 1"),
        (row(7), "no kept row of site fjord, deep False, seed 7"),
    ],
)
def test_what_deviates_is_named_with_its_case(kept: KeptRows, other, words):
    (line,) = deviations(dives, kept, [other])
    assert words in line


@pytest.mark.parametrize(
    ("before", "value", "tolerance", "equal"),
    [
        (1.0, 1.0 + 1e-7, 1e-6, True),
        (1.0, 1.0 + 1e-5, 1e-6, False),
        (1.0, 1.0 + 1e-12, 0.0, False),
        (True, 1, 1e-6, False),
        ([1.0, 2.0], [1.0, 2.0], 0.0, True),
        ([1.0, 2.0], [1.0], 0.1, False),
        ("a", "b", 1.0, False),
        (None, 0.0, 1.0, False),
    ],
)
def test_numbers_are_equal_within_a_relative_tolerance(before, value, tolerance, equal):
    assert same(before, value, tolerance) is equal


def test_changed_files_of_a_check():
    assert Check(date="", commit="").changed_files() == []
    assert Check(date="", commit="", code={"sim": {"gone.py": "0"}}).changed_files() == [
        "sim/gone.py"
    ]
