"""Metrics of an inspection flight, from its recording and the true pose of the object.

The distance is measured from the true camera to the outline of the true object as seen from above,
at half the object's height. The view angle is the angle between the camera's horizontal direction
and the direction to the nearest point of the outline. A surface sample is seen if, from some pose
of the flight, it was in the image, faced the camera, and was not occluded by the object. In a
flight of several levels, distance and view angle are evaluated on the first level. Coverage is the
share of the surface that is visible at all from places where hull and arm keep their clearance.
Undersides, and surfaces that lie on the seabed, do not count.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from uuv.models.meshes.visibility import SurfaceSamples, View
from uuv.models.objects.targets import TargetModel
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric, unmeasured
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    inverse,
    pose,
    rotation_from_quat_wxyz,
    transform_points,
)

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

_EVERY = 1.0  # [s] between poses at which visibility is evaluated


class MeasuredSurface(Protocol):
    """Mesh of the surface that was seen, in the object's frame as the vehicle identified it."""

    @property
    def vertices(self) -> Array:
        """Vertices (V, 3) [m]."""
        ...

    @property
    def deviation(self) -> Array:
        """Signed distance (V,) [m] of each vertex from the model."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionBounds:
    """Acceptance bounds of an inspection flight."""

    distance: float = 0.05  # [m] peak error from the set distance
    distance_rms: float = 0.03  # [m]
    view: float = float(np.radians(10.0))  # [rad]
    ends: float = 0.05  # [m] between first and last position of the camera
    coverage: float = 0.0  # share of what can be seen
    # [m] 95th percentile of the measured surface's distance from the true surface
    mesh: float = 0.005


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueInspection:
    """True object and camera, and the commanded distance."""

    target: TargetModel
    X_WT: Array  # (4, 4)
    X_BC: Array  # (4, 4) camera in the hull
    half_view: tuple[float, float]  # tangents of half the fields of view, horizontal and vertical
    far: float  # [m] range limit of the camera
    distance: float  # [m] set distance
    # (n, 4, 4) allowed camera poses X_WC
    allowed: Array = field(default_factory=lambda: np.empty((0, 4, 4)))

    def __post_init__(self) -> None:
        for name in ("X_WT", "X_BC"):
            object.__setattr__(self, name, checked(getattr(self, name), (4, 4), name))
        if not (self.far > 0.0 and self.distance > 0.0 and min(self.half_view) > 0.0):
            raise ConfigurationError("inspection: half_view, far and distance must be > 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionMetrics:
    """Distance from the object, view angle, and share of the surface that was seen."""

    distance_set_m: float | None = metric(minimum=0)
    distance_rms_m: float | None = metric(
        "Error of the true distance from the camera to the outline, at half the object's height.",
        minimum=0,
    )
    distance_max_m: float | None = metric(minimum=0)
    view_max_rad: float | None = metric(
        "Angle between the camera's level direction and the direction to the nearest point of the "
        "outline.",
        minimum=0,
    )
    ends_m: float | None = metric(
        "Distance between the camera's first and last positions.", minimum=0
    )
    seen_share: float | None = metric(
        "Share of the object's surface that was seen.", maximum=1, minimum=0
    )
    coverage: float | None = metric(
        "Share that was seen of the surface visible from any position where the vehicle keeps its "
        "clearance.",
        maximum=1,
        minimum=0,
    )
    levels: int | None = metric(
        "Number of orbits flown; distance, view angle and gap between the ends are those of the "
        "first orbit.",
        minimum=0,
    )
    flown_s: float | None = metric(minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshMetrics:
    """Distances of the measured surface from the true object at the identified pose, and from the
    model.
    """

    vertices: int = metric(minimum=0)
    true_p50_m: float | None = metric(
        "Median of the distances of the measured vertices from the true surface.", minimum=0
    )
    true_p95_m: float | None = metric(minimum=0)
    model_p95_m: float | None = metric(
        "95th percentile of the distances from the model, which include measurement error and "
        "true deviation.",
        minimum=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionRunMetrics:
    """Metrics of an inspection flight."""

    inspection: InspectionMetrics
    mesh: MeshMetrics | None = metric("Surface that was measured; null if none was.")


def schema() -> dict[str, Any]:
    """JSON Schema of an inspection's metrics.json."""
    about = "What inspect_object.py writes to metrics.json"
    return run_schema(InspectionRunMetrics, "Figures of an inspection flight", about)


def assess_inspection(
    recording: "Recording",
    truth: TrueInspection,
    *,
    seed: int,
    wall_s: float,
    bounds: InspectionBounds | None = None,
    measured: MeasuredSurface | None = None,
) -> Assessment:
    """All metrics of a flight. A metric that could not be measured is None and counts as missed.

    Args:
        recording: The run.
        truth: True object, camera, and set distance.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        bounds: Acceptance bounds; default: `InspectionBounds()`.
        measured: Surface that was measured; None if none was requested.

    Returns:
        The assessment.
    """
    bounds = bounds or InspectionBounds()
    flown = np.flatnonzero(recording.within(WorkState.WORK))
    figures = _flight_figures(recording, truth, flown)

    mm = 1e3
    degrees = float(np.degrees(1.0))
    checks = (
        Requirement("distance, RMS error", figures.distance_rms_m, bounds.distance_rms, "mm", mm),
        Requirement("distance, peak error", figures.distance_max_m, bounds.distance, "mm", mm),
        Requirement("pointing error, peak", figures.view_max_rad, bounds.view, "deg", degrees),
        Requirement(
            "gap between start and end of the orbit", figures.ends_m, bounds.ends, "mm", mm
        ),
        Requirement("surface seen", figures.seen_share, None, "%", 100.0),
        Requirement(
            "visible surface not covered",
            None if figures.coverage is None else 1.0 - figures.coverage,
            1.0 - bounds.coverage if bounds.coverage > 0.0 else None,
            "%",
            100.0,
        ),
        Requirement("time on the orbit", figures.flown_s, None, "s"),
    )

    mesh = None if measured is None else mesh_figures(measured, truth)
    if mesh is not None:
        checks = (
            *checks,
            Requirement("mesh error, median", mesh.true_p50_m, None, "mm", mm),
            Requirement("mesh error, 95 %", mesh.true_p95_m, bounds.mesh, "mm", mm),
        )

    metrics = InspectionRunMetrics(inspection=figures, mesh=mesh)
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s)


