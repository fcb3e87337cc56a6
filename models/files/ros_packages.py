"""Where the packages of ROS and the models of Gazebo lie that a vehicle's file names.

A package is looked for in the folders of ROS_PACKAGE_PATH and the like, among the folders above the
file and beside them, and, of a file that is itself in a package, in the workspace around that one.
"""

import os
from collections.abc import Iterator
from functools import lru_cache
from itertools import islice
from pathlib import Path

_PATHS = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
_MARKS = ("package.xml", "model.config")  # files by which a folder is a package, or a model
_ABOVE = 4  # folders above the file below which the end of a mesh's path is looked for
_AROUND = 3  # folders above a package in which others are looked for
_BELOW = 6  # depth of that search
_MOST = 20_000  # folders that are looked into


def package_folder(package: str, folder: Path) -> Path | None:
    """Folder of a package or model; None: there is none.

    Args:
        package: its name.
        folder: of the file that names it.
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
    """File of a mesh that a vehicle's file names, whatever its format; None: there is none.

    A plain path counts from the file's folder. A package is looked for (`package_folder`), and
    where it is not found, the end of the path below the file's folder or those above, with at
    least one folder, and last its name beside the file.

    Args:
        name: path, file://, package:// or model://.
        folder: of the file.
    """
    plain = name.removeprefix("file://")
    folder = folder.resolve()
    tried = [folder / plain]

    # A package: as a folder above, or beside one, whatever marks it; else by its mark.
    if "://" in plain:
        plain = plain.partition("://")[2]
        package, _, rest = plain.partition("/")
        above = [folder, *folder.parents]
        tried = [base / package / rest for base in above] + [
            base / rest for base in above if base.name == package
        ]
        if (marked := package_folder(package, folder)) is not None:
            tried.append(marked / rest)

    # The end of the path below the file's folder or those above, with a folder of its own: of a
    # bare name there may be another vehicle's. Beside the file the name will do.
    parts = Path(plain).parts
    near = [folder, *folder.parents][:_ABOVE]
    tried += [base.joinpath(*parts[k:]) for k in range(len(parts) - 1) for base in near]
    tried.append(folder / Path(plain).name)

    return next((path.resolve() for path in tried if path.is_file()), None)


def look_anew() -> None:
    """Forget what packages there are: some may have come since."""
    _below.cache_clear()


def _stated() -> list[str]:
    return [
        entry for path in _PATHS for entry in os.environ.get(path, "").split(os.pathsep) if entry
    ]


def _is_package(folder: Path) -> bool:
    try:
        return any((folder / mark).is_file() for mark in _MARKS)
    except OSError:  # a folder that may not be read
        return False


@lru_cache(maxsize=64)
def _below(base: Path) -> dict[str, Path]:
    """Packages below a folder by their folders' names, those near it first; see `look_anew`."""
    packages: dict[str, Path] = {}
    for folder in islice(_folders(base), _MOST):
        if folder.name not in packages and _is_package(folder):
            packages[folder.name] = folder

    return packages


def _folders(base: Path) -> Iterator[Path]:
    """A folder and those below it, level by level; hidden ones and links are left out."""
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
