"""Runs that have ended: `uuv replay RUN`, `uuv report RUN`, `uuv view RUN`."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from uuv.cli.json_output import print_json
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.extras import LOG, absent, to_install
from uuv.sim.interfaces.files import regular
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.command_line import parse
from uuv.sim.runs.run_folder import LATEST, RUNS, pointed_to

if TYPE_CHECKING:
    from uuv.runner import Run as EndedRun
    from uuv.scenario import Scenario

Run = Annotated[
    Positional[str],
    arg(metavar="RUN", help="Folder of a run, or the name of a job for its latest run."),
]
Trust = Annotated[bool, arg(help="Also run the code MODULE:ATTRIBUTE that the scenario names.")]
_RRD = b"RRF"  # first bytes of a log


@dataclass(kw_only=True)
class ReplayOptions:
    """Repeat a run from its record, and compare the trajectories bit for bit.

    With --log a real vehicle's log is simulated instead, driven by its pulses, and laid beside.
    """

    run: Run = ""
    trust: Trust = False
    log: Path | None = None
    """Log of a vehicle in place of RUN, as for `uuv logs`, or CSV as for `uuv identify water`."""
    vehicle: str | None = None
    """With --log: the vehicle, a name of `uuv list vehicles` or a file; default: the usual one of
    the log's motor frame."""
    window: float = 10.0
    """With --log: time [s] after which the simulation begins anew at the measured state."""
    picture: Path | None = None
    """With --log: PNG of what was measured and simulated, over time."""
    json: bool = False
    """Print verdict, duration and both digests as JSON; with --log the table."""


@dataclass(kw_only=True)
class ReportOptions:
    """Print the path of report.html; if there is none, the run is repeated to write it alone."""

    run: Run
    trust: Trust = False


@dataclass(kw_only=True)
class ViewOptions:
    """Open the log of a run in the Rerun viewer; no code is run, whatever its scenario names."""

    run: Run


def main(verb: str, args: Sequence[str]) -> int:
    """Carries out the verb on the run; returns the exit code."""
    match verb:
        case "replay":
            options = parse(ReplayOptions, args)
            if options.log is not None:
                return _beside(options, options.log)
            _refuse_of_a_log(options)
            return replay(run_folder(options.run), trust=options.trust, as_json=options.json)
        case "report":
            options = parse(ReportOptions, args)
            return report(run_folder(options.run), trust=options.trust)
        case _:
            return view(run_folder(parse(ViewOptions, args).run))


def _beside(options: ReplayOptions, log: Path) -> int:
    """Compares a log with its simulation; returns the exit code."""
    if options.run:
        raise ConfigurationError(f"replay: RUN {options.run!r} and --log: give only one of the two")
    if options.trust:
        raise ConfigurationError("replay: --trust is of a RUN; a log names no code")
    from uuv.cli.past.real_log import replay_log

    return replay_log(log, options.vehicle, options.window, options.picture, as_json=options.json)


def _refuse_of_a_log(options: ReplayOptions) -> None:
    """Refuse options that only a log has."""
    usual = ReplayOptions()
    for name in ("vehicle", "window", "picture"):
        if getattr(options, name) != getattr(usual, name):
            raise ConfigurationError(f"replay: --{name} needs --log, and has no use for a RUN")


def run_folder(name: str) -> Path:
    """Folder of a run: the one given, or the latest run of a scenario.

    Raises:
        ConfigurationError: There is no such run.
    """
    if not name:
        raise ConfigurationError("RUN: missing (--help lists the options)")
    try:
        for folder in (Path(name), RUNS / name / LATEST, RUNS / name.replace("-", "_") / LATEST):
            # the present target of `latest`, since later runs change that link
            target = pointed_to(folder)
            if (target / "metrics.json").exists():
                return target

        names = (
            sorted(path.name for path in RUNS.iterdir() if path.is_dir()) if RUNS.is_dir() else []
        )
    except OSError as error:  # a name that is too long, or a folder that may not be looked into
        raise ConfigurationError(f"{name}: no run ({error.strerror})") from error

    known = f"; runs/ has {', '.join(names)}" if names else "; there is no folder runs/ here"
    raise ConfigurationError(f"{name}: must be a run, a folder with metrics.json{known}")


