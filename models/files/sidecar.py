"""Water of a vehicle without Python: a YAML file beside its MJCF, or custom elements within it, read and written.

    attach_beside(spec, "rov.xml")  # its rov.water.yaml, and its elements <numeric name="water/hull/volume" ...>
    write_sidecar(spec, "rov.water.yaml")
    text = xml_with_elements(spec)

Both hold one tree. Its names are those of the Python API, which reads the numbers, so that nothing is rounded:

    water_density: 1025.0
    bodies:
      hull: {volume: 0.03, added_mass: [15, 20, 25, 0.4, 0.8, 0.9], quadratic_damping: [30, 60, 80, 1, 2, 3]}
      link1: {cylinder: {radius: 0.03, start: [0.0, 0.0, 0.0], end: [0.3, 0.0, 0.0]}}
    thrusters:
      bow: {forward: 50.0, reverse: 40.0, time_constant: 0.1}
      stern: {t200: {handedness: -1}}

A custom element has the path of one number, or row of numbers: `water/hull/volume`, `water/link1/cylinder/radius`,
`water/hull/strips/0/start`, `water/water_density`, `thruster/bow/forward`.
"""

import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
import yaml

from uuv.models import hydrodynamics
from uuv.models.files.exact_mjcf import exact_xml
from uuv.models.files.yaml_files import document_of
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.models.water import thrusters
from uuv.models.water.forms import CrossTerms, FadingDamping, Form, LiftDrag, MunkFactor, PlanarStrip
from uuv.models.water.thrusters import Thruster
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import Array, shown

ENDING: Final = ".water.yaml"  # takes the place of the MJCF's own ending
_WATER, _THRUSTER = hydrodynamics.ELEMENTS
_DENSITY: Final = "water_density"
_SECTIONS: Final = (_DENSITY, "bodies", "thrusters")
_MOST = 500  # numbers in a row, and entries in a list

SHAPES: Final[dict[str, Callable[..., BodyHydrodynamics]]] = {
    "sphere": hydrodynamics.sphere,
    "ellipsoid": hydrodynamics.ellipsoid,
    "box": hydrodynamics.box,
    "cylinder": hydrodynamics.cylinder,
}
_THRUSTER_MAKERS: Final[dict[str, Callable[..., Thruster]]] = {
    "t200": thrusters.t200,
    "of_table": Thruster.of_table,
    "of_polynomial": Thruster.of_polynomial,
}
_FORM_MAKERS: Final[dict[str, Callable[..., Form]]] = {
    "munk_factor": MunkFactor,
    "fading_damping": FadingDamping,
    "lift_drag": LiftDrag,
    "wing": LiftDrag.of_wing,
    "cross_terms": CrossTerms,
    "planar_strip": PlanarStrip,
}
_FORM_NAMES: Final = {maker: name for name, maker in _FORM_MAKERS.items()}
_BODY_FIELDS: Final = tuple(field.name for field in fields(BodyHydrodynamics))
_UPPER: Final = np.triu_indices(6)


def beside(mjcf: str | Path) -> Path:
    """Name of the sidecar that belongs to an MJCF file: `rov.xml` has `rov.water.yaml`."""
    path = Path(mjcf)
    return path.with_name(path.stem + ENDING)


def attach_beside(spec: mujoco.MjSpec, mjcf: str | Path, sidecar: str | Path | None = None) -> None:
    """Attach what custom elements of `spec` and its sidecar say; the elements are removed from the spec.

    Args:
        spec: as read from `mjcf`, changed in place.
        mjcf: file of the spec.
        sidecar: YAML file; by default the one `beside` the MJCF, if there is one.

    Raises:
        ConfigurationError: a file that cannot be read, an unknown name, a wrong number, or water stated twice.
    """
    in_file = elements_of(spec)
    found = beside(mjcf) if sidecar is None else Path(sidecar)
    if sidecar is not None or found.is_file():
        said = read_sidecar(found)
        for section in ("bodies", "thrusters"):
            if twice := sorted(set(in_file.get(section, {})) & set(said.get(section, {}))):
                raise ConfigurationError(
                    f"water file {shown(str(found))}: {section} {', '.join(twice)} have custom elements in the MJCF too"
                )
        if _DENSITY in in_file and _DENSITY in said:
            raise ConfigurationError(f"water file {shown(str(found))}: {_DENSITY} is a custom element of the MJCF too")
        where = f"water file {shown(str(found))}"
        if in_file:
            attach_tree(spec, _with_density_of(said, in_file), "MJCF")
        attach_tree(spec, _with_density_of(in_file, said), where)
    else:
        attach_tree(spec, in_file, "MJCF")
    for element in [each for each in spec.numerics if each.name.startswith(hydrodynamics.ELEMENTS)]:
        spec.delete(element)


