"""What a vehicle has of the contract, what is doubtful, and which jobs it can begin: `uuv check VEHICLE`."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuv.check.checked_jobs import JOBS, check_jobs
from uuv.sim.runs.command_line import parse

WIDTH = 132  # characters of the tables where the output is no terminal
_USAGE = f"""usage: uuv check VEHICLE [OPTIONS]

What a vehicle has of the contract, what was computed or looks wrong, and which jobs it can begin. Exit code 0: all of
them; 1: some are refused. VEHICLE: a name of `uuv list vehicle`, a file, MJCF or URDF, or MODULE:FUNCTION that returns
an MjSpec.

  --parts FILE    maps the model's names to those of the contract; default NAME.parts.yaml beside the file
  --tool NAME     a tool of `uuv list tools` on the tip
  --forces F ...  set forces [N] in place of the jobs' own
  --jobs JOB ...  of {", ".join(JOBS)}
  --json          print the check as JSON"""


@dataclass(kw_only=True)
class CheckOptions:
    """Check a vehicle."""

    parts: Path | None = None
    """File that maps the model's names to those of the contract."""
    tool: str | None = None
    """Tool on the tip."""
    forces: tuple[float, ...] = ()
    """Set forces [N] in place of the jobs' own."""
    jobs: tuple[str, ...] = JOBS
    """Jobs for which a verdict is wanted."""
    json: bool = False
    """Print the check as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the check; 1 if a job is refused."""
    del verb
    if not args or args[0].startswith("-"):
        print(_USAGE)
        return 0 if args and args[0] in ("-h", "--help") else 2
    options = parse(CheckOptions, args[1:])
    check_jobs(options.jobs)
    from uuv import inputs
    from uuv.scenario import VehicleSetup

    parts = None if options.parts is None else str(options.parts)
    inputs.check_vehicle(VehicleSetup(vehicle=args[0], tool=options.tool, parts=parts))
    from uuv import first_start
    from uuv.check.check import check_vehicle
    from uuv.check.table import print_check
    from uuv.sim.runs.terminal import console

    first_start.build()
    found = check_vehicle(
        args[0], parts_file=options.parts, tool=options.tool, jobs=options.jobs, forces=options.forces
    )
    if options.json:
        json.dump(found.as_dict(), sys.stdout, indent=2)
        print()
    else:
        print_check(found, console(WIDTH))
    return 0 if found.sound else 1
