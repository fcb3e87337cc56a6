"""Study of identification on unseen objects: one scene, and recall, accepts and false accepts over
many.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from time import process_time
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.stats import chi2

from experiments.identification.unseen.judge import (
    RIVAL_GAIN,
    SIZED,
    TELLING,
    ViewOfObject,
    pose_error,
)
from experiments.identification.unseen.pictures import gallery, recall_chart
from experiments.identification.unseen.scenes import PILE, UnseenCase, UnseenScene, build, present
from uuv.experiment import Row, Summary, Table
from uuv.perception.registration.fine_fit import ModelSurface
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.pose_check import Decision
from uuv.perception.registration.recognition import identify_together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Known = Literal["coarse", "place", "any"]
_THERE = ("present", "pile")  # contents of a scene in which the object can be found
_SMALL, _FAR = 0.4, 1.5  # [m] extent, range: bounds of two lines of the table
_SHOWN = 10  # scenes in the report's picture: one of each class
_TITLES = {"present": "object present", "pile": "pile of five"}


@dataclass(frozen=True, slots=True)
class UnseenTrial:
    """One identification; a case of the study."""

    scene: UnseenCase
    # beforehand: position within 0.3 m and attitude within 45 deg (coarse), position only, or
    # nothing
    known: Known


def run(trial: UnseenTrial) -> Row:
    """Row of one scene: truth, what its view can tell, errors, verdict and computing times."""
    case, known = trial.scene, trial.known
    began = process_time()
    scene = build(case)
    built = process_time()
    surface = ModelSurface.of(scene.target)
    prepared = process_time()

    if case.content == "pile":
        # The objects of a pile are sought together.
        found, spent = _of_pile(replace(case, member=0), known)[case.member]
    else:
        found = identify(
            scene.scan,
            surface,
            scene.approach if known != "any" else None,
            scene.orientation if known == "coarse" else None,
            sensor=scene.sensor.model,
        )
        spent = process_time() - prepared

    # Judged by the truth: errors, and what the view can tell at all.
    error = pose_error(scene, found.X_sensor_target)
    view = ViewOfObject(scene)
    there = case.content in _THERE
    contradicted = view.contradicted(found.X_sensor_target)
    bounds = view.bounds(scene.sensor.model) if scene.there is not None else None
    rival_nats = view.rival_nats(scene.sensor.model) if there else np.inf

    return {
        # The scene.
        "content": case.content,
        "kind": scene.shape.kind,
        "hidden_class": case.hidden,
        "sensor": case.sensor,
        "around": case.around,
        "index": case.index,
        "member": case.member,
        "seed": case.seed,
        "range_m": scene.range_m,
        "extent_m": scene.shape.extent,
        "hidden": scene.hidden,
        "pixels": int(scene.seen.sum()),
        "declared": scene.declared,
        "symmetric": scene.likeness.symmetry.axis is not None
        or len(scene.likeness.symmetry.rotations) > 1,
        # What its view tells.
        "sigma_mm": None if bounds is None else 1e3 * bounds.position_m,
        "sigma_deg": None if bounds is None else bounds.angle_deg,
        "size_sigma": None if bounds is None else bounds.size,
        "shown": bounds is not None
        and bounds.shows_pose(scene.range_m)
        and rival_nats >= RIVAL_GAIN,
        "contradicted": contradicted,
        "rival_nats": rival_nats,
        "mirror_share": min(view.mirror_share(), contradicted)
        if case.content == "mirrored"
        else 1.0,
        # The result of identification.
        "position_m": error.position_m,
        "angle_deg": error.angle_deg,
        "found": bool(there and error.found),
        **_doubt(found, scene, bool(there and error.found)),
        "decision": str(found.decision),
        "reason": found.reason,
        # Processor times.
        "scene_s": built - began,
        "model_s": prepared - built,
        "identify_s": spent,
    }


@lru_cache(maxsize=1)  # its members are cases in a row
def _of_pile(first: UnseenCase, known: Known) -> list[tuple[Identification, float]]:
    """Result of each object of a pile, all of them sought together, and its share of the processor
    time [s].
    """
    scenes = [build(replace(first, member=k)) for k in range(PILE)]

    began = process_time()
    surfaces = {str(k): ModelSurface.of(scene.target) for k, scene in enumerate(scenes)}
    approaches = (
        {} if known == "any" else {str(k): scene.approach for k, scene in enumerate(scenes)}
    )

    found = identify_together(scenes[0].scan, surfaces, approaches, sensor=scenes[0].sensor.model)
    spent = (process_time() - began) / PILE

    return [(found[str(k)], spent) for k in range(PILE)]


def _doubt(found: Identification, scene: UnseenScene, right: bool) -> Row:
    """Normalised squared error of a right pose over its covariance, and its degrees of freedom;
    None without one.
    """
    if not right or found.covariance is None:
        return {"nees": None, "nees_degrees": None}

    X_CT = scene.likeness.symmetry.nearest_pose(scene.X_CT, found.X_sensor_target[:3, :3])
    nees = found.covariance.normalised_error(found.X_sensor_target, X_CT)
    return {"nees": nees, "nees_degrees": found.covariance.degrees}


def line(row: Row) -> str:
    """Line about a scene that went wrong; empty for others."""
    if row["content"] in _THERE:
        if row["found"] and row["decision"] == Decision.ACCEPT:
            return ""
    elif row["decision"] != Decision.ACCEPT:
        return ""

    reason = f": {row['reason']}" if row["reason"] else ""
    return (
        f"{row['content']} {row['index']}, {row['kind']}, {row['around']}, {row['sensor']}, "
        f"hidden {row['hidden']:.2f}: {1e3 * row['position_m']:.0f} mm, {row['angle_deg']:.0f} "
        f"deg, {row['decision']}{reason}"
    )


def is_false_accept(row: Row) -> bool:
    """Whether the verdict accepts a wrong pose, or something else in the object's place."""
    return row["decision"] == Decision.ACCEPT and not row["found"]


