"""Numba's on-disk cache: keys for kernels that depend on other files, and files that two processes may write."""

import hashlib
import importlib
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
    name_files_by_key()
    function.__qualname__ += f".{imports_stamp(function.__globals__)}"
    return function


@cache
def name_files_by_key() -> None:
    """Let numba name its code files by their key, and write them before the index that names them.

    Numba numbers the code files of a function and writes the index first. Of two processes that compile different
    signatures at the same time, one may then load the machine code of the other's.
    """
    caching = importlib.import_module("numba.core.caching")  # loaded by then, for the decorator above
    caching.IndexDataCacheFile.save = _save


def _save(file: Any, key: Any, data: Any) -> None:
    """`IndexDataCacheFile.save`; an index entry that is lost in a race only costs another compilation."""
    name = f"{file._index_name.removesuffix('.nbi')}.{hashlib.sha256(file._dump(key)).hexdigest()[:12]}.nbc"
    file._save_data(name, data)
    overloads = file._load_index()
    overloads[key] = name
    file._save_index(overloads)


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
