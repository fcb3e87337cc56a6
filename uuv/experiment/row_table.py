"""Rows of a study as Parquet files with typed columns and dotted names, complete at any time."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.runs.saving import write_whole

Row = dict[str, Any]  # result of one case, of JSON types

SCHEMA_VERSION = 1  # version of the files; other versions are refused
ROWS = "rows"  # name of the folder of the files
# name of a column: the nesting of the row, in JSON, with a letter for each value (`_leaf`)
LAYOUT = "_layout"
CHUNK = 256  # number of rows in a file
_MOST_BYTES = 64_000_000  # largest size of a file, and of its unpacked content
# keys of the metadata of a file, and of a column
_VERSION_KEY = b"uuv_arm.schema_version"
_JSON = {b"uuv_arm.encoding": b"json"}
_EXACT = 2**53  # largest whole number up to which all are exact in a double


class RowTable:
    """Table of rows in the folder `rows`: one file for each 256 rows, in the order in which the
    rows were added.

    A value that is nested in tables has a column with a dotted name: `figures.force_rms_n`. Columns
    are boolean, int64, double, text, lists of these, or JSON as text where the values are of
    several types. A new row replaces the last file by a longer one, atomically; a new column, or a
    column of a wider type, replaces the files one by one from the first. A reader therefore finds
    complete rows, none of them twice, at any time.
    """

    def __init__(self, folder: Path) -> None:
        """Read the existing rows.

        Args:
            folder: Folder of the study; `rows` in it is created with the first row.

        Raises:
            ConfigurationError: A file cannot be read, or has another version.
        """
        self._home = folder / ROWS
        self.rows: list[Row] = []
        self._kinds: dict[str, pa.DataType | None] = {}  # type of each column; None: JSON as text
        self._last = pa.table({})  # content of the last file if it is not full

        uneven = False
        for file in _files(self._home):
            table = _read(file)
            self.rows += _decoded(table, file)

            kinds = _kinds_of(table.schema)
            uneven |= bool(self._kinds) and kinds != self._kinds
            for name, kind in kinds.items():
                self._kinds[name] = _wider(self._kinds[name], kind) if name in self._kinds else kind
            self._last = table

        if uneven:  # a kill between two files of a change of columns
            self._write_all()

        if len(self.rows) % CHUNK == 0:
            self._last = pa.table({})

    def extend(self, rows: Sequence[Row]) -> None:
        """Add rows. They are on disk when this returns, and each file is written once.

        Raises:
            ConfigurationError: A file cannot be written, or two values of a row have the same name.
        """
        self._widen(rows)
        for start in range(0, len(rows), CHUNK):
            self._append(rows[start : start + CHUNK])

    def replace(self, rows: Mapping[int, Row]) -> None:
        """Replace the rows whose numbers are the keys of `rows`, writing each file once.

        The new rows are on disk when this returns. The exceptions are those of `extend`.
        """
        self._widen([*rows.values()])
        files: dict[int, dict[int, Row]] = {}
        for at, row in rows.items():
            files.setdefault(at // CHUNK, {})[at] = row

        for number, changed in sorted(files.items()):
            numbers = range(number * CHUNK, min((number + 1) * CHUNK, len(self.rows)))
            table = self._table([changed.get(at, self.rows[at]) for at in numbers])
            self._write(number, table)
            for at, row in changed.items():
                self.rows[at] = row
            if table.num_rows < CHUNK:
                self._last = table

    def _widen(self, rows: Sequence[Row]) -> None:
        """Make the columns wide enough for new rows, also in existing files."""
        kinds = dict(self._kinds)
        for row in rows:
            for name, entry in _flat(row):
                kinds[name] = _wider(kinds[name], _kind(entry)) if name in kinds else _kind(entry)

        if kinds == self._kinds:
            return

        before = self._kinds
        self._kinds = kinds
        try:
            self._write_all()
        except ConfigurationError:
            self._kinds = before
            raise

    def _append(self, rows: Sequence[Row]) -> None:
        """Add at most CHUNK rows, to the file that is not full and to a new one."""
        room = CHUNK - len(self.rows) % CHUNK
        for part in (rows[:room], rows[room:]):
            if not part:
                continue

            last = self._table(part)
            if self._last.num_rows:
                last = pa.concat_tables([self._last, last]).combine_chunks()

            self._write(len(self.rows) // CHUNK, last)
            self.rows += part
            self._last = last if last.num_rows < CHUNK else pa.table({})

    def _write_all(self) -> None:
        """Write all files again with the present columns, beginning with the first, which pandas
        reads.
        """
        for number in range(-(-len(self.rows) // CHUNK)):
            self._last = self._table(self.rows[number * CHUNK : (number + 1) * CHUNK])
            self._write(number, self._last)
        if len(self.rows) % CHUNK == 0:
            self._last = pa.table({})

    def _write(self, number: int, table: pa.Table) -> None:
        if self._home.is_symlink():
            raise ConfigurationError(
                f"{self._home}: must be a folder, got a link; the rows would be written to the "
                "target of the link"
            )
        try:
            self._home.mkdir(exist_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f"{self._home}: the folder cannot be created ({error.strerror})"
            ) from error

        content = pa.BufferOutputStream()
        pq.write_table(table, content, compression="zstd")
        write_whole(
            self._home / f"{number:06d}.parquet",
            content.getvalue().to_pybytes(),
            part_in=self._home.parent,
        )

    def _table(self, rows: Iterable[Row]) -> pa.Table:
        flat = [dict(_flat(row)) for row in rows]
        fields, columns = [], []

        for name, kind in self._kinds.items():
            cells = [row.get(name) for row in flat]
            if kind is None:
                cells = [json.dumps(row[name]) if name in row else None for row in flat]
            fields.append(pa.field(name, kind or pa.string(), metadata=None if kind else _JSON))
            columns.append(pa.array(cells, fields[-1].type))

        return pa.table(columns, pa.schema(fields, {_VERSION_KEY: str(SCHEMA_VERSION).encode()}))


def read_rows(folder: str | Path) -> list[Row]:
    """Rows of a study or campaign, nested as they were made; to get tables, read `rows` with
    pandas.

    Args:
        folder: Folder of the study.

    Raises:
        ConfigurationError: A file cannot be read, or has another version.
    """
    return [row for file in _files(Path(folder) / ROWS) for row in _rows_of(file)]


def delete_rows(folder: Path) -> None:
    """Delete the files of a `RowTable` in `folder`, the last one first."""
    for file in reversed(_files(folder / ROWS)):
        file.unlink()


def has_rows(folder: Path) -> bool:
    """True if there is a file of a `RowTable` in `folder`."""
    return bool(_files(folder / ROWS))


def _files(home: Path) -> list[Path]:
    return sorted(home.glob("*.parquet"))


def _read(file: Path) -> pa.Table:
    raw = bytes_of(file, "rows", _MOST_BYTES)
    try:
        stored = pq.ParquetFile(pa.BufferReader(raw))
        metadata = stored.metadata
        unpacked = sum(
            metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups)
        )

        if metadata.num_rows > CHUNK or unpacked > _MOST_BYTES:
            raise ConfigurationError(
                f"{file}: has more than {CHUNK} rows or {_MOST_BYTES} bytes; remove it"
            )
        table = stored.read()
    except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
        if isinstance(error, ConfigurationError):
            raise
        message = (str(error).splitlines() or [""])[0]
        raise ConfigurationError(
            f"{file}: is not a complete Parquet file ({message}); repair or remove it"
        ) from error

    version = (table.schema.metadata or {}).get(_VERSION_KEY, b"none").decode()
    if version != str(SCHEMA_VERSION):
        raise ConfigurationError(
            f"{file}: schema version must be {SCHEMA_VERSION}, got {version}; discard the rows by "
            "--anew, or give another --out"
        )

    return table


def _kinds_of(schema: pa.Schema) -> dict[str, pa.DataType | None]:
    return {field.name: None if field.metadata == _JSON else field.type for field in schema}


# -- one row ---------------------------------------------------------------------------------------


def _flat(row: Row) -> Iterator[tuple[str, Any]]:
    """Name and value of each column of a row, with its layout as the last column."""
    columns: dict[str, Any] = {}
    layout = _laid_out(row, "", columns)
    yield from columns.items()
    yield LAYOUT, json.dumps(layout, separators=(",", ":"))


def _laid_out(value: Any, name: str, columns: dict[str, Any]) -> Any:
    """Layout of `value`, whose columns are added to `columns`."""
    if isinstance(value, Mapping):
        return {
            key: _laid_out(entry, f"{name}.{key}" if name else key, columns)
            for key, entry in value.items()
        }
    if name in columns or name == LAYOUT:
        raise ConfigurationError(f"row: names of values must differ, got {name!r} twice")
    columns[name] = value
    return _leaf(value)


def _leaf(value: Any) -> str:
    """Letter for the type of a value if the column does not imply it: i whole number, f float, n
    None; else empty.
    """
    if value is None:
        return "n"
    if isinstance(value, list):
        letters = {_leaf(entry) for entry in value} - {"n"}
        return letters.pop() if len(letters) == 1 else ""
    return "i" if type(value) is int else "f" if isinstance(value, float) else ""


def _rows_of(file: Path) -> list[Row]:
    return _decoded(_read(file), file)


def _decoded(table: pa.Table, file: Path) -> list[Row]:
    """Rows of a table, which was read from `file`."""
    try:
        return _nested_rows(table)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigurationError(
            f"{file}: is not a table of rows ({error}); repair or remove it"
        ) from error


def _nested_rows(table: pa.Table) -> list[Row]:
    columns: dict[str, list[Any]] = {name: table[name].to_pylist() for name in table.schema.names}
    for name, kind in _kinds_of(table.schema).items():
        if kind is None:
            columns[name] = [None if text is None else json.loads(text) for text in columns[name]]

    layouts = columns.pop(LAYOUT)
    rows = [{name: values[i] for name, values in columns.items()} for i in range(table.num_rows)]
    return [_nested(json.loads(layout), "", row) for layout, row in zip(layouts, rows, strict=True)]


def _nested(layout: Any, name: str, values: Row) -> Any:
    if isinstance(layout, dict):
        return {
            key: _nested(inner, f"{name}.{key}" if name else key, values)
            for key, inner in layout.items()
        }
    return _as_laid_out(values[name], {"i": int, "f": float}.get(layout))


def _as_laid_out(value: Any, kind: type | None) -> Any:
    if kind is None or value is None:
        return value
    return (
        [_as_laid_out(entry, kind) for entry in value] if isinstance(value, list) else kind(value)
    )


# -- types of columns ------------------------------------------------------------------------------


def _kind(value: Any) -> pa.DataType | None:
    """Type of a column for `value`; None: JSON as text."""
    if isinstance(value, list):
        kind: pa.DataType | None = pa.null()
        for entry in value:
            kind = _wider(kind, None if isinstance(entry, list | Mapping) else _kind(entry))

        # the layout has only one letter for a list
        mixed = len({type(entry) for entry in value} - {type(None)}) > 1
        return None if kind is None or mixed else pa.list_(kind)
    if isinstance(value, bool):
        return pa.bool_()
    if isinstance(value, int):
        return pa.int64() if abs(value) <= _EXACT else None
    if isinstance(value, float):
        return pa.float64()
    if isinstance(value, str):
        return pa.string() if _is_utf8(value) else None
    return pa.null() if value is None else None


def _is_utf8(value: str) -> bool:
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def _wider(first: pa.DataType | None, second: pa.DataType | None) -> pa.DataType | None:
    """Type that can hold the values of both types exactly."""
    if first == second or first is None or second is None:
        return first if first == second else None
    if pa.types.is_null(first) or pa.types.is_null(second):
        return second if pa.types.is_null(first) else first
    if pa.types.is_list(first) and pa.types.is_list(second):
        inner = _wider(first.value_type, second.value_type)
        return None if inner is None else pa.list_(inner)
    if {first, second} == {pa.int64(), pa.float64()}:
        return pa.float64()
    return None