def outcome(row: Row) -> str:
    """Kind of scene and pose in the confusion table."""
    content = row["content"]

    if content in _THERE:
        return f"{_TITLES[content]}, {'found' if row['found'] else 'not found'}"

    if content == "mirrored":
        return (
            f"mirrored, {'>=' if row['mirror_share'] >= TELLING else '<'} {100 * TELLING:.0f} "
            "% of the view differ"
        )

    if content == "resized":
        sigma = row["size_sigma"]
        return (
            f"resized, sigma of size {'<' if sigma is not None and sigma < SIZED else '>='} "
            f"{100 * SIZED:.1f} %"
        )

    return {"absent": "absent", "other": "another object of the class"}[content]


def summarise(rows: list[Row], title: str) -> Summary:
    """Recall, accepts and false accepts by condition and class of shape, and the confusion table.

    Args:
        rows: Rows of all scenes.
        title: Title of the tables.
    """
    depth, sonar = (
        [row for row in rows if (row["sensor"] == "sonar") is by_sonar]
        for by_sonar in (False, True)
    )

    there = [row for row in depth if row["content"] == "present"]
    tables: list[Table] = []
    metrics: dict[str, Any] = {}

    for name, part in (
        ("present", there),
        ("sonar", sonar),
        ("piles", [row for row in depth if row["content"] == "pile"]),
    ):
        if part:
            metrics[name] = {
                label: figures_of(some) for label, some in _parts(part, name == "present")
            }
            tables.append(_recall_table(metrics[name], f"{name.capitalize()}: {title}"))

    metrics["confusion"] = confusion(depth)
    if depth:
        tables.append(_confusion_table(metrics["confusion"], "Verdicts"))
    if sonar:
        metrics["confusion_sonar"] = confusion(sonar)
        tables.append(_confusion_table(metrics["confusion_sonar"], "Verdicts, sonar"))

    metrics["covariance"] = doubts = consistency(depth)
    false = [row for row in depth if is_false_accept(row)]
    metrics["false_accepts"] = len(false)
    metrics["false_accept_percent"] = 100.0 * len(false) / max(1, len(depth))
    metrics["scene_s"] = float(np.mean([row["scene_s"] for row in rows]))

    said = [f"processor time of a scene {metrics['scene_s']:.2f} s (mean)"]
    if depth:
        share = metrics["false_accept_percent"]
        said.append(
            f"false accepts: {len(false)} of {len(depth)} verdicts ({share:.1f} %); sonar apart"
        )

    if doubts["poses"]:
        said.append(
            f"covariance of {doubts['poses']} poses found: squared error "
            f"{doubts['nees_mean']:.2f} of what it says "
            f"(mean), {doubts['nees_median']:.2f} (median); {doubts['covered_percent']:.0f} % "
            "within the 95 % ellipsoid"
        )

    said += [f"false accept: {line(row)}" for row in false]

    return Summary(
        metrics=metrics, tables=tables, lines=said, pictures=_pictures(there) if there else ()
    )


