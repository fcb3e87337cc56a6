"""Reader of a model given as a point cloud: points, and normals where the file has them."""

from pathlib import Path

import numpy as np

from models.meshes.ply_files import read_ply_normals
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import bytes_of, text_of
from sim.interfaces.spatial import Array

TEXT = ("xyz", "txt", "asc", "csv")  # endings of text files, three or six numbers a line


def is_cloud_file(file: Path) -> bool:
    """Whether a file holds a cloud: PCD or text by its ending, PLY if it has no faces.

    Raises:
        ConfigurationError: the file cannot be read.
    """
    kind = file.suffix.lower().removeprefix(".")
    if kind != "ply":
        return kind == "pcd" or kind in TEXT
    try:
        points, _, triangles = read_ply_normals(bytes_of(file, "target cloud"))
    except ValueError:
        return False  # the reader of meshes says why
    return len(points) > 0 and not len(triangles)


def read_surfels(file: Path) -> tuple[Array, Array | None]:
    """Points (n, 3) in the unit of the file, and normals (n, 3) or None; points that are not finite are left out.

    Raises:
        ConfigurationError: the file is malformed.
    """
    match file.suffix.lower():
        case ".pcd":
            from models.meshes.pcd_files import read_pcd  # brings numba, which few objects need

            points, normals, _ = read_pcd(file)
        case ".ply":
            try:
                points, normals, _ = read_ply_normals(bytes_of(file, "target cloud"))
            except ValueError as error:
                raise ConfigurationError(f"target cloud {str(file)!r}: it cannot be read as PLY: {error}") from error
        case _:
            points, normals = _read_text(file)
    finite = np.isfinite(points).all(axis=1)
    return points[finite], None if normals is None else normals[finite]


def _read_text(file: Path) -> tuple[Array, Array | None]:
    lines = [line.partition("#")[0].replace(",", " ").replace(";", " ") for line in _lines(file)]
    try:
        values = np.loadtxt(lines, dtype=np.float64, ndmin=2)
    except ValueError:
        values = np.zeros((0, 0))
    if values.shape[1] not in (3, 6):
        raise ConfigurationError(
            f"target cloud {str(file)!r}: every line must hold 3 numbers (x y z) or 6 (x y z nx ny nz); "
            f"the first is {next((line for line in lines if line.strip()), '')[:60].strip()!r}"
        )
    return values[:, :3], values[:, 3:] if values.shape[1] == 6 else None


def _lines(file: Path) -> list[str]:
    return text_of(file, "target cloud").splitlines()
