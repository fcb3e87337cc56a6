"""Tool paths on fouled and dented objects: how far path and model lie off the true surface.

For each seed an object is drawn, seen once by the depth camera, found, and a path planned on it. Distances are taken
along the tool's axis from the path to the true surface. What the camera saw and what it did not are told apart.
"""

from _start import ScenarioOptions, parse, run_scenario  # isort: skip

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from _contact_options import coarse_detection
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

from models import open3d_loader
from models.barrel import RIM_HEIGHT, RIM_WIDTH
from models.pile import FLANGE, FLANGE_DIAMETER
from models.targets import (
    BARREL_DIAMETER,
    BARREL_LENGTH,
    PILE_DIAMETER,
    PILE_LENGTH,
    ModelPath,
    TargetModel,
    barrel,
    longitudinal,
    pile,
    revolve,
    ring,
    transverse,
    vertical,
)
from perception.identification import Identification, identify
from perception.path_deviation import deviate
from perception.registration import ModelSurface
from perception.scan import Scan
from perception.toolpath import carry, densified, plan_path
from sim.depth_camera import DepthCamera
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.messages import DepthImage
from sim.interfaces.spatial import Array, inverse, pose, rotation_from_z, transform_points

BOUND = 0.003  # [m] within which the path on the true surface must be
_AHEAD = 0.08  # [m] before the path, where rays to the true surface begin
_RINGS, _SIDES = 0.01, 256  # [m] between the rings of the true mesh; its sides
_BUMP_WIDTH = (0.05, 0.09)  # [m] as of a Gaussian
_BUMPS_NEAR = 0.2  # [m] of a path; a symmetric object's may be found up to 30 deg around it
_BUMP_AREA = 0.08  # [m^2] of shell for each


@dataclass(kw_only=True)
class Options(ScenarioOptions):
    """Paths on objects that are not as their models."""

    trials: int = 10
    """Seeds of each object, from --seed on."""
    judged: bool = True
    """Plan only on what identification accepts (--no-judged: on its best pose, whatever the check says)."""


_ON_BARREL = {"longitudinal": longitudinal(), "transverse": transverse(2.0)}
_ON_PILE = {"vertical": vertical(), "ring": ring(1.75)}


def _points(paths: dict[str, ModelPath]) -> Array:
    return np.vstack([path.p for path in paths.values()])


def bumpy(
    profile: Array, shell: float, near: Array, rng: np.random.Generator, low: float, high: float
) -> tuple[Array, np.ndarray]:
    """The surface of revolution of `profile` (P, 2) [m] with smooth bumps, `low` to `high` [m], on its shell.

    `shell` [m] is the shell's radius: rims, flanges and ends stay clean. Bumps lie around `near` (N, 3) [m], where they
    cover about a third.
    """
    points = [profile[:1]]
    for a, b in pairwise(profile):
        flat = a[1] == b[1] == shell
        count = 1 + int(abs(b[0] - a[0]) / _RINGS) if flat else 1
        points.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    vertices, triangles = revolve(np.vstack(points), _SIDES)
    radius = np.linalg.norm(vertices[:, 1:], axis=1)
    on_shell = np.abs(radius - shell) < 1e-9
    height = np.zeros(len(vertices))
    around = np.flatnonzero(on_shell & (cKDTree(near).query(vertices)[0] < _BUMPS_NEAR))
    area = 2.0 * np.pi * shell * float(np.ptp(profile[:, 0])) * len(around) / max(1, int(on_shell.sum()))
    for row in rng.choice(around, size=max(3, round(area / _BUMP_AREA))):
        bump, width = low + rng.random() * (high - low), rng.uniform(*_BUMP_WIDTH)
        shape = bump * np.exp(-np.sum((vertices - vertices[row]) ** 2, axis=1) / (2.0 * width**2))
        height = np.where(np.abs(shape) > np.abs(height), shape, height)
    ends = np.sort(vertices[~on_shell, 0])
    gap = np.abs(vertices[:, :1] - np.unique(np.round(ends, 6))).min(axis=1)
    height *= np.clip(gap / 0.04, 0.0, 1.0) * on_shell  # none hangs over a rim
    vertices[:, 1:] *= (1.0 + height / np.maximum(radius, 1e-9))[:, None]
    return vertices, triangles


def true_barrel(rng: np.random.Generator, low: float, high: float) -> TargetModel:
    """The barrel as the sea left it."""
    r, h = 0.5 * BARREL_DIAMETER, 0.5 * BARREL_LENGTH
    half = [(-h, 0.0), (-h, r + RIM_HEIGHT), (RIM_WIDTH - h, r + RIM_HEIGHT), (RIM_WIDTH - h, r)]
    profile = np.array(half + [(-x, radius) for x, radius in reversed(half)])
    vertices, triangles = bumpy(profile, r, _points(_ON_BARREL), rng, low, high)
    return TargetModel(name="barrel", vertices=vertices, triangles=triangles)


