"""Rows as Parquet: exact, typed, and whole for other readers at every moment."""

import importlib
import json
import math
import os
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuv.experiment import read_rows, row_table
from uuv.experiment.row_table import LAYOUT, Row, RowTable
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs import saving

NUMBERS = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(st.characters(), max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abcd"), inner, max_size=3)
    ),
    max_leaves=8,
)


def filled(folder: Path, rows: list[Row]) -> RowTable:
    table = RowTable(folder)
    for row in rows:
        table.extend([row])
    return table


def same(one: Any, other: Any) -> bool:
    """Equal in value, type and sign of zero."""
    if isinstance(one, dict):
        return (
            isinstance(other, dict)
            and [*one] == [*other]
            and all(same(one[key], other[key]) for key in one)
        )
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(same, one, other))
    return (
        type(one) is type(other)
        and one == other
        and (one != 0 or math.copysign(1, one) == math.copysign(1, other))
    )


@settings(max_examples=20, deadline=None)
@given(
    rows=st.lists(
        st.dictionaries(st.sampled_from("abcd"), VALUES, max_size=4), min_size=1, max_size=5
    )
)
def test_rows_come_back_as_they_were(tmp_path_factory, rows):
    """Missing and None, empty tables, whole and other numbers in one column, text that is no UTF-8,
    mixed lists.
    """
    folder = tmp_path_factory.mktemp("rows")
    filled(folder, rows)
    assert same(read_rows(folder), rows)
    assert same(RowTable(folder).rows, rows)


@settings(max_examples=20, deadline=None)
@given(
    rows=st.lists(
        st.dictionaries(st.sampled_from("abcd"), VALUES, max_size=4), min_size=1, max_size=5
    ),
    others=st.dictionaries(
        st.integers(0, 4),
        st.dictionaries(st.sampled_from("abcde"), VALUES, max_size=4),
        min_size=1,
        max_size=3,
    ),
)
def test_rows_take_the_places_of_others(tmp_path_factory, rows, others):
    """In files that are full, and in the last one."""
    others = {at % len(rows): other for at, other in others.items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(row_table, "CHUNK", 2)
        folder = tmp_path_factory.mktemp("rows")
        table = filled(folder, rows)
        table.replace(others)
        table.extend([{"a": 1}])
        expected = [*(others.get(at, row) for at, row in enumerate(rows)), {"a": 1}]
        assert same(read_rows(folder), expected)
        assert same(RowTable(folder).rows, expected)


@settings(max_examples=20, deadline=None)
@given(sizes=st.lists(st.integers(0, 7), min_size=1, max_size=4))
def test_rows_come_in_any_number_at_a_time(tmp_path_factory, sizes):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(row_table, "CHUNK", 3)
        folder = tmp_path_factory.mktemp("rows")
        table = RowTable(folder)
        rows = []
        for size in sizes:
            more = [
                {"run": len(rows) + i, **({"rare": 1.0} if i == 2 else {})} for i in range(size)
            ]
            table.extend(more)
            rows += more
        assert same(read_rows(folder), rows)
        full = [len(pq.read_table(file)) for file in sorted((folder / "rows").glob("*.parquet"))]
        assert all(count == 3 for count in full[:-1])


def test_columns_are_typed_and_named_by_dots(tmp_path):
    rows = [
        {
            "run": 0,
            "class": "kept",
            "figures": {"rms": 1, "lost": None},
            "at": [1.0, None],
            "odd": 1,
        },
        {"run": 1, "class": "kept", "figures": {"rms": 0.1, "ok": True}, "at": [], "odd": "x"},
    ]
    filled(tmp_path, rows)
    table = pq.read_table(tmp_path / "rows")
    types = {field.name: field.type for field in table.schema if field.name != LAYOUT}
    assert types == {
        "run": pa.int64(),
        "class": pa.string(),
        "figures.rms": pa.float64(),
        "figures.lost": pa.null(),
        "figures.ok": pa.bool_(),
        "at": pa.list_(pa.float64()),
        "odd": pa.string(),
    }
    assert table["figures.rms"].to_pylist() == [1.0, 0.1]
    assert [json.loads(text) for text in table["odd"].to_pylist()] == [1, "x"]


def test_files_hold_a_number_of_rows_each_and_share_their_columns(tmp_path, monkeypatch):
    monkeypatch.setattr(row_table, "CHUNK", 3)
    rows: list[Row] = [{"run": run, "value": float(run)} for run in range(7)]
    table = filled(tmp_path, rows)
    table.extend([{"run": 7, "detail": "late"}])
    files = sorted((tmp_path / "rows").iterdir())
    assert [pq.read_metadata(file).num_rows for file in files] == [3, 3, 2]
    assert len({tuple(pq.read_schema(file).names) for file in files}) == 1
    assert read_rows(tmp_path) == [*rows, {"run": 7, "detail": "late"}]
    RowTable(tmp_path).extend([{"run": 8}])
    assert len(read_rows(tmp_path)) == 9


@pytest.mark.parametrize(
    "change", [{"detail": "late"}, {"value": "text"}], ids=["a column", "a wider type"]
)
def test_readers_find_whole_rows_after_every_single_write(tmp_path, monkeypatch, change):
    """A kill between any two writes of a change of columns: nothing is lost or doubled, and it is
    mended later.
    """
    monkeypatch.setattr(row_table, "CHUNK", 2)
    rows: list[Row] = [{"run": run, "value": run} for run in range(5)]
    for allowed in range(5):
        folder = tmp_path / str(allowed)
        folder.mkdir()
        table = filled(folder, rows)
        left = allowed
        write = row_table.write_whole

        def killed(file: Path, content: bytes, *, part_in: Path, write: Any = write) -> None:
            nonlocal left
            if not left:
                raise KeyboardInterrupt
            left -= 1
            write(file, content, part_in=part_in)

        with monkeypatch.context() as patched:
            patched.setattr(row_table, "write_whole", killed)
            try:
                table.extend([{"run": 5, **change}])
            except KeyboardInterrupt:
                assert allowed < 4
        assert (
            pq.read_table(folder / "rows")["run"].to_pylist()
            == [0, 1, 2, 3, 4, 5][: 5 + (allowed == 4)]
        )
        again = RowTable(folder)
        assert again.rows[:5] == rows
        assert len(again.rows) == 5 + (allowed == 4)
        assert len({pq.read_schema(file) for file in (folder / "rows").iterdir()}) == 1


def test_two_values_of_one_name_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match=r"names of values must differ, got 'a\.b'"):
        filled(tmp_path, [{"a.b": 1, "a": {"b": 2}}])


