"""Tool paths on fouled and dented objects against their true surface: one scene, and the table of
many.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from uuv.experiment import Row, Summary, Table
from uuv.models.meshes.closed_shells import vertex_normals
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects import deformed
from uuv.models.objects.deformed import Deformed
from uuv.models.objects.targets import (
    ModelPath,
    TargetModel,
    barrel,
    longitudinal,
    pile,
    ring,
    transverse,
    vertical,
)
from uuv.perception.clouds.scan import Scan
from uuv.perception.finding.target_finder import Frame, with_fused_frames
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.toolpath.path_deviation import deviate
from uuv.perception.toolpath.path_planner import carry, densified, plan_path
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.interfaces.errors import PerceptionError
from uuv.sim.interfaces.spatial import Array, inverse, pose, rotation_from_z
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.depth_camera import NOISE, DepthCamera
from uuv.sim.sensors.stereo_noise import StereoNoise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BOUND = 0.003  # [m] allowed distance of the path from the true surface
_AHEAD = 0.08  # [m] before the path, where rays to the true surface start
# patches; the found rotation about a symmetry axis is up to 30 deg off, and paths may miss some
_PATCHES = 8
_PAD = 0.045  # [m] radius of the tool's pad
# [m] standard deviation of the camera's position between frames; known to the vehicle
_SWAY = 0.005


@dataclass(frozen=True)
class PathScene:
    """One object with its deformation, its paths and the camera's position."""

    known: TargetModel
    kind: str  # "fouled" or "dented"
    height: tuple[float, float]  # [m] least and greatest height of growth or depth of dents
    paths: Mapping[str, ModelPath]
    view: tuple[float, float, float]  # [m] position of the camera in T

    def seen(
        self, streams: Streams, count: int, noise: StereoNoise | None = NOISE
    ) -> tuple[Deformed, list[Frame]]:
        """Draws the deformed object and its depth frames.

        Args:
            streams: Draw deformation, camera position and frames.
            count: Number of frames.
            noise: Stereo noise; None: exact depth.

        Returns:
            The deformed object, its frames.
        """
        near = np.vstack([path.p for path in self.paths.values()])
        deform = getattr(deformed, self.kind)
        true = deform(self.known, streams["deformation"], _PATCHES, self.height, near)
        eye = np.array(self.view) + streams["camera"].uniform(-0.15, 0.15, 3)
        X_TC = pose(rotation_from_z(-eye, np.cross(-eye, [0.3, 0.9, 0.2])), eye)
        return true, looks_at(true.target, X_TC, count, noise, streams)


_BARREL = (
    barrel(),
    {"longitudinal": longitudinal(), "transverse": transverse(2.0)},
    (0.0, -0.35, 1.2),
)
_PILE = (pile(), {"vertical": vertical(), "ring": ring(1.75)}, (1.8, 0.3, 0.0))
SCENES = {
    f"{kind} {name}": PathScene(known, kind, height, paths, view)
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
    target: TargetModel, X_TC: Array, count: int, noise: StereoNoise | None, streams: Streams
) -> list[Frame]:
    """Depth frames of an object from a camera that sways about a pose and knows where it is.

    Args:
        target: The object.
        X_TC: (4, 4) mean pose of the camera in T.
        count: Number of frames.
        noise: Stereo noise; None: exact depth.
        streams: Draw sway and noise of each frame.

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
    for k in range(count):
        X = X_TC @ pose(p=_SWAY * streams[f"sway {k}"].standard_normal(3))
        camera = DepthCamera(model, "world", X, noise=noise)
        _, image = camera.step(camera.init(streams[f"noise {k}"]), truth)
        looks.append(Frame(scan=Scan.from_depth(image), X_WS=X))
    return looks


class TrueSurface:
    """True surface of an object in T: distances to it and its normals."""

    def __init__(self, target: TargetModel) -> None:
        self._triangles = target.triangles
        self._normals = vertex_normals(target.vertices, target.triangles)
        self._scene = RayScene(target.vertices, target.triangles)
        self._nearest = NearestSurface.of(target.vertices, target.triangles)

    def distances(self, p_T: Array, z_T: Array) -> Array:
        """Distances (N,) [m] from points (N, 3) along the tool's axes (N, 3); the shortest where an
        axis misses.
        """
        along = self._scene.cast(p_T - _AHEAD * z_T, z_T)["t"] - _AHEAD
        return np.where(np.isfinite(along), along, self._nearest.query(p_T).distance)

    def normals(self, p_T: Array) -> Array:
        """Outward unit normals (N, 3) at the surface points nearest to `p_T` (N, 3)."""
        nearest = self._nearest.query(p_T)
        return _unit(
            np.einsum(
                "nk,nkj->nj", nearest.weights, self._normals[self._triangles[nearest.triangle]]
            )
        )

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
                total = total + self.normals(
                    p_T + _PAD * share * (np.cos(angle) * x_T + np.sin(angle) * y_T)
                )
        return _unit(total)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def angles(a: Array, b: Array) -> Array:
    """Angles (N,) [rad] between unit vectors (N, 3)."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))


