"""The named models: what each is, how big, what moves it, and where its figures are from.

`./uvw run scripts/show_models.py` prints one table.
"""

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

import models
from scenarios.start import parse, run_scenario


@dataclass
class Options:
    """Named models and their sources."""

    names: tuple[str, ...] = ()  # of models.available(); all by default


def main() -> int:
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
