"""Is the fit true? Paper 002's check by a projected trajectory, made robust.

Curves in a plane perpendicular to o = -(S - H_D)/|S - H_D| are projected along o on the scanned and on the fitted
model's triangulated surface (eq. 2); the distances E_i between both projections say how far the surfaces lie apart.

The paper's Q = sqrt(sum E_i^2) grows with the number of rays and has no rule for rays that miss, and a few rays at
edges dominate it. Here: a trimmed rms over rays that should hit both, the share of rays that agree, the share where
the scan sees through the model, and the offset of sharp depth edges, for what no projection can feel.
"""

from dataclasses import dataclass

import numpy as np

from models import open3d_loader
from perception.registration import Evidence, ModelSurface, edge_offsets
from perception.scan import jump, triangulate
from sim.interfaces.spatial import Array, inverse, transform_points

TRIM = 0.15  # share of the largest distances left out of the figure
MODEL_TOLERANCE = 0.001  # [m], how truly a model is known
_RAY_STEP = 0.006  # [m] along the curves
_LINES = 8
_SURFACE_PIXELS = 40_000  # the scan is thinned to this before it is triangulated: finer than the rays lie
_MIN_RAYS = 40
_PATCHES = 9.0  # patches to the model's radius
_PATCH_RAYS = 5
_PATCH_TRIM = 0.25  # share of patches that may be fouled or dented
# Limits on shares of rays and edges (0..1), set between true poses and poses 5 deg or 2 cm off (tests/unit).
MIN_AGREEMENT = 0.70
MAX_THROUGH = 0.12
MIN_EDGE_SHARE = 0.25
MAX_GOES_ON = 0.35


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Check:
    """Figures of the check and their limits; `reason` is empty if all hold."""

    figure_m: float  # [m] trimmed rms distance of both projections along o; inf if it could not be made
    threshold_m: float  # [m] its limit, from the sensor's noise and resolution at this range
    form_m: float  # [m] trimmed rms of the patch medians of the same distances, signed: what noise does not explain
    form_threshold_m: float  # [m]
    agreement: float  # share of the rays where both surfaces lie within that limit (3 sigma each)
    through: float  # share of the rays where the scan lies behind the model's surface
    rays: int  # that should hit both
    edge_m: float  # [m] median offset of sharp depth edges along their worst direction; NaN without any in view
    edge_threshold_m: float  # [m]
    edge_share: float  # share of sharp depth edges found in the scan; NaN without any in view
    goes_on: float  # share of sharp model edges beyond which the scanned surface goes on
    points_scan: Array  # (K, 3) [m] projections C_i on the scan, in S, rays that hit both
    points_model: Array  # (K, 3) [m] projections C'_i on the model, in S
    reason: str


