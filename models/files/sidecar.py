"""Hydrodynamic data of a vehicle without Python, as YAML beside the MJCF or as elements within it.

    attach_beside(spec, "rov.xml")  # rov.water.yaml, or elements <numeric name="water/..." ...>
    write_sidecar(spec, "rov.water.yaml")
    text = xml_with_elements(spec)

Both hold the same tree. Its names are those of the Python API, and its numbers are not rounded:

    water_density: 1025.0
    bodies:
      hull:
        volume: 0.03
        added_mass: [15, 20, 25, 0.4, 0.8, 0.9]
        quadratic_damping: [30, 60, 80, 1, 2, 3]
      link1: {cylinder: {radius: 0.03, start: [0.0, 0.0, 0.0], end: [0.3, 0.0, 0.0]}}
    thrusters:
      bow: {forward: 50.0, reverse: 40.0, time_constant: 0.1}
      stern: {t200: {handedness: -1}}

The name of a custom element is the path of one number, or of one row of numbers:
`water/hull/volume`, `water/link1/cylinder/radius`, `water/hull/strips/0/start`,
`water/water_density`, `thruster/bow/forward`.
"""

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.files.exact_mjcf import exact_xml
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.water import thrusters
from uuv.models.water.bounds import LARGEST
from uuv.models.water.forms import (
    CrossTerms,
    FadingDamping,
    Form,
    LiftDrag,
    MunkFactor,
    PlanarStrip,
)
from uuv.models.water.native_mark import without_mark
from uuv.models.water.thrusters import Thruster
from uuv.sim.interfaces.documents import checked, inside, named, yaml_of, yaml_text
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array, shown
from uuv.sim.interfaces.tables import Table, TableReader, WithFields

ENDING: Final = ".water.yaml"  # replaces the MJCF's own ending
_WATER, _THRUSTER = hydrodynamics.ELEMENTS
_DENSITY: Final = "water_density"
_TWICE: Final = "in user data or stated twice"
_MOST = 500  # largest number of entries of a list
_MOST_BYTES = 1_000_000  # largest size of a file
_LARGEST_EXACT = 2.0**53  # larger whole numbers are not exact in a double

SHAPES: Final[dict[str, Callable[..., BodyHydrodynamics]]] = {
    "sphere": hydrodynamics.sphere,
    "ellipsoid": hydrodynamics.ellipsoid,
    "box": hydrodynamics.box,
    "cylinder": hydrodynamics.cylinder,
}
_THRUSTER_MAKERS: Final[dict[str, Callable[..., Thruster]]] = {
    "t200": thrusters.t200,
    "from_table": WithFields(thrusters.from_table, Thruster),
    "of_table": WithFields(Thruster.of_table, Thruster),
    "of_polynomial": WithFields(Thruster.of_polynomial, Thruster),
}
_FORM_MAKERS: Final[dict[str, Callable[..., Form]]] = {
    "munk_factor": MunkFactor,
    "fading_damping": FadingDamping,
    "lift_drag": LiftDrag,
    "wing": WithFields(LiftDrag.of_wing, LiftDrag),
    "cross_terms": CrossTerms,
    "planar_strip": PlanarStrip,
}
_FORM_NAMES: Final = {maker: name for name, maker in _FORM_MAKERS.items()}
_BODY_FIELDS: Final = tuple(entry.name for entry in fields(BodyHydrodynamics))
_ROWS: Final = ("ahead", "astern", "command", "thrust")  # largest number of points of a curve
_PAIRS: Final = ("polynomial", "table")  # largest number of rows
_ELEMENT_NAMES: Final = (_WATER.rstrip("/"), _THRUSTER.rstrip("/"))
_UPPER: Final = np.triu_indices(6)


def beside(mjcf: str | Path) -> Path:
    """Name of the sidecar of an MJCF file: `rov.water.yaml` for `rov.xml`."""
    path = Path(mjcf)
    return path.with_name(path.stem + ENDING)


