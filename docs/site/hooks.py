"""Hooks of the documentation site: pages of the API by room, and equations as MathML, which browsers draw."""

import html
import re
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOMS = {
    "models": "What exists: vehicles, arms, objects, soils, and their coefficients.",
    "sim": "The plant, its water, the sensors, the loop, logs and judgement.",
    "perception": "From measurements to what is where.",
    "controllers": "From estimates and plans to commands.",
    "calib": "The arm's kinematics from touches.",
    "uuv": "Scenarios, tasks, perturbations, studies and the command `uuv`.",
}
_EQUATION = re.compile(r'<(div|span) class="arithmatex">\\[\[(](.*?)\\[\])]</\1>', flags=re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Adds api/ROOM.md for each room."""
    for room, about in ROOMS.items():
        text = f"# {room}\n\n{about}\n\n::: {'uuv' if room == 'uuv' else f'uuv.{room}'}\n"
        files.append(File.generated(config, f"api/{room}.md", content=text))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Equations as MathML."""
    return _EQUATION.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    display = "block" if found[1] == "div" else "inline"
    return convert(html.unescape(found[2]).strip(), display=display)
