"""Benchmark: identification of unseen objects against other libraries, on the same pixels.

    # ours alone
    BENCHMARK=scripts/experiments/identification/unseen/unseen_peers.py
    ./uvw run $BENCHMARK

    # with the peers
    PEERS=scripts/experiments/identification/peers_requirements.txt
    ./uvw run --extra open3d --with-requirements $PEERS $BENCHMARK

The scenes are those of the study of unseen objects with the object present; its position is known
within 0.3 m, its attitude is not. Ours begins at the depth frame. The peers get the points with
normals that our segmentation assigns to the object, cropped and thinned as ours are; where it
leaves none, all points where the object could be. ICP alone, and small_gicp, also start from the
true position with an attitude 25 deg off the truth: a help that the others do not get.

A pose is found within 5 mm plus 0.3 % of the range and 3 deg, modulo the geometric symmetry of the
shape. Times are processor times; what a method prepares once for a model is counted apart. Ours
counts its own segmentation and check.
"""

from uuv.start import parse, run_scenario  # isort: skip

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from experiments.identification.registration_peers import PEERS, Model, RegistrationTask
from experiments.identification.unseen.judge import pose_error
from experiments.identification.unseen.scenes import UnseenCase, UnseenScene, build, present
from uuv.experiment import Row, Study, StudyOptions, Summary, Table
from uuv.experiment.options import at_least
from uuv.perception.clouds.scan import near_any, without_flying_pixels
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.identification import APPROACH_ERROR, Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points

