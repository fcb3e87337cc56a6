"""Benchmark "UUV contact": scores one controller by the truth, in a process of its own that gets estimates only.

    ./uvw run scripts/benchmarks/contact_score.py                                   # the default, 100 public cases
    ./uvw run scripts/benchmarks/contact_score.py --entry mymodule:MyController --cases 10
    ./uvw run scripts/benchmarks/contact_score.py --seed 4711                       # 100 fresh cases

The result file is metrics.json in the folder of results; contact_leaderboard.py makes a table of several.
docs/benchmark.md
says what is scored and how to enter a controller.
"""

from scenarios.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from scenarios.contact_benchmark.cases import CASES, PUBLIC_SEED, VERSION, cases, digest
from scenarios.contact_benchmark.entries import Entry
from scenarios.contact_benchmark.score import ScoredCase, score, summary
from scenarios.study import Study, StudyOptions
from scenarios.study.harness import key_of
from scenarios.study.loaded_code import digests, loaded_files


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Score of a controller on the benchmark "UUV contact"."""

    entry: str = "default"
    """default, normal-force-law, "without METHOD", "joint PD", a registered controller, or MODULE:CLASS."""
    estimator: str = ""
    """MODULE:CLASS of an estimator that the entry brings; empty: navigation is given, as to all others."""
    cases: int = CASES
    """Number of cases, from the first on."""
    seed: int = PUBLIC_SEED
    """Seed of the cases; the default gives the public ones, any other fresh ones."""
    in_process: bool = False
    """Run the controller in the simulation's process: faster, and no entry, for it could read the truth."""


def main() -> int:
    """Runs or resumes the benchmark and returns the exit code."""
    options = parse(Options)
    entry, chosen = Entry.of(options.entry, options.estimator), cases(options.cases, seed=options.seed)
    about = {
        "version": VERSION,
        "seed": options.seed,
        "public": options.seed == PUBLIC_SEED,
        "cases": len(chosen),
        "cases_digest": digest(chosen),
        "code": key_of(digests(loaded_files())),
        "entry": entry.name,
        "source": entry.source,
        "in_process": options.in_process,
    }
    todo = [ScoredCase(case=case, entry=entry, in_process=options.in_process) for case in chosen]
    name = "contact_score-" + "".join(c if c.isalnum() else "-" for c in entry.name)
    return Study(cases=todo, run_one=score, summarise=lambda rows: summary(rows, about)).carry_out(
        name, options, f"UUV contact, version {VERSION}: {entry.name}"
    )


if __name__ == "__main__":
    run_scenario(main)
