"""Reconstruction of the seabed and choice of the working height on random terrains: one terrain,
summary of many.
"""

from dataclasses import dataclass
from functools import cache, partial

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from uuv.controllers.planning.path_poses import tool_poses
from uuv.controllers.planning.seabed_height import WorkHeight, arm_gap, choose_height
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.experiment import Row, Summary, Table
from uuv.models.naming import CAMERA_SITE, TOOL_GEOM
from uuv.models.site.seabed import KINDS, Seabed, seabed
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perception.seabed.seabed_finder import points_in_world
from uuv.perception.seabed.terrain_path import SeabedPlan, plan_seabed_work
from uuv.sim.interfaces.errors import PerceptionError, ReachError
from uuv.sim.interfaces.messages import SonarScan
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.sonar import Sonar, SonarBeams, SonarNoise
from uuv.tasks.seabed_sampling import (
    ABOVE,
    AHEAD,
    APART,
    LOOKS,
    height_search,
    sonar_beams,
    sonar_on_hull,
)

SWATH = sonar_beams().azimuth  # [rad] swath of the sonar, both ways
STANDOFF = 0.1  # [m] from which the tool approaches the path


def seen(
    ground: Seabed, X_WB: Array, box: Array, rng: np.random.Generator, *, beam: float, noise: float
) -> Array:
    """Echoes of LOOKS pings of the sonar under the hull.

    Args:
        ground: True terrain.
        X_WB: (4, 4) pose of the hull.
        box: (2, 3) [m] corners of the hull's box in B.
        rng: Draws the noise.
        beam: [rad] spacing of the beams.
        noise: Standard deviation along the beam, share of the range.

    Returns:
        (N, 3) [m] in W.
    """
    spec = mujoco.MjSpec()
    ground.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    X_BS, count = sonar_on_hull(box), 1 + round(SWATH / beam)
    sonar = Sonar(
        model,
        "world",
        X_WB @ X_BS,
        noise=SonarNoise(range_share=noise),
        beams=SonarBeams(rows=count, columns=count, elevation=SWATH, azimuth=SWATH),
    )
    pings = [SonarScan(time=0.0, points=sonar.ping(data, rng), X_BS=X_BS) for _ in range(LOOKS)]
    return np.concatenate([points_in_world(X_WB, ping) for ping in pings])


@dataclass(frozen=True)
class TerrainCase:
    """One terrain; a case of the study."""

    seed: int
    beam: float  # [deg] spacing of the sonar's beams
    noise: float  # standard deviation along the beam [% of the range]
    vehicle: str


@cache
def searched_with(vehicle: str) -> WorkVehicle:
    """The vehicle as its planner knows it."""
    return OwnVehicle.of(vehicle_spec(vehicle), (CAMERA_SITE, TOOL_GEOM)).at_work()


def run(case: TerrainCase) -> Row:
    """Errors of targets and profile in units of 1 cm + 0.5 % of the range, and the height or the
    refusal.
    """
    own = searched_with(case.vehicle)
    vehicle, chain, box = own.vehicle, own.chain, own.hull_box
    streams = Streams(case.seed)
    kind = KINDS[case.seed % len(KINDS)]
    center_W = (*streams["center"].uniform(-5.0, 5.0, 2), -20.0)
    ground = seabed(kind, streams["ground"], center_W=center_W, half=3.0)
    R_WB = exp_so3([0.0, 0.0, streams["heading"].uniform(-np.pi, np.pi)])
    X_WB = pose(R_WB, ground.center_W + ABOVE)
    B = X_WB[:3, 3] + np.array([[AHEAD, -0.5 * APART, 0.0], [AHEAD, 0.5 * APART, 0.0]]) @ R_WB.T
    beam = np.radians(case.beam)
    cloud = seen(ground, X_WB, box, streams["echoes"], beam=beam, noise=0.01 * case.noise)
    true = ground.mesh()[0]
    work = partial(_work, own=own, X_WB=X_WB, B=B)
    result: Row = {
        "seed": case.seed,
        "kind": kind,
        "points": len(cloud),
        "refused": "",
        "margin": None,
    }
    plan, found, result["refused"] = work(cloud)
    result["truly_refused"] = work(true)[2]
    if plan is not None and plan.profile is not None:
        result["targets"] = _errors(plan.targets.A, ground, X_WB).tolist()
        result["profile"] = _errors(plan.profile.T, ground, X_WB).tolist()
    if found is None or plan is None or plan.path is None:
        return result
    at = found.placement
    p_B = (true - at.X_WB[:3, 3]) @ at.X_WB[:3, :3]
    outside = np.maximum(0.0, np.maximum(box[0] - p_B, p_B - box[1]))
    tools = tool_poses(plan.path, np.linspace(0.0, plan.path.s[-1], 30), at.roll, STANDOFF)
    return result | {
        "margin": at.margin,
        "aside_m": found.aside,
        "hull_to_true_ground_m": float(np.linalg.norm(outside, axis=1).min()),
        "arm_to_true_ground_m": arm_gap(
            chain, at.X_WB @ vehicle.X_BA, tools, at.q_start, cKDTree(true)
        ),
    }


