"""`uuv check VEHICLE`: parts of the contract, doubts, and the jobs that the vehicle can begin."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uuv.check.checked_jobs import JOBS, JOBS_ON_OBJECT, check_jobs, check_options
from uuv.check.conditions import POSES
from uuv.cli.json_output import print_json
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import parse

WIDTH = 132  # [characters] of the tables if the output is no terminal


@dataclass(kw_only=True)
class CheckOptions:
    """Check a vehicle: parts of the contract, doubtful figures, and the jobs that it can begin.

    Exit code 0: all jobs are feasible; 1: some are refused.
    """

    vehicle: Annotated[
        Positional[str],
        arg(
            metavar="VEHICLE",
            help="A name of `uuv list vehicles`, a file, or MODULE:FUNCTION, which returns an "
            "MjSpec that need not be compiled.",
        ),
    ]
    parts: Path | None = None
    """File that maps the model's names to those of the contract; default: NAME.parts.yaml in the
    folder of the vehicle's file."""
    tool: str | None = None
    """Tool on the tip: a name of `uuv list tools`."""
    poses: Annotated[int, arg(metavar="N")] = POSES
    """Poses of the object that are drawn for each job of the arm: it is feasible if 95 % of them
    pass."""
    seed: int = 0
    """Seed of the first pose; those of the others follow it."""
    forces: tuple[float, ...] = ()
    """Set forces [N] in place of the jobs' own."""
    speed: float | None = None
    """Speed of the tool [m/s] along its path, in place of the jobs' own."""
    current: tuple[float, float, float] | None = None
    """Steady current [m/s], world axes, in place of the jobs' own."""
    flow: str | None = None
    """Flow field at the jobs' site: a kind, or MODULE:CLASS (docs/own_current.md)."""
    object: str | None = None
    """Object of the job `object`, a name or file as for `uuv run clean-object`; unless --jobs
    names others, that job takes the place of those of the arm."""
    battery: float | None = None
    """Battery of this voltage [V] for thrusters with tables of their current; default: their
    voltage is constant."""
    jobs: tuple[str, ...] = ()
    """Jobs for which a verdict is wanted; default: all but `object`, and those that hold an object
    or a handle."""
    json: bool = False
    """Print the check as JSON."""

    @property
    def chosen(self) -> tuple[str, ...]:
        """Jobs that are checked."""
        return self.jobs or (JOBS if self.object is None else JOBS_ON_OBJECT)


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the check; exit code 1 if a job is refused."""
    del verb
    options = parse(CheckOptions, args)
    check_jobs(options.chosen)
    if options.poses < 1:
        raise ConfigurationError(f"--poses: must be at least 1, got {options.poses}")
    from uuv import inputs
    from uuv.check.conditions import Conditions
    from uuv.models.water.battery import Battery
    from uuv.scenario import VehicleSetup
    from uuv.site import flow_of

    parts = None if options.parts is None else str(options.parts)
    conditions = Conditions(
        poses=options.poses,
        seed=options.seed,
        forces=options.forces,
        speed=options.speed,
        current=options.current,
        flow=None if options.flow is None else flow_of(options.flow),
        object=options.object,
        battery=None if options.battery is None else Battery(voltage=options.battery),
    )
    inputs.check_vehicle(
        VehicleSetup(
            vehicle=options.vehicle, tool=options.tool, parts=parts, battery=conditions.battery
        )
    )
    check_options(options.chosen, conditions)
    from uuv import first_start
    from uuv.check.check import check_vehicle
    from uuv.check.progress import pose_progress
    from uuv.check.table import print_check
    from uuv.sim.runs.terminal import console

    first_start.build()
    with pose_progress() as watch:
        verdicts = check_vehicle(
            options.vehicle,  # its name or file
            parts_file=options.parts,
            tool=options.tool,
            jobs=options.chosen,
            conditions=conditions,
            watch=watch,
        )

    if options.json:
        print_json(verdicts.as_dict())
    else:
        print_check(verdicts, console(WIDTH))
    return 0 if verdicts.sound else 1
