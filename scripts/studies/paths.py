"""Study: deviation of tool paths from the true surface of fouled and dented objects.

For each seed an object is drawn and seen by the depth camera in a few frames from nearly one position. It is identified
in the last frame, and a path is planned on the median of all. Distances to the true surface are taken along the tool's
axis, from the path and from the undeformed model. The tool's tilt is relative to the true normal at its tip. Beside it
stands the change of that normal within the pad. Seen and unseen parts of the path are listed separately.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from models.meshes.closed_shells import vertex_normals
from models.meshes.nearest_surface import NearestSurface
from models.meshes.ray_casting import RayScene
from models.objects import deformed
from models.objects.deformed import Deformed
from models.objects.targets import ModelPath, TargetModel, barrel, longitudinal, pile, ring, transverse, vertical
from perception.clouds.scan import Scan
from perception.registration.fine_fit import ModelSurface
from perception.registration.identification import Identification, identify
from perception.registration.multi_frame import Frame, with_fused_frames
from perception.toolpath.path_deviation import deviate
from perception.toolpath.path_planner import carry, densified, plan_path
from scenarios.site import coarse_detection
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.spatial import Array, inverse, pose, rotation_from_z
from sim.runs.saving import write_whole
from sim.sensors.depth_camera import NOISE, DepthCamera
from sim.sensors.stereo_noise import StereoNoise

BOUND = 0.003  # [m] allowed distance of the path from the true surface
_AHEAD = 0.08  # [m] before the path, where rays to the true surface start
_PATCHES = 8  # patches; the found rotation about a symmetry axis is up to 30 deg off, and paths may miss some
_PAD = 0.045  # [m] radius of the tool's pad
_SWAY = 0.005  # [m] standard deviation of the camera's position between frames; known to the vehicle


@dataclass(kw_only=True)
class Options:
    """Tool paths on objects that deviate from their models."""

    seed: int = 0
    """First seed."""
    trials: int = 10
    """Number of seeds for each object, from --seed on."""
    looks: int = 1
    """Depth frames whose median the path is planned on; jobs with possible growth or dents take 16."""
    exact: bool = False
    """Exact depth: shows the errors due to the camera's resolution and the path's smoothing alone."""
    judged: bool = True
    """Plan only on accepted identifications (--no-judged: on the best pose in any case)."""
    out: Path | None = None
    """Folder for paths.json and paths.png."""


@dataclass(frozen=True)
class PathCase:
    """One object with its deformation, its paths and the camera's position."""

    known: TargetModel
    kind: str  # "fouled" or "dented"
    height: tuple[float, float]  # [m] least and greatest height of growth or depth of dents
    paths: Mapping[str, ModelPath]
    view: tuple[float, float, float]  # [m] position of the camera in T

    def seen(
        self, rng: np.random.Generator, count: int, noise: StereoNoise | None = NOISE
    ) -> tuple[Deformed, list[Frame]]:
        """Draws the deformed object and its depth frames.

        Args:
            rng: Draws deformation, camera position and noise.
            count: Number of frames.
            noise: Stereo noise; None: exact depth.

        Returns:
            The deformed object, its frames.
        """
        near = np.vstack([path.p for path in self.paths.values()])
        true = getattr(deformed, self.kind)(self.known, rng, _PATCHES, self.height, near)
        eye = np.array(self.view) + rng.uniform(-0.15, 0.15, 3)
        X_TC = pose(rotation_from_z(-eye, np.cross(-eye, [0.3, 0.9, 0.2])), eye)
        return true, looks_at(true.target, X_TC, count, noise, rng)


_BARREL = (barrel(), {"longitudinal": longitudinal(), "transverse": transverse(2.0)}, (0.0, -0.35, 1.2))
_PILE = (pile(), {"vertical": vertical(), "ring": ring(1.75)}, (1.8, 0.3, 0.0))
CASES = {
    f"{kind} {name}": PathCase(known, kind, height, paths, view)
    for name, (known, paths, view) in (("barrel", _BARREL), ("pile", _PILE))
    for kind, height in (("fouled", (0.01, 0.04)), ("dented", (0.01, 0.03)))
}


@dataclass(kw_only=True)
class _PathPoses:
    """Body poses in the form in which a depth camera reads the plant's truth."""

    time: float
    xpos: Array
    xmat: Array