def attach_beside(
    spec: mujoco.MjSpec,
    mjcf: str | Path,
    sidecar: str | Path | None = None,
    of_file: Mapping[str, Any] | None = None,
) -> None:
    """Attach the custom elements of `spec` and its sidecar; the elements are removed from the spec.

    Args:
        spec: as read from `mjcf`, changed in place.
        mjcf: MJCF file of the spec.
        sidecar: YAML file; by default the one `beside` the MJCF, if there is one.
        of_file: tree of water that the file states in another form; bodies and the density of the
            sidecar replace those of this tree.

    Raises:
        ConfigurationError: a file cannot be read, a name is unknown, a number is wrong, or water is
            stated twice.
    """
    in_file = elements_of(spec)
    file = beside(mjcf) if sidecar is None else Path(sidecar)
    if of_file:
        stated = read_sidecar(file) if sidecar is not None or file.is_file() else {}
        kept = {
            name: body
            for name, body in of_file["bodies"].items()
            if name not in stated.get("bodies", {})
        }
        attach_tree(spec, {**_with_density_of(stated, of_file), "bodies": kept}, str(mjcf))

    # Two sources may complete each other, but not state the same part.
    if sidecar is not None or file.is_file():
        in_sidecar = read_sidecar(file)
        what = named(file, "water file")
        for section in ("bodies", "thrusters"):
            if twice := sorted(set(in_file.get(section, {})) & set(in_sidecar.get(section, {}))):
                both = f"{section} {', '.join(twice)}"
                raise ConfigurationError(
                    f"{what}: {both} are also stated by custom elements of the MJCF; state each "
                    "once"
                )
        if _DENSITY in in_file and _DENSITY in in_sidecar:
            raise ConfigurationError(
                f"{what}: {_DENSITY} is also stated by a custom element of the MJCF; state it once"
            )
        if in_file:
            attach_tree(spec, _with_density_of(in_sidecar, in_file), "MJCF", _ELEMENT_NAMES)
        attach_tree(spec, _with_density_of(in_file, in_sidecar), what)
    else:
        attach_tree(spec, in_file, "MJCF", _ELEMENT_NAMES)

    for element in [part for part in spec.numerics if part.name.startswith(hydrodynamics.ELEMENTS)]:
        spec.delete(element)


def read_sidecar(file: str | Path) -> dict[str, Any]:
    """Tree of a sidecar, with the sections `water_density`, `bodies` and `thrusters`.

    Raises:
        ConfigurationError: the file cannot be read, is not YAML, or has an unknown section.
    """
    return checked_tree(yaml_of(file, "water file", _MOST_BYTES), named(file, "water file"))


def checked_tree(document: Any, what: str) -> dict[str, Any]:
    """`document` as a tree with known sections; `what` begins error messages.

    Raises:
        ConfigurationError: the document is not a mapping, has an unknown section, or has a number
            that is NaN.
    """
    try:
        _READER.made(_Sections, checked(document))
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from error
    return dict(document)


def elements_of(spec: mujoco.MjSpec) -> dict[str, Any]:
    """Tree, as that of a sidecar, of a spec's custom elements `water/...` and `thruster/...`.

    Raises:
        ConfigurationError: a name refers to no body or actuator, or contradicts another name.
    """
    bodies = [body.name for body in spec.bodies[1:]]
    actuators = [actuator.name for actuator in spec.actuators]
    tree: dict[str, Any] = {}
    for element in spec.numerics:
        name = str(element.name)
        numbers = [float(x) for x in element.data]
        content: Any = checked(
            numbers[0] if len(numbers) == 1 else numbers, f"custom element {name!r}"
        )

        if name == _WATER + _DENSITY:
            tree[_DENSITY] = content
        elif name.startswith(_WATER):
            _put(tree, ["bodies", *_path(name, _WATER, bodies, "body")], content, name)
        elif name.startswith(_THRUSTER):
            _put(tree, ["thrusters", *_path(name, _THRUSTER, actuators, "actuator")], content, name)

    return {
        section: _of_owners(branch) if isinstance(branch, dict) else branch
        for section, branch in tree.items()
    }