def read_sidecar(file: str | Path) -> dict[str, Any]:
    """Tree of a sidecar, with the sections `water_density`, `bodies` and `thrusters`.

    Raises:
        ConfigurationError: the file cannot be read, is no YAML, or has another section.
    """
    what = f"water file {shown(str(file))}"
    return checked_tree(document_of(text_of(file, "water file"), what), what)


def checked_tree(document: Any, what: str) -> dict[str, Any]:
    """`document` as a tree with known sections; `what` begins error messages.

    Raises:
        ConfigurationError: it is no mapping, or has another section.
    """
    tree = _mapping(document, what)
    _known(tree, _SECTIONS, what, "section")
    for section in _SECTIONS[1:]:
        if section in tree:
            _mapping(tree[section], f"{what}: {section}")
    if _DENSITY in tree:
        _read(float, tree[_DENSITY], f"{what}: {_DENSITY}")
    return tree


def elements_of(spec: mujoco.MjSpec) -> dict[str, Any]:
    """Tree of a spec's custom numeric elements `water/...` and `thruster/...`, as that of a sidecar.

    Raises:
        ConfigurationError: a name that leads to no body or actuator, or contradicts another name.
    """
    bodies = [body.name for body in spec.bodies[1:]]
    actuators = [actuator.name for actuator in spec.actuators]
    tree: dict[str, Any] = {}
    for element in spec.numerics:
        name = str(element.name)
        numbers = [float(x) for x in element.data]
        value: Any = numbers[0] if len(numbers) == 1 else numbers
        if name == _WATER + _DENSITY:
            tree[_DENSITY] = value
        elif name.startswith(_WATER):
            _put(tree, ["bodies", *_path(name, _WATER, bodies, "body")], value, name)
        elif name.startswith(_THRUSTER):
            _put(tree, ["thrusters", *_path(name, _THRUSTER, actuators, "actuator")], value, name)
    return {section: _of_owners(branch) if isinstance(branch, dict) else branch for section, branch in tree.items()}


def attach_tree(spec: mujoco.MjSpec, tree: Mapping[str, Any], what: str) -> None:
    """Attach the water and thrusters of a tree to `spec`.

    Args:
        spec: changed in place.
        tree: as `read_sidecar` or `elements_of` returns.
        what: begins error messages.

    Raises:
        ConfigurationError: an unknown body, actuator or field; a wrong number; water that the user data holds already.
    """
    if not tree:
        return
    density = _read(float, tree[_DENSITY], f"{what}: {_DENSITY}") if _DENSITY in tree else None
    names = [body.name for body in spec.bodies[1:] if body.name]
    wet, driven = {}, {}
    for name, entry in tree.get("bodies", {}).items():
        _known([name], names, what, "body")
        if hydrodynamics.carries(spec.body(name).userdata):
            raise ConfigurationError(f"{what}: body {name!r} has its water already, in user data or stated twice")
        wet[name] = body_of(entry, f"{what}: body {name!r}", density)
    actuators = {actuator.name: actuator for actuator in spec.actuators if actuator.name}
    for name, entry in tree.get("thrusters", {}).items():
        _known([name], actuators, what, "actuator")
        if thrusters.carries(np.array(actuators[name].userdata)):
            raise ConfigurationError(f"{what}: thruster {name!r} has its table already, in user data or stated twice")
        driven[name] = thruster_of(entry, f"{what}: thruster {name!r}")
    try:
        if wet or density is not None:
            hydrodynamics.attach(spec, wet, density)
        if driven:
            thrusters.attach(spec, driven)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from error


