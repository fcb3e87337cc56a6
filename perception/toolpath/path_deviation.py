"""Deviation of the scanned surface from the model along a path [Konoplin 2022, eq. 2].

Points of the path are projected along +-o on the triangulations of scan and model. The sensor's
noise decides which differences are significant. A steep and high bump shows in few pixels. A low
and wide bump, or a small error of the pose, shows only in the mean of many. The difference is
therefore tested with means of three widths, the finest first.

Short holes in the scan are bridged and long ones refused, because the surface there is unknown. A
side of the object that the sensor cannot see well is not a hole; there the path follows the model.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uuv.models.objects.targets import ModelPath
from uuv.perception.clouds.scan import distances_along, jump
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import PerceptionError
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

SEEN_WELL = np.cos(np.deg2rad(60.0))  # cosine of incidence above which a scanned point is trusted
_BEFORE = 0.2  # [m] distance before the path, at which projecting rays begin
# [m] along o from a path point to the first model surface; a larger distance means another face
SAME_FACE = 0.03
# [m] offsets of rays across the path
BESIDE = np.array([-0.036, -0.024, -0.012, 0.0, 0.012, 0.024, 0.036])
_INNER = slice(1, -1)
_LATERAL = BESIDE[_INNER]  # [m] offsets of the rays whose median is the deviation
_MEDIAN = 0.025  # [m] along the path, length of the median
_SMOOTH = 0.008  # [m] along the path, width of the Gaussian for high and steep deviations
_SMOOTH_LOW = 0.025  # [m] the same for low ones
_SMOOTH_POSE = 0.06  # [m] the same for errors of the pose
NOISE_PATCH = 2.5  # [px] radius of one patch of correlated stereo error
POSE_ERROR = 0.0015  # [m] error of the transformed path from the pose alone
_RESUME = 0.35  # [-] share of the threshold at which a detected deviation begins and ends
_LEAST_RAYS = 3  # least share of the rays across the path that must be valid
# [m] along the path, length of the median for the shape of high and steep deviations
_MEDIAN_FORM = 0.013
# [-] ratio of the noise to that of a mean: a parabola of seven lines, and a Gaussian of second
# order
_FORM_NOISE = 1.9
_MEAN_ERROR = 0.0015  # [m] error of a mean at the middle of such a shape
# [-] ratio of the noise of a median to that of a mean, and of adjacent patches of noise
SPREAD = 1.7
# [m], and multiple of its size: length over which a deviation fades out into surface that was not
# seen
_FADE = (0.05, 4.0)


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """Signed distance of the scanned surface behind (+) or before (-) the model along a path."""

    o: Array  # (3,) unit direction of projection, from the sensor to the object, in S
    along_o: Array  # (n,) [m], 0 where the path stays on the model
    across: Array  # (n,) slope of the deviation across the path, [m]/[m]
    share: Array  # (n,) [-] weight of the scan in the tool axis, 0 to 1, without steps
    on_scan: np.ndarray  # (n,) bool: a significant deviation
    # (n,) bool: True where the scan was compared with the model; elsewhere the path is extrapolated
    seen: np.ndarray
    bridged: np.ndarray  # (n,) bool: in a hole of the scan with surface on both sides
    threshold: Array  # (n,) [m] threshold of a high and steep deviation
    # (n, 7) [m] along o from points at BESIDE across the path to the model; inf: missed
    section: Array
    # (n, 3) of the deviation across the path, a polynomial in m: [m] as `along_o`, [m]/[m],
    # [m]/[m^2]
    form: Array


def deviate(
    evidence: Evidence,
    surface: ModelSurface,
    X_ST: Array,
    path: ModelPath,
    max_deviation: float,
    bridge: float,
) -> Deviation:
    """Compare the surfaces of scan and model along +-o at a dense path [Konoplin 2022, eq. 2].

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.
        path: Dense path in S.
        max_deviation: [m] largest deviation; beyond it the scan shows another object.
        bridge: [m] longest hole, along the path, over which the deviations on both sides are
            joined.

    Returns:
        The deviation at each point of the path.

    Raises:
        PerceptionError: There is a longer hole where the sensor should see the object well; the
            message states its position and cause.
    """
    H_D = transform_points(X_ST, surface.center)
    o = H_D / np.linalg.norm(H_D)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p, axis=0), axis=1))])
    step = float(np.diff(s).mean())
    n = len(path.p)

    compared = _compared(evidence, surface, X_ST, path, o, max_deviation)
    form = _form(compared.well, compared.difference, s)
    section = np.where(compared.face, compared.behind, np.inf)
    cosine = compared.cosine[:, len(BESIDE) // 2]
    rays = compared.rays[:, _INNER]
    face = compared.face[:, _INNER]
    well = compared.well[:, _INNER]
    difference = compared.difference[:, _INNER]

    # Holes in plain view, which may be bridged, and sides that are out of view
    usable = well.sum(axis=1) >= _LEAST_RAYS
    hole = ~usable & (
        _in_plain_view(evidence, surface, X_ST, rays, face).sum(axis=1) >= _LEAST_RAYS
    )
    bridged = _bridgeable(usable, hole, s, bridge, evidence, path.p)

    nearest = _nearest(usable)
    middle = _lateral_median(well, difference, s)

    # The noise of a median is 1.25 times that of a mean, and patches of noise are adjacent: 1.7 in
    # all, from 120 paths on clean barrels. An error of the pose appears as 1/cos along the line of
    # sight. A path has some fifty independent positions, and one false dent tilts the tool: hence
    # 4.5 sigma, not 3.
    doubt = SPREAD * evidence.sensor.sigma(path.p[:, 2])
    pose_error = POSE_ERROR / np.maximum(cosine, SEEN_WELL)
    radius = NOISE_PATCH * path.p[:, 2] / evidence.sensor.focal

    def mean(known: np.ndarray, width: float) -> tuple[Array, Array]:
        """Gaussian mean over the `known` points, and its noise, which grows at ends and gaps."""
        average, weight = _blur_known(middle, known, width / step)
        patch = (np.ptp(_LATERAL) + step) * (_MEDIAN + 2.0 * width) * weight
        return average, doubt / np.sqrt(np.maximum(1.0, patch / (np.pi * radius**2)))

    # High and steep deviations
    fine, sigma = mean(usable, _SMOOTH)
    threshold = 4.5 * sigma + pose_error
    high = _hysteresis(np.where(usable, np.abs(fine), 0.0), threshold)
    # Next to such a deviation, the flank of another one at the side of the path tilts the tool
    # before it is high on the path.
    patches = (np.ptp(BESIDE) + step) * (_MEDIAN_FORM + 2.0 * _SMOOTH) / (np.pi * radius**2)
    leans = (
        4.5 * doubt / np.sqrt(np.maximum(1.0, patches)) / np.std(BESIDE) + pose_error / BESIDE[-1]
    )

    whole = usable & (well.sum(axis=1) > _LEAST_RAYS)
    beyond = np.maximum(np.abs(fine) / threshold, np.where(whole, np.abs(form[:, 1]), 0.0) / leans)
    if high.any():
        high = _hysteresis(np.where(usable, beyond, 0.0), np.ones(n))
    rest = usable & ~high

    # Low and wide ones
    wide, sigma = mean(rest, _SMOOTH_LOW)
    low = _hysteresis(np.where(rest, np.abs(wide), 0.0), 4.5 * sigma + pose_error)
    rest &= ~low

    # Errors of the pose
    widest, sigma = mean(rest, _SMOOTH_POSE)
    # Fouling or a dent also shifts the pose. No threshold is used for this error, because a step
    # would tilt the tool more than the error matters. Shrinkage removes the part that noise
    # explains. On a clean path the model is the better measurement.
    along = widest**3 / (widest**2 + (2.0 * sigma) ** 2 + 1e-12) * float(np.any(high | low))
    # The fitted shape is less biased than a mean, but noisier, so it is weighted by its noise.
    trust = 1.0 / (1.0 + (_FORM_NOISE * doubt / _MEAN_ERROR) ** 2 / np.maximum(1.0, patches))
    trust = np.where(well.sum(axis=1) > _LEAST_RAYS, trust, 0.0)
    steep = fine + trust * (form[:, 0] - fine)

    for detected, deviation in ((low, wide), (high, steep)):
        # a gap next to a deviation does not end the deviation
        share = _blur(detected[nearest].astype(float), step)
        along += share * (deviation - along)

    # Slope across the path; deviation and slope are continued over parts that were not seen
    across = _slope(well, difference, middle)
    along, across, on_scan = _over_gaps(
        along, np.where(usable, across, 0.0), high | low, usable, bridged, s
    )

    share = _blur(on_scan.astype(float), step)
    across = _blur(across, 0.5 * step)
    bend = share * trust * np.where(usable & high[nearest], form[:, 2], 0.0)
    return Deviation(
        o=o,
        along_o=along,
        across=across,
        share=share,
        on_scan=on_scan,
        seen=usable,
        bridged=bridged,
        threshold=threshold,
        section=section,
        form=np.column_stack([along, share * across, bend]),
    )


class _Compared(NamedTuple):
    """Rays at a path, cast on scan and model along o; l rays across it at each of n points."""

    rays: Array  # (n, l, 3) [m] points beside the path
    behind: Array  # (n, l) [m] model behind these points along o
    difference: Array  # (n, l) [m] scan behind the model; not finite if a ray misses either
    cosine: Array  # (n, l) cosine of the angle between the line of sight and the tool axis
    face: np.ndarray  # (n, l) bool: the sensor sees this face of the model well
    well: np.ndarray  # (n, l) bool: in addition, the scan shows it


def _compared(
    evidence: Evidence,
    surface: ModelSurface,
    X_ST: Array,
    path: ModelPath,
    o: Array,
    max_deviation: float,
) -> _Compared:
    """Cast the rays of `deviate` on both surfaces; arguments as for `deviate`, and `o` (3,) unit
    vector.
    """
    n = len(path.p)
    lateral = np.cross(path.a, path.b)
    rays = path.p[:, None] + BESIDE[None, :, None] * lateral[:, None]
    # X_j may be outside or inside the scanned surface, so rays begin in front of both
    starts = rays - _BEFORE * o

    model = _project_on_model(surface, X_ST, starts.reshape(-1, 3), o).reshape(n, -1)
    scan = _project_on_scan(evidence, path.p, starts.reshape(-1, 3), o).reshape(n, -1)
    with np.errstate(invalid="ignore"):  # inf - inf where both are missed
        difference = scan - model
        in_bounds = np.isfinite(difference) & (np.abs(difference) < max_deviation)

    sight = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    cosine = np.einsum("nli,ni->nl", sight, path.a)
    behind = model - _BEFORE
    face = (cosine > SEEN_WELL) & (np.abs(behind) < SAME_FACE)
    return _Compared(rays, behind, difference, cosine, face, face & in_bounds)


def _lateral_median(well: np.ndarray, difference: Array, s: Array) -> Array:
    """Median (n,) [m] of the differences (n, l) across the path, and of its neighbours along it."""
    usable = well.sum(axis=1) >= _LEAST_RAYS
    middle = np.zeros(len(s))
    middle[usable] = np.ma.median(np.ma.masked_where(~well, difference)[usable], axis=1)
    if usable.any():
        # so that gaps do not enter a median near them
        middle = np.interp(s, s[usable], middle[usable])

    step = float(np.diff(s).mean())
    return ndimage.median_filter(middle, size=2 * int(0.5 * _MEDIAN / step) + 1, mode="reflect")


def _project_on_model(surface: ModelSurface, X_ST: Array, starts: Array, o: Array) -> np.ndarray:
    """Distances (n,) [m] along `o` from `starts` (n, 3) in S to the model, inf if missed."""
    X_TS = inverse(X_ST)
    way = np.broadcast_to(X_TS[:3, :3] @ o, starts.shape)
    return surface.scene.cast(transform_points(X_TS, starts), way)["t"]


def _project_on_scan(evidence: Evidence, near: Array, starts: Array, o: Array) -> np.ndarray:
    """Distances (n,) [m] along `o` from `starts` (n, 3) in S to the scan near a path, or inf.

    `near` (m, 3) [m]: points of the path.
    """
    part = evidence.scan.part(evidence.scan.window(near, 0.1, 10**6))
    if min(part.depth.shape) < 2:
        return np.full(len(starts), np.inf)
    distances = distances_along(part, starts, o)
    return np.full(len(starts), np.inf) if distances is None else distances


def _in_plain_view(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, rays: Array, face: np.ndarray
) -> np.ndarray:
    """Mask (n, l) of the points `rays` (n, l, 3) in S at which the sensor should see the model."""
    flat = rays.reshape(-1, 3)
    X_TS = inverse(X_ST)
    hit = surface.scene.cast(X_TS[:3, 3], flat @ X_TS[:3, :3].T)["t"]
    inside = evidence.scan.pixels(flat)[2] & (flat[:, 2] > 0.0)
    return face & (inside & (hit > 1.0 - SAME_FACE / np.linalg.norm(flat, axis=1))).reshape(
        face.shape
    )


def _bridgeable(
    usable: np.ndarray, hole: np.ndarray, s: Array, bridge: float, evidence: Evidence, p: Array
) -> np.ndarray:
    """Mask (n,) of the gaps to be bridged.

    Raises PerceptionError if a hole is longer than `bridge` [m].
    """
    # Holes that are too long
    step = float(np.diff(s).mean())
    label, count = ndimage.label(hole)
    for i in range(1, count + 1):
        rows = np.flatnonzero(label == i)
        length = float(s[rows[-1]] - s[rows[0]]) + step
        if length > bridge:
            raise PerceptionError(
                f"the scan has a hole of {1e3 * length:.0f} mm on the tool path, {s[rows[0]]:.2f} "
                f"m from its start: {_cause(evidence, p[rows])}; at most {1e3 * bridge:.0f} mm "
                "can be bridged"
            )

    # Gaps with surface on both sides
    bridged = np.zeros_like(usable)
    label, count = ndimage.label(~usable)
    for i in range(1, count + 1):
        rows = np.flatnonzero(label == i)
        inner = rows[0] > 0 and rows[-1] < len(usable) - 1
        if inner and float(s[rows[-1]] - s[rows[0]]) + step <= bridge:
            bridged[rows] = True
    return bridged


def _cause(evidence: Evidence, p: Array) -> str:
    """Reason, as text, for missing surface at the points (n, 3) in S."""
    row, column, _ = evidence.scan.pixels(p)
    behind = evidence.scan.depth[row, column] - p[:, 2]
    if np.isfinite(behind).mean() < 0.5:
        return "no return from there"
    middle = float(np.nanmedian(behind))
    if abs(middle) < float(jump(np.median(p[:, 2]))):
        return "the returns from there form no surface"
    return (
        f"the surface there lies {1e3 * abs(middle):.0f} mm "
        f"{'behind' if middle > 0.0 else 'before'} the object"
    )


def _over_gaps(
    along: Array,
    across: Array,
    on_scan: np.ndarray,
    usable: np.ndarray,
    bridged: np.ndarray,
    s: Array,
) -> tuple[Array, Array, np.ndarray]:
    """Deviation, slope across the path and flag, continued over parts of the path that were not
    seen.
    """
    if not usable.any():
        nothing = np.zeros(len(s))
        return nothing, nothing, np.zeros(len(s), dtype=bool)
    if usable.all():
        return along, across, on_scan

    # Over gaps: interpolated between seen parts
    at = s[usable]
    if len(at) >= 2:
        from scipy.interpolate import PchipInterpolator

        along = np.where(usable, along, PchipInterpolator(at, along[usable], extrapolate=False)(s))
    across = np.interp(s, at, across[usable])

    # Beyond them: faded out from the nearest seen part
    before = np.maximum.accumulate(np.where(usable, np.arange(len(s)), -1))
    after = np.minimum.accumulate(np.where(usable, np.arange(len(s)), len(s))[::-1])[::-1]
    out = ~(usable | bridged)
    faded = np.zeros(len(s))
    faded_across = np.zeros(len(s))
    for edge, exists in ((before, before >= 0), (after, after < len(s))):
        rows = np.flatnonzero(out & exists)
        size = along[edge[rows]]
        u = np.abs(s[rows] - s[edge[rows]]) / np.maximum(_FADE[0], _FADE[1] * np.abs(size))
        left = np.where(u < 1.0, 1.0 - u * u * (3.0 - 2.0 * u), 0.0)
        faded[rows] += left * size
        faded_across[rows] += left * across[edge[rows]]

    joined = bridged & on_scan[np.clip(before, 0, None)] & on_scan[np.clip(after, None, len(s) - 1)]
    return (
        np.where(out, faded, along),
        np.where(out, faded_across, across),
        (on_scan & usable) | joined,
    )


def _nearest(known: np.ndarray) -> np.ndarray:
    """Index (n,) of the nearest row that is `known`; the row's own index if there is none."""
    if not known.any():
        return np.arange(len(known))
    return ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)[0]


