"""Rays of the check, cast on the surfaces of scan and model and classified [Konoplin 2022, eq. 2].

On each ray both surfaces agree, or the scan is in front of the model, or the scan is behind the
model (the scan "sees through" the model), or an occluder hides the model, which is no evidence.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uuv.perception.clouds.scan import distances_along, jump
from uuv.perception.registration.evidence import MODEL_TOLERANCE, Evidence
from uuv.perception.registration.likelihood import OCCLUDER
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.projection.trajectories import across, curves, direction
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

# largest number of pixels of the triangulated scan: finer than the spacing of the rays
SURFACE_PIXELS = 40_000
MIN_RAYS = 40  # least number of rays for a verdict
_ACROSS_EDGES = 1.5  # [px] by which a ray is moved sideways to detect a nearby edge
_FEW_RAYS = 120  # number of parallel rays, below which lines of sight replace them
# [-] share of an occluder in the rim of a region without depth, above which the occluder may
# continue there
_TURNED_AWAY = 0.3
# [-] share of the parallel rays that are clear of edges, below which lines of sight replace them
_THIN = 0.75
_SIGHTS = 1000  # approximate number of lines of sight
_STEEP = np.cos(np.deg2rad(65.0))  # cosine of incidence, below which a ray is not used


@dataclass(frozen=True, slots=True, eq=False)
class CheckRays:
    """Rays along o where the sensor should see the model, and their classes, as arrays (n,) or (n,
    3).
    """

    C_model: Array  # [m] in S
    o: Array  # (3,)
    E: Array  # [m] scan behind (+) or in front of (-) the model; inf if the ray misses the scan
    sigma: Array  # [m] standard deviation of E
    pitch: Array  # [m] distance of neighbouring pixels there
    hidden: np.ndarray  # an occluder lies in front of the model
    near: np.ndarray  # both surfaces agree
    through: np.ndarray  # the scan lies behind the model
    judged: np.ndarray  # near, in front of or through: evidence for or against

    @property
    def compared(self) -> np.ndarray:
        """Mask of the rays that meet the scan and no occluder."""
        return np.isfinite(self.E) & ~self.hidden


def cast(evidence: Evidence, surface: ModelSurface, X_ST: Array, points: Array) -> CheckRays | str:
    """Rays over the visible model `points` (m, 3) [m] in S, cast on both surfaces.

    Returns a reason if too few rays meet the model. The rays are parallel [Konoplin 2022]. On bars
    and grids, where many of them pass near an edge, lines of sight replace them.
    """
    met = _parallel(evidence, surface, X_ST, points)
    if met is None or len(met.C_model) < _FEW_RAYS or met.clear < _THIN:
        by_sight = _lines_of_sight(evidence, surface, X_ST)
        met = by_sight if met is None or len(by_sight.C_model) > len(met.C_model) else met
    if len(met.C_model) < MIN_RAYS:
        return f"only {len(met.C_model)} check rays meet the visible model; need {MIN_RAYS}"

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

    # The ray starts in front of the object, and an occluder may be nearer; only the sensor's line
    # of sight shows it.
    row, column, _ = scan.pixels(C_model)
    top = max(0, int(row.min()) - 2)
    left = max(0, int(column.min()) - 2)
    first = scan.depth[top : int(row.max()) + 3, left : int(column.max()) + 3]
    first = np.where(np.isfinite(first), first, np.inf)
    row = row - top
    column = column - left
    around = ndimage.minimum_filter(first, 3)[row, column]
    occluder = np.maximum(OCCLUDER, 6.0 * sigma)
    hidden = (around < z - occluder) | (-occluder > E)
    if scan.known is not None:
        hidden |= scan.known.depth[row + top, column + left] < z

    # Where scan and model agree along the line of sight, a ray next to it passed through a gap that
    # an occluder leaves.
    behind = scan.depth[top : top + len(first), left : left + first.shape[1]][row, column] - z
    agrees = np.abs(behind) < 3.0 * sigma
    E = np.where(agrees & ~(np.abs(E) < 3.0 * sigma), behind, E)

    # If the ray meets no triangle the line of sight decides: the scan is behind, or there is no
    # depth around.
    meets = np.isfinite(E)
    past = ~meets & np.where(np.isfinite(around), around > z + 3.0 * sigma, True)
    past &= np.isfinite(around) | ~np.isfinite(ndimage.minimum_filter(first, 5)[row, column])
    hidden |= past & _behind_no_depth(first, row, column, z - occluder)

    # Classes: agreement, scan behind the model, scan in front of it
    near = ~hidden & (np.abs(E) < 3.0 * sigma)
    through = ~hidden & ((meets & (3.0 * sigma <= E)) | past)
    before = ~hidden & meets & (-3.0 * sigma >= E)
    judged = near | through | before
    return CheckRays(C_model, met.o, E, sigma, pitch, hidden, near, through, judged)


def _behind_no_depth(first: Array, row: np.ndarray, column: np.ndarray, limit: Array) -> np.ndarray:
    """Mask (n,) of rays into a region without depth that an occluder at the region's rim may hide.

    In such a region the surface of the occluder may be turned away.

    Args:
        first: (h, w) [m] depth of the scan, inf where there is none.
        row: (n,) rows of the rays' pixels.
        column: (n,) columns of the rays' pixels.
        limit: (n,) [m] depth below which a surface is in front of the model.
    """
    label, count = ndimage.label(~np.isfinite(first))
    if count == 0:
        return np.zeros(len(row), dtype=bool)
    beside = ndimage.maximum_filter(label, 3)
    beside[~np.isfinite(first)] = 0

    # Region of each ray, and the depth in front of which the ray is occluded there
    region = label[row, column]
    within = region > 0
    nearest = np.full(count + 1, np.inf)
    np.minimum.at(nearest, region[within], limit[within])

    # Share of an occluder in the region's rim
    rim = beside > 0
    occluding = np.bincount(beside[rim], first[rim] < nearest[beside[rim]], count + 1)
    share = occluding / np.maximum(np.bincount(beside[rim], minlength=count + 1), 1)
    return within & (share[region] > _TURNED_AWAY)


class _Met(NamedTuple):
    """Rays that meet the model where the sensor should see it."""

    C_model: Array  # (n, 3) [m] in S
    cosine: Array  # (n,) cosine of the angle of incidence
    # (n,) [m] scan behind (+) or in front of (-) the model; inf if the ray misses the scan
    E: Array
    o: Array  # (3,) unit, their mean direction
    clear: float  # [-] share of the rays that are clear of the model's edges


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

    # The rays are parallel, unlike the sensor's lines of sight: keep rays whose model point the
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
    part = scan.part(scan.window(C_model, 0.05, SURFACE_PIXELS))
    t_scan = distances_along(part, starts, o)
    if t_scan is None:
        return None
    return _Met(C_model, cosine, np.where(np.isfinite(t_scan), t_scan - t_model, np.inf), o, clear)


def _lines_of_sight(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> _Met:
    """Lines of sight of pixels whose neighbours see the same face of the model."""
    scan = evidence.scan
    window = scan.window(transform_points(X_ST, surface.points), 0.0, SURFACE_PIXELS)
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

    # An even selection of those with moderate incidence
    rows, columns = np.nonzero(clear & (cosine > _STEEP))
    every = max(1, len(rows) // _SIGHTS)
    rows = rows[::every]
    columns = columns[::every]
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
