"""Runs of the jobs whose figures stand beside statements of the papers and beside measurements.

Each case is a command of a file in stated/, run in this process; its row has the figures that the
statements name, from metrics.json or from what the command prints. docs/papers.md and
docs/measured.md are made of the kept rows, by page.py and measured_page.py beside this file.
"""

from uuv.start import run_scenario  # isort: skip

import io
import re
import runpy
import shlex
import sys
import tempfile
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from experiments.papers.stated.statements import all_rows, leaves
from uuv.catalogue import CHECKOUT
from uuv.experiment import Page, column, experiment
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError

STATEMENTS = tuple(all_rows())
COMMANDS = tuple(dict.fromkeys(command for row in STATEMENTS for command in row.commands))
QUICK = "uuv identify object --object manifold"
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_LAST = 300  # characters of the errors of a command that failed


@dataclass(frozen=True, kw_only=True)
class StatedCase:
    """One command."""

    command: str
    """What stands after `./uvw run scripts/`."""


@dataclass(frozen=True, kw_only=True)
class StatedRow:
    """Figures that the statements name; those that the command did not give are lacking."""

    accepted: bool = column("accepted")
    figures: Mapping[str, float | None] = column("value", by="figure")


@experiment("papers", vary={"command": COMMANDS}, quick={"command": (QUICK,)})
def stated_runs(case: StatedCase) -> StatedRow:
    """Runs a command, and takes its figures."""
    with tempfile.TemporaryDirectory(prefix="uuv_papers_") as home:
        out = Path(home) / "out"
        code, output, errors = _run([*shlex.split(case.command), "--out", str(out)])
        # 1: done, and outside its bounds
        if code not in (0, 1):
            raise ConfigurationError(f"exit code {code}: {' '.join(errors.split())[-_LAST:]}")

        file = out / "metrics.json"
        metrics = dict(leaves(json_of(file, "metrics"))) if file.is_file() else {}

    figures = {}
    for statement in STATEMENTS:
        if case.command in statement.commands:
            figures |= statement.figures_of(case.command, metrics, output)
    return StatedRow(accepted=code == 0, figures=figures)


def _run(words: list[str]) -> tuple[int, str, str]:
    """Runs `uuv` or a file of scripts/ in this process, so that the row depends on its code.

    Returns:
        Exit code, output without colours, and errors.
    """
    before, output, errors = sys.argv, io.StringIO(), io.StringIO()
    sys.argv = words
    code: object = 0
    try:
        with redirect_stdout(output), redirect_stderr(errors):
            if words[0] == "uuv":
                runpy.run_module("uuv", run_name="__main__")
            else:
                runpy.run_path(str(CHECKOUT / "scripts" / words[0]), run_name="__main__")
    except SystemExit as stop:
        code = stop.code
    finally:
        sys.argv = before
    number = code if isinstance(code, int) else int(code is not None)
    return number, _COLOURS.sub("", output.getvalue()), errors.getvalue()


stated_runs.page = (
    Page()
    .table("Jobs beside the papers", by="command", columns=["accepted"])
    .table("Figures beside the papers", by=("command", "figure"), columns=["figures"])
)

if __name__ == "__main__":
    run_scenario(stated_runs.main)
