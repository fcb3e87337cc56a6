"""Verification of a fitted pose by projected trajectories: accept, rescan or refuse.

Curves in a plane perpendicular to o = -(S - H_D)/|S - H_D| are projected along o on the
triangulated surfaces of the scan and of the fitted model. The distances E_i between both
projections measure how far the surfaces lie apart [Konoplin 2022, eq. 2].

The published Q = sqrt(sum E_i^2) (`registration.published.paper_check`) grows with the number of
rays. It has no rule for rays that miss a surface or meet an occluder, and is dominated by a few
rays at edges. Here each ray of several curves is classified: both surfaces agree, or the scan is in
front of the model, or the scan is behind the model (the scan "sees through" the model), or an
occluder hides the model, which is no evidence.

A trimmed rms, the shares of these classes, the coverage and the offset of sharp depth edges are
compared with limits from the sensor's noise and resolution. There are three further conditions:

- ICP from the pose does not move it.
- The object has the size of the model.
- The scan is far less likely at every other pose that looks similar (such as a starfish turned by
  one arm), and at every pose to which another ICP converged.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uuv.perception.clouds.scan import connected_surfaces
from uuv.perception.registration.evidence import MODEL_TOLERANCE, Evidence, explained
from uuv.perception.registration.fine_fit import IcpFit, fine_fit
from uuv.perception.registration.likelihood import OCCLUDER, log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pairing import edge_offsets
from uuv.perception.registration.pose_covariance import PoseCovariance
from uuv.perception.registration.pose_search import best_alternative
from uuv.perception.registration.projection.check_rays import (
    MIN_RAYS,
    SURFACE_PIXELS,
    CheckRays,
    cast,
)
from uuv.sim.interfaces.spatial import Array, transform_points

TRIM = 0.15  # [-] share of the largest distances that the figure leaves out
_RIM = 1.0  # [noise lengths] width below which a missing part is explained by the error of an edge
_FEATURE = 2.0  # [noise lengths^2] largest part that may be missing by chance
# [spacings] edge of a part that a cloud cannot distinguish from a gap between two of its surfaces
_UNTOLD = 3.0
_AGREES = 1.5  # [sigma] difference up to which scan and model agree
# [-] share of such pixels among those within 3 sigma around a missing part; around a dent there are
# fewer
_ABRUPT = 0.6
_TOGETHER = 3.0  # [spacings] between neighbouring points of one surface
# [-] explained share of a scanned surface, above which all of it should belong to the model
_PART = 0.1
_PATCHES = 9.0  # [-] ratio of the model's radius to the edge of a patch
_PATCH_RAYS = 5  # least number of rays in a patch
_PATCH_TRIM = 0.25  # [-] share of patches that may be fouled or dented
# Limits on shares of rays and edges (0..1) and on figures in units of the noise. They are between
# the values of true poses (clean, fouled, up to 66 % hidden) and of poses 10 deg or 3 cm off;
# scripts/experiments/identification/decisions.py counts their errors.
MAX_FIGURE = 1.0  # [sigma]; true poses reach 0.85
MIN_AGREEMENT = 0.70  # [-] least share of rays on which both surfaces agree
MAX_THROUGH = 0.12  # [-] largest share of rays on which the scan sees through the model
MIN_EDGE_SHARE = 0.25  # [-] least share of the model's sharp edges found in the scan
# [-] largest share of the model's edges beyond which the scanned surface goes on
MAX_GOES_ON = 0.35
# [-] unexplained share of the scanned surface around the model; fouled objects reach 0.13
MAX_BEYOND = 0.25
# [-] least share of the model's sharp edges that the scan shows, and largest share beyond which it
# continues, if the object ends where the model does
_ENDS = (0.75, 0.1)
# [-] largest unexplained share in that case: a neighbour is in contact with the object
_MAX_TOUCHING = 0.5
MIN_COVERAGE = 0.1  # [-] least share of the expected rays on which the scan shows the object
WHOLE = 0.5  # [-] coverage above which another scan is not expected to remove a contradiction
MAX_MOVE = (0.003, 0.005)  # [m] and share of the range: largest motion of the pose by another ICP
# [m], share of the range and [rad]: largest error of an accepted pose
FOUND = (0.005, 0.003, np.deg2rad(3.0))
# [views] cost of a wrong pose: below a probability of 0.9 another view is expected to cost less
WRONG_COSTS = 10.0
# [-] largest difference of the best scale from 1: half that of an object 5 % larger or smaller
MAX_SIZE = 0.025
# [-] standard deviation of the scale, above which such a difference cannot be detected
MAX_SIZE_SIGMA = 0.02
# [nat] margin over every other pose; right poses among near twins (an uneven starfish) reach 8
MIN_MARGIN = 6.0


class Decision(StrEnum):
    """Decision after one identification."""

    ACCEPT = "accept"
    # scan from another position: the scan neither proves the pose nor rules it out
    RESCAN = "rescan"
    REFUSE = "refuse"  # the scan contradicts the model


class EdgeFigures(NamedTuple):
    """Comparison of the sharp depth edges; the figures are NaN without any in view."""

    offset_m: float  # [m] median offset across the edge
    threshold_m: float  # [m] its limit
    share: float  # [-] share of the model's edges found in the scan
    goes_on: float  # [-] share of the model's edges beyond which the scanned surface goes on


class Projections(NamedTuple):
    """Points at which the rays meet both surfaces."""

    scan: Array  # (k, 3) [m] C_i on the scan, in S
    model: Array  # (k, 3) [m] C'_i on the model, in S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseCheck:
    """Figures of the verification with their limits; `reason` is empty if all limits are kept."""

    decision: Decision
    figure_m: float  # [m] trimmed rms distance of both projections along o; inf without a verdict
    threshold_m: float  # [m] its limit, from the sensor's noise and resolution at this range
    # [m] trimmed rms of the signed medians of the same distances over patches: an error beyond
    # noise
    form_m: float
    form_threshold_m: float  # [m] limit of it
    # [-] share of the rays with a verdict on which both surfaces are within 3 sigma
    agreement: float
    # [-] share of the rays with a verdict on which the scan is behind the model's surface
    through: float
    coverage: float  # [-] share of all rays on which the scan shows the object
    hidden: float  # [-] share of all rays with an occluder in front of the object
    rays: int  # number of rays expected to meet both surfaces
    edges: EdgeFigures
    # [-] share of the scanned surface connected to the model that the model does not explain
    beyond: float
    move_m: float  # [m] rms by which another ICP moves the visible model
    move_threshold_m: float  # [m] limit of it
    size: float  # [-] best scale of the object relative to the model
    size_threshold: float  # [-] largest difference of the scale from 1
    # [nat] log likelihood above that of the best other pose that was tried; inf if there was none
    margin: float
    free: Array  # (k, 6) free twists as in `IcpFit`
    projections: Projections
    # True: the scan contradicts the pose; False: it agrees, or does not observe enough
    contradicted: bool
    reason: str  # reason why the pose was not accepted


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
        covariance: Covariance of the pose; None: the uncertainty is not checked.

    Returns:
        Figures, limits and decision. The decision is RESCAN if too few rays meet the object.
    """
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if visible.sum() < 10:
        return _unmade("the model at the fitted pose is out of view")
    rays = cast(evidence, surface, X_ST, transform_points(X_ST, surface.points[visible]))
    if isinstance(rays, str):
        return _unmade(rays)
    both = rays.compared
    if both.sum() < MIN_RAYS:
        return _unmade(
            f"only {int(both.sum())} check rays meet the object in the scan; need {MIN_RAYS}"
        )

    # Another ICP: whether it moves the pose, and the size at which the object fits best
    rest = fit or fine_fit(evidence, surface, X_ST)
    points = surface.points[visible]
    move = 0.0
    if fit is None:
        move = _rms_distance(transform_points(rest.X_ST, points), transform_points(X_ST, points))
    range_m = float(np.linalg.norm(rays.C_model.mean(axis=0)))

    # Other poses: how much less likely the scan is there
    if others is None:
        others = best_alternative(evidence, surface, X_ST)

    surfaces = _surface_figures(evidence, surface, rays)
    figures = PoseCheck(
        decision=Decision.ACCEPT,
        figure_m=surfaces.distance,
        threshold_m=surfaces.distance_threshold,
        form_m=surfaces.form,
        form_threshold_m=surfaces.form_threshold,
        agreement=surfaces.agreement,
        through=surfaces.through,
        coverage=float((rays.judged & ~rays.through).mean()),
        hidden=float(rays.hidden.mean()),
        rays=len(rays.E),
        edges=_edge_figures(evidence, surface, X_ST, float(np.median(rays.pitch))),
        beyond=_beyond(evidence, surface, X_ST),
        # other fits, sizes and poses
        move_m=move,
        move_threshold_m=MAX_MOVE[0] + MAX_MOVE[1] * range_m,
        size=rest.size,
        size_threshold=MAX_SIZE,
        margin=log_likelihood(evidence, surface, X_ST) - others,
        free=rest.free,
        projections=Projections(
            scan=(rays.C_model + np.where(both, rays.E, 0.0)[:, None] * rays.o)[both],
            model=rays.C_model[both],
        ),
        contradicted=False,
        reason="",
    )

    against = _contradictions(figures, _missing(evidence, surface, X_ST))
    lacking = _unobserved(
        figures,
        free=len(rest.free) - (surface.symmetry.axis is not None),
        size_sigma=covariance.size_sigma if covariance is not None else rest.size_sigma,
        looseness=_looseness(covariance, range_m),
    )
    return _decided(figures, against, lacking)


