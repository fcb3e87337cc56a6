"""Arms from files: a Denavit-Hartenberg table as CSV or YAML, a URDF, an MJCF.

    source = read_arm("arm.urdf", tip="ball_link")
    source.arm, source.tcp, source.joint_names

What a URDF or MJCF says with six numbers a joint becomes rows of four (`calib.arm`); the tip is the flange.
"""

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
import yaml

from calib.arm import Arm
from calib.kernels import ROW
from models.arms import dh_geometry as arm_geometry
from models.mjcf_files import read_mjcf
from models.naming import ARM_BASE_BODY, TIP_SITE
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import bytes_of
from sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    checked_pose,
    exp_so3,
    number,
    pose,
    readonly,
    real_array,
    shown,
)

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
_UNITS = {"angle": ("rad", "deg"), "length": ("m", "mm")}
_LONGEST = 1e4  # [m] or [rad] in a URDF or calibration: more is a slip, or millimetres
_LONGEST_KEY = 60  # characters of a column's name
_DRIVEN = {"revolute": "r", "continuous": "r", "prismatic": "p"}


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmSource:
    """An arm with where it is from."""

    path: Path
    kind: Kind
    arm: Arm
    joint_names: tuple[str, ...]
    base: str  # link or body that the arm's base frame is of
    tip: str  # link or site that the arm's flange is
    tcp: Array  # (3,) [m] tool point in the flange, as the file says; zero if it does not
    limits: Array  # (n, 2) [rad] or [m], infinite where the file has none
    sha256: str
    notes: tuple[str, ...] = ()


def read_arm(path: Path | str, *, base: str | None = None, tip: str | None = None) -> ArmSource:
    """The arm of a file: .csv (DH), .yaml (DH, or what `calib.results` wrote), .urdf, .xml or .mjcf (MuJoCo).

    `base` and `tip` name links of a URDF (default: its root, and its only driven leaf), or a body and a site of an MJCF
    (default: arm_base, tip). Raises ConfigurationError for what cannot be read or is no serial arm.
    """
    raw = bytes_of(path, "arm")
    file = Path(path)
    suffix, digest = file.suffix.lower(), hashlib.sha256(raw).hexdigest()
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
        raise ConfigurationError(f"arm {file}: allowed {', '.join((*readers, '.urdf'))}, got {suffix!r}")
    if suffix == ".urdf":
        return _from_urdf(file, raw, digest, base, tip)  # XML says its encoding itself
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"arm {file}: not a text file in UTF-8") from error
    return readers[suffix](file, text, digest, base, tip)


def of_geometry(geometry: arm_geometry.ArmGeometry) -> Arm:
    """The arm of an MJCF's rows, its tip site as flange, for `calib`."""
    arm = Arm.from_dh(geometry.dh, beta=geometry.beta)
    return _placed(arm, geometry.X_A0, geometry.X_nG)


def to_geometry(arm: Arm, tcp: Array, like: arm_geometry.ArmGeometry) -> arm_geometry.ArmGeometry:
    """The identified `arm`, its tip at `tcp` (3,) [m] in the nominal one, as rows that `arm_geometry.move` takes."""
    X_nG = np.array(arm.X_n_flange)
    X_nG[:3, 3] += X_nG[:3, :3] @ tcp
    return replace(
        like, X_A0=arm.X_base_0, dh=readonly(arm.table[:, :4]), beta=readonly(arm.table[:, 4]), X_nG=readonly(X_nG)
    )


def _placed(arm: Arm, X_base_0: Array, X_n_flange: Array) -> Arm:
    return replace(arm, X_base_0=readonly(X_base_0), X_n_flange=readonly(X_n_flange))


# DH tables


