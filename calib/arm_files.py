"""Arms from files: Denavit-Hartenberg tables as CSV or YAML, Universal Robots' YAML, URDF, MJCF.

    source = read_arm("arm.urdf", tip="ball_link")
    source.arm, source.tcp

A URDF or MJCF has six numbers per joint. They are converted to rows of a table
(`uuv.models.arms.serial_arm`); the tip becomes the flange.
"""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import mujoco
import numpy as np

from uuv.models.files import urdf, urdf_places
from uuv.models.files.mjcf_files import read_mjcf
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.sim.interfaces.documents import parsed_yaml
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    checked_pose,
    pose,
    readonly,
    shown,
)
from uuv.sim.interfaces.tables import TableReader

if TYPE_CHECKING:
    from uuv.models.arms.serial_arm import SerialArm

Kind = Literal["dh", "yaml", "urdf", "mjcf"]
_DH_NAMES = {
    "theta": 0,
    "theta0": 0,
    "theta_offset": 0,
    "offset": 0,
    "q": 0,
    "d": 1,
    "a": 2,
    "r": 2,
    "alpha": 3,
    "beta": 4,
}
_COLUMNS = ("theta", "d", "a", "alpha", "beta")
_ANGLES, _LENGTHS = (0, 3, 4), (1, 2)
_MOST_BYTES = 1_000_000  # [bytes] largest size of a YAML file
_FACTORS = {"deg": np.pi / 180.0, "mm": 1e-3}
# [m] an arm that reaches farther is assumed to be in millimetres, if no unit is stated
_LONGEST = 50.0
_DETOUR = 5.0  # factor on the reach of an arm, beyond which lengths of links cancel each other
_POSTURES = 64  # number of postures drawn to estimate the reach of an arm
_LONGEST_KEY = 60  # largest number of characters of a column's name


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmSource:
    """An arm with the file from which it was read."""

    path: Path
    kind: Kind
    arm: "SerialArm"  # with the limits and joint names of the file
    base: str  # link or body whose frame is the arm's base
    tip: str  # link or site whose frame is the arm's flange
    # (3,) [m] tool point in the flange, if stated
    tcp: Array = field(default_factory=lambda: readonly(np.zeros(3)))
    sha256: str
    notes: tuple[str, ...] = ()  # assumptions made while reading


def read_arm(path: Path | str, *, base: str | None = None, tip: str | None = None) -> ArmSource:
    """Read the kinematics of an arm from a DH table, YAML, URDF or MJCF file.

    Args:
        path: .csv or .txt (DH table), .yaml or .yml (DH table, a file of `uuv.calib.results`, or
            the calibration of a Universal Robots arm), .urdf, .xml or .mjcf (MuJoCo).
        base: link of a URDF (default: its root) or body of an MJCF (default: arm_base).
        tip: link of a URDF (default: its only leaf) or site of an MJCF (default: tip).

    Returns:
        The arm with its source.

    Raises:
        ConfigurationError: the file cannot be read, or does not describe a serial arm.
    """
    raw = bytes_of(path, "arm")
    file = Path(path)
    suffix = file.suffix.lower()
    digest = hashlib.sha256(raw).hexdigest()

    # Any XML may be a URDF.
    if suffix == ".xml" and b"<robot" in raw[:4000]:
        suffix = ".urdf"

    readers = {
        ".csv": _from_csv,
        ".txt": _from_csv,
        ".yaml": _from_yaml,
        ".yml": _from_yaml,
        ".xml": _from_mjcf,
        ".mjcf": _from_mjcf,
    }

    if suffix not in (*readers, ".urdf"):
        raise ConfigurationError(
            f"arm {file}: ending must be one of {', '.join((*readers, '.urdf'))}, got {suffix!r}"
        )
    if suffix == ".urdf":
        return _from_urdf(file, raw, digest, base, tip)  # XML says its encoding itself

    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"arm {file}: must be a text file in UTF-8") from error

    return readers[suffix](file, text, digest, base, tip)


# DH tables