def _decided(figures: PoseCheck, against: list[str], lacking: list[str]) -> PoseCheck:
    """The check with its decision, from what contradicts the pose and what the view lacks."""
    if not (against or lacking):
        return figures

    # A gross contradiction is final if most of the object is in view
    gross = (
        figures.agreement < 0.5
        or figures.through > 0.3
        or figures.figure_m > 2.0 * figures.threshold_m
    )
    final = gross and figures.coverage + figures.through > WHOLE
    return replace(
        figures,
        decision=Decision.REFUSE if final else Decision.RESCAN,
        contradicted=bool(against),
        reason="; ".join(against + lacking),
    )


class _SurfaceFigures(NamedTuple):
    """Comparison of both surfaces along the rays."""

    agreement: float  # [-] share of the judged rays on which both agree
    through: float  # [-] share of the judged rays on which the scan lies behind the model
    distance: float  # [m] trimmed rms
    distance_threshold: float  # [m]
    form: float  # [m] trimmed rms of the medians over patches
    form_threshold: float  # [m]


def _surface_figures(evidence: Evidence, surface: ModelSurface, rays: CheckRays) -> _SurfaceFigures:
    """Figures of the surfaces, with limits from the noise of the compared rays."""
    both = rays.compared
    judged = max(1, int(rays.judged.sum()))
    noise = float(np.sqrt(np.mean(rays.sigma[both] ** 2)))

    # Over a patch the noise averages out: what remains are errors of shape and pose
    size = surface.radius / _PATCHES
    independent = max(1.0, size / float(np.median(rays.pitch)) / evidence.sensor.noise_length)

    return _SurfaceFigures(
        agreement=float(rays.near.sum() / judged),
        through=float(rays.through.sum() / judged),
        distance=_trimmed_rms(rays.E[both], TRIM),
        distance_threshold=MAX_FIGURE * noise,
        form=_form(rays.C_model[both], rays.E[both], size),
        form_threshold=MODEL_TOLERANCE + 1.1 * noise / np.sqrt(independent),
    )


