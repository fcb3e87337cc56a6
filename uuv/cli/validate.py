"""`uuv validate`: the physics against closed forms and other formulations, in a checkout."""

import runpy
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuv.catalogue import CHECKOUT
from uuv.cli.json_output import file_alone
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.start import parse

TABLE = "table.json"
_WORK = CHECKOUT / "scripts" / "validate_physics.py"


@dataclass(kw_only=True)
class ValidateOptions:
    """Check the physics against closed forms, conservation laws and independent formulations.

    The checks are tests of the project, so this needs a checkout.
    """

    out: Path | None = None
    """Folder for table.md and table.json."""
    docs: bool = False
    """Put the table into docs/results/physics.md as well."""
    json: bool = False
    """Print table.json alone."""


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the checks, prints and writes the table; exit code 0 if all hold."""
    del verb
    options = parse(ValidateOptions, args)
    if not _WORK.is_file():
        raise ConfigurationError(
            "validate: works only in a checkout, since the checks are tests of the project"
        )
    run = runpy.run_path(str(_WORK), run_name="validate_physics")["run"]
    return file_alone(lambda: run(options), TABLE) if options.json else run(options)
