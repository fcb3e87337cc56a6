"""Cache keys for numba kernels that depend on code or constants in other files."""

import hashlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])


def keyed_by_imports(function: F) -> F:
    """Decorator below `@numba.njit(cache=True)` for kernels that use compiled functions or constants of other files.

    Numba invalidates cached machine code only when the file of the function itself changes, though the code contains
    that of all it calls. It names its cache files by `__qualname__`. With `imports_stamp` in that name, a change
    elsewhere leads to new files.
    """
    function.__qualname__ += f".{imports_stamp(function.__globals__)}"
    return function


def imports_stamp(namespace: Mapping[str, Any]) -> str:
    """Hash of 12 characters over everything that kernels of the module `namespace` may take from other files.

    That is the source of each imported compiled function, of those that its file imports in turn, and the constants.
    """
    digest = hashlib.sha256()
    for part in _parts(namespace, {str(namespace.get("__file__"))}):
        digest.update(part)
    return digest.hexdigest()[:12]


def _parts(namespace: Mapping[str, Any], seen: set[str]) -> Iterator[bytes]:
    for name, value in sorted(namespace.items()):
        if hasattr(value, "__wrapped__"):  # numba's functions refer so to their Python source
            origin = inspect.unwrap(value)
            file = inspect.getfile(origin)
            if file not in seen:
                seen.add(file)
                yield _source(file)
                yield from _parts(origin.__globals__, seen)
        elif isinstance(value, (int, float, tuple)) and not name.startswith("__"):
            yield f"{name}={value!r};".encode()


@cache
def _source(file: str) -> bytes:
    return Path(file).read_bytes()
