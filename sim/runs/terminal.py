"""Terminal output of commands: printed text may come from a file, and is shown without
interpretation.
"""

import sys
from typing import Any

from rich.console import Console
from rich.text import Text

from uuv.sim.interfaces.errors import harmless

_WIDTH = 140  # [characters] width of a line if the output is not a terminal


class PlainConsole(Console):
    """Console that prints square brackets as text instead of markup, and sends no control
    characters.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Same as `Console.render_str`, for a text made harmless."""
        return super().render_str(harmless(text), **options)


def console(width: int = _WIDTH) -> PlainConsole:
    """Console of a command; `width` is the width of a line if the output is not a terminal."""
    return PlainConsole(width=None if sys.stdout.isatty() else width)


def verdict(failed: str) -> Text:
    """Print the verdict of a run or study: accepted, or the bounds that `failed`."""
    if failed:
        return Text.assemble(("not accepted", "red"), f": {harmless(failed)}")
    return Text("accepted", style="green")
