"""Added mass by panels of shapes whose added mass is known, over the number of panels.

Ellipsoids have a closed form, cubes and cylinders published numbers. Errors are the largest over
the diagonal terms of a shape; those about an axis of revolution are not compared. Times are those
of one surface, from the mesh to the matrix. "Extrapolated" is from the first number of panels and
the third, as `wet` does by default; Capytaine, where it is installed (`--with capytaine`), gets the
surface of the third.
"""

from uuv.start import run_scenario  # isort: skip

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TypedDict

import numpy as np

from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models import hydrodynamics
from uuv.models.water_from_geometry import panels as panel_method
from uuv.models.water_from_geometry.geoms import primitive
from uuv.models.water_from_geometry.surface import union_surface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

COUNTS = (400, 800, 1600, 3200)  # panels
ELLIPSOIDS = (  # semi-axes [m]
    (1.0, 1.0, 1.0),
    (2.0, 1.0, 1.0),
    (5.0, 1.0, 1.0),
    (10.0, 1.0, 1.0),
    (1.0, 1.0, 0.5),
    (1.0, 1.0, 0.2),
    (1.0, 1.0, 0.1),
    (1.0, 0.6, 0.3),
)
# A cube's added mass over its displaced mass is its polarisability at permittivity zero, less one.
CUBE = 0.6383  # [Sihvola 2004]
# length over diameter, factor across [DNV 2010, table D-2]
CYLINDERS = ((1.2, 0.62), (2.5, 0.78), (5.0, 0.90))
_MODES = ("Surge", "Sway", "Heave", "Roll", "Pitch", "Yaw")  # names of Capytaine


@dataclass(frozen=True, kw_only=True)
class KnownShape:
    """A shape whose added mass is known."""

    kind: str  # of MuJoCo's geoms
    size: tuple[float, float, float]  # by MuJoCo
    factors: Array  # (6,) diagonal of added over displaced mass; NaN: not compared
    reference: str

    @property
    def corners(self) -> Array:
        """Corners (n, 3, 3) [m] of its triangles."""
        vertices, triangles = primitive(self.kind, np.array(self.size))
        return vertices[triangles]


def known_shapes() -> dict[str, KnownShape]:
    """Shapes by name."""
    shapes = {}

    # Ellipsoids: in closed form
    for axes in ELLIPSOIDS:
        body = hydrodynamics.ellipsoid(axes, water_density=1.0)
        factors = body.added_mass.diagonal() / body.volume
        factors[factors < 1e-9] = np.nan  # about an axis of revolution
        name = f"ellipsoid {' '.join(f'{axis:g}' for axis in axes)}"
        shapes[name] = KnownShape(
            kind="ellipsoid", size=axes, factors=factors, reference="Lamb 1932"
        )

    # Cube and cylinders: tabulated
    factors = np.array([CUBE] * 3 + [np.nan] * 3)
    shapes["cube"] = KnownShape(
        kind="box", size=(0.5, 0.5, 0.5), factors=factors, reference="Sihvola 2004"
    )

    for slenderness, factor in CYLINDERS:
        shapes[f"cylinder, L/d {slenderness:g}"] = KnownShape(
            kind="cylinder",
            size=(0.5, 0.5 * slenderness, 0.0),
            factors=np.array([factor, factor, *[np.nan] * 4]),
            reference="DNV 2010, 2 digits",
        )
    return shapes


SHAPES = known_shapes()


@dataclass(frozen=True, kw_only=True)
class ShapeCase:
    """One shape."""

    shape: str
    """Name of the shape."""
    panels: tuple[int, ...] = COUNTS
    """Numbers of panels, rising."""

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in zip(self.panels, self.panels[1:], strict=False))
        if len(self.panels) < 2 or not rising or self.panels[0] < 8:
            raise ConfigurationError(
                "--panels: must be two or more rising numbers of at least 8, got "
                f"{' '.join(map(str, self.panels))}"
            )


