"""Identification of unseen objects against other libraries, on the same pixels.

    # ours alone
    BENCHMARK=scripts/experiments/identification/unseen/unseen_peers.py
    ./uvw run $BENCHMARK

    # with the peers
    PEERS=scripts/experiments/identification/peers_requirements.txt
    ./uvw run --extra open3d --with-requirements $PEERS $BENCHMARK

The scenes are those of `unseen` with the object present; its position is known within 0.3 m, its
attitude is not. Ours begins at the depth frame. The peers get the points with normals that our
segmentation assigns to the object, cropped and thinned as ours are; where it leaves none, all
points where the object could be. ICP alone, and small_gicp, also start from the true position with
an attitude 25 deg off the truth: a help that the others do not get.

A pose is found within 5 mm plus 0.3 % of the range and 3 deg, modulo the geometric symmetry of the
shape. Times are processor times, comparable with --workers 1 only; what a method prepares once for
a model is counted apart. Ours counts its own segmentation and check.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from experiments.identification.registration_peers import PEERS, Model, RegistrationTask
from experiments.identification.scene_cases import identified, timed
from experiments.identification.unseen.judge import pose_error
from experiments.identification.unseen.scenes import UnseenCase, UnseenScene, build, present
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.declaration import vars_of
from uuv.experiment.options import at_least
from uuv.perception.clouds.scan import near_any, without_flying_pixels
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.identification import APPROACH_ERROR, Identification
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points

OURS = "ours"
OFF = radians(25.0)  # [rad] of the start that some peers are given from the truth


@dataclass(frozen=True, kw_only=True)
class PeerScenes:
    """Scenes and peers."""

    present: int = 300
    """Number of scenes."""
    peers: tuple[str, ...] = tuple(PEERS)
    """Names of peers; those whose package is not installed are left out."""
    seed: int = 0
    """Seed of all scenes."""

    def __post_init__(self) -> None:
        at_least(self, present=1, seed=0)
        for name in self.peers:
            if name not in PEERS:
                raise ConfigurationError(f"--peers: no peer {name!r}; there are {', '.join(PEERS)}")


@dataclass(frozen=True, kw_only=True)
class UnseenPeerCase(UnseenCase):
    """One scene for all methods."""

    peers: tuple[str, ...]  # names in PEERS


@dataclass(frozen=True, kw_only=True)
class UnseenPeerRow:
    """Errors and times of all methods on one scene."""

    segmented: bool = column("the segmentation leaves points")
    accepted: bool = column("accepted by ours")
    found: Mapping[str, bool] = column("found", by="method")
    position: Mapping[str, float] = column("position", "mm", digits=2, factor=1e3, by="method")
    angle: Mapping[str, float] = column("angle", "deg", digits=2, factor=degrees(1.0), by="method")
    time: Mapping[str, float | None] = column(
        "time", "ms", digits=0, factor=1e3, tolerance=None, by="method"
    )
    model_time: Mapping[str, float | None] = column(
        "model", "ms", digits=0, factor=1e3, tolerance=None, by="method"
    )
    error: Mapping[str, str] = column("error raised", by="method")


def cases(scenes: PeerScenes) -> Iterator[UnseenPeerCase]:
    """The scenes, with the peers that are installed."""
    installed = tuple(name for name in scenes.peers if not PEERS[name].missing)
    for k in range(scenes.present):
        yield UnseenPeerCase(**vars_of(present(scenes.seed, k)), peers=installed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """What a method makes of a scene; if it raises an error, it has found nothing."""

    X_ST: Array  # (4, 4)
    time: float | None  # [s]
    model_time: float | None  # [s] of what is prepared once for a model
    error: str = ""


@experiment("unseen_peers", cases=cases, quick={"present": 2})
def unseen_peers(case: UnseenPeerCase) -> UnseenPeerRow:
    """Runs all methods on one scene."""
    scene = build(case)
    model_time, surface = timed(lambda: ModelSurface.of(scene.target))
    time, verdict = timed(lambda: identified(scene, surface, "place"))

    task = task_of(scene, surface, verdict)
    attempts = {
        OURS: Attempt(X_ST=verdict.X_sensor_target, time=time, model_time=model_time),
        **{PEERS[name].title: attempt(name, task) for name in case.peers},
    }
    errors = {name: pose_error(scene, entry.X_ST) for name, entry in attempts.items()}

    return UnseenPeerRow(
        segmented=verdict.evidence is not None,
        accepted=verdict.accepted,
        found={name: error.found for name, error in errors.items()},
        position={name: error.position_m for name, error in errors.items()},
        angle={name: radians(error.angle_deg) for name, error in errors.items()},
        time={name: entry.time for name, entry in attempts.items()},
        model_time={name: entry.model_time for name, entry in attempts.items()},
        error={name: entry.error for name, entry in attempts.items()},
    )


def task_of(scene: UnseenScene, surface: ModelSurface, verdict: Identification) -> RegistrationTask:
    """What the peers get of a scene, with the points that our identification assigns to the object.

    Args:
        scene: The scene.
        surface: Surface model of its target.
        verdict: Our identification.
    """
    evidence = verdict.evidence
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


def attempt(name: str, task: RegistrationTask) -> Attempt:
    """What a peer makes of a scene.

    Args:
        name: In PEERS.
        task: What it gets of the scene.
    """
    peer = PEERS[name]
    model_time: float | None = None

    try:
        peer.load()
        model_time, prepared = timed(lambda: peer.prepare(task.model))
        time, X_ST = timed(lambda: peer.register(task, prepared))
    except Exception as error:  # each library has its own
        words = f"{type(error).__name__}: {error}"
        return Attempt(X_ST=np.eye(4), time=None, model_time=model_time, error=words)
    return Attempt(X_ST=X_ST, time=time, model_time=model_time)


def left_out(rows: list[Row]) -> list[str]:
    """Lines about peers that do not take part."""
    return [
        f"left out: {peer.title}, not installed: {', '.join(peer.missing)}"
        for name, peer in PEERS.items()
        if peer.missing and name not in rows[0]["peers"]
    ]


def accepts(rows: list[Row]) -> str:
    """Line about the verdicts of ours."""
    right = [row for row in rows if row["found"][OURS]]
    accepted = sum(row["accepted"] for row in right)
    others = sum(row["accepted"] for row in rows) - accepted
    return f"ours: {accepted} of {len(right)} found poses accepted, {others} others"


unseen_peers.page = (
    Page()
    .table(
        "Poses found, and time",
        by="method",
        columns=[
            stat("share", "found"),
            stat(
                "median",
                lambda row: 1e3 * row["position"] if row["found"] else None,
                "error of those found, median",
                unit="mm",
                digits=2,
            ),
            stat(
                "median",
                lambda row: degrees(row["angle"]) if row["found"] else None,
                "angle",
                unit="deg",
                digits=2,
            ),
            stat("median", "time"),
            stat("p95", "time"),
            stat("median", "model_time", "once for a model"),
            stat("count", "error"),
        ],
    )
    .table("Found, by occlusion", by="method", across="hidden", columns=[stat("share", "found")])
    .table("Found, by sensor", by="method", across="sensor", columns=[stat("share", "found")])
    .table("Found, by shape", by="method", across="kind", columns=[stat("count", "found")])
    .add(left_out)
    .add(accepts)
    .share("segmented")
)

if __name__ == "__main__":
    run_scenario(unseen_peers.main)
