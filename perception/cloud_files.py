"""A user's own cloud from a file, cleaned: what was left out is said, what cannot be used is one error."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from perception.point_files import read_cloud
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import existing_file
from sim.interfaces.spatial import Array, finite_number, readonly

FARTHEST = 100.0  # [m] from the sensor that a cloud is believed
_NO_POINT = 1e15  # in any unit, from where on a number is no place
MOST = 500_000  # points that are kept


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudFile:
    """What a file holds."""

    points: Array  # (N, 3) [m], in the sensor's frame; finite, none twice
    notes: tuple[str, ...]  # what was left out, in words


def load_cloud(file: str | Path, scale: float | None = None) -> CloudFile:
    """The cloud of a PLY, PCD or text file (three numbers a line), in the sensor's frame.

    `scale` takes the file's unit to metres (0.001 for millimetres); None: metres, and a cloud that then lies farther
    than FARTHEST is refused. Points that are not finite, at the origin (no return) or there twice are left out; of
    more than MOST an even share is kept. Raises ConfigurationError for a file that is missing, malformed, empty,
    without a usable point, or in a wrong unit.
    """
    file = existing_file(file, "cloud")
    if scale is not None:
        scale = finite_number(scale, f"cloud {file}: scale", least=1e-9, most=1e9)
    points = read_cloud(file)
    points = np.where(np.abs(points) < _NO_POINT, points, np.nan) * (1.0 if scale is None else scale)
    notes: list[str] = []

    def kept(mask: np.ndarray, what: str) -> None:
        nonlocal points
        if not mask.all():
            notes.append(f"{int((~mask).sum())} of {len(mask)} points left out: {what}")
            points = points[mask]
        if not len(points):
            raise ConfigurationError(f"cloud {file}: no usable point is left; {'; '.join(notes)}")

    kept(np.asarray(np.isfinite(points).all(axis=1)), "not finite")
    kept(np.asarray(points.any(axis=1)), "at the origin, no return")
    if scale is None:
        far = float((np.abs(points).max(axis=1) > FARTHEST).mean())
        if far > 0.02:
            middle = float(np.median(np.linalg.norm(points, axis=1)))
            raise ConfigurationError(
                f"cloud {file}: {far:.0%} of its points lie more than {FARTHEST:.0f} m from the sensor, median "
                f"{middle:.4g} m: millimetres, or units mixed? One unit is allowed; give its scale (0.001 for mm)"
            )
    first = np.zeros(len(points), dtype=bool)
    first[np.unique(points, axis=0, return_index=True)[1]] = True
    kept(first, "there twice")
    if len(points) > MOST:
        notes.append(f"{len(points)} points thinned to {MOST}")
        points = points[np.linspace(0, len(points) - 1, MOST).astype(np.int64)]
    return CloudFile(points=readonly(points), notes=tuple(notes))
