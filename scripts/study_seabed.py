"""How well the seabed is known and where the vehicle may work on it: seeded terrains seen by a coarse 3D sonar.

Each terrain is seen from 2.5 m above: beams a degree apart, noise along the beam, false echoes. Two targets are
projected, the profile between them is cut, and the height to work at is chosen; all is judged against the true terrain.
With --speed, the time from cloud to path over the size of the cloud instead, and other ways to triangulate beside it.
"""

from _start import made_folder, parse, run_scenario  # isort: skip

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _job_parts import hull_box, undriven
from rich.console import Console
from rich.progress import track
from rich.table import Table

from controllers.mkps import Chain
from controllers.seabed import HeightSearch, choose_height
from models import open3d_loader, scenes
from models.seabed import KINDS, Seabed, seabed
from models.vehicle import ARM_BASE_BODY, TIP_SITE, Vehicle
from perception.terrain import build_terrain
from perception.terrain_path import plan_seabed_work
from sim.interfaces.errors import ConfigurationError, PerceptionError, ReachError
from sim.interfaces.spatial import Array, exp_so3, pose

ALTITUDE = 2.5  # [m] of the sonar over the middle of the terrain
ABOVE = np.array([0.0, 0.0, ALTITUDE])
SWATH = np.radians(45.0)  # [rad] to either side
FALSE = 0.03  # share of echoes that are none


@dataclass(kw_only=True)
class Options:
    """Study the seabed's surface and the choice of height."""

    terrains: int = 100
    """So many, of all kinds in turn."""
    seed: int = 0
    """Of the first; each terrain has its own."""
    beam: float = 1.0
    """Between the sonar's beams [deg]."""
    noise: float = 0.5
    """Standard deviation along the beam [% of the range]."""
    vehicle: str = "uuv_puma"
    """A name of models.available(), or an MJCF file with the named parts (README)."""
    speed: bool = False
    """Times over the size of the cloud instead."""
    out: Path = Path("runs/study_seabed")
    """Folder for study.json or speed.json."""


