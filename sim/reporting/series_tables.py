"""Series and events of a run as tables in its folder, one for each rate, with units.

`write_series` leaves them beside the log, as Parquet, or as .npz without the package pyarrow; `PastRun` reads them
back, and everything else of a run's folder.
"""

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.extras import wanted
from sim.interfaces.messages import AbortCode, WorkState

if TYPE_CHECKING:  # the figures of a run are read without the kernels of what recorded it
    import pyarrow as pa

    from sim.evaluation.metrics import Assessment
    from sim.loop.recording import RecordedSeries, Recording, Series

LOOP, SLOW, POSES, EVENTS = "loop", "slow", "poses", "events"
LATE = "_late"  # after the name of a table whose series begin later than those of another of its rate
_FILE = "series_"  # before the name of a table of series
_NAMES = {"body_pose": POSES, "contact_normal": LOOP}  # series whose rate names a table; the other rate is SLOW
_ABOUT = "about"  # entry of an .npz file: unit and series of each column, in JSON


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


def write_series(recording: "Recording", folder: Path) -> None:
    """Writes the table of each rate of the recording, and that of the events, to `folder`.

    Columns are `time` [s] and NAME or NAME.LABEL, such as p_WB.x.
    """
    for name, columns in _tables(recording).items():
        _write(folder / f"{_FILE}{name}", columns)
    events = recording.events
    texts = {
        "state": [str(event.state) for event in events],
        "abort": ["" if event.abort is None else str(event.abort) for event in events],
        "note": [event.note for event in events],
    }
    times = Column("time", np.array([event.time for event in events]), "s")
    _write(folder / EVENTS, [times, *(Column(name, np.array(words, dtype=np.str_)) for name, words in texts.items())])


def _tables(recording: "Recording") -> dict[str, list[Column]]:
    """Columns of the table of each rate; series of the same times share a table."""
    by_time: dict[tuple[int, float], list[tuple[str, Series]]] = {}
    for name, series in recording.series.items():
        if len(series.time):
            by_time.setdefault((len(series.time), float(series.time[0])), []).append((name, series))
    made: dict[str, list[Column]] = {}
    for group in by_time.values():
        title = next((_NAMES[name] for name, _ in group if name in _NAMES), SLOW)
        while title in made:  # series that begin later, such as an estimate after the tare
            title += LATE
        made[title] = [Column("time", group[0][1].time, "s")]
        for name, series in group:
            labels = series.labels
            if name == "body_pose":
                labels = tuple(
                    f"{body}.{part}" for body in series.labels for part in ("x", "y", "z", "qw", "qx", "qy", "qz")
                )
            width = series.value.shape[1]
            if len(labels) != width:
                labels = tuple(map(str, range(width))) if width > 1 else ()
            words = [f"{name}.{label}" for label in labels] or [name]
            made[title] += [Column(word, series.value[:, i], series.unit, name) for i, word in enumerate(words)]
    return made


def _write(file: Path, columns: Sequence[Column]) -> None:
    """Writes a table to `file`, whose ending follows from the format."""
    if find_spec("pyarrow") is None:
        stored: dict[str, Any] = {column.name: column.values for column in columns}
        stored[_ABOUT] = np.array(json.dumps({column.name: column.about for column in columns}))
        np.savez_compressed(file.with_suffix(".npz"), **stored)
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields, arrays = [], []
    for column in columns:
        arrays.append(pa.array(column.values))
        about = {key.encode(): value.encode() for key, value in column.about.items()}
        fields.append(pa.field(column.name, arrays[-1].type, metadata=about))
    pq.write_table(
        pa.table(arrays, schema=pa.schema(fields)),
        file.with_suffix(".parquet"),
        compression="zstd",
        use_dictionary=False,
        column_encoding={
            column.name: "BYTE_STREAM_SPLIT" for column in columns if np.issubdtype(column.values.dtype, np.floating)
        },
    )


def _read(file: Path) -> dict[str, Column]:
    """Columns of a table by name."""
    if file.suffix == ".npz":
        with np.load(file) as stored:
            about = json.loads(str(stored[_ABOUT]))
            return {name: Column(name, stored[name], **about[name]) for name in about}
    with wanted():
        import pyarrow.parquet as pq
    table = pq.read_table(file)
    return {
        field.name: Column(
            field.name,
            table[field.name].to_numpy(),
            **{key: (field.metadata or {}).get(key.encode(), b"").decode() for key in ("unit", "series")},
        )
        for field in table.schema
    }


