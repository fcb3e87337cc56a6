"""Recall, accepts and false accepts of identification on objects that no code was tuned on.

Shapes and scenes are drawn by a seeded grammar (`experiments.identification.unseen`): ten classes
of shape, three of occlusion, clutter, touching neighbours and piles, three kinds of depth noise and
a sonar. A pose is found within 5 mm plus 0.3 % of the range and 3 deg, modulo the geometric
symmetry of the shape. A false accept is an accepted pose that is not found, or any accepted pose
where the object is absent, another one, mirrored, or 5 % larger or smaller.

Times are processor times, comparable with --workers 1 only.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import chi2

from experiments.identification.scene_cases import Start, identified, timed
from experiments.identification.unseen.judge import (
    RIVAL_GAIN,
    SIZED,
    TELLING,
    ViewOfObject,
    pose_error,
)
from experiments.identification.unseen.pictures import gallery, recall_chart
from experiments.identification.unseen.scenes import (
    PILE,
    UnseenCase,
    UnseenScene,
    build,
    piled,
    present,
    wrong,
)
from uuv.experiment import Page, Row, Table, column, experiment, stat
from uuv.experiment.declaration import vars_of
from uuv.experiment.options import at_least
from uuv.perception.registration.fine_fit import ModelSurface
from uuv.perception.registration.identification import Identification
from uuv.perception.registration.pose_check import Decision
from uuv.perception.registration.recognition import identify_together
from uuv.sim.interfaces.errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Record = Mapping[str, Any]
_THERE = ("present", "pile")  # contents of a scene in which the object can be found
_SMALL, _FAR = 0.4, 1.5  # [m] extent, range: bounds of two lines of a table
_SHOWN = 10  # scenes in the picture: one of each class
_TITLES = {"present": "object present", "pile": "pile of five"}
_KNOWN = {
    "coarse": "position within 0.3 m and attitude within 45 deg",
    "place": "position within 0.3 m",
    "any": "nothing",
}


@dataclass(frozen=True, kw_only=True)
class UnseenScenes:
    """How many scenes of each kind, and what is known of them."""

    present: int = 300
    """Number of scenes with the object present."""
    wrong: int = 100
    """Number of scenes where it is absent, another object of its class, mirrored or resized, in
    turn.
    """
    piles: int = 0
    """Number of piles of five touching objects, which are searched for together; of the start only
    the position.
    """
    sonar: int = 0
    """Number of scenes with the object present that a sonar sees."""
    start: Start = "place"
    """Prior knowledge: position within 0.3 m and attitude within 45 deg (coarse), position only
    (place), or none (any).
    """
    seed: int = 0
    """Seed of all scenes."""

    def __post_init__(self) -> None:
        at_least(self, present=0, wrong=0, piles=0, sonar=0, seed=0)
        if not any((self.present, self.wrong, self.piles, self.sonar)):
            raise ConfigurationError(
                "no scenes: one of --present, --wrong, --piles and --sonar must be positive"
            )


@dataclass(frozen=True, kw_only=True)
class UnseenTrial(UnseenCase):
    """One identification."""

    known: Start  # beforehand, as `UnseenScenes.start`


@dataclass(frozen=True, kw_only=True)
class UnseenTruth:
    """The scene, and what its view can tell."""

    shape: str = column("shape")
    range_m: float = column("range", "m")
    extent_m: float = column("extent", "m")
    hidden_share: float = column("hidden share", "%", digits=0, factor=100.0)
    pixels: int = column("pixels of the object")
    declared: bool = column("symmetry declared")
    symmetric: bool = column("symmetric")
    sigma_mm: float | None = column("bound of the position", "mm", digits=2)
    sigma_deg: float | None = column("bound of the attitude", "deg", digits=2)
    size_sigma: float | None = column("bound of the size", "%", digits=2, factor=100.0)
    rival_nats: float = column("gain over the best rival", "nat")
    shown: bool = column("the view shows the pose")


@dataclass(frozen=True, kw_only=True)
class UnseenRow(UnseenTruth):
    """What identification makes of a scene."""

    contradicted: float = column("contradicted share of the view", "%", digits=1, factor=100.0)
    mirror_share: float = column("share in which the mirror image differs", "%", factor=100.0)
    position_m: float = column("position", "mm", digits=2, factor=1e3)
    angle_deg: float = column("angle", "deg", digits=2)
    found: bool = column("found")
    nees: float | None = column("squared error over the covariance")
    nees_degrees: int | None = column("its degrees of freedom")
    decision: str = column("decision")
    reason: str = column("reason")
    scene_s: float = column("time of the scene", "s", tolerance=None)
    model_s: float = column("time of the model", "ms", digits=0, factor=1e3, tolerance=None)
    identify_s: float = column("time", "ms", digits=0, factor=1e3, tolerance=None)


def trials(scenes: UnseenScenes) -> Iterator[UnseenTrial]:
    """Scenes with the object, wrong ones, piles, and those of a sonar."""
    seed = scenes.seed
    for case in (
        *(present(seed, k) for k in range(scenes.present)),
        *(wrong(seed, k) for k in range(scenes.wrong)),
        *(piled(seed, k) for k in range(PILE * scenes.piles)),
        *(present(seed, k, "sonar") for k in range(scenes.sonar)),
    ):
        yield UnseenTrial(**vars_of(case), known=scenes.start)


@experiment("unseen", cases=trials, quick={"present": 4, "wrong": 4})
def unseen(case: UnseenTrial) -> UnseenRow:
    """Identifies the object of a scene, and judges the result by the truth."""
    scene_s, scene = timed(lambda: build(case))
    model_s, surface = timed(lambda: ModelSurface.of(scene.target))

    # The objects of a pile are sought together.
    if case.content == "pile":
        verdict, identify_s = _of_pile(replace(case, member=0))[case.member]
    else:
        identify_s, verdict = timed(lambda: identified(scene, surface, case.known))

    # Judged by the truth.
    X_CT = verdict.X_sensor_target
    error = pose_error(scene, X_CT)
    view = ViewOfObject(scene)
    right = case.content in _THERE and error.found
    contradicted = view.contradicted(X_CT)
    mirror_share = view.mirror_share() if case.content == "mirrored" else 1.0
    nees, degrees = _squared_error(verdict, scene) if right else (None, None)

    return UnseenRow(
        **vars_of(_truth(scene, view)),
        contradicted=contradicted,
        mirror_share=min(mirror_share, contradicted) if case.content == "mirrored" else 1.0,
        position_m=error.position_m,
        angle_deg=error.angle_deg,
        found=right,
        nees=nees,
        nees_degrees=degrees,
        decision=str(verdict.decision),
        reason=verdict.reason,
        scene_s=scene_s,
        model_s=model_s,
        identify_s=identify_s,
    )


def _truth(scene: UnseenScene, view: ViewOfObject) -> UnseenTruth:
    """The truth about a scene, and what its view can tell."""
    sensor, symmetry = scene.sensor.model, scene.likeness.symmetry
    bounds = view.bounds(sensor) if scene.there is not None else None
    rival_nats = view.rival_nats(sensor) if scene.case.content in _THERE else np.inf

    return UnseenTruth(
        shape=scene.shape.kind,
        range_m=scene.range_m,
        extent_m=scene.shape.extent,
        hidden_share=scene.hidden,
        pixels=int(scene.seen.sum()),
        declared=scene.declared,
        symmetric=symmetry.axis is not None or len(symmetry.rotations) > 1,
        sigma_mm=None if bounds is None else 1e3 * bounds.position_m,
        sigma_deg=None if bounds is None else bounds.angle_deg,
        size_sigma=None if bounds is None else bounds.size,
        rival_nats=rival_nats,
        shown=bounds is not None and bounds.shows_pose(scene.range_m) and rival_nats >= RIVAL_GAIN,
    )


@lru_cache(maxsize=1)  # its members are cases in a row
def _of_pile(first: UnseenTrial) -> list[tuple[Identification, float]]:
    """Result of each object of a pile, all of them sought together, and its share of the processor
    time [s].
    """
    scenes = {str(k): build(replace(first, member=k)) for k in range(PILE)}
    scene = scenes["0"]

    def together() -> Mapping[str, Identification]:
        surfaces = {k: ModelSurface.of(member.target) for k, member in scenes.items()}
        known = {} if first.known == "any" else {k: s.approach for k, s in scenes.items()}
        return identify_together(scene.scan, surfaces, known, sensor=scene.sensor.model)

    spent, verdicts = timed(together)
    return [(verdicts[k], spent / PILE) for k in scenes]


def _squared_error(verdict: Identification, scene: UnseenScene) -> tuple[float | None, int | None]:
    """Normalised squared error of a right pose over its covariance, and its degrees of freedom;
    None without one.
    """
    if verdict.covariance is None:
        return None, None

    X_CT = scene.likeness.symmetry.nearest_pose(scene.X_CT, verdict.X_sensor_target[:3, :3])
    nees = verdict.covariance.normalised_error(verdict.X_sensor_target, X_CT)
    return nees, verdict.covariance.degrees


def line(row: Record) -> str:
    """Line about a scene that went wrong; empty for others."""
    accepted = row["decision"] == Decision.ACCEPT
    if (accepted and row["found"]) if row["content"] in _THERE else not accepted:
        return ""

    reason = f": {row['reason']}" if row["reason"] else ""
    return (
        f"{row['content']} {row['index']}, {row['shape']}, {row['around']}, {row['sensor']}, "
        f"hidden {row['hidden_share']:.2f}: {1e3 * row['position_m']:.0f} mm, "
        f"{row['angle_deg']:.0f} deg, {row['decision']}{reason}"
    )


def is_false_accept(row: Record) -> bool:
    """Whether the verdict accepts a wrong pose, or something else in the object's place."""
    return row["decision"] == Decision.ACCEPT and not row["found"]


