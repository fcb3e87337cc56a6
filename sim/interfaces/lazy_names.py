"""Names that a package imports on first use, listed by the imports in its stub `__init__.pyi`.

    __getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)

Type checkers read the stub itself. In the stub, `from uuv.runner import run as run` provides `run`,
and an assignment such as `Arm = SerialArm` provides an imported name under another name.
"""

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def names_of_stub(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Functions by which a package provides the names of its stub.

    Args:
        package: `__name__` of the package.
        file: `__file__` of the package; the stub is beside it.

    Returns:
        Its `__getattr__`, `__dir__` and `__all__`.
    """
    homes = _homes(Path(file).with_suffix(".pyi"))
    names = sorted(homes)

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}; it has {names}")
        module, original_name = homes[name]
        return getattr(import_module(module), original_name)

    def listed() -> list[str]:
        return sorted({*vars(import_module(package)), *names})

    return get, listed, names


def _homes(stub: Path) -> dict[str, tuple[str, str]]:
    """Module of each name of a stub, and the name in that module."""
    imported: dict[str, tuple[str, str]] = {}
    exports: dict[str, tuple[str, str]] = {}

    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            for alias in node.names:
                imported[alias.asname or alias.name] = node.module, alias.name
                if alias.asname == alias.name:
                    exports[alias.name] = node.module, alias.name

        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Name):
            for target in node.targets:
                if isinstance(target, ast.Name):
                    exports[target.id] = imported[node.value.id]
    return exports