def _from_csv(file: Path, text: str, digest: str, base: str | None, tip: str | None) -> ArmSource:
    lines = [line.split("#", 1)[0].strip() for line in text.splitlines()]
    cells = [re.split(r"\s*[;,\t]\s*" if re.search(r"[;,\t]", line) else r"\s+", line) for line in lines if line]
    header: list[str] = []
    try:
        [float(cell) for cell in cells[0]]
    except ValueError:
        header, cells = [cell.lower() for cell in cells[0]], cells[1:]
    if not cells:
        raise ConfigurationError(f"arm {file}: holds no rows")
    columns = header or ["theta", "d", "a", "alpha", "beta"][: len(cells[0])]
    rows = []
    for k, row in enumerate(cells, 1):
        if len(row) != len(columns):
            raise ConfigurationError(f"arm {file}: row {k} has {len(row)} numbers, {len(columns)} expected")
        rows.append(dict(zip(columns, row, strict=True)))
    return _of_rows(file, "dh", rows, digest, {}, base, tip)


def _from_yaml(file: Path, text: str, digest: str, base: str | None, tip: str | None) -> ArmSource:
    try:
        document = yaml.safe_load(text)
    except RecursionError as error:
        raise ConfigurationError(f"arm {file}: no YAML of an arm: brackets within brackets, too deep") from error
    except Exception as error:  # its constructors of dates and numbers raise ValueError and others
        raise ConfigurationError(f"arm {file}: no YAML ({' '.join(str(error).split())[:120]})") from error
    if isinstance(document, Mapping) and "kinematics" in document:
        return _of_ur(file, document["kinematics"], digest, base, tip)
    if isinstance(document, Mapping):
        found = next((document[key] for key in ("dh", "joints") if key in document), None)
        about = document
    else:
        found, about = document, {}
    if not isinstance(found, Sequence) or isinstance(found, str) or not found:
        raise ConfigurationError(
            f"arm {file}: expected a list of rows under 'dh' (theta, d, a, alpha), or UR's 'kinematics'"
        )
    names = ["theta", "d", "a", "alpha", "beta"]
    rows = []
    for k, row in enumerate(found, 1):
        if isinstance(row, Mapping):
            rows.append({str(key).lower(): value for key, value in row.items()})
        elif isinstance(row, Sequence) and not isinstance(row, str) and len(row) in (4, 5):
            rows.append(dict(zip(names, row, strict=False)))
        else:
            raise ConfigurationError(f"arm {file}: row {k}: expected theta, d, a, alpha[, beta], got {shown(row)}")
    return _of_rows(file, "yaml", rows, digest, about, base, tip)


