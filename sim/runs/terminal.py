"""Terminal output of commands: what is printed may come from a file, and is shown as it stands."""

import sys
from typing import Any

from rich.console import Console
from rich.text import Text

from uuv.sim.interfaces.errors import harmless

_WIDTH = 140  # [characters] of a line where the output is no terminal


class PlainConsole(Console):
    """Console to which square brackets are text, not markup; it sends no control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As `Console.render_str`, of a harmless text."""
        return super().render_str(harmless(text), **options)


def console(width: int = _WIDTH) -> PlainConsole:
    """Console of a command; `width` is that of a line where the output is no terminal."""
    return PlainConsole(width=None if sys.stdout.isatty() else width)


def verdict(failed: str) -> Text:
    """The verdict of a run or study: accepted, unless bounds `failed`, which are told."""
    if failed:
        return Text.assemble(("not accepted", "red"), f": {harmless(failed)}")
    return Text("accepted", style="green")
