"""Verification of a fitted pose by projected trajectories: accept, rescan or refuse.

Curves in a plane perpendicular to o = -(S - H_D)/|S - H_D| are projected along o on the
triangulated surfaces of the scan and of the fitted model. The distances E_i between both
projections measure how far the surfaces lie apart [Konoplin 2022, eq. 2].

The published Q = sqrt(sum E_i^2) (`registration.published.paper_check`) grows with the number of
rays. It has no rule for rays that miss a surface or meet an occluder, and a few rays at edges
dominate it. Here each ray of several curves is classified. Either both surfaces agree, or the scan
lies in front of the model, or behind it (the scan sees through the model), or an occluder hides the
model, which is no evidence.

A trimmed rms, the shares of these classes, the coverage and the offset of sharp depth edges are
compared with limits from the sensor's noise and resolution. Three further conditions:

- ICP from the pose does not move it.
- The object is as large as the model.
- The scan is far less likely at every other pose that looks alike (an arm of a starfish further),
  and at every pose to which another ICP converged.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uuv.perception.clouds.scan import connected_surfaces, distances_along, jump
from uuv.perception.registration.evidence import MODEL_TOLERANCE, Evidence, explained
from uuv.perception.registration.fine_fit import IcpFit, fine_fit
from uuv.perception.registration.likelihood import OCCLUDER, log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pairing import edge_offsets
from uuv.perception.registration.pose_covariance import PoseCovariance
from uuv.perception.registration.pose_search import best_alternative
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

TRIM = 0.15  # [-] share of the largest distances left out of the figure
_SURFACE_PIXELS = 40_000  # pixels at most of the scan that is triangulated: finer than the rays lie
_RAY_STEP = 0.006  # [m] between rays along the curves
_LINES = 8  # straight lines through the centre, evenly distributed over 180 deg
_CIRCLES = (0.35, 0.7)  # [-] radii as a share of the object's extent across the line of sight
_ACROSS_EDGES = 1.5  # [px] by which a ray is moved aside to detect a nearby edge
_MIN_RAYS = 40  # rays without which there is no verdict
_RIM = 1.0  # [noise lengths] width below which a missing part is the error of an edge
_FEATURE = 2.0  # [noise lengths^2] largest part that may be missing by chance
# [spacings] edge of a part that a cloud cannot distinguish from a gap between two of its surfaces
_UNTOLD = 3.0
_AGREES = 1.5  # [sigma] within which scan and model agree
# [-] share of such pixels among those within 3 sigma around a missing part, of a dent less
_ABRUPT = 0.6
_FEW_RAYS = 120  # parallel rays below which lines of sight replace them
# [-] share of the rim of a region without depth that an occluder takes, above which it may go on
# there
_TURNED_AWAY = 0.3
# [-] share of the parallel rays that stay clear of edges, below which lines of sight replace them
_THIN = 0.75
_SIGHTS = 1000  # lines of sight, about
_STEEP = np.cos(np.deg2rad(65.0))  # cosine of incidence below which a ray does not count
_TOGETHER = 3.0  # [spacings] between neighbouring points of one surface
# [-] explained share of a scanned surface, above which all of it should belong to the model
_PART = 0.1
_PATCHES = 9.0  # [-] model radius over the edge of a patch
_PATCH_RAYS = 5  # rays in a patch, at least
_PATCH_TRIM = 0.25  # [-] share of patches that may be fouled or dented
# Limits on shares of rays and edges (0..1) and on figures in units of the noise. They lie between
# true poses (clean, fouled, up to 66 % hidden) and poses 10 deg or 3 cm off;
# scripts/experiments/identification/decisions.py counts their errors.
MAX_FIGURE = 1.0  # [sigma]; true poses reach 0.85
MIN_AGREEMENT = 0.70  # [-] least share of rays on which both surfaces agree
MAX_THROUGH = 0.12  # [-] largest share of rays on which the scan sees through the model
MIN_EDGE_SHARE = 0.25  # [-] least share of the model's sharp edges found in the scan
# [-] largest share of the model's edges beyond which the scanned surface goes on
MAX_GOES_ON = 0.35
# [-] unexplained share of the scanned surface around the model; fouled objects reach 0.13
MAX_BEYOND = 0.25
# [-] share of the model's sharp edges that the scan shows, at least, and beyond which it goes on,
# at most, where the object ends as the model does
_ENDS = (0.75, 0.1)
_MAX_TOUCHING = 0.5  # [-] unexplained share then: a neighbour touches it
MIN_COVERAGE = 0.1  # [-] least share of the expected rays on which the scan shows the object
WHOLE = 0.5  # [-] coverage above which another scan is not expected to remove a contradiction
MAX_MOVE = (0.003, 0.005)  # [m] and share of the range by which another ICP may move the pose
# [m], share of the range and [rad] by which a pose may be wrong
FOUND = (0.005, 0.003, np.deg2rad(3.0))
# [views] that a wrong pose costs: below a probability of 0.9 another view is expected to cost less
WRONG_COSTS = 10.0
# [-] by which the best scale may differ from 1: midway to an object 5 % larger or smaller
MAX_SIZE = 0.025
# [-] standard deviation of the scale above which this cannot be distinguished from 1
MAX_SIZE_SIGMA = 0.02
# [nat] over every other pose; right poses among near twins (an uneven starfish) reach 8
MIN_MARGIN = 6.0


class Decision(StrEnum):
    """Decision after one identification."""

    ACCEPT = "accept"
    RESCAN = "rescan"  # from another place: the scan neither proves the pose nor rules it out
    REFUSE = "refuse"  # the scan contradicts the model


class EdgeFigures(NamedTuple):
    """Comparison of the sharp depth edges; the figures are NaN without any in view."""

    offset_m: float  # [m] median offset across the edge
    threshold_m: float  # [m] its limit
    share: float  # [-] share of the model's edges found in the scan
    goes_on: float  # [-] share of the model's edges beyond which the scanned surface goes on


class Projections(NamedTuple):
    """Where the rays meet both surfaces."""

    scan: Array  # (k, 3) [m] C_i on the scan, in S
    model: Array  # (k, 3) [m] C'_i on the model, in S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseCheck:
    """Figures of the verification with their limits; `reason` is empty if all hold."""

    decision: Decision
    figure_m: float  # [m] trimmed rms distance of both projections along o; inf without a verdict
    threshold_m: float  # [m] its limit, from the sensor's noise and resolution at this range
    # [m] trimmed rms of the patch medians of the same distances, signed: more than noise
    form_m: float
    form_threshold_m: float  # [m]
    agreement: float  # [-] share of the judged rays on which both surfaces lie within 3 sigma
    through: float  # [-] share of the judged rays on which the scan lies behind the model's surface
    coverage: float  # [-] share of all rays on which the scan shows the object
    hidden: float  # [-] share of all rays with an occluder in front of the object
    rays: int  # expected to meet both surfaces
    edges: EdgeFigures
    # [-] share of the scanned surface connected to the model that the model does not explain
    beyond: float
    move_m: float  # [m] rms by which another ICP moves the visible model
    move_threshold_m: float  # [m]
    size: float  # [-] best scale of the object against the model
    size_threshold: float  # [-] by which it may differ from 1
    # [nat] log likelihood above that of the best other pose that was tried; inf if none was
    margin: float
    free: Array  # (k, 6) free twists as in `IcpFit`
    projections: Projections
    contradicted: bool  # the scan speaks against the pose; False: it agrees, or tells too little
    reason: str  # why the pose was not accepted


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Rays along o where the sensor should see the model, and their classes. All (n,) or (n, 3)."""

    C_model: Array  # [m] in S
    o: Array  # (3,)
    E: Array  # [m] scan behind (+) or in front of (-) the model; inf where the ray misses the scan
    sigma: Array  # [m] of E
    pitch: Array  # [m] between pixels there
    hidden: np.ndarray  # an occluder lies in front of the model
    near: np.ndarray  # both surfaces agree
    through: np.ndarray  # the scan lies behind the model
    judged: np.ndarray  # near, in front of or through: evidence for or against

    @property
    def compared(self) -> np.ndarray:
        """Mask of the rays that meet the scan and no occluder."""
        return np.isfinite(self.E) & ~self.hidden