def _of_rows(
    file: Path,
    kind: Kind,
    rows: list[dict[str, Any]],
    digest: str,
    about: Mapping[str, Any],
    base: str | None,
    tip: str | None,
) -> ArmSource:
    """An arm of rows given by name; units from the names ("alpha_deg", "d [mm]"), from `about`, or from the size."""
    notes: list[str] = []
    table = np.zeros((len(rows), ROW))
    stated = {"angle": "", "length": ""}
    units = about.get("units") or {}
    if not isinstance(units, Mapping) or any(value not in _UNITS.get(key, ()) for key, value in units.items()):
        raise ConfigurationError(
            f"arm {file}: units: allowed {{angle: rad or deg, length: m or mm}}, got {shown(units)}"
        )
    stated |= units
    names, types = [], []
    for k, row in enumerate(rows):
        seen = set()
        for key, value in row.items():
            if len(key) > _LONGEST_KEY:
                raise ConfigurationError(f"arm {file}: row {k + 1}: no column is called {shown(key)}")
            word = re.split(r"[\[( ]", key)[0].removesuffix("_deg").removesuffix("_rad").removesuffix("_mm")
            word = word.removesuffix("_m")
            if word in ("name", "joint"):
                names.append(str(value))
                continue
            if word in ("type", "joint_type"):
                types.append(str(value).lower()[:1])
                continue
            if word not in _DH_NAMES:
                raise ConfigurationError(
                    f"arm {file}: unknown column {key!r}; allowed theta, d, a, alpha, beta, name, type"
                )
            unit = re.search(r"(deg|rad|mm|m)(?:rees|ians)?[\])]?$", key[len(word) :])
            column = _DH_NAMES[word]
            try:
                figure = float(value) if isinstance(value, str) else number(value, key)
            except ValueError:
                raise ConfigurationError(
                    f"arm {file}: row {k + 1}: {key} must be a number, got {shown(value)}"
                ) from None
            said = unit.group(1) if unit else stated["length" if column in (1, 2) else "angle"]
            table[k, column] = figure * {"deg": np.pi / 180.0, "mm": 1e-3}.get(said, 1.0)
            seen.add((column, said))
        missing = {0, 1, 2, 3} - {column for column, _ in seen}
        if missing:
            lacking = [("theta", "d", "a", "alpha")[i] for i in sorted(missing)]
            raise ConfigurationError(f"arm {file}: row {k + 1} lacks {', '.join(lacking)}")
    if not np.all(np.isfinite(table)):
        raise ConfigurationError(f"arm {file}: every number must be finite")
    angles, lengths = np.abs(table[:, [0, 3, 4]]).max(), np.abs(table[:, [1, 2]]).max()
    if angles > 4.0 * np.pi:
        notes.append(f"{file.name}: angles look like degrees (the largest is {angles:.4g}), turned into radians")
        table[:, [0, 3, 4]] = np.deg2rad(table[:, [0, 3, 4]])
    if lengths > 50.0:
        notes.append(f"{file.name}: lengths look like millimetres (the largest is {lengths:.4g}), turned into metres")
        table[:, [1, 2]] *= 1e-3
    n = len(table)
    letters = str(about.get("joint_types") or "".join(types) or "r" * n)
    arm = Arm.from_dh(table[:, :4], letters, beta=table[:, 4])
    X_base_0 = checked_pose(about.get("X_base_0", np.eye(4)), f"arm {file}: X_base_0")
    X_n_flange = checked_pose(about.get("X_n_flange", np.eye(4)), f"arm {file}: X_n_flange")
    joint_names = _joint_names(file, about, n)
    if not joint_names and len(names) == n and len(set(names)) == n and not all(name.isdigit() for name in names):
        joint_names = tuple(names)
    return ArmSource(
        path=file,
        kind=kind,
        arm=_placed(arm, X_base_0, X_n_flange),
        joint_names=joint_names or tuple(f"joint{k + 1}" for k in range(n)),
        base=base or str(about.get("base", "base")),
        tip=tip or str(about.get("tip", "flange")),
        tcp=checked(about.get("tcp", np.zeros(3)), (3,), f"arm {file}: tcp"),
        limits=_limits(file, about, n),
        sha256=digest,
        notes=tuple(notes),
    )


def _joint_names(file: Path, about: Mapping[str, Any], n: int) -> tuple[str, ...]:
    """`joint_names`: as many different words as there are joints, or none."""
    given = about.get("joint_names")
    if given is None:
        return ()
    words = isinstance(given, Sequence) and not isinstance(given, str)
    if not words or len(given) != n or len({str(name) for name in given}) != n:
        raise ConfigurationError(f"arm {file}: joint_names: {n} different names, got {shown(given)}")
    return tuple(str(name) for name in given)


def _limits(file: Path, about: Mapping[str, Any], n: int) -> Array:
    """Joint limits (n, 2) under `limits`; null is no limit."""
    if about.get("limits") is None:
        return readonly(np.tile([-np.inf, np.inf], (n, 1)))
    found = real_array(about["limits"], f"arm {file}: limits", f"{n} pairs of numbers")  # None becomes NaN
    if found.shape != (n, 2):
        raise ConfigurationError(f"arm {file}: limits: {n} pairs of numbers, got shape {found.shape}")
    found = np.where(np.isnan(found), [-np.inf, np.inf], found)
    crossed = np.flatnonzero(~(found[:, 0] < found[:, 1]))
    if crossed.size:
        k = int(crossed[0])
        raise ConfigurationError(f"arm {file}: limits: those of joint {k + 1} must rise, got {shown(found[k])}")
    return readonly(found)