def attach_tree(
    spec: mujoco.MjSpec,
    tree: Mapping[str, Any],
    what: str,
    names: tuple[str, str] = ("bodies", "thrusters"),
) -> None:
    """Attach the water and thrusters of a tree to `spec`.

    Args:
        spec: changed in place.
        tree: as `read_sidecar` or `elements_of` returns.
        what: first words of error messages.
        names: names of the two sections in messages.

    Raises:
        ConfigurationError: a body, actuator or field is unknown, a number is wrong, or the user
            data holds water already.
    """
    try:
        sections = _READER.made(_Sections, tree)
        bodies = {body.name: body for body in spec.bodies[1:] if body.name}
        actuators = {actuator.name: actuator for actuator in spec.actuators if actuator.name}
        _check_names(sections.bodies, bodies, "body")
        _check_names(sections.thrusters, actuators, "actuator")

        # All water and thrusters are read before any of them is written.
        wet = {}
        driven = {}
        for name, entry in sections.bodies.items():
            if hydrodynamics.carries(bodies[name].userdata):
                raise ConfigurationError(f"body {name!r} has hydrodynamic data already, {_TWICE}")
            wet[name] = _body_of(entry, inside(names[0], name), sections.water_density)
        for name, entry in sections.thrusters.items():
            if thrusters.carries(np.array(actuators[name].userdata)):
                raise ConfigurationError(f"thruster {name!r} has a table already, {_TWICE}")
            driven[name] = _READER.made(Thruster, entry, inside(names[1], name))

        if wet or sections.water_density is not None:
            hydrodynamics.attach(spec, wet, sections.water_density)
        if driven:
            thrusters.attach(spec, driven)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from error


def tree_of(spec: mujoco.MjSpec) -> dict[str, Any]:
    """Tree of the water and thrusters of `spec`; reading it gives the same numbers to the last bit.

    Raises:
        ConfigurationError: the spec has no hydrodynamics, or a wet body or thruster has no name.
    """
    wet = hydrodynamics.attached(spec)
    if not wet:
        raise ConfigurationError(
            "this spec has no hydrodynamics; call uuv.models.hydrodynamics.attach first"
        )

    driven = {
        actuator.name: thrusters.unpack(np.array(actuator.userdata))
        for actuator in spec.actuators
        if thrusters.carries(np.array(actuator.userdata))
    }
    if "" in wet or "" in driven:
        raise ConfigurationError(
            "water: every wet body and thruster must have a name to be written"
        )

    tree: dict[str, Any] = {
        _DENSITY: hydrodynamics.density_of(spec),
        "bodies": {name: _written(body) for name, body in wet.items()},
    }
    if driven:
        tree["thrusters"] = {name: _written(thruster) for name, thruster in driven.items()}

    return tree


def write_sidecar(spec: mujoco.MjSpec, file: str | Path) -> Path:
    """Write the water and thrusters of `spec` as YAML, to be used with its `xml_without_water`.

    Returns:
        The file.

    Raises:
        ConfigurationError: as `tree_of` does, or the file cannot be written.
    """
    path = Path(file)
    text = yaml_text(tree_of(spec), width=120)

    # A disk that is full midway leaves the old file as it was.
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        try:
            part.write_text(text, encoding="utf-8")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"water file {shown(str(path))}: cannot be written ({error.strerror})"
        ) from error
    return path


