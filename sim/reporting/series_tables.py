"""Series and events of a run as tables in its folder, one for each rate, with units.

`write_series` leaves them beside the log, as Parquet, or as .npz without the package pyarrow;
`PastRun` reads them back, and everything else of a run's folder.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.evaluation.run_metrics import EveryRun
from uuv.sim.interfaces import page
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import one_of, shown
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.reporting.series_files import (
    ENDINGS,
    MOST_NUMBERS,
    Column,
    arrow_table,
    read_table,
    write_table,
)
from uuv.sim.runs.run_folder import checked_format

if TYPE_CHECKING:  # the figures of a run are read without the kernels of what recorded it
    import pandas as pd
    import pyarrow as pa

    from uuv.sim.evaluation.assessment import Assessment
    from uuv.sim.loop.recording import Event, RecordedSeries, Recording, Series
    from uuv.sim.reporting.run_plot import RunFigure

METRICS = "metrics.json"  # in the folder of a run
STATES = (*WorkState, "interrupted", "crashed")  # in which a run may end
LOOP = "loop"
SLOW = "slow"
POSES = "poses"
EVENTS = "events"
# after the name of a table whose series begin later than those of another of its rate
LATE = "_late"
_CLOUD = "cloud_"  # before the name of a cloud
_FILE = "series_"  # before the name of a table of series
# series whose rate names a table; the other rate is SLOW
_NAMES = {"body_pose": POSES, "contact_normal": LOOP}


def write_series(recording: "Recording", folder: Path) -> None:
    """Writes the table of each rate of the recording, and that of the events, to `folder`.

    Columns are `time` [s] and NAME or NAME.LABEL, such as p_WB.x.
    """
    for name, columns in _tables(recording).items():
        write_table(folder / f"{_FILE}{name}", columns)

    events = recording.events
    texts = {
        "state": [str(event.state) for event in events],
        "abort": ["" if event.abort is None else str(event.abort) for event in events],
        "note": [event.note for event in events],
    }

    for name, points in recording.clouds.items():
        columns = [Column(axis, points[:, k], "m") for k, axis in enumerate("xyz")]
        if len(points):
            write_table(folder / f"{_CLOUD}{name}", columns)

    times = Column("time", np.array([event.time for event in events]), "s")
    write_table(
        folder / EVENTS,
        [times, *(Column(name, np.array(words, dtype=np.str_)) for name, words in texts.items())],
    )


def _tables(recording: "Recording") -> dict[str, list[Column]]:
    """Columns of the table of each rate; series of the same times share a table."""
    by_time: dict[tuple[int, float], list[tuple[str, Series]]] = {}
    for name, series in recording.series.items():
        if len(series.time):
            by_time.setdefault((len(series.time), float(series.time[0])), []).append((name, series))

    tables: dict[str, list[Column]] = {}
    for group in by_time.values():
        title = next((_NAMES[name] for name, _ in group if name in _NAMES), SLOW)
        while title in tables:  # series that begin later, such as an estimate after the tare
            title += LATE

        tables[title] = [Column("time", group[0][1].time, "s")]
        for name, series in group:
            labels = series.labels
            if name == "body_pose":
                labels = tuple(
                    f"{body}.{part}"
                    for body in series.labels
                    for part in ("x", "y", "z", "qw", "qx", "qy", "qz")
                )

            width = series.value.shape[1]
            if len(labels) != width:
                labels = tuple(map(str, range(width))) if width > 1 else ()
            words = [f"{name}.{label}" for label in labels] or [name]
            tables[title] += [
                Column(word, series.value[:, i], series.unit, name) for i, word in enumerate(words)
            ]

    return tables


@dataclass(frozen=True, slots=False)
class PastRun:
    """A run in its folder: figures, scenario, series and events; a notebook shows it as a card."""

    folder: Path
    _kept: dict[str, dict[str, Column]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @classmethod
    def of(cls, folder: str | Path) -> "PastRun":
        """The run in `folder`.

        Raises:
            ConfigurationError: There is none.
        """
        if not (Path(folder) / METRICS).exists():
            raise ConfigurationError(f"{folder}: no run, a folder with {METRICS}")
        return cls(Path(folder))

    @cached_property
    def metrics(self) -> Mapping[str, Any]:
        """Content of metrics.json.

        Raises:
            ConfigurationError: It cannot be read, or is of a later format, or lacks what every run
                has (`uuv.sim.evaluation.run_metrics.EveryRun`).
        """
        file = self.folder / METRICS
        content = json_of(file, "metrics")
        checked_format(content, f"metrics {shown(str(file))}")

        try:
            ended = TableReader(METRICS, passes_unknown=True).made(EveryRun, content).run.state
            one_of(ended, STATES, "run.state")
        except ConfigurationError as error:
            raise ConfigurationError(f"metrics {shown(str(file))}: {error}") from error

        return content

    @property
    def simulated_s(self) -> float:
        """[s] simulated time.

        Raises:
            ConfigurationError: The run gave none.
        """
        if (simulated := self.metrics["run"]["simulated_s"]) is None:
            raise ConfigurationError(
                f"{self.folder}/{METRICS}: run.simulated_s is null: the run crashed"
            )
        return float(simulated)

    @property
    def rates(self) -> tuple[str, ...]:
        """Names of the tables of series: LOOP at the loop's rate, SLOW at 50 Hz, POSES at 25 Hz.

        Series that begin later, such as an estimate of the controller after the tare, have a table
        with LATE.
        """
        files = [file for ending in ENDINGS for file in self.folder.glob(f"{_FILE}*{ending}")]
        return tuple(sorted({file.stem.removeprefix(_FILE) for file in files}))

    @cached_property
    def clouds(self) -> Mapping[str, np.ndarray]:
        """Points (N, 3) [m] in W of each cloud that the run kept, by name.

        Raises:
            ConfigurationError: A file of them is none that a run writes.
        """
        files = sorted(f for ending in ENDINGS for f in self.folder.glob(f"{_CLOUD}*{ending}"))
        read: dict[str, Mapping[str, Column]] = {}
        count = 0
        for file in files:
            table = read[file.stem.removeprefix(_CLOUD)] = read_table(file)
            count += sum(column.values.size for column in table.values())
            if count > MOST_NUMBERS:
                raise ConfigurationError(
                    f"{self.folder}: its clouds have more than {MOST_NUMBERS} values"
                )

        for name, columns in read.items():
            if tuple(columns) != ("x", "y", "z"):
                raise ConfigurationError(
                    f"{self.folder}: cloud {shown(name)} must have the columns x, y, z"
                )
        return {
            name: np.column_stack([column.values for column in columns.values()])
            for name, columns in read.items()
        }

    def table(self, rate: str = LOOP) -> "pa.Table":
        """Series of one rate, or EVENTS, as a table of Arrow.

        Raises:
            ConfigurationError: There is no such table.
            MissingLibraryError: The package pyarrow is not installed.
        """
        with wanted():
            import pyarrow as pa
        file = self._file(rate)
        if file.suffix == ".parquet":
            return arrow_table(file)
        return pa.table({name: column.values for name, column in read_table(file).items()})

    def frame(self, rate: str = LOOP) -> "pd.DataFrame":
        """Series of one rate, or EVENTS, as a data frame of pandas; its index is the time [s].

        Raises:
            ConfigurationError: There is no such table.
            MissingLibraryError: The extra pandas is not installed.
        """
        with wanted():
            import pandas as pd
        columns = read_table(self._file(rate))
        return pd.DataFrame({name: column.values for name, column in columns.items()}).set_index(
            "time"
        )

    def plot(self, *, whole: bool = False) -> "RunFigure":
        """Figure of force, path error, hull and phase over time, by Matplotlib.

        Args:
            whole: From the start of the run; else from the approach on.

        Raises:
            ConfigurationError: The run kept no series, or ended before there was anything to draw.
            MissingLibraryError: The extra log is not installed.
        """
        with wanted():
            from uuv.sim.reporting.run_plot import plot_of

        return plot_of(self.recorded, whole=whole)

    def column(self, name: str, rate: str = LOOP) -> np.ndarray:
        """Values (N,) of one column; `time` is a column too.

        Raises:
            ConfigurationError: There is no such column; the message names the table that has it,
                or lists those that there are.
        """
        columns = self._columns(rate)
        if name not in columns:
            raise ConfigurationError(f"no column {name!r} in the table {rate!r}{self._near(name)}")
        return columns[name].values

    def _near(self, name: str) -> str:
        """End of the message on a column that a table lacks: another table has it, or one of a
        similar name, or the columns of all tables.
        """
        tables = {rate: list(self._columns(rate)) for rate in self.rates}
        for rate, names in tables.items():
            if name in names:
                return f"; the table {rate!r} has it: column({name!r}, {rate!r})"

        near = did_you_mean(name, [column for names in tables.values() for column in names])
        lists = "; ".join(f"{rate!r}: {', '.join(names)}" for rate, names in tables.items())
        return f"{near}; there are in {lists}"

    def numbers(self, name: str, rate: str = LOOP) -> np.ndarray:
        """Values (N,) of one column, which must be numbers.

        Raises:
            ConfigurationError: There is no such column, or it is texts.
        """
        numbers = self.column(name, rate)
        if numbers.dtype.kind not in "bifu":
            raise ConfigurationError(
                f"{self.folder}: the column {shown(name)} of {rate!r} is not numeric"
            )

        return numbers

    def units(self, rate: str = LOOP) -> dict[str, str]:
        """Unit of each column."""
        return {name: column.unit for name, column in self._columns(rate).items()}

    @property
    def states(self) -> dict[int, str]:
        """Names of the states of the work by their number in the series `state`."""
        from uuv.sim.loop.recording import STATES as LOGGED_STATES

        return {number: str(state) for number, state in enumerate(LOGGED_STATES)}

    @cached_property
    def recorded(self) -> "RecordedSeries":
        """All series and events, in the form that the functions of `uuv.sim.evaluation` take.

        Raises:
            ConfigurationError: The run was made with --no-record, or a series of every step has
                another shape.
        """
        from uuv.sim.loop.recording import RecordedSeries, Series

        series: dict[str, Series] = {}
        for rate in self.rates or (LOOP,):
            columns = self._columns(rate)
            time = self.numbers("time", rate)
            if not np.isfinite(time).all() or (np.diff(time) < 0.0).any():
                raise ConfigurationError(
                    f"{self.folder}: the times of its series {rate!r} do not rise"
                )

            # Columns by series.
            parts: dict[str, list[Column]] = {}
            for column in columns.values():
                if column.series:
                    parts.setdefault(column.series, []).append(column)
            for name, group in parts.items():
                labels = tuple(column.label for column in group) if group[0].label else ()
                components = np.column_stack([self.numbers(column.name, rate) for column in group])
                series[name] = Series(
                    time=time, value=components, unit=group[0].unit, labels=labels
                )

        self._check_layout(series)
        return RecordedSeries(duration=self.simulated_s, series=series, events=self.events)

    @cached_property
    def events(self) -> "tuple[Event, ...]":
        """Changes of the state of the work, at least one, in order of time.

        Raises:
            ConfigurationError: There is no such table, or it has a state or cause that there is
                not.
        """
        from uuv.sim.loop.recording import Event

        columns = self._columns(EVENTS)
        times = self.numbers("time", EVENTS).tolist()
        texts = [self._texts(columns, name) for name in ("state", "note", "abort")]

        if not np.isfinite(times).all() or sorted(times) != times:
            raise ConfigurationError(f"{self.folder}: the times of its events do not rise")

        events = []
        for time, state, note, abort in zip(times, *texts, strict=True):
            one_of(state, [*WorkState], f"{self.folder}: state of an event")
            if abort:
                one_of(abort, [*AbortCode], f"{self.folder}: cause of an event")
            cause = AbortCode(abort) if abort else None
            events.append(Event(time=float(time), state=WorkState(state), note=note, abort=cause))

        return tuple(events)

    def _check_layout(self, series: "Mapping[str, Series]") -> None:
        """Refuse a series of every step whose number of columns is wrong, or of rows differs from
        `state`, and a state that there is not.
        """
        from uuv.sim.loop.logged_columns import WIDTHS
        from uuv.sim.loop.recording import STATES as LOGGED_STATES

        if "state" not in series:
            raise ConfigurationError(
                f"{self.folder}: its tables are of another version, without the series 'state'"
            )

        for name, width in WIDTHS.items():
            if name in series and series[name].value.shape != (len(series["state"].time), width):
                raise ConfigurationError(
                    f"{self.folder}: the series {name!r} must have {width} columns of loop's rate"
                )

        states = series["state"].scalar
        allowed = range(len(LOGGED_STATES))
        if not np.isin(states, allowed).all():
            wrong = states[~np.isin(states, allowed)][0]
            raise ConfigurationError(
                f"{self.folder}: the series 'state' must be whole numbers in 0..{allowed[-1]}, got "
                f"{wrong:g}"
            )

        for name in ("arm_wrench", "believed.arm_wrench_B"):
            if name in series and series[name].value.shape[1] != 6:
                raise ConfigurationError(f"{self.folder}: the series {name!r} must have 6 columns")

    def _texts(self, columns: Mapping[str, Column], name: str) -> list[str]:
        """Values of a column of texts of the events."""
        if name not in columns or columns[name].values.dtype.kind not in "OU":
            raise ConfigurationError(
                f"{self.folder}: the table {EVENTS!r} has no column {shown(name)} of texts"
            )
        return list(map(str, columns[name].values))

    def _columns(self, rate: str) -> dict[str, Column]:
        if rate not in self._kept:
            read = read_table(self._file(rate))
            columns = [
                column for table in (*self._kept.values(), read) for column in table.values()
            ]
            if sum(column.values.size for column in columns) > MOST_NUMBERS:
                raise ConfigurationError(
                    f"{self.folder}: its tables have more than {MOST_NUMBERS} values"
                )

            self._kept[rate] = read
        return self._kept[rate]

    def _file(self, rate: str) -> Path:
        stem = EVENTS if rate == EVENTS else f"{_FILE}{rate}"
        for ending in ENDINGS:
            if (file := self.folder / f"{stem}{ending}").exists():
                return file

        known = (
            ", ".join((*self.rates, EVENTS)) if self.rates else "none: it was run with --no-record"
        )
        raise ConfigurationError(f"{self.folder}: no series {rate!r}; there are {known}")

    def _repr_html_(self) -> str:
        """Card for a notebook."""
        run = self.metrics["run"]
        rows = [("ended", str(run["state"]), ""), ("simulated", f"{self.simulated_s:.0f}", "s")]

        for title, table, name, scale, unit in (
            ("force error, RMS", "contact", "force_error_rms_n", 1.0, "N"),
            ("force error, peak", "contact", "force_error_max_n", 1.0, "N"),
            ("path deviation, peak", "tool", "path_deviation_max_m", 1e3, "mm"),
            ("true path deviation, peak", "path", "true_deviation_max_m", 1e3, "mm"),
        ):
            figures = self.metrics.get(table)
            figure = figures.get(name) if isinstance(figures, Mapping) else None
            if isinstance(figure, int | float):
                rows.append((title, f"{scale * figure:.2f}", unit))

        return page.card(
            str(self.folder), bool(self.metrics["accepted"]), self.metrics["failed"], rows
        )


def card_of(title: str, assessment: "Assessment") -> str:
    """Card of a run that is in memory."""
    from uuv.sim.reporting.results_table import figures_of

    rows = [
        (check.name, figures_of(check)[0], check.unit)
        for check in assessment.checks
        if check.value is not None
    ]

    return page.card(title, assessment.accepted, assessment.failed, rows)
