"""Reader of all point cloud files, of models and of scans: points, and normals if there are any."""

from dataclasses import dataclass
from pathlib import Path

from uuv.models.meshes.ply_files import ply_columns, read_ply_normals
from uuv.models.meshes.text_clouds import read_text_cloud
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of, existing_file, text_of
from uuv.sim.interfaces.spatial import Array

TEXT = ("xyz", "txt", "asc", "csv", "pts", "xyzn", "xyzrgb")  # endings of text files
KINDS = "allowed are PLY, PCD, or text with x y z on each line"
# Files of other programs: first bytes, endings, and how to convert them.
_FOREIGN = {
    "NumPy": (b"\x93NUMPY", ("npy", "npz"), 'numpy.savetxt("cloud.xyz", points) writes such text'),
    "LAS": (b"LASF", ("las", "laz"), "pdal translate FILE cloud.ply, or CloudCompare, converts it"),
    "E57": (b"ASTM-E57", ("e57",), "pdal translate FILE cloud.ply, or CloudCompare, converts it"),
}
_HEAD = 20_000  # [bytes] that contain the header of a PCD file
_HEAD_LINES = 50  # [bytes] of a text, by which its kind is recognised


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surfels:
    """Content of a point cloud file, in its unit and order."""

    points: Array  # (n, 3), n > 0, NaN kept
    normals: Array | None  # (n, 3) as they are in the file
    # rows and columns of an organised cloud, which only PCD files can hold
    shape: tuple[int, int] | None
    notes: tuple[str, ...]  # description of how its columns were used


def is_cloud_file(file: Path) -> bool:
    """True if a file holds a cloud: PCD or text by its ending, PLY if it has no faces.

    Raises:
        ConfigurationError: the file cannot be read, or is a cloud of a format that is not read
            here.
    """
    kind = file.suffix.lower().removeprefix(".")
    if kind != "ply":
        _refuse_foreign(file, "target cloud")
        return kind == "pcd" or kind in TEXT

    try:
        points, _, triangles = read_ply_normals(bytes_of(file, "target cloud"))
    except ValueError:
        return False  # the reader of meshes raises the error
    return len(points) > 0 and not len(triangles)


def read_surfels(file: str | Path, what: str = "cloud") -> Surfels:
    """Read a point cloud file: PLY or PCD by its ending, else text.

    Args:
        file: Path of the file.
        what: First words of error messages: "cloud" or "target cloud".

    Raises:
        ConfigurationError: the file is missing, empty, malformed or of another format.
    """
    path = existing_file(file, what)
    match path.suffix.lower():
        case ".pcd":
            # imported here, since it imports numba, which few objects need
            from uuv.models.meshes.pcd_files import read_pcd

            points, normals, shape, others = read_pcd(path)
            return Surfels(points=points, normals=normals, shape=shape, notes=_left_out(others))
        case ".ply":
            content = bytes_of(path, what)
            try:
                points, normals, _ = read_ply_normals(content)
            except ValueError as error:
                raise ConfigurationError(
                    f"{what} {path}: no points can be read from this PLY file: {error}"
                ) from error
            if not len(points):
                raise ConfigurationError(f"{what} {path}: this PLY file has no points")

            used = {*"xyz", *(("nx", "ny", "nz") if normals is not None else ())}
            others = [name for name in ply_columns(content) if name not in used]
            return Surfels(points=points, normals=normals, shape=None, notes=_left_out(others))
        case _:
            cloud = read_text_cloud(_text(path, what), f"{what} {path}")
            return Surfels(
                points=cloud.points, normals=cloud.normals, shape=None, notes=cloud.notes
            )


def _left_out(names: list[str]) -> tuple[str, ...]:
    """Note on the columns that are not read; none if there are no such columns."""
    return (f"columns left out: {' '.join(names)}",) if names else ()


def check_surfels(file: str | Path, what: str = "cloud") -> None:
    """Refuse a file whose beginning is neither PLY nor PCD nor text with points.

    Raises:
        ConfigurationError: It is missing, empty or of another kind.
    """
    path = existing_file(file, what)
    match path.suffix.lower():
        case ".ply" if not bytes_of(path, what).lstrip().startswith(b"ply"):
            raise ConfigurationError(f"{what} {path}: this is not a PLY file; {KINDS}")
        case ".pcd" if b"FIELDS" not in bytes_of(path, what)[:_HEAD]:
            raise ConfigurationError(f"{what} {path}: this is not a PCD file; {KINDS}")
        case ".ply" | ".pcd":
            return
        case _:
            read_text_cloud(_text(path, what), f"{what} {path}", _HEAD_LINES)


def _text(path: Path, what: str) -> str:
    """Text of a cloud that is neither PLY nor PCD. The error for a binary file lists the allowed
    kinds.
    """
    _refuse_foreign(path, what)
    try:
        text = text_of(path, what)
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; {KINDS}") from error
    if "\0" in text:
        raise ConfigurationError(
            f"{what} {path}: this file is binary and of an unknown kind; {KINDS}"
        )
    return text


def _refuse_foreign(path: Path, what: str) -> None:
    """Refuse a cloud file of another program, recognised by ending or first bytes; the message
    states how to convert it.
    """
    ending = path.suffix.lower().removeprefix(".")
    for name, (start, endings, way) in _FOREIGN.items():
        if ending in endings or bytes_of(path, what).startswith(start):
            raise ConfigurationError(f"{what} {path}: {name} files cannot be read; {KINDS}: {way}")
