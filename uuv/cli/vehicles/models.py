"""`uuv models`: size, actuation and sources of the named models."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from uuv.cli.json_output import print_json
from uuv.start import parse

_NAMES = "Names of `uuv list vehicles`; default: all."


@dataclass(kw_only=True)
class ModelsOptions:
    """List the named models with size, actuation and sources."""

    names: Annotated[Positional[tuple[str, ...]], arg(metavar="[NAME ...]", help=_NAMES)] = ()
    json: bool = False
    """Print the table as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the table; returns the exit code."""
    del verb
    options = parse(ModelsOptions, args)
    from uuv import models

    described = [(name, models.describe(name)) for name in options.names or models.available()]
    shown = [model for name, model in described if options.names or model.name == name]  # no alias

    if options.json:
        print_json(
            {
                model.name: {
                    "dof": model.dof,
                    "mass_kg": model.mass,
                    "volume_m3": model.volume,
                    "thrusters": model.thrusters,
                    "drive": model.drive,
                    "joints": list(model.joints),
                    "source": model.source,
                }
                for model in shown
            }
        )
        return 0

    from rich.table import Table

    from uuv.sim.runs.terminal import console

    table = Table(title="Named models", title_justify="left")
    table.add_column("name", no_wrap=True, overflow="fold")
    for column in ("DOF", "dry kg, L", "moved by", "source"):
        table.add_column(column, overflow="fold")

    for model in shown:
        joints = f", {len(model.joints)} joints" if model.joints else ""
        moved = f"{model.thrusters} thrusters" if model.thrusters else model.drive
        size = f"{model.mass:.4g}, {1e3 * model.volume:.4g}"
        table.add_row(model.name, f"{model.dof}", size, moved + joints, model.source)
    console().print(table)
    return 0
