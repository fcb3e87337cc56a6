"""Runs that have ended: `uuv replay RUN`, `uuv report RUN`, `uuv view RUN`. RUN is the folder of a run."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from uuv.kinds import TRUST
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.extras import LOG, absent, to_install
from uuv.sim.interfaces.files import regular
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.run_folder import LATEST, RUNS

if TYPE_CHECKING:
    from uuv.scenario import Scenario

TRUST_HELP = f"{TRUST}: run the code, MODULE:ATTRIBUTE, that its scenario names too."
_RRD = b"RRF"  # begins a log
_ABOUT = {
    "replay": "Runs again from its record, and compares the trajectory to the bit.",
    "report": "Prints the path of report.html, and writes it by running again where there is none.",
    "view": "Opens the log in the Rerun viewer.",
}


def main(verb: str, args: Sequence[str]) -> int:
    """Does the verb with the run; returns the exit code."""
    names, trust = [arg for arg in args if arg != TRUST], TRUST in args
    if len(names) != 1 or names[0].startswith("-"):
        told = f"{_ABOUT[verb]} RUN: folder of a run, or the name of a job for its latest."
        print(f"usage: uuv {verb} RUN [{TRUST}]\n\n{told}\n{TRUST_HELP}")
        return 0 if {"-h", "--help"} & {*names} else 2
    folder = run_folder(names[0])
    return {"replay": replay, "report": report, "view": view}[verb](folder, trust=trust)


def run_folder(given: str) -> Path:
    """Folder of a run: as given, or the latest of a scenario's.

    Raises:
        ConfigurationError: There is none.
    """
    try:
        for folder in (Path(given), RUNS / given / LATEST, RUNS / given.replace("-", "_") / LATEST):
            if (folder / "metrics.json").exists():
                return folder.parent / folder.readlink() if folder.is_symlink() else folder  # `latest` moves on
        there = sorted(path.name for path in RUNS.iterdir() if path.is_dir()) if RUNS.is_dir() else []
    except OSError as error:  # a name that is too long, or a folder that may not be looked into
        raise ConfigurationError(f"{given}: no run ({error.strerror})") from error
    known = f"; runs/ has {', '.join(there)}" if there else "; there is no folder runs/ here"
    raise ConfigurationError(f"{given}: no run, a folder with metrics.json{known}")


def scenario_of(folder: Path, *, trust: bool) -> "Scenario":
    """The scenario of a run; with the arguments and errors of `scenario_file.read_scenario`."""
    from uuv.scenario_file import SCENARIO_FILE, read_scenario

    return read_scenario(folder / SCENARIO_FILE, trust=trust)


def replay(folder: Path, *, trust: bool = False) -> int:
    """Runs again; 0 if the trajectory is the same to the bit, else 1. `trust`: also code that the scenario names."""
    from uuv.inputs import check_inputs
    from uuv.sim.reporting.series_tables import PastRun

    wanted = PastRun.of(folder).metrics["run"]["trajectory_sha256"]
    scenario = scenario_of(folder, trust=trust)
    check_inputs(scenario)
    from uuv.runner import run  # what runs it is imported, and compiled, after what can be refused

    ran = run(scenario)
    got = ran.recording.digest()
    if got == wanted:
        print(f"the same to the bit: {ran.recording.duration:.1f} s, trajectory {got[:12]}")
        return 0
    print(
        f"another trajectory: {got[:12]}, recorded {str(wanted)[:12]}. The record is of other code or libraries, of "
        "another machine, or of a run that was interrupted (see provenance in metrics.json)."
    )
    return 1


def report(folder: Path, *, trust: bool = False) -> int:
    """Prints the path of the report, made anew where it is missing; `trust`: also by code that the scenario names."""
    file = folder / "report.html"
    if not file.exists():
        if absent(LOG):
            raise MissingLibraryError(f"report: needs {', '.join(absent(LOG))}: {to_install(LOG)}")
        from uuv.inputs import check_inputs

        scenario = scenario_of(folder, trust=trust)
        check_inputs(scenario)
        from uuv.command import show
        from uuv.runner import run

        show(run(scenario), folder)
    print(file.resolve())
    return 0


def view(folder: Path, *, trust: bool = False) -> int:
    """Opens the Rerun viewer on the run's log; its exit code. No code is run, whether or not one may `trust` it."""
    del trust
    log = folder / "run.rrd"
    if not log.exists():
        raise ConfigurationError(f"{folder} has no run.rrd: run it again without --no-record, with the extra {LOG}")
    with regular(log, "log") as stream:
        if stream.read(len(_RRD)) != _RRD:
            raise ConfigurationError(f"log {shown(str(log))}: is no log of Rerun")
    beside = Path(sys.executable).with_name("rerun")
    program = str(beside) if beside.exists() else shutil.which("rerun")
    if program is None:
        raise MissingLibraryError(f"view: the Rerun viewer is missing: {to_install(LOG)}")
    return subprocess.run([program, str(log)], check=False).returncode
