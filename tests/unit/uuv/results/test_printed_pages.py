"""Pages of results: those in docs/ are what the kept rows give, and README's figures are theirs."""

import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from uuv.cli.results import CHANGED, main
from uuv.experiment.loaded_code import digests
from uuv.results import kept_rows as kept
from uuv.results import pages
from uuv.results.kept_rows import ROWS, kept_rows
from uuv.sim.interfaces.errors import ConfigurationError

MOST_KEPT = 800_000  # bytes of all kept rows


@pytest.fixture(scope="module")
def entries() -> list[pages.ResultsOfOne]:
    """All experiments with their kept rows."""
    return pages.results(pages.all_experiments(), data=False)


def test_the_pages_in_docs_are_those_of_the_kept_rows(entries, root: Path):
    texts = pages.pages(entries)
    assert pages.stale(texts) == [], "run uuv results"
    listed = {path.name for path in (root / "docs" / "results").glob("*.md")} - {"physics.md"}
    assert listed == {f"{entry.experiment.name}.md" for entry in entries if entry.kept}

    # a subject has one section, with the experiments of the folders in it
    overview = texts[Path(pages.OVERVIEW)]
    subjects = re.findall(r"^## (.*)$", overview, flags=re.MULTILINE)
    assert len(subjects) == len(set(subjects))

    # one digit of a table, not the status, makes a page stale
    other = re.sub(r"(\| [^\n]*)0 \|\n", r"\g<1>1 |\n", overview, count=1)
    assert other != overview
    assert pages.stale({Path(pages.OVERVIEW): other}) == [pages.OVERVIEW]
    status = re.sub(r"^Status: .*$", "Status: other", overview, flags=re.MULTILINE)
    assert pages.stale({Path(pages.OVERVIEW): status}) == []


def test_kept_rows_are_small_and_of_an_experiment(entries):
    files = sorted(ROWS.glob("*.json"))
    assert sum(file.stat().st_size for file in files) < MOST_KEPT
    assert {file.stem for file in files} <= {entry.experiment.name for entry in entries}
    assert len(files) >= 2


