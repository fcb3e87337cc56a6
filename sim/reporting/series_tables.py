"""Series and events of a run as Parquet tables, one for each rate, with units in the columns' metadata.

`write_series` leaves them beside the log; `PastRun` reads them back, and everything else of a run's folder.
"""

import html
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sim.evaluation.metrics import Assessment
from sim.interfaces.errors import ConfigurationError
from sim.loop.recording import Recording, Series
from sim.reporting.results_table import figures_of

LOOP, SLOW, POSES, EVENTS = "loop", "slow", "poses", "events"
LATE = "_late"  # after the name of a table whose series begin later than those of another of its rate
_UNIT = b"unit"
_NAMES = {"body_pose": POSES, "contact_normal": LOOP}  # series whose rate names a table; the other rate is SLOW


def write_series(recording: Recording, folder: Path) -> None:
    """Writes series_<rate>.parquet for each rate of the recording, and events.parquet, to `folder`.

    Columns are `time` [s] and NAME or NAME.LABEL, such as p_WB.x.
    """
    for name, columns in _tables(recording).items():
        fields = [
            pa.field(column, pa.float64(), metadata={_UNIT: unit.encode()}) for column, (_, unit) in columns.items()
        ]
        table = pa.table([values for values, _ in columns.values()], schema=pa.schema(fields))
        pq.write_table(
            table,
            folder / f"series_{name}.parquet",
            compression="zstd",
            use_dictionary=False,
            column_encoding=dict.fromkeys(columns, "BYTE_STREAM_SPLIT"),
        )
    events = recording.events
    pq.write_table(
        pa.table(
            {
                "time": pa.array([event.time for event in events], pa.float64()),
                "state": [str(event.state) for event in events],
                "abort": pa.array([None if event.abort is None else str(event.abort) for event in events], pa.string()),
                "note": [event.note for event in events],
            }
        ),
        folder / f"{EVENTS}.parquet",
    )


def _tables(recording: Recording) -> dict[str, dict[str, tuple[np.ndarray, str]]]:
    """Columns, each with its unit, of the table of each rate; series of the same times share a table."""
    by_time: dict[tuple[int, float], list[tuple[str, Series]]] = {}
    for name, series in recording.series.items():
        if len(series.time):
            by_time.setdefault((len(series.time), float(series.time[0])), []).append((name, series))
    made: dict[str, dict[str, tuple[np.ndarray, str]]] = {}
    for group in by_time.values():
        title = next((_NAMES[name] for name, _ in group if name in _NAMES), SLOW)
        while title in made:  # series that begin later, such as an estimate after the tare
            title += LATE
        columns: dict[str, tuple[np.ndarray, str]] = {"time": (group[0][1].time, "s")}
        for name, series in group:
            labels = series.labels if len(series.labels) == series.value.shape[1] else ()
            if name == "body_pose":
                labels = tuple(
                    f"{body}.{part}" for body in series.labels for part in ("x", "y", "z", "qw", "qx", "qy", "qz")
                )
            words = [f"{name}.{label}" for label in labels] or [name]
            columns |= {word: (series.value[:, i], series.unit) for i, word in enumerate(words)}
        made[title] = columns
    return made


@dataclass(frozen=True, slots=False)
class PastRun:
    """A run in its folder: figures, scenario, series and events; a notebook shows it as a card."""

    folder: Path

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
        return tuple(sorted(path.stem.removeprefix("series_") for path in self.folder.glob("series_*.parquet")))

    def table(self, rate: str = LOOP) -> pa.Table:
        """Series of one rate, or EVENTS; `.to_pandas()` makes a data frame of it, where pandas is installed.

        Raises:
            ConfigurationError: There is no such table.
        """
        file = self.folder / (f"{EVENTS}.parquet" if rate == EVENTS else f"series_{rate}.parquet")
        if not file.exists():
            known = ", ".join((*self.rates, EVENTS)) if self.rates else "none: it was run with --no-record"
            raise ConfigurationError(f"{self.folder}: no series {rate!r}; there are {known}")
        return pq.read_table(file)

    def column(self, name: str, rate: str = LOOP) -> np.ndarray:
        """Values (N,) of one column; `time` is one too.

        Raises:
            ConfigurationError: There is no such column; the message lists those that there are.
        """
        table = self.table(rate)
        if name not in table.column_names:
            raise ConfigurationError(f"no column {name!r}; there are {', '.join(table.column_names)}")
        return table[name].to_numpy()

    def units(self, rate: str = LOOP) -> dict[str, str]:
        """Unit of each column."""
        return {field.name: (field.metadata or {}).get(_UNIT, b"").decode() for field in self.table(rate).schema}

    def _repr_html_(self) -> str:
        """Card for a notebook."""
        run, contact, tool = self.metrics["run"], self.metrics.get("contact", {}), self.metrics.get("tool", {})
        rows = [("ended", str(run["state"]), ""), ("simulated", f"{run['simulated_s']:.0f}", "s")]
        for title, value, scale, unit in (
            ("force error, RMS", contact.get("force_error_rms_n"), 1.0, "N"),
            ("force error, peak", contact.get("force_error_max_n"), 1.0, "N"),
            ("path deviation, peak", tool.get("path_deviation_max_m"), 1e3, "mm"),
            ("tip to ideal path, peak", tool.get("object_deviation_max_m"), 1e3, "mm"),
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


def card_of(title: str, assessment: Assessment) -> str:
    """Card of a run that is in memory."""
    rows = [(check.name, figures_of(check)[0], check.unit) for check in assessment.checks if check.value is not None]
    return card(title, assessment.accepted, assessment.failed, rows)