def body_of(entry: Any, what: str, water_density: float | None = None) -> BodyHydrodynamics:
    """Coefficients of a body's entry: fields of BodyHydrodynamics, or one shape, of which fields may replace some.

    Args:
        entry: mapping of names to numbers.
        what: begins error messages.
        water_density: [kg/m^3] of a shape that states none; by default that of the shape's function.

    Raises:
        ConfigurationError: an unknown name or a wrong number.
    """
    entry = _mapping(entry, what)
    _known(entry, (*_BODY_FIELDS, *SHAPES), what, "field")
    shapes = [name for name in entry if name in SHAPES]
    if len(shapes) > 1:
        raise ConfigurationError(f"{what}: one shape, not {' and '.join(shapes)}")
    given = {name: value for name, value in entry.items() if name not in SHAPES}
    for name, value in given.items():
        if name in ("added_mass", "linear_damping"):
            given[name] = _square(_plain(value, f"{what}: {name}"), name == "added_mass", f"{what}: {name}")
        elif name == "strips":
            given[name] = tuple(
                _call(StripDrag, each, f"{what}: strip {k}") for k, each in enumerate(_list(value, f"{what}: strips"))
            )
        elif name == "forms":
            given[name] = tuple(
                _form(each, f"{what}: form {k}") for k, each in enumerate(_list(value, f"{what}: forms"))
            )
        else:
            given[name] = _plain(value, f"{what}: {name}")
    try:
        if not shapes:
            if "volume" not in given:
                raise ConfigurationError(f"volume or a shape ({', '.join(SHAPES)}) is missing")
            return BodyHydrodynamics(**given)
        of_shape = _mapping(entry[shapes[0]], f"{what}: {shapes[0]}")
        if water_density is not None:
            of_shape = {_DENSITY: water_density, **of_shape}
        return replace(_call(SHAPES[shapes[0]], of_shape, f"{what}: {shapes[0]}"), **given)
    except ConfigurationError as error:
        raise _of(what, error) from error


def _form(entry: Any, what: str) -> Form:
    """Form of an entry with one name: that of its kind, with the fields below it."""
    entry = _mapping(entry, what)
    _known(entry, _FORM_MAKERS, what, "form")
    if len(entry) != 1:
        raise ConfigurationError(f"{what}: expected one of {', '.join(_FORM_MAKERS)}, got {shown(list(entry))}")
    ((name, given),) = entry.items()
    return _call(_FORM_MAKERS[name], given, f"{what}: {name}", LiftDrag)


def thruster_of(entry: Any, what: str) -> Thruster:
    """Thruster of an entry: fields of Thruster, or one of `t200`, `of_table` and `of_polynomial` with its arguments.

    Raises:
        ConfigurationError: an unknown name or a wrong number; the message begins with `what`.
    """
    entry = _mapping(entry, what)
    makers = [name for name in entry if name in _THRUSTER_MAKERS]
    if not makers:
        _known(entry, (*(field.name for field in fields(Thruster)), *_THRUSTER_MAKERS), what, "field")
        return _call(Thruster, entry, what)
    if len(entry) > 1:
        raise ConfigurationError(f"{what}: {makers[0]} takes the other fields as its own, got {', '.join(entry)}")
    given = {} if entry[makers[0]] is None else entry[makers[0]]  # `t200:` alone
    return _call(_THRUSTER_MAKERS[makers[0]], given, f"{what}: {makers[0]}")


def tree_of(spec: mujoco.MjSpec) -> dict[str, Any]:
    """Tree of the water and thrusters that are attached to `spec`; reading it gives the same numbers to the last bit.

    Raises:
        ConfigurationError: the spec has no hydrodynamics, or a wet body or thruster has no name.
    """
    wet = hydrodynamics.attached(spec)
    if not wet:
        raise ConfigurationError("this spec has no hydrodynamics; call uuv.models.hydrodynamics.attach first")
    driven = {
        actuator.name: thrusters.unpack(np.array(actuator.userdata))
        for actuator in spec.actuators
        if thrusters.carries(np.array(actuator.userdata))
    }
    if "" in wet or "" in driven:
        raise ConfigurationError("water: a wet body or thruster without a name cannot be written")
    tree: dict[str, Any] = {
        _DENSITY: hydrodynamics.density_of(spec),
        "bodies": {name: _written(body) for name, body in wet.items()},
    }
    if driven:
        tree["thrusters"] = {name: _written(thruster) for name, thruster in driven.items()}
    return tree


def write_sidecar(spec: mujoco.MjSpec, file: str | Path) -> Path:
    """Write the water and thrusters of `spec` as YAML; `xml_without_water` is the MJCF that belongs to it.

    Returns:
        The file.

    Raises:
        ConfigurationError: as `tree_of` does, or the file cannot be written.
    """
    path = Path(file)
    text = yaml.safe_dump(tree_of(spec), sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"water file {shown(str(path))}: cannot be written ({error.strerror})") from error
    return path


