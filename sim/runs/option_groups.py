"""Options of a command in groups: `tyro` shows each group under its title, and one class still
holds them all.

A class of options, or a base of it, tells its groups by `groups`: title, and names of its fields.
What a field means stands below it, or in `abouts` of a class that is made at run time.
"""

import ast
import inspect
import sys
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, make_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_type_hints

import tyro

Options = TypeVar("Options")
REST = "job"  # title of the group of all others


def cli(kind: type[Options], args: Sequence[str]) -> Options:
    """Parse `args` into a `kind`, as `tyro.cli` does, with its options in groups.

    Raises:
        SystemExit: --help, or a mistake; tyro has told it.
    """
    titles = _titles(kind)
    if len(titles) < 2:
        return tyro.cli(kind, args=args)
    hints, told = get_type_hints(kind, include_extras=True), _told(kind)
    members: dict[str, list[tuple[str, Any, Any]]] = {title: [] for title in titles.values()}
    for each in fields(cast(Any, kind)):
        hint = Annotated[hints[each.name], tyro.conf.arg(help=told.get(each.name, ""))]
        members[titles[each.name]].append((each.name, hint, _default(each)))
    parts = []
    for title, group in members.items():
        part = make_dataclass(title, group, kw_only=True)
        whole = all(
            each.default is not MISSING or each.default_factory is not MISSING
            for each in fields(part)
        )
        # else tyro looks for its source
        hint = Annotated[part, tyro.conf.OmitArgPrefixes, tyro.conf.arg(help="")]
        parts.append((title, hint, field(default_factory=part) if whole else field()))
    grouped = make_dataclass("Grouped", parts, kw_only=True)
    found = tyro.cli(grouped, args=args, description=inspect.getdoc(kind))
    return kind(
        **{name: value for title in members for name, value in vars(getattr(found, title)).items()}
    )


def _titles(kind: type) -> dict[str, str]:
    """Title of the group of each field."""
    named = {}
    for base in kind.__mro__:
        for title, names in vars(base).get("groups", {}).items():
            named |= {name: title for name in names.split() if name not in named}
    titles = {each.name: named.get(each.name, REST) for each in fields(kind)}
    order = sorted(
        dict.fromkeys(titles.values()), key=lambda title: (title != REST, title == "output")
    )
    return (
        {name: title for wanted in order for name, title in titles.items() if title == wanted}
        if named
        else {}
    )


def _default(each: Field[Any]) -> Any:
    if each.default_factory is not MISSING:
        return field(default_factory=each.default_factory)
    return field() if each.default is MISSING else field(default=each.default)


def _told(kind: type) -> dict[str, str]:
    """What the class and its bases say below each field."""
    told: dict[str, str] = {}
    for base in reversed(kind.__mro__[:-1]):
        told |= vars(base).get("abouts", {})
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        body = None if file is None else _classes(file).get(base.__qualname__)
        if body is None:  # typed in at a prompt, or made by a function
            continue
        for declared, below in pairwise(body.body):
            match declared, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                    value=ast.Constant(value=str(said))
                ):
                    told[name] = " ".join(said.split())
    return told


@cache
def _classes(file: str) -> Mapping[str, ast.ClassDef]:
    """Source of each class of a module's file; read once, where `inspect.getsource` would read it
    for every class.
    """
    try:
        tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError):  # of a plug-in that has changed since it was imported
        return {}
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
