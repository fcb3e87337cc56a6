"""`uuv results`: prints pages of the experiments' kept rows or checks the rows, in a checkout."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from uuv.cli.json_output import print_json
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.start import parse

if TYPE_CHECKING:
    from uuv.experiment import Experiment

CHANGED = 1  # exit code
PARTS = 8  # number of parts of the experiments, for checking one part at a time


@dataclass(kw_only=True)
class ResultsOptions:
    """Print docs/results.md and a page for each experiment from kept rows; check them."""

    only: tuple[str, ...] = ()
    """Names of experiments to check or keep; default: all."""
    check: bool = False
    """Run the quick subset of each experiment and compare it with the kept rows."""
    unverified: bool = False
    """With --check: leave out what is verified for the present code, to go on with a check that was
    interrupted."""
    part: int | None = None
    """With --check: check only one eighth of the experiments: number 0 to 7, taken modulo 8."""
    data: Annotated[Path | None, arg(metavar="FOLDER")] = None
    """Folder of measured data; without it, experiments that need it are not checked."""
    keep: Annotated[Path | None, arg(metavar="FOLDER")] = None
    """Folder of a run whose rows are kept, of the experiment that --only names."""
    workers: int = 0
    """Number of processes of a check; 0: one for each core."""
    json: bool = False
    """Print only the status of these experiments, as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Keeps or checks rows, then writes the pages; exit code 1 if a check failed or found other
    values.
    """
    del verb
    options = parse(ResultsOptions, args)
    from uuv.results import kept_rows, pages

    experiments = pages.all_experiments()
    chosen = _chosen(experiments, options)

    if options.keep is not None:
        if len(chosen) != 1:
            raise ConfigurationError("--keep: needs --only with the name of its experiment")
        kept_rows.keep(chosen[0], options.keep).write(kept_rows.ROWS)

    # Each mark is written at once; a subset that fails does not end the check
    changed = False
    for experiment in chosen if options.check else []:
        try:
            changed |= _check(experiment, options)
        except ConfigurationError as error:
            changed = True
            print(f"not checked: {error}", file=sys.stderr)

    entries = pages.results(experiments, data=options.data is not None)
    for path, text in pages.pages(entries).items():
        pages.write_page(path, text)
    names = {experiment.name for experiment in chosen}
    statuses = {
        entry.experiment.name: entry.status for entry in entries if entry.experiment.name in names
    }
    if options.json:
        print_json(statuses)
    else:
        print("\n".join(f"{name}: {status}" for name, status in statuses.items()))
    return CHANGED if changed else 0


def _chosen(
    experiments: Sequence["Experiment[Any, Any]"], options: ResultsOptions
) -> list["Experiment[Any, Any]"]:
    names = [experiment.name for experiment in experiments]
    for name in options.only:
        if name not in names:
            known = ", ".join(names)
            raise ConfigurationError(
                f"--only: no experiment {name!r}; there are {known}{did_you_mean(name, names)}"
            )

    chosen = [entry for entry in experiments if not options.only or entry.name in options.only]
    return chosen if options.part is None else chosen[options.part % PARTS :: PARTS]


def _check(experiment: "Experiment[Any, Any]", options: ResultsOptions) -> bool:
    """Checks the kept rows of an experiment, if it has any; True if they have changed."""
    from uuv.results import kept_rows
    from uuv.results.check import check

    reference = kept_rows.kept_rows(experiment.name)
    if reference is None or (experiment.needs_data and options.data is None):
        return False
    if options.unverified and reference.is_verified:
        return False

    began = _processor_time()
    present = check(experiment, reference, options.data, options.workers)
    present.write(kept_rows.ROWS)
    if not options.json:
        spent = _processor_time() - began
        print(f"{experiment.name}: checked in {spent:.0f} s of processor time", flush=True)
    return bool(present.check.deviations)


def _processor_time() -> float:
    """Processor time [s] of this process's children; 0 on Windows."""
    times = os.times()
    return times.children_user + times.children_system
