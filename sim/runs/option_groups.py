"""Options of a command in groups, which tyro shows under their titles; one class has all options.

A class of options, or a base of it, declares its groups in `groups`, by title and names of fields.
The description of a field follows it in the source, or is in `abouts` of a class that is made at
run time.
"""

import inspect
from collections.abc import Sequence
from dataclasses import MISSING, Field, field, fields, make_dataclass
from typing import Annotated, Any, TypeVar, cast, get_type_hints

import tyro

from uuv.sim.runs.help_texts import help_texts

Options = TypeVar("Options")
REST = "job"  # title of the group of all other options


def cli(kind: type[Options], args: Sequence[str]) -> Options:
    """Parse `args` into a `kind`, as `tyro.cli` does, with its options in groups.

    Raises:
        SystemExit: After --help, or after a mistake that tyro has reported.
    """
    titles = _titles(kind)
    if len(titles) < 2:
        return tyro.cli(kind, args=args)
    hints = get_type_hints(kind, include_extras=True)
    texts = help_texts(kind)
    members: dict[str, list[tuple[str, Any, Any]]] = {title: [] for title in titles.values()}

    for option in fields(cast(Any, kind)):
        hint = Annotated[hints[option.name], tyro.conf.arg(help=texts.get(option.name, ""))]
        members[titles[option.name]].append((option.name, hint, _default(option)))

    parts = []
    for title, group in members.items():
        part = make_dataclass(title, group, kw_only=True)
        whole = all(
            member.default is not MISSING or member.default_factory is not MISSING
            for member in fields(part)
        )
        # otherwise tyro looks for the source of the class
        hint = Annotated[part, tyro.conf.OmitArgPrefixes, tyro.conf.arg(help="")]
        parts.append((title, hint, field(default_factory=part) if whole else field()))

    # Read by groups, then passed to the class.
    grouped = make_dataclass("Grouped", parts, kw_only=True)
    parsed = tyro.cli(grouped, args=args, description=inspect.getdoc(kind))
    return kind(
        **{
            name: setting
            for title in members
            for name, setting in vars(getattr(parsed, title)).items()
        }
    )


def _titles(kind: type) -> dict[str, str]:
    """Title of the group of each field."""
    named = {}
    for base in kind.__mro__:
        for title, names in vars(base).get("groups", {}).items():
            named |= {name: title for name in names.split() if name not in named}

    titles = {option.name: named.get(option.name, REST) for option in fields(kind)}
    order = sorted(
        dict.fromkeys(titles.values()), key=lambda title: (title != REST, title == "output")
    )

    return (
        {name: title for group in order for name, title in titles.items() if title == group}
        if named
        else {}
    )


def _default(option: Field[Any]) -> Any:
    if option.default_factory is not MISSING:
        return field(default_factory=option.default_factory)
    return field() if option.default is MISSING else field(default=option.default)