def _edge_figures(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, pitch: float
) -> EdgeFigures:
    """Figures of the sharp depth edges; `pitch` [m]: between pixels at the object."""
    offsets, share, goes_on = edge_offsets(evidence, surface, X_ST)
    offset = float(np.median(np.abs(offsets))) if len(offsets) else np.nan
    return EdgeFigures(offset, 3.0 * pitch + 0.002, share, goes_on)


def _contradictions(figures: PoseCheck, missing: tuple[int, int]) -> list[str]:
    """Descriptions of what contradicts the pose.

    `missing` is the number of pixels of the largest missing part of the model, and the number that
    may be missing by chance.
    """
    edges = figures.edges
    ends = edges.share > _ENDS[0] and edges.goes_on < _ENDS[1]
    limits = (
        # surfaces
        (
            figures.figure_m > figures.threshold_m,
            f"surfaces are {1e3 * figures.figure_m:.1f} mm apart, limit "
            f"{1e3 * figures.threshold_m:.1f} mm",
        ),
        (
            figures.form_m > figures.form_threshold_m,
            f"shapes differ by {1e3 * figures.form_m:.1f} mm, "
            f"limit {1e3 * figures.form_threshold_m:.1f} mm",
        ),
        (
            figures.agreement < MIN_AGREEMENT,
            f"only {figures.agreement:.0%} of the check rays agree, need {MIN_AGREEMENT:.0%}",
        ),
        (
            figures.through > MAX_THROUGH,
            f"the scan sees through {figures.through:.0%} of the model",
        ),
        # edges, and what lies beyond them
        (
            edges.offset_m > edges.threshold_m,
            f"edges are {1e3 * edges.offset_m:.1f} mm apart, limit {1e3 * edges.threshold_m:.1f} "
            "mm",
        ),
        (
            edges.goes_on > MAX_GOES_ON,
            f"the scanned surface continues beyond {edges.goes_on:.0%} of the model's edges",
        ),
        (
            figures.beyond > (_MAX_TOUCHING if ends else MAX_BEYOND),
            f"{figures.beyond:.0%} of the scanned surface connected to the model does not belong "
            "to the model",
        ),
        # another fit, size or pose
        (
            figures.move_m > figures.move_threshold_m,
            f"a further fit moves the pose by {1e3 * figures.move_m:.1f} mm, limit "
            f"{1e3 * figures.move_threshold_m:.1f} mm",
        ),
        (
            abs(figures.size - 1.0) > figures.size_threshold,
            f"at {figures.size:.2f} times its size the model fits better",
        ),
        (figures.margin < -MIN_MARGIN, "another pose fits better"),
        # missing parts
        (
            missing[0] > missing[1],
            f"{missing[0]} connected pixels of the model are missing in the scan, limit "
            f"{missing[1]}",
        ),
    )
    return [text for failed, text in limits if failed]


