"""Cells of a Jupyter notebook, run in order in one namespace, without Jupyter."""

import ast
import json
from pathlib import Path
from typing import Any

WRITE = "%%writefile "  # the one magic that the notebooks use


def cells(notebook: Path) -> list[dict[str, Any]]:
    """Cells of a notebook, as in its file."""
    return json.loads(notebook.read_text(encoding="utf-8"))["cells"]


def code_of(cell: dict[str, Any]) -> str:
    """Python of a cell, also where it is written to a file."""
    text = "".join(cell["source"])
    return text.partition("\n")[2] if text.startswith(WRITE) else text


def run_cell(cell: dict[str, Any], names: dict[str, Any]) -> Any:
    """Runs a cell of code; returns the value of its last line, where that is an expression."""
    text = "".join(cell["source"])
    if text.startswith(WRITE):
        Path(text.partition("\n")[0].removeprefix(WRITE)).write_text(code_of(cell))
        return None

    tree = ast.parse(text)
    last = tree.body[-1]
    if not isinstance(last, ast.Expr):
        exec(compile(tree, "cell", "exec"), names)
        return None

    tree.body.pop()
    exec(compile(tree, "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)