def test_another_version_of_the_schema_is_refused(tmp_path, monkeypatch):
    filled(tmp_path, [{"run": 0}])
    monkeypatch.setattr(row_table, "SCHEMA_VERSION", 2)
    with pytest.raises(
        ConfigurationError,
        match=r"000000.parquet: schema version must be 2, got 1; "
        r"discard the rows by --anew",
    ):
        RowTable(tmp_path)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="writes to /dev/full")
def test_a_full_disk_costs_the_row_at_hand_only(tmp_path, monkeypatch):
    table = filled(tmp_path, [{"run": 0}])
    message = r"000000.parquet: cannot be written \(No space left on device\)"
    with monkeypatch.context() as full:
        full.setattr(saving, "_not_through_a_link", lambda *_: os.open("/dev/full", os.O_WRONLY))
        with pytest.raises(ConfigurationError, match=message):
            table.extend([{"run": 1, "new": 1.0}])
    assert read_rows(tmp_path) == [{"run": 0}]
    table.extend([{"run": 1, "new": 1.0}])
    assert read_rows(tmp_path) == [{"run": 0}, {"run": 1, "new": 1.0}]


@pytest.mark.parametrize("reader", ["pandas", "polars", "duckdb"])
def test_others_read_it(tmp_path, reader, monkeypatch):
    module = pytest.importorskip(reader)
    monkeypatch.setattr(row_table, "CHUNK", 2)
    filled(tmp_path, [{"run": run, "figures": {"rms": run / 10, "none": None}} for run in range(5)])
    if reader == "duckdb":
        table = module.sql(
            f"select \"figures.rms\" from '{tmp_path}/rows/*.parquet' order by run"
        ).fetchall()
        figures = [row[0] for row in table]
    else:
        figures = list(
            importlib.import_module(reader).read_parquet(tmp_path / "rows")["figures.rms"]
        )
    assert figures == [run / 10 for run in range(5)]