def xml_with_elements(spec: mujoco.MjSpec) -> str:
    """MJCF of `spec` with its water and thrusters in custom elements, which keep every digit.

    Raises:
        ConfigurationError: as `tree_of` does.
    """
    tree = tree_of(spec)
    lines = [_numeric(_WATER + _DENSITY, [tree[_DENSITY]])]
    for section, prefix in (("bodies", _WATER), ("thrusters", _THRUSTER)):
        lines += [_numeric(prefix + name, numbers) for name, numbers in _leaves(tree.get(section, {}))]
    head, end, _ = xml_without_water(spec).rpartition("</mujoco>")
    return f"{head}  <custom>\n" + "".join(f"    {line}\n" for line in lines) + f"  </custom>\n{end}\n"


def xml_without_water(spec: mujoco.MjSpec) -> str:
    """MJCF of `spec` without the user data of its water and thrusters, for a sidecar to stand beside.

    Their reaction torques are taken out of the gears, where reading the thrusters puts them again.
    """
    bare = spec.copy()
    for body in bare.bodies:
        if hydrodynamics.carries(body.userdata):
            body.userdata = []
    for actuator in bare.actuators:
        if thrusters.carries(np.array(actuator.userdata)):
            actuator.userdata, actuator.gear[3:] = [], 0.0
    bare.nuser_body = max([len(body.userdata) for body in bare.bodies] or [0])
    bare.nuser_actuator = max([len(actuator.userdata) for actuator in bare.actuators] or [0])
    return exact_xml(bare)


# ------------------------------------------------------------------------------------------------------------- reading


def _with_density_of(other: Mapping[str, Any], tree: Mapping[str, Any]) -> dict[str, Any]:
    """`tree` with the density of the water that `other` states: shapes take it."""
    return {**({_DENSITY: other[_DENSITY]} if _DENSITY in other else {}), **tree}


def _path(name: str, prefix: str, known: list[str], what: str) -> list[str]:
    """Body or actuator, and the names behind it, of an element; names of bodies may contain a slash themselves."""
    rest = name.removeprefix(prefix)
    owners = [each for each in known if each and rest.startswith(each + "/")]
    if not owners:
        first = rest.partition("/")[0]
        raise ConfigurationError(
            f"custom element {name!r}: no {what} {first!r} with a field behind it{did_you_mean(first, known)}"
        )
    owner = max(owners, key=len)
    return [owner, *rest[len(owner) + 1 :].split("/")]


def _put(tree: dict[str, Any], path: list[str], value: Any, name: str) -> None:
    for step in path[:-1]:
        tree = tree.setdefault(step, {})
        if not isinstance(tree, dict):
            raise ConfigurationError(f"custom element {name!r}: {step!r} is a number already")
    if path[-1] in tree:
        raise ConfigurationError(f"custom element {name!r}: stated twice, as a number and as a part of its own")
    tree[path[-1]] = value


def _of_owners(branch: dict[str, Any]) -> dict[str, Any]:
    """`_with_lists` of what stands below each body or actuator, which may itself be called 0 or 1."""
    return {owner: _with_lists(entry) for owner, entry in branch.items()}


def _with_lists(branch: Any) -> Any:
    """`branch`, with mappings of 0, 1, 2, ... turned into lists."""
    if not isinstance(branch, dict):
        return branch
    if set(branch) == {str(k) for k in range(len(branch))}:
        return [_with_lists(branch[str(k)]) for k in range(len(branch))]
    return {key: _with_lists(value) for key, value in branch.items()}


def _mapping(value: Any, what: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"{what}: expected names with their numbers, got {shown(value)}")
    return dict(value)


def _list(value: Any, what: str) -> list[Any]:
    if isinstance(value, Mapping):
        return [value]
    if not isinstance(value, list) or len(value) > _MOST:
        raise ConfigurationError(f"{what}: expected a list of at most {_MOST}, got {shown(value)}")
    return value


def _known(given: Iterable[Any], allowed: Iterable[str], what: str, kind: str) -> None:
    allowed = list(allowed)
    for name in given:
        if name not in allowed:
            near = did_you_mean(name, allowed) or f"; there are {', '.join(allowed)}"
            raise ConfigurationError(f"{what}: unknown {kind} {shown(name)}{near}")


def _call(maker: Callable[..., Any], entry: Any, what: str, figures: type = Thruster) -> Any:
    """What `maker` makes of the arguments in `entry`; its `**figures` are fields of the class `figures`."""
    entry = _mapping(entry, what)
    wanted = dict(inspect.signature(maker).parameters)
    if any(each.kind is each.VAR_KEYWORD for each in wanted.values()):
        wanted = {name: each for name, each in wanted.items() if each.kind is not each.VAR_KEYWORD}
        others = inspect.signature(figures).parameters
        wanted |= {name: each.replace(default=None) for name, each in others.items() if name not in wanted}
    _known(entry, wanted, what, "field")
    if missing := [name for name, each in wanted.items() if each.default is each.empty and name not in entry]:
        raise ConfigurationError(f"{what}: {', '.join(missing)} is missing")
    given = {name: _read(wanted[name].annotation, value, f"{what}: {name}") for name, value in entry.items()}
    try:
        return maker(**given)
    except ConfigurationError as error:
        raise _of(what, error) from error


