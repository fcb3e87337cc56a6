"""Reader and writer of touch files: CSV with joint values, one touch per row.

A folder holds one CSV file per point. A single file holds one point, or several separated by a
column `point` or by empty lines. Separators are commas, semicolons, tabs or blanks; a header is
optional. Radians and degrees are distinguished automatically, and the result is reported.
"""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of, existing_file
from uuv.sim.interfaces.spatial import Array, readonly, shown

Units = Literal["auto", "rad", "deg"]
POINT_COLUMNS = ("point", "series", "socket", "hole", "nest", "target", "label")
IGNORED_COLUMNS = ("time", "t", "stamp", "timestamp", "index", "touch", "comment", "note")
_UNIT_ENDING = r"[_ .](deg|degrees|rad|radians|m)$"  # of a column: joint1_deg
# Hinges turn little more than one turn in either direction, so a larger value is in degrees.
# Touches in many orientations turn joints by more than 7 deg, so values in degrees exceed this
# bound.
_MOST_RADIANS = 2.0 * np.pi + 0.6
# [rad], and share of a slide's range: tolerated excess over joint limits (stops, offsets)
_BEYOND = 0.35
_UNIT = 2e-3  # tolerance of a unit quaternion's length, for files with few digits


@dataclass(frozen=True, kw_only=True, eq=False)
class Touches:
    """Series of touches, one per point; arrays are read-only."""

    series: tuple[Array, ...]  # each (m_i, n) [rad], slides [m]
    names: tuple[str, ...]  # names of the points
    sha256: str  # hash of the files' bytes, in the order read
    notes: tuple[str, ...] = ()  # notes about the files, to be reported
    beyond: tuple[str, ...] = ()  # for each point with joint values beyond the limits, the worst

    @property
    def count(self) -> int:
        """Number of touches in all series."""
        return sum(len(q) for q in self.series)


@dataclass(frozen=True, slots=True)
class _Row:
    values: list[float]
    point: str
    where: str  # file:line


def read_touches(
    paths: Path | str | Sequence[Path | str],
    *,
    joint_types: str | None = None,
    joint_names: Sequence[str] = (),
    units: Units = "auto",
    limits: Array | None = None,
    beyond: Literal["refuse", "note"] = "refuse",
) -> Touches:
    """Read touches from CSV files and from folders of such files.

    Args:
        paths: file, folder, or several of them.
        joint_types: one letter per joint of the arm (r, p), which determines the number of joint
            values and which of them are angles.
        joint_names: selects and orders the columns of a header that has all of them.
        units: "rad", "deg", or "auto": by the header or by the size of the values.
        limits: (n, 2) joint limits [rad], slides [m].
        beyond: "refuse" values far beyond those limits, or "note" them as `Touches.beyond`.

    Returns:
        The touches in radians and metres.

    Raises:
        ConfigurationError: a file is missing or empty, a number is not finite, or a row has another
            length. A file has poses (x y z qx qy qz qw) in place of joint values. Values are far
            beyond the limits, unless these are noted. Some files look like degrees and others like
            radians.
    """
    path_list = [paths] if isinstance(paths, str | Path) else list(paths)
    files = [file for path in path_list for file in _files(Path(path))]
    if not files:
        raise ConfigurationError("touches: must name at least one file or folder")

    digest = hashlib.sha256()
    points: dict[str, list[list[float]]] = {}
    notes: list[str] = []
    largest: dict[str, float] = {}  # [as read] largest angle of each file, for the choice of unit
    stated: set[str] = set()
    width = len(joint_types) if joint_types is not None else None

    # Rows by point; the digest covers the bytes in the order read.
    for file, stem in zip(files, _distinct(files), strict=True):
        raw = bytes_of(file, "touches")
        digest.update(raw)
        rows, several, unit = _parse(_text(raw, file), file, stem, width, tuple(joint_names))
        width = len(rows[0].values) if width is None else width
        _refuse_poses(file, rows)

        for row in rows:
            if len(row.values) != width:
                raise ConfigurationError(
                    f"{row.where}: must have {width} joint values, got {len(row.values)}"
                )
            points.setdefault(row.point, []).append(row.values)

        if several:
            notes.append(
                f"{file.name}: {len({row.point for row in rows})} points, separated by {several}"
            )
        if unit is not None:
            stated.add(unit)

        values = np.abs([row.values for row in rows])[:, _hinges(joint_types, width)]
        largest[stem] = float(values.max()) if values.size else 0.0

    # One unit for all files.
    is_degrees = _degrees(units, stated, largest, notes)
    hinges = _hinges(joint_types, width or 0)
    series = [np.array(rows) for rows in points.values()]
    if is_degrees:
        series = [np.where(hinges, np.deg2rad(q), q) for q in series]

    read = Touches(
        series=tuple(readonly(q) for q in series),
        names=tuple(points),
        sha256=digest.hexdigest(),
        notes=tuple(notes),
    )

    # Joint limits, if the arm is known.
    if limits is None:
        return read
    outside = _beyond_limits(read, np.asarray(limits), hinges, joint_names)
    if outside and beyond == "refuse":
        raise ConfigurationError(f"{outside[0]}: check arm, unit and order of the joint values")
    return replace(read, beyond=tuple(outside))


