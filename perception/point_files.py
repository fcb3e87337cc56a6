"""Files of points: clouds as text, PLY or PCD, and the text file of targets B_i and direction z (paper 004)."""

from pathlib import Path

import numpy as np

from models import open3d_loader
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

_POINT_CLOUDS = (".ply", ".pcd")
_PLY_SIZES = {
    "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4,
    "float32": 4, "double": 8, "float64": 8,
}  # [bytes]; of others at least 1  # fmt: skip
_UP = "z"  # first word of the line that gives the direction


def read_cloud(file: str | Path) -> Array:
    """Points (N, 3) [m] of a file: PLY or PCD by its ending, else text with three numbers a line.

    Columns are parted by blanks, commas or semicolons; `#` begins a comment. NaN stays NaN: the terrain says so.
    Raises ConfigurationError for a file that is missing, empty or has other columns, with the line.
    """
    path = _existing(file, "cloud")
    if path.suffix.lower() in _POINT_CLOUDS:
        _whole(path)
        points = np.asarray(open3d_loader.load().io.read_point_cloud(str(path)).points, dtype=np.float64)
        if not len(points):
            raise ConfigurationError(f"cloud {path}: no points can be read from this {path.suffix[1:].upper()} file")
        return points
    text = _text(path, "cloud")
    try:
        points = np.loadtxt(text.translate(_BLANKS).splitlines(), dtype=np.float64, comments="#", ndmin=2)
    except ValueError:
        points = None
    if points is None or points.shape[1] != 3:
        rows = [_numbers(line, 3, f"cloud {path}, line {i}") for i, line in _lines(text)]
        points = np.array(rows)
    return points


def picture_shape(file: str | Path) -> tuple[int, int] | None:
    """Rows and columns of a PCD file whose points are the pixels of a picture; None of any other file."""
    path = _existing(file, "cloud")
    said: dict[bytes, bytes] = {}
    if path.suffix.lower() == ".pcd":
        with path.open("rb") as lines:
            while (words := lines.readline(200).split(maxsplit=1)) and words[0] != b"DATA":
                said[words[0]] = words[-1].strip()
    height, width = said.get(b"HEIGHT", b""), said.get(b"WIDTH", b"")
    if not (height.isdigit() and width.isdigit()) or min(int(height), int(width)) < 2:
        return None
    return int(height), int(width)


def read_targets(file: str | Path) -> tuple[Array, Array]:
    """Points B (s, 3) [m] and the unit vector z (3,) of a text file.

    Three numbers a line; the line of z begins with the letter z, without one it is (0, 0, 1). Raises
    ConfigurationError, with the line, for anything else.
    """
    path = _existing(file, "targets")
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
        elif not np.linalg.norm(values) > 1e-9:
            raise ConfigurationError(f"{where}: z must not be zero")
        else:
            z = np.array(values) / np.linalg.norm(values)
    if not B:
        raise ConfigurationError(f"targets {path}: there is no point B in it")
    return np.array(B), np.array([0.0, 0.0, 1.0]) if z is None else z


_BLANKS = str.maketrans({",": " ", ";": " ", "\t": " "})


def _existing(file: str | Path, what: str) -> Path:
    path = Path(file)
    if not path.is_file():
        raise ConfigurationError(f"{what} {path}: there is no such file")
    if not path.stat().st_size:
        raise ConfigurationError(f"{what} {path}: the file is empty")
    return path


def _whole(path: Path) -> None:
    """Raise ConfigurationError for a binary PLY file that ends before its points do: it would be read as if whole."""
    with path.open("rb") as file:
        points, size, at_points = 0, 0, False
        if file.readline().strip() != b"ply" or not file.readline().startswith(b"format binary"):
            return
        while (line := file.readline()) and line.strip() != b"end_header":
            words = line.decode("ascii", "replace").split()
            if words[:1] == ["element"] and len(words) == 3:
                if at_points:
                    break
                at_points = words[1] == "vertex" and words[2].isdigit()
                points = int(words[2]) if at_points else 0
            elif at_points and words[:1] == ["property"]:
                size += _PLY_SIZES.get(words[1], 1)
    if path.stat().st_size < points * size:
        raise ConfigurationError(f"cloud {path}: the file is cut short, there are {points} points in its header")


def _text(path: Path, what: str) -> str:
    try:
        text = path.read_text("utf-8-sig")  # a byte order mark is no number
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{what} {path}: it cannot be read as text ({error})") from error
    if not any(True for _ in _lines(text)):
        raise ConfigurationError(f"{what} {path}: the file is empty")
    return text


def _lines(text: str):
    """Numbers, from 1, and content of the lines that say something."""
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
