"""Store of compiled kernels: a shared folder of the user, with one file for each kernel and
signature.

A file is named by the hash of its stamp, and holds the stamp, the machine code and the code's hash.
It is written under another name and then renamed, so that no reader sees an incomplete file. A
reader ignores a file that belongs to another user, that others may write, that is truncated, or
whose stamp differs.

`UUV_KERNEL_STORE` names the folder, or is `off`. The default is `uuv-arm/kernel-store` in the
user's cache folder or, if that is impossible, in the temporary folder. `UUV_KERNEL_STORE_MB` limits
the size of the store; the least recently used files are removed first.
"""

import contextlib
import hashlib
import json
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from uuid import uuid4

from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.tables import TableReader

FOLDER = "UUV_KERNEL_STORE"  # environment variable: a folder, or OFF
LIMIT = "UUV_KERNEL_STORE_MB"  # environment variable: largest size in megabytes
OFF = "off"
DEFAULT_LIMIT = 512.0  # [MB]

_MAGIC = b"uuv kernel 1\n"
# suffixes of complete files, and of files that are being written
_SUFFIX, _PART = ".kernel", ".part"
_LAST_START = "last_start.json"
_SHORT = 10_000  # [bytes] more than it has
_STALE = 3600.0  # [s] age from which a partial file counts as left by a process that died
_RECENT = 3600.0  # [s] a use is recorded at most once in this time


@dataclass(frozen=True, slots=True)
class LastStart:
    """Numbers of kernels loaded and compiled at one start of a run."""

    loaded: int  # loaded from the store
    compiled: int  # compiled
    time: float  # [s] since the epoch


@dataclass(frozen=True, slots=True)
class StoreContent:
    """Content of the store."""

    folder: Path | None  # None if there is no store
    why: str  # why there is no store, or why it is not at the usual place; empty otherwise
    files: int
    bytes: int
    limit: int  # [bytes]
    oldest: float  # [s] since the epoch, oldest last use of a file; 0 if there is no file
    newest: float  # [s] the same for the most recent use


@dataclass(frozen=True, slots=True)
class _Place:
    folder: Path | None
    why: str = ""


def folder() -> Path | None:
    """The store's folder; None if there is none, in which case each process compiles for itself."""
    return _place().folder


def load(stamp: str) -> bytes | None:
    """Machine code that was kept under this stamp; None if there is none that can be trusted."""
    file = _file(stamp)
    content = None if file is None else _read(file)
    if file is None or content is None:
        return None

    code = _code_of(content, stamp.encode())
    if code is None:
        with contextlib.suppress(OSError):
            file.unlink()  # truncated, or of another stamp
        return None

    _note_use(file)
    return code


def holds(stamp: str) -> bool:
    """True if there is a file with this stamp, whatever its content."""
    file = _file(stamp)
    return file is not None and file.exists()


def save(stamp: str, code: bytes) -> bool:
    """Keep machine code; False if that was impossible, such as on a full disk."""
    file = _file(stamp)
    if file is None:
        return False

    head = stamp.encode()
    part = file.with_name(f"{uuid4().hex}{_PART}")
    try:
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
            stream.write(
                _MAGIC + len(head).to_bytes(4, "big") + head + hashlib.sha256(code).digest() + code
            )
        part.replace(file)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink()
        return False
    return True


def trim() -> None:
    """Remove the least recently used files, down to the limit, and partial files that nobody
    completes.
    """
    store = folder()
    if store is None:
        return
    time_now = time.time()

    for part in store.glob(f"*{_PART}"):
        with contextlib.suppress(OSError):
            if time_now - part.stat().st_mtime > _STALE:
                part.unlink()

    files = sorted(_files(store), key=lambda entry: entry[1].st_mtime)
    size = sum(about.st_size for _, about in files)
    most = limit()

    for file, about in files:
        if size <= most:
            break
        with contextlib.suppress(OSError):
            file.unlink()
            size -= about.st_size


def empty() -> int:
    """Remove all files of the store; returns their number."""
    store = folder()
    removed = 0
    for file, _ in _files(store) if store is not None else ():
        with contextlib.suppress(OSError):
            file.unlink()
            removed += 1
    return removed


def content() -> StoreContent:
    """Present content of the store."""
    store = _place()
    files = [about for _, about in _files(store.folder)] if store.folder is not None else []
    used = [about.st_mtime for about in files]

    return StoreContent(
        folder=store.folder,
        why=store.why,
        files=len(files),
        bytes=sum(about.st_size for about in files),
        limit=limit(),
        oldest=min(used, default=0.0),
        newest=max(used, default=0.0),
    )