def check(
    evidence: Evidence,
    surface: ModelSurface,
    X_ST: Array,
    fit: IcpFit | None = None,
    others: float | None = None,
    covariance: PoseCovariance | None = None,
) -> PoseCheck:
    """Verify the pose `X_ST` of the model against the scan.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.
        fit: Result of `fine_fit` at `X_ST`, or at a pose equal to it by declared symmetry. None:
            ICP is run from `X_ST`.
        others: [nat] log likelihood of the best other hypothesis; None: of the best pose that looks
            alike.
        covariance: Of the pose; None: it is not judged.

    Returns:
        Figures, limits and decision. The decision is RESCAN where too few rays meet the object.
    """
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if visible.sum() < 10:
        return _unmade("the model at the fitted pose is out of view")
    rays = _cast(evidence, surface, X_ST, transform_points(X_ST, surface.points[visible]))
    if isinstance(rays, str):
        return _unmade(rays)

    E = rays.E
    both = rays.compared
    sigma = rays.sigma
    if both.sum() < _MIN_RAYS:
        return _unmade(
            f"only {int(both.sum())} check rays meet the object in the scan; need {_MIN_RAYS}"
        )

    # Shares of the rays on which both surfaces agree, and on which the scan lies behind
    judged = max(1, int(rays.judged.sum()))
    agreement = float(rays.near.sum() / judged)
    seen_through = float(rays.through.sum() / judged)
    coverage = float((rays.judged & ~rays.through).mean())

    # Distance of both surfaces, against the sensor's noise
    noise = float(np.sqrt(np.mean(sigma[both] ** 2)))
    figure = _trimmed_rms(E[both], TRIM)
    threshold = MAX_FIGURE * noise

    # Distance over patches, in which the noise averages out: errors of shape and pose
    size = surface.radius / _PATCHES
    form = _form(rays.C_model[both], E[both], size)
    independent = max(1.0, size / float(np.median(rays.pitch)) / evidence.sensor.noise_length)
    form_threshold = MODEL_TOLERANCE + 1.1 * noise / np.sqrt(independent)

    # Depth edges, and how far the surface goes on beyond them
    offsets, edge_share, goes_on = edge_offsets(evidence, surface, X_ST)
    beyond = _beyond(evidence, surface, X_ST)
    ends = edge_share > _ENDS[0] and goes_on < _ENDS[1]
    edge = float(np.median(np.abs(offsets))) if len(offsets) else np.nan
    edge_threshold = 3.0 * float(np.median(rays.pitch)) + 0.002

    # Another ICP: whether it moves the pose, and the size at which the object fits best
    rest = fit or fine_fit(evidence, surface, X_ST)
    points = surface.points[visible]
    move = 0.0
    if fit is None:
        move = _rms_distance(transform_points(rest.X_ST, points), transform_points(X_ST, points))
    move_threshold = MAX_MOVE[0] + MAX_MOVE[1] * float(np.linalg.norm(rays.C_model.mean(axis=0)))
    size_threshold = MAX_SIZE

    # Other poses: how much less likely the scan is there
    if others is None:
        others = best_alternative(evidence, surface, X_ST)
    margin = log_likelihood(evidence, surface, X_ST) - others

    # Parts of the model that the scan misses, and how well this view holds the pose
    missing, least = _missing(evidence, surface, X_ST)
    size_sigma = covariance.size_sigma if covariance is not None else rest.size_sigma
    loose, doubt = _looseness(covariance, float(np.linalg.norm(rays.C_model.mean(axis=0))))
    undeclared = len(rest.free) - (surface.symmetry.axis is not None)

    # What contradicts the pose
    against = [
        text
        for failed, text in (
            # surfaces
            (
                figure > threshold,
                f"surfaces lie {1e3 * figure:.1f} mm apart, limit {1e3 * threshold:.1f} mm",
            ),
            (
                form > form_threshold,
                f"shapes differ by {1e3 * form:.1f} mm, limit {1e3 * form_threshold:.1f} mm",
            ),
            (
                agreement < MIN_AGREEMENT,
                f"only {agreement:.0%} of the check rays agree, need {MIN_AGREEMENT:.0%}",
            ),
            (seen_through > MAX_THROUGH, f"the scan sees through {seen_through:.0%} of the model"),
            # edges, and what lies beyond them
            (
                edge > edge_threshold,
                f"edges lie {1e3 * edge:.1f} mm apart, limit {1e3 * edge_threshold:.1f} mm",
            ),
            (
                goes_on > MAX_GOES_ON,
                f"the surface goes on beyond {goes_on:.0%} of the model's edges",
            ),
            (
                beyond > (_MAX_TOUCHING if ends else MAX_BEYOND),
                f"{beyond:.0%} of the surface that it lies on is not the model's",
            ),
            # another fit, size or pose
            (
                move > move_threshold,
                f"a further fit moves it by {1e3 * move:.1f} mm, limit {1e3 * move_threshold:.1f} "
                "mm",
            ),
            (
                abs(rest.size - 1.0) > size_threshold,
                f"at {rest.size:.2f} times its size it fits better",
            ),
            (margin < -MIN_MARGIN, "another pose fits better"),
            # missing parts
            (
                missing > least,
                f"{missing} connected pixels of the model are missing, at most {least} may be",
            ),
        )
        if failed
    ]

    # What this view does not observe
    lacking = [
        text
        for failed, text in (
            (
                coverage < MIN_COVERAGE,
                f"only {coverage:.0%} of what should be seen is seen, need {MIN_COVERAGE:.0%}",
            ),
            (
                edge_share < MIN_EDGE_SHARE,
                f"only {edge_share:.0%} of the model's edges are in the scan",
            ),
            (
                undeclared > 0,
                "this view does not hold the whole pose: the model can slide or turn "
                "on what is seen",
            ),
            (abs(margin) <= MIN_MARGIN, "another pose fits as well"),
            (
                size_sigma > MAX_SIZE_SIGMA,
                f"its size is seen to {size_sigma:.1%} only, need {MAX_SIZE_SIGMA:.1%}",
            ),
            (loose, f"this view holds the pose to {doubt} only, one standard deviation"),
        )
        if failed
    ]

    # Decision: a gross contradiction of an object seen for the most part is final
    gross = agreement < 0.5 or seen_through > 0.3 or figure > 2.0 * threshold
    decision = Decision.ACCEPT
    if against or lacking:
        decision = Decision.REFUSE if gross and coverage + seen_through > WHOLE else Decision.RESCAN
    return PoseCheck(
        decision=decision,
        figure_m=figure,
        threshold_m=threshold,
        form_m=form,
        form_threshold_m=form_threshold,
        agreement=agreement,
        through=seen_through,
        coverage=coverage,
        hidden=float(rays.hidden.mean()),
        rays=len(E),
        edges=EdgeFigures(edge, edge_threshold, edge_share, goes_on),
        beyond=beyond,
        move_m=move,
        move_threshold_m=move_threshold,
        size=rest.size,
        size_threshold=size_threshold,
        margin=margin,
        free=rest.free,
        projections=Projections(
            scan=(rays.C_model + np.where(both, E, 0.0)[:, None] * rays.o)[both],
            model=rays.C_model[both],
        ),
        contradicted=bool(against),
        reason="; ".join(against + lacking),
    )