def xml_with_elements(spec: mujoco.MjSpec) -> str:
    """MJCF of `spec` with its water and thrusters in custom elements, which keep every digit.

    Raises:
        ConfigurationError: as `tree_of` does.
    """
    tree = tree_of(spec)
    lines = [_numeric(_WATER + _DENSITY, [tree[_DENSITY]])]
    for section, prefix in (("bodies", _WATER), ("thrusters", _THRUSTER)):
        lines += [
            _numeric(prefix + name, numbers) for name, numbers in _leaves(tree.get(section, {}))
        ]

    head, end, _ = _bare_xml(spec).rpartition("</mujoco>")
    return (
        f"{head}  <custom>\n" + "".join(f"    {line}\n" for line in lines) + f"  </custom>\n{end}\n"
    )


def xml_without_water(spec: mujoco.MjSpec) -> str:
    """MJCF of `spec` without the user data of its water and thrusters, to be used with a sidecar.

    Reaction torques of the thrusters are removed from the gears; they are added again when the
    thrusters are read. MuJoCo alone can load this file as the vehicle in air.
    """
    return without_mark(_bare_xml(spec))


def _bare_xml(spec: mujoco.MjSpec) -> str:
    bare = spec.copy()
    for body in bare.bodies:
        if hydrodynamics.carries(body.userdata):
            body.userdata = []
    for actuator in bare.actuators:
        if thrusters.carries(np.array(actuator.userdata)):
            thrusters.detach(actuator)
            actuator.gear[3:] = 0.0

    bare.nuser_body = max([len(body.userdata) for body in bare.bodies] or [0])
    bare.nuser_actuator = max([len(actuator.userdata) for actuator in bare.actuators] or [0])
    return exact_xml(bare)


# -- reading ---------------------------------------------------------------------------------------


def _with_density_of(other: Mapping[str, Any], tree: Mapping[str, Any]) -> dict[str, Any]:
    """`tree` with the density of water that `other` states, because shapes need that density."""
    return {**({_DENSITY: other[_DENSITY]} if _DENSITY in other else {}), **tree}


def _path(name: str, prefix: str, known: list[str], what: str) -> list[str]:
    """Body or actuator of an element, and the names behind it. A body's name may contain
    slashes.
    """
    rest = name.removeprefix(prefix)
    owners = [candidate for candidate in known if candidate and rest.startswith(candidate + "/")]
    if not owners:
        first = rest.partition("/")[0]
        raise ConfigurationError(
            f"custom element {name!r}: there is no {what} {first!r} with a field behind its "
            f"name{did_you_mean(first, known)}"
        )

    owner = max(owners, key=len)
    return [owner, *rest[len(owner) + 1 :].split("/")]


def _put(tree: dict[str, Any], path: list[str], value: Any, name: str) -> None:
    for step in path[:-1]:
        tree = tree.setdefault(step, {})
        if not isinstance(tree, dict):
            raise ConfigurationError(
                f"custom element {name!r}: {step!r} is a number in another element, so it has no "
                "parts"
            )
    if path[-1] in tree:
        raise ConfigurationError(
            f"custom element {name!r}: stated twice, as a number and as a group of numbers"
        )
    tree[path[-1]] = value


def _of_owners(branch: dict[str, Any]) -> dict[str, Any]:
    """`_with_lists` of the entries below each body or actuator, whose name may be 0 or 1."""
    return {owner: _with_lists(entry) for owner, entry in branch.items()}


def _with_lists(branch: Any) -> Any:
    """`branch`, with mappings of 0, 1, 2, ... turned into lists."""
    if not isinstance(branch, dict):
        return branch
    if set(branch) == {str(k) for k in range(len(branch))}:
        return [_with_lists(branch[str(k)]) for k in range(len(branch))]
    return {key: _with_lists(value) for key, value in branch.items()}


_OF_DENSITY: Final = {"schema": {"unit": "kg/m^3", "exclusiveMinimum": 0, "maximum": LARGEST}}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sections:
    """A tree whose entries of bodies and actuators are read once the model is known to have
    these.
    """

    water_density: float | None = field(default=None, metadata=_OF_DENSITY)
    bodies: Mapping[str, Any] = field(default_factory=dict)
    thrusters: Mapping[str, Any] = field(default_factory=dict)


