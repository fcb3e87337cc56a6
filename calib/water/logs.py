"""Vehicle logs for the identification of water: columns, units, one reader of CSV and Parquet.

The columns are listed below. All except `time` are optional. A cell is blank (null in Parquet) if
there is no sample at that time.

    time                 [s], increasing
    x y z qx qy qz qw    pose of the hull in W [m], z up from the surface; or quaternion alone
    wx wy wz             IMU in hull axes: rate [rad/s]
    ax ay az             IMU in hull axes: specific force [m/s^2], +9.81 in z at rest
    vx vy vz             DVL: velocity over ground in hull axes [m/s]
    depth                of the hull's origin [m], down
    thruster.NAME        command as a fraction from -1 to 1, held until the next
    thrust.NAME          alternatively: thrust [N], if it is known
    joint.NAME           joint angle [rad]

A Parquet table recorded by a run of this project can be read too; its column names are translated.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.files import bytes_of, text_of
from uuv.sim.interfaces.spatial import Array, shown

POSITION, ATTITUDE, RATE, FORCE, VELOCITY, DEPTH = (
    "position",
    "attitude",
    "rate",
    "specific force",
    "velocity",
    "depth",
)
CHANNELS = {  # number of columns of each
    POSITION: ("x", "y", "z"),
    ATTITUDE: ("qx", "qy", "qz", "qw"),
    RATE: ("wx", "wy", "wz"),
    FORCE: ("ax", "ay", "az"),
    VELOCITY: ("vx", "vy", "vz"),
    DEPTH: ("depth",),
}
# of their columns; the attitude is a quaternion
UNITS = {POSITION: "m", RATE: "rad/s", FORCE: "m/s^2", VELOCITY: "m/s", DEPTH: "m"}
KINDS = "CSV, Parquet, or the folder of a recorded run"
THRUSTER, THRUST, JOINT = "thruster.", "thrust.", "joint."
SHORTEST = 4.0  # [s] least length of a log
GAP = 0.5  # [s] without any row, in addition to five usual steps, from which on there is a gap
_PULSE, _NEUTRAL, _SPAN = (900.0, 2100.0), 1500, 400  # [us]
_FASTEST, _SPINNING = 10.0, 12.0  # [m/s], [rad/s] beyond which a unit must be wrong
_OF_RUNS = {  # column of a run's own table: column in this format
    **{f"p_WB.{axis}": axis for axis in "xyz"},
    **{f"quat_WB_wxyz.{part}": f"q{part}" for part in "xyzw"},
}
_RUN = "quat_WB_wxyz.w"  # column by which such a table is recognised


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channel:
    """Samples of one sensor."""

    time: Array  # (k,) [s]
    values: Array  # (k, d)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaterLog:
    """One log; fields without a column are empty."""

    name: str
    time: Array  # (N,) [s] of its rows
    channels: Mapping[str, Channel]  # by CHANNELS
    commands: Mapping[str, Array]  # (N,) by thruster, a fraction
    thrusts: Mapping[str, Array]  # (N,) [N] by thruster
    joints: Mapping[str, Array]  # (N,) [rad] by joint

    @property
    def duration(self) -> float:
        """Time [s] from the first row to the last."""
        return float(self.time[-1] - self.time[0])

    def segments(self) -> list[tuple[float, float]]:
        """Beginning and end [s] of each part without a gap."""
        steps = np.diff(self.time)
        after = np.flatnonzero(steps > max(GAP, 5.0 * float(np.median(steps))))
        begins = self.time[np.r_[0, after + 1]]
        ends = self.time[np.r_[after, len(self.time) - 1]]
        return [(float(a), float(b)) for a, b in zip(begins, ends, strict=True)]


def read_log(
    file: str | Path, *, thrusters: Sequence[str], joints: Mapping[str, tuple[float, float]]
) -> WaterLog:
    """Read and check a log.

    Args:
        file: CSV or Parquet, with the columns of this module.
        thrusters: Names of the vehicle's thrusters.
        joints: Ranges [rad] of the vehicle's joints by name.

    Raises:
        ConfigurationError: The file cannot be read, or a column is unknown, incomplete or in
            another unit.
        MissingLibraryError: The file is Parquet, and the package pyarrow is not installed.
    """
    path = Path(file)
    columns = _parquet(path) if path.suffix == ".parquet" else _csv(path)
    return log_of(f"log {path.name}", columns, thrusters=thrusters, joints=joints)


def log_of(
    name: str,
    columns: Mapping[str, Array],
    *,
    thrusters: Sequence[str],
    joints: Mapping[str, tuple[float, float]],
) -> WaterLog:
    """The log of columns (N,) by name, NaN where there is no sample; otherwise as `read_log`."""
    columns = _of_run(columns, thrusters, joints) if _RUN in columns else dict(columns)
    known = {
        "time",
        *(channel for group in CHANNELS.values() for channel in group),
        *(f"{kind}{thruster}" for kind in (THRUSTER, THRUST) for thruster in thrusters),
        *(f"{JOINT}{joint}" for joint in joints),
    }

    if unknown := [column for column in columns if column not in known]:
        raise ConfigurationError(_unknown(name, unknown[0], known, thrusters, joints))
    if "time" not in columns:
        raise ConfigurationError(f"{name}: it has no column 'time' [s]")

    time = _time(name, columns["time"])
    channels = _channels(name, columns, time)

    # Channels that depend on each other.
    _compare_rates(name, channels)
    if POSITION in channels and ATTITUDE not in channels:
        raise ConfigurationError(
            f"{name}: x y z must be accompanied by qx qy qz qw, since without an attitude the "
            "heading is unknown"
        )

    _refuse_half(name, columns, thrusters, joints)

    return WaterLog(
        name=name,
        time=time,
        channels=channels,
        commands={
            thruster: _command(name, thruster, _held(columns[THRUSTER + thruster]))
            for thruster in thrusters
            if THRUSTER + thruster in columns
        },
        thrusts={
            thruster: _held(columns[THRUST + thruster])
            for thruster in thrusters
            if THRUST + thruster in columns
        },
        joints={
            joint: _joint(name, joint, time, columns[JOINT + joint], limits)
            for joint, limits in joints.items()
            if JOINT + joint in columns
        },
    )


def _channels(name: str, columns: Mapping[str, Array], time: Array) -> dict[str, Channel]:
    """Samples of each sensor, in the units of the format; at least one sensor is needed."""
    channels = {}
    for kind, words in CHANNELS.items():
        have = [word for word in words if word in columns]
        if not have:
            continue
        if len(have) < len(words):
            lacking = next(word for word in words if word not in columns)
            raise ConfigurationError(
                f"{name}: {kind} must have all of {', '.join(words)}; {lacking!r} is missing"
            )

        values = np.column_stack([columns[word] for word in words])
        present = ~np.isnan(values).all(axis=1)
        half = present & np.isnan(values).any(axis=1)
        if half.any():
            row = int(np.flatnonzero(half)[0])
            raise ConfigurationError(
                f"{name}: at {time[row]:g} s some of {', '.join(words)} are missing; a sample must "
                "have all of them"
            )

        if present.sum() >= 2:
            channels[kind] = Channel(
                time=time[present], values=_in_units(name, kind, time[present], values[present])
            )

    if not channels:
        some = "; ".join(" ".join(words) for words in CHANNELS.values())
        raise ConfigurationError(
            f"{name}: no sensor has a sample; the log must have at least one of: {some}"
        )

    return channels


def _refuse_half(
    name: str, columns: Mapping[str, Array], thrusters: Sequence[str], joints: Iterable[str]
) -> None:
    """Refuse logs in which only some thrusters or joints have a column, or a thruster has two."""
    # A column for every thruster and joint, or for none.
    for kind, have in (
        (
            "thruster",
            [
                thruster
                for thruster in thrusters
                if f"{THRUSTER}{thruster}" in columns or f"{THRUST}{thruster}" in columns
            ],
        ),
        ("joint", [joint for joint in joints if f"{JOINT}{joint}" in columns]),
    ):
        lacking = [
            channel
            for channel in (thrusters if kind == "thruster" else joints)
            if channel not in have
        ]
        if have and lacking:
            raise ConfigurationError(
                f"{name}: {kind} {lacking[0]} has no column, although others have one; add "
                f"{kind}.{lacking[0]}{', zero if it was off' if kind == 'thruster' else ''}"
            )

    # A thruster has either the command or the thrust.
    both = [
        thruster
        for thruster in thrusters
        if f"{THRUSTER}{thruster}" in columns and f"{THRUST}{thruster}" in columns
    ]
    if both:
        raise ConfigurationError(
            f"{name}: thruster {both[0]} must have a command or a thrust, not both"
        )


def write_log(file: Path, log: WaterLog) -> None:
    """Write a log as CSV, with blank cells where there is no sample."""
    columns: dict[str, Array] = {"time": log.time}
    for kind, channel in log.channels.items():
        at = np.searchsorted(log.time, channel.time)
        for i, word in enumerate(CHANNELS[kind]):
            columns[word] = np.full(len(log.time), np.nan)
            columns[word][at] = channel.values[:, i]

    for before, group in ((THRUSTER, log.commands), (THRUST, log.thrusts), (JOINT, log.joints)):
        columns |= {f"{before}{channel}": values for channel, values in group.items()}

    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow("" if np.isnan(value) else f"{value:.9g}" for value in row)


def check_log(file: str | Path) -> None:
    """Refuse a file that is neither CSV nor Parquet, before its vehicle is known.

    Raises:
        ConfigurationError: It is missing, empty or of another kind.
    """
    path = Path(file)
    if path.suffix == ".parquet":
        if not bytes_of(path, "log").startswith(b"PAR1"):
            raise ConfigurationError(
                f"log {path.name}: must be {KINDS}; this is not a Parquet file"
            )
    else:
        _text(path)


def _text(path: Path) -> str:
    try:
        text = text_of(path, "log")
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; allowed are {KINDS}") from error

    if "\0" in text:
        raise ConfigurationError(f"log {path.name}: must be {KINDS}; this file is binary")
    return text


def _csv(path: Path) -> dict[str, Array]:
    text = _text(path)
    # all kinds of line ends, such as those of older spreadsheets, become one
    lines = io.StringIO(text, newline=None)
    rows = _rows(csv.reader(lines), path.name)

    # Names of the columns; each must occur once.
    head = [cell.strip() for cell in next(rows, [])]
    if twice := [cell for i, cell in enumerate(head) if cell in head[:i]]:
        raise ConfigurationError(f"log {path.name}: column {shown(twice[0])} occurs twice")

    # Rows of numbers.
    table = []
    for number, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(head):
            raise ConfigurationError(
                f"log {path.name}: line {number} must have {len(head)} cells as the first line, "
                f"got {len(row)}"
            )
        table.append(
            [_cell(path.name, number, word, cell) for word, cell in zip(head, row, strict=True)]
        )

    if len(table) < 2:
        raise ConfigurationError(
            f"log {path.name}: must have at least {SHORTEST:g} s of samples, got {len(table)} rows "
            "of numbers"
        )

    return dict(zip(head, np.array(table).T, strict=True))


def _rows(read: Iterator[list[str]], file: str) -> Iterator[list[str]]:
    """Rows of cells, as read by the module `csv`."""
    try:
        yield from read
    except csv.Error as error:
        raise ConfigurationError(f"log {file}: cannot be read ({error})") from error


def _cell(file: str, line: int, column: str, cell: str) -> float:
    if not cell.strip():
        return np.nan
    try:
        number = float(cell)
    except ValueError:
        raise ConfigurationError(
            f"log {file}: line {line}, column {column!r}: expected a number, got {shown(cell)}"
        ) from None
    if not np.isfinite(number):
        raise ConfigurationError(
            f"log {file}: line {line}, column {column!r} is {cell.strip()}; leave a cell blank "
            "where there is no sample"
        )
    return number


def _parquet(path: Path) -> dict[str, Array]:
    with wanted():
        import pyarrow as pa
        import pyarrow.parquet as pq

    raw = bytes_of(path, "log")
    try:
        table = pq.read_table(io.BytesIO(raw))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ConfigurationError(
            f"log {path.name}: cannot be read as a Parquet table ({error})"
        ) from error

    columns = {}
    for word in table.column_names:
        try:
            values = np.asarray(
                table[word].combine_chunks().cast(pa.float64()).to_numpy(zero_copy_only=False)
            )
        except (pa.ArrowException, ValueError) as error:
            raise ConfigurationError(
                f"log {path.name}: column {word!r} must hold numbers ({error})"
            ) from error

        blank = np.asarray(table[word].is_null().to_numpy(), dtype=bool)
        bad = np.flatnonzero(~blank & ~np.isfinite(values)).tolist()
        if bad and _RUN not in table.column_names:  # runs record NaN where there is no value
            raise ConfigurationError(
                f"log {path.name}: row {bad[0]}, column {word!r} is not finite; leave null where "
                "there is no sample"
            )
        columns[word] = np.array(values, dtype=np.float64)

    if len(table) < 2:
        raise ConfigurationError(
            f"log {path.name}: must have at least {SHORTEST:g} s of samples, got {len(table)} rows"
        )

    return columns


def _of_run(
    columns: Mapping[str, Array],
    thrusters: Sequence[str],
    joints: Mapping[str, tuple[float, float]],
) -> dict[str, Array]:
    """Columns of a run's own table, renamed as in this module; all other columns are left out."""
    names = {"time": "time", **_OF_RUNS}
    names |= {f"{THRUST}{thruster}": f"{THRUST}{thruster}" for thruster in thrusters} | {
        f"q.{joint}": f"{JOINT}{joint}" for joint in joints
    }

    return {names[word]: values for word, values in columns.items() if word in names}


