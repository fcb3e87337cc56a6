"""Rerun's program as we start it: a log made compact holds the same, and what is no log stays as it
is.
"""

import socket
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from uuv.sim.reporting import rerun_program, rerun_stream


def values(file: Path) -> tuple[np.ndarray, int]:
    """Everything logged at `a`, in order of time, and the number of chunks that hold it."""
    chunks = [chunk for chunk in RrdReader(file).stream().to_chunks() if chunk.entity_path == "/a"]
    rows = [
        (time, number[0])
        for batch in (chunk.to_record_batch() for chunk in chunks)
        for time, number in zip(
            batch.column("t").to_pylist(), batch.column("Scalars:scalars").to_pylist(), strict=True
        )
    ]
    return np.array([number for _, number in sorted(rows)]), len(chunks)


def test_compact_log_holds_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(rerun_program, "_SMALL", 0)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    file = tmp_path / "run.rrd"
    stream = rr.RecordingStream("test")
    stream.save(str(file))
    for i in range(200):
        stream.set_time("t", sequence=i)
        stream.log("a", rr.Scalars(float(i * i)))
        stream.flush()
    stream.disconnect()
    before, many = values(file)
    assert rerun_program.compact(file)
    after, few = values(file)
    assert np.array_equal(before, np.arange(200.0) ** 2)
    assert np.array_equal(after, before)
    assert few < many
    assert not (tmp_path / "home").exists(), "Rerun wrote its usage settings"
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


@pytest.mark.parametrize("content", [b"no log" * 500, b""])
def test_what_cannot_be_made_compact_stays(tmp_path, monkeypatch, content):
    monkeypatch.setattr(rerun_program, "_SMALL", 0)
    file = tmp_path / "run.rrd"
    file.write_bytes(content)
    assert not rerun_program.compact(file)
    assert file.read_bytes() == content
    assert not rerun_program.compact(tmp_path / "none.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


class Spawned:
    """Stands for the module `rerun` where a viewer is to be started: keeps what it is told."""

    def __init__(self) -> None:
        self.told: dict[str, object] = {}

    def spawn(self, **told: object) -> None:
        self.told = told


def test_viewer_is_started_for_this_recording_and_waited_for(monkeypatch):
    """Without the recording, `rerun` starts nothing and says that it is disabled."""
    assert not rr.is_enabled()
    stream = rr.RecordingStream("test")
    fake = Spawned()
    with socket.create_server(("127.0.0.1", 0)) as viewer:
        monkeypatch.setattr(rerun_program, "PORT", viewer.getsockname()[1])
        assert rerun_program.spawn_viewer(fake, stream)
    assert fake.told["recording"] is stream
    assert Path(str(fake.told["executable_path"])).is_file()
    monkeypatch.setattr(rerun_program, "WAIT", 0.2)
    assert not rerun_program.spawn_viewer(fake, stream)


def test_log_is_whole_where_no_viewer_starts(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(rerun_program, "spawn_viewer", lambda *_: False)
    stream = rerun_stream.LogStream(tmp_path / "run.rrd", "a run", view=True)
    stream.event("a", rr.Scalars(1.0), 0.5)
    stream.close()
    assert f"open the log later by: rerun {tmp_path / 'run.rrd'}" in capsys.readouterr().err
    assert any(
        chunk.entity_path == "/a" for chunk in RrdReader(tmp_path / "run.rrd").stream().to_chunks()
    )