def _from_csv(file: Path, text: str, digest: str, base: str | None, tip: str | None) -> ArmSource:
    lines = [line.split("#", 1)[0].strip() for line in text.splitlines()]
    cells = [
        re.split(r"\s*[;,\t]\s*" if re.search(r"[;,\t]", line) else r"\s+", line)
        for line in lines
        if line
    ]

    # A first row of words names the columns.
    header: list[str] = []
    try:
        [float(cell) for cell in cells[0]]
    except ValueError:
        header = [cell.lower() for cell in cells[0]]
        cells = cells[1:]

    if not cells:
        raise ConfigurationError(f"arm {file}: must have at least one row, has none")
    columns = header or _COLUMNS[: len(cells[0])]

    rows = []
    for k, row in enumerate(cells, 1):
        if len(row) != len(columns):
            raise ConfigurationError(
                f"arm {file}: row {k} must have {len(columns)} numbers, got {len(row)}"
            )
        rows.append(dict(zip(columns, row, strict=True)))

    return _of_rows(file, "dh", rows, digest, _ArmTable(), base, tip)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Units:
    """Units of a table whose columns state no units."""

    angle: Literal["rad", "deg"] | None = None
    length: Literal["m", "mm"] | None = None


_Row = Mapping[str, float | str] | list[float | str]
_ROW = "theta, d, a, alpha[, beta], by name or in this order"
_ROWS = {
    "schema": {
        "title": f"a list of rows {_ROW}",
        "minItems": 1,
        "items": {
            "title": _ROW,
            "minItems": 4,
            "maxItems": 5,
            "additionalProperties": {"title": "a number, or the word of name or type"},
        },
    }
}
_NAMES = {"schema": {"title": "a list of different names, one for each joint"}}
_LETTERS = "letters r (hinge) and p (slide), one for each joint"
_TYPES = {"schema": {"title": _LETTERS, "pattern": "^[rpRP]+$"}}
_UNITS = {"schema": {"title": "{angle: rad or deg, length: m or mm}"}}


@dataclass(frozen=True, slots=True, kw_only=True)
class _ArmTable:
    """A table and optional further entries of its file; other entries are ignored."""

    dh: list[_Row] | None = field(default=None, metadata=_ROWS)
    joints: list[_Row] | None = field(default=None, metadata=_ROWS)  # another name of `dh`
    units: _Units | None = field(default=None, metadata=_UNITS)
    joint_types: str | None = field(default=None, metadata=_TYPES)
    joint_names: list[str | int] | None = field(default=None, metadata=_NAMES)
    X_base_0: Array | None = None  # (4, 4)
    X_n_flange: Array | None = None  # (4, 4)
    tcp: Array | None = field(default=None, metadata={"schema": {"unit": "m"}})  # (3,)
    limits: list[tuple[float | None, float | None]] | None = None  # null: no limit
    base: str | None = None
    tip: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _UniversalRobot:
    """Calibration as Universal Robots' driver writes it."""

    kinematics: Mapping[str, Any]  # by name, and `hash`


@dataclass(frozen=True, slots=True, kw_only=True)
class _UniversalJoint:
    """Pose of a joint in the one before, [m, rad]."""

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float


_KEYS = tuple(entry.name for entry in fields(_ArmTable))
_READER, _PASSING = TableReader(), TableReader(passes_unknown=True)
_TABLES = ("dh", "joints", "kinematics")


def _from_yaml(file: Path, text: str, digest: str, base: str | None, tip: str | None) -> ArmSource:
    if len(text) > _MOST_BYTES:
        raise ConfigurationError(f"arm {file}: larger than {_MOST_BYTES} bytes")
    document = parsed_yaml(text, f"arm {file}")
    if isinstance(document, list):
        document = {"dh": document}  # only the rows

    try:
        table = _READER.table(document)
        if "kinematics" in table:
            return _of_ur(file, _PASSING.made(_UniversalRobot, table), digest, base, tip)
        arm = _READER.made(_ArmTable, {key: value for key, value in table.items() if key in _KEYS})
    except ConfigurationError as error:
        raise ConfigurationError(f"arm {file}: {error}") from error

    listed = arm.dh or arm.joints
    if listed is None:
        near = [did_you_mean(key, _TABLES) for key in table if key not in _KEYS]
        raise ConfigurationError(
            f"arm {file}: expected a list of rows under 'dh' (theta, d, a, alpha), or UR's "
            f"'kinematics', got {shown(list(table))}{next(filter(None, near), '')}"
        )

    rows: list[dict[str, Any]] = []
    for row in listed:
        named_row = zip(_COLUMNS, row, strict=False) if isinstance(row, list) else row.items()
        rows.append({key.lower(): value for key, value in named_row})

    notes = [
        f"{file.name}: the entry {shown(key)} is ignored{near}"
        for key in table
        if (near := _near(key))
    ]
    return _of_rows(file, "yaml", rows, digest, arm, base, tip, notes)