def _unknown(
    name: str,
    column: str,
    known: Iterable[str],
    thrusters: Sequence[str],
    joints: Mapping[str, tuple[float, float]],
) -> str:
    kind, dot, _ = column.partition(".")

    # A thruster or joint that this vehicle does not have.
    for before, have in ((THRUSTER, thrusters), (THRUST, thrusters), (JOINT, tuple(joints))):
        if dot and f"{kind}." == before:
            available = ", ".join(before + word for word in have) or "none"
            meant = did_you_mean(column, [before + word for word in have])
            return f"{name}: unknown column {shown(column)}; this vehicle has {available}{meant}"

    plain = ", ".join(("time", *(word for group in CHANNELS.values() for word in group)))
    return (
        f"{name}: unknown column {shown(column)}; the columns are {plain}, {THRUSTER}NAME, "
        f"{THRUST}NAME, {JOINT}NAME{did_you_mean(column, list(known))}"
    )


def _time(name: str, time: Array) -> Array:
    if np.isnan(time).any():
        raise ConfigurationError(
            f"{name}: row {int(np.flatnonzero(np.isnan(time))[0])} has no time"
        )

    steps = np.diff(time)
    if len(back := np.flatnonzero(steps <= 0.0)):
        at = int(back[0])
        raise ConfigurationError(
            f"{name}: time must increase, but {time[at + 1]:g} s follows {time[at]:g} s"
        )

    # In seconds.
    usual = float(np.median(steps))
    if usual > 1.0:
        raise ConfigurationError(
            f"{name}: rows must be at most 1 s apart, got {usual:g} s; time must be in s (not ms, "
            "us or ns)"
        )

    if time[-1] - time[0] < SHORTEST:
        raise ConfigurationError(
            f"{name}: must last at least {SHORTEST:g} s, got {time[-1] - time[0]:.3g} s; time must "
            "be in s"
        )
    return time


