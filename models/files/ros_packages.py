"""Search of the ROS packages and Gazebo models that a vehicle's file names.

A package is searched for in the folders of ROS_PACKAGE_PATH and similar variables, and among the
folders above the file and their siblings. If the file is itself in a package, the workspace of that
package is searched too.
"""

import os
from collections.abc import Iterator
from functools import lru_cache
from itertools import islice
from pathlib import Path

_PATHS = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
_MARKS = ("package.xml", "model.config")  # files that mark a folder as a package, or as a model
_ABOVE = 4  # number of folders above the file in which the end of a mesh's path is searched for
_AROUND = 3  # number of folders above a package in which other packages are searched for
_BELOW = 6  # depth of that search
_MOST = 20_000  # largest number of folders that are searched


def package_folder(package: str, folder: Path) -> Path | None:
    """Folder of a package or model; None if it is not found.

    Args:
        package: name of the package or model.
        folder: folder of the file that names it.
    """
    folder = folder.resolve()
    above = [folder, *folder.parents]

    for base in above:
        if base.name == package:
            return base
        if (base / package).is_dir() and _is_package(base / package):
            return base / package

    inside = next((k for k, base in enumerate(above) if _is_package(base)), None)
    workspace = [] if inside is None else above[inside + 1 : inside + 1 + _AROUND]
    searched = [Path(path) for path in _stated()] + [base for base in workspace if base.name]

    return next((known[package] for base in searched if package in (known := _below(base))), None)


def mesh_file(name: str, folder: Path) -> Path | None:
    """File of a mesh, of any format, that a vehicle's file names; None if it is not found.

    A plain path is relative to the file's folder. Of package:// and model:// the package is
    searched for (`package_folder`). If it is not found, the end of the path, with at least one
    folder, is searched for below the file's folder and the folders above, and at last the bare name
    in the file's folder.

    Args:
        name: path, file://, package:// or model://.
        folder: folder of the file.
    """
    plain = name.removeprefix("file://")
    folder = folder.resolve()
    tried = [folder / plain]

    # A package is a folder above or a sibling of one, even without a mark; any other folder needs
    # the mark.
    if "://" in plain:
        plain = plain.partition("://")[2]
        package, _, rest = plain.partition("/")
        above = [folder, *folder.parents]
        tried = [base / package / rest for base in above] + [
            base / rest for base in above if base.name == package
        ]
        if (marked := package_folder(package, folder)) is not None:
            tried.append(marked / rest)

    # The end of the path is searched for with at least one folder, since a bare name may be the
    # mesh of another vehicle. In the file's own folder the bare name suffices.
    parts = Path(plain).parts
    near = [folder, *folder.parents][:_ABOVE]
    tried += [base.joinpath(*parts[k:]) for k in range(len(parts) - 1) for base in near]
    tried.append(folder / Path(plain).name)

    return next((path.resolve() for path in tried if path.is_file()), None)


def look_anew() -> None:
    """Clear the stored search results, since packages may have been added."""
    _below.cache_clear()


def _stated() -> list[str]:
    return [
        entry for path in _PATHS for entry in os.environ.get(path, "").split(os.pathsep) if entry
    ]


def _is_package(folder: Path) -> bool:
    try:
        return any((folder / mark).is_file() for mark in _MARKS)
    except OSError:  # a folder without permission to read
        return False


@lru_cache(maxsize=64)
def _below(base: Path) -> dict[str, Path]:
    """Packages below a folder by their folders' names, near ones first. The result is stored until
    `look_anew`.
    """
    packages: dict[str, Path] = {}
    for folder in islice(_folders(base), _MOST):
        if folder.name not in packages and _is_package(folder):
            packages[folder.name] = folder

    return packages


def _folders(base: Path) -> Iterator[Path]:
    """A folder and those below it, level by level, without hidden folders and links."""
    level = [base]
    for _ in range(_BELOW):
        following: list[Path] = []
        for folder in level:
            yield folder
            try:
                entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
                following += [
                    Path(entry.path)
                    for entry in entries
                    if entry.is_dir(follow_symlinks=False) and not entry.name.startswith(".")
                ]
            except OSError:
                continue

        level = following
