"""Reader of text files with targets B_i and direction z [Konoplin 2019].

Clouds are read by `uuv.models.meshes.surfel_files`.
"""

from pathlib import Path

import numpy as np

from uuv.models.meshes.surfel_files import read_surfels
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file, text_of
from uuv.sim.interfaces.spatial import Array

_UP = "z"  # first word of the line with the direction z
_BLANKS = str.maketrans({",": " ", ";": " ", "\t": " "})


def read_cloud(file: str | Path) -> Array:
    """Read the points (n, 3) [m] of a PLY, PCD or text file.

    NaN stays NaN: `build_terrain` refuses it.

    Raises:
        ConfigurationError: The file is missing, empty or has other columns; the message names the
            line.
    """
    return read_surfels(file).points


def read_targets(file: str | Path) -> tuple[Array, Array]:
    """Read points B (s, 3) [m] and the unit vector z (3,) of a text file.

    Each line has three numbers. The line of z begins with the letter z; without such a line z is
    (0, 0, 1).

    Raises:
        ConfigurationError: The file has another form; the message names the line.
    """
    path = existing_file(file, "targets")

    B = []
    z = None
    for i, line in _lines(_text(path, "targets")):
        where = f"targets {path}, line {i}"
        word, _, rest = line.partition(" ")
        vector = _numbers(rest if word == _UP else line, 3, where)
        if not np.all(np.isfinite(vector)):
            raise ConfigurationError(f"{where}: every number must be finite, got {line!r}")

        if word != _UP:
            B.append(vector)
        elif z is not None:
            raise ConfigurationError(f"{where}: z is stated twice")
        elif not (largest := np.abs(vector).max()) > 1e-9:
            raise ConfigurationError(f"{where}: z must not be zero")
        else:
            # normalised in two steps, because the square of 1e200 overflows
            z = np.array(vector) / largest
            z /= np.linalg.norm(z)

    if not B:
        raise ConfigurationError(f"targets {path}: the file has no point B")
    return np.array(B), np.array([0.0, 0.0, 1.0]) if z is None else z


def _text(path: Path, what: str) -> str:
    text = text_of(path, what)
    if not any(True for _ in _lines(text)):
        raise ConfigurationError(f"{what} {path}: the file is empty")
    return text


def _lines(text: str):
    """Line numbers, from 1, and contents of the lines that are neither empty nor comments."""
    for i, line in enumerate(text.splitlines(), start=1):
        content = line.partition("#")[0].translate(_BLANKS).strip()
        if content:
            yield i, content


def _numbers(line: str, count: int, where: str) -> list[float]:
    words = line.split()
    if len(words) != count:
        raise ConfigurationError(
            f"{where}: expected {count} columns (x y z), got {len(words)}: {line[:60]!r}"
        )
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ConfigurationError(f"{where}: expected {count} numbers, got {line[:60]!r}") from None
