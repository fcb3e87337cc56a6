"""Tool paths on fouled and dented objects: how far path and model lie off the true surface.

For each seed an object is drawn, seen by the depth camera in a few frames from nearly one place, found in the last, and
a path planned on the median of all. Distances are taken along the tool's axis from the path to the true surface. What
the camera saw and what it did not are told apart.
"""

from _start import ScenarioOptions, parse, run_scenario  # isort: skip

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from _contact_options import coarse_detection
from rich.console import Console
from rich.table import Table

from models import deformed, open3d_loader
from models.targets import ModelPath, TargetModel, barrel, longitudinal, pile, ring, transverse, vertical
from perception.identification import Identification, identify
from perception.looks import Look, on_all_looks
from perception.path_deviation import deviate
from perception.registration import ModelSurface
from perception.scan import Scan
from perception.toolpath import carry, densified, plan_path
from sim.depth_camera import DepthCamera
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.spatial import Array, inverse, pose, rotation_from_z, transform_points

BOUND = 0.003  # [m] within which the path on the true surface must be
_AHEAD = 0.08  # [m] before the path, where rays to the true surface begin
_PATCHES = 8  # a symmetric object may be found up to 30 deg around, its paths beside some of them
_SWAY = 0.005  # [m] from frame to frame, which the vehicle knows


@dataclass(kw_only=True)
class Options(ScenarioOptions):
    """Paths on objects that are not as their models."""

    trials: int = 10
    """Seeds of each object, from --seed on."""
    looks: int = 16
    """Depth frames whose median a path is planned on."""
    judged: bool = True
    """Plan only on what identification accepts (--no-judged: on its best pose, whatever the check says)."""


@dataclass(frozen=True)
class Case:
    """One object and what is done with it."""

    known: TargetModel
    kind: str  # "fouled" or "dented"
    height: tuple[float, float]  # [m] of growth or dents, least and most
    paths: Mapping[str, ModelPath]
    view: tuple[float, float, float]  # [m] of the camera in T

    def true(self, rng: np.random.Generator) -> TargetModel:
        """The object as the sea left it."""
        near = np.vstack([path.p for path in self.paths.values()])
        return getattr(deformed, self.kind)(self.known, rng, _PATCHES, self.height, near).target


_BARREL = (barrel(), {"longitudinal": longitudinal(), "transverse": transverse(2.0)}, (0.0, -0.35, 1.2))
_PILE = (pile(), {"vertical": vertical(), "ring": ring(1.75)}, (1.8, 0.3, 0.0))
CASES = {
    f"{kind} {name}": Case(known, kind, height, paths, view)
    for name, (known, paths, view) in (("barrel", _BARREL), ("pile", _PILE))
    for kind, height in (("fouled", (0.01, 0.04)), ("dented", (0.01, 0.03)))
}


@dataclass(kw_only=True)
class _Poses:
    """What a depth camera asks of the plant's truth."""

    time: float
    xpos: Array
    xmat: Array


def looks_at(target: TargetModel, X_TC: Array, count: int, rng: np.random.Generator) -> list[Look]:
    """`count` frames of `target` from a camera that sways about `X_TC` (4, 4), which it knows; poses in T."""
    spec = mujoco.MjSpec()
    target.add_to(spec, np.eye(4), stand=False, felt=False)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    truth = _Poses(time=0.0, xpos=data.xpos, xmat=data.xmat)
    looks: list[Look] = []
    for _ in range(count):
        X = X_TC @ pose(p=_SWAY * rng.standard_normal(3))
        camera = DepthCamera(model, "world", X)
        looks.append(Look(scan=Scan.from_depth(camera.step(camera.init(rng), truth)[1]), X_WS=X))
    return looks


def distances(scene: Any, X_TS: Array, p: Array, z: Array) -> Array:
    """Distances (N,) [m] along the tool's axes from points in S to the true surface; inf where there is none."""
    z_T = z @ X_TS[:3, :3].T
    return open3d_loader.cast_rays(scene, transform_points(X_TS, p) - _AHEAD * z_T, z_T)["t"] - _AHEAD


def trial(case: Case, seed: int, count: int, judged: bool) -> dict[str, Any]:
    """One seed: what came of identification, and of each path."""
    rng = np.random.default_rng(seed)
    true = case.true(rng)
    eye = np.array(case.view) + rng.uniform(-0.15, 0.15, 3)
    looks = looks_at(true, pose(rotation_from_z(-eye, np.cross(-eye, [0.3, 0.9, 0.2])), eye), count, rng)
    X_CT = inverse(looks[-1].X_WS)
    approach, orientation = coarse_detection(X_CT, rng)
    found = identify(looks[-1].scan, ModelSurface.of(case.known), approach, orientation)
    position, angle = case.known.symmetry.error(found.X_sensor_target, X_CT)
    result: dict[str, Any] = {
        "seed": seed, "accepted": found.accepted, "reason": found.reason,
        "position_error_m": position, "orientation_error_rad": angle, "paths": {},
    }  # fmt: skip
    if judged and not found.accepted:
        return result
    found = on_all_looks(replace(found, accepted=True), looks)
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
    if options.looks < 1:
        raise ConfigurationError(f"--looks: must be at least 1, got {options.looks}")
    folder, console = options.folder("study_paths"), Console()
    console.width = max(console.width, 110)  # the table is wider than a terminal must be
    trials = 2 if options.quick else options.trials
    results = {
        name: [trial(case, options.seed + i, options.looks, options.judged) for i in range(trials)]
        for name, case in CASES.items()
    }
    table = Table(
        title=f"Paths on the true surface, {trials} seeds from {options.seed}, {options.looks} looks; in mm, where seen"
    )
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
