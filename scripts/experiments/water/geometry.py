"""Benchmark: water from geometry against closed forms, literature, vehicles and robots' meshes.

    # shapes and BlueROV2
    ./uvw run scripts/experiments/water/geometry.py

    # with Capytaine on the same surfaces
    ./uvw run --with capytaine scripts/experiments/water/geometry.py

    # with a UR5 and a Panda
    ./uvw run --with example-robot-data scripts/experiments/water/geometry.py

Errors of the added mass are the largest over the diagonal terms of each shape. Seconds are those of
one surface, from the mesh to the matrix.
"""

import importlib.metadata
import json
import logging
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console

from uuv import models
from uuv.experiment import Table
from uuv.models import hydrodynamics
from uuv.models.vehicles.bluerov2_heavy import BENZON_2022, HEIGHT, LENGTH, WIDTH, WU_2018
from uuv.models.water_from_geometry import panels as panel_method
from uuv.models.water_from_geometry.files import read_model
from uuv.models.water_from_geometry.geoms import geoms_of, moving_bodies, primitive
from uuv.models.water_from_geometry.surface import union_surface
from uuv.models.water_from_geometry.wetting import Wetted, wet
from uuv.sim.interfaces.spatial import Array
from uuv.sim.runs.saving import write_whole
from uuv.start import parse, run_scenario

COUNTS = (400, 800, 1600, 3200)  # panels
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
PACKAGE = "example-robot-data"
# of the package
ROBOTS = ("ur_description/urdf/ur5_robot.urdf", "panda_description/urdf/panda.urdf")
# A cube's added mass over its displaced mass is its polarisability at permittivity zero, less one.
CUBE = 0.6383  # [Sihvola 2004]
# length over diameter, factor across [DNV 2010, table D-2]
CYLINDERS = ((1.2, 0.62), (2.5, 0.78), (5.0, 0.90))
SKETCH = f"""<mujoco><worldbody><body name="hull"><freejoint/>
  <geom type="cylinder" size=".057 .15" zaxis="1 0 0" pos="0 0 .02"/>
  <geom type="cylinder" size=".0445 .125" zaxis="1 0 0" pos="0 0 -.085"/>
  <geom type="box" size="{LENGTH / 2} .0032 .09" pos="0 .165 -.03"/>
  <geom type="box" size="{LENGTH / 2} .0032 .09" pos="0 -.165 -.03"/>
  <geom type="box" size="{LENGTH / 2} .165 .0032" pos="0 0 -.1"/>
  <geom type="box" size=".105 .05 .0325" pos=".115 .12 .09"/>
  <geom type="box" size=".105 .05 .0325" pos="-.115 .12 .09"/>
  <geom type="box" size=".105 .05 .0325" pos=".115 -.12 .09"/>
  <geom type="box" size=".105 .05 .0325" pos="-.115 -.12 .09"/>
  <geom type="cylinder" size=".03 .05" pos=".156 .111 -.06" zaxis="1 -1 0"/>
  <geom type="cylinder" size=".03 .05" pos=".156 -.111 -.06" zaxis="1 1 0"/>
  <geom type="cylinder" size=".03 .05" pos="-.156 .111 -.06" zaxis="1 1 0"/>
  <geom type="cylinder" size=".03 .05" pos="-.156 -.111 -.06" zaxis="1 -1 0"/>
  <geom type="cylinder" size=".03 .05" pos=".12 .24 0"/>
    <geom type="cylinder" size=".03 .05" pos=".12 -.24 0"/>
  <geom type="cylinder" size=".03 .05" pos="-.12 .24 0"/>
    <geom type="cylinder" size=".03 .05" pos="-.12 -.24 0"/>
</body></worldbody></mujoco>"""


@dataclass
class Options:
    """Accuracy and cost of the panel method, a vehicle against published figures, robots against
    their meshes.
    """

    quick: bool = False
    """At most 800 panels, shapes only."""
    json: Path | None = None
    """File for all numbers."""


def main() -> int:
    """Prints the tables and returns the exit code."""
    options = parse(Options)

    console = Console(width=None if Console().is_terminal else 160)
    numbers: dict[str, Any] = {}

    counts = COUNTS[:2] if options.quick else COUNTS
    console.print(shapes(counts, numbers).printed())

    if not options.quick:
        for table in vehicle(numbers):
            console.print(table.printed())
        for table in robots(numbers):
            console.print(table.printed())

    if options.json is not None:
        write_whole(options.json, json.dumps(numbers, indent=2))
    return 0