def _of_ur(file: Path, joints: Any, digest: str, base: str | None, tip: str | None) -> ArmSource:
    """Universal Robots' calibration: x, y, z, roll, pitch, yaw of each joint, its axis z."""
    if not isinstance(joints, Mapping):
        raise ConfigurationError(f"arm {file}: kinematics: expected joints with x, y, z, roll, pitch, yaw")
    X, axes, points, names = np.eye(4), [], [], []
    for name, values in joints.items():
        if name == "hash":
            continue
        try:
            given = [float(values[key]) for key in ("x", "y", "z", "roll", "pitch", "yaw")]
        except (TypeError, KeyError, ValueError, OverflowError) as error:
            raise ConfigurationError(f"arm {file}: {shown(name)}: expected x, y, z, roll, pitch, yaw") from error
        figures = checked_place(given, (6,), f"arm {file}: {shown(name)}: x, y, z, roll, pitch, yaw", _LONGEST)
        X = X @ pose(_rpy(figures[3:]), figures[:3])
        axes.append(X[:3, 2])
        points.append(X[:3, 3])
        names.append(str(name))
    if not axes:
        raise ConfigurationError(f"arm {file}: kinematics holds no joints")
    n = len(axes)
    return ArmSource(
        path=file,
        kind="yaml",
        arm=Arm.from_axes(axes, points, X),
        joint_names=tuple(names),
        base=base or "base",
        tip=tip or "flange",
        tcp=readonly(np.zeros(3)),
        limits=readonly(np.tile([-np.inf, np.inf], (n, 1))),
        sha256=digest,
    )


# URDF


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UrdfChain:
    """The joints of a URDF from one link to another, at zero."""

    joints: tuple[ET.Element, ...]  # base to tip, fixed ones too
    X_parent_child: tuple[Array, ...]  # (4, 4) of each

    @property
    def driven(self) -> tuple[int, ...]:
        """Places of the joints that move."""
        return tuple(i for i, joint in enumerate(self.joints) if joint.get("type") in _DRIVEN)

    @property
    def X_base_child(self) -> list[Array]:
        """The link after each joint in the base link (4, 4), at zero."""
        X, out = np.eye(4), []
        for step in self.X_parent_child:
            X = X @ step
            out.append(X)
        return out


def urdf_chain(root: ET.Element, file: Path, base: str | None, tip: str | None) -> UrdfChain:
    """The chain between two links of a URDF; by default its root and its only leaf."""
    joints = {child.get("link"): joint for joint in root.iter("joint") if (child := joint.find("child")) is not None}
    links = [str(link.get("name")) for link in root.iter("link")]
    if not links:
        raise ConfigurationError(f"arm {file}: the URDF has no links")
    for name, word in ((base, "base"), (tip, "tip")):
        if name is not None and name not in links:
            raise ConfigurationError(f"--{word}: the URDF has no link {name!r}; it has {', '.join(links)}")
    if tip is None:
        parents = {up.get("link") for joint in joints.values() if (up := joint.find("parent")) is not None}
        leaves = [link for link in links if link not in parents and link in joints]
        if len(leaves) != 1:
            raise ConfigurationError(f"arm {file}: --tip: which link touches? the leaves are {', '.join(leaves)}")
        tip = leaves[0]
    path: list[ET.Element] = []
    link: str | None = tip
    while link != base and link in joints:
        joint = joints[link]
        parent = joint.find("parent")
        if parent is None or joint in path:
            raise ConfigurationError(
                f"arm {file}: joint {joint.get('name')!r} has no parent, or the tree closes on itself"
            )
        path.insert(0, joint)
        link = parent.get("link")
    if base is not None and link != base:
        raise ConfigurationError(f"arm {file}: link {tip!r} is not carried by link {base!r}")
    for joint in path:
        if joint.get("type") not in (*_DRIVEN, "fixed") or joint.find("mimic") is not None:
            raise ConfigurationError(
                f"arm {file}: joint {joint.get('name')!r} between base and tip is "
                f"{'a mimic' if joint.find('mimic') is not None else joint.get('type')}; allowed revolute, continuous, "
                "prismatic, fixed"
            )
    chain = UrdfChain(joints=tuple(path), X_parent_child=tuple(_origin(joint, file) for joint in path))
    if not chain.driven:
        raise ConfigurationError(f"arm {file}: no driven joint on the way to link {tip!r}")
    return chain


