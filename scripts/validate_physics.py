"""Validation table of the physics: each check with its reference, its largest error and its
tolerance.

The checks are the tests in tests/physics that carry `@pytest.mark.check(name, reference)`. One row
sums up all tests of
one name: the error that comes nearest to its tolerance, over all seeds and cases. Writes table.md
and table.json.

The same as `uuv validate`.
"""

from uuv.start import new_folder, run_scenario  # isort: skip

import json
import re
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import mujoco
import pytest
from rich.console import Console
from rich.table import Table
from rich.text import Text

from uuv.cli import validate
from uuv.cli.validate import ValidateOptions
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.saving import write_whole

ROOT = Path(__file__).resolve().parents[1]
MARK = "check"


@dataclass
class Row:
    """One row of the table: a check over all its cases."""

    name: str
    reference: str  # closed form, conservation law or formulation that the check compares with
    cases: int = 0
    passed: int = 0
    skipped: str = ""  # reason of the last skipped case
    # quantity, largest error, tolerance
    figures: list[tuple[str, float, float]] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """True if every case ran and passed within its nominal tolerance.

        UUV_TOLERANCE_SCALE widens the tolerances of the tests; it is ignored here.
        """
        passed_all = all(error <= tolerance for _, error, tolerance in self.figures)
        return passed_all and self.cases > 0 and self.passed == self.cases

    @property
    def verdict(self) -> str:
        """Verdict in words: "ok", "missed", or "skipped" with the reason."""
        if self.ok:
            return "ok"
        return f"skipped: {self.skipped}" if self.skipped else "missed"

    @property
    def worst(self) -> tuple[str, float, float] | None:
        """The figure nearest to its tolerance; None for a check without figures, such as a
        specified error.
        """
        return max(
            self.figures,
            key=lambda figure: figure[1] / figure[2] if figure[2] else float(figure[1] > 0),
            default=None,
        )

    def columns(self) -> list[str]:
        """Cells of the row: name, reference, largest error, tolerance."""
        if self.worst is None:
            return [self.name, self.reference, f"{self.passed} of {self.cases} cases", "all"]

        what, error, tolerance = self.worst
        return [
            self.name,
            self.reference,
            f"{_short(error, 1)} ({what})",
            _short(tolerance, 1).replace(".0e", "e"),
        ]


class ValidationPage:
    """A pytest plug-in that collects the rows, in the order of the tests."""

    def __init__(self) -> None:
        self.rows: dict[str, Row] = {}
        self._row_of: dict[str, Row] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Hook of pytest: makes one row for each name among the markers."""
        for test in items:
            for mark in test.iter_markers(MARK):
                name, reference = mark.args
                self._row_of[test.nodeid] = self.rows.setdefault(name, Row(name, reference))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Hook of pytest: adds the outcome and the figures of one test to its row."""
        row = self._row_of[report.nodeid]
        if report.when == "call" or not report.passed:
            row.cases += 1
            row.passed += report.passed
            if report.skipped:
                row.skipped = str(
                    report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
                )

            # The fixture `within` leaves quantity, error and tolerance of each comparison.
            compared = [entry for key, entry in report.user_properties if key == "within"]
            row.figures += cast(list[tuple[str, float, float]], compared)


def _short(value: float, digits: int) -> str:
    return f"{value:.{digits}e}" if value else "0"


def put_into_docs(lines: list[str]) -> None:
    """Replaces the table of checks in docs/results/physics.md, and the title above it, by `lines`.

    Raises:
        ConfigurationError: The page does not hold exactly one such table.
    """
    page = ROOT / "docs" / "results" / "physics.md"
    old = re.compile(r"^Physics on MuJoCo .*\n\n(\|.*\n)+", flags=re.MULTILINE)
    text, count = old.subn(lambda _: "\n".join(lines), page.read_text(encoding="utf-8"))
    if count != 1:
        raise ConfigurationError(
            f"{page}: expected one line 'Physics on MuJoCo ...' with a table below, found {count}"
        )

    page.write_text(text, encoding="utf-8")


def main() -> int:
    """Does what the verb does; returns the exit code."""
    return validate.main("validate", sys.argv[1:])


def run(options: ValidateOptions) -> int:
    """Runs the checks, prints and writes the table; exit code 0 if all hold."""
    out = new_folder("validate", options.out).resolve()
    page = ValidationPage()
    begin = time.perf_counter()
    worked = time.process_time()

    # The checks are the tests of physics that are marked; the plug-in collects their figures.
    stopped = pytest.main(
        [
            str(ROOT / "tests" / "physics"),
            f"--rootdir={ROOT}",
            f"-c={ROOT / 'pyproject.toml'}",
            "-m",
            MARK,
            "-p",
            "no:cacheprovider",
            "--tb=short",
            "-W",  # tyro has loaded typeguard, which is also a pytest plug-in
            "ignore::pytest.PytestAssertRewriteWarning",
        ],
        plugins=[page],
    )

    seconds, worked = time.perf_counter() - begin, time.process_time() - worked
    rows = list(page.rows.values())
    good = sum(row.ok for row in rows)
    title = (
        f"Physics on MuJoCo {mujoco.__version__}: {good} of {len(rows)} checks ok, "
        f"{worked:.0f} s of processor time"
    )

    table = Table(title=title, title_justify="left")
    for column in ("check", "reference", "largest error", "tolerance", ""):
        table.add_column(column)
    for row in rows:
        table.add_row(
            *map(Text, row.columns()), Text(row.verdict, style="green" if row.ok else "bold red")
        )
    Console().print(table)

    lines = ["| check | reference | largest error | tolerance | |", "|---|---|---|---|---|"]
    lines += [f"| {' | '.join([*row.columns(), row.verdict])} |" for row in rows]
    lines = [title, "", *lines, ""]
    (out / "table.md").write_text("\n".join(lines))
    if options.docs:
        put_into_docs(lines)

    figures = [
        {
            "check": r.name,
            "reference": r.reference,
            "cases": r.cases,
            "passed": r.passed,
            "skipped": r.skipped,
        }
        | dict(zip(("quantity", "error", "tolerance"), r.worst or (None, None, None), strict=True))
        for r in rows
    ]
    run = {
        "mujoco": mujoco.__version__,
        "seconds": round(seconds, 1),
        "processor_seconds": round(worked, 1),
    }
    write_whole(out / validate.TABLE, json.dumps({**run, "checks": figures}, indent=1) + "\n")
    return 0 if stopped == pytest.ExitCode.OK and all(row.ok for row in rows) else 1


if __name__ == "__main__":
    run_scenario(main)