def _in_units(name: str, kind: str, time: Array, values: Array) -> Array:
    """The samples, quaternions of unit length without jumps of sign; another unit is refused."""
    dt = np.diff(time)

    if kind in (POSITION, DEPTH):
        speed = float(np.quantile(np.abs(np.diff(values, axis=0)).max(axis=1) / dt, 0.9))
        if speed > _FASTEST:
            raise ConfigurationError(
                f"{name}: {kind} changes by {speed:.3g} m/s; it must be in m (not mm)"
            )
    elif kind == ATTITUDE:
        length = np.linalg.norm(values, axis=1)
        if float(np.abs(length - 1.0).max()) > 0.02:
            raise ConfigurationError(
                f"{name}: qx qy qz qw must be a unit quaternion, its length reaches "
                f"{length.max():.3g}"
            )

        values = values / length[:, None]
        upright = 1.0 - 2.0 * (values[:, 0] ** 2 + values[:, 1] ** 2)
        if float(np.median(upright)) < -0.5:
            raise ConfigurationError(
                f"{name}: the hull is upside down; the attitude of the hull in W, with z up, must "
                "be in the order qx qy qz qw"
            )

        # q and -q are one attitude: no jumps of sign.
        flips = np.cumprod(
            np.r_[1.0, np.where(np.sum(values[1:] * values[:-1], axis=1) < 0.0, -1.0, 1.0)]
        )
        values = values * flips[:, None]
    elif kind == VELOCITY and float(np.quantile(np.abs(values), 0.9)) > _FASTEST:
        raise ConfigurationError(
            f"{name}: vx vy vz reach {np.abs(values).max():.3g}; they must be in m/s (not mm/s)"
        )
    elif kind == RATE and float(np.quantile(np.abs(values), 0.99)) > _SPINNING:
        raise ConfigurationError(
            f"{name}: wx wy wz reach {np.abs(values).max():.3g}; they must be in rad/s (not deg/s)"
        )
    elif kind == FORCE:
        usual = float(np.median(np.linalg.norm(values, axis=1)))
        if not 5.0 < usual < 20.0:
            raise ConfigurationError(
                f"{name}: ax ay az have a usual length of {usual:.3g}; they must be specific force "
                "[m/s^2], 9.81 at rest"
            )

    return values