def scenario_of(folder: Path, *, trust: bool) -> "Scenario":
    """The scenario of a run; arguments and errors are those of `scenario_file.read_scenario`.

    The inputs of an operator are read from the run's folder.
    """
    from uuv.scenario import INPUTS_FILE
    from uuv.scenario_file import SCENARIO_FILE, read_scenario

    scenario = read_scenario(folder / SCENARIO_FILE, trust=trust)
    operator = scenario.control.operator
    if operator is None:
        return scenario
    operator = replace(operator, inputs=str(folder / INPUTS_FILE))
    return replace(scenario, control=replace(scenario.control, operator=operator))


def replay(folder: Path, *, trust: bool = False, as_json: bool = False) -> int:
    """Repeats a run; returns 0 if the trajectory is identical in every bit, otherwise 1.

    Args:
        folder: Folder of the run.
        trust: Also run the code that its scenario names.
        as_json: Print JSON.

    Raises:
        UuvError: The record cannot be read, or its scenario cannot be run.
    """
    ran, recorded = _repeated(folder, trust=trust)
    got = ran.recording.digest()
    same = got == recorded
    if as_json:
        digests = {"trajectory_sha256": got, "recorded_sha256": recorded}
        print_json({"same": same, "simulated_s": ran.recording.duration, **digests})
        return 0 if same else 1

    if same:
        print(f"the same to the bit: {ran.recording.duration:.1f} s, trajectory {got[:12]}")
        return 0

    print(f"{_different(ran, recorded)}.")
    return 1


def _repeated(folder: Path, *, trust: bool) -> "tuple[EndedRun, str | None]":
    """The repeated run of a folder, and the digest of the recorded trajectory."""
    from uuv.inputs import check_inputs
    from uuv.sim.reporting.series_tables import PastRun

    recorded = PastRun.of(folder).metrics["run"]["trajectory_sha256"]
    scenario = scenario_of(folder, trust=trust)
    check_inputs(scenario)
    from uuv.runner import run  # imported, and compiled, after all checks

    return run(scenario), recorded


def _different(ran: "EndedRun", recorded: str | None) -> str:
    """Text on a repeated run whose trajectory is not the recorded one."""
    return (
        f"different trajectory: {ran.recording.digest()[:12]}, recorded {str(recorded)[:12]}. The "
        "record was made by other code or libraries, on another machine, or by a run that was "
        "interrupted (see provenance in metrics.json)"
    )


def report(folder: Path, *, trust: bool = False) -> int:
    """Prints the report's path; a missing report is written, with `trust` also by a scenario's
    code.
    """
    file = folder / "report.html"
    if not file.exists():
        if absent(LOG):
            raise MissingLibraryError(f"report: needs {', '.join(absent(LOG))}: {to_install(LOG)}")
        ran, recorded = _repeated(folder, trust=trust)
        if ran.recording.digest() != recorded:
            raise ConfigurationError(
                f"report: {folder} has no report.html, and {_different(ran, recorded)}"
            )
        from uuv.command import report_in

        report_in(ran, folder)
    print(file.resolve())
    return 0


def view(folder: Path) -> int:
    """Opens the run's log in the Rerun viewer; returns the viewer's exit code."""
    log = folder / "run.rrd"
    if not log.exists():
        raise ConfigurationError(
            f"{folder} has no run.rrd: run it again without --no-record, with the extra {LOG}"
        )
    with regular(log, "log") as stream:
        if stream.read(len(_RRD)) != _RRD:
            raise ConfigurationError(f"log {shown(str(log))}: is no log of Rerun")

    beside = Path(sys.executable).with_name("rerun")
    program = str(beside) if beside.exists() else shutil.which("rerun")
    if program is None:
        raise MissingLibraryError(f"view: the Rerun viewer is missing: {to_install(LOG)}")
    return subprocess.run([program, str(log)], check=False).returncode