def _work(
    cloud: Array, *, own: WorkVehicle, X_WB: Array, B: Array
) -> tuple[SeabedPlan | None, WorkHeight | None, str]:
    """Plan and working height on a cloud (N, 3) [m], None from a failed stage on; and the reason of
    the failure.
    """
    try:
        plan = plan_seabed_work(cloud, B)
    except PerceptionError as error:
        return None, None, str(error)
    assert plan.path is not None
    try:
        found = choose_height(
            own,
            plan.path,
            ground=plan.terrain.vertices,
            X_WB=X_WB,
            force=60.0,
            standoff=STANDOFF,
            search=height_search(own.hull_box, drag=True),
        )
    except ReachError as error:
        return plan, None, str(error)
    return plan, found, ""


def _errors(points: Array, ground: Seabed, X_WB: Array) -> Array:
    """Vertical error of points (N, 3) in units of the limit, 1 cm + 0.5 % of their range."""
    reach = np.linalg.norm(points - X_WB[:3, 3], axis=1)
    return np.abs(points[:, 2] - ground.height(points)) / (0.01 + 0.005 * reach)


def summarise(runs: list[Row]) -> Summary:
    """Table by kind of seabed, and every refusal beside that on the exactly known ground."""
    cells = []
    for kind in (*KINDS, "all"):
        mine = [run for run in runs if kind in (run["kind"], "all")]
        if not mine:
            continue
        targets = np.concatenate([run.get("targets", []) for run in mine])
        profile = np.concatenate([run.get("profile", []) for run in mine])
        worked = [run for run in mine if run["margin"] is not None]
        cells.append(
            (
                kind,
                str(len(mine)),
                _share(targets),
                _share(profile),
                f"{np.quantile(profile, 0.95):.2f}" if len(profile) else "-",
                f"{len(worked)}",
                f"{min(run['margin'] for run in worked):.2f}" if worked else "-",
                f"{min(run['hull_to_true_ground_m'] for run in worked):.2f}" if worked else "-",
                f"{min(run['arm_to_true_ground_m'] for run in worked):.2f}" if worked else "-",
                f"{sum(bool(run['refused']) != bool(run['truly_refused']) for run in mine)}",
            )
        )
    table = Table(
        title="Reconstruction of the seabed and choice of the working height",
        columns=(
            "seabed",
            "runs",
            "targets within",
            "profile within",
            "95 %, of limit",
            "worked",
            "least margin",
            "hull to true ground [m]",
            "arm to it [m]",
            "wrong",
        ),
        rows=cells,
    )
    lines = [
        f"{run['kind']} {run['seed']}: {run['refused'] or 'worked'} | truly: "
        f"{run['truly_refused'] or 'would do'}"
        for run in runs
        if run["refused"] or run["truly_refused"]
    ]
    wrong = sum(bool(run["refused"]) != bool(run["truly_refused"]) for run in runs)
    return Summary(metrics={"terrains": len(runs), "wrong": wrong}, tables=[table], lines=lines)


def _share(values: Array) -> str:
    return f"{np.mean(values <= 1.0):.1%} of {len(values)}" if len(values) else "-"
