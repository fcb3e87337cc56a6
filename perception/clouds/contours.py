"""Contours: depth edges of a scan between neighbouring pixels, and directions across them."""

from dataclasses import dataclass, fields

import numpy as np
from scipy import ndimage

from uuv.perception.clouds.cloud_grid import jump
from uuv.perception.clouds.scan import Scan
from uuv.sim.interfaces.spatial import Array

_SEAM = 5  # [px] width of the seam without depth between an occluder and the surface behind it
_EDGE_WIDTH = 2.0  # [px] standard deviation of the Gaussian for the direction across an edge


@dataclass(frozen=True, slots=True, eq=False)
class Contour:
    """Depth edges, each between a pixel on the near side and one of its four neighbours."""

    rows: np.ndarray  # (n,) row of the near pixel
    columns: np.ndarray  # (n,) column of the near pixel
    steps: np.ndarray  # (n, 2) step to the neighbour: columns right, rows down
    tangents: Array  # (n, 2) x/z and y/z of the edge
    depth: Array  # (n,) [m] depth of the near pixel

    def only(self, kept: np.ndarray) -> "Contour":
        """The edges that a mask (n,) selects."""
        return Contour(*(getattr(self, field.name)[kept] for field in fields(self)))


def contour(scan: Scan, mask: np.ndarray, depth_all: Array, seams: bool = True) -> Contour:
    """Depth edges between masked pixels and those of their 4-neighbours that are farther by a jump,
    or empty.

    The edge lies midway between the two pixels. If the neighbour is a mixed pixel, which may belong
    to either side, the edge lies on the neighbour. The border of the picture is not an edge,
    because there the view ends, not the object. The edge of an occluder, which leaves a seam of
    empty pixels, is not an edge of the object either.

    Args:
        scan: The scan.
        mask: (h, w) pixels of the object.
        depth_all: (h, w) [m] depth of all pixels, NaN without echo.
        seams: True: occluders leave seams; False for a rendered model.

    Returns:
        The depth edges, one for each pair of pixels.
    """
    z = np.where(np.isfinite(depth_all), depth_all, np.inf)
    here = np.where(mask, scan.depth, np.inf)
    step = np.where(mask, jump(scan.depth), 0.0)

    # No edge on the border of the picture
    inner = np.zeros_like(mask)
    inner[1:-1, 1:-1] = True
    edges: list[tuple[np.ndarray, ...]] = []
    with np.errstate(invalid="ignore"):
        # Pixels next to an occluder, which leaves a seam without depth
        hidden = (
            here - ndimage.minimum_filter(z, 2 * _SEAM + 1) > step if seams else np.zeros_like(mask)
        )

        # Edges towards each neighbour that is farther by a jump, or empty
        for right, down in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            beside = np.roll(z, (-down, -right), axis=(0, 1))
            rows, columns = np.nonzero(
                mask & inner & (beside - here > step) & ~(hidden & np.isinf(beside))
            )
            beyond = z[
                np.clip(rows + 2 * down, 0, len(z) - 1),
                np.clip(columns + 2 * right, 0, z.shape[1] - 1),
            ]

            # a single empty pixel within a surface is no edge
            ends = beyond - here[rows, columns] > step[rows, columns]
            rows = rows[ends]
            columns = columns[ends]
            beyond = beyond[ends]

            # The edge is on the neighbour if that is a mixed pixel, else midway
            neighbour = beside[rows, columns]
            reach = np.where(beyond - neighbour > jump(neighbour), 1.0, 0.5)  # [px]
            edges.append((rows, columns, np.tile([right, down], (len(rows), 1)), reach))

    rows, columns, steps, reach = (np.concatenate(part) for part in zip(*edges, strict=True))
    tangents = (
        np.column_stack([scan.tangent_x[columns], scan.tangent_y[rows]])
        + scan.pitches * reach[:, None] * steps
    )
    return Contour(rows, columns, steps, tangents, scan.depth[rows, columns])


def outward(mask: np.ndarray, depth: Array, rows: np.ndarray, columns: np.ndarray) -> Array:
    """Unit directions across depth edges at given pixels, away from the near side.

    At the rim of `mask` the direction points out of the mask. Inside the mask, where one part of
    the object is in front of another, it points towards larger `depth`.

    Args:
        mask: (h, w) pixels of the object.
        depth: (h, w) [m] of the pixels.
        rows: (n,) of the pixels.
        columns: (n,) of the pixels.

    Returns:
        Directions (n, 2), x then y in the image.
    """
    smooth = ndimage.gaussian_filter(mask.astype(np.float32), _EDGE_WIDTH)

    gradient = -_gradient(smooth, rows, columns)
    # mixed pixels along an inner edge leave gaps
    closed = ndimage.binary_closing(mask, iterations=2)
    inner = ndimage.binary_erosion(closed, iterations=round(4.0 * _EDGE_WIDTH))[rows, columns]

    # Inside the mask the direction is perpendicular to lines of equal inverse depth
    if inner.any():
        near = np.where(mask, 1.0 / np.where(mask, depth, 1.0), 0.0)
        mean = ndimage.gaussian_filter(near, _EDGE_WIDTH) / np.maximum(smooth, 1e-6)
        gradient[inner] = -_gradient(mean, rows[inner], columns[inner])
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def _gradient(image: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Array:
    """Gradient (n, 2), x then y, by Sobel kernels, at pixels that are not on the border."""
    near = {
        (dy, dx): image[rows + dy, columns + dx]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
        if dy or dx
    }

    x = sum(weight * (near[dy, 1] - near[dy, -1]) for dy, weight in ((-1, 1.0), (0, 2.0), (1, 1.0)))
    y = sum(weight * (near[1, dx] - near[-1, dx]) for dx, weight in ((-1, 1.0), (0, 2.0), (1, 1.0)))
    return np.column_stack([x, y]).astype(np.float64)
