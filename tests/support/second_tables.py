"""Lists that are written twice: tables of names that the product has already, such as its jobs or
its perturbations.

A table is a dictionary, a tuple, a list, a set, a `Literal` or a `match` with three or more names
of one list. One of them is the list itself; any other has to agree with it by hand, and should be
derived from it.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import get_args

from source_tree import name_of, nodes, parsed, sources

LEAST = 3  # names of a list that make a table of it
_TABLES = (ast.Dict, ast.Tuple, ast.List, ast.Set, ast.Match)


@dataclass(frozen=True, slots=True)
class Table:
    """Names of one list that stand together."""

    kind: str
    path: Path
    line: int
    names: frozenset[str]

    def __str__(self) -> str:
        """Place and names."""
        return f"    {name_of(self.path)}:{self.line}: {self.kind}: {', '.join(sorted(self.names))}"


@cache
def lists() -> Mapping[str, frozenset[str]]:
    """Names of each list of the product, as its registries have them."""
    from uuv import methods, models
    from uuv.cli.main import VERBS
    from uuv.jobs import BY_NAME
    from uuv.kinds import SENSORS
    from uuv.models.arms import published_arms
    from uuv.models.objects.targets import OBJECTS
    from uuv.models.site.terrain_kinds import Kind
    from uuv.models.tools.tools import TOOLS
    from uuv.perturbations import perturbation
    from uuv.site import SITE_OBJECTS
    from uuv.tasks import registry as tasks

    named: Mapping[str, Iterable[str]] = {
        "job": [*BY_NAME, *(job.function.__name__ for job in BY_NAME.values())],
        "verb": VERBS,
        "task": tasks.registry().names(),
        "perturbation": perturbation.registry().names(),
        "sensor": SENSORS.names(),
        "object": OBJECTS.names(),
        "site object": SITE_OBJECTS.names(),
        "tool": TOOLS.names(),
        "vehicle": models.available(),
        "arm": published_arms.available(),
        "terrain": get_args(Kind),
        "method": get_args(methods.Method),
    }
    return {kind: frozenset(map(_spelling, names)) for kind, names in named.items()}


def tables_in(path: Path, known: Mapping[str, frozenset[str]]) -> Iterator[Table]:
    """All tables of the `known` lists in a file, the lists themselves included; `__all__` is
    none.
    """
    tree = parsed(path)
    exported = {
        id(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    }
    for node in nodes(path):
        if not isinstance(node, _TABLES):
            continue
        words = frozenset(map(_spelling, _words(node)))
        if len(words) < LEAST or id(node) in exported:
            continue
        for kind, names in known.items():
            if len(words & names) >= LEAST:
                yield Table(kind, path, getattr(node, "lineno", 0), words & names)


@cache
def product_tables() -> tuple[Table, ...]:
    """All tables of the product, lists themselves included; those of experiments are choices."""
    product = [path for path in sources() if not name_of(path).startswith("scripts/")]
    return tuple(table for path in product for table in tables_in(path, lists()))


@cache
def second_tables() -> tuple[Table, ...]:
    """Tables beside the list itself, which is the one with the most names."""
    tables = sorted(product_tables(), key=lambda t: -len(t.names))
    met: set[str] = set()
    return tuple(table for table in tables if table.kind in met or met.add(table.kind))


def _spelling(name: str) -> str:
    return name.replace("_", "-")


def _words(node: ast.AST) -> Iterator[str]:
    """Names that stand in a table: texts, classes, and first arguments of the calls that make its
    entries.
    """
    entries: list[ast.expr | None] = []
    if isinstance(node, ast.Dict):
        entries = [*node.keys, *node.values]
    elif isinstance(node, ast.Tuple | ast.List | ast.Set):
        entries = [*node.elts]
    elif isinstance(node, ast.Match):
        patterns = [inner for case in node.cases for inner in ast.walk(case.pattern)]
        entries = [inner.value for inner in patterns if isinstance(inner, ast.MatchValue)]
    for entry in entries:
        if isinstance(entry, ast.Call) and entry.args:
            entry = entry.args[0]
        if isinstance(entry, ast.Constant) and isinstance(entry.value, str):
            yield entry.value
        elif isinstance(entry, ast.Name):  # a class, or a text that has a name of its own
            yield entry.id.lower() if entry.id.isupper() else entry.id
