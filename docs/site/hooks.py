"""Hooks of the documentation site: pages of the API, notebooks, equations as MathML.

The API shows the promised names first, a page for each group of docs/api.md, then all other names
as internals, a page for each package.
"""

import ast
import html
import re
from functools import cache
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from notebooks import page_of
from promised_names import groups_of

_ROOT = Path(__file__).resolve().parents[2]
_GROUPS = groups_of((_ROOT / "docs" / "api.md").read_text(encoding="utf-8"))
_ROOMS = frozenset({"models", "sim", "perception", "controllers", "calib"})
_LARGEST = 1_000_000  # bytes of a page of the API
_EQUATION = re.compile(r'<(div|span) class="arithmatex">\\[\[(](.*?)\\[\])]</\1>', flags=re.DOTALL)
_PROMISED_NAMES = frozenset(name for group in _GROUPS for name in group.lines)
_NAME = re.compile(r"^\| `(uuv\.[\w.]+)` \|", flags=re.MULTILINE)


# whether notebooks are run: not by `serve`, which builds at each change
_building = {"execute": True}


def on_startup(command: str, **_: Any) -> None:
    """Learns what the site is made for."""
    _building["execute"] = command == "build"


def on_config(config: Any) -> Any:
    """Adds the pages of the API, and those of the experiments, to the navigation."""
    promised = [{group.title: f"api/{group.page}.md"} for group in _GROUPS]
    internals = [{package: f"api/internals/{package}.md"} for package in _packages()]
    (api,) = (entry["API"] for entry in config.nav if "API" in entry)

    api += [*promised, {"Internals": internals}]

    (measured,) = (entry["Measured"] for entry in config.nav if "Measured" in entry)

    # A page for each experiment with rows.
    pages = sorted(path.name for path in (_ROOT / "docs" / "results").glob("*.md"))
    experiments = [f"results/{name}" for name in pages if name != "physics.md"]
    if experiments:
        measured.append({"Experiments": experiments})
    return config


def on_files(files: Files, config: Any) -> Files:
    """Adds api/GROUP.md for each group of promised names, api/internals/PACKAGE.md for each
    package, and notebooks/NAME.md.
    """
    # Promised names, by group.
    for group in _GROUPS:
        entries = "\n".join(map(_entry, group.lines))
        text = f"# {group.title}\n\n[Example, and all names in a list](../api.md).\n\n{entries}"
        files.append(File.generated(config, f"api/{group.page}.md", content=text))

    # All modules, by package.
    for package, modules in _packages().items():
        entries = "\n".join(map(_module_entry, modules))
        text = (
            f"# {package}\n\nInternals: they may change at any time. [What is "
            f"promised](../../api.md).\n\n{entries}"
        )
        files.append(File.generated(config, f"api/internals/{package}.md", content=text))

    for notebook in sorted((_ROOT / "docs" / "notebooks").glob("*.ipynb")):
        text = page_of(notebook, _ROOT, **_building)
        files.append(File.generated(config, f"notebooks/{notebook.stem}.md", content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """In the list of promised names, each is a link to its entry."""
    return _NAME.sub(r"| [`\1`][\1] |", markdown) if page.file.src_uri == "api.md" else markdown


def on_page_content(content: str, **_: Any) -> str:
    """Equations as MathML."""
    return _EQUATION.sub(_mathml, content)


def on_post_build(config: Any) -> None:
    """Refuses a page of the API that is too large to read.

    Raises:
        PluginError: Which one.
    """
    for page in Path(config.site_dir, "api").rglob("*.html"):
        if page.stat().st_size > _LARGEST:
            raise PluginError(
                f"{page}: {page.stat().st_size} bytes, at most {_LARGEST} are allowed"
            )


def _packages() -> dict[str, list[str]]:
    """Modules by package, both dotted; of a package its `__init__` first."""
    found: dict[str, list[str]] = {}
    for room in ("uuv", *sorted(_ROOMS)):
        for file in sorted(
            (_ROOT / room).rglob("*.py"), key=lambda path: path.as_posix().replace("__init__", "")
        ):
            # Its dotted name.
            parts = list(file.relative_to(_ROOT).with_suffix("").parts)
            # a link of the checkout; the room comes by itself
            if parts[0] == "uuv" and parts[1] in _ROOMS:
                continue
            parts = parts if room == "uuv" else ["uuv", *parts]

            is_package = parts[-1] == "__init__"
            parts = parts[:-1] if is_package else parts
            package = ".".join(parts if is_package else parts[:-1])

            # a promised function may bear the name of its module, whose entry would be a second one
            if not parts[-1].startswith("__") and ".".join(parts) not in _PROMISED_NAMES:
                found.setdefault(package, []).append(".".join(parts))
    return found


def _entry(name: str) -> str:
    """Directive of a promised name, and the fields of a dataclass with the remarks that hold their
    units.
    """
    module, _, word = _home(name).rpartition(".")
    fields = [
        line
        for node in _body(module)
        if isinstance(node, ast.ClassDef) and node.name == word and node.decorator_list
        for field in node.body
        if isinstance(field, ast.AnnAssign)
        for line in _texts(module)[0].splitlines()[field.lineno - 1 : field.end_lineno]
    ]
    block = (
        "\n```python\n" + "\n".join(line.removeprefix("    ") for line in fields) + "\n```\n"
        if fields
        else ""
    )
    return f"::: {name}\n    options: {{heading_level: 2}}\n{block}"


def _module_entry(module: str) -> str:
    """Directive of a module that shows its public functions and classes, without those that are
    promised.
    """
    names = [
        node.name for node in _body(module) if isinstance(node, ast.ClassDef | ast.FunctionDef)
    ]
    shown = [
        name for name in names if not name.startswith("_") and f"{module}.{name}" not in _promised()
    ]
    return f"::: {module}\n    options: {{heading_level: 2, members: [{', '.join(shown)}]}}\n"


@cache
def _promised() -> frozenset[str]:
    """Dotted names of all that is promised, in the modules that define it."""
    return frozenset(_home(name) for group in _GROUPS for name in group.lines)


def _home(name: str) -> str:
    """Dotted name of a thing in the module that defines it, by the imports of the module that hands
    it out.
    """
    module, _, word = name.rpartition(".")
    for node in _body(module):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if (alias.asname or alias.name) == word:
                    return _home(f"{node.module}.{alias.name}")
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Name):
            names = [target.id for target in node.targets if isinstance(target, ast.Name)]
            if word in names:
                return _home(f"{module}.{node.value.id}")
    return name


@cache
def _body(module: str) -> list[ast.stmt]:
    """Statements of a module; of a package that hands out names, also those of its stub."""
    return [node for text in _texts(module) for node in ast.parse(text).body]


@cache
def _texts(module: str) -> list[str]:
    """Text of a module; of a package, of its `__init__` and its stub."""
    place = _ROOT.joinpath(*module.split("."))
    files = [place.with_suffix(".py"), place / "__init__.py", place / "__init__.pyi"]
    return [file.read_text(encoding="utf-8") for file in files if file.is_file()]


def _mathml(found: re.Match[str]) -> str:
    display = "block" if found[1] == "div" else "inline"
    equation = convert(html.unescape(found[2]).strip(), display=display)
    # a long one scrolls by itself on a narrow screen
    return f'<div class="equation">{equation}</div>' if display == "block" else equation
