"""Fusion of several depth frames of one scene: the median depth in the pixel grid of the last frame.

A stereo matcher errs in patches, differently in every frame. A mean over the neighbours in one frame keeps this error;
a median over frames removes it. The median also removes what a single frame shows alone: flying pixels, a fish.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.clouds.scan import Scan
from perception.registration.identification import Identification
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, inverse, readonly, transform_points

_SEEN = 0.4  # [-] share of the frames in which a pixel must have depth
_MEDIAN = 1.25  # [-] standard deviation of a median of normal errors over that of their mean
_FEW = 3  # frames from which on they are fused: a median of fewer removes nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """A scan with the pose of the sensor."""

    scan: Scan
    X_WS: Array  # (4, 4) pose of the sensor, in a frame W common to all frames


def fused(looks: Sequence[Frame]) -> Scan:
    """Median depth of several frames in the grid and sensor frame of the last one; NaN where too few have depth.

    The frames may be taken from different places. Where one has no depth, or shows another surface, the others decide.

    Args:
        looks: Frames, in order of time.

    Raises:
        ConfigurationError: Without any frame.
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


def with_fused_frames(found: Identification, looks: Sequence[Frame]) -> Identification:
    """Replace the scan of an identification by the median of several frames, for planning a path on it.

    The pose and its PoseCheck stay those of the single frame, whose noise their limits were set for. With fewer than
    three frames `found` is returned unchanged.

    Args:
        found: Identification in the last of `looks`.
        looks: Frames, in order of time.
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
    """Depth (h, w) [m] of the points of `scan` in the pixels of `grid`, the nearest in each; NaN where there is none.

    `X_GS` (4, 4): pose of the scan's sensor in the frame of the grid's.
    """
    points = scan.points.reshape(-1, 3)
    points = transform_points(X_GS, points[np.isfinite(points[:, 2])])
    row, column, inside = grid.pixels(points)
    depth = np.full(grid.depth.shape, np.inf)
    np.minimum.at(depth, (row[inside], column[inside]), points[inside, 2])
    depth[np.isinf(depth)] = np.nan
    return depth