def _compare_rates(name: str, channels: Mapping[str, Channel]) -> None:
    """Refuse rates that are 57 times those of the attitude, and therefore in deg/s."""
    if ATTITUDE not in channels or RATE not in channels:
        return

    attitude, rate = channels[ATTITUDE], channels[RATE]
    turned = 2.0 * np.sqrt(np.sum(np.diff(attitude.values, axis=0) ** 2, axis=1)).sum()
    steps = np.minimum(np.diff(rate.time), 1.0)
    measured = float(np.sum(np.linalg.norm(rate.values[:-1], axis=1) * steps))

    if turned > 0.3 and measured > 20.0 * turned:
        raise ConfigurationError(
            f"{name}: wx wy wz integrate to {measured:.3g}, but the quaternion turns by "
            f"{turned:.3g} rad; wx wy wz must be in rad/s (not deg/s)"
        )


def _held(values: Array) -> Array:
    """A column with blanks filled by the last value, and by zero before the first value."""
    last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(last >= 0, values[np.maximum(last, 0)], 0.0)


def _command(name: str, thruster: str, values: Array) -> Array:
    most = float(np.abs(values).max())
    if most <= 1.0 + 1e-6:
        return np.clip(values, -1.0, 1.0)
    message = f"{name}: {THRUSTER}{thruster} reaches {most:.4g}; it must be a fraction from -1 to 1"
    if _PULSE[0] <= float(np.median(values)) <= _PULSE[1]:
        raise ConfigurationError(
            f"{message}: for a pulse in us it is (pulse - {_NEUTRAL}) / {_SPAN}"
        )
    raise ConfigurationError(f"{message}{': of percent, a hundredth' if most <= 100.0 else ''}")


def _joint(name: str, joint: str, time: Array, values: Array, limits: tuple[float, float]) -> Array:
    sampled = ~np.isnan(values)
    if sampled.sum() < 2:
        raise ConfigurationError(f"{name}: {JOINT}{joint} must have at least two samples")

    filled = np.interp(time, time[sampled], values[sampled])
    low, high = limits
    beyond = max(float(filled.max()) - high, low - float(filled.min()))
    if beyond > 0.5:
        degrees = np.radians(filled)
        fits = degrees.max() <= high + 0.1 and degrees.min() >= low - 0.1
        raise ConfigurationError(
            f"{name}: {JOINT}{joint} runs from {filled.min():.4g} to {filled.max():.4g}, but its "
            f"range is {low:.3g} to {high:.3g} rad{' (these look like degrees)' if fits else ''}"
        )
    return filled
