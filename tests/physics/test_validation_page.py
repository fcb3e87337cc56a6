"""docs/results/physics.md shows the checks that there are: no line missing, none left over."""

import ast
import re
from pathlib import Path

HERE = Path(__file__).parent


def checks() -> list[tuple[str, str]]:
    """(name, reference) of every `@pytest.mark.check` in this folder, in the order of the files and
    lines.
    """
    named = []
    for file in sorted(HERE.glob("test_*.py")):
        calls = [
            node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)
        ]
        for call in sorted(calls, key=lambda call: call.lineno):
            if ast.unparse(call.func) == "pytest.mark.check":
                name, reference = (ast.literal_eval(argument) for argument in call.args)
                named.append((name, reference))
    return named


def test_page_shows_every_check(root):
    text = (root / "docs" / "results" / "physics.md").read_text(encoding="utf-8")
    (table,) = re.findall(
        r"^Physics on MuJoCo .*\n\n\|.*\n\|.*\n((?:\|.*\n)+)", text, flags=re.MULTILINE
    )
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    assert [tuple(row[:2]) for row in rows] == checks(), "run uuv validate --docs"
    assert {row[-1] for row in rows} == {"ok"}


def test_a_name_stands_for_one_line():
    names = [name for name, _ in checks()]
    assert len(names) == len(set(names)) > 30