def _blur(values: Array, step: float) -> Array:
    return ndimage.gaussian_filter1d(values, _SMOOTH / step, mode="nearest")


def _blur_known(values: Array, known: np.ndarray, width: float) -> tuple[Array, Array]:
    """Gaussian mean of the `known` values, 0 if none is near; and their share of the Gaussian.

    `width` is in samples. Values beyond the ends count as unknown.
    """
    weight = ndimage.gaussian_filter1d(known.astype(float), width, mode="constant")
    total = ndimage.gaussian_filter1d(np.where(known, values, 0.0), width, mode="constant")
    return np.where(weight > 1e-3, total / np.maximum(weight, 1e-3), 0.0), weight


def _hysteresis(size: Array, threshold: Array) -> np.ndarray:
    """Mask of the runs in which `size` stays above a share of `threshold` and exceeds `threshold`
    at least once.
    """
    label, _ = ndimage.label(size > _RESUME * threshold)
    return np.isin(label, np.unique(label[(size > threshold) & (label > 0)]))


def _form(well: np.ndarray, difference: Array, s: Array) -> Array:
    """Polynomial (n, 3) of the deviation across the path, in [m]; the surface may be curved.

    The mean over a curved surface is biased. Parabolas across the path, and a Gaussian of second
    order along the path, avoid this bias.
    """
    step = float(np.diff(s).mean())
    lines = np.zeros(difference.shape)
    weight = np.zeros(difference.shape)

    # Each line along the path: median, then a Gaussian of second order
    for k, known in enumerate(well.T):
        if known.sum() < 2:
            continue
        line = np.interp(s, s[known], difference[known, k])
        line = _blur(
            ndimage.median_filter(
                line, size=2 * int(0.5 * _MEDIAN_FORM / step) + 1, mode="nearest"
            ),
            step,
        )
        lines[:, k] = 2.0 * line - _blur(line, step)
        weight[:, k] = _blur(known.astype(float), step)

    # Parabola across the lines, by weighted least squares
    x = BESIDE / BESIDE[-1]
    powers = x[:, None] ** np.arange(3)
    normal = np.einsum("nk,kp,kq->npq", weight, powers, powers) + np.diag([1e-9, 1e-3, 1e-3])
    form = np.linalg.solve(normal, np.einsum("nk,kp,nk->np", weight, powers, lines)[..., None])[
        ..., 0
    ]
    return form / BESIDE[-1] ** np.arange(3)


def _slope(well: np.ndarray, difference: Array, middle: Array) -> Array:
    """Slope (n,) of the deviation across the path by least squares over the lateral rays."""
    weight = well * _LATERAL
    slope = (np.where(well, difference - middle[:, None], 0.0) * weight).sum(axis=1)
    return slope / np.maximum((weight * _LATERAL).sum(axis=1), 1e-8)