@dataclass(frozen=True, slots=False)
class PastRun:
    """A run in its folder: figures, scenario, series and events; a notebook shows it as a card."""

    folder: Path
    _kept: dict[str, dict[str, Column]] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, folder: str | Path) -> "PastRun":
        """The run in `folder`.

        Raises:
            ConfigurationError: There is none.
        """
        if not (Path(folder) / "metrics.json").exists():
            raise ConfigurationError(f"{folder}: no run, a folder with metrics.json")
        return cls(Path(folder))

    @cached_property
    def metrics(self) -> Mapping[str, Any]:
        """Content of metrics.json."""
        try:
            return json.loads((self.folder / "metrics.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{self.folder}/metrics.json: cannot be read ({error})") from error

    @property
    def rates(self) -> tuple[str, ...]:
        """Names of the tables of series: LOOP at the loop's rate, SLOW at 50 Hz, POSES of all bodies at 25 Hz.

        Series that begin later, such as an estimate of the controller after the tare, have a table with LATE.
        """
        files = [file for ending in (".parquet", ".npz") for file in self.folder.glob(f"{_FILE}*{ending}")]
        return tuple(sorted({file.stem.removeprefix(_FILE) for file in files}))

    def table(self, rate: str = LOOP) -> "pa.Table":
        """Series of one rate, or EVENTS; `.to_pandas()` makes a data frame of it, where pandas is installed.

        Raises:
            ConfigurationError: There is no such table.
            MissingLibraryError: The package pyarrow is not installed.
        """
        with wanted():
            import pyarrow as pa
            import pyarrow.parquet as pq
        file = self._file(rate)
        if file.suffix == ".parquet":
            return pq.read_table(file)
        return pa.table({name: column.values for name, column in _read(file).items()})

    def column(self, name: str, rate: str = LOOP) -> np.ndarray:
        """Values (N,) of one column; `time` is one too.

        Raises:
            ConfigurationError: There is no such column; the message lists those that there are.
        """
        columns = self._columns(rate)
        if name not in columns:
            raise ConfigurationError(f"no column {name!r}; there are {', '.join(columns)}")
        return columns[name].values

    def units(self, rate: str = LOOP) -> dict[str, str]:
        """Unit of each column."""
        return {name: column.unit for name, column in self._columns(rate).items()}

    @cached_property
    def recorded(self) -> "RecordedSeries":
        """All series and events, as functions of `sim.evaluation` take them.

        Raises:
            ConfigurationError: The run was made with --no-record, or its tables do not tell the series of a column.
        """
        from sim.loop.recording import Event, RecordedSeries, Series

        series: dict[str, Series] = {}
        for rate in self.rates or (LOOP,):
            columns = self._columns(rate)
            time = columns["time"].values
            parts: dict[str, list[Column]] = {}
            for column in columns.values():
                if column.series:
                    parts.setdefault(column.series, []).append(column)
            for name, group in parts.items():
                labels = tuple(column.label for column in group) if group[0].label else ()
                value = np.column_stack([column.values for column in group])
                series[name] = Series(time=time, value=value, unit=group[0].unit, labels=labels)
        if not series:
            raise ConfigurationError(f"{self.folder}: its tables are of another version")
        said = {name: column.values for name, column in self._columns(EVENTS).items()}
        events = [
            Event(time=float(time), state=WorkState(state), note=str(note), abort=AbortCode(abort) if abort else None)
            for time, state, note, abort in zip(said["time"], said["state"], said["note"], said["abort"], strict=True)
        ]
        return RecordedSeries(duration=float(self.metrics["run"]["simulated_s"]), series=series, events=tuple(events))

    def _columns(self, rate: str) -> dict[str, Column]:
        if rate not in self._kept:
            self._kept[rate] = _read(self._file(rate))
        return self._kept[rate]

    def _file(self, rate: str) -> Path:
        stem = EVENTS if rate == EVENTS else f"{_FILE}{rate}"
        for ending in (".parquet", ".npz"):
            if (file := self.folder / f"{stem}{ending}").exists():
                return file
        known = ", ".join((*self.rates, EVENTS)) if self.rates else "none: it was run with --no-record"
        raise ConfigurationError(f"{self.folder}: no series {rate!r}; there are {known}")

    def _repr_html_(self) -> str:
        """Card for a notebook."""
        run, contact, tool, path = (self.metrics.get(name, {}) for name in ("run", "contact", "tool", "path"))
        rows = [("ended", str(run["state"]), ""), ("simulated", f"{run['simulated_s']:.0f}", "s")]
        for title, value, scale, unit in (
            ("force error, RMS", contact.get("force_error_rms_n"), 1.0, "N"),
            ("force error, peak", contact.get("force_error_max_n"), 1.0, "N"),
            ("path deviation, peak", tool.get("path_deviation_max_m"), 1e3, "mm"),
            ("true path deviation, peak", path.get("true_deviation_max_m"), 1e3, "mm"),
        ):
            if value is not None:
                rows.append((title, f"{scale * value:.2f}", unit))
        return card(str(self.folder), bool(self.metrics["accepted"]), self.metrics["failed"], rows)


def card(title: str, accepted: bool, failed: Any, rows: Any) -> str:
    """HTML of a run for notebooks: title, verdict and figures; readable on light and dark ground."""
    said = "accepted" if accepted else "not accepted: " + "; ".join(map(str, failed))
    colour = "#2e9e5b" if accepted else "#d1495b"
    right = ' style="text-align:right"'
    cells = "".join(
        f"<tr><td>{html.escape(name)}</td><td{right}>{html.escape(value)}</td><td>{html.escape(unit)}</td></tr>"
        for name, value, unit in rows
    )
    return (
        f'<div style="border-left:4px solid {colour};padding:2px 10px"><b>{html.escape(title)}</b>'
        f'<div style="color:{colour}">{html.escape(said)}</div><table>{cells}</table></div>'
    )


def card_of(title: str, assessment: "Assessment") -> str:
    """Card of a run that is in memory."""
    from sim.reporting.results_table import figures_of

    rows = [(check.name, figures_of(check)[0], check.unit) for check in assessment.checks if check.value is not None]
    return card(title, assessment.accepted, assessment.failed, rows)
