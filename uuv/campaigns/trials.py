"""Trials of one job over many seeds: metrics, table of their spread, and success rate."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from uuv.experiment import Row, Study, Summary, Table
from uuv.experiment.options import PoolOptions

WANTED = 0.95  # share of the trials that must be accepted
Metrics = dict[str, Any]
# Row of the table: label, key of the summary, unit, scale from SI, and which end is the worst.
Spread = tuple[str, str, str, float, Literal["min", "max"]]


@dataclass(frozen=True, kw_only=True)
class Trials:
    """Trials of one kind of job."""

    # metrics of a trial, from the shared settings and its seed
    one: Callable[[tuple[Any, int]], Mapping[str, Any]]
    crashed: Callable[[int, str], Metrics]  # metrics of a seed whose trial failed, with the message
    summary: Callable[[Sequence[Metrics]], Metrics]
    spreads: tuple[Spread, ...]
    # appended to the line of the success rate, from the summary
    also: Callable[[Metrics], str] = lambda _: ""

    def carry_out(self, name: str, setting: Any, seeds: Iterable[int], options: PoolOptions) -> int:
        """Runs a trial for each seed and reports the statistics; one that fails with an error does
        not end the others.

        Args:
            name: Name of the scenario.
            setting: Settings that all trials share.
            seeds: Seeds of the trials.
            options: Options of the command.

        Returns:
            The exit code.
        """
        study = Study(
            cases=[(setting, seed) for seed in seeds],
            run_one=self.one,
            summarise=self._summarise,
            failed=lambda case, reason: self.crashed(case[1], reason),
            line=_line,
        )
        return study.carry_out(f"{name}_trials", options, f"Trials of {name}")

    def _summarise(self, trials: list[Row]) -> Summary:
        figures = self.summary(trials)
        rate = (
            f"{figures['accepted']} of {figures['trials']} accepted: {figures['share']:.1%}, 95 % "
            "interval "
            f"{figures['share_low']:.1%} to {figures['share_high']:.1%}{self.also(figures)}"
        )
        kinds = ", ".join(f"{kind} {count}" for kind, count in figures["failures"].items())
        failures = [f"failures: {kinds} (seeds {figures['failed_seeds']})"] if kinds else []
        too_few = figures["share"] < WANTED
        return Summary(
            metrics={"summary": figures},
            tables=[_spread_table(figures, self.spreads)],
            lines=[rate, *failures],
            failed=[f"accepted: {figures['share']:.1%}, wanted {WANTED:.0%}"] if too_few else [],
        )


def _line(trial: Row) -> str:
    return "" if trial["accepted"] else f"seed {trial['run']['seed']}: {'; '.join(trial['failed'])}"


def _spread_table(figures: Metrics, spreads: Iterable[Spread]) -> Table:
    """Table of the spread of each figure over the trials; those without values are left out."""
    rows = []
    for label, key, unit, scale, worst in spreads:
        values = figures[key]
        if values is not None:
            rows.append(
                (label, unit, *(f"{values[name] * scale:.2f}" for name in ("median", "p95", worst)))
            )
    return Table(
        title="Spread over the trials",
        columns=("figure", "unit", "median", "95 %", "worst"),
        rows=rows,
        labels=2,
    )