def shapes(counts: tuple[int, ...], numbers: dict[str, Any]) -> Table:
    """Error and seconds over the number of panels, for shapes with a known added mass."""
    peer = find_spec("capytaine") is not None
    rows = []
    for name, kind, size, expected, source in _known():
        vertices, triangles = primitive(kind, np.array(size))
        corners = vertices[triangles]
        a, b, c = corners.transpose(1, 0, 2)
        volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0

        # Largest error and seconds at each number of panels.
        cells, found, solved = [], {}, {}
        for count in counts:
            begun = time.perf_counter()
            surface = union_surface(corners, volume, count)
            solved[count] = panel_method.added_mass(surface.vertices, surface.triangles, 1.0)
            seconds = time.perf_counter() - begun
            error = _error(solved[count].added_mass.diagonal() / volume, expected)
            found[count] = {"panels": solved[count].panels, "error": error, "seconds": seconds}
            cells.append(f"{100 * error:.1f} % {seconds:.1f} s")

        # Extrapolated from two of them.
        last = max(counts[:3])
        best = panel_method.extrapolated(solved[counts[0]], solved[last])
        diagonal = best.added_mass.diagonal() / volume
        error = _error(diagonal, expected)
        cells.append(f"{100 * error:.1f} %")
        found |= {"extrapolated": error, "asymmetry": best.asymmetry}

        if peer:
            surface = union_surface(corners, volume, last)
            theirs, seconds = _capytaine(surface.vertices, surface.triangles)
            found["capytaine"] = {"error": _error(theirs / volume, expected), "seconds": seconds}
            cells.append(f"{100 * found['capytaine']['error']:.1f} % {seconds:.1f} s")

        rows.append([name, source, *cells, f"{best.asymmetry:.0e}"])
        numbers.setdefault("shapes", {})[name] = found

    last = max(counts[:3])
    columns = [
        "shape",
        "reference",
        *(f"{count} panels" for count in counts),
        f"{counts[0]} and {last}",
    ]
    columns += [f"Capytaine, {last}"] if peer else []

    return Table(
        title="(a) largest relative error of the added mass, and seconds",
        columns=[*columns, "asymmetry"],
        rows=rows,
        labels=2,
    )


def _known() -> list[tuple[str, str, tuple[float, float, float], Array, str]]:
    """Shapes: name, kind, MuJoCo's size, added over displaced mass (NaN: not compared), source."""
    # Ellipsoids have a closed form.
    found = []
    for a, b, c in (
        (1.0, 1.0, 1.0),
        (2.0, 1.0, 1.0),
        (5.0, 1.0, 1.0),
        (10.0, 1.0, 1.0),
        (1.0, 1.0, 0.5),
        (1.0, 1.0, 0.2),
        (1.0, 1.0, 0.1),
        (1.0, 0.6, 0.3),
    ):
        body = hydrodynamics.ellipsoid((a, b, c), water_density=1.0)
        expected = body.added_mass.diagonal() / body.volume
        expected[expected < 1e-9] = np.nan  # about an axis of revolution
        found.append(
            (f"ellipsoid {a:g} {b:g} {c:g}", "ellipsoid", (a, b, c), expected, "Lamb 1932")
        )

    # Cubes and cylinders have published numbers.
    nothing = [np.nan] * 3
    found.append(("cube", "box", (0.5, 0.5, 0.5), np.array([CUBE] * 3 + nothing), "Sihvola 2004"))

    for slenderness, factor in CYLINDERS:
        expected = np.array([factor, factor, np.nan, *nothing])
        found.append(
            (
                f"cylinder, L/d {slenderness:g}",
                "cylinder",
                (0.5, 0.5 * slenderness, 0.0),
                expected,
                "DNV 2010, 2 digits",
            )
        )

    return found


def _error(found: Array, expected: Array) -> float:
    return float(np.nanmax(np.abs(found / expected - 1.0)))


def _capytaine(vertices: Array, triangles: np.ndarray) -> tuple[Array, float]:
    """Diagonal (6,) of the added mass at density 1 by Capytaine, in deep water far from the
    surface, and seconds.
    """
    import capytaine  # pyright: ignore[reportMissingImports]

    logging.getLogger("capytaine").setLevel(logging.ERROR)
    mesh = capytaine.Mesh(vertices=vertices, faces=np.column_stack([triangles, triangles[:, 0]]))
    body = capytaine.FloatingBody(
        mesh=mesh, dofs=capytaine.rigid_body_dofs(rotation_center=(0, 0, 0))
    )

    names = ("Surge", "Sway", "Heave", "Roll", "Pitch", "Yaw")
    begun = time.perf_counter()
    solver = capytaine.BEMSolver()
    found = []
    for name in names:
        problem = capytaine.RadiationProblem(
            body=body,
            radiating_dof=name,
            omega=np.inf,
            free_surface=np.inf,
            water_depth=np.inf,
            rho=1.0,
        )
        found.append(float(solver.solve(problem).added_mass[name]))

    return np.array(found), time.perf_counter() - begun


