"""Study: accuracy of the seabed's reconstruction and the choice of working height, over random terrains.

Each terrain is scanned by a coarse 3D sonar under the hull (`sim.sensors.sonar`) from 2.5 m above. Two targets are
projected, the profile between them is cut, and the working height is chosen. All is compared with the true terrain. A
refusal is right where the exactly known ground is refused as well; work is right where it is not.

With --speed, the study measures the time from cloud to path over the size of the cloud instead, beside other
triangulations.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import json
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial import cKDTree

from controllers.mkps import Chain
from controllers.planning.hull_placement import tool_poses
from controllers.planning.seabed_height import WorkHeight, arm_gap, choose_height
from models.meshes import open3d_loader
from models.meshes.ray_casting import RayScene
from models.naming import CAMERA_SITE, TOOL_GEOM
from models.site.seabed import KINDS, Seabed, seabed
from models.vehicle import Vehicle
from perception.seabed.seabed_finder import points_in_world
from perception.seabed.terrain import build_terrain
from perception.seabed.terrain_path import SeabedPlan, plan_seabed_work
from scenarios.own_vehicle import OwnVehicle, vehicle_spec
from scenarios.tasks.seabed_sampling import ABOVE, AHEAD, APART, BEAMS, LOOKS, height_search, sonar_on_hull
from sim.interfaces.errors import ConfigurationError, MissingLibraryError, PerceptionError, ReachError
from sim.interfaces.messages import SonarScan
from sim.interfaces.spatial import Array, exp_so3, pose
from sim.runs.saving import write_whole
from sim.sensors.sonar import Sonar, SonarBeams, SonarNoise

SWATH = BEAMS.azimuth  # [rad] swath of the sonar, both ways
STANDOFF = 0.1  # [m] from which the tool approaches the path
FALSE = 0.03  # share of false echoes in the clouds for --speed


@dataclass(kw_only=True)
class Options:
    """Study the reconstruction of the seabed and the choice of height."""

    terrains: int = 100
    """Number of terrains, all kinds in turn."""
    seed: int = 0
    """Seed of the first terrain; each has its own."""
    beam: float = 1.0
    """Spacing of the sonar's beams [deg]."""
    noise: float = 0.3
    """Standard deviation along the beam [% of the range]."""
    vehicle: str = "uuv_puma"
    """A name of models.available(), or an MJCF file with the named parts (docs/concepts.md)."""
    speed: bool = False
    """Measure times over the size of the cloud instead."""
    out: Path | None = None
    """Folder for study.json or speed.json."""


def seen(ground: Seabed, X_WB: Array, box: Array, rng: np.random.Generator, *, beam: float, noise: float) -> Array:
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


