"""An experiment of one file: its options, cases, rows and page, and what it refuses."""

import ast
import importlib.util
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

from uuv.experiment import Page, column, experiment, read_rows, stat
from uuv.experiment.declaration import experiments_in
from uuv.experiment.drawn_cases import DrawnCase, write_cases
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError

MISSPELT: Any = "meen"


@dataclass(frozen=True, kw_only=True)
class Throw:
    """One throw."""

    ball: str
    """Name of the ball."""
    speed: float = 3.0
    """Speed [m/s]."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class Landing:
    """Where it lands."""

    reach: float | None = column("reach", "mm", digits=0, factor=1e3)
    good: bool = column("beyond 5 m", default=False)
    bounces: Mapping[str, int] | None = column("bounces", by="ground", default=None)


@experiment("throws", seeds=6, vary={"ball": ("red", "blue")}, quick={"runs": 2})
def throws(case: Throw) -> Landing:
    """Throws a ball."""
    if case.speed < 0.0:
        raise PerceptionError("no ball is seen")
    reach = case.speed + case.seed
    if reach > 7.0:
        return Landing(reach=None)
    bounces = {"sand": case.seed, "rock": 2 * case.seed}
    return Landing(reach=reach, good=reach > 5.0, bounces=bounces)


@dataclass(frozen=True, kw_only=True)
class Volley:
    """Several throws in a row."""

    speeds: tuple[float, ...] = (1.0, 2.0)
    """Speeds [m/s]."""


def thrown(volley: Volley) -> Iterator[Throw]:
    """A throw for each speed."""
    return (Throw(ball="red", speed=speed, seed=0) for speed in volley.speeds)


volleys = experiment("volleys", cases=thrown)(throws.run)


def summary_of(page: Page, **options: Any) -> Any:
    """Summary of all rows of the experiment on a page."""
    cases = throws.space.cases(throws.options_with(options))
    rows = [{"seed": case.seed, "ball": case.ball, "speed": case.speed} for case in cases]
    outcomes = [vars(throws(case)) for case in cases]
    page.check(throws.columns)
    return page.summary(
        [row | outcome for row, outcome in zip(rows, outcomes, strict=True)], throws.columns
    )


# -- cases and options -----------------------------------------------------------------------------


def test_seeds_go_round_the_combinations_or_are_paired_with_all():
    cases = throws.space.cases(throws.options_with({"runs": 3, "seed": 4}))
    assert [(case.ball, case.seed) for case in cases] == [("red", 4), ("blue", 5), ("red", 6)]

    paired = experiment("p", seeds=2, vary={"ball": ("a", "b")}, paired=True)(throws.run)
    cases = paired.space.cases(paired.options_with({}))
    assert [(c.ball, c.seed) for c in cases] == [("a", 0), ("b", 0), ("a", 1), ("b", 1)]


def test_a_function_makes_the_cases_of_options_of_its_own():
    cases = volleys.space.cases(volleys.options_with({"speeds": (1.5, 2.5)}))
    assert [case.speed for case in cases] == [1.5, 2.5]


def test_drawn_cases_are_run_in_place_of_those_of_the_options(tmp_path: Path):
    """Two kept throws, with seeds that no option asks for."""
    cases = [Throw(ball="blue", speed=0.1 + 0.2, seed=9), Throw(ball="red", seed=3)]
    drawn = [DrawnCase(case=k, values=asdict(case)) for k, case in enumerate(cases)]
    file = tmp_path / "cases.json"

    write_cases(file, "throws", drawn)
    assert throws.study(throws.options_with({"drawn": file, "runs": 1})).cases == cases

    green = Throw(ball="green", seed=9)
    write_cases(file, "throws", [DrawnCase(case=3, values=asdict(green))])
    with pytest.raises(ConfigurationError, match="case 3: ball: allowed red, blue, got 'green'"):
        throws.study(throws.options_with({"drawn": file}))

    write_cases(file, "catches", drawn)
    with pytest.raises(ConfigurationError, match="experiment: allowed throws, got 'catches'"):
        throws.study(throws.options_with({"drawn": file}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ball": ("rde",)}, "--ball: must be one of red, blue, got 'rde' (did you mean red?)"),
        ({"ball": ()}, "--ball: must have at least one value"),
        ({"runs": 0}, "--runs: must be at least 1, got 0"),
        ({"seed": -1}, "--seed: must be at least 0, got -1"),
        ({"balls": ("red",)}, "throws: option must be one of "),
    ],
)
def test_options_that_are_refused(options, message):
    with pytest.raises(ConfigurationError) as refused:
        throws.space.cases(throws.options_with(options))
    assert message in str(refused.value)


@dataclass(frozen=True, kw_only=True)
class Twice:
    """Row with a column of the case."""

    speed: float = column("speed")


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """Case with an option of the harness."""

    workers: int = 1


def test_declarations_that_are_refused():
    def twice(case: Throw) -> Twice: ...

    def hidden(case: Hidden) -> Landing: ...

    def bare(case: Throw): ...

    with pytest.raises(
        ConfigurationError, match=r"Twice\.speed: the name must differ from the fields of Throw"
    ):
        experiment("x")(twice)
    with pytest.raises(ConfigurationError, match=r"Hidden\.workers: is an option of every"):
        experiment("x")(hidden)
    with pytest.raises(
        ConfigurationError, match="bare: the annotation of its result must be a dataclass"
    ):
        experiment("x")(bare)
    with pytest.raises(
        ConfigurationError, match=r"varied field of Throw: must be one of .*, got 'bal'"
    ):
        experiment("x", vary={"bal": (1,)})(throws.run)


# -- running ---------------------------------------------------------------------------------------


def test_a_row_holds_case_and_outcome_and_a_second_start_resumes(tmp_path, capfd):
    options = throws.options_with({"out": tmp_path, "workers": 1, "runs": 2})
    assert throws.carry_out(options) == 0
    first, second = sorted(read_rows(tmp_path), key=lambda row: row["seed"])
    assert {name: first[name] for name in throws.columns} == {
        "ball": "red",
        "speed": 3.0,
        "seed": 0,
        "reach": 3.0,
        "good": False,
        "bounces": {"sand": 0, "rock": 0},
    }
    assert second["ball"] == "blue"

    longer = throws.options_with({"out": tmp_path, "workers": 1, "runs": 3})
    assert throws.carry_out(longer) == 0
    assert "2 of 3 runs are already done" in capfd.readouterr().out


def test_a_page_of_rows_of_another_version_is_refused_by_the_column(tmp_path, monkeypatch):
    options = throws.options_with({"out": tmp_path, "workers": 1, "runs": 1})
    assert throws.carry_out(options) == 0
    page_alone = throws.options_with({"out": tmp_path, "run": False, "runs": 1})
    assert throws.carry_out(page_alone) == 0

    monkeypatch.setattr(throws, "columns", {**throws.columns, "height": throws.columns["reach"]})
    with pytest.raises(ConfigurationError, match=r"another version of .*: no column height"):
        throws.carry_out(page_alone)


def test_an_error_of_a_run_names_its_case(tmp_path):
    options = throws.options_with({"out": tmp_path, "workers": 1, "speed": -1.0})
    with pytest.raises(
        ConfigurationError, match=r"throws, ball 'red', speed -1\.0, seed 0: no ball"
    ):
        throws.carry_out(options)


def test_a_case_that_failed_can_have_a_row(tmp_path):
    lost = experiment("lost", seeds=2, failed=lambda *_: Landing(reach=None))
    declared = lost(throws.run)
    options = declared.options_with({"out": tmp_path, "workers": 1, "speed": -1.0, "ball": "red"})
    assert declared.carry_out(options) == 0
    assert [row["reach"] for row in read_rows(tmp_path)] == [None, None]


def test_a_worker_gets_the_experiment_by_its_name():
    assert pickle.loads(pickle.dumps(throws)) is throws
    assert pickle.loads(pickle.dumps(throws.row)) == throws.row


# -- page ------------------------------------------------------------------------------------------


def test_a_table_has_statistics_by_group_and_over_all():
    page = Page().table(
        "Reach",
        by="ball",
        columns=[stat("mean", "reach"), stat("spread", "reach"), stat("share", "good")],
        total=True,
    )
    (table,) = summary_of(page).tables
    assert table.columns == (
        "ball",
        "reach, mean [mm]",
        "reach, median, 95 %, largest [mm]",
        "beyond 5 m [%]",
    )
    # reach of red 3, 5, 7 m; of blue 4 and 6 m, and one without
    assert [list(row[:3]) for row in table.rows] == [
        ["red", "5000", "5000, 6800, 7000"],
        ["blue", "5000", "5000, 5900, 6000"],
        ["all", "5000", "5000, 6800, 7000"],
    ]
    assert table.rows[0][3] == "33.3 (6.1 to 79.2) of 3"
    assert "reach, mean: 1 of 6 rows have no value" in table.caption


def test_a_function_of_all_rows_is_not_asked_without_rows():
    page = Page().add(lambda rows: f"first: {rows[0]['ball']}")
    assert page.summary([], throws.columns).lines == []
    assert page.summary([{"ball": "red"}], throws.columns).lines == ["first: red"]


def test_quantiles_and_the_standard_error_of_the_mean():
    """Of 0 to 10 the quantiles are 1 and 9, and the standard error is sqrt(11 / 11) = 1."""
    rows = [{"reach": 1.0 * k} for k in range(11)]
    cells = {
        kind: stat(kind, lambda row: row["reach"], kind).cell(rows)
        for kind in ("p10", "p90", "sem")
    }
    assert cells == {"p10": "1", "p90": "9", "sem": "1"}
    assert stat("sem", lambda row: row["reach"], "sem").cell(rows[:1]) == "-"


def test_columns_with_keys_make_a_line_or_a_column_for_each_key():
    page = Page().table("Down", by="ground", columns=[stat("total", "bounces")])
    page.table("Across", by="ball", across="ground", columns=[stat("total", "bounces")])
    down, across = summary_of(page).tables
    assert [list(row) for row in down.rows] == [["sand", "10"], ["rock", "20"]]
    assert across.columns == ("ball", "sand", "rock")
    assert [list(row) for row in across.rows] == [["red", "6", "12"], ["blue", "4", "8"]]

    # Figures have the names of both, not their places
    figures = summary_of(page).metrics["Across"]
    label = next(iter(figures["red"]["sand"]))
    assert [figures[ball]["rock"][label] for ball in ("red", "blue")] == [
        {"total": 12},
        {"total": 8},
    ]


def test_a_histogram_counts_whole_numbers_bins_and_missing_values():
    page = Page().histogram("bounces", by="ground").histogram("reach", none="never")
    whole, bins = summary_of(page).tables
    assert whole.columns == ("ground", *map(str, range(9)))
    assert [row[0] for row in whole.rows] == ["sand", "rock"]
    assert list(whole.rows[0][1:6]) == ["1"] * 5
    (numbers,) = bins.rows
    assert bins.columns[-1] == "never"
    assert numbers[-1] == "1"
    assert sum(map(int, numbers[1:])) == 6


def test_a_histogram_counts_what_is_true():
    (table,) = summary_of(Page().histogram("good")).tables
    assert sorted(map(int, table.rows[0][1:])) == [2, 4]


def test_a_share_is_among_the_trials_of_rows_that_have_a_value():
    share = stat("share", lambda row: row["good"], "good", among="tried")
    rows = [{"good": 8, "tried": 10}, {"good": None, "tried": 10}]
    assert share.numbers(rows)["of"] == 10


def test_bounds_make_it_accepted_or_not():
    within = Page().accept(stat("largest", "reach"), most=7.5)
    assert summary_of(within).accepted
    beyond = Page().accept(stat("largest", "reach"), most=6.5).accept(stat("share", "good"))
    assert summary_of(beyond).failed == ["reach, largest: 7000 mm, at most 6500 mm is allowed"]
    assert not summary_of(Page().accept(stat("largest", "reach"), most=9.0), speed=9.0).accepted


def test_a_bound_holds_for_each_group():
    """Red flies 3, 5, 7 m and blue 4, 6 m: only blue is within 6.5 m."""
    page = Page().accept(stat("largest", "reach"), most=6.5, by="ball")
    assert summary_of(page).failed == [
        "ball red, reach, largest: 7000 mm, at most 6500 mm is allowed"
    ]
    bounces = Page().accept(stat("largest", "bounces"), most=7.0, by="ground")
    assert summary_of(bounces).failed == ["rock, bounces, largest: 8, at most 7 is allowed"]
    lost = Page().accept(stat("mean", "reach"), by="ball", where=lambda row: row["reach"] is None)
    assert summary_of(lost).failed == ["ball blue, reach, mean: no value"]
    nowhere = Page().accept(stat("mean", "reach"), by="ball", where=lambda _: False)
    assert summary_of(nowhere).failed == ["reach, mean: no row"]


def test_a_statistic_of_a_group_is_what_a_function_of_its_rows_gives():
    def gap(rows: list[dict[str, Any]]) -> float | None:
        reach = [row["reach"] for row in rows if row["reach"] is not None]
        return max(reach) - min(reach) if len(reach) > 2 else None

    widest = stat("group", gap, "gap", unit="mm", digits=0, factor=1e3)
    summary = summary_of(
        Page().table("T", by="ball", columns=[widest]).accept(widest, most=3.0, by="ball")
    )
    (table,) = summary.tables
    assert table.columns == ("ball", "gap [mm]")
    assert [list(row) for row in table.rows] == [["red", "4000"], ["blue", "-"]]
    assert table.caption == ""
    assert summary.failed == [
        "ball red, gap: 4000 mm, at most 3000 mm is allowed",
        "ball blue, gap: no value",
    ]


def test_a_picture_may_be_drawn_when_it_is_asked_for():
    drawn: list[int] = []
    page = Page().add(lambda rows: ("title", "caption", lambda: drawn.append(len(rows))))
    summary = summary_of(page)
    assert drawn == []
    assert [picture[:2] for picture in summary.pictures] == [("title", "caption")]
    assert drawn == [6]


def test_shares_and_figures_of_a_function():
    page = Page().share("good", "far").add(lambda rows: [f"{len(rows)} rows", {"last": 5}])
    summary = summary_of(page)
    assert summary.lines == ["far: 33.3 % (9.7 to 70.0) of 6", "6 rows"]
    assert summary.metrics["last"] == 5
    assert summary.metrics["far"]["good"] == 2


@pytest.mark.parametrize(
    ("page", "message"),
    [
        (lambda: Page().share("god"), "got 'god'"),
        (lambda: Page().table("T", columns=["reech"]), "did you mean reach?"),
        (lambda: Page().table("T", by="grond", columns=["reach"]), "got 'grond'"),
        (lambda: Page().histogram("x"), "a histogram of the page: must be one of the columns "),
        (lambda: Page().table("T", columns=[stat("mean", lambda _: 1)]), "must have a label"),
        (lambda: Page().accept(stat("mean", "reach"), by="bal"), "did you mean ball?"),
        (
            lambda: Page().table("T", columns=[stat("group", "reach")]),
            "must have a function of the",
        ),
        (lambda: Page().table("T", columns=[stat(MISSPELT, "reach")]), "did you mean mean?"),
    ],
)
def test_names_on_a_page_are_checked_where_it_is_declared(page, message):
    with pytest.raises(ConfigurationError) as refused:
        throws.page = page()
    assert message in str(refused.value)


# -- the example of the documents ------------------------------------------------------------------


def test_the_example_of_the_page_is_the_file_and_runs_as_a_command(root, tmp_path):
    page = (root / "docs" / "own_experiment.md").read_text(encoding="utf-8")
    file = root / "docs" / "examples" / "my_drift.py"
    assert f"```python\n{file.read_text(encoding='utf-8')}```" in page

    words = "--runs 1 --vehicle bluerov2_heavy --speed 0.3 --workers 1"
    run = subprocess.run(
        [sys.executable, file, *words.split(), "--out", tmp_path / "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    (row,) = read_rows(tmp_path / "out")
    assert 0.3 < row["drift"] < 0.6
    assert "Two seconds without thrust" in run.stdout
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["accepted"]
    assert Path(tmp_path / "out" / "report.html").is_file()


def test_experiments_of_a_module_are_those_that_it_declares():
    assert experiments_in(sys.modules[__name__])[0] is throws


def test_the_example_around_a_job_is_the_file_and_fits_its_page(root):
    page = (root / "docs" / "own_experiment.md").read_text(encoding="utf-8")
    file = root / "docs" / "examples" / "my_current.py"
    assert f"```python\n{file.read_text(encoding='utf-8')}```" in page

    spec = importlib.util.spec_from_file_location("my_current", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert len(module.my_current.space.cases(module.my_current.options_with({}))) == 4


@pytest.mark.long(
    guarded_by="tests/unit/uuv/experiment/test_declaration.py::"
    "test_the_example_around_a_job_is_the_file_and_fits_its_page"
)
def test_the_example_around_a_job_runs_as_a_command(root, tmp_path):
    words = "--runs 1 --speed 0.1 --workers 1"
    subprocess.run(
        [
            sys.executable,
            root / "docs" / "examples" / "my_current.py",
            *words.split(),
            "--out",
            tmp_path / "out",
        ],
        cwd=tmp_path,
        check=True,
    )
    (row,) = read_rows(tmp_path / "out")
    assert row["accepted"]
    assert row["ended"] == "done"
    assert row["checked"]["force error, peak"] < 10.0


def test_the_names_of_checks_on_the_page_are_those_of_the_assessments(root):
    """Names that are put together, of the gears' friction, end in words of their own."""
    page = (root / "docs" / "own_experiment.md").read_text(encoding="utf-8")
    table = page.partition("| work | checks |")[2].partition("\n\n")[0]
    listed = set(re.findall(r"`([^`]+)`", table))

    written = set()
    for file in (*(root / "sim" / "evaluation").rglob("*.py"), *(root / "uuv").rglob("tasks/*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(func=ast.Name(id="Requirement"), args=[ast.Constant(value=name), *_]):
                    written.add(name)
    composed = {name for name in listed if name.endswith(", error of the worst joint")}
    assert listed - composed == written
    assert len(composed) == 3
