"""Lists jobs, vehicles and all other named things, one line each: `uuv list [KIND ...]`."""

import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from uuv.catalogue import SHELVES, things
from uuv.cli.json_output import print_json
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import parse

_WIDTH = 120  # [characters] of a line if the output is no terminal
_LEAST = 40  # [characters] width of a description in a narrow terminal
_KINDS = [shelf.kind for shelf in SHELVES]


@dataclass(kw_only=True)
class ListOptions:
    """List jobs, vehicles and all other named things, one line each."""

    kinds: Annotated[
        Positional[tuple[str, ...]],
        arg(metavar="[KIND ...]", help=f"Some of {', '.join(_KINDS)}; default: all."),
    ] = ()
    json: bool = False
    """Print names and lines by kind as JSON."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints all kinds, or the named ones; returns the exit code."""
    del verb
    options = parse(ListOptions, args)
    kinds = [_kind(word) for word in options.kinds] or _KINDS
    listed = {shelf: list(things(shelf.kind)) for shelf in SHELVES if shelf.kind in kinds}
    if options.json:
        print_json({shelf.kind: dict(entries) for shelf, entries in listed.items()})
        return 0

    columns = shutil.get_terminal_size((_WIDTH, 0)).columns
    blocks = []
    for shelf, entries in listed.items():
        wide = max((len(name) for name, _ in entries), default=0)
        lines = [_entry(f"  {name:<{wide}}  ", about, columns) for name, about in entries]
        blocks.append("\n".join([f"{shelf.kind}s  ({shelf.use})", *lines]))
    print("\n\n".join(blocks))
    return 0


def _kind(word: str) -> str:
    """The kind whose name, in the singular or the plural, is `word`."""
    kind = word.removesuffix("s")
    if kind not in _KINDS:
        known = ", ".join(_KINDS)
        raise ConfigurationError(f"no kind {word!r}; there are {known}{did_you_mean(kind, _KINDS)}")
    return kind


def _entry(begin: str, about: str, columns: int) -> str:
    """A name and its description, wrapped to the width of the terminal."""
    room = max(_LEAST, columns - len(begin))
    lines = textwrap.wrap(about, room, break_long_words=False, break_on_hyphens=False) or [""]
    return f"\n{' ' * len(begin)}".join([f"{begin}{lines[0]}".rstrip(), *lines[1:]])
