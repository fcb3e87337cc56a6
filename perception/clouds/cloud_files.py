"""Loading and cleaning of a user's point cloud file. Notes list the points left out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuv.models.meshes.surfel_files import read_surfels
from uuv.perception.clouds.scan import row_hash
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import Array, finite_number, readonly

FARTHEST = 100.0  # [m] from the sensor; a cloud without `scale` whose points are farther is refused
_NO_POINT = 1e15  # in any unit; a larger coordinate counts as not finite
MOST = 20_000_000  # largest number of points; more take gigabytes of memory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudFile:
    """Cleaned cloud of a file."""

    points: Array  # (n, 3) [m] in S, without duplicates; or organised (h, w, 3), NaN where left out
    notes: tuple[str, ...]  # points and columns left out, as text


def load_cloud(file: str | Path, scale: float | None = None) -> CloudFile:
    """Load a point cloud in the sensor's frame S from a PLY, PCD or text file.

    A line of a text file has x y z and optional other columns. Points that are not finite, at the
    origin (no return) or duplicates are left out. An organised PCD file keeps its pixel grid.

    Args:
        file: Path of the file.
        scale: [m] per unit of the file (0.001 for millimetres). None: metres, and a cloud that is
            then farther than FARTHEST is refused.

    Raises:
        ConfigurationError: The file is missing, malformed, empty, has no usable point, has more
            than MOST points, or is in a wrong unit.
    """
    file = existing_file(file, "cloud")
    if scale is not None:
        scale = finite_number(scale, f"cloud {file}: scale", least=1e-9, most=1e9)
    surfels = read_surfels(file)
    points = surfels.points
    shape = surfels.shape

    if len(points) > MOST:
        raise ConfigurationError(
            f"cloud {file}: must have at most {MOST} points, got {len(points)}"
        )

    # Metres; coordinates that mean "no point" become NaN
    points = np.where(np.abs(points) < _NO_POINT, points, np.nan) * (
        1.0 if scale is None else scale
    )
    usable = np.ones(len(points), dtype=bool)
    notes = list(surfels.notes)

    def leave_out(those: np.ndarray, what: str) -> None:
        those = those & usable
        if those.any():
            notes.append(f"{int(those.sum())} of {int(usable.sum())} points left out: {what}")
            usable[those] = False
        if not usable.any():
            raise ConfigurationError(
                f"cloud {file}: the file has no usable point; {'; '.join(notes)}"
            )

    leave_out(np.asarray(~np.isfinite(points).all(axis=1)), "not finite")
    leave_out(np.asarray(~points.any(axis=1)), "at the origin, no return")

    if scale is None:
        _check_unit(points[usable], file)

    # An organised cloud keeps its pixels, an unordered cloud loses its duplicates
    if shape is not None:
        points[~usable] = np.nan
        return CloudFile(points=readonly(points.reshape(*shape, 3)), notes=tuple(notes))
    leave_out(_again(points), "duplicates")
    return CloudFile(points=readonly(points[usable]), notes=tuple(notes))


def _check_unit(points: Array, file: Path) -> None:
    """Refuse points (n, 3) if more than 2 % are farther than FARTHEST, which shows that they are
    not in metres.
    """
    far = float((np.abs(points).max(axis=1) > FARTHEST).mean())
    if far <= 0.02:
        return

    middle = float(np.median(np.linalg.norm(points, axis=1)))
    raise ConfigurationError(
        f"cloud {file}: {far:.0%} of its points lie more than {FARTHEST:.0f} m from the sensor, "
        f"median {middle:.4g} m; if the file is in millimetres, state its scale (0.001); mixed "
        "units are not allowed"
    )


def _again(points: Array) -> np.ndarray:
    """Mask (n,) of the points (n, 3) that are duplicates of an earlier one."""
    # three numbers are packed into one for sorting; -0 counts as 0
    mixed = row_hash((points + 0.0).view(np.int64))
    # stable sorting: of equal points the first stays first
    order = np.argsort(mixed, kind="stable")
    again = np.zeros(len(points), dtype=bool)
    again[order[1:]] = (points[order[1:]] == points[order[:-1]]).all(axis=1)
    return again
