"""Files that a result depends on: sources of loaded modules of project and user, and their data
files.
"""

import hashlib
import os
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from uuv.sim.interfaces.files import regular
from uuv.sim.runs.command_line import is_installed
from uuv.sim.runs.provenance import HOME

PACKAGES = frozenset(("uuv", "experiments"))  # folder of the project, wherever it is installed

_MOST_BYTES = 1_000_000_000  # largest size of a file


def loaded_files() -> frozenset[str]:
    """Source files of the project's and the user's modules that this process has loaded, and their
    data files.

    Data files are all other files in a package's folder. Paths of files in the checkout are
    relative to it.
    """
    files: set[str] = set()
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and file.endswith(".py"):
            files.update(_with_data(name.partition(".")[0], file))

    return frozenset(files)


def new_digests() -> dict[str, str]:
    """Digests of those `loaded_files` that this process has not reported before. Reported files are
    not read again.

    A process that loads a file after it was changed therefore reports another digest. The result
    includes digests that child processes have reported since the last call (`told_by_another`).
    """
    files = loaded_files() - _reported
    _reported.update(files)
    new = digests(files) | _of_others
    _of_others.clear()
    return new


def told_by_another(code: Mapping[str, str]) -> None:
    """Take the digests of files that a child process has loaded; `new_digests` includes them."""
    _of_others.update(code)


def file_of(module: str) -> str:
    """File of a module that is not imported here, named as in `loaded_files`.

    Raises:
        ImportError: There is no such module, or the module has no file.
    """
    try:
        spec = find_spec(module)
    except ValueError as error:
        raise ModuleNotFoundError(module) from error

    if spec is None or spec.origin is None or not Path(spec.origin).is_file():
        raise ModuleNotFoundError(module)
    return _named(Path(spec.origin).resolve())


_reported: set[str] = set()
_of_others: dict[str, str] = {}


def digests(files: Iterable[str]) -> dict[str, str]:
    """Digest of the content of each of `files`, named as in `loaded_files`; empty for a missing
    file.
    """
    return {file: _digest(HOME / file) for file in sorted(files)}


@cache
def _with_data(package: str, file: str) -> tuple[str, ...]:
    """A module's file and its data files; none for an installed module of another project."""
    if package not in PACKAGES and is_installed(Path(file)):
        return ()

    # For a module of a package: all files of its folder except sources.
    path = Path(file).resolve()
    files = [path]
    if (path.parent / "__init__.py").exists():
        files += [
            other
            for other in path.parent.iterdir()
            if other.is_file() and other.suffix not in (".py", ".pyc")
        ]
    return tuple(map(_named, files))


def _named(file: Path) -> str:
    return str(file.relative_to(HOME) if file.is_relative_to(HOME) else file)


def _digest(file: Path) -> str:
    """Digest of a file; empty if there is none, or if it is too large to be source or data of the
    project.
    """
    try:
        with regular(file, "file") as stream:
            large = os.fstat(stream.fileno()).st_size > _MOST_BYTES
            return "" if large else hashlib.file_digest(stream, "sha256").hexdigest()[:16]
    except (OSError, ValueError):  # also for a name that is not a file name
        return ""