def _check_names(entries: Mapping[str, Any], known: Mapping[str, Any], kind: str) -> None:
    for name in entries:
        if name not in known:
            near = did_you_mean(name, known) or f"; there are {', '.join(known)}"
            raise ConfigurationError(f"unknown {kind} {shown(name)}{near}")


def _body_of(entry: Any, where: str, water_density: float | None) -> BodyHydrodynamics:
    """Coefficients of a body's entry: a shape, and fields of BodyHydrodynamics that replace those
    of the shape.

    Args:
        entry: table of names with their numbers.
        where: place of the table.
        water_density: [kg/m^3] for a shape that states no density; None: the default of the shape's
            function.

    Raises:
        ConfigurationError: a name is unknown or a number is wrong.
    """
    entry = _spelt_out(_READER.table(entry, where), where)
    _READER.check_keys(entry, (*_BODY_FIELDS, *SHAPES), where)
    shapes = [name for name in entry if name in SHAPES]
    if len(shapes) > 1:
        raise ConfigurationError(f"{where}: must have one shape, got {' and '.join(shapes)}")
    if not shapes and "volume" not in entry:
        raise ConfigurationError(f"{where}: volume or a shape ({', '.join(SHAPES)}) is missing")

    # Fields of the body; for a matrix the diagonal suffices.
    stated = {name: figure for name, figure in entry.items() if name not in SHAPES}
    for name in ("added_mass", "linear_damping"):
        if name in stated:
            alone = {name: stated[name]}
            numbers = _READER.values(BodyHydrodynamics, alone, where, complete=False)[name]
            stated[name] = _square(numbers, name == "added_mass", inside(where, name)).tolist()
    if not shapes:
        return _READER.made(BodyHydrodynamics, stated, where)

    # Coefficients of the shape; the fields replace them.
    shape = shapes[0]
    path = inside(where, shape)
    density = {} if water_density is None else {_DENSITY: water_density}
    body = _READER.made(SHAPES[shape], {**density, **_READER.table(entry[shape], path)}, path)
    try:
        return replace(body, **_READER.values(BodyHydrodynamics, stated, where, complete=False))
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from error


def water_kind(kind: Any, table: Table, where: str) -> tuple[Any, Table, str]:
    """Class or function that builds a form or a thruster from a table (`tables.Chooser`); other
    kinds are built by their own class.

    A form has one key, its name, with the fields below it. A thruster has one key `t200`,
    `from_table`, `of_table` or `of_polynomial` with the fields below it, or the fields of Thruster.

    Raises:
        ConfigurationError: the form is unknown, or a thruster has other fields besides such a key.
    """
    # A form has one key with its fields below.
    if kind is Form:
        _READER.check_keys(table, _FORM_MAKERS, where)
        if len(table) != 1:
            known = ", ".join(_FORM_MAKERS)
            raise ConfigurationError(f"{where}: must be one of {known}, got {shown(list(table))}")
        ((name, entry),) = table.items()
        return _FORM_MAKERS[name], entry, inside(where, name)
    if kind is not Thruster:
        return kind, table, where

    # A thruster has a key that selects how it is built, or the fields of Thruster.
    makers = [name for name in table if name in _THRUSTER_MAKERS]
    if makers and len(table) > 1:
        got = ", ".join(table)
        raise ConfigurationError(
            f"{where}: {makers[0]} must be the only key, with the other fields below it, got {got}"
        )
    if makers:
        entry = {} if table[makers[0]] is None else table[makers[0]]  # only `t200:`, without fields
        return _THRUSTER_MAKERS[makers[0]], _spelt_out(entry, where), inside(where, makers[0])

    field_names = [entry.name for entry in fields(Thruster)]
    _READER.check_keys(table, (*field_names, *_THRUSTER_MAKERS), where)
    return Thruster, _spelt_out(table, where), where


