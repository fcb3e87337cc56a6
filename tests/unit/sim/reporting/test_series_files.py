"""Tables of series that are cut, forged or too large are refused in one line, and nothing is
unpacked without bound.
"""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.reporting import series_files
from uuv.sim.reporting.series_files import Column, read_table, write_table


def columns() -> list[Column]:
    time = np.linspace(0.0, 1.0, 101)
    return [Column("time", time, "s"), Column("p.x", 0.5 + np.sin(time), "m", "p")]


def refused(file: Path, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said) as error:
        read_table(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("change", ["cut", "empty", "text", "bit"])
def test_a_damaged_parquet_file(change: str, tmp_path: Path):
    write_table(tmp_path / "t", columns())
    file = tmp_path / "t.parquet"
    whole = file.read_bytes()
    flipped = whole[:200] + bytes([whole[200] ^ 1]) + whole[201:]
    file.write_bytes(
        {"cut": whole[: len(whole) // 2], "empty": b"", "text": b"hello", "bit": flipped}[change]
    )
    refused(file, "the file is empty" if change == "empty" else "is not a complete Parquet file")


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"time": [[1.0], [2.0]]}, "'time' is neither numbers nor texts"),
        ({"time": [1.0, None], "a": ["x", None]}, "'a' is neither numbers nor texts"),
        ({"time": pa.array([], pa.float64())}, "must have one length, at least 1"),
        ({"\x1b[2J": [1.0]}, "is no name of a column"),
        ({"note": ["\x07"]}, "a control character"),
    ],
)
def test_columns_that_no_run_writes(table: dict[str, Any], said: str, tmp_path: Path):
    pq.write_table(pa.table(table), tmp_path / "t.parquet", use_dictionary=False)
    refused(tmp_path / "t.parquet", said)


def test_a_word_stored_once_is_not_unfolded(tmp_path: Path):
    """A dictionary of one long text and many rows is a small file, and many gigabytes in memory."""
    pq.write_table(
        pa.table({"note": ["x" * 100_000] * 1000}), tmp_path / "t.parquet", use_dictionary=True
    )
    assert (tmp_path / "t.parquet").stat().st_size < 100_000
    refused(tmp_path / "t.parquet", "encoded differently from the files of a run")


def test_too_many_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(series_files, "MOST_NUMBERS", 201)
    write_table(tmp_path / "t", columns())
    refused(tmp_path / "t.parquet", "more than 201 values")


def archive(**entries: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive_file:
        for name, entry in entries.items():
            archive_file.writestr(f"{name}.npy", entry)
    return content.getvalue()


def stored(array: Any) -> bytes:
    content = io.BytesIO()
    np.save(content, array, allow_pickle=True)
    return content.getvalue()


ABOUT = {"time": {"unit": "s", "series": ""}}


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (b"PK\x03\x04junk", "is not a complete .npz file"),
        (archive(about=stored(np.array([{}], dtype=object))), "is not a complete .npz file"),
        (archive(time=stored(np.zeros(3))), "is not a complete .npz file"),
        (archive(about=stored("5")), "columns: must be a table, got 5"),
        (
            archive(about=stored(json.dumps({"time": {"unit": 5}}))),
            "columns.time.unit: must be text",
        ),
        (archive(about=stored(json.dumps(ABOUT))), "is not a complete .npz file"),
        (
            archive(about=stored(json.dumps(ABOUT)), time=stored(np.zeros((2, 2)))),
            "must have one length",
        ),
        (
            archive(about=stored(json.dumps(ABOUT)), time=stored(np.zeros(3))[:-8]),
            "is not a complete .npz file",
        ),
    ],
)
def test_a_damaged_npz_file(raw: bytes, said: str, tmp_path: Path):
    (tmp_path / "t.npz").write_bytes(raw)
    refused(tmp_path / "t.npz", said)


def test_an_archive_is_not_unpacked_beyond_its_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(series_files, "_MOST_BYTES", 100_000)
    raw = archive(about=stored(json.dumps(ABOUT)), time=stored(np.zeros(50_000)))
    assert len(raw) < 10_000
    (tmp_path / "t.npz").write_bytes(raw)
    refused(tmp_path / "t.npz", "more than .* values")
