"""Reader and writer of PLY files, meshes and point clouds, text and binary of either byte order."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.spatial import Array

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_FACES = ("vertex_indices", "vertex_index")  # both names occur in files
_MOST = 2**31  # bound of the number of elements
_NOT_FINITE = "a count or an index is not finite"
NO_SUCH_VERTEX = "a face refers to a vertex that does not exist"


def read_ply(content: bytes) -> tuple[Array, np.ndarray]:
    """Read points (N, 3) and triangles (T, 3) from PLY `content`, in its own unit and order.

    T is 0 for a cloud. Faces with more corners are triangulated around their first. NaN stays NaN.

    Raises:
        ValueError: the content is no PLY file, or is malformed or truncated; the message states the
            reason.
    """
    points, _, triangles = read_ply_normals(content)
    return points, triangles


def read_ply_normals(content: bytes) -> tuple[Array, Array | None, np.ndarray]:
    """As `read_ply`, with normals (N, 3) between points and triangles; None without nx, ny and nz.

    Raises:
        ValueError: as `read_ply` does.
    """
    try:
        return _read(content)
    except OverflowError as error:
        raise ValueError(_NOT_FINITE) from error


def ply_columns(content: bytes) -> list[str]:
    """Names of the properties of the vertices of PLY `content`.

    Raises:
        ValueError: the content is no PLY file.
    """
    _, elements, _ = _header(content)
    vertices = [element for element in elements if element.name == "vertex"]
    return [name for element in vertices for name, _, _ in element.properties]


def need_corners(points: Array, triangles: np.ndarray) -> None:
    """Raise ValueError if one of `triangles` (T, 3) refers to a point that is not in `points` (N,
    3).
    """
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(points):
        raise ValueError(NO_SUCH_VERTEX)


def _read(content: bytes) -> tuple[Array, Array | None, np.ndarray]:
    order, elements, at = _header(content)
    source = _Text(content[at:].split()) if not order else _Binary(content, at, order)
    points = np.zeros((0, 3))
    normals = None
    triangles = np.zeros((0, 3), dtype=np.int64)

    # All elements are read in turn, since each begins where the previous one ends.
    for element in elements:
        columns = source.read(element)
        if element.name == "vertex":
            if not {"x", "y", "z"} <= columns.keys():
                raise ValueError("its vertices have no x, y and z")

            with np.errstate(invalid="ignore"):  # a signalling NaN raises a flag
                points = np.column_stack(
                    [np.asarray(columns[axis], dtype=np.float64) for axis in "xyz"]
                )
                if {"nx", "ny", "nz"} <= columns.keys():
                    normals = np.column_stack(
                        [np.asarray(columns[f"n{axis}"], dtype=np.float64) for axis in "xyz"]
                    )
        elif element.name == "face":
            corners = next((columns[name] for name in _FACES if name in columns), None)
            if corners is None:
                raise ValueError("its faces have no vertex_indices")
            triangles = _triangles(corners)
            break  # later elements are not read

    need_corners(points, triangles)
    return points, normals, triangles


def write_ply(
    file: Path,
    points: ArrayLike,
    triangles: ArrayLike | None = None,
    colours: ArrayLike | None = None,
) -> None:
    """Write points and optional triangles and colours as a binary PLY file.

    Args:
        file: path.
        points: (N, 3), written in double precision.
        triangles: (T, 3) indices.
        colours: (N, 3) in [0, 1].
    """
    corners = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    fields: list[Any] = [("p", "<f8", 3)]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(corners)}"]
    header += [f"property double {axis}" for axis in "xyz"]
    if colours is not None:
        fields.append(("colour", "u1", 3))
        header += [f"property uchar {name}" for name in ("red", "green", "blue")]

    rows = np.zeros(len(corners), dtype=fields)
    rows["p"] = corners
    if colours is not None:
        rows["colour"] = np.rint(255.0 * np.clip(colours, 0.0, 1.0))

    faces = np.zeros(0, dtype=[("corners", "u1"), ("index", "<i4", 3)])
    if triangles is not None:
        index = np.asarray(triangles).reshape(-1, 3)
        faces = np.zeros(len(index), dtype=faces.dtype)
        faces["corners"] = 3
        faces["index"] = index
        header += [f"element face {len(index)}", "property list uchar int vertex_indices"]

    file.write_bytes(
        "\n".join([*header, "end_header", ""]).encode() + rows.tobytes() + faces.tobytes()
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Element:
    name: str
    count: int
    # name, type, type of the length if it is a list
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return any(length is not None for _, _, length in self.properties)


def _header(content: bytes) -> tuple[str, list[_Element], int]:
    """Parse the header: byte order ('' for text), elements, and offset of the data."""
    if not content.startswith(b"ply"):
        raise ValueError("it does not begin with 'ply'")
    order: str | None = None
    elements: list[_Element] = []
    at = 0

    # The header is read line by line; properties belong to the last named element.
    while (end := content.find(b"\n", at)) >= 0:
        words = content[at:end].decode("ascii", "replace").split()
        at = end + 1
        match words:
            case ["end_header"]:
                if order is None:
                    raise ValueError("its header names no format")
                return order, elements, at
            case ["format", name, *_] if name in _FORMATS:
                order = _FORMATS[name]
            case ["element", name, count] if count.isdecimal() and int(count) < _MOST:
                elements.append(_Element(name, int(count)))
            case ["property", "list", length, kind, name] if (
                elements and length in _TYPES and kind in _TYPES
            ):
                elements[-1].properties.append((name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind], None))
            case ["ply"] | ["comment", *_] | ["obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"its header has an unknown line {' '.join(words)[:40]!r}")
    raise ValueError("its header has no end")


def _cut_short(element: _Element) -> ValueError:
    return ValueError(
        f"it is truncated: its header states {element.count} entries of {element.name}"
    )


class _Text:
    """Sequential reader of the numbers of a text PLY."""

    def __init__(self, words: list[bytes]) -> None:
        self._words = words
        self._at = 0

    def read(self, element: _Element) -> dict[str, Any]:
        """Columns (count,) of `element`; a property that is a list gives a list of arrays."""
        if not element.has_lists:
            width = len(element.properties)
            numbers = self._take(element.count * width, element).reshape(element.count, width)
            return {name: numbers[:, k] for k, (name, _, _) in enumerate(element.properties)}

        columns: dict[str, Any] = {name: [] for name, _, _ in element.properties}
        for _ in range(element.count):
            for name, _, length in element.properties:
                many = 1 if length is None else int(self._take(1, element)[0])
                columns[name].append(self._take(many, element))
        return columns

    def _take(self, count: int, element: _Element) -> Array:
        words = self._words[self._at : self._at + max(count, 0)]
        if len(words) < count:
            raise _cut_short(element)
        self._at += len(words)
        return np.array(words, dtype="S").astype(np.float64) if words else np.zeros(0)


class _Binary:
    """Sequential reader of a binary PLY."""

    def __init__(self, content: bytes, at: int, order: str) -> None:
        self._content = content
        self._at = at
        self._order = order

    def read(self, element: _Element) -> dict[str, Any]:
        """Columns as in `_Text.read`; for lists of equal length an array (count, length)."""
        rows = self._rows(element, self._lengths(element))
        if rows is not None:
            return {name: rows[name] for name, _, _ in element.properties}

        columns: dict[str, Any] = {name: [] for name, _, _ in element.properties}
        for _ in range(element.count):
            for name, kind, length in element.properties:
                many = 1 if length is None else int(self._take(length, 1, element)[0])
                columns[name].append(self._take(kind, many, element))
        return columns

    def _lengths(self, element: _Element) -> list[int]:
        """Lengths of the lists in the first row; 1 for properties that are not lists."""
        lengths = []
        start = self._at
        for _, kind, length in element.properties if element.count else ():
            lengths.append(1 if length is None else int(self._take(length, 1, element)[0]))
            self._take(kind, lengths[-1], element)

        self._at = start
        return lengths or [0] * len(element.properties)

    def _rows(self, element: _Element, lengths: list[int]) -> np.ndarray | None:
        """All rows at once, if the lists in each of them are as long as in the first; else None."""
        fields: list[Any] = []
        for (name, kind, length), many in zip(element.properties, lengths, strict=True):
            if length is not None:
                fields.append((f"length of {name}", self._order + length))
            fields.append(
                (name, self._order + kind)
                if length is None
                else (name, self._order + kind, (many,))
            )

        row = np.dtype(fields)
        if len(self._content) - self._at < element.count * row.itemsize:
            if element.has_lists:
                return None
            raise _cut_short(element)

        # Read with the lengths of the first row, if the lengths of all lists agree with them.
        rows = np.frombuffer(self._content, row, element.count, self._at)
        for (name, _, length), many in zip(element.properties, lengths, strict=True):
            if length is not None and (rows[f"length of {name}"] != many).any():
                return None

        self._at += rows.nbytes
        return rows

    def _take(self, kind: str, count: int, element: _Element) -> np.ndarray:
        form = np.dtype(self._order + kind)
        if count < 0 or len(self._content) - self._at < count * form.itemsize:
            raise _cut_short(element)
        taken = np.frombuffer(self._content, form, count, self._at)
        self._at += taken.nbytes
        return taken


def _triangles(faces: Any) -> np.ndarray:
    """Triangles (T, 3) of faces, given as an array (F, n) or as arrays (n,) of corners.

    Faces of less than three corners are left out.
    """
    if isinstance(faces, np.ndarray):
        if not np.isfinite(faces).all():
            raise ValueError(_NOT_FINITE)
        faces = faces.astype(np.int64)
        fans = [faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)]
        return np.stack(fans, axis=1).reshape(-1, 3) if fans else np.zeros((0, 3), dtype=np.int64)

    fans = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
    return np.array(fans, dtype=np.int64).reshape(-1, 3)
