"""Leaderboard of the benchmark "UUV contact" from result files of uuv benchmark.

    TABLE=scripts/experiments/leaderboard/contact_leaderboard.py
    ./uvw run $TABLE --results runs/benchmark-default runs/benchmark-joint-PD

All results must be of the same cases; one alone gives a page too.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from experiments.leaderboard.table import page, read_result
from uuv.sim.runs.run_folder import RUNS
from uuv.sim.runs.saving import write_whole


@dataclass(kw_only=True)
class Options:
    """Leaderboard of the benchmark "UUV contact"."""

    results: tuple[Path, ...]
    """Result files, metrics.json of uuv benchmark, or their folders."""
    out: Path = RUNS / "leaderboard.md"
    """File of the page, in Markdown."""


def main() -> int:
    """Writes and prints the page."""
    options = parse(Options)
    text = page([read_result(file) for file in options.results])
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(options.out, text)
    print(text)
    print(f"written to {options.out}")
    return 0


if __name__ == "__main__":
    run_scenario(main)