def _flight_figures(
    recording: "Recording", truth: TrueInspection, flown: NDArray[np.intp]
) -> InspectionMetrics:
    """Figures of the samples `flown`; without samples, only the set distance."""
    if not len(flown):
        return unmeasured(InspectionMetrics, distance_set_m=truth.distance)

    every = max(1, round(0.1 / recording.timestep))
    levels = [level[::every] for level in np.split(flown, np.flatnonzero(np.diff(flown) > 1) + 1)]
    X_WC = camera_poses(recording, truth, levels[0])
    off, view = off_and_view(X_WC, truth)
    step = max(1, round(_EVERY / 0.1))
    views = np.concatenate([camera_poses(recording, truth, level[::step]) for level in levels])

    return InspectionMetrics(
        distance_set_m=truth.distance,
        distance_rms_m=float(np.sqrt(np.mean(off**2))),
        distance_max_m=float(np.abs(off).max()),
        view_max_rad=float(view.max()),
        ends_m=float(np.linalg.norm(X_WC[-1, :3, 3] - X_WC[0, :3, 3])),
        seen_share=seen_share(views, truth),
        coverage=coverage(views, truth),
        levels=len(levels),
        flown_s=float(len(flown) * recording.timestep),
    )


def mesh_figures(measured: MeasuredSurface, truth: TrueInspection) -> MeshMetrics:
    """Figures of a measured surface, given in the object's frame as the vehicle identified it."""
    if not len(measured.vertices):
        return unmeasured(MeshMetrics, vertices=0)

    from uuv.models.meshes.nearest_surface import NearestSurface

    off = (
        NearestSurface.of(truth.target.vertices, truth.target.triangles)
        .query(measured.vertices)
        .distance
    )
    return MeshMetrics(
        vertices=len(off),
        true_p50_m=float(np.median(off)),
        true_p95_m=float(np.percentile(off, 95.0)),
        model_p95_m=float(np.percentile(np.abs(measured.deviation), 95.0)),
    )


def camera_poses(recording: "Recording", truth: TrueInspection, rows: np.ndarray) -> Array:
    """True camera poses in W.

    Args:
        recording: The run.
        truth: Holds the camera's pose in the hull.
        rows: Steps (n,) of the recording.

    Returns:
        X_WC (n, 4, 4).
    """
    p = recording["p_WB"].value[rows]
    quat = recording["quat_WB_wxyz"].value[rows]
    return np.array(
        [pose(rotation_from_quat_wxyz(q), at) @ truth.X_BC for q, at in zip(quat, p, strict=True)]
    )


def off_and_view(X_WC: Array, truth: TrueInspection) -> tuple[Array, Array]:
    """Error of the cameras' distance from the outline, and the angle between view and nearest
    point.
    """
    vertices = transform_points(truth.X_WT, truth.target.vertices)
    from scipy.spatial import ConvexHull

    # Nearest points of the outline, as seen from above.
    outline = vertices[ConvexHull(vertices[:, :2]).vertices, :2]
    side = np.roll(outline, -1, axis=0) - outline
    off = X_WC[:, None, :2, 3] - outline
    share = np.clip(
        np.einsum("nki,ki->nk", off, side) / np.einsum("ki,ki->k", side, side), 0.0, 1.0
    )
    away = off - share[..., None] * side

    rows = np.arange(len(away))
    nearest = np.linalg.norm(away, axis=2).argmin(axis=1)
    way = -away[rows, nearest]
    level = np.linalg.norm(way, axis=1)
    middle = 0.5 * (vertices[:, 2].min() + vertices[:, 2].max())

    axis = X_WC[:, :2, 2]
    cross = axis[:, 0] * way[:, 1] - axis[:, 1] * way[:, 0]
    view = np.abs(np.arctan2(cross, np.einsum("ni,ni->n", axis, way)))
    return np.hypot(level, X_WC[:, 2, 3] - middle) - truth.distance, view


def seen_share(X_WC: Array, truth: TrueInspection) -> float:
    """Share of the object's surface that is seen by at least one of the cameras at `X_WC` (n, 4,
    4).
    """
    return float(_seen(X_WC, truth).mean())


def coverage(X_WC: Array, truth: TrueInspection) -> float | None:
    """Share that cameras (n, 4, 4) saw of the surface visible from allowed poses; None if none is.

    The surface that they saw counts as visible, since the allowed poses are samples on a grid.
    """
    covered = _seen(X_WC, truth)
    visible = covered | _seen(truth.allowed, truth)
    return float(covered.sum() / visible.sum()) if visible.any() else None


def _seen(X_WC: Array, truth: TrueInspection) -> np.ndarray:
    samples = SurfaceSamples(truth.target.vertices, truth.target.triangles)
    return samples.seen(inverse(truth.X_WT) @ X_WC, View(truth.half_view, truth.far))
