"""Collection: objects picked up from the seabed in a current, and what the vehicle learns of them.

The current has a speed of 0.15 m/s and gusts, from a drawn side. The bracket is a mesh without
declared grasps, written to a file as a user's own. Stones of other masses than that of stone have
the same shape; the vehicle does not know the mass. A case that is refused or broken off counts.
"""

from uuv.start import run_scenario  # isort: skip

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuv import jobs, run
from uuv.experiment import Page, column, experiment, stat
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams

# An angle of 60 mm by 40 mm, 12 mm thick and 50 mm long: outline [m] of its section.
ANGLE = np.array(
    [[0.0, 0.0], [0.06, 0.0], [0.06, 0.012], [0.012, 0.012], [0.012, 0.04], [0.0, 0.04]]
)
LENGTH = 0.05  # [m]
_FACES = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5))  # triangles of the section
# Options of the job by the object.
OBJECTS: Mapping[str, Mapping[str, Any]] = {
    "stone": {"object": "stone"},
    "small anode": {"object": "small_anode"},
    "starfish": {"object": "starfish", "mass": 1.55, "load": 2.4, "range": 1.0},
    "bracket": {"mass": 0.25},
    "stone of 0.3 kg": {"object": "stone", "mass": 0.3},
    "stone of 1.4 kg": {"object": "stone", "mass": 1.4},
    "stone of 3 kg": {"object": "stone", "mass": 3.0, "load": 30.0},
    "stone of 5 kg": {"object": "stone", "mass": 5.0, "load": 50.0, "grip": 60.0},
}
BRACKET = "bracket"


@dataclass(frozen=True, kw_only=True)
class CollectCase:
    """One object at one place."""

    what: str
    """Object, of OBJECTS."""
    speed: float = 0.15
    """Speed of the current [m/s]."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    seed: int

    def __post_init__(self) -> None:
        if self.what not in OBJECTS:
            known = ", ".join(OBJECTS)
            raise ConfigurationError(f"what: must be one of {known}, got {self.what!r}")


@dataclass(frozen=True, kw_only=True)
class CollectRow:
    """How a run ended."""

    accepted: bool = column("accepted")
    in_basket: bool = column("in the basket")
    dropped: bool = column("dropped")
    ended: str = column("ended")  # cause of an abort, else the last phase
    note: str = column("note")
    put: float | None = column("from the middle", "mm", digits=1, factor=1e3, default=None)
    grip_peak: float | None = column("peak of grip", "N", digits=1, default=None)
    slip: float | None = column("slip", "mm", digits=2, factor=1e3, default=None)
    excursion: float | None = column("hull excursion", "mm", digits=1, factor=1e3, default=None)
    weight: float | None = column("weight in water", "N", digits=2, default=None)
    mass: float | None = column("mass", "kg", digits=3, default=None)
    mass_error: float | None = column("error of mass", "g", digits=1, factor=1e3, default=None)
    failed: Sequence[str] = column("bounds missed")


def refused(case: CollectCase, error: str) -> CollectRow:
    """Row of a run that is refused, or fails."""
    del case
    return CollectRow(
        accepted=False, in_basket=False, dropped=False, ended="refused", note=error, failed=[]
    )


@experiment(
    "collect",
    seeds=5,
    vary={"what": tuple(OBJECTS)},
    paired=True,
    quick={"runs": 1, "what": ("stone",)},
    failed=refused,
)
def collect(case: CollectCase) -> CollectRow:
    """Collects an object in a current from a drawn side."""
    # Current.
    heading = Streams(case.seed)["heading"].uniform(-np.pi, np.pi)
    current = (case.speed * np.cos(heading), case.speed * np.sin(heading), 0.0)

    # A user's own mesh is a file.
    with tempfile.TemporaryDirectory() as folder:
        options = dict(OBJECTS[case.what])
        if case.what == BRACKET:
            file = Path(folder) / "bracket.stl"
            file.write_text(stl(*bracket()))
            options |= {"object": str(file), "scale": 1.0}

        scenario = jobs.collect(
            quick=True, current=current, gust=case.gust, seed=case.seed, **options
        )
        done = run(scenario)

    # Figures.
    metrics = done.assessment.metrics
    put = metrics["put"]
    grip = metrics["grip"]
    load = metrics["load"]
    identified = load["identified_kg"]

    # The end.
    ended = metrics["run"]["abort"]
    return CollectRow(
        accepted=metrics["accepted"],
        in_basket=put["in_basket"],
        dropped=ended == "dropped",
        ended=ended or metrics["run"]["state"],
        note=done.recording.final.note,
        put=put["put_error_m"],
        grip_peak=grip["force_max_n"],
        slip=grip["slip_max_m"],
        excursion=load["hull_excursion_max_m"],
        weight=load["weight_n"],
        mass=load["mass_kg"],
        mass_error=None if identified is None else abs(identified - load["mass_kg"]),
        failed=list(done.assessment.failed),
    )


def bracket() -> tuple[Array, np.ndarray]:
    """Vertices (12, 3) [m] and triangles (20, 3) of the angle, about its middle."""
    count = len(ANGLE)
    # Both ends, and the sides between them.
    low, high = (np.column_stack([ANGLE, np.full(count, z)]) for z in (0.0, LENGTH))
    faces = np.array(_FACES)
    sides = [
        triangle
        for i in range(count)
        for j in [(i + 1) % count]
        for triangle in ((i, j, count + j), (i, count + j, count + i))
    ]

    vertices = np.vstack([low, high])
    triangles = np.vstack([faces[:, ::-1], faces + count, np.array(sides)])
    return vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)), triangles


def stl(vertices: Array, triangles: np.ndarray) -> str:
    """A mesh as the text of an STL file."""
    lines = ["solid part"]
    for corners in vertices[triangles]:
        lines.append("facet normal 0 0 0\nouter loop")
        lines += [f"vertex {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
        lines.append("endloop\nendfacet")
    return "\n".join([*lines, "endsolid part\n"])


collect.page = (
    Page()
    .share("in_basket")
    .share("dropped")
    .table(
        "Put into the basket",
        by="what",
        columns=[
            stat("share", "accepted"),
            stat("largest", "put"),
            stat("largest", "slip"),
            stat("largest", "grip_peak"),
            stat("largest", "excursion"),
        ],
    )
    .table(
        "Mass as identified after the lift",
        by="what",
        columns=["mass", "weight", stat("mean", "mass_error"), stat("largest", "mass_error")],
    )
)

if __name__ == "__main__":
    run_scenario(collect.main)
