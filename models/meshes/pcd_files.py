"""Reader of PCD files, the point clouds of PCL, as text, binary or compressed. Points keep the
order of the file.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_TYPES = {("F", 4): "<f4", ("F", 8): "<f8"} | {
    (kind, size): f"<{kind.lower()}{size}" for kind in "IU" for size in (1, 2, 4, 8)
}
_PADDING = "_"  # name of a field without content
_LONGEST_HEADER = 100  # largest number of lines of the header


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Layout of the data of a PCD file, as its header states it."""

    kind: str  # ascii, binary or binary_compressed
    types: list[str]  # type of each field, as a NumPy type
    counts: list[int]  # number of numbers of each field
    count: int  # number of points
    shape: tuple[int, int]  # rows and columns of an organised cloud
    columns: list[int]  # indices of the fields x, y, z, and of the normal if there is one
    left_out: list[str]  # names of the other fields


def read_pcd(file: Path) -> tuple[Array, Array | None, tuple[int, int] | None, list[str]]:
    """Read the points of a PCD file.

    Args:
        file: Path of the file.

    Returns:
        Points (n, 3), n > 0, in the unit of the file, with NaN kept in place. Normals (n, 3) as
            they are in the file, None if there are none. Rows and columns if the cloud is
            organised, else None. Names of the fields that are not read.

    Raises:
        ConfigurationError: The file cannot be read, is not PCD, has no x, y, z, or is truncated.
    """
    header, body = _header(bytes_of(file, "cloud"), file)
    try:
        layout = _layout(header)
    except (KeyError, ValueError, IndexError) as error:
        raise ConfigurationError(
            f"cloud {file}: no points can be read from this PCD file: bad header ({error})"
        ) from error

    count = layout.count
    if not count:
        raise ConfigurationError(
            f"cloud {file}: no points can be read from this PCD file, since its header states 0 "
            "points"
        )

    height, width = layout.shape
    shape = (height, width) if min(height, width) > 1 and height * width == count else None
    if layout.kind == "ascii":
        first = [sum(layout.counts[:k]) for k in layout.columns]
        return (
            *_parted(_from_text(body, count, first, sum(layout.counts), file)),
            shape,
            layout.left_out,
        )

    fields = _binary_fields(body, layout, file)
    with np.errstate(invalid="ignore"):  # a signalling NaN would raise a flag
        numbers = [
            np.ascontiguousarray(fields[k]).view(layout.types[k])[:, 0].astype(np.float64)
            for k in layout.columns
        ]
    return *_parted(np.column_stack(numbers)), shape, layout.left_out


def _layout(header: dict[str, list[str]]) -> _Layout:
    """Layout that a header states; KeyError, ValueError or IndexError if it is malformed."""
    names = header["FIELDS"]
    sizes, counts = (
        [int(word) for word in header.get(key, ["1"] * len(names))] for key in ("SIZE", "COUNT")
    )
    types = [_TYPES[kind.upper(), size] for kind, size in zip(header["TYPE"], sizes, strict=True)]
    count = (
        int(header["POINTS"][0])
        if "POINTS" in header
        else int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
    )
    height, width = (int(header.get(key, ["1"])[0]) for key in ("HEIGHT", "WIDTH"))

    columns = [names.index(axis) for axis in "xyz"]
    if all(f"normal_{axis}" in names for axis in "xyz"):
        columns += [names.index(f"normal_{axis}") for axis in "xyz"]
    kind = header["DATA"][0].lower()

    if not len(names) == len(counts) == len(types) or count < 0 or min(counts) < 0:
        raise ValueError("fields")
    if not all(counts[k] for k in columns):
        raise ValueError("x, y and z, and normals, must have a COUNT of at least 1")
    return _Layout(
        kind=kind,
        types=types,
        counts=counts,
        count=count,
        shape=(height, width),
        columns=columns,
        left_out=[name for k, name in enumerate(names) if k not in columns and name != _PADDING],
    )


