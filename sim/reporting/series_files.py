"""Files of tables of series: Parquet, or .npz without pyarrow. Files from others are checked.

A column has a name, values, a unit, and the series that it is part of.
"""

import io
import json
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.interfaces.documents import checked, parsed_json
from uuv.sim.interfaces.errors import ConfigurationError, commands_a_terminal
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.interfaces.spatial import shown
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.runs.saving import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

ENDINGS = (".parquet", ".npz")
MOST_NUMBERS = 40_000_000  # of a run: half an hour at the loop's rate is 37 million
# of the content of a file; a file is packed to less than half of that
_MOST_BYTES = 8 * MOST_NUMBERS
_ABOUT = "about"  # entry of an .npz file: unit and series of each column, in JSON
_LONGEST_NAME = 200  # [characters] of a column
# Encodings that `write_table` uses. Others unfold without bound: a word stored once is a million
# words in memory.
_ENCODINGS = {"PLAIN", "RLE", "BYTE_STREAM_SPLIT"}
# What NumPy and zipfile raise at a file that is cut or forged.
_BROKEN = (
    OSError,
    ValueError,
    KeyError,
    EOFError,
    MemoryError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)


@dataclass(frozen=True, slots=True)
class About:
    """What is stored beside the values of a column."""

    unit: str = ""
    series: str = ""  # that it is part of


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """Column of a table: values (N,), their unit, and the series that they are part of."""

    name: str
    values: np.ndarray
    unit: str = ""
    series: str = ""

    @property
    def label(self) -> str:
        """Name within its series; empty for a series of one column."""
        return self.name.removeprefix(self.series).removeprefix(".")

    @property
    def about(self) -> dict[str, str]:
        """What is stored beside the values."""
        return {"unit": self.unit, "series": self.series}


def write_table(file: Path, columns: Sequence[Column]) -> None:
    """Writes a table to `file`, whose ending follows from the format."""
    content = io.BytesIO()
    if find_spec("pyarrow") is None:
        stored: dict[str, Any] = {column.name: column.values for column in columns}
        stored[_ABOUT] = np.array(json.dumps({column.name: column.about for column in columns}))
        np.savez_compressed(content, **stored)
        write_whole(file.with_suffix(".npz"), content.getvalue())
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = []
    arrays = []
    for column in columns:
        arrays.append(pa.array(column.values))
        about = {key.encode(): entry.encode() for key, entry in column.about.items()}
        fields.append(pa.field(column.name, arrays[-1].type, metadata=about))

    pq.write_table(
        pa.table(arrays, schema=pa.schema(fields)),
        content,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
        column_encoding={
            column.name: "BYTE_STREAM_SPLIT"
            for column in columns
            if np.issubdtype(column.values.dtype, np.floating)
        },
    )

    write_whole(file.with_suffix(".parquet"), content.getvalue())


def read_table(file: Path) -> dict[str, Column]:
    """Columns of a table by name: numbers or texts, all of one length.

    Raises:
        ConfigurationError: The file is none that `write_table` makes, is cut, or has more than
            `MOST_NUMBERS` values.
        MissingLibraryError: It is a Parquet file, and the package pyarrow is not installed.
    """
    subject = f"series {shown(str(file))}"
    columns = (
        _from_npz(file, subject) if file.suffix == ".npz" else _from_parquet(arrow_table(file))
    )
    lengths = {column.values.shape for column in columns}
    if len(lengths) != 1 or len(next(iter(lengths))) != 1 or not next(iter(lengths))[0]:
        raise ConfigurationError(f"{subject}: its columns must have one length, at least 1")

    for column in columns:
        named = column.name + column.series
        if len(named) > 2 * _LONGEST_NAME or commands_a_terminal(named):
            raise ConfigurationError(f"{subject}: {shown(column.name)} is no name of a column")
        if len(column.unit) > 20 or commands_a_terminal(column.unit):
            raise ConfigurationError(f"{subject}: {shown(column.unit)} is no unit")

        if column.values.dtype.kind == "O":  # of Arrow: texts, or numbers with gaps
            if not all(isinstance(word, str) for word in column.values):
                raise ConfigurationError(
                    f"{subject}: {shown(column.name)} is neither numbers nor texts"
                )
            checked(column.values.tolist(), column.name)
        elif column.values.dtype.kind not in "bifuU":
            raise ConfigurationError(
                f"{subject}: {shown(column.name)} is neither numbers nor texts"
            )

    return {column.name: column for column in columns}


def arrow_table(file: Path) -> "pa.Table":
    """The table in a Parquet file.

    Raises:
        ConfigurationError: As for `read_table`.
        MissingLibraryError: The package pyarrow is not installed.
    """
    with wanted():
        import pyarrow as pa
        import pyarrow.parquet as pq
    subject = f"series {shown(str(file))}"
    raw = bytes_of(file, "series", _MOST_BYTES // 2)
    try:
        stored = pq.ParquetFile(pa.BufferReader(raw), page_checksum_verification=True)
        metadata = stored.metadata
        parts = [
            metadata.row_group(i).column(k)
            for i in range(metadata.num_row_groups)
            for k in range(metadata.num_columns)
        ]

        # What it takes in memory, checked before it is read.
        unpacked = sum(part.total_uncompressed_size for part in parts)
        if metadata.num_rows * metadata.num_columns > MOST_NUMBERS or unpacked > _MOST_BYTES:
            raise ConfigurationError(f"{subject}: more than {MOST_NUMBERS} values")
        if any(
            part.has_dictionary_page or not _ENCODINGS.issuperset(part.encodings) for part in parts
        ):
            raise ConfigurationError(f"{subject}: encoded differently from the files of a run")

        table = stored.read()
    except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
        if isinstance(error, ConfigurationError):
            raise
        raise ConfigurationError(f"{subject}: is not a complete Parquet file") from error

    if len(set(table.schema.names)) < len(table.schema.names):
        raise ConfigurationError(f"{subject}: two columns have one name")
    return table


def _from_parquet(table: "pa.Table") -> list[Column]:
    columns = []
    for field in table.schema:
        metadata = field.metadata or {}
        about = {
            key: metadata.get(key.encode(), b"").decode(errors="replace")
            for key in ("unit", "series")
        }
        columns.append(Column(field.name, table[field.name].to_numpy(), **about))

    return columns


def _from_npz(file: Path, what: str) -> list[Column]:
    raw = io.BytesIO(bytes_of(file, "series", _MOST_BYTES // 2))
    try:
        with zipfile.ZipFile(raw) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > _MOST_BYTES:
                raise ConfigurationError(f"{what}: more than {MOST_NUMBERS} values")

        with np.load(raw) as stored:  # which unpickles nothing
            about = parsed_json(str(stored[_ABOUT]), f"{what}: about")
            names = TableReader("about").made(_Abouts, {"columns": about}).columns
            return [
                Column(name, stored[name], field.unit, field.series)
                for name, field in names.items()
            ]
    except (*_BROKEN, RecursionError) as error:
        if isinstance(error, ConfigurationError):
            raise
        raise ConfigurationError(f"{what}: is not a complete .npz file of a run") from error


@dataclass(frozen=True, slots=True)
class _Abouts:
    """What is stored beside the columns of an .npz file, by name."""

    columns: Mapping[str, About]
