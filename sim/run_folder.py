"""The folder of a run: new, and of one run alone, so that what lies in it belongs together."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

from sim.interfaces.errors import ConfigurationError
from sim.saving import write_whole

_claimed: list[Path] = []  # by this process
RUNS = Path("runs")  # where the user stands
BEGUN = "run.json"  # in a run's folder from the beginning: what was asked for, and when
LATEST = "latest"


def new_folder(scenario: str, out: Path | None = None, seed: int | None = None) -> Path:
    """A folder for one run, made and claimed: `out`, or runs/<scenario>/<time>-<seed> with "latest" beside it.

    Raises ConfigurationError for an `out` in which there is something already, and where no folder can be made.
    """
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
            used = any(out.iterdir())
        except OSError as error:
            raise _cannot(out, error) from error
        if used or not _claim(out, scenario):
            raise ConfigurationError(f"--out {out}: is in use already; each run needs a new or empty folder of its own")
        return out
    name = f"{datetime.now():%Y%m%d-%H%M%S}" + ("" if seed is None else f"-{seed}")
    folder = _next_to_others(RUNS / scenario, name)
    _claim(folder, scenario)
    point_to(folder.parent / LATEST, folder.name)
    return folder


def _next_to_others(home: Path, name: str) -> Path:
    """A new folder `name` in `home`, or `name`.2 and so on where another run began in the same second."""
    for again in count(1):
        folder = home / (name if again == 1 else f"{name}.{again}")
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


def give_back() -> None:
    """Leave no trace of folders that this process claimed and wrote nothing to: the run was refused at the door."""
    while _claimed:
        folder = _claimed.pop()
        try:
            if [path.name for path in folder.iterdir()] != [BEGUN]:
                continue
            (folder / BEGUN).unlink()
            folder.rmdir()
            latest = folder.parent / LATEST
            if latest.is_symlink() and not latest.exists():
                latest.unlink()
                if others := sorted(path.name for path in folder.parent.iterdir() if path.is_dir()):
                    point_to(latest, others[-1])
        except OSError:
            continue  # it stays as it is


def point_to(latest: Path, name: str) -> None:
    """Let `latest` lead to `name` beside it: by a link or, where there are none, as a file that holds the name."""
    part = latest.with_name(f".{latest.name}.{os.getpid()}")
    try:
        part.unlink(missing_ok=True)
        part.symlink_to(name, target_is_directory=True)
        part.replace(latest)
    except (OSError, NotImplementedError):
        part.unlink(missing_ok=True)
        write_whole(latest, name + "\n")


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold `folder` against other processes, for as long as this one lives: a lock is gone with its process.

    Raises ConfigurationError if another holds it.
    """
    try:
        lock = (folder / ".lock").open("a+")
    except OSError as error:
        raise _cannot(folder, error) from error
    with lock as file:
        if not _locked(file.fileno()):
            file.seek(0)
            raise ConfigurationError(f"{folder}: process {file.read().strip() or '?'} is at work in it")
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


def _locked(file: int) -> bool:
    """Whether this process has the lock on an open file now."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        lock = getattr(msvcrt, "locking")  # noqa: B009  pyright knows it on Windows only
        try:
            lock(file, getattr(msvcrt, "LK_NBLCK"), 1)  # noqa: B009
        except OSError:
            return False
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _claim(folder: Path, scenario: str) -> bool:
    """Whether this process is the first to begin a run in `folder`. ConfigurationError where it cannot be written."""
    begun = {"scenario": scenario, "begun": datetime.now(UTC).isoformat(timespec="seconds"), "command": sys.argv}
    try:
        with (folder / BEGUN).open("x", encoding="utf-8") as file:
            file.write(json.dumps(begun, indent=2) + "\n")
    except FileExistsError:
        return False
    except OSError as error:
        raise ConfigurationError(f"--out {folder}: cannot be written to ({error.strerror})") from error
    _claimed.append(folder)
    return True


def _cannot(folder: Path, error: OSError) -> ConfigurationError:
    return ConfigurationError(f"--out {folder}: cannot be made a folder ({error.strerror})")