def test_quick_subsets_are_cases_of_the_kept_rows(entries):
    """Else a check would compare nothing."""
    for entry in entries:
        experiment = entry.experiment
        if entry.kept is None or experiment.needs_data:
            continue
        cases = experiment.study(experiment.options_with(experiment.quick)).cases
        keys = {experiment.row_key(row) for row in entry.kept.rows}
        assert {experiment.case_key(case) for case in cases} <= keys, experiment.name
        assert experiment.quick


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Folder in which `uuv results` has its rows and pages, with the rows of two experiments."""
    for name in ("t200_voltages", "remus"):
        shutil.copy(ROWS / f"{name}.json", tmp_path)
    monkeypatch.setattr(kept, "ROWS", tmp_path)
    monkeypatch.setattr(kept, "kept_rows", partial(kept_rows, folder=tmp_path))
    monkeypatch.setattr(pages, "DOCS", tmp_path)
    return tmp_path


def test_a_check_goes_on_after_a_subset_that_fails(apart: Path, monkeypatch, capsys):
    """As where the interpreter of the subset ends without a folder."""
    monkeypatch.setattr("uuv.results.check.sys.executable", "/bin/false")
    before = {file.name: file.read_bytes() for file in apart.glob("*.json")}
    assert main("results", ["--check", "--only", "t200_voltages", "remus"]) == CHANGED
    errors = capsys.readouterr().err
    for name in ("t200_voltages", "remus"):
        assert f"not checked: experiment {name}: its quick subset failed" in errors
    assert {file.name: file.read_bytes() for file in apart.glob("*.json")} == before


def test_a_check_that_was_interrupted_leaves_out_what_is_verified(apart: Path, capsys):
    record = kept_rows("remus", apart)
    assert record is not None
    files = [f"{folder}/{name}" for folder, names in record.check.code.items() for name in names]
    code = {file: digest for file, digest in digests(files).items() if digest}
    replace(record, check=kept.checked(code)).write(apart)
    assert main("results", ["--check", "--unverified", "--only", "remus"]) == 0
    assert "checked in" not in capsys.readouterr().out


def test_an_experiment_that_needs_data_says_that_there_is_none(entries, monkeypatch):
    entry = next(entry for entry in entries if entry.kept is not None)
    monkeypatch.setattr(type(entry.experiment), "needs_data", True)
    assert entry.status.startswith("*no data here*; ")
    assert not replace(entry, has_data=True).status.startswith("*no data")
    assert replace(entry, kept=None).status == "*no rows kept*"


def test_an_experiment_without_rows_has_neither_tables_nor_a_verdict(entries):
    (entry,) = (entry for entry in entries if entry.experiment.name == "ik_success")
    texts = pages.pages([replace(entry, kept=None)])
    assert [*texts] == [Path(pages.OVERVIEW)]
    section = texts[Path(pages.OVERVIEW)].partition("## Kinematics")[2]
    assert "Status: *no rows kept*, of:" in section
    assert "`./uvw run scripts/experiments/kinematics/ik_success.py`" in section
    assert "ccepted" not in section
    assert "|" not in section


def test_a_long_table_stands_on_the_page_of_its_experiment_alone(entries, monkeypatch):
    (entry,) = (entry for entry in entries if entry.experiment.name == "ik_success")
    title = "Targets solved; of hybrid by kind of target"
    texts = pages.pages([entry])
    assert title in texts[Path(pages.OVERVIEW)]
    monkeypatch.setattr(pages, "MOST_ROWS", 2)
    texts = pages.pages([entry])
    assert title not in texts[Path(pages.OVERVIEW)]
    assert title in texts[Path("results/ik_success.md")]


def test_an_overview_that_is_too_long_is_refused(entries, monkeypatch):
    monkeypatch.setattr(pages, "MOST_LINES", 20)
    with pytest.raises(
        ConfigurationError, match=r"results.md: must have at most 20 lines, got \d+"
    ):
        pages.pages(entries)


def test_a_wheel_has_no_experiments(monkeypatch, tmp_path: Path):
    monkeypatch.setattr(pages, "EXPERIMENTS", tmp_path / "scripts" / "experiments")
    with pytest.raises(ConfigurationError, match="needs a checkout"):
        pages.all_experiments()


# -- README ----------------------------------------------------------------------------------------


def solved_by_hybrid() -> str:
    """Sentence of the README about the inverse kinematics."""
    kept_table = kept_rows("ik_success")
    assert kept_table is not None
    rows: list[dict[str, Any]] = kept_table.rows
    # the Puma with a tool is no arm of its own
    arms = {row["arm"].partition(",")[0].removesuffix("_tool") for row in rows}
    (targets,) = {row["tried"]["within limits"] for row in rows}
    missed = sum(row["missed"]["within limits"] for row in rows)
    number = "all" if missed == 0 else f"all but {missed}"
    thousands = f"{targets:,}".replace(",", " ")
    return f"solves {number} of {len(arms)} published arms, {thousands} targets a case"


def physics_rows(text: str) -> dict[str, list[str]]:
    """Cells of each row of the physics by the name of the check."""
    rows = re.findall(r"^\| (.*) \|$", text, flags=re.MULTILINE)
    return {cells[0]: cells for cells in (row.split(" | ") for row in rows)}


def force_of_the_main_job() -> str:
    """Sentence of the README about the true force, of both paths of the main job."""
    kept_table = kept_rows("papers")
    assert kept_table is not None
    errors = {
        row["command"].rpartition(" ")[2]: row["figures"]["contact.force_error_rms_n"]
        for row in kept_table.rows
        if row["command"].startswith("clean_barrel.py --no-record --path")
        and "contact.force_error_rms_n" in row["figures"]
    }
    along, around = (errors[path] for path in ("longitudinal", "transverse"))
    return f"{along:.2f} N along a barrel, {around:.2f} N around it"


def worst_of_ten(root: Path) -> str:
    """Part of that sentence: the largest of the main job's table on earlier results."""
    page = (root / "docs" / "results_earlier.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (?:longitudinal|transverse) \| \d \| ([\d.]+),", page, flags=re.MULTILINE
    )
    assert len(rows) == 10
    return f"{max(map(float, rows)):.2f} N in the [worst of ten earlier runs]"


def added_mass_of_shapes() -> str:
    """Sentence of the README about the water of a mesh."""
    kept_table = kept_rows("added_mass")
    assert kept_table is not None
    assert len(kept_table.rows) == 12
    largest = max(row["extrapolated"] for row in kept_table.rows)
    return (
        "The largest error of the added mass, on twelve shapes with a known value, is "
        f"{100.0 * largest:.1f} %"
    )


def test_the_readme_has_the_figures_of_the_kept_rows(root: Path):
    readme = " ".join((root / "README.md").read_text(encoding="utf-8").split())
    assert solved_by_hybrid() in readme
    assert force_of_the_main_job() in readme
    assert worst_of_ten(root) in readme
    assert added_mass_of_shapes() in readme


def test_a_figure_of_the_readme_that_is_typed_stands_on_the_page_that_it_links(root: Path):
    readme = (root / "README.md").read_text(encoding="utf-8")
    linked = re.findall(r"\[(\d[^\]]*)\]\((docs/[\w/]+\.md)[^)]*\)", readme)
    assert len(linked) >= 2
    for figure, page in linked:
        assert figure in (root / page).read_text(encoding="utf-8"), figure


def test_the_readme_has_the_figures_of_the_physics(root: Path):
    page = (root / "docs" / "results" / "physics.md").read_text(encoding="utf-8")
    readme = (root / "README.md").read_text(encoding="utf-8")
    (title,) = re.findall(r"^Physics (on MuJoCo .* checks ok)", page, flags=re.MULTILINE)
    assert f"The physics, {title}" in readme

    table = readme.partition("| check | reference | largest error |")[2].partition("\n\n")[0]
    shown = physics_rows(table)
    names = [name for name in shown if not name.startswith(("---", "cost of a step"))]
    assert len(names) == 5
    for name in names:
        assert physics_rows(page)[name][:3] == shown[name], name
    rise = physics_rows(page)["rise of a buoyant sphere, 1 s: every integrator and solver"][2]
    assert f"from the closed form by {rise.split()[0]} of itself" in " ".join(readme.split())