@dataclass(frozen=True, kw_only=True)
class ShapeRow:
    """Errors and times of a shape."""

    triangles: Mapping[str, int] = column("triangles", by="surface")
    error: Mapping[str, float] = column("error", "%", digits=1, factor=100.0, by="surface")
    seconds: Mapping[str, float] = column("time", "s", digits=1, by="surface", tolerance=None)
    extrapolated: float = column("extrapolated", "%", digits=1, factor=100.0)
    # a ratio of rounding errors
    asymmetry: float = column("asymmetry", "ppm", digits=0, factor=1e6, tolerance=None)
    peer_error: float | None = column("Capytaine", "%", digits=1, factor=100.0, tolerance=None)
    peer_seconds: float | None = column("Capytaine", "s", digits=1, tolerance=None)


class PeerFigures(TypedDict):
    """What Capytaine gives; None where it is not installed."""

    peer_error: float | None
    peer_seconds: float | None


@experiment("added_mass", vary={"shape": tuple(SHAPES)}, quick={"shape": ("cube",)})
def added_mass(case: ShapeCase) -> ShapeRow:
    """Solves surfaces of a shape with each number of panels."""
    known = SHAPES[case.shape]
    corners = known.corners
    a, b, c = corners.transpose(1, 0, 2)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0

    solutions: dict[int, panel_method.PanelSolution] = {}
    error: dict[str, float] = {}
    seconds: dict[str, float] = {}
    for count in case.panels:
        begun = time.perf_counter()
        surface = union_surface(corners, volume, count)
        solution = panel_method.added_mass(surface.vertices, surface.triangles, 1.0)
        seconds[_surface(count)] = time.perf_counter() - begun
        error[_surface(count)] = _error(solution.added_mass.diagonal() / volume, known)
        solutions[count] = solution

    last = case.panels[:3][-1]
    best = panel_method.extrapolated(solutions[case.panels[0]], solutions[last])
    return ShapeRow(
        triangles={_surface(count): solution.panels for count, solution in solutions.items()},
        error=error,
        seconds=seconds,
        extrapolated=_error(best.added_mass.diagonal() / volume, known),
        asymmetry=best.asymmetry,
        **_by_capytaine(known, volume, last),
    )


def _surface(panels: int) -> str:
    return f"{panels} panels"


def _error(factors: Array, known: KnownShape) -> float:
    return float(np.nanmax(np.abs(factors / known.factors - 1.0)))


def _by_capytaine(known: KnownShape, volume: float, count: int) -> PeerFigures:
    """Error and time of Capytaine on the same surface, in deep water far from the surface."""
    if find_spec("capytaine") is None:
        return PeerFigures(peer_error=None, peer_seconds=None)
    import capytaine  # pyright: ignore[reportMissingImports]

    logging.getLogger("capytaine").setLevel(logging.ERROR)
    surface = union_surface(known.corners, volume, count)
    faces = np.column_stack([surface.triangles, surface.triangles[:, 0]])
    body = capytaine.FloatingBody(
        mesh=capytaine.Mesh(vertices=surface.vertices, faces=faces),
        dofs=capytaine.rigid_body_dofs(rotation_center=(0, 0, 0)),
    )

    begun = time.perf_counter()
    solver = capytaine.BEMSolver()
    deep = {"free_surface": np.inf, "water_depth": np.inf, "omega": np.inf, "rho": 1.0}
    diagonal = np.array(
        [
            solver.solve(
                capytaine.RadiationProblem(body=body, radiating_dof=mode, **deep)
            ).added_mass[mode]
            for mode in _MODES
        ],
        dtype=float,
    )
    seconds = time.perf_counter() - begun
    return PeerFigures(peer_error=_error(diagonal / volume, known), peer_seconds=seconds)


def _reference(row: Row) -> str:
    return SHAPES[row["shape"]].reference


added_mass.page = (
    Page()
    .table(
        "Largest relative error of the added mass",
        by="shape",
        columns=[
            stat("value", _reference, "reference"),
            "extrapolated",
            "peer_error",
            "peer_seconds",
            "asymmetry",
        ],
    )
    .table("The same, by surface [%]", by="shape", across="surface", columns=["error"])
    .table("Time of a surface [s]", by="shape", across="surface", columns=["seconds"])
)

if __name__ == "__main__":
    run_scenario(added_mass.main)
