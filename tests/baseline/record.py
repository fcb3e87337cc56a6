"""Writes the behaviour baseline anew, or judges fresh seeds by it.

    ./uvw run tests/baseline/record.py --reason "force loop at 30 rad/s: a fifth less force error"

    # these alone
    ./uvw run tests/baseline/record.py --reason "..." --only pile traces

    # fresh seeds against the bands; writes nothing
    ./uvw run tests/baseline/record.py --judge 1000 1010

A reason is asked for, lands in the file, and the difference is printed for the changelog. Judging
exits with 1 if any figure lies outside its band.
"""

import argparse
import os
import sys
from datetime import UTC, datetime
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import store
import traces
from bands import Band, Figures, bands_of, faults
from cases import CASES, run_all

QUICK_SEEDS, SEEDS = 24, 12  # of cases that take about a second, and of whole runs
QUICK = (
    "calibration",
    "inverse_kinematics",
    "hover_envelope",
    "identification_barrel",
    "identification_rock",
    "identification_valve",
)
TRACES = "traces"


Task = tuple[str, int]  # case, seed


def figures_of(task: Task) -> Figures:
    return CASES[task[0]](task[1])


def died(task: Task) -> Figures:
    raise SystemExit(f"the process of {task[0]}, seed {task[1]}, died")


def all_figures(tasks: list[Task], workers: int) -> dict[str, dict[int, Figures]]:
    """Figures by case and seed, in the order of `tasks`."""
    by_case: dict[str, dict[int, Figures]] = {name: {} for name, _ in tasks}
    for (name, seed), figures in run_all(tasks, workers, figures_of, died):
        by_case[name][seed] = figures
        print(f"{name}, seed {seed}", file=sys.stderr, flush=True)
    return {name: dict(sorted(runs.items())) for name, runs in by_case.items()}


def differences(
    name: str, before: dict[str, Band | None], after: dict[str, Band | None]
) -> list[str]:
    """A line for each figure of a case that moved by more than a spread, came, or went."""
    lines = []
    for figure in dict.fromkeys([*before, *after]):
        old, new = before.get(figure), after.get(figure)
        if old is None or new is None:
            if (figure in before) != (figure in after) or old is not new:
                lines.append(
                    f"{name} {figure}: {_said(old, figure in before)} -> "
                    f"{_said(new, figure in after)}"
                )
        elif abs(new.middle - old.middle) > 0.02 * abs(old.middle) or new.seeds != old.seeds:
            lines.append(f"{name} {figure}: {_said(old, True)} -> {_said(new, True)}")
    return lines


def _said(band: Band | None, there: bool) -> str:
    if band is None:
        return "no figure" if there else "(not held)"
    return f"{band.middle:.4g} ({band.low:.3g} to {band.high:.3g})"


def rewrite(reason: str, only: list[str], workers: int) -> None:
    names = [name for name in CASES if not only or name in only]
    tasks = [
        (name, seed) for name in names for seed in range(QUICK_SEEDS if name in QUICK else SEEDS)
    ]
    figures_of_runs = all_figures(tasks, workers)
    held = store.read() if store.FILE.exists() else {}
    for name in names:
        bands = bands_of(list(figures_of_runs[name].values()))
        for line in differences(name, held.get(name, {}), bands):
            print(line)
        held[name] = bands
    date = datetime.now(UTC).date().isoformat()
    if names:
        store.write({name: held[name] for name in CASES if name in held}, reason=reason, date=date)
    if not only or TRACES in only:
        for line in traces.rewrite(reason=reason, date=date):
            print(line)


def judge(first: int, last: int, only: list[str], workers: int) -> int:
    """Say every figure of seeds `first` to `last` - 1 that lies outside its band, as runs end; the
    exit code.
    """
    held = store.read()
    names = [name for name in CASES if name in held and (not only or name in only)]
    tasks = [(name, seed) for seed in range(first, last) for name in names]
    alarms = judged = 0
    for (name, seed), figures in run_all(tasks, workers, figures_of, died):
        judged += len(held[name])
        breaches = faults(figures, held[name], fresh=True)
        alarms += len(breaches)
        print(f"{name}, seed {seed}: {'; '.join(breaches) or 'within'}", flush=True)
    print(f"{len(tasks)} runs, {judged} figures, {alarms} outside their bands")
    return 1 if alarms else 0


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--reason", help="why the behaviour may change; lands in the file")
    what.add_argument(
        "--judge", nargs=2, type=int, metavar=("FIRST", "LAST"), help="seeds FIRST to LAST - 1"
    )
    parser.add_argument("--only", nargs="+", default=[], choices=[*CASES, TRACES], metavar="CASE")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    if options.judge:
        first, last = options.judge
        return judge(first, last, options.only, options.workers)
    if len(options.reason.split()) < 3:
        parser.error("--reason: a sentence that a reader of the changelog understands")
    rewrite(options.reason, options.only, options.workers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
