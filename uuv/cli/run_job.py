"""A job or a scenario file: `uuv run NAME [OPTIONS]`, `uuv run FILE.toml [OPTIONS]`."""

import contextlib
import io
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from uuv import jobs
from uuv.catalogue import JOBS
from uuv.cli.carry_out import run_job
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import JSON, QUIET, SET, TASK, Options, RunOptions, parse
from uuv.sim.runs.run_folder import claimed_folder

_MORE = f"""\
  {SET} KEY=VALUE ...  other values, by the keys of a scenario file and in its units, such as task.speed=0.03
                      or perturbations.MountedObject.stiffness=1e4
  {TASK} MODULE:CLASS  a task of one's own, with its defaults, in place of the job's (`uuv new task NAME`)
  {QUIET}              print the verdict and the folder alone
  {JSON}               print metrics.json alone"""
_HELP = f"""usage: uuv run NAME|FILE.toml [OPTIONS]

NAME: {", ".join(JOBS)}; `uuv run NAME --help` lists its options.
FILE.toml: a scenario, such as the scenario.toml in the folder of every run.

{_MORE}"""


@dataclass(kw_only=True)
class FileOptions(RunOptions):
    """Run a scenario from its file."""

    seed: int | None = None
    """Seed instead of that in the file."""
    trust: bool = False
    """Run the code, MODULE:ATTRIBUTE, that the file names too; what is typed here needs no leave."""


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the job; returns the exit code."""
    del verb
    started = time.perf_counter()
    if not args or args[0] in ("-h", "--help"):
        print(_HELP)
        return 0
    name, (rest, task, values) = args[0], _assignments([arg for arg in args[1:] if arg not in (QUIET, JSON)])
    if name in JOBS:
        chosen = _parsed(getattr(jobs, JOBS[name]), rest)
        scenario = chosen.scenario()
    elif name.endswith(".toml"):
        chosen = _parsed(FileOptions, rest)
        from uuv.scenario_file import read_scenario

        scenario = read_scenario(name, trust=chosen.trust)
        if chosen.seed is not None:
            scenario = replace(scenario, seed=chosen.seed)
    else:
        raise ConfigurationError(
            f"no job {name!r}; there are {', '.join(JOBS)}, or a scenario file (.toml){did_you_mean(name, JOBS)}"
        )
    if task or values:
        from uuv.scenario_file import with_values

        scenario = with_values(with_values(scenario, task, TASK), values)
    if QUIET not in args and JSON not in args:
        return run_job(scenario, chosen, started)
    with contextlib.redirect_stdout(io.StringIO()):
        code = run_job(scenario, chosen, started)
    folder = claimed_folder()
    from uuv.sim.reporting.series_tables import PastRun

    metrics = PastRun.of(folder).metrics
    if JSON in args:
        json.dump(metrics, sys.stdout, indent=2)
        print()
    else:
        verdict = "accepted" if metrics["accepted"] else "not accepted: " + "; ".join(metrics["failed"])
        print(f"{verdict}\n{folder}")
    return code


def _parsed(kind: type[Options], args: Sequence[str]) -> Options:
    """Options of the job; --help tells those of `uuv run` too."""
    try:
        return parse(kind, args)
    except SystemExit as stop:
        if not stop.code:
            print(f"\nand of every job:\n{_MORE}")
        raise


def _assignments(args: Sequence[str]) -> tuple[list[str], list[str], list[str]]:
    """Arguments without --task and --set, and the assignments that each of these means."""
    args = list(args)
    task: list[str] = []
    if TASK in args:
        at = args.index(TASK)
        if at + 1 == len(args) or args[at + 1].startswith("-"):
            raise ConfigurationError(f"{TASK}: MODULE:CLASS is missing")
        module = args[at + 1].partition(":")[0]
        task = [f'task.kind="{args[at + 1]}"', f'name="{module.rpartition(".")[2]}"']
        del args[at : at + 2]
    rest: list[str] = []
    values: list[str] = []
    into = rest
    for arg in args:
        if arg == SET:
            into = values
            continue
        if arg.startswith("--"):
            into = rest
        into.append(arg)
    return rest, task, values
