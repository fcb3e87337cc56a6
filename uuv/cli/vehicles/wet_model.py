"""`uuv wet MODEL`: an MJCF with hydrodynamic data from geometry, and a table of their origins."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from uuv.cli.json_output import print_json
from uuv.models.water.bounds import SEA_WATER
from uuv.models.water_from_geometry.choices import PANELS, Choice
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import parse

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from uuv.models.water_from_geometry.wetting import Wetted

_COLUMNS = ("body", "quantity", "value", "origin", "uncertainty")


@dataclass
class WetOptions:
    """Compute volume, buoyancy, added mass and drag of every body of a model from its geometry.

    Writes NAME.wet.xml, an MJCF with these hydrodynamic data, and prints the origin and the
    uncertainty of each number.
    """

    model: Annotated[Positional[Path], arg(metavar="MODEL", help="URDF, MJCF, or one mesh.")]
    out: Path | None = None
    """File to write; default: NAME.wet.xml in the folder of the model."""
    geoms: Choice = "auto"
    """Geoms that displace water; auto: the visual geoms of a body that has some, otherwise its
    collision geoms."""
    density: float = SEA_WATER
    """Density of the water [kg/m^3]."""
    panels: int = PANELS
    """Number of triangles of each body's surface."""
    neutral: bool = False
    """Add foam or ballast to the floating root, so that the vehicle is weightless and level."""
    metacentric_height: float = 0.02
    """Height [m] of the centre of buoyancy above the centre of mass, with --neutral."""
    free: bool = False
    """Let the root link of a URDF float; otherwise it is fixed to the world."""
    scale: float | None = None
    """Length [m] of a mesh file's unit: 0.001 for millimetres."""
    sidecar: bool = False
    """Write the hydrodynamic data to NAME.wet.water.yaml instead of into the MJCF."""
    json: bool = False
    """Print the table as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Writes the model and prints the table; returns the exit code."""
    del verb
    options = parse(WetOptions, args)
    from uuv.sim.runs.terminal import console

    return wet_model(options, console(200))


def wet_model(options: WetOptions, console: "Console") -> int:
    """Writes the model and prints the table; returns the exit code."""
    from uuv.models.files.mesh_shapes import MESHES
    from uuv.models.files.vehicle_file import WET
    from uuv.models.water_from_geometry.files import make_neutral, read_model, write_model

    visual = options.geoms != "collision"
    spec, notes = read_model(options.model, free=options.free, scale=options.scale, visual=visual)
    out = options.model.with_suffix(f"{WET}.xml") if options.out is None else options.out

    if not out.parent.is_dir():
        raise ConfigurationError(f"--out {out}: there is no folder {str(out.parent)!r}")
    from uuv.models.files.sidecar import tree_of
    from uuv.models.water_from_geometry.wetting import wet  # brings compiled panels

    wetted = wet(
        spec,
        geoms=options.geoms,
        density=options.density,
        panels=options.panels,
        metacentric_height=options.metacentric_height if options.neutral else None,
    )
    if options.model.suffix.lower() in MESHES:
        make_neutral(spec)

    written = write_model(wetted, out, with_sidecar=options.sidecar)
    if options.json:
        content = {"files": written, "notes": [*notes, *wetted.dry], "water": tree_of(spec)}
        print_json({**content, "origins": [asdict(origin) for origin in wetted.origins]})
        return 0

    console.print(table(wetted, options.model.name))
    for note in (*notes, *(f"no water: {body}" for body in wetted.dry)):
        console.print(note, markup=False, highlight=False, soft_wrap=True)
    for path in written:
        console.print(f"written to {path}", markup=False, highlight=False, soft_wrap=True)
    return 0


def table(wetted: "Wetted", title: str) -> "Table":
    """The table of origins."""
    from rich.table import Table

    printed = Table(title=title, title_justify="left")
    for column in _COLUMNS:
        printed.add_column(column, overflow="fold", no_wrap=column in ("body", "quantity"))
    last = None
    for o in wetted.origins:
        if last not in (None, o.body):
            printed.add_section()
        row = ("" if o.body == last else o.body, o.quantity, o.value, o.origin, o.uncertainty)
        printed.add_row(*row)
        last = o.body
    return printed