def _from_urdf(file: Path, raw: bytes, digest: str, base: str | None, tip: str | None) -> ArmSource:
    try:
        root = ET.fromstring(raw)
    except (ET.ParseError, ValueError, LookupError) as error:  # the latter two of encodings it does not know
        raise ConfigurationError(f"arm {file}: no XML ({error})") from error
    chain = urdf_chain(root, file, base, tip)
    X = chain.X_base_child
    axes, points, types, names, limits = [], [], "", [], []
    for i in chain.driven:
        joint = chain.joints[i]
        element = joint.find("axis")
        axis = _numbers(element.get("xyz") if element is not None else None, (1.0, 0.0, 0.0), file, joint)
        if not np.linalg.norm(axis) > 0.0:
            raise ConfigurationError(f"arm {file}: joint {joint.get('name')!r}: its axis has no length")
        axes.append(X[i][:3, :3] @ axis)
        points.append(X[i][:3, 3])
        types += _DRIVEN[str(joint.get("type"))]
        names.append(str(joint.get("name")))
        limits.append(_urdf_limits(joint, file))
    first, last = chain.joints[0].find("parent"), chain.joints[-1].find("child")
    assert first is not None
    assert last is not None
    return ArmSource(
        path=file,
        kind="urdf",
        arm=Arm.from_axes(axes, points, X[-1], types),
        joint_names=tuple(names),
        base=str(first.get("link")),
        tip=str(last.get("link")),
        tcp=readonly(np.zeros(3)),
        limits=readonly(np.array(limits)),
        sha256=digest,
    )


def _urdf_limits(joint: ET.Element, file: Path) -> tuple[float, float]:
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return -np.inf, np.inf
    try:
        lower, upper = float(limit.get("lower", "-inf")), float(limit.get("upper", "inf"))
    except ValueError as error:
        raise ConfigurationError(f"arm {file}: joint {joint.get('name')!r}: limits must be numbers") from error
    return (lower, upper) if lower < upper else (-np.inf, np.inf)


def _origin(joint: ET.Element, file: Path) -> Array:
    element = joint.find("origin")
    if element is None:
        return np.eye(4)
    p = _numbers(element.get("xyz"), (0.0, 0.0, 0.0), file, joint)
    return pose(_rpy(_numbers(element.get("rpy"), (0.0, 0.0, 0.0), file, joint)), p)


def _numbers(text: str | None, default: tuple[float, float, float], file: Path, joint: ET.Element) -> Array:
    if text is None:
        return np.array(default)
    try:
        values = [float(word) for word in text.split()]
        return checked_place(values, (3,), f"arm {file}: joint {joint.get('name')!r}", _LONGEST)
    except ConfigurationError:
        raise
    except ValueError as error:
        raise ConfigurationError(
            f"arm {file}: joint {joint.get('name')!r}: three numbers, got {shown(text)}"
        ) from error


def _rpy(angles: Sequence[float] | Array) -> Array:
    """URDF's roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = angles
    return exp_so3([0.0, 0.0, yaw]) @ exp_so3([0.0, pitch, 0.0]) @ exp_so3([roll, 0.0, 0.0])


# MJCF


def mjcf_geometry(file: Path, base: str | None, tip: str | None) -> tuple[mujoco.MjSpec, arm_geometry.ArmGeometry]:
    """Spec and arm of an MJCF; joints without actuator (springs, pads) stay out of it if others have one."""
    spec, model = read_mjcf(file, "arm")
    return spec, arm_geometry.read(model, base or ARM_BASE_BODY, tip or TIP_SITE, exclude=_passive(model))


def _passive(model: mujoco.MjModel) -> list[str]:
    joints = {
        int(j)
        for j, kind in zip(model.actuator_trnid[:, 0], model.actuator_trntype, strict=True)
        if int(kind) == mujoco.mjtTrn.mjTRN_JOINT
    }
    if not joints:
        return []
    free = mujoco.mjtJoint.mjJNT_FREE
    return [model.joint(j).name for j in range(model.njnt) if j not in joints and int(model.jnt_type[j]) != free]


def _from_mjcf(file: Path, _text: str, digest: str, base: str | None, tip: str | None) -> ArmSource:
    _, geometry = mjcf_geometry(file, base, tip)
    return ArmSource(
        path=file,
        kind="mjcf",
        arm=of_geometry(geometry),
        joint_names=geometry.joint_names,
        base=geometry.base_body,
        tip=tip or TIP_SITE,
        tcp=readonly(np.zeros(3)),
        limits=geometry.limits,
        sha256=digest,
    )