def true_pile(rng: np.random.Generator, low: float, high: float) -> TargetModel:
    """The pile as the sea left it."""
    r, h, R = 0.5 * PILE_DIAMETER, 0.5 * PILE_LENGTH, 0.5 * FLANGE_DIAMETER
    collar = [(FLANGE[0], r), (FLANGE[0], R), (FLANGE[1], R), (FLANGE[1], r)]
    profile = np.array([(-h, 0.0), (-h, r), *collar, (h, r), (h, 0.0)])
    vertices, triangles = bumpy(profile, r, _points(_ON_PILE)[:, [2, 0, 1]], rng, low, high)
    return TargetModel(name="pile", vertices=vertices[:, [1, 2, 0]], triangles=triangles)


@dataclass(frozen=True)
class Case:
    """One object and what is done with it."""

    known: TargetModel
    true: Callable[[np.random.Generator, float, float], TargetModel]
    bumps: tuple[float, float]  # [m] lowest and highest; negative: dents
    paths: dict[str, ModelPath]
    view: tuple[float, float, float]  # [m] of the camera in T


CASES = {
    "fouled barrel": Case(barrel(), true_barrel, (0.01, 0.04), _ON_BARREL, (0.0, -0.35, 1.2)),
    "dented barrel": Case(barrel(), true_barrel, (-0.01, -0.03), _ON_BARREL, (0.0, -0.35, 1.2)),
    "fouled pile": Case(pile(), true_pile, (0.01, 0.04), _ON_PILE, (1.8, 0.3, 0.0)),
    "dented pile": Case(pile(), true_pile, (-0.01, -0.03), _ON_PILE, (1.8, 0.3, 0.0)),
}


@dataclass(kw_only=True)
class _Poses:
    """What a depth camera asks of the plant's truth."""

    time: float
    xpos: Array
    xmat: Array


def look(target: TargetModel, X_CT: Array, rng: np.random.Generator) -> DepthImage:
    """A frame of `target` at `X_CT` from a camera at the origin."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="target", pos=X_CT[:3, 3])
    # The camera takes what is drawn; nothing has to collide here.
    flat = (target.vertices @ X_CT[:3, :3].T).astype(np.float32)
    spec.add_mesh(
        name="target", uservert=flat.ravel(), userface=target.triangles.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="target", contype=0, conaffinity=0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera = DepthCamera(model, "world", np.eye(4))
    return camera.step(camera.init(rng), _Poses(time=0.0, xpos=data.xpos, xmat=data.xmat))[1]


def distances(scene: Any, X_TS: Array, p: Array, z: Array) -> Array:
    """Distances (N,) [m] along the tool's axes from points in S to the true surface; inf where there is none."""
    z_T = z @ X_TS[:3, :3].T
    return open3d_loader.cast_rays(scene, transform_points(X_TS, p) - _AHEAD * z_T, z_T)["t"] - _AHEAD


def trial(case: Case, seed: int, judged: bool) -> dict[str, Any]:
    """One seed: what came of identification, and of each path."""
    rng = np.random.default_rng(seed)
    true = case.true(rng, *case.bumps)
    eye = np.array(case.view) + rng.uniform(-0.15, 0.15, 3)
    X_CT = inverse(pose(rotation_from_z(-eye, np.cross(-eye, [0.3, 0.9, 0.2])), eye))
    image = look(true, X_CT, rng)
    approach, orientation = coarse_detection(X_CT, rng)
    found = identify(Scan.from_depth(image), ModelSurface.of(case.known), approach, orientation)
    position, angle = case.known.symmetry.error(found.X_sensor_target, X_CT)
    result: dict[str, Any] = {
        "seed": seed, "accepted": found.accepted, "reason": found.reason,
        "position_error_m": position, "orientation_error_rad": angle, "paths": {},
    }  # fmt: skip
    if judged and not found.accepted:
        return result
    found = replace(found, accepted=True)
    scene = open3d_loader.ray_scene(true.vertices, true.triangles)
    for name, path in case.paths.items():
        result["paths"][name] = _of_path(found, path, scene, inverse(X_CT))
    return result


