"""Compares two campaigns of the same draws, run by run; each argument is the folder of a finished one.

./uvw run scripts/compare_campaigns.py runs/contact runs/contact_other --out runs/comparison
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder

NAME = "compare_campaigns"


@dataclass(kw_only=True)
class Options:
    """Compare two campaigns of the same draws."""

    a: Positional[Path]
    """Folder of the first campaign."""
    b: Positional[Path]
    """Folder of the second campaign."""
    out: Path | None = None
    """New folder for metrics.json and report.html, by default in runs/compare_campaigns."""


def main() -> int:
    """Compares the campaigns; returns the exit code."""
    options = parse(Options)
    for folder in (options.a, options.b):
        if not folder.is_dir():
            raise ConfigurationError(f"{folder}: no folder of a campaign")

    from uuv.campaigns.comparison import Finished, compared
    from uuv.experiment.harness import as_json
    from uuv.experiment.row_log import METRICS, PAGE
    from uuv.sim.runs.provenance import provenance
    from uuv.sim.runs.terminal import console as console_of

    summary = compared(Finished.read(options.a), Finished.read(options.b))
    folder, made_by = new_folder(NAME, options.out), provenance(NAME, options)
    write_json(folder / METRICS, as_json({**summary.metrics, "provenance": made_by}))
    summary.write_page(folder / PAGE, "Comparison of two campaigns", made_by["options"], "")
    console = console_of(160)
    summary.print_to(console)
    console.print(f"written to {folder}/", highlight=False)
    return 0


if __name__ == "__main__":
    run_scenario(main)
