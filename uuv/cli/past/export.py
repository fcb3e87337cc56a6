"""A run's data for other tools: `uuv export RUN --mcap FILE`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuv.cli.json_output import print_json
from uuv.cli.past.past_runs import Run, Trust, run_folder, scenario_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import parse


@dataclass(kw_only=True)
class ExportOptions:
    """Write a run's series, events and clouds in one or more formats of other tools."""

    run: Run
    mcap: Path | None = None
    """MCAP file with messages of ROS 2, for Foxglove, Rerun, PlotJuggler (docs/your_tools.md)."""
    bag: Path | None = None
    """New folder of a ROS 2 bag with the same messages."""
    csv: Path | None = None
    """Folder for a CSV file of each table."""
    mat: Path | None = None
    """MATLAB file with a struct for each table."""
    trust: Trust = False
    json: bool = False
    """Print files and numbers of messages as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Writes the files; returns the exit code."""
    del verb
    options = parse(ExportOptions, args)
    if not any((options.mcap, options.bag, options.csv, options.mat)):
        raise ConfigurationError("export: needs at least one of --mcap, --bag, --csv, --mat")

    folder = run_folder(options.run)
    for file in (options.mcap, options.mat):
        if file is not None and not file.parent.is_dir():
            raise ConfigurationError(f"export: there is no folder {str(file.parent)!r}")

    if options.bag is not None:
        from uuv.export.files import check_bag

        check_bag(options.bag)

    written = _exported(folder, options)
    if options.json:
        print_json(written)
        return 0
    for name, count in written.items():
        print(f"{name}: {count} messages" if count else name)
    return 0


def _exported(folder: Path, options: ExportOptions) -> dict[str, int]:
    """Files that were written, with the number of messages in each; 0 for tables."""
    from uuv.export import files
    from uuv.sim.reporting.series_tables import PastRun

    run = PastRun.of(folder)
    ros = options.mcap is not None or options.bag is not None
    description = _description(folder, trust=options.trust) if ros else ""

    written: dict[str, int] = {}
    if options.csv is not None:
        written |= {str(file): 0 for file in files.write_csv(options.csv, run)}
    if options.mat is not None:
        files.write_matlab(options.mat, run)
        written[str(options.mat)] = 0
    if not ros:
        return written

    from uuv.export.topics import RosTypes, RunTopics

    types = RosTypes()
    topics = RunTopics(run.recorded, run.clouds, description, types=types).topics
    about = {"accepted": str(run.metrics["accepted"]), "run": folder.name}
    if options.mcap is not None:
        written[str(options.mcap)] = files.write_mcap(options.mcap, topics, types, about)
    if options.bag is not None:
        written[str(options.bag)] = files.write_bag(options.bag, topics, types)
    return written


def _description(folder: Path, *, trust: bool) -> str:
    """URDF of the run's vehicle.

    Raises:
        ConfigurationError: Its scenario cannot be read, or names code that is not trusted.
    """
    from uuv.assembly import assemble
    from uuv.export.robot_description import robot_description
    from uuv.inputs import check_inputs

    scenario = scenario_of(folder, trust=trust)
    check_inputs(scenario)
    return robot_description(assemble(scenario).plant.model)
