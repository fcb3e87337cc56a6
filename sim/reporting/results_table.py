"""Table of results for the terminal."""

from rich.table import Table
from rich.text import Text

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement


def results_table(assessment: Assessment, title: str = "") -> Table:
    """Value, bound and verdict of every check, for `rich.print`."""
    table = Table(title=title or None, title_justify="left")
    table.add_column("figure")
    for name in ("value", "bound"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    table.add_column("", justify="center")
    for check in assessment.checks:
        table.add_row(check.name, *figures_of(check), check.unit, _verdict(check))
    return table


def figures_of(check: Requirement) -> tuple[str, str]:
    """Value and bound of `check` in its unit, as text; a dash for a missing one."""
    return _number(check.value, check.scale), _number(check.bound, check.scale)


def _number(value: float | None, scale: float) -> str:
    return "–" if value is None else f"{value * scale:.2f}"


def _verdict(check: Requirement) -> Text:
    if check.bound is None:
        return Text("")
    return Text("ok", style="green") if check.ok else Text("missed", style="bold red")