OURS = "ours"
OFF = np.deg2rad(25.0)  # [rad] of the start that some peers are given from the truth
GROUPS = {
    "hidden_class": "hidden: {}",
    "sensor": "sensor: {}",
    "kind": "{}",
}  # columns of the tables, by entry of a row


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Scenes and peers."""

    runs: int = 300
    """Number of scenes."""
    peers: tuple[str, ...] = tuple(PEERS)
    """Names of peers; those whose package is not installed are left out."""
    workers: int = 1
    """Number of processes; 0: one for each core, 1: this one.

    Computing times are comparable with 1 only.
    """

    def __post_init__(self) -> None:
        at_least(self, runs=1, workers=0)
        for name in self.peers:
            if name not in PEERS:
                raise ConfigurationError(f"--peers: no peer {name!r}; there are {', '.join(PEERS)}")


@dataclass(frozen=True, slots=True)
class PeerCase:
    """One scene for all methods; a case of the benchmark."""

    scene: UnseenCase
    peers: tuple[str, ...]  # names in PEERS


def run(case: PeerCase) -> Row:
    """Errors and times of all methods on one scene."""
    scene = build(case.scene)

    model_s, surface = _timed(lambda: ModelSurface.of(scene.target))
    find_s, found = _timed(
        lambda: identify(scene.scan, surface, scene.approach, sensor=scene.sensor.model)
    )

    ours = {
        **_judged(scene, found.X_sensor_target),
        "model_s": model_s,
        "find_s": find_s,
        "error": "",
    }

    task = task_of(scene, surface, found)
    methods = {OURS: ours, **{name: _raced(name, scene, task) for name in case.peers}}

    return {
        "kind": scene.shape.kind,
        "hidden_class": case.scene.hidden,
        "sensor": case.scene.sensor,
        "index": case.scene.index,
        "segmented": found.evidence is not None,
        "accepted": found.accepted,
        "methods": methods,
    }


def task_of(scene: UnseenScene, surface: ModelSurface, found: Identification) -> RegistrationTask:
    """What the peers get of a scene, with the points that our identification `found` to be the
    object's.
    """
    evidence = found.evidence
    if evidence is None:
        near = near_any(scene.scan.points, scene.approach[None], surface.radius + APPROACH_ERROR)
        mask = near & without_flying_pixels(scene.scan)
        evidence = Evidence.of(scene.scan, mask, 0.8 * surface.spacing, scene.sensor.model)

    # The start of ICP alone lies OFF off the true attitude, about a random axis.
    axis = np.random.default_rng([scene.case.seed, scene.case.index, 25]).normal(size=3)
    R = scene.X_CT[:3, :3] @ exp_so3(OFF * axis / np.linalg.norm(axis))
    center = transform_points(scene.X_CT, surface.center)

    return RegistrationTask(
        points=evidence.points,
        normals=evidence.normals,
        sigma=float(np.median(evidence.sigma)),
        model=Model(
            points=surface.points,
            normals=surface.normals,
            spacing=surface.spacing,
            radius=surface.radius,
            center=surface.center,
        ),
        approach=scene.approach,
        approach_error=APPROACH_ERROR,
        X_near=pose(R, center - R @ surface.center),
        seed=scene.case.seed + scene.case.index,
    )


def _raced(name: str, scene: UnseenScene, task: RegistrationTask) -> dict[str, Any]:
    """Errors and times of a peer; if it raises an error, it has found nothing."""
    peer, error, model_s, find_s, X_ST = PEERS[name], "", np.nan, np.nan, np.eye(4)

    try:
        peer.load()
        model_s, prepared = _timed(lambda: peer.prepare(task.model))
        find_s, X_ST = _timed(lambda: peer.register(task, prepared))
    except Exception as raised:  # each library has its own
        error = f"{type(raised).__name__}: {raised}"

    return {**_judged(scene, X_ST), "model_s": model_s, "find_s": find_s, "error": error}


def _judged(scene: UnseenScene, X_ST: Array) -> dict[str, Any]:
    error = pose_error(scene, X_ST)
    return {"found": error.found, "position_m": error.position_m, "angle_deg": error.angle_deg}


def _timed(what: Callable[[], Any]) -> tuple[float, Any]:
    began = process_time()
    result = what()
    return process_time() - began, result


def summarise(rows: list[Row], left_out: Sequence[str] = ()) -> Summary:
    """Poses found by each method, by occlusion, sensor and class of shape; errors of those found,
    and times.

    Args:
        rows: Rows of all scenes.
        left_out: Lines about peers that do not take part.
    """
    metrics = {name: figures_of(rows, name) for name in rows[0]["methods"]}

    some = next(iter(metrics.values()))
    titles = {name: PEERS[name].title if name in PEERS else OURS for name in metrics}

    by_shape = [label for label in some["found_of"] if ":" not in label]
    by_condition = [label for label in some["found_of"] if label not in by_shape]

    tables = [
        # All scenes, by condition.
        Table(
            title=f"Poses found of {len(rows)}, and time",
            columns=(
                "method",
                "found",
                *by_condition,
                "error [mm]",
                "[deg]",
                "time [ms]",
                "p95",
                "model [ms]",
            ),
            rows=[
                (
                    titles[name],
                    str(each["found"]),
                    *(_of(each["found_of"][label]) for label in by_condition),
                    # Errors are over found poses, times over all.
                    *(
                        _figure(each[key], digits)
                        for key, digits in (("median_mm", 2), ("median_deg", 2))
                    ),
                    *(_figure(each[key], 0) for key in ("find_ms", "find_p95_ms", "model_ms")),
                )
                for name, each in metrics.items()
            ],
            caption="Errors and times are medians, errors those of found poses; model: prepared "
            "once for each.",
        ),
        # By class of shape.
        Table(
            title="Poses found, by class of shape",
            columns=("method", *by_shape),
            rows=[
                (titles[name], *(_of(each["found_of"][label]) for label in by_shape))
                for name, each in metrics.items()
            ],
        ),
    ]

    found = [row for row in rows if row["methods"][OURS]["found"]]
    lines = [
        *left_out,
        f"ours: {sum(row['accepted'] for row in found)} of {len(found)} found poses accepted, "
        f"{sum(row['accepted'] for row in rows) - sum(row['accepted'] for row in found)} others",
        f"scenes whose segmentation leaves no points: {sum(not row['segmented'] for row in rows)}",
        *(
            f"{titles[name]}: {each['errors']} errors raised"
            for name, each in metrics.items()
            if each["errors"]
        ),
    ]

    return Summary(metrics={"scenes": len(rows), "methods": metrics}, tables=tables, lines=lines)


def figures_of(rows: Sequence[Row], name: str) -> dict[str, Any]:
    """Figures of the method `name` over the scenes."""
    of = [row["methods"][name] for row in rows]
    found = [each for each in of if each["found"]]

    def median(some: Sequence[Row], key: str) -> float:
        values = [each[key] for each in some if each[key] is not None]
        return float(np.median(values)) if values else np.nan

    times = [each["find_s"] for each in of if each["find_s"] is not None]

    return {
        "found": len(found),
        "found_of": {
            label: [sum(row["methods"][name]["found"] for row in some), len(some)]
            for label, some in _parts(rows)
        },
        "median_mm": 1e3 * median(found, "position_m"),
        "median_deg": median(found, "angle_deg"),
        "find_ms": 1e3 * median(of, "find_s"),
        "find_p95_ms": 1e3 * float(np.quantile(times, 0.95)) if times else np.nan,
        "model_ms": 1e3 * median(of, "model_s"),
        "errors": sum(bool(each["error"]) for each in of),
    }


def _parts(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Rows by occlusion, sensor and class of shape, with the columns' names."""
    for key, label in GROUPS.items():
        for value in dict.fromkeys(row[key] for row in rows):
            yield label.format(value), [row for row in rows if row[key] == value]


def _of(counts: Sequence[int]) -> str:
    return f"{counts[0]}/{counts[1]}"


def _figure(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def main() -> int:
    """Runs or resumes the benchmark and returns the exit code."""
    options = parse(Options)
    there = tuple(name for name in options.peers if not PEERS[name].missing)
    left_out = [
        f"left out: {PEERS[name].title}, not installed: {', '.join(PEERS[name].missing)}"
        for name in options.peers
        if name not in there
    ]
    cases = [PeerCase(present(options.seed, k), there) for k in range(options.runs)]
    study = Study(cases=cases, run_one=run, summarise=partial(summarise, left_out=left_out))
    return study.carry_out(
        "bench_unseen_peers", options, "Unseen objects: ours and other libraries"
    )


if __name__ == "__main__":
    run_scenario(main)
