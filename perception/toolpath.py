"""From a path on the model to a tool path on the real surface (paper 002, eq. 3 and after).

The path is carried over with the pose that was found. Where the object is seen well and lies elsewhere than its model
by more than the sensor's noise explains (fouled, silted, dented), points are moved along +-o onto the scanned
triangulation; elsewhere the model is the better measurement and stays. A cubic B-spline smooths the whole.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

from models import open3d_loader
from models.targets import ModelPath
from perception.identification import Identification
from perception.registration import Evidence, ModelSurface
from perception.scan import triangulate
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.messages import ToolPath
from sim.interfaces.spatial import Array, inverse, readonly, transform_points

SEEN_WELL = np.cos(np.deg2rad(60.0))  # cosine of incidence above which a scanned point is trusted
_DENSE = 0.003  # [m] between the points that are projected
_BEFORE = 0.2  # [m] before the path, where projecting rays begin
_SAME_FACE = 0.03  # [m] along o between a path point and the first model surface met, else that is another face
_KNOTS = 0.015  # [m] between the knots of the smoothing spline
_LATERAL = np.array([-0.024, -0.012, 0.0, 0.012, 0.024])  # [m] across the path: neighbours that share one noise patch
_MEDIAN = 0.025  # [m] along the path
_SMOOTH = 0.008  # [m] along the path, width of a Gaussian
_NOISE_PATCH = 2.5  # [px] radius of one independent patch of stereo error
_POSE_ERROR = 0.0015  # [m] that the carried path may be wrong by itself
_RESUME = 0.35  # share of the threshold at which a deviation that was found begins and ends


def plan_path(
    found: Identification, path: ModelPath, *, spacing: float = 0.0015, max_deviation: float = 0.05
) -> ToolPath:
    """The tool path on the real surface, in the sensor frame S.

    `spacing` [m] of the result along its arc length; `max_deviation` [m] along the line of sight, beyond which what
    the scan shows is taken for something else in front of or behind the object.
    Raises PerceptionError if `found` was not accepted, ConfigurationError for a path that stands still.
    """
    if not found.accepted or found.evidence is None:
        raise PerceptionError(f"no tool path on an object that was not found: {found.reason}")
    if not (spacing > 0.0 and max_deviation > 0.0):
        raise ConfigurationError(f"spacing and max_deviation must be positive [m], got {spacing}, {max_deviation}")
    dense = carry(found.X_sensor_target, densified(path))
    deviation = deviate(found.evidence, found.surface, found.X_sensor_target, dense, max_deviation)
    p = dense.p + deviation.along_o[:, None] * deviation.o
    z = dense.a + deviation.share[:, None] * (_tilted_axis(dense, deviation) - dense.a)
    return _smoothed(p, z, deviation.on_scan, spacing)


def carry(X_ST: Array, path: ModelPath) -> ModelPath:
    """The path's points and axes in S: paper 002, eq. (3), with both rotations and centroids in one pose."""
    R = X_ST[:3, :3]
    return ModelPath(p=transform_points(X_ST, path.p), a=path.a @ R.T, b=path.b @ R.T)


def densified(path: ModelPath) -> ModelPath:
    """The same path at _DENSE, through all its points. Raises ConfigurationError if two neighbours coincide."""
    chord = np.linalg.norm(np.diff(path.p, axis=0), axis=1)
    if chord.min() < 1e-9:
        raise ConfigurationError(f"tool path: points {int(chord.argmin())} and {int(chord.argmin()) + 1} coincide")
    u = np.concatenate([[0.0], np.cumsum(chord)])
    fine = np.linspace(0.0, u[-1], max(8, 1 + round(u[-1] / _DENSE)))
    p, a, b = (make_interp_spline(u, values, k=3)(fine) for values in (path.p, path.a, path.b))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return ModelPath(p=p, a=a, b=b / np.linalg.norm(b, axis=1, keepdims=True))


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """How far the scanned surface lies behind (+) or before (-) the model along a path."""

    o: Array  # (3,) unit direction of projection, from the sensor to the object, in S
    along_o: Array  # (N,) [m], 0 where the model is kept
    across: Array  # (N,) slope of the deviation across the path, [m]/[m]
    share: Array  # (N,) of the scan in the result, 0 to 1, without steps
    on_scan: np.ndarray  # (N,) bool
    threshold: Array  # (N,) [m] that a deviation must exceed


