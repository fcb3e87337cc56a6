"""A user's own cloud from a file, cleaned: what was left out is said, what cannot be used is one error."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from perception.clouds.point_files import read_picture
from perception.clouds.scan import row_hash
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import existing_file
from sim.interfaces.spatial import Array, finite_number, readonly

FARTHEST = 100.0  # [m] from the sensor that a cloud is believed
_NO_POINT = 1e15  # in any unit, from where on a number is no place
MOST = 20_000_000  # points: gigabytes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudFile:
    """What a file holds."""

    points: Array  # (N, 3) [m], in the sensor's frame, none twice; or a picture (H, W, 3), NaN where left out
    notes: tuple[str, ...]  # what was left out, in words


def load_cloud(file: str | Path, scale: float | None = None) -> CloudFile:
    """The cloud of a PLY, PCD or text file (three numbers a line), in the sensor's frame.

    `scale` takes the file's unit to metres (0.001 for millimetres); None: metres, and a cloud that then lies farther
    than FARTHEST is refused. Points that are not finite, at the origin (no return) or there twice are left out; the
    pixels of a PCD file that is a picture stay in their places. Raises ConfigurationError for a file that is missing,
    malformed, empty, without a usable point, of more than MOST points, or in a wrong unit.
    """
    file = existing_file(file, "cloud")
    if scale is not None:
        scale = finite_number(scale, f"cloud {file}: scale", least=1e-9, most=1e9)
    points, shape = read_picture(file)
    if len(points) > MOST:
        raise ConfigurationError(f"cloud {file}: at most {MOST} points are allowed, it holds {len(points)}")
    points = np.where(np.abs(points) < _NO_POINT, points, np.nan) * (1.0 if scale is None else scale)
    kept = np.ones(len(points), dtype=bool)
    notes: list[str] = []

    def leave_out(those: np.ndarray, what: str) -> None:
        those = those & kept
        if those.any():
            notes.append(f"{int(those.sum())} of {int(kept.sum())} points left out: {what}")
            kept[those] = False
        if not kept.any():
            raise ConfigurationError(f"cloud {file}: no usable point is left; {'; '.join(notes)}")

    leave_out(np.asarray(~np.isfinite(points).all(axis=1)), "not finite")
    leave_out(np.asarray(~points.any(axis=1)), "at the origin, no return")
    if scale is None:
        far = float((np.abs(points[kept]).max(axis=1) > FARTHEST).mean())
        if far > 0.02:
            middle = float(np.median(np.linalg.norm(points[kept], axis=1)))
            raise ConfigurationError(
                f"cloud {file}: {far:.0%} of its points lie more than {FARTHEST:.0f} m from the sensor, median "
                f"{middle:.4g} m: millimetres, or units mixed? One unit is allowed; give its scale (0.001 for mm)"
            )
    if shape is not None:
        points[~kept] = np.nan
        return CloudFile(points=readonly(points.reshape(*shape, 3)), notes=tuple(notes))
    leave_out(_again(points), "there twice")
    return CloudFile(points=readonly(points[kept]), notes=tuple(notes))


def _again(points: Array) -> np.ndarray:
    """Mask (N,) of the points (N, 3) that were there before."""
    mixed = row_hash((points + 0.0).view(np.int64))  # one number to sort by, of three; -0 is 0
    order = np.argsort(mixed, kind="stable")  # of equal ones the first stays first
    again = np.zeros(len(points), dtype=bool)
    again[order[1:]] = (points[order[1:]] == points[order[:-1]]).all(axis=1)
    return again