def _read(kind: Any, value: Any, what: str) -> Any:
    """`value` as the `kind` of argument, int, float or rows of numbers; what numbers are allowed is the callee's."""
    value = _plain(value, what)
    if kind in (int, float) and isinstance(value, list):
        raise ConfigurationError(f"{what}: expected one number, got {shown(value)}")
    if kind is int and float(value).is_integer():
        return int(value)
    if kind == Thruster.__annotations__["table"] and isinstance(value, list):
        return [each if isinstance(each, list) else [each] for each in value]  # an element of one number is no row
    return value


def _plain(value: Any, what: str, depth: int = 0) -> Any:
    """`value` if it is a number, or a row of numbers, or rows of numbers; numbers as floats."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value) if isinstance(value, float) or abs(value) < 2**1000 else math.inf
        if math.isnan(number):
            raise ConfigurationError(f"{what}: must not be NaN")
        return number
    if isinstance(value, list) and len(value) <= _MOST and depth < 2:
        return [_plain(each, what, depth + 1) for each in value]
    hint = ""
    if isinstance(value, str) and _is_number(value):
        hint = f"; YAML reads it as text: write {float(value)!r}" if "e" in value.lower() else "; leave out the quotes"
    raise ConfigurationError(f"{what}: expected a number, or a row of at most {_MOST}, got {shown(value)}{hint}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _square(value: Any, triangle: bool, what: str) -> Array:
    """Matrix (6, 6) of its diagonal, its upper triangle by rows (if `triangle`), or all its numbers; else `value`."""
    try:
        numbers = np.array(value, dtype=np.float64)
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape == (6,):
        return np.diag(numbers) if triangle else numbers
    if triangle and numbers.shape == (21,):
        matrix = np.zeros((6, 6))
        matrix[_UPPER] = matrix[_UPPER[::-1]] = numbers
        return matrix
    if numbers.shape in ((36,), (6, 6)):
        return numbers.reshape(6, 6)
    count = "6, 21 (upper triangle by rows) or 6 x 6" if triangle else "6 or 6 x 6"
    raise ConfigurationError(f"{what}: expected {count} numbers, got {shown(value)}")


def _of(what: str, error: ConfigurationError) -> ConfigurationError:
    """`error` with `what` before it, unless it says so already."""
    return error if str(error).startswith(what) else ConfigurationError(f"{what}: {error}")


# ------------------------------------------------------------------------------------------------------------- writing


def _written(thing: Any) -> dict[str, Any]:
    """Fields of a dataclass that differ from their defaults, as plain numbers, rows and mappings."""
    tree = {}
    for field in fields(thing):
        value = getattr(thing, field.name)
        if field.name == "linear_damping" and _same(value, np.diag(np.diag(value))):
            value = np.diag(value)
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if default is MISSING or not _same(value, default):
            tree[field.name] = _tree(value)
    return tree


def _same(value: Any, default: Any) -> bool:
    if isinstance(value, np.ndarray):
        return np.shape(default) == value.shape and value.tobytes() == np.asarray(default).tobytes()  # of zeros too
    return value == default


def _tree(value: Any) -> Any:
    if isinstance(value, Form):
        return {_FORM_NAMES[type(value)]: _written(value)}
    if is_dataclass(value) and not isinstance(value, type):
        return _written(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [_tree(each) for each in value]
    return value


def _leaves(branch: Any, name: str = "") -> Iterator[tuple[str, list[float]]]:
    """Paths and rows of numbers of a tree."""
    if isinstance(branch, dict):
        for key, value in branch.items():
            yield from _leaves(value, f"{name}/{key}" if name else key)
    elif isinstance(branch, list) and not all(isinstance(each, int | float) for each in branch):
        for k, value in enumerate(branch):
            yield from _leaves(value, f"{name}/{k}")
    else:
        yield name, branch if isinstance(branch, list) else [branch]


def _numeric(name: str, numbers: list[float]) -> str:
    return f'<numeric name={quoteattr(name)} data="{" ".join(repr(float(x)) for x in numbers)}"/>'