def _missing(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> tuple[int, int]:
    """Pixels of the largest part of the model that is missing, and how many may be by chance.

    The part is a connected region of pixels in which the scan lies behind the model by 3 sigma or
    more, wider than the errors at an edge. At its rim the distance must jump: a dent begins gently.
    """
    window = evidence.scan.window(transform_points(X_ST, surface.points), 0.05, _SURFACE_PIXELS)
    scan = evidence.scan.part(window)
    depth = surface.depth(X_ST, scan)

    # Scan behind the model, in standard deviations
    shown = np.isfinite(depth) & np.isfinite(scan.depth)
    sigma = evidence.sensor.sigma(np.where(shown, depth, 1.0))
    behind = np.where(shown, scan.depth - depth, 0.0) / sigma

    # [px] of one independent reading
    cell = evidence.sensor.noise_length * evidence.scan.pitch / scan.pitch
    wide = 2 * int(np.ceil(0.5 * _RIM * cell)) + 1

    # Regions wider than the error of an edge, larger than chance and than gaps of the cloud
    label, count = ndimage.label(ndimage.binary_opening(behind > 3.0, np.ones((wide, wide))))
    pixel = scan.pitch * float(np.median(depth[shown])) if shown.any() else np.inf  # [m]
    least = round(max(_FEATURE * cell**2, (_UNTOLD * surface.resolution / pixel) ** 2))
    rough = shown & (np.abs(behind) < 3.0)
    agrees = shown & (np.abs(behind) < _AGREES)

    # Largest of them that is too deep for a dent, or begins abruptly
    largest = 0
    for part in range(1, count + 1):
        inside = label == part
        rim = ndimage.binary_dilation(inside, iterations=wide) & shown & ~inside
        deep = np.median((behind * sigma)[inside]) > OCCLUDER  # deeper than any dent
        if inside.sum() > max(largest, least) and (
            deep or agrees[rim].sum() > _ABRUPT * max(1, rough[rim].sum())
        ):
            largest = int(inside.sum())
    return largest, least


def _looseness(covariance: PoseCovariance | None, range_m: float) -> tuple[bool, str]:
    """Whether another view costs less than a wrong pose would; and the pose's deviations."""
    if covariance is None:
        return False, ""
    position, angle = covariance.held_sigmas
    wrong = 1.0 - covariance.chance_within(FOUND[0] + FOUND[1] * range_m, FOUND[2])
    return wrong * WRONG_COSTS > 1.0, f"{1e3 * position:.1f} mm and {np.rad2deg(angle):.1f} deg"


def _cast(evidence: Evidence, surface: ModelSurface, X_ST: Array, points: Array) -> _Rays | str:
    """Compare both surfaces along rays over the visible model `points` (m, 3) [m] in S.

    Returns a reason if too few rays meet the model. The rays are parallel [Konoplin 2022]. On bars
    and grids many of them pass near an edge: lines of sight replace them.
    """
    met = _parallel(evidence, surface, X_ST, points)
    if met is None or len(met.C_model) < _FEW_RAYS or met.clear < _THIN:
        by_sight = _lines_of_sight(evidence, surface, X_ST)
        met = by_sight if met is None or len(by_sight.C_model) > len(met.C_model) else met
    if len(met.C_model) < _MIN_RAYS:
        return f"only {len(met.C_model)} check rays meet the visible model; need {_MIN_RAYS}"

    sensor = evidence.sensor
    scan = evidence.scan
    C_model = met.C_model
    cosine = met.cosine
    E = met.E

    # Standard deviation of the distance: noise, pixel pitch on a slope, model
    z = C_model[:, 2]
    pitch = scan.pitch * z
    slope = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / cosine
    sigma = np.sqrt(sensor.sigma(z) ** 2 + (pitch * slope) ** 2 + MODEL_TOLERANCE**2)

    # The ray starts in front of the object and an occluder may lie nearer: only the sensor's line
    # of sight shows it.
    row, column, _ = scan.pixels(C_model)
    top, left = max(0, int(row.min()) - 2), max(0, int(column.min()) - 2)
    first = scan.depth[top : int(row.max()) + 3, left : int(column.max()) + 3]
    first = np.where(np.isfinite(first), first, np.inf)
    row, column = row - top, column - left
    around = ndimage.minimum_filter(first, 3)[row, column]
    occluder = np.maximum(OCCLUDER, 6.0 * sigma)
    hidden = (around < z - occluder) | (-occluder > E)
    if scan.known is not None:
        hidden |= scan.known.depth[row + top, column + left] < z

    # Where scan and model agree along the line of sight, a ray beside it passed through a gap that
    # an occluder leaves.
    behind = scan.depth[top : top + len(first), left : left + first.shape[1]][row, column] - z
    agrees = np.abs(behind) < 3.0 * sigma
    E = np.where(agrees & ~(np.abs(E) < 3.0 * sigma), behind, E)

    # Where the ray meets no triangle the line of sight decides: the scan lies behind, or there is
    # no depth around.
    meets = np.isfinite(E)
    past = ~meets & np.where(np.isfinite(around), around > z + 3.0 * sigma, True)
    past &= np.isfinite(around) | ~np.isfinite(ndimage.minimum_filter(first, 5)[row, column])
    hidden |= past & _behind_no_depth(first, row, column, z - occluder)

    # Classes: agreement, scan behind the model, scan in front of it
    near = ~hidden & (np.abs(E) < 3.0 * sigma)
    through = ~hidden & ((meets & (3.0 * sigma <= E)) | past)
    before = ~hidden & meets & (-3.0 * sigma >= E)
    return _Rays(C_model, met.o, E, sigma, pitch, hidden, near, through, near | through | before)


def _behind_no_depth(first: Array, row: np.ndarray, column: np.ndarray, limit: Array) -> np.ndarray:
    """Mask (n,) of rays into a region without depth that an occluder at its rim may hide.

    Its surface may be turned away there.

    Args:
        first: (h, w) [m] depth of the scan, inf where there is none.
        row: (n,) of the rays' pixels.
        column: (n,)
        limit: (n,) [m] depth below which a surface is in front of the model.
    """
    label, count = ndimage.label(~np.isfinite(first))
    if count == 0:
        return np.zeros(len(row), dtype=bool)
    beside = ndimage.maximum_filter(label, 3)
    beside[~np.isfinite(first)] = 0

    # Region of each ray, and the depth in front of which it is occluded there
    region = label[row, column]
    within = region > 0
    nearest = np.full(count + 1, np.inf)
    np.minimum.at(nearest, region[within], limit[within])

    # Share of the region's rim that an occluder takes
    rim = beside > 0
    occluding = np.bincount(beside[rim], first[rim] < nearest[beside[rim]], count + 1)
    share = occluding / np.maximum(np.bincount(beside[rim], minlength=count + 1), 1)
    return within & (share[region] > _TURNED_AWAY)


class _Met(NamedTuple):
    """Rays that meet the model where the sensor should see it."""

    C_model: Array  # (n, 3) [m] in S
    cosine: Array  # (n,) of the angle of incidence
    # (n,) [m] scan behind (+) or in front of (-) the model; inf where the ray misses the scan
    E: Array
    o: Array  # (3,) unit, their mean direction
    clear: float  # [-] share of the rays that stay clear of the model's edges


def _parallel(evidence: Evidence, surface: ModelSurface, X_ST: Array, points: Array) -> _Met | None:
    """Rays along o from the curves; None if the scan has no surface."""
    scan = evidence.scan
    H_D, o = direction(points)
    starts = curves(H_D, o, points)

    # Rays that meet the model, clear of its edges
    X_TS = inverse(X_ST)
    on_model = surface.scene.cast(
        transform_points(X_TS, starts), np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)
    )
    meets = np.isfinite(on_model["t"])
    hit = meets & clear_of_edges(
        surface,
        X_TS,
        starts,
        on_model["t"],
        o,
        _ACROSS_EDGES * scan.pitch * float(np.linalg.norm(H_D)),
    )
    clear = float(hit.sum() / max(1, meets.sum()))
    t_model = on_model["t"][hit]
    starts = starts[hit]
    C_model = starts + t_model[:, None] * o

    # The rays are parallel, the sensor's lines of sight are not: keep rays whose model point the
    # sensor itself should see.
    line = C_model / np.linalg.norm(C_model, axis=1, keepdims=True)
    origin_T = X_TS[:3, 3]
    sight = surface.scene.distance(origin_T, transform_points(X_TS, C_model) - origin_T)
    cosine = np.abs(np.einsum("ij,ij->i", on_model["normal"][hit] @ X_ST[:3, :3].T, line))
    expected = (sight > 0.995) & (cosine > _STEEP) & scan.pixels(C_model)[2]
    C_model = C_model[expected]
    starts = starts[expected]
    t_model = t_model[expected]
    cosine = cosine[expected]

    if not len(C_model):
        return None

    # Distances to the scan along the same rays
    part = scan.part(scan.window(C_model, 0.05, _SURFACE_PIXELS))
    t_scan = distances_along(part, starts, o)
    if t_scan is None:
        return None
    return _Met(C_model, cosine, np.where(np.isfinite(t_scan), t_scan - t_model, np.inf), o, clear)