def vehicle(numbers: dict[str, Any]) -> list[Table]:
    """BlueROV2 Heavy: the stand-ins of its model, a sketch with its frame, two published sets."""
    made: dict[str, hydrodynamics.BodyHydrodynamics] = {}

    # Three models of its shape: what is seen, a sketch of the parts, the box around all.
    spec = models.load("bluerov2_heavy_benzon2022")
    made["foam and housing"] = wet(spec, geoms="visual", density=1000.0).bodies["hull"]
    made["sketch of its parts"] = wet(mujoco.MjSpec.from_string(SKETCH), density=1000.0).bodies[
        "hull"
    ]
    spec = models.load("bluerov2_heavy_benzon2022")
    made[f"solid box {LENGTH:g} {WIDTH:g} {HEIGHT:g} m"] = wet(
        spec, geoms="collision", density=1000.0
    ).bodies["hull"]

    added, drag = [], []
    for name, water in made.items():
        added.append(
            [name, f"{1e3 * water.volume:.1f}", *(f"{x:.3g}" for x in water.added_mass.diagonal())]
        )
        drag.append([name, *(f"{x:.3g}" for x in water.quadratic_damping), *["0"] * 3])
        numbers.setdefault("bluerov2", {})[name] = {
            "volume": water.volume,
            "added_mass": water.added_mass.tolist(),
            "quadratic_damping": water.quadratic_damping.tolist(),
        }

    # Two published sets, with linear drag.
    for name, hull in (("Benzon 2022", BENZON_2022), ("Wu 2018", WU_2018)):
        added.append(
            [
                name,
                f"{1e3 * hull.volume:.1f}",
                *(f"{x:.3g}" for x in np.diag(np.asarray(hull.added_mass))),
            ]
        )
        quadratic, linear = np.asarray(hull.quadratic_damping), np.asarray(hull.linear_damping)
        drag.append([name, *(f"{x:.3g}" for x in quadratic), *(f"{x:.3g}" for x in linear[:3])])

    return [
        Table(
            title="(b) BlueROV2 Heavy: added mass [kg, kg m^2]",
            columns=["from", "litres", *AXES],
            rows=added,
        ),
        Table(
            title="(b) BlueROV2 Heavy: quadratic drag [N s^2/m^2, N m s^2], and linear [N s/m]",
            columns=["from", *AXES, *(f"linear {axis}" for axis in AXES[:3])],
            rows=drag,
        ),
    ]


def robots(numbers: dict[str, Any]) -> list[Table]:
    """Robots of the package example-robot-data: our volumes beside those of trimesh."""
    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return []

    tables = []
    for wanted in ROBOTS:
        place = next(
            (Path(str(file.locate())) for file in files if str(file).endswith(wanted)), None
        )
        if place is None:
            continue

        # Our reader and union, timed.
        begun = time.perf_counter()
        spec, _ = read_model(place)
        wetted = wet(spec)
        seconds = time.perf_counter() - begun

        theirs = _trimesh_volumes(spec)
        rows = _rows(wetted, theirs)
        numbers.setdefault("robots", {})[place.stem] = {"seconds": seconds, "rows": rows}

        total = sum(water.volume for water in wetted.bodies.values())
        tables.append(
            Table(
                title=f"(c) {place.stem}: {len(rows)} bodies, {1e3 * total:.2f} l, {seconds:.0f} s",
                columns=[
                    "body",
                    "litres",
                    "trimesh, litres",
                    "closed",
                    "added mass kg",
                    "drag",
                    "uncertainty",
                ],
                rows=rows,
            )
        )

    return tables


def _rows(wetted: Wetted, theirs: dict[str, tuple[float, str]]) -> list[list[str]]:
    rows = []
    for name, water in wetted.bodies.items():
        told = {o.quantity: o for o in wetted.origins if o.body == name}
        volume, closed = theirs.get(name, (np.nan, "no mesh"))
        rows.append(
            [
                name,
                f"{1e3 * water.volume:.4g}",
                "-" if np.isnan(volume) else f"{1e3 * volume:.4g}",
                closed,
                " ".join(f"{x:.3g}" for x in water.added_mass.diagonal()[:3]),
                "strip" if water.segments else "areas",
                f"{told['volume'].uncertainty}; {told['added mass'].uncertainty}; "
                f"{told['drag'].uncertainty}",
            ]
        )

    return rows


def _trimesh_volumes(spec: mujoco.MjSpec) -> dict[str, tuple[float, str]]:
    """Sum of a body's mesh volumes by trimesh, without union, and how many meshes are closed."""
    import trimesh

    model = spec.copy().compile()
    found = {}
    for body in moving_bodies(model):
        chosen = [g for g in geoms_of(model, body, "auto")[0] if model.geom_dataid[g] >= 0]
        meshes = []

        for g in chosen:
            at = int(model.geom_dataid[g])
            v, f = int(model.mesh_vertadr[at]), int(model.mesh_faceadr[at])
            vertices = model.mesh_vert[v : v + model.mesh_vertnum[at]]
            meshes.append(
                trimesh.Trimesh(vertices, model.mesh_face[f : f + model.mesh_facenum[at]])
            )

        if meshes:
            closed = sum(bool(mesh.is_watertight) for mesh in meshes)
            found[model.body(body).name] = (
                sum(float(m.volume) for m in meshes),
                f"{closed} of {len(meshes)}",
            )

    return found


if __name__ == "__main__":
    run_scenario(main)
