"""Several looks at one scene as one scan: the median of what each saw, in the grid of the last.

A stereo matcher errs anew in every frame, in patches: no mean over the neighbours in one frame takes that out, a median
over frames does. It also leaves out what a single frame shows alone: flying pixels, a fish.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.clouds.scan import Scan
from perception.registration.identification import Identification
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, inverse, readonly, transform_points

_SEEN = 0.4  # share of the looks in which a pixel must be seen
_MEDIAN = 1.25  # standard deviation of a median of normal errors over that of their mean
_FEW = 3  # looks from which on a median is one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """A scan, and where it was taken from."""

    scan: Scan
    X_WS: Array  # (4, 4) pose of the sensor, in a frame W common to all looks


def fused(looks: Sequence[Frame]) -> Scan:
    """The median depth of `looks` in the grid and frame of the last one; NaN where too few saw anything.

    Looks may be taken from anywhere; where one sees nothing, or another surface, the others decide. Raises
    ConfigurationError without any look.
    """
    if not looks:
        raise ConfigurationError("fused: at least one look is needed")
    last = looks[-1]
    X_SW = inverse(last.X_WS)
    depths = np.stack([*(_seen_from(last.scan, look.scan, X_SW @ look.X_WS) for look in looks[:-1]), last.scan.depth])
    enough = np.isfinite(depths).sum(axis=0) >= max(1, _SEEN * len(looks))
    depth = np.full(last.scan.depth.shape, np.nan)
    depth[enough] = np.nanmedian(depths[:, enough], axis=0)
    x, y = np.meshgrid(last.scan.tangent_x, last.scan.tangent_y)
    return replace(last.scan, points=readonly(np.stack([depth * x, depth * y, depth], axis=-1)))


def on_all_looks(found: Identification, looks: Sequence[Frame]) -> Identification:
    """`found` in the last of `looks`, with all of them as evidence, for the surface that a path is planned on.

    The pose and its check stay those of the single look, whose noise their limits were made for.
    """
    if found.evidence is None or len(looks) < _FEW:
        return found
    evidence, scan = found.evidence, fused(looks)
    of_median = evidence.sensor.disparity_sigma * _MEDIAN / float(np.sqrt(len(looks)))
    return replace(
        found,
        evidence=replace(
            evidence,
            scan=scan,
            mask=evidence.mask & np.isfinite(scan.depth),
            sensor=replace(evidence.sensor, disparity_sigma=of_median),
        ),
    )


def _seen_from(grid: Scan, scan: Scan, X_GS: Array) -> Array:
    """Depth (H, W) [m] of the points of `scan` in the pixels of `grid`, the nearest in each; NaN where there is none.

    `X_GS` (4, 4): the pose of the scan's sensor in that of the grid.
    """
    points = scan.points.reshape(-1, 3)
    points = transform_points(X_GS, points[np.isfinite(points[:, 2])])
    row, column, inside = grid.pixels(points)
    depth = np.full(grid.depth.shape, np.inf)
    np.minimum.at(depth, (row[inside], column[inside]), points[inside, 2])
    depth[np.isinf(depth)] = np.nan
    return depth