def one(seed: int, options: Options, vehicle: Vehicle, chain: Chain, box: Array) -> dict[str, Any]:
    """Row of one terrain: errors of targets and profile in units of 1 cm + 0.5 % of the range, height or refusal.

    Args:
        seed: Seed of the terrain.
        options: Options of the study.
        vehicle: The vehicle.
        chain: Kinematics of its arm.
        box: (2, 3) [m] corners of the hull's box in B.
    """
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    ground = seabed(kind, rng, center_W=(*rng.uniform(-5.0, 5.0, 2), -20.0), half=3.0)
    R_WB = exp_so3([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    X_WB = pose(R_WB, ground.center_W + ABOVE)
    B = X_WB[:3, 3] + np.array([[AHEAD, -0.5 * APART, 0.0], [AHEAD, 0.5 * APART, 0.0]]) @ R_WB.T
    cloud = seen(ground, X_WB, box, rng, beam=np.radians(options.beam), noise=0.01 * options.noise)
    true = ground.mesh()[0]
    work = partial(_work, vehicle=vehicle, chain=chain, box=box, X_WB=X_WB, B=B)
    result: dict[str, Any] = {"seed": seed, "kind": kind, "points": len(cloud), "refused": "", "margin": None}
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
        "arm_to_true_ground_m": arm_gap(chain, at.X_WB @ vehicle.X_BA, tools, at.q_start, cKDTree(true)),
    }


def _work(
    cloud: Array, *, vehicle: Vehicle, chain: Chain, box: Array, X_WB: Array, B: Array
) -> tuple[SeabedPlan | None, WorkHeight | None, str]:
    """Plan and working height on a cloud (N, 3) [m], None from a failed stage on; and the reason of the failure."""
    try:
        plan = plan_seabed_work(cloud, B)
    except PerceptionError as error:
        return None, None, str(error)
    assert plan.path is not None
    try:
        found = choose_height(
            vehicle,
            chain,
            plan.path,
            ground=plan.terrain.vertices,
            hull_box=box,
            X_WB=X_WB,
            force=60.0,
            standoff=STANDOFF,
            search=height_search(box, drag=True),
        )
    except ReachError as error:
        return plan, None, str(error)
    return plan, found, ""


def _errors(points: Array, ground: Seabed, X_WB: Array) -> Array:
    """Vertical error of points (N, 3) in units of the limit, 1 cm + 0.5 % of their range."""
    reach = np.linalg.norm(points - X_WB[:3, 3], axis=1)
    return np.abs(points[:, 2] - ground.height(points)) / (0.01 + 0.005 * reach)


def study(options: Options, console: Console) -> dict[str, Any]:
    """Runs all terrains, prints the table and returns the rows for study.json."""
    own = OwnVehicle.of(vehicle_spec(options.vehicle), (CAMERA_SITE, TOOL_GEOM))
    vehicle, chain, box = own.vehicle, own.chain(), own.hull_box
    seeds = range(options.seed, options.seed + options.terrains)
    runs = [one(seed, options, vehicle, chain, box) for seed in track(seeds, "terrains", console=console)]
    table = Table(
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
    )
    for kind in (*KINDS, "all"):
        mine = [run for run in runs if kind in (run["kind"], "all")]
        if not mine:
            continue
        targets = np.concatenate([run.get("targets", []) for run in mine])
        profile = np.concatenate([run.get("profile", []) for run in mine])
        worked = [run for run in mine if run["margin"] is not None]
        table.add_row(
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
    console.print(table)
    for run in runs:
        if run["refused"] or run["truly_refused"]:
            truly = run["truly_refused"] or "would do"
            console.print(
                f"{run['kind']} {run['seed']}: {run['refused'] or 'worked'} | truly: {truly}", highlight=False
            )
    return {"runs": runs}


def _share(values: Array) -> str:
    return f"{np.mean(values <= 1.0):.1%} of {len(values)}" if len(values) else "-"


def speed(options: Options, console: Console) -> dict[str, Any]:
    """Processor times of our pipeline and of other triangulations of the same points, for speed.json."""
    try:
        o3d = open3d_loader.load()
    except MissingLibraryError as error:
        o3d = None
        console.print(f"no other ways to triangulate: {error}", highlight=False, markup=False)
    rows = []
    table = Table("points", "cloud to path, s", "ball pivoting: s, mm off", "Poisson: s, mm off", "ours: mm off")
    rng = np.random.default_rng(options.seed)
    ground = seabed("ripples", rng)
    B = np.array([[-0.4, -0.2, 2.0], [0.4, 0.2, 2.0]])
    plan_seabed_work(_scatter(ground, 5_000, rng), B)  # loads all compiled code
    for points in (5_000, 20_000, 50_000, 100_000, 200_000, 400_000):
        cloud = _scatter(ground, points, rng)
        ours = min(_timed(lambda cloud=cloud: plan_seabed_work(cloud, B))[0] for _ in range(3))
        row: dict[str, Any] = {"points": points, "cloud_to_path_s": ours}
        at = np.column_stack([rng.uniform(-1.5, 1.5, (2_000, 2)), np.full(2_000, 2.0)])
        row["ours_mm"], row["ours_missed"] = _off(build_terrain(cloud).scene, at - cloud.mean(axis=0), ground, at)
        if o3d and points <= 20_000:
            shape = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
            for name, make in (("ball_pivoting", _pivot), ("poisson", _poisson)):
                seconds, mesh = _timed(lambda make=make, shape=shape: make(o3d, shape))
                scene = RayScene(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
                row[f"{name}_s"] = seconds
                row[f"{name}_mm"], row[f"{name}_missed"] = _off(scene, at, ground, at)
        rows.append(row)
        table.add_row(
            str(points),
            f"{ours:.3f}",
            *(
                f"{row[f'{name}_s']:.2f}, {row[f'{name}_mm']:.1f}, {row[f'{name}_missed']:.1%} missed"
                if f"{name}_s" in row
                else "-"
                for name in ("ball_pivoting", "poisson")
            ),
            f"{row['ours_mm']:.1f}, {row['ours_missed']:.1%} missed",
        )
    console.print(table)
    return {"rows": rows}


def _scatter(ground: Seabed, points: int, rng: np.random.Generator) -> Array:
    """Points of uniform density over 4 x 4 m, with 5 mm of noise and false echoes."""
    xy = rng.uniform(-2.0, 2.0, (points, 2))
    z = ground.height(xy) + rng.normal(0.0, 0.005, points)
    wild = rng.random(points) < FALSE
    z[wild] += rng.uniform(-0.6, 0.3, wild.sum())
    return np.column_stack([xy, z])


def _timed(work: Any) -> tuple[float, Any]:
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def _off(scene: Any, starts: Array, ground: Seabed, at: Array) -> tuple[float, float]:
    """95 % quantile of the vertical error [mm] at places `at`, and the share of rays without a hit."""
    t = scene.cast(starts, np.broadcast_to([0.0, 0.0, -1.0], starts.shape))["t"]
    hit = np.isfinite(t)
    off = np.abs(at[hit, 2] - t[hit] - ground.height(at[hit]))
    return 1e3 * float(np.quantile(off, 0.95)), float(1.0 - hit.mean())


def _pivot(o3d: Any, cloud: Any) -> Any:
    clean = _clean(cloud)
    gap = float(np.mean(clean.compute_nearest_neighbor_distance()))
    radii = o3d.utility.DoubleVector([1.5 * gap, 3.0 * gap, 6.0 * gap])
    return o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(clean, radii)


def _poisson(o3d: Any, cloud: Any) -> Any:
    return o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(_clean(cloud), depth=8, n_threads=1)[0]


def _clean(cloud: Any) -> Any:
    """Removes statistical outliers and adds normals upwards, which both triangulations need."""
    clean, _ = cloud.remove_statistical_outlier(nb_neighbors=24, std_ratio=1.0)
    clean.estimate_normals()
    clean.orient_normals_to_align_with_direction(np.array([0.0, 0.0, 1.0]))
    return clean


def main() -> int:
    """Runs the study or the time measurement, writes its file and returns the exit code."""
    options = parse(Options)
    if options.terrains < 1 or not options.beam > 0.0 or not options.noise >= 0.0:
        raise ConfigurationError(
            f"--terrains >= 1, --beam > 0, --noise >= 0: got {options.terrains}, {options.beam}, {options.noise}"
        )
    folder = new_folder("study_seabed", options.out, options.seed)
    console = Console()
    figures = speed(options, console) if options.speed else study(options, console)
    file = folder / ("speed.json" if options.speed else "study.json")
    write_whole(file, json.dumps(figures, indent=2) + "\n")
    console.print(f"written to {file}", highlight=False)
    return 0


if __name__ == "__main__":
    run_scenario(main)
