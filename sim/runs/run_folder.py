"""Output folders: each run gets a new folder, so that the files in it belong together."""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import folder_given, folder_name, regular
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.saving import write_whole

RUNS = Path("runs")  # in the working directory
BEGUN = "run.json"  # file in a run's folder from the start, with command and time
LATEST = "latest"
_LONGEST_NAME = 255  # [bytes] of a folder
# format number of the files in a run's folder; files of the first format have no such entry
FORMAT = 2
FORMAT_KEY = "format"  # key of that number in scenario.toml and metrics.json


@dataclass(frozen=True, slots=True)
class _Claimed:
    """Folder in which this process began a run."""

    folder: Path
    is_new: bool  # whether this process created the folder
    latest: Path | None = None  # link to the folder


_claimed: list[_Claimed] = []


def new_folder(scenario: str, out: Path | None = None, seed: int | None = None) -> Path:
    """Create and claim a folder for one run.

    Args:
        scenario: Name of the scenario.
        out: Folder to use; default: runs/<scenario>/<time>-<seed>, to which a link "latest" in the
            same folder then points.
        seed: Part of the default name.

    Returns:
        The folder.

    Raises:
        ConfigurationError: The name is not valid for a folder, `out` is not empty, or the folder
            cannot be created.
    """
    folder_name(scenario, "name")
    if out is not None:
        folder_given(out, "--out")
        is_new = True
        try:
            try:
                out.mkdir(parents=True)
            except FileExistsError:
                is_new = False
            used = any(out.iterdir())
        except OSError as error:
            raise _cannot(out, error) from error

        if used or not _claim(out, scenario):
            raise ConfigurationError(
                f"--out {out}: must be a new or an empty folder; this one is already in use"
            )

        _claimed.append(_Claimed(out, is_new))
        return out

    name = f"{datetime.now():%Y%m%d-%H%M%S}" + ("" if seed is None else f"-{seed}")
    folder = _next_to_others(RUNS / scenario, name)
    latest = folder.parent / LATEST

    _claim(folder, scenario)
    _claimed.append(_Claimed(folder, True, latest))
    point_to(latest, folder.name)
    return folder


def checked_format(document: Any, what: str) -> None:
    """Refuse a document in a run's folder, given as tables, that has a later format.

    Raises:
        ConfigurationError: The format is not a format number, or later than FORMAT; the message
            begins with `what`.
    """
    number = document.get(FORMAT_KEY, 1) if isinstance(document, Mapping) else 1
    if not isinstance(number, int) or isinstance(number, bool) or number < 1:
        raise ConfigurationError(
            f"{what}: {FORMAT_KEY}: must be a whole number >= 1, got {shown(number)}"
        )

    if number > FORMAT:
        raise ConfigurationError(
            f"{what}: {FORMAT_KEY}: must be 1 to {FORMAT} for this version of uuv, got {number}, "
            "of a later version"
        )


def _next_to_others(home: Path, name: str) -> Path:
    """Create the folder `name` in `home`, or `name`.2 and so on if another run began in the same
    second.
    """
    for number in count(1):
        folder = home / (name if number == 1 else f"{name}.{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError as error:
            if not folder.is_dir():
                raise _cannot(folder, error) from error
        except OSError as error:
            raise _cannot(folder, error) from error
        else:
            return folder
    raise AssertionError  # count has no end


def claimed_folder() -> Path:
    """Folder of the last run that this process began.

    Raises:
        ConfigurationError: The process began no run.
    """
    if not _claimed:
        raise ConfigurationError("no run was begun")
    return _claimed[-1].folder


def works_in(folder: Path) -> None:
    """Note that this process writes results to `folder`, which has earlier ones: a resumed
    study.
    """
    _claimed.append(_Claimed(folder, is_new=False))


def give_back() -> None:
    """Remove the folders of runs that this process began but wrote no results to.

    A folder that the process did not create stays, empty as before.
    """
    while _claimed:
        claimed = _claimed.pop()
        folder = claimed.folder
        latest = claimed.latest
        try:
            if [path.name for path in folder.iterdir()] != [BEGUN]:
                continue
            (folder / BEGUN).unlink()

            if claimed.is_new:
                folder.rmdir()

            if latest is not None and latest.is_symlink() and not latest.exists():
                latest.unlink()
                if others := sorted(path.name for path in folder.parent.iterdir() if path.is_dir()):
                    point_to(latest, others[-1])
        except OSError:
            continue  # an error leaves the folder as it is


def point_to(latest: Path, name: str) -> None:
    """Let `latest` refer to `name` in the same folder, by a link or, without links, by a file with
    the name.
    """
    part = latest.with_name(f".{latest.name}.{os.getpid()}")
    try:
        part.unlink(missing_ok=True)
        part.symlink_to(name, target_is_directory=True)
        part.replace(latest)
    except (OSError, NotImplementedError):
        part.unlink(missing_ok=True)
        write_whole(latest, name + "\n")


def pointed_to(latest: Path) -> Path:
    """Folder that a link or a file by `point_to` refers to; any other path as it is."""
    if latest.is_symlink():
        return latest.parent / latest.readlink()
    if latest.name != LATEST or not latest.is_file():
        return latest
    with regular(latest, LATEST) as file:
        name = file.read(_LONGEST_NAME).decode(errors="replace").strip()
    if Path(name).name != name:
        raise ConfigurationError(
            f"{latest}: must have the name of a run beside it, got {shown(name)}"
        )
    return latest.parent / name


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Context manager with an exclusive lock on `folder`, which the end of the process also frees.

    Raises:
        ConfigurationError: Another process holds it, or the file system has no locks.
    """
    try:
        # A link is not followed, because the file that it refers to would be emptied.
        number = os.open(
            folder / ".lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666
        )
        lock = os.fdopen(number, "r+")
    except OSError as error:
        raise _cannot(folder, error) from error
    with lock as file:
        try:
            locked = _locked(file.fileno())
        except OSError as error:
            raise ConfigurationError(
                f"{folder}: its file system does not support locks ({error.strerror})"
            ) from error

        if not locked:
            file.seek(0)
            raise ConfigurationError(
                f"{folder}: in use by the process {file.read().strip() or '?'}"
            )

        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


def _locked(file: int) -> bool:
    """Return True if this process now has the lock on an open file.

    Raises OSError if locks are not supported.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        lock = getattr(msvcrt, "locking")  # noqa: B009  pyright knows it on Windows only
        try:
            lock(file, getattr(msvcrt, "LK_NBLCK"), 1)  # noqa: B009  likewise
        except OSError:
            return False
        return True

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _claim(folder: Path, scenario: str) -> bool:
    """True if this process is the first to begin a run in `folder`; an error if it is read-only."""
    begun = {
        "scenario": scenario,
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
    }

    try:
        with (folder / BEGUN).open("x", encoding="utf-8") as file:
            file.write(json.dumps(begun, indent=2) + "\n")
    except FileExistsError:
        return False
    except OSError as error:
        raise ConfigurationError(
            f"--out {folder}: cannot be written to ({error.strerror})"
        ) from error
    return True


def _cannot(folder: Path, error: OSError) -> ConfigurationError:
    return ConfigurationError(f"--out {folder}: the folder cannot be created ({error.strerror})")
