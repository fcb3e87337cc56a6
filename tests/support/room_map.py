"""The map of rooms in CONTRIBUTING.md, as the tree is: what each package is for, and the order of
imports.

./uvw run tests/support/room_map.py    writes it anew
"""

import ast
import tomllib
from collections.abc import Iterator

from source_tree import ROOMS, ROOT, modules, parsed

FILE = ROOT / "CONTRIBUTING.md"
BEGIN = "<!-- map of rooms: written by ./uvw run tests/support/room_map.py -->"
END = "<!-- end of the map -->"


def room_map() -> str:
    """Table of the packages, and a line for the layers of each room."""
    rows = [f"| `{folder}/` | {purpose} |" for folder, purpose in packages()]
    orders = [f"- `{room}`: {' > '.join(layers)}" for room, layers in orders_of_imports()]
    return "\n".join(["| folder | content |", "|---|---|", *rows, "", *orders])


def packages() -> Iterator[tuple[str, str]]:
    """Folder and summary of each package two levels deep; of the experiments, their subjects."""
    tops = [f"uuv.{room}" for room in ROOMS] + ["uuv", "experiments"]
    named = {name: path for name, path in modules().items() if path.name == "__init__.py"}
    for top in tops:
        inside = [
            name
            for name in named
            if name.startswith(f"{top}.") and name.count(".") == top.count(".") + 1
        ]
        for name in [top, *(name for name in sorted(inside) if name not in tops)]:
            folder = named[name].parent.relative_to(ROOT).as_posix()
            text = ast.get_docstring(parsed(named[name])) or ""
            yield folder, " ".join(text.partition("\n\n")[0].split())


def orders_of_imports() -> Iterator[tuple[str, list[str]]]:
    """Each package with layers of its own, and these, the topmost first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    for contract in contracts:
        for container in contract.get("containers", ()):
            yield container.removeprefix("uuv."), contract["layers"]


def with_map(page: str) -> str:
    """A page with the map between its marks as it should be.

    Raises:
        ValueError: The page lacks a mark.
    """
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page has no {BEGIN} ... {END}")
    return f"{head}{BEGIN}\n\n{room_map()}\n\n{END}{tail}"


if __name__ == "__main__":
    FILE.write_text(with_map(FILE.read_text(encoding="utf-8")), encoding="utf-8")
