"""Reader of point clouds as text, one point per line, with or without a line of column names.

Without names, the columns after x, y and z are identified by their values: three columns of unit
length are a normal. Colours, intensities and all other columns are left out.
"""

import re
from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

_BLANKS = str.maketrans({",": " ", ";": " ", "\t": " "})
_COMMENTS = ("#", "//", "%")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_POINT = (
    ("x", "y", "z"),
    ("points:0", "points:1", "points:2"),
    ("points_0", "points_1", "points_2"),
)
_NORMAL = (
    ("nx", "ny", "nz"),
    ("n_x", "n_y", "n_z"),
    ("normal_x", "normal_y", "normal_z"),
    ("normalx", "normaly", "normalz"),
    ("normals:0", "normals:1", "normals:2"),
    ("normals_0", "normals_1", "normals_2"),
)
_UNIT = 0.02  # largest error of the length of a rounded unit vector
_MOSTLY = 0.95  # share of rows with a unit vector, above which the columns are a normal
_SHOWN = 60  # largest number of characters of a line in an error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TextCloud:
    """Points of a text file, in its unit and order."""

    points: Array  # (n, 3), NaN kept
    normals: Array | None  # (n, 3) as they are in the file
    notes: tuple[str, ...]  # description of how its columns were used


def read_text_cloud(text: str, where: str, most_lines: int | None = None) -> TextCloud:
    """Read the points of a text.

    Columns are separated by blanks, commas or semicolons; `#`, `//` and `%` begin a comment. A
    comma may be the decimal sign if the columns are separated by another character.

    Args:
        text: Content of the file, not empty.
        where: First words of error messages: "cloud FILE".
        most_lines: Number of lines to read, to check whether the text is a cloud.

    Raises:
        ConfigurationError: The text has no points, or a line with a different number of columns;
            the message names the line.
    """
    lines = text.splitlines()[:most_lines]
    names, first = _head(lines, where)
    if first == len(lines):
        raise ConfigurationError(f"{where}: the text has no points")
    notes: list[str] = []
    if _has_decimal_commas(lines[first]):
        lines = [line.replace(",", ".") for line in lines]
        notes.append("commas are read as decimal signs")

    numbers = _values(lines, first, where)
    width = numbers.shape[1]
    if names and len(names) != width:
        raise ConfigurationError(
            f"{where}: {len(names)} columns are named ({' '.join(names)[:_SHOWN]}), but line "
            f"{first + 1} has {width} numbers"
        )
    if width < 3:
        raise ConfigurationError(
            f"{where}, line {first + 1}: expected x y z and optional columns, got {width} numbers: "
            f"{lines[first][:_SHOWN].strip()!r}"
        )

    point, normal = _named(names) if names else ([0, 1, 2], _normal_columns(numbers))
    others = [k for k in range(width) if k not in (*point, *(normal or ()))]
    if others:
        what = (
            " ".join(names[k] for k in others) if names else ", ".join(str(k + 1) for k in others)
        )
        notes.append(
            f"columns left out: {what}" + ("" if names or normal else " (no unit normals)")
        )

    return TextCloud(
        points=numbers[:, point],
        normals=None if normal is None else numbers[:, normal],
        notes=tuple(notes),
    )


def _head(lines: list[str], where: str) -> tuple[list[str], int]:
    """Names of the columns, empty without a line of names, and the index of the first line of
    numbers.
    """
    names: list[str] = []
    for i, line in enumerate(lines):
        content = line.strip()
        comment = next((mark for mark in _COMMENTS if content.startswith(mark)), "")
        words = _words(content.removeprefix(comment))
        if not words or (comment and not _is_head(words)):
            continue
        if comment or not _are_numbers(_numbers_of(line)):
            if names or not _is_head(words):
                raise ConfigurationError(
                    f"{where}, line {i + 1}: expected 3 numbers (x y z), or a line that names the "
                    f"columns, x, y and z among them, got {content[:_SHOWN]!r}"
                )
            names = words
        elif len(words) > 1 or not words[0].isdigit():
            # a single whole number is the count of points, with which PTS files begin
            return names, i

    return names, len(lines)


def _words(line: str) -> list[str]:
    """Names in a line, in lower case, without quotes and units in brackets."""
    return re.sub(r"\[[^\]]*\]|\([^)]*\)|[\"']", " ", line).translate(_BLANKS).lower().split()


def _is_head(words: list[str]) -> bool:
    return any(set(trio) <= set(words) for trio in _POINT)


def _named(names: list[str]) -> tuple[list[int], list[int] | None]:
    """Columns of the point, and those of the normal if it has one."""
    point = next(trio for trio in _POINT if set(trio) <= set(names))
    normal = next((trio for trio in _NORMAL if set(trio) <= set(names)), None)
    return [names.index(name) for name in point], normal and [names.index(name) for name in normal]


def _numbers_of(line: str) -> list[str]:
    """Words of a line of numbers, without the comment at the end of the line."""
    for mark in _COMMENTS:
        line = line.partition(mark)[0]
    return (
        (line.replace(",", ".") if _has_decimal_commas(line) else line).translate(_BLANKS).split()
    )


def _are_numbers(words: list[str]) -> bool:
    try:
        [float(word) for word in words]
    except ValueError:
        return False
    return bool(words)


def _has_decimal_commas(line: str) -> bool:
    """True if commas are decimal signs: each column between blanks or semicolons contains a
    comma.
    """
    words = line.replace(";", " ").split()
    with_comma = [word for word in words if "," in word]
    return (
        len(words) >= 3
        and bool(with_comma)
        and all(_DECIMAL_COMMA.fullmatch(word) for word in with_comma)
    )


def _values(lines: list[str], first: int, where: str) -> Array:
    """Numbers (n, columns) of the lines from `first` on."""
    rows = [_numbers_only(line) for line in lines[first:]]
    try:
        numbers = np.loadtxt(rows, dtype=np.float64, ndmin=2)
        if len(numbers):
            return numbers
    except ValueError:
        pass

    # The first wrong line is named.
    width = len(rows[0].split())
    for i, row in enumerate(rows, start=first + 1):
        words = row.split()
        if words and (len(words) != width or not _are_numbers(words)):
            raise ConfigurationError(
                f"{where}, line {i}: expected {width} numbers, got {row[:_SHOWN].strip()!r}"
            )

    return np.array([[float(word) for word in row.split()] for row in rows if row.split()])


def _numbers_only(line: str) -> str:
    for mark in _COMMENTS:
        if mark in line:
            line = line.partition(mark)[0]
    return line.translate(_BLANKS)


def _normal_columns(values: Array) -> list[int] | None:
    """Indices of three columns after the first three that hold normals; None if there are no
    normals.

    Normals have unit length in nearly all rows, or negative components. Colours have neither of
    these properties.
    """
    for start in range(3, values.shape[1] - 2):
        trio = values[:, start : start + 3]
        usable = np.isfinite(trio).all(axis=1) & trio.any(axis=1)
        if usable.any():
            length = np.linalg.norm(trio[usable], axis=1)
            if (np.abs(length - 1.0) < _UNIT).mean() >= _MOSTLY:
                return [start, start + 1, start + 2]

    if values.shape[1] != 6:
        return None
    trio = values[:, 3:]
    finite = trio[np.isfinite(trio).all(axis=1)]
    # A normal of unknown direction is reported where the model is made.
    zero = not finite.any()
    return [3, 4, 5] if zero or (finite < 0.0).any() else None