def by_sonar(row: Record) -> bool:
    """Whether a sonar sees the scene."""
    return row["sensor"] == "sonar"


def shows_object(row: Record) -> bool:
    """Whether the object is there, alone or with neighbours, before a camera."""
    return row["content"] == "present" and not by_sonar(row)


def outcome(row: Record) -> str:
    """Kind of scene and pose in the table of verdicts."""
    content = row["content"]

    if content in _THERE:
        return f"{_TITLES[content]}, {'found' if row['found'] else 'not found'}"
    if content == "mirrored":
        sign = ">=" if row["mirror_share"] >= TELLING else "<"
        return f"mirrored, {sign} {100 * TELLING:.0f} % of the view differ"
    if content == "resized":
        sigma = row["size_sigma"]
        sign = "<" if sigma is not None and sigma < SIZED else ">="
        return f"resized, sigma of size {sign} {100 * SIZED:.1f} %"
    return {"absent": "absent", "other": "another object of the class"}[content]


def known_beforehand(rows: list[Row]) -> list[str]:
    """Lines about what identification knew of the scenes."""
    counts = {known: sum(row["known"] == known for row in rows) for known in _KNOWN}
    return [f"known of {n} scenes: {_KNOWN[known]}" for known, n in counts.items() if n]


def recall_by_condition(rows: list[Row]) -> list[Table]:
    """Table of the scenes with the object by conditions that overlap."""
    conditions: Mapping[str, Callable[[Record], bool]] = {
        f"smaller than {_SMALL} m": lambda row: row["extent_m"] < _SMALL,
        f"farther than {_FAR} m": lambda row: row["range_m"] > _FAR,
        "no symmetry": lambda row: not row["symmetric"],
        "symmetry declared": lambda row: row["symmetric"] and row["declared"],
        "symmetry not declared": lambda row: row["symmetric"] and not row["declared"],
        "the view shows the pose": lambda row: row["shown"],
        "the view does not show it": lambda row: not row["shown"],
    }
    parts = {
        condition: [row for row in rows if shows_object(row) and meets(row)]
        for condition, meets in conditions.items()
    }

    figures = [figure.bound_to(unseen.columns, "recall") for figure in FIGURES]
    lines = [
        (condition, *(figure.cell(part) for figure in figures))
        for condition, part in parts.items()
        if part
    ]
    headings = [figure.heading for figure in figures]
    title = "Object present, by what may matter"
    return [Table(title=title, columns=("condition", *headings), rows=lines)] if lines else []