def _of_path(found: Identification, path: ModelPath, scene: Any, X_TS: Array) -> dict[str, Any]:
    try:
        planned = plan_path(found, path)
    except PerceptionError as error:
        return {"refused": str(error)}
    carried = carry(found.X_sensor_target, densified(path))
    assert found.evidence is not None
    deviation = deviate(found.evidence, found.surface, found.X_sensor_target, carried, 0.05, 0.06)
    share = np.linspace(0.0, 1.0, len(planned.s))
    seen = np.interp(share, np.linspace(0.0, 1.0, len(carried.p)), deviation.seen.astype(float)) > 0.5
    model, off = distances(scene, X_TS, carried.p, carried.a), distances(scene, X_TS, planned.p, planned.z)
    on = np.abs(off[seen])
    return {
        "seen": float(seen.mean()),
        "model_max_m": float(np.abs(model[deviation.seen]).max(initial=0.0)),
        "path_rms_m": float(np.sqrt(np.mean(on**2))) if len(on) else None,
        "path_p95_m": float(np.percentile(on, 95)) if len(on) else None,
        "path_max_m": float(on.max(initial=0.0)),
        "within": float(np.mean(on < BOUND)) if len(on) else None,
        "unseen_max_m": float(np.abs(off[~seen]).max(initial=0.0)),
        "profile": {"s": planned.s[::4].tolist(), "off": off[::4].tolist(), "seen": seen[::4].tolist()},
    }


def picture(results: dict[str, list[dict[str, Any]]], file: str) -> None:
    """Distance to the true surface along every path: the model's in the table, the planned path's here."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 2.4 * len(results)), layout="constrained")
    for axes, (name, trials) in zip(np.atleast_1d(figure.subplots(len(results))), results.items(), strict=True):
        for found in trials:
            for k, path in enumerate(found["paths"].values()):
                if "profile" in path:
                    seen = np.array(path["profile"]["seen"])
                    off = 1e3 * np.where(seen, path["profile"]["off"], np.nan)
                    axes.plot(path["profile"]["s"], off, color=f"C{k}", linewidth=0.8)
        axes.axhspan(-1e3 * BOUND, 1e3 * BOUND, color="0.9")
        axes.set(title=f"{name}; grey: the bound", ylabel="off the true surface [mm]")
        names = next((list(found["paths"]) for found in trials if found["paths"]), [])
        for k, path_name in enumerate(names):
            axes.plot([], [], color=f"C{k}", label=path_name)
        if names:
            axes.legend(fontsize="small", loc="upper right")
    figure.supxlabel("along the path [m], where seen; a line a seed")
    figure.savefig(file, dpi=110)


def main() -> int:
    options = parse(Options)
    if options.trials < 1:
        raise ConfigurationError(f"--trials: must be at least 1, got {options.trials}")
    folder, console = options.folder("study_paths"), Console()
    console.width = max(console.width, 110)  # the table is wider than a terminal must be
    trials = 2 if options.quick else options.trials
    results = {
        name: [trial(case, options.seed + i, options.judged) for i in range(trials)] for name, case in CASES.items()
    }
    table = Table(title=f"Paths on the true surface, {trials} seeds from {options.seed}; distances in mm, where seen")
    for column in ("object", "path", "found", "planned", "model off", "RMS", "p95", "max", "<= 3"):
        table.add_column(column, justify="left" if column in ("object", "path") else "right", no_wrap=True)
    for name, found in results.items():
        accepted = sum(each["accepted"] for each in found)
        for path in CASES[name].paths:
            rows = [each["paths"][path] for each in found if "path_max_m" in each["paths"].get(path, {})]
            if not rows:
                table.add_row(name, path, f"{accepted}/{trials}", "0")
                continue
            rms = np.sqrt(np.mean([row["path_rms_m"] ** 2 for row in rows]))
            table.add_row(
                name, path, f"{accepted}/{trials}", str(len(rows)),
                f"{1e3 * min(r['model_max_m'] for r in rows):.0f} to {1e3 * max(r['model_max_m'] for r in rows):.0f}",
                f"{1e3 * rms:.2f}", f"{1e3 * np.median([r['path_p95_m'] for r in rows]):.1f}",
                f"{1e3 * max(r['path_max_m'] for r in rows):.1f}",
                f"{np.mean([r['within'] for r in rows]):.1%}",
            )  # fmt: skip
    console.print(table)
    (folder / "paths.json").write_text(json.dumps(results, indent=1), encoding="utf-8")
    picture(results, str(folder / "paths.png"))
    console.print(f"written to {folder}/", highlight=False)
    planned = [path for found in results.values() for each in found for path in each["paths"].values()]
    return 0 if planned and all(path.get("path_max_m", 0.0) < BOUND for path in planned) else 1


if __name__ == "__main__":
    run_scenario(main)
