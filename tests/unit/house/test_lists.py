"""A list is written once, and what describes a run knows no word of a command line."""

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import ratchets
from second_tables import lists, product_tables, second_tables, tables_in
from source_tree import ROOT, name_of, nodes, sources

VALUES = [
    path
    for path in sources()
    if re.fullmatch(
        r"uuv/(scenario|site|methods|own_vehicle|inputs|outcome)\.py|uuv/(tasks|perturbations|sensors|components)/.*",
        name_of(path),
    )
]
OPTION = re.compile(r"--[a-z]")


def texts_with_options(parts: Iterable[ast.AST]) -> Iterator[str]:
    """Texts that begin with an option of a command line, those that are put together
    included.
    """
    for node in parts:
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and OPTION.match(node.value)
        ):
            yield node.value


def test_no_list_is_written_twice():
    excess = ratchets.worse(ratchets.table_counts(), ratchets.limits())
    assert not excess, ratchets.complaint(excess)


def test_the_lists_themselves_are_found():
    # All but names that are added beside the list, as a variant of an arm is.
    whole = {
        table.kind
        for table in product_tables()
        if len(table.names) >= 0.9 * len(lists()[table.kind])
    }
    assert whole == set(lists()) - {"job"}  # which is no table: functions under `@job`


@pytest.mark.parametrize(
    "text",
    [
        "HOLD = {'Gears': 1, 'Water': 2, 'Pad': 3}",
        "def f(kind):\n    match kind:\n        case 'Gears' | 'Water': return 1\n        case "
        "'Pad': return 2",
        "Kind = Literal['Gears', 'Water', 'Pad', 'other']",
        "ENTRIES = (Entry('Gears', 1), Entry('Water', 2), Entry('Pad', 3))",
        "MAKERS = [Gears, Water, Pad]",
    ],
)
def test_a_second_table_is_found(text: str, tmp_path: Path):
    file = tmp_path / "table.py"
    file.write_text(text)
    (table,) = tables_in(file, lists())
    assert (table.kind, table.names) == ("perturbation", {"Gears", "Water", "Pad"})


@pytest.mark.parametrize(
    "text",
    ["A = ('Gears', 'Water')", "__all__ = ['Gears', 'Water', 'Pad']", "F(Gears, Water, Pad)"],
)
def test_other_names_together_are_no_table(text: str, tmp_path: Path):
    file = tmp_path / "table.py"
    file.write_text(text)
    assert list(tables_in(file, lists())) == []


def test_a_new_second_table_is_refused(monkeypatch: pytest.MonkeyPatch):
    one_more = (
        *second_tables(),
        *tables_in(ROOT / "uuv" / "perturbations" / "perturbation.py", lists()),
    )
    monkeypatch.setattr(ratchets, "second_tables", lambda: one_more)
    excess = ratchets.worse(ratchets.table_counts(), ratchets.limits())
    assert excess == [("uuv/perturbations/perturbation.py", "tables", 1, 0)]
    assert "uuv/perturbations/perturbation.py:" in ratchets.complaint(excess)


def test_what_describes_a_run_names_keys_and_not_options():
    assert len(VALUES) > 20
    assert {
        name_of(path): texts for path in VALUES if (texts := [*texts_with_options(nodes(path))])
    } == {}


def test_an_option_in_a_message_is_found():
    text = (
        "def f(x):\n    finite(x, '--range [m]')\n    plot(x, '--')\n    raise "
        "ValueError(f'--speed {x}: no')"
    )
    assert [*texts_with_options(ast.walk(ast.parse(text)))] == ["--range [m]", "--speed "]