def _unobserved(
    figures: PoseCheck, free: int, size_sigma: float, looseness: tuple[bool, str]
) -> list[str]:
    """Descriptions of what this view does not observe well enough.

    Args:
        figures: Figures of the pose.
        free: Number of free twists beyond the declared symmetry.
        size_sigma: [-] standard deviation of the best scale.
        looseness: True if the pose is too uncertain, and its standard deviations.
    """
    loose, sigmas = looseness
    limits = (
        (
            figures.coverage < MIN_COVERAGE,
            f"only {figures.coverage:.0%} of the visible model is in the scan, need "
            f"{MIN_COVERAGE:.0%}",
        ),
        (
            figures.edges.share < MIN_EDGE_SHARE,
            f"only {figures.edges.share:.0%} of the model's edges are in the scan",
        ),
        (
            free > 0,
            "the pose is not fully observable in this view: the model can slide or turn on the "
            "scan",
        ),
        (abs(figures.margin) <= MIN_MARGIN, "another pose fits as well"),
        (
            size_sigma > MAX_SIZE_SIGMA,
            f"the standard deviation of the object's size is {size_sigma:.1%}, need "
            f"{MAX_SIZE_SIGMA:.1%}",
        ),
        (loose, f"the pose is too uncertain in this view: standard deviation {sigmas}"),
    )
    return [text for failed, text in limits if failed]


def _missing(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> tuple[int, int]:
    """Number of pixels of the largest missing part of the model, and the number that may be missing
    by chance.

    The part is a connected region of pixels in which the scan lies behind the model by 3 sigma or
    more, wider than the errors at an edge. At the rim of the part the distance must jump, since a
    dent begins gradually.
    """
    window = evidence.scan.window(transform_points(X_ST, surface.points), 0.05, SURFACE_PIXELS)
    scan = evidence.scan.part(window)
    depth = surface.depth(X_ST, scan)

    # Scan behind the model, in standard deviations
    shown = np.isfinite(depth) & np.isfinite(scan.depth)
    sigma = evidence.sensor.sigma(np.where(shown, depth, 1.0))
    behind = np.where(shown, scan.depth - depth, 0.0) / sigma

    # [px] size of one independent reading
    cell = evidence.sensor.noise_length * evidence.scan.pitch / scan.pitch
    wide = 2 * int(np.ceil(0.5 * _RIM * cell)) + 1

    # Regions wider than the error of an edge, larger than chance and than gaps of the cloud
    label, count = ndimage.label(ndimage.binary_opening(behind > 3.0, np.ones((wide, wide))))
    pixel = scan.pitch * float(np.median(depth[shown])) if shown.any() else np.inf  # [m]
    least = round(max(_FEATURE * cell**2, (_UNTOLD * surface.resolution / pixel) ** 2))
    rough = shown & (np.abs(behind) < 3.0)
    agrees = shown & (np.abs(behind) < _AGREES)

    # The largest of these regions that is too deep for a dent, or begins abruptly
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
    """True if another view costs less than a wrong pose would; and the pose's deviations."""
    if covariance is None:
        return False, ""
    position, angle = covariance.held_sigmas
    wrong = 1.0 - covariance.chance_within(FOUND[0] + FOUND[1] * range_m, FOUND[2])
    return wrong * WRONG_COSTS > 1.0, f"{1e3 * position:.1f} mm and {np.rad2deg(angle):.1f} deg"


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
    """Unexplained share of the scanned surfaces that continue the model at `X_ST` smoothly.

    A neighbour in contact with the object meets it at a crease, and counts as another surface.
    """
    if surface.is_open:
        return 0.0  # the object continues where its own scan ends

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