def seen(ground: Seabed, rng: np.random.Generator, *, beam: float, noise: float) -> Array:
    """Echoes (N, 3) [m] in W of a sonar that looks straight down from ALTITUDE over the middle of `ground`."""
    p_WS = ground.center_W + ABOVE
    angle = np.arange(-SWATH, SWATH, beam)
    across, along = (np.tan(a.ravel() + rng.normal(0.0, 0.25 * beam, a.size)) for a in np.meshgrid(angle, angle))
    rays = np.column_stack([across, along, -np.ones(len(across))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    vertices, triangles = ground.mesh()
    scene = open3d_loader.ray_scene(vertices - ground.center_W, triangles)
    r = open3d_loader.cast_rays(scene, p_WS - ground.center_W, rays)["t"].astype(np.float64)
    hit = np.isfinite(r)
    r, rays = r[hit], rays[hit]
    r *= 1.0 + noise * rng.standard_normal(len(r))
    wild = rng.random(len(r)) < FALSE
    r[wild] += rng.uniform(-0.6, 0.3, wild.sum())
    return p_WS + r[:, None] * rays


def one(seed: int, options: Options, vehicle: Vehicle, chain: Chain, box: Array) -> dict[str, Any]:
    """One terrain: errors of targets and profile in units of 1 cm + 0.5 % of the range, the height or the refusal."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    ground = seabed(kind, rng, center_W=(*rng.uniform(-5.0, 5.0, 2), -20.0), half=3.0)
    cloud = seen(ground, rng, beam=np.radians(options.beam), noise=0.01 * options.noise)
    yaw = rng.uniform(-np.pi, np.pi)
    X_WB = pose(exp_so3([0.0, 0.0, yaw]), ground.center_W + ABOVE)
    way = exp_so3([0.0, 0.0, yaw]) @ np.array([[0.5, -0.15, 0.0], [0.5, 0.15, 0.0]]).T
    B = X_WB[:3, 3] + way.T
    result: dict[str, Any] = {"seed": seed, "kind": kind, "points": len(cloud), "refused": "", "margin": None}
    result["true_step_m"] = float(np.ptp(ground.height(B[:1] + np.linspace(0, 1, 30)[:, None] * (B[1] - B[0]))))
    try:
        plan = plan_seabed_work(cloud, B)
    except PerceptionError as error:
        return result | {"refused": str(error)}
    assert plan.profile is not None
    assert plan.path is not None
    result["targets"] = _errors(plan.targets.A, ground, X_WB).tolist()
    result["profile"] = _errors(plan.profile.T, ground, X_WB).tolist()
    try:
        found = choose_height(
            vehicle, chain, plan.path, ground=plan.terrain.vertices, hull_box=box, X_WB=X_WB, force=60.0,
            standoff=0.1, search=HeightSearch(jets_above=-float(box[0, 2])),
        )  # fmt: skip
    except ReachError as error:
        return result | {"refused": str(error)}
    X = found.placement.X_WB
    true = ground.mesh()[0]
    p_B = (true - X[:3, 3]) @ X[:3, :3]
    outside = np.maximum(0.0, np.maximum(box[0] - p_B, p_B - box[1]))
    result["margin"], result["aside_m"] = found.placement.margin, found.aside
    result["hull_to_true_ground_m"] = float(np.linalg.norm(outside, axis=1).min())
    return result


def _errors(points: Array, ground: Seabed, X_WB: Array) -> Array:
    """Vertical distance of points (N, 3) to the true surface over 1 cm + 0.5 % of their range; 1 is at the limit."""
    reach = np.linalg.norm(points - X_WB[:3, 3], axis=1)
    return np.abs(points[:, 2] - ground.height(points)) / (0.01 + 0.005 * reach)


def study(options: Options, console: Console) -> dict[str, Any]:
    own = scenes.vehicle_spec(options.vehicle).compile()
    vehicle = Vehicle.of(own)
    chain = Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=undriven(own, vehicle))
    box = hull_box(own, vehicle)
    seeds = range(options.seed, options.seed + options.terrains)
    runs = [one(seed, options, vehicle, chain, box) for seed in track(seeds, "terrains", console=console)]
    table = Table("seabed", "runs", "targets within", "profile within", "95 %, of limit", "worked", "least margin",
                  "hull to true ground [m]")  # fmt: skip
    for kind in (*KINDS, "all"):
        mine = [run for run in runs if kind in (run["kind"], "all")]
        if not mine:
            continue
        targets = np.concatenate([run.get("targets", []) for run in mine])
        profile = np.concatenate([run.get("profile", []) for run in mine])
        worked = [run for run in mine if run["margin"] is not None]
        table.add_row(
            kind, str(len(mine)), _share(targets), _share(profile),
            f"{np.quantile(profile, 0.95):.2f}" if len(profile) else "-", f"{len(worked)}",
            f"{min(run['margin'] for run in worked):.2f}" if worked else "-",
            f"{min(run['hull_to_true_ground_m'] for run in worked):.2f}" if worked else "-",
        )  # fmt: skip
    console.print(table)
    for run in runs:
        if run["refused"]:
            console.print(f"{run['kind']} {run['seed']}: {run['refused']}", highlight=False)
    return {"runs": runs}


def _share(values: Array) -> str:
    return f"{np.mean(values <= 1.0):.1%} of {len(values)}" if len(values) else "-"


def speed(options: Options, console: Console) -> dict[str, Any]:
    """Times by the process's own clock: of everything, and of other triangulations of the same points."""
    o3d = open3d_loader.load()
    rows = []
    table = Table("points", "cloud to path, s", "ball pivoting: s, mm off", "Poisson: s, mm off", "ours: mm off")
    rng = np.random.default_rng(options.seed)
    ground = seabed("ripples", rng)
    B = np.array([[-0.4, -0.2, 2.0], [0.4, 0.2, 2.0]])
    plan_seabed_work(_scatter(ground, 5_000, rng), B)  # loads all compiled code
    for points in (3_000, 10_000, 30_000, 100_000, 200_000, 400_000):
        cloud = _scatter(ground, points, rng)
        ours = min(_timed(lambda cloud=cloud: plan_seabed_work(cloud, B))[0] for _ in range(3))
        row: dict[str, Any] = {"points": points, "cloud_to_path_s": ours}
        at = np.column_stack([rng.uniform(-1.5, 1.5, (2_000, 2)), np.full(2_000, 2.0)])
        row["ours_mm"], row["ours_missed"] = _off(build_terrain(cloud).scene, at - cloud.mean(axis=0), ground, at)
        if points <= 30_000:
            shape = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
            for name, make in (("ball_pivoting", _pivot), ("poisson", _poisson)):
                seconds, mesh = _timed(lambda make=make, shape=shape: make(o3d, shape))
                scene = open3d_loader.ray_scene(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
                row[f"{name}_s"] = seconds
                row[f"{name}_mm"], row[f"{name}_missed"] = _off(scene, at, ground, at)
        rows.append(row)
        table.add_row(str(points), f"{ours:.3f}", *(
            f"{row[f'{name}_s']:.2f}, {row[f'{name}_mm']:.1f}, {row[f'{name}_missed']:.1%} missed"
            if f"{name}_s" in row else "-" for name in ("ball_pivoting", "poisson")
        ), f"{row['ours_mm']:.1f}, {row['ours_missed']:.1%} missed")  # fmt: skip
    console.print(table)
    return {"rows": rows}


def _scatter(ground: Seabed, points: int, rng: np.random.Generator) -> Array:
    """Points of an even density over 4 x 4 m, 5 mm of noise, false echoes."""
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
    """95 % of the vertical distances [mm] to the true surface at places `at`, and the share of rays that missed."""
    t = open3d_loader.cast_rays(scene, starts, np.broadcast_to([0.0, 0.0, -1.0], starts.shape))["t"]
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
    """Without statistical outliers, with normals upwards: what both need."""
    clean, _ = cloud.remove_statistical_outlier(nb_neighbors=24, std_ratio=1.0)
    clean.estimate_normals()
    clean.orient_normals_to_align_with_direction(np.array([0.0, 0.0, 1.0]))
    return clean


def main() -> int:
    options = parse(Options)
    if options.terrains < 1 or not options.beam > 0.0 or not options.noise >= 0.0:
        raise ConfigurationError(
            f"--terrains >= 1, --beam > 0, --noise >= 0: got {options.terrains}, {options.beam}, {options.noise}"
        )
    made_folder(options.out)
    console = Console()
    figures = speed(options, console) if options.speed else study(options, console)
    file = options.out / ("speed.json" if options.speed else "study.json")
    file.write_text(json.dumps(figures, indent=2) + "\n", "utf-8")
    console.print(f"written to {file}", highlight=False)
    return 0


if __name__ == "__main__":
    run_scenario(main)
