"""`uuv compare-campaigns`: two campaigns of the same draws, run by run."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uuv.cli.carry_out import METRICS
from uuv.cli.json_output import file_alone
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse

NAME = "compare_campaigns"
Finished = Annotated[Positional[Path], arg(metavar="FOLDER", help="Folder of a finished campaign.")]


@dataclass(kw_only=True)
class CompareCampaignsOptions:
    """Compare two campaigns of the same draws, run by run."""

    a: Finished
    b: Finished
    out: Path | None = None
    """New folder for metrics.json and report.html, by default in runs/compare_campaigns."""
    json: bool = False
    """Print metrics.json alone."""


def main(verb: str, args: Sequence[str]) -> int:
    """Compares the campaigns; returns the exit code."""
    del verb
    options = parse(CompareCampaignsOptions, args)
    for folder in (options.a, options.b):
        if not folder.is_dir():
            raise ConfigurationError(f"{folder}: no folder of a campaign")

    work = partial(compare_campaigns, options)
    return file_alone(work, METRICS) if options.json else work()


def compare_campaigns(options: CompareCampaignsOptions) -> int:
    """Compares the campaigns, prints and writes the result; returns the exit code.

    Raises:
        ConfigurationError: A folder holds no finished campaign, or the draws are not the same.
    """
    from uuv.campaigns import comparison
    from uuv.experiment.harness import as_json
    from uuv.experiment.row_log import PAGE
    from uuv.sim.runs.provenance import provenance
    from uuv.sim.runs.terminal import console as console_of

    finished = [comparison.Finished.read(folder) for folder in (options.a, options.b)]
    summary = comparison.compared(*finished)
    folder = new_folder(NAME, options.out)
    made_by = provenance(NAME, options)
    write_json(folder / METRICS, as_json({**summary.metrics, "provenance": made_by}))
    summary.write_page(folder / PAGE, "Comparison of two campaigns", made_by["options"], "")

    console = console_of(160)
    summary.print_to(console)
    console.print(f"written to {folder}/", highlight=False)
    return 0
