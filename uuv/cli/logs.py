"""Prints the content of a vehicle's log: `uuv logs FILE`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from uuv.cli.json_output import print_json
from uuv.logs.picture_file import check_picture
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.command_line import parse

if TYPE_CHECKING:  # not needed for a help text
    from uuv.logs.vehicle_log import VehicleLog

_WIDTH = 132  # [characters] of the table if the output is no terminal


@dataclass(kw_only=True)
class LogsOptions:
    """Print rates, gaps, axes and units of a log, motor order and pulses, and missing data."""

    file: Annotated[
        Positional[Path],
        arg(metavar="FILE", help=".BIN of ArduPilot, .tlog of MAVLink, .mcap, or a ROS bag."),
    ]
    picture: Path | None = None
    """PNG file with motor commands and motion over time."""
    json: bool = False
    """Print the content as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the content of the log; returns the exit code."""
    del verb
    options = parse(LogsOptions, args)
    if options.picture is not None:
        check_picture(options.picture)

    from uuv.logs.readers import read_vehicle_log

    log = read_vehicle_log(options.file)
    if options.picture is not None:
        from uuv.logs.picture import write_picture

        write_picture(options.picture, log)
    if options.json:
        print_json(_content(log))
    else:
        _print(log)
    return 0


def _content(log: "VehicleLog") -> dict[str, Any]:
    """Content of the log, for JSON."""
    return {
        "name": log.name,
        "kind": log.kind,
        "duration_s": log.duration,
        "messages": log.messages,
        "streams": {
            quantity: {
                "samples": len(stream.time),
                "rate_hz": stream.rate,
                "gaps": stream.gaps[0],
                "longest_gap_s": stream.gaps[1],
                "columns": list(stream.labels),
                "unit": stream.unit,
                "source": stream.source,
            }
            for quantity, stream in log.streams.items()
        },
        "frame": log.frame or None,
        "directions": list(log.directions),
        "driven": log.driven,
        "missing": log.lacking(),
        "notes": list(log.notes),
    }


def _print(log: "VehicleLog") -> None:
    """Prints the content of the log as a table and lines."""
    from rich.table import Table
    from rich.text import Text

    from uuv.sim.runs.terminal import console

    out = console(_WIDTH)
    out.print(f"{shown(log.name)}: {log.kind}, {log.duration:.1f} s, {log.messages} messages")
    table = Table("stream", "samples", "Hz", "gaps", "unit", "from")
    for quantity, stream in log.streams.items():
        count, longest = stream.gaps
        gaps = f"{count}, longest {longest:.1f} s" if count else ""
        table.add_row(
            quantity,
            str(len(stream.time)),
            f"{stream.rate:.1f}",
            gaps,
            stream.unit,
            Text(stream.source),
        )
    out.print(table)

    if log.frame:
        directions = " ".join(f"{sign:+d}" for sign in log.directions) or "not known"
        out.print(f"motors: ArduSub's frame {log.frame}, directions {directions}")
    if log.driven is not None:
        out.print(f"a motor off neutral in {log.driven:.1%} of the samples")
    for line in log.lacking():
        out.print(Text(f"missing: {line}"))
    for line in log.notes:
        out.print(Text(f"note: {line}"))