def check_touches(paths: Sequence[Path | str]) -> None:
    """Refuse files that are missing, empty or not text, before their arm is known.

    Raises:
        ConfigurationError: A file is unsuitable; the message names it.
    """
    for path in paths:
        for file in _files(Path(path)):
            _text(bytes_of(file, "touches"), file)


def write_touches(
    folder: Path, names: Sequence[str], series: Sequence[Array], joint_names: Sequence[str]
) -> Path:
    """Write one CSV file per point into `folder`, readable by `read_touches`.

    Args:
        folder: created if it is missing.
        names: names of the points, which are also those of the files.
        series: joint values (m_i, n) per point.
        joint_names: header.

    Returns:
        The folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, q in zip(names, series, strict=True):
        lines = [",".join(joint_names), *(",".join(f"{value:.10f}" for value in row) for row in q)]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")

    return folder


def write_touch_list(
    file: Path, points: Sequence[str], q: Array, joint_names: Sequence[str], joint_types: str
) -> Path:
    """Write touches of several points into one CSV file in their order, readable by `read_touches`.

    Args:
        file: CSV file.
        points: name of the point of each touch.
        q: joint values (m, n) [rad], slides [m].
        joint_names: header, with units.
        joint_types: one letter per joint (r, p).

    Returns:
        The file.

    Raises:
        ConfigurationError: a point's name has a character that separates cells or begins a comment.
    """
    for point in points:
        if re.search(r"[,;#\s]", point):
            raise ConfigurationError(
                f"point {shown(point)}: a name in a list must not have a comma, semicolon, # or "
                "blank"
            )

    units = ("m" if letter == "p" else "rad" for letter in joint_types)
    head = ",".join(
        ("point", *(f"{name} [{unit}]" for name, unit in zip(joint_names, units, strict=True)))
    )
    rows = (
        ",".join((point, *(f"{value:.10f}" for value in row)))
        for point, row in zip(points, q, strict=True)
    )

    file.write_text("\n".join((head, *rows)) + "\n", encoding="utf-8")
    return file


def _refuse_poses(file: Path, rows: Sequence[_Row]) -> None:
    """Refuse a file of poses: rows of seven numbers that end in a unit quaternion."""
    values = np.array([row.values for row in rows if len(row.values) == 7])
    if len(values) < len(rows) or len(values) < 2 or np.ptp(values[:, 3:], axis=0).max() < 1e-6:
        return
    if np.abs(np.linalg.norm(values[:, 3:], axis=1) - 1.0).max() < _UNIT:
        raise ConfigurationError(
            f"{file}: must hold joint values, but has poses (x y z and a unit quaternion in every "
            "row); name the files of joint values one by one, or move this file out of the folder"
        )


def _beyond_limits(
    read: Touches, limits: Array, hinges: np.ndarray, joint_names: Sequence[str]
) -> list[str]:
    """A message for each point with joint values beyond the arm's limits, about the worst value.

    Args:
        read: touches.
        limits: (n, 2) joint limits [rad], slides [m]; infinite or NaN where there are none.
        hinges: (n,) bool, True for a hinge.
        joint_names: names of the joints; may be empty.
    """
    out = []
    with np.errstate(invalid="ignore"):
        slack = np.where(hinges, _BEYOND, _BEYOND * np.diff(limits, axis=1)[:, 0])

    for name, q in zip(read.names, read.series, strict=True):
        with np.errstate(invalid="ignore"):
            beyond = np.maximum(limits[:, 0] - q, q - limits[:, 1]) - slack
        beyond = np.where(np.isfinite(beyond), beyond, -np.inf)
        touch, joint = divmod(int(np.argmax(beyond)), beyond.shape[1])
        if beyond[touch, joint] <= 0.0:
            continue

        word, (low, high) = "rad" if hinges[joint] else "m", limits[joint]
        called = joint_names[joint] if joint < len(joint_names) else f"joint {joint + 1}"
        out.append(
            f"touches of {name!r}: touch {touch + 1} has {called} at {q[touch, joint]:.4g} "
            f"{word}, the arm's limits "
            f"are {low:.4g} to {high:.4g}"
        )

    return out


def _hinges(joint_types: str | None, width: int) -> np.ndarray:
    return np.array([letter != "p" for letter in (joint_types or "r" * width)], dtype=bool)


def _degrees(units: Units, stated: set[str], largest: dict[str, float], notes: list[str]) -> bool:
    """True if the angles are degrees: as requested, by the headers or by size; noted in `notes`."""
    if units != "auto":
        return units == "deg"

    # As the headers state.
    if len(stated) > 1:
        raise ConfigurationError(
            "touches: some headers state degrees, others radians; state --units rad or --units deg"
        )
    if stated:
        if "deg" in stated:
            notes.append("touches: degrees by their header, converted to radians")
        return "deg" in stated

    # By size.
    large = [name for name, value in largest.items() if value > _MOST_RADIANS]
    if large and len(large) < len(largest):
        raise ConfigurationError(
            f"touches: {', '.join(large[:3])} {'looks' if len(large) == 1 else 'look'} like "
            f"degrees (up to {max(largest.values()):.4g}), the rest like radians; state --units "
            "rad or --units deg"
        )

    if large:
        notes.append(
            f"touches: look like degrees (the largest angle is {max(largest.values()):.4g}), "
            "converted to radians; state --units rad if they are radians already"
        )

    return bool(large)


def _files(path: Path) -> list[Path]:
    if _is_folder(path):
        files = sorted(
            file
            for file in path.rglob("*")
            if file.suffix.lower() in (".csv", ".tsv") and file.is_file()
        )
        if not files:
            raise ConfigurationError(f"touches: there is no .csv file in folder {path}")
        return files
    return [existing_file(path, "touches")]


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):  # not a valid path; `existing_file` reports it
        return False


def _distinct(files: Sequence[Path]) -> list[str]:
    """Unique name per file: its stem, preceded by as many folders as needed."""
    for depth in range(1, 8):
        names = ["/".join((*file.parts[-depth:-1], file.stem)) for file in files]
        if len(set(names)) == len(names):
            return names
    return [str(file) for file in files]


def _text(raw: bytes, file: Path) -> str:
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f"{file}: must be a text file in UTF-8; touches are CSV files or a folder of such files"
        ) from error


def _parse(
    text: str, file: Path, stem: str, width: int | None, joint_names: tuple[str, ...]
) -> tuple[list[_Row], str, str | None]:
    """Rows of one file, the separator of its points (empty for one), and the unit of its header."""
    header: list[str] | None = None
    rows: list[_Row] = []
    block = 1
    gap = False
    for number, line in enumerate(text.splitlines(), 1):
        body = line.split("#", 1)[0].strip()
        if not body:
            gap = gap or (bool(rows) and not line.strip())
            continue

        cells = _cells(body)
        where = f"{file.name}:{number}"
        if header is None and not rows and not _any_number(cells):
            header = [cell.strip('"').strip().lower() for cell in cells]
            continue

        # A blank line after touches separates points.
        if gap:
            block += 1
            gap = False
        if header is not None and len(cells) != len(header):
            raise ConfigurationError(
                f"{where}: must have {len(header)} cells as the header, got {len(cells)}"
            )
        rows.append(_row(cells, header, joint_names, width, where, block))

    if not rows:
        raise ConfigurationError(f"{file}: must have at least one touch, has none")

    # A point is named by its label, or by the file and the block in it.
    labels = list(dict.fromkeys(row.point for row in rows))
    blocks = labels[0].startswith("\n")
    several = "" if len(labels) == 1 else "empty lines" if blocks else "their label"
    if len(labels) == 1 and blocks:
        names = {labels[0]: stem}
    elif blocks:
        names = {label: f"{stem}:{label.strip()}" for label in labels}
    else:
        names = {label: label for label in labels}

    rows = [_Row(row.values, names[row.point], row.where) for row in rows]
    units_stated = {
        unit
        for cell in header or ()
        for unit in re.findall(r"[\[(_\s](deg|rad)(?:rees|ians?|s)?(?=[\])\s]|$)", cell)
    }
    return rows, several, units_stated.pop() if len(units_stated) == 1 else None


def _cells(line: str) -> list[str]:
    if ";" in line:
        return [cell.strip().replace(",", ".") for cell in line.split(";")]
    if "," in line:
        return [cell.strip() for cell in line.split(",")]
    return line.split()


def _any_number(cells: Sequence[str]) -> bool:
    for cell in cells:
        try:
            float(cell)
        except ValueError:
            continue
        return True
    return False


def _row(
    cells: list[str],
    header: list[str] | None,
    joint_names: tuple[str, ...],
    width: int | None,
    where: str,
    block: int,
) -> _Row:
    point = f"\n{block}"  # no label in a file begins with a line break
    columns: list[str] = []  # those of the joint values, where the header names them

    if header is None:
        if (
            width is not None
            and len(cells) == width + 1
            and (cells[0].isdigit() or not _any_number(cells[:1]))
        ):
            point = cells[0]  # its number or name
            cells = cells[1:]
    else:
        bare = [re.split(r"\s*[\[(]", name)[0] for name in header]
        label = next((i for i, name in enumerate(bare) if name in POINT_COLUMNS), None)
        if label is not None:
            point = cells[label].strip('"')

        lowered = [name.lower() for name in joint_names]
        short = [_joint_of(name) for name in header]  # without their units
        named = next(
            (names for names in (bare, short) if all(name in names for name in lowered)), None
        )
        if lowered and named is not None:
            cells = [cells[named.index(name)] for name in lowered]
        else:
            drop = {label, *(i for i, name in enumerate(bare) if name in IGNORED_COLUMNS)}
            columns = [name for i, name in enumerate(header) if i not in drop]
            cells = [cell for i, cell in enumerate(cells) if i not in drop]

    values: list[float] = []
    for cell in cells:
        try:
            value = float(cell)
        except ValueError:
            raise ConfigurationError(f"{where}: {shown(cell)} must be a number") from None
        if not np.isfinite(value):
            raise ConfigurationError(
                f"{where}: every joint value must be finite, got {shown(cell)}"
            )
        values.append(value)

    if width is not None and len(values) != width:
        raise ConfigurationError(
            f"{where}: must have one joint value for each of the arm's {width} joints, got "
            f"{len(values)}{_other_columns(columns, joint_names)}"
        )
    return _Row(values, point, where)


def _other_columns(columns: Sequence[str], joint_names: Sequence[str]) -> str:
    """End of a message: columns read as joint values that are no joints, and those ignored."""
    if not columns:
        return ""

    joints = [name.lower() for name in joint_names]
    others = [name for name in columns if _joint_of(name) not in joints]
    if joints and len(others) < len(columns):
        text = f"; not joints of the arm: {', '.join(others)}"
    else:
        text = f": {', '.join(columns)}"
        text += f"; its joints are {', '.join(joint_names)}" if joints else ""

    return f"{text}; ignored: {', '.join(IGNORED_COLUMNS)}"


def _joint_of(column: str) -> str:
    """Name of a column without its unit: joint1 of "joint1 [deg]" and "joint1_deg"."""
    return re.sub(_UNIT_ENDING, "", re.split(r"\s*[\[(]", column)[0])