def confusion(rows: Sequence[Record]) -> dict[str, dict[str, int]]:
    """Number of verdicts by kind of scene and pose."""
    table: dict[str, dict[str, int]] = {}
    for row in sorted(rows, key=outcome):
        counts = table.setdefault(outcome(row), {str(d): 0 for d in Decision})
        counts[row["decision"]] += 1
    return table


def verdicts(rows: list[Row]) -> list[Any]:
    """Tables of the verdicts by cameras and by a sonar, and lines about the false accepts."""
    parts = {
        "Verdicts": [row for row in rows if not by_sonar(row)],
        "Verdicts, sonar": [row for row in rows if by_sonar(row)],
    }
    items: list[Any] = []
    for title, part in parts.items():
        table = confusion(part)
        items.append({title: table})
        if part:
            decisions = [str(d) for d in Decision]
            cells = [(name, *(str(n) for n in counts.values())) for name, counts in table.items()]
            items.append(Table(title=title, columns=("scene and pose", *decisions), rows=cells))

    items += [f"false accept: {line(row)}" for row in parts["Verdicts"] if is_false_accept(row)]
    return items


def consistency(rows: Sequence[Record]) -> dict[str, float]:
    """Whether the errors of found poses are as their covariance says: chi-square with its degrees
    of freedom.
    """
    pairs = [(row["nees"], row["nees_degrees"]) for row in rows if row["nees"] is not None]
    if not pairs:
        return {"poses": 0}

    nees, degrees = np.array(pairs).T
    return {
        "poses": len(nees),
        "nees_mean": float(nees.sum() / degrees.sum()),
        "nees_median": float(np.median(nees / chi2.median(degrees))),
        "covered_percent": 100.0 * float(np.mean(nees < chi2.ppf(0.95, degrees))),
    }


