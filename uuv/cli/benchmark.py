"""`uuv benchmark`: scores a controller by the truth; its own process gets estimates only.

    uuv benchmark                        # the default controller, 100 public cases
    uuv benchmark --entry mymodule:MyController --cases 10
    echo 4711 | uuv benchmark --fresh    # fresh cases, with a seed from a pipe

The result file is metrics.json in the folder of results. docs/benchmark.md says what is scored and
how to enter a controller.
"""

import secrets
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from uuv.cli.carry_out import METRICS
from uuv.cli.json_output import file_alone
from uuv.experiment.options import StudyOptions, at_least
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown, whole_number
from uuv.sim.runs.command_line import RunOptions
from uuv.start import parse

if TYPE_CHECKING:  # not needed for a help text
    from uuv.assembly import Assembly
    from uuv.benchmark.score import ScoredCase
    from uuv.scenario import Scenario

_LONGEST = 100  # [characters] that are read from standard input


@dataclass(kw_only=True)
class BenchmarkOptions(StudyOptions):
    """Score of a controller on the benchmark "UUV contact"."""

    entry: str = "default"
    """default, normal-force-law, "without METHOD", "joint PD", a registered controller, or
    MODULE:CLASS."""
    estimator: str = ""
    """MODULE:CLASS of the entry's own estimator; empty: the project's navigation, as for all other
    entries."""
    cases: int | None = None
    """Number of cases, from the first on; default: all public ones."""
    only: int | None = None
    """Run only the case of this number, with all its logs, in a folder of its own; its row is not
    changed."""
    fresh: bool = False
    """Use fresh cases. Their seed comes through a pipe to standard input, since an entry can read a
    command line but not its parent's pipe. Without a pipe the seed is drawn, and printed at the
    end."""
    json: bool = False
    """Print metrics.json alone."""
    in_process: bool = False
    """Run the controller in the simulation's process. This is faster, but not valid as an entry,
    since the controller could read the truth."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, cases=1, only=0)


def main(verb: str, args: Sequence[str]) -> int:
    """Runs or resumes the benchmark, or runs a single case; returns the exit code."""
    del verb
    started = time.perf_counter()
    options = parse(BenchmarkOptions, args)
    work = partial(benchmark, options, started)
    return file_alone(work, METRICS) if options.json else work()


def benchmark(options: BenchmarkOptions, started: float) -> int:
    """Runs or resumes the benchmark, or runs a single case; returns the exit code.

    Args:
        options: Options of the command line.
        started: [s] time.perf_counter() at the start of the command.

    Raises:
        UuvError: There is no such entry, or the folder cannot be used.
    """
    seed_given = seed_of_cases() if options.fresh else None
    from uuv.benchmark.cases import CASES, PUBLIC_SEED, VERSION, BenchmarkCase, cases, digest
    from uuv.benchmark.door import close_memory
    from uuv.benchmark.entries import Entry
    from uuv.benchmark.score import ScoredCase, line, score, summary
    from uuv.experiment import Study
    from uuv.experiment.harness import key_of
    from uuv.experiment.loaded_code import digests, loaded_files

    close_memory()
    entry = Entry.of(options.entry, options.estimator)
    seed = PUBLIC_SEED if seed_given is None else seed_given
    name = "benchmark-" + "".join(c if c.isalnum() else "-" for c in entry.name)
    if options.only is not None:
        case = BenchmarkCase(seed=seed, index=options.only)
        scored = ScoredCase(case=case, entry=entry, in_process=options.in_process)
        return with_report(scored, name, options, started)

    chosen = cases(CASES if options.cases is None else options.cases, seed=seed)
    about = {
        "version": VERSION,
        "seed": seed,
        "public": seed == PUBLIC_SEED,
        "cases": len(chosen),
        "cases_digest": digest(chosen),
        "code": key_of(digests(loaded_files())),
        "entry": entry.name,
        "source": entry.source,
        "in_process": options.in_process,
    }

    study = Study(
        cases=[
            ScoredCase(case=case, entry=entry, in_process=options.in_process) for case in chosen
        ],
        run_one=score,
        summarise=lambda rows: summary(rows, about),
        line=line,
        code=entry.code(),
        of={
            "--entry": options.entry,
            "--estimator": options.estimator,
            "--in-process": options.in_process,
            # an entry could read study.json, so it does not contain the seed itself
            "cases of digest": key_of([VERSION, seed]),
        },
    )
    return study.carry_out(name, options, f"UUV contact, version {VERSION}: {entry.name}")


def seed_of_cases() -> int:
    """Seed from standard input; a new one of 63 bits if there is none, or if it is a terminal.

    Raises:
        ConfigurationError: Standard input is not one whole number.
    """
    stream = sys.stdin  # None if the process was started without standard input
    text = "" if stream is None or stream.isatty() else stream.read(_LONGEST).strip()
    if not text:
        return secrets.randbits(63)
    if not (text.isascii() and text.isdigit()):
        raise ConfigurationError(
            f"--fresh: standard input must be one whole number, got {shown(text)}"
        )
    return whole_number(int(text), "--fresh", most=2**63 - 1)


def with_report(scored: "ScoredCase", study: str, options: BenchmarkOptions, started: float) -> int:
    """Runs a single case with all its output; returns the exit code."""
    from uuv.benchmark.score import entered
    from uuv.command import command

    scenario = scored.case.scenario(scored.entry.control)
    scenario = replace(scenario, name=f"{study}/case_{scored.case.index:04d}")
    with ExitStack() as stack:

        def assembled(_: "Scenario", *, full: bool) -> "Assembly":
            stack.close()  # ends the entry's process of an earlier assembly
            return stack.enter_context(entered(scored, full=full))[0]

        after = f", case {scored.case.index} by {scored.entry.name}"
        return command(scenario, RunOptions(out=options.out), started, after, assembled=assembled)