@dataclass(frozen=True)
class PathCase:
    """One scene with one seed; a case of the study."""

    scene: str  # of SCENES
    seed: int
    looks: int  # depth frames whose median the path is planned on
    exact: bool  # exact depth
    judged: bool  # plan only on accepted identifications


def run(case: PathCase) -> Row:
    """Row of one case: see `trial`."""
    return {"object": case.scene, **trial(SCENES[case.scene], case)}


def trial(scene: PathScene, case: PathCase) -> Row:
    """Identification error, and the deviations of each path of a scene."""
    streams = Streams(case.seed)
    true, looks = scene.seen(streams, case.looks, None if case.exact else NOISE)
    X_CT = inverse(looks[-1].X_WS)
    approach, orientation = coarse_detection(X_CT, streams["detection"])
    found = identify(looks[-1].scan, ModelSurface.of(scene.known), approach, orientation)
    position, angle = scene.known.symmetry.error(found.X_sensor_target, X_CT)
    result: Row = {
        "seed": case.seed,
        "accepted": found.accepted,
        "reason": found.reason,
        "position_error_m": position,
        "orientation_error_rad": angle,
        "paths": {},
    }
    if case.judged and not found.accepted:
        return result
    found = with_fused_frames(replace(found, accepted=True), looks)
    surface = TrueSurface(true.target)
    for name, path in scene.paths.items():
        result["paths"][name] = _of_path(found, path, surface, inverse(X_CT))
    return result


def _of_path(
    found: Identification, path: ModelPath, surface: TrueSurface, X_TS: Array
) -> dict[str, Any]:
    try:
        planned = plan_path(found, path)
    except PerceptionError as error:
        return {"refused": str(error)}
    carried = carry(found.X_sensor_target, densified(path))
    assert found.evidence is not None
    deviation = deviate(found.evidence, found.surface, found.X_sensor_target, carried, 0.05, 0.06)
    share = np.linspace(0.0, 1.0, len(planned.s))
    seen = (
        np.interp(share, np.linspace(0.0, 1.0, len(carried.p)), deviation.seen.astype(float)) > 0.5
    )
    model_T, tool_T = (
        carry(X_TS, carried),
        carry(X_TS, ModelPath(p=planned.p, a=planned.z, b=planned.x)),
    )
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
        "turn_in_pad_rad": _spread(
            angles(surface.mean_normals(tool_T.p, tool_T.b, tool_T.a), normal)[seen]
        ),
        "profile": {
            "s": planned.s[::4].tolist(),
            "off": off[::4].tolist(),
            "seen": seen[::4].tolist(),
        },
    }


def _spread(values: Array) -> dict[str, float] | None:
    """RMS and largest magnitude of `values`; None if empty."""
    if not len(values):
        return None
    return {"rms": float(np.sqrt(np.mean(values**2))), "max": float(np.abs(values).max())}


def cells_of(paths: list[dict[str, Any]], trials: int) -> list[str]:
    """Cells of the table for one path of one object: `paths` planned or refused, in `trials`
    scenes.
    """

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


def summarise(rows: list[Row], looks: str) -> Summary:
    """Table by object and path; the bound is that of all seen parts of all paths.

    Args:
        rows: Rows of all scenes.
        looks: Number and kind of the depth frames, for the title.
    """
    results = {name: [row for row in rows if row["object"] == name] for name in SCENES}
    trials = len(rows) // len(SCENES)
    cells = [
        (name, path, *cells_of([each["paths"][path] for each in found if each["paths"]], trials))
        for name, found in results.items()
        for path in SCENES[name].paths
    ]
    planned = [path for row in rows for path in row["paths"].values()]
    worst = max((path["path_m"]["max"] for path in planned if path.get("path_m")), default=None)
    failed = (
        []
        if worst is not None and worst < BOUND
        else [f"off the true surface: {_mm(worst)}, allowed {_mm(BOUND)}"]
    )
    table = Table(
        title=f"Paths on the true surface, {trials} seeds from {rows[0]['seed']}, {looks}; RMS "
        "and largest",
        caption="model, path (where seen) and unseen: off the true surface in mm; tilt of the "
        "tool and turn of the "
        "true normal within the pad, where seen, in deg",
        columns=(*_COLUMNS, "tilt", "max", "turn"),
        rows=cells,
        labels=2,
    )
    return Summary(
        metrics={"worst_m": worst}, tables=[table], pictures=_pictures(results), failed=failed
    )


_COLUMNS = (
    "object",
    "path",
    "refused",
    "seen",
    "model",
    "max",
    "path",
    "max",
    "<= 3",
    "unseen max",
)


def _mm(value: float | None) -> str:
    return "no path" if value is None else f"{1e3 * value:.1f} mm"


def _pictures(results: dict[str, list[Row]]) -> Iterator[tuple[str, str, "Figure"]]:
    yield (
        "Paths",
        "Distance of every path from the true surface, where seen; grey: the bound.",
        picture(results),
    )


def picture(results: dict[str, list[Row]]) -> "Figure":
    """Plots the distance of every planned path from the true surface."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 2.4 * len(results)), layout="constrained")
    for axes, (name, trials) in zip(
        np.atleast_1d(figure.subplots(len(results))), results.items(), strict=True
    ):
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
    return figure