def note_start(loaded: int, compiled: int) -> None:
    """Record how many kernels a start took from the store and compiled, for `last_start`."""
    store = folder()
    if store is None:
        return

    part = store / f"{uuid4().hex}{_PART}"
    with contextlib.suppress(OSError):
        part.write_text(
            json.dumps(asdict(LastStart(loaded, compiled, time.time()))), encoding="utf-8"
        )
        part.replace(store / _LAST_START)


def last_start() -> LastStart | None:
    """The last start that `note_start` recorded; None if there is none."""
    store = folder()
    if store is None:
        return None
    try:
        return TableReader().made(LastStart, json_of(store / _LAST_START, "last start", _SHORT))
    except ConfigurationError:
        return None


def limit() -> int:
    """Largest size of the store in bytes."""
    try:
        megabytes = float(os.environ.get(LIMIT) or DEFAULT_LIMIT)
        return int(megabytes * 1e6) if megabytes >= 0.0 else int(DEFAULT_LIMIT * 1e6)
    except (ValueError, OverflowError):
        return int(DEFAULT_LIMIT * 1e6)


# ---- files


def _file(stamp: str) -> Path | None:
    store = folder()
    return (
        None
        if store is None
        else store / f"{hashlib.sha256(stamp.encode()).hexdigest()[:40]}{_SUFFIX}"
    )


def _files(folder: Path) -> Iterator[tuple[Path, os.stat_result]]:
    for file in folder.glob(f"*{_SUFFIX}"):
        with contextlib.suppress(OSError):
            yield file, file.lstat()


def _read(file: Path) -> bytes | None:
    """Content of a file that belongs to the user and that nobody else may write."""
    try:
        with os.fdopen(os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as stream:
            return stream.read() if _is_trusted(os.fstat(stream.fileno())) else None
    except OSError:
        return None


def _code_of(content: bytes, stamp: bytes) -> bytes | None:
    """Machine code in the content of a file with exactly this stamp; None if it is incomplete."""
    start = len(_MAGIC) + 4 + len(stamp)
    if content[:start] != _MAGIC + len(stamp).to_bytes(4, "big") + stamp:
        return None

    digest = content[start : start + 32]
    code = content[start + 32 :]
    return code if hashlib.sha256(code).digest() == digest else None


def _note_use(file: Path) -> None:
    with contextlib.suppress(OSError):
        if time.time() - file.stat().st_mtime > _RECENT:
            os.utime(file)


# ---- place


def _place() -> _Place:
    return _place_for(os.environ.get(FOLDER, ""), os.environ.get("XDG_CACHE_HOME", ""))


@cache
def _place_for(setting: str, caches: str) -> _Place:
    """Folder of the store, determined once for each process and setting."""
    if setting.lower() == OFF:
        return _Place(None, f"{FOLDER}={OFF}")

    # As the environment variable says.
    if setting:
        folder = Path(setting).expanduser().resolve()
        reason = _unfit(folder)
        if reason:
            print(f"no store of compiled kernels: {FOLDER}={setting}: {reason}", file=sys.stderr)
        return _Place(None if reason else folder, reason)

    # In the user's cache.
    try:
        folder = (Path(caches) if caches else Path.home() / ".cache") / "uuv-arm" / "kernel-store"
        reason = _unfit(folder)
    except RuntimeError:  # no home
        reason = "there is no home folder"
    else:
        if not reason:
            return _Place(folder)

    # Else among temporary files.
    beside = Path(tempfile.gettempdir()) / f"uuv-arm-kernels-{os.getuid()}"
    if not _unfit(beside):
        print(f"compiled kernels are kept in {beside}: {reason}", file=sys.stderr)
        return _Place(beside, reason)

    print(f"no store of compiled kernels, each start compiles: {reason}", file=sys.stderr)
    return _Place(None, reason)


def _unfit(folder: Path) -> str:
    """Reason why `folder` cannot be the store; empty if it can.

    A missing folder is created.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)

        about = folder.lstat()
        if not stat.S_ISDIR(about.st_mode):
            return f"{folder} is no folder"
        if about.st_uid != os.getuid():
            return f"{folder} belongs to another user"
        if about.st_mode & 0o077:
            # the folder belongs to the user; files that others may have put into it are refused one
            # by one
            folder.chmod(0o700)

        probe = folder / f"{uuid4().hex}{_PART}"
        probe.touch(mode=0o600, exist_ok=False)
        probe.unlink()
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    return ""


def _is_trusted(about: os.stat_result) -> bool:
    return stat.S_ISREG(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o022