def _lines_of_sight(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> _Met:
    """Lines of sight of pixels whose neighbours see the same face of the model."""
    scan = evidence.scan
    window = scan.window(transform_points(X_ST, surface.points), 0.0, _SURFACE_PIXELS)
    part = scan.part(window)

    model, cosine = surface.seen(X_ST, part)
    z = np.where(np.isfinite(model.depth), model.depth, np.inf)

    # Pixels whose four neighbours lie on the same face
    step = jump(model.depth)
    clear = np.isfinite(model.depth)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            for side in (-1, 1):
                clear &= np.abs(np.roll(z, side, axis=axis) - z) < step

    # An even selection of those that see it at a fair angle
    rows, columns = np.nonzero(clear & (cosine > _STEEP))
    every = max(1, len(rows) // _SIGHTS)
    rows, columns = rows[::every], columns[::every]
    C_model = model.points[rows, columns]
    behind = part.depth[rows, columns] - model.depth[rows, columns]

    # Their distance along the ray, which is longer than along the axis
    along = np.linalg.norm(C_model, axis=1) / C_model[:, 2]
    o = C_model.sum(axis=0) if len(C_model) else np.array([0.0, 0.0, 1.0])
    return _Met(
        C_model=C_model,
        cosine=cosine[rows, columns],
        E=np.where(np.isfinite(behind), behind * along, np.inf),
        o=o / np.linalg.norm(o),
        clear=1.0,
    )


def direction(points: Array) -> tuple[Array, Array]:
    """Centroid H_D (3,) [m] of model points (m, 3) [m] in S, and the line of sight o (3,) to it."""
    H_D = points.mean(axis=0)
    return H_D, H_D / np.linalg.norm(H_D)  # S is the origin: o = -(S - H_D)/|S - H_D|


def across(o: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) perpendicular to `o` (3,) and to each other."""
    u = np.cross(o, [0.0, 1.0, 0.0] if abs(o[1]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    return u, np.cross(o, u)


def curves(H_D: Array, o: Array, points: Array) -> Array:
    """Points c_i of lines and circles in a plane perpendicular to `o`, in front of the object.

    Args:
        H_D: (3,) [m] centroid of the visible model in S.
        o: (3,) unit line of sight.
        points: (m, 3) [m] visible model points in S.

    Returns:
        Points (n, 3) [m] in S.
    """
    reach = lateral_reach(H_D, o, points)
    s = np.arange(-reach, reach + _RAY_STEP, _RAY_STEP)

    flat = [
        np.outer(s, [np.cos(angle), np.sin(angle)])
        for angle in np.linspace(0.0, np.pi, _LINES, endpoint=False)
    ]
    flat += [
        circle(share * reach, max(8, round(2.0 * np.pi * share * reach / _RAY_STEP)))
        for share in _CIRCLES
    ]
    return in_plane(H_D, o, points, np.vstack(flat))


def clear_of_edges(
    surface: ModelSurface, X_TS: Array, starts: Array, t: Array, o: Array, margin: float
) -> np.ndarray:
    """Mask (n,) of the rays that meet the same face of the model when moved aside by `margin`.

    Args:
        surface: Sampled model.
        X_TS: (4, 4) pose of S in T.
        starts: (n, 3) [m] start points of the rays in S.
        t: (n,) [m] distance to the model along `o`.
        o: (3,) unit direction of the rays in S.
        margin: [m] by which each ray is moved to four sides.

    Returns:
        Mask (n,).
    """
    clear = np.ones(len(starts), dtype=bool)
    way = np.broadcast_to(o @ X_TS[:3, :3].T, starts.shape)

    u, v = across(o)
    for aside in (u, -u, v, -v):
        beside = surface.scene.distance(transform_points(X_TS, starts + margin * aside), way)
        with np.errstate(invalid="ignore"):
            clear &= np.abs(beside - t) < jump(0.0) + 3.0 * margin
    return clear


def circle(radius: float, n: int) -> Array:
    """Points (n, 2) [m] of a circle about the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def lateral_reach(H_D: Array, o: Array, points: Array) -> float:
    """Distance [m] of the outermost of `points` (m, 3) from the line through H_D along `o`."""
    offset = points - H_D
    return float(np.linalg.norm(offset - np.outer(offset @ o, o), axis=1).max())


def in_plane(H_D: Array, o: Array, points: Array, flat: Array) -> Array:
    """Points (n, 3) [m] in S of `flat` (n, 2) [m] in a plane across `o`, before all `points`."""
    before = min(float(((points - H_D) @ o).min()) - 0.3, -0.05)
    return H_D + before * o + flat @ np.stack(across(o))


def _trimmed_rms(distances: Array, trim: float) -> float:
    smallest = np.sort(np.abs(distances))[: max(1, int((1.0 - trim) * len(distances)))]
    return float(np.sqrt(np.mean(smallest**2)))


def _rms_distance(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))


def _form(points: Array, E: Array, size: float) -> float:
    """Trimmed rms [m] of the medians of `E` (n,) over cubes of edge `size` [m]; 0 if too few.

    Averaging removes the noise and leaves errors of shape and pose.
    """
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    _, patch, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    large = np.nonzero(count >= _PATCH_RAYS)[0]
    return (
        _trimmed_rms(np.asarray(ndimage.median(E, patch, large)), _PATCH_TRIM)
        if len(large) >= 4
        else 0.0
    )


def _beyond(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Share that the model at `X_ST` leaves unexplained of the surfaces that pass smoothly into it.

    A neighbour that touches the object meets it at a crease, and is another surface.
    """
    if surface.is_open:
        return 0.0  # the object goes on where its scan ends

    on_model = explained(evidence, surface, X_ST)
    label = connected_surfaces(evidence.points, _TOGETHER * surface.spacing, evidence.normals)
    taken = (np.bincount(label, weights=on_model) > _PART * np.bincount(label))[label]
    return float(1.0 - on_model[taken].mean()) if taken.any() else 0.0


def _unmade(reason: str) -> PoseCheck:
    nothing = np.zeros((0, 3))
    return PoseCheck(
        decision=Decision.RESCAN,
        figure_m=np.inf,
        threshold_m=0.0,
        form_m=np.inf,
        form_threshold_m=0.0,
        agreement=0.0,
        through=0.0,
        coverage=0.0,
        hidden=np.nan,
        rays=0,
        edges=EdgeFigures(np.nan, 0.0, np.nan, np.nan),
        beyond=np.nan,
        move_m=np.nan,
        move_threshold_m=0.0,
        size=np.nan,
        size_threshold=0.0,
        margin=np.inf,
        free=np.zeros((0, 6)),
        projections=Projections(nothing, nothing),
        contradicted=True,
        reason=reason,
    )
