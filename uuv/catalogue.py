"""Catalogue of jobs, vehicles and other named things, with one line about each.

The modules are not imported, which would take seconds. Names and first lines of docstrings are read
from the sources.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

HOME = Path(__file__).resolve().parent  # folder of the package `uuv`, with the rooms in it
CHECKOUT = HOME.parent  # folder that contains the package: the checkout, if there is one
EXPERIMENTS = CHECKOUT / "scripts" / "experiments"  # folder of experiments in a checkout
# end of the file of an experiment that is a command
_COMMAND = re.compile(r"^    run_scenario\((\w+\.)?main\)$", re.M)
_GROUP = "uuv_arm"  # group of entry points, as in `uuv.models.registry`


@dataclass(frozen=True, slots=True)
class Shelf:
    """One kind of named things, and the command that uses it."""

    kind: str
    use: str


SHELVES = (
    Shelf("job", "uuv run NAME; one of your own: uuv run MODULE:FUNCTION"),
    Shelf("experiment", "./uvw run scripts/experiments/NAME.py, in a clone"),
    Shelf("vehicle", "--vehicle NAME"),
    Shelf("arm", "uuv.models.arms.published_arms.load(NAME)"),
    Shelf("object", "uuv run clean-object --object NAME"),
    Shelf("tool", "--tool NAME"),
    Shelf("soil", "uuv run sample-seabed --soil NAME"),
    Shelf("sensor", "--sensor NAME"),
    Shelf("controller", "--controller NAME"),
    Shelf("flow", "kind of [site.flow] in a scenario file; --flow MODULE:CLASS"),
    Shelf("task", "kind of [task] in a scenario file; uuv run open-water --task MODULE:CLASS"),
    Shelf("perturbation", "kind of [[perturbations]] in a scenario file"),
)


def things(kind: str) -> Iterator[tuple[str, str]]:
    """Name and one line about each thing of a kind; those of other packages come last."""
    match kind:
        case "job":
            yield from _jobs(HOME / "jobs" / "__init__.py")
        case "experiment":
            for file in sorted(EXPERIMENTS.rglob("[!_]*.py")):
                source = file.read_text(encoding="utf-8")
                if _COMMAND.search(source):
                    # The first line only, since parsing the file would take half of the time.
                    headline = source.partition("\n")[0].strip('"')
                    name = file.relative_to(EXPERIMENTS).with_suffix("").as_posix()
                    yield name, headline.removeprefix("Study: ").removeprefix("Benchmark: ")

        case "vehicle":
            yield from _vehicles()
        case "arm":
            yield from _arms(HOME / "models" / "arms" / "published_arms.py")

        case "object":
            folder = HOME / "models" / "objects"
            documented = {}
            for file in folder.glob("*.py"):
                documented |= _definitions(file)
            for name in _keys(folder / "targets.py", "OBJECTS"):
                yield name, documented.get(name, "")
        case "tool":
            yield from _documented(HOME / "models" / "tools" / "tools.py", "TOOLS")
        case "soil":
            yield from _documented(HOME / "models" / "site" / "soil.py", "SOILS")

        case "flow":
            documented = _definitions(HOME / "sim" / "water" / "cylinder_wake.py")
            for name in _keys(HOME / "site.py", "FLOWS"):
                yield name, documented.get(name, "")
        case "sensor":
            documented = _definitions(HOME / "components" / "contact_parts.py")
            for name in _keys(HOME / "kinds.py", "SENSORS"):
                yield name, documented.get(name, "")

        case "controller":
            classes = _definitions(HOME / "controllers" / "whole_body" / "work_controller.py")
            for name in _keys(HOME / "kinds.py", "CONTROLLERS"):
                yield name, classes["WorkController"]

        case "task" | "perturbation":
            folder = HOME / f"{kind}s"
            documented = {}
            for file in folder.glob("*.py"):
                documented |= _definitions(file)
            listed = folder / ("registry.py" if kind == "task" else "perturbation.py")
            for name, class_name in _kinds(listed):
                yield name, documented.get(class_name, "")

    yield from (
        (point.name, f"of {point.value}") for point in entry_points(group=f"{_GROUP}.{kind}")
    )


def _jobs(file: Path) -> Iterator[tuple[str, str]]:
    """Functions with the decorator `@job`, by their names with dashes."""
    for node in _tree(file).body:
        if isinstance(node, ast.FunctionDef):
            marks = [mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)]
            if "job" in marks:
                yield node.name.replace("_", "-"), _summary(node)


def _vehicles() -> Iterator[tuple[str, str]]:
    """Built-in vehicles with their sources."""
    file = HOME / "models" / "__init__.py"
    table = next(
        node for node in ast.walk(_assigned(file, "_MODELS")) if isinstance(node, ast.Dict)
    )

    for key, entry in zip(table.keys, table.values, strict=True):
        if isinstance(key, ast.Constant) and isinstance(entry, ast.Call):
            source = next(word.value for word in entry.keywords if word.arg == "source")
            yield _word(key), _word(source)


def _arms(file: Path) -> Iterator[tuple[str, str]]:
    """Arms with their titles: entries of a dictionary, and some that are added to it later."""
    table = _assigned(file, "_ARMS")
    entries = (
        list(zip(table.keys, table.values, strict=True)) if isinstance(table, ast.Dict) else []
    )

    for node in _tree(file).body:
        if isinstance(node, ast.Assign) and isinstance(at := node.targets[0], ast.Subscript):
            entries.append((at.slice, node.value))

    for key, call in entries:
        if isinstance(key, ast.Constant) and isinstance(call, ast.Call):
            title = call.args[0] if call.args else None
            yield _word(key), _word(title)


def _documented(file: Path, registry: str) -> Iterator[tuple[str, str]]:
    documented = _definitions(file)
    yield from ((name, documented.get(name, "")) for name in _keys(file, registry))


@cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def _definitions(file: Path) -> dict[str, str]:
    """Summary of each class and function of a module, which is the first paragraph of its
    docstring.
    """
    kinds = (ast.ClassDef, ast.FunctionDef)
    return {node.name: _summary(node) for node in _tree(file).body if isinstance(node, kinds)}


def _summary(node: ast.Module | ast.ClassDef | ast.FunctionDef) -> str:
    return " ".join((ast.get_docstring(node) or "").partition("\n\n")[0].split())


def _keys(file: Path, variable: str) -> list[str]:
    """Keys of the dictionary that is assigned to a module-level variable, or that it is made
    from.
    """
    for inner in ast.walk(_assigned(file, variable)):
        if isinstance(inner, ast.Dict):
            named = [
                _assigned(file, key.id) if isinstance(key, ast.Name) else key for key in inner.keys
            ]
            return [_word(key) for key in named if isinstance(key, ast.Constant)]
    return []


def _assigned(file: Path, variable: str) -> ast.expr:
    """Value of a module-level variable."""
    for node in _tree(file).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue

        names = node.targets if isinstance(node, ast.Assign) else [node.target]
        if any(isinstance(name, ast.Name) and name.id == variable for name in names):
            return node.value
    raise LookupError(f"{file} has no {variable}")


def _kinds(file: Path) -> list[tuple[str, str]]:
    """Names that a function's dictionary lists, and their classes, its MODULE:CLASS values."""
    for inner in ast.walk(_tree(file)):
        if isinstance(inner, ast.Dict) and inner.keys:
            return [
                (_word(key), _word(value).rpartition(":")[2])
                for key, value in zip(inner.keys, inner.values, strict=True)
                if isinstance(key, ast.Constant)
            ]
    return []


def _word(node: ast.expr | None) -> str:
    """Content of a string in the source; empty for anything else."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