def _near(key: str) -> str:
    """Hint at the known key that an unknown key resembles."""
    return "" if key in _KEYS else did_you_mean(key, _KEYS)


def _of_rows(
    file: Path,
    kind: Kind,
    rows: list[dict[str, Any]],
    digest: str,
    about: _ArmTable,
    base: str | None,
    tip: str | None,
    notes: Sequence[str] = (),
) -> ArmSource:
    """An arm from rows of named columns; units from the names ("a [mm]"), `about`, or the size."""
    # imported here, since its kernels compile on import; inputs that can be refused are refused
    # before
    from uuv.models.arms.serial_arm import SerialArm

    read = _table_of(file, rows, about.units or _Units())
    table = read.table
    notes = [*notes, *_guessed_angles(file, read)]

    n = len(table)
    letters = about.joint_types or "".join(read.types) or "r" * n
    reach = _extent(file, table, letters)

    # Lengths in millimetres.
    if "length" not in read.stated and reach > _LONGEST:
        notes.append(
            f"{file.name}: lengths look like millimetres (the arm reaches {reach:.4g}), converted "
            "to metres"
        )
        table[:, _LENGTHS] *= 1e-3
        reach *= 1e-3

    # Frames far from the arm.
    if reach < _LONGEST and np.abs(table[:, _LENGTHS]).max() > _DETOUR * reach:
        notes.append(
            f"{file.name}: along nearly parallel axes d up to {np.abs(table[:, 1]).max():.4g} m "
            f"cancel, the arm reaches {reach:.3g} m: the same arm with frames near it is used"
        )
        arm = _near_frames(SerialArm(table=readonly(table), joint_types=letters))
    else:
        arm = SerialArm.from_dh(table[:, :4], letters, beta=table[:, 4], name=f"arm {file}")

    # Base, flange, tool point and names of the joints.
    X_base_0 = checked_pose(_or(about.X_base_0, np.eye(4)), f"arm {file}: X_base_0")
    X_n_flange = checked_pose(_or(about.X_n_flange, np.eye(4)), f"arm {file}: X_n_flange")
    tcp = checked(_or(about.tcp, np.zeros(3)), (3,), f"arm {file}: tcp [m]")
    joint_names = _joint_names(file, about, n)

    names = read.names
    if (
        not joint_names
        and len(names) == n
        and len(set(names)) == n
        and not all(name.isdigit() for name in names)
    ):
        joint_names = tuple(names)

    return ArmSource(
        path=file,
        kind=kind,
        arm=replace(
            arm,
            X_base_0=X_base_0 @ arm.X_base_0,
            X_n_flange=arm.X_n_flange @ X_n_flange,
            limits=_limits(file, about, n),
            joint_names=joint_names,
        ),
        base=base or about.base or "base",
        tip=tip or about.tip or "flange",
        tcp=tcp,
        sha256=digest,
        notes=tuple(notes),
    )


def _or(stated: Array | None, default: Array) -> Array:
    return default if stated is None else stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Table:
    """Rows as read: in rad and m if a unit is stated, else as in the file."""

    table: Array  # (n, 5)
    stated: frozenset[str]  # kinds, of "angle" and "length", with a stated unit
    names: list[str]  # of the joints
    types: list[str]


