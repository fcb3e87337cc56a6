"""The check of a vehicle on a terminal: parts, figures, findings, verdicts."""

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table
from rich.text import Text

from uuv.check.checked_jobs import ARM_JOBS
from uuv.check.findings import VehicleCheck

_COLOURS = {
    "note": "cyan",
    "doubt": "yellow",
    "fault": "red",
    "there": "green",
    "computed": "cyan",
    "missing": "yellow",
    "read": "green",
    "guessed": "yellow",
    "left out": "yellow",
}


def print_check(check: VehicleCheck, console: Console) -> None:
    """Print a check; for a vehicle without findings it fits on one screen."""
    console.print(Text(check.vehicle, style="bold"))
    if check.parts:
        console.print(_parts(check), soft_wrap=False)

    if check.figures:
        table = Table(box=None, show_header=False, pad_edge=False)
        table.add_column(style="dim", no_wrap=True)
        table.add_column()
        for job in check.figures:
            table.add_row(job.name, job.said)
        console.print(table)

    if check.file:
        table = Table(box=None, pad_edge=False, title="from its file", title_justify="left")
        for column in ("part", "quantity", "value", "", "origin"):
            table.add_column(column, overflow="fold")
        for entry in check.file:
            way = Text(entry.way, style=_COLOURS[entry.way])
            table.add_row(entry.part, entry.quantity, entry.value, way, entry.origin)
        console.print(table)

    # Findings, and the verdicts on the jobs.
    if check.findings:
        table = Table(
            box=None, show_header=False, pad_edge=False, title="findings", title_justify="left"
        )
        table.add_column(no_wrap=True)
        table.add_column()
        for job in check.findings:
            table.add_row(Text(job.code, style=_COLOURS[job.level]), job.said)
        console.print(table)

    if check.jobs:
        table = Table(
            box=None, show_header=False, pad_edge=False, title="jobs", title_justify="left"
        )
        table.add_column(no_wrap=True)
        table.add_column(no_wrap=True)
        table.add_column()

        for job in check.jobs:
            verdict = (
                Text("feasible", "green") if job.promised else Text(f"refused: {job.code}", "red")
            )
            table.add_row(job.job, verdict, job.said)
        console.print(table)
        _print_commands([verdict.job for verdict in check.jobs if verdict.promised], console)


def _print_commands(promised: Iterable[str], console: Console) -> None:
    """Print commands for the feasible jobs of the arm; the check itself simulates hovering."""
    runs = [ARM_JOBS[name] for name in promised if name in ARM_JOBS and ARM_JOBS[name].command]

    # Those with a tool of their own take none.
    for brings, but in ((False, ""), (True, " but --tool and --forces")):
        commands = sorted(run.command for run in runs if run.brings_tool is brings)
        if commands:
            line = f"to run with the same options{but}: uuv run {', '.join(commands)}"
            console.print(Text(line, style="dim"))


def _parts(check: VehicleCheck) -> Text:
    """All parts in a line or two; computed and missing parts are marked."""
    line = Text("parts: ")
    for i, part in enumerate(check.parts):
        line.append(", " if i else "")
        name = part.name.removeprefix("actuators ")
        line.append(name if part.state == "there" else f"{name} {part.state}", _COLOURS[part.state])
    return line