def deviate(evidence: Evidence, surface: ModelSurface, X_ST: Array, path: ModelPath, max_deviation: float) -> Deviation:
    """Project a dense `path` (in S) along +-o on the scanned and on the model's surface and compare (eq. 2)."""
    H_D = transform_points(X_ST, surface.center)
    o = H_D / np.linalg.norm(H_D)
    step = float(np.linalg.norm(np.diff(path.p, axis=0), axis=1).mean())
    n = len(path.p)
    lateral = np.cross(path.a, path.b)
    rays = path.p[:, None] + _LATERAL[None, :, None] * lateral[:, None]  # (N, L, 3)
    starts = rays - _BEFORE * o  # X_j may lie outside or inside the scanned surface: begin before both

    model = _project_on_model(surface, X_ST, starts.reshape(-1, 3), o).reshape(n, -1)
    part = evidence.scan.part(evidence.scan.window(path.p, 0.1, 10**6))
    vertices, triangles = triangulate(part, np.isfinite(part.depth))
    if not len(triangles):
        nothing = np.zeros(n)
        return Deviation(o, nothing, nothing, nothing, np.zeros(n, dtype=bool), nothing)
    scene = open3d_loader.ray_scene(vertices, triangles)
    scan = open3d_loader.cast_rays(scene, starts.reshape(-1, 3), np.broadcast_to(o, (starts.size // 3, 3)))["t"]
    with np.errstate(invalid="ignore"):  # inf - inf where both are missed
        difference = scan.reshape(n, -1) - model
    sight = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    cosine = np.einsum("nli,ni->nl", sight, path.a)
    well = cosine > SEEN_WELL
    well &= np.abs(model - _BEFORE) < _SAME_FACE
    with np.errstate(invalid="ignore"):
        well &= np.isfinite(difference) & (np.abs(difference) < max_deviation)

    usable = well.sum(axis=1) >= 3
    middle = np.zeros(n)
    middle[usable] = np.ma.median(np.ma.masked_where(~well, difference)[usable], axis=1)
    middle = ndimage.median_filter(middle, size=2 * int(0.5 * _MEDIAN / step) + 1, mode="nearest")
    known = _blur(usable.astype(float), step)
    smooth = np.where(usable, _blur(np.where(usable, middle, 0.0), step) / np.maximum(known, 1e-6), 0.0)

    sigma = evidence.sensor.sigma(path.p[:, 2])
    patch = (np.ptp(_LATERAL) + step) * (_MEDIAN + 2.0 * _SMOOTH)
    radius = _NOISE_PATCH * path.p[:, 2] / evidence.sensor.focal
    independent = np.maximum(1.0, patch / (np.pi * radius**2))
    # A median spreads 1.25 times as wide as a mean; an error of the pose shows as 1/cos along the line of sight.
    # A path has some fifty independent places, and one false dent tips the tool: hence 4.5 sigma, not 3.
    threshold = 4.5 * 1.25 * sigma / np.sqrt(independent)
    threshold += _POSE_ERROR / np.maximum(cosine[:, len(_LATERAL) // 2], SEEN_WELL)
    on_scan = _hysteresis(np.abs(smooth), threshold) & usable
    # Slope across the path by least squares over the lateral rays.
    weight = well * _LATERAL
    slope = (np.where(well, difference - middle[:, None], 0.0) * weight).sum(axis=1)
    slope /= np.maximum((weight * _LATERAL).sum(axis=1), 1e-8)
    share = _blur(on_scan.astype(float), step)
    return Deviation(
        o=o,
        along_o=share * smooth,
        across=_blur(np.where(usable, slope, 0.0), 0.5 * step),
        share=share,
        on_scan=on_scan,
        threshold=threshold,
    )


def _project_on_model(surface: ModelSurface, X_ST: Array, starts: Array, o: Array) -> np.ndarray:
    """Distances (N,) [m] along `o` from `starts` (N, 3) in S to the model's surface, inf if missed."""
    X_TS = inverse(X_ST)
    way = np.broadcast_to(X_TS[:3, :3] @ o, starts.shape)
    return open3d_loader.cast_rays(surface.scene, transform_points(X_TS, starts), way)["t"]


def _blur(values: Array, step: float) -> Array:
    return ndimage.gaussian_filter1d(values, _SMOOTH / step, mode="nearest")


def _hysteresis(size: Array, threshold: Array) -> np.ndarray:
    """Runs where `size` stays above a share of `threshold` and somewhere exceeds it whole."""
    label, _ = ndimage.label(size > _RESUME * threshold)
    return np.isin(label, np.unique(label[(size > threshold) & (label > 0)]))


def _tilted_axis(path: ModelPath, deviation: Deviation) -> Array:
    """Tool axes (N, 3) into the deviating surface, from its slopes along and across the path."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p, axis=0), axis=1))])
    along = _blur(np.gradient(deviation.along_o, s), float(np.diff(s).mean()))
    c = np.cross(path.a, path.b)
    normal = np.cross(path.b + along[:, None] * deviation.o, c + deviation.across[:, None] * deviation.o)
    # a x b = c, so b x c = a: the same side as the carried axis.
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _smoothed(p: Array, z: Array, on_scan: np.ndarray, spacing: float) -> ToolPath:
    """Least-squares cubic B-splines through points and axes, sampled evenly over arc length."""
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    curve, axis = _spline(u, p), _spline(u, z)
    fine = np.linspace(0.0, u[-1], max(16, 4 * round(u[-1] / spacing)))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))])
    s = np.linspace(0.0, length[-1], max(2, 1 + round(length[-1] / spacing)))
    at = np.interp(s, length, fine)
    points, tool = curve(at), axis(at)
    tool /= np.linalg.norm(tool, axis=1, keepdims=True)
    x = curve.derivative()(at)
    x -= np.einsum("ij,ij->i", x, tool)[:, None] * tool
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    nearest = np.clip(np.searchsorted(u, at), 0, len(u) - 1)
    flags = on_scan[nearest].copy()
    flags.setflags(write=False)
    return ToolPath(s=readonly(s), p=readonly(points), z=readonly(tool), x=readonly(x), on_scan=flags)


def _spline(u: Array, values: Array) -> BSpline:
    intervals = max(1, min(int(u[-1] / _KNOTS), (len(u) - 4) // 2))
    inner = np.linspace(u[0], u[-1], intervals + 1)[1:-1]
    return make_lsq_spline(u, values, np.concatenate([[u[0]] * 4, inner, [u[-1]] * 4]), k=3)
