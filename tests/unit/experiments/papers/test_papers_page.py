"""Statements of the papers: their figures, and what is refused when a row is not there."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.papers import page
from experiments.papers.page import PaperFigures, conditions, page_of
from experiments.papers.stated.statements import (
    Paper,
    PaperStatement,
    Statements,
    all_rows,
    leaves,
    read,
)
from experiments.papers.stated_runs import COMMANDS, QUICK, stated_runs
from uuv.clouds.identification import found_in
from uuv.clouds.options import IdentificationOptions
from uuv.models.objects import targets
from uuv.results.kept_rows import Check, KeptRows
from uuv.results.pages import ResultsOfOne, without_status
from uuv.sim.interfaces.errors import ConfigurationError

STATED = PaperStatement(
    place="fig. 5",
    stated="2 cm/s",
    command="clean_barrel.py --no-record",
    ours="{tool.speed*100:.2f} cm/s over {way_m} m, {tool.turns} turns, {tool.lost}",
    printed=r"path of (?P<way_m>[\d.]+) m",
)
METRICS = {"tool": {"speed": 0.0203, "turns": 3, "lost": None}, "other": [1.0]}
TEXT = "2.03 cm/s over 0.6 m, 3 turns, none"
STATEMENTS = Statements(
    intro="About.", paper=(Paper(source="Konoplin 2022", title="T", text="t", row=(STATED,)),)
)


def kept(*, deviations: tuple[str, ...] = (), lost: str = "") -> PaperFigures:
    """Figures of kept rows of the command of STATED."""
    figures = STATED.figures_of(STATED.command, dict(leaves(METRICS)), "a path of 0.60 m")
    figures.pop(lost, None)
    rows = KeptRows(
        experiment="papers",
        command="./uvw run ...",
        commit="c",
        date="d",
        check=Check(date="d", commit="c", deviations=deviations),
        columns={"command": [STATED.command], "accepted": [True], "figures": [figures]},
    )
    return PaperFigures.of([ResultsOfOne(experiment=stated_runs, kept=rows)])


def texts(figures: dict[str, Any]) -> tuple[str, str, str]:
    """Texts of STATED with the figures of its command."""
    return STATED.texts({STATED.command: figures})


def test_figures_are_of_the_metrics_and_of_what_is_printed():
    figures = STATED.figures_of(STATED.command, dict(leaves(METRICS)), "a path of 0.60 m")
    assert len(figures) == 4
    assert texts(figures) == ("", TEXT, "")
    other = STATED.figures_of(STATED.command, dict(leaves(METRICS)), "a path of 1 m")
    assert texts(other) != ("", TEXT, "")
    with pytest.raises(KeyError):
        texts(STATED.figures_of(STATED.command, {}, "a path of 0.60 m"))


def test_a_command_that_prints_something_else_is_refused():
    with pytest.raises(ConfigurationError, match=r"fig\. 5: 'clean_barrel\.py"):
        STATED.figures_of(STATED.command, dict(leaves(METRICS)), "a way of 0.60 m")


def test_the_patterns_of_the_project_match_what_an_identification_prints():
    options = IdentificationOptions(object="manifold")
    _, notes = found_in(options, targets.of(options.object))
    output = "\n".join(notes)
    stated = [row for row in read().rows if row.printed]
    assert len(stated) == 2
    for row in stated:
        figures = row.figures_of(row.command, {}, output)
        assert set(figures) == set(row.names(row.command)) == {"position_mm", "range_m"}
        assert f"error {figures['position_mm']:.2f} mm" in output
        assert f"at {figures['range_m']:.2f} m" in output


def test_only_the_default_command_prints_and_a_group_may_be_absent():
    row = replace(
        STATED,
        published="{tool.speed*100:.1f} cm/s",
        published_command="other.py --fast",
        printed=r"path of (?P<way_m>[\d.]+) m(?: in (?P<turns>\d+))?",
        ours="{way_m} m, {turns}",
    )
    assert row.figures_of("other.py --fast", {"tool.speed": 0.04}, "") == {"tool.speed": 0.04}
    assert row.figures_of(row.command, {}, "a path of 0.60 m") == {"way_m": 0.6}
    assert row.figures_of(row.command, {}, "a path of 0.60 m in 2") == {"way_m": 0.6, "turns": 2.0}


def test_a_figure_may_name_another_source():
    row = replace(STATED, remark="{share@hover*100:.0f} % of {case.seed.count@hover}", printed="")
    assert row.sources == [STATED.command, "hover"]
    assert row.names("hover") == ["share", "case.seed.count"]
    figures = dict(leaves(METRICS)) | {"way_m": 0.6, "tool.turns": 3}
    hover = {"share": 0.5, "case.seed.count": 4}
    assert row.texts({row.command: figures, "hover": hover})[2] == "50 % of 4"
    with pytest.raises(ConfigurationError, match=r"fig\. 5: \{alone\} needs a source"):
        PaperStatement(place="fig. 5", stated="a", ours="{alone}")


def test_conditions_of_rows_are_figures():
    rows = [{"seed": seed, "speed": 0.1, "arm": arm} for seed, arm in ((0, "era"), (2, "ur5"))]
    assert conditions(("seed", "speed", "arm"), rows) == {
        "case.seed": "0 to 2",
        "case.seed.count": 2,
        "case.speed": 0.1,
        "case.speed.count": 1,
        "case.arm": "era, ur5",
        "case.arm.count": 2,
    }


def test_a_statement_has_a_command_or_an_experiment():
    with pytest.raises(ConfigurationError, match=r"fig\. 5: has a command or an experiment"):
        replace(STATED, experiment="views")
    with pytest.raises(ConfigurationError, match="printed: needs a command"):
        replace(STATED, command="")
    with pytest.raises(ConfigurationError, match="printed: has no named group"):
        replace(STATED, printed="path of (.*) m")


def test_the_page_has_the_figures_and_the_status_of_their_rows():
    lines = list(page_of(STATEMENTS, kept()))
    assert f"| fig. 5 | 2 cm/s |  | {TEXT} | `{STATED.command}` |  |" in lines
    assert "Status: `papers`: verified d, commit c" in lines


@pytest.mark.parametrize(
    ("figures", "reason"),
    [
        (PaperFigures.of([]), "papers: no such experiment"),
        (PaperFigures.of([ResultsOfOne(experiment=stated_runs, kept=None)]), "*no rows kept*"),
        (kept(deviations=("speed 0.3, kept was 0.2",)), "*changed*"),
        (kept(lost="tool.turns"), f"{STATED.command}: its rows have no tool.turns"),
    ],
)
def test_a_statement_without_a_figure_is_refused_by_name(
    figures: PaperFigures, reason: str, monkeypatch, capsys
):
    monkeypatch.setattr(page, "read", lambda: STATEMENTS)
    monkeypatch.setattr(PaperFigures, "kept", lambda _: figures)
    monkeypatch.setattr(page, "write_page", lambda *_: pytest.fail("a page was written"))
    monkeypatch.setattr("sys.argv", ["page.py"])
    monkeypatch.setenv("COLUMNS", "300")
    assert page.main() == 1
    output = capsys.readouterr().out
    assert "fig. 5: " in output
    assert reason in output


def test_the_page_of_the_project_is_that_of_the_kept_rows(root: Path):
    statements = read()
    text = "\n".join(page_of(statements, PaperFigures.kept(statements)))
    kept_page = (root / "docs" / page.PAGE).read_text(encoding="utf-8")
    assert without_status(kept_page) == without_status(text)


def test_the_statements_of_the_project_can_be_read():
    assert QUICK in COMMANDS
    for row in all_rows():
        assert [source for source in row.sources if not row.names(source)] == [], row.place


def test_solvers_are_named_not_counted():
    """A figure is found by a name, so that another order of the solvers changes nothing."""
    counted = [
        figure.name for row in all_rows() for figure in row.figures if figure.name[-2:-1] == "."
    ]
    assert [name for name in counted if name[-1].isdigit()] == []


def test_a_statement_has_figures_of_the_published_method_beside_those_of_the_default_one():
    both = replace(
        STATED,
        published="{tool.speed*100:.1f} cm/s",
        published_command="other.py",
        ours="{tool.speed*100:.2f} cm/s, {range: of all.value:.1f} m",
        printed="",
    )
    figures = {
        both.command: {"tool.speed": 0.0203, "range: of all.value": 2.0},
        "other.py": {"tool.speed": 0.041},
    }
    assert both.texts(figures) == ("4.1 cm/s", "2.03 cm/s, 2.0 m", "")
    assert both.names("other.py") == ["tool.speed"]
    with pytest.raises(ConfigurationError, match="published_command: needs published"):
        replace(STATED, published_command="other.py")