def _table_of(file: Path, rows: list[dict[str, Any]], units: _Units) -> _Table:
    """The rows of a table; a stated unit also applies to columns of its kind that state none."""
    table = np.zeros((len(rows), len(_COLUMNS)))
    names: list[str] = []
    types: list[str] = []
    units_read: dict[str, set[str]] = {
        kind: {unit} - {None} for kind, unit in asdict(units).items()
    }
    bare = np.zeros(table.shape, dtype=bool)

    for k, row in enumerate(rows):
        filled = set()

        for key, value in row.items():
            word, unit = _word_and_unit(file, k, key)
            if word in ("name", "joint"):
                names.append(str(value))
            elif word in ("type", "joint_type"):
                types.append(str(value).lower()[:1])
            else:
                column = _DH_NAMES[word]
                kind = "length" if column in _LENGTHS else "angle"
                if unit:
                    units_read[kind].add(unit)
                table[k, column] = _figure(file, k, key, value) * _FACTORS.get(unit, 1.0)
                bare[k, column] = not unit
                filled.add(column)

        if missing := {0, 1, 2, 3} - filled:
            lacking = [("theta", "d", "a", "alpha")[i] for i in sorted(missing)]
            raise ConfigurationError(f"arm {file}: row {k + 1} lacks {', '.join(lacking)}")

    if not np.all(np.isfinite(table)):
        raise ConfigurationError(f"arm {file}: every number must be finite")

    # Columns without a unit take the unit of their kind.
    for kind, columns in (("angle", _ANGLES), ("length", _LENGTHS)):
        chosen = getattr(units, kind) or (
            min(units_read[kind]) if len(units_read[kind]) == 1 else ""
        )
        for column in columns:
            table[bare[:, column], column] *= _FACTORS.get(chosen, 1.0)

    return _Table(
        table=table,
        stated=frozenset(kind for kind, symbols in units_read.items() if symbols),
        names=names,
        types=types,
    )


def _word_and_unit(file: Path, k: int, key: str) -> tuple[str, str]:
    """Word of a column's name, and the unit that it states or an empty text."""
    if len(key) > _LONGEST_KEY:
        raise ConfigurationError(f"arm {file}: row {k + 1}: there is no column {shown(key)}")

    word = (
        re.split(r"[\[( ]", key)[0]
        .removesuffix("_deg")
        .removesuffix("_rad")
        .removesuffix("_mm")
        .removesuffix("_m")
    )

    if word not in _DH_NAMES and word not in ("name", "joint", "type", "joint_type"):
        raise ConfigurationError(
            f"arm {file}: unknown column {key!r}; must be one of theta, d, a, alpha, beta, name, "
            "type"
        )

    unit = re.search(r"(deg|rad|mm|m)(?:rees|ians)?[\])]?$", key[len(word) :])
    return word, unit.group(1) if unit else ""


def _figure(file: Path, k: int, key: str, value: float | str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ConfigurationError(
            f"arm {file}: row {k + 1}: {key} must be a number, got {shown(value)}"
        ) from None


def _guessed_angles(file: Path, read: _Table) -> Iterator[str]:
    """Convert angles without a stated unit to radians if they look like degrees, with a note."""
    largest = np.abs(read.table[:, _ANGLES]).max()
    if "angle" not in read.stated and largest > 4.0 * np.pi:
        yield (
            f"{file.name}: angles look like degrees (the largest is {largest:.4g}), converted to "
            "radians"
        )

        read.table[:, _ANGLES] = np.deg2rad(read.table[:, _ANGLES])


def _extent(file: Path, table: Array, letters: str) -> float:
    """Largest distance [unit of the table] of the flange from the base over many postures.

    The lengths themselves do not show the reach: along nearly parallel axes, values of d of
    hundreds of metres cancel.
    """
    from uuv.models.arms.serial_arm import SerialArm

    size = max(float(np.abs(table[:, _LENGTHS]).max()), 1e-300)
    unit = table.copy()
    unit[:, _LENGTHS] /= size  # a table in millimetres must not be refused here

    arm = SerialArm.from_dh(unit[:, :4], letters, beta=unit[:, 4], name=f"arm {file}")
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, len(table)))

    return size * float(
        np.linalg.norm(arm.flange(np.where(arm.slides, 0.0, q))[:, :3, 3], axis=1).max()
    )


def _near_frames(arm: "SerialArm") -> "SerialArm":
    """The same arm, with each frame's origin where its axis is nearest to the previous axis."""
    from uuv.models.arms import kinematics
    from uuv.models.arms.serial_arm import SerialArm

    X = kinematics.frames(arm.table, arm.slides, arm.X_base_0, np.zeros((1, arm.n)))[0]

    axes, points = X[:-1, :3, 2], [X[0, :3, 3]]
    for z, o in zip(axes[1:], X[1:-1, :3, 3], strict=True):
        points.append(o + z * float(z @ (points[-1] - o)))

    return SerialArm.from_axes(axes, points, X[-1] @ arm.X_n_flange, arm.joint_types)


def _joint_names(file: Path, about: _ArmTable, n: int) -> tuple[str, ...]:
    """Validated `joint_names`: as many different words as there are joints, or none."""
    names = tuple(map(str, about.joint_names or ()))

    if about.joint_names is not None and not len(names) == len(set(names)) == n:
        names_got = shown(about.joint_names)
        raise ConfigurationError(
            f"arm {file}: joint_names: must have {n} different names, got {names_got}"
        )

    return names


