"""Fouled and dented objects: their scenes, and tool paths against their true surface."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

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
from uuv.perception.finding.target_finder import Frame
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
        return true, frames_of(true.target, X_TC, count, noise, streams)


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


def frames_of(
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
    frames: list[Frame] = []
    for k in range(count):
        X = X_TC @ pose(p=_SWAY * streams[f"sway {k}"].standard_normal(3))
        camera = DepthCamera(model, "world", X, noise=noise)
        _, image = camera.step(camera.init(streams[f"noise {k}"]), truth)
        frames.append(Frame(scan=Scan.from_depth(image), X_WS=X))
    return frames


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
        y_T = np.cross(z_T, x_T)
        total = self.normals(p_T)
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


def identified(known: TargetModel, frame: Frame, streams: Streams) -> Identification:
    """Identification of an object in a frame, from a drawn coarse detection."""
    approach, orientation = coarse_detection(inverse(frame.X_WS), streams["detection"])
    return identify(frame.scan, ModelSurface.of(known), approach, orientation)


@dataclass(frozen=True, slots=True, kw_only=True)
class PathFigures:
    """Deviations of one path, over its seen part if not said otherwise; None: there is none."""

    refused: str = ""  # why no path was planned
    seen: float | None = None  # share of the path
    model_rms: float | None = None  # [m] distance of the undeformed model from the true surface
    model_largest: float | None = None
    path_rms: float | None = None  # [m] that of the path
    path_largest: float | None = None
    within: float | None = None  # share of the seen part that is within BOUND
    unseen_largest: float | None = None  # [m] of the path where it is not seen
    tilt_rms: float | None = None  # [rad] of the tool against the true normal
    tilt_largest: float | None = None
    turn_rms: float | None = None  # [rad] of the mean normal within the pad against that at its tip
    profile: Mapping[str, list[float]] | None = None  # arc length [m], distance [m], and seen


def path_figures(
    identification: Identification, path: ModelPath, surface: TrueSurface, X_TS: Array
) -> PathFigures:
    """Plans a path and compares it with the true surface.

    Args:
        identification: Of the object, with the fused frames.
        path: On the undeformed model.
        surface: The true one, in T.
        X_TS: (4, 4) true pose of the sensor in T.
    """
    try:
        planned = plan_path(identification, path)
    except PerceptionError as error:
        return PathFigures(refused=str(error))

    # Which part of the path is seen.
    X_ST = identification.X_sensor_target
    carried = carry(X_ST, densified(path))
    assert identification.evidence is not None
    deviation = deviate(identification.evidence, identification.surface, X_ST, carried, 0.05, 0.06)
    share = np.linspace(0.0, 1.0, len(planned.s))
    along = np.linspace(0.0, 1.0, len(carried.p))
    visible = np.interp(share, along, deviation.seen.astype(float)) > 0.5

    # Model and path off the true surface.
    model_T = carry(X_TS, carried)
    tool_T = carry(X_TS, ModelPath(p=planned.p, a=planned.z, b=planned.x))
    model = surface.distances(model_T.p, model_T.a)[deviation.seen]
    distance = surface.distances(tool_T.p, tool_T.a)

    # The tool against the normal.
    normal = surface.normals(tool_T.p)
    tilt = angles(-tool_T.a, normal)[visible]
    turn = angles(surface.mean_normals(tool_T.p, tool_T.b, tool_T.a), normal)[visible]
    return PathFigures(
        seen=float(visible.mean()),
        model_rms=_rms(model),
        model_largest=_largest(model),
        path_rms=_rms(distance[visible]),
        path_largest=_largest(distance[visible]),
        within=float(np.mean(np.abs(distance[visible]) < BOUND)) if visible.any() else None,
        unseen_largest=_largest(distance[~visible]),
        tilt_rms=_rms(tilt),
        tilt_largest=_largest(tilt),
        turn_rms=_rms(turn),
        profile={
            "s": planned.s[::4].tolist(),
            "distance": distance[::4].tolist(),
            "seen": visible[::4].tolist(),
        },
    )


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def _largest(values: Array) -> float | None:
    return float(np.abs(values).max()) if len(values) else None