_READER: Final = TableReader(choose=water_kind, places_faults=True)


def _spelt_out(value: Any, where: str) -> Any:
    """`value` of a document, converted to the type of its field.

    A custom element cannot state a whole number, or a row of one number. Therefore 5.0 is converted
    to 5, and a single number to a row of a curve.
    """
    if isinstance(value, Mapping):
        tree = {key: _spelt_out(entry, inside(where, key)) for key, entry in value.items()}
        tree |= {key: _row(tree[key]) for key in _ROWS if key in tree}
        pairs = {key: _row(tree[key]) for key in _PAIRS if key in tree}
        return tree | {key: [_row(row) for row in rows] for key, rows in pairs.items()}

    if isinstance(value, list):
        if len(value) > _MOST:
            raise ConfigurationError(
                f"{where}: must have at most {_MOST} entries, got {len(value)}"
            )
        return [_spelt_out(entry, inside(where, i)) for i, entry in enumerate(value)]

    exact = isinstance(value, float) and value.is_integer() and abs(value) < _LARGEST_EXACT
    return int(value) if exact and not (value == 0.0 and math.copysign(1.0, value) < 0.0) else value


def _row(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _square(numbers: Array, triangle: bool, where: str) -> Array:
    """Matrix (6, 6) from its diagonal, from all its numbers or, if `triangle`, from its upper
    triangle.
    """
    if numbers.shape == (6,):
        return np.diag(numbers) if triangle else numbers
    if triangle and numbers.shape == (21,):
        matrix = np.zeros((6, 6))
        matrix[_UPPER] = matrix[_UPPER[::-1]] = numbers
        return matrix
    if numbers.shape in ((36,), (6, 6)):
        return numbers.reshape(6, 6)

    count = "6, 21 (upper triangle by rows) or 6 x 6" if triangle else "6 or 6 x 6"
    raise ConfigurationError(f"{where}: must be {count} numbers, got {shown(numbers)}")


# -- writing ---------------------------------------------------------------------------------------


def _written(record: Any) -> dict[str, Any]:
    """Fields of a dataclass that differ from their defaults, as plain numbers, rows and
    mappings.
    """
    tree = {}
    for entry in fields(record):
        content = getattr(record, entry.name)
        if entry.name == "linear_damping" and _same(content, np.diag(np.diag(content))):
            content = np.diag(content)

        default = entry.default_factory() if entry.default_factory is not MISSING else entry.default
        if default is MISSING or not _same(content, default):
            tree[entry.name] = _tree(content)
    # An empty table would have no custom element.
    return tree or {entry.name: _tree(getattr(record, entry.name)) for entry in fields(record)}


def _same(value: Any, default: Any) -> bool:
    if isinstance(value, np.ndarray):
        # also a row of zeros
        return np.shape(default) == value.shape and value.tobytes() == np.asarray(default).tobytes()
    return value == default


def _tree(value: Any) -> Any:
    if isinstance(value, Form):
        return {_FORM_NAMES[type(value)]: _written(value)}
    if is_dataclass(value) and not isinstance(value, type):
        return _written(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [_tree(entry) for entry in value]
    return value


def _leaves(branch: Any, name: str = "") -> Iterator[tuple[str, list[float]]]:
    """Paths in a tree, each with its row of numbers."""
    if isinstance(branch, dict):
        for key, child in branch.items():
            yield from _leaves(child, f"{name}/{key}" if name else key)
    elif isinstance(branch, list) and not all(isinstance(entry, int | float) for entry in branch):
        for k, child in enumerate(branch):
            yield from _leaves(child, f"{name}/{k}")
    else:
        yield name, branch if isinstance(branch, list) else [branch]


def _numeric(name: str, numbers: list[float]) -> str:
    return f'<numeric name={quoteattr(name)} data="{" ".join(repr(float(x)) for x in numbers)}"/>'