def _limits(file: Path, about: _ArmTable, n: int) -> Array:
    """Joint limits (n, 2) under `limits`; null is no limit."""
    pairs = about.limits if about.limits is not None else [(None, None)] * n

    if len(pairs) != n:
        raise ConfigurationError(
            f"arm {file}: limits: must have {n} pairs of numbers, got {shown(about.limits)}"
        )

    limits = np.array(pairs, dtype=np.float64)  # of None: NaN
    limits = np.where(np.isnan(limits), [-np.inf, np.inf], limits)

    crossed = np.flatnonzero(~(limits[:, 0] < limits[:, 1]))
    if crossed.size:
        k = int(crossed[0])
        raise ConfigurationError(
            f"arm {file}: limits: the lower limit of joint {k + 1} must be below the upper one, "
            f"got {shown(limits[k])}"
        )

    return readonly(limits)


def _of_ur(
    file: Path, robot: _UniversalRobot, digest: str, base: str | None, tip: str | None
) -> ArmSource:
    """An arm from Universal Robots' calibration, which states pose and z axis of each joint."""
    joints = {
        name: _PASSING.made(_UniversalJoint, entry, f"kinematics.{name}")
        for name, entry in robot.kinematics.items()
        if name != "hash"
    }

    if not joints:
        raise ConfigurationError("kinematics must have joints, has none")

    X = np.eye(4)
    axes = []
    points = []
    for name, joint in joints.items():
        place = f"kinematics.{name}: x, y, z, roll, pitch, yaw"
        figures = checked_place(astuple(joint), (6,), place, urdf_places.LONGEST)
        X = X @ pose(urdf_places.rotation_from_rpy(figures[3:]), figures[:3])
        axes.append(X[:3, 2])
        points.append(X[:3, 3])
    from uuv.models.arms.serial_arm import SerialArm

    return ArmSource(
        path=file,
        kind="yaml",
        arm=replace(SerialArm.from_axes(axes, points, X), joint_names=tuple(joints)),
        base=base or "base",
        tip=tip or "flange",
        sha256=digest,
    )


# URDF


def _from_urdf(file: Path, raw: bytes, digest: str, base: str | None, tip: str | None) -> ArmSource:
    chain = urdf.parse(raw, f"arm {file}").chain(base, tip, ("--base", "--tip"))
    return ArmSource(
        path=file, kind="urdf", arm=chain.arm(), base=chain.base, tip=chain.tip, sha256=digest
    )


# MJCF


def mjcf_arm(file: Path, base: str | None, tip: str | None) -> "tuple[mujoco.MjSpec, SerialArm]":
    """Read the spec and the arm of an MJCF. If some joints have an actuator, joints without one are
    fixed.

    Args:
        file: path.
        base: name of the body whose frame is the base; default `arm_base`.
        tip: name of the site that is the flange; default `tip`.

    Returns:
        The spec, and the arm.

    Raises:
        ConfigurationError: as `uuv.models.files.mjcf_files.read_mjcf` and
            `uuv.models.arms.dh_geometry.read`.
    """
    spec, model = read_mjcf(file, "arm")
    from uuv.models.arms import dh_geometry

    return spec, dh_geometry.read(
        model, base or ARM_BASE_BODY, tip or TIP_SITE, exclude=_passive(model)
    )


def _passive(model: mujoco.MjModel) -> list[str]:
    joints = {
        int(j)
        for j, kind in zip(model.actuator_trnid[:, 0], model.actuator_trntype, strict=True)
        if int(kind) == mujoco.mjtTrn.mjTRN_JOINT
    }

    if not joints:
        return []
    free = mujoco.mjtJoint.mjJNT_FREE

    return [
        model.joint(j).name
        for j in range(model.njnt)
        if j not in joints and int(model.jnt_type[j]) != free
    ]


def _from_mjcf(file: Path, _text: str, digest: str, base: str | None, tip: str | None) -> ArmSource:
    _, arm = mjcf_arm(file, base, tip)
    return ArmSource(
        path=file,
        kind="mjcf",
        arm=arm,
        base=base or ARM_BASE_BODY,
        tip=tip or TIP_SITE,
        sha256=digest,
    )
