"""What is printed may come from a file: brackets are text, and no character commands the
terminal.
"""

from io import StringIO

import pytest
from rich.table import Table

from uuv.sim.runs.terminal import PlainConsole, verdict

HOSTILE = "[/red]k \x1b]0;owned\x07 :smile: [bold]x"


@pytest.mark.parametrize("where", ["line", "cell", "title", "column", "verdict"])
def test_a_text_is_shown_as_it_stands(where: str):
    output = StringIO()
    console = PlainConsole(file=output, width=100, force_terminal=True, color_system=None)
    table = Table(title=HOSTILE if where == "title" else None)
    table.add_column(HOSTILE if where == "column" else "c")
    table.add_row(HOSTILE if where == "cell" else "x")
    console.print({"line": HOSTILE, "verdict": verdict(HOSTILE)}.get(where, table), soft_wrap=True)
    shown = output.getvalue()
    assert "\x1b" not in shown
    assert "\x07" not in shown
    assert "[/red]k \ufffd]0;owned\ufffd :smile: [bold]x" in shown
