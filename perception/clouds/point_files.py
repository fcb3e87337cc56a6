"""Readers of point files: clouds as text, PLY or PCD, and text files of targets B_i and direction z [Konoplin 2019]."""

from pathlib import Path

import numpy as np

from models.meshes.ply_files import read_ply
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import bytes_of, existing_file, text_of
from sim.interfaces.spatial import Array

KINDS = "what goes is PLY, PCD, or text with x y z a line"
_HEAD = 20_000  # [bytes] that hold the header of a PCD file
_UP = "z"  # first word of the line with the direction z


def read_cloud(file: str | Path) -> Array:
    """Read the points (n, 3) [m] of a file: PLY or PCD by its ending, else text with three numbers a line.

    Columns are separated by blanks, commas or semicolons; `#` begins a comment. NaN stays NaN: `build_terrain` refuses
    it.

    Raises:
        ConfigurationError: For a file that is missing, empty or has other columns; it names the line.
    """
    return read_organised_cloud(file)[0]


def read_organised_cloud(file: str | Path) -> tuple[Array, tuple[int, int] | None]:
    """As `read_cloud`, and rows and columns of an organised cloud, which only PCD files can hold."""
    path = existing_file(file, "cloud")
    match path.suffix.lower():
        case ".pcd":
            from models.meshes.pcd_files import read_pcd  # brings numba, which other clouds do without

            points, _, shape = read_pcd(path)
            return points, shape
        case ".ply":
            return _ply_points(path), None
        case _:
            return _text_points(path), None


def check_cloud(file: str | Path) -> None:
    """Refuse a file that is no cloud by its beginning: neither PLY nor PCD nor lines of three numbers.

    Raises:
        ConfigurationError: It is missing, empty or of another kind.
    """
    path = existing_file(file, "cloud")
    match path.suffix.lower():
        case ".ply" if not bytes_of(path, "cloud").lstrip().startswith(b"ply"):
            raise ConfigurationError(f"cloud {path}: it is no PLY file; {KINDS}")
        case ".pcd" if b"FIELDS" not in bytes_of(path, "cloud")[:_HEAD]:
            raise ConfigurationError(f"cloud {path}: it is no PCD file; {KINDS}")
        case ".ply" | ".pcd":
            return
        case _:
            i, line = next(_lines(_cloud_text(path)))
            _numbers(line, 3, f"cloud {path}, line {i}")


def read_targets(file: str | Path) -> tuple[Array, Array]:
    """Read points B (s, 3) [m] and the unit vector z (3,) of a text file.

    Three numbers a line. The line of z begins with the letter z; without one it is (0, 0, 1).

    Raises:
        ConfigurationError: For anything else; it names the line.
    """
    path = existing_file(file, "targets")
    B, z = [], None
    for i, line in _lines(_text(path, "targets")):
        where = f"targets {path}, line {i}"
        word, _, rest = line.partition(" ")
        values = _numbers(rest if word == _UP else line, 3, where)
        if not np.all(np.isfinite(values)):
            raise ConfigurationError(f"{where}: every number must be finite, got {line!r}")
        if word != _UP:
            B.append(values)
        elif z is not None:
            raise ConfigurationError(f"{where}: z is given twice")
        elif not (largest := np.abs(values).max()) > 1e-9:
            raise ConfigurationError(f"{where}: z must not be zero")
        else:
            z = np.array(values) / largest  # first: the square of 1e200 overflows
            z /= np.linalg.norm(z)
    if not B:
        raise ConfigurationError(f"targets {path}: there is no point B in it")
    return np.array(B), np.array([0.0, 0.0, 1.0]) if z is None else z


_BLANKS = str.maketrans({",": " ", ";": " ", "\t": " "})


def _ply_points(path: Path) -> Array:
    content = bytes_of(path, "cloud")
    try:
        points, _ = read_ply(content)
    except ValueError as error:
        raise ConfigurationError(f"cloud {path}: no points can be read from this PLY file: {error}") from error
    if not len(points):
        raise ConfigurationError(f"cloud {path}: there are no points in this PLY file")
    return points


def _text_points(path: Path) -> Array:
    text = _cloud_text(path)
    try:
        points = np.loadtxt(text.translate(_BLANKS).splitlines(), dtype=np.float64, comments="#", ndmin=2)
    except ValueError:
        points = None
    if points is None or points.shape[1] != 3:
        rows = [_numbers(line, 3, f"cloud {path}, line {i}") for i, line in _lines(text)]
        points = np.array(rows)
    return points


def _cloud_text(path: Path) -> str:
    """Text of a cloud that is neither PLY nor PCD; tells what goes where it is none."""
    try:
        text = _text(path, "cloud")
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; {KINDS}") from error
    if "\0" in text:
        raise ConfigurationError(f"cloud {path}: it is binary; {KINDS}")
    return text


def _text(path: Path, what: str) -> str:
    text = text_of(path, what)
    if not any(True for _ in _lines(text)):
        raise ConfigurationError(f"{what} {path}: the file is empty")
    return text


def _lines(text: str):
    """Numbers, from 1, and content of the lines that are neither empty nor comments."""
    for i, line in enumerate(text.splitlines(), start=1):
        said = line.partition("#")[0].translate(_BLANKS).strip()
        if said:
            yield i, said


def _numbers(line: str, count: int, where: str) -> list[float]:
    words = line.split()
    if len(words) != count:
        raise ConfigurationError(f"{where}: expected {count} columns (x y z), got {len(words)}: {line[:60]!r}")
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ConfigurationError(f"{where}: expected {count} numbers, got {line[:60]!r}") from None
