"""Compiled loops that are kept between runs, and what they are compiled from in other files."""

import hashlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])


def keyed_by_imports(function: F) -> F:
    """For below `@numba.njit(cache=True)`, in a file that takes compiled functions or numbers from another.

    Numba keeps machine code until the file of the function itself changes, though it holds that of all it calls. It
    names its files by `__qualname__`, so with `imports_stamp` in there a change elsewhere is met by other names.
    """
    function.__qualname__ += f".{imports_stamp(function.__globals__)}"
    return function


def imports_stamp(namespace: Mapping[str, Any]) -> str:
    """A word of 12 letters that changes with what compiled code in the module `namespace` may take from other files.

    That is the source of each compiled function imported, and of those that its file imports in turn, and the numbers.
    """
    digest = hashlib.sha256()
    for part in _parts(namespace, {str(namespace.get("__file__"))}):
        digest.update(part)
    return digest.hexdigest()[:12]


def _parts(namespace: Mapping[str, Any], seen: set[str]) -> Iterator[bytes]:
    for name, value in sorted(namespace.items()):
        if hasattr(value, "__wrapped__"):  # numba's functions say so what they were made of
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
