"""Table of the named models: degrees of freedom, mass, volume, actuation, and the source of the figures.

`./uvw run scripts/show_models.py` prints it.
"""

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from uuv import models
from uuv.start import parse, run_scenario


@dataclass
class Options:
    """Named models and their sources."""

    names: tuple[str, ...] = ()  # names of uuv.models.available(); default: all


def main() -> int:
    """Prints the table and returns the exit code."""
    options = parse(Options)
    names = options.names or tuple(name for name in models.available() if models.describe(name).name == name)
    table = Table(title="Named models")
    table.add_column("name", no_wrap=True, overflow="fold")
    for column in ("DOF", "dry kg, L", "moved by", "source"):
        table.add_column(column, overflow="fold")
    for told in map(models.describe, names):
        joints = f", {len(told.joints)} joints" if told.joints else ""
        moved = f"{told.thrusters} thrusters" if told.thrusters else told.drive
        size = f"{told.mass:.4g}, {1e3 * told.volume:.4g}"
        table.add_row(told.name, f"{told.dof}", size, moved + joints, told.source)
    Console().print(table)
    return 0


if __name__ == "__main__":
    run_scenario(main)
