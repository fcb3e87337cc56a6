"""The project's own Python files: under which module names they are, and their syntax trees, each
parsed and walked once.
"""

import ast
import subprocess
from collections.abc import Collection, Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("models", "sim", "controllers", "perception", "calib")
PRODUCT = ("uuv", *ROOMS, "scripts")  # folders of the checkout with code that is not a test


def tracked(*patterns: str) -> list[Path]:
    """Files under version control and new ones beside them; in a copy without one, all."""
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *patterns]
    try:
        listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        everything = [path for pattern in patterns for path in ROOT.rglob(pattern)]
        return [path for path in everything if ".venv" not in path.parts]

    return [
        ROOT / name for name in sorted({*listed.stdout.splitlines()}) if (ROOT / name).is_file()
    ]


def name_of(path: Path) -> str:
    """A file as it is called in messages and ratchets: its path in the checkout."""
    return path.relative_to(ROOT).as_posix()


@cache
def sources() -> tuple[Path, ...]:
    """All Python files of the product."""
    return tuple(path for path in tracked("*.py") if path.relative_to(ROOT).parts[0] in PRODUCT)


@cache
def parsed(path: Path) -> ast.Module:
    """A file's syntax tree; not at import, which every process does that collects the tests."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file's tree, for the many rules that look at each: a walk takes longer than
    they do.
    """
    return tuple(ast.walk(parsed(path)))


@cache
def modules() -> dict[str, Path]:
    """Files by the module names under which they are imported: those of `uuv`, its rooms and the
    experiments.
    """
    homes = {
        "uuv": "uuv",
        "scripts/experiments": "experiments",
        **{room: f"uuv.{room}" for room in ROOMS},
    }
    named = {}
    for path in sources():
        for folder, package in homes.items():
            if path.is_relative_to(ROOT / folder):
                inner = path.relative_to(ROOT / folder).with_suffix("").parts
                named[".".join([package, *(part for part in inner if part != "__init__")])] = path
    return named


@cache
def imports() -> dict[str, frozenset[str]]:
    """Modules of the project that each one imports anywhere: at its top, inside functions and for
    type checkers.
    """
    return {
        module: frozenset(imported_by(nodes(path), modules())) for module, path in modules().items()
    }


def imported_by(statements: Iterable[ast.AST], known: Collection[str]) -> set[str]:
    """Those of the `known` modules that a module imports, packages for the sake of a name in them
    included.
    """
    names: set[str] = set()
    for node in statements:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in known else node.module for name in inner}
    return {name for name in names if name in known}


def circles(graph: dict[str, frozenset[str]]) -> list[list[str]]:
    """Groups of modules that import each other, directly or by way of others (Tarjan's components
    of two and more).
    """
    order: dict[str, int] = {}  # in which a module was first met
    lowest: dict[str, int] = {}  # earliest module that it reaches
    open_modules: list[str] = []
    circular: list[list[str]] = []

    def visit(module: str) -> None:
        order[module] = lowest[module] = len(order)
        open_modules.append(module)
        for other in sorted(graph.get(module, ())):
            if other not in order:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in open_modules:
                lowest[module] = min(lowest[module], order[other])

        if lowest[module] == order[module]:
            at = open_modules.index(module)
            group = open_modules[at:]
            open_modules[at:] = []
            if len(group) > 1:
                circular.append(sorted(group))

    for module in sorted(graph):
        if module not in order:
            visit(module)
    return circular