def looks_at(
    target: TargetModel, X_TC: Array, count: int, noise: StereoNoise | None, rng: np.random.Generator
) -> list[Frame]:
    """Depth frames of an object from a camera that sways about a pose and knows where it is.

    Args:
        target: The object.
        X_TC: (4, 4) mean pose of the camera in T.
        count: Number of frames.
        noise: Stereo noise; None: exact depth.
        rng: Draws sway and noise.

    Returns:
        Frames with their poses in T.
    """
    spec = mujoco.MjSpec()
    target.add_to(spec, np.eye(4), stand=False, felt=False)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    truth = _PathPoses(time=0.0, xpos=data.xpos, xmat=data.xmat)
    looks: list[Frame] = []
    for _ in range(count):
        X = X_TC @ pose(p=_SWAY * rng.standard_normal(3))
        camera = DepthCamera(model, "world", X, noise=noise)
        looks.append(Frame(scan=Scan.from_depth(camera.step(camera.init(rng), truth)[1]), X_WS=X))
    return looks


class TrueSurface:
    """True surface of an object in T: distances to it and its normals."""

    def __init__(self, target: TargetModel) -> None:
        self._triangles = target.triangles
        self._normals = vertex_normals(target.vertices, target.triangles)
        self._scene = RayScene(target.vertices, target.triangles)
        self._nearest = NearestSurface.of(target.vertices, target.triangles)

    def distances(self, p_T: Array, z_T: Array) -> Array:
        """Distances (N,) [m] from points (N, 3) along the tool's axes (N, 3); the shortest where an axis misses."""
        along = self._scene.cast(p_T - _AHEAD * z_T, z_T)["t"] - _AHEAD
        return np.where(np.isfinite(along), along, self._nearest.query(p_T).distance)

    def normals(self, p_T: Array) -> Array:
        """Outward unit normals (N, 3) at the surface points nearest to `p_T` (N, 3)."""
        nearest = self._nearest.query(p_T)
        return _unit(np.einsum("nk,nkj->nj", nearest.weights, self._normals[self._triangles[nearest.triangle]]))

    def mean_normals(self, p_T: Array, x_T: Array, z_T: Array) -> Array:
        """Outward unit normals averaged over the tool's pad.

        Args:
            p_T: (N, 3) [m] centres of the pad.
            x_T: (N, 3) unit vectors in the pad's plane.
            z_T: (N, 3) unit normals of the pad's plane.

        Returns:
            (N, 3) unit vectors.
        """
        y_T, total = np.cross(z_T, x_T), self.normals(p_T)
        for share, count in ((0.5, 8), (0.9, 14)):  # share of the pad's radius, points on the ring
            for angle in np.linspace(0.0, 2.0 * np.pi, count, endpoint=False):
                total = total + self.normals(p_T + _PAD * share * (np.cos(angle) * x_T + np.sin(angle) * y_T))
        return _unit(total)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def angles(a: Array, b: Array) -> Array:
    """Angles (N,) [rad] between unit vectors (N, 3)."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))


def trial(case: PathCase, seed: int, options: Options) -> dict[str, Any]:
    """Result of one seed: identification error, and the deviations of each path.

    Args:
        case: Object and camera.
        seed: Seed.
        options: Options of the study.
    """
    rng = np.random.default_rng(seed)
    true, looks = case.seen(rng, options.looks, None if options.exact else NOISE)
    X_CT = inverse(looks[-1].X_WS)
    approach, orientation = coarse_detection(X_CT, rng)
    found = identify(looks[-1].scan, ModelSurface.of(case.known), approach, orientation)
    position, angle = case.known.symmetry.error(found.X_sensor_target, X_CT)
    result: dict[str, Any] = {
        "seed": seed,
        "accepted": found.accepted,
        "reason": found.reason,
        "position_error_m": position,
        "orientation_error_rad": angle,
        "paths": {},
    }
    if options.judged and not found.accepted:
        return result
    found = with_fused_frames(replace(found, accepted=True), looks)
    surface = TrueSurface(true.target)
    for name, path in case.paths.items():
        result["paths"][name] = _of_path(found, path, surface, inverse(X_CT))
    return result


def _of_path(found: Identification, path: ModelPath, surface: TrueSurface, X_TS: Array) -> dict[str, Any]:
    try:
        planned = plan_path(found, path)
    except PerceptionError as error:
        return {"refused": str(error)}
    carried = carry(found.X_sensor_target, densified(path))
    assert found.evidence is not None
    deviation = deviate(found.evidence, found.surface, found.X_sensor_target, carried, 0.05, 0.06)
    share = np.linspace(0.0, 1.0, len(planned.s))
    seen = np.interp(share, np.linspace(0.0, 1.0, len(carried.p)), deviation.seen.astype(float)) > 0.5
    model_T, tool_T = carry(X_TS, carried), carry(X_TS, ModelPath(p=planned.p, a=planned.z, b=planned.x))
    model = surface.distances(model_T.p, model_T.a)
    off = surface.distances(tool_T.p, tool_T.a)
    normal = surface.normals(tool_T.p)
    return {
        "seen": float(seen.mean()),
        "model_m": _spread(model[deviation.seen]),
        "path_m": _spread(off[seen]),
        "unseen_m": _spread(off[~seen]),
        "within": float(np.mean(np.abs(off[seen]) < BOUND)) if seen.any() else None,
        "tilt_rad": _spread(angles(-tool_T.a, normal)[seen]),
        "turn_in_pad_rad": _spread(angles(surface.mean_normals(tool_T.p, tool_T.b, tool_T.a), normal)[seen]),
        "profile": {"s": planned.s[::4].tolist(), "off": off[::4].tolist(), "seen": seen[::4].tolist()},
    }


def _spread(values: Array) -> dict[str, float] | None:
    """RMS and largest magnitude of `values`; None if empty."""
    if not len(values):
        return None
    return {"rms": float(np.sqrt(np.mean(values**2))), "max": float(np.abs(values).max())}


def row_of(paths: list[dict[str, Any]], trials: int) -> list[str]:
    """Cells of the table for one path of one object: `paths` planned or refused, in `trials` scenes."""

    def both(name: str, scale: float) -> list[str]:
        spreads = [path[name] for path in planned if path[name] is not None]
        if not spreads:
            return ["-", "-"]
        rms = np.sqrt(np.mean([spread["rms"] ** 2 for spread in spreads]))
        return [f"{scale * rms:.1f}", f"{scale * max(spread['max'] for spread in spreads):.1f}"]

    mm, deg = 1e3, float(np.degrees(1.0))
    planned = [path for path in paths if "refused" not in path]
    within = [path["within"] for path in planned if path["within"] is not None]
    return [
        f"{1.0 - len(planned) / trials:.0%}",
        f"{np.mean([path['seen'] for path in planned]):.0%}" if planned else "-",
        *both("model_m", mm),
        *both("path_m", mm),
        f"{np.mean(within):.1%}" if within else "-",
        both("unseen_m", mm)[1],
        *both("tilt_rad", deg),
        both("turn_in_pad_rad", deg)[0],
    ]


def picture(results: dict[str, list[dict[str, Any]]], file: str) -> None:
    """Plots the distance of every planned path from the true surface into `file`."""
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
    """Runs the study and writes its files; exit code 0 if all seen parts of all paths are within BOUND."""
    options = parse(Options)
    if options.trials < 1:
        raise ConfigurationError(f"--trials: must be at least 1, got {options.trials}")
    if options.looks < 1:
        raise ConfigurationError(f"--looks: must be at least 1, got {options.looks}")
    if options.seed < 0:
        raise ConfigurationError(f"--seed: must not be negative, got {options.seed}")
    folder = new_folder("study_paths", options.out, options.seed)
    console = Console()
    console.width = max(console.width, 125)  # the table is wider than a usual terminal
    seeds = range(options.seed, options.seed + options.trials)
    results = {name: [trial(case, seed, options) for seed in seeds] for name, case in CASES.items()}
    looks = f"{options.looks} {'exact ' * options.exact}looks"
    table = Table(
        title=f"Paths on the true surface, {options.trials} seeds from {options.seed}, {looks}; RMS and largest",
        caption="model, path (where seen) and unseen: off the true surface in mm; tilt of the tool and turn of the "
        "true normal within the pad, where seen, in deg",
    )
    columns = ("object", "path", "refused", "seen", "model", "max", "path", "max", "<= 3", "unseen max")
    for column in (*columns, "tilt", "max", "turn"):
        table.add_column(column, justify="left" if column in columns[:2] else "right", no_wrap=True)
    for name, found in results.items():
        for path in CASES[name].paths:
            table.add_row(name, path, *row_of([each["paths"][path] for each in found if each["paths"]], options.trials))
    console.print(table)
    write_whole(folder / "paths.json", json.dumps(results, indent=1))
    picture(results, str(folder / "paths.png"))
    console.print(f"written to {folder}/", highlight=False)
    planned = [path for found in results.values() for each in found for path in each["paths"].values()]
    worst = max((path["path_m"]["max"] for path in planned if path.get("path_m")), default=np.inf)
    return 0 if worst < BOUND else 1


if __name__ == "__main__":
    run_scenario(main)