def check(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> Check:
    """Judge the pose `X_ST` (4, 4) of the model against the scan."""
    sensor = evidence.sensor
    visible = surface.visible(X_ST, evidence.scan, sensor.max_incidence)
    if visible.sum() < 10:
        return _unmade("the model at the fitted pose is out of view")
    H_D = transform_points(X_ST, surface.points[visible]).mean(axis=0)
    o = H_D / np.linalg.norm(H_D)  # S is the origin: o = -(S - H_D)/|S - H_D|
    starts = _curves(H_D, o, transform_points(X_ST, surface.points[visible]))

    X_TS = inverse(X_ST)
    on_model = open3d_loader.cast_rays(
        surface.scene, transform_points(X_TS, starts), np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    )
    C_model = starts + on_model["t"][:, None] * o
    hit = np.isfinite(on_model["t"])
    hit &= _clear_of_edges(
        surface, X_TS, starts, on_model["t"], o, 1.5 * evidence.scan.pitch * float(np.linalg.norm(H_D))
    )
    normals = on_model["normal"] @ X_ST[:3, :3].T
    C_model, normals, starts, t_model = C_model[hit], normals[hit], starts[hit], on_model["t"][hit]
    # The rays are parallel, the sensor's are not: keep those whose model point the sensor itself should see.
    line = C_model / np.linalg.norm(C_model, axis=1, keepdims=True)
    origin_T = X_TS[:3, 3]
    sight = open3d_loader.cast_rays(surface.scene, origin_T, transform_points(X_TS, C_model) - origin_T)["t"]
    cosine = np.abs(np.einsum("ij,ij->i", normals, line))
    expected = (sight > 0.995) & (cosine > np.cos(np.deg2rad(65.0))) & evidence.scan.pixels(C_model)[2]
    if expected.sum() < _MIN_RAYS:
        return _unmade(f"only {int(expected.sum())} check rays meet the visible model; need {_MIN_RAYS}")
    C_model, cosine, starts, t_model = C_model[expected], cosine[expected], starts[expected], t_model[expected]

    part = evidence.scan.part(evidence.scan.window(C_model, 0.05, _SURFACE_PIXELS))
    vertices, triangles = triangulate(part, part.depth > 0.0)
    if not len(triangles):
        return _unmade("the scan has no surface")
    on_scan = open3d_loader.cast_rays(
        open3d_loader.ray_scene(vertices, triangles), starts, np.broadcast_to(o, starts.shape)
    )["t"]
    both = np.isfinite(on_scan)
    E = np.where(both, on_scan - t_model, np.inf)
    pitch = evidence.scan.pitch * C_model[:, 2]
    slope = np.sqrt(1.0 - cosine**2) / cosine
    sigma = np.sqrt(sensor.sigma(C_model[:, 2]) ** 2 + (pitch * slope) ** 2 + MODEL_TOLERANCE**2)
    near = np.abs(E) < 3.0 * sigma
    # A ray past the scanned object meets what is behind it, or nothing.
    through = ~near & (E > 0.0)
    if both.sum() < _MIN_RAYS:
        return _unmade(f"only {int(both.sum())} check rays meet the scan; need {_MIN_RAYS}")
    figure = _trimmed_rms(E[both], TRIM)
    threshold = 1.5 * float(np.sqrt(np.mean(sigma**2)))
    form, rays_a_patch = _form(C_model[both], E[both], surface.radius / _PATCHES)
    form_threshold = MODEL_TOLERANCE + 1.1 * float(np.sqrt(np.mean(sigma**2) / rays_a_patch))

    offsets, edge_share, goes_on = edge_offsets(evidence, surface, X_ST)
    edge = float(np.median(np.abs(offsets))) if len(offsets) else np.nan
    edge_threshold = 3.0 * float(np.median(pitch)) + 0.002
    agreement, seen_through = float(near.mean()), float(through.mean())
    failures = [
        text
        for failed, text in (
            (figure > threshold, f"surfaces lie {1e3 * figure:.1f} mm apart, limit {1e3 * threshold:.1f} mm"),
            (form > form_threshold, f"shapes differ by {1e3 * form:.1f} mm, limit {1e3 * form_threshold:.1f} mm"),
            (agreement < MIN_AGREEMENT, f"only {agreement:.0%} of the check rays agree, need {MIN_AGREEMENT:.0%}"),
            (seen_through > MAX_THROUGH, f"the scan sees through {seen_through:.0%} of the model"),
            (edge > edge_threshold, f"edges lie {1e3 * edge:.1f} mm apart, limit {1e3 * edge_threshold:.1f} mm"),
            (edge_share < MIN_EDGE_SHARE, f"only {edge_share:.0%} of the model's edges are in the scan"),
            (goes_on > MAX_GOES_ON, f"the surface goes on beyond {goes_on:.0%} of the model's edges"),
        )
        if failed
    ]
    return Check(
        figure_m=figure,
        threshold_m=threshold,
        form_m=form,
        form_threshold_m=form_threshold,
        agreement=agreement,
        through=seen_through,
        rays=len(E),
        edge_m=edge,
        edge_threshold_m=edge_threshold,
        edge_share=edge_share,
        goes_on=goes_on,
        points_scan=(starts + np.where(both, on_scan, 0.0)[:, None] * o)[both],
        points_model=C_model[both],
        reason="; ".join(failures),
    )


def _clear_of_edges(
    surface: ModelSurface, X_TS: Array, starts: Array, t: np.ndarray, o: Array, margin: float
) -> np.ndarray:
    """Mask (N,) of the rays that meet the same face of the model when moved aside by `margin` [m]."""
    clear = np.ones(len(starts), dtype=bool)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    u = _across(o)
    v = np.cross(o, u)
    for aside in (u, -u, v, -v):
        beside = open3d_loader.cast_rays(surface.scene, transform_points(X_TS, starts + margin * aside), way)["t"]
        with np.errstate(invalid="ignore"):
            clear &= np.abs(beside - t) < jump(0.0) + 3.0 * margin
    return clear


def _across(o: Array) -> Array:
    """A unit vector perpendicular to `o`."""
    u = np.cross(o, [0.0, 1.0, 0.0] if abs(o[1]) < 0.9 else [1.0, 0.0, 0.0])
    return u / np.linalg.norm(u)


def _trimmed_rms(distances: Array, trim: float) -> float:
    kept = np.sort(np.abs(distances))[: max(1, int((1.0 - trim) * len(distances)))]
    return float(np.sqrt(np.mean(kept**2)))


def _form(points: Array, E: Array, size: float) -> tuple[float, float]:
    """Trimmed rms [m] of the medians of `E` (N,) over cubes of edge `size` [m], and the mean number of rays in one.

    Averaging takes the noise out and leaves what is wrong with shape and pose.
    """
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    _, patch, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    medians = np.array([np.median(E[patch == i]) for i in np.nonzero(count >= _PATCH_RAYS)[0]])
    if len(medians) < 4:
        return 0.0, 1.0
    return _trimmed_rms(medians, _PATCH_TRIM), float(count[count >= _PATCH_RAYS].mean())


def _curves(H_D: Array, o: Array, points: Array) -> Array:
    """Points c_i (N, 3) of lines and circles in a plane across `o`, before the object, that cross all of it."""
    u = _across(o)
    v = np.cross(o, u)
    offset = points - H_D
    reach = float(np.linalg.norm(offset - np.outer(offset @ o, o), axis=1).max())
    s = np.arange(-reach, reach + _RAY_STEP, _RAY_STEP)
    flat = [np.outer(s, [np.cos(angle), np.sin(angle)]) for angle in np.linspace(0.0, np.pi, _LINES, endpoint=False)]
    for share in (0.35, 0.7):
        angle = np.arange(0.0, 2.0 * np.pi, _RAY_STEP / (share * reach))
        flat.append(share * reach * np.column_stack([np.cos(angle), np.sin(angle)]))
    plane = np.vstack(flat)
    before = min(float((offset @ o).min()) - 0.3, -0.05)
    return H_D + before * o + plane @ np.stack([u, v])


def _unmade(reason: str) -> Check:
    nothing = np.zeros((0, 3))
    return Check(
        figure_m=np.inf,
        threshold_m=0.0,
        form_m=np.inf,
        form_threshold_m=0.0,
        agreement=0.0,
        through=0.0,
        rays=0,
        edge_m=np.nan,
        edge_threshold_m=0.0,
        edge_share=np.nan,
        goes_on=np.nan,
        points_scan=nothing,
        points_model=nothing,
        reason=reason,
    )