def _parts(rows: Sequence[Row], by_condition: bool) -> Iterator[tuple[str, list[Row]]]:
    """Rows by condition and by class, those that are there."""
    yield "all", list(rows)

    for key, label in (
        ("hidden_class", "hidden: {}"),
        ("sensor", "sensor: {}"),
        ("around", "surroundings: {}"),
        ("kind", "shape: {}"),
    ):
        if by_condition or key == "kind":
            for value in dict.fromkeys(row[key] for row in rows):
                yield label.format(value), [row for row in rows if row[key] == value]

    if by_condition:
        for label, chosen in (
            (f"smaller than {_SMALL} m", lambda row: row["extent_m"] < _SMALL),
            (f"farther than {_FAR} m", lambda row: row["range_m"] > _FAR),
            ("no symmetry", lambda row: not row["symmetric"]),
            ("symmetry declared", lambda row: row["symmetric"] and row["declared"]),
            ("symmetry not declared", lambda row: row["symmetric"] and not row["declared"]),
            ("the view shows the pose", lambda row: row["shown"]),
            ("the view does not show it", lambda row: not row["shown"]),
        ):
            if part := [row for row in rows if chosen(row)]:
                yield label, part


def figures_of(rows: Sequence[Row]) -> dict[str, float]:
    """Figures over scenes with the object present."""
    found = [row for row in rows if row["found"]]
    accepted = [row for row in found if row["decision"] == Decision.ACCEPT]

    def median(of: Sequence[Row], name: str) -> float:
        return float(np.median([row[name] for row in of])) if of else np.nan

    return {
        "scenes": len(rows),
        "found": len(found),
        "found_percent": 100.0 * len(found) / len(rows),
        "accepted": len(accepted),
        "accepted_of_found_percent": 100.0 * len(accepted) / len(found) if found else np.nan,
        "false_accepts": sum(map(is_false_accept, rows)),
        "median_mm": 1e3 * median(found, "position_m"),
        "median_deg": median(found, "angle_deg"),
        "identify_ms": 1e3 * median(rows, "identify_s"),
        "identify_p95_ms": 1e3 * float(np.quantile([row["identify_s"] for row in rows], 0.95)),
    }


def consistency(rows: Sequence[Row]) -> dict[str, float]:
    """Whether the errors of found poses are as their covariance says: chi-square with its degrees
    of freedom.
    """
    nees, degrees = (
        np.array([(row["nees"], row["nees_degrees"]) for row in rows if row["nees"] is not None])
        .reshape(-1, 2)
        .T
    )

    return {
        "poses": len(nees),
        "nees_mean": float(nees.sum() / degrees.sum()) if len(nees) else np.nan,
        "nees_median": float(np.median(nees / chi2.median(degrees))) if len(nees) else np.nan,
        "covered_percent": 100.0 * float(np.mean(nees < chi2.ppf(0.95, degrees)))
        if len(nees)
        else np.nan,
    }


def confusion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Number of verdicts by kind of scene and pose."""
    table: dict[str, dict[str, int]] = {}

    for row in sorted(rows, key=outcome):
        counts = table.setdefault(outcome(row), {str(d): 0 for d in Decision})
        counts[row["decision"]] += 1
    return table


def _recall_table(figures: Mapping[str, Mapping[str, float]], title: str) -> Table:
    columns = (
        "condition",
        "scenes",
        "found",
        "found [%]",
        "accepted of found [%]",
        "false accepts",
        "median error [mm]",
        "[deg]",
        "time: median, p95 [ms]",
    )

    rows = [
        (
            name,
            f"{f['scenes']:.0f}",
            f"{f['found']:.0f}",
            f"{f['found_percent']:.0f}",
            _or_dash(f["accepted_of_found_percent"], 0),
            f"{f['false_accepts']:.0f}",
            _or_dash(f["median_mm"], 2),
            _or_dash(f["median_deg"], 2),
            f"{f['identify_ms']:.0f}, {f['identify_p95_ms']:.0f}",
        )
        for name, f in figures.items()
    ]

    return Table(
        title=title, columns=columns, rows=rows, caption="Errors are those of found poses."
    )


def _or_dash(value: float, digits: int) -> str:
    """A figure for a table; a dash where there was nothing to take it from."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _confusion_table(table: Mapping[str, Mapping[str, int]], title: str) -> Table:
    decisions = [str(d) for d in Decision]
    rows = [(name, *(str(counts[d]) for d in decisions)) for name, counts in table.items()]
    return Table(title=title, columns=("scene and pose", *decisions), rows=rows)


def _pictures(rows: Sequence[Row]) -> Iterator[tuple[str, str, "Figure"]]:
    yield (
        "Recall",
        "Scenes with the object, by class of shape and of occlusion.",
        recall_chart(rows),
    )

    cases = [present(row["seed"], row["index"]) for row in rows[:_SHOWN]]
    yield (
        "Scenes",
        "The first of them: the object in colour, and the depth that the sensor reads.",
        gallery(cases),
    )