def _binary_fields(body: bytes, layout: _Layout, file: Path) -> list[np.ndarray]:
    """Bytes (count, width) of each field, from binary data, compressed or not."""
    count = layout.count
    widths = [
        np.dtype(type_).itemsize * many
        for type_, many in zip(layout.types, layout.counts, strict=True)
    ]
    if layout.kind == "binary":
        if len(body) < count * sum(widths):
            raise _cut_short(file, count)
        rows = np.frombuffer(body, np.uint8, count * sum(widths)).reshape(count, -1)
        return [rows[:, sum(widths[:k]) : sum(widths[: k + 1])] for k in range(len(widths))]

    if layout.kind != "binary_compressed":
        raise ConfigurationError(
            f"cloud {file}: PCD data must be ascii, binary or binary_compressed, got "
            f"{layout.kind!r}"
        )

    packed, whole = np.frombuffer(body[:8].ljust(8, b"\0"), "<u4").astype(np.int64)
    if len(body) < 8 + packed or whole != count * sum(widths):
        raise _cut_short(file, count)
    flat = np.zeros(whole, dtype=np.uint8)
    if _unpack(np.frombuffer(body, np.uint8, packed, 8), flat) != whole:
        raise _cut_short(file, count)

    # The compressed data is stored field by field, not point by point.
    ends = count * np.cumsum([0, *widths])
    return [flat[ends[k] : ends[k + 1]].reshape(count, -1) for k in range(len(widths))]


def _parted(values: Array) -> tuple[Array, Array | None]:
    """Points (n, 3), and normals (n, 3) if the values have more columns."""
    return values[:, :3], values[:, 3:] if values.shape[1] > 3 else None


def _header(content: bytes, file: Path) -> tuple[dict[str, list[str]], bytes]:
    """Values of each header line by its keyword, and the data after the header."""
    header: dict[str, list[str]] = {}
    at = 0
    for _ in range(_LONGEST_HEADER):
        end = content.find(b"\n", at)
        if end < 0:
            break
        words = content[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
            if words[0].upper() == "DATA":
                return header, content[at:]
    raise ConfigurationError(
        f"cloud {file}: no points can be read from this PCD file, since it has no header"
    )


def _from_text(data: bytes, count: int, columns: list[int], width: int, file: Path) -> Array:
    lines = [line.split() for line in data.decode("ascii", "replace").splitlines() if line.strip()]
    if len(lines) < count:
        raise _cut_short(file, count)

    points = np.empty((count, len(columns)))
    for i, words in enumerate(lines[:count]):
        try:
            if len(words) != width:
                raise ValueError
            points[i] = [float(words[k]) for k in columns]
        except ValueError:
            raise ConfigurationError(
                f"cloud {file}, point {i + 1}: expected {width} numbers, got "
                f"{' '.join(words)[:60]!r}"
            ) from None
    return points


def _cut_short(file: Path, count: int) -> ConfigurationError:
    return ConfigurationError(
        f"cloud {file}: the file is truncated: its header states {count} points"
    )


@kernel
def _unpack(packed: np.ndarray, whole: np.ndarray) -> int:
    """Decompress LZF [Lehmann 2000] into `whole`; returns the number of bytes written, -1 if
    malformed.
    """
    i = 0  # index of the next byte of `packed`
    o = 0  # index of the next byte of `whole`
    while i < len(packed):
        head = np.int64(packed[i])
        i += 1
        if head < 32:  # literal run of head + 1 bytes
            if i + head + 1 > len(packed) or o + head + 1 > len(whole):
                return -1
            for _ in range(head + 1):
                whole[o] = packed[i]
                i += 1
                o += 1
            continue

        length = head >> 5  # back reference
        if length == 7:
            if i >= len(packed):
                return -1
            length += np.int64(packed[i])
            i += 1
        if i >= len(packed):
            return -1

        back = o - ((head & 31) << 8) - np.int64(packed[i]) - 1
        i += 1
        if back < 0 or o + length + 2 > len(whole):
            return -1

        for _ in range(length + 2):
            whole[o] = whole[back]
            o += 1
            back += 1

    return o
