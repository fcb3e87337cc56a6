"""Runs that have ended: `uuv replay RUN`, `uuv report RUN`, `uuv view RUN`. RUN is the folder of a run."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from sim.interfaces.errors import ConfigurationError, MissingLibraryError
from sim.interfaces.extras import LOG, absent, to_install
from sim.runs.run_folder import LATEST, RUNS

_ABOUT = {
    "replay": "Runs again from its record, and compares the trajectory to the bit.",
    "report": "Prints the path of report.html, and writes it by running again where there is none.",
    "view": "Opens the log in the Rerun viewer.",
}


def main(verb: str, args: Sequence[str]) -> int:
    """Does the verb with the run; returns the exit code."""
    if len(args) != 1 or args[0].startswith("-"):
        print(f"usage: uuv {verb} RUN\n\n{_ABOUT[verb]} RUN: folder of a run, or the name of a job for its latest.")
        return 0 if args and args[0] in ("-h", "--help") else 2
    folder = run_folder(args[0])
    return {"replay": replay, "report": report, "view": view}[verb](folder)


def run_folder(given: str) -> Path:
    """Folder of a run: as given, or the latest of a scenario's.

    Raises:
        ConfigurationError: There is none.
    """
    for folder in (Path(given), RUNS / given / LATEST, RUNS / given.replace("-", "_") / LATEST):
        if (folder / "metrics.json").exists():
            return folder.parent / folder.readlink() if folder.is_symlink() else folder  # `latest` moves on
    there = sorted(path.name for path in RUNS.iterdir() if path.is_dir()) if RUNS.is_dir() else []
    known = f"; runs/ has {', '.join(there)}" if there else "; there is no folder runs/ here"
    raise ConfigurationError(f"{given}: no run, a folder with metrics.json{known}")


def replay(folder: Path) -> int:
    """Runs again; 0 if the trajectory is the same to the bit, else 1."""
    from scenarios.inputs import check_inputs
    from scenarios.scenario_file import SCENARIO_FILE, read_scenario
    from sim.reporting.series_tables import PastRun

    wanted = PastRun.of(folder).metrics["run"]["trajectory_sha256"]
    scenario = read_scenario(folder / SCENARIO_FILE)
    check_inputs(scenario)
    from scenarios.runner import run  # what runs it is imported, and compiled, after what can be refused

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


def report(folder: Path) -> int:
    """Prints the path of the report, made anew where it is missing."""
    file = folder / "report.html"
    if not file.exists():
        if absent(LOG):
            raise MissingLibraryError(f"report: needs {', '.join(absent(LOG))}: {to_install(LOG)}")
        from scenarios.inputs import check_inputs
        from scenarios.scenario_file import SCENARIO_FILE, read_scenario

        scenario = read_scenario(folder / SCENARIO_FILE)
        check_inputs(scenario)
        from scenarios.command import show
        from scenarios.runner import run

        show(run(scenario), folder)
    print(file.resolve())
    return 0


def view(folder: Path) -> int:
    """Opens the Rerun viewer on the run's log; its exit code."""
    log = folder / "run.rrd"
    if not log.exists():
        raise ConfigurationError(f"{folder} has no run.rrd: run it again without --no-record, with the extra {LOG}")
    beside = Path(sys.executable).with_name("rerun")
    program = str(beside) if beside.exists() else shutil.which("rerun")
    if program is None:
        raise MissingLibraryError(f"view: the Rerun viewer is missing: {to_install(LOG)}")
    return subprocess.run([program, str(log)], check=False).returncode