def covariances(rows: list[Row]) -> list[Any]:
    """Consistency of the covariances of poses found by cameras, as figures and a line."""
    figures = consistency([row for row in rows if not by_sonar(row)])
    if not figures["poses"]:
        return []

    return [
        {"covariance": figures},
        f"covariance of {figures['poses']} poses found: NEES per degree of freedom "
        f"{figures['nees_mean']:.2f} (1 is consistent), median over that of the distribution "
        f"{figures['nees_median']:.2f}; {figures['covered_percent']:.0f} % within the 95 % "
        "ellipsoid",
    ]


def pictures(rows: list[Row]) -> "list[tuple[str, str, Figure]]":
    """What became of the scenes with the object, and the first of them."""
    some = [row for row in rows if shows_object(row)]
    if not some:
        return []
    scenes = gallery([case_of(row) for row in some[:_SHOWN]])
    return [
        ("Recall", "Scenes with the object, by shape and occlusion.", recall_chart(some)),
        ("Scenes", "The object in colour, and the depth that the sensor reads.", scenes),
    ]


def case_of(row: Row) -> UnseenCase:
    """The case of a row: its scene, drawn from a file or by its seed."""
    values = {entry.name: row[entry.name] for entry in fields(UnseenCase)}
    return UnseenCase(**{**values, "streams": tuple(map(tuple, row["streams"]))})


FIGURES = [
    stat("share", "found", digits=0),
    stat(
        "share",
        lambda row: row["decision"] == Decision.ACCEPT if row["found"] else None,
        "accepted of those found",
        digits=0,
    ),
    stat("count", is_false_accept, "false accepts"),
    stat(
        "median",
        lambda row: 1e3 * row["position_m"] if row["found"] else None,
        "error of those found, median",
        unit="mm",
        digits=2,
    ),
    stat(
        "median",
        lambda row: row["angle_deg"] if row["found"] else None,
        "angle",
        unit="deg",
        digits=2,
    ),
    stat("median", "identify_s"),
    stat("p95", "identify_s"),
]
unseen.line = line
unseen.page = (
    Page()
    .table("Object present", by="hidden", columns=FIGURES, where=shows_object, total=True)
    .table("Object present, by sensor", by="sensor", columns=FIGURES, where=shows_object)
    .table("Object present, by surroundings", by="around", columns=FIGURES, where=shows_object)
    .table("Object present, by shape", by="shape", columns=FIGURES, where=shows_object)
    .add(recall_by_condition)
    .table("Seen by a sonar", by="shape", columns=FIGURES, where=by_sonar, total=True)
    .table(
        "Piles of five",
        by="shape",
        columns=FIGURES,
        where=lambda row: row["content"] == "pile",
        total=True,
    )
    .table(
        "Processor times",
        by="sensor",
        columns=[stat("mean", "scene_s"), stat("median", "model_s"), stat("median", "identify_s")],
    )
    .add(verdicts)
    .add(known_beforehand)
    .share(is_false_accept, "false accepts, by cameras", where=lambda row: not by_sonar(row))
    .add(covariances)
    .add(pictures)
)

if __name__ == "__main__":
    run_scenario(unseen.main)
